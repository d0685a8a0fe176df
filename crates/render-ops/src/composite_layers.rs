//! Layers in depth, one over another.
//!
//! # Forward
//! Layer k has the colours `c_k`, times their alpha (premultiplied), and the alphas `a_k`. From the last
//! layer on, before a background b: `r_k = c_k + (1 - a_k) r_(k+1)`, where `r_(k+1)` is b at a pixel
//! that no further layer covers. The picture is `r_0`.
//!
//! # Backward
//! From the first layer on, with `r_bar_0 = x_bar`: `c_bar_k = r_bar_k`, `a_bar_k = -r_bar_k . r_(k+1)`,
//! `r_bar_(k+1) = (1 - a_k) r_bar_k`, and the last `r_bar` at a pixel is the background's. It is smooth in
//! colours and alphas.
//!
//! # Source
//! Porter and Duff, *Compositing digital images*, SIGGRAPH 1984: the operator over.

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::background::{Background, Kind};
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::picture::{Composite, Picture, checked_channels};

const NAME: &str = "composite_layers";

/// What a layer in depth shows.
#[derive(Debug, Clone, Copy)]
pub struct Layer<'a, 't, T: Scalar> {
    /// The layer's fragments, at pixel centres.
    pub fragments: &'a Fragments<'t, T>,
    /// Colours times their alpha, `[N, C]`.
    pub premultiplied: Var<'t, T>,
    /// How much of what lies behind is hidden, from 0 to 1: `[N]`.
    pub alpha: Var<'t, T>,
}

/// The picture of layers one over another, the nearest first, before a background:
/// [`depth_layers`](crate::depth_layers()) has the fragments. The first layer covers every pixel that
/// some layer covers.
///
/// An alpha of 1 hides all that lies behind, and an alpha of 0 nothing. The picture has the
/// first layer's silhouettes, so [`antialias`](crate::antialias()) smooths those alone.
///
/// # Errors
/// - [`RenderError::NoLayers`] without a layer.
/// - [`RenderError::Shape`] unless the colours of each layer are `[N, C]`, C > 0, its
///   alphas `[N]`, and the background has as many channels; and for fragments that are not whole.
/// - [`RenderError::ExactLayers`] for fragments of exact coverage.
/// - [`RenderError::LayerSize`] for layers of several sizes.
/// - [`RenderError::LayerPixel`] where a layer covers a pixel that the layer before does not.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn composite_layers<'t, T: Scalar>(
    layers: &[Layer<'_, 't, T>],
    background: Background<'t, T>,
) -> Result<Composite<'t, T>, RenderError> {
    let Some(front) = layers.first() else {
        return Err(RenderError::NoLayers { operation: NAME });
    };
    let tape = front.premultiplied.tape();
    let channels = checked_channels(NAME, front.premultiplied, front.fragments.coverage.count())?;
    let mut coverages = Vec::with_capacity(layers.len());
    for layer in layers {
        let coverage = layer.fragments.checked_coverage(NAME, tape)?;
        if coverage.is_exact() {
            return Err(RenderError::ExactLayers { operation: NAME });
        }
        let (count, size) = (coverage.count(), front.fragments.coverage.size());
        if coverage.size() != size {
            return Err(RenderError::LayerSize { expected: size, given: coverage.size() });
        }
        let expected = [
            (layer.premultiplied, vec![count, channels], "values"),
            (layer.alpha, vec![count], "alphas"),
        ];
        for (variable, shape, what) in expected {
            if *variable.shape() != shape[..] {
                let rule = format!("{what} of shape {shape:?}");
                return Err(RenderError::Shape { operation: NAME, rule, shape: variable.shape() });
            }
        }
        coverages.push(coverage);
    }
    let coverage = Arc::clone(&coverages[0]);
    let backdrop = background.behind(NAME, tape, coverage.size(), channels)?;
    let inputs: Vec<_> = [backdrop.values]
        .into_iter()
        .chain(layers.iter().flat_map(|layer| [layer.premultiplied, layer.alpha]))
        .collect();
    let op = CompositeLayers { coverages, kind: backdrop.kind };
    let values = tape.apply(op, &inputs)?;
    let clip = front.fragments.clip;
    Ok(Composite(Picture { values, backdrop, clip, coverage, blended: None }))
}

/// Inputs: a background `[C]` or `[H, W, C]`, then for each layer colours `[N, C]` and alphas `[N]`.
struct CompositeLayers {
    coverages: Vec<Arc<Coverage>>,
    kind: Kind,
}

/// Stands for "no fragment".
const NONE: u32 = u32::MAX;

/// What a backward pass reads.
#[derive(Debug)]
struct Saved<T: Scalar> {
    /// By layer: for each fragment the fragment of the next layer at its pixel, or [`NONE`].
    next: Vec<Vec<u32>>,
    /// By layer: `r_k`, and the alphas.
    seen: Vec<Vec<T>>,
    alphas: Vec<Vec<T>>,
    /// Per pixel: a fragment of a layer.
    fragments: Vec<u32>,
    /// `r_bar` of a layer and of the next.
    bars: [Vec<T>; 2],
    /// The sum over all pixels that see a background of one colour.
    color_bar: Vec<T::Wide>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        let (next, seen, alphas, fragments, bars, color_bar) = Default::default();
        Self { next, seen, alphas, fragments, bars, color_bar }
    }
}

impl CompositeLayers {
    /// Finds what lies behind each fragment.
    ///
    /// # Errors
    /// [`RenderError::LayerPixel`] where a layer covers a pixel that the layer before does not.
    fn find_next<T: Scalar>(&self, saved: &mut Saved<T>) -> Result<(), RenderError> {
        let Saved { next, fragments, .. } = saved;
        next.resize_with(self.coverages.len(), Vec::new);
        fragments.clear();
        fragments.resize(self.coverages[0].size().pixels(), NONE);
        for (k, coverage) in self.coverages.iter().enumerate() {
            next[k].clear();
            next[k].resize(coverage.count(), NONE);
        }
        for (k, pair) in self.coverages.windows(2).enumerate() {
            for (n, pixel) in pair[0].pixels().enumerate() {
                fragments[pixel] = n as u32;
            }
            for (n, pixel) in pair[1].pixels().enumerate() {
                let front = std::mem::replace(&mut fragments[pixel], NONE);
                if front == NONE {
                    return Err(RenderError::LayerPixel { layer: k + 1, pixel });
                }
                next[k][front as usize] = n as u32;
            }
            // What is left has nothing behind it.
            pair[0].pixels().for_each(|pixel| fragments[pixel] = NONE);
        }
        Ok(())
    }
}

impl<T: Scalar> Op<T> for CompositeLayers {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let (background, channels) = (inputs.data(0), inputs.shape(1)[1]);
        self.find_next(saved)?;
        let Saved { next, seen, alphas, .. } = saved;
        seen.resize_with(self.coverages.len(), Vec::new);
        alphas.resize_with(self.coverages.len(), Vec::new);
        for (k, coverage) in self.coverages.iter().enumerate().rev() {
            let (colors, alpha) = (inputs.data(1 + 2 * k), inputs.data(2 + 2 * k));
            let (front, behind) = seen.split_at_mut(k + 1);
            let front = &mut front[k];
            front.clear();
            front.extend_from_slice(colors);
            let rows = front.chunks_exact_mut(channels).zip(alpha).zip(&next[k]);
            for (((row, &alpha), &next), pixel) in rows.zip(coverage.pixels()) {
                let behind = match next {
                    NONE => &background[self.kind.entry(channels, pixel)..][..channels],
                    next => &behind[0][next as usize * channels..][..channels],
                };
                let left = T::ONE - alpha;
                row.iter_mut().zip(behind).for_each(|(row, &behind)| *row += left * behind);
            }
            alphas[k].clear();
            alphas[k].extend_from_slice(alpha);
        }
        outputs.push(inputs.shape(1)).copy_from_slice(&seen[0]);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let needs_alpha = (0..self.coverages.len()).any(|k| inputs.needs(2 + 2 * k));
        Keep::NOTHING.input_if(0, needs_alpha)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let channels = kept.input_shape(1)[1];
        let Saved { next, seen, alphas, bars: [bars, behind_bars], color_bar, .. } = saved;
        color_bar.clear();
        color_bar.resize(channels, T::Wide::ZERO);
        bars.clear();
        bars.extend_from_slice(kept.only_upstream());
        for (k, coverage) in self.coverages.iter().enumerate() {
            if let Some(colors_bar) = gradients.get(1 + 2 * k) {
                colors_bar.add(bars);
            }
            if let Some(alpha_bar) = gradients.get(2 + 2 * k) {
                let background = kept.input(0);
                let entries = alpha_bar.entries().iter_mut().zip(bars.chunks_exact(channels));
                for (((entry, bar), &next), pixel) in entries.zip(&next[k]).zip(coverage.pixels()) {
                    let behind = match next {
                        NONE => &background[self.kind.entry(channels, pixel)..][..channels],
                        next => &seen[k + 1][next as usize * channels..][..channels],
                    };
                    let dot: T::Wide =
                        bar.iter().zip(behind).map(|(a, b)| a.widen() * b.widen()).sum();
                    *entry += T::narrow(-dot);
                }
            }
            let count = self.coverages.get(k + 1).map_or(0, |next| next.count());
            behind_bars.clear();
            behind_bars.resize(count * channels, T::ZERO);
            let mut background_bar = gradients.get(0).map(|bar| bar.entries());
            let rows = bars.chunks_exact(channels).zip(&alphas[k]).zip(&next[k]);
            for (((bar, &alpha), &next), pixel) in rows.zip(coverage.pixels()) {
                let left = T::ONE - alpha;
                let to = match (next, background_bar.as_deref_mut(), self.kind) {
                    (NONE, None, _) => continue,
                    (NONE, _, Kind::Color) => {
                        for (sum, bar) in color_bar.iter_mut().zip(bar) {
                            *sum += left.widen() * bar.widen();
                        }
                        continue;
                    }
                    (NONE, Some(entries), Kind::Image) => {
                        &mut entries[pixel * channels..][..channels]
                    }
                    (next, ..) => &mut behind_bars[next as usize * channels..][..channels],
                };
                to.iter_mut().zip(bar).for_each(|(to, &bar)| *to += left * bar);
            }
            std::mem::swap(bars, behind_bars);
        }
        if let (Kind::Color, Some(background_bar)) = (self.kind, gradients.get(0)) {
            background_bar.add_each(|c| T::narrow(color_bar[c]));
        }
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        let bytes =
            |lists: &[Vec<T>]| lists.iter().map(|list| size_of_val(&list[..])).sum::<usize>();
        let next = saved.next.iter().map(|list| size_of_val(&list[..])).sum::<usize>();
        bytes(&saved.seen) + bytes(&saved.alphas) + next
    }
}
