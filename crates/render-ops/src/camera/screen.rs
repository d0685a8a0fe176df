//! From intrinsics in pixels to the rows of a matrix to clip space.
//!
//! # Forward
//! With the scales (a, b) and the centre (c, d), a point of OpenCV's camera coordinates (X, Y, Z) is
//! seen at `u = a X / w + c`, `v = b Y / w + d` in OpenCV's pixels, in which the centre of the first
//! pixel is 0. In pixels of this project it is at (u + 1/2, v + 1/2). So with y up
//! `x_ndc = (2 u + 1) / W - 1`, `y_ndc = 1 - (2 v + 1) / H`, and
//!
//! - `x_clip = (2 a / W) X + ((2 c + 1) / W - 1) w`,
//! - `y_clip = -(2 b / H) Y - ((2 d + 1) / H - 1) w`,
//!
//! where w is Z for a pinhole and 1 for an orthographic camera. z_clip and w have no parameter that is
//! learnt.
//!
//! # Backward
//! `a_bar = 2 M_bar_00 / W`, `b_bar = -2 M_bar_11 / H`, `c_bar = 2 M_bar_0j / W`,
//! `d_bar = -2 M_bar_1j / H`, with j the column of w. It is linear.

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar};

use crate::error::RenderError;
use crate::matrix;
use crate::size::Size;

/// Input: intrinsics `[4]`. Output: a matrix `[4, 4]`.
pub(super) struct Screen {
    pub(super) operation: &'static str,
    /// What the scales and the centre have to be.
    pub(super) rules: [&'static str; 2],
    pub(super) size: Size,
    /// The column whose coordinate is w: 2 for Z, 3 for 1.
    pub(super) column: usize,
    /// The entries of z_clip's row for Z and for 1.
    pub(super) depth: [f64; 2],
}

impl Screen {
    /// 2 / W and -2 / H.
    fn units<S: Scalar>(&self) -> [S; 2] {
        [2.0 / self.size.width as f64, -2.0 / self.size.height as f64].map(S::from_f64)
    }
}

impl<T: Scalar> Op<T> for Screen {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        self.operation
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let refused = |rule, value: f64| Err(RenderError::value(self.operation, rule, value));
        if **inputs.shape(0) != [4] {
            let rule = "intrinsics of shape [4]";
            return Err(RenderError::shape(self.operation, rule, inputs.shape(0)));
        }
        let wide: [T::Wide; 4] = std::array::from_fn(|k| inputs.data(0)[k].widen());
        let (scales, centers) = ([wide[0], wide[1]], [wide[2], wide[3]]);
        let two = T::Wide::from_f64(2.0);
        let mut rows = [[T::Wide::ZERO; 4]; 4];
        for (k, unit) in self.units::<T::Wide>().into_iter().enumerate() {
            let extent = T::Wide::from_f64([self.size.width, self.size.height][k] as f64);
            let scale = unit * scales[k];
            // Too small for the precision is as good as 0.
            if !scales[k].is_finite() || T::narrow(scale) == T::ZERO {
                return refused(self.rules[0], scales[k].to_f64());
            }
            if !centers[k].is_finite() {
                return refused(self.rules[1], centers[k].to_f64());
            }
            rows[k][k] = scale;
            let offset = (two * centers[k] + T::Wide::ONE - extent) / extent;
            rows[k][self.column] = if k == 0 { offset } else { -offset };
        }
        [rows[2][2], rows[2][3]] = self.depth.map(T::Wide::from_f64);
        rows[3][self.column] = T::Wide::ONE;
        let entries = outputs.push([4, 4]);
        matrix::write(&rows, entries);
        matrix::check_finite(entries)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(intrinsics_bar) = gradients.get(0) else { return };
        let (bars, units) = (kept.only_upstream(), self.units::<T::Wide>());
        intrinsics_bar.add_each(|k| {
            let (row, column) = (k % 2, if k < 2 { k } else { self.column });
            T::narrow(units[row] * bars[4 * row + column].widen())
        });
    }
}
