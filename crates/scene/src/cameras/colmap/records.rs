//! What a reconstruction holds, in either form.

use bokashi_render_ops::Size;
use glam::{DQuat, DVec3};

use crate::cameras::camera::{Camera, from_corner};
use crate::cameras::distortion::Distortion;

/// COLMAP's models by their numbers in binary files, and the parameters of those that are read.
pub(super) const MODELS: [(&str, Option<usize>); 11] = [
    ("SIMPLE_PINHOLE", Some(3)),
    ("PINHOLE", Some(4)),
    ("SIMPLE_RADIAL", Some(4)),
    ("RADIAL", Some(5)),
    ("OPENCV", Some(8)),
    ("OPENCV_FISHEYE", Some(8)),
    ("FULL_OPENCV", Some(12)),
    ("FOV", None),
    ("SIMPLE_RADIAL_FISHEYE", Some(4)),
    ("RADIAL_FISHEYE", Some(5)),
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

/// The number of parameters of a model.
///
/// # Errors
/// The rule, for a model that is not read.
pub(super) fn parameters_of(model: &str) -> Result<usize, String> {
    let known = MODELS.iter().find(|(name, _)| *name == model);
    known.and_then(|(_, count)| *count).ok_or_else(|| {
        let read: Vec<&str> =
            MODELS.iter().filter(|(_, count)| count.is_some()).map(|(name, _)| *name).collect();
        format!("a camera has a model of {}, and this is {model}", read.join(", "))
    })
}

/// The camera at the origin of a model with its parameters.
///
/// # Errors
/// The rule that is broken, and what broke it.
pub(super) fn camera(
    model: &str,
    [width, height]: [u64; 2],
    parameters: &[f64],
) -> Result<Camera, String> {
    let count = parameters_of(model)?;
    if !(1..=LONGEST).contains(&width) || !(1..=LONGEST).contains(&height) {
        let rule = format!("an image has from 1 to {LONGEST} columns and rows");
        return Err(format!("{rule}, and this is {width} x {height}"));
    }
    // The rest of the parameters: those of the lens in OpenCV's order.
    let (intrinsics, kind, rest) = match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], Distortion::NONE, &[][..]),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::NONE, &[][..]),
        ("SIMPLE_RADIAL", [f, cx, cy, rest @ ..]) if rest.len() == 1 => {
            ([*f, *f, *cx, *cy], Distortion::NONE, rest)
        }
        ("RADIAL", [f, cx, cy, rest @ ..]) if rest.len() == 2 => {
            ([*f, *f, *cx, *cy], Distortion::NONE, rest)
        }
        ("OPENCV", [fx, fy, cx, cy, rest @ ..]) if rest.len() == 4 => {
            ([*fx, *fy, *cx, *cy], Distortion::NONE, rest)
        }
        ("FULL_OPENCV", [fx, fy, cx, cy, rest @ ..]) if rest.len() == 8 => {
            ([*fx, *fy, *cx, *cy], Distortion::Rational([0.0; 8]), rest)
        }
        ("OPENCV_FISHEYE", [fx, fy, cx, cy, rest @ ..]) if rest.len() == 4 => {
            ([*fx, *fy, *cx, *cy], Distortion::Fisheye([0.0; 4]), rest)
        }
        ("SIMPLE_RADIAL_FISHEYE", [f, cx, cy, rest @ ..]) if rest.len() == 1 => {
            ([*f, *f, *cx, *cy], Distortion::Fisheye([0.0; 4]), rest)
        }
        ("RADIAL_FISHEYE", [f, cx, cy, rest @ ..]) if rest.len() == 2 => {
            ([*f, *f, *cx, *cy], Distortion::Fisheye([0.0; 4]), rest)
        }
        _ => {
            let rule = format!("a camera of the model {model} has {count} parameters");
            return Err(format!("{rule}, and this has {}", parameters.len()));
        }
    };
    if let Some(number) = parameters.iter().find(|number| !number.is_finite()) {
        return Err(format!("parameters of a camera are finite, and this has {number}"));
    }
    let [fx, fy, ..] = intrinsics;
    if !(fx > 0.0 && fy > 0.0) {
        return Err(format!("focal lengths are above 0, and these are {fx} and {fy}"));
    }
    let size = Size { width: width as usize, height: height as usize };
    let distortion = kind.with_coefficients(rest);
    Ok(Camera { distortion, ..Camera::new(size, from_corner(intrinsics)) })
}
