//! Downsampling of an image by a whole factor, by any separable filter.
//!
//! # Forward
//! `y = R_x R_y c`: along the columns, then along the rows, channel by channel. One pixel of y stands
//! for a block of k by k pixels, and their centres are the same. Along a line
//! `(R c)_j = sum_t w_t c_(k j + f + t)`, with the weights `w` of the filter, stretched by k, and the
//! place f of the first (`filter`); what lies outside is the border's.
//!
//! # Backward
//! `c_bar = R_y^T R_x^T y_bar`, with `(R^T g)_i = sum_j w_(i - k j - f) g_j`. What that puts outside the
//! image is added where the border takes its pixels from.
//!
//! It is linear, and so smooth everywhere.
//!
//! # Order of work
//! Rows are weighed first (`weighing`): whole rows side by side in memory. What is left is a k-th of the
//! image. Its pixels are sorted by their column modulo k. Then a tap of all pixels of a row is a run of
//! neighbours, too.
//!
//! # Source
//! Wolberg, *Digital image warping*, 1990, section 5: filters that are stretched by the factor against
//! aliasing.

mod weighing;

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, TensorError, Var};

use self::weighing::{Band, Lists, Window, add_weighed, weigh};
use crate::border::Border;
use crate::error::RenderError;
use crate::filter::Filter;
use crate::scratch::Workbench;

/// `image: [H, W, C]` with a k-th of the rows and columns: `[H / k, W / k, C]`, with the gradient of the
/// image. A pixel of the result has its centre in the middle of a block of `k` by `k` pixels. It is the mean
/// of the pixels around it, weighted by `filter`, which is stretched by `k`.
///
/// A constant image stays as it is, but for a zero border under a filter that reaches beyond it. A
/// factor of 1 with a filter that interpolates is the identity: the image itself is returned. The box is
/// as fast as memory is read; other filters take longer by their radius.
///
/// # Errors
/// - `TensorError::Value` for a factor of 0, for a filter's radius that is not above 0 and at most 64,
///   and for weights whose sum is not finite or 0.
/// - [`RenderError::Shape`] unless the image is `[H, W, C]` with at least one entry, H and W multiples
///   of `k`.
#[inline(never)]
pub fn downsample<'t, T: Scalar>(
    image: Var<'t, T>,
    k: usize,
    filter: &Filter,
    border: Border,
) -> Result<Var<'t, T>, RenderError> {
    image.tape().apply(Downsample { factor: k, filter: filter.clone(), border }, &[image])
}

const NAME: &str = "downsample";

/// Input: image `[H, W, C]`. Output: `[H / k, W / k, C]`.
struct Downsample {
    factor: usize,
    filter: Filter,
    border: Border,
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<T> {
    window: Window<T>,
    /// The rows of the image that each row of the result sees, and the other way about.
    rows: Lists<T>,
    by_row: Lists<T>,
    /// Memory: for pieces of work; for rows that are spread to the image's width.
    bands: Workbench<Band<T>>,
    spread: Vec<T>,
}

/// Entries of the image that one piece of work sees: 256 kB in `f32`.
const PIECE: usize = 1 << 16;

impl<T: Scalar> Op<T> for Downsample {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (shape, k) = (inputs.shape(0), self.factor);
        if k == 0 {
            let rule = "a factor of at least 1".into();
            return Err(TensorError::Value { operation: NAME, rule, value: 0.0 }.into());
        }
        let [height, width, channels] = match **shape {
            [h, w, c] if h * w * c > 0 && h % k == 0 && w % k == 0 => [h, w, c],
            _ => {
                let rule = "an image of shape [H, W, C] with at least one entry";
                let rule = format!("{rule}, H and W multiples of {k}");
                return Err(RenderError::Shape { operation: NAME, rule, shape: shape.clone() });
            }
        };
        let Saved { window, rows, by_row, bands, .. } = saved;
        window.fill(&self.filter, k, self.border)?;
        if k == 1 && window.is_one_pixel() {
            outputs.pass(0, "the factor is 1, and the filter interpolates");
            return Ok(());
        }
        rows.fill(window, height);
        if inputs.needs(0) {
            by_row.transpose(rows, height);
        }
        let (image, row) = (inputs.data(0), width * channels);
        let out_row = row / k;
        let per_piece = (PIECE / (row * k)).max(1);
        let out = outputs.push([height / k, width / k, channels]);
        let (window, rows) = (&*window, &*rows);
        for_each_piece_mut(out, per_piece * out_row, |piece, out| {
            let (first, lines) = (piece * per_piece, Lines { window, width, channels });
            bands.with(|band| {
                crate::dispatch::dispatch::<T, _>(Gather { lines, rows, image, first, band, out });
            });
        });
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(image_bar) = gradients.get(0) else { return };
        let out_bar = kept.only_upstream();
        let &[height, width, channels] = &**kept.input_shape(0) else { return };
        let (k, row) = (self.factor, width * channels);
        let out_row = row / k;
        let Saved { window, by_row, bands, spread, .. } = saved;
        let (window, by_row, bands) = (&*window, &*by_row, &*bands);
        spread.resize(height / k * row, T::ZERO);
        let per_piece = (PIECE / (row * k)).max(1);
        for_each_piece_mut(spread, per_piece * row, |piece, spread| {
            let (first, lines) = (piece * per_piece, Lines { window, width, channels });
            let from = &out_bar[first * out_row..];
            bands.with(|band| {
                crate::dispatch::dispatch::<T, _>(Spread { lines, from, band, spread })
            });
        });
        let (entries, fresh) = image_bar.entries_or_fresh();
        let per_piece = (PIECE / row).max(1);
        for_each_piece_mut(entries, per_piece * row, |piece, entries| {
            let first = piece * per_piece;
            crate::dispatch::dispatch::<T, _>(Add { by_row, spread, first, row, fresh, entries });
        });
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { window, rows, by_row, bands, spread } = saved;
        let entries = window.len() + bands.total(Band::len) + spread.len();
        size_of::<T>() * entries + rows.bytes() + by_row.bytes()
    }
}

/// The lines of an image, and how they are seen.
#[derive(Clone, Copy)]
struct Lines<'a, T> {
    window: &'a Window<T>,
    /// Pixels in a line.
    width: usize,
    channels: usize,
}

/// The rows `out` of a piece, compiled for the vectors that the processor has.
struct Gather<'a, T> {
    lines: Lines<'a, T>,
    rows: &'a Lists<T>,
    image: &'a [T],
    first: usize,
    band: &'a mut Band<T>,
    out: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for Gather<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { lines: Lines { window, width, channels }, rows, image, first, band, out } = self;
        let row = window.count(width) * channels;
        for (j, out) in out.chunks_exact_mut(row).enumerate() {
            weigh(rows.row(first + j), image, band.line(window, width, channels));
            band.gather(window, width, channels, out);
        }
    }
}

/// Rows of the result, `from` on, spread to the width of the image; the same.
struct Spread<'a, T> {
    lines: Lines<'a, T>,
    from: &'a [T],
    band: &'a mut Band<T>,
    spread: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for Spread<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { lines: Lines { window, width, channels }, from, band, spread } = self;
        let rows = from.chunks_exact(window.count(width) * channels);
        for (spread, from) in spread.chunks_exact_mut(width * channels).zip(rows) {
            band.spread(window, width, channels, from);
            spread.copy_from_slice(band.line(window, width, channels));
        }
    }
}

/// Rows of the gradient of the image, of `row` entries, from rows that are spread; the same.
struct Add<'a, T> {
    by_row: &'a Lists<T>,
    spread: &'a [T],
    first: usize,
    row: usize,
    /// Whether the entries mean nothing yet.
    fresh: bool,
    entries: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for Add<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        for (i, entries) in self.entries.chunks_exact_mut(self.row).enumerate() {
            let list = self.by_row.row(self.first + i);
            if self.fresh {
                weigh(list, self.spread, entries);
            } else {
                add_weighed(list, self.spread, entries);
            }
        }
    }
}
