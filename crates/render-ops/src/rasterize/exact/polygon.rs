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

use std::ops::Range;

use bokashi_core::Scalar;

/// Coefficients of 1, x and y.
pub(super) type Line<S> = [S; 3];

/// Stands for the border of the pixel or cell, which does not move.
pub(super) const BORDER: u32 = u32::MAX;

/// What a side of a polygon lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bound {
    /// The index of its line, or [`BORDER`].
    pub(super) line: u32,
    /// Whether the polygon is on the line's inside.
    pub(super) is_inside: bool,
}

/// A convex polygon of [`Polygons`], counter-clockwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Polygon {
    first: u32,
    count: u32,
}

/// Convex polygons, the corners of all of them side by side: they are cut often and never change.
#[derive(Debug, Default)]
pub(super) struct Polygons<S> {
    /// Where the corners are, and what the side from each to the next corner lies on. Memory beyond `len`
    /// is for more of them: to append them one by one is slow.
    xs: Vec<S>,
    ys: Vec<S>,
    bounds: Vec<Bound>,
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
    fn corners(&self, Polygon { first, count }: Polygon) -> Range<usize> {
        let first = first as usize;
        let end = first + count as usize;
        debug_assert!(end <= self.len, "this polygon has been forgotten");
        first..end
    }

    /// Makes room for so many more corners.
    #[inline(always)]
    fn reserve(&mut self, corners: usize) {
        let least = self.len + corners;
        if least > self.xs.len() {
            self.grow(2 * least);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, corners: usize) {
        let Self { xs, ys, bounds, values, .. } = self;
        for numbers in [xs, ys, values] {
            numbers.resize(corners, S::ZERO);
        }
        bounds.resize(corners, Bound { line: BORDER, is_inside: true });
    }

    /// A rectangle, from its least to its largest x and y.
    pub(super) fn rectangle(&mut self, low: [S; 2], high: [S; 2]) -> Polygon {
        self.still([low, [high[0], low[1]], high, [low[0], high[1]]])
    }

    /// A polygon without an extent.
    pub(super) fn point(&mut self, point: [S; 2]) -> Polygon {
        self.still([point; 3])
    }

    /// The polygon of these corners, which do not move.
    fn still<const N: usize>(&mut self, points: [[S; 2]; N]) -> Polygon {
        let bound = Bound { line: BORDER, is_inside: true };
        self.add(points.into_iter().map(|point| (point, bound)))
    }

    /// The polygon of these corners.
    fn add(&mut self, corners: impl ExactSizeIterator<Item = ([S; 2], Bound)>) -> Polygon {
        self.reserve(corners.len());
        let (first, count) = (self.len as u32, corners.len() as u32);
        for ([x, y], bound) in corners {
            (self.xs[self.len], self.ys[self.len], self.bounds[self.len]) = (x, y, bound);
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
        self.add(others.corners(polygon).map(|index| {
            let Bound { line, is_inside } = others.bounds[index];
            let line = if line == BORDER { BORDER } else { name(line) };
            ([others.xs[index], others.ys[index]], Bound { line, is_inside })
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
        match self.lies(polygon, line) {
            [true, true] => {
                let inside = self.part(polygon, Bound { line: index, is_inside: true });
                let outside = self.part(polygon, Bound { line: index, is_inside: false });
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
        match self.lies(polygon, line) {
            [true, true] => self.part(polygon, Bound { line: index, is_inside: true }),
            [is_inside, _] => is_inside.then_some(polygon),
        }
    }

    /// Whether some of a polygon lies on the outside of a line, by more than rounding.
    #[inline(always)]
    pub(super) fn has_outside(&mut self, polygon: Polygon, line: Line<S>) -> bool {
        self.lies(polygon, line)[1]
    }

    /// Whether some of a polygon lies on the inside of a line, and some on the outside, by more than
    /// rounding. Leaves the line's values at the corners.
    #[inline(always)]
    fn lies(&mut self, polygon: Polygon, line: Line<S>) -> [bool; 2] {
        let corners = self.corners(polygon);
        let (xs, ys) = (&self.xs[corners.clone()], &self.ys[corners]);
        let values = &mut self.values[..xs.len()];
        // A NaN is neither less nor more, so it lies on no side.
        let (mut least, mut most) = (S::ZERO, S::ZERO);
        for ((value, &x), &y) in values.iter_mut().zip(xs).zip(ys) {
            *value = value_at(line, [x, y]);
            least = if *value < least { *value } else { least };
            most = if *value > most { *value } else { most };
        }
        // Corners lie in the pixel, where no term of the value is larger than the line's size.
        let error_bound = S::from_f64(16.0 * f64::EPSILON) * size(line);
        [most > error_bound, least < -error_bound]
    }

    /// The part of a polygon on one side of the line whose values were found; what is cut off leaves
    /// the side `cut`.
    #[inline(always)]
    fn part(&mut self, polygon: Polygon, cut: Bound) -> Option<Polygon> {
        let corners = self.corners(polygon);
        let count = corners.len();
        // A corner is followed by one crossing at most.
        self.reserve(2 * count);
        let (xs, new_xs) = self.xs.split_at_mut(self.len);
        let (ys, new_ys) = self.ys.split_at_mut(self.len);
        let (bounds, new_bounds) = self.bounds.split_at_mut(self.len);
        let (xs, ys, bounds) = (&xs[corners.clone()], &ys[corners.clone()], &bounds[corners]);
        let values = &self.values[..count];
        let sign = if cut.is_inside { S::ONE } else { -S::ONE };
        let mut new = 0;
        let mut add = |x: S, y: S, bound: Bound| {
            (new_xs[new], new_ys[new], new_bounds[new]) = (x, y, bound);
            new += 1;
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
            if a >= S::ZERO {
                let bound = if b >= S::ZERO || a > S::ZERO { bounds[k] } else { cut };
                add(xs[k], ys[k], bound);
            }
            if (a > S::ZERO && b < S::ZERO) || (a < S::ZERO && b > S::ZERO) {
                let share = a / (a - b);
                let bound = if a > S::ZERO { cut } else { bounds[k] };
                add(xs[k] + share * (xs[next] - xs[k]), ys[k] + share * (ys[next] - ys[k]), bound);
            }
        }
        let part = Polygon { first: self.len as u32, count: new as u32 };
        self.len += new;
        (new > 2).then_some(part)
    }

    /// The corners.
    pub(super) fn points(&self, polygon: Polygon) -> impl Iterator<Item = [S; 2]> + Clone + '_ {
        let corners = self.corners(polygon);
        let (xs, ys) = (&self.xs[corners.clone()], &self.ys[corners]);
        xs.iter().zip(ys).map(|(&x, &y)| [x, y])
    }

    /// The sides with their ends.
    #[inline(always)]
    pub(super) fn segments(
        &self,
        polygon: Polygon,
    ) -> impl Iterator<Item = (Bound, [[S; 2]; 2])> + '_ {
        let Range { start, end } = self.corners(polygon);
        (start..end).map(move |index| {
            let next = if index + 1 < end { index + 1 } else { start };
            let ends = [index, next].map(|index| [self.xs[index], self.ys[index]]);
            (self.bounds[index], ends)
        })
    }

    /// The first corner, and the triangles around it.
    #[inline(always)]
    pub(super) fn fan(
        &self,
        polygon: Polygon,
    ) -> ([S; 2], impl Iterator<Item = Triangle<S>> + Clone) {
        let corners = self.corners(polygon);
        let (xs, ys) = (&self.xs[corners.clone()], &self.ys[corners]);
        // Relative to a corner: far from the centre the products of a small polygon would cancel.
        let first = [xs[0], ys[0]];
        let mut p = [xs[1] - first[0], ys[1] - first[1]];
        let triangles = xs[2..].iter().zip(&ys[2..]).map(move |(x, y)| {
            let q = [*x - first[0], *y - first[1]];
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
