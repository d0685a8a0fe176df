//! Blur with a discrete Gaussian at a cost that does not grow with sigma.
//!
//! # Forward
//! The discrete Gaussian of variance t is `exp(t L / 2)`, where L is the second difference. Take
//! poles z and residues `z g` of a rational approximation of the exponential (`poles`), and
//! `h = t / 2`. A line x becomes `y = r x + Re sum_j c_j v_j`, where `(h L - z_j) v_j = x`,
//! `c_j = 2 z_j g_j` and `r = 1 + 2 Re sum_j g_j`: one tridiagonal system for each pole. With a
//! mirror border, the entry nearest to zero is subtracted from the line before, and added after. So
//! a constant is kept to the last digit, and no entry grows.
//!
//! Beyond a mirror border the line goes on mirrored: L repeats its ends. Beyond a zero border the
//! solution goes on without end and falls off as `v_k = q^k v_0`, with `q + 1/q - 2 = z / h` and
//! `|q| < 1`. That changes only the first and the last equation, so both borders are exact. A clamp
//! border is left to windows.
//!
//! # Slope
//! `dy/dsigma` is the derivative of the rational function, not of the exponential. It takes one
//! more system, `(h L - z_j) w_j = x' - 2 (x + z_j e v_j) / sigma`, and then
//! `y' = r x' + Re sum_j c_j w_j`, with `x' = dx/dsigma`. Here `e = 1`, except at the ends of a
//! line with a zero border. There `e = 1 / (1 - q^2)`, since q changes with sigma, too.
//!
//! # Adjoint
//! All of this is symmetric: the adjoint of the blur is the blur.
//!
//! # Order of work
//! First along the columns: 32 columns lie side by side, and each step goes down all of them at
//! once. Then along the rows: as many rows and channels lie side by side as make 32.
//!
//! # Precision
//! Where sigma is large, the factor of each elimination step is close to 1. So its difference from
//! 1 is stored, which keeps its digits. In `f32` rounding adds less than 2e-6 of the largest entry,
//! for any sigma up to 3000.
//!
//! # Source
//! Lindeberg, *Scale-space for discrete signals*, IEEE PAMI 12(3), 1990: the kernel. Trefethen,
//! Weideman and Schmelzer, *Talbot quadratures and rational approximations*, BIT 46, 2006: the
//! approximation.

mod complex;
mod line;
mod poles;
#[cfg(test)]
mod tests;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_piece_mut, for_each_two_pieces_mut};

use self::line::{LANES, Lanes, Task};
use crate::copy::copy;
use crate::scratch::Workbench;

pub(super) use self::line::{Block, Line};
pub(super) use self::poles::Order;

/// Pixels of a row whose columns are blurred by one piece of work.
const PIXELS: usize = LANES;

/// A blur of images of one shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rational<'a, T> {
    height: usize,
    /// Pixels in a row.
    width: usize,
    channels: usize,
    along_rows: &'a Line<T>,
    along_columns: &'a Line<T>,
}

impl<'a, T: Scalar> Rational<'a, T> {
    /// The blur `[along_rows, along_columns]` of images `[H, W, C]`.
    pub(super) fn new(shape: &[usize], lines: &'a [Line<T>; 2]) -> Self {
        let &[height, width, channels] = shape else { unreachable!("an image has three axes") };
        let [along_rows, along_columns] = lines;
        Self { height, width, channels, along_rows, along_columns }
    }

    /// Writes the blurred image to `out` and, unless it is empty, its derivative with respect to
    /// sigma to `slope`; `columns` is memory.
    pub(super) fn apply(
        &self,
        image: &[T],
        [columns, slopes]: &mut [Vec<T>; 2],
        bench: &Workbench<Block<T>>,
        out: &mut [T],
        slope: &mut [T],
    ) {
        let band = self.rows_per_band() * self.row();
        columns.resize(self.strips() * self.strip(), T::ZERO);
        if slope.is_empty() {
            for_each_piece_mut(columns, self.strip(), |strip, columns| {
                self.columns(image, strip, bench, Task::Blur, [columns, &mut []]);
            });
            return for_each_piece_mut(out, band, |band, out| {
                self.rows([columns, &[]], band, bench, Task::Blur, [out, &mut []]);
            });
        }
        slopes.resize(columns.len(), T::ZERO);
        for_each_two_pieces_mut(columns, slopes, [self.strip(); 2], |strip, columns, slopes| {
            self.columns(image, strip, bench, Task::BlurWithSlopes, [columns, slopes]);
        });
        for_each_two_pieces_mut(out, slope, [band; 2], |band, out, slope| {
            self.rows([columns, slopes], band, bench, Task::BlurBoth, [out, slope]);
        });
    }

    /// Entries in a row of pixels.
    fn row(&self) -> usize {
        self.width * self.channels
    }

    fn strips(&self) -> usize {
        self.width.div_ceil(PIXELS)
    }

    /// Entries of a strip: of each row the same few pixels.
    fn strip(&self) -> usize {
        self.height * PIXELS * self.channels
    }

    fn rows_per_band(&self) -> usize {
        (LANES / self.channels).max(1)
    }

    fn columns(
        &self,
        image: &[T],
        strip: usize,
        bench: &Workbench<Block<T>>,
        task: Task,
        out: [&mut [T]; 2],
    ) {
        bench.with(|block| {
            let work = Columns { blur: self, image, strip, task, block, out };
            crate::dispatch::dispatch::<T, _>(work);
        });
    }

    fn rows(
        &self,
        columns: [&[T]; 2],
        band: usize,
        bench: &Workbench<Block<T>>,
        task: Task,
        out: [&mut [T]; 2],
    ) {
        bench.with(|block| {
            let work = Rows { blur: self, columns, band, task, block, out };
            crate::dispatch::dispatch::<T, _>(work);
        });
    }
}

/// A strip of columns, blurred along them.
struct Columns<'a, 'b, T> {
    blur: &'a Rational<'b, T>,
    image: &'a [T],
    strip: usize,
    task: Task,
    block: &'a mut Block<T>,
    /// The strip, row by row, and its slopes.
    out: [&'a mut [T]; 2],
}

impl<T: Scalar> pulp::WithSimd for Columns<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { blur, image, strip, task, block, out: [out, slopes] } = self;
        let (line, row, width) = (blur.along_columns, blur.row(), PIXELS * blur.channels);
        for offset in (0..width).step_by(LANES) {
            let start = row.min(strip * width + offset);
            let length = LANES.min(row - start);
            if length == 0 {
                break;
            }
            line.start(block, task);
            for (y, lanes) in block.lines.iter_mut().enumerate() {
                lanes.put(&image[y * row + start..][..length]);
            }
            line.solve(block, task);
            for y in 0..blur.height {
                out[y * width + offset..][..LANES].copy_from_slice(&block.lines[y].0);
                if !slopes.is_empty() {
                    let from = &block.slopes[y].0;
                    slopes[y * width + offset..][..LANES].copy_from_slice(from);
                }
            }
        }
    }
}

/// A band of rows, blurred along them.
struct Rows<'a, 'b, T> {
    blur: &'a Rational<'b, T>,
    /// Strips of columns, and their slopes.
    columns: [&'a [T]; 2],
    band: usize,
    task: Task,
    block: &'a mut Block<T>,
    /// The rows, and their slopes.
    out: [&'a mut [T]; 2],
}

impl<T: Scalar> pulp::WithSimd for Rows<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        match self.blur.channels {
            1 => self.work::<1>(),
            3 => self.work::<3>(),
            4 => self.work::<4>(),
            _ => self.work::<0>(),
        }
    }
}

impl<T: Scalar> Rows<'_, '_, T> {
    /// For pixels of `C` channels; 0 stands for any number.
    #[inline(always)]
    fn work<const C: usize>(self) {
        let Self { blur, columns: [columns, slopes], band, task, block, out: [out, slope_out] } =
            self;
        let channels = if C == 0 { blur.channels } else { C };
        let (line, row) = (blur.along_rows, blur.row());
        let (first, rows) = (band * blur.rows_per_band(), out.len() / row);
        // More channels than lanes: the channels of one row are blurred in turns.
        for from in (0..channels).step_by(LANES) {
            let count = if C == 0 { LANES.min(channels - from) } else { C };
            line.start(block, task);
            for strip in 0..blur.strips() {
                let position = strip * PIXELS;
                let pixels = PIXELS.min(blur.width - strip * PIXELS) * channels;
                for r in 0..rows {
                    let to = [from, r * count, count];
                    let range = (strip * blur.height + first + r) * PIXELS * channels;
                    load(&columns[range..][..pixels], channels, to, &mut block.lines[position..]);
                    if task == Task::BlurBoth {
                        let slopes = &slopes[range..][..pixels];
                        load(slopes, channels, to, &mut block.slopes[position..]);
                    }
                }
            }
            let used = rows * count;
            if used < LANES {
                block.lines.iter_mut().for_each(|lanes| lanes.0[used..].fill(T::ZERO));
                block.slopes.iter_mut().for_each(|lanes| lanes.0[used..].fill(T::ZERO));
            }
            line.solve(block, task);
            for strip in 0..blur.strips() {
                let position = strip * PIXELS;
                let start = strip * PIXELS * channels;
                let pixels = row.min(start + PIXELS * channels) - start;
                for r in 0..rows {
                    let from = [from, r * count, count];
                    let out = &mut out[r * row + start..][..pixels];
                    store(&block.lines[position..], out, channels, from);
                    if task == Task::BlurBoth {
                        let out = &mut slope_out[r * row + start..][..pixels];
                        store(&block.slopes[position..], out, channels, from);
                    }
                }
            }
        }
    }
}

/// Copies from each pixel `count` channels from `channel` on to lanes from `lane` on.
#[inline(always)]
fn load<T: Scalar>(
    pixels: &[T],
    channels: usize,
    [channel, lane, count]: [usize; 3],
    line: &mut [Lanes<T>],
) {
    for (pixel, lanes) in pixels.chunks_exact(channels).zip(line) {
        copy(&pixel[channel..channel + count], &mut lanes.0[lane..lane + count]);
    }
}

/// Copies the lanes back to the pixels.
#[inline(always)]
fn store<T: Scalar>(
    line: &[Lanes<T>],
    pixels: &mut [T],
    channels: usize,
    [channel, lane, count]: [usize; 3],
) {
    for (pixel, lanes) in pixels.chunks_exact_mut(channels).zip(line) {
        copy(&lanes.0[lane..lane + count], &mut pixel[channel..channel + count]);
    }
}
