//! Convex polygons within a pixel: cut by lines, measured, and the adjoint of the measure.
//!
//! Coordinates are scaled ones relative to the pixel's centre: the pixel is `[-1, 1]^2`, of area 4. A
//! line is `l(x, y) = l_0 + l_1 x + l_2 y`; the side of it where l is positive is its inside.
//!
//! # Measure
//! Of a polygon P the integrals of 1, x and y over it: area and first moments.
//!
//! # Adjoint
//! Where a side of P lies on a line whose inside P is on, a change dl of the line moves the side
//! outwards by `dl(x, y) / |(l_1, l_2)|`. With the gradients `m_bar` of the integrals of 1, x and y and
//! `g(x, y) = m_bar_0 + m_bar_1 x + m_bar_2 y` the side adds
//! `l_bar += int g (1, x, y) ds / |(l_1, l_2)|`, with the other sign where P is on the outside. Corners
//! move, too, but only what moves across a side changes an integral: where a corner came from does
//! not matter. Over a side of length s from p to q the integral of two linear functions' product is
//! `s (2 f_p g_p + f_p g_q + f_q g_p + 2 f_q g_q) / 6`.

use bokashi_core::Scalar;
use smallvec::SmallVec;

/// Coefficients of 1, x and y.
pub(super) type Line<S> = [S; 3];

/// Stands for the pixel's own border, which does not move.
pub(super) const BORDER: u32 = u32::MAX;

/// What a side of a polygon lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side {
    /// The index of its line, or [`BORDER`].
    pub(super) line: u32,
    /// Whether the polygon is on the line's inside.
    pub(super) is_inside: bool,
}

/// A convex polygon, counter-clockwise; side k leads from point k to the next one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polygon<S> {
    points: SmallVec<[[S; 2]; 8]>,
    sides: SmallVec<[Side; 8]>,
}

/// The integrals of 1, x and y.
pub(super) type Measure<S> = [S; 3];

#[inline(always)]
pub(super) fn value_at<S: Scalar>(line: Line<S>, [x, y]: [S; 2]) -> S {
    line[0] + line[1] * x + line[2] * y
}

impl<S: Scalar> Polygon<S> {
    /// The whole pixel.
    pub(super) fn pixel() -> Self {
        let (low, high) = (-S::ONE, S::ONE);
        let border = Side { line: BORDER, is_inside: true };
        Self {
            points: SmallVec::from_slice(&[[low, low], [high, low], [high, high], [low, high]]),
            sides: SmallVec::from_slice(&[border; 4]),
        }
    }

    /// Nothing.
    fn empty() -> Self {
        Self { points: SmallVec::new(), sides: SmallVec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.points.len() < 3
    }

    /// Whether some of it lies on the inside of a line, and whether some lies on the outside, by more
    /// than rounding: a corner that was cut by this line lies on neither side.
    pub(super) fn lies(&self, line: Line<S>) -> [bool; 2] {
        let size = line[0].abs() + line[1].abs() + line[2].abs();
        let doubt = S::from_f64(16.0 * f64::EPSILON) * size;
        let mut lies = [false; 2];
        for &point in &self.points {
            let value = value_at(line, point);
            lies[0] |= value > doubt;
            lies[1] |= value < -doubt;
        }
        lies
    }

    /// The part on the inside of a line.
    pub(super) fn inside(&self, line: Line<S>, index: u32) -> Self {
        self.part(line, Side { line: index, is_inside: true })
    }

    /// The part on the outside of a line.
    pub(super) fn outside(&self, line: Line<S>, index: u32) -> Self {
        self.part(line.map(|number| -number), Side { line: index, is_inside: false })
    }

    /// The part where `line` is not negative; what is cut off leaves the side `cut`.
    fn part(&self, line: Line<S>, cut: Side) -> Self {
        let mut part = Self::empty();
        let count = self.points.len();
        for k in 0..count {
            let (p, q) = (self.points[k], self.points[(k + 1) % count]);
            let (a, b) = (value_at(line, p), value_at(line, q));
            if a >= S::ZERO {
                part.points.push(p);
                part.sides.push(if b >= S::ZERO || a > S::ZERO { self.sides[k] } else { cut });
            }
            if (a > S::ZERO && b < S::ZERO) || (a < S::ZERO && b > S::ZERO) {
                let share = a / (a - b);
                part.points.push([0, 1].map(|axis| p[axis] + share * (q[axis] - p[axis])));
                part.sides.push(if a > S::ZERO { cut } else { self.sides[k] });
            }
        }
        if part.points.len() < 3 { Self::empty() } else { part }
    }

    /// The corners.
    pub(super) fn points(&self) -> &[[S; 2]] {
        &self.points
    }

    /// The sides with their ends.
    pub(super) fn segments(&self) -> impl Iterator<Item = (Side, [S; 2], [S; 2])> + '_ {
        let count = self.points.len();
        (0..count).map(move |k| (self.sides[k], self.points[k], self.points[(k + 1) % count]))
    }

    pub(super) fn measure(&self) -> Measure<S> {
        // Triangles around the first point: nothing large cancels.
        let mut measure = [S::ZERO; 3];
        let Some(&origin) = self.points.first() else { return measure };
        let (half, third) = (S::from_f64(0.5), S::from_f64(1.0 / 3.0));
        for pair in self.points[1..].windows(2) {
            let [p, q] = [pair[0], pair[1]].map(|p| [p[0] - origin[0], p[1] - origin[1]]);
            let area = half * (p[0] * q[1] - p[1] * q[0]);
            measure[0] += area;
            measure[1] += area * (origin[0] + third * (p[0] + q[0]));
            measure[2] += area * (origin[1] + third * (p[1] + q[1]));
        }
        measure
    }
}

/// What a side from p to q adds to the gradient of its line, whose normal is of length `slope`, from
/// that of the measure of the polygon that it bounds.
#[inline(always)]
pub(super) fn line_bar<S: Scalar>(
    [p, q]: [[S; 2]; 2],
    is_inside: bool,
    slope: S,
    measure_bar: Measure<S>,
) -> Line<S> {
    let (x, y) = (q[0] - p[0], q[1] - p[1]);
    let sixth = S::from_f64(if is_inside { 1.0 / 6.0 } else { -1.0 / 6.0 });
    let scale = sixth * (x * x + y * y).sqrt() / slope;
    let (g_p, g_q) = (scale * value_at(measure_bar, p), scale * value_at(measure_bar, q));
    let (of_p, of_q) = (g_p + g_p + g_q, g_p + g_q + g_q);
    [of_p + of_q, of_p * p[0] + of_q * q[0], of_p * p[1] + of_q * q[1]]
}

/// The length of a line's normal.
#[inline(always)]
pub(super) fn slope<S: Scalar>([_, x, y]: Line<S>) -> S {
    (x * x + y * y).sqrt()
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
    fn cut(lines: &[Line<f64>], sides: &[bool]) -> Polygon<f64> {
        let mut polygon = Polygon::pixel();
        for (k, (&line, &is_inside)) in lines.iter().zip(sides).enumerate() {
            polygon = match is_inside {
                true => polygon.inside(line, k as u32),
                false => polygon.outside(line, k as u32),
            };
        }
        polygon
    }

    proptest! {
        #[test]
        fn the_parts_of_a_polygon_measure_as_much_as_it_does(
            lines in proptest::collection::vec(line(), 1..6),
            sides: [bool; 5],
            last in line(),
        ) {
            let whole = cut(&lines, &sides);
            let parts = [whole.inside(last, 9), whole.outside(last, 9)];
            let [a, b] = parts.map(|part| part.measure());
            for (k, whole) in whole.measure().into_iter().enumerate() {
                prop_assert!((a[k] + b[k] - whole).abs() < 1e-14);
            }
        }

        #[test]
        fn the_adjoint_is_the_difference_quotient(
            lines in proptest::collection::vec(line(), 1..6),
            sides: [bool; 5],
            m_bar in [-1.0..1.0, -1.0..1.0, -1.0..1.0],
        ) {
            let polygon = cut(&lines, &sides);
            prop_assume!(polygon.measure()[0] > 1e-2);
            let mut lines_bar = vec![[0.0; 3]; lines.len()];
            for (side, p, q) in polygon.segments().filter(|(side, ..)| side.line != BORDER) {
                let line = side.line as usize;
                let bar = line_bar([p, q], side.is_inside, slope(lines[line]), m_bar);
                lines_bar[line].iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar);
            }
            let loss = |lines: &[Line<f64>]| -> f64 {
                cut(lines, &sides).measure().into_iter().zip(m_bar).map(|(m, bar)| m * bar).sum()
            };
            for k in 0..lines.len() {
                for c in 0..3 {
                    let size = 1e-6 * lines[k][1].hypot(lines[k][2]);
                    let by = |sign: f64| {
                        let mut moved = lines.clone();
                        moved[k][c] += sign * size;
                        loss(&moved)
                    };
                    let quotient = (by(1.0) - by(-1.0)) / (2.0 * size);
                    let scale = 1.0 / lines[k][1].hypot(lines[k][2]);
                    prop_assert!((quotient - lines_bar[k][c]).abs() < 1e-6 * scale);
                }
            }
        }
    }

    #[test]
    fn a_pixel_measures_4_and_nothing_nothing() {
        let [area, x, y] = Polygon::<f64>::pixel().measure();
        assert!(area == 4.0 && x.abs() < 1e-15 && y.abs() < 1e-15);
        let beyond = Polygon::<f64>::pixel().inside([-3.0, 1.0, 0.0], 0);
        assert!(beyond.is_empty());
        assert_eq!(beyond.measure(), [0.0; 3]);
    }
}
