//! From a picture to an image.
//!
//! # Forward
//! A pixel of the picture has its value, any other pixel the background.
//!
//! # Backward
//! `values_bar_p = image_bar` at the value's pixel; the background's gradient is `image_bar` at the
//! other pixels, summed over them where the background is one colour. It is linear.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Scalar, Var};

use crate::background::Kind;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::picture::Picture;
use crate::picture_rows::PictureRows;

impl<'t, T: Scalar> Picture<'t, T> {
    /// The dense image, `[H, W, C]`, with the background where the picture has no pixel.
    ///
    /// # Errors
    /// None that a picture can cause.
    #[inline(never)]
    pub fn image(&self) -> Result<Var<'t, T>, RenderError> {
        let (coverage, rim) = (Arc::clone(&self.coverage), self.rim.clone());
        let op = Image { coverage, rim, kind: self.backdrop.kind };
        self.values.tape().apply(op, &[self.values, self.backdrop.values])
    }
}

/// Inputs: values `[P, C]`, a background `[C]` or `[H, W, C]`.
struct Image {
    coverage: Arc<Coverage>,
    rim: Option<Arc<Vec<u32>>>,
    kind: Kind,
}

impl Image {
    fn rim(&self) -> &[u32] {
        self.rim.as_deref().map_or(&[], Vec::as_slice)
    }
}

impl<T: Scalar> Op<T> for Image {
    /// Memory for the sums over the pixels that show a background of one colour.
    type Saved = Vec<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "image"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (size, channels) = (self.coverage.size(), inputs.shape(0)[1]);
        let (values, background) = (inputs.data(0), inputs.data(1));
        let image = outputs.try_push("image", [size.height, size.width, channels])?;
        self.coverage.for_each_gap(self.rim(), |gap| {
            let first = gap.start;
            let entries = gap.start * channels..gap.end * channels;
            self.kind.fill(&mut image[entries], background, channels, first);
        });
        let entries = |rows: Range<usize>| rows.start * channels..rows.end * channels;
        for run in &self.coverage.centers.runs {
            image[entries(run.pixels())].copy_from_slice(&values[entries(run.fragments())]);
        }
        let rim_values = values[self.coverage.centers() * channels..].chunks_exact(channels);
        for (&pixel, value) in self.rim().iter().zip(rim_values) {
            image[pixel as usize * channels..][..channels].copy_from_slice(value);
        }
        Ok(())
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
            let rows = 0..self.coverage.size().height;
            let picture = PictureRows { coverage: &self.coverage, rim: self.rim(), channels };
            picture.pull_back(image_bar, rows, values_bar.entries());
        }
        let Some(background_bar) = gradients.get(1) else { return };
        if self.kind == Kind::Color {
            sums.clear();
            sums.resize(channels, T::Wide::ZERO);
            self.coverage.for_each_gap(self.rim(), |gap| {
                for row in
                    image_bar[gap.start * channels..gap.end * channels].chunks_exact(channels)
                {
                    sums.iter_mut().zip(row).for_each(|(sum, bar)| *sum += bar.widen());
                }
            });
            background_bar.add_each(|c| T::narrow(sums[c]));
        } else {
            let entries = background_bar.entries();
            self.coverage.for_each_gap(self.rim(), |gap| {
                for at in gap.start * channels..gap.end * channels {
                    entries[at] += image_bar[at];
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use crate::background::Background;
    use crate::composite::composite;
    use crate::fixtures::{SMALL, surface};
    use crate::fragments::Fragments;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;

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
        let image = tape.leaf(&Tensor::from_flat_fn([3, 5, 2], |k| -(k as f64)));
        for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
            let out = composite(values, &fragments, background).unwrap().image().unwrap().value();
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
        let upstream = Tensor::from_flat_fn([3, 5, 2], |k| (k + 1) as f64);
        let at_uncovered = expected(&fragments, |_| 0.0, |k| (k + 1) as f64);
        let at_covered: Vec<_> = fragments
            .coverage
            .pixels()
            .flat_map(|pixel| [2 * pixel + 1, 2 * pixel + 2].map(|entry| entry as f64))
            .collect();
        let color = tape.leaf(&Tensor::zeros([2]));
        let image = tape.leaf(&Tensor::zeros([3, 5, 2]));
        for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
            let out = composite(values, &fragments, background).unwrap().image().unwrap();
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
        let fragments = rasterize(clip, &Mesh::new(vec![], 1).unwrap(), SMALL).unwrap();
        let values = tape.leaf(&Tensor::zeros([0, 1]));
        let color = tape.leaf(&Tensor::full([1], 0.5));
        let out = composite(values, &fragments, Background::Color(color)).unwrap();
        let out = out.image().unwrap();
        assert_eq!(out.value().data(), [0.5; 15]);
        let gradients = out.sum().backward().unwrap();
        assert_eq!(gradients.get(color).unwrap().data(), [15.0]);
    }
}
