//! A floating-point filter: what single precision decides beyond doubt.
//!
//! Most pixels lie far from a face's edges, and most surfaces far from each other. There numbers of 32 bits, of which a
//! vector holds twice as many, give the answer of [`Scalar::Wide`]. What a bound leaves in doubt is worked out in wide
//! numbers (`setup`, `culling`), so nothing depends on the filter but the time.
//!
//! # Vertices
//! A vertex of 16 bytes has its pixel coordinates as whole numbers of a unit h, so that differences are exact, and its
//! depth z / w less a depth amid them, so that they are small. Only *tame* vertices have one (`corner`).
//!
//! # Bounds
//! Let b be the larger side of a face's box in pixels and `B = b + 1`. Coordinates from the face's first pixel are off by
//! half a unit, and by the rounding of a difference to single precision, `e B` with `e = 2^-24`.
//!
//! *Edge functions* `E = (x_j - X) (y_k - Y) - (x_k - X) (y_j - Y)`, at most 7 pixels beyond the box. Coordinates that are
//! off by d move E by `4 d (B + 3.5)`. Rounding of the coefficients and of their sum takes `17 e B (B + 3.5)`, of which 4
//! are the coordinates'. So E is certain beyond `(2 h + 17 e B) (B + 3.5) + slack`.
//!
//! *Slack* is what wide numbers leave in doubt themselves, in square pixels, and so that the sign of the area holds for
//! `culling`. The w of a face's vertices are within a factor of [`EVEN`]. Then `setup`'s bound is below
//! `65 eps W H EVEN^2 / 4`, and that of the determinant below `193 eps W H EVEN^2 / 4`, for W x H pixels.
//!
//! *Depths* are stored in units of a tolerance, [`RESOLUTION`] of half their range, and are certain where they differ by
//! more than 1. A sample of vertices tells the middle and the unit: both may be off within bounds (`with_depths_of`).
//! So stored depths are below 20,000, and four roundings of them take 0.005 of the 0.02 that `blocks` leaves.
//!
//! A pixel with the weights `b_i` has the depth of the plane through the vertices. Where these are off by `d_i`, it is
//! off by `grad z . sum b_i d_i`, at most half a unit times `|z_x| + |z_y|`; 1.4 times that for pixels that may lie a
//! little outside, since `blocks` asks for an area of 16 bounds. Rounding moves both weights and the area by what it
//! moves edge functions by, over the area, and sums by less: four times in all, times the range of the depths. `blocks`
//! asks that the sum is less than 1 / 2.
//!
//! # Source
//! Filters: Shewchuk, *Adaptive precision floating-point arithmetic and fast robust geometric predicates*, Discrete and
//! Computational Geometry 18, 1997.

use bokashi_core::Scalar;
use pulp::Simd;

use super::corner::{Corner, HALF_A_PIXEL, ROUNDING_OF_PIXELS};
use crate::order::{largest, least};
use crate::raster_options::Sampling;
use crate::size::Size;

/// Faces, or pixels of a row, that are worked on side by side.
pub(super) const EIGHT: usize = 8;

pub(super) type Eight<V> = [V; EIGHT];

/// Splits items into whole blocks of eight and, if some are left, one more block, which their last item fills up.
#[inline(always)]
pub(super) fn split_into_eights<I: Copy>(items: &[I]) -> (&[Eight<I>], Option<Eight<I>>) {
    let (eights, rest) = items.as_chunks();
    let filled = rest.last().map(|&last| {
        let mut filled = [last; EIGHT];
        filled[..rest.len()].copy_from_slice(rest);
        filled
    });
    (eights, filled)
}

/// The w of the vertices of one face differ by less than this factor.
const EVEN: f32 = 4.0;

/// The largest depth that is drawn, and less the smallest.
const LARGEST_DEPTH: f64 = 1.0;

/// Whether none of the depths between two that lie on a line is drawn.
#[inline(always)]
pub(super) fn are_beyond([a, b]: [f64; 2]) -> bool {
    let least = LARGEST_DEPTH * (1.0 + 1e-3);
    a > least && b > least || a < -least && b < -least
}

/// Whether a depth in wide numbers is drawn.
#[inline(always)]
pub(super) fn is_drawn(depth: f64) -> bool {
    depth.abs() <= LARGEST_DEPTH
}

/// Depths that differ by more than this share of the largest depth are told apart.
const RESOLUTION: f64 = 2e-4;

/// Half the range of depths from which on they are told apart. The tolerance stays far above what wide numbers round,
/// some 1e-15, and in units of it depths stay far below [`EMPTY`].
const LEAST_HALF: f64 = 1e-9;

/// The depth of a pixel that nothing covers: far beyond any other.
pub(super) const EMPTY: f32 = 1e30;

/// What the filter measures with, for one mesh in one image.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Filter {
    /// A pixel has `2^bits` units.
    bits: u32,
    /// In pixels.
    unit: f32,
    /// In square pixels: see the head of this file.
    slack: f32,
    /// The same in square units.
    slack_in_units: f32,
    /// Half a pixel, and more than the roundings of a coordinate within the image, in units.
    half: i32,
    rounding: i32,
    /// A depth amid the others.
    middle: f64,
    /// Stored depths have so many units.
    per_depth: f64,
    /// Whether all depths are 0, in wide numbers too.
    is_flat: bool,
}

/// What is asked of the depths of some vertices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Depths {
    /// Of tame vertices.
    pub(super) least: f64,
    pub(super) largest: f64,
    /// The size of the largest z: where it is 0, all depths are.
    pub(super) largest_z: f64,
}

impl Default for Depths {
    fn default() -> Self {
        Self { least: f64::INFINITY, largest: f64::NEG_INFINITY, largest_z: 0.0 }
    }
}

impl Depths {
    /// Those of other vertices, too.
    #[inline(always)]
    pub(super) fn with(self, others: Self) -> Self {
        let larger = |a: f64, b: f64| if b > a { b } else { a };
        Self {
            least: if others.least < self.least { others.least } else { self.least },
            largest: larger(self.largest, others.largest),
            largest_z: larger(self.largest_z, others.largest_z),
        }
    }
}

/// A vertex, as the filter sees it: the bits of four numbers, so that all are loaded at once.
///
/// The first two are x and y, as whole numbers of units from the centre of the first pixel. The third is its depth less
/// that amid the others, in units of the tolerance. The last is its w. It is 0 for a vertex that is not tame: no face with
/// such a vertex is even.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(16))]
pub(super) struct Record([u32; 4]);

/// The vertices of eight faces, number by number.
#[derive(Debug)]
pub(super) struct Octet {
    pub(super) x: [Eight<i32>; 3],
    pub(super) y: [Eight<i32>; 3],
    pub(super) depth: [Eight<f32>; 3],
    w: [Eight<f32>; 3],
}

/// The pixels that eight faces can touch, and which way they surely turn.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    /// First and last.
    pub(super) columns: [Eight<i32>; 2],
    pub(super) rows: [Eight<i32>; 2],
    /// 1 or -1 as `culling` has it, or 0 where it has to be asked.
    pub(super) orientations: Eight<i32>,
}

impl Filter {
    /// Of a mesh with vertices of these depths.
    pub(super) fn new(depths: Depths, size: Size) -> Self {
        let extent = size.width.max(size.height) as u64;
        // A coordinate stays below 2^30.
        let bits = 30_u32.saturating_sub(extent.next_power_of_two().trailing_zeros());
        let unit = (-f64::from(bits)).exp2();
        let even = f64::from(EVEN * EVEN);
        let slack =
            2.0 * 193.0 / 4.0 * f64::EPSILON * even * size.width as f64 * size.height as f64;
        let Depths { least, largest, largest_z } = depths;
        let middle = if least <= largest { 0.5 * (least + largest) } else { 0.0 };
        // Where there is nothing to tell apart, that of all depths in view.
        let half = 0.5 * (largest - least);
        let per_depth = 1.0 / (RESOLUTION * if half > LEAST_HALF { half } else { LARGEST_DEPTH });
        let [unit_in_pixels, slack] = [unit, slack].map(|number| number as f32);
        Self {
            bits,
            unit: unit_in_pixels,
            slack,
            slack_in_units: slack / (unit_in_pixels * unit_in_pixels),
            half: (HALF_A_PIXEL / unit).ceil() as i32,
            rounding: (ROUNDING_OF_PIXELS / unit).ceil() as i32 + 1,
            middle,
            per_depth,
            is_flat: largest_z == 0.0,
        }
    }

    /// This filter, but storing depths as another does, which was made from a sample of the vertices. `None` unless that
    /// stores them as finely, within a factor of 2, and its middle lies within their range.
    pub(super) fn with_depths_of(self, of_sample: &Self) -> Option<Self> {
        let ratio = of_sample.per_depth / self.per_depth;
        let shift = (of_sample.middle - self.middle).abs() * self.per_depth;
        ((0.5..=2.0).contains(&ratio) && shift * RESOLUTION <= 1.0)
            .then_some(Self { is_flat: self.is_flat, ..*of_sample })
    }

    /// Of a vertex.
    #[inline(always)]
    pub(super) fn record<S: Scalar<Wide = S>>(&self, corner: &Corner<S>, size: Size) -> Record {
        // A sum that is so large that its last digit is 1: its low bits are the nearest whole number.
        let units = f64::from(1_u32 << self.bits);
        let whole = |pixel: f64| (pixel * units + 6_755_399_441_055_744.0).to_bits() as u32;
        let [x, y] = corner.pixel(size).map(whole);
        let [depth, w] = [self.narrow(corner.depth()), corner.vertex.w.to_f64() as f32];
        let record = Record([x, y, depth.to_bits(), w.to_bits()]);
        // Chosen afterwards: without a branch there are vectors.
        if corner.is_tame(size) { record } else { Record::default() }
    }

    /// What a later face has to be nearer by, beside the tolerance: where all depths are 0, the first face wins.
    #[inline(always)]
    pub(super) fn advantage(&self) -> f32 {
        if self.is_flat { 2.0 } else { 0.0 }
    }

    /// By how much a depth that was computed in wide numbers has to differ from another.
    #[inline(always)]
    pub(super) fn tolerance_at(&self, depth: f32) -> f32 {
        1.0 + DIGITS * depth.abs()
    }

    /// A depth in wide numbers, as it is stored.
    #[inline(always)]
    pub(super) fn narrow(&self, depth: f64) -> f32 {
        ((depth - self.middle) * self.per_depth) as f32
    }

    /// Whether an error of depths is a small share of the tolerance.
    #[inline(always)]
    pub(super) fn is_small(&self, error: f64) -> bool {
        error * self.per_depth < 0.1
    }

    /// Whether depths between two, which are wide numbers and lie on a line, are surely drawn, and can be computed in single
    /// precision: their rounding is a small share of the tolerance.
    #[inline(always)]
    pub(super) fn is_plain(&self, ends: [f64; 2]) -> bool {
        ends.iter().all(|&depth| {
            depth.abs() < LARGEST_DEPTH * (1.0 - 1e-9) && DIGITS * self.narrow(depth).abs() < 0.25
        })
    }

    /// The depths at some centres, as they are stored, and by how much each has to differ from another. What is not drawn
    /// lies behind all.
    #[inline(always)]
    pub(super) fn depths_of<V: Simd, S: Scalar>(
        &self,
        simd: V,
        centers: &[S],
        depth: impl Fn(S) -> S,
    ) -> (V::f32s, V::f32s) {
        let mut depths = [0.0; EIGHT];
        for (stored, &x) in depths.iter_mut().zip(centers) {
            let depth = depth(x).to_f64();
            *stored = if is_drawn(depth) { self.narrow(depth) } else { 2.0 * EMPTY };
        }
        let depths = simd.partial_load_f32s(&depths[..V::F32_LANES]);
        let digits = simd.splat_f32s(DIGITS);
        (depths, simd.mul_add_e_f32s(digits, simd.abs_f32s(depths), simd.splat_f32s(1.0)))
    }

    /// What eight faces can touch of pixels, as they are sampled, and which way they turn.
    #[inline(always)]
    pub(super) fn boxes(&self, octet: &Octet, size: Size, sampling: Sampling) -> Boxes {
        let Octet { x, y, w, .. } = octet;
        let bits = self.bits;
        let margin = self.rounding + if sampling.has_pieces() { self.half } else { 0 };
        let up = (1 << bits) - 1 - margin;
        let last = [size.width, size.height].map(|extent| extent as i32 - 1);
        let mut boxes = Boxes::default();
        for k in 0..EIGHT {
            let [lx, hx] = [x[0][k].min(x[1][k]).min(x[2][k]), x[0][k].max(x[1][k]).max(x[2][k])];
            let [ly, hy] = [y[0][k].min(y[1][k]).min(y[2][k]), y[0][k].max(y[1][k]).max(y[2][k])];
            boxes.columns[0][k] = ((lx + up) >> bits).max(0);
            boxes.columns[1][k] = ((hx + margin) >> bits).min(last[0]);
            boxes.rows[0][k] = ((ly + up) >> bits).max(0);
            boxes.rows[1][k] = ((hy + margin) >> bits).min(last[1]);
            let [ax, ay] = [(x[1][k] - x[0][k]) as f32, (y[1][k] - y[0][k]) as f32];
            let [bx, by] = [(x[2][k] - x[0][k]) as f32, (y[2][k] - y[0][k]) as f32];
            // Rows go down.
            let area = ay * bx - ax * by;
            let bound = self.area_bound([ax, ay], [bx, by]);
            let of_vertices = [w[0][k], w[1][k], w[2][k]];
            let (least, largest) = (least(of_vertices), largest(of_vertices));
            let bound = if largest < EVEN * least { bound } else { f32::INFINITY };
            boxes.orientations[k] = i32::from(area > bound) - i32::from(area < -bound);
        }
        boxes
    }

    /// The size, in square units, beyond which the area between two edges is certain. Each coordinate of an edge is off by a
    /// unit, and terms by four roundings.
    #[inline(always)]
    fn area_bound(&self, [ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
        (ax.abs() + ay.abs() + bx.abs() + by.abs() + 2.0)
            + 4.2 * HALF_EPSILON * ((ay * bx).abs() + (ax * by).abs())
            + self.slack_in_units
    }

    /// Coordinates in pixels from the first column and row of eight boxes.
    #[inline(always)]
    pub(super) fn around(
        &self,
        octet: &Octet,
        [columns, rows]: [&Eight<i32>; 2],
    ) -> [[Eight<f32>; 2]; 3] {
        let mut local = [[[0.0; EIGHT]; 2]; 3];
        // Not by `from_fn`, which would be a call.
        for i in 0..3 {
            for k in 0..EIGHT {
                let (x, y) = (octet.x[i][k], octet.y[i][k]);
                local[i][0][k] = (x - (columns[k] << self.bits)) as f32 * self.unit;
                local[i][1][k] = (y - (rows[k] << self.bits)) as f32 * self.unit;
            }
        }
        local
    }

    /// The size beyond which edge functions are certain, for a face whose box has a larger side of `b` pixels.
    #[inline(always)]
    pub(super) fn edge_bound(&self, b: f32) -> f32 {
        2.001 * self.unit * (b + 4.5) + rounding_of_edges(b) + self.slack
    }

    /// What the depths of a face are off by at most, which has these slopes along rows and columns, a range and an area.
    #[inline(always)]
    pub(super) fn depth_bound(&self, b: f32, slopes: [f32; 2], range: f32, area: f32) -> f32 {
        let by_units = 0.501 * self.unit * (slopes[0].abs() + slopes[1].abs());
        1.4 * by_units + 4.0 * rounding_of_edges(b) * range / area
    }
}

/// What rounding moves edge functions by at most: see the head of this file.
#[inline(always)]
fn rounding_of_edges(b: f32) -> f32 {
    let side = b + 1.0;
    17.0 * HALF_EPSILON * side * (side + 3.5)
}

/// Four times the rounding of a number of 32 bits, as a share of it: what stored depths are off by, and more.
pub(super) const DIGITS: f32 = 2.0 * f32::EPSILON;

/// The rounding of a number of 32 bits, as a share of it: 2^-24.
pub(super) const HALF_EPSILON: f32 = 0.5 * f32::EPSILON;

/// 0, 1, 2, ..
#[inline(always)]
pub(super) fn first_lanes<V: Simd>(_: V) -> V::f32s {
    const LANES: Eight<f32> = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    // A partial load would take a jump.
    V::as_simd_f32s(&LANES).0[0]
}

impl Octet {
    /// Of eight faces.
    #[inline(always)]
    pub(super) fn gather<V: Simd>(simd: V, records: &[Record], faces: [[u32; 3]; EIGHT]) -> Self {
        let mut corners = [[[0; EIGHT]; 4]; 3];
        for i in 0..3 {
            let mut eight = [Record::default(); EIGHT];
            for k in 0..EIGHT {
                eight[k] = records[faces[k][i] as usize];
            }
            corners[i] = transpose(simd, eight);
        }
        let [p, q, r] = corners;
        let to_i32 = |bits: Eight<u32>| bits.map(|bits| bits as i32);
        let to_f32 = |bits: Eight<u32>| bits.map(f32::from_bits);
        Self {
            x: [to_i32(p[0]), to_i32(q[0]), to_i32(r[0])],
            y: [to_i32(p[1]), to_i32(q[1]), to_i32(r[1])],
            depth: [to_f32(p[2]), to_f32(q[2]), to_f32(r[2])],
            w: [to_f32(p[3]), to_f32(q[3]), to_f32(r[3])],
        }
    }
}

/// Transposes eight records: the c-th array has the c-th number of each, in their order.
#[inline(always)]
fn transpose<V: Simd>(simd: V, records: Eight<Record>) -> [Eight<u32>; 4] {
    let mut columns = [[0; EIGHT]; 4];
    if const { V::F32_LANES == EIGHT } {
        // Loaded whole and transposed in registers: a third of the instructions. The vectors that are dispatched to take
        // rows in this order, which pulp does not promise: a test holds it.
        const ORDER: [usize; EIGHT] = [0, 2, 4, 6, 1, 3, 5, 7];
        let mut rows = [[0; 4]; EIGHT];
        for k in 0..EIGHT {
            rows[ORDER[k]] = records[k].0;
        }
        let rows = V::as_simd_u32s(rows.as_flattened()).0;
        let mut vectors = [simd.splat_f32s(0.0); 4];
        for c in 0..4 {
            vectors[c] = simd.transmute_f32s_u32s(rows[c]);
        }
        let vectors = simd.deinterleave_shfl_f32s(vectors);
        for c in 0..4 {
            V::as_mut_simd_u32s(&mut columns[c]).0[0] = simd.transmute_u32s_f32s(vectors[c]);
        }
    } else {
        for k in 0..EIGHT {
            let row = records[k].0;
            for c in 0..4 {
                columns[c][k] = row[c];
            }
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::super::blocks::SmallFaces;
    use super::super::corner::{ClipVertices, Scaling};
    use super::super::vertices::{Measures, record};
    use super::*;
    use crate::dispatch::dispatch_256;

    /// How far a face's edge functions, area and depths lie from those in wide numbers, as shares of the bounds.
    #[derive(Debug, Default, Clone, Copy)]
    struct Errors {
        edge: f64,
        area: f64,
        depth: f64,
        /// Of faces that are drawn by their stored depths, as a share of what `blocks` relies on.
        drawn_depth: f64,
    }

    impl Errors {
        fn largest(self, other: Self) -> Self {
            Self {
                edge: self.edge.max(other.edge),
                area: self.area.max(other.area),
                depth: self.depth.max(other.depth),
                drawn_depth: self.drawn_depth.max(other.drawn_depth),
            }
        }
    }

    /// Of a face with vertices at pixel coordinates, with depths, in an image of `extent` x `extent` pixels. `others`
    /// are depths of other vertices.
    fn errors(pixels: [[f64; 2]; 3], depths: [f64; 3], others: [f64; 2], extent: usize) -> Errors {
        let size = Size::square(extent);
        let to_clip = |pixel: f64| (2.0 * pixel + 1.0) / extent as f64 - 1.0;
        let vertex = |[x, y]: [f64; 2], depth: f64| [to_clip(x), -to_clip(y), depth, 1.0];
        let clip: Vec<_> = (pixels.into_iter().zip(depths))
            .chain(others.map(|depth| ([0.0; 2], depth)))
            .map(|(pixel, depth)| vertex(pixel, depth))
            .collect();
        let corners = ClipVertices::new(clip.as_flattened(), size, Scaling::Own);
        let filter = Filter::new(Measures::from_sample(&corners).depths, size);
        let extreme = filter.with_depths_of(&other_depths(filter, 2.0, 1.0)).unwrap();
        errors_of(filter, &corners, pixels, depths)
            .largest(errors_of(extreme, &corners, pixels, depths))
    }

    /// One that stores depths so many times as finely, with the middle moved by a share of half the range.
    fn other_depths(filter: Filter, ratio: f64, shift: f64) -> Filter {
        let half = 1.0 / (RESOLUTION * filter.per_depth);
        let middle = filter.middle + shift * half;
        Filter { middle, per_depth: ratio * filter.per_depth, ..filter }
    }

    struct Transpose(Eight<Record>);

    impl pulp::WithSimd for Transpose {
        type Output = [Eight<u32>; 4];

        #[inline(always)]
        fn with_simd<V: Simd>(self, simd: V) -> Self::Output {
            transpose(simd, self.0)
        }
    }

    #[test]
    fn records_keep_their_order_and_all_bits_in_vectors_of_any_length() {
        // Read as f32 they are an infinity and signalling NaN, whose bits arithmetic would not keep.
        let bits = |k: usize, c: usize| (0xff80_0000_u32).wrapping_add((4 * k + c) as u32);
        let records = std::array::from_fn(|k| Record(std::array::from_fn(|c| bits(k, c))));
        let expected: [Eight<u32>; 4] =
            std::array::from_fn(|c| std::array::from_fn(|k| bits(k, c)));
        assert_eq!(dispatch_256::<f32, _>(Transpose(records)), expected);
        assert_eq!(pulp::Scalar.vectorize(Transpose(records)), expected);
        assert_eq!(pulp::Arch::new().dispatch(Transpose(records)), expected);
    }

    #[test]
    fn depths_are_stored_as_a_sample_tells_within_bounds() {
        let depths = Depths { least: 0.25, largest: 0.75, largest_z: 1.0 };
        let filter = Filter::new(depths, Size::square(16));
        for (ratio, shift, is_near) in [
            (0.5, 0.99, true),
            (2.0, -0.99, true),
            (0.49, 0.0, false),
            (2.01, 0.0, false),
            (1.0, 1.01, false),
            (1.0, -1.01, false),
        ] {
            let some = Filter { is_flat: true, ..other_depths(filter, ratio, shift) };
            let taken = filter.with_depths_of(&some);
            assert_eq!(taken.is_some(), is_near, "{ratio}, {shift}");
            if let Some(Filter { is_flat, middle, per_depth, .. }) = taken {
                assert_eq!((is_flat, middle, per_depth), (false, some.middle, some.per_depth));
            }
        }
    }

    /// [`errors`] of a filter, where the first three vertices have these pixel coordinates and depths.
    fn errors_of(
        filter: Filter,
        corners: &ClipVertices<'_, f64>,
        pixels: [[f64; 2]; 3],
        depths: [f64; 3],
    ) -> Errors {
        let (size, extent) = (corners.size, corners.size.width);
        let mut records = [Record::default(); 5];
        record(corners, &filter, 0, &mut records);
        let octet = Octet::gather(pulp::Scalar, &records, [[0, 1, 2]; EIGHT]);
        let boxes = filter.boxes(&octet, size, Sampling::Center);
        let small = SmallFaces::new(&filter, &octet, size, [0, extent - 1]);
        let cross = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| ay * bx - ax * by;
        let less = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
        let [p, q, r] = pixels;
        let area = cross(less(q, p), less(r, p));
        let mut errors = Errors::default();
        // In single precision, as in `boxes`.
        let unit = f64::from(filter.unit);
        let units = |i: usize, axis: usize| f64::from([&octet.x, &octet.y][axis][i][0]);
        let edge = |i: usize| [0, 1].map(|axis| (units(i, axis) - units(0, axis)) as f32);
        let ([ax, ay], [bx, by]) = (edge(1), edge(2));
        let bound = f64::from(filter.area_bound([ax, ay], [bx, by]) - filter.slack_in_units);
        errors.area = (f64::from(ay * bx - ax * by) - area / (unit * unit)).abs() / bound;
        if boxes.orientations[0] == 0 {
            return errors;
        }
        let sign = f64::from(boxes.orientations[0]);
        let sides = [0, 1].map(|axis| {
            let [a, b, c] = [p[axis], q[axis], r[axis]];
            a.max(b).max(c) - a.min(b).min(c)
        });
        let bound = f64::from(filter.edge_bound(sides[0].max(sides[1]) as f32));
        let [start, right, down] =
            [[0, 0], [1, 0], [0, 1]].map(|place| small.values_at(0, place)[3]);
        let [a, b, c] = octet.depth.map(|depths| depths[0]);
        let depth_bound = f64::from(filter.depth_bound(
            sides[0].max(sides[1]) as f32,
            [right - start, down - start],
            (b - a).abs().max((c - a).abs()),
            area.abs() as f32,
        ));
        let [columns, rows] = [&boxes.columns, &boxes.rows].map(|[first, last]| first[0]..=last[0]);
        for row in rows.clone() {
            for column in columns.clone() {
                let at = [f64::from(column), f64::from(row)];
                let [a, b, c, depth] =
                    small.values_at(0, [column - columns.start(), row - rows.start()]);
                let [p, q, r] = [p, q, r].map(|vertex| less(vertex, at));
                let wide = [cross(q, r), cross(r, p), cross(p, q)].map(|edge| sign * edge);
                for (wide, single) in wide.into_iter().zip([a, b, c]) {
                    // Slack has another purpose.
                    let share = 1.0 - f64::from(filter.slack) / bound;
                    errors.edge = errors.edge.max((wide / bound - f64::from(single)).abs() / share);
                }
                if small.is_small(0) && wide.iter().all(|edge| *edge > -bound) {
                    let wide = (0..3).map(|i| wide[i] / (sign * area) * depths[i]).sum::<f64>();
                    let off = (wide - filter.middle) * filter.per_depth - f64::from(depth);
                    errors.drawn_depth = errors.drawn_depth.max(2.0 * off.abs());
                    // Of the largest depth the rounding is less than what `blocks` leaves.
                    errors.depth = errors.depth.max((off.abs() - 0.02).max(0.0) / depth_bound);
                }
            }
        }
        errors
    }

    /// Numbers in [0, 1), the same for all runs.
    fn draws() -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    /// The largest errors of faces whose vertices lie where rounding to units does most, in images of several sizes: of
    /// sides up to `most` pixels, with depths at both ends of the range, or all alike.
    fn worst_of_units(extents: &[usize], most: f64, is_steep: bool) -> Errors {
        let (mut worst, mut draw) = (Errors::default(), draws());
        for &extent in extents {
            let unit = extent as f64 / f64::from(1 << 30);
            for _ in 0..400 {
                let side = (extent as f64 / 2.0 - 10.0).min(most) * draw().powi(3) + 0.3;
                let origin = [0; 2].map(|_| draw() * (extent as f64 - side - 3.0));
                let corners: [[f64; 2]; 3] = [[0; 2]; 3].map(|_| {
                    [0, 1].map(|axis: usize| {
                        ((origin[axis] + side * draw().round()) / unit).floor() * unit
                    })
                });
                let depths =
                    [0; 3].map(|_| if is_steep { 1.8 * draw().round() - 0.9 } else { 0.0 });
                for halves in 0..64_u32 {
                    let half = |bit: usize| if halves >> bit & 1 == 1 { 0.499 } else { -0.499 };
                    let moved = std::array::from_fn(|i| {
                        std::array::from_fn(|axis| corners[i][axis] + half(2 * i + axis) * unit)
                    });
                    worst = worst.largest(errors(moved, depths, [-0.9, 0.9], extent));
                }
            }
        }
        worst
    }

    /// Those of faces as large as can be in an image whose units are fine, so that numbers of 32 bits round most.
    fn worst_of_rounding() -> Errors {
        let (mut worst, mut draw) = (Errors::default(), draws());
        for _ in 0..6000 {
            let [x, y] = [0; 2].map(|_| 30.0 * draw());
            let moved = [0; 3].map(|_| [x + 30.0 * draw(), y + 30.0 * draw()]);
            worst = worst.largest(errors(moved, [0.0; 3], [-0.9, 0.9], 64));
        }
        worst
    }

    /// Those of slivers whose depths are as steep as can be.
    fn worst_of_slivers() -> Errors {
        let (mut worst, mut draw) = (Errors::default(), draws());
        for _ in 0..20000 {
            let [x, y] = [0; 2].map(|_| 20.0 * draw());
            let (along, off) = (draw(), f64::powf(10.0, -5.0 * draw()));
            let place = |x: f64, y: f64| [500.0 + x, 500.0 + y];
            let third = place(along * x - off * y, along * y + off * x);
            let depths = [0; 3].map(|_| 1.8 * draw().round() - 0.9);
            let face = [place(0.0, 0.0), place(x, y), third];
            worst = worst.largest(errors(face, depths, [-0.9, 0.9], 1024));
        }
        worst
    }

    #[test]
    fn bounds_hold_and_a_quarter_of_them_does_not() {
        let worst = [
            worst_of_units(&[64, 1024, 16384], 30.0, false),
            worst_of_rounding(),
            worst_of_units(&[1 << 16], 12.0, true),
            worst_of_slivers(),
        ];
        for errors in worst {
            let shares = [errors.edge, errors.area, errors.depth, errors.drawn_depth];
            assert!(shares.iter().all(|&share| share < 1.0), "{worst:?}");
        }
        let [units, rounding, steep, _] = worst;
        let shares = [units.edge, units.area, rounding.edge, steep.depth];
        assert!(shares.iter().all(|&share| share > 0.25), "{worst:?}");
    }
}
