//! Analytic antialiasing of silhouettes: it blends neighbouring pixels by where a silhouette edge
//! passes between their centres, and so gives silhouettes a gradient.
//!
//! # Forward
//! For each pixel and its right and its lower neighbour, `c_0` and `c_1`, whose triangle ids differ:
//! the edge is one of the covered triangle's, of two the nearer one's. Of its edges that cross the
//! line through the two centres take the one that lies farthest towards the other pixel; use it
//! only if it is a silhouette (no face on its other side, or both faces on the same side of it in
//! the image), runs more across the line than along it, and crosses between the two centres, at
//! distance d from the covered one. With `s = 1` where the triangle covers the first pixel and -1
//! where it covers the second, `alpha = s (1/2 - d)`: where positive `out_0 += alpha (c_1 - c_0)`,
//! else `out_1 += alpha (c_1 - c_0)`. All reads are from the input image, so up to four blends add
//! at a pixel, each with a share of at most 1/2.
//!
//! # Backward
//! `alpha_bar = out_bar . (c_1 - c_0)` at the blended pixel; `c_bar_0 -= alpha out_bar`,
//! `c_bar_1 += alpha out_bar`, beside `c_bar = out_bar`; from alpha to the edge's vertices as in
//! `discontinuity`.
//!
//! # Where it is not smooth
//! Where a crossing reaches a pixel centre, an edge passes through 45 degrees, or an edge starts or
//! stops being a silhouette. An intersection of two faces is no edge of either: it gets no
//! gradient. The gradient is that of this image; from that of the true area coverage it differs
//! in first order of the pixel size.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, section 3.5.

mod discontinuity;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::{is_shared, merge_ranges};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Tensor, Var};

use self::discontinuity::{Blend, blend};
use crate::error::RenderError;
use crate::fragments::{Coverage, Fragments};
use crate::runs::add_term;

/// Fragments in one piece of the search for discontinuities.
const FRAGMENTS_PER_PIECE: usize = 1 << 13;

/// The antialiased image `[H, W, C]` of `image: [H, W, C]`, which shows `fragments`, the
/// rasterization of vertices `clip: [V, 4]`.
///
/// For images of one fragment per pixel, as [`rasterize`](crate::rasterize()) gives them.
///
/// # Errors
/// [`RenderError::Shape`] unless the image is `[H, W, C]` of the fragments' size and `clip` is
/// `[V, 4]` with the mesh's number of vertices, and for fragments that are not whole;
/// `TensorError::ForeignVariable` for variables of several tapes.
pub fn antialias<'t, T: Scalar>(
    image: Var<'t, T>,
    fragments: &Fragments<'t, T>,
    clip: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let coverage = fragments.checked_coverage("antialias", image.tape())?;
    let op = Antialias { coverage, depth: fragments.depth.value() };
    image.tape().apply(op, &[image, clip])
}

/// Inputs: image `[H, W, C]`, clip `[V, 4]`.
struct Antialias<T> {
    coverage: Arc<Coverage>,
    depth: Tensor<T>,
}

impl<T: Scalar> Antialias<T> {
    /// Adds the blends at the pairs that belong to fragment `fragment`: itself with its right and
    /// its lower neighbour, and an uncovered left or upper neighbour with itself.
    fn visit(&self, clip: &[T], fragment: usize, blends: &mut Vec<Blend<T::Wide>>) {
        let (coverage, depth) = (&*self.coverage, self.depth.data());
        let size = coverage.size();
        let pixel = coverage.pixels()[fragment] as usize;
        let face = coverage.faces()[fragment] as usize;
        let (row, column) = (pixel / size.width, pixel % size.width);
        for (below, step) in [(false, 1), (true, size.width)] {
            let (has_next, has_previous) = if below {
                (row + 1 < size.height, row > 0)
            } else {
                (column + 1 < size.width, column > 0)
            };
            if has_previous && coverage.fragment_at(pixel - step).is_none() {
                blends.extend(blend(clip, coverage, face, (pixel - step) as u32, below, false));
            }
            if has_next {
                let other = coverage.fragment_at(pixel + step);
                let face_of = |fragment: usize| coverage.faces()[fragment] as usize;
                // The nearer of two faces; of equally near ones the first pixel's.
                let (face, covers_first) = match other {
                    Some(other) if face_of(other) == face => continue,
                    Some(other) if depth[other] < depth[fragment] => (face_of(other), false),
                    _ => (face, true),
                };
                blends.extend(blend(clip, coverage, face, pixel as u32, below, covers_first));
            }
        }
    }

    /// All blends, in the order of the fragments.
    fn find(&self, clip: &[T], blends: &mut Vec<Blend<T::Wide>>) {
        blends.clear();
        let count = self.coverage.count();
        if !is_shared(count, FRAGMENTS_PER_PIECE) {
            (0..count).for_each(|n| self.visit(clip, n, blends));
            return;
        }
        let work = |fragments: Range<usize>| {
            let mut found = Vec::new();
            fragments.for_each(|n| self.visit(clip, n, &mut found));
            found
        };
        merge_ranges(count, FRAGMENTS_PER_PIECE, work, |found| blends.extend(found));
    }

    /// The first entries of the first pixel, the second pixel, and the blended one of the two.
    fn entries(&self, blend: &Blend<T::Wide>, channels: usize) -> [usize; 3] {
        let step = if blend.below { self.coverage.size().width } else { 1 };
        let first = blend.pixel as usize * channels;
        let second = first + step * channels;
        [first, second, if blend.alpha > T::Wide::ZERO { first } else { second }]
    }

    fn check(&self, image: &Shape, clip: &Shape) -> Result<(), RenderError> {
        let size = self.coverage.size();
        let refused = |rule: String, shape: &Shape| {
            Err(RenderError::Shape { operation: "antialias", rule, shape: shape.clone() })
        };
        if image.rank() != 3 || image[..2] != [size.height, size.width] {
            return refused(
                format!("an image of shape [{}, {}, C]", size.height, size.width),
                image,
            );
        }
        let vertices = self.coverage.mesh().vertex_count();
        if **clip != [vertices, 4] {
            return refused(format!("clip positions of shape [{vertices}, 4]"), clip);
        }
        Ok(())
    }
}

impl<T: Scalar> Op<T> for Antialias<T> {
    type Saved = Vec<Blend<T::Wide>>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "antialias"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        blends: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        self.check(inputs.shape(0), inputs.shape(1))?;
        self.find(inputs.data(1), blends);
        if blends.is_empty() {
            outputs.pass(0, "no discontinuities");
            return Ok(());
        }
        let image = inputs.data(0);
        let channels = inputs.shape(0)[2];
        let out = outputs.push(inputs.shape(0));
        out.copy_from_slice(image);
        for blend in blends.iter() {
            let [first, second, target] = self.entries(blend, channels);
            let alpha = T::narrow(blend.alpha);
            for c in 0..channels {
                out[target + c] += alpha * (image[second + c] - image[first + c]);
            }
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        if inputs.needs(1) { Keep::NOTHING.input(0).input(1) } else { Keep::NOTHING }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        blends: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let out_bar = kept.only_upstream();
        let channels = kept.output_shape(0)[2];
        if let Some(image_bar) = gradients.get(0) {
            image_bar.add(out_bar);
            let image_bar = image_bar.entries();
            for blend in blends.iter() {
                let [first, second, target] = self.entries(blend, channels);
                let alpha = T::narrow(blend.alpha);
                for c in 0..channels {
                    let share = alpha * out_bar[target + c];
                    image_bar[first + c] -= share;
                    image_bar[second + c] += share;
                }
            }
        }
        if let Some(clip_bar) = gradients.get(1) {
            let (image, clip) = (kept.input(0), kept.input(1));
            let clip_bar = clip_bar.entries();
            for blend in blends.iter().filter(|blend| !blend.clamped) {
                let [first, second, target] = self.entries(blend, channels);
                let alpha_bar = (0..channels)
                    .map(|c| {
                        let step = image[second + c].widen() - image[first + c].widen();
                        out_bar[target + c].widen() * step
                    })
                    .sum();
                let bars = blend.pull_back(alpha_bar, clip, self.coverage.size());
                for (&vertex, [x_bar, y_bar, w_bar]) in blend.edge.iter().zip(bars) {
                    let row = &mut clip_bar[4 * vertex as usize..][..4];
                    add_term(&mut row[0], T::narrow(x_bar));
                    add_term(&mut row[1], T::narrow(y_bar));
                    add_term(&mut row[3], T::narrow(w_bar));
                }
            }
        }
    }

    fn saved_bytes(&self, blends: &Self::Saved) -> usize {
        size_of_val(blends.as_slice())
    }
}
