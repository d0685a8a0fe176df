//! Photographs by rays: nothing of the engine makes them but the file format.

use bokashi_core::Tensor;
use bokashi_scene::{ColorSpace, Location, Picture};
use glam::DVec3;

/// Rays along each side of a pixel.
const RAYS: usize = 8;
/// Rays of each pixel through a lens.
const LENS_RAYS: usize = 512;

/// A ball whose colour is a function of the place on it.
pub(crate) struct Ball {
    pub(crate) center: DVec3,
    pub(crate) radius: f64,
    /// For each channel: waves along a direction, with a phase.
    waves: [[(DVec3, f64); 3]; 3],
    /// Where light comes from, of an irradiance of pi; without one, the ball shows its colours.
    light: Option<DVec3>,
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
                let coordinate = (3 * c + k) as f64;
                let along = DVec3::new(
                    (1.0 + coordinate).sin(),
                    (2.0 + 3.0 * coordinate).cos(),
                    (5.0 * coordinate).sin(),
                );
                ((6.0 + 2.0 * k as f64) * along, coordinate)
            })
        });
        Self { center, radius, waves, light: None }
    }

    /// The ball under light from a direction, and nothing else.
    pub(crate) fn lit(self, direction: DVec3) -> Self {
        Self { light: Some(direction.normalize()), ..self }
    }

    /// Linear light of a place on the ball.
    pub(crate) fn color(&self, place: DVec3) -> [f64; 3] {
        let normal = (place - self.center) / self.radius;
        let share = self.light.map_or(1.0, |light| light.dot(normal).max(0.0));
        self.waves.map(|waves| {
            let sum: f64 =
                waves.iter().map(|(along, phase)| (along.dot(normal) + phase).sin()).sum();
            share * (0.5 + 0.14 * sum)
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

impl Eye {
    /// The focal length in pixels.
    pub(crate) fn focal_length(&self) -> f64 {
        0.5 * self.pixels as f64 / (0.5 * self.angle.to_radians()).tan()
    }

    fn rays(&self) -> Rays {
        let forward = (-self.position).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let slope = (0.5 * self.angle.to_radians()).tan();
        Rays { forward, right, down: forward.cross(right), slope, pixels: self.pixels as f64 }
    }
}

/// The rays of a camera through its image.
struct Rays {
    forward: DVec3,
    right: DVec3,
    down: DVec3,
    /// Of the rays at the left and right border.
    slope: f64,
    pixels: f64,
}

impl Rays {
    /// The direction of a ray through a place in the image, in pixels.
    fn along(&self, coordinate: [f64; 2]) -> DVec3 {
        let [x, y] =
            coordinate.map(|coordinate| self.slope * (2.0 * coordinate / self.pixels - 1.0));
        (self.forward + x * self.right + y * self.down).normalize()
    }

    /// Whether some ray of a pixel, whose middle's is `along`, may meet the ball.
    fn may_meet(&self, ball: &Ball, from: DVec3, along: DVec3) -> bool {
        let to = ball.center - from;
        // The corners of a pixel are sqrt 2 of half its side away.
        let reach = ball.radius + 1.5 * self.slope / self.pixels * to.length();
        (to - to.dot(along) * along).length_squared() < reach * reach
    }
}

/// The photograph, as a PNG with opacity.
pub(crate) fn photograph(balls: &[Ball], eye: &Eye) -> Vec<u8> {
    let light = light(balls, eye);
    let picture = Picture::from_color(&light, ColorSpace::Srgb).unwrap();
    picture.encode_png(&Location::new("photograph.png")).unwrap()
}

/// What a ray meets first.
fn color_along<'a>(
    balls: impl IntoIterator<Item = &'a Ball>,
    from: DVec3,
    along: DVec3,
) -> Option<[f64; 3]> {
    let met = balls.into_iter().filter_map(|ball| Some((ball.met(from, along)?, ball)));
    let far = |(place, _): &(DVec3, &Ball)| place.distance(from);
    met.min_by(|a, b| far(a).total_cmp(&far(b))).map(|(place, ball)| ball.color(place))
}

/// Light and opacity, `[pixels, pixels, 4]`; colours are not multiplied by opacity.
pub(crate) fn light(balls: &[Ball], eye: &Eye) -> Tensor<f32> {
    let Eye { position, pixels, .. } = *eye;
    let rays = eye.rays();
    let mut light = vec![0.0_f32; pixels * pixels * 4];
    let mut near: Vec<&Ball> = Vec::new();
    for (pixel, sum) in light.chunks_exact_mut(4).enumerate() {
        let (row, column) = (pixel / pixels, pixel % pixels);
        let middle = rays.along([column as f64 + 0.5, row as f64 + 0.5]);
        near.clear();
        near.extend(balls.iter().filter(|ball| rays.may_meet(ball, position, middle)));
        if near.is_empty() {
            continue;
        }
        let mut total = [0.0; 4];
        for k in 0..RAYS * RAYS {
            let coordinate = [(column, k % RAYS), (row, k / RAYS)];
            let along = rays.along(
                coordinate
                    .map(|(coordinate, ray)| coordinate as f64 + (ray as f64 + 0.5) / RAYS as f64),
            );
            if let Some([red, green, blue]) = color_along(near.iter().copied(), position, along) {
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

/// Light before black, `[pixels, pixels, 3]`, as a thin lens of this radius sees it that is focused at this
/// distance: the mean over rays from points of the lens through points of the pixel where it is sharp.
pub(crate) fn through_lens(balls: &[Ball], eye: &Eye, radius: f64, focus: f64) -> Tensor<f32> {
    let rays = eye.rays();
    let Rays { forward, right, down, .. } = rays;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let pixels = eye.pixels;
    let mut light = Vec::with_capacity(pixels * pixels * 3);
    for pixel in 0..pixels * pixels {
        let mut total = [0.0; 3];
        for k in 0..LENS_RAYS {
            // Points of the pixel by the plastic number, those of the lens on a spiral.
            let k = k as f64;
            let [x, y] = [0.754_877_666, 0.569_840_291].map(|share| (0.5 + k * share).fract());
            let along = rays.along([(pixel % pixels) as f64 + x, (pixel / pixels) as f64 + y]);
            let sharp = eye.position + focus / along.dot(forward) * along;
            let (sin, cos) = (golden * k).sin_cos();
            let from = radius * ((k + 0.5) / LENS_RAYS as f64).sqrt();
            let from = eye.position + from * (cos * right + sin * down);
            if let Some(color) = color_along(balls, from, (sharp - from).normalize()) {
                total = [0, 1, 2].map(|c| total[c] + color[c] / LENS_RAYS as f64);
            }
        }
        light.extend(total.map(|x| x as f32));
    }
    Tensor::from_flat_fn([pixels, pixels, 3], |k| light[k])
}

/// Each pixel a mean of its neighbours, weighted by a Gaussian of its own standard deviation; mirrored at the
/// border. `light` is `[pixels, pixels, C]`.
pub(crate) fn blurred(light: &Tensor<f32>, sigmas: &[f64]) -> Tensor<f32> {
    let sigma = |pixel: usize| sigmas[pixel].max(1e-3);
    let weight = |pixel, offset: [isize; 2]| {
        let along = |k: isize| (-0.5 * (k as f64 / sigma(pixel)).powi(2)).exp();
        along(offset[0]) * along(offset[1])
    };
    means(light, |pixel| (5.0 * sigma(pixel)).ceil() as isize, weight)
}

/// Each pixel a mean of its neighbours, weighted by the share of them that lies in a disc; mirrored at the border.
/// Also the standard deviation of these weights along an axis.
pub(crate) fn blurred_by_disc(light: &Tensor<f32>, radius: f64) -> (Tensor<f32>, f64) {
    let reach = radius.ceil() as isize;
    let share = |offset: [isize; 2]| {
        let points = (0..RAYS * RAYS).filter(|k| {
            let within = [k / RAYS, k % RAYS].map(|k| (k as f64 + 0.5) / RAYS as f64 - 0.5);
            (offset[0] as f64 + within[0]).hypot(offset[1] as f64 + within[1]) < radius
        });
        points.count() as f64
    };
    let offsets = || (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [y, x]));
    let sum: f64 = offsets().map(share).sum();
    let variance = offsets().map(|offset| share(offset) * (offset[1] * offset[1]) as f64 / sum);
    (means(light, |_| reach, |_, offset| share(offset)), variance.sum::<f64>().sqrt())
}

/// Each pixel a weighted mean of those around it, by offsets down and right; mirrored at the border.
fn means(
    light: &Tensor<f32>,
    reach: impl Fn(usize) -> isize,
    weight: impl Fn(usize, [isize; 2]) -> f64,
) -> Tensor<f32> {
    let (pixels, channels) = (light.shape()[0] as isize, light.shape()[2]);
    let mirrored = |coordinate: isize| {
        let coordinate = coordinate.rem_euclid(2 * pixels);
        if coordinate < pixels { coordinate } else { 2 * pixels - 1 - coordinate }
    };
    let mut all = vec![0.0_f32; light.size()];
    for (pixel, sum) in all.chunks_exact_mut(channels).enumerate() {
        let (row, column) = (pixel as isize / pixels, pixel as isize % pixels);
        let reach = reach(pixel);
        let mut total = vec![0.0; channels + 1];
        for (down, right) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
            let weight = weight(pixel, [down, right]);
            let coordinate = mirrored(row + down) * pixels + mirrored(column + right);
            total[channels] += weight;
            for (channel, total) in total[..channels].iter_mut().enumerate() {
                *total +=
                    weight * f64::from(light.data()[coordinate as usize * channels + channel]);
            }
        }
        for (sum, part) in sum.iter_mut().zip(&total) {
            *sum = (part / total[channels]) as f32;
        }
    }
    Tensor::from_flat_fn(light.shape(), |k| all[k])
}
