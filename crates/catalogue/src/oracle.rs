//! The right answers, worked out another way than the library does: in whole numbers where a
//! scene's points lie on a grid, by a linear system per pixel where they don't.

use bokashi_core::Scalar;
use bokashi_render_ops::Size;

use crate::clip_scene::{ClipScene, Drawn};

/// Steps of the grid in one pixel. Pixel centres are on it.
pub(crate) const STEPS: i64 = 64;

/// Points on a grid of 1/64 px. In an image whose sides are powers of two, up to 256, their clip
/// coordinates are exact in both precisions.
#[derive(Debug, Clone)]
pub struct GridScene {
    /// In steps of the grid.
    pub points: Vec<[i64; 2]>,
    /// By the indices of points.
    pub faces: Vec<[u32; 3]>,
    /// In pixels.
    pub size: Size,
}

impl GridScene {
    pub(crate) fn scene(&self) -> ClipScene {
        let px = |number: i64| number as f64 / STEPS as f64;
        let points: Vec<_> = self.points.iter().map(|&[x, y]| [px(x), px(y)]).collect();
        ClipScene::from_px(&points, &self.faces, self.size)
    }

    /// How many faces cover each pixel centre: in whole numbers, the centre moved by a little to
    /// the right and by far less downwards, so that it lies on no edge.
    pub fn layers(&self) -> Vec<usize> {
        let Size { width, height } = self.size;
        let mut layers = vec![0; width * height];
        for &face in &self.faces {
            let [a, b, c] = face.map(|index| self.points[index as usize]);
            for (pixel, count) in layers.iter_mut().enumerate() {
                let (column, row) = ((pixel % width) as i64, (pixel / width) as i64);
                let center = [column * STEPS + STEPS / 2, row * STEPS + STEPS / 2];
                let sides = [side(a, b, center), side(b, c, center), side(c, a, center)];
                *count += usize::from(sides == [1; 3] || sides == [-1; 3]);
            }
        }
        layers
    }

    /// Whether any face covers each pixel.
    pub(crate) fn covered(&self) -> Vec<bool> {
        self.layers().into_iter().map(|count| count > 0).collect()
    }
}

/// On which side of the line from a to b the point p lies: 1, -1, or 0 for a line of no length.
fn side(a: [i64; 2], b: [i64; 2], p: [i64; 2]) -> i128 {
    let [dx, dy] = [b[0] - a[0], b[1] - a[1]].map(i128::from);
    let [px, py] = [p[0] - a[0], p[1] - a[1]].map(i128::from);
    // What a step to the right adds, then what a step downwards adds.
    let terms = [dx * py - dy * px, -dy, dx];
    terms.into_iter().find(|&term| term != 0).map_or(0, i128::signum)
}

/// How a drawn face compares with the linear system.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Comparison {
    /// Pixels that are covered in one alone.
    pub(crate) wrong: usize,
    /// Pixels too close to an edge or to an end of the depth range to tell.
    pub(crate) close: usize,
    /// Pixels that both cover.
    pub(crate) covered: usize,
    /// The largest difference of weights and depths.
    pub(crate) error: f64,
}

/// Compares with the weights b that solve `sum b_i (x_i, y_i, w_i) = (X, Y, 1)` by Cramer's rule,
/// for the one face of `scene`, after its positions were rounded to `T`.
pub(crate) fn compare<T: Scalar>(scene: &ClipScene, drawn: &Drawn) -> Comparison {
    let Size { width, height } = scene.size;
    let rounded = |index: u32| scene.clip[index as usize].map(|c| T::from_f64(c).to_f64());
    let corners = scene.faces[0].map(rounded);
    let column = |k: usize| corners.map(|corner| corner[k]);
    let (x, y, w) = (column(0), column(1), column(3));
    let determinant = |x: [f64; 3], y: [f64; 3], w: [f64; 3]| {
        x[0] * (y[1] * w[2] - y[2] * w[1]) - x[1] * (y[0] * w[2] - y[2] * w[0])
            + x[2] * (y[0] * w[1] - y[1] * w[0])
    };
    let whole = determinant(x, y, w);
    let mut comparison = Comparison::default();
    for (pixel, seen) in drawn.pixels.iter().enumerate() {
        let center_x = (2 * (pixel % width) + 1) as f64 / width as f64 - 1.0;
        let center_y = 1.0 - (2 * (pixel / width) + 1) as f64 / height as f64;
        let b: [f64; 3] = std::array::from_fn(|k| {
            let (mut x, mut y, mut w) = (x, y, w);
            (x[k], y[k], w[k]) = (center_x, center_y, 1.0);
            determinant(x, y, w) / whole
        });
        let size: f64 = b.iter().map(|b| b.abs()).sum();
        let depth: f64 = (0..3).map(|k| b[k] * corners[k][2]).sum();
        let margin = 1e-9;
        if b.iter().any(|b| b.abs() < margin * size) || (depth.abs() - 1.0).abs() < margin {
            comparison.close += 1;
            continue;
        }
        let inside = b.iter().all(|&b| b > 0.0) && depth.abs() < 1.0;
        if inside != seen.is_some() {
            comparison.wrong += 1;
        }
        if let Some(seen) = seen.filter(|_| inside) {
            comparison.covered += 1;
            let total: f64 = b.iter().sum();
            let found = [seen.uv[0], seen.uv[1], seen.depth];
            for (found, expected) in found.iter().zip([b[0] / total, b[1] / total, depth]) {
                comparison.error = comparison.error.maximum_or_nan((found - expected).abs());
            }
        }
    }
    comparison
}

/// The antialiased image of a single face with vertices in pixels, of the motley image `image`
/// before: each pair of neighbours by the text of the paper, without regard to w.
pub(crate) fn antialiased(
    corners: [[f64; 2]; 3],
    covered: &[bool],
    image: &[f64],
    size: Size,
) -> Vec<f64> {
    let Size { width, height } = size;
    // Of each pixel the shares of its neighbours, and what they add to it.
    let mut moved = vec![[0.0_f64; 2]; image.len()];
    for pixel in 0..width * height {
        let (column, row) = (pixel % width, pixel / width);
        for (below, neighbour, is_inside) in
            [(false, pixel + 1, column + 1 < width), (true, pixel + width, row + 1 < height)]
        {
            if !is_inside || covered[pixel] == covered[neighbour] {
                continue;
            }
            let (sign, owner) = if covered[pixel] { (1.0, pixel) } else { (-1.0, neighbour) };
            let center = [(owner % width) as f64 + 0.5, (owner / width) as f64 + 0.5];
            let local = corners.map(|[x, y]| {
                let (x, y) = (x - center[0], y - center[1]);
                if below { [y, x] } else { [x, y] }
            });
            // The straddling edge that lies farthest towards the other pixel.
            let mut farthest: Option<(f64, [f64; 2])> = None;
            for k in 0..3 {
                let ([x1, y1], [x2, y2]) = (local[k], local[(k + 1) % 3]);
                let (dx, dy) = (x2 - x1, y2 - y1);
                if (y1 < 0.0) != (y2 < 0.0) {
                    let d = sign * (x1 * dy - y1 * dx) / dy;
                    if farthest.is_none_or(|(other, _)| d > other) {
                        farthest = Some((d, [dx, dy]));
                    }
                }
            }
            let Some((d, [dx, dy])) = farthest else { continue };
            if dy.abs() < dx.abs() || !(-1.0 / 16.0..=17.0 / 16.0).contains(&d) {
                continue;
            }
            let alpha = sign * (0.5 - d.clamp(0.0, 1.0));
            let target = if alpha > 0.0 { pixel } else { neighbour };
            moved[target][0] += alpha.abs();
            moved[target][1] += alpha * (image[neighbour] - image[pixel]);
        }
    }
    let out = |(value, [share, sum]): (&f64, [f64; 2])| value + sum / share.max(1.0);
    image.iter().zip(moved).map(out).collect()
}
