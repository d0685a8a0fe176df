//! Culling: what becomes of a face before any of its pixels is visited.
//!
//! A face is left out if all its vertices lie beyond one of the view's planes, if its area is zero
//! within rounding, or if the side that it shows is culled. For all others this file finds the pixels
//! that they can touch. The area has the sign of the determinant of the three vertices.

use std::ops::Range;

use bokashi_core::Scalar;

use super::canvas::resize;
use super::corner::{BEHIND, Corner, Corners, HALF_A_PIXEL, ROUNDING_OF_PIXELS, touched};
use super::filter::{Boxes, EIGHT, Filter, Octet, Record};
use crate::coverage::Culled;
use crate::edges::repeats_a_vertex;
use crate::homogeneous::{Vertex, determinant, edge, edge_error_bound};
use crate::raster_options::{Cull, RasterOptions, Sampling};
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

    /// The columns, and of the rows of a band those that are among them.
    #[inline(always)]
    pub(super) fn within(&self, band: &Range<usize>) -> [Range<usize>; 2] {
        let [[left, right], [top, bottom]] =
            [self.columns, self.rows].map(|ends| ends.map(|end| end as usize));
        [left..right + 1, band.start.max(top)..band.end.min(bottom + 1)]
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

/// The orientation of the side that is not drawn; none is 2.
#[inline(always)]
fn turned_away(cull: Cull) -> i8 {
    match cull {
        Cull::None => 2,
        Cull::Back => -1,
        Cull::Front => 1,
    }
}

/// The work of judging the faces from `first` on, whose `orientations` are filled in: not as a closure, which would not
/// be compiled for the vectors that were found.
pub(super) struct Judge<'a, T: Scalar> {
    pub(super) faces: &'a [[u32; 3]],
    pub(super) first: usize,
    pub(super) corners: Corners<'a, T>,
    pub(super) records: &'a [Record],
    pub(super) filter: &'a Filter,
    pub(super) options: RasterOptions,
    pub(super) most_noise: T::Wide,
    pub(super) rows_per_band: usize,
    pub(super) orientations: &'a mut [i8],
    pub(super) judged: &'a mut Judged,
}

/// A face, and the first and the last band that it can touch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Listed {
    pub(super) face: u32,
    pub(super) bands: [u32; 2],
}

/// What became of some faces.
#[derive(Debug, Default)]
pub(super) struct Judged {
    /// Those that can touch pixels come first.
    listed: Vec<Listed>,
    count: usize,
    pub(super) culled: Culled,
    /// Whether some face that is drawn reaches behind the eye.
    pub(super) reaches_behind: bool,
}

impl Judged {
    /// The faces that can touch pixels.
    pub(super) fn listed(&self) -> &[Listed] {
        &self.listed[..self.count]
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
    fn with_simd<V: pulp::Simd>(mut self, _: V) {
        let faces = self.faces;
        let (listed, culled) = (std::mem::take(&mut self.judged.listed), Culled::default());
        *self.judged = Judged { listed, count: 0, culled, reaches_behind: false };
        resize(&mut self.judged.listed, faces.len(), Listed::default);
        for (block, faces) in faces.chunks(EIGHT).enumerate() {
            self.judge_eight(block * EIGHT, faces);
        }
    }
}

impl<T: Scalar> Judge<'_, T> {
    /// Judges up to eight faces, of which the first is number `start`.
    #[inline(always)]
    fn judge_eight(&mut self, start: usize, faces: &[[u32; 3]]) {
        let Self { filter, options, .. } = *self;
        let away = i32::from(turned_away(options.cull));
        let margin = reach_of_pixels(options.sampling) + ROUNDING_OF_PIXELS;
        // Where there are fewer than eight, the last one takes part several times.
        let eight = std::array::from_fn(|k| faces[k.min(faces.len() - 1)]);
        let boxes = filter.boxes(&Octet::gather(self.records, eight), options.size, margin);
        let per_row = 1.0 / self.rows_per_band as f64;
        let ([mut first_bands, mut last_bands], mut are_listed) = ([[0; EIGHT]; 2], [0; EIGHT]);
        for k in 0..EIGHT {
            let [columns, rows] = [&boxes.columns, &boxes.rows].map(|[a, b]| [a[k], b[k]]);
            // Half a row from where the next whole number starts, so that rounding changes nothing.
            let band = |row: i32| ((f64::from(row) + 0.5) * per_row) as i32 as u32;
            (first_bands[k], last_bands[k]) = (band(rows[0]), band(rows[1]));
            let is_listed =
                (boxes.orientations[k] != away) & (columns[0] <= columns[1]) & (rows[0] <= rows[1]);
            are_listed[k] = u32::from(is_listed);
        }
        for (k, &vertices) in faces.iter().enumerate() {
            let orientation = boxes.orientations[k];
            let (mut bands, mut is_listed) = ([first_bands[k], last_bands[k]], are_listed[k] == 1);
            let number = start + k;
            if orientation == 0 {
                let touched = self.judge_one(number, vertices);
                is_listed = touched.is_some();
                bands = touched.unwrap_or_default().rows.map(|row| row / self.rows_per_band as u32);
            } else {
                let is_away = orientation == away;
                self.judged.culled.facing += usize::from(is_away);
                self.orientations[number] = if is_away { 0 } else { orientation as i8 };
            }
            self.judged.listed[self.judged.count] =
                Listed { face: (self.first + number) as u32, bands };
            self.judged.count += usize::from(is_listed);
        }
    }

    /// Judges a face in wide numbers.
    #[cold]
    #[inline(never)]
    fn judge_one(&mut self, number: usize, vertices: [u32; 3]) -> Option<Touched> {
        let corners = self.corners.of_face(vertices);
        let verdict =
            Verdict::from_corners(corners.each_ref(), vertices, self.options, self.most_noise);
        self.orientations[number] = verdict.orientation;
        self.judged.count(&verdict)
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
            let positions = Corners::new(clip.as_flattened(), size, None);
            let noise = Measures::new(&positions, size, 0..3).extents.most_rounding(size);
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
