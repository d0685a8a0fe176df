//! Layers: the pixels of a picture that can differ from its background.
//!
//! Most of a picture is often background, and most losses are sums over pixels. A layer holds the
//! values of the covered pixels, and those of its *rim*: once it is antialiased the uncovered pixels
//! beside a silhouette, with exact coverage the boundary pixels. What is computed on a layer costs
//! nothing elsewhere.

use std::sync::Arc;

use bokashi_core::{Scalar, Var};

use crate::background::Background;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::mix::mix;

/// The pixels of a picture that can differ from its background, with the background.
///
/// The fields can be exchanged: the values for others of as many rows and any number of channels,
/// operations refuse all else; the background before antialiasing, since the rim's values hold the
/// one that was there.
#[derive(Debug, Clone)]
pub struct Layer<'t, T: Scalar> {
    /// The values of the fragments at pixel centres, in their order, and then of the rim. Shape `[P, C]`,
    /// differentiable.
    pub values: Var<'t, T>,
    /// What is seen elsewhere.
    pub background: Background<'t, T>,
    pub(crate) coverage: Arc<Coverage>,
    /// The pixels of the rim, in order, where there are any.
    pub(crate) rim: Option<Arc<Vec<u32>>>,
    /// A layer without silhouettes has no rim afterwards either.
    pub(crate) is_antialiased: bool,
}

/// The layer of fragment values `[N, C]` before a background.
///
/// # Errors
/// [`RenderError::Shape`] unless the values are `[N, C]`, C > 0, with N the number of fragments, and
/// for fragments that are not whole. `TensorError::ForeignVariable` for variables of several tapes.
pub fn layer<'t, T: Scalar>(
    values: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    background: Background<'t, T>,
) -> Result<Layer<'t, T>, RenderError> {
    Layer::of("layer", values, fragments, background)
}

impl<'t, T: Scalar> Layer<'t, T> {
    /// [`layer`], as a part of `operation`.
    pub(crate) fn of(
        operation: &'static str,
        values: Var<'t, T>,
        fragments: &Fragments<'t, T>,
        background: Background<'t, T>,
    ) -> Result<Self, RenderError> {
        let coverage = fragments.checked_coverage(operation, values.tape())?;
        checked_channels(operation, values, coverage.count())?;
        let (mut values, mut rim) = (values, None);
        if let Some(weight) = fragments.weight {
            values = mix(values, weight, &coverage, background, operation)?;
            rim = Some(Arc::clone(&coverage.boundary.pixels));
        }
        Ok(Self { values, background, coverage, rim, is_antialiased: false })
    }

    /// C, where the values have a row for each fragment and each pixel of the rim.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the values are `[P, C]`, C > 0, with P the number of fragments
    /// at pixel centres and of pixels of the rim.
    pub(crate) fn checked_channels(&self, operation: &'static str) -> Result<usize, RenderError> {
        checked_channels(operation, self.values, self.coverage.centers() + self.rim().len())
    }

    /// The pixels of the rim, in order.
    pub(crate) fn rim(&self) -> &[u32] {
        self.rim.as_deref().map_or(&[], Vec::as_slice)
    }
}

/// C of values `[rows, C]`, C > 0.
fn checked_channels<T: Scalar>(
    operation: &'static str,
    values: Var<'_, T>,
    rows: usize,
) -> Result<usize, RenderError> {
    match *values.shape() {
        [given, channels] if given == rows && channels > 0 => Ok(channels),
        _ => {
            let rule = format!("values of shape [{rows}, C], C > 0");
            Err(RenderError::Shape { operation, rule, shape: values.shape() })
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::antialias::antialias;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::resolve::resolve;
    use crate::size::Size;
    use crate::target::Target;

    const SIZE: Size = Size { width: 24, height: 17 };

    /// Two faces, one in front of the other, both with silhouettes.
    fn fragments<T: Scalar>(tape: &Tape<T>) -> Fragments<'_, T> {
        let clip = [
            [-0.9, -0.8, 0.2, 1.0],
            [0.7, -0.6, 0.3, 1.1],
            [-0.1, 0.9, 0.1, 0.9],
            [0.9, 0.7, 0.0, 1.2],
            [-0.3, 0.1, -0.2, 1.0],
            [0.2, -0.7, 0.1, 1.0],
        ];
        let clip = tape.leaf(&Tensor::from_flat_fn([6, 4], |k| T::from_f64(clip[k / 4][k % 4])));
        rasterize(clip, &Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap(), SIZE).unwrap()
    }

    /// One value per pixel, and a face that covers all of them: no silhouette is in sight.
    fn filled<T: Scalar>(tape: &Tape<T>) -> (Var<'_, T>, Fragments<'_, T>) {
        let clip = [[-1.0, -1.0, 0.0, 1.0], [3.0, -1.0, 0.0, 1.0], [-1.0, 3.0, 0.0, 1.0]];
        let clip = tape.leaf(&Tensor::from_flat_fn([3, 4], |k| T::from_f64(clip[k / 4][k % 4])));
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        (leaf(tape, [SIZE.pixels(), 1]), rasterize(clip, &mesh, SIZE).unwrap())
    }

    fn leaf<'t, T: Scalar, const N: usize>(tape: &'t Tape<T>, axes: [usize; N]) -> Var<'t, T> {
        tape.leaf(&Tensor::from_flat_fn(axes, |k| T::from_f64((k * 37 % 101) as f64 / 101.0)))
    }

    fn backgrounds<T: Scalar>(tape: &Tape<T>) -> [Background<'_, T>; 3] {
        let color = leaf(tape, [2]);
        let image = leaf(tape, [SIZE.height, SIZE.width, 2]);
        [Background::Zero, Background::Color(color), Background::Image(image)]
    }

    #[test]
    fn an_antialiased_layer_makes_the_antialiased_image() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape);
        let clip = fragments.clip;
        let values = leaf(&tape, [fragments.coverage.count(), 2]);
        let image_bar =
            Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k % 7) as f64 - 2.5);
        for background in backgrounds(&tape) {
            let whole = resolve(values, &fragments, background).unwrap();
            let whole = antialias(whole, &fragments, clip).unwrap();
            let layer = layer(values, &fragments, background).unwrap().antialias(clip).unwrap();
            assert!(layer.values.shape()[0] > fragments.coverage.count());
            let image = layer.image().unwrap();
            assert_eq!(image.value(), whole.value());
            let [found, expected] =
                [image, whole].map(|image| tape.vjp(&[(image, &image_bar)]).unwrap());
            for variable in [Some(values), Some(clip), background.variable()].into_iter().flatten()
            {
                let found = found.get_or_zeros(variable);
                let expected = expected.get_or_zeros(variable);
                for (&found, &expected) in found.data().iter().zip(expected.data()) {
                    approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
                }
            }
        }
    }

    #[test]
    fn the_squared_error_is_that_of_the_image_whatever_the_background() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape);
        let values = leaf(&tape, [fragments.coverage.count(), 2]);
        let goal =
            Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k * 13 % 29) as f64 / 29.0);
        let constant = Tensor::new([2], vec![0.25, 0.75]).unwrap();
        let zero = Tensor::zeros([2]);
        let own = Background::Color(tape.constant(&constant));
        let learnt = Background::Color(tape.leaf(&constant));
        for (background, color) in backgrounds(&tape)
            .map(|background| (background, &zero))
            .into_iter()
            .chain([own, learnt, Background::Zero].map(|background| (background, &constant)))
            .chain([(own, &zero)])
        {
            let target = Target::new(&goal, color).unwrap();
            let layer = layer(values, &fragments, background).unwrap();
            let layer = layer.antialias(fragments.clip).unwrap();
            let found = layer.squared_error(&target).unwrap();
            let difference = layer.image().unwrap() - tape.constant(&goal);
            let expected = difference.square().sum();
            approx::assert_relative_eq!(found.item(), expected.item(), max_relative = 1e-13);
            let [found, expected] = [found, expected].map(|loss| loss.backward().unwrap());
            let variables = [Some(values), Some(fragments.clip), background.variable()];
            for variable in variables.into_iter().flatten() {
                let found = found.get_or_zeros(variable);
                let expected = expected.get_or_zeros(variable);
                for (&found, &expected) in found.data().iter().zip(expected.data()) {
                    approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
                }
            }
        }
    }

    #[test]
    fn without_silhouettes_antialiasing_leaves_the_layer_itself() {
        let tape = Tape::<f32>::new();
        let (values, fragments) = filled(&tape);
        let whole = layer(values, &fragments, Background::Zero).unwrap();
        let same = whole.clone().antialias(fragments.clip).unwrap();
        assert_eq!(same.values.value(), values.value());
        let report = tape.take_report();
        assert!(report.left_out.iter().any(|entry| entry.name == "antialias"));
        assert_eq!(same.image().unwrap().value(), whole.image().unwrap().value());
    }

    #[test]
    fn without_silhouettes_too_a_layer_is_antialiased_once() {
        let tape = Tape::<f64>::new();
        let (values, fragments) = filled(&tape);
        let whole = layer(values, &fragments, Background::Zero).unwrap();
        let smooth = whole.antialias(fragments.clip).unwrap();
        let error = smooth.antialias(fragments.clip).unwrap_err().to_string();
        let rule = "antialias needs a layer that was not antialiased before";
        assert_eq!(error, format!("{rule}, got one with a rim of 0 pixels"));
    }

    #[test]
    fn a_layer_says_its_own_name() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape);
        let count = fragments.coverage.count();
        let wrong = leaf(&tape, [count + 1, 2]);
        let short = Fragments { barycentrics: wrong, ..fragments.clone() };
        let rule = format!("layer needs values of shape [{count}, C], C > 0, got shape");
        let error = layer(wrong, &fragments, Background::Zero).unwrap_err().to_string();
        assert_eq!(error, format!("{rule} [{}, 2]", count + 1));
        let error = layer(wrong, &short, Background::Zero).unwrap_err().to_string();
        assert!(error.starts_with("layer needs barycentrics of shape"), "{error}");
    }

    #[test]
    fn values_exchanged_for_others_of_another_shape_are_refused_by_every_operation() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape);
        let (clip, count) = (fragments.clip, fragments.coverage.count());
        let values = leaf(&tape, [count, 2]);
        let goal = Tensor::zeros([SIZE.height, SIZE.width, 2]);
        // One for which no image is made, and one for which it is.
        let targets =
            [0.0, 0.5].map(|entry| Target::new(&goal, &Tensor::full([2], entry)).unwrap());
        let plain = layer(values, &fragments, Background::Zero).unwrap();
        let smooth = plain.clone().antialias(clip).unwrap();
        let rows = smooth.values.shape()[0];
        assert!(rows > count);
        for (whole, rows, other_rows) in [(plain, count, rows), (smooth, rows, count)] {
            let shapes: [&[usize]; 6] = [
                &[other_rows, 2],
                &[rows - 1, 2],
                &[rows + 1, 2],
                &[rows, 0],
                &[2 * rows],
                &[rows, 2, 1],
            ];
            for shape in shapes {
                let values = tape.leaf(&Tensor::zeros(shape));
                let wrong = Layer { values, ..whole.clone() };
                let before = tape.len();
                let mut results = vec![("resolve", wrong.image().map(drop))];
                for target in &targets {
                    results.push(("squared_error", wrong.squared_error(target).map(drop)));
                }
                if !whole.is_antialiased {
                    results.push(("antialias", wrong.antialias(clip).map(drop)));
                }
                for (operation, result) in results {
                    assert_eq!(
                        result.unwrap_err().to_string(),
                        format!(
                            "{operation} needs values of shape [{rows}, C], C > 0, got shape {}",
                            values.shape()
                        )
                    );
                }
                assert_eq!(tape.len(), before);
            }
            // What is exchanged for its like is accepted.
            let moved = Layer { values: whole.values * 0.5, ..whole };
            assert!(moved.image().is_ok() && moved.squared_error(&targets[0]).is_ok());
        }
    }

    #[test]
    fn a_layer_is_antialiased_once_and_in_its_own_tape() {
        let (tape, other) = (Tape::<f64>::new(), Tape::new());
        let fragments = fragments(&tape);
        let values = leaf(&tape, [fragments.coverage.count(), 2]);
        let whole = layer(values, &fragments, Background::Zero).unwrap();
        let smooth = whole.clone().antialias(fragments.clip).unwrap();
        let rim = smooth.values.shape()[0] - fragments.coverage.count();
        let error = smooth.antialias(fragments.clip).unwrap_err().to_string();
        let rule = "antialias needs a layer that was not antialiased before";
        assert_eq!(error, format!("{rule}, got one with a rim of {rim} pixels"));
        let foreign = other.leaf(&fragments.clip.value());
        let error = whole.clone().antialias(foreign).unwrap_err().to_string();
        assert_eq!(error, "antialias needs variables of one tape, got one of another");
        let short = leaf(&tape, [5, 4]);
        let error = whole.antialias(short).unwrap_err().to_string();
        assert_eq!(error, "antialias needs clip positions of shape [6, 4], got shape [5, 4]");
    }
}
