//! Culling: what becomes of a face before any of its pixels is visited.
//!
//! A face is left out if all its vertices lie beyond one of the view's planes, if its area is zero
//! within rounding, or if the side that it shows is culled. For all others this file finds the pixels
//! that they can touch. The area has the sign of the determinant of the three vertices.

use bokashi_core::Scalar;

use super::corner::{BEHIND, Corner, HALF_A_PIXEL, ROUNDING_OF_PIXELS, UNUSUAL, touched};
use super::filter::{Boxes, EIGHT, Filter, Octet, Record};
use crate::edges::repeats_a_vertex;
use crate::homogeneous::{Vertex, determinant, edge, edge_error_bound};
use crate::raster_options::{Cull, RasterOptions};
use crate::size::Size;

/// What becomes of a face.
#[derive(Debug, Clone, Copy)]
pub(super) enum Fate {
    /// Its area is zero within rounding, or it repeats a vertex.
    Degenerate,
    /// All of it lies beside the image, behind the eye, or outside the depth range.
    Outside,
    /// It turns the side away that is not drawn.
    Facing,
    /// It can touch pixels in these columns and rows, first and last; in none where the last
    /// comes before the first.
    Drawn { columns: [u32; 2], rows: [u32; 2] },
}

/// The sign of a face's area as it is seen, and what becomes of the face. The sign is 0 where the area
/// is zero within rounding, or where that side is not drawn: the surface ends at such a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Verdict {
    pub(super) orientation: i8,
    /// Whether it is drawn and reaches behind the eye: its outline is not that of its vertices.
    pub(super) reaches_behind: bool,
    pub(super) fate: Fate,
}

impl Verdict {
    /// Whether its face is drawn.
    #[inline(always)]
    pub(super) fn is_drawn(&self) -> bool {
        matches!(self.fate, Fate::Drawn { .. })
    }

    /// On the face of these vertices.
    #[inline(never)]
    pub(super) fn from_corners<S: Scalar<Wide = S>>(
        corners: [&Corner<S>; 3],
        vertices: [u32; 3],
        options: RasterOptions,
        most_noise: S,
    ) -> Self {
        let [p, q, r] = corners.map(|corner| corner.vertex);
        let determinant = determinant(p, edge(q, r));
        // No sign that is an accident: all that asks which way the face turns, asks this number.
        let noise = if determinant.abs() > most_noise {
            most_noise
        } else if repeats_a_vertex(vertices) {
            // Wherever it lies.
            return Self { orientation: 0, reaches_behind: false, fate: Fate::Degenerate };
        } else {
            rounding([p, q, r], options.size)
        };
        let orientation = i8::from(determinant > noise) - i8::from(determinant < -noise);
        let [a, b, c] = corners.map(|corner| corner.beyond);
        let fate = if a & b & c & !UNUSUAL != 0 {
            Fate::Outside
        } else if orientation == 0 {
            Fate::Degenerate
        } else if is_turned_away(orientation, options.cull) {
            Fate::Facing
        } else if (a | b | c) & BEHIND != 0 {
            let Size { width, height } = options.size;
            Fate::Drawn { columns: [0, width as u32 - 1], rows: [0, height as u32 - 1] }
        } else {
            let margin = reach_of_pixels(options);
            let touched =
                |axis, extent| touched(corners.map(|corner| corner.pixel[axis]), extent, margin);
            let Size { width, height } = options.size;
            Fate::Drawn { columns: touched(0, width), rows: touched(1, height) }
        };
        let is_drawn = matches!(fate, Fate::Drawn { .. });
        let orientation = if matches!(fate, Fate::Facing) { 0 } else { orientation };
        Self { orientation, reaches_behind: is_drawn && (a | b | c) & BEHIND != 0, fate }
    }
}

impl Boxes {
    /// The `k`-th of the faces is drawn.
    #[inline(always)]
    fn drawn(&self, k: usize) -> Fate {
        let [columns, rows] = [&self.columns, &self.rows].map(|[first, last]| {
            if first[k] <= last[k] { [first[k] as u32, last[k] as u32] } else { [1, 0] }
        });
        Fate::Drawn { columns, rows }
    }
}

/// Whether a face shows the side that is not drawn.
#[inline(always)]
fn is_turned_away(orientation: i8, cull: Cull) -> bool {
    match cull {
        Cull::None => false,
        Cull::Back => orientation < 0,
        Cull::Front => orientation > 0,
    }
}

/// The work of judging `faces`, of which `verdicts` are filled in: not as a closure, which would not be compiled for the
/// vectors that were found.
pub(super) struct Judge<'a, S> {
    pub(super) faces: &'a [[u32; 3]],
    pub(super) corners: &'a [Corner<S>],
    pub(super) records: &'a [Record],
    pub(super) filter: &'a Filter,
    pub(super) options: RasterOptions,
    pub(super) most_noise: S,
    pub(super) verdicts: &'a mut [Verdict],
}

impl<S: Scalar<Wide = S>> pulp::WithSimd for Judge<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { faces, corners, records, filter, options, most_noise, verdicts } = self;
        let margin = reach_of_pixels(options) + ROUNDING_OF_PIXELS;
        for (faces, verdicts) in faces.chunks(EIGHT).zip(verdicts.chunks_mut(EIGHT)) {
            // Where there are fewer than eight, the last one takes part several times.
            let eight = std::array::from_fn(|k| faces[k.min(faces.len() - 1)]);
            let boxes = filter.boxes(&Octet::gather(records, eight), options.size, margin);
            for (k, (&face, verdict)) in faces.iter().zip(verdicts).enumerate() {
                let orientation = boxes.orientations[k] as i8;
                // Each is written where it stays: out of a copy that was written in pieces it would be read as a whole,
                // and wait for all of them.
                if orientation == 0 {
                    let of_face = face.map(|vertex| &corners[vertex as usize]);
                    *verdict = Verdict::from_corners(of_face, face, options, most_noise);
                } else if is_turned_away(orientation, options.cull) {
                    *verdict =
                        Verdict { orientation: 0, reaches_behind: false, fate: Fate::Facing };
                } else {
                    *verdict = Verdict { orientation, reaches_behind: false, fate: boxes.drawn(k) };
                }
            }
        }
    }
}

/// The size below which a determinant's sign is an accident of rounding. `D = sum_i w_i a_i`, so its
/// rounding errors are below `sum_i |w_i| bound_i`. Bounds are relative, so each product also has a share
/// of [`LEAST_PRODUCT`].
#[inline(always)]
fn rounding<S: Scalar<Wide = S>>(vertices: [Vertex<S>; 3], size: Size) -> S {
    let least = S::from_f64(LEAST_PRODUCT);
    (0..3).fold(least, |sum, k| {
        let bound = edge_error_bound(vertices[(k + 1) % 3], vertices[(k + 2) % 3], size);
        sum + vertices[k].w.abs() * (bound + least)
    })
}

/// Products below this size lose digits: they lie near the smallest numbers. A determinant as small is no
/// divisor of depths and weights.
const LEAST_PRODUCT: f64 = f64::MIN_POSITIVE / f64::EPSILON;

/// The largest x, y and w of some vertices, apart from their signs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extents<S>([S; 3]);

impl<S: Scalar> Default for Extents<S> {
    fn default() -> Self {
        Self([S::ZERO; 3])
    }
}

impl<S: Scalar<Wide = S>> Extents<S> {
    pub(super) fn from_corners(corners: &[Corner<S>]) -> Self {
        let of_corner = |Corner { vertex, .. }: &Corner<S>| {
            Self([vertex.x, vertex.y, vertex.w].map(|number| number.abs()))
        };
        corners.iter().map(of_corner).fold(Self::default(), Self::with)
    }

    /// Those of other vertices, too.
    #[inline(always)]
    pub(super) fn with(self, others: Self) -> Self {
        let larger = |k: usize| if others.0[k] > self.0[k] { others.0[k] } else { self.0[k] };
        Self([0, 1, 2].map(larger))
    }

    /// At least the [`rounding`] of any face of theirs.
    pub(super) fn most_rounding(self, size: Size) -> S {
        let [x, y, w] = self.0;
        let vertex = Vertex { x, y, z: S::ZERO, w };
        S::from_f64(1.0 + 1e-12) * rounding([vertex; 3], size)
    }
}

/// How far beyond its centre a pixel is of interest.
fn reach_of_pixels(options: RasterOptions) -> f64 {
    if options.sampling.has_pieces() { HALF_A_PIXEL } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The six orders of a face's corners: three rotations in either winding.
    const ORDERS: [[u32; 3]; 6] =
        [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1]];

    #[test]
    fn a_face_has_an_orientation_unless_its_area_is_a_rounding_error() {
        let size = Size::square(16);
        let orientation = |clip: &[[f64; 4]; 3], face: [u32; 3]| {
            let corners = face.map(|vertex| Corner::new(clip.as_flattened(), vertex, size));
            let noise = Extents::from_corners(&corners).most_rounding(size);
            Verdict::from_corners(corners.each_ref(), face, size.into(), noise).orientation
        };
        // On a line but for rounding: in the image, and beside it, where faces are left out as outside.
        for shift in [0.0, 20.0] {
            let on_line = |k: f64| [0.1 * k + shift, 0.07 * k - 0.013, 0.0, 1.0];
            for k in 0..50 {
                let clip = [-7.0, 1.0 + 0.1 * f64::from(k), 6.0].map(on_line);
                for face in ORDERS {
                    assert_eq!(orientation(&clip, face), 0, "{clip:?}");
                }
            }
            let off_line = [[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]];
            let clip = off_line.map(|[x, y]| [x + shift, y, 0.0, 1.0]);
            assert_eq!([[0, 1, 2], [0, 2, 1]].map(|face| orientation(&clip, face)), [1, -1]);
        }
        // So far to the side that the determinant lies among the smallest numbers, and not at 0.
        let far =
            [[1e164, 1e6, 0.0, 40.0], [-1e164, -7e5, 0.0, 300.0], [5e163, 1.3e6, 0.0, -200.0]];
        let [p, q, r] = [0, 1, 2].map(|k| Corner::new(far.as_flattened(), k, size).vertex);
        assert_ne!(determinant(p, edge(q, r)), 0.0);
        assert_eq!(orientation(&far, [0, 1, 2]), 0);
    }
}
