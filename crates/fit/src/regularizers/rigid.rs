//! As rigid as possible: neighbourhoods turn and move, and otherwise keep the shape of a rest pose.
//!
//! # Forward
//! With rest edges `r_ij = r_i - r_j`, their weights w and the edges `p_ij = p_i - p_j` now:
//! `L = (1 / V) sum_i sum_j w_ij |p_ij - R_i r_ij|^2` over the neighbours j of i, where each R_i is the
//! rotation that makes its own sum smallest (`best_rotation`, of `sum_j w_ij r_ij p_ij'`).
//!
//! # Backward
//! `p_bar_i = (2 L_bar / V) sum_j w_ij (2 p_ij - (R_i + R_j) r_ij)`. The rotations are constants.
//! Each is the best for the present positions, so to first order L does not change with it (envelope theorem). So the
//! gradient is exact.
//!
//! # Where it is not smooth
//! Where several rotations are equally good: a vertex with edges along one line, or turned inside out.
//! One of them is taken.
//!
//! # Source
//! Sorkine and Alexa, *As-rigid-as-possible surface modeling*, SGP 2007, equations 3 and 8.

use std::sync::Arc;

use bokashi_core::parallel::write_each;
use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tensor, TensorError, Var, sum,
};

use super::vertices::{PER_PIECE, Vector, add_by_vertex, check, dot, minus, plus, position};
use crate::best_rotation::best_rotation;
use crate::topology::Topology;

const NAME: &str = "rigidity";

/// The weights of the edges of a neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum RigidWeights {
    /// Equal weights.
    Uniform,
    /// The cotangents of the rest pose, as in the paper. The error then hardly depends on how the surface is cut into
    /// triangles. Negative weights, as of obtuse angles, count as 0: with them the error would have no minimum.
    #[default]
    Cotangent,
}

/// The error of deformations of a mesh that are not rigid, made once from its rest pose. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Rigidity(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    topology: Topology,
    /// Edges at rest and their weights, by the places of neighbours ([`Topology::places`]).
    rest: Vec<(Vector<f64>, f64)>,
}

impl Rigidity {
    /// The error of deformations of `topology` whose vertices rest at `rest`, `[V, 3]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless the positions are `[V, 3]` with as many vertices as the topology;
    /// [`TensorError::Value`] for a position that is not finite.
    pub fn new<T: Scalar>(
        topology: &Topology,
        rest: &Tensor<T>,
        weights: RigidWeights,
    ) -> Result<Self, TensorError> {
        // Checks the positions, too.
        let mut of_places = topology.cotangent_weights(rest)?;
        match weights {
            RigidWeights::Uniform => of_places.fill(1.0),
            RigidWeights::Cotangent => of_places.iter_mut().for_each(|w| *w = w.max(0.0)),
        }
        let rows: Vec<_> =
            rest.data().as_chunks::<3>().0.iter().map(|row| row.map(Scalar::to_f64)).collect();
        let vertices = 0..topology.vertex_count();
        let edges = vertices.flat_map(|vertex| {
            let point = rows[vertex];
            topology.neighbors(vertex).iter().map(move |&other| (point, other))
        });
        let edges = edges.map(|(point, other)| minus(point, rows[other as usize]));
        let rest = edges.zip(of_places).collect();
        Ok(Self(Arc::new(Inner { topology: topology.clone(), rest })))
    }

    /// The mean over vertices of the weighted squared distances between their edges and the rotated edges of the rest
    /// pose; returns `[]`. It is 0 for a mesh that was only moved and turned, and without a vertex.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless the positions are `[V, 3]` with as many vertices as the topology.
    #[inline(never)]
    pub fn error<'t, T: Scalar>(&self, positions: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
        positions.tape().apply(self.clone(), &[positions])
    }

    /// `1 / V`.
    fn share<S: Scalar>(&self) -> S {
        S::ONE / S::from_f64(self.0.topology.vertex_count().max(1) as f64)
    }

    /// The neighbours of `vertex` with their edges at rest and weights.
    #[inline(always)]
    fn around<S: Scalar>(
        &self,
        vertex: usize,
    ) -> impl Iterator<Item = (u32, Vector<S>, S)> + Clone + '_ {
        let Inner { topology, rest } = &*self.0;
        let rest = &rest[topology.places(vertex)];
        topology
            .neighbors(vertex)
            .iter()
            .zip(rest)
            .map(|(&other, &(edge, weight))| (other, edge.map(S::from_f64), S::from_f64(weight)))
    }
}

/// A neighbourhood: its rotation, by rows, and its error.
#[derive(Debug, Clone, Copy)]
pub struct Cell<S> {
    rotation: [Vector<S>; 3],
    error: S,
}

fn turned<S: Scalar>(rotation: &[Vector<S>; 3], edge: Vector<S>) -> Vector<S> {
    rotation.map(|row| dot(row, edge))
}

impl<T: Scalar> Op<T> for Rigidity {
    type Saved = Vec<Cell<T::Wide>>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        cells: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        check(NAME, inputs, &self.0.topology)?;
        let positions = inputs.data(0);
        let zero = T::Wide::ZERO;
        let cell = |vertex: usize| {
            let point = position(positions, vertex as u32);
            let edge = |other| minus(point, position(positions, other));
            let around = self.around::<T::Wide>(vertex);
            let mut moments = [[zero; 3]; 3];
            for (other, rest, weight) in around.clone() {
                let edge = edge(other);
                for (row, r) in moments.iter_mut().zip(rest) {
                    for (entry, p) in row.iter_mut().zip(edge) {
                        *entry += weight * r * p;
                    }
                }
            }
            let rotation = best_rotation(moments);
            let error = around.map(|(other, rest, weight)| {
                let apart = minus(edge(other), turned(&rotation, rest));
                weight * dot(apart, apart)
            });
            Cell { rotation, error: error.sum() }
        };
        let count = self.0.topology.vertex_count();
        cells.resize(count, Cell { rotation: [[zero; 3]; 3], error: zero });
        write_each(cells, PER_PIECE, cell);
        let total = sum::<T>(count, |vertex| cells[vertex].error);
        outputs.push([])[0] = T::narrow(self.share::<T::Wide>() * total);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        cells: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(bar) = gradients.get(0) else { return };
        let (positions, cells) = (kept.input(0), &*cells);
        let two = T::Wide::from_f64(2.0);
        let factor = two * self.share::<T::Wide>() * kept.only_upstream()[0].widen();
        add_by_vertex(bar, |vertex| {
            let point = position(positions, vertex as u32);
            let mut total = [T::Wide::ZERO; 3];
            for (other, rest, weight) in self.around::<T::Wide>(vertex) {
                let edge = minus(point, position(positions, other));
                let here = minus(edge, turned(&cells[vertex].rotation, rest));
                let there = minus(edge, turned(&cells[other as usize].rotation, rest));
                total = plus(total, plus(here, there).map(|x| weight * x));
            }
            total.map(|x| factor * x)
        });
    }

    fn saved_bytes(&self, cells: &Self::Saved) -> usize {
        size_of_val(cells.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tape;

    use super::*;

    /// A bent sheet of 4 x 4 quads, 25 vertices, and one vertex more without a face.
    fn sheet() -> (Topology, Tensor<f64>) {
        let mut faces = Vec::new();
        for k in 0..16 {
            let first = k / 4 * 5 + k % 4;
            faces.extend([[first, first + 1, first + 6], [first, first + 6, first + 5]]);
        }
        let positions = Tensor::from_fn([26, 3], |[v, axis]| {
            let [x, y] = [(v % 5) as f64, (v / 5) as f64];
            [x + 0.1 * y, y, 0.3 * (x * y).sin()][axis]
        });
        (Topology::new(&faces, 26).unwrap(), positions)
    }

    /// Turned by `angle` about z, scaled, and moved.
    fn moved(rest: &Tensor<f64>, angle: f64, scale: f64) -> Tensor<f64> {
        Tensor::from_fn([rest.shape()[0], 3], |[v, axis]| {
            let [x, y, z] = [0, 1, 2].map(|axis| rest[[v, axis]]);
            let (sine, cosine) = angle.sin_cos();
            let turned = [cosine * x - sine * y, sine * x + cosine * y, z];
            scale * turned[axis] + [5.0, -3.0, 0.5][axis]
        })
    }

    #[test]
    fn an_edge_between_wide_angles_has_no_weight() {
        // A thin rhombus with its longer diagonal: the angles at its tips are wide, and their cotangents
        // negative.
        let topology = Topology::new(&[[0, 1, 2], [1, 0, 3]], 4).unwrap();
        let rest = [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]];
        let rest = Tensor::from(rest);
        let rigidity = Rigidity::new(&topology, &rest, RigidWeights::Cotangent).unwrap();
        for (edge, weight) in &rigidity.0.rest {
            // By hand: half of the cotangent of the one angle that a side faces, 2 / 0.5.
            let expected = if edge[1] == 0.0 { 0.0 } else { 2.0 };
            approx::assert_relative_eq!(*weight, expected, max_relative = 1e-14);
        }
    }

    #[test]
    fn what_is_moved_and_turned_is_rigid_and_what_is_scaled_is_not() {
        let (topology, rest) = sheet();
        for weights in [RigidWeights::Uniform, RigidWeights::Cotangent] {
            let rigidity = Rigidity::new(&topology, &rest, weights).unwrap();
            let of = |angle, scale| {
                let tape = Tape::new();
                let positions = tape.leaf(&moved(&rest, angle, scale));
                let error = rigidity.error(positions).unwrap();
                (error.item(), error.backward().unwrap().get_or_zeros(positions))
            };
            for angle in [0.0, 0.7, 3.0, -3.0] {
                let (error, gradient) = of(angle, 1.0);
                assert!(error < 1e-28, "{error}");
                assert!(gradient.data().iter().all(|g| g.abs() < 1e-13));
            }
            // Every edge is off by its own length times 0.5.
            let rest_sum: f64 = rigidity.0.rest.iter().map(|(r, w)| w * dot(*r, *r)).sum();
            let (error, _) = of(1.0, 1.5);
            approx::assert_relative_eq!(error, 0.25 * rest_sum / 26.0, max_relative = 1e-12);
        }
    }

    #[test]
    fn degenerate_neighbourhoods_have_a_finite_error_and_gradient() {
        // A collapsed mesh, a single edge's worth of faces, no face at all.
        for (faces, count) in [(vec![[0, 1, 2]], 3), (vec![[0, 1, 1]], 3), (vec![], 2), (vec![], 0)]
        {
            let topology = Topology::new(&faces, count).unwrap();
            for entry in [|_| 0.0, |k| k as f32, |k| (k * k % 7) as f32] {
                let rest = Tensor::from_flat_fn([count, 3], entry);
                for weights in [RigidWeights::Uniform, RigidWeights::Cotangent] {
                    let rigidity = Rigidity::new(&topology, &rest, weights).unwrap();
                    for now in [|_| 0.0, |k| 1e30 * k as f32, |k| -((k % 4) as f32)] {
                        let tape = Tape::new();
                        let positions = tape.leaf(&Tensor::from_flat_fn([count, 3], now));
                        let error = rigidity.error(positions).unwrap();
                        let gradient = error.backward().unwrap().get_or_zeros(positions);
                        let is_huge = now(1) > 1.0;
                        assert!(is_huge || error.item().is_finite());
                        assert!(gradient.is_finite() && !error.item().is_nan());
                    }
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let (topology, rest) = sheet();
        let lost = rest.map(|x| if x == 0.0 { f64::NAN } else { x });
        assert!(Rigidity::new(&topology, &lost, RigidWeights::Uniform).is_err());
    }
}
