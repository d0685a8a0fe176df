//! The camera that an entry of a scene describes.

use bokashi_render_ops::Size;
use bokashi_render_ops::camera::{
    fisheye_limit, fisheye_radius, look_at, opengl_to_opencv_pose, opengl_to_opencv_view,
};
use glam::{DMat3, DMat4, DVec3, DVec4};

use crate::cameras::{Camera, Distortion};
use crate::description::{CameraEntry, Coefficients, Convention, Finite};

/// How far from a rotation a pose may be, entry by entry.
const RIGID_TOLERANCE: f64 = 1e-3;
/// The least sine between where a camera looks and its up direction.
const LEAST_SINE: f64 = 1e-9;

/// The camera of `entry` whose images have `width` and `height`.
///
/// # Errors
/// The rule that it breaks.
pub(crate) fn camera(
    entry: &CameraEntry,
    [width, height]: [usize; 2],
) -> Result<Camera, &'static str> {
    let extent = [width, height].map(|extent| extent as f64);
    let distortion = match (entry.distortion, entry.fisheye) {
        (None, None) => Distortion::NONE,
        (Some(Coefficients::Five(coefficients)), None) => {
            Distortion::Polynomial(coefficients.map(|x| x.0))
        }
        (Some(Coefficients::Eight(coefficients)), None) => {
            Distortion::Rational(coefficients.map(|x| x.0))
        }
        (None, Some(coefficients)) => Distortion::Fisheye(coefficients.map(|x| x.0)),
        (Some(_), Some(_)) => return Err("a lens has either `distortion` or `fisheye`"),
    };
    let focal = match (entry.focal, entry.angle) {
        (Some(focal), None) => focal.0,
        (None, Some(angle)) if let Distortion::Fisheye(lens) = distortion => {
            let half = 0.5 * angle.0.to_radians();
            if half > fisheye_limit(lens) {
                return Err("the `angle` of a fisheye is one that its coefficients reach");
            }
            [0.5 * extent[0] / fisheye_radius(half, lens); 2]
        }
        (None, Some(angle)) if angle.0 < 180.0 => {
            [0.5 * extent[0] / (0.5 * angle.0.to_radians()).tan(); 2]
        }
        _ => return Err("a camera has either `focal`, or an `angle` below 180 degrees"),
    };
    let middle = extent.map(|extent| 0.5 * (extent - 1.0));
    let center = entry.center.map_or(middle, |center| center.map(|x| x.0));
    let size = Size { width, height };
    let intrinsics = [focal[0], focal[1], center[0], center[1]];
    let camera = Camera { size, intrinsics, distortion, view: view(entry)? };
    match camera.is_finite() {
        true => Ok(camera),
        false => Err("a camera's angle and place give finite numbers, and these are too extreme"),
    }
}

/// World to camera, in OpenCV's convention.
fn view(entry: &CameraEntry) -> Result<DMat4, &'static str> {
    match (entry.pose, entry.position) {
        (Some(rows), None) if entry.target.is_none() && entry.up.is_none() => {
            let rows = rows.map(|row| DVec4::from_array(row.map(|x| x.0)));
            let pose = DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
            let pose = match entry.convention {
                Convention::Opencv => pose,
                Convention::Opengl => opengl_to_opencv_pose(pose),
            };
            let turn = DMat3::from_mat4(pose);
            let off = turn.transpose() * turn - DMat3::IDENTITY;
            let is_rigid = off.to_cols_array().iter().all(|x| x.abs() < RIGID_TOLERANCE);
            match is_rigid && turn.determinant() > 0.0 && rows[3] == DVec4::W {
                true => Ok(pose.inverse()),
                false => Err("a pose is a rotation and a translation, above the row 0 0 0 1"),
            }
        }
        (None, Some(position)) => {
            let vector = |given: Option<[Finite; 3]>, default| {
                given.map_or(default, |v| DVec3::from_array(v.map(|x| x.0)))
            };
            let position = DVec3::from_array(position.map(|x| x.0));
            let (target, up) = (vector(entry.target, DVec3::ZERO), vector(entry.up, DVec3::Y));
            let along = (target - position).normalize_or_zero();
            match along.cross(up.normalize_or_zero()).length() >= LEAST_SINE {
                true => Ok(opengl_to_opencv_view(look_at(position, target, up))),
                false => Err("a camera looks at another place than its own, and not along `up`"),
            }
        }
        _ => Err("a camera has either `pose`, or `position` and perhaps `target` and `up`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_of_a_fisheye_is_what_its_image_sees() {
        let text = "angle = 200\nfisheye = [0.1, 0, 0, 0]\nposition = [0, 0, 3]";
        let entry: CameraEntry = toml::from_str(text).unwrap();
        let camera = camera(&entry, [100, 80]).unwrap();
        let angle = 2.0 * camera.angle_at(0, 50.0).unwrap().to_degrees();
        assert!((angle - 200.0).abs() < 1e-9, "{angle}");
        let entry = |numbers: &str| {
            let text = format!("distortion = {numbers}\nfocal = 3\nposition = [0, 0, 3]");
            toml::from_str::<CameraEntry>(&text).map_err(|error| error.message().to_owned())
        };
        assert!(entry("[1, 2, 3, 4, 5, 6, 7, 8]").is_ok());
        // Four would be a fisheye's.
        let rule = "a list of 5 or 8 finite numbers is needed here";
        assert!(entry("[1, 2, 3, 4]").unwrap_err().contains(rule));
    }

    #[test]
    fn numbers_that_leave_their_range_are_refused() {
        let place = "position = [0, 0, 3]";
        let fisheye = "fisheye = [0, 0, 0, 0]";
        let rows = |x: &str| {
            format!(
                "focal = 3\npose = [[1, 0, 0, {x}], [0, 1, 0, {x}], [0, 0, 1, {x}], [0, 0, 0, 1]]"
            )
        };
        let cases = [
            (format!("angle = 40\n{place}"), ""),
            (format!("angle = 1e-320\n{place}"), "these are too extreme"),
            (format!("angle = 180\n{place}"), "an `angle` below 180 degrees"),
            (format!("angle = 299\n{fisheye}\n{place}"), ""),
            (format!("angle = 301\n{fisheye}\n{place}"), "one that its coefficients reach"),
            (
                format!("focal = 3\n{fisheye}\ndistortion = [0, 0, 0, 0, 0]\n{place}"),
                "either `distortion` or `fisheye`",
            ),
            (
                "focal = 3\nposition = [1e308, 1e308, 1e308]".to_owned(),
                "another place than its own",
            ),
            (format!("focal = 3\n{place}\nup = [0, 0, 1]"), "not along `up`"),
            (rows("1e300"), ""),
            (
                rows("1.7e308")
                    .replace("[[1, 0, 0", "[[0.8, 0.6, 0")
                    .replace("[0, 1, 0", "[-0.6, 0.8, 0"),
                "these are too extreme",
            ),
            (rows("1").replace("[[1,", "[[-1,"), "a pose is a rotation"),
        ];
        for (text, expected) in cases {
            let entry: CameraEntry = toml::from_str(&text).unwrap();
            let message = camera(&entry, [4, 3]).err().unwrap_or_default();
            assert!(
                message.contains(expected) && message.is_empty() == expected.is_empty(),
                "{text}: {message}"
            );
        }
    }
}
