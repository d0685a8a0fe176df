//! Blurs of pictures, and their squared error, without the image of the picture.
//!
//! # Forward
//! A blur, `b = K c`, sees a few rows of the image c at a time. So they are written from the picture's
//! values a *chunk* of rows at a time, into memory that stays in a cache, and blurred from there. Of the
//! squared error `L = sum_k (b_k - r_k)^2` the gradients are computed along with it, while `b` is there:
//! `dL/dsigma = sum_k 2 (b_k - r_k) db_k/dsigma` and `dL/dc = K^T 2 (b - r)`, each chunk of which is added
//! to the gradients of the picture's values at once. Neither c nor b nor `db/dsigma` is ever stored as a
//! whole.
//!
//! # Backward
//! `sigma_bar = L_bar dL/dsigma`, and the values' gradient is `L_bar` times what is known of it; where
//! `L_bar` is 1, as in a fit, nothing is computed.
//!
//! # The same bits
//! Rows are blurred as those of the whole image are, and sums have the pieces of [`bokashi_core::sum`]
//! and of `gaussian_blur`. So the bits are those of the operations that this one stands for. Only where
//! `L_bar` is no power of two, gradients are rounded otherwise.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_item_mut, for_each_zipped_mut, threads};
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, Tensor, Var, sum};

use super::{GaussianBlur, PRODUCTS, dot, gaussian_blur};
use crate::background::Kind;
use crate::border::Border;
use crate::convolution::{Band, Convolution};
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::picture::Picture;
use crate::picture_rows::PictureRows;
use crate::runs::rows_per_band;
use crate::scratch::Workbench;
use crate::taps::{Blur, Kernel, Taps, check_radius};

/// A picture that is seen through a Gaussian blur: [`Picture::blurred`]. Nothing is computed until its image or its
/// loss is asked for.
#[derive(Debug, Clone)]
pub struct Blurred<'t, T: Scalar> {
    pub(crate) picture: Picture<'t, T>,
    sigma: Var<'t, T>,
    blur: Blur,
}

impl<'t, T: Scalar> Picture<'t, T> {
    /// The picture through a Gaussian blur with the standard deviation `sigma`, in pixels: [`gaussian_blur`] of
    /// [`Picture::image`], to the same bits.
    pub fn blurred(&self, sigma: Var<'t, T>, blur: &Blur) -> Blurred<'t, T> {
        Blurred { picture: self.clone(), sigma, blur: *blur }
    }
}

impl<'t, T: Scalar> Blurred<'t, T> {
    /// The blurred image, `[H, W, C]`.
    ///
    /// Where the background is a constant colour, the image before the blur takes no memory. So it is
    /// for the sampled and the unnormalized kernel, and for windows of the discrete one, with a zero or
    /// a mirror border.
    ///
    /// # Errors
    /// As [`gaussian_blur`].
    #[inline(never)]
    pub fn image(&self) -> Result<Var<'t, T>, RenderError> {
        if !self.is_blurred_by_rows()? {
            return gaussian_blur(self.picture.image()?, self.sigma, &self.blur);
        }
        let op = BlurOfPicture { rows: self.rows_to_blur() };
        self.picture.values.tape().apply(op, &self.inputs())
    }

    /// The sum of the squared errors of the image against `reference: [H, W, C]`, where it is blurred by rows;
    /// returns `[]`.
    pub(crate) fn squared_error(&self, reference: &Tensor<T>) -> Result<Var<'t, T>, RenderError> {
        let op = BlurredSquaredError { rows: self.rows_to_blur(), reference: reference.clone() };
        self.picture.values.tape().apply(op, &self.inputs())
    }

    fn inputs(&self) -> [Var<'t, T>; 3] {
        [self.picture.values, self.sigma, self.picture.backdrop.values]
    }

    /// Whether the picture is blurred without its image.
    ///
    /// # Errors
    /// As [`gaussian_blur`], but for a sigma that it refuses.
    pub(crate) fn is_blurred_by_rows(&self) -> Result<bool, RenderError> {
        let Self { picture: Picture { backdrop, coverage, .. }, sigma, blur } = self;
        let shape = sigma.shape();
        if shape.size() != 1 {
            let rule = "a single number for sigma".to_owned();
            return Err(RenderError::Shape { operation: "gaussian_blur", rule, shape });
        }
        check_radius(blur.radius)?;
        let (sigma, size) = (sigma.item(), coverage.size());
        let is_identity = blur.kernel != Kernel::Unnormalized && sigma == T::ZERO;
        let order = GaussianBlur { blur: *blur }.order(sigma.to_f64(), [size.width, size.height]);
        Ok(backdrop.kind == Kind::Color
            && blur.kernel != Kernel::Disc
            && !backdrop.values.needs_gradient()
            // Its adjoint adds what lies beyond the border to far rows.
            && blur.border != Border::Clamp
            && !is_identity
            && order.is_none())
    }

    fn rows_to_blur(&self) -> RowsToBlur {
        let Picture { coverage, blended, .. } = &self.picture;
        RowsToBlur { coverage: Arc::clone(coverage), blended: blended.clone(), blur: self.blur }
    }
}

const ERROR_NAME: &str = "blurred_squared_error";

/// Entries in a chunk, for each thread: so few that chunks stay in a shared cache, and enough bands that
/// threads end together.
const ENTRIES_PER_CHUNK: usize = if cfg!(test) { 1 << 10 } else { 1 << 19 };

/// A picture whose rows are blurred.
struct RowsToBlur {
    coverage: Arc<Coverage>,
    blended: Option<Arc<Vec<u32>>>,
    blur: Blur,
}

impl RowsToBlur {
    fn shape(&self, channels: usize) -> [usize; 3] {
        let size = self.coverage.size();
        [size.height, size.width, channels]
    }

    fn picture_rows(&self, channels: usize) -> PictureRows<'_> {
        let blended = self.blended.as_deref().map_or(&[][..], Vec::as_slice);
        PictureRows { coverage: &self.coverage, blended, channels }
    }

    /// The chunks of rows, from the top: whole bands, as many rows as a window sees to either side, so
    /// that a row is written for few chunks, and a number that no result depends on.
    fn chunks(&self, channels: usize, reach: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let size = self.coverage.size();
        let height = size.height;
        let rows = (threads() * ENTRIES_PER_CHUNK / (size.width * channels)).max(reach).max(1);
        let rows = rows.next_multiple_of(rows_per_band(size));
        (0..height).step_by(rows).map(move |first| first..(first + rows).min(height))
    }
}

/// Some rows of an image, which move down with the chunks.
#[derive(Debug, Default)]
struct MovingRows<T> {
    entries: Vec<T>,
    /// The rows that are there.
    rows: Range<usize>,
}

impl<T: Scalar> MovingRows<T> {
    /// Makes these `rows` of `length` entries each, at or below those that are there; `fill(first, rows)`
    /// writes those that are missing.
    fn move_to(&mut self, rows: Range<usize>, length: usize, fill: impl FnOnce(usize, &mut [T])) {
        let known = self.rows.end.saturating_sub(rows.start) * length;
        let all = rows.len() * length;
        if known > 0 {
            let start = (rows.start - self.rows.start) * length;
            self.entries.copy_within(start..start + known, 0);
        }
        enough(&mut self.entries, all);
        fill(rows.start + known / length, &mut self.entries[known..all]);
        self.rows = rows;
    }

    /// Forgets all rows: they are of another image.
    fn forget(&mut self) {
        self.rows = 0..0;
    }

    /// The entries from the first row on, and that row.
    fn view(&self) -> (&[T], usize) {
        (&self.entries, self.rows.start)
    }

    fn bytes(&self) -> usize {
        size_of_val(self.entries.as_slice())
    }
}

/// The rows that a window sees around some rows of an image `height` high.
fn around(rows: &Range<usize>, reach: usize, height: usize) -> Range<usize> {
    rows.start.saturating_sub(reach)..(rows.end + reach).min(height)
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<T: Scalar> {
    taps: [Taps<T>; 2],
    /// `db/dsigma`, of a chunk where only a sum is wanted of it.
    slopes: Vec<T>,
    /// `dL/dsigma`.
    slope: T::Wide,
    /// The gradients of L with respect to the picture's values, `[P, C]`.
    values_bar: Arc<Vec<T>>,
    /// Memory: for pieces of work, for the rows around a chunk and around those that come before it, for
    /// a chunk and its gradients, for sums by piece.
    bands: Workbench<Band<T>>,
    image: MovingRows<T>,
    b_bar: MovingRows<T>,
    chunk: Vec<T>,
    image_bar: Vec<T>,
    sums: Vec<[T::Wide; 2]>,
    products: Vec<T::Wide>,
}

impl<T: Scalar> Saved<T> {
    fn bytes(&self) -> usize {
        let Self { slopes, values_bar, bands, image, b_bar, chunk, image_bar, .. } = self;
        let entries = slopes.len() + values_bar.len() + chunk.len() + image_bar.len();
        image.bytes() + b_bar.bytes() + size_of::<T>() * (entries + bands.total(Band::len))
    }
}

/// The first `length` entries of `memory`.
fn enough<T: Scalar>(memory: &mut Vec<T>, length: usize) -> &mut [T] {
    if memory.len() < length {
        memory.resize(length, T::ZERO);
    }
    &mut memory[..length]
}

/// Inputs: values `[P, C]`, sigma `[]`, a colour `[C]`. Output: the blurred image `[H, W, C]`.
struct BlurOfPicture {
    rows: RowsToBlur,
}

impl<T: Scalar> Op<T> for BlurOfPicture {
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
        let (values, sigma, color) = (inputs.data(0), inputs.data(1)[0], inputs.data(2));
        let channels = color.len();
        let shape @ [height, width, _] = self.rows.shape(channels);
        let length = width * channels;
        let Saved { taps, slopes, bands, image, .. } = saved;
        Taps::fill(taps, sigma, &self.rows.blur, [width, height])?;
        let convolution = Convolution::new(&shape, self.rows.blur.border, taps);
        let out = outputs.push(shape);
        slopes.resize(if inputs.needs(1) { out.len() } else { 0 }, T::ZERO);
        let (picture, reach) = (self.rows.picture_rows(channels), convolution.reach());
        image.forget();
        for chunk in self.rows.chunks(channels, reach) {
            image.move_to(around(&chunk, reach, height), length, |first, rows| {
                picture.fill(values, color, first, rows);
            });
            let entries = chunk.start * length..chunk.end * length;
            let slopes = slopes.get_mut(entries.clone()).unwrap_or_default();
            convolution.apply_from(image.view(), chunk.start, bands, &mut out[entries], slopes);
        }
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let b_bar = kept.only_upstream();
        let Saved { taps, slopes, bands, image_bar: memory, products, .. } = saved;
        if let Some(sigma_bar) = gradients.get(1) {
            let sum = dot(slopes, b_bar, products);
            sigma_bar.add_each(|_| T::narrow(sum));
        }
        let Some(values_bar) = gradients.get(0) else { return };
        let values_bar = values_bar.entries();
        let channels = kept.input_shape(2).size();
        let shape @ [_, width, _] = self.rows.shape(channels);
        let length = width * channels;
        let adjoint = Convolution::new(&shape, self.rows.blur.border, taps).adjoint();
        for chunk in self.rows.chunks(channels, adjoint.reach()) {
            let image_bar = enough(memory, chunk.len() * length);
            adjoint.apply_from((b_bar, 0), chunk.start, bands, image_bar, &mut []);
            self.rows.picture_rows(channels).pull_back(image_bar, chunk, values_bar);
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.bytes()
    }
}

/// Inputs: values `[P, C]`, sigma `[]`, a colour `[C]`. Output: the error `[]`.
struct BlurredSquaredError<T> {
    rows: RowsToBlur,
    /// `[H, W, C]`.
    reference: Tensor<T>,
}

impl<T: Scalar> Op<T> for BlurredSquaredError<T> {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        ERROR_NAME
    }

    // In one piece: four windows of rows move together.
    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (values, sigma, color) = (inputs.data(0), inputs.data(1)[0], inputs.data(2));
        let [with_values, with_slope] = [inputs.needs(0), inputs.needs(1)];
        let channels = color.len();
        let shape @ [height, width, _] = self.rows.shape(channels);
        let length = width * channels;
        let Saved { taps, slopes, slope, values_bar, bands, .. } = saved;
        let Saved { image, b_bar, chunk: memory, image_bar, sums, .. } = saved;
        Taps::fill(taps, sigma, &self.rows.blur, [width, height])?;
        let convolution = Convolution::new(&shape, self.rows.blur.border, taps);
        let (adjoint, reach) = (convolution.adjoint(), convolution.reach());
        let (picture, reference) = (self.rows.picture_rows(channels), self.reference.data());
        let per_band = rows_per_band(self.rows.coverage.size());
        let values_bar = fresh(values_bar, if with_values { values.len() } else { 0 });
        values_bar.fill(T::ZERO);
        let two = T::from_f64(2.0);
        // Windows of rows move down with the chunks. The blur sees `reach` rows to either side:
        //   image             chunk.start - reach  .....................  chunk.end + reach   c
        //   blurred, slopes             start / length  .....  chunk.end                      b, db/dsigma
        //   b_bar        pulled - reach  ....................  chunk.end                      2 (b - r)
        //   image_bar           pulled  .....  known                                          K^T b_bar
        // A row's gradient is known once b_bar is known `reach` rows below it: up to chunk.end - reach, in
        // whole bands.
        image.forget();
        b_bar.forget();
        sums.clear();
        // Entries whose sums are still to be taken begin at `start`: a piece may lie in two chunks. The
        // gradients of the rows before `pulled` are known.
        let (mut start, mut pulled) = (0, 0);
        for chunk in self.rows.chunks(channels, reach) {
            image.move_to(around(&chunk, reach, height), length, |first, rows| {
                picture.fill(values, color, first, rows);
            });
            let (offset, end) = (chunk.start * length - start, chunk.end * length);
            let blurred = enough(memory, end - start);
            let slopes = enough(slopes, if with_slope { end - start } else { 0 });
            let of_chunk = offset.min(slopes.len());
            let (of_chunk, blurred_here) = (&mut slopes[of_chunk..], &mut blurred[offset..]);
            convolution.apply_from(image.view(), chunk.start, bands, blurred_here, of_chunk);

            if with_values {
                let is_last = chunk.end == height;
                let known = chunk.end.saturating_sub(reach) / per_band * per_band;
                let known = if is_last { height } else { known.max(pulled) };
                let seen = pulled.saturating_sub(reach)..chunk.end;
                b_bar.move_to(seen, length, |first, b_bar| {
                    debug_assert_eq!(first, chunk.start);
                    let reference = &reference[first * length..];
                    for_each_zipped_mut(b_bar, [blurred_here, reference], |bar, [b, r]| {
                        *bar = two * (b - r)
                    });
                });
                let image_bar = enough(image_bar, (known - pulled) * length);
                adjoint.apply_from(b_bar.view(), pulled, bands, image_bar, &mut []);
                picture.pull_back(image_bar, pulled..known, values_bar);
                pulled = known;
            }

            // Sums are taken of whole pieces, as `sum` cuts them; the rest waits for the next chunk.
            let done = if chunk.end == height { end } else { end / PIECE * PIECE };
            let first = sums.len();
            sums.resize(first + (done - start).div_ceil(PIECE), [T::Wide::ZERO; 2]);
            let (blurred, slopes_now) = (&*blurred, &*slopes);
            let reference = &reference[start..];
            for_each_item_mut(&mut sums[first..], |k, sums| {
                let piece = k * PIECE..((k + 1) * PIECE).min(done - start);
                let (b, r) = (&blurred[piece.clone()], &reference[piece.clone()]);
                *sums = sums_of_piece(b, r, slopes_now.get(piece).unwrap_or_default());
            });
            memory.copy_within(done - start..end - start, 0);
            slopes.copy_within((done - start).min(slopes.len()).., 0);
            start = done;
        }
        // In the order of `bokashi_core::sum` and of `dot`.
        let total = sums.iter().fold(T::Wide::ZERO, |total, [square, _]| total + *square);
        outputs.push([])[0] = T::narrow(total);
        *slope = sums.iter().map(|&[_, product]| product).sum();
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let l_bar = kept.only_upstream()[0];
        let Saved { slope, values_bar, .. } = saved;
        if let Some(sigma_bar) = gradients.get(1) {
            sigma_bar.add_each(|_| T::narrow(l_bar.widen() * *slope));
        }
        gradients.lend_scaled(0, l_bar, values_bar);
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.bytes()
    }
}

/// `list` with `length` entries, whatever they are; another list where somebody else holds this one.
fn fresh<T: Scalar>(list: &mut Arc<Vec<T>>, length: usize) -> &mut [T] {
    if Arc::get_mut(list).is_none() {
        *list = Arc::default();
    }
    let list = Arc::get_mut(list).expect("nobody else holds it");
    if list.len() != length {
        list.resize(length, T::ZERO);
    }
    list
}

/// Entries that are summed on their own, by `sum` and by `dot`.
const PIECE: usize = PRODUCTS;
const _: () = assert!(PIECE == ENTRIES_PER_PIECE);

/// Of a piece: `sum_k (b_k - r_k)^2` and `sum_k s_k 2 (b_k - r_k)`, where there are slopes s.
fn sums_of_piece<T: Scalar>(b: &[T], r: &[T], slopes: &[T]) -> [T::Wide; 2] {
    let squares = sum::<T>(b.len(), |k| {
        let difference = b[k].widen() - r[k].widen();
        difference * difference
    });
    [squares, crate::dispatch::dispatch::<T, _>(Products { b, r, slopes })]
}

/// `sum_k s_k 2 (b_k - r_k)`, compiled for the vectors that the processor has.
struct Products<'a, T> {
    b: &'a [T],
    r: &'a [T],
    slopes: &'a [T],
}

impl<T: Scalar> pulp::WithSimd for Products<'_, T> {
    type Output = T::Wide;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> T::Wide {
        const LANES: usize = super::LANES;
        let two = T::from_f64(2.0);
        let mut lanes = [T::Wide::ZERO; LANES];
        let length = self.slopes.len();
        let (slopes, slopes_rest) = self.slopes.as_chunks::<LANES>();
        let (b, b_rest) = self.b[..length].as_chunks::<LANES>();
        let (r, r_rest) = self.r[..length].as_chunks::<LANES>();
        for ((slope, b), r) in slopes.iter().zip(b).zip(r) {
            for k in 0..LANES {
                lanes[k] += slope[k].widen() * (two * (b[k] - r[k])).widen();
            }
        }
        for (k, ((slope, &b), &r)) in slopes_rest.iter().zip(b_rest).zip(r_rest).enumerate() {
            lanes[k] += slope.widen() * (two * (b - r)).widen();
        }
        lanes.into_iter().sum()
    }
}
