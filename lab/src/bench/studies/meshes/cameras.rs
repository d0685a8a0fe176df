//! The cameras around a mesh: two rings of twelve.

use std::f64::consts::PI;

use bokashi_render_ops::camera::{look_at, perspective};
use glam::{DMat4, DVec3};

const RINGS: [f64; 2] = [10.0, 40.0];
const AROUND: usize = 12;
/// Half the image's width at the distance 1: the paper's.
const HALF_WIDTH: f64 = 0.4;
/// From the middle: a sphere of radius 1 is seen whole, with a margin of a fiftieth.
const DISTANCE: f64 = 2.75;

/// From the world to clip space. The rings are 10 and 40 degrees above the ground, y up; those of the
/// second look from between those of the first.
pub(super) fn cameras() -> Vec<DMat4> {
    let projection = perspective(2.0 * HALF_WIDTH.atan(), 1.0, 1.0, 10.0);
    let eyes = RINGS.iter().enumerate().flat_map(|(ring, elevation)| {
        let (rise, out) = elevation.to_radians().sin_cos();
        (0..AROUND).map(move |k| {
            let (sine, cosine) = (PI * (2 * k + ring) as f64 / AROUND as f64).sin_cos();
            DISTANCE * DVec3::new(out * sine, rise, out * cosine)
        })
    });
    eyes.map(|eye| projection * look_at(eye, DVec3::ZERO, DVec3::Y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_sees_the_whole_sphere_from_a_place_of_its_own() {
        let cameras = cameras();
        assert_eq!(cameras.len(), 24);
        let mut largest: f64 = 0.0;
        for (at, camera) in cameras.iter().enumerate() {
            let middle = *camera * DVec3::ZERO.extend(1.0);
            assert!(
                middle.truncate().truncate().length() < 1e-12
                    && (middle.w - DISTANCE).abs() < 1e-12
            );
            // Points all over the sphere.
            for k in 0..2000 {
                let height = 1.0 - (2 * k + 1) as f64 / 2000.0;
                let (sine, cosine) = (2.4 * k as f64).sin_cos();
                let out = (1.0 - height * height).sqrt();
                let clip = *camera * DVec3::new(out * cosine, height, out * sine).extend(1.0);
                let ndc = clip.truncate() / clip.w;
                assert!(ndc.abs().max_element() < 1.0, "camera {at}: {ndc}");
                largest = largest.max(ndc.x.abs());
            }
            let apart = |other: &DMat4| (*camera - *other).to_cols_array().map(f64::abs);
            let same = |other: &DMat4| apart(other).iter().all(|entry| *entry < 1e-6);
            assert!(!cameras[..at].iter().any(same), "camera {at}");
        }
        assert!(largest > 0.9, "{largest}");
    }
}
