//! Images at half the size, and back.
//!
//! # Forward
//! `H` takes the mean of 2 x 2 pixels, and `D` doubles: along each axis a pixel is 3/4 of the one that it lies
//! in and 1/4 of the nearer neighbour. Together they add 1 to the variance per axis, at every pixel, and half
//! a blur of variance v in between adds 4 v.
//!
//! # Backward
//! `H^T` gives each of the 2 x 2 pixels a quarter. `D^T` takes along each axis 1/4, 3/4, 3/4, 1/4 of four
//! pixels in a row.
//!
//! # Borders
//! The image is extended by its border, so that it can be halved as often as needed, and cut at the end:
//! `crop D .. D K H .. H extend`, with the adjoint `extend^T H^T .. H^T K^T D^T .. D^T crop^T`. What lies beyond
//! a black border, or beyond a clamped one, looks the same at half the size, so few pixels more will do. A
//! mirror has to stand between two pixels at every size: on the right and at the bottom, where the extent is no
//! multiple, the image is continued as far as the blur sees, but no farther than twice its extent.

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_piece_mut;

use super::spans::{enough, extend};
use crate::border::Border;
use crate::copy::copy;
use crate::scratch::Workbench;

/// The function for pixels of so many channels.
macro_rules! for_channels {
    ($function:ident, $channels:expr) => {
        match $channels {
            1 => $function::<T, 1>,
            3 => $function::<T, 3>,
            4 => $function::<T, 4>,
            _ => $function::<T, 0>,
        }
    };
}

/// Entries of one piece of work.
const PIECE: usize = 1 << 14;

/// An axis of an image that is extended.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Axis {
    /// Pixels of the image.
    pub(super) extent: usize,
    /// Pixels before the image, an even number.
    pub(super) before: usize,
    /// Pixels of the extended image, an even number.
    pub(super) length: usize,
    pub(super) border: Border,
}

impl Axis {
    /// An axis that can be halved so many times, under a blur that reaches `reach` pixels.
    pub(super) fn new(extent: usize, border: Border, halvings: usize, reach: usize) -> Self {
        let block = 1 << halvings;
        let [before, after] = match border {
            Border::Mirror if extent.is_multiple_of(block) => [0, 0],
            Border::Mirror => [0, reach.min(extent)],
            // Doubling looks two pixels of the smallest size beyond the image.
            Border::Zero | Border::Clamp => [2 * block, 2 * block],
        };
        let length = (before + extent + after).next_multiple_of(block);
        Self { extent, before, length, border }
    }

    /// An axis of an image that has been extended.
    pub(super) fn whole(length: usize) -> Self {
        Self { extent: length, before: 0, length, border: Border::Clamp }
    }

    /// The pixel at a place of the extended image.
    fn source(&self, place: usize) -> Option<usize> {
        self.border.source(place as isize - self.before as isize, self.extent)
    }

    /// The places of the extended image that lie outside the image.
    fn outside(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.before).chain(self.before + self.extent..self.length)
    }

    /// The place of the first pixel of the extended line, from the image's first one on.
    fn start(&self) -> isize {
        -(self.before as isize)
    }
}

/// An image to be halved, and its half.
#[derive(Debug, Clone, Copy)]
pub(super) struct Halving<'a, T> {
    rows: Axis,
    columns: Axis,
    channels: usize,
    /// Memory for rows.
    bench: &'a Workbench<[Vec<T>; 2]>,
}

impl<'a, T: Scalar> Halving<'a, T> {
    /// Of an image of these rows and columns, with memory for pieces of work.
    pub(super) fn new(
        [rows, columns]: [Axis; 2],
        channels: usize,
        bench: &'a Workbench<[Vec<T>; 2]>,
    ) -> Self {
        Self { rows, columns, channels, bench }
    }

    /// Entries of a row of the image, and of a row of the half.
    fn lengths(&self) -> [usize; 2] {
        [self.columns.extent * self.channels, self.columns.length / 2 * self.channels]
    }

    /// Entries of the half.
    pub(super) fn half_size(&self) -> usize {
        self.rows.length / 2 * self.lengths()[1]
    }

    /// Calls `work(y, row, memory)` for each row of `out`, which has `length` entries a row.
    fn for_each_row(
        &self,
        out: &mut [T],
        length: usize,
        work: impl Fn(usize, &mut [T], &mut [Vec<T>; 2]) + Send + Sync,
    ) {
        let rows = (PIECE / length).max(1);
        for_each_piece_mut(out, rows * length, |piece, out| {
            self.bench.with(|memory| {
                for (k, row) in out.chunks_exact_mut(length).enumerate() {
                    work(piece * rows + k, row, memory);
                }
            });
        });
    }

    /// `half = H extend image`.
    pub(super) fn halve(&self, image: &[T], half: &mut [T]) {
        let ([length, half_length], channels) = (self.lengths(), self.channels);
        let Axis { border, .. } = self.columns;
        let halve_row = for_channels!(halve_row, channels);
        self.for_each_row(half, half_length, |y, out, [sum, line]| {
            let sum = rows_of(sum, length);
            let pair = [2 * y, 2 * y + 1]
                .map(|place| self.rows.source(place).map(|row| &image[row * length..][..length]));
            match pair {
                [Some(a), Some(b)] => {
                    sum.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (&a, &b))| *to = a + b);
                }
                [Some(a), None] | [None, Some(a)] => sum.copy_from_slice(a),
                [None, None] => sum.fill(T::ZERO),
            }
            let line = rows_of(line, 2 * half_length);
            extend(sum, channels, border, self.columns.start(), line);
            halve_row(line, out, channels);
        });
    }

    /// `image = crop D half`.
    pub(super) fn double(&self, half: &[T], image: &mut [T]) {
        let ([length, half_length], channels) = (self.lengths(), self.channels);
        let quarter = T::from_f64(0.25);
        let double_row = for_channels!(double_row, channels);
        self.for_each_row(image, length, |y, out, [mixed, _]| {
            let mixed = rows_of(mixed, half_length);
            let [near, far] = nearest(y + self.rows.before, self.rows.length / 2)
                .map(|row| &half[row * half_length..][..half_length]);
            for i in 0..half_length {
                mixed[i] = near[i] + quarter * (far[i] - near[i]);
            }
            double_row(mixed, out, self.columns.before, channels);
        });
    }

    /// `half = D^T crop^T image`.
    pub(super) fn double_adjoint(&self, image: &[T], half: &mut [T]) {
        let ([length, half_length], channels) = (self.lengths(), self.channels);
        let [one, three] = [0.25, 0.75].map(T::from_f64);
        let double_row_adjoint = for_channels!(double_row_adjoint, channels);
        self.for_each_row(half, half_length, |y, out, [sum, line]| {
            let sum = rows_of(sum, length);
            sum.fill(T::ZERO);
            for (place, share) in
                four_around(y, self.rows.length).into_iter().zip([one, three, three, one])
            {
                let row = place.checked_sub(self.rows.before).filter(|&y| y < self.rows.extent);
                let Some(row) = row else { continue };
                let from = &image[row * length..][..length];
                sum.iter_mut().zip(from).for_each(|(to, &from)| *to += share * from);
            }
            let line = rows_of(line, 2 * half_length);
            line.fill(T::ZERO);
            line[self.columns.before * channels..][..length].copy_from_slice(sum);
            double_row_adjoint(line, out, channels);
        });
    }

    /// `image = extend^T H^T half`.
    pub(super) fn halve_adjoint(&self, half: &[T], image: &mut [T]) {
        let ([length, half_length], channels) = (self.lengths(), self.channels);
        let quarter = T::from_f64(0.25);
        self.for_each_row(image, length, |y, out, [sum, _]| {
            let sum = rows_of(sum, half_length);
            let row_at = |place: usize| &half[place / 2 * half_length..][..half_length];
            let own = row_at(y + self.rows.before);
            sum.iter_mut().zip(own).for_each(|(to, &from)| *to = quarter * from);
            for place in self.rows.outside().filter(|&place| self.rows.source(place) == Some(y)) {
                let from = row_at(place);
                sum.iter_mut().zip(from).for_each(|(to, &from)| *to += quarter * from);
            }
            for (x, out) in out.chunks_exact_mut(channels).enumerate() {
                copy(&sum[(x + self.columns.before) / 2 * channels..][..channels], out);
            }
            for place in self.columns.outside() {
                let Some(x) = self.columns.source(place) else { continue };
                let from = &sum[place / 2 * channels..][..channels];
                let to = &mut out[x * channels..][..channels];
                to.iter_mut().zip(from).for_each(|(to, &from)| *to += from);
            }
        });
    }
}

/// Pixels of the half row from pairs of the extended row; `C` channels, or any number where it is 0.
fn halve_row<T: Scalar, const C: usize>(line: &[T], out: &mut [T], channels: usize) {
    let channels = if C == 0 { channels } else { C };
    let quarter = T::from_f64(0.25);
    for (out, pair) in out.chunks_exact_mut(channels).zip(line.chunks_exact(2 * channels)) {
        let (a, b) = pair.split_at(channels);
        for c in 0..channels {
            out[c] = quarter * (a[c] + b[c]);
        }
    }
}

/// Pixels of a row from the half row; the first has `before` others before it.
fn double_row<T: Scalar, const C: usize>(
    half: &[T],
    out: &mut [T],
    before: usize,
    channels: usize,
) {
    let channels = if C == 0 { channels } else { C };
    let (halves, quarter) = (half.len() / channels, T::from_f64(0.25));
    for (x, out) in out.chunks_exact_mut(channels).enumerate() {
        let [near, far] = nearest(x + before, halves).map(|x| &half[x * channels..][..channels]);
        for c in 0..channels {
            out[c] = near[c] + quarter * (far[c] - near[c]);
        }
    }
}

/// Pixels of the half row's gradient from the extended row's.
fn double_row_adjoint<T: Scalar, const C: usize>(line: &[T], out: &mut [T], channels: usize) {
    let channels = if C == 0 { channels } else { C };
    let (length, [one, three]) = (line.len() / channels, [0.25, 0.75].map(T::from_f64));
    for (x, out) in out.chunks_exact_mut(channels).enumerate() {
        let [a, b, c, d] = four_around(x, length).map(|x| &line[x * channels..][..channels]);
        for k in 0..channels {
            out[k] = three * (b[k] + c[k]) + one * (a[k] + d[k]);
        }
    }
}

/// Of a pixel of the extended image the pixel of the half that it lies in, and its nearer neighbour.
#[inline(always)]
fn nearest(place: usize, halves: usize) -> [usize; 2] {
    let near = place / 2;
    let far =
        if place.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(halves - 1) };
    [near, far]
}

/// The pixels of the extended image that a pixel of the half goes into.
#[inline(always)]
fn four_around(half: usize, length: usize) -> [usize; 4] {
    let first = 2 * half;
    // At the ends a pixel is its own neighbour.
    [first.saturating_sub(1), first, first + 1, (first + 2).min(length - 1)]
}

/// The first `length` entries of `memory`.
fn rows_of<T: Scalar>(memory: &mut Vec<T>, length: usize) -> &mut [T] {
    enough(memory, length);
    &mut memory[..length]
}
