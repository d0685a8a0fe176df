//! The squared error of a layer against a target.
//!
//! # Forward
//! `L = sum_p |x_p - t_p|^2` over the pixels p of the layer, plus the same sum for the background at
//! all others. The sums for blocks of background pixels are worked out once, with the target; so a
//! step costs what the layer costs, whatever the size of the picture. In [`Scalar::Wide`].
//!
//! # Backward
//! `x_bar_p = 2 (x_p - t_p) L_bar`.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tensor, TensorError, Var, sum,
};

use crate::background::Background;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::layer::Layer;

/// A target image, and what the background that is seen beside it costs.
#[derive(Debug, Clone)]
pub struct Target<T: Scalar>(Arc<Inner<T>>);

#[derive(Debug)]
struct Inner<T: Scalar> {
    image: Tensor<T>,
    background: Vec<T>,
    /// The squared errors of the background over blocks of [`BLOCK`] pixels, in the order of rows,
    /// and over blocks of so many blocks.
    short: Vec<T::Wide>,
    long: Vec<T::Wide>,
}

/// Pixels in a block: fewer are visited on either side of a covered stretch, and fewer blocks, and so
/// many times as many pixels are left for blocks of blocks.
const BLOCK: usize = 16;

impl<T: Scalar> Target<T> {
    /// The target `image: [H, W, C]` for pictures before a background of one colour,
    /// `background: [C]`.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the image is `[H, W, C]` and the background `[C]`.
    pub fn new(image: &Tensor<T>, background: &Tensor<T>) -> Result<Self, RenderError> {
        let refused = |rule: &str, tensor: &Tensor<T>| {
            let (rule, shape) = (rule.to_owned(), tensor.shape().clone());
            Err(RenderError::Shape { operation: "target", rule, shape })
        };
        let &[_, _, channels] = &**image.shape() else {
            return refused("an image of shape [H, W, C]", image);
        };
        if **background.shape() != [channels] || channels == 0 {
            return refused(&format!("a background of shape [{channels}], C > 0"), background);
        }
        let background = background.data().to_vec();
        let blocks = image.data().chunks(BLOCK * channels);
        let short: Vec<_> = blocks.map(|block| squared_error(&background, block)).collect();
        let long = short.chunks(BLOCK).map(|block| block.iter().copied().sum()).collect();
        Ok(Self(Arc::new(Inner { image: image.clone(), background, short, long })))
    }

    /// The image.
    pub fn image(&self) -> &Tensor<T> {
        &self.0.image
    }
}

impl<T: Scalar> Inner<T> {
    /// The squared error of the background over `pixels`.
    fn behind(&self, pixels: Range<usize>) -> T::Wide {
        let channels = self.background.len();
        // Blocks of one size within a range, and what is left of the range before and after.
        let inner = |range: &Range<usize>, size: usize| {
            let (first, end) = (range.start.div_ceil(size), range.end / size);
            (first < end).then_some(first..end)
        };
        let single = |pixels: Range<usize>| -> T::Wide {
            let entries = pixels.start * channels..pixels.end * channels;
            squared_error(&self.background, &self.image.data()[entries])
        };
        let total = |blocks: &[T::Wide]| -> T::Wide { blocks.iter().copied().sum() };
        let Some(short) = inner(&pixels, BLOCK) else { return single(pixels) };
        let ends =
            single(pixels.start..short.start * BLOCK) + single(short.end * BLOCK..pixels.end);
        let Some(long) = inner(&short, BLOCK) else { return ends + total(&self.short[short]) };
        ends + total(&self.short[short.start..long.start * BLOCK])
            + total(&self.short[long.end * BLOCK..short.end])
            + total(&self.long[long])
    }
}

/// The squared error of one colour against some pixels.
fn squared_error<T: Scalar>(color: &[T], pixels: &[T]) -> T::Wide {
    let channels = color.len();
    let of_channel = |c: usize| {
        let color = color[c].widen();
        sum::<T>(pixels.len() / channels, |pixel| {
            let difference = color - pixels[pixel * channels + c].widen();
            difference * difference
        })
    };
    (0..channels).map(of_channel).sum()
}

impl<'t, T: Scalar> Layer<'t, T> {
    /// The sum of the squared errors of the whole picture, layer and background, against `target`;
    /// returns `[]`.
    ///
    /// Where the background is a constant colour, the one that the target was made for, no pixel
    /// beside the layer is visited; otherwise the image is made first.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the values have a row for each pixel of the layer, and the
    /// target the picture's size and channels; and as [`Layer::image`].
    pub fn squared_error(&self, target: &Target<T>) -> Result<Var<'t, T>, RenderError> {
        let (size, channels) = (self.coverage.size(), self.checked_channels("squared_error")?);
        let shape = [size.height, size.width, channels];
        if **target.image().shape() != shape {
            return Err(RenderError::Shape {
                operation: "squared_error",
                rule: format!("a target of shape {shape:?}"),
                shape: target.image().shape().clone(),
            });
        }
        let tape = self.values.tape();
        if let Some(background) = self.background.variable() {
            if !std::ptr::eq(background.tape(), tape) {
                return Err(TensorError::ForeignVariable { operation: "squared_error" }.into());
            }
            let channels = shape[2];
            self.background.behind().check("squared_error", &background.shape(), size, channels)?;
        }
        let background = &target.0.background;
        let is_targets = match self.background {
            Background::Zero => background.iter().all(|&entry| entry == T::ZERO),
            Background::Color(color) => {
                !color.needs_gradient() && color.value().data() == background.as_slice()
            }
            Background::Image(_) => false,
        };
        if !is_targets {
            let difference = self.image()?.try_sub(tape.constant(target.image()))?;
            return Ok(difference.square().sum());
        }
        let op = SquaredError {
            coverage: Arc::clone(&self.coverage),
            rim: self.rim.clone(),
            target: Arc::clone(&target.0),
        };
        tape.leave_out("squared_error", "pixels of the background: summed with the target");
        Ok(tape.apply(op, &[self.values])?)
    }
}

/// Input: values `[P, C]`. Output: `[]`.
struct SquaredError<T: Scalar> {
    coverage: Arc<Coverage>,
    rim: Option<Arc<Vec<u32>>>,
    target: Arc<Inner<T>>,
}

/// Entries that are subtracted at once.
const AT_ONCE: usize = 12;

/// `x - t` for the first `length` entries. What it writes after them means nothing: most runs are
/// short, and a fixed number of entries takes less time than as many as there are.
#[inline(always)]
fn subtract<T: Scalar>(length: usize, differences: &mut [T], x: &[T], t: &[T]) {
    let mut done = 0;
    if let (Some(differences), Some(x), Some(t)) = (
        differences.first_chunk_mut::<AT_ONCE>(),
        x.first_chunk::<AT_ONCE>(),
        t.first_chunk::<AT_ONCE>(),
    ) {
        *differences = std::array::from_fn(|k| x[k] - t[k]);
        done = AT_ONCE;
    }
    for k in done..length {
        differences[k] = x[k] - t[k];
    }
}

/// Partial sums, so that additions overlap.
const PARTS: usize = 16;

/// The sum of the squares.
#[inline(always)]
fn sum_of_squares<T: Scalar>(entries: &[T]) -> T::Wide {
    let mut parts = [T::Wide::ZERO; PARTS];
    let (whole, rest) = entries.as_chunks::<PARTS>();
    for entries in whole {
        for part in 0..PARTS {
            let entry = entries[part].widen();
            parts[part] += entry * entry;
        }
    }
    for (part, entry) in parts.iter_mut().zip(rest) {
        *part += entry.widen() * entry.widen();
    }
    parts.into_iter().sum()
}

impl<T: Scalar> Op<T> for SquaredError<T> {
    /// The differences `x - t: [P, C]`.
    type Saved = Vec<T>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "squared_error"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        differences: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let (x, target) = (inputs.data(0), self.target.image.data());
        let (coverage, channels) = (&*self.coverage, self.target.background.len());
        let rim = self.rim.as_deref().map_or(&[][..], Vec::as_slice);
        if differences.len() != x.len() {
            differences.resize(x.len(), T::ZERO);
        }
        let (own, rim_own) = differences.split_at_mut(coverage.centers() * channels);
        let (x_own, x_rim) = x.split_at(own.len());
        let square = |difference: &T| difference.widen() * difference.widen();
        let mut total = T::Wide::ZERO;
        let work = |slots: Range<usize>, first: usize, own: &mut [T]| {
            let x = &x_own[first * channels..][..own.len()];
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    let mut at = 0;
                    for (pixel, length) in coverage.stretches_of(slots) {
                        let length = length * channels;
                        subtract(length, &mut own[at..], &x[at..], &target[pixel * channels..]);
                        at += length;
                    }
                    sum_of_squares(own)
                },
            )
        };
        coverage
            .merge_bands_mut(coverage.center_bands(), channels, own, work, |band| total += band);
        let rows = rim_own.chunks_exact_mut(channels).zip(x_rim.chunks_exact(channels));
        for (&pixel, (row, x)) in rim.iter().zip(rows) {
            let target = &target[pixel as usize * channels..][..channels];
            row.iter_mut().zip(x.iter().zip(target)).for_each(|(row, (&x, &t))| *row = x - t);
            total += row.iter().map(square).sum();
        }
        coverage.for_each_gap(rim, |gap| total += self.target.behind(gap));
        outputs.push([])[0] = T::narrow(total);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        differences: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let slope = T::from_f64(2.0) * kept.only_upstream()[0];
        x_bar.add_zipped([differences], |[difference]| slope * difference);
    }

    fn saved_bytes(&self, differences: &Self::Saved) -> usize {
        size_of_val(differences.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tape;

    use super::*;
    use crate::layer::layer;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::size::Size;

    #[test]
    fn the_background_of_a_range_is_the_sum_over_its_pixels() {
        // Long enough for blocks of blocks.
        let pixels = 3 * BLOCK * BLOCK + 5 * BLOCK + 7;
        let image = Tensor::from_flat_fn([1, pixels, 2], |k| (k % 11) as f64);
        let target = Target::new(&image, &Tensor::new([2], vec![3.0, 8.0]).unwrap()).unwrap();
        let square = |k: usize| (image.data()[k] - [3.0, 8.0][k % 2]).powi(2);
        let ends = [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK, BLOCK * BLOCK];
        let starts = ends.iter().flat_map(|&start| [start, start + BLOCK * BLOCK]);
        for start in starts {
            for end in ends.iter().flat_map(|&end| [start + end, pixels - end]) {
                if start <= end && end <= pixels {
                    // Whole numbers: sums are exact.
                    let expected: f64 = (2 * start..2 * end).map(square).sum();
                    assert_eq!(target.0.behind(start..end), expected, "{start}..{end}");
                }
            }
        }
    }

    #[test]
    fn the_error_is_exactly_zero_where_the_target_is_the_picture() {
        let tape = Tape::<f32>::new();
        let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
        let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let fragments = rasterize(clip, &mesh, Size::square(100)).unwrap();
        let values = Tensor::from_flat_fn([fragments.coverage.count(), 3], |k| (k as f32).sqrt());
        let values = tape.leaf(&values);
        let color = Tensor::full([3], 0.3);
        let background = Background::Color(tape.constant(&color));
        let layer = layer(values, &fragments, background).unwrap().antialias(clip).unwrap();
        let target = Target::new(&layer.image().unwrap().value(), &color).unwrap();
        let loss = layer.squared_error(&target).unwrap();
        assert_eq!(loss.item(), 0.0);
        let gradients = loss.backward().unwrap();
        assert!(gradients.get(values).unwrap().data().iter().all(|&bar| bar == 0.0));
    }

    #[test]
    fn a_background_that_an_image_refuses_is_refused_even_where_its_numbers_are_the_targets() {
        let (tape, other) = (Tape::new(), Tape::new());
        let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
        let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let fragments = rasterize(clip, &mesh, Size::square(8)).unwrap();
        let values = tape.leaf(&Tensor::full([fragments.coverage.count(), 3], 0.5));
        let color = Tensor::full([3], 0.25);
        let target = Target::new(&Tensor::zeros([8, 8, 3]), &color).unwrap();
        let error = |background: Var<'_, f64>| {
            let layer = layer(values, &fragments, Background::Color(background)).unwrap();
            layer.squared_error(&target).unwrap_err().to_string()
        };
        let message = "squared_error needs a background colour of shape [3], got shape [1, 3]";
        assert_eq!(error(tape.constant(&Tensor::full([1, 3], 0.25))), message);
        let foreign = other.constant(&color);
        assert_eq!(error(foreign), "squared_error needs variables of one tape, got one of another");
    }

    #[test]
    fn wrong_shapes_are_refused() {
        let image = Tensor::<f64>::zeros([4, 5, 3]);
        let color = Tensor::zeros([3]);
        let error = Target::new(&Tensor::zeros([4, 5]), &color).unwrap_err().to_string();
        assert_eq!(error, "target needs an image of shape [H, W, C], got shape [4, 5]");
        let error = Target::new(&image, &Tensor::zeros([1])).unwrap_err().to_string();
        assert_eq!(error, "target needs a background of shape [3], C > 0, got shape [1]");

        let target = Target::new(&image, &color).unwrap();
        let tape = Tape::new();
        let mesh = Mesh::new(vec![], 1).unwrap();
        let clip = tape.leaf(&Tensor::zeros([1, 4]));
        let fragments = rasterize(clip, &mesh, Size::square(4)).unwrap();
        let values = tape.leaf(&Tensor::zeros([0, 3]));
        let layer = layer(values, &fragments, Background::Zero).unwrap();
        let error = layer.squared_error(&target).unwrap_err().to_string();
        assert_eq!(error, "squared_error needs a target of shape [4, 4, 3], got shape [4, 5, 3]");
    }
}
