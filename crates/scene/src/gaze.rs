//! What cameras look at.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};

use crate::cameras::{Camera, Distortion};
use crate::object::Object;

/// From the centre of a pixel to its border.
const HALF: f64 = 0.5;
/// Axes that are more alike meet nowhere in particular: the least of the eigenvalues that a mean of them has.
const LEAST_SPREAD: f64 = 1e-6;

/// The share of an object's vertices, over all its instances, that lie in front of `camera` and inside its
/// image; 0 for an object without any. Nothing is asked about what hides them.
pub fn share_seen(object: &Object, camera: &Camera) -> f64 {
    let [width, height] = [camera.size.width, camera.size.height].map(|extent| extent as f64);
    let pixels = camera.pixels();
    let is_seen = |point: DVec3| {
        pixels(point).is_some_and(|pixel| {
            (-HALF..width - HALF).contains(&pixel.x) && (-HALF..height - HALF).contains(&pixel.y)
        })
    };
    let all = object.places.iter();
    let all =
        all.flat_map(|transform| object.points().map(|point| transform.transform_point3(point)));
    let (mut seen, mut count) = (0_usize, 0_usize);
    for point in all {
        seen += usize::from(is_seen(point));
        count += 1;
    }
    if count == 0 { 0.0 } else { seen as f64 / count as f64 }
}

/// The place that `cameras` look at, and the radius of the largest ball around it that each of them sees
/// whole: the place with the least sum of squared distances to their axes.
///
/// `None` where their axes have no such place, as those of a single camera, or where some camera does not
/// see it.
pub fn gaze(cameras: &[Camera]) -> Option<(DVec3, f64)> {
    let center = meeting_point(cameras)?;
    let radii = cameras.iter().map(|camera| seen_radius(camera, center));
    let radius = radii.fold(f64::INFINITY, f64::min);
    (radius > 0.0 && radius.is_finite()).then_some((center, radius))
}

/// [`gaze`] of a share of the cameras, those that see most: the place, and the median of the radii. Others may be close
/// or look elsewhere.
pub(crate) fn gaze_of_most(cameras: &[Camera], share: f64) -> Option<(DVec3, f64)> {
    let count = ((share * cameras.len() as f64).ceil() as usize).clamp(1, cameras.len().max(1));
    let mut kept = cameras.to_vec();
    let mut center = meeting_point(&kept)?;
    for _ in 0..2 {
        let by_radius = |camera: &Camera| -seen_radius(camera, center);
        kept = cameras.to_vec();
        kept.sort_by(|a, b| by_radius(a).total_cmp(&by_radius(b)));
        kept.truncate(count);
        center = meeting_point(&kept)?;
    }
    let mut radii: Vec<_> = kept.iter().map(|camera| seen_radius(camera, center)).collect();
    radii.sort_by(f64::total_cmp);
    let radius = radii[radii.len() / 2];
    (radius > 0.0 && radius.is_finite()).then_some((center, radius))
}

/// The place with the least sum of squared distances to the axes of `cameras`.
fn meeting_point(cameras: &[Camera]) -> Option<DVec3> {
    let count = cameras.len() as f64;
    let (mut across, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let pose = camera.opencv_pose();
        let along = pose.z_axis.truncate().normalize_or_zero();
        let outer = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
        let projection = DMat3::IDENTITY - outer;
        across += projection;
        sum += projection * pose.w_axis.truncate();
    }
    // The product of three numbers from 0 to 1, of which two are large wherever the third is small.
    if (across * (1.0 / count)).determinant() < LEAST_SPREAD {
        return None;
    }
    let center = across.inverse() * sum;
    center.is_finite().then_some(center)
}

/// The radius of the largest ball around `center` that a camera sees whole; not above 0 where it does not see it.
fn seen_radius(camera: &Camera, center: DVec3) -> f64 {
    let point = camera.view.transform_point3(center);
    let [.., cx, cy] = camera.intrinsics;
    let [width, height] = [camera.size.width, camera.size.height].map(|extent| extent as f64);
    // The axis, how far it is from the principal point to a side of the image, and the place along it.
    let sides = [
        (0, cx + HALF, point.x),
        (0, width - HALF - cx, -point.x),
        (1, cy + HALF, point.y),
        (1, height - HALF - cy, -point.y),
    ];
    if let Distortion::Fisheye(_) = camera.distortion {
        // The angle that is left between the ball's middle and the nearest side.
        let angles = sides.map(|(k, reach, _)| camera.angle_at(k, reach).unwrap_or(PI));
        let off = point.truncate().length().atan2(point.z);
        let gap = angles.into_iter().fold(PI, f64::min) - off;
        return point.length() * gap.min(FRAC_PI_2).sin();
    }
    // The planes through the eye and the sides of the image, as distances to them.
    let gaps = sides.map(|(k, reach, along)| {
        let f = camera.intrinsics[k];
        (f * along + reach * point.z) / f.hypot(reach)
    });
    gaps.into_iter().fold(point.z, f64::min)
}

#[cfg(test)]
mod tests {
    use bokashi_render_ops::Size;
    use bokashi_render_ops::camera::{look_at, opengl_to_opencv_view};
    use glam::DMat4;

    use super::*;
    use crate::model::Model;
    use crate::shapes;

    /// A camera with an angle of view of 90 degrees across 100 pixels.
    fn camera(position: DVec3, target: DVec3) -> Camera {
        let size = Size { width: 100, height: 50 };
        let view = opengl_to_opencv_view(look_at(position, target, DVec3::Y));
        Camera { view, ..Camera::new(size, [50.0, 50.0, 49.5, 24.5]) }
    }

    fn cube(place: DMat4) -> Object {
        let (name, model) = ("cube".to_owned(), Model::default());
        Object::from_geometry(name, &shapes::cube(12), &model, vec![place]).unwrap()
    }

    #[test]
    fn what_lies_beside_or_behind_is_not_seen() {
        let camera_in_front = camera(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO);
        let share = |x: f64, z: f64| {
            share_seen(&cube(DMat4::from_translation(DVec3::new(x, 0.0, z))), &camera_in_front)
        };
        assert_eq!(share(0.0, 0.0), 1.0);
        assert_eq!(share(0.0, 20.0), 0.0);
        assert_eq!(share(100.0, 0.0), 0.0);
        // The image ends at x = 9 for the front of the cube, and at x = 11 for its back.
        assert_eq!(share(9.9, 0.0), 0.75);
        let empty = Object { places: vec![], ..cube(DMat4::IDENTITY) };
        assert_eq!(share_seen(&empty, &camera_in_front), 0.0);
    }

    #[test]
    fn cameras_around_a_place_look_at_it() {
        let target = DVec3::new(3.0, -2.0, 1.0);
        let around = [DVec3::X, DVec3::Z, DVec3::new(-1.0, 0.5, 0.5)];
        let all = around.map(|towards| camera(target + 10.0 * towards.normalize(), target));
        let (center, radius) = gaze(&all).unwrap();
        assert!(center.abs_diff_eq(target, 1e-9), "{center}");
        // The image is 25 pixels high on each side of its middle.
        let expected = 10.0 * (25.0_f64 / 50.0).atan().sin();
        assert!((radius - expected).abs() < 1e-9, "{radius} and not {expected}");
    }

    #[test]
    fn axes_that_do_not_meet_in_front_have_no_place() {
        let along = camera(DVec3::Z, DVec3::ZERO);
        let beside = camera(DVec3::new(1.0, 0.0, 1.0), DVec3::X);
        assert_eq!(gaze_of_most(&[], 0.8), None);
        assert_eq!(gaze(&[]), None);
        assert_eq!(gaze(&[along]), None);
        assert_eq!(gaze(&[along, beside]), None, "parallel");
        let away = [DVec3::X, DVec3::Z].map(|eye| camera(eye, 2.0 * eye));
        assert_eq!(gaze(&away), None, "back to back");
    }
}
