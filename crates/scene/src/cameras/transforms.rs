//! `transforms.json`, as NeRF's synthetic scenes, instant-ngp and nerfstudio have it.
//!
//! # What is read
//! - Of all frames, or of a frame by itself: `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1` to `k6`,
//!   `p1`, `p2`, and `camera_angle_x`, `camera_angle_y`, the whole angles of view in radians.
//!   A focal length goes before an angle, what a frame says before what is said of all. Without
//!   `fl_y` and its angle pixels are square. Without `cx` and `cy` the principal point is the
//!   middle.
//! - `camera_model`: PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV, OPENCV by default.
//!   Any of them has the coefficients that are given, k1, k2, k3, p1, p2. FULL_OPENCV has k4, k5 and k6, too.
//!   OPENCV_FISHEYE has k1 to k4 of OpenCV's module `fisheye`, as instant-ngp's `is_fisheye` has.
//! - `frames`, each with `file_path`, from the folder of this file, and `transform_matrix`, camera
//!   to world, of 3 or 4 rows. A path may lack its ending: `.png`, `.jpg`, `.jpeg` and `.exr` are
//!   tried. Where `w` or `h` is missing, both are those of the image.
//! - nerfstudio's `mask_path` of a frame. There a mask is black where pixels do not count; here they
//!   count as background.
//!
//! Camera coordinates are OpenGL's, and the corner of the first pixel is (0, 0).
//!
//! # What is left out
//! What makes another camera is refused: coefficients that the model lacks, instant-ngp's `ftheta_p0` to
//! `ftheta_p4`, `latlong` and `rolling_shutter`, and axes of other programs, `from_mitsuba` and `from_na`.
//! Keys that say nothing of a camera or an image are ignored, as `aabb_scale` and `applied_transform`: the world
//! is the one in which the poses are given. A note names all keys that are not known: see `keys`.
//!
//! # Source
//! The code of Mildenhall et al., *NeRF*, 2020, of instant-ngp (`src/nerf_loader.cu`, `scripts/colmap2nerf.py`)
//! and of nerfstudio (`data/dataparsers/nerfstudio_dataparser.py`).

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use bokashi_description::json_message;
use bokashi_render_ops::Size;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::camera::{Camera, NamedView, from_corner, to_corner};
use super::camera_file::CameraFile;
use super::distortion::Distortion;
use super::keys::{self, Keys};
use super::rotation::pose;
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::picture::Picture;

/// Models whose lens is that of OpenCV, with some coefficients 0; and those of others.
const MODELS: [&str; 5] = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"];
const RATIONAL: &str = "FULL_OPENCV";
const FISHEYE: &str = "OPENCV_FISHEYE";
/// What a path may lack.
const ENDINGS: [&str; 6] = ["", ".png", ".jpg", ".jpeg", ".exr", ".hdr"];
/// The most columns or rows of an image.
const LONGEST: f64 = 65535.0;

/// What is said of a camera, of all frames or of one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Lens {
    camera_model: Option<String>,
    #[serde(skip_serializing)]
    is_fisheye: Option<bool>,
    #[serde(skip_serializing)]
    camera_angle_x: Option<f64>,
    #[serde(skip_serializing)]
    camera_angle_y: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    p1: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    p2: Option<f64>,
    k3: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k4: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k5: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k6: Option<f64>,
    // Of any kind, and refused where they say something.
    #[serde(skip_serializing)]
    latlong: Option<Value>,
    #[serde(skip_serializing)]
    rolling_shutter: Option<Value>,
    #[serde(skip_serializing)]
    from_mitsuba: Option<Value>,
    #[serde(skip_serializing)]
    from_na: Option<Value>,
}

/// What else is said of a frame.
#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
}

/// A file, of whose frames only `F` is read.
#[derive(Debug, Deserialize)]
struct Frames<F> {
    frames: Vec<F>,
}

#[derive(Debug, Serialize)]
struct WrittenFrame {
    file_path: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mask_path: Option<String>,
    #[serde(flatten)]
    lens: Option<Lens>,
    transform_matrix: [[f64; 4]; 4],
}

#[derive(Debug, Serialize)]
struct Written {
    #[serde(flatten)]
    lens: Option<Lens>,
    frames: Vec<WrittenFrame>,
}

/// The views of the file `path` in `folder`, in the file's order. A view's name is its `file_path`.
///
/// A pose that is a rotation only to 0.001 becomes the nearest rotation. Cameras of images that are smaller than
/// they by a whole factor are scaled with them; a note says so, and another names keys that are not known.
///
/// # Errors
/// - [`SceneError::Read`] and [`SceneError::Outside`] where the file can't be read, or an image
///   lies outside the folder.
/// - [`SceneError::Content`] for what is no such file, with its line and column; for a frame
///   without an image in the folder, with another frame's image, with a camera of a lens that
///   OpenCV has not, or with a pose that is further from a rotation.
pub fn read_transforms(folder: &Folder, path: impl AsRef<Path>) -> Result<CameraFile, SceneError> {
    let path = path.as_ref();
    let text = folder.read_text(path)?;
    let location = Location::new(folder.join(path));
    // Piece by piece, since what serde flattens has no line. A frame has a path and a matrix, so that there are
    // not many more than the text has lines.
    let frames: Frames<Frame> = parsed(&text, &location)?;
    let common: Lens = parsed(&text, &location)?;
    let lenses: Frames<Lens> = parsed(&text, &location)?;
    let (all, keys_of_frames): (Keys, Frames<Keys>) =
        (parsed(&text, &location)?, parsed(&text, &location)?);
    let mut notes = keys::notes(&all, &keys_of_frames.frames)
        .map_err(|rule| SceneError::content(location.clone(), rule))?;
    let mut names = BTreeSet::new();
    let views = lenses.frames.into_iter().zip(frames.frames).map(|(lens, frame)| {
        let file_path = frame.file_path.replace('\\', "/");
        let name = file_path.strip_prefix("./").unwrap_or(&file_path).to_owned();
        let content = |message: String| {
            SceneError::content(location.clone(), format!("frame {name:?}: {message}"))
        };
        if !names.insert(name.clone()) {
            return Err(content(
                "a frame has an image of its own, and this is repeated".to_owned(),
            ));
        }
        let image = image_of(folder, path, &name, &location)?;
        let mask = frame.mask_path.filter(|mask| !mask.is_empty());
        let mask = mask.map(|mask| mask_of(folder, path, &mask));
        let lens = lens.or(&common);
        let size = match (lens.w, lens.h) {
            (Some(width), Some(height)) => whole_size([width, height]).map_err(content)?,
            _ => {
                let [width, height] = Picture::read_size(folder, &image)?;
                Size { width, height }
            }
        };
        let camera = lens.camera(size).map_err(content)?;
        let camera = camera.with_opengl_pose(pose(&frame.transform_matrix).map_err(content)?);
        if !camera.is_finite() {
            let rule = "a camera's angles and pose give finite numbers, and these are too extreme";
            return Err(content(rule.to_owned()));
        }
        Ok(NamedView { name, image, mask, camera })
    });
    let views = views.collect::<Result<Vec<NamedView>, _>>()?;
    let masked = views.iter().filter(|view| view.mask.is_some()).count();
    if masked > 0 {
        let note = format!("the masks that `mask_path` names, {masked}, show where objects are");
        notes
            .push(format!("{note}: black is background here, and in nerfstudio it does not count"));
    }
    Ok(CameraFile { views, notes }.sized(folder))
}

/// The text of a `transforms.json` with these views, in the order given. Reading it again answers
/// the same, to rounding; the views' names become the paths of their images.
///
/// What all cameras share is said once. Numbers that are not finite are written as `null`.
pub fn transforms_json(views: &[NamedView]) -> String {
    let mut lenses = views.iter().map(|view| Lens::from_camera(&view.camera));
    let first = lenses.next();
    let is_shared = lenses.all(|lens| Some(&lens) == first.as_ref());
    let frames = views.iter().map(|view| WrittenFrame {
        file_path: slashes(&view.image),
        mask_path: view.mask.as_deref().map(slashes),
        lens: (!is_shared).then(|| Lens::from_camera(&view.camera)),
        transform_matrix: view.camera.opengl_pose().transpose().to_cols_array_2d(),
    });
    let written = Written { frames: frames.collect(), lens: first.filter(|_| is_shared) };
    // Strings and numbers always have a text.
    serde_json::to_string_pretty(&written).unwrap_or_default()
}

/// A path as the file has it.
fn slashes(path: &Path) -> String {
    path.to_string_lossy().replace('\\', "/")
}

fn parsed<'t, F: Deserialize<'t>>(text: &'t str, location: &Location) -> Result<F, SceneError> {
    serde_json::from_str(text).map_err(|error| {
        let [line, column] =
            [error.line(), error.column()].map(|count| Some(count).filter(|count| *count > 0));
        let location = Location { line, column, ..location.clone() };
        let rule = json_message(&error);
        SceneError::content(location, format!("a file of cameras is JSON with frames: {rule}"))
    })
}

/// The file of a mask, whose path is given as that of an image. One that is missing is missed when its turn
/// comes.
fn mask_of(folder: &Folder, path: &Path, mask: &str) -> PathBuf {
    let mask = mask.replace('\\', "/");
    let parent = path.parent().unwrap_or(Path::new(""));
    parent
        .strip_prefix(folder.path())
        .unwrap_or(parent)
        .join(mask.strip_prefix("./").unwrap_or(&mask))
}

/// The file of an image, whose path is given from the folder of the file of cameras.
fn image_of(
    folder: &Folder,
    path: &Path,
    name: &str,
    location: &Location,
) -> Result<PathBuf, SceneError> {
    let parent = path.parent().unwrap_or(Path::new(""));
    // Relative to the folder, also where the file of cameras was not.
    let parent = parent.strip_prefix(folder.path()).unwrap_or(parent);
    for ending in ENDINGS {
        let image = parent.join(format!("{name}{ending}"));
        match folder.find(&image) {
            Ok(file) if file.is_file() => return Ok(image),
            Err(error @ SceneError::Outside { .. }) => return Err(error),
            _ => {}
        }
    }
    let rule = "a frame has an image, with or without the ending .png, .jpg, .jpeg or .exr";
    let message =
        format!("{rule}, and there is none at {}", folder.join(parent).join(name).display());
    Err(SceneError::content(location.clone(), message))
}

/// A size of whole pixels.
fn whole_size(size: [f64; 2]) -> Result<Size, String> {
    let is_whole = |extent: f64| extent.fract() == 0.0 && (1.0..=LONGEST).contains(&extent);
    match size {
        [width, height] if is_whole(width) && is_whole(height) => {
            Ok(Size { width: width as usize, height: height as usize })
        }
        [width, height] => {
            let rule = format!("w and h are whole numbers from 1 to {LONGEST}");
            Err(format!("{rule}, and these are {width} and {height}"))
        }
    }
}

impl Lens {
    fn from_camera(camera: &Camera) -> Self {
        let [fx, fy, cx, cy] = to_corner(camera.intrinsics).map(Some);
        let [w, h] = [camera.size.width, camera.size.height].map(|extent| Some(extent as f64));
        let lens = Self { w, h, fl_x: fx, fl_y: fy, cx, cy, ..Self::default() };
        match camera.distortion {
            Distortion::Polynomial(coefficients) => {
                let [k1, k2, p1, p2, k3] = coefficients.map(Some);
                let camera_model = Some("OPENCV".to_owned());
                Self { camera_model, k1, k2, p1, p2, k3, ..lens }
            }
            Distortion::Rational(coefficients) => {
                let [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients.map(Some);
                let camera_model = Some(RATIONAL.to_owned());
                Self { camera_model, k1, k2, p1, p2, k3, k4, k5, k6, ..lens }
            }
            Distortion::Fisheye(coefficients) => {
                let [k1, k2, k3, k4] = coefficients.map(Some);
                Self { camera_model: Some(FISHEYE.to_owned()), k1, k2, k3, k4, ..lens }
            }
        }
    }

    /// What is said here, and where nothing is, what is said of all frames.
    fn or(self, all: &Self) -> Self {
        // A focal length of all frames does not go before an angle of this one.
        let mut all = all.clone();
        if self.fl_x.is_some() || self.camera_angle_x.is_some() {
            (all.fl_x, all.camera_angle_x) = (None, None);
        }
        if self.fl_y.is_some() || self.camera_angle_y.is_some() {
            (all.fl_y, all.camera_angle_y) = (None, None);
        }
        macro_rules! first {
            ($($key:ident)*) => { Self { $($key: self.$key.or(all.$key),)* } };
        }
        first!(camera_model is_fisheye camera_angle_x camera_angle_y w h fl_x fl_y cx cy
            k1 k2 p1 p2 k3 k4 k5 k6 latlong rolling_shutter from_mitsuba from_na)
    }

    /// The lens by its model and coefficients.
    fn distortion(&self) -> Result<Distortion, String> {
        let numbers = |coefficients: &[Option<f64>]| -> Vec<f64> {
            coefficients.iter().copied().map(Option::unwrap_or_default).collect()
        };
        let filled = |kind: Distortion, coefficients: &[Option<f64>]| {
            kind.with_coefficients(&numbers(coefficients))
        };
        let &Self { k1, k2, k3, k4, k5, k6, p1, p2, .. } = self;
        let named = self.camera_model.as_deref();
        let is_fisheye = named == Some(FISHEYE);
        if let (Some(model), Some(flag)) = (named, self.is_fisheye)
            && is_fisheye != flag
        {
            return Err(format!("camera_model is {model}, and is_fisheye is {flag}"));
        }
        let (lens, more) = if is_fisheye || self.is_fisheye == Some(true) {
            let lens = filled(Distortion::Fisheye([0.0; 4]), &[k1, k2, k3, k4]);
            (lens, [("p1", p1), ("p2", p2), ("k5", k5), ("k6", k6)])
        } else if named == Some(RATIONAL) {
            let all = [k1, k2, p1, p2, k3, k4, k5, k6];
            (filled(Distortion::Rational([0.0; 8]), &all), [("", None); 4])
        } else if named.is_none_or(|model| MODELS.contains(&model)) {
            let lens = filled(Distortion::NONE, &[k1, k2, p1, p2, k3]);
            (lens, [("k4", k4), ("k5", k5), ("k6", k6), ("", None)])
        } else {
            let all = MODELS.into_iter().chain([RATIONAL, FISHEYE]).collect::<Vec<_>>().join(", ");
            let model = named.unwrap_or_default();
            return Err(format!("a camera_model is {all}, and this is {model}"));
        };
        match more
            .into_iter()
            .find_map(|(key, number)| Some((key, number.filter(|number| *number != 0.0)?)))
        {
            None => Ok(lens),
            Some((key, number)) => {
                let rule = match lens {
                    Distortion::Fisheye(_) => "a fisheye has k1, k2, k3 and k4",
                    _ => "a lens has k1, k2, k3, p1 and p2, and more only as FULL_OPENCV",
                };
                Err(format!("{rule}, and {key} is {number}"))
            }
        }
    }

    /// Refuses what makes another camera.
    fn check(&self) -> Result<(), String> {
        let says_something = |value: &&Value| match value {
            Value::Null | Value::Bool(false) => false,
            Value::Array(all) => all.iter().any(|value| value.as_f64() != Some(0.0)),
            _ => true,
        };
        let rule = "a camera is one of OpenCV's, and all of its image is taken at once";
        let rules = [
            ("latlong", &self.latlong, rule),
            ("rolling_shutter", &self.rolling_shutter, rule),
            ("from_mitsuba", &self.from_mitsuba, "poses are those of NeRF's axes"),
            ("from_na", &self.from_na, "poses are those of NeRF's axes"),
        ];
        let broken = rules
            .into_iter()
            .find(|(_, value, _)| value.as_ref().is_some_and(|v| says_something(&v)));
        broken
            .map_or(Ok(()), |(key, _, rule)| Err(format!("{rule}, and {key} says something else")))
    }

    /// The camera at the origin.
    fn camera(&self, size: Size) -> Result<Camera, String> {
        self.check()?;
        let distortion = self.distortion()?;
        let extents = [size.width as f64, size.height as f64];
        let focal_from_angle = |angle: Option<f64>, extent: f64| match angle {
            Some(angle) if 0.0 < angle && angle < std::f64::consts::PI => {
                Ok(Some(0.5 * extent / (0.5 * angle).tan()))
            }
            Some(angle) => {
                Err(format!("an angle of view lies between 0 and pi, and this is {angle}"))
            }
            None => Ok(None),
        };
        let found_x = self
            .fl_x
            .map_or_else(|| focal_from_angle(self.camera_angle_x, extents[0]), |f| Ok(Some(f)));
        let found_y = self
            .fl_y
            .map_or_else(|| focal_from_angle(self.camera_angle_y, extents[1]), |f| Ok(Some(f)));
        let (fx, fy) = match (found_x?, found_y?) {
            (Some(fx), Some(fy)) => (fx, fy),
            (Some(f), None) | (None, Some(f)) => (f, f),
            (None, None) => {
                return Err("a camera has fl_x or camera_angle_x, and this has neither".to_owned());
            }
        };
        if !(fx > 0.0 && fy > 0.0) {
            return Err(format!("focal lengths are above 0, and these are {fx} and {fy}"));
        }
        let cx = self.cx.unwrap_or(extents[0] / 2.0);
        let cy = self.cy.unwrap_or(extents[1] / 2.0);
        Ok(Camera { distortion, ..Camera::new(size, from_corner([fx, fy, cx, cy])) })
    }
}
