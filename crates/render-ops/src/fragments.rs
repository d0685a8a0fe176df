//! Fragments: the covered samples of an image alone, as tensors.
//!
//! Between vertices and pixels stand fragments. Whatever is computed on a surface is ordinary
//! tensor arithmetic on `[N, C]`, and costs nothing where there is no surface.

use std::fmt;
use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};

use crate::coverage::Coverage;
use crate::error::RenderError;

/// The fragments of a rasterized mesh: N covered samples, as tensors.
///
/// Fragments at pixel centres come first. They are ordered by bands of rows from the top, in a band by
/// face, and within a face by pixel; [`Coverage::pixels`] lists their pixels. With exact coverage the
/// pieces of boundary pixels follow, in an order of the same kind.
///
/// A field can be exchanged for another of the same shape on the same tape; operations refuse anything
/// else.
#[derive(Clone)]
pub struct Fragments<'t, T: Scalar> {
    /// The perspective-correct weights of vertices 0 and 1 of each fragment's face; vertex 2 has what is
    /// missing to 1. Shape `[N, 2]`, differentiable.
    pub barycentrics: Var<'t, T>,
    /// With exact coverage, the share of its pixel that each of the K pieces covers. Fragments at pixel
    /// centres have weight 1, which is not stored. Shape `[K]`, differentiable.
    pub weight: Option<Var<'t, T>>,
    /// The clip positions that were rasterized. Shape `[V, 4]`.
    pub clip: Var<'t, T>,
    /// Which face each fragment lies on, and which pixel it belongs to.
    pub coverage: Arc<Coverage>,
}

impl<T: Scalar> fmt::Debug for Fragments<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fragments").field("coverage", &self.coverage).finish_non_exhaustive()
    }
}

impl<'t, T: Scalar> Fragments<'t, T> {
    /// The coverage, where the fragments are whole and on `tape`.
    ///
    /// # Errors
    /// [`TensorError::ForeignVariable`] for fragments of another tape; [`RenderError::Shape`] for
    /// barycentrics that are not one row per fragment, positions not one per vertex, or weights not
    /// one per piece; [`RenderError::MissingWeights`] where these are missing.
    pub(crate) fn checked_coverage(
        &self,
        operation: &'static str,
        tape: &'t Tape<T>,
    ) -> Result<Arc<Coverage>, RenderError> {
        let variables = [Some(self.barycentrics), Some(self.clip), self.weight];
        if variables.iter().flatten().any(|variable| !std::ptr::eq(variable.tape(), tape)) {
            return Err(TensorError::ForeignVariable { operation }.into());
        }
        let (count, vertices) = (self.coverage.count(), self.coverage.mesh().vertex_count());
        let refused = |rule: String, variable: Var<'t, T>| {
            Err(RenderError::Shape { operation, rule, shape: variable.shape() })
        };
        if *self.barycentrics.shape() != [count, 2] {
            return refused(format!("barycentrics of shape [{count}, 2]"), self.barycentrics);
        }
        if *self.clip.shape() != [vertices, 4] {
            return refused(format!("clip positions of shape [{vertices}, 4]"), self.clip);
        }
        let pieces = count - self.coverage.centers();
        match self.weight {
            None if self.coverage.is_exact() => {
                return Err(RenderError::MissingWeights { operation, pieces });
            }
            Some(weight) if *weight.shape() != [pieces] => {
                return refused(format!("weights of shape [{pieces}]"), weight);
            }
            _ => {}
        }
        Ok(Arc::clone(&self.coverage))
    }
}

impl<T: Scalar> Fragments<'_, T> {
    /// The fragments without their tape, for other steps and other tapes: of geometry that does not
    /// change, which need be rasterized once. It copies nothing.
    pub fn still(&self) -> StillFragments<T> {
        StillFragments {
            barycentrics: self.barycentrics.value(),
            weight: self.weight.map(Var::value),
            clip: self.clip.value(),
            coverage: Arc::clone(&self.coverage),
        }
    }
}

/// The fragments of geometry that does not change, which outlive a step: see [`Fragments::still`].
#[derive(Clone)]
pub struct StillFragments<T: Scalar> {
    barycentrics: Tensor<T>,
    weight: Option<Tensor<T>>,
    clip: Tensor<T>,
    coverage: Arc<Coverage>,
}

impl<T: Scalar> fmt::Debug for StillFragments<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StillFragments").field("coverage", &self.coverage).finish_non_exhaustive()
    }
}

impl<T: Scalar> StillFragments<T> {
    /// The fragments on `tape`, as constants: every operation takes them, and none computes a gradient
    /// of the geometry. It copies nothing.
    pub fn on<'t>(&self, tape: &'t Tape<T>) -> Fragments<'t, T> {
        Fragments {
            barycentrics: tape.constant(&self.barycentrics),
            weight: self.weight.as_ref().map(|weight| tape.constant(weight)),
            clip: tape.constant(&self.clip),
            coverage: Arc::clone(&self.coverage),
        }
    }

    /// Which face each fragment lies on, and which pixel it belongs to.
    pub fn coverage(&self) -> &Arc<Coverage> {
        &self.coverage
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;
    use crate::antialias::antialias;
    use crate::background::Background;
    use crate::composite::composite;
    use crate::depth::depth;
    use crate::eye_depth::eye_depth;
    use crate::interpolate::interpolate;
    use crate::mesh::Mesh;
    use crate::raster_options::{RasterOptions, Sampling};
    use crate::rasterize::rasterize;
    use crate::size::Size;

    fn fragments(tape: &Tape<f64>) -> (Var<'_, f64>, Fragments<'_, f64>) {
        let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
        let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        (clip, rasterize(clip, &mesh, Size::square(6)).unwrap())
    }

    /// What every operation makes of fragments, and the gradient of the colours.
    fn drawn(fragments: &Fragments<'_, f64>) -> Vec<Tensor<f64>> {
        let tape = fragments.clip.tape();
        let colors = tape.leaf(&Tensor::from([[0.1, 0.5], [0.9, 0.2], [0.4, 0.7]]));
        let eye = eye_depth(fragments).unwrap();
        let surface = interpolate(colors, fragments).unwrap();
        let picture = composite(surface, fragments, Background::Zero).unwrap();
        let image = match fragments.weight {
            None => antialias(picture).unwrap().image().unwrap(),
            Some(_) => picture.image().unwrap(),
        };
        let gradients = image.square().sum().backward().unwrap();
        vec![
            image.value(),
            depth(fragments).unwrap().value(),
            eye.values().value(),
            eye.image(fragments, 5.0).unwrap().distances().value(),
            gradients.get(colors).unwrap().clone(),
        ]
    }

    #[test]
    fn still_fragments_are_the_same_to_every_operation_on_later_steps_and_other_tapes() {
        for sampling in [Sampling::Center, Sampling::Exact] {
            let mut tape = Tape::new();
            let (still, expected) = {
                let (clip, whole) = fragments(&tape);
                let options = RasterOptions::new(Size::square(6)).sampling(sampling);
                let fragments =
                    rasterize(clip, whole.coverage.mesh(), options.creases(&[])).unwrap();
                (fragments.still(), drawn(&fragments))
            };
            for _ in 0..2 {
                tape.reset();
                // What the step before has left is written over, but for what is still held.
                let (clip, whole) = fragments(&tape);
                let options = RasterOptions::new(Size::square(5)).sampling(sampling);
                rasterize(clip * 0.7, whole.coverage.mesh(), options.creases(&[])).unwrap();
                let again = still.on(&tape);
                assert!(!again.clip.needs_gradient() && !again.barycentrics.needs_gradient());
                assert_eq!(drawn(&again), expected);
            }
            let elsewhere = still.clone();
            let there = thread::spawn(move || drawn(&elsewhere.on(&Tape::new())));
            assert_eq!(there.join().unwrap(), expected);
            assert!(Arc::ptr_eq(still.coverage(), &still.on(&Tape::new()).coverage));
        }
    }

    #[test]
    fn nothing_covers_a_pixel_outside_the_image() {
        let tape = Tape::new();
        let (_, fragments) = fragments(&tape);
        let coverage = &fragments.coverage;
        assert!((0..36).any(|pixel| coverage.fragment_at(pixel).is_some()));
        assert!([36, 37, usize::MAX].iter().all(|&pixel| coverage.fragment_at(pixel).is_none()));
    }

    #[test]
    fn pieces_without_their_weights_are_refused() {
        let tape = Tape::new();
        let (clip, whole) = fragments(&tape);
        let options = RasterOptions::new(Size::square(6)).sampling(Sampling::Exact);
        let exact = rasterize(clip, whole.coverage.mesh(), options.creases(&[])).unwrap();
        let values = tape.leaf(&Tensor::full([exact.coverage.count(), 1], 0.5));
        let pieces = exact.coverage.count() - exact.coverage.centers();
        let lost = Fragments { weight: None, ..exact };
        let error = composite(values, &lost, Background::Zero).unwrap_err().to_string();
        let rule = format!("composite needs a weight for each of the {pieces} pieces");
        assert_eq!(error, format!("{rule} of exact coverage, got none"));
    }

    #[test]
    fn fragments_that_are_not_whole_or_of_another_tape_are_refused_by_every_operation() {
        let (tape, other) = (Tape::new(), Tape::new());
        let (_, whole) = fragments(&tape);
        let count = whole.coverage.count();
        let colors = tape.leaf(&Tensor::full([3, 1], 0.5));
        let values = tape.leaf(&Tensor::full([count, 1], 0.5));
        let messages = |fragments: &Fragments<'_, f64>| {
            [
                interpolate(colors, fragments).map(drop),
                composite(values, fragments, Background::Zero).map(drop),
            ]
            .map(|result| result.unwrap_err().to_string())
        };
        let few =
            Fragments { barycentrics: tape.leaf(&Tensor::zeros([count - 1, 2])), ..whole.clone() };
        let flat = Fragments { clip: tape.leaf(&Tensor::zeros([4, 3])), ..whole.clone() };
        let (_, foreign) = fragments(&other);
        let before = tape.len();
        for (at, operation) in ["interpolate", "composite"].iter().enumerate() {
            assert_eq!(
                messages(&few)[at],
                format!(
                    "{operation} needs barycentrics of shape [{count}, 2], got shape [{}, 2]",
                    count - 1
                )
            );
            assert_eq!(
                messages(&flat)[at],
                format!("{operation} needs clip positions of shape [3, 4], got shape [4, 3]")
            );
            assert_eq!(
                messages(&foreign)[at],
                format!("{operation} needs variables of one tape, got one of another")
            );
        }
        assert_eq!(tape.len(), before);
        // What is exchanged for its like is accepted.
        let moved = Fragments { clip: whole.clip * 0.5, ..whole };
        assert!(composite(values, &moved, Background::Zero).is_ok());
    }
}
