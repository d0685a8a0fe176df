//! From surfaces to pixels: which operations there are, and their numbers.

use std::path::PathBuf;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::{
    BladeCount, CircleRadius, Count, Finite, NotNegative, Positive, SampleCount, SurfaceCount,
};

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

/// A thin lens, which blurs what is out of focus.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(try_from = "LensKeys", into = "LensKeys")]
#[schemars(with = "LensKeys")]
pub struct LensEntry {
    /// How wide it is.
    pub opening: Opening,
    /// The distance that is sharp, in units of the scene.
    pub focus: Positive,
    /// How many hidden surfaces are seen beside the outlines of what hides them; by default 2.
    pub surfaces: Option<SurfaceCount>,
    /// The largest radius of a circle of confusion, in pixels; by default 64.
    pub largest_radius: Option<CircleRadius>,
    /// The form of its opening; by default a disc.
    pub iris: Option<IrisEntry>,
    /// How many samples along each side of a pixel are drawn, and seen through the lens; by default 1.
    pub samples: Option<SampleCount>,
    /// Whether surfaces are blurred as they lean; by default each pixel is blurred as if it faced the lens.
    pub slopes: bool,
}

impl LensEntry {
    /// How many hidden surfaces are drawn.
    pub fn surface_count(&self) -> usize {
        self.surfaces.map_or(2, |count| count.0)
    }

    /// How many samples along each side of a pixel are drawn.
    pub fn sample_count(&self) -> usize {
        self.samples.map_or(1, |count| count.0)
    }
}

/// An opening that blades make: a regular polygon, which blurs as far as the disc of its radius.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IrisEntry {
    /// How many blades.
    pub blades: BladeCount,
    /// The direction of a corner, in degrees from the right towards the bottom of the image; by default 0.
    pub rotation: Option<Finite>,
}

/// How wide a lens is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Opening {
    /// The radius of the circle of confusion at infinite distance, in pixels.
    Aperture(NotNegative),
    /// The radius of the lens itself, in units of the scene.
    Radius(NotNegative),
}

impl Opening {
    /// The opening that one of two keys gives; `None` without either.
    ///
    /// # Errors
    /// The rule that both break.
    pub(crate) fn from_keys(
        aperture: Option<NotNegative>,
        radius: Option<NotNegative>,
    ) -> Result<Option<Self>, &'static str> {
        match (aperture, radius) {
            (Some(_), Some(_)) => Err("a lens has either `aperture` or `radius`"),
            (aperture, radius) => Ok(aperture.map(Self::Aperture).or(radius.map(Self::Radius))),
        }
    }

    /// The numbers of the keys `aperture` and `radius`.
    fn keys(self) -> [Option<NotNegative>; 2] {
        match self {
            Self::Aperture(number) => [Some(number), None],
            Self::Radius(number) => [None, Some(number)],
        }
    }

    /// Its key.
    pub fn key(self) -> &'static str {
        match self {
            Self::Aperture(_) => "aperture",
            Self::Radius(_) => "radius",
        }
    }

    /// Its number.
    pub fn number(self) -> f64 {
        let (Self::Aperture(number) | Self::Radius(number)) = self;
        number.0
    }
}

/// A thin lens, which blurs what is out of focus.
#[derive(Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct LensKeys {
    /// The radius of the circle of confusion at infinite distance, in pixels.
    aperture: Option<NotNegative>,
    /// In place of `aperture`: the radius of the lens itself, in units of the scene.
    radius: Option<NotNegative>,
    /// The distance that is sharp, in units of the scene.
    focus: Positive,
    /// How many hidden surfaces are seen beside the outlines of what hides them, from 0 to 8; by default 2.
    surfaces: Option<SurfaceCount>,
    /// The largest radius of a circle of confusion, in pixels; by default 64.
    largest_radius: Option<CircleRadius>,
    /// The form of its opening; by default a disc.
    iris: Option<IrisEntry>,
    /// How many samples along each side of a pixel are drawn, and seen through the lens, from 1 to 8; by default 1.
    samples: Option<SampleCount>,
    /// Whether surfaces are blurred as they lean; by default each pixel is blurred as if it faced the lens.
    #[serde(default)]
    slopes: bool,
}

impl TryFrom<LensKeys> for LensEntry {
    type Error = String;

    fn try_from(keys: LensKeys) -> Result<Self, String> {
        let LensKeys { aperture, radius, focus, surfaces, largest_radius, iris, samples, slopes } =
            keys;
        let Some(opening) = Opening::from_keys(aperture, radius)? else {
            return Err("a lens has `aperture` or `radius`".to_owned());
        };
        let entry = Self { opening, focus, surfaces, largest_radius, iris, samples, slopes };
        // So wide circles are drawn, counted in samples.
        match largest_radius.map_or(0.0, |radius| radius.0) * entry.sample_count() as f64 {
            0.0..=1024.0 => Ok(entry),
            radius => Err(format!(
                "`largest_radius` times `samples` is at most 1024, and this is {radius}"
            )),
        }
    }
}

impl From<LensEntry> for LensKeys {
    fn from(entry: LensEntry) -> Self {
        let LensEntry { opening, focus, surfaces, largest_radius, iris, samples, slopes } = entry;
        let [aperture, radius] = opening.keys();
        Self { aperture, radius, focus, surfaces, largest_radius, iris, samples, slopes }
    }
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
