//! A rotation and a translation as a matrix.
//!
//! # Forward
//! `M = [R t; 0 1]`, with R of a quaternion (see `rotation`).
//!
//! # Backward
//! `t_bar` is the last column of `M_bar`, and `R_bar` its first three; from there to the quaternion as
//! in `rotation`. It is smooth everywhere but at the quaternion 0, which is refused.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::rotation;

const NAME: &str = "rigid";

/// The matrix `[4, 4]` that turns by `rotation: [4]`, a quaternion (x, y, z, w) of any length but 0, and
/// then moves by `translation: [3]`. Both have a gradient.
///
/// # Errors
/// [`RenderError::Shape`] for inputs of another shape; [`RenderError::Rotation`] for a quaternion that is
/// zero or not finite; `TensorError::Value` for a translation that is not finite;
/// `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn rigid<'t, T: Scalar>(
    rotation: Var<'t, T>,
    translation: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    rotation.tape().apply(Rigid, &[rotation, translation])
}

/// Inputs: rotation `[4]`, translation `[3]`. Output: a matrix `[4, 4]`.
struct Rigid;

impl<T: Scalar> Op<T> for Rigid {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        for (i, rule) in
            ["a rotation of shape [4]", "a translation of shape [3]"].iter().enumerate()
        {
            if **inputs.shape(i) != [4 - i] {
                return Err(RenderError::shape(NAME, *rule, inputs.shape(i)));
            }
        }
        let t = inputs.data(1);
        if let Some(lost) = t.iter().find(|t| !t.is_finite()) {
            return Err(RenderError::value(NAME, "a finite translation", lost.to_f64()));
        }
        let r = rotation::checked_matrix(inputs.data(0))?;
        let entries = outputs.push([4, 4]);
        for (row, entries) in entries.chunks_exact_mut(4).enumerate() {
            match r.get(row) {
                Some(r) => {
                    let [x, y, z] = r.map(T::narrow);
                    entries.copy_from_slice(&[x, y, z, t[row]]);
                }
                None => entries.copy_from_slice(&[T::ZERO, T::ZERO, T::ZERO, T::ONE]),
            }
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(0, inputs.needs(0))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let bars = kept.only_upstream();
        if let Some(rotation_bar) = gradients.get(0) {
            let r_bar = std::array::from_fn(|i| std::array::from_fn(|k| bars[4 * i + k].widen()));
            let q = std::array::from_fn(|k| kept.input(0)[k].widen());
            let q_bar = rotation::pull_back(q, r_bar);
            rotation_bar.add_each(|k| T::narrow(q_bar[k]));
        }
        if let Some(translation_bar) = gradients.get(1) {
            translation_bar.add_each(|k| bars[4 * k + 3]);
        }
    }
}
