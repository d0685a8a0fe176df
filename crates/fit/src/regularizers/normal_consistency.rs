//! Normal consistency: the angles between neighbouring faces.
//!
//! # Forward
//! `L = (1 / P) sum (1 - n_f . n_g)` over the P pairs of faces that share an edge, with unit normals,
//! as `|n_f - n_g|^2 / 2`, which keeps the digits of small angles. A face that is wound the other way
//! than its neighbour counts with its normal reversed.
//!
//! # Backward
//! `n_bar_f = -(L_bar / P) sum n_g` over the faces beside f. With the cross product c of two sides a and
//! b, `c_bar = (n_bar - n (n . n_bar)) / |c|`, `a_bar = b x c_bar` and `b_bar = c_bar x a`. Each vertex
//! gathers what its corners have.
//!
//! # Where it is not smooth
//! A face without an area, to within the rounding of its sides, has no normal: its pairs count as flat
//! and give no gradient. Beside that the slope grows as 1 over the height of the face.

use bokashi_core::parallel::write_each;
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, TensorError, Var, sum};

use super::vertices::{PER_PIECE, Vector, add_by_vertex, check, cross, dot, minus, plus, position};
use crate::topology::{FacePair, Topology};

const NAME: &str = "normal_error";

/// Input: positions `[V, 3]`.
struct NormalConsistency {
    topology: Topology,
}

/// A face in space.
#[derive(Debug, Clone, Copy)]
struct Facet<S> {
    /// The unit normal; zero where there is none.
    normal: Vector<S>,
    /// Sides from corner 0, and the length of their cross product, in units of `size`.
    sides: [Vector<S>; 2],
    area: S,
    size: S,
}

impl<S: Scalar> Facet<S> {
    fn new(corners: [Vector<S>; 3]) -> Self {
        let zero = [S::ZERO; 3];
        let mut sides = [minus(corners[1], corners[0]), minus(corners[2], corners[0])];
        // By its value: a constant unit, in which no square leaves the range of the numbers.
        let largest = |size: f64, x: &S| size.maximum_or_nan(x.to_f64().abs());
        let size = S::from_f64(sides.iter().flatten().fold(0.0, largest));
        if size == S::ZERO {
            return Self { normal: zero, sides, area: S::ZERO, size: S::ONE };
        }
        sides.iter_mut().flatten().for_each(|x| *x = *x / size);
        let [a, b] = sides;
        let product = cross(a, b);
        let (square, bound) = (dot(product, product), 8.0 * f64::EPSILON);
        let bound = S::from_f64(bound * bound) * dot(a, a) * dot(b, b);
        if square <= bound {
            return Self { normal: zero, sides, area: S::ZERO, size };
        }
        let area = square.sqrt();
        Self { normal: product.map(|x| x / area), sides, area, size }
    }

    /// The gradients of the corners.
    fn pull_back(&self, normal_bar: Vector<S>) -> [Vector<S>; 3] {
        if self.area == S::ZERO {
            return [[S::ZERO; 3]; 3];
        }
        let along = dot(self.normal, normal_bar);
        let share = S::ONE / (self.area * self.size);
        let across: Vector<S> =
            std::array::from_fn(|k| (normal_bar[k] - self.normal[k] * along) * share);
        let (b, c) = (cross(self.sides[1], across), cross(across, self.sides[0]));
        [plus(b, c).map(|x| -x), b, c]
    }
}

/// Facets and normals for the backward pass, and memory.
#[derive(Debug, Default)]
struct Saved<S> {
    facets: Vec<Facet<S>>,
    corner_bars: Vec<[Vector<S>; 3]>,
}

impl NormalConsistency {
    /// `1 / P`, or 1 without a pair.
    fn share<S: Scalar>(&self) -> S {
        S::ONE / S::from_f64(self.topology.pairs().len().max(1) as f64)
    }
}

/// `normal` as the other face of a pair sees it.
fn oriented<S: Scalar>(pair: FacePair, normal: Vector<S>) -> Vector<S> {
    if pair.is_oriented { normal } else { normal.map(|x| -x) }
}

impl<T: Scalar> Op<T> for NormalConsistency {
    type Saved = Saved<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        check(NAME, inputs, &self.topology)?;
        let (positions, faces) = (inputs.data(0), self.topology.faces());
        let facet = |face: [u32; 3]| Facet::new(face.map(|vertex| position(positions, vertex)));
        let facets = &mut saved.facets;
        facets.resize(faces.len(), Facet::new([[T::Wide::ZERO; 3]; 3]));
        write_each(facets, PER_PIECE, |face| facet(faces[face]));
        let (facets, pairs) = (&*facets, self.topology.pairs());
        let total = sum::<T>(pairs.len(), |k| {
            let [f, g] = pairs[k].faces.map(|face| &facets[face as usize]);
            if f.area == T::Wide::ZERO || g.area == T::Wide::ZERO {
                return T::Wide::ZERO;
            }
            let apart = minus(f.normal, oriented(pairs[k], g.normal));
            T::Wide::from_f64(0.5) * dot(apart, apart)
        });
        outputs.push([])[0] = T::narrow(self.share::<T::Wide>() * total);
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(bar) = gradients.get(0) else { return };
        let Saved { facets, corner_bars } = saved;
        let (facets, pairs) = (&*facets, self.topology.pairs());
        let factor = -(self.share::<T::Wide>() * kept.only_upstream()[0].widen());
        corner_bars.resize(facets.len(), [[T::Wide::ZERO; 3]; 3]);
        write_each(corner_bars, PER_PIECE, |face| {
            let mut total = [T::Wide::ZERO; 3];
            for &pair in self.topology.pairs_of(face) {
                let pair = pairs[pair as usize];
                let [f, g] = pair.faces;
                let other = if f as usize == face { g } else { f };
                total = plus(total, oriented(pair, facets[other as usize].normal));
            }
            facets[face].pull_back(total.map(|x| factor * x))
        });
        let bars = &*corner_bars;
        add_by_vertex(bar, |vertex| {
            let corners = self.topology.corners(vertex).iter();
            corners.fold([T::Wide::ZERO; 3], |total, &corner| {
                plus(total, bars[corner as usize / 3][corner as usize % 3])
            })
        });
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        size_of_val(saved.facets.as_slice())
    }
}

/// The mean over pairs of faces that share an edge of `1 - cos` of the angle between their normals, from
/// 0 for a plane to 2; returns `[]`. 0 without a pair. Boundaries have no part in it, nor edges of three
/// faces; pairs with a face without an area count as flat.
///
/// # Errors
/// [`TensorError::Shape`] unless the positions are `[V, 3]` with as many vertices as the topology.
#[inline(never)]
pub fn normal_error<'t, T: Scalar>(
    positions: Var<'t, T>,
    topology: &Topology,
) -> Result<Var<'t, T>, TensorError> {
    positions.tape().apply(NormalConsistency { topology: topology.clone() }, &[positions])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    /// Two faces at an edge along x, the second one turned by `angle` out of the plane of the first.
    fn hinge(angle: f64, scale: f64) -> Tensor<f64> {
        let rows =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.6, -angle.cos(), angle.sin()]];
        Tensor::from_flat_fn([4, 3], |k| scale * rows[k / 3][k % 3])
    }

    const FACES: [[u32; 3]; 2] = [[0, 1, 2], [1, 0, 3]];

    #[test]
    fn a_hinge_has_1_minus_the_cosine_of_its_angle_whichever_way_it_is_wound() {
        for scale in [1e-150, 1.0, 1e150] {
            for angle in [1e-9, 0.1, 1.0, 2.0, 3.1, -0.5] {
                let mut found = Vec::new();
                for faces in [FACES, [FACES[0], [0, 1, 3]]] {
                    let topology = Topology::new(&faces, 4).unwrap();
                    let tape = Tape::new();
                    let v = tape.leaf(&hinge(angle, scale));
                    let error = normal_error(v, &topology).unwrap();
                    let half = (0.5 * angle).sin();
                    let expected = 2.0 * half * half;
                    approx::assert_relative_eq!(error.item(), expected, max_relative = 1e-6);
                    let gradient = error.backward().unwrap().get_or_zeros(v);
                    // Vertex 3 turns around the edge at distance 1: d(1 - cos) = sin.
                    let turned = [0.0, angle.sin(), angle.cos()];
                    let along: f64 = (0..3).map(|k| gradient[[3, k]] * turned[k]).sum();
                    let expected = angle.sin() / scale;
                    approx::assert_relative_eq!(along, expected, max_relative = 1e-7);
                    found.push((error.item(), gradient));
                }
                assert_eq!(found[0].0, found[1].0);
            }
        }
    }

    #[test]
    fn a_face_without_an_area_counts_as_flat_and_gives_no_gradient() {
        let topology = Topology::new(&[FACES[0], FACES[1], [2, 1, 4]], 5).unwrap();
        let mut rows = hinge(0.7, 1.0).data().to_vec();
        for last in [[1.0, 0.0, 0.0], [0.65, 0.5, 0.0], [1.7, -1.0, 0.0]] {
            rows.truncate(12);
            rows.extend(last);
            let tape = Tape::new();
            let v = tape.leaf(&Tensor::new([5, 3], rows.clone()).unwrap());
            let error = normal_error(v, &topology).unwrap();
            approx::assert_relative_eq!(error.item(), 0.5 * (1.0 - 0.7_f64.cos()), epsilon = 1e-15);
            let gradient = error.backward().unwrap().get_or_zeros(v);
            assert!(gradient.is_finite());
            assert_eq!(&gradient.data()[12..], [0.0; 3]);
        }
    }

    #[test]
    fn without_a_pair_there_is_no_error() {
        let tape = Tape::<f32>::new();
        for (faces, count) in [(vec![], 0), (vec![], 3), (vec![[0, 1, 2]], 3)] {
            let v = tape.leaf(&Tensor::from_flat_fn([count, 3], |k| (k * k) as f32));
            let topology = Topology::new(&faces, count).unwrap();
            let error = normal_error(v, &topology).unwrap();
            assert_eq!(error.item(), 0.0);
            let gradient = error.backward().unwrap().get_or_zeros(v);
            assert!(gradient.data().iter().all(|g| *g == 0.0));
        }
    }
}
