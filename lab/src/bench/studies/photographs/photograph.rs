//! The cube as a photograph has it: each pixel is the mean of many points of it.
//!
//! Nothing of it is shared with what is fitted but the texels. Rays are cut with the cube's slabs, in `f64`;
//! there is no rasterizer, no face and no edge function. A pixel is divided into cells, and each has a
//! point anywhere in it. So a pixel's error falls with the cells' number to the power 3/4 where an edge
//! crosses it, and faster elsewhere.

use bokashi_core::Tensor;
use bokashi_render_ops::Size;
use glam::{DMat4, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::object::{Object, SIDES, TEXELS, axes, texture_position};
use crate::bench::scenes::uniform;

/// The picture `[H, W, 3]` of the cube, `to_clip` from its own coordinates to clip space, of `cells` across
/// and down a pixel. The background is 0. The same for one seed, on any number of threads.
pub(super) fn photograph(
    object: &Object,
    to_clip: &DMat4,
    size: Size,
    cells: [usize; 2],
    seed: u64,
) -> Tensor<f64> {
    let back = to_clip.inverse();
    let width = size.width;
    let corners = (0..8).map(|vertex| {
        let corner = DVec3::from_array([2, 1, 0].map(|bit| (vertex >> bit & 1) as f64 - 0.5));
        let clip = *to_clip * corner.extend(1.0);
        [
            0.5 * width as f64 * (1.0 + clip.x / clip.w),
            0.5 * size.height as f64 * (1.0 - clip.y / clip.w),
        ]
    });
    let corners: Vec<[f64; 2]> = corners.collect();
    // Elsewhere nothing is seen of it.
    let within = |axis: usize, pixel: usize| {
        let (low, high) = (pixel as f64, (pixel + 1) as f64);
        corners.iter().any(|corner| corner[axis] > low)
            && corners.iter().any(|corner| corner[axis] < high)
    };
    let mut image = vec![0.0; size.pixels() * 3];
    image.par_chunks_mut(width * 3).enumerate().for_each(|(row, line)| {
        if !within(1, row) {
            return;
        }
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(row as u64);
        for (column, pixel) in line.chunks_exact_mut(3).enumerate() {
            if !within(0, column) {
                continue;
            }
            for cell in 0..cells[0] * cells[1] {
                let [across, down] = [cell % cells[0], cell / cells[0]];
                let x = column as f64 + (across as f64 + uniform(&mut generator)) / cells[0] as f64;
                let y = row as f64 + (down as f64 + uniform(&mut generator)) / cells[1] as f64;
                let ndc = [2.0 * x / width as f64 - 1.0, 1.0 - 2.0 * y / size.height as f64];
                let channels = color(object, &back, ndc);
                pixel.iter_mut().zip(channels).for_each(|(sum, channel)| *sum += channel);
            }
            pixel.iter_mut().for_each(|sum| *sum /= (cells[0] * cells[1]) as f64);
        }
    });
    Tensor::new([size.height, width, 3], image).expect("three channels")
}

/// What is seen along the ray of a point of the image.
fn color(object: &Object, back: &DMat4, [x, y]: [f64; 2]) -> [f64; 3] {
    let [near, far] = [-1.0, 1.0].map(|z| back.project_point3(DVec3::new(x, y, z)).to_array());
    let along: [f64; 3] = std::array::from_fn(|axis| far[axis] - near[axis]);
    // Where the ray enters and leaves the slab of each axis.
    let (mut enters, mut leaves, mut through) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for axis in 0..3 {
        let ends = [-0.5, 0.5].map(|end| (end - near[axis]) / along[axis]);
        let (first, last) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if first > enters {
            (enters, through) = (first, axis);
        }
        leaves = leaves.min(last);
    }
    if enters.is_nan() || leaves.is_nan() || enters >= leaves || enters < 0.0 {
        return [0.0; 3];
    }
    let side = 2 * through + usize::from(along[through] < 0.0);
    let [_, across, down] = axes(side);
    let on = [across, down].map(|axis| (near[axis] + enters * along[axis] + 0.5).clamp(0.0, 1.0));
    let [column, row] = texture_position(side, on);
    // Between the four texels around it: never one of another side.
    let first = |texel: f64, least: usize| (texel as usize).min(least + TEXELS - 2);
    let (left, top) = (first(column, side * TEXELS), first(row, 0));
    let (right, lower) = (column - left as f64, row - top as f64);
    let texel = |row: usize, column: usize, channel: usize| {
        object.texels.data()[(row * SIDES * TEXELS + column) * 3 + channel]
    };
    std::array::from_fn(|channel| {
        let line = |row: usize| {
            (1.0 - right) * texel(row, left, channel) + right * texel(row, left + 1, channel)
        };
        (1.0 - lower) * line(top) + lower * line(top + 1)
    })
}

#[cfg(test)]
mod tests {
    use super::super::object::{camera, poses};
    use super::*;

    /// The root of the mean square of the differences.
    fn apart(one: &Tensor<f64>, other: &Tensor<f64>) -> f64 {
        let squares = one.data().iter().zip(other.data()).map(|(a, b)| (a - b) * (a - b));
        (squares.sum::<f64>() / one.data().len() as f64).sqrt()
    }

    #[test]
    fn photographs_converge_as_cells_become_smaller() {
        let object = Object::new().unwrap();
        let to_clip = camera() * poses(1)[0];
        let of = |cells: usize, seed: u64| {
            photograph(&object, &to_clip, Size::square(16), [cells; 2], seed)
        };
        let truth = of(128, 9);
        let errors = [2, 8, 32].map(|cells| apart(&of(cells, 0), &truth));
        // Sixteen times as many cells: an eighth of the error, where edges dominate.
        for pair in errors.windows(2) {
            assert!((4.0..16.0).contains(&(pair[0] / pair[1])), "{errors:?}");
        }
        assert_eq!(of(8, 3), of(8, 3));
        assert_ne!(of(8, 3), of(8, 4));
    }

    #[test]
    fn a_side_that_fills_the_view_shows_its_own_texels() {
        let object = Object::new().unwrap();
        // From the middle of the near plane to the cube's upper side on z, which is the last one.
        let to_clip = DMat4::from_scale(DVec3::new(2.0, 2.0, -1.0));
        let found = photograph(&object, &to_clip, Size::square(TEXELS - 1), [1, 1], 0);
        // Rows run down in an image, and s, along x, runs to the right: x across, y from below.
        let [normal, across, down] = axes(5);
        assert_eq!([normal, across, down], [2, 0, 1]);
        let last = TEXELS - 2;
        for (row, column) in [(0, 0), (0, last), (last, 3), (30, 17)] {
            let texels = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[r, c]| {
                let row = TEXELS - 1 - row - r;
                object.texels.data()[(row * SIDES * TEXELS + 5 * TEXELS + column + c) * 3]
            });
            let least = texels.iter().copied().fold(f64::INFINITY, f64::min);
            let most = texels.iter().copied().fold(0.0, f64::max);
            let seen = found[[row, column, 0]];
            assert!((least - 1e-12..=most + 1e-12).contains(&seen), "{row} {column}: {seen}");
        }
    }
}
