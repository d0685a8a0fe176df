//! An image of half the size: means of blocks of 2 x 2 pixels.
//!
//! # Forward
//! `y_ij = mean of x_pq over p in {2 i, 2 i + 1}, q in {2 j, 2 j + 1}` within the image; blocks at odd
//! ends are smaller.
//!
//! # Backward
//! `x_bar_pq += y_bar_ij / n_ij` with the number n of the block's pixels.

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, TensorError, Var};

/// Input: an image `[H, W, C]`.
struct Halved;

/// `1 / n` by the rows and columns of a block.
#[inline(always)]
fn share<S: Scalar>(rows: usize, columns: usize) -> S {
    S::from_f64([1.0, 0.5, 0.25][(rows - 1) + (columns - 1)])
}

impl<T: Scalar> Op<T> for Halved {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "halved"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let shape = inputs.shape(0);
        let &[height, width, channels] = &**shape else {
            let (operation, rule) = ("halved", "an image of shape [H, W, C]".into());
            return Err(TensorError::Shape { operation, rule, shape: shape.clone() });
        };
        if height.max(width) <= 1 {
            outputs.pass(0, "there is nothing to halve");
            return Ok(());
        }
        let x = inputs.data(0);
        let row = width * channels;
        let y_row = width.div_ceil(2) * channels;
        let y = outputs.push([height.div_ceil(2), width.div_ceil(2), channels]);
        let per_piece = (ENTRIES_PER_PIECE / row.max(1)).max(1);
        for_each_piece_mut(y, per_piece * y_row.max(1), |piece, y| {
            for (i, y) in y.chunks_mut(y_row).enumerate() {
                let p = 2 * (piece * per_piece + i);
                let rows = (height - p).min(2);
                for (j, y) in y.chunks_mut(channels).enumerate() {
                    let columns = (width - 2 * j).min(2);
                    let share = share::<T::Wide>(rows, columns);
                    for (c, y) in y.iter_mut().enumerate() {
                        let mut sum = T::Wide::ZERO;
                        for r in 0..rows {
                            let first = (p + r) * row + 2 * j * channels + c;
                            (0..columns).for_each(|s| sum += x[first + s * channels].widen());
                        }
                        *y = T::narrow(share * sum);
                    }
                }
            }
        });
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (shape, y_bar) = (kept.input_shape(0), kept.only_upstream());
        let [height, width, channels] = [shape[0], shape[1], shape[2]];
        let (row, y_row) = (width * channels, width.div_ceil(2) * channels);
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let per_piece = (ENTRIES_PER_PIECE / row.max(1)).max(1);
        for_each_piece_mut(x_bar, per_piece * row.max(1), |piece, x_bar| {
            for (p, x_bar) in x_bar.chunks_mut(row).enumerate() {
                let p = piece * per_piece + p;
                let rows = (height - p / 2 * 2).min(2);
                for (q, x_bar) in x_bar.chunks_mut(channels).enumerate() {
                    let share = share::<T>(rows, (width - q / 2 * 2).min(2));
                    let y_bar = &y_bar[p / 2 * y_row + q / 2 * channels..][..channels];
                    for (x_bar, &y_bar) in x_bar.iter_mut().zip(y_bar) {
                        let term = share * y_bar;
                        *x_bar = if fresh { term } else { *x_bar + term };
                    }
                }
            }
        });
    }
}

/// Halves the size of `image: [H, W, C]` to `[ceil(H / 2), ceil(W / 2), C]`. Each pixel is the mean of two by
/// two pixels, or of fewer at an odd end.
///
/// # Errors
/// [`TensorError::Shape`] unless the image is `[H, W, C]`.
#[inline(never)]
pub fn halved<T: Scalar>(image: Var<'_, T>) -> Result<Var<'_, T>, TensorError> {
    image.tape().apply(Halved, &[image])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    #[test]
    fn pixels_are_means_of_two_by_two_and_of_fewer_at_odd_ends() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::from_flat_fn([3, 5, 1], |k| k as f64));
        let y = halved(x).unwrap();
        //  0  1 |  2  3 |  4
        //  5  6 |  7  8 |  9
        // 10 11 | 12 13 | 14
        let expected = Tensor::new([2, 3, 1], vec![3.0, 5.0, 6.5, 10.5, 12.5, 14.0]).unwrap();
        assert_eq!(y.value(), expected);
        let upstream = Tensor::from_flat_fn([2, 3, 1], |k| 4.0 * (k + 1) as f64);
        let found = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
        let expected =
            [[1.0, 1.0, 2.0, 2.0, 6.0], [1.0, 1.0, 2.0, 2.0, 6.0], [8.0, 8.0, 10.0, 10.0, 24.0]];
        assert_eq!(found.data(), expected.concat());
    }

    #[test]
    fn halves_of_a_large_image_keep_its_mean_in_every_channel() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::from_flat_fn([128, 200, 3], |k| (k % 257) as f64));
        let mut y = x;
        for _ in 0..3 {
            y = halved(y).unwrap();
        }
        assert_eq!(*y.shape(), [16, 25, 3]);
        let means = [x, y].map(|image| {
            let rows = image.shape()[0] * image.shape()[1];
            image.reshape([rows, 3]).unwrap().mean_axis(0).unwrap().value()
        });
        for c in 0..3 {
            approx::assert_relative_eq!(means[0][[c]], means[1][[c]], max_relative = 1e-13);
        }
    }

    #[test]
    fn a_pixel_is_itself_and_no_pixel_is_none() {
        let tape = Tape::<f32>::new();
        let pixel = tape.leaf(&Tensor::full([1, 1, 4], 2.0));
        assert_eq!((halved(pixel).unwrap().value(), tape.len()), (pixel.value(), 1));
        for (shape, half) in
            [([0, 5, 1], [0, 3, 1]), ([4, 0, 2], [2, 0, 2]), ([6, 3, 0], [3, 2, 0])]
        {
            let x = tape.leaf(&Tensor::zeros(shape));
            let y = halved(x).unwrap();
            assert_eq!(*y.shape(), half);
            assert_eq!(y.sum().backward().unwrap().get_or_zeros(x), x.value());
        }
    }
}
