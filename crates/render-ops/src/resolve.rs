//! From fragments to an image.
//!
//! # Forward
//! A covered pixel is the value of its fragment, any other one the background.
//!
//! # Backward
//! `values_bar_n = image_bar` at the fragment's pixel; the background's gradient is `image_bar` at
//! the pixels without a fragment, summed over them where the background is one colour. It is
//! linear.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var};

use crate::error::RenderError;
use crate::fragments::{Coverage, Fragments};

/// What is seen where nothing covers a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub enum Background<'t, T: Scalar> {
    /// Zeros.
    #[default]
    Zero,
    /// One colour, `[C]`.
    Color(Var<'t, T>),
    /// An image, `[H, W, C]`.
    Image(Var<'t, T>),
}

/// The image `[H, W, C]` of fragment values `[N, C]` before a background.
///
/// # Errors
/// [`RenderError::Shape`] unless the values are `[N, C]`, C > 0, with N the number of fragments, and
/// the background has as many channels and, if it is an image, the image's size; and for fragments
/// that are not whole. `TensorError::ForeignVariable` for variables of several tapes.
pub fn resolve<'t, T: Scalar>(
    values: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    background: Background<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage("resolve", values.tape())?;
    let resolve = |is_color| Resolve { coverage, is_color };
    match background {
        Background::Zero => values.tape().apply(resolve(false), &[values]),
        Background::Color(color) => values.tape().apply(resolve(true), &[values, color]),
        Background::Image(image) => values.tape().apply(resolve(false), &[values, image]),
    }
}

/// Inputs: values `[N, C]`, and perhaps a background `[C]` or `[H, W, C]`.
struct Resolve {
    coverage: Arc<Coverage>,
    /// Whether the background is one colour.
    is_color: bool,
}

impl Resolve {
    /// The first entries of the pixels without a fragment.
    fn uncovered(&self, channels: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.coverage.size().pixels())
            .filter(|&pixel| self.coverage.fragment_at(pixel).is_none())
            .map(move |pixel| pixel * channels)
    }

    /// The first entry of each fragment's pixel.
    fn covered(&self, channels: usize) -> impl Iterator<Item = usize> + '_ {
        self.coverage.pixels().iter().map(move |&pixel| pixel as usize * channels)
    }
}

impl<T: Scalar> Op<T> for Resolve {
    /// Memory for the sums over the pixels that show a background of one colour.
    type Saved = Vec<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "resolve"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let count = self.coverage.count();
        let refused = |rule: String, shape: &Shape| {
            Err(RenderError::Shape { operation: "resolve", rule, shape: shape.clone() })
        };
        let channels = match **inputs.shape(0) {
            [rows, channels] if rows == count && channels > 0 => channels,
            _ => return refused(format!("values of shape [{count}, C], C > 0"), inputs.shape(0)),
        };
        let size = self.coverage.size();
        let shape = [size.height, size.width, channels];
        if inputs.len() == 2 {
            let background = inputs.shape(1);
            if self.is_color && **background != [channels] {
                return refused(format!("a background colour of shape [{channels}]"), background);
            }
            if !self.is_color && **background != shape {
                return refused(format!("a background image of shape {shape:?}"), background);
            }
        }

        let values = inputs.data(0).chunks_exact(channels);
        let image = outputs.push(shape);
        if inputs.len() == 1 {
            image.fill(T::ZERO);
        } else {
            let behind = inputs.data(1);
            for at in self.uncovered(channels) {
                let from = if self.is_color { 0 } else { at };
                image[at..at + channels].copy_from_slice(&behind[from..from + channels]);
            }
        }
        for (value, at) in values.zip(self.covered(channels)) {
            image[at..at + channels].copy_from_slice(value);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        sums: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let image_bar = kept.only_upstream();
        let channels = kept.input_shape(0)[1];
        if let Some(values_bar) = gradients.get(0) {
            let pixels = self.coverage.pixels();
            values_bar
                .add_each(|k| image_bar[pixels[k / channels] as usize * channels + k % channels]);
        }
        if kept.input_count() == 1 {
            return;
        }
        if let Some(background_bar) = gradients.get(1) {
            if self.is_color {
                sums.clear();
                sums.resize(channels, T::Wide::ZERO);
                for at in self.uncovered(channels) {
                    let row = &image_bar[at..at + channels];
                    sums.iter_mut().zip(row).for_each(|(sum, bar)| *sum += bar.widen());
                }
                background_bar.add_each(|c| T::narrow(sums[c]));
            } else {
                let entries = background_bar.entries();
                for at in self.uncovered(channels) {
                    for c in at..at + channels {
                        entries[c] += image_bar[c];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::size::Size;

    const SIZE: Size = Size { width: 5, height: 3 };

    /// The fragments of a face over part of an image, and values `[N, 2]` on it.
    fn surface<T: Scalar>(tape: &Tape<T>) -> (Fragments<'_, T>, Var<'_, T>) {
        let clip = [-1.2, -0.9, 0.0, 1.0, 0.6, -0.7, 0.0, 1.0, 0.1, 1.3, 0.0, 1.0].map(T::from_f64);
        let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
        let fragments = rasterize(clip, &Mesh::new(vec![[0, 1, 2]], 3).unwrap(), SIZE).unwrap();
        let count = fragments.coverage.count();
        assert!((3..12).contains(&count), "{count}");
        let values = Tensor::from_fn([count, 2], |k| T::from_f64(100.0 + k as f64));
        (fragments, tape.leaf(&values))
    }

    /// The image by looking up each pixel's fragment.
    fn expected(
        fragments: &Fragments<'_, f64>,
        value: impl Fn(usize) -> f64,
        behind: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        (0..30)
            .map(|k| match fragments.coverage.fragment_at(k / 2) {
                Some(fragment) => value(2 * fragment + k % 2),
                None => behind(k),
            })
            .collect()
    }

    #[test]
    fn a_pixel_is_its_fragments_value_or_the_background() {
        let tape = Tape::new();
        let (fragments, values) = surface(&tape);
        let color = tape.leaf(&Tensor::new([2], vec![0.25, 0.5]).unwrap());
        let image = tape.leaf(&Tensor::from_fn([3, 5, 2], |k| -(k as f64)));
        for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
            let out = resolve(values, &fragments, background).unwrap().value();
            assert_eq!(*out.shape(), [3, 5, 2].into());
            let behind = |k: usize| match background {
                Background::Zero => 0.0,
                Background::Color(_) => [0.25, 0.5][k % 2],
                Background::Image(_) => -(k as f64),
            };
            assert_eq!(out.data(), expected(&fragments, |k| 100.0 + k as f64, behind));
        }
    }

    #[test]
    fn each_upstream_entry_goes_to_the_fragment_or_to_the_background() {
        let tape = Tape::new();
        let (fragments, values) = surface(&tape);
        let upstream = Tensor::from_fn([3, 5, 2], |k| (k + 1) as f64);
        let at_uncovered = expected(&fragments, |_| 0.0, |k| (k + 1) as f64);
        let at_covered: Vec<_> = fragments
            .coverage
            .pixels()
            .iter()
            .flat_map(|&pixel| [2 * pixel + 1, 2 * pixel + 2].map(f64::from))
            .collect();
        let color = tape.leaf(&Tensor::zeros([2]));
        let image = tape.leaf(&Tensor::zeros([3, 5, 2]));
        for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
            let out = resolve(values, &fragments, background).unwrap();
            let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
            assert_eq!(gradients.get(values).unwrap().data(), at_covered);
            match background {
                Background::Zero => {}
                Background::Color(color) => {
                    let sum = |c: usize| at_uncovered.iter().skip(c).step_by(2).sum::<f64>();
                    assert_eq!(gradients.get(color).unwrap().data(), [sum(0), sum(1)]);
                }
                Background::Image(image) => {
                    assert_eq!(gradients.get(image).unwrap().data(), at_uncovered);
                }
            }
        }
    }

    #[test]
    fn an_image_that_nothing_covers_is_the_background() {
        let tape = Tape::<f32>::new();
        let clip = tape.leaf(&Tensor::zeros([1, 4]));
        let fragments = rasterize(clip, &Mesh::new(vec![], 1).unwrap(), SIZE).unwrap();
        let values = tape.leaf(&Tensor::zeros([0, 1]));
        let color = tape.leaf(&Tensor::full([1], 0.5));
        let out = resolve(values, &fragments, Background::Color(color)).unwrap();
        assert_eq!(out.value().data(), [0.5; 15]);
        let gradients = out.sum().backward().unwrap();
        assert_eq!(gradients.get(color).unwrap().data(), [15.0]);
    }

    #[test]
    fn wrong_shapes_are_refused() {
        let tape = Tape::<f64>::new();
        let (fragments, values) = surface(&tape);
        let count = fragments.coverage.count();
        for shape in [vec![count], vec![count + 1, 2], vec![count, 0], vec![count, 2, 1]] {
            let wrong = tape.leaf(&Tensor::zeros(shape.as_slice()));
            let error = resolve(wrong, &fragments, Background::Zero).unwrap_err();
            let rule = format!("resolve needs values of shape [{count}, C], C > 0, got shape");
            assert!(error.to_string().starts_with(&rule), "{error}");
        }
        for shape in [&[][..], &[3], &[1], &[2], &[5, 3, 2], &[3, 5, 1], &[3, 5, 2], &[30]] {
            let behind = tape.leaf(&Tensor::zeros(shape));
            for (background, rule, right) in [
                (Background::Color(behind), "a background colour of shape [2]", &[2][..]),
                (Background::Image(behind), "a background image of shape [3, 5, 2]", &[3, 5, 2]),
            ] {
                let resolved = resolve(values, &fragments, background);
                if shape == right {
                    assert!(resolved.is_ok());
                    continue;
                }
                let message = resolved.unwrap_err().to_string();
                assert!(message.starts_with(&format!("resolve needs {rule}, got")), "{message}");
            }
        }
    }
}
