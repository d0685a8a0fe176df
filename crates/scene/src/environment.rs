//! Light from all sides: cube maps from images of six faces, and from panoramas; and panoramas from cube maps.
//!
//! # Panoramas
//! An image twice as wide as high shows latitudes as rows, from the zenith +y, and longitudes as columns. The
//! place `u, v`, from 0 to 1 from the left and from the top, is seen in the direction
//!
//! `(cos b cos a, sin b, cos b sin a)`, with `a = 2 pi (u - 1/2)` and `b = pi (1/2 - v)`.
//!
//! So the middle of the image is +x, and to the right of it comes +z: as in three.js, and as in Blender once its
//! z is y, as its exporters have it.
//!
//! A texel of the cube map is the mean of the image over the solid angle that it has. Each pixel is cut into
//! parts that are small beside texels. A part counts by its solid angle, `da (sin b1 - sin b0)`, in the texel in
//! which its middle lies. So what shines from few pixels keeps its light, however few they are.
//!
//! The way back: a pixel of the panorama is the mean of samples of the cube map, which go on over the edges of
//! its faces. There are two along each axis of a pixel, so that no texel falls between them: in the corners of
//! faces several texels lie in one pixel.
//!
//! # Source
//! `equirectUv` of three.js; `direction_to_equirectangular` of Blender's Cycles; OpenGL 4.6, section 8.13, for the
//! faces of cube maps.

use std::f64::consts::{PI, TAU};

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{CubeMap, Detail, Sampler, sample_cube_map};

use crate::error::SceneError;

/// Parts of a pixel are so many times smaller than the smallest side of a texel.
const FINER: f64 = 4.0;
/// The sides of texels in the corners of a face are seen so many times smaller than in its middle.
const CORNER: f64 = 3.0;

/// Per face the axes along which columns and rows grow: an axis and its sign.
const AXES: [[(usize, f64); 2]; 6] = [
    [(2, -1.0), (1, -1.0)],
    [(2, 1.0), (1, -1.0)],
    [(0, 1.0), (2, 1.0)],
    [(0, 1.0), (2, -1.0)],
    [(0, 1.0), (1, -1.0)],
    [(0, -1.0), (1, -1.0)],
];

/// The cube map `[6, side, side, 3]` of a panorama `[H, W, 3]`.
pub(crate) fn cube_from_panorama(image: &Tensor<f32>, side: usize) -> Tensor<f32> {
    let [height, width] = [image.shape()[0], image.shape()[1]];
    let least = 2.0 / (side as f64 * CORNER * FINER);
    let parts = |pixel: f64| (pixel / least).ceil().max(1.0) as usize;
    let (rows, columns) = (height * parts(PI / height as f64), width * parts(TAU / width as f64));
    let turns: Vec<[f64; 2]> = (0..columns)
        .map(|k| (TAU * ((k as f64 + 0.5) / columns as f64 - 0.5)).sin_cos())
        .map(|(sin, cos)| [cos, sin])
        .collect();
    let mut sums = vec![[0.0_f64; 4]; 6 * side * side];
    for row in 0..rows {
        let latitude = |position: f64| PI * (0.5 - position / rows as f64);
        let (sin, cos) = latitude(row as f64 + 0.5).sin_cos();
        let weight = latitude(row as f64).sin() - latitude(row as f64 + 1.0).sin();
        let pixels = &image.data()[row * height / rows * width * 3..][..width * 3];
        for (column, [x, z]) in turns.iter().enumerate() {
            let sum = &mut sums[texel([cos * x, sin, cos * z], side)];
            let from = column * width / columns * 3;
            for (sum, sample) in sum.iter_mut().zip(&pixels[from..from + 3]) {
                *sum += weight * f64::from(*sample);
            }
            sum[3] += weight;
        }
    }
    Tensor::from_flat_fn([6, side, side, 3], |k| (sums[k / 3][k % 3] / sums[k / 3][3]) as f32)
}

/// Samples along each axis of a pixel of a panorama.
const SAMPLES: usize = 2;
/// Light is divided by this while it is sampled: in a corner the sum of three texels is no larger than a number is.
const HEADROOM: f32 = 4.0;

/// The panorama `[2 S, 4 S, 3]` of a cube map `[6, S, S, 3]`: as an environment's image it gives a cube map of
/// the same side. Some 200 bytes of memory for each of its pixels.
///
/// # Errors
/// What [`sample_cube_map`] refuses: a cube map of another shape.
pub(crate) fn panorama_from_cube(cube: &Tensor<f32>) -> Result<Tensor<f32>, SceneError> {
    let side = cube.shape()[1];
    let [height, width] = [2 * side, 4 * side];
    let [rows, columns] = [SAMPLES * height, SAMPLES * width];
    // Samples of a pixel follow each other.
    let directions = (0..rows * columns).map(|sample| {
        let (pixel, part) = (sample / (SAMPLES * SAMPLES), sample % (SAMPLES * SAMPLES));
        let row = pixel / width * SAMPLES + part / SAMPLES;
        let column = pixel % width * SAMPLES + part % SAMPLES;
        let (sin_a, cos_a) = (TAU * ((column as f64 + 0.5) / columns as f64 - 0.5)).sin_cos();
        let (sin_b, cos_b) = (PI * (0.5 - (row as f64 + 0.5) / rows as f64)).sin_cos();
        [cos_b * cos_a, sin_b, cos_b * sin_a].map(|x| x as f32)
    });
    let directions = Tensor::new([rows * columns, 3], directions.flatten().collect::<Vec<_>>());
    let tape = Tape::new();
    let directions = tape.constant(&directions.map_err(FitError::from)?);
    let map = CubeMap::new(tape.constant(&cube.map(|x| x / HEADROOM))).map_err(FitError::from)?;
    let samples = sample_cube_map(&map, directions, Detail::Finest, Sampler::new());
    let samples = samples.map_err(FitError::from)?.value();
    let of_pixel = SAMPLES * SAMPLES;
    Ok(Tensor::from_flat_fn([height, width, 3], |k| {
        let first = k / 3 * of_pixel * 3 + k % 3;
        let sum =
            (0..of_pixel).map(|part| f64::from(samples.data()[first + 3 * part])).sum::<f64>();
        (f64::from(HEADROOM) * sum / of_pixel as f64) as f32
    }))
}

/// The texel that is seen in a direction.
fn texel(direction: [f64; 3], side: usize) -> usize {
    let size = direction.map(f64::abs);
    let axis = match size {
        [x, y, z] if x >= y && x >= z => 0,
        [_, y, z] if y >= z => 1,
        _ => 2,
    };
    let face = 2 * axis + usize::from(direction[axis] < 0.0);
    let [column, row] = AXES[face].map(|(along, sign)| {
        let position = 0.5 * (sign * direction[along] / size[axis] + 1.0);
        ((position * side as f64) as usize).min(side - 1)
    });
    (face * side + row) * side + column
}

#[cfg(test)]
mod tests {
    use bokashi_render_ops::{Prefilter, TextureFilter, irradiance};

    use super::*;

    /// The light of a pixel of a panorama of so many rows: its direction's middle.
    fn panorama(height: usize, light: impl Fn([f64; 3]) -> [f64; 3]) -> Tensor<f32> {
        let width = 2 * height;
        let middle = |position: usize, all: usize| (position as f64 + 0.5) / all as f64;
        let pixels: Vec<_> = (0..height * width)
            .map(|pixel| {
                let a = TAU * (middle(pixel % width, width) - 0.5);
                let b = PI * (0.5 - middle(pixel / width, height));
                light([b.cos() * a.cos(), b.sin(), b.cos() * a.sin()])
            })
            .collect();
        Tensor::from_flat_fn([height, width, 3], |k| pixels[k / 3][k % 3] as f32)
    }

    /// The direction to the middle of a texel, and the texel's solid angle.
    fn seen(texel: usize, side: usize) -> ([f64; 3], f64) {
        let (face, row, column) = (texel / (side * side), texel / side % side, texel % side);
        let edge = |position: usize| 2.0 * position as f64 / side as f64 - 1.0;
        let places = [[edge(column), edge(column + 1)], [edge(row), edge(row + 1)]];
        let mut direction = [0.0; 3];
        direction[face / 2] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
        for ((axis, sign), [from, until]) in AXES[face].into_iter().zip(places) {
            direction[axis] = sign * 0.5 * (from + until);
        }
        let corner = |s: f64, t: f64| (s * t).atan2((s * s + t * t + 1.0).sqrt());
        let [[s0, s1], [t0, t1]] = places;
        let angle = corner(s1, t1) - corner(s0, t1) - corner(s1, t0) + corner(s0, t0);
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        (direction.map(|x| x / length), angle)
    }

    fn sky([x, y, z]: [f64; 3]) -> [f64; 3] {
        [1.0 + x + z * z, 1.5 + y, 2.0 + z + x * y]
    }

    #[test]
    fn a_direction_leads_to_the_texel_that_is_drawn_there() {
        let tape = Tape::<f64>::new();
        let side = 2;
        let numbers = Tensor::from_flat_fn([6, side, side, 1], |k| k as f64);
        let map = CubeMap::new(tape.constant(&numbers)).unwrap();
        // Diagonals and middles of edges among them: the first of equal components counts.
        let steps = [-1.0, -0.6, -0.1, 0.0, 0.1, 0.6, 1.0];
        let all = (0..343).map(|k| [steps[k / 49], steps[k / 7 % 7], steps[k % 7]]);
        let all: Vec<[f64; 3]> = all.filter(|direction| *direction != [0.0; 3]).collect();
        let rows = tape.constant(&Tensor::new([all.len(), 3], all.concat()).unwrap());
        let nearest = Sampler::new().filter(TextureFilter::Nearest);
        let found = sample_cube_map(&map, rows, Detail::Finest, nearest).unwrap().value();
        for (k, direction) in all.iter().enumerate() {
            assert_eq!(found.data()[k], texel(*direction, side) as f64, "{direction:?}");
        }
        let face = |direction| texel(direction, 1);
        for (direction, expected) in [
            ([1.0, 1.0, 1.0], 0),
            ([-1.0, 1.0, -1.0], 1),
            ([0.0, 1.0, -1.0], 2),
            ([0.5, -1.0, 1.0], 3),
            ([1.0, 0.0, 1.0], 0),
            ([-1.0, -1.0, 0.0], 1),
        ] {
            assert_eq!(face(direction), expected, "{direction:?}");
        }
    }

    #[test]
    fn a_panorama_of_a_smooth_sky_is_that_sky_on_the_cube() {
        // As far as a slope of 2 leads in half of a texel and half of a pixel, or less.
        for (height, side, bound) in [(64, 32, 0.02), (200, 16, 0.006), (16, 32, 0.16)] {
            let cube = cube_from_panorama(&panorama(height, sky), side);
            let off = (0..6 * side * side).flat_map(|texel| {
                let expected = sky(seen(texel, side).0);
                let cube = cube.data();
                (0..3).map(move |k| (f64::from(cube[3 * texel + k]) - expected[k]).abs())
            });
            let worst = off.fold(0.0, f64::max);
            println!("{height} rows, {side} texels: {worst:.2e}");
            assert!(worst < bound, "{height} {side}: {worst}");
        }
    }

    #[test]
    fn the_irradiance_of_a_panorama_is_that_of_its_sky() {
        let side = 32;
        let cube = cube_from_panorama(&panorama(128, sky), side);
        let tape = Tape::<f64>::new();
        let texels = Tensor::from_flat_fn([6, side, side, 3], |k| f64::from(cube.data()[k]));
        let prefilter = Prefilter::new(side, 3).unwrap();
        let harmonics = prefilter.harmonics(tape.constant(&texels)).unwrap();
        let normals = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.48, -0.6, 0.64]];
        let rows = Tensor::from_fn([4, 3], |[row, k]| normals[row][k]);
        let found = irradiance(harmonics, tape.constant(&rows)).unwrap().value();
        for (row, [x, y, z]) in normals.into_iter().enumerate() {
            // Of 1: pi; of x: 2 pi / 3; of z^2 - 1/3 and x y: pi / 4.
            let expected = [
                PI + TAU / 3.0 * x + PI / 3.0 + PI / 4.0 * (z * z - 1.0 / 3.0),
                1.5 * PI + TAU / 3.0 * y,
                2.0 * PI + TAU / 3.0 * z + PI / 4.0 * x * y,
            ];
            for (k, expected) in expected.into_iter().enumerate() {
                let off = found[[row, k]] / expected - 1.0;
                println!("{row} {k}: {off:.2e}");
                assert!(off.abs() < 2e-3, "{row} {k}: {off}");
            }
        }
    }

    #[test]
    fn a_sun_of_one_pixel_keeps_its_light() {
        let (height, side) = (64, 8);
        // Near the zenith, at the horizon, and at the seam behind.
        for (row, column) in [(0, 3), (32, 64), (20, 0), (63, 127)] {
            let lit = |k: usize| if k / 3 == row * 2 * height + column { 1000.0 } else { 0.0 };
            let image = Tensor::from_flat_fn([height, 2 * height, 3], lit);
            let cube = cube_from_panorama(&image, side);
            let light = |texel: usize| f64::from(cube.data()[3 * texel]) * seen(texel, side).1;
            let found: f64 = (0..6 * side * side).map(light).sum();
            let edge = |row: usize| (PI * (0.5 - row as f64 / height as f64)).sin();
            let expected = 1000.0 * TAU / (2 * height) as f64 * (edge(row) - edge(row + 1));
            println!("{row} {column}: {:.2e}", found / expected - 1.0);
            assert!((found / expected - 1.0).abs() < 0.03, "{row} {column}: {found} {expected}");
        }
    }

    /// The light of each texel's mean over the texel's solid angle, over all of them: [4 pi] of white.
    fn light(cube: &Tensor<f32>) -> f64 {
        let side = cube.shape()[1];
        (0..6 * side * side).map(|k| f64::from(cube.data()[3 * k]) * seen(k, side).1).sum()
    }

    #[test]
    fn a_cube_map_comes_back_from_its_panorama() {
        // As far as a slope of 2 leads in a texel, or less; of one colour to the last bits.
        for (side, bound) in [(8, 0.16), (16, 0.06), (64, 0.01)] {
            let cube = Tensor::from_flat_fn([6, side, side, 3], |k| {
                sky(seen(k / 3, side).0)[k % 3] as f32
            });
            let panorama = panorama_from_cube(&cube).unwrap();
            assert_eq!(*panorama.shape(), [2 * side, 4 * side, 3].into());
            let back = cube_from_panorama(&panorama, side);
            let off = back.data().iter().zip(cube.data()).map(|(a, b)| (a - b).abs());
            let worst = off.fold(0.0, f32::max);
            println!("{side}: {worst:.2e}");
            assert!(worst < bound, "{side}: {worst}");
        }
        for color in [0.0, 0.7, 3e38] {
            let cube = Tensor::full([6, 8, 8, 3], color);
            let back = cube_from_panorama(&panorama_from_cube(&cube).unwrap(), 8);
            for x in back.data() {
                assert!((x - color).abs() <= 1e-6 * color, "{color}: {x}");
            }
        }
    }

    #[test]
    fn a_sun_of_one_texel_keeps_its_light_in_a_panorama() {
        let side = 16;
        // In the middles, at edges and in the corners of faces: a texel is smallest there.
        for texel in [0, 7, 8 * side + 8, 2 * side * side, 3 * side * side - 1, 6 * side * side - 1]
        {
            let lit = |k: usize| if k / 3 == texel { 1e5 } else { 0.0 };
            let cube = Tensor::from_flat_fn([6, side, side, 3], lit);
            let back = cube_from_panorama(&panorama_from_cube(&cube).unwrap(), side);
            let off = light(&back) / light(&cube) - 1.0;
            println!("{texel}: {off:.3}");
            assert!(off.abs() < 0.1, "{texel}: {off}");
        }
    }

    #[test]
    fn the_middle_is_x_and_the_right_of_it_z() {
        // Four columns of one colour each: -x to -z, -z to x, x to z, z to -x.
        let image = Tensor::from_flat_fn([32, 64, 3], |k| (k / 3 % 64 / 16) as f32);
        let cube = cube_from_panorama(&image, 8);
        let towards = |direction: [f64; 3]| cube.data()[3 * texel(direction, 8)];
        assert_eq!(towards([-1.0, 0.1, -0.5]), 0.0);
        assert_eq!(towards([1.0, 0.1, -0.5]), 1.0);
        assert_eq!(towards([1.0, -0.1, 0.5]), 2.0);
        assert_eq!(towards([-1.0, 0.1, 0.5]), 3.0);
        let image = Tensor::from_flat_fn([32, 64, 3], |k| (k / 3 / 64) as f32);
        let cube = cube_from_panorama(&image, 8);
        let up = |y: f64| cube.data()[3 * texel([0.1, y, 0.1], 8)];
        assert!(up(1.0) < 4.0 && up(-1.0) > 27.0, "{} {}", up(1.0), up(-1.0));
    }
}
