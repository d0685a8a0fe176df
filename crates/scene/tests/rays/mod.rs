//! Photographs by rays: nothing of the engine makes them but the file format.

use bokashi_core::Tensor;
use bokashi_scene::{ColorSpace, Picture, Place};
use glam::DVec3;

/// Rays along each side of a pixel.
const RAYS: usize = 8;

/// A ball whose colour is a function of the place on it.
pub(crate) struct Ball {
    pub(crate) center: DVec3,
    pub(crate) radius: f64,
    /// For each channel: waves along a direction, with a phase.
    waves: [[(DVec3, f64); 3]; 3],
}

/// A camera that looks at the origin, y up.
pub(crate) struct Eye {
    pub(crate) position: DVec3,
    /// Of view, horizontally, in degrees.
    pub(crate) angle: f64,
    pub(crate) pixels: usize,
}

impl Ball {
    /// A ball of many colours.
    pub(crate) fn motley(center: DVec3, radius: f64) -> Self {
        let waves = std::array::from_fn(|c| {
            std::array::from_fn(|k| {
                let at = (3 * c + k) as f64;
                let along = DVec3::new((1.0 + at).sin(), (2.0 + 3.0 * at).cos(), (5.0 * at).sin());
                ((3.0 + k as f64) * along, at)
            })
        });
        Self { center, radius, waves }
    }

    /// Linear light of a place on the ball.
    pub(crate) fn color(&self, place: DVec3) -> [f64; 3] {
        let own = (place - self.center) / self.radius;
        self.waves.map(|waves| {
            let sum: f64 = waves.iter().map(|(along, phase)| (along.dot(own) + phase).sin()).sum();
            0.5 + 0.14 * sum
        })
    }

    /// Where a ray from outside meets the ball.
    fn met(&self, from: DVec3, along: DVec3) -> Option<DVec3> {
        let to = self.center - from;
        let near = to.dot(along);
        let gap = self.radius * self.radius - (to - near * along).length_squared();
        (gap > 0.0 && near > 0.0).then(|| from + (near - gap.sqrt()) * along)
    }
}

/// The photograph, as a PNG with opacity.
pub(crate) fn photograph(balls: &[Ball], eye: &Eye) -> Vec<u8> {
    let light = light(balls, eye);
    let picture = Picture::of_color(&light, ColorSpace::Srgb).unwrap();
    picture.encode_png(&Place::of("photograph.png")).unwrap()
}

/// Light and opacity, `[pixels, pixels, 4]`; colours are not multiplied by opacity.
pub(crate) fn light(balls: &[Ball], eye: &Eye) -> Tensor<f32> {
    let Eye { position, angle, pixels } = *eye;
    let forward = (-position).normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let down = forward.cross(right);
    let half = (0.5 * angle.to_radians()).tan();
    let share = |at: usize, ray: usize| {
        let at = at as f64 + (ray as f64 + 0.5) / RAYS as f64;
        half * (2.0 * at / pixels as f64 - 1.0)
    };
    let mut light = vec![0.0_f32; pixels * pixels * 4];
    for (pixel, sum) in light.chunks_exact_mut(4).enumerate() {
        let (row, column) = (pixel / pixels, pixel % pixels);
        let mut total = [0.0; 4];
        for k in 0..RAYS * RAYS {
            let [x, y] = [share(column, k % RAYS), share(row, k / RAYS)];
            let along = (forward + x * right + y * down).normalize();
            let met = balls.iter().filter_map(|ball| Some((ball.met(position, along)?, ball)));
            let far = |(place, _): &(DVec3, &Ball)| place.distance(position);
            if let Some((place, ball)) = met.min_by(|a, b| far(a).total_cmp(&far(b))) {
                let [red, green, blue] = ball.color(place);
                for (total, part) in total.iter_mut().zip([red, green, blue, 1.0]) {
                    *total += part / (RAYS * RAYS) as f64;
                }
            }
        }
        // Colours of a PNG are not multiplied by opacity.
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum = match channel {
                3 => total[3],
                channel => total[channel] / total[3].max(1e-9),
            } as f32;
        }
    }
    Tensor::from_flat_fn([pixels, pixels, 4], |k| light[k])
}
