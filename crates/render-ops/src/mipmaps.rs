//! A level of a texture from the next finer level.
//!
//! # Forward
//! Along each axis n texels become `m = max(1, floor(n / 2))`. Where n is even, a texel is the mean of
//! two. Where `n = 2 m + 1`, texel j is the mean of texels `2 j`, `2 j + 1` and `2 j + 2` with the
//! weights `a`, `b` and `c`: `b = m / n`, `a + c = 1 - b`, `c - a = (j + 1/2) / m - 1/2`. So their
//! centroid is the middle of texel j, `(j + 1/2) n / m`, and a texture that is linear in the coordinates
//! stays so. A single texel stays as it is.
//!
//! # Backward
//! Each texel gets the gradients of the texels that it is part of, times its weights in them. It is
//! linear.
//!
//! # Source
//! Guthe and Heckbert, *Non-power-of-two mipmapping*, 2005, where the three texels have the weights of
//! the parts that a box covers: there a linear texture bends.

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;

/// The next coarser level of `level: [.., H, W, C]`, which was checked: `[.., h, w, C]`. Both axes
/// are halved; those before them stay.
pub(crate) fn halved<'t, T: Scalar>(level: Var<'t, T>) -> Result<Var<'t, T>, RenderError> {
    level.tape().apply(Halve, &[level])
}

/// The extent of an axis on the next level.
pub(crate) fn half(extent: usize) -> usize {
    (extent / 2).max(1)
}

struct Halve;

/// The texels of the finer level that texel `j` of the coarser level is made of: the first, and the
/// weights of it and of those that follow.
#[inline(always)]
fn taps<T: Scalar>(j: usize, extent: usize) -> (usize, [T; 3], usize) {
    let coarse = half(extent);
    if extent == 1 {
        return (0, [T::ONE, T::ZERO, T::ZERO], 1);
    }
    if extent.is_multiple_of(2) {
        return (2 * j, [T::from_f64(0.5), T::from_f64(0.5), T::ZERO], 2);
    }
    let middle = coarse as f64 / extent as f64;
    let lean = (j as f64 + 0.5) / coarse as f64 - 0.5;
    let side = 0.5 * (1.0 - middle);
    (2 * j, [side - 0.5 * lean, middle, side + 0.5 * lean].map(T::from_f64), 3)
}

/// Height, width and channels of the last three axes.
fn extents(shape: &[usize]) -> [usize; 3] {
    *shape.last_chunk().expect("a level has three axes and more")
}

/// Texels in one piece of work.
const TEXELS_PER_PIECE: usize = ENTRIES_PER_PIECE / 4;

impl<T: Scalar> Op<T> for Halve {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "mipmaps"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let (fine, shape) = (inputs.data(0), inputs.shape(0));
        let [height, width, channels] = extents(shape);
        let (rows, columns) = (half(height), half(width));
        let mut axes = shape.to_vec();
        let rank = axes.len();
        (axes[rank - 3], axes[rank - 2]) = (rows, columns);
        let coarse = outputs.push(&axes);
        match channels {
            1 => halve::<T, 1>(fine, [height, width, 1], coarse),
            3 => halve::<T, 3>(fine, [height, width, 3], coarse),
            4 => halve::<T, 4>(fine, [height, width, 4], coarse),
            _ => halve::<T, 1>(fine, [height, width, channels], coarse),
        }
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(fine_bar) = gradients.get(0) else { return };
        let [height, width, channels] = extents(kept.input_shape(0));
        let coarse_bar = kept.only_upstream();
        let fine_bar = fine_bar.entries_or_fresh();
        match channels {
            1 => spread::<T, 1>(coarse_bar, [height, width, 1], fine_bar),
            3 => spread::<T, 3>(coarse_bar, [height, width, 3], fine_bar),
            4 => spread::<T, 4>(coarse_bar, [height, width, 4], fine_bar),
            _ => spread::<T, 1>(coarse_bar, [height, width, channels], fine_bar),
        }
    }
}

/// Writes a coarser level, in groups of `N` channels, where a texel has one or several groups.
fn halve<T: Scalar, const N: usize>(
    fine: &[T],
    [height, width, channels]: [usize; 3],
    coarse: &mut [T],
) {
    let (rows, columns) = (half(height), half(width));
    let length = columns * channels;
    let rows_per_piece = (TEXELS_PER_PIECE / columns).max(1);
    for_each_piece_mut(coarse, rows_per_piece * length, |piece, coarse| {
        crate::dispatch::dispatch::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let coarse = coarse;
                let lines = (piece * rows_per_piece..).zip(coarse.chunks_exact_mut(length));
                for (line, coarse) in lines {
                    let (face, row) = (line / rows, line % rows);
                    let (first, weights, count) = taps::<T>(row, height);
                    let line_of = |k: usize| {
                        &fine[(face * height + first + k) * width * channels..][..width * channels]
                    };
                    let fine = [line_of(0), line_of(1.min(count - 1)), line_of(count - 1)];
                    if count == 2 && width % 2 == 0 && channels == N {
                        halve_even_rows::<T, N>(fine, coarse);
                    } else {
                        halve_rows(fine, &weights[..count], channels, coarse);
                    }
                }
            },
        );
    });
}

/// A coarser row from two finer rows of even length.
#[inline(always)]
fn halve_even_rows<T: Scalar, const N: usize>([upper, lower, _]: [&[T]; 3], coarse: &mut [T]) {
    let quarter = T::from_f64(0.25);
    let fine = upper.chunks_exact(2 * N).zip(lower.chunks_exact(2 * N));
    for (coarse, (upper, lower)) in coarse.as_chunks_mut::<N>().0.iter_mut().zip(fine) {
        for c in 0..N {
            coarse[c] = quarter * ((upper[c] + upper[N + c]) + (lower[c] + lower[N + c]));
        }
    }
}

/// A coarser row from up to three finer rows.
#[inline(always)]
fn halve_rows<T: Scalar>(fine: [&[T]; 3], weights: &[T], channels: usize, coarse: &mut [T]) {
    let width = fine[0].len() / channels;
    for (j, coarse) in coarse.chunks_exact_mut(channels).enumerate() {
        let (first, along, taken) = taps::<T>(j, width);
        for (c, coarse) in coarse.iter_mut().enumerate() {
            let mut sum = T::ZERO;
            for (row, &weight) in fine.iter().zip(weights) {
                for (k, &along) in along[..taken].iter().enumerate() {
                    sum += weight * along * row[(first + k) * channels + c];
                }
            }
            *coarse = sum;
        }
    }
}

/// Adds the gradients of a coarser level to those of a finer level; where they are fresh, writes them.
fn spread<T: Scalar, const N: usize>(
    coarse_bar: &[T],
    [height, width, channels]: [usize; 3],
    (fine_bar, is_fresh): (&mut [T], bool),
) {
    let (rows, columns) = (half(height), half(width));
    let length = width * channels;
    let rows_per_piece = (TEXELS_PER_PIECE / width).max(1);
    for_each_piece_mut(fine_bar, rows_per_piece * length, |piece, fine_bar| {
        crate::dispatch::dispatch::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let fine_bar = fine_bar;
                if is_fresh {
                    fine_bar.fill(T::ZERO);
                }
                let lines = (piece * rows_per_piece..).zip(fine_bar.chunks_exact_mut(length));
                for (line, fine_bar) in lines {
                    let (face, row) = (line / height, line % height);
                    // The coarser rows that this row is part of.
                    for coarse in (row / 2).saturating_sub(1)..=(row / 2).min(rows - 1) {
                        let (first, weights, count) = taps::<T>(coarse, height);
                        let Some(&weight) =
                            row.checked_sub(first).and_then(|k| weights[..count].get(k))
                        else {
                            continue;
                        };
                        let bars = &coarse_bar[(face * rows + coarse) * columns * channels..]
                            [..columns * channels];
                        if width % 2 == 0 && channels == N {
                            spread_even_row::<T, N>(bars, weight, fine_bar);
                        } else {
                            spread_row(bars, weight, channels, fine_bar);
                        }
                    }
                }
            },
        );
    });
}

/// Adds the shares of a finer row of even length in a coarser row's gradients.
#[inline(always)]
fn spread_even_row<T: Scalar, const N: usize>(bars: &[T], weight: T, fine_bar: &mut [T]) {
    let share = weight * T::from_f64(0.5);
    for (fine_bar, bars) in fine_bar.chunks_exact_mut(2 * N).zip(bars.as_chunks::<N>().0) {
        for c in 0..N {
            fine_bar[c] += share * bars[c];
            fine_bar[N + c] += share * bars[c];
        }
    }
}

/// Adds the shares of a finer row in a coarser row's gradients.
#[inline(always)]
fn spread_row<T: Scalar>(bars: &[T], weight: T, channels: usize, fine_bar: &mut [T]) {
    let width = fine_bar.len() / channels;
    for (j, bars) in bars.chunks_exact(channels).enumerate() {
        let (first, along, taken) = taps::<T>(j, width);
        let fine_bar = fine_bar[first * channels..].chunks_exact_mut(channels);
        for (&along, fine_bar) in along[..taken].iter().zip(fine_bar) {
            let share = weight * along;
            fine_bar.iter_mut().zip(bars).for_each(|(fine_bar, &bar)| *fine_bar += share * bar);
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    #[test]
    fn a_texture_that_is_linear_in_the_coordinates_stays_so_at_any_size() {
        let tape = Tape::<f64>::new();
        for [height, width] in [[8, 16], [7, 5], [3, 12], [1, 9], [13, 1], [11, 2], [1, 1]] {
            let linear = |[height, width]: [usize; 2]| {
                Tensor::from_fn([height, width, 2], |[i, j, c]| {
                    let (u, v) = (i as f64 + 0.5, j as f64 + 0.5);
                    1.5 + [0.3, -2.0][c] * u / height as f64 + [1.0, 0.7][c] * v / width as f64
                })
            };
            let (mut level, mut size) = (tape.leaf(&linear([height, width])), [height, width]);
            while size != [1, 1] {
                level = halved(level).unwrap();
                size = size.map(half);
                let expected = linear(size);
                assert_eq!(level.shape(), *expected.shape());
                for (found, expected) in level.value().data().iter().zip(expected.data()) {
                    approx::assert_relative_eq!(*found, expected, epsilon = 1e-14);
                }
            }
        }
    }

    #[test]
    fn even_extents_are_means_of_four() {
        let tape = Tape::<f32>::new();
        let fine = tape.leaf(&Tensor::from_flat_fn([2, 4, 1], |k| k as f32));
        assert_eq!(halved(fine).unwrap().value().data(), [2.5, 4.5]);
    }

    #[test]
    fn backward_is_the_adjoint_and_faces_stay_apart() {
        let tape = Tape::<f64>::new();
        let numbers =
            |shape: &[usize], by: f64| Tensor::from_flat_fn(shape, |k| (by * k as f64).sin());
        let shapes: [&[usize]; 6] =
            [&[8, 6, 3], &[7, 5, 2], &[1, 9, 1], &[6, 5, 5, 2], &[140, 131, 1], &[6, 1, 1, 4]];
        for shape in shapes {
            let fine = tape.leaf(&numbers(shape, 1.1));
            let coarse = halved(fine).unwrap();
            let upstream = numbers(&coarse.shape(), 0.7);
            let bars = tape.vjp(&[(coarse, &upstream)]).unwrap().get_or_zeros(fine);
            let dot = |a: &Tensor<f64>, b: &Tensor<f64>| -> f64 {
                a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
            };
            let (there, back) = (dot(&coarse.value(), &upstream), dot(&fine.value(), &bars));
            approx::assert_relative_eq!(there, back, epsilon = 1e-11);
            // A face alone.
            if let &[faces, height, width, channels] = shape {
                let size = height * width * channels;
                for face in 0..faces {
                    let face_texels = fine.value().data()[face * size..][..size].to_vec();
                    let face_texels =
                        tape.leaf(&Tensor::new([height, width, channels], face_texels).unwrap());
                    let alone = halved(face_texels).unwrap().value();
                    let count = alone.size();
                    assert_eq!(alone.data(), &coarse.value().data()[face * count..][..count]);
                }
            }
        }
    }
}
