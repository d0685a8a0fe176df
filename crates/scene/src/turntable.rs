//! A camera that goes once around what a scene's cameras look at, as if that stood on a turntable.

use std::f64::consts::TAU;

use bokashi_render_ops::camera::{look_at, opengl_to_opencv_view};
use glam::{DMat4, DVec3};

use crate::cameras::Camera;
use crate::gaze::gaze;
use crate::scene::Scene;
use crate::scene_view::SceneView;

/// The sine of the highest latitude of the circle: near the poles a camera would turn on the spot.
const STEEPEST: f64 = 0.985;
/// Means of directions shorter than this have none.
const LEAST_MEAN: f64 = 1e-3;
/// From the middle of a scene whose cameras have no distance, in its radii.
const USUAL_DISTANCE: f64 = 3.0;

/// A circle on which a camera moves, looking at its middle.
#[derive(Debug)]
struct Circle {
    /// What the camera looks at.
    middle: DVec3,
    /// The mean up direction of the cameras, of length 1, which is the circle's axis.
    up: DVec3,
    /// Where the circle starts, of length 1, at a right angle to `up`.
    start: DVec3,
    /// From the middle to the camera.
    distance: f64,
    /// The sine of the camera's latitude.
    tilt: f64,
}

impl Circle {
    /// At the mean height and distance of `cameras`, from the direction of `first` on. `ball` is the scene's.
    fn new(cameras: &[Camera], first: &Camera, (center, radius): (DVec3, f64)) -> Self {
        let middle = gaze(cameras).map_or(center, |(middle, _)| middle);
        let eye = |camera: &Camera| camera.opencv_pose().w_axis.truncate() - middle;
        let mean = |sum: f64| sum / cameras.len() as f64;
        let ups = cameras.iter().map(|camera| -camera.opencv_pose().y_axis.truncate());
        let up = ups.sum::<DVec3>() / cameras.len() as f64;
        let up = if up.length() > LEAST_MEAN { up.normalize() } else { DVec3::Y };
        let distance = mean(cameras.iter().map(|camera| eye(camera).length()).sum());
        let is_apart = distance.is_finite() && distance > LEAST_MEAN * radius;
        let height = mean(cameras.iter().map(|camera| eye(camera).dot(up)).sum());
        let (distance, tilt) = match is_apart {
            true => (distance, (height / distance).clamp(-STEEPEST, STEEPEST)),
            false => (USUAL_DISTANCE * radius, 0.0),
        };
        let along = eye(first).reject_from_normalized(up);
        let is_aside = is_apart && along.length() > LEAST_MEAN * distance;
        let start = if is_aside { along.normalize() } else { up.any_orthonormal_vector() };
        Self { middle, up, start, distance, tilt }
    }

    /// The world as the camera sees it after this share of the circle, counter-clockwise seen from above.
    fn view(&self, share: f64) -> DMat4 {
        let Self { middle, up, start, distance, tilt } = *self;
        let (sin, cos) = (TAU * share).sin_cos();
        let level = start * cos + up.cross(start) * sin;
        let eye = middle + distance * (level * (1.0 - tilt * tilt).sqrt() + up * tilt);
        opengl_to_opencv_view(look_at(eye, middle, up))
    }
}

impl Scene {
    /// The scene with `count` views in the place of its own: those of a camera that goes once around the place that
    /// the cameras look at ([`gaze`]), in steps of one angle. Its circle has the cameras' mean distance from
    /// there, their mean height and their mean up direction. It has the lens of the view with the widest angle,
    /// the first of several, and starts where that one stands. Where cameras meet nowhere, as a single one,
    /// it goes around the middle of the objects.
    ///
    /// `None` of a scene without views.
    pub fn turntable(&self, count: usize) -> Option<Self> {
        let width = |view: &SceneView| {
            let Camera { size, intrinsics: [focal, ..], .. } = view.camera;
            size.width as f64 / focal
        };
        // Of equal ones `max_by` has the last.
        let mut widest = self.views.first()?;
        for view in &self.views {
            if width(view) > width(widest) {
                widest = view;
            }
        }
        let cameras: Vec<Camera> = self.views.iter().map(|view| view.camera).collect();
        let circle = Circle::new(&cameras, &widest.camera, self.ball());
        let views = (0..count).map(|k| SceneView {
            name: format!("{k}"),
            image: None,
            mask: None,
            exposure: 0.0,
            camera: Camera { view: circle.view(k as f64 / count as f64), ..widest.camera },
            ..widest.clone()
        });
        Some(Self { views: views.collect(), ..self.clone() })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A scene of a small cube at (1, 2, 3) that these cameras see.
    fn scene(cameras: &[&str]) -> Scene {
        let folder = tempfile::tempdir().unwrap();
        let mut text = "[[meshes]]\nshape = \"cube\"\n\
                        place = { translation = [1, 2, 3], scale = 0.5 }\n"
            .to_owned();
        for (k, camera) in cameras.iter().enumerate() {
            let camera = format!("camera = {{ size = [20, 16], {camera} }}");
            text.push_str(&format!("[[views]]\nname = \"v{k}\"\n{camera}\n"));
        }
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        Scene::load(folder.path().join("scene.toml")).unwrap()
    }

    /// Eyes of a turntable of four views, after checks of what all of them have.
    fn eyes(scene: &Scene, middle: DVec3) -> Vec<DVec3> {
        let turned = scene.turntable(4).unwrap();
        assert_eq!(turned.views.len(), 4);
        let eyes: Vec<DVec3> = turned
            .views
            .iter()
            .map(|SceneView { camera, image, .. }| {
                assert!(camera.is_finite() && image.is_none());
                let at = camera.pixels()(middle).unwrap();
                assert!((at.x - 9.5).abs() < 1e-6 && (at.y - 7.5).abs() < 1e-6, "{at}");
                camera.opencv_pose().w_axis.truncate()
            })
            .collect();
        for picture in turned.pictures(1).unwrap() {
            let picture = picture.unwrap();
            assert!(picture.data().iter().all(|x| x.is_finite()));
            // The cube is seen in the middle.
            assert!(picture.data()[3 * (8 * 20 + 10)] > 0.5);
        }
        eyes
    }

    #[test]
    fn the_camera_goes_around_what_cameras_look_at_from_the_widest_on() {
        let middle = DVec3::new(1.0, 2.0, 3.0);
        // All as high above the horizon, so that their ups together are level.
        let rows =
            [(5.0, 0.0, 1.0, 30), (0.0, -5.0, 2.0, 40), (-5.0, 0.0, 1.0, 40), (0.0, 5.0, 2.0, 30)];
        let all = rows.map(|(x, z, scale, angle)| {
            let [x, y, z] = (middle + scale * DVec3::new(x, 2.0, z)).to_array();
            format!("angle = {angle}, position = [{x}, {y}, {z}], target = [1, 2, 3]")
        });
        let scene = scene(&all.each_ref().map(String::as_str));
        let eyes = eyes(&scene, middle);
        for (eye, towards) in eyes.iter().zip([DVec3::NEG_Z, DVec3::NEG_X, DVec3::Z, DVec3::X]) {
            let expected = middle + 1.5 * (5.0 * towards + 2.0 * DVec3::Y);
            assert!(eye.distance(expected) < 1e-9, "{eye} {expected}");
        }
        let focal = scene.turntable(4).unwrap().views[0].camera.intrinsics[0];
        assert_eq!(focal, scene.views[1].camera.intrinsics[0]);
    }

    #[test]
    fn cameras_that_give_no_circle_still_have_one() {
        let middle = DVec3::new(1.0, 2.0, 3.0);
        let at = |place: &str| format!("angle = 40, {place}");
        let above = "position = [1, 7, 3], target = [1, 2, 3], up";
        let upside = "position = [1, 2, 8], target = [1, 2, 3], up";
        // A pose in the place of a position: x and y of the camera, then where it looks.
        let far = "pose = [[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
        let cases = [
            vec![at("position = [1, 2, 8], target = [1, 2, 3]")],
            // From above alone, whatever is up in their images.
            vec![at(&format!("{above} = [1, 0, 0]")), at(&format!("{above} = [-1, 0, 0]"))],
            // Their ups cancel.
            vec![at(&format!("{upside} = [0, 1, 0]")), at(&format!("{upside} = [0, -1, 0]"))],
            // In the middle of what they look at; further than numbers reach.
            vec![at("position = [1, 2, 3], target = [1, 2, 9]")],
            vec![at(far)],
        ];
        for cameras in cases {
            let all: Vec<_> = cameras.iter().map(String::as_str).collect();
            let eyes = eyes(&scene(&all), middle);
            let distances = eyes.iter().map(|eye| eye.distance(middle));
            assert!(distances.clone().all(|x| (x - eyes[0].distance(middle)).abs() < 1e-9));
            for (k, eye) in eyes.iter().enumerate() {
                assert!(eye.distance(eyes[(k + 1) % 4]) > 0.2, "{cameras:?}: {eyes:?}");
            }
        }
        assert!(scene(&[]).turntable(4).is_none());
        assert!(scene(&[&at("position = [1, 2, 8]")]).turntable(0).unwrap().views.is_empty());
    }
}
