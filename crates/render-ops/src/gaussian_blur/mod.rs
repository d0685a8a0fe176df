//! Gaussian blur of an image, with a standard deviation that can be learnt.
//!
//! # Forward
//! `b = K_y K_x c`: along the rows, then along the columns, channel by channel, with the window
//! `w_k` of `taps` and the border rule of `border`.
//!
//! # Backward
//! `c_bar = K_x^T K_y^T b_bar`. For the zero and the mirror border `K^T = K`; for the clamp border
//! what leaves the image is added to the border pixels: `K^T = K_zero` plus, at the first pixel,
//! `sum_j g_j sum_(k > j) w_k`, and likewise at the last.
//! `sigma_bar = <K_y^T b_bar, K'_x c> + <b_bar, K'_y K_x c>` with `K' = dK/dsigma`.
//!
//! # Where it is not smooth
//! A radius that follows from a tolerance steps with sigma; the jump is below that tolerance. A fit
//! whose target lies on a step keeps an error of that size, so fix the radius there.
//!
//! # Source
//! Kitabayashi and Iwasaki, on parameter estimation of Gaussian filtering by differentiable
//! rendering, equations (1) to (5): the seed kernel. The sampled one is what image libraries use.

mod convolution;
mod padding;
#[cfg(test)]
mod tests;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use self::convolution::Lines;
use self::padding::{add_overhang, pad};
use crate::border::Border;
use crate::error::RenderError;
use crate::taps::{Blur, Kernel, Taps, check_radius};

/// `image: [H, W, C]` blurred with standard deviation `sigma: []`, in pixels; returns `[H, W, C]`.
///
/// Sampled weights with sigma 0 are the identity: the image itself is returned. The larger sigma
/// grows beyond the image, the closer the result comes to what its border stands for: the mean of
/// the image (mirror), of its corners (clamp), or zero.
///
/// # Errors
/// [`RenderError::BadSigma`] unless sigma is finite and positive (or 0, for sampled weights);
/// [`RenderError::Shape`] unless the image is `[H, W, C]` with at least one entry and sigma a single
/// number; [`RenderError::BadRadius`] for a tolerance outside (0, 1) or a radius above 16384.
pub fn gaussian_blur<'t, T: Scalar>(
    image: Var<'t, T>,
    sigma: Var<'t, T>,
    blur: &Blur,
) -> Result<Var<'t, T>, RenderError> {
    let shape = sigma.shape();
    if shape.size() != 1 {
        let rule = "a single number for sigma".to_owned();
        return Err(RenderError::Shape { operation: "gaussian_blur", rule, shape });
    }
    check_image(&image.shape())?;
    check_radius(blur.radius)?;
    let is_identity = blur.kernel == Kernel::Sampled && sigma.item() == T::ZERO;
    // Of a variable of another tape the tape makes an error.
    if is_identity && std::ptr::eq(image.tape(), sigma.tape()) {
        image.tape().leave_out("gaussian_blur", "sigma is 0");
        return Ok(image);
    }
    image.tape().apply(GaussianBlur { blur: *blur }, &[image, sigma])
}

/// Inputs: image `[H, W, C]`, sigma `[]`.
struct GaussianBlur {
    blur: Blur,
}

/// The window, the padded pictures that the forward passes read, and memory.
#[derive(Debug)]
struct Saved<T> {
    /// The windows along the rows and along the columns.
    taps: [Taps<T>; 2],
    /// The image, with its rows padded.
    rows: Vec<T>,
    /// The image blurred along its rows, with its columns padded.
    columns: Vec<T>,
    /// Memory for a pass: a padded picture, the picture between the passes, the last one.
    padded: Vec<T>,
    between: Vec<T>,
    last: Vec<T>,
}

impl<T: Default> Default for Saved<T> {
    fn default() -> Self {
        Self {
            taps: [Taps::default(), Taps::default()],
            rows: Vec::new(),
            columns: Vec::new(),
            padded: Vec::new(),
            between: Vec::new(),
            last: Vec::new(),
        }
    }
}

/// The two passes over an image `[H, W, C]`: along the rows, along the columns.
struct Passes {
    rows: Lines,
    columns: Lines,
}

impl Passes {
    fn of<T: Scalar>(
        [height, width, channels]: [usize; 3],
        border: Border,
        [along_rows, along_columns]: &[Taps<T>; 2],
    ) -> Self {
        let cell = width * channels;
        Self {
            rows: Lines {
                lines: height,
                extent: width,
                cell: channels,
                pad: border.reach(along_rows.radius(), width),
            },
            columns: Lines {
                lines: 1,
                extent: height,
                cell,
                pad: border.reach(along_columns.radius(), height),
            },
        }
    }
}

impl GaussianBlur {
    /// `y = K^T g` along `lines`, with `padded` as memory.
    fn adjoint<T: Scalar>(
        &self,
        taps: &Taps<T>,
        lines: Lines,
        g: &[T],
        padded: &mut Vec<T>,
        y: &mut [T],
    ) {
        // The clamp border's adjoint is the zero border's, and what leaves the image.
        let border =
            if self.blur.border == Border::Clamp { Border::Zero } else { self.blur.border };
        pad(border, g, lines, padded);
        lines.convolve(padded, &taps.weights[..=lines.pad], y);
        if self.blur.border == Border::Clamp {
            add_overhang(g, lines, &taps.weights, y);
        }
    }
}

impl<T: Scalar> Op<T> for GaussianBlur {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "gaussian_blur"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let &[height, width, channels] = &**inputs.shape(0) else {
            unreachable!("gaussian_blur has checked the rank");
        };
        let Saved { taps, rows, columns, between, .. } = saved;
        Taps::fill(taps, inputs.data(1)[0], &self.blur, [width, height])?;
        let passes = Passes::of([height, width, channels], self.blur.border, taps);
        let [along_rows, along_columns] = taps;
        between.resize(inputs.shape(0).size(), T::ZERO);
        pad(self.blur.border, inputs.data(0), passes.rows, rows);
        passes.rows.convolve(rows, &along_rows.weights[..=passes.rows.pad], between);
        pad(self.blur.border, between, passes.columns, columns);
        let out = outputs.push(inputs.shape(0));
        passes.columns.convolve(columns, &along_columns.weights[..=passes.columns.pad], out);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let b_bar = kept.only_upstream();
        let &[height, width, channels] = &**kept.input_shape(0) else {
            unreachable!("gaussian_blur has checked the rank");
        };
        let Saved { taps, rows, columns, padded, between, last } = saved;
        let passes = Passes::of([height, width, channels], self.blur.border, taps);
        let [along_rows, along_columns] = &*taps;
        self.adjoint(along_columns, passes.columns, b_bar, padded, between);
        if let Some(sigma_bar) = gradients.get(1) {
            let by_rows =
                passes.rows.slope_product(rows, &along_rows.window(passes.rows.pad), between);
            let window = along_columns.window(passes.columns.pad);
            let by_columns = passes.columns.slope_product(columns, &window, b_bar);
            sigma_bar.add_each(|_| T::narrow(by_rows + by_columns));
        }
        if let Some(image_bar) = gradients.get(0) {
            last.resize(between.len(), T::ZERO);
            self.adjoint(along_rows, passes.rows, between, padded, last);
            image_bar.add(last);
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { rows, columns, padded, between, last, .. } = saved;
        size_of::<T>() * [rows, columns, padded, between, last].map(Vec::len).iter().sum::<usize>()
    }
}

fn check_image(shape: &bokashi_core::Shape) -> Result<(), RenderError> {
    if shape.rank() == 3 && shape.size() > 0 {
        return Ok(());
    }
    Err(RenderError::Shape {
        operation: "gaussian_blur",
        rule: "an image of shape [H, W, C] with at least one entry".to_owned(),
        shape: shape.clone(),
    })
}
