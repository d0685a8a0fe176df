//! Convex polygons within a pixel: cut by lines, their areas, and the adjoint of integrals over them.
//!
//! Coordinates are scaled coordinates relative to the pixel's centre: the pixel is `[-1, 1]^2`, of
//! area 4. A line is `l(x, y) = l_0 + l_1 x + l_2 y`. The side of the line where l is positive is its
//! inside.
//!
//! # Adjoint
//! Let a side of a polygon P lie on a line, with P on its inside. A change dl of the line moves the side outwards
//! by `dl(x, y) / |(l_1, l_2)|`. Let g(x, y) be the gradient of the loss per unit of area gained at
//! (x, y). The side then adds `l_bar += int g (1, x, y) ds / |(l_1, l_2)|`. The sign is the opposite
//! where P lies outside the line. Corners move, too, but only what moves across a side changes an
//! integral: where a corner came from does not matter. Along a side from p to q (1, x, y) is
//! `(1 - u) (1, p) + u (1, q)` at the share u. So the integrals of `(1 - u) g` and of `u g` du are enough.

use std::num::NonZeroU32;
use std::ops::Range;

use bokashi_core::Scalar;

/// Coefficients of 1, x and y.
pub(super) type Line<S> = [S; 3];

/// Stands for the border of the pixel or cell, which does not move.
pub(super) const BORDER: u32 = u32::MAX;

/// What a side of a polygon lies on: the index of its line, or [`BORDER`], and whether the polygon is on the
/// line's inside. In one number, since a load waits for all stores that it spans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bound(u64);

impl Bound {
    /// That of a polygon that was not cut.
    const UNCUT: Self = Self::new(BORDER, true);

    const fn new(line: u32, is_inside: bool) -> Self {
        Self((line as u64) << 1 | is_inside as u64)
    }

    #[inline(always)]
    pub(super) fn line(self) -> u32 {
        (self.0 >> 1) as u32
    }

    #[inline(always)]
    pub(super) fn is_inside(self) -> bool {
        self.0 & 1 == 1
    }
}

/// A corner of a polygon, and what the side from it to the next corner lies on.
#[derive(Debug, Clone, Copy)]
struct Corner<S> {
    point: [S; 2],
    bound: Bound,
}

/// A convex polygon of [`Polygons`], counter-clockwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Polygon {
    first: u32,
    /// Not 0, so that a polygon that may be missing fits into a register, too.
    count: NonZeroU32,
}

/// Convex polygons, the corners of all of them side by side: they are cut often and never change.
#[derive(Debug, Default)]
pub(super) struct Polygons<S> {
    /// Memory beyond `len` is for more of them: to append them one by one is slow.
    corners: Vec<Corner<S>>,
    /// How many corners all polygons have.
    len: usize,
    /// A line's values at a polygon's corners, and memory for more.
    values: Vec<S>,
}

/// A triangle of a polygon's fan around its first corner, from which the other corners p and q are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle<S> {
    pub(super) p: [S; 2],
    pub(super) q: [S; 2],
    /// Twice its area, which is 0 where rounding would make it negative.
    pub(super) twice: S,
}

/// How a polygon lies to a line.
#[derive(Debug, Clone, Copy)]
struct Position {
    /// Whether some of it lies on the inside, and some on the outside, by more than rounding.
    reaches: [bool; 2],
    /// The corners on the inside or on the line, and those on the outside or on the line: a bit for each of the first 64.
    corners: [u64; 2],
}

/// The corners of a polygon that lie on one side of a line or on the line: in turn from the first to the last one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    first: usize,
    last: usize,
}

impl Run {
    /// The run of corners, of `count`, whose bits are set: some are, and some are not. `None` where they are several runs,
    /// by rounding, or where there are more than 64 corners.
    #[inline(always)]
    fn find(bits: u64, count: usize) -> Option<Self> {
        if count > u64::BITS as usize {
            return None;
        }
        // The corner before the first one of a run is of none, and so is the corner after its last one.
        let firsts = bits & !(bits << 1 | bits >> (count - 1));
        let lasts = bits & !(bits >> 1 | (bits & 1) << (count - 1));
        let is_one = firsts != 0 && firsts & (firsts - 1) == 0;
        let [first, last] = [firsts, lasts].map(|bit| bit.trailing_zeros() as usize);
        is_one.then_some(Self { first, last })
    }
}

#[inline(always)]
pub(super) fn value_at<S: Scalar>(line: Line<S>, [x, y]: [S; 2]) -> S {
    line[0] + line[1] * x + line[2] * y
}

/// The largest size of a line's values in the pixel.
#[inline(always)]
pub(super) fn size<S: Scalar>([one, x, y]: Line<S>) -> S {
    one.abs() + x.abs() + y.abs()
}

impl<S: Scalar> Polygons<S> {
    /// Forgets all polygons.
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Where a polygon's corners are.
    #[inline(always)]
    fn range(&self, Polygon { first, count }: Polygon) -> Range<usize> {
        let first = first as usize;
        let end = first + count.get() as usize;
        debug_assert!(end <= self.len, "this polygon has been forgotten");
        first..end
    }

    /// Makes room for so many more corners.
    #[inline(always)]
    fn reserve(&mut self, corners: usize) {
        let least = self.len + corners;
        if least > self.corners.len() {
            self.grow(2 * least);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, corners: usize) {
        self.corners.resize(corners, Corner { point: [S::ZERO; 2], bound: Bound::UNCUT });
        self.values.resize(corners, S::ZERO);
    }

    /// A rectangle, from its least to its largest x and y.
    pub(super) fn rectangle(&mut self, low: [S; 2], high: [S; 2]) -> Polygon {
        self.uncut([low, [high[0], low[1]], high, [low[0], high[1]]])
    }

    /// A polygon without an extent.
    pub(super) fn point(&mut self, point: [S; 2]) -> Polygon {
        self.uncut([point; 3])
    }

    /// The polygon of these corners, which do not move.
    fn uncut<const N: usize>(&mut self, points: [[S; 2]; N]) -> Polygon {
        self.add(points.into_iter().map(|point| Corner { point, bound: Bound::UNCUT }))
    }

    /// The polygon of these corners.
    fn add(&mut self, corners: impl ExactSizeIterator<Item = Corner<S>>) -> Polygon {
        self.reserve(corners.len());
        let first = self.len as u32;
        let count = NonZeroU32::new(corners.len() as u32).expect("a polygon has corners");
        for corner in corners {
            self.corners[self.len] = corner;
            self.len += 1;
        }
        Polygon { first, count }
    }

    /// The same as a polygon of others, whose lines have other names here.
    pub(super) fn copy_of(
        &mut self,
        others: &Self,
        polygon: Polygon,
        mut name: impl FnMut(u32) -> u32,
    ) -> Polygon {
        self.add(others.corners(polygon).iter().map(|&Corner { point, bound }| {
            let line = if bound.line() == BORDER { BORDER } else { name(bound.line()) };
            Corner { point, bound: Bound::new(line, bound.is_inside()) }
        }))
    }

    /// How many corners all polygons have.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The parts of a polygon on the inside and on the outside of a line, where there are any. Where
    /// nothing lies on the other side by more than rounding, a part is the whole polygon: a corner
    /// that was cut by this line lies on neither side.
    #[inline(always)]
    pub(super) fn split(
        &mut self,
        polygon: Polygon,
        line: Line<S>,
        index: u32,
    ) -> [Option<Polygon>; 2] {
        let position = self.position(polygon, line);
        match position.reaches {
            [true, true] => {
                let inside = self.part(polygon, position, Bound::new(index, true));
                let outside = self.part(polygon, position, Bound::new(index, false));
                [inside, outside]
            }
            [true, false] => [Some(polygon), None],
            [false, true] => [None, Some(polygon)],
            [false, false] => [None, None],
        }
    }

    /// The part on the inside of a line alone.
    #[inline(always)]
    pub(super) fn inside(
        &mut self,
        polygon: Polygon,
        line: Line<S>,
        index: u32,
    ) -> Option<Polygon> {
        let position = self.position(polygon, line);
        match position.reaches {
            [true, true] => self.part(polygon, position, Bound::new(index, true)),
            [is_inside, _] => is_inside.then_some(polygon),
        }
    }

    /// The part on the outside of a line, and whether there is one on the inside.
    #[inline(always)]
    pub(super) fn outside(
        &mut self,
        polygon: Polygon,
        line: Line<S>,
        index: u32,
    ) -> (bool, Option<Polygon>) {
        let position = self.position(polygon, line);
        match position.reaches {
            [true, true] => (true, self.part(polygon, position, Bound::new(index, false))),
            [is_inside, is_outside] => (is_inside, is_outside.then_some(polygon)),
        }
    }

    /// Whether some of a polygon lies on the inside of a line, and some on the outside, by more than
    /// rounding.
    #[inline(always)]
    pub(super) fn lies(&mut self, polygon: Polygon, line: Line<S>) -> [bool; 2] {
        self.position(polygon, line).reaches
    }

    /// How a polygon lies to a line. Leaves the line's values at the corners.
    #[inline(always)]
    fn position(&mut self, polygon: Polygon, line: Line<S>) -> Position {
        let corners = &self.corners[self.range(polygon)];
        // A NaN is neither less nor more, so it lies on no side.
        let (mut least, mut most) = (S::ZERO, S::ZERO);
        let (mut inside, mut outside) = (0, 0);
        for (corner, found) in corners.iter().zip(&mut self.values).rev() {
            let value = value_at(line, corner.point);
            *found = value;
            least = if value < least { value } else { least };
            most = if value > most { value } else { most };
            inside = inside << 1 | u64::from(value >= S::ZERO);
            outside = outside << 1 | u64::from(value <= S::ZERO);
        }
        // Corners lie in the pixel, where no term of the value is larger than the line's size.
        let error_bound = S::from_f64(16.0 * f64::EPSILON) * size(line);
        let reaches = [most > error_bound, least < -error_bound];
        Position { reaches, corners: [inside, outside] }
    }

    /// The part of a polygon on one side of the line whose values were found; what is cut off leaves
    /// the side `cut`. It begins with the first corner that stays.
    ///
    /// ```text
    ///      first +-----+ last      The corners on this side follow each other, for a polygon is convex. Before
    ///           /       \          them comes a crossing, from which the rest of the old side goes on. After
    ///      ----x---------x----     them comes another one, where `cut` begins. A corner on the line itself is
    ///         /           \        its own crossing.
    ///  before +           + next
    /// ```
    #[inline(always)]
    fn part(&mut self, polygon: Polygon, position: Position, cut: Bound) -> Option<Polygon> {
        let range = self.range(polygon);
        let count = range.len();
        // A corner on the line is both here and beyond.
        let [inside, outside] = position.corners;
        let (here, beyond) = if cut.is_inside() { (inside, outside) } else { (outside, inside) };
        let Some(Run { first, last }) = Run::find(here, count) else {
            return self.part_of_several_runs(polygon, cut);
        };
        // One corner at least is cut off.
        self.reserve(count + 1);
        let (corners, new) = self.corners.split_at_mut(self.len);
        let (corners, values) = (&corners[range], &self.values[..count]);
        let after = |index: usize| if index + 1 < count { index + 1 } else { 0 };
        let (before, next) = (if first > 0 { first } else { count } - 1, after(last));
        let is_beyond = |index: usize| beyond >> index & 1 == 1;
        let mut total = 0;
        let mut add = |corner: Corner<S>| {
            new[total] = corner;
            total += 1;
        };
        let mut index = first;
        while index != last {
            add(corners[index]);
            index = after(index);
        }
        let crossing = |from: usize, to: usize| {
            let (p, q) = (corners[from].point, corners[to].point);
            let share = values[from] / (values[from] - values[to]);
            [p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])]
        };
        // Where it lies on the line, the last corner is its own crossing.
        let Corner { point, bound } = corners[last];
        let leaves = !is_beyond(last) & is_beyond(next);
        add(Corner { point, bound: if leaves { bound } else { cut } });
        if leaves {
            add(Corner { point: crossing(last, next), bound: cut });
        }
        if is_beyond(before) & !is_beyond(first) {
            add(Corner { point: crossing(before, first), bound: corners[before].bound });
        }
        self.end_part(total)
    }

    /// [`Self::part`] of any corners, one after another.
    #[cold]
    #[inline(never)]
    fn part_of_several_runs(&mut self, polygon: Polygon, cut: Bound) -> Option<Polygon> {
        let range = self.range(polygon);
        let count = range.len();
        // A corner is followed by one crossing at most.
        self.reserve(2 * count);
        let (corners, new) = self.corners.split_at_mut(self.len);
        let (corners, values) = (&corners[range], &self.values[..count]);
        let sign = if cut.is_inside() { S::ONE } else { -S::ONE };
        let mut total = 0;
        let mut add = |point: [S; 2], bound: Bound| {
            new[total] = Corner { point, bound };
            total += 1;
        };
        // Around the polygon, with a and b the distances of corner k and of the next one from the line, up to a
        // factor. A side keeps its bound where its part stays; where the part leaves over the line, `cut`
        // begins.
        //      a > 0, b < 0: corner k, and the crossing, at which `cut` begins
        //      a < 0, b > 0: the crossing, from which the rest of the old side goes on
        //      a = 0, b < 0: corner k lies on the line, and `cut` begins there
        for k in 0..count {
            let next = if k + 1 < count { k + 1 } else { 0 };
            let (a, b) = (sign * values[k], sign * values[next]);
            let Corner { point: p, bound } = corners[k];
            if a >= S::ZERO {
                add(p, if b >= S::ZERO || a > S::ZERO { bound } else { cut });
            }
            if (a > S::ZERO && b < S::ZERO) || (a < S::ZERO && b > S::ZERO) {
                let (share, q) = (a / (a - b), corners[next].point);
                let point = [p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])];
                add(point, if a > S::ZERO { cut } else { bound });
            }
        }
        self.end_part(total)
    }

    /// The polygon of so many corners, which were written behind all others; none of fewer than three.
    #[inline(always)]
    fn end_part(&mut self, corners: usize) -> Option<Polygon> {
        let first = self.len as u32;
        self.len += corners;
        let count = NonZeroU32::new(corners as u32).filter(|count| count.get() > 2)?;
        Some(Polygon { first, count })
    }

    #[inline(always)]
    fn corners(&self, polygon: Polygon) -> &[Corner<S>] {
        &self.corners[self.range(polygon)]
    }

    /// The corners.
    pub(super) fn points(&self, polygon: Polygon) -> impl Iterator<Item = [S; 2]> + Clone + '_ {
        self.corners(polygon).iter().map(|corner| corner.point)
    }

    /// The sides with their ends.
    #[inline(always)]
    pub(super) fn segments(
        &self,
        polygon: Polygon,
    ) -> impl Iterator<Item = (Bound, [[S; 2]; 2])> + '_ {
        let corners = self.corners(polygon);
        corners.iter().enumerate().map(move |(index, &Corner { point, bound })| {
            let next = if index + 1 < corners.len() { index + 1 } else { 0 };
            (bound, [point, corners[next].point])
        })
    }

    /// The first corner, and the triangles around it.
    #[inline(always)]
    pub(super) fn fan(
        &self,
        polygon: Polygon,
    ) -> ([S; 2], impl Iterator<Item = Triangle<S>> + Clone) {
        let corners = self.corners(polygon);
        // Relative to a corner: far from the centre the products of a small polygon would cancel.
        let first = corners[0].point;
        let from_first = move |[x, y]: [S; 2]| [x - first[0], y - first[1]];
        let mut p = from_first(corners[1].point);
        let triangles = corners[2..].iter().map(move |corner| {
            let q = from_first(corner.point);
            let cross = p[0] * q[1] - p[1] * q[0];
            let twice = if cross > S::ZERO { cross } else { S::ZERO };
            Triangle { p: std::mem::replace(&mut p, q), q, twice }
        });
        (first, triangles)
    }

    #[inline(always)]
    pub(super) fn area(&self, polygon: Polygon) -> S {
        let (_, triangles) = self.fan(polygon);
        S::from_f64(0.5) * triangles.map(|triangle| triangle.twice).sum()
    }
}

/// What a side from p to q adds to the gradient of its line, of normal `normal`, from the integrals of
/// `(1 - u) g` and of `u g` along it. It counts `share` times, negative where its polygon is on the
/// line's outside.
#[inline(always)]
pub(super) fn line_bar<S: Scalar>(
    [p, q]: [[S; 2]; 2],
    share: f64,
    [normal_x, normal_y]: [S; 2],
    integrals: [S; 2],
) -> Line<S> {
    // Near 1, since squares of what belongs to vertices far away may leave the range of the numbers.
    let largest = normal_x.abs().maximum_or_nan(normal_y.abs());
    let (normal_x, normal_y) = (normal_x / largest, normal_y / largest);
    // The side's length over that of the normal, at a right angle to it: no root is needed.
    let across = ((q[0] - p[0]) * normal_y - (q[1] - p[1]) * normal_x).abs();
    let scale = S::from_f64(share) * across / (normal_x * normal_x + normal_y * normal_y) / largest;
    let [of_p, of_q] = integrals.map(|integral| scale * integral);
    [of_p + of_q, of_p * p[0] + of_q * q[0], of_p * p[1] + of_q * q[1]]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn line() -> impl Strategy<Value = Line<f64>> {
        (-1.2..1.2, 0.0..std::f64::consts::TAU, 0.1..10.0).prop_map(|(offset, angle, scale)| {
            let (sin, cos): (f64, f64) = f64::sin_cos(angle);
            [offset, cos, sin].map(|number| scale * number)
        })
    }

    /// The pixel, on the inside of some lines and on the outside of others.
    fn cut(polygons: &mut Polygons<f64>, lines: &[Line<f64>], sides: &[bool]) -> Option<Polygon> {
        let mut polygon = polygons.rectangle([-1.0; 2], [1.0; 2]);
        for (k, (&line, &is_inside)) in (0..).zip(lines.iter().zip(sides)) {
            let [inside, outside] = polygons.split(polygon, line, k);
            polygon = if is_inside { inside? } else { outside? };
        }
        Some(polygon)
    }

    proptest! {
        #[test]
        fn the_parts_of_a_polygon_measure_as_much_as_it_does(
            lines in proptest::collection::vec(line(), 1..6),
            sides: [bool; 5],
            last in line(),
        ) {
            let mut polygons = Polygons::default();
            let Some(whole) = cut(&mut polygons, &lines, &sides) else { return Ok(()) };
            let parts = polygons.split(whole, last, 9);
            let inside = polygons.inside(whole, last, 9);
            let area = |part: Option<Polygon>| part.map(|p| polygons.area(p));
            prop_assert_eq!(area(inside), area(parts[0]));
            let sum: f64 = parts.into_iter().filter_map(area).sum();
            prop_assert!((sum - polygons.area(whole)).abs() < 1e-14);
        }
    }

    proptest! {
        #[test]
        fn corners_on_one_side_are_one_run(
            count in 3..=64_usize,
            start in 0..64_usize,
            length in 1..64_usize,
        ) {
            let (first, kept) = (start % count, 1 + length % (count - 1));
            let is_kept = |k: &usize| (k + count - first) % count < kept;
            let bits = (0..count).filter(is_kept).map(|k| 1 << k).sum();
            let last = (first + kept - 1) % count;
            prop_assert_eq!(Run::find(bits, count), Some(Run { first, last }));
        }

        /// Corners in any order, some on the line, with which rounding may have made several runs.
        #[test]
        fn a_run_of_corners_is_cut_as_corners_one_by_one(
            corners in proptest::collection::vec(([-1.0..1.0, -1.0..1.0], -3..4_i8), 3..8),
            is_inside: bool,
        ) {
            let mut polygons = Polygons::default();
            let polygon = polygons.add(corners.iter().zip(0..100).map(|(&(point, _), k)| {
                Corner { point, bound: Bound::new(k, k % 2 == 0) }
            }));
            let bits = |sign: i8| {
                (0..).zip(&corners).map(|(k, (_, given))| u64::from(sign * given >= 0) << k).sum()
            };
            let position = Position { reaches: [true; 2], corners: [bits(1), bits(-1)] };
            for (value, (_, given)) in polygons.values.iter_mut().zip(&corners) {
                *value = 0.3 * f64::from(*given);
            }
            let cut = Bound::new(99, is_inside);
            // Either may begin with any corner.
            let list = |polygons: &Polygons<f64>, part: Option<Polygon>| {
                part.map(|part| {
                    let mut list: Vec<_> =
                        polygons.corners(part).iter().map(|corner| format!("{corner:?}")).collect();
                    let least = (0..list.len()).min_by_key(|&k| &list[k]);
                    list.rotate_left(least.expect("it has corners"));
                    list
                })
            };
            let expected = polygons.part_of_several_runs(polygon, cut);
            let expected = list(&polygons, expected);
            let found = polygons.part(polygon, position, cut);
            let sign = if is_inside { 1 } else { -1 };
            // Only where some are clearly on either side a part is asked for.
            let has = |side: i8| corners.iter().any(|(_, given)| sign * given * side > 0);
            if has(1) && has(-1) {
                prop_assert_eq!(list(&polygons, found), expected);
            }
        }
    }

    proptest! {
        #[test]
        fn a_position_tells_the_corners_on_each_side(
            points in proptest::collection::vec([-1.0..1.0, -1.0..1.0], 3..70),
            line in line(),
            through in proptest::option::of(0..70_usize),
        ) {
            // Perhaps one through a corner, exactly.
            let x_of = |k: usize| -> f64 { points[k % points.len()][0] };
            let line = through.map_or(line, |k| [-x_of(k), 1.0, 0.0]);
            let mut polygons = Polygons::default();
            let polygon = polygons.add(points.iter().map(|&point| Corner { point, bound: Bound::UNCUT }));
            let Position { reaches, corners: [inside, outside] } = polygons.position(polygon, line);
            let values: Vec<_> = points.iter().map(|&point| value_at(line, point)).collect();
            prop_assert_eq!(&polygons.values[..values.len()], &values[..]);
            for (k, &value) in values.iter().enumerate().take(u64::BITS as usize) {
                prop_assert_eq!(inside >> k & 1 == 1, value >= 0.0);
                prop_assert_eq!(outside >> k & 1 == 1, value <= 0.0);
            }
            let bound = 16.0 * f64::EPSILON * size(line);
            let expected = [values.iter().any(|&value| value > bound), values.iter().any(|&value| value < -bound)];
            prop_assert_eq!(reaches, expected);
        }
    }

    #[test]
    fn what_is_no_number_lies_on_no_side() {
        let mut polygons = Polygons::<f64>::default();
        let pixel = polygons.rectangle([-1.0; 2], [1.0; 2]);
        let Position { reaches, corners } = polygons.position(pixel, [f64::NAN, 1.0, 0.0]);
        assert_eq!((reaches, corners), ([false; 2], [0; 2]));
    }

    #[test]
    fn runs_that_rounding_parts_are_not_one_nor_are_many_corners() {
        assert_eq!(Run::find(1, 64), Some(Run { first: 0, last: 0 }));
        assert_eq!(Run::find(1, 65), None);
        // Of a few corners in turn the third lies on the other side by rounding.
        assert_eq!(Run::find(0b01010, 5), None);
        assert_eq!(Run::find(0b01110, 5), Some(Run { first: 1, last: 3 }));
    }

    #[test]
    fn the_adjoint_goes_with_1_over_the_size_of_the_line() {
        let bar = |size: f64| {
            let normal = [0.6 * size, 0.8 * size];
            line_bar([[0.8, -0.6], [-0.8, 0.6]], 1.0, normal, [0.5; 2]).map(|bar| bar * size)
        };
        for power in [-200, -160, 160, 200] {
            let (found, expected) = (bar(f64::powi(10.0, power)), bar(1.0));
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-14, "{power}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_pixel_measures_4_and_beyond_it_is_nothing() {
        let mut polygons = Polygons::<f64>::default();
        let pixel = polygons.rectangle([-1.0; 2], [1.0; 2]);
        assert_eq!(polygons.area(pixel), 4.0);
        assert_eq!(polygons.split(pixel, [-3.0, 1.0, 0.0], 0), [None, Some(pixel)]);
    }
}
