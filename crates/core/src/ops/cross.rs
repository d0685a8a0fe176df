//! Cross product of vectors along an axis of extent 3: `z = x × y`, where operands broadcast;
//! `x_bar += y × z_bar`, `y_bar += z_bar × x`. An entry that was repeated collects the terms of all its
//! copies.
//!
//! With `j` and `k` the axes after `i`, in a circle: `z_i = x_j y_k - x_k y_j`. Formed in
//! [`Scalar::Wide`]: in `f32` the products are exact and a component is rounded once, so also that of
//! nearly parallel vectors.

use std::array;

use crate::axis::{for_each_short_line_mut, sum_rows};
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::walk::{Walk, axes};

/// The axes after each of the three, in a circle.
const AFTER: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

struct Cross {
    axis: usize,
}

/// Vectors of an operand, and how far their components lie apart.
#[derive(Clone, Copy)]
struct Vectors<'a, T> {
    entries: &'a [T],
    stride: usize,
}

impl<'a, T: Scalar> Vectors<'a, T> {
    /// Component `k` of the vectors from that at `at` on.
    fn from(self, at: usize, k: usize) -> &'a [T] {
        &self.entries[at + k * self.stride..]
    }

    /// Component `k` of the vector at `at`.
    #[inline(always)]
    fn get(self, at: usize, k: usize) -> T::Wide {
        self.entries[at + k * self.stride].widen()
    }
}

/// Component `i` of `x × y`, for the vectors at these places.
#[inline(always)]
fn component<T: Scalar>(
    [x, y]: [Vectors<'_, T>; 2],
    [at, right_at]: [usize; 2],
    i: usize,
) -> T::Wide {
    let [j, k] = AFTER[i];
    x.get(at, j) * y.get(right_at, k) - x.get(at, k) * y.get(right_at, j)
}

/// How far a step to the next vector moves in arrays of vectors that lie in one piece: those of the full
/// shape, or a single one.
fn steps_beside(full: &Shape, operands: [&Shape; 2]) -> Option<[usize; 2]> {
    let step = |shape: &Shape| match shape {
        _ if shape == full => Some(3),
        _ if shape.size() == 3 => Some(0),
        _ => None,
    };
    Some([step(operands[0])?, step(operands[1])?])
}

impl Cross {
    const NAME: &'static str = "cross";

    /// The common shape of two operands.
    fn full(&self, left: &Shape, right: &Shape) -> Result<Shape, TensorError> {
        let operation = Self::NAME;
        let shapes = || Box::new([left.clone(), right.clone()]);
        let Some(full) = left.broadcast(right) else {
            return Err(TensorError::Broadcast { operation, shapes: shapes() });
        };
        if self.axis >= full.rank() {
            return Err(TensorError::Axis { operation, axis: self.axis, shape: full });
        }
        // Counted from the last axis, as shapes are aligned; an extent of 1 is no vector.
        let extent = |shape: &Shape| {
            (self.axis + shape.rank()).checked_sub(full.rank()).map(|axis| shape[axis])
        };
        if (extent(left), extent(right)) != (Some(3), Some(3)) {
            let rule = format!("extent 3 along axis {} of the common shape", self.axis).into();
            return Err(TensorError::Mismatch { operation, rule, shapes: shapes() });
        }
        Ok(full)
    }

    /// The vectors of an operand.
    fn vectors<'a, T>(&self, (entries, shape): (&'a [T], &Shape), full: &Shape) -> Vectors<'a, T> {
        Vectors { entries, stride: shape.strides_in(full)[self.axis] }
    }

    /// Calls `put(entry, component)` for each entry of `z`, of the common shape: with `x × y`.
    fn of_all<T: Scalar>(
        &self,
        full: &Shape,
        operands: [(&[T], &Shape); 2],
        z: &mut [T],
        put: impl Fn(&mut T, T) + Send + Sync,
    ) {
        let vectors = operands.map(|of| self.vectors(of, full));
        let [left, right] = operands.map(|(_, shape)| shape);
        if self.axis + 1 == full.rank() {
            // Vectors that lie in one piece, in arrays of as many or beside a single one.
            let [x, y] = operands.map(|(entries, _)| entries);
            let put_all = |z: &mut [T], x: &[T], y: &[T]| {
                let operands = [x, y].map(|entries| Vectors { entries, stride: 1 });
                let product: [T; 3] = array::from_fn(|i| T::narrow(component(operands, [0, 0], i)));
                z.iter_mut().zip(product).for_each(|(z, component)| put(z, component));
            };
            match (left == full, right == full) {
                (true, true) => {
                    return for_each_short_line_mut::<T, 3, 2>(z, [x, y], |_, z, [x, y]| {
                        put_all(z, x, y)
                    });
                }
                (true, false) if y.len() == 3 => {
                    return for_each_short_line_mut::<T, 3, 1>(z, [x], |_, z, [x]| {
                        put_all(z, x, y)
                    });
                }
                (false, true) if x.len() == 3 => {
                    return for_each_short_line_mut::<T, 3, 1>(z, [y], |_, z, [y]| {
                        put_all(z, x, y)
                    });
                }
                _ => {}
            }
        }
        // Along the vectors their start stays, and the component goes on.
        let all = axes([full, left, right]).enumerate();
        let walk = Walk::new(all.map(|(at, (extent, [_, i, j]))| {
            (extent, if at == self.axis { [0, 0, 1] } else { [i, j, 0] })
        }));
        let [step, right_step, along] = walk.steps();
        walk.rows_mut(z, |z, [at, right_at, i]| {
            if [step, right_step, along] == [1, 1, 0] {
                // Components that lie in one piece.
                let [j, k] = AFTER[i];
                let [x, y] = vectors;
                let left = x.from(at, j).iter().zip(x.from(at, k));
                let right = y.from(right_at, j).iter().zip(y.from(right_at, k));
                for (z, (x, y)) in z.iter_mut().zip(left.zip(right)) {
                    let product = x.0.widen() * y.1.widen() - x.1.widen() * y.0.widen();
                    put(z, T::narrow(product));
                }
                return;
            }
            for (k, z) in z.iter_mut().enumerate() {
                let at = [at + k * step, right_at + k * right_step];
                put(z, T::narrow(component(vectors, at, i + k * along)));
            }
        });
    }

    /// Adds `x × y`, summed over copies, to the gradient of an operand of shape `own`.
    fn add<T: Scalar>(
        &self,
        own_bar: &mut Accumulator<T>,
        own: &Shape,
        full: &Shape,
        operands: [(&[T], &Shape); 2],
    ) {
        if own == full {
            let (own_bar, fresh) = own_bar.entries_or_fresh();
            let put = |sum: &mut T, term: T| *sum = if fresh { term } else { *sum + term };
            return self.of_all(full, operands, own_bar, put);
        }
        let vectors = operands.map(|of| self.vectors(of, full));
        let [left, right] = operands.map(|(_, shape)| shape);
        if self.axis + 1 == full.rank() && own.size() == 3 {
            // A vector beside many: what is full goes on with them, and what is not stays.
            if let Some(steps) = steps_beside(full, [left, right]) {
                let term = |row: usize, i| component(vectors, steps.map(|step| row * step), i);
                let own_bar = own_bar.entries();
                return sum_rows::<T>(full.size() / 3, 3, term, |i, sum| {
                    own_bar[i] += T::narrow(sum);
                });
            }
        }
        let all = axes([full, own, left, right]).enumerate();
        let all = all.map(|(at, (extent, [_, own, i, j]))| {
            (extent, if at == self.axis { [own, 0, 0, 1] } else { [own, i, j, 0] })
        });
        add_over_copies(own_bar.entries(), all, |[_, at, right_at, i]| {
            component(vectors, [at, right_at], i)
        });
    }
}

impl<T: Scalar> Op<T> for Cross {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let full = self.full(inputs.shape(0), inputs.shape(1))?;
        let operands = [0, 1].map(|i| (inputs.data(i), inputs.shape(i)));
        let z = outputs.try_push(Self::NAME, &full)?;
        self.of_all(&full, operands, z, |z, component| *z = component);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let mut keep = Keep::NOTHING;
        for (own, other) in [(0, 1), (1, 0)] {
            if inputs.needs(own) {
                keep = keep.input(other);
            }
        }
        keep
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (left, right) = (kept.input_shape(0), kept.input_shape(1));
        let full = kept.output_shape(0);
        let z_bar = (kept.only_upstream(), full);
        if let Some(x_bar) = gradients.get(0) {
            self.add(x_bar, left, full, [(kept.input(1), right), z_bar]);
        }
        if let Some(y_bar) = gradients.get(1) {
            self.add(y_bar, right, full, [z_bar, (kept.input(0), left)]);
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The cross products of vectors along `axis` of the common shape, where both operands have extent
    /// 3; along other axes they broadcast. Of `[n, 3]` and `[n, 3]` or `[3]`, along axis 1, those of
    /// rows: `[n, 3]`.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast; [`TensorError::Axis`] unless the common
    /// shape has such an axis; [`TensorError::Mismatch`] unless both have extent 3 along it.
    pub fn cross(self, other: Self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Cross { axis }, &[self, other])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn unit_vectors_turn_to_the_right() {
        let tape = Tape::new();
        let unit =
            tape.constant(&Tensor::from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
        let next = unit.gather_rows(&std::sync::Arc::from([1, 2, 0])).unwrap();
        let last = unit.gather_rows(&std::sync::Arc::from([2, 0, 1])).unwrap();
        assert_eq!(unit.cross(next, 1).unwrap().value(), last.value());
        assert_eq!(unit.cross(unit, 1).unwrap().value(), Tensor::zeros([3, 3]));
    }

    /// Component `k` of the vectors along `axis` of a shape of `rank`.
    fn component_of(of: Var<'_, f64>, axis: usize, rank: usize, k: usize) -> Var<'_, f64> {
        of.slice(axis + of.shape().rank() - rank, k..k + 1).unwrap()
    }

    #[test]
    fn cross_products_are_those_of_slices_whichever_axes_broadcast() {
        let shapes: [(&[usize], usize); 8] = [
            (&[4, 2, 3], 2),
            (&[4, 3, 2], 1),
            (&[3, 4, 2], 0),
            (&[4, 1, 3], 2),
            (&[2, 3], 2),
            (&[3], 2),
            (&[3, 1, 2], 0),
            (&[3, 1], 1),
        ];
        for ((left, axis), (right, right_axis)) in
            shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r)))
        {
            let rank = left.len().max(right.len());
            // The axis is that of a shape of rank 3, and shapes are aligned at their last axes.
            let [axis, right_axis] = [axis, right_axis].map(|axis| axis + rank - 3);
            if axis != right_axis {
                continue;
            }
            let tape = Tape::new();
            let x = tape.leaf(&Tensor::from_flat_fn(left, |k| (k % 7) as f64 - 3.0));
            let y = tape.leaf(&Tensor::from_flat_fn(right, |k| (k % 5) as f64 - 1.0));
            let Ok(fused) = x.cross(y, axis) else { continue };
            let part = |of, k| component_of(of, axis, rank, k);
            let parts = AFTER.map(|[j, k]| {
                let [a, b] = [j, k].map(|k| (part(x, k), part(y, k)));
                a.0 * b.1 - b.0 * a.1
            });
            let apart = Var::concat(&parts, axis).unwrap();
            let upstream = Tensor::from_flat_fn(apart.shape(), |k| 1.0 + k as f64);
            let of = |z| {
                let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
                (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
            };
            assert_eq!(of(fused), of(apart), "{left:?} {right:?} {axis}");
        }
    }

    #[test]
    fn nearly_parallel_vectors_lose_no_digits_in_f32() {
        let tape = Tape::<f32>::new();
        let x = tape.constant(&Tensor::from([1.0 + f32::EPSILON, 1.0, 0.0]));
        let y = tape.constant(&Tensor::from([1.0, 1.0 - f32::EPSILON, 0.0]));
        // (1 + e)(1 - e) - 1 = -e^2.
        let z = x.cross(y, 0).unwrap().value();
        assert_eq!(z.data(), [0.0, 0.0, -f32::EPSILON * f32::EPSILON]);
    }

    #[test]
    fn vectors_have_three_components_on_both_sides() {
        let tape = Tape::<f64>::new();
        let of = |shape: &[usize]| tape.constant_full(shape, 1.0);
        let message =
            "cross needs extent 3 along axis 1 of the common shape, got shapes [2, 3] and [2, 1]";
        assert_eq!(of(&[2, 3]).cross(of(&[2, 1]), 1).unwrap_err().to_string(), message);
        assert!(of(&[2, 3]).cross(of(&[]), 1).is_err());
        assert!(of(&[2, 2]).cross(of(&[2, 2]), 1).is_err());
        let message = "cross needs an axis below the rank 1, got axis 1 of shape [3]";
        assert_eq!(of(&[3]).cross(of(&[3]), 1).unwrap_err().to_string(), message);
        let message = "cross needs shapes that broadcast, got [2, 3] and [4, 3]";
        assert_eq!(of(&[2, 3]).cross(of(&[4, 3]), 1).unwrap_err().to_string(), message);
        assert_eq!(of(&[0, 3]).cross(of(&[3]), 1).unwrap().shape(), Shape::from([0, 3]));
    }
}
