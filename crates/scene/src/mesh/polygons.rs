//! Polygons of files as triangles.
//!
//! A polygon becomes as many triangles as it has corners, less two, and each corner is one of theirs. A
//! convex one is the fan around its first corner. A concave one is cut by ear clipping, seen along the axis
//! that is nearest to its normal, which leaves its coordinates as they are.
//!
//! Ear clipping drops corners on a straight side. They are put back into the triangle that has the side:
//! without them the faces beside it would no longer share its vertices.
//!
//! # Where no answer is right
//! A polygon that crosses itself stays the fan. One whose corners leave its plane is cut as any other. Both
//! are counted.
//!
//! # Sources
//! Normal: M. E. Newell's method, in Sutherland, Sproull, Schumacker, A Characterization of Ten
//! Hidden-Surface Algorithms, ACM Computing Surveys 1974. Ears: the crate earcut, after Mapbox's.

use std::collections::HashSet;
use std::f64::consts::TAU;

use earcut::Earcut;
use glam::{DVec2, DVec3};

use crate::mesh::notes::Notes;

/// A corner that turns backwards by less, as a sine, is straight: so far are numbers of `f32` off.
const STRAIGHT: f64 = 1e-6;
/// A corner is off its polygon's plane where its distance is a larger share of the polygon's extent.
const FLAT: f64 = 0.01;
/// Triangles cover a polygon where their areas differ from its own by a smaller share.
const COVERED: f64 = 1e-6;
/// The number of no corner.
const NONE: u32 = u32::MAX;

/// The polygons of more than three corners among the faces of a file, as fans.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    /// For each the number of its first triangle, and how many triangles it has.
    list: Vec<[u32; 2]>,
}

impl Polygons {
    /// A polygon of so many `corners` begins at the triangle `first`.
    pub(super) fn add(&mut self, first: usize, corners: usize) {
        if corners > 3 {
            self.list.push([first as u32, corners as u32 - 2]);
        }
    }

    /// Cuts the concave polygons anew in all index buffers, the first of which names `positions`.
    pub(super) fn cut(
        &self,
        positions: &[[f64; 3]],
        faces: &mut [&mut Vec<[u32; 3]>],
        notes: &mut Notes,
    ) {
        let (mut bent, mut crossing, mut ears) = (0, 0, Earcut::new());
        let mut points = Vec::new();
        for &[first, count] in &self.list {
            let all = first as usize..(first + count) as usize;
            let fan = &faces[0][all.clone()];
            points.clear();
            points.extend(corners(fan).map(|row| DVec3::from(positions[row as usize])));
            let cut = Cut::new(&points, &mut ears);
            bent += usize::from(cut.is_bent);
            crossing += usize::from(cut.crosses);
            if let Some(triangles) = cut.triangles {
                for faces in faces.iter_mut() {
                    let fan_corners: Vec<u32> = corners(&faces[all.clone()]).collect();
                    for (face, triangle) in faces[all.clone()].iter_mut().zip(&triangles) {
                        *face = triangle.map(|corner| fan_corners[corner as usize]);
                    }
                }
            }
        }
        let bent_note = "a polygon has corners that are off its plane by more than 1 % of its size";
        notes.count(bent_note, bent);
        let crossing_note = "a polygon crosses itself and became a fan around its first corner";
        notes.count(crossing_note, crossing);
    }
}

/// The corners of a fan.
fn corners(fan: &[[u32; 3]]) -> impl Iterator<Item = u32> + '_ {
    fan[0][..2].iter().copied().chain(fan.iter().map(|triangle| triangle[2]))
}

/// How a polygon is cut.
#[derive(Debug, Default)]
struct Cut {
    /// The corners of its triangles; nothing where they are the fan around the first corner.
    triangles: Option<Vec<[u32; 3]>>,
    is_bent: bool,
    crosses: bool,
}

impl Cut {
    fn new(points: &[DVec3], ears: &mut Earcut<f64>) -> Self {
        let count = points.len();
        let from_first = |k: usize| points[k] - points[0];
        let doubled: DVec3 = (1..count).map(|k| from_first(k - 1).cross(from_first(k))).sum();
        let [least, most] = points
            .iter()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], &p| [a.min(p), b.max(p)]);
        let extent = (most - least).length();
        // What is not finite is refused later.
        if !extent.is_finite() || !doubled.is_finite() {
            return Self::default();
        }
        let normal = doubled.normalize_or_zero();
        if normal == DVec3::ZERO || doubled.length() < STRAIGHT * extent * extent {
            // It has no area: it lies on a line, or its lobes cancel.
            let far = (0..count).map(from_first).fold(DVec3::ZERO, |far, way| {
                if way.length_squared() > far.length_squared() { way } else { far }
            });
            let widths = (0..count).map(|k| far.cross(from_first(k)).length());
            let width = widths.fold(0.0, f64::max);
            return Self { crosses: width > 1e-3 * far.length_squared(), ..Self::default() };
        }
        let middle = points.iter().sum::<DVec3>() / count as f64;
        let off = points.iter().map(|&p| (p - middle).dot(normal).abs()).fold(0.0, f64::max);
        let is_bent = off > FLAT * extent;

        // Counter-clockwise in two of the axes.
        let axis = normal.abs().max_position();
        let flattened = |p: DVec3| {
            let [x, y] = [p[(axis + 1) % 3], p[(axis + 2) % 3]];
            if normal[axis] > 0.0 { DVec2::new(x, y) } else { DVec2::new(y, x) }
        };
        let flat: Vec<DVec2> = (0..count).map(|k| flattened(from_first(k))).collect();
        let (is_convex, turned) = turns(&flat);
        if is_convex {
            // A star turns twice.
            return Self { triangles: None, is_bent, crosses: turned > 1.5 * TAU };
        }
        let mut clipped: Vec<u32> = Vec::new();
        ears.earcut(flat.iter().map(|p| p.to_array()), &[], &mut clipped);
        let mut triangles: Vec<[u32; 3]> = clipped.as_chunks().0.to_vec();
        // In the order of the corners, a triangle turns as the polygon does.
        triangles.iter_mut().for_each(|triangle| triangle.sort_unstable());
        let triangles = with_all_corners(triangles, count);
        let doubled_area = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|corner| flat[corner as usize]);
            (b - a).perp_dot(c - a)
        };
        let area: f64 = (1..count).map(|k| flat[k - 1].perp_dot(flat[k])).sum();
        let covered: f64 = triangles.iter().map(|triangle| doubled_area(triangle).abs()).sum();
        let crosses = triangles.len() != count - 2 || (covered - area).abs() > COVERED * area;
        Self { triangles: Some(triangles).filter(|_| !crosses), is_bent, crosses }
    }
}

/// Whether a polygon turns to one side alone, and the sum of the angles by which it turns.
fn turns(corners: &[DVec2]) -> (bool, f64) {
    let ends = corners.iter().skip(1).chain(corners.first());
    let sides = corners.iter().zip(ends).map(|(&start, &end)| end - start);
    let mut sides = sides.filter(|side| *side != DVec2::ZERO);
    let (mut is_convex, mut turned) = (true, 0.0);
    let Some(first) = sides.next() else { return (is_convex, turned) };
    let mut last = first;
    for side in sides.chain([first]) {
        let sine = last.perp_dot(side);
        is_convex &= sine >= -STRAIGHT * last.length() * side.length();
        // Back along the same line is half a turn.
        turned += sine.atan2(last.dot(side)).abs();
        last = side;
    }
    (is_convex, turned)
}

/// The triangles with the corners of straight sides that they lack, where each such side is that of one.
fn with_all_corners(triangles: Vec<[u32; 3]>, count: usize) -> Vec<[u32; 3]> {
    let kept: HashSet<u32> = triangles.iter().flatten().copied().collect();
    let mut order: Vec<u32> = kept.into_iter().collect();
    if order.len() == count || order.is_empty() {
        return triangles;
    }
    order.sort_unstable();
    // From each corner the next one that a triangle has.
    let mut following = vec![NONE; count];
    for (k, &corner) in order.iter().enumerate() {
        following[corner as usize] = order[(k + 1) % order.len()];
    }
    let after = |corner: u32| (corner + 1) % count as u32;
    let (mut whole, mut left) = (Vec::with_capacity(count - 2), triangles);
    while let Some([a, b, c]) = left.pop() {
        let side = [[a, b, c], [b, c, a], [c, a, b]]
            .into_iter()
            .find(|&[from, to, _]| following[from as usize] == to && after(from) != to);
        let Some([from, to, opposite]) = side else {
            whole.push([a, b, c]);
            continue;
        };
        let mut corner = from;
        while corner != to {
            let next = after(corner);
            following[corner as usize] = next;
            left.push([corner, next, opposite]);
            corner = next;
        }
    }
    whole
}
