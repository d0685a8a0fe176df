//! What is visible of faces in a pixel, exactly and by another way than the library's: a sweep.
//!
//! Between two heights at which lines meet, the same faces are seen in the same order along a row, and
//! how much of the row each one takes is linear in the height. So the rows at the middles of all such
//! stretches give the areas without error, but for rounding.

use bokashi_render_ops::Size;

/// Coefficients of 1, x and y in pixels from the top left corner.
type Line = [f64; 3];

/// A face over the image: what it covers, and its depth.
#[derive(Debug, Clone, Copy)]
struct Sheet {
    /// Positive inside, of largest coefficient 1.
    edges: [Line; 3],
    depth: Line,
}

fn at(line: Line, x: f64, y: f64) -> f64 {
    line[0] + line[1] * x + line[2] * y
}

impl Sheet {
    /// The weights b of the corners `(x, y, z, w)` at a point of the image are linear over it:
    /// `sum b_i (x_i, y_i, w_i) = (X, Y, 1)`. The face is seen where all are positive, at the depth
    /// `sum b_i z_i`. `None` for a face without area, to within rounding.
    fn new(corners: [[f64; 4]; 3], Size { width, height }: Size) -> Option<Self> {
        let p = corners
            .map(|[x, y, _, w]| [0.5 * width as f64 * (w + x), 0.5 * height as f64 * (w - y), w]);
        let cross = |[a, b, c]: [f64; 3], [d, e, f]: [f64; 3]| {
            [b * f - c * e, c * d - a * f, a * e - b * d]
        };
        let normals = [cross(p[1], p[2]), cross(p[2], p[0]), cross(p[0], p[1])];
        let volume: f64 = (0..3).map(|k| p[0][k] * normals[0][k]).sum();
        let edges = normals.map(|[x, y, one]| [one / volume, x / volume, y / volume]);
        let depth = [0, 1, 2].map(|c| (0..3).map(|k| corners[k][2] * edges[k][c]).sum());
        let sizes = p.map(|[x, y, w]| x.abs() + y.abs() + w.abs());
        let scaled = |line: Line| {
            let largest = line.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
            line.map(|c| c / largest)
        };
        (volume.abs() > 1e-15 * sizes[0] * sizes[1] * sizes[2])
            .then(|| Self { edges: edges.map(scaled), depth })
    }

    /// All lines at which something changes.
    fn lines(&self) -> [Line; 5] {
        let ([a, b, c], [one, x, y]) = (self.edges, self.depth);
        [a, b, c, [one - 1.0, x, y], [one + 1.0, x, y]]
    }

    fn is_seen(&self, x: f64, y: f64) -> bool {
        self.edges.iter().all(|&edge| at(edge, x, y) > 0.0) && at(self.depth, x, y).abs() <= 1.0
    }
}

/// The area of what is visible of each face in the pixel at `[column, row]`, in pixels: of faces at
/// equal depths, to within 1e-12, that of the first one.
pub fn visible_areas(
    clip: &[[f64; 4]],
    faces: &[[u32; 3]],
    size: Size,
    [column, row]: [usize; 2],
) -> Vec<f64> {
    let corners = |face: &[u32; 3]| face.map(|index| clip[index as usize]);
    let sheets: Vec<_> = faces.iter().map(|face| Sheet::new(corners(face), size)).collect();
    let [left, top] = [column, row].map(|place| place as f64);
    let all = || sheets.iter().enumerate().filter_map(|(face, sheet)| Some((face, (*sheet)?)));
    let mut lines: Vec<Line> = all().flat_map(|(_, sheet)| sheet.lines()).collect();
    for (face, one) in all() {
        let others = all().take_while(|(other, _)| *other < face);
        lines.extend(others.map(|(_, other)| [0, 1, 2].map(|c| one.depth[c] - other.depth[c])));
    }
    // Only those that pass through the pixel.
    lines.retain(|&line| {
        let ends = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let sides = ends.map(|[x, y]| at(line, left + x, top + y) > 0.0);
        sides != [true; 4] && sides != [false; 4]
    });
    let borders = [[-left, 1.0, 0.0], [-left - 1.0, 1.0, 0.0]];
    lines.extend(borders);

    let mut heights = vec![top, top + 1.0];
    for (k, a) in lines.iter().enumerate() {
        for b in &lines[..k] {
            let height = (a[0] * b[1] - a[1] * b[0]) / (a[1] * b[2] - a[2] * b[1]);
            heights.extend((top < height && height < top + 1.0).then_some(height));
        }
        // A level line.
        heights.extend((a[1] == 0.0).then(|| (-a[0] / a[2]).clamp(top, top + 1.0)));
    }
    heights.sort_unstable_by(f64::total_cmp);

    let mut areas = vec![0.0; faces.len()];
    for pair in heights.windows(2).filter(|pair| pair[0] < pair[1]) {
        let y = 0.5 * (pair[0] + pair[1]);
        let crossing = |line: &Line| -(line[0] + line[2] * y) / line[1];
        let mut places: Vec<f64> = lines.iter().map(crossing).collect();
        places.retain(|place| (left..=left + 1.0).contains(place));
        places.sort_unstable_by(f64::total_cmp);
        for ends in places.windows(2) {
            let x = 0.5 * (ends[0] + ends[1]);
            let mut seen: Option<(usize, f64)> = None;
            for (face, sheet) in all().filter(|(_, sheet)| sheet.is_seen(x, y)) {
                let depth = at(sheet.depth, x, y);
                if seen.is_none_or(|(_, nearest)| depth < nearest - 1e-12) {
                    seen = Some((face, depth));
                }
            }
            if let Some((face, _)) = seen {
                areas[face] += (ends[1] - ends[0]) * (pair[1] - pair[0]);
            }
        }
    }
    areas
}
