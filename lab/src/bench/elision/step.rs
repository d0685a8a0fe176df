//! A step of a pipeline, up to what it computes.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{FitError, squared_error};
use bokashi_render_ops::{
    Background, Blur, Detail, Fragments, Layer, Light, Material, RasterOptions, Sampler, Surface,
    Texture, Weighting, antialias, composite, composite_layers, depth, depth_layers, differentials,
    gaussian_blur, interpolate, interpolate_differentials, project, rasterize, sample_texture,
    shade, vertex_normals,
};

use crate::bench::scenes::Scene;

/// A texture that the surface shows, and what is asked of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Textured {
    pub(super) learns_texels: bool,
    pub(super) learns_coordinates: bool,
    /// It has coarser levels, so far off that no sample is taken from them.
    pub(super) has_mipmaps: bool,
    /// Samples are told how coordinates change from pixel to pixel.
    pub(super) has_differentials: bool,
}

/// Added to the level of each sample, so that it is below 0.
const BIAS: f32 = -32.0;

/// A step, and what it asks for.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) scene: Scene,
    pub(super) learns_positions: bool,
    pub(super) learns_colors: bool,
    /// The blur; `None`: there is none.
    pub(super) sigma: Option<f32>,
    pub(super) learns_sigma: bool,
    /// The colours are those of a surface in the light of a lamp.
    pub(super) is_lit: bool,
    pub(super) learns_light: bool,
    /// The surface shows a texture, and not its colours.
    pub(super) texture: Option<Textured>,
    /// Opaque layers in depth, and the most of them; `None`: what is nearest, without layers.
    pub(super) layers: Option<Option<usize>>,
    /// A background of zeros with a gradient of its own, not the empty one.
    pub(super) has_background: bool,
    /// The depth has an upstream gradient, of zeros.
    pub(super) has_depth: bool,
}

/// What a step gives, by name.
pub(super) type Results = Vec<(&'static str, Tensor<f32>)>;

impl Step {
    /// Positions, colours and sigma are learnt before an empty background.
    pub(super) fn new(scene: &Scene) -> Self {
        Self {
            scene: scene.clone(),
            learns_positions: true,
            learns_colors: true,
            sigma: Some(1.0),
            learns_sigma: true,
            is_lit: false,
            learns_light: false,
            texture: None,
            layers: None,
            has_background: false,
            has_depth: false,
        }
    }

    /// The same without a blur.
    pub(super) fn sharp(scene: &Scene) -> Self {
        Self { sigma: None, learns_sigma: false, ..Self::new(scene) }
    }

    /// The same without a blur, in the light of a lamp that is learnt.
    pub(super) fn lit(scene: &Scene) -> Self {
        Self { is_lit: true, learns_light: true, ..Self::sharp(scene) }
    }

    /// The same without a blur, with a texture that is learnt with its coordinates.
    pub(super) fn textured(scene: &Scene) -> Self {
        let texture = Textured {
            learns_texels: true,
            learns_coordinates: true,
            has_mipmaps: true,
            has_differentials: true,
        };
        Self { learns_colors: false, texture: Some(texture), ..Self::sharp(scene) }
    }

    /// The same with another texture.
    pub(super) fn with_texture(&self, change: impl Fn(&mut Textured)) -> Self {
        let mut step = self.clone();
        step.texture.iter_mut().for_each(change);
        step
    }

    fn learns(&self) -> bool {
        let of_texture =
            self.texture.map(|texture| texture.learns_texels || texture.learns_coordinates);
        self.learns_positions
            || self.learns_colors
            || self.learns_sigma
            || self.learns_light
            || of_texture.unwrap_or(false)
    }

    /// What the texture shows at the fragments.
    fn sampled<'t>(
        &self,
        texture: Textured,
        [texels, coordinates]: [Var<'t, f32>; 2],
        fragments: &Fragments<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let tape = texels.tape();
        let places = interpolate(coordinates, fragments)?;
        let detail = match texture.has_differentials {
            true => {
                let slopes = differentials(fragments)?;
                let slopes = interpolate_differentials(coordinates, fragments, slopes)?;
                let bias = Some(tape.constant_scalar(BIAS));
                Detail::Differentials { differentials: slopes, bias }
            }
            false => Detail::Finest,
        };
        let texture = match texture.has_mipmaps {
            true => Texture::with_mipmaps(texels)?,
            false => Texture::new(texels)?,
        };
        Ok(sample_texture(&texture, places, detail, Sampler::new())?)
    }

    /// The tensors that the step starts from.
    pub(super) fn start(&self) -> Start {
        let [height, width] = [self.scene.size.height, self.scene.size.width];
        let positions: Tensor<f32> = self.scene.positions.cast();
        let vertices = self.scene.mesh.vertex_count();
        let extent = height.clamp(1, 256);
        Start {
            texels: Tensor::from_flat_fn([extent, extent, 3], |k| {
                (k * 7919 % 1009) as f32 / 1009.0
            }),
            coordinates: Tensor::from_fn([vertices, 2], |[v, c]| positions[[v, c]]),
            positions,
            colors: self.scene.colors.cast(),
            sigma: Tensor::scalar(self.sigma.unwrap_or_default()),
            background: Tensor::zeros([height, width, 3]),
            target: Tensor::full([height, width, 3], 0.25),
            light: Tensor::from([1.0, 2.0, 3.0]),
            one: Tensor::scalar(1.0),
            depth_upstream: None,
        }
    }

    /// Takes the step; gives what it found where `look` says so.
    pub(super) fn take(
        &self,
        start: &mut Start,
        tape: &Tape<f32>,
        look: bool,
    ) -> Result<Results, FitError> {
        let leaf = |learns: bool, tensor: &Tensor<f32>| match learns {
            true => tape.leaf(tensor),
            false => tape.constant(tensor),
        };
        let positions = leaf(self.learns_positions, &start.positions);
        let colors = leaf(self.learns_colors, &start.colors);
        let sigma = leaf(self.learns_sigma, &start.sigma);
        let clip = project(positions, &self.scene.camera, None)?;
        let options = RasterOptions::from(self.scene.size);
        let layers = match self.layers {
            None => vec![rasterize(clip, &self.scene.mesh, options)?],
            Some(most) => depth_layers(clip, &self.scene.mesh, options, most)?,
        };
        let fragments = &layers[0];
        let light = leaf(self.learns_light, &start.light);
        let texels = leaf(self.texture.is_some_and(|texture| texture.learns_texels), &start.texels);
        let coordinates = leaf(
            self.texture.is_some_and(|texture| texture.learns_coordinates),
            &start.coordinates,
        );
        let mut surface = match self.texture {
            None => interpolate(colors, fragments)?,
            Some(texture) => self.sampled(texture, [texels, coordinates], fragments)?,
        };
        if self.is_lit {
            let normals = vertex_normals(positions, &self.scene.mesh, Weighting::Area)?;
            let place = Surface {
                normals: interpolate(normals, fragments)?,
                views: tape.constant(&Tensor::from([0.5, 0.25, 1.0])),
                positions: None,
            };
            let material = Material::MetallicRoughness {
                base_color: surface,
                roughness: tape.constant_scalar(0.5),
                metallic: tape.constant_scalar(0.25),
                conserves_energy: false,
            };
            let direction = tape.constant(&Tensor::from([0.25, 1.0, 0.5]));
            let lamp = Light::Directional { direction, irradiance: light };
            surface = shade(&place, &material, &[lamp])?;
        }
        let background = match self.has_background {
            true => Background::Image(tape.leaf(&start.background)),
            false => Background::Zero,
        };
        let picture = match self.layers {
            None => composite(surface, fragments, background)?,
            Some(_) => {
                let mut all = Vec::with_capacity(layers.len());
                for (k, fragments) in layers.iter().enumerate() {
                    let premultiplied =
                        if k == 0 { surface } else { interpolate(colors, fragments)? };
                    let alpha = tape.constant_full([fragments.coverage.count()], 1.0);
                    all.push(Layer { fragments, premultiplied, alpha });
                }
                composite_layers(&all, background)?
            }
        };
        let picture = antialias(picture)?;
        let mut image = picture.image()?;
        if self.sigma.is_some() {
            image = gaussian_blur(image, sigma, &Blur::default())?;
        }
        let loss = squared_error(image, tape.constant(&start.target))?;
        let mut results = Vec::new();
        if look {
            results.extend([("picture", image.value()), ("loss", loss.value())]);
        }
        if !self.learns() {
            return Ok(results);
        }
        let gradients = match self.has_depth {
            false => loss.backward()?,
            true => {
                let depth = depth(fragments)?;
                let zeros = || Tensor::zeros(depth.shape());
                let upstream = start.depth_upstream.get_or_insert_with(zeros);
                tape.vjp(&[(loss, &start.one), (depth, upstream)])?
            }
        };
        let learnt = [
            ("gradient of positions", self.learns_positions, positions),
            ("gradient of colours", self.learns_colors, colors),
            ("gradient of sigma", self.learns_sigma, sigma),
            ("gradient of the light", self.learns_light, light),
            (
                "gradient of texels",
                self.texture.is_some_and(|texture| texture.learns_texels),
                texels,
            ),
            (
                "gradient of coordinates",
                self.texture.is_some_and(|texture| texture.learns_coordinates),
                coordinates,
            ),
        ];
        for (name, _, variable) in learnt.into_iter().filter(|(_, learnt, _)| look && *learnt) {
            results.push((name, gradients.get_or_zeros(variable)));
        }
        Ok(results)
    }
}

/// The tensors that a step starts from.
pub(super) struct Start {
    positions: Tensor<f32>,
    colors: Tensor<f32>,
    texels: Tensor<f32>,
    /// Of vertices, on the texture.
    coordinates: Tensor<f32>,
    sigma: Tensor<f32>,
    background: Tensor<f32>,
    target: Tensor<f32>,
    /// Its irradiance.
    light: Tensor<f32>,
    one: Tensor<f32>,
    /// Zeros, once their number is known.
    depth_upstream: Option<Tensor<f32>>,
}
