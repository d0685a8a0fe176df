//! A loss on an image and on its halves: `sum_j L(x_j, r_j)` with both images halved j times.
//!
//! At coarse levels, images that are many pixels apart overlap, and so have a gradient.

use bokashi_core::{Scalar, TensorError, Var};

use super::halved::halved;

/// The sum of `loss` of `image` and `reference`, `[H, W, C]`, over `levels` levels. The first level has the images
/// themselves. Each further level is [`halved`](crate::halved) once more.
///
/// ```
/// # use bokashi_core::{Tape, Tensor, TensorError};
/// use bokashi_fit::{Penalty, mean_error, pyramid_error};
///
/// let tape = Tape::<f64>::new();
/// let image = tape.leaf(&Tensor::from_fn([64, 64, 3], |[i, j, _]| (i * j % 7) as f64));
/// let reference = tape.constant_full([64, 64, 3], 3.0);
/// let loss = pyramid_error(image, reference, 4, |image, reference| {
///     mean_error(image, reference, Penalty::Absolute)
/// })?;
/// # loss.backward()?;
/// # Ok::<(), TensorError>(())
/// ```
///
/// # Errors
/// Those of `loss`; [`TensorError::Value`] for no level, or one more than an image of a single pixel;
/// [`TensorError::Shape`] unless the images are `[H, W, C]`.
pub fn pyramid_error<'t, T: Scalar, E: From<TensorError>>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    levels: usize,
    mut loss: impl FnMut(Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, E>,
) -> Result<Var<'t, T>, E> {
    let operation = "pyramid_error";
    let most = match *image.shape() {
        [height, width, _] => {
            let extent = height.max(width).max(1);
            extent.next_power_of_two().trailing_zeros() as usize + 1
        }
        _ => {
            let rule = "images of shape [H, W, C]".into();
            return Err(TensorError::Shape { operation, rule, shape: image.shape() }.into());
        }
    };
    if !(1..=most).contains(&levels) {
        let (rule, value) = (format!("from 1 to {most} levels").into(), levels as f64);
        return Err(TensorError::Value { operation, rule, value }.into());
    }
    let mut total = loss(image, reference)?;
    let (mut image, mut reference) = (image, reference);
    for _ in 1..levels {
        (image, reference) = (halved(image)?, halved(reference)?);
        total = total.try_add(loss(image, reference)?)?;
    }
    Ok(total)
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor, squared_error};

    use super::*;

    #[test]
    fn a_pyramid_sums_the_loss_over_the_halves() {
        let tape = Tape::<f64>::new();
        let image = tape.leaf(&Tensor::from_flat_fn([4, 4, 1], |k| k as f64));
        let zero = tape.constant(&Tensor::zeros([4, 4, 1]));
        // 0 to 15; means 2.5, 4.5, 10.5, 12.5; their mean 7.5.
        let levels = [1240.0, 6.25 + 20.25 + 110.25 + 156.25, 56.25];
        let mut total = 0.0;
        for (k, level) in levels.into_iter().enumerate() {
            total += level;
            let found = pyramid_error(image, zero, k + 1, squared_error).unwrap();
            assert_eq!(found.item(), total);
        }
        for levels in [0, 4] {
            let error = pyramid_error(image, zero, levels, squared_error).unwrap_err();
            let message = format!("pyramid_error needs from 1 to 3 levels, got {levels}");
            assert_eq!(error.to_string(), message);
        }
        let flat = tape.leaf(&Tensor::zeros([4, 4]));
        let error = pyramid_error(flat, flat, 1, squared_error).unwrap_err().to_string();
        assert_eq!(error, "pyramid_error needs images of shape [H, W, C], got shape [4, 4]");
    }
}
