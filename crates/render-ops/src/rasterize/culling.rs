//! Culling: what becomes of a face before any of its pixels is visited.
//!
//! A face is left out if all its vertices lie beyond one of the view's planes, if its area is zero
//! within rounding, or if the side that it shows is culled. For all others this file finds the pixels
//! that they can touch. The area has the sign of the determinant of the three vertices.

use std::ops::Range;

use bokashi_core::Scalar;
use pulp::Simd;

use super::corner::{BEHIND, ClipVertices, Corner, HALF_A_PIXEL, touched};
use super::filter::{Boxes, EIGHT, Eight, Filter, Octet, Record, split_into_eights};
use crate::coverage::Culled;
use crate::edges::repeats_a_vertex;
use crate::homogeneous::{Vertex, determinant, edge, edge_error_bound};
use crate::raster_options::{Cull, RasterOptions, Sampling};
use crate::scratch::resize;
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
    /// It can touch these pixels.
    Drawn(Touched),
}

/// Columns and rows of pixels, first and last; none where the last comes before the first.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Touched {
    pub(super) columns: [u32; 2],
    pub(super) rows: [u32; 2],
}

impl Touched {
    /// The pixels of a face, or up to `margin` beyond.
    pub(super) fn from_corners<S: Scalar<Wide = S>>(
        corners: [&Corner<S>; 3],
        Size { width, height }: Size,
        margin: f64,
    ) -> Self {
        if corners.iter().any(|corner| corner.vertex.w <= S::ZERO) {
            return Self { columns: [0, width as u32 - 1], rows: [0, height as u32 - 1] };
        }
        let pixels = corners.map(|corner| corner.pixel(Size { width, height }));
        let touched =
            |axis: usize, extent| touched(pixels.map(|pixel| pixel[axis]), extent, margin);
        Self { columns: touched(0, width), rows: touched(1, height) }
    }

    /// The columns, and of the rows of a band those that are among them, perhaps none.
    #[inline(always)]
    pub(super) fn within(&self, band: &Range<usize>) -> [Range<usize>; 2] {
        let [[left, right], [top, bottom]] =
            [self.columns, self.rows].map(|ends| ends.map(|end| end as usize));
        let first = band.start.max(top);
        [left..right + 1, first..band.end.min(bottom + 1).max(first)]
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        let Self { columns, rows } = self;
        columns[0] > columns[1] || rows[0] > rows[1]
    }

    /// Those of the `k`-th of eight faces.
    #[inline(always)]
    pub(super) fn from_box(boxes: &Boxes, k: usize) -> Self {
        let [columns, rows] = [&boxes.columns, &boxes.rows].map(|[first, last]| {
            if first[k] <= last[k] { [first[k] as u32, last[k] as u32] } else { [1, 0] }
        });
        Self { columns, rows }
    }
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
        let [a, b, c] = corners.map(|corner| corner.beyond(options.size));
        let fate = if a & b & c != 0 {
            Fate::Outside
        } else if orientation == 0 {
            Fate::Degenerate
        } else if orientation == turned_away(options.cull) {
            Fate::Facing
        } else {
            let margin = reach_of_pixels(options.sampling);
            Fate::Drawn(Touched::from_corners(corners, options.size, margin))
        };
        let is_drawn = matches!(fate, Fate::Drawn(_));
        let orientation = if matches!(fate, Fate::Facing) { 0 } else { orientation };
        Self { orientation, reaches_behind: is_drawn && (a | b | c) & BEHIND != 0, fate }
    }
}

/// The orientation of the side that is not drawn: 2, which no face has, where both sides are.
#[inline(always)]
fn turned_away(cull: Cull) -> i8 {
    match cull {
        Cull::None => 2,
        Cull::Back => -1,
        Cull::Front => 1,
    }
}

/// What faces are judged by.
pub(super) struct Rules<'a, T: Scalar> {
    pub(super) corners: ClipVertices<'a, T>,
    pub(super) records: &'a [Record],
    pub(super) filter: &'a Filter,
    pub(super) options: RasterOptions,
    /// At least the rounding of any face's area.
    pub(super) most_noise: T::Wide,
}

/// The work of judging the faces from `first` on, whose `orientations` are filled in: not as a closure, which would not
/// be compiled for the vectors that were found.
pub(super) struct Judge<'a, T: Scalar> {
    pub(super) rules: &'a Rules<'a, T>,
    pub(super) faces: &'a [[u32; 3]],
    pub(super) first: usize,
    pub(super) orientations: &'a mut [i8],
    pub(super) judged: &'a mut Judged,
}

/// A face, and the first and the last row of pixels that it can touch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Listed {
    pub(super) face: u32,
    pub(super) rows: [u32; 2],
}

/// What became of some faces.
#[derive(Debug, Default)]
pub(super) struct Judged {
    /// Those that can touch pixels come first, so many.
    listed: Vec<Listed>,
    listed_count: usize,
    pub(super) culled: Culled,
    /// Whether some face that is drawn reaches behind the eye.
    pub(super) reaches_behind: bool,
}

impl Judged {
    /// The faces that can touch pixels.
    pub(super) fn listed(&self) -> &[Listed] {
        &self.listed[..self.listed_count]
    }

    /// Counts a face; returns which pixels it can touch, if any.
    fn count(&mut self, verdict: &Verdict) -> Option<Touched> {
        match verdict.fate {
            Fate::Degenerate => self.culled.degenerate += 1,
            Fate::Outside => self.culled.outside += 1,
            Fate::Facing => self.culled.facing += 1,
            Fate::Drawn(touched) => {
                self.reaches_behind |= verdict.reaches_behind;
                return Some(touched).filter(|touched| !touched.is_empty());
            }
        }
        None
    }
}

impl<T: Scalar> pulp::WithSimd for Judge<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, simd: V) {
        let Self { rules, faces, first, orientations, judged } = self;
        judged.culled = Culled::default();
        judged.reaches_behind = false;
        // Taken out, so that its place stays in a register.
        let mut listed = std::mem::take(&mut judged.listed);
        resize(&mut listed, faces.len() + EIGHT, Listed::default);
        let (mut count, mut facing) = (0, [0; EIGHT]);
        let (eights, last) = split_into_eights(faces);
        let blocks = eights.iter().chain(&last).zip(orientations.chunks_mut(EIGHT));
        for (first, (faces, orientations)) in (first as u32..).step_by(EIGHT).zip(blocks) {
            let mut eight = rules.judge_eight(simd, faces);
            let own = orientations.len();
            if own < EIGHT {
                // Those that only fill the block are neither.
                eight.are_listed[own..].fill(0);
                eight.are_away[own..].fill(0);
            }
            if eight.has_doubt {
                rules.settle(&mut eight, &faces[..own], judged);
            }
            let narrow = |to: &mut [i8]| {
                to.iter_mut().zip(eight.orientations).for_each(|(to, turn)| *to = turn as i8);
            };
            // Of a length that is known it is one store.
            match orientations.first_chunk_mut::<EIGHT>() {
                Some(of_eight) => narrow(of_eight),
                None => narrow(orientations),
            }
            facing = std::array::from_fn(|k| facing[k] - eight.are_away[k]);
            // Neighbours mostly turn the same way.
            if eight.are_listed == [0; EIGHT] {
                continue;
            }
            let Some(next) = listed[count..].first_chunk_mut::<EIGHT>() else { break };
            let mut place = 0;
            for k in 0..EIGHT {
                // Without a branch, which nobody could foretell.
                let rows = [eight.rows[0][k] as u32, eight.rows[1][k] as u32];
                next[place % EIGHT] = Listed { face: first + k as u32, rows };
                place += eight.are_listed[k] as usize;
            }
            count += place;
        }
        judged.culled.facing += facing.into_iter().sum::<i32>() as usize;
        (judged.listed, judged.listed_count) = (listed, count);
    }
}

/// What becomes of eight faces.
struct EightJudged {
    orientations: Eight<i32>,
    /// First and last that each can touch.
    rows: [Eight<i32>; 2],
    /// 1 for those that can touch pixels.
    are_listed: Eight<i32>,
    /// -1 for those that turn the side away that is not drawn.
    are_away: Eight<i32>,
    /// Whether one at least has to be judged in wide numbers: those have the orientation 0 and are not turned away.
    has_doubt: bool,
}

impl<T: Scalar> Rules<'_, T> {
    /// Judges eight faces by the filter.
    #[inline(always)]
    fn judge_eight<V: Simd>(&self, simd: V, faces: &Eight<[u32; 3]>) -> EightJudged {
        let Self { records, filter, options, .. } = *self;
        let away = i32::from(turned_away(options.cull));
        let octet = Octet::gather(simd, records, *faces);
        let boxes = filter.boxes(&octet, options.size, options.sampling);
        let Boxes { columns, rows, orientations: before_culling } = boxes;
        let [mut are_listed, mut are_away, mut have_pixels] = [[0; EIGHT]; 3];
        let mut orientations = [0; EIGHT];
        // Loops of one step each stay vectors.
        for k in 0..EIGHT {
            are_away[k] = -i32::from(before_culling[k] == away);
        }
        for k in 0..EIGHT {
            have_pixels[k] =
                i32::from((columns[0][k] <= columns[1][k]) & (rows[0][k] <= rows[1][k]));
        }
        for k in 0..EIGHT {
            are_listed[k] = have_pixels[k] & !are_away[k];
        }
        for k in 0..EIGHT {
            orientations[k] = before_culling[k] & !are_away[k];
        }
        // 1 & 1 = 1 & -1 = 1, and 1 & 0 = 0: it is 0 where one is in doubt.
        let all = before_culling.iter().fold(1, |all, orientation| all & orientation);
        EightJudged { orientations, rows, are_listed, are_away, has_doubt: all == 0 }
    }

    /// Judges those in doubt in wide numbers.
    #[cold]
    #[inline(never)]
    fn settle(&self, eight: &mut EightJudged, faces: &[[u32; 3]], judged: &mut Judged) {
        for (k, &vertices) in faces.iter().enumerate() {
            if eight.orientations[k] != 0 || eight.are_away[k] != 0 {
                continue;
            }
            let corners = self.corners.corners_of(vertices);
            let verdict =
                Verdict::from_corners(corners.each_ref(), vertices, self.options, self.most_noise);
            let touched = judged.count(&verdict);
            eight.orientations[k] = verdict.orientation.into();
            eight.are_listed[k] = i32::from(touched.is_some());
            let [top, bottom] = touched.unwrap_or_default().rows;
            (eight.rows[0][k], eight.rows[1][k]) = (top as i32, bottom as i32);
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
pub(super) struct Extents<S>(pub(super) [S; 3]);

impl<S: Scalar> Default for Extents<S> {
    fn default() -> Self {
        Self([S::ZERO; 3])
    }
}

impl<S: Scalar<Wide = S>> Extents<S> {
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
fn reach_of_pixels(sampling: Sampling) -> f64 {
    if sampling.has_pieces() { HALF_A_PIXEL } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::corner::Scaling;
    use super::super::vertices::Measures;
    use super::*;

    /// The six orders of a face's corners: three rotations in either winding.
    const ORDERS: [[u32; 3]; 6] =
        [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1]];

    #[test]
    fn a_face_has_an_orientation_unless_its_area_is_a_rounding_error() {
        let size = Size::square(16);
        let orientation = |clip: &[[f64; 4]; 3], face: [u32; 3]| {
            let corners = face.map(|vertex| Corner::new(clip.as_flattened(), vertex, size));
            let positions = ClipVertices::new(clip.as_flattened(), size, Scaling::Own);
            let noise = Measures::from_sample(&positions).extents.most_rounding(size);
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
