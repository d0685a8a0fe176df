//! A view of a scene, drawn: from numbers to an image.

use std::sync::Arc;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{FitError, Variables};
use bokashi_render_ops::{
    Background, Blur, Cull, Fragments, Kernel, LensPicture, Picture, RasterOptions, RenderError,
    Silhouettes, Size, Surface, depth_layers, exposure, gaussian_blur, interpolate, rasterize,
    srgb_encode,
};
use glam::DMat4;

use super::fragment_cache::{FragmentCache, Key};
use super::lens::{Layer, StepLens};
use super::lighting::Lighting;
use super::materials::{Indexed, MaterialSampler, VertexAttributes, Wanted};
use super::normals::{MotionContext, Normals, VertexNormals};
use super::parts::Parts;
use super::view_camera::{StepCamera, ViewCamera};
use crate::description::{CullName, KernelName, SilhouettesName, SurfaceModel, Tone};
use crate::error::SceneError;
use crate::learnables::{BLUR, Frame, Learnable, Moves, Recorded, TABLE, Values};
use crate::scene::Scene;

/// A scene, ready to be drawn: what no step changes is worked out once.
pub struct Renderer {
    scene: Arc<Scene>,
    frame: Frame,
    parts: Parts,
    materials: MaterialSampler,
    normals: Normals,
    lighting: Arc<Lighting>,
    cache: FragmentCache,
}

/// What is interpolated between vertices.
#[derive(Clone, Copy)]
struct Interpolated<'t, 'a> {
    attributes: VertexAttributes<'t, 'a>,
    /// Where there is light.
    normals: Option<VertexNormals<'t, 'a>>,
}

/// A view, drawn.
pub struct Drawn<'t> {
    /// What is visible, where a lens is in the way with a margin around the image.
    visible: Layer<'t>,
    background: Background<'t, f32>,
    /// The lens, and the layers behind what is visible.
    lens: Option<(StepLens<'t>, Vec<Layer<'t>>)>,
    /// The vertices in the world.
    pub(crate) world: Var<'t, f32>,
}

impl<'t> Drawn<'t> {
    /// Its fragments. Behind a lens their image has a margin.
    pub fn fragments(&self) -> &Fragments<'t, f32> {
        &self.visible.fragments
    }

    /// Whether all of it is in focus.
    pub(crate) fn is_sharp(&self) -> bool {
        self.lens.is_none()
    }

    /// What its lens makes of it; `None` where all of it is in focus.
    fn lens_picture(&self) -> Result<Option<LensPicture<'t, f32>>, RenderError> {
        let Some((lens, behind)) = &self.lens else { return Ok(None) };
        lens.picture(&self.visible, behind, self.background).map(Some)
    }

    /// Light, before lens, blur and tone. A fourth channel is 1 where the objects are.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn light(&self) -> Result<Picture<'t, f32>, RenderError> {
        self.visible.fragments.picture(self.visible.light, self.background)
    }
}

/// What is drawn of a view.
#[derive(Clone, Copy)]
struct Request<'a> {
    view: usize,
    /// How many times smaller its image is.
    reduce: usize,
    /// Whether a fourth channel is 1 where the objects are.
    with_mask: bool,
    /// Whether it is seen through its lens.
    with_lens: bool,
    cache: Option<&'a FragmentCache>,
}

impl Renderer {
    /// What draws `scene`.
    ///
    /// # Errors
    /// [`SceneError::Render`] for meshes or an environment of a size that the engine refuses.
    pub fn new(scene: Arc<Scene>) -> Result<Self, SceneError> {
        let frame = Frame::new(&scene);
        Self::with_frame(scene, frame)
    }

    /// What draws `scene`, whose meshes were others when it had these measures.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub(crate) fn with_frame(scene: Arc<Scene>, frame: Frame) -> Result<Self, SceneError> {
        let lighting = Arc::new(Lighting::new(&scene)?);
        Self::with_lighting(scene, frame, lighting)
    }

    /// As [`Renderer::with_frame`], with the lighting of another scene whose lights are the same.
    pub(super) fn with_lighting(
        scene: Arc<Scene>,
        frame: Frame,
        lighting: Arc<Lighting>,
    ) -> Result<Self, SceneError> {
        let parts = Parts::new(&scene.objects, frame.origin)?;
        let filter = scene.description.pipeline.texture_filter;
        Ok(Self {
            frame,
            materials: MaterialSampler::new(&parts, &scene.objects, filter)?,
            normals: Normals::new(&parts, &scene)?,
            lighting,
            cache: FragmentCache::default(),
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

    /// The measures of the scene.
    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The objects as one mesh.
    pub(super) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// The lighting, shared.
    pub(super) fn lighting(&self) -> Arc<Lighting> {
        Arc::clone(&self.lighting)
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
        let light = self.behind(channels);
        Ok(self
            .toned(tape.constant(&Tensor::new([1, channels], light).map_err(RenderError::from)?))?
            .reshape([channels])
            .map_err(RenderError::from)?
            .value())
    }

    /// The light of the background, with 0 in a fourth channel.
    fn behind(&self, channels: usize) -> Vec<f32> {
        let background = self.scene.description.pipeline.background;
        let mut behind = background.map_or([0.0; 3], |color| color.map(|x| x.0 as f32)).to_vec();
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
        let request = Request { view, reduce, with_mask, with_lens: true, cache: None };
        self.draw_request(values, request)
    }

    /// As [`Renderer::draw`], with everything in focus.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub(crate) fn draw_sharp<'t>(
        &self,
        values: &Values<'t, '_>,
        view: usize,
    ) -> Result<Drawn<'t>, FitError> {
        let request = Request { view, reduce: 1, with_mask: true, with_lens: false, cache: None };
        self.draw_request(values, request)
    }

    /// As [`Renderer::draw`], for a step of many: where neither geometry nor cameras are learnt, a view's
    /// fragments are kept, as far as a budget of memory goes, and the normals at the vertices. That changes no bit.
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
        let cache = self.is_frozen(values).then_some(&self.cache);
        self.draw_request(values, Request { view, reduce, with_mask, with_lens: true, cache })
    }

    /// The variables of a step with all levels of the textures that are learnt in the place of their texels. `None` where
    /// they stay as they are.
    ///
    /// # Errors
    /// What the operations refuse.
    pub(crate) fn share_values<'t>(
        &self,
        values: &Values<'t, '_>,
    ) -> Result<Option<Variables<'t, f32>>, FitError> {
        self.materials.share_levels(&self.scene.objects, values)
    }

    fn draw_request<'t>(
        &self,
        values: &Values<'t, '_>,
        request: Request<'_>,
    ) -> Result<Drawn<'t>, FitError> {
        if let Some(surfaces) = self.on_surfaces(values)? {
            let values = Values { learnt: Some(&surfaces.variables), ..*values };
            // What is kept is of this renderer's meshes.
            let request = Request { cache: None, ..request };
            return surfaces.renderer.as_ref().unwrap_or(self).draw_request(&values, request);
        }
        let Request { view, reduce, with_mask, with_lens, cache } = request;
        let world = self.parts.world(&self.scene.objects, &self.frame, values)?;
        let interpolated = self.interpolated(values, world, cache)?;
        let view_camera = self.view_camera(view, reduce);
        let size = view_camera.camera.size;
        let step_camera = view_camera.in_step(values)?;
        let lens = match with_lens {
            true => self.lens(values, world, (&view_camera, &step_camera), reduce)?,
            false => None,
        };
        let (lens, clip) = lens.unzip();
        let key = Key { view, reduce, margin: lens.map_or(0, |lens| lens.margin()) };
        let layers: Vec<_> = match cache.and_then(|cache| cache.get(key)) {
            Some(layers) => layers.iter().map(|layer| layer.on(values.tape)).collect(),
            None => {
                let clip = clip.map_or_else(|| step_camera.clip(world), Ok)?;
                let layers = self.layers(clip, interpolated, size, lens)?;
                if let Some(cache) = cache {
                    cache.insert(key, layers.iter().map(Fragments::constant).collect());
                }
                layers
            }
        };
        let eye = step_camera.eye()?;
        let stops = values.stops(&self.scene, view)?;
        let mut lit = self.lit(values, interpolated, [world, eye], layers, (stops, with_mask))?;
        let behind = lit.split_off(1);
        let visible = lit.swap_remove(0);
        let background = self.behind(if with_mask { 4 } else { 3 });
        let background = Background::Color(values.tape.constant(&background.as_slice().into()));
        Ok(Drawn { visible, background, lens: lens.map(|lens| (lens, behind)), world })
    }

    /// A view's camera, with its image made smaller `reduce` times.
    pub(super) fn view_camera(&self, view: usize, reduce: usize) -> ViewCamera<'_> {
        let mut camera = self.scene.views[view].camera.scaled(reduce);
        camera.view *= DMat4::from_translation(self.frame.origin);
        ViewCamera { frame: &self.frame, view, camera }
    }

    /// A view's lens with its margin, and the vertices in clip space; `None` where everything is in focus.
    fn lens<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
        (camera, step_camera): (&ViewCamera<'_>, &StepCamera<'t>),
        reduce: usize,
    ) -> Result<Option<(StepLens<'t>, Var<'t, f32>)>, FitError> {
        let lens = StepLens::new(&self.scene, values, camera, reduce)?;
        let Some(lens) = lens else { return Ok(None) };
        let clip = step_camera.clip(world)?;
        let faces = self.parts.assembly.mesh().faces();
        let lens = lens.with_margin(&clip.value(), faces, camera.camera.size, self.frame.near);
        Ok(Some((lens, clip)))
    }

    /// How many circles of confusion a view's lens cuts to the largest one. Only where it may cut some, the view
    /// is drawn.
    pub(crate) fn capped(&self, values: &Values<'_, '_>, view: usize) -> Result<usize, FitError> {
        let world = self.parts.world(&self.scene.objects, &self.frame, values)?;
        let camera = self.view_camera(view, 1);
        let lens = self.lens(values, world, (&camera, &camera.in_step(values)?), 1)?;
        if !lens.is_some_and(|(lens, _)| lens.may_cap) {
            return Ok(0);
        }
        let picture = self.draw(values, view, 1, false)?.lens_picture()?;
        Ok(picture.map_or(0, |picture| picture.capped))
    }

    /// Layers with their light, multiplied by some stops; `with_mask` adds a fourth channel of 1.
    fn lit<'t>(
        &self,
        values: &Values<'t, '_>,
        interpolated: Interpolated<'t, '_>,
        [world, eye]: [Var<'t, f32>; 2],
        layers: Vec<Fragments<'t, f32>>,
        (stops, with_mask): (Option<Var<'t, f32>>, bool),
    ) -> Result<Vec<Layer<'t>>, FitError> {
        let channels = if with_mask { 4 } else { 3 };
        let lit = layers.into_iter().enumerate().map(|(k, fragments)| {
            let light = match k {
                // It says what hides what, and its light is not asked for.
                1 => values.tape.constant_full([fragments.coverage.count(), channels], 0.0),
                _ => {
                    let light = self.light(values, interpolated, world, eye, &fragments)?;
                    let light = stops.map_or(Ok(light), |stops| exposure(light, stops))?;
                    match with_mask {
                        true => {
                            let ones = values.tape.constant_full([light.shape()[0], 1], 1.0);
                            Var::concat(&[light, ones], 1)?
                        }
                        false => light,
                    }
                }
            };
            Ok(Layer { fragments, light })
        });
        lit.collect()
    }

    /// Whether nothing is learnt that changes fragments: where vertices are seen, or with exact silhouettes where
    /// colours may have creases.
    fn is_frozen(&self, values: &Values<'_, '_>) -> bool {
        let sees_creases = self.silhouettes() == Silhouettes::Exact;
        let changes = |row: &Learnable| match row.moves {
            Moves::Vertices => true,
            Moves::Creases => sees_creases,
            Moves::Nothing => false,
        };
        !TABLE.iter().any(|row| changes(row) && values.learns(row, &self.scene))
    }

    /// What is interpolated between vertices.
    fn interpolated<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
        cache: Option<&FragmentCache>,
    ) -> Result<Interpolated<'t, '_>, FitError> {
        let objects = &self.scene.objects;
        let context = MotionContext { objects, frame: &self.frame, values };
        let kept = cache.map(FragmentCache::normals);
        let normals =
            self.lighting.is_lit().then(|| self.normals.vertex_normals(world, context, kept));
        Ok(Interpolated {
            attributes: self.materials.vertex_attributes(&self.parts, objects, values)?,
            normals: normals.transpose()?,
        })
    }

    /// Fragments of vertices in clip space, that will show what is at the vertices.
    fn fragments<'t>(
        &self,
        clip: Var<'t, f32>,
        Interpolated { attributes, normals }: Interpolated<'t, '_>,
        size: Size,
    ) -> Result<Fragments<'t, f32>, FitError> {
        let normals = normals.map(|corners| corners.normals);
        let shown = [attributes.colors, attributes.coordinates, normals].into_iter().flatten();
        let shown: Vec<_> = shown.map(|Indexed { rows, indices }| (rows, indices).into()).collect();
        let options = self.options(size);
        Ok(rasterize(clip, self.parts.assembly.mesh(), options.creases(&shown))?)
    }

    /// What is visible of vertices in clip space, and with a lens the layers at pixel centres, of which the first
    /// shows the same.
    fn layers<'t>(
        &self,
        clip: Var<'t, f32>,
        interpolated: Interpolated<'t, '_>,
        size: Size,
        lens: Option<StepLens<'t>>,
    ) -> Result<Vec<Fragments<'t, f32>>, FitError> {
        let Some(lens) = lens else { return Ok(vec![self.fragments(clip, interpolated, size)?]) };
        let (clip, size) = (lens.clip(clip, size)?, lens.size(size));
        let mut layers = vec![self.fragments(clip, interpolated, size)?];
        if lens.surfaces > 0 {
            let options = self.options(size).silhouettes(Silhouettes::Aliased);
            let most = Some(lens.surfaces + 1);
            layers.extend(depth_layers(clip, self.parts.assembly.mesh(), options, most)?);
        }
        Ok(layers)
    }

    /// Whether a picture goes through operations that see its neighbours: it is then an image.
    pub fn is_dense(&self) -> bool {
        let description = &self.scene.description;
        let is_learnt = description.learn.lens.is_some();
        let has_lens = description.pipeline.lens.is_some_and(|lens| {
            let own = self.scene.views.iter().filter_map(|view| view.lens.opening);
            is_learnt || own.chain([lens.opening]).any(|opening| opening.number() > 0.0)
        });
        description.pipeline.blur.is_some() || has_lens
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
        if !self.is_dense() {
            return Ok(drawn.light()?.map(|light| self.toned(light))?.image()?);
        }
        let mut image = match drawn.lens_picture()? {
            Some(picture) => picture.image,
            None => drawn.light()?.image()?,
        };
        let pipeline = &self.scene.description.pipeline;
        if let Some(blur) = pipeline.blur {
            // Lengths in pixels shrink with the image.
            let share = 1.0 / reduce as f32;
            let sigma = values.number(&BLUR, "", blur.0) * share;
            let kernel = match pipeline.blur_kernel {
                KernelName::Sampled => Kernel::Sampled,
                KernelName::Discrete => Kernel::Discrete,
                KernelName::Disc => Kernel::Disc,
            };
            image = gaussian_blur(image, sigma, &Blur { kernel, ..Blur::default() })?;
        }
        Ok(self.toned(image)?)
    }

    /// What the fragments send to the eye, `[N, 3]`.
    fn light<'t>(
        &self,
        values: &Values<'t, '_>,
        interpolated: Interpolated<'t, '_>,
        world: Var<'t, f32>,
        eye: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let objects = &self.scene.objects;
        let reflection = self.lighting.model == SurfaceModel::MetallicRoughness;
        let wanted = Wanted { reflection, normals: self.lighting.is_lit() };
        let Interpolated { attributes, normals } = interpolated;
        let (parts, sampler) = (&self.parts, &self.materials);
        let samples = sampler.sample(parts, objects, values, attributes, fragments, wanted)?;
        let Some(normals) = normals else { return Ok(samples.base_color) };
        let normals = self.normals.at_fragments(normals, fragments, samples.normals)?;
        let positions = interpolate(world, fragments)?;
        let views = eye.try_sub(positions)?;
        let surface = Surface { normals, views, positions: Some(positions) };
        self.lighting.shade(&self.scene, values, self.frame.origin, &surface, &samples)
    }

    /// Normals of the surface at the fragments in the world, `[N, 3]`, of any length, without normal maps.
    pub(crate) fn normals<'t>(
        &self,
        values: &Values<'t, '_>,
        world: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let context = MotionContext { objects: &self.scene.objects, frame: &self.frame, values };
        let normals = self.normals.vertex_normals(world, context, None)?;
        self.normals.at_fragments(normals, fragments, None)
    }

    /// Which of the instances of all objects a face belongs to.
    pub(crate) fn instance(&self, face: usize) -> Option<usize> {
        self.parts.instance(face)
    }
}
