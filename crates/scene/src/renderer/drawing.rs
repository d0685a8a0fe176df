//! A view of a scene, drawn: from numbers to an image.

use std::sync::Arc;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Blur, Cull, Fragments, Lens, LensOptions, Picture, Radius, RasterOptions,
    RenderError, Silhouettes, Size, Surface, depth_of_field, exposure, eye_depth, gaussian_blur,
    interpolate, rasterize, srgb_encode,
};
use glam::{DMat4, DVec3};

use super::frame::Frame;
use super::kept::Kept;
use super::lighting::Lighting;
use super::looks::{Asked, LookUp, LooksAtVertices};
use super::normals::{Moved, Normals, NormalsAtVertices};
use super::parts::Parts;
use super::sight::Sight;
use crate::description::{CullName, Silhouettes as SilhouettesName, SurfaceModel, Tone};
use crate::error::SceneError;
use crate::object::Object;
use crate::scene::Scene;
use crate::values::{Recorded, Values, of_object};

/// A scene, ready to be drawn: what no step changes is worked out once.
pub struct Renderer {
    scene: Arc<Scene>,
    frame: Frame,
    parts: Parts,
    looks: LookUp,
    normals: Normals,
    lighting: Lighting,
    kept: Kept,
}

/// What is interpolated between vertices.
#[derive(Clone, Copy)]
struct AtVertices<'t, 'a> {
    looks: LooksAtVertices<'t, 'a>,
    /// Where there is light.
    normals: Option<NormalsAtVertices<'t, 'a>>,
}

/// A view, drawn.
pub struct Drawn<'t> {
    /// Its fragments.
    pub fragments: Fragments<'t, f32>,
    /// Light, before lens, blur and tone. A fourth channel is 1 where the objects are.
    pub light: Picture<'t, f32>,
    /// The vertices in the world.
    pub(crate) world: Var<'t, f32>,
}

impl Renderer {
    /// What draws `scene`.
    ///
    /// # Errors
    /// [`SceneError::Render`] for meshes or an environment of a size that the engine refuses.
    pub fn new(scene: Arc<Scene>) -> Result<Self, SceneError> {
        let frame = Frame::of(&scene);
        let parts = Parts::of(&scene.objects, frame.origin)?;
        let filter = scene.description.pipeline.texture_filter;
        Ok(Self {
            frame,
            looks: LookUp::of(&parts, &scene.objects, filter)?,
            normals: Normals::of(&parts, &scene)?,
            lighting: Lighting::of(&scene)?,
            kept: Kept::default(),
            parts,
            scene,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The radius of the scene.
    pub fn radius(&self) -> f64 {
        self.frame.radius
    }

    /// The middle of the scene.
    pub(crate) fn center(&self) -> DVec3 {
        self.frame.origin + self.frame.center
    }

    /// The middles of objects in the world.
    pub(crate) fn middles(&self) -> impl Iterator<Item = DVec3> {
        self.frame.middles.iter().map(|middle| self.frame.origin + middle)
    }

    /// The size of a view whose image is made smaller `reduce` times along each axis.
    pub fn size(&self, view: usize, reduce: usize) -> Size {
        self.scene.views[view].camera.scaled(reduce).size
    }

    /// The background as pixels stand for it, with 0 in a fourth channel.
    ///
    /// # Errors
    /// None: those of tone curves.
    pub fn background(&self, channels: usize) -> Result<Tensor<f32>, SceneError> {
        let tape = Tape::new();
        let own = self.behind(channels);
        Ok(self
            .toned(tape.constant(&Tensor::new([1, channels], own).map_err(RenderError::from)?))?
            .reshape([channels])
            .map_err(RenderError::from)?
            .value())
    }

    /// The light of the background, with 0 in a fourth channel.
    fn behind(&self, channels: usize) -> Vec<f32> {
        let own = self.scene.description.pipeline.background;
        let mut behind = own.map_or([0.0; 3], |color| color.map(|x| x.0 as f32)).to_vec();
        behind.resize(channels, 0.0);
        behind
    }

    /// How silhouettes look.
    fn silhouettes(&self) -> Silhouettes {
        match self.scene.description.pipeline.silhouettes {
            SilhouettesName::Aliased => Silhouettes::Aliased,
            SilhouettesName::Antialias => Silhouettes::Antialias,
            SilhouettesName::Exact => Silhouettes::Exact,
        }
    }

    /// How a view is rasterized.
    fn options(&self, size: Size) -> RasterOptions {
        let pipeline = &self.scene.description.pipeline;
        let cull = match pipeline.cull {
            CullName::None => Cull::None,
            CullName::Back => Cull::Back,
        };
        RasterOptions::new(size).cull(cull).silhouettes(self.silhouettes())
    }

    /// Draws a view whose image is made smaller `reduce` times along each axis; `with_mask` adds a fourth
    /// channel that is 1 where the objects are.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn draw<'t>(
        &self,
        values: &Values<'t, '_>,
        view: usize,
        reduce: usize,
        with_mask: bool,
    ) -> Result<Drawn<'t>, FitError> {
        self.drawn(values, (view, reduce), with_mask, None)
    }

    /// As [`Renderer::draw`], for a step of many: where neither geometry nor cameras are learnt, a view's
    /// fragments are kept, as far as a budget of memory goes. That changes no bit.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub(crate) fn draw_again<'t>(
        &self,
        values: &Values<'t, '_>,
        view: usize,
        reduce: usize,
        with_mask: bool,
    ) -> Result<Drawn<'t>, FitError> {
        let kept = self.is_still(values).then_some(&self.kept);
        self.drawn(values, (view, reduce), with_mask, kept)
    }

    /// Draws a view, with its fragments from what is kept where there is that.
    fn drawn<'t>(
        &self,
        values: &Values<'t, '_>,
        key @ (view, reduce): (usize, usize),
        with_mask: bool,
        kept: Option<&Kept>,
    ) -> Result<Drawn<'t>, FitError> {
        let world = self.parts.world(&self.scene.objects, &self.frame, values)?;
        let at_vertices = self.at_vertices(values, world)?;
        let mut camera = self.scene.views[view].camera.scaled(reduce);
        camera.view *= DMat4::from_translation(self.frame.origin);
        let seen = Sight { frame: &self.frame, view, camera }.seen(values)?;
        let fragments = match kept.and_then(|kept| kept.get(key)) {
            Some(still) => still.on(values.tape),
            None => {
                let clip = seen.clip(world)?;
                let fragments = self.fragments(clip, at_vertices, camera.size)?;
                if let Some(kept) = kept {
                    kept.keep(key, fragments.still());
                }
                fragments
            }
        };
        let light = self.light(values, at_vertices, world, seen.eye()?, &fragments)?;
        self.shown(values, world, light, fragments, with_mask)
    }

    /// Whether neither geometry nor cameras are learnt, nor colours that may have creases.
    fn is_still(&self, values: &Values<'_, '_>) -> bool {
        let moves = |name: &str| values.learnt(name).is_some();
        let kinds = match self.silhouettes() {
            Silhouettes::Exact => &["vertices", "pose", "colors"][..],
            _ => &["vertices", "pose"],
        };
        let is_moved =
            |object: &Object| kinds.iter().any(|kind| moves(&of_object(kind, &object.name)));
        !["cameras", "intrinsics", "distortion"].into_iter().any(moves)
            && !self.scene.objects.iter().any(is_moved)
    }

    /// What is interpolated between vertices.
    fn at_vertices<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
    ) -> Result<AtVertices<'t, '_>, FitError> {
        let moved = Moved { objects: &self.scene.objects, frame: &self.frame, values };
        let normals = self.lighting.is_lit().then(|| self.normals.at_vertices(world, moved));
        Ok(AtVertices {
            looks: self.looks.at_vertices(&self.parts, &self.scene.objects, values)?,
            normals: normals.transpose()?,
        })
    }

    /// Fragments of vertices in clip space, that will show what is at the vertices.
    fn fragments<'t>(
        &self,
        clip: Var<'t, f32>,
        AtVertices { looks, normals }: AtVertices<'t, '_>,
        size: Size,
    ) -> Result<Fragments<'t, f32>, FitError> {
        let shown = [looks.colors, looks.coordinates, normals.map(|own| own.normals)];
        let shown: Vec<_> =
            shown.into_iter().flatten().map(|own| (own.rows, own.indices).into()).collect();
        let options = self.options(size);
        Ok(rasterize(clip, self.parts.assembly.mesh(), options.creases(&shown))?)
    }

    /// A view of fragments with this light, `[N, 3]`.
    fn shown<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
        light: Var<'t, f32>,
        fragments: Fragments<'t, f32>,
        with_mask: bool,
    ) -> Result<Drawn<'t>, FitError> {
        let tape = values.tape;
        let mut surface = match self.scene.description.pipeline.exposure {
            None if values.learnt("exposure").is_none() => light,
            own => exposure(light, values.number("exposure", own.map_or(0.0, |x| x.0)))?,
        };
        if with_mask {
            let ones = tape.constant_full([fragments.coverage.count(), 1], 1.0);
            surface = Var::concat(&[surface, ones], 1)?;
        }
        let behind = self.behind(if with_mask { 4 } else { 3 });
        let background = Background::Color(tape.constant(&Tensor::from(behind.as_slice())));
        let light = fragments.picture(surface, background)?;
        Ok(Drawn { fragments, light, world })
    }

    /// Whether a picture goes through operations that see its neighbours: it is then an image.
    pub fn is_dense(&self, values: &Values<'_, '_>) -> bool {
        let pipeline = &self.scene.description.pipeline;
        let is_learnt =
            ["blur", "aperture", "focus"].iter().any(|name| values.learnt(name).is_some());
        pipeline.blur.is_some() || pipeline.lens.is_some() || is_learnt
    }

    /// The picture's light as pixels stand for it; the fourth channel stays as it is.
    pub fn toned<'t>(&self, light: Var<'t, f32>) -> Result<Var<'t, f32>, RenderError> {
        if self.scene.description.pipeline.tone == Tone::Linear {
            return Ok(light);
        }
        let axis = light.shape().len() - 1;
        let channels = light.shape()[axis];
        let colors = if channels == 3 { light } else { light.slice(axis, 0..3)? };
        let encoded = srgb_encode(colors.clamp(0.0, 1.0)?)?;
        match channels {
            3 => Ok(encoded),
            _ => Ok(Var::concat(&[encoded, light.slice(axis, 3..channels)?], axis)?),
        }
    }

    /// The image of a drawn view, `[H, W, 3]` or with a fourth channel, through lens, blur and tone.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn image<'t>(
        &self,
        values: &Values<'t, '_>,
        drawn: &Drawn<'t>,
        reduce: usize,
    ) -> Recorded<'t> {
        let pipeline = &self.scene.description.pipeline;
        if !self.is_dense(values) {
            return Ok(drawn.light.map(|light| self.toned(light))?.image()?);
        }
        let mut image = drawn.light.image()?;
        // Lengths in pixels shrink with the image.
        let share = 1.0 / reduce as f32;
        if let Some(lens) = pipeline.lens {
            let far = 1e3 * self.frame.radius;
            let distances = eye_depth(&drawn.fragments)?.image(&drawn.fragments, far)?;
            let options = LensOptions {
                radius: Radius::Tolerance(lens.tolerance.map_or(1e-3, |tolerance| tolerance.0)),
                ..LensOptions::default()
            };
            let lens = Lens {
                aperture: values.number("aperture", lens.aperture.0) * share,
                focus: values.number("focus", lens.focus.0),
            };
            image = depth_of_field(image, distances, lens, &options)?.image;
        }
        if let Some(blur) = pipeline.blur {
            let sigma = values.number("blur", blur.0) * share;
            image = gaussian_blur(image, sigma, &Blur::default())?;
        }
        Ok(self.toned(image)?)
    }

    /// What the fragments send to the eye, `[N, 3]`.
    fn light<'t>(
        &self,
        values: &Values<'t, '_>,
        at_vertices: AtVertices<'t, '_>,
        world: Var<'t, f32>,
        eye: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let objects = &self.scene.objects;
        let reflection = self.lighting.model == SurfaceModel::MetallicRoughness;
        let asked = Asked { reflection, normals: self.lighting.is_lit() };
        let at = at_vertices.looks;
        let looks = self.looks.at(&self.parts, objects, values, at, fragments, asked)?;
        let Some(normals) = at_vertices.normals else { return Ok(looks.base_color) };
        let normals = self.normals.at(normals, fragments, looks.normals)?;
        let positions = interpolate(world, fragments)?;
        let views = eye.try_sub(positions)?;
        let surface = Surface { normals, views, positions: Some(positions) };
        self.lighting.of_surface(&self.scene, values, self.frame.origin, &surface, &looks)
    }

    /// Normals of the surface at the fragments in the world, `[N, 3]`, of any length, without normal maps.
    pub(crate) fn normals<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let moved = Moved { objects: &self.scene.objects, frame: &self.frame, values };
        self.normals.at(self.normals.at_vertices(world, moved)?, fragments, None)
    }

    /// Which of the instances of all objects a face belongs to.
    pub(crate) fn instance(&self, face: usize) -> Option<usize> {
        self.parts.instance(face)
    }
}
