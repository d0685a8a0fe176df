//! Structural similarity of images.
//!
//! # Forward
//! Windows of 11 x 11 pixels lie at each place where they fit. For each window and channel, with the weights w of a
//! Gaussian of sigma 1.5: `mx = sum w x`, `vx = sum w x^2 - mx^2`, `vxy = sum w x y - mx my`, and so
//! for y. With `c1 = (0.01 peak)^2` and `c2 = (0.03 peak)^2`:
//! `l = (2 mx my + c1) / (mx^2 + my^2 + c1)` and `cs = (2 vxy + c2) / (vx + vy + c2)`.
//!
//! The error is the mean of `1 - l cs`, or of `1 - cs` where the luminance is left out. Moments are
//! summed in [`Scalar::Wide`], first along columns, then along rows. Variances do not change with an
//! offset, so those of x and of y are taken from each image's mean: they keep their digits.
//!
//! # Backward
//! Of `s = l cs`: `ds/dvxy = C = 2 l / b2` and `ds/dvx = ds/dvy = B = -s / b2` with the denominator b2
//! of cs. By mx, with what the variances have of it: `A = cs (2 my - 2 mx l) / b1 - 2 mx B - my C`. With
//! these at every window, and sums over the windows that see pixel q:
//! `x_bar_q = -(sum w A + 2 x_q sum w B + y_q sum w C) s_bar`. In y alike, with its own A.
//!
//! # Where rounding shows
//! A variance that rounding makes negative counts as 0, and a covariance is no larger than the mean of
//! the variances. So `|cs| <= 1`, and equal images have the error 0 and gradients of 0.
//!
//! # Source
//! Wang, Bovik, Sheikh and Simoncelli, *Image quality assessment: from error visibility to structural
//! similarity*, IEEE Transactions on Image Processing 13(4), 2004. As in their program, windows lie
//! within the image.

use std::array::from_fn;

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_two_pieces_mut, merge_ranges_into};
use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, TensorError, Var, sum,
};

/// The width of a window.
pub(super) const WINDOW: usize = 11;
/// Rows and columns of an image that have no window around them.
const BEYOND: usize = WINDOW - 1;
/// The standard deviation of its weights.
const SIGMA: f64 = 1.5;
/// The constants of the authors.
const K: [f64; 2] = [0.01, 0.03];

/// The error of image 0 against image 1.
pub(super) struct Ssim {
    /// Whether the luminance counts, beside contrast and structure.
    pub(super) luminance: bool,
    /// The largest value that images may have.
    pub(super) peak: f64,
}

/// A piece of the windows: some rows of them.
#[derive(Debug, Default)]
pub(super) struct Piece<T, S> {
    /// Moments of a row, summed along columns: x, y, x^2, y^2, xy.
    moments: [Vec<S>; 5],
    /// A of x, A of y, B and C, where a gradient will read them.
    slopes: [Vec<T>; 4],
    /// The sum of `1 - s`.
    total: S,
}

/// Moments and slopes for the backward pass, and memory.
#[derive(Debug, Default)]
pub(super) struct Saved<T, S> {
    pieces: Vec<Piece<T, S>>,
    /// Per piece of image rows: a row of sums of A, B and C along columns.
    sums: Vec<[Vec<S>; 3]>,
    /// The mean of each image, a constant that is subtracted first.
    offsets: [S; 2],
}

/// The extents of images `[H, W, C]`, and where windows fit.
#[derive(Clone, Copy)]
struct Layout {
    height: usize,
    /// Entries of a row, `W C`.
    row: usize,
    channels: usize,
    /// Rows of windows, and entries of such a row.
    windows: [usize; 2],
}

impl Layout {
    fn new(shape: &[usize]) -> Self {
        let [height, width, channels] = from_fn(|axis| shape[axis]);
        let windows = [height - BEYOND, (width - BEYOND) * channels];
        Self { height, row: width * channels, channels, windows }
    }

    /// Rows of windows in a piece of work.
    fn rows_per_piece(&self) -> usize {
        (ENTRIES_PER_PIECE / self.row / 4).max(1)
    }

    /// Rows of the image in a piece of work of the backward pass.
    fn image_rows_per_piece(&self) -> usize {
        (ENTRIES_PER_PIECE / self.row).max(1)
    }
}

/// The weights of a window along an axis.
fn weights<S: Scalar>() -> [S; WINDOW] {
    let weight = |k: usize| {
        let distance = k as f64 - (WINDOW / 2) as f64;
        (-distance * distance / (2.0 * SIGMA * SIGMA)).exp()
    };
    let total: f64 = (0..WINDOW).map(weight).sum();
    from_fn(|k| S::from_f64(weight(k) / total))
}

/// How many entries are worked on at once: vectors of them.
const AT_ONCE: usize = 4;

/// Five moments of each entry of a row over the rows of its windows.
#[inline(always)]
fn fill_moments<T: Scalar>(
    moments: &mut [Vec<T::Wide>; 5],
    images: [&[T]; 2],
    row: usize,
    w: &[T::Wide; WINDOW],
    offsets: [T::Wide; 2],
) {
    let mut k = 0;
    while k + AT_ONCE <= row {
        let sums = along_columns::<T, AT_ONCE>(images, row, k, w, offsets);
        for (moments, sums) in moments.iter_mut().zip(sums) {
            moments[k..k + AT_ONCE].copy_from_slice(&sums);
        }
        k += AT_ONCE;
    }
    for k in k..row {
        let sums = along_columns::<T, 1>(images, row, k, w, offsets);
        moments.iter_mut().zip(sums).for_each(|(moments, [m])| moments[k] = m);
    }
}

/// The moments of entries `k..k + L`, from the rows of a window.
#[inline(always)]
fn along_columns<T: Scalar, const L: usize>(
    [x, y]: [&[T]; 2],
    row: usize,
    k: usize,
    w: &[T::Wide; WINDOW],
    offsets: [T::Wide; 2],
) -> [[T::Wide; L]; 5] {
    let mut sums = [[T::Wide::ZERO; L]; 5];
    for (t, &w) in w.iter().enumerate() {
        let (x, y) = (&x[t * row + k..][..L], &y[t * row + k..][..L]);
        for j in 0..L {
            let (x, y) = (x[j].widen() - offsets[0], y[j].widen() - offsets[1]);
            let (wx, wy) = (w * x, w * y);
            sums[0][j] += wx;
            sums[1][j] += wy;
            sums[2][j] += wx * x;
            sums[3][j] += wy * y;
            sums[4][j] += wx * y;
        }
    }
    sums
}

/// `sum_t w_t row[k + t channels]` of entries `k..k + L`, of each of some rows.
#[inline(always)]
fn along_rows<S: Scalar, const N: usize, const L: usize>(
    rows: &[Vec<S>; N],
    channels: usize,
    k: usize,
    w: &[S; WINDOW],
) -> [[S; L]; N] {
    from_fn(|n| {
        let mut sums = [S::ZERO; L];
        for (t, &w) in w.iter().enumerate() {
            let row = &rows[n][k + t * channels..][..L];
            for j in 0..L {
                sums[j] += w * row[j];
            }
        }
        sums
    })
}

/// `number` with its value raised to `low`, or lowered to `high`; what a dual number carries stays.
#[inline(always)]
fn held<S: Scalar>(number: S, low: f64, high: f64) -> S {
    let value = number.to_f64();
    if value < low {
        number + S::from_f64(low - value)
    } else if value > high {
        number + S::from_f64(high - value)
    } else {
        number
    }
}

impl Ssim {
    /// Refuses images and a peak that have no similarity.
    fn check(
        &self,
        [shape, y_shape]: [&Shape; 2],
        operation: &'static str,
    ) -> Result<(), TensorError> {
        if shape != y_shape {
            let rule = "two images of one shape".into();
            let shapes = Box::new([shape.clone(), y_shape.clone()]);
            return Err(TensorError::Mismatch { operation, rule, shapes });
        }
        if !matches!(**shape, [h, w, c] if h.min(w) >= WINDOW && c > 0) {
            let rule = "images [H, W, C] of at least 11 x 11 pixels, C > 0".into();
            return Err(TensorError::Shape { operation, rule, shape: shape.clone() });
        }
        let constants = self.constants::<f64>();
        if !(self.peak > 0.0 && constants.into_iter().all(|c| c.is_normal())) {
            let (rule, value) = ("a peak above 0 whose square is a number".into(), self.peak);
            return Err(TensorError::Value { operation, rule, value });
        }
        Ok(())
    }

    /// `s` of moments, and A of x, A of y, B and C.
    #[inline(always)]
    fn similarity<S: Scalar>(
        &self,
        [mx, my, xx, yy, xy]: [S; 5],
        [c1, c2]: [S; 2],
        offsets: [S; 2],
    ) -> (S, [S; 4]) {
        let two = S::from_f64(2.0);
        let vx = held(xx - mx * mx, 0.0, f64::INFINITY);
        let vy = held(yy - my * my, 0.0, f64::INFINITY);
        let most = 0.5 * (vx.to_f64() + vy.to_f64());
        let vxy = held(xy - mx * my, -most, most);
        let b2 = vx + vy + c2;
        let cs = (two * vxy + c2) / b2;
        let (l, to_x, to_y) = if self.luminance {
            let (x, y) = (mx + offsets[0], my + offsets[1]);
            let b1 = x * x + y * y + c1;
            let l = (two * x * y + c1) / b1;
            let share = two * cs / b1;
            (l, share * (y - x * l), share * (x - y * l))
        } else {
            (S::ONE, S::ZERO, S::ZERO)
        };
        let s = l * cs;
        let (b, c) = (-(s / b2), two * l / b2);
        (s, [to_x - two * mx * b - my * c, to_y - two * my * b - mx * c, b, c])
    }

    /// `c1` and `c2`.
    fn constants<S: Scalar>(&self) -> [S; 2] {
        K.map(|k| S::from_f64((k * self.peak) * (k * self.peak)))
    }

    /// The gradient of image `number` of both.
    fn pull_back<T: Scalar>(
        &self,
        layout: Layout,
        images: [&[T]; 2],
        number: usize,
        saved: &mut Saved<T, T::Wide>,
        factor: T::Wide,
        (bar, fresh): (&mut [T], bool),
    ) {
        let Layout { height, row, channels, windows: [window_rows, window_row] } = layout;
        let w = &weights::<T::Wide>();
        let margin = BEYOND * channels;
        let per_piece = layout.image_rows_per_piece();
        let window_piece = layout.rows_per_piece();
        let Saved { pieces, sums, offsets } = saved;
        let [own_offset, other_offset] = [offsets[number], offsets[1 - number]];
        let pieces = &*pieces;
        sums.resize_with(height.div_ceil(per_piece), Default::default);
        let [own_image, other] = [images[number], images[1 - number]];
        let two = T::Wide::from_f64(2.0);
        for_each_two_pieces_mut(bar, sums, [per_piece * row, 1], |piece, bar, sums| {
            let sums = &mut sums[0];
            // Nothing beyond the windows on either side.
            for sums in &mut *sums {
                sums.clear();
                sums.resize(window_row + 2 * margin, T::Wide::ZERO);
            }
            for (row_in_piece, bar) in bar.chunks_mut(row).enumerate() {
                let q = piece * per_piece + row_in_piece;
                let window_rows_here = q.saturating_sub(BEYOND)..(q + 1).min(window_rows);
                for (sums, list) in sums.iter_mut().zip([number, 2, 3]) {
                    let sums = &mut sums[margin..][..window_row];
                    sums.fill(T::Wide::ZERO);
                    for r in window_rows_here.clone() {
                        let slopes = &pieces[r / window_piece].slopes[list];
                        let slopes = &slopes[r % window_piece * window_row..][..window_row];
                        let w = w[q - r];
                        sums.iter_mut().zip(slopes).for_each(|(sum, s)| *sum += w * s.widen());
                    }
                }
                let sums = &*sums;
                let (own_row, other) = (&own_image[q * row..][..row], &other[q * row..][..row]);
                let mut put = |k: usize, [a, b, c]: [T::Wide; 3]| {
                    let (x, y) = (own_row[k].widen() - own_offset, other[k].widen() - other_offset);
                    let term = T::narrow(-factor * (a + two * x * b + y * c));
                    bar[k] = if fresh { term } else { bar[k] + term };
                };
                let mut k = 0;
                while k + AT_ONCE <= row {
                    let sums = along_rows::<_, 3, AT_ONCE>(sums, channels, k, w);
                    (0..AT_ONCE).for_each(|j| put(k + j, sums.map(|sums| sums[j])));
                    k += AT_ONCE;
                }
                for k in k..row {
                    put(k, along_rows::<_, 3, 1>(sums, channels, k, w).map(|[sum]| sum));
                }
            }
        });
    }
}

impl<T: Scalar> Op<T> for Ssim {
    type Saved = Saved<T, T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        if self.luminance { "ssim_error" } else { "contrast_structure_error" }
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        self.check([inputs.shape(0), inputs.shape(1)], Op::<T>::name(self))?;
        let layout = Layout::new(inputs.shape(0));
        let [window_rows, window_row] = layout.windows;
        let images = [inputs.data(0), inputs.data(1)];
        let (w, constants) = (&weights::<T::Wide>(), self.constants());
        let offsets = images.map(|image| {
            let total = sum::<T>(image.len(), |k| image[k].widen());
            T::Wide::from_f64(total.to_f64() / image.len() as f64)
        });
        saved.offsets = offsets;
        let needs = [inputs.needs(0), inputs.needs(1)];
        let keeps = [needs[0], needs[1], inputs.any_needs(), inputs.any_needs()];
        let piece = |rows: std::ops::Range<usize>, piece: &mut Piece<T, T::Wide>| {
            let Piece { moments, slopes, total } = piece;
            *total = T::Wide::ZERO;
            moments.iter_mut().for_each(|moments| moments.resize(layout.row, T::Wide::ZERO));
            for (slopes, keeps) in slopes.iter_mut().zip(keeps) {
                slopes.resize(if keeps { rows.len() * window_row } else { 0 }, T::ZERO);
            }
            for (row_in_piece, r) in rows.enumerate() {
                let images = images.map(|image| &image[r * layout.row..]);
                fill_moments(moments, images, layout.row, w, offsets);
                // Row by row: a sum of few terms has a small error.
                let mut of_row = T::Wide::ZERO;
                let mut put = |k: usize, moments: [T::Wide; 5]| {
                    let (s, all_slopes) = self.similarity(moments, constants, offsets);
                    of_row += T::Wide::ONE - s;
                    for ((slopes, keeps), slope) in slopes.iter_mut().zip(keeps).zip(all_slopes) {
                        if keeps {
                            slopes[row_in_piece * window_row + k] = T::narrow(slope);
                        }
                    }
                };
                let mut k = 0;
                while k + AT_ONCE <= window_row {
                    let means = along_rows::<_, 5, AT_ONCE>(moments, layout.channels, k, w);
                    (0..AT_ONCE).for_each(|j| put(k + j, means.map(|means| means[j])));
                    k += AT_ONCE;
                }
                for k in k..window_row {
                    let means = along_rows::<_, 5, 1>(moments, layout.channels, k, w);
                    put(k, means.map(|[means]| means));
                }
                *total += of_row;
            }
        };
        let mut total = T::Wide::ZERO;
        let per_piece = layout.rows_per_piece();
        merge_ranges_into(&mut saved.pieces, window_rows, per_piece, piece, |p| total += p.total);
        let count = T::Wide::from_f64((window_rows * window_row) as f64);
        outputs.push([])[0] = T::narrow(total / count);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let layout = Layout::new(kept.input_shape(0));
        let [rows, row] = layout.windows;
        let factor = kept.only_upstream()[0].widen() / T::Wide::from_f64((rows * row) as f64);
        let images = [kept.input(0), kept.input(1)];
        for number in 0..2 {
            if let Some(bar) = gradients.get(number) {
                self.pull_back(layout, images, number, saved, factor, bar.entries_or_fresh());
            }
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let bytes = |piece: &Piece<T, T::Wide>| -> usize {
            piece.slopes.iter().map(|slopes| size_of_val(slopes.as_slice())).sum()
        };
        saved.pieces.iter().map(bytes).sum()
    }
}

/// The structural dissimilarity of `image` and `reference`, both `[H, W, C]`: the mean of `1 - SSIM` over
/// the places of a window of 11 x 11 pixels and over channels, from 0 to 2; returns `[]`. `peak` is the
/// largest value that images may have: 1, or 255.
///
/// Both have gradients; where one needs none, its part is left out. It costs many times as much as a mean
/// squared error.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have one shape; [`TensorError::Shape`] for images smaller than
/// a window; [`TensorError::Value`] for a peak that is not above 0, or whose square is out of range.
#[inline(never)]
pub fn ssim_error<'t, T: Scalar>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    peak: f64,
) -> Result<Var<'t, T>, TensorError> {
    image.tape().apply(Ssim { luminance: true, peak }, &[image, reference])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    fn image(shape: [usize; 3], seed: usize) -> Tensor<f64> {
        Tensor::from_flat_fn(shape, |k| ((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0)
    }

    /// The mean of `1 - s` by direct windows and centred moments.
    fn naive(x: &Tensor<f64>, y: &Tensor<f64>, peak: f64, luminance: bool) -> f64 {
        let [height, width, channels] = from_fn(|axis| x.shape()[axis]);
        let (mut total, mut count) = (0.0, 0.0);
        for r in 0..height - 10 {
            for s in 0..width - 10 {
                for c in 0..channels {
                    let mut window = Vec::new();
                    for i in 0..11 {
                        for j in 0..11 {
                            let square = (i as f64 - 5.0).powi(2) + (j as f64 - 5.0).powi(2);
                            let at = [r + i, s + j, c];
                            window.push(((-square / 4.5).exp(), x[at], y[at]));
                        }
                    }
                    let mass: f64 = window.iter().map(|(w, ..)| w).sum();
                    let mean = |f: &dyn Fn(f64, f64) -> f64| {
                        window.iter().map(|&(w, x, y)| w / mass * f(x, y)).sum::<f64>()
                    };
                    let (mx, my) = (mean(&|x, _| x), mean(&|_, y| y));
                    let vx = mean(&|x, _| (x - mx).powi(2));
                    let vy = mean(&|_, y| (y - my).powi(2));
                    let vxy = mean(&|x, y| (x - mx) * (y - my));
                    let (c1, c2) = ((0.01 * peak).powi(2), (0.03 * peak).powi(2));
                    let l = (2.0 * mx * my + c1) / (mx * mx + my * my + c1);
                    let cs = (2.0 * vxy + c2) / (vx + vy + c2);
                    total += 1.0 - if luminance { l * cs } else { cs };
                    count += 1.0;
                }
            }
        }
        total / count
    }

    fn error(x: &Tensor<f64>, y: &Tensor<f64>, peak: f64, luminance: bool) -> f64 {
        let tape = Tape::new();
        let op = Ssim { luminance, peak };
        tape.apply(op, &[tape.leaf(x), tape.leaf(y)]).unwrap().item()
    }

    #[test]
    fn the_error_is_that_of_direct_windows() {
        for shape in [[11, 11, 1], [12, 17, 3], [40, 23, 2], [11, 300, 1], [90, 90, 4]] {
            let (x, y) = (image(shape, 1), image(shape, 2));
            // Alike, for the other end of the range.
            let near = Tensor::from_flat_fn(shape, |k| x.data()[k] + 0.05 * y.data()[k]);
            for (y, peak) in [(&y, 1.0), (&near, 1.0), (&near, 255.0)] {
                for luminance in [true, false] {
                    let found = error(&x, y, peak, luminance);
                    let expected = naive(&x, y, peak, luminance);
                    approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
                }
            }
        }
    }

    #[test]
    fn equal_images_have_the_error_0_and_no_gradient() {
        for scale in [1e-20, 1.0, 1e6] {
            for entry in [|k: usize| 0.7 + 0.0 * k as f64, |k| (k as f64).sqrt()] {
                let x = Tensor::from_flat_fn([13, 19, 2], |k| (scale * entry(k)) as f32);
                let tape = Tape::new();
                let [image, reference] = [tape.leaf(&x), tape.leaf(&x)];
                let error = ssim_error(image, reference, 1.0).unwrap();
                assert_eq!(error.item(), 0.0);
                let gradients = error.backward().unwrap();
                for variable in [image, reference] {
                    assert!(gradients.get_or_zeros(variable).data().iter().all(|g| *g == 0.0));
                }
            }
        }
    }

    #[test]
    fn the_error_is_symmetric_and_keeps_under_a_common_scale() {
        let (x, y) = (image([20, 16, 3], 3), image([20, 16, 3], 4));
        let found = error(&x, &y, 1.0, true);
        approx::assert_relative_eq!(error(&y, &x, 1.0, true), found, max_relative = 1e-14);
        let times = |of: &Tensor<f64>, factor: f64| of.map(|entry| factor * entry);
        for power in [-30, 8, 100] {
            let factor = f64::powi(2.0, power);
            let scaled = error(&times(&x, factor), &times(&y, factor), factor, true);
            approx::assert_relative_eq!(scaled, found, max_relative = 1e-14);
        }
        // Turned inside out, contrast and structure say the opposite.
        let negative = error(&x, &x.map(|entry| 1.0 - entry), 1.0, false);
        assert!(negative > 1.9, "{negative}");
    }

    #[test]
    fn rows_that_are_worked_on_alone_are_those_of_a_whole() {
        // Of several pieces: a shift by a row moves windows from one piece to the next.
        let tall = image([200, 40, 3], 5);
        let other = image([200, 40, 3], 6);
        let part = |of: &Tensor<f64>, rows: std::ops::Range<usize>| {
            let data = of.data()[rows.start * 120..rows.end * 120].to_vec();
            Tensor::new([rows.len(), 40, 3], data).unwrap()
        };
        let whole = 190.0 * error(&tall, &other, 1.0, true);
        for cut in [1, 33, 64, 100] {
            let above = error(&part(&tall, 0..cut + 10), &part(&other, 0..cut + 10), 1.0, true);
            let below = error(&part(&tall, cut..200), &part(&other, cut..200), 1.0, true);
            let sum = cut as f64 * above + (190 - cut) as f64 * below;
            approx::assert_relative_eq!(sum, whole, max_relative = 1e-13);
        }
    }
}
