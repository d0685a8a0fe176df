//! Distances along the view axis at fragments.
//!
//! # Forward and backward
//! `w = sum_i b_i w_i` with the perspective-correct weights `b_i = a_i / sum_j a_j`: 1 / w is linear over
//! the image. That is a quotient of two functions that are linear over the image, `face_quotients` with
//! `n = w` and `m = 1`. It is computed of edge functions, and not of the barycentrics that were
//! rounded: where one vertex is much farther away than the others, its weight is what is left of 1. w is
//! linear over the face, so that for a piece of a boundary pixel, whose weights are means, it is the
//! mean.
//!
//! # Where it is not smooth
//! Where the visible face changes.
//!
//! # Source
//! Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, Graphics Hardware
//! 1997.

use bokashi_core::{Scalar, Var};

use crate::background::Background;
use crate::depth_image::DepthImage;
use crate::error::RenderError;
use crate::face_quotients::{Quotient, quotients};
use crate::fragments::Fragments;
use crate::homogeneous::Vertex;
use crate::picture::Composite;

const NAME: &str = "eye_depth";

/// Each fragment's distance along the view axis, differentiable with respect to the clip positions that
/// were rasterized. A piece of exact coverage has its mean distance.
///
/// It is the w of clip space, which is the distance, in units of the scene, for the matrices of
/// [`pinhole`](crate::pinhole()) and [`perspective`](crate::camera::perspective). An orthographic camera
/// has w = 1 everywhere. There interpolate the z of the vertices in camera coordinates instead, and make
/// a [`DepthImage::from_distances`].
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
#[inline(never)]
pub fn eye_depth<'t, T: Scalar>(
    fragments: &Fragments<'t, T>,
) -> Result<EyeDepth<'t, T>, RenderError> {
    Ok(EyeDepth { values: quotients::<T, Distance>(fragments)? })
}

/// Distances along the view axis at fragments: what [`eye_depth`] gives.
#[derive(Debug, Clone, Copy)]
pub struct EyeDepth<'t, T: Scalar> {
    values: Var<'t, T>,
}

impl<'t, T: Scalar> EyeDepth<'t, T> {
    /// A distance for each fragment, `[N]`, differentiable.
    pub fn values(self) -> Var<'t, T> {
        self.values
    }

    /// The image of the distances, `[H, W]`, before a background that is `far` away. A boundary pixel of
    /// exact coverage has the mean of what is seen in it, the background among it. Silhouettes of
    /// fragments at pixel centres are steps.
    ///
    /// # Errors
    /// - `TensorError::Value` unless `far` is positive, and with exact coverage finite.
    /// - [`RenderError::Shape`] for other fragments than the distances are of, and for fragments that are
    ///   not whole; `TensorError::ForeignVariable` for fragments of another tape.
    pub fn image(
        self,
        fragments: &Fragments<'t, T>,
        far: f64,
    ) -> Result<DepthImage<'t, T>, RenderError> {
        let rule = match fragments.weight {
            None => "a background at a distance above 0",
            Some(_) => "a background at a finite distance above 0",
        };
        let is_finite = T::from_f64(far).is_finite() || fragments.weight.is_none();
        if far.is_nan() || T::from_f64(far) <= T::ZERO || !is_finite {
            return Err(RenderError::value(NAME, rule, far));
        }
        let far = self.values.tape().constant_full([1], T::from_f64(far));
        let rows = self.values.reshape([self.values.shape().size(), 1])?;
        let picture = Composite::from_values(rows, fragments, Background::Color(far))?;
        let size = picture.size();
        Ok(DepthImage::from_distances(picture.image()?.reshape([size.height, size.width])?))
    }
}

struct Distance;

impl Quotient for Distance {
    const NAME: &'static str = NAME;

    /// A vertex that was multiplied has weights that were divided.
    #[inline(always)]
    fn terms<S: Scalar>(vertex: &Vertex<S>, factor: S) -> [S; 2] {
        [vertex.w, factor]
    }

    #[inline(always)]
    fn pull_back<S: Scalar>([n_bar, _]: [S; 2]) -> [S; 2] {
        [S::ZERO, n_bar]
    }

    /// What rasterization lets through lies before the eye.
    #[inline(always)]
    fn within_range<S: Scalar>(quotient: S) -> S {
        quotient.maximum_or_nan(S::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};
    use glam::{DMat4, DVec3};

    use super::*;
    use crate::camera::perspective;
    use crate::fixtures::surface;
    use crate::mesh::Mesh;
    use crate::project::project;
    use crate::raster_options::{RasterOptions, Sampling};
    use crate::rasterize::rasterize;
    use crate::size::Size;

    const SIZE: Size = Size { width: 9, height: 7 };

    /// A face in perspective, between 1.5 and 4 units before the eye, and its corners.
    const CORNERS: [[f64; 3]; 3] = [[-0.9, -0.6, -1.5], [1.4, -0.9, -2.5], [-0.2, 1.9, -4.0]];

    fn camera() -> DMat4 {
        perspective(0.9, 9.0 / 7.0, 0.1, 10.0)
    }

    fn fragments<T: Scalar>(tape: &Tape<T>, sampling: Sampling) -> Fragments<'_, T> {
        let positions = tape.leaf(&Tensor::<f64>::from(CORNERS).cast());
        let clip = project(positions, &camera(), None).unwrap();
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        rasterize(clip, &mesh, RasterOptions::new(SIZE).sampling(sampling).creases(&[])).unwrap()
    }

    /// How far along the view axis the ray through a pixel's centre meets the face.
    fn traced(pixel: usize) -> f64 {
        let [x, y] = SIZE.center::<f64>(pixel);
        let ndc = [x / SIZE.width as f64, y / SIZE.height as f64];
        let inverse = camera().inverse();
        let ray = inverse.project_point3(DVec3::new(ndc[0], ndc[1], 0.0));
        let [a, b, c] = CORNERS.map(DVec3::from);
        let normal = (b - a).cross(c - a);
        -(ray * (normal.dot(a) / normal.dot(ray))).z
    }

    #[test]
    fn it_is_the_distance_at_which_the_pixels_ray_meets_the_face() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape, Sampling::Center);
        let found = eye_depth(&fragments).unwrap().values().value();
        assert!(found.size() > 10);
        for (pixel, found) in fragments.coverage.pixels().zip(found.data()) {
            approx::assert_relative_eq!(*found, traced(pixel), max_relative = 1e-13);
        }
        let single = Tape::<f32>::new();
        let coarse = eye_depth(&self::fragments(&single, Sampling::Center)).unwrap().values();
        for (coarse, found) in coarse.value().data().iter().zip(found.data()) {
            approx::assert_relative_eq!(f64::from(*coarse), *found, max_relative = 1e-6);
        }
    }

    #[test]
    fn vertices_of_any_size_have_the_distances_of_their_w() {
        // A vertex times a number is seen at the same place, at another distance.
        let w = |scales: [f64; 3]| {
            let tape = Tape::<f64>::new();
            let places = [[-0.9, -0.8], [0.95, -0.7], [0.1, 0.9]];
            let clip = Tensor::from_flat_fn([3, 4], |k| {
                let [x, y] = places[k / 4];
                scales[k / 4] * [x, y, 0.0, 1.0][k % 4]
            });
            let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
            let fragments = rasterize(tape.leaf(&clip), &mesh, SIZE).unwrap();
            eye_depth(&fragments).unwrap().values().value().data().to_vec()
        };
        let expected = w([1.0, 2.0, 3.0]);
        for scale in [1e-200, 1e-70, 1e70, 1e200] {
            for (found, expected) in w([1.0, 2.0, 3.0].map(|w| scale * w)).iter().zip(&expected) {
                approx::assert_relative_eq!(*found, scale * expected, max_relative = 1e-13);
            }
        }
        // 1 / w is linear, so what is close to the first vertex is as close as it is.
        let near = w([1e-70, 1.0, 1.0]);
        let nearer = w([1e-72, 1.0, 1.0]);
        for (near, nearer) in near.iter().zip(nearer) {
            approx::assert_relative_eq!(near / nearer, 100.0, max_relative = 1e-12);
        }
    }

    #[test]
    fn an_image_of_distances_is_far_where_nothing_is_seen() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape, Sampling::Center);
        for far in [7.5, f64::INFINITY] {
            let image = eye_depth(&fragments).unwrap().image(&fragments, far).unwrap();
            let image = image.distances().value();
            assert_eq!(**image.shape(), [7, 9]);
            for (pixel, &found) in image.data().iter().enumerate() {
                match fragments.coverage.fragment_at(pixel) {
                    None => assert_eq!(found, far),
                    Some(_) => assert!((found - traced(pixel)).abs() < 1e-12),
                }
            }
        }
    }

    #[test]
    fn a_boundary_pixel_of_exact_coverage_has_the_mean_distance() {
        let tape = Tape::<f64>::new();
        let fragments = fragments(&tape, Sampling::Exact);
        let distances = eye_depth(&fragments).unwrap();
        let image = distances.image(&fragments, 7.5).unwrap().distances().value();
        let (values, weights) = (distances.values().value(), fragments.weight.unwrap().value());
        let centers = fragments.coverage.centers();
        let mut count = 0;
        for (pixel, pieces) in fragments.coverage.boundary() {
            let share = |piece: &u32| weights.data()[*piece as usize - centers];
            let seen: f64 = pieces.iter().map(|p| share(p) * values.data()[*p as usize]).sum();
            let rest = 1.0 - pieces.iter().map(share).sum::<f64>();
            approx::assert_relative_eq!(image.data()[pixel], seen + 7.5 * rest, epsilon = 1e-12);
            count += 1;
        }
        assert!(count > 10, "{count} boundary pixels");
    }

    #[test]
    fn what_cannot_be_is_refused_with_rule_and_value() {
        let tape = Tape::<f64>::new();
        let (whole, _) = surface(&tape);
        let distances = eye_depth(&whole).unwrap();
        for far in [0.0, -1.0, f64::NAN] {
            let error = distances.image(&whole, far).unwrap_err().to_string();
            assert_eq!(
                error,
                format!("eye_depth needs a background at a distance above 0, got {far}")
            );
        }
        let exact = fragments(&tape, Sampling::Exact);
        let error = eye_depth(&exact).unwrap().image(&exact, f64::INFINITY).unwrap_err();
        let rule = "eye_depth needs a background at a finite distance above 0, got inf";
        assert_eq!(error.to_string(), rule);
        // Distances of other fragments.
        let count = whole.coverage.count();
        let error = eye_depth(&exact).unwrap().image(&whole, 1.0).unwrap_err().to_string();
        let rule = format!("composite needs values of shape [{count}, C], C > 0, got shape");
        assert!(error.starts_with(&rule), "{error}");
        let lost = Fragments { weight: None, ..exact };
        assert!(matches!(eye_depth(&lost), Err(RenderError::MissingWeights { .. })));
    }
}
