//! From the numbers of a scene to pictures.
//!
//! All objects are drawn as one mesh, so that one visibility decides what is in front. Each material is
//! looked up at its own fragments alone, and light is worked out once for all of them.

use std::sync::Arc;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::camera::{from_tensor, to_tensor};
use bokashi_render_ops::{
    Assembly, Background, Blur, Camera as Projection, Cull, Detail, Environment, Fragments, Lens,
    LensOptions, Light, Material, Mesh, Picture, Prefilter, Radius, RasterOptions, RenderError,
    Sampler, Sampling, Size, Surface, Texture, TextureFilter, Weighting, affine_inverse, antialias,
    composite, depth_of_field, differentials, distort, exposure, eye_depth, gaussian_blur,
    interpolate, interpolate_differentials_indexed, interpolate_indexed, pinhole, project,
    rasterize, sample_texture, se3, shade, srgb_encode, transform_points, vertex_normals,
};
use glam::{DMat4, DVec3};

use crate::cameras::Camera;
use crate::description::{CullName, FilterName, LightEntry, Silhouettes, SurfaceModel, Tone};
use crate::error::SceneError;
use crate::object::{Attribute, Object};
use crate::scene::Scene;
use crate::values::{Recorded, Values, of_object};

/// The coarsest mirror image of an environment is this many halvings smaller.
const ENVIRONMENT_LEVELS: usize = 4;

/// A scene, ready to be drawn: what no step changes is worked out once.
pub struct Renderer {
    scene: Arc<Scene>,
    assembly: Assembly,
    /// Whether some objects have them, and the index buffers of all objects' numbers, one after another.
    colors: Option<Joint>,
    coordinates: Option<Joint>,
    smoothing: Smoothing,
    model: SurfaceModel,
    prefilter: Option<Prefilter<f32>>,
    /// The middles of objects in the world.
    middles: Vec<DVec3>,
    center: DVec3,
    radius: f64,
    near: f64,
    far: f64,
}

/// Attributes of all objects with one index buffer; an object without them has a row of its own.
struct Joint {
    indices: Mesh,
}

/// Which corners share a normal: all at a vertex, or those that share one in the object's file.
struct Smoothing {
    mesh: Mesh,
    /// The vertex of each normal, where these are not the vertices themselves.
    vertices: Option<Arc<[u32]>>,
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
        let objects = &scene.objects;
        let parts: Vec<_> =
            objects.iter().map(|object| (&object.mesh, object.places.len())).collect();
        let assembly = Assembly::new(&parts)?;
        let joint = |pick: fn(&Object) -> Option<&Attribute>| -> Result<_, SceneError> {
            if objects.iter().all(|object| pick(object).is_none()) {
                return Ok(None);
            }
            let own = objects.iter().map(|object| match pick(object) {
                Some(attribute) => Ok(attribute.indices.clone()),
                // One row for all corners.
                None => Mesh::new(vec![[0; 3]; object.mesh.faces().len()], 1),
            });
            let own = own.collect::<Result<Vec<_>, _>>()?;
            let indices = assembly.attributes(&own.iter().collect::<Vec<_>>())?;
            Ok(Some(Joint { indices }))
        };
        let colors = joint(|object| object.colors.as_ref())?;
        let coordinates = joint(|object| object.coordinates.as_ref())?;
        let (center, radius) = scene.ball();
        let pipeline = &scene.description.pipeline;
        let is_lit = !scene.description.lights.is_empty() || scene.environment.is_some();
        let default = if is_lit { SurfaceModel::MetallicRoughness } else { SurfaceModel::Unlit };
        let side = scene.environment.as_ref().map(|texels| texels.shape()[1]);
        let middle = |object: &Object| object.extent().map_or(center, |[a, b]| 0.5 * (a + b));
        Ok(Self {
            smoothing: Smoothing::new(&assembly, objects)?,
            colors,
            coordinates,
            model: pipeline.surface.unwrap_or(default),
            prefilter: side.map(|side| Prefilter::new(side, ENVIRONMENT_LEVELS)).transpose()?,
            middles: objects.iter().map(middle).collect(),
            near: pipeline.near.map_or(2e-3 * radius, |near| near.0),
            far: pipeline.far.map_or(f64::INFINITY, |far| far.0),
            assembly,
            center,
            radius,
            scene,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The radius of the scene.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The middle of the scene.
    pub(crate) fn center(&self) -> DVec3 {
        self.center
    }

    /// The middles of objects in the world.
    pub(crate) fn middles(&self) -> &[DVec3] {
        &self.middles
    }

    /// The size of a view whose image is made smaller `reduce` times along each axis.
    pub fn size(&self, view: usize, reduce: usize) -> Size {
        self.scene.views[view].camera.scaled(reduce).size
    }

    /// The vertices of all instances in the world, `[V, 3]`.
    fn world<'t>(&self, values: &Values<'t, '_>) -> Recorded<'t> {
        let tape = values.tape;
        let mut all = Vec::new();
        for (object, &middle) in self.scene.objects.iter().zip(&self.middles) {
            let own = values.tensor(&of_object("vertices", &object.name), &object.positions);
            let pose = values.learnt(&of_object("pose", &object.name));
            for place in &object.places {
                all.push(match pose {
                    Some(pose) => transform_points(own, self.moved(pose, middle, place)?)?,
                    None if *place == DMat4::IDENTITY => own,
                    None => transform_points(own, tape.constant(&to_tensor(place)))?,
                });
            }
        }
        match all.as_slice() {
            [] => Ok(tape.constant(&Tensor::zeros([0, 3]))),
            [only] => Ok(*only),
            _ => Ok(Var::concat(&all, 0)?),
        }
    }

    /// `before`, and then a small motion about a place: `pose` has a translation in radii of the scene and a
    /// rotation.
    fn moved<'t>(&self, pose: Var<'t, f32>, about: DVec3, before: &DMat4) -> Recorded<'t> {
        let radius = self.radius as f32;
        let tape = pose.tape();
        let units = Tensor::from([radius, radius, radius, 1.0, 1.0, 1.0]);
        let increment = pose.try_mul(tape.constant(&units))?;
        let moved = se3(increment, &(DMat4::from_translation(-about) * *before))?;
        let back = tape.constant(&to_tensor(&DMat4::from_translation(about)));
        Ok(back.matmul(moved)?)
    }

    /// The view matrix: fixed, or a variable where cameras are learnt.
    fn view_matrix<'t>(
        &self,
        values: &Values<'t, '_>,
        view: usize,
    ) -> Result<Projection<'t, f32>, FitError> {
        let camera = &self.scene.views[view].camera;
        let Some(increments) = values.learnt("cameras") else {
            return Ok(Projection::Fixed(camera.view));
        };
        let own = increments.slice(0, view..view + 1)?.reshape([6])?;
        // About the middle of the scene, along the camera's axes: what moves the picture and what changes its
        // size are then different numbers.
        let about = camera.view.transform_point3(self.center);
        Ok(Projection::Variable(self.moved(own, about, &camera.view)?))
    }

    /// The matrix from the camera's coordinates to clip space.
    fn lens_matrix<'t>(
        &self,
        values: &Values<'t, '_>,
        camera: &Camera,
        size: Size,
    ) -> Result<Projection<'t, f32>, FitError> {
        let [near, far] = [self.near, self.far];
        let Some(learnt) = values.learnt("intrinsics") else {
            let tape = Tape::new();
            let intrinsics = tape.constant(&Tensor::from(camera.intrinsics));
            let matrix = pinhole(intrinsics, size, near, far)?.value();
            return Ok(Projection::Fixed(from_tensor(&matrix)?));
        };
        // Focal lengths by factors, the principal point by shares of the image's width.
        let tape = values.tape;
        let [fx, fy, cx, cy] = camera.intrinsics.map(|x| x as f32);
        let focal = learnt.slice(0, 0..2)?.exp().try_mul(tape.constant(&Tensor::from([fx, fy])))?;
        let shift = learnt.slice(0, 2..4)? * size.width as f32;
        let center = shift.try_add(tape.constant(&Tensor::from([cx, cy])))?;
        let intrinsics = Var::concat(&[focal, center], 0)?;
        Ok(Projection::Variable(pinhole(intrinsics, size, near, far)?))
    }

    /// The vertices in clip space, and the eye in the world, `[3]`.
    fn clip<'t>(
        &self,
        values: &Values<'t, '_>,
        view: usize,
        reduce: usize,
        world: Var<'t, f32>,
    ) -> Result<(Var<'t, f32>, Var<'t, f32>), FitError> {
        let tape = values.tape;
        let camera = self.scene.views[view].camera.scaled(reduce);
        let view = self.view_matrix(values, view)?;
        let lens = self.lens_matrix(values, &camera, camera.size)?;
        let on_tape = |matrix: Projection<'t, f32>| match matrix {
            Projection::Fixed(matrix) => tape.constant(&to_tensor(&matrix)),
            Projection::Variable(matrix) => matrix,
        };
        let eye = match view {
            Projection::Fixed(view) => {
                let eye = view.inverse().transform_point3(DVec3::ZERO).as_vec3();
                tape.constant(&Tensor::from(eye.to_array()))
            }
            Projection::Variable(view) => {
                affine_inverse(view)?.slice(1, 3..4)?.slice(0, 0..3)?.reshape([3])?
            }
        };
        let is_straight = camera.distortion == [0.0; 5];
        let distortion = match values.learnt("distortion") {
            None if is_straight => None,
            learnt => Some(learnt.unwrap_or_else(|| {
                tape.constant(&Tensor::from(camera.distortion.map(|x| x as f32)))
            })),
        };
        let clip = match (distortion, view, lens) {
            (Some(distortion), ..) => {
                let seen = distort(transform_points(world, on_tape(view))?, distortion)?;
                project(seen, lens, None)?
            }
            (None, Projection::Fixed(view), Projection::Fixed(lens)) => {
                project(world, &(lens * view), None)?
            }
            (None, ..) => project(world, on_tape(lens).matmul(on_tape(view))?, None)?,
        };
        Ok((clip, eye))
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

    /// How a view is rasterized.
    fn options(&self, size: Size) -> RasterOptions {
        let pipeline = &self.scene.description.pipeline;
        let cull = match pipeline.cull {
            CullName::None => Cull::None,
            CullName::Back => Cull::Back,
        };
        let sampling = match pipeline.silhouettes {
            Silhouettes::Exact => Sampling::Exact,
            _ => Sampling::Center,
        };
        RasterOptions::new(size).cull(cull).sampling(sampling)
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
        let world = self.world(values)?;
        let (clip, eye) = self.clip(values, view, reduce, world)?;
        let options = self.options(self.size(view, reduce));
        let fragments = rasterize(clip, self.assembly.mesh(), options)?;
        let light = self.light(values, world, eye, &fragments)?;
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
        let composite = composite(surface, &fragments, background)?;
        let light = match self.scene.description.pipeline.silhouettes {
            Silhouettes::Antialias => antialias(composite)?,
            _ => composite.into(),
        };
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
            let far = 1e3 * self.radius;
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
        world: Var<'t, f32>,
        eye: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let looks = self.looks(values, fragments)?;
        if self.model == SurfaceModel::Unlit {
            return Ok(looks.base_color);
        }
        let normals = self.normals(world, fragments)?;
        let positions = interpolate(world, fragments)?;
        let views = eye.try_sub(positions)?;
        let surface = Surface { normals, views, positions: Some(positions) };
        let material = match self.model {
            SurfaceModel::Lambert => Material::Lambert { color: looks.base_color },
            _ => Material::MetallicRoughness {
                base_color: looks.base_color,
                roughness: looks.roughness,
                metallic: looks.metallic,
                conserves_energy: false,
            },
        };
        let lights = self.lights(values);
        let mut light =
            (!lights.is_empty()).then(|| shade(&surface, &material, &lights)).transpose()?;
        if let (Some(texels), Some(prefilter)) = (&self.scene.environment, &self.prefilter) {
            let texels = values.tensor("environment", texels);
            let own = Environment::of_texels(texels, prefilter)?.shade(&surface, &material)?;
            light = Some(match light {
                Some(light) => light.try_add(own)?,
                None => own,
            });
        }
        // Without light it is dark.
        Ok(light.unwrap_or(looks.base_color * 0.0))
    }

    /// Normals at the fragments in the world, `[N, 3]`, of any length.
    pub(crate) fn normals<'t>(
        &self,
        world: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Recorded<'t> {
        let corners = match &self.smoothing.vertices {
            Some(vertices) => world.gather_rows(vertices)?,
            None => world,
        };
        let normals = vertex_normals(corners, &self.smoothing.mesh, Weighting::Angle)?;
        Ok(interpolate_indexed(normals, &self.smoothing.mesh, fragments)?)
    }

    /// Which object a face belongs to, and which of its instances, counted over all objects.
    pub(crate) fn instance(&self, face: usize) -> Option<usize> {
        let place = self.assembly.place(face)?;
        let before = self.scene.objects[..place.part].iter().map(|object| object.places.len());
        Some(before.sum::<usize>() + place.instance)
    }

    fn lights<'t>(&self, values: &Values<'t, '_>) -> Vec<Light<'t, f32>> {
        let vector =
            |numbers: [f64; 3]| values.tape.constant(&Tensor::from(numbers.map(|x| x as f32)));
        let lights = self.scene.description.lights.iter().enumerate().map(|(at, light)| {
            let color = |own: [crate::description::NotNegative; 3]| {
                values.color(&of_object("light", &at.to_string()), own.map(|x| x.0 as f32))
            };
            match *light {
                LightEntry::Ambient { color: own } => Light::Ambient { radiance: color(own) },
                LightEntry::Directional { direction, color: own } => Light::Directional {
                    direction: vector(direction.map(|x| x.0)),
                    irradiance: color(own),
                },
                LightEntry::Point { position, color: own } => {
                    Light::Point { position: vector(position.map(|x| x.0)), intensity: color(own) }
                }
            }
        });
        lights.collect()
    }
}

/// What the fragments are made of.
struct Looks<'t> {
    /// `[N, 3]`.
    base_color: Var<'t, f32>,
    /// `[N]`.
    roughness: Var<'t, f32>,
    /// `[N]`.
    metallic: Var<'t, f32>,
}

impl Renderer {
    /// What the fragments are made of: each object's at its own fragments.
    fn looks<'t>(
        &self,
        values: &Values<'t, '_>,
        fragments: &Fragments<'t, f32>,
    ) -> Result<Looks<'t>, FitError> {
        let objects = &self.scene.objects;
        let colors = self.colors.as_ref().map(|joint| {
            let white = Tensor::full([1, 3], 1.0);
            let own = objects.iter().map(|object| match &object.colors {
                Some(own) => values.tensor(&of_object("colors", &object.name), &own.rows),
                None => values.tape.constant(&white),
            });
            let all = joined(&own.collect::<Vec<_>>())?;
            Ok::<_, FitError>(interpolate_indexed(all, &joint.indices, fragments)?)
        });
        let places = self.coordinates.as_ref().map(|joint| {
            let zero = Tensor::zeros([1, 2]);
            let own = objects.iter().map(|object| match &object.coordinates {
                Some(own) => values.tape.constant(&own.rows),
                None => values.tape.constant(&zero),
            });
            let all = joined(&own.collect::<Vec<_>>())?;
            let at = interpolate_indexed(all, &joint.indices, fragments)?;
            let is_fixed = matches!(
                self.scene.description.pipeline.texture_filter,
                FilterName::Nearest | FilterName::Bilinear
            );
            let slopes = match is_fixed {
                true => None,
                false => {
                    let slopes = differentials(fragments)?;
                    let of =
                        interpolate_differentials_indexed(all, &joint.indices, fragments, slopes)?;
                    Some(of)
                }
            };
            Ok::<_, FitError>((at, slopes))
        });
        let (colors, places) = (colors.transpose()?, places.transpose()?);
        let groups = self.groups(fragments);
        let parts = objects.iter().zip(&groups.rows).filter_map(|(object, rows)| {
            let count = match rows {
                Some(rows) if rows.is_empty() => return None,
                Some(rows) => rows.len(),
                None => fragments.coverage.count(),
            };
            let own = |all: Var<'t, f32>| match rows {
                Some(rows) => all.gather_rows(rows),
                None => Ok(all),
            };
            Some(self.look(values, object, count, |which| match which {
                Rows::Colors => colors.map(own).transpose(),
                Rows::Places => places.map(|(at, _)| own(at)).transpose(),
                Rows::Slopes => places.and_then(|(_, slopes)| slopes).map(own).transpose(),
            }))
        });
        let parts = parts.collect::<Result<Vec<_>, FitError>>()?;
        let back = |pick: fn(&Looks<'t>) -> Var<'t, f32>| -> Recorded<'t> {
            let all = joined(&parts.iter().map(pick).collect::<Vec<_>>())?;
            Ok(match &groups.back {
                Some(back) => all.gather_rows(back)?,
                None => all,
            })
        };
        if parts.is_empty() {
            let tape = values.tape;
            let [color, number] =
                [tape.constant(&Tensor::zeros([0, 3])), tape.constant(&Tensor::zeros([0]))];
            return Ok(Looks { base_color: color, roughness: number, metallic: number });
        }
        let base_color = back(|look| look.base_color)?;
        if self.model != SurfaceModel::MetallicRoughness {
            // Nobody asks for the others.
            let Looks { roughness, metallic, .. } = parts[0];
            return Ok(Looks { base_color, roughness, metallic });
        }
        Ok(Looks {
            base_color,
            roughness: back(|look| look.roughness)?,
            metallic: back(|look| look.metallic)?,
        })
    }

    /// What `count` fragments of an object are made of.
    fn look<'t>(
        &self,
        values: &Values<'t, '_>,
        object: &Object,
        count: usize,
        rows: impl Fn(Rows) -> Result<Option<Var<'t, f32>>, bokashi_core::TensorError>,
    ) -> Result<Looks<'t>, FitError> {
        let look = &object.look;
        let sampled = |kind: &str, own: &Tensor<f32>| -> Result<Option<Var<'t, f32>>, FitError> {
            let Some(places) = rows(Rows::Places)? else { return Ok(None) };
            let texels = values.tensor(&of_object(kind, &object.name), own);
            let slopes = rows(Rows::Slopes)?;
            let (texture, detail) = match slopes {
                Some(differentials) => {
                    let detail = Detail::Differentials { differentials, bias: None };
                    (Texture::with_mipmaps(texels)?, detail)
                }
                None => (Texture::new(texels)?, Detail::Finest),
            };
            let filter = match self.scene.description.pipeline.texture_filter {
                FilterName::Nearest => TextureFilter::Nearest,
                FilterName::Bilinear => TextureFilter::Bilinear,
                FilterName::Trilinear => TextureFilter::Trilinear,
                FilterName::Anisotropic => TextureFilter::Anisotropic { probes: 8 },
            };
            Ok(Some(sample_texture(&texture, places, detail, Sampler::new().filter(filter))?))
        };
        let textured =
            look.texture.as_ref().map(|own| sampled("texture", own)).transpose()?.flatten();
        let ones = || values.tape.constant_full([count, 1], 1.0);
        let color = || values.color(&of_object("texture", &object.name), look.base_color);
        let base_color = match (textured, rows(Rows::Colors)?) {
            (Some(texture), Some(colors)) => texture.try_mul(colors)?,
            (Some(texture), None) => texture,
            (None, Some(colors)) => colors.try_mul(color())?,
            (None, None) => ones().try_mul(color())?,
        };
        if self.model != SurfaceModel::MetallicRoughness {
            let unused = values.tape.constant_scalar(0.0);
            return Ok(Looks { base_color, roughness: unused, metallic: unused });
        }
        let number = |kind: &str, channel: usize, own: f32| -> Recorded<'t> {
            let map = look.roughness_metallic.as_ref().map(|maps| {
                let [height, width] = [maps.shape()[0], maps.shape()[1]];
                Tensor::from_flat_fn([height, width, 1], |k| maps.data()[2 * k + channel])
            });
            match map.map(|map| sampled(kind, &map)).transpose()?.flatten() {
                Some(found) => Ok(found.reshape([count])?),
                None => {
                    let number = values.number(&of_object(kind, &object.name), own.into());
                    Ok(ones().try_mul(number)?.reshape([count])?)
                }
            }
        };
        Ok(Looks {
            base_color,
            roughness: number("roughness", 0, look.roughness)?,
            metallic: number("metallic", 1, look.metallic)?,
        })
    }

    /// Which fragments belong to which object.
    fn groups(&self, fragments: &Fragments<'_, f32>) -> Groups {
        let count = self.scene.objects.len();
        if count <= 1 {
            return Groups { rows: vec![None; count], back: None };
        }
        let mut rows = vec![Vec::new(); count];
        for (fragment, face) in fragments.coverage.faces().enumerate() {
            let part = self.assembly.place(face).map_or(0, |place| place.part);
            rows[part].push(fragment as u32);
        }
        let mut back = vec![0; fragments.coverage.count()];
        for (at, &fragment) in rows.iter().flatten().enumerate() {
            back[fragment as usize] = at as u32;
        }
        let rows = rows.into_iter().map(|rows| Some(rows.into())).collect();
        Groups { rows, back: Some(back.into()) }
    }
}

/// Numbers at the fragments of one object.
enum Rows {
    Colors,
    Places,
    Slopes,
}

/// The fragments of each object, all of them where there is one object; and where each fragment then is.
struct Groups {
    rows: Vec<Option<Arc<[u32]>>>,
    back: Option<Arc<[u32]>>,
}

/// Rows one after another.
fn joined<'t>(parts: &[Var<'t, f32>]) -> Recorded<'t> {
    match parts {
        [only] => Ok(*only),
        _ => Ok(Var::concat(parts, 0)?),
    }
}

impl Smoothing {
    fn new(assembly: &Assembly, objects: &[Object]) -> Result<Self, SceneError> {
        if objects.iter().all(|object| object.normals.is_none()) {
            return Ok(Self { mesh: assembly.mesh().clone(), vertices: None });
        }
        let (mut faces, mut vertices) = (Vec::new(), Vec::new());
        let mut first = 0;
        for object in objects {
            for _ in &object.places {
                let own = object.mesh.faces();
                let corners =
                    object.normals.as_ref().map_or(own, |normals| normals.indices.faces());
                let mut seen = std::collections::HashMap::new();
                faces.extend(own.iter().zip(corners).map(|(vertex, normal)| {
                    [0, 1, 2].map(|k| {
                        *seen.entry((vertex[k], normal[k])).or_insert_with(|| {
                            vertices.push(first + vertex[k]);
                            vertices.len() as u32 - 1
                        })
                    })
                }));
                first += object.mesh.vertex_count() as u32;
            }
        }
        let mesh = Mesh::new(faces, vertices.len())?;
        Ok(Self { mesh, vertices: Some(vertices.into()) })
    }
}
