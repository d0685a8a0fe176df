//! Lengths of edges.
//!
//! # Forward
//! `L = (1 / E) sum_e (|v_i - v_j| - target)^2` over the E edges, summed in [`Scalar::Wide`]; 0 without an
//! edge.
//!
//! # Backward
//! `v_bar_i = (2 L_bar / E) sum_j (1 - target / |v_i - v_j|) (v_i - v_j)` over the neighbours of i.
//!
//! # Where it is not smooth
//! At edges without a length, where the slope is taken as 0; a target of 0 is smooth everywhere.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var, sum};

use super::vertices::{add_by_vertex, check, dot, minus, plus, position};
use crate::topology::Topology;

const NAME: &str = "edge_length_error";

/// Input: positions `[V, 3]`.
struct EdgeLength {
    topology: Topology,
    target: f64,
}

impl EdgeLength {
    /// `1 / E`, or 1 without an edge.
    fn share<S: Scalar>(&self) -> S {
        S::ONE / S::from_f64(self.topology.edges().len().max(1) as f64)
    }
}

impl<T: Scalar> Op<T> for EdgeLength {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        check(NAME, inputs, &self.topology)?;
        let (positions, edges) = (inputs.data(0), self.topology.edges());
        let target = T::Wide::from_f64(self.target);
        let is_short = self.target == 0.0;
        let total = sum::<T>(edges.len(), |e| {
            let [a, b] = edges[e].map(|vertex| position(positions, vertex));
            let edge = minus(a, b);
            let square = dot(edge, edge);
            if is_short {
                return square;
            }
            // Without a length it has no slope, that of a square root least of all.
            let length = if square == T::Wide::ZERO { T::Wide::ZERO } else { square.sqrt() };
            (length - target) * (length - target)
        });
        outputs.push([])[0] = T::narrow(self.share::<T::Wide>() * total);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(bar) = gradients.get(0) else { return };
        let positions = kept.input(0);
        let two = T::Wide::from_f64(2.0);
        let factor = two * self.share::<T::Wide>() * kept.only_upstream()[0].widen();
        let target = T::Wide::from_f64(self.target);
        add_by_vertex(bar, |vertex| {
            let point = position(positions, vertex as u32);
            let mut total = [T::Wide::ZERO; 3];
            for &other in self.topology.neighbors(vertex) {
                let edge = minus(point, position(positions, other));
                let square = dot(edge, edge);
                let pull = if self.target == 0.0 {
                    T::Wide::ONE
                } else if square == T::Wide::ZERO {
                    T::Wide::ZERO
                } else {
                    T::Wide::ONE - target / square.sqrt()
                };
                total = plus(total, edge.map(|x| pull * x));
            }
            total.map(|x| factor * x)
        });
    }
}

/// The mean over the edges of the squared difference of their length and `target`; returns `[]`. With a
/// target of 0, the mean squared length. 0 without an edge.
///
/// # Errors
/// [`TensorError::Shape`] unless the positions are `[V, 3]` with as many vertices as the topology;
/// [`TensorError::Value`] for a target that is not finite and from 0 up.
#[inline(never)]
pub fn edge_length_error<'t, T: Scalar>(
    positions: Var<'t, T>,
    topology: &Topology,
    target: f64,
) -> Result<Var<'t, T>, TensorError> {
    if !(target >= 0.0 && target.is_finite()) {
        let rule = "a finite target length from 0 up".into();
        return Err(TensorError::Value { operation: NAME, rule, value: target });
    }
    positions.tape().apply(EdgeLength { topology: topology.clone(), target }, &[positions])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    #[test]
    fn the_error_and_its_gradient_are_those_worked_out_by_hand() {
        let topology = Topology::new(&[[0, 1, 2]], 4).unwrap();
        let rows = [0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 4.0, 0.0, 9.0, 9.0, 9.0];
        let tape = Tape::<f64>::new();
        let v = tape.leaf(&Tensor::new([4, 3], rows.to_vec()).unwrap());
        for (target, expected, of_1) in [
            (0.0, 50.0 / 3.0, [12.0 / 3.0, -8.0 / 3.0]),
            // Lengths 3, 4 and 5: pulls 1 / 3, 1 / 2 and 3 / 5.
            (2.0, 14.0 / 3.0, [2.0 / 3.0 * (1.0 + 1.8), 2.0 / 3.0 * -2.4]),
        ] {
            let error = edge_length_error(v, &topology, target).unwrap();
            approx::assert_relative_eq!(error.item(), expected, max_relative = 1e-15);
            let gradient = error.backward().unwrap().get_or_zeros(v);
            for axis in 0..2 {
                approx::assert_relative_eq!(gradient[[1, axis]], of_1[axis], max_relative = 1e-14);
            }
            assert_eq!(&gradient.data()[9..], [0.0; 3]);
        }
    }

    #[test]
    fn edges_without_a_length_and_meshes_without_an_edge_have_no_slope() {
        let tape = Tape::<f32>::new();
        let topology = Topology::new(&[[0, 1, 2]], 3).unwrap();
        let point = tape.leaf(&Tensor::full([3, 3], 0.5));
        let error = edge_length_error(point, &topology, 2.0).unwrap();
        assert_eq!(error.item(), 4.0);
        assert_eq!(error.backward().unwrap().get_or_zeros(point), Tensor::zeros([3, 3]));
        let loose = Topology::new(&[], 3).unwrap();
        let error = edge_length_error(point, &loose, 1.0).unwrap();
        assert_eq!(error.item(), 0.0);
        assert_eq!(error.backward().unwrap().get_or_zeros(point), Tensor::zeros([3, 3]));
    }
}
