//! Antialiasing by its definition, one pair of neighbouring pixels after another: slow, plain, and
//! independent of the implementation.

use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::{Coverage, Fragments, Size, depth};

/// One blend of neighbouring pixels.
#[derive(Debug, Clone, Copy)]
pub struct Blend {
    /// The first pixel and the second one, on its right or below.
    pub pair: [usize; 2],
    /// The vertices of the edge, the smaller index first.
    pub edge: [u32; 2],
    /// The share of the second pixel mixed into the first where positive, of the first into the
    /// second where negative.
    pub alpha: f64,
    /// Whether the edge passes beyond the centre of one of the pixels.
    pub clamped: bool,
}

impl Blend {
    fn choice(&self) -> Choice {
        (self.pair, self.edge, self.alpha > 0.0, self.clamped)
    }
}

/// The pair, the edge, whether its first pixel is blended, and whether the share is at a limit.
pub type Choice = ([usize; 2], [u32; 2], bool, bool);

/// What does not move where vertices move by very little, blend after blend.
pub fn choices<T: Scalar>(fragments: &Fragments<'_, T>, clip: &Tensor<f64>) -> Vec<Choice> {
    blends(fragments, clip).iter().map(Blend::choice).collect()
}

/// The blends of a picture of `fragments`, whose vertices are `clip: [V, 4]`.
pub fn blends<T: Scalar>(fragments: &Fragments<'_, T>, clip: &Tensor<f64>) -> Vec<Blend> {
    let Size { width, height } = fragments.coverage.size();
    let depth = depth(fragments).unwrap().value();
    let coverage = &fragments.coverage;
    let visible: Vec<Option<VisibleFace>> = (0..width * height)
        .map(|pixel| {
            let fragment = coverage.fragment_at(pixel)?;
            Some((coverage.face_at(pixel)?, depth.data()[fragment].to_f64()))
        })
        .collect();
    let mut blends = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let first = row * width + column;
            if column + 1 < width {
                blends.extend(blend(coverage, &visible, clip, [first, first + 1]));
            }
            if row + 1 < height {
                blends.extend(blend(coverage, &visible, clip, [first, first + width]));
            }
        }
    }
    blends
}

/// The face that a pixel's centre sees, and how deep.
pub type VisibleFace = (usize, f64);

fn blend(
    coverage: &Coverage,
    visible: &[Option<VisibleFace>],
    clip: &Tensor<f64>,
    pair: [usize; 2],
) -> Option<Blend> {
    let Size { width, height } = coverage.size();
    let faces = coverage.mesh().faces();
    let (face, covers_first) = match (visible[pair[0]], visible[pair[1]]) {
        (None, None) => return None,
        (Some((face, _)), None) => (face, true),
        (None, Some((face, _))) => (face, false),
        (Some((face, _)), Some((other, _))) if face == other => return None,
        (Some((face, z)), Some((other, z_other))) => {
            if z_other < z {
                (other, false)
            } else {
                (face, true)
            }
        }
    };

    // Pixels across and down from the image's top left corner, homogeneous; for a pair one above
    // the other with the two exchanged, so that the pair always runs along the first axis.
    let is_upright = pair[1] != pair[0] + 1 || width == 1;
    let point = |vertex: u32| -> [f64; 3] {
        let row = &clip.data()[4 * vertex as usize..][..4];
        let (x, y, w) = (row[0], row[1], row[3]);
        let (across, down) = (0.5 * (x + w) * width as f64, 0.5 * (w - y) * height as f64);
        if is_upright { [down, across, w] } else { [across, down, w] }
    };
    let (column, row) = ((pair[0] % width) as f64 + 0.5, (pair[0] / width) as f64 + 0.5);
    let (along, across) = if is_upright { (row, column) } else { (column, row) };

    // The edge whose crossing with the line through both centres lies farthest from the centre
    // that the face covers.
    let corners = faces[face];
    let mut farthest: Option<(f64, usize)> = None;
    for corner in 0..3 {
        let [p, q] = [point(corners[(corner + 1) % 3]), point(corners[(corner + 2) % 3])];
        let [f, g] = [p, q].map(|p| p[1] - across * p[2]);
        if (f < 0.0) == (g < 0.0) {
            continue;
        }
        let t = f / (f - g);
        let at: [f64; 3] = std::array::from_fn(|k| p[k] + t * (q[k] - p[k]));
        let from_first = at[0] / at[2] - along;
        let distance = if covers_first { from_first } else { 1.0 - from_first };
        if at[2] > 0.0 && farthest.is_none_or(|(other, _)| distance > other) {
            farthest = Some((distance, corner));
        }
    }
    let (distance, corner) = farthest?;
    let [j, k] = [corners[(corner + 1) % 3], corners[(corner + 2) % 3]];
    let [p, q] = [point(j), point(k)];
    let normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let side = |r: [f64; 3]| (0..3).map(|i| normal[i] * r[i]).sum::<f64>();
    let at_edge: Vec<u32> = faces
        .iter()
        .filter(|face| face.contains(&j) && face.contains(&k))
        .flat_map(|face| face.iter().copied().filter(|&vertex| vertex != j && vertex != k))
        .collect();
    let is_silhouette = match *at_edge {
        [one, other] => side(point(one)) * side(point(other)) >= 0.0,
        _ => true,
    };
    let slack = 1.0 / 16.0;
    if !is_silhouette
        || normal[0].abs() < normal[1].abs()
        || !(-slack..=1.0 + slack).contains(&distance)
    {
        return None;
    }
    let inside = distance.clamp(0.0, 1.0);
    let alpha = if covers_first { 0.5 - inside } else { inside - 0.5 };
    Some(Blend { pair, edge: [j.min(k), j.max(k)], alpha, clamped: inside != distance })
}
