//! The silhouette of a mask, and distances of pixels from it.

use bokashi_core::Tensor;
use glam::{DVec2, DVec3};

use crate::cameras::Camera;

/// The distance from the corner of a pixel to its centre, along each axis.
const HALF: f64 = 0.5;

/// The width of a block of pixels over a grid's cell, with which each block inside has a point.
const WIDER: f64 = 1.5;

/// A silhouette, and the camera that sees it.
#[derive(Debug, Clone)]
pub(super) struct Silhouette {
    camera: Camera,
    /// Distances of the centres of pixels from the silhouette, in pixels, row-major, below 0 inside.
    distances: Vec<f32>,
}

impl Silhouette {
    /// The silhouette of a mask `[H, W]` of the camera's size, the share of each pixel that objects cover. A share
    /// between 0 and 1 places the silhouette inside its pixel.
    pub(super) fn new(camera: Camera, mask: &Tensor<f32>) -> Self {
        let [height, width] = [mask.shape()[0], mask.shape()[1]];
        let is_covered = |share: f32| share >= 0.5;
        let to_covered = squared_distances([height, width], |k| is_covered(mask.data()[k]));
        let to_bare = squared_distances([height, width], |k| !is_covered(mask.data()[k]));
        // Without any pixel on the other side, the distance is at least that to the image's border.
        let most = (height + width) as f32;
        let distance = |k: usize| {
            let share = mask.data()[k];
            if share > 0.0 && share < 1.0 {
                return 0.5 - share;
            }
            let (squares, sign) =
                if is_covered(share) { (&to_bare, -1.0) } else { (&to_covered, 1.0) };
            // From centre to centre; the silhouette is half a pixel before the other one.
            sign * ((squares[k] as f32).sqrt() - 0.5).min(most)
        };
        Self { camera, distances: (0..height * width).map(distance).collect() }
    }

    /// The camera.
    pub(super) fn camera(&self) -> Camera {
        self.camera
    }

    /// The distances of the images of points from the silhouette, below 0 inside. A pixel counts as wide as it is
    /// around `middle`, in units of the world. `None` behind the camera, and beyond the image's border next to an
    /// object that the border cuts off.
    pub(super) fn distances(&self, middle: DVec3) -> impl Fn(DVec3) -> Option<f64> {
        let unit = self.unit(middle);
        let pixels = self.camera.pixels();
        move |point| Some(unit * self.distance_at(pixels(point)?)?)
    }

    /// The blocks of pixels for a grid of points that are `spacing` apart around `middle`.
    pub(super) fn blocks(&self, middle: DVec3, spacing: f64) -> Blocks {
        let side = (WIDER * spacing / self.unit(middle)).ceil().max(1.0) as usize;
        Blocks { camera: self.camera, side }
    }

    /// The intersection over union of the mask and the image of `points`, both in blocks. A block is covered where some
    /// pixel or some point covers it.
    pub(super) fn overlap(&self, points: &[DVec3], blocks: &Blocks) -> f64 {
        let mut covered = vec![[false; 2]; blocks.count()];
        let width = self.camera.size.width;
        for (k, _) in self.distances.iter().enumerate().filter(|(_, distance)| **distance < 0.0) {
            covered[blocks.index(k % width, k / width)][0] = true;
        }
        let block = blocks.finder();
        for block in points.iter().filter_map(|&point| block(point)) {
            covered[block][1] = true;
        }
        let count = |is_one: fn(&[bool; 2]) -> bool| covered.iter().filter(|b| is_one(b)).count();
        count(|[a, b]| *a && *b) as f64 / count(|[a, b]| *a || *b).max(1) as f64
    }

    /// The width of a pixel at a point of the world.
    pub(super) fn unit(&self, place: DVec3) -> f64 {
        let [fx, fy, ..] = self.camera.intrinsics;
        self.camera.view.transform_point3(place).length() / (fx * fy).abs().sqrt()
    }

    /// The distance at a point of the image, by bilinear interpolation.
    fn distance_at(&self, pixel: DVec2) -> Option<f64> {
        let [width, height] = [self.camera.size.width, self.camera.size.height];
        let last = DVec2::new((width - 1) as f64, (height - 1) as f64);
        let inside = pixel.clamp(DVec2::ZERO, last);
        let (column, row) = (inside.x as usize, inside.y as usize);
        let (next, below) = ((column + 1).min(width - 1), (row + 1).min(height - 1));
        let (u, v) = (inside.x.fract(), inside.y.fract());
        let value = |row: usize, column: usize| f64::from(self.distances[row * width + column]);
        let upper = value(row, column) * (1.0 - u) + value(row, next) * u;
        let lower = value(below, column) * (1.0 - u) + value(below, next) * u;
        let distance = upper * (1.0 - v) + lower * v;
        let beyond = pixel.distance(inside);
        match beyond <= HALF {
            true => Some(distance),
            false => (distance > 0.0).then_some(distance + beyond),
        }
    }
}

/// An image in square blocks of pixels. At the distance of a grid's middle, each block inside the image of the grid has
/// a point of the grid.
#[derive(Debug)]
pub(super) struct Blocks {
    camera: Camera,
    /// The number of pixels along a side.
    side: usize,
}

impl Blocks {
    fn columns(&self) -> usize {
        self.camera.size.width.div_ceil(self.side)
    }

    /// The number of blocks.
    pub(super) fn count(&self) -> usize {
        self.columns() * self.camera.size.height.div_ceil(self.side)
    }

    /// Finds the block of a point of the world; `None` where the image does not show the point.
    pub(super) fn finder(&self) -> impl Fn(DVec3) -> Option<usize> {
        let size = [self.camera.size.width, self.camera.size.height].map(|extent| extent as f64);
        let pixels = self.camera.pixels();
        move |point| {
            let pixel = (pixels(point)? + HALF).floor();
            let is_shown = (0.0..size[0]).contains(&pixel.x) && (0.0..size[1]).contains(&pixel.y);
            is_shown.then(|| self.index(pixel.x as usize, pixel.y as usize))
        }
    }

    /// The block of a pixel.
    fn index(&self, column: usize, row: usize) -> usize {
        row / self.side * self.columns() + column / self.side
    }
}

/// The squared distance of each pixel of `[height, width]`, row-major, to the nearest pixel for which `is_one` is true.
/// It is infinite without such a pixel.
///
/// # Source
/// Felzenszwalb and Huttenlocher, *Distance transforms of sampled functions*, Theory of Computing 8, 2012: minima of
/// parabolas, along columns and then along rows.
fn squared_distances([height, width]: [usize; 2], is_one: impl Fn(usize) -> bool) -> Vec<f64> {
    let mut squares: Vec<f64> =
        (0..height * width).map(|k| if is_one(k) { 0.0 } else { f64::INFINITY }).collect();
    let mut line = vec![0.0; height.max(width)];
    let mut lowest = Vec::new();
    for column in 0..width {
        for row in 0..height {
            line[row] = squares[row * width + column];
        }
        lower_envelope(&line[..height], &mut lowest, |row, least| {
            squares[row * width + column] = least;
        });
    }
    for row in squares.chunks_exact_mut(width.max(1)) {
        line[..width].copy_from_slice(row);
        lower_envelope(&line[..width], &mut lowest, |column, least| row[column] = least);
    }
    squares
}

/// Writes `min_j values[j] + (k - j)^2` for each k. `lowest` is memory for the parabolas that are the lowest somewhere,
/// each with the point from which on it is.
fn lower_envelope(
    values: &[f64],
    lowest: &mut Vec<(usize, f64)>,
    mut write: impl FnMut(usize, f64),
) {
    lowest.clear();
    for (k, &value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        let mut start = f64::NEG_INFINITY;
        while let Some(&(j, begins)) = lowest.last() {
            // The parabolas j and k meet at `((v_k + k^2) - (v_j + j^2)) / (2 (k - j))`. If that is before j begins, j
            // is nowhere the lowest.
            let sum = (value + (k * k) as f64) - (values[j] + (j * j) as f64);
            start = sum / (2 * (k - j)) as f64;
            if start > begins {
                break;
            }
            lowest.pop();
            start = f64::NEG_INFINITY;
        }
        lowest.push((k, start));
    }
    let mut current = 0;
    for k in 0..values.len() {
        while lowest.get(current + 1).is_some_and(|&(_, begins)| begins < k as f64) {
            current += 1;
        }
        let least = lowest.get(current).map_or(f64::INFINITY, |&(j, _)| {
            values[j] + (k as f64 - j as f64) * (k as f64 - j as f64)
        });
        write(k, least);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bokashi_render_ops::Size;
    use glam::DMat4;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_those_to_the_nearest_pixel(
            size in (1_usize..9, 1_usize..9),
            bits in any::<u64>(),
            rarity in 0_u32..3,
        ) {
            let (height, width) = size;
            // The rarer, the farther apart.
            let is_one = |k: usize| (0..=rarity).all(|n| bits.rotate_left(7 * n) >> (k % 64) & 1 == 1);
            let found = squared_distances([height, width], is_one);
            for k in 0..height * width {
                let square = |j: usize| {
                    let rows = (k / width).abs_diff(j / width).pow(2);
                    (rows + (k % width).abs_diff(j % width).pow(2)) as f64
                };
                let ones = (0..height * width).filter(|&j| is_one(j));
                prop_assert_eq!(found[k], ones.map(square).fold(f64::INFINITY, f64::min));
            }
        }
    }

    /// A camera 4 in front of the origin, of 9 x 9 pixels; at the origin a pixel is 0.1 wide.
    fn camera() -> Camera {
        let view = DMat4::from_translation(4.0 * DVec3::Z);
        Camera { view, ..Camera::new(Size { width: 9, height: 9 }, [40.0, 40.0, 4.0, 4.0]) }
    }

    #[test]
    fn a_silhouette_runs_where_the_share_of_a_pixel_says() {
        // All columns up to 3 are covered, and a quarter of column 4.
        let mask =
            Tensor::from_flat_fn([9, 9], |k| [1.0, 1.0, 1.0, 1.0, 0.25, 0.0][(k % 9).min(5)]);
        let silhouette = Silhouette::new(camera(), &mask);
        let distance = silhouette.distances(DVec3::ZERO);
        for (pixels, expected) in [(0.0, 0.25), (2.0, 2.5), (-3.0, -2.5)] {
            let found = distance(DVec3::new(0.1 * pixels, 0.0, 0.0)).unwrap();
            assert!((found - 0.1 * expected).abs() < 1e-6, "{pixels}: {found}");
        }
    }

    #[test]
    fn a_view_says_nothing_of_what_it_cannot_see() {
        let left = Tensor::from_flat_fn([9, 9], |k| f32::from(u8::from(k % 9 < 5)));
        let silhouette = Silhouette::new(camera(), &left);
        let distance = silhouette.distances(DVec3::ZERO);
        // The object goes on beyond the left border; to the right there is none.
        assert_eq!(distance(DVec3::new(-0.8, 0.0, 0.0)), None);
        assert!(distance(DVec3::new(0.8, 0.0, 0.0)).unwrap() > 0.4);
        assert_eq!(distance(DVec3::new(0.0, 0.0, -5.0)), None);
        for share in [0.0, 1.0] {
            let even = Silhouette::new(camera(), &Tensor::from_flat_fn([9, 9], |_| share));
            let found = even.distances(DVec3::ZERO)(DVec3::ZERO).unwrap();
            assert!(found.is_finite() && (found < 0.0) == (share == 1.0));
        }
    }
}
