//! A view's lens: how far beside the image it sees, and what it makes of surfaces one behind another.

use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Border, Filter, Fragments, Iris, LensLayer, LensPicture, RenderError, Size,
    ThinLens, ThinLensOptions, downsample, eye_depth, lens_picture,
};

use super::margin::{Surroundings, margin};
use super::view_camera::ViewCamera;
use crate::description::LensNumber;
use crate::learnables::{Recorded, Values};
use crate::scene::Scene;

/// A lens in a step, at one size of its image.
#[derive(Clone, Copy)]
pub(super) struct StepLens<'t> {
    lens: ThinLens<'t, f32>,
    options: ThinLensOptions,
    /// Whether it may have circles of confusion that are cut to the largest one.
    pub(super) may_cap: bool,
    /// How many hidden surfaces are drawn.
    pub(super) surfaces: usize,
    /// How many samples along each side of a pixel are drawn: margin and circles are counted in samples.
    samples: usize,
    /// Whether surfaces are blurred as they lean.
    slopes: bool,
}

/// Fragments, and their light.
#[derive(Clone)]
pub(super) struct Layer<'t> {
    pub(super) fragments: Fragments<'t, f32>,
    /// `[N, C]`.
    pub(super) light: Var<'t, f32>,
}

impl<'t> StepLens<'t> {
    /// The lens of a view whose image is made smaller `reduce` times; `None` where everything is in focus.
    pub(super) fn new(
        scene: &Scene,
        values: &Values<'t, '_>,
        camera: &ViewCamera<'_>,
        reduce: usize,
    ) -> Result<Option<Self>, FitError> {
        let Some(entry) = scene.description.pipeline.lens else { return Ok(None) };
        let number = |which| values.lens_number(scene, camera.view, which);
        let Some(focus) = number(LensNumber::Focus) else { return Ok(None) };
        // Lengths in pixels shrink with the image, and lengths in samples grow with their number.
        let samples = entry.sample_count();
        let share = samples as f64 / reduce as f64;
        let lens = match (number(LensNumber::Aperture), number(LensNumber::Radius)) {
            (Some(aperture), _) => ThinLens { aperture: aperture * share as f32, focus },
            (None, Some(radius)) => {
                let focal_length = camera.focal_length(values)? * samples as f32;
                ThinLens::from_radius(radius, focal_length, focus)?
            }
            (None, None) => return Ok(None),
        };
        if lens.aperture.item() == 0.0 {
            return Ok(None);
        }
        let usual = ThinLensOptions::default();
        let largest = entry.largest_radius.map_or(usual.largest_radius, |largest| largest.0);
        let iris = entry.iris.map_or(usual.iris, |iris| Iris::Polygon {
            blades: iris.blades.0,
            rotation: iris.rotation.map_or(0.0, |degrees| degrees.0.to_radians()),
        });
        let options = ThinLensOptions { largest_radius: largest * share, iris, ..usual };
        let (surfaces, slopes) = (entry.surface_count(), entry.slopes);
        Ok(Some(Self { lens, options, may_cap: false, surfaces, samples, slopes }))
    }

    /// The lens with the margin that it needs around an image of `size`: what these faces in clip space have
    /// beside it is blurred into it.
    pub(super) fn with_margin(
        mut self,
        clip: &Tensor<f32>,
        faces: &[[u32; 3]],
        size: Size,
        near: f64,
    ) -> Self {
        let ThinLens { aperture, focus } = self.lens;
        let [aperture, focus] = [aperture, focus].map(|number| f64::from(number.item()));
        let largest = self.options.largest_radius;
        let corner = self.options.iris.reach();
        let beside = Surroundings::new(self.sampled(size), corner * largest, near);
        let distances = beside.distances(clip, faces);
        // Circles grow from the focus towards both ends.
        let radius = |distance: f64| (aperture * (1.0 - focus / distance)).abs();
        let radius = distances.map(|[least, most]| radius(least).max(radius(most)));
        self.may_cap = radius.is_some_and(|radius| radius > largest);
        self.options.margin = radius.map_or(0, |radius| margin(corner * radius.min(largest)));
        self
    }

    /// The margin in samples.
    pub(super) fn margin(&self) -> usize {
        self.options.margin
    }

    /// The samples of an image.
    fn sampled(&self, size: Size) -> Size {
        let [width, height] = [size.width, size.height].map(|extent| extent * self.samples);
        Size { width, height }
    }

    /// The samples of an image with its margin.
    pub(super) fn size(&self, size: Size) -> Size {
        let Size { width, height } = self.sampled(size);
        let [width, height] = [width, height].map(|extent| extent + 2 * self.margin());
        Size { width, height }
    }

    /// Clip positions of an image of `size`, `[V, 4]`, in the image with its margin.
    pub(super) fn clip(&self, clip: Var<'t, f32>, size: Size) -> Recorded<'t> {
        let (size, whole) = (self.sampled(size), self.size(size));
        let share = |part: usize, whole: usize| (part as f64 / whole as f64) as f32;
        let row = [share(size.width, whole.width), share(size.height, whole.height), 1.0, 1.0];
        Ok(clip.try_mul(clip.tape().constant(&Tensor::from([row])))?)
    }

    /// The picture of what is visible and of the layers behind, before a background far away: the mean over each
    /// pixel's samples.
    pub(super) fn picture<'a>(
        &self,
        visible: &'a Layer<'t>,
        behind: &'a [Layer<'t>],
        background: Background<'t, f32>,
    ) -> Result<LensPicture<'t, f32>, RenderError> {
        let seen = |layer: &'a Layer<'t>| layer.seen(self.slopes);
        let behind = behind.iter().map(seen).collect::<Result<Vec<_>, _>>()?;
        let (visible, far) = (seen(visible)?, f64::INFINITY);
        let picture = lens_picture(visible, &behind, background, far, self.lens, &self.options)?;
        let image = downsample(picture.image, self.samples, &Filter::Box, Border::Clamp)?;
        Ok(LensPicture { image, ..picture })
    }
}

impl<'t> Layer<'t> {
    /// What a lens sees of it.
    fn seen(&self, slopes: bool) -> Result<LensLayer<'_, 't, f32>, RenderError> {
        let Self { fragments, light } = self;
        let alpha = light.tape().constant_full([fragments.coverage.count()], 1.0);
        if slopes {
            return LensLayer::from_fragments(fragments, *light, alpha);
        }
        let distance = eye_depth(fragments)?.values();
        Ok(LensLayer { fragments, premultiplied: *light, alpha, distance, slope: None })
    }
}
