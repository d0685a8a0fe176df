//! Views of a scene: an image each, and the camera that took it.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::{Count, Finite, NotNegative, Positive};
use crate::pipeline::Opening;

/// A view: an image, and the camera that took it.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViewEntry {
    /// What the results call it; by default the image's name without its ending.
    pub name: Option<String>,
    /// PNG, JPEG, EXR or HDR, as it is stored. A view without an image can be rendered and not learnt from.
    pub image: Option<PathBuf>,
    /// An image that shows where the objects are, by shades, labels or opacity. It takes the place of the
    /// image's own opacity.
    pub mask: Option<PathBuf>,
    /// How numbers of the image stand for light; by default linear for EXR and HDR, and sRGB for others.
    pub color_space: Option<ColorSpaceName>,
    /// Whether it is measured and never learnt from.
    #[serde(default)]
    pub held_out: bool,
    /// How much its light is multiplied, in stops, besides the pipeline's exposure; by default 0.
    pub exposure: Option<Finite>,
    /// The camera.
    pub camera: CameraEntry,
    /// What its lens has in place of the pipeline's numbers.
    #[serde(default)]
    pub lens: ViewLens,
}

/// What a view's lens has in place of the pipeline's numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(try_from = "ViewLensKeys")]
#[schemars(with = "ViewLensKeys")]
pub struct ViewLens {
    /// How wide it is.
    pub opening: Option<Opening>,
    /// The distance that is sharp, in units of the scene.
    pub focus: Option<Positive>,
}

/// What a view's lens has in place of the pipeline's numbers.
#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ViewLensKeys {
    /// The radius of the circle of confusion at infinite distance, in pixels.
    aperture: Option<NotNegative>,
    /// In place of `aperture`, as in the pipeline: the radius of the lens itself, in units of the scene.
    radius: Option<NotNegative>,
    /// The distance that is sharp, in units of the scene.
    focus: Option<Positive>,
}

impl TryFrom<ViewLensKeys> for ViewLens {
    type Error = &'static str;

    fn try_from(keys: ViewLensKeys) -> Result<Self, &'static str> {
        let opening = Opening::from_keys(keys.aperture, keys.radius)?;
        Ok(Self { opening, focus: keys.focus })
    }
}

/// How numbers of a file stand for light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColorSpaceName {
    /// By the curve of sRGB.
    Srgb,
    /// In proportion to light.
    Linear,
}

/// A pinhole camera with a lens.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Columns and rows; by default those of the image.
    pub size: Option<[Count; 2]>,
    /// Focal lengths along x and y, in pixels: one number stands for both.
    pub focal: Option<Focal>,
    /// The horizontal angle of view in degrees, in place of `focal`; a fisheye's is what it sees.
    pub angle: Option<Positive>,
    /// The principal point, in pixels, with the *centre* of the first pixel at (0, 0), as OpenCV has it; by
    /// default the middle of the image.
    pub center: Option<[Finite; 2]>,
    /// Coefficients of the lens, k1, k2, p1, p2, k3, as OpenCV has them; and k4, k5, k6 after them.
    pub distortion: Option<Coefficients>,
    /// In place of `distortion`: coefficients of a fisheye, k1, k2, k3, k4, as OpenCV's module `fisheye` has them.
    pub fisheye: Option<[Finite; 4]>,
    /// Four rows of the matrix from the camera's coordinates to the world's.
    pub pose: Option<[[Finite; 4]; 4]>,
    /// The camera's coordinates.
    #[serde(default)]
    pub convention: Convention,
    /// Where the camera stands, in place of `pose`.
    pub position: Option<[Finite; 3]>,
    /// What it looks at, with `position`; by default the origin.
    pub target: Option<[Finite; 3]>,
    /// Which direction is up in the image, with `position`; by default y.
    pub up: Option<[Finite; 3]>,
}

/// One focal length, or two.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(from = "FocalNumbers")]
#[schemars(with = "FocalNumbers")]
pub struct Focal(pub [f64; 2]);

#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a finite number above 0 is needed here, or a list of two of them")]
enum FocalNumbers {
    Same(Positive),
    Both([Positive; 2]),
}

impl From<FocalNumbers> for Focal {
    fn from(numbers: FocalNumbers) -> Self {
        match numbers {
            FocalNumbers::Same(both) => Self([both.0; 2]),
            FocalNumbers::Both(numbers) => Self(numbers.map(|number| number.0)),
        }
    }
}

/// Coefficients of a lens, five or eight.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a list of 5 or 8 finite numbers is needed here")]
pub enum Coefficients {
    /// k1, k2, p1, p2, k3.
    Five([Finite; 5]),
    /// k1, k2, p1, p2, k3, k4, k5, k6.
    Eight([Finite; 8]),
}

/// Which way a camera's axes point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Convention {
    /// x right, y down, z forward.
    #[default]
    Opencv,
    /// x right, y up, z backward.
    Opengl,
}

/// Views from a file of cameras that another tool wrote.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CamerasEntry {
    /// A `transforms.json`, as tools for radiance fields write it.
    pub transforms: Option<PathBuf>,
    /// A folder with COLMAP's `cameras` and `images`, as text or binary, or with such folders that are called
    /// 0, 1 and so on.
    pub colmap: Option<PathBuf>,
    /// The folder of COLMAP's images; by default `images`.
    pub images: Option<PathBuf>,
    /// A folder of masks, in a tree like that of the images and with their names.
    pub masks: Option<PathBuf>,
    /// How numbers of the images stand for light; by default linear for EXR and HDR, and sRGB for others.
    pub color_space: Option<ColorSpaceName>,
    /// Each so many-th view is measured and never learnt from, the first among them.
    pub held_out_every: Option<Count>,
}
