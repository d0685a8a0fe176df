//! From surfaces to pixels: which operations there are, and their numbers.

use std::path::PathBuf;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::{Count, Finite, NotNegative, Positive};

/// Which operations make a picture. What is absent costs nothing.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PipelineEntry {
    /// How pixels at silhouettes are made: by default exactly, while `RasterOptions::new` of a program
    /// antialiases.
    #[serde(default)]
    pub silhouettes: SilhouettesName,
    /// How surfaces answer light; by default `unlit` in a scene without lights, else
    /// `metallic-roughness`.
    pub surface: Option<SurfaceModel>,
    /// Whether faces are drawn that turn their back to the camera.
    #[serde(default)]
    pub cull: CullName,
    /// How textures are looked up.
    #[serde(default)]
    pub texture_filter: FilterName,
    /// The linear colour behind everything; by default black.
    pub background: Option<[NotNegative; 3]>,
    /// The nearest distance that is seen; by default a thousandth of the scene's extent.
    pub near: Option<Positive>,
    /// The farthest distance that is seen; by default there is none.
    pub far: Option<Positive>,
    /// What pixels stand for when they are compared with images, and in pictures.
    #[serde(default)]
    pub tone: Tone,
    /// How much light is multiplied, in stops: 1 is twice as much.
    pub exposure: Option<Finite>,
    /// The standard deviation of a blur of the whole picture, in pixels.
    pub blur: Option<Positive>,
    /// The weights of that blur.
    #[serde(default)]
    pub blur_kernel: KernelName,
    /// A lens that blurs what is out of focus.
    pub lens: Option<LensEntry>,
}

/// How pixels at silhouettes are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SilhouettesName {
    /// Pixels show what lies at their centres; edges move nothing.
    Aliased,
    /// Pairs of pixels at silhouettes are blended: fast, and blind to edges of faces that lie between pixel
    /// centres, as those of fine meshes do.
    Antialias,
    /// Pixels at silhouettes are means over what is visible in them, with the true gradient.
    #[default]
    Exact,
}

/// How surfaces answer light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SurfaceModel {
    /// They show their base colour.
    Unlit,
    /// They are matte.
    Lambert,
    /// As glTF has it.
    MetallicRoughness,
}

/// Which faces are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CullName {
    /// All.
    #[default]
    None,
    /// Those that turn their front to the camera.
    Back,
}

/// How textures are looked up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FilterName {
    /// The nearest texel.
    Nearest,
    /// Between four texels.
    Bilinear,
    /// Between eight texels of two levels, as large as the pixel sees them.
    #[default]
    Trilinear,
    /// Trilinear, up to eight times along the longer side of what the pixel sees.
    Anisotropic,
}

/// The weights of a blur.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum KernelName {
    /// A Gaussian at pixel centres.
    #[default]
    Sampled,
    /// A Gaussian of diffusion from pixel to pixel: a wide one takes no longer than a narrow one.
    Discrete,
    /// A disc whose radius is two standard deviations, up to 2048 pixels, as a lens out of focus has it.
    Disc,
}

/// What pixels stand for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Tone {
    /// Light, cut off at 1 and encoded by the curve of sRGB, as in photographs.
    #[default]
    Srgb,
    /// Light.
    Linear,
}

/// A lens that blurs what is out of focus.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LensEntry {
    /// The standard deviation of the blur at infinite distance, in pixels.
    pub aperture: NotNegative,
    /// The distance that is sharp, in units of the scene.
    pub focus: Positive,
    /// How far off the blur may be; by default 1e-3.
    pub tolerance: Option<Positive>,
}

/// A light. Colours are linear.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LightEntry {
    /// From all sides alike.
    Ambient {
        /// Its radiance.
        color: [NotNegative; 3],
    },
    /// From far away.
    Directional {
        /// Towards the light, in the world.
        direction: [Finite; 3],
        /// Its irradiance.
        color: [NotNegative; 3],
    },
    /// From a place.
    Point {
        /// Where it is, in the world.
        position: [Finite; 3],
        /// Its intensity.
        color: [NotNegative; 3],
    },
}

/// What a light's place is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightPlace {
    /// Towards the light, in the world, of any length.
    Direction(DVec3),
    /// In the world.
    Position(DVec3),
}

impl LightEntry {
    /// Where it is; `None` of light from all sides.
    pub fn place(&self) -> Option<LightPlace> {
        let vector = |numbers: [Finite; 3]| DVec3::from(numbers.map(|x| x.0));
        match *self {
            Self::Ambient { .. } => None,
            Self::Directional { direction, .. } => Some(LightPlace::Direction(vector(direction))),
            Self::Point { position, .. } => Some(LightPlace::Position(vector(position))),
        }
    }

    /// Its colour.
    pub fn color(&self) -> [f64; 3] {
        let (Self::Ambient { color } | Self::Directional { color, .. } | Self::Point { color, .. }) =
            self;
        color.map(|x| x.0)
    }
}

/// Light from all sides.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentEntry {
    /// A panorama, twice as wide as high, whose middle is +x and whose top is +y; or the six faces of a cube map,
    /// +x, -x, +y, -y, +z, -z, one below the other.
    pub image: Option<PathBuf>,
    /// The same light from everywhere, in place of an image.
    pub color: Option<[NotNegative; 3]>,
    /// Texels along a side of the cube map, a power of two from 8 to 256; by default 16 for `color`, and up to 64
    /// for a panorama, as it has pixels.
    pub size: Option<Count>,
}
