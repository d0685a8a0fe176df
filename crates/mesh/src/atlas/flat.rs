//! Charts in the plane: projected along their axes, and cut where projections would overlap.

use bokashi_render_ops::glam::{DVec2, DVec3};

use super::charts::{Chart, Faces, NONE};
use crate::box_tree::{Bounds, BoxTree};
use crate::placed::Placed;
use crate::triangle::nearest;

/// A chart projected to the plane.
pub(super) struct FlatChart {
    pub(super) faces: Vec<u32>,
    /// The vertices of the mesh at its corners, each once.
    pub(super) vertices: Vec<u32>,
    /// The positions of these vertices in the plane. The least coordinates are 0.
    pub(super) points: Vec<DVec2>,
    /// The faces, with indices into `vertices`.
    pub(super) corners: Vec<[u32; 3]>,
    /// The largest coordinates.
    pub(super) extent: DVec2,
}

/// Faces projected along an axis: z is the height along it.
struct ProjectedFaces {
    corners: Vec<[DVec3; 3]>,
    bounds: Vec<Bounds>,
}

/// Projects charts to the plane, and cuts them where needed. No two faces of a flat chart overlap. Faces less than
/// `reach` apart in the plane are also near in space.
pub(super) fn flattened(
    charts: &[Chart],
    faces: &Faces,
    placed: &Placed,
    indices: &[[u32; 3]],
    reach: f64,
) -> Vec<FlatChart> {
    let mut flat = Vec::new();
    // A stack: a chart that is cut is replaced by its parts.
    let mut open: Vec<_> = charts.iter().rev().cloned().collect();
    while let Some(Chart { faces: all, axis }) = open.pop() {
        let projected = ProjectedFaces::new(&all, axis, placed, indices);
        let is_kept = projected.kept(reach);
        if is_kept.iter().all(|is_kept| *is_kept) {
            flat.push(FlatChart::new(all, axis, placed, indices));
            continue;
        }
        let pick = |kept: bool| {
            let picked = all.iter().zip(&is_kept).filter(|(_, is_kept)| **is_kept == kept);
            picked.map(|(face, _)| *face).collect::<Vec<_>>()
        };
        let parts = faces.parts(&pick(true)).into_iter().chain(faces.parts(&pick(false)));
        open.extend(parts.map(|faces| Chart { faces, axis }));
    }
    flat
}

/// Two unit vectors across `axis` that are right-handed with it.
fn across(axis: DVec3) -> [DVec3; 2] {
    let (right, up) = axis.any_orthonormal_pair();
    if right.cross(up).dot(axis) > 0.0 { [right, up] } else { [up, right] }
}

impl ProjectedFaces {
    fn new(all: &[u32], axis: DVec3, placed: &Placed, indices: &[[u32; 3]]) -> Self {
        let [right, up] = across(axis);
        let project = |point: DVec3| DVec3::new(point.dot(right), point.dot(up), point.dot(axis));
        let corners: Vec<_> =
            all.iter().map(|face| placed.corners(indices[*face as usize]).map(project)).collect();
        let bounds = corners.iter().map(|corners| Bounds::around(corners)).collect();
        Self { corners, bounds }
    }

    /// Which faces stay in the chart: of two that do not [`fit`], the first.
    fn kept(&self, reach: f64) -> Vec<bool> {
        let tree = BoxTree::new(&self.bounds);
        let mut is_kept = vec![true; self.corners.len()];
        for face in 0..self.corners.len() {
            is_kept[face] = !self.has_rival(&tree, face, reach, |other| {
                other < face
                    && is_kept[other]
                    && !fit(&self.corners[face], &self.corners[other], reach)
            });
        }
        is_kept
    }

    /// Whether `is_rival` is true of a face that may not [`fit`] with this one. Such faces overlap its projection, or
    /// they are less than `reach` beside it and more than `2 reach` above or below it. In a smooth chart only
    /// neighbours are tested, however large `reach` is.
    fn has_rival(
        &self,
        tree: &BoxTree,
        face: usize,
        reach: f64,
        mut is_rival: impl FnMut(usize) -> bool,
    ) -> bool {
        let corners = &self.corners[face];
        let [low, high] = [
            corners[0].min(corners[1]).min(corners[2]),
            corners[0].max(corners[1]).max(corners[2]),
        ];
        let beside = DVec3::new(reach, reach, 0.0);
        let [near_low, near_high] = [low - beside, high + beside];
        let (deep, far) = (f64::NEG_INFINITY, f64::INFINITY);
        [
            [low.with_z(deep), high.with_z(far)],
            [near_low.with_z(low.z + 2.0 * reach), near_high.with_z(far)],
            [near_low.with_z(deep), near_high.with_z(high.z - 2.0 * reach)],
        ]
        .iter()
        .any(|ends| tree.has_near(&Bounds::around(ends), |other, _| is_rival(other as usize)))
    }
}

/// Whether two projected faces can lie in one chart.
fn fit(one: &[DVec3; 3], other: &[DVec3; 3], reach: f64) -> bool {
    if overlap(one, other) {
        return false;
    }
    // Faces with a common corner are near in space.
    if one.iter().any(|corner| other.contains(corner)) {
        return true;
    }
    let flat = |corners: &[DVec3; 3]| corners.map(|corner| DVec3::new(corner.x, corner.y, 0.0));
    let is_near = |of: &[DVec3; 3], to: &[DVec3; 3]| {
        of.iter().all(|corner| {
            let (weights, square) = nearest(flat(to), DVec3::new(corner.x, corner.y, 0.0));
            let height: f64 = (0..3).map(|k| weights[k] * to[k].z).sum();
            square >= reach * reach || (corner.z - height).abs() <= 2.0 * reach
        })
    };
    is_near(one, other) && is_near(other, one)
}

/// Whether two counter-clockwise faces overlap in the plane. Convex shapes do unless an edge of one separates them.
fn overlap(one: &[DVec3; 3], other: &[DVec3; 3]) -> bool {
    let is_between = |edges: &[DVec3; 3], points: &[DVec3; 3]| {
        (0..3).any(|k| {
            let (start, along) = (edges[k], edges[(k + 1) % 3] - edges[k]);
            points.iter().all(|point| along.cross(*point - start).z <= 0.0)
        })
    };
    !is_between(one, other) && !is_between(other, one)
}

impl FlatChart {
    fn new(faces: Vec<u32>, axis: DVec3, placed: &Placed, indices: &[[u32; 3]]) -> Self {
        let corners = faces.iter().map(|face| indices[*face as usize]);
        let mut vertices: Vec<u32> = corners.clone().flatten().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let place =
            |vertex: u32| vertices.binary_search(&vertex).map_or(NONE, |place| place as u32);
        let corners = corners.map(|face| face.map(place)).collect();
        let [right, up] = across(axis);
        let project = |vertex: &u32| {
            let point = placed.points[*vertex as usize];
            DVec2::new(point.dot(right), point.dot(up))
        };
        let points: Vec<_> = vertices.iter().map(project).collect();
        let (points, extent) = upright(&points);
        Self { faces, vertices, points, corners, extent }
    }

    /// The area in the plane.
    pub(super) fn area(&self) -> f64 {
        let twice = self.corners.iter().map(|face| {
            let [a, b, c] = face.map(|vertex| self.points[vertex as usize]);
            (b - a).perp_dot(c - a)
        });
        0.5 * twice.sum::<f64>()
    }
}

/// Turns points so that the box around them has the least area and is at least as high as wide; also the extent of the
/// box. A side of the least box lies along an edge of the convex hull (Freeman and Shapira 1975).
fn upright(points: &[DVec2]) -> (Vec<DVec2>, DVec2) {
    let hull = hull(points);
    let mut best = (f64::INFINITY, DVec2::X);
    for k in 0..hull.len() {
        let along = (hull[(k + 1) % hull.len()] - hull[k]).normalize_or(DVec2::X);
        let [low, high] = bounds(hull.iter().map(|point| turned(along, *point)));
        let area = (high - low).element_product();
        if area < best.0 {
            best = (area, along);
        }
    }
    let mut turn = best.1;
    let [low, high] = bounds(hull.iter().map(|point| turned(turn, *point)));
    if high.x - low.x > high.y - low.y {
        turn = turn.perp();
    }
    let turned: Vec<_> = points.iter().map(|point| turned(turn, *point)).collect();
    let [low, high] = bounds(turned.iter().copied());
    (turned.into_iter().map(|point| point - low).collect(), high - low)
}

/// The coordinates of a point along the unit vector `along` and across it.
fn turned(along: DVec2, point: DVec2) -> DVec2 {
    DVec2::new(along.dot(point), along.perp_dot(point))
}

fn bounds(points: impl Iterator<Item = DVec2>) -> [DVec2; 2] {
    points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], point| {
        [low.min(point), high.max(point)]
    })
}

/// The convex hull, counter-clockwise, by Andrew's monotone chain (1979).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull: Vec<DVec2> = Vec::new();
    let half = |points: &mut dyn Iterator<Item = DVec2>, hull: &mut Vec<DVec2>| {
        let first = hull.len();
        for point in points {
            // A chain turns left at each of its points.
            while let [.., a, b] = hull[first..]
                && (b - a).perp_dot(point - a) <= 0.0
            {
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
    };
    half(&mut sorted.iter().copied(), &mut hull);
    half(&mut sorted.iter().rev().copied(), &mut hull);
    if hull.is_empty() {
        sorted.truncate(1);
        sorted
    } else {
        hull
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{Model, sphere, torus};

    /// The faces of a model whose normals have at least such a cosine with the z axis, seen along it.
    fn projected_faces(model: &Model, least: f64) -> ProjectedFaces {
        let (positions, mesh) = (model.positions(), model.mesh());
        let placed = Placed::new("projected", &positions, &mesh).unwrap();
        let faces = Faces::new(&placed, &mesh);
        let all: Vec<u32> = (0..model.faces.len() as u32)
            .filter(|k| faces.normals[*k as usize].z >= least)
            .collect();
        ProjectedFaces::new(&all, DVec3::Z, &placed, &model.faces)
    }

    #[test]
    fn faces_stay_that_fit_with_all_before_that_stay() {
        let above = |height| move |point: DVec3| point + height * DVec3::Z;
        let mut cut = 0;
        for model in [
            sphere(8).shaken(0.1, 3),
            sphere(6).and(sphere(5).moved(above(0.4))),
            torus(20, 10, 0.3).shaken(0.1, 7),
        ] {
            let projected = projected_faces(&model, 0.3);
            for reach in [0.0, 0.01, 0.05, 0.1, 0.3, 1.0] {
                let mut expected: Vec<bool> = Vec::new();
                for (face, one) in projected.corners.iter().enumerate() {
                    let mut before = projected.corners[..face].iter().zip(&expected);
                    expected.push(before.all(|(other, stays)| !stays || fit(one, other, reach)));
                }
                cut += expected.iter().filter(|stays| !**stays).count();
                assert_eq!(projected.kept(reach), expected, "{reach}");
            }
        }
        assert!(cut > 500, "{cut}");
    }

    #[test]
    fn a_smooth_chart_has_as_many_rivals_however_far_they_reach() {
        let projected = projected_faces(&sphere(24), 0.6);
        let tree = BoxTree::new(&projected.bounds);
        for reach in [0.03, 0.1, 0.5, 3.0] {
            let mut count = 0;
            for face in 0..projected.corners.len() {
                projected.has_rival(&tree, face, reach, |_| {
                    count += 1;
                    false
                });
            }
            let share = count as f64 / projected.corners.len() as f64;
            assert!(share < 24.0, "{reach}: {share} each of {}", projected.corners.len());
        }
    }
}
