//! Faces that lie side by side in a cell, so that none hides another.
//!
//! At an edge that is not on the outline, one face ends and another begins. So the number of faces that
//! cover a place changes only across sides that lie on the outline. If no other face meets such a side but at
//! its ends, there is nothing beyond it, and one face within. If a cell has such sides, and that is so at all
//! of them, no place of it is covered twice: else some place beside one of these sides would be.
//!
//! That takes a look at each pair of a side and a face, in place of each pair of faces.

use bokashi_core::Scalar;

use super::parts::Source;
use super::polygon::{Bound, Line, Polygon, Polygons, size, value_at};

/// Stands for "no face".
pub(super) const NO_FACE: u32 = u32::MAX;

/// Fewer faces are soon held against each other.
const FEW: usize = 6;

/// Values within the first share of a line's size may be rounding; values beyond the second are not.
const ROUNDING: f64 = 1e-14;
const CLEAR: f64 = 1e-9;

/// A face in a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceInCell<'a, S> {
    /// What the cell holds of it.
    pub(super) polygon: Polygon,
    /// Its edge functions, positive inside.
    pub(super) edges: &'a [Line<S>; 3],
    /// The faces beyond its edges; [`NO_FACE`] at those of the outline, and at those that may be.
    pub(super) neighbors: [u32; 3],
}

/// Whether faces surely lie side by side in a cell. They end at edges alone, and where one ends at an edge
/// that is not on its outline, another one begins. `source` tells which edge bounds a polygon.
#[inline(always)]
pub(super) fn lie_side_by_side<'a, S: Scalar>(
    faces: impl ExactSizeIterator<Item = FaceInCell<'a, S>> + Clone,
    polygons: &Polygons<S>,
    source: impl Fn(Bound) -> Option<Source>,
) -> bool {
    if faces.len() < FEW {
        return false;
    }
    let mut has_outline = false;
    for (index, face) in
        faces.clone().enumerate().filter(|(_, face)| face.neighbors.contains(&NO_FACE))
    {
        for (bound, ends) in polygons.segments(face.polygon) {
            // Of the outline only: across any other edge the neighbour begins where the face ends.
            let Some(Source::Edge { k, .. }) = source(bound) else { continue };
            if face.neighbors[usize::from(k)] != NO_FACE {
                continue;
            }
            has_outline = true;
            let mut others = faces.clone().enumerate().filter(|&(other, _)| other != index);
            let is_beside = |(_, other): (usize, FaceInCell<'_, S>)| {
                ends_beside(ends, other.edges)
                    || lies_off(face.edges[usize::from(k)], polygons.points(other.polygon))
            };
            if !others.all(is_beside) {
                return false;
            }
        }
    }
    has_outline
}

/// Whether one of a face's edges leaves all of a side from p to q outside, clearly but for one of its ends.
#[inline(always)]
fn ends_beside<S: Scalar>([p, q]: [[S; 2]; 2], edges: &[Line<S>; 3]) -> bool {
    edges.iter().any(|&edge| {
        let [a, b] = [p, q].map(|end| value_at(edge, end));
        let size = size(edge);
        let (most, clear) = (S::from_f64(ROUNDING) * size, S::from_f64(-CLEAR) * size);
        (a < clear && b <= most) || (b < clear && a <= most)
    })
}

/// Whether all of these points clearly lie on one side of a line.
#[inline(always)]
fn lies_off<S: Scalar>(line: Line<S>, mut points: impl Iterator<Item = [S; 2]> + Clone) -> bool {
    let clear = S::from_f64(CLEAR) * size(line);
    points.clone().all(|point| value_at(line, point) > clear)
        || points.all(|point| value_at(line, point) < -clear)
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    const COLUMNS: usize = 4;
    const ROWS: usize = 3;

    /// The faces of a net over the pixel that run counter-clockwise, with the faces beyond their edges.
    pub(in super::super) fn net(shifts: &[[f64; 2]]) -> Vec<([Line<f64>; 3], [u32; 3])> {
        let vertex = |index: usize| {
            let (column, row) = (index % COLUMNS, index / COLUMNS);
            // It ends within the pixel.
            [
                0.9 * column as f64 - 2.1 + shifts[index][0],
                0.9 * row as f64 - 1.3 + shifts[index][1],
            ]
        };
        let mut faces = Vec::new();
        for row in 0..ROWS - 1 {
            for column in 0..COLUMNS - 1 {
                let [a, b] = [0, 1].map(|k| row * COLUMNS + column + k);
                let [c, d] = [a, b].map(|index| index + COLUMNS);
                faces.extend([[a, b, d], [a, d, c]]);
            }
        }
        let line = |a: usize, b: usize| {
            let ([p_x, p_y], [q_x, q_y]) = (vertex(a), vertex(b));
            [p_x * q_y - p_y * q_x, p_y - q_y, q_x - p_x]
        };
        let edges = |[a, b, c]: [usize; 3]| [line(b, c), line(c, a), line(a, b)];
        faces.retain(|&face| edges(face).iter().map(|edge| edge[0]).sum::<f64>() > 1e-6);
        let beyond = |a: usize, b: usize| {
            let runs_back =
                |face: &[usize; 3]| (0..3).any(|k| [face[k], face[(k + 1) % 3]] == [b, a]);
            faces.iter().position(runs_back).map_or(NO_FACE, |face| face as u32)
        };
        let neighbors = |[a, b, c]: [usize; 3]| [beyond(b, c), beyond(c, a), beyond(a, b)];
        faces.iter().map(|&face| (edges(face), neighbors(face))).collect()
    }

    /// Whether faces are found to lie side by side in the pixel, and the largest area that two of them share.
    fn look(faces: &[([Line<f64>; 3], [u32; 3])]) -> (bool, f64) {
        let mut polygons = Polygons::default();
        let pixel = polygons.rectangle([-1.0; 2], [1.0; 2]);
        let mut cut = |from: Polygon, face: usize| {
            let mut lines = faces[face].0.iter().zip(3 * face as u32..);
            let part =
                lines.try_fold(from, |part, (&line, index)| polygons.inside(part, line, index));
            (part, part.map_or(0.0, |part| polygons.area(part)))
        };
        let parts: Vec<_> =
            (0..faces.len()).filter_map(|face| Some((face, cut(pixel, face).0?))).collect();
        let mut shared = 0.0;
        for (index, &(_, part)) in parts.iter().enumerate() {
            for &(other, _) in &parts[index + 1..] {
                shared = f64::max(shared, cut(part, other).1);
            }
        }
        let all = parts.iter().map(|&(face, polygon)| {
            let (edges, neighbors) = &faces[face];
            FaceInCell { polygon, edges, neighbors: *neighbors }
        });
        let source = |bound: Bound| {
            let line = bound.line();
            let edge = Source::Edge { band_face: line / 3, k: (line % 3) as u8 };
            (line < u32::MAX).then_some(edge)
        };
        (lie_side_by_side(all, &polygons, source), shared)
    }

    pub(in super::super) fn shifts(most: f64) -> impl Strategy<Value = Vec<[f64; 2]>> {
        proptest::collection::vec(proptest::array::uniform2(-most..most), COLUMNS * ROWS)
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn what_lies_side_by_side_shares_no_area(most in 0.0..1.2, unit in shifts(1.0)) {
            let shifts: Vec<_> = unit.iter().map(|shift| shift.map(|by| most * by)).collect();
            let (are_side_by_side, shared) = look(&net(&shifts));
            prop_assert!(!are_side_by_side || shared < 1e-12, "{shared}");
        }

        #[test]
        fn a_net_without_folds_is_found(shifts in shifts(0.1)) {
            let (are_side_by_side, shared) = look(&net(&shifts));
            prop_assert!(are_side_by_side && shared < 1e-12, "{are_side_by_side} {shared}");
        }
    }

    /// As both sides of a surface do that is seen edge-on: the sides of the outline are those of both.
    #[test]
    fn faces_on_the_same_side_of_an_edge_do_not_lie_side_by_side() {
        let mut faces = net(&[[0.0; 2]; COLUMNS * ROWS]);
        faces.extend(faces.clone());
        let (are_side_by_side, shared) = look(&faces);
        assert!(!are_side_by_side && shared > 0.1);
    }
}
