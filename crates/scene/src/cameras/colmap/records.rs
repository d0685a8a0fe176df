//! What a reconstruction holds, in either form.

use bokashi_render_ops::Size;
use glam::{DQuat, DVec3};

use crate::cameras::camera::{Camera, from_corner};
use crate::cameras::distortion::Distortion;

/// How the parameters of a model are read: the number of focal lengths, the principal point after them, and
/// coefficients of the lens in OpenCV's order.
pub(super) struct Model {
    focal_lengths: usize,
    coefficients: usize,
    /// The lens without coefficients.
    lens: Distortion,
}

impl Model {
    const fn new(focal_lengths: usize, coefficients: usize, lens: Distortion) -> Option<Self> {
        Some(Self { focal_lengths, coefficients, lens })
    }

    /// The number of parameters.
    pub(super) fn parameters(&self) -> usize {
        self.focal_lengths + 2 + self.coefficients
    }
}

/// COLMAP's models by their numbers in binary files; those without a [`Model`] are not read.
pub(super) const MODELS: [(&str, Option<Model>); 11] = [
    ("SIMPLE_PINHOLE", Model::new(1, 0, Distortion::NONE)),
    ("PINHOLE", Model::new(2, 0, Distortion::NONE)),
    ("SIMPLE_RADIAL", Model::new(1, 1, Distortion::NONE)),
    ("RADIAL", Model::new(1, 2, Distortion::NONE)),
    ("OPENCV", Model::new(2, 4, Distortion::NONE)),
    ("OPENCV_FISHEYE", Model::new(2, 4, Distortion::Fisheye([0.0; 4]))),
    ("FULL_OPENCV", Model::new(2, 8, Distortion::Rational([0.0; 8]))),
    ("FOV", None),
    ("SIMPLE_RADIAL_FISHEYE", Model::new(1, 1, Distortion::Fisheye([0.0; 4]))),
    ("RADIAL_FISHEYE", Model::new(1, 2, Distortion::Fisheye([0.0; 4]))),
    ("THIN_PRISM_FISHEYE", None),
];

/// The most columns or rows of an image.
const LONGEST: u64 = 65535;

/// A point of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColmapPoint {
    /// Where it lies in the world.
    pub position: DVec3,
    /// Its colour as in the photographs, encoded as sRGB.
    pub color: [u8; 3],
}

/// A camera's number, and the camera at the origin.
pub(super) struct Lens {
    pub(super) number: u32,
    pub(super) camera: Camera,
}

/// A photograph.
pub(super) struct Shot {
    pub(super) rotation: DQuat,
    pub(super) translation: DVec3,
    /// The number of its camera.
    pub(super) camera: u32,
    pub(super) name: String,
}

/// A point's number, and the point.
pub(super) struct Numbered {
    pub(super) number: u64,
    pub(super) point: ColmapPoint,
}

/// The model of this name.
///
/// # Errors
/// The rule, for a model that is not read.
pub(super) fn model(name: &str) -> Result<&'static Model, String> {
    let known = MODELS.iter().find(|(known, _)| *known == name);
    known.and_then(|(_, model)| model.as_ref()).ok_or_else(|| {
        let read = MODELS.iter().filter_map(|(name, model)| model.as_ref().map(|_| *name));
        let read = read.collect::<Vec<_>>().join(", ");
        format!("a camera has a model of {read}, and this is {name}")
    })
}

/// The camera at the origin of a model with its parameters.
///
/// # Errors
/// The rule that is broken, and what broke it.
pub(super) fn camera(
    name: &str,
    [width, height]: [u64; 2],
    parameters: &[f64],
) -> Result<Camera, String> {
    let model = model(name)?;
    if !(1..=LONGEST).contains(&width) || !(1..=LONGEST).contains(&height) {
        let rule = format!("an image has from 1 to {LONGEST} columns and rows");
        return Err(format!("{rule}, and this is {width} x {height}"));
    }
    if parameters.len() != model.parameters() {
        let rule = format!("a camera of the model {name} has {} parameters", model.parameters());
        return Err(format!("{rule}, and this has {}", parameters.len()));
    }
    if let Some(number) = parameters.iter().find(|number| !number.is_finite()) {
        return Err(format!("parameters of a camera are finite, and this has {number}"));
    }
    let (focal_lengths, rest) = parameters.split_at(model.focal_lengths);
    let [fx, fy] = [focal_lengths[0], focal_lengths[model.focal_lengths - 1]];
    if !(fx > 0.0 && fy > 0.0) {
        return Err(format!("focal lengths are above 0, and these are {fx} and {fy}"));
    }
    let size = Size { width: width as usize, height: height as usize };
    let distortion = model.lens.with_coefficients(&rest[2..]);
    Ok(Camera { distortion, ..Camera::new(size, from_corner([fx, fy, rest[0], rest[1]])) })
}
