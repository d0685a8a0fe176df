//! Cross product of vectors along the last axes, of extent 3: `z = x × y`, where the other axes broadcast;
//! `x_bar += y × z_bar`, `y_bar += z_bar × x`. A vector that was repeated collects the terms of all its
//! copies.
//!
//! With `j` and `k` the axes after `i`, in a circle: `z_i = x_j y_k - x_k y_j`. Formed in
//! [`Scalar::Wide`]: in `f32` the products are exact and a component is rounded once, so also that of
//! nearly parallel vectors.

use crate::axis::{for_each_short_line_mut, sum_rows};
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::vectors::{Pairs, common_shape};
use crate::walk::axes;

/// The axes after each of the three, in a circle.
const AFTER: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

const NAME: &str = "cross";

struct Cross;

/// The common shape of two operands.
fn full_shape(left: &Shape, right: &Shape) -> Result<Shape, TensorError> {
    let full = common_shape(left, right, NAME)?;
    if full.last() == Some(&3) {
        return Ok(full);
    }
    let rule = "vectors of three components along the last axes".into();
    let shapes = Box::new([left.clone(), right.clone()]);
    Err(TensorError::Mismatch { operation: NAME, rule, shapes })
}

/// Component `i` of `x × y`.
#[inline(always)]
fn component<T: Scalar>(x: &[T], y: &[T], i: usize) -> T::Wide {
    let [j, k] = AFTER[i];
    x[j].widen() * y[k].widen() - x[k].widen() * y[j].widen()
}

/// Calls `put(entry, component)` for the three entries of `z`: with `x × y`.
#[inline(always)]
fn put_product<T: Scalar>(z: &mut [T], x: &[T], y: &[T], put: &impl Fn(&mut T, T)) {
    let components = [0, 1, 2].map(|i| T::narrow(component(x, y, i)));
    z.iter_mut().zip(components).for_each(|(z, component)| put(z, component));
}

/// Calls `put(entry, component)` for each entry of `z`, of the shape `full`: with `x × y`.
fn for_each_component<T: Scalar>(
    z: &mut [T],
    full: &Shape,
    operands: [(&[T], &Shape); 2],
    put: impl Fn(&mut T, T) + Send + Sync,
) {
    match Pairs::new(operands, full) {
        Pairs::Many(many) => for_each_short_line_mut::<T, 3, 2>(z, many, |_, z, [x, y]| {
            put_product(z, x, y, &put);
        }),
        Pairs::ManyAndOne(x, y) => for_each_short_line_mut::<T, 3, 1>(z, [x], |_, z, [x]| {
            put_product(z, x, y, &put);
        }),
        Pairs::OneAndMany(x, y) => for_each_short_line_mut::<T, 3, 1>(z, [y], |_, z, [y]| {
            put_product(z, x, y, &put);
        }),
        Pairs::Any([x, y]) => for_each_short_line_mut::<T, 3, 0>(z, [], |row, z, []| {
            put_product(z, x.row(row, 3), y.row(row, 3), &put);
        }),
    }
}

/// Adds `x × y`, summed over copies, to the gradient of an operand of `shape`.
fn add_cross<T: Scalar>(
    gradient: &mut Accumulator<T>,
    shape: &Shape,
    full: &Shape,
    operands: [(&[T], &Shape); 2],
) {
    if shape == full {
        let (gradient, fresh) = gradient.entries_or_fresh();
        let put = |sum: &mut T, term: T| *sum = if fresh { term } else { *sum + term };
        return for_each_component(gradient, full, operands, put);
    }
    // One vector beside as many as there are: components that the compiler knows.
    if shape.size() == 3
        && let Pairs::Many([x, y]) = Pairs::new(operands, full)
    {
        let ([x, y], gradient) = ([x, y].map(|x| x.as_chunks::<3>().0), gradient.entries());
        let term = |row: usize, i: usize| component(&x[row], &y[row], i);
        return sum_rows::<T>(x.len(), 3, term, |i, total| gradient[i] += T::narrow(total));
    }
    let [(x, x_shape), (y, y_shape)] = operands;
    // Along the vectors their start stays, and the component goes on.
    let last = full.rank() - 1;
    let all = axes([full, shape, x_shape, y_shape]).enumerate();
    let all = all.map(|(axis, (extent, [_, copy, i, j]))| {
        (extent, if axis == last { [copy, 0, 0, 1] } else { [copy, i, j, 0] })
    });
    add_over_copies(gradient.entries(), all, |[_, x_start, y_start, i]| {
        component(&x[x_start..][..3], &y[y_start..][..3], i)
    });
}

impl<T: Scalar> Op<T> for Cross {
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
        let full = full_shape(inputs.shape(0), inputs.shape(1))?;
        let operands = [0, 1].map(|i| (inputs.data(i), inputs.shape(i)));
        let z = outputs.try_push(NAME, &full)?;
        for_each_component(z, &full, operands, |z, component| *z = component);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (left, right) = (kept.input_shape(0), kept.input_shape(1));
        let full = kept.output_shape(0);
        let z_bar = (kept.only_upstream(), full);
        if let Some(x_bar) = gradients.get(0) {
            add_cross(x_bar, left, full, [(kept.input(1), right), z_bar]);
        }
        if let Some(y_bar) = gradients.get(1) {
            add_cross(y_bar, right, full, [z_bar, (kept.input(0), left)]);
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The cross products of vectors along the last axes, which have the extent 3; the other axes
    /// broadcast. Of `[n, 3]` and `[n, 3]` or `[3]`, those of rows: `[n, 3]`. For vectors along another axis
    /// [`Var::permute`] the operands.
    ///
    /// # Errors
    /// [`TensorError::Mismatch`] unless both have extent 3 along the last axis;
    /// [`TensorError::Broadcast`] unless the other axes broadcast.
    pub fn cross(self, other: Self) -> Result<Self, TensorError> {
        self.tape.apply(Cross, &[self, other])
    }
}
