//! Surfaces that do not face the lens.
//!
//! # Forward
//! A lens sees at the pixel y, through its point p, what the pinhole picture shows at `x = y + p s(x)`. So of the
//! lens the share `(1 - p . g) / (pi s^2)`, per pixel, sees the pixel x, with `g = grad s`: by `dp / dx`, up to
//! first order. These shares sum to 1, but their mean is not x: it is `x - s E[p (1 - p . g)] = x + s g / 4`, since
//! a disc has `E[p_x^2] = 1/4`. There a disc of radius s is put, which has the same first moments. With
//! `s = K (1 - f / z)` g is `ds/dz grad z`. Each component is cut to [-1/2, 1/2]: beyond 1 the pinhole picture is no
//! longer seen in its order.
//!
//! A shift by a part of a pixel shares a surface among neighbouring pixels, linearly along each axis.
//!
//! # Backward
//! With `m = s g / 4`: `s_bar = m_bar . g / 4`, `g_bar = m_bar s / 4` where it is not cut, from there
//! `(ds/dz)_bar = g_bar . grad z` and `(grad z)_bar = g_bar ds/dz`; and `m_bar` is the surface's dot product with the
//! differences of the gradients at neighbouring pixels.
//!
//! # Where it is not smooth
//! Where g is cut, and where a shift passes a whole pixel. Along an axis without a shift there is no gradient. Nor is
//! there where a shift passes what a rung's pixels allow, for circles of 224 pixels and more.

use bokashi_core::Scalar;

use super::circles::Circle;
use crate::defocus::MOST_HALVINGS;
use crate::size::Size;

/// The largest component of the gradient of a radius.
const STEEPEST: f64 = 0.5;
/// The largest shift in pixels of a rung's own size. At most halvings only circles of 224 pixels and more reach it.
const LARGEST_SHIFT: f64 = 1.75;
/// A smaller shift, in pixels, is rounding: many pixels of a face that is parallel to the image have it.
const LEAST_SHIFT: f64 = 1e-6;
/// Rows and columns that a shift reaches.
pub(super) const REACH: usize = 2;

/// How far a surface is moved, in pixels to the right and down.
pub(super) fn shift<S: Scalar>(circle: &Circle<S>, slope: [S; 2]) -> [S; 2] {
    let quarter = S::from_f64(0.25) * circle.radius;
    slope.map(|slope| {
        let shift = quarter * cut(circle.by_distance * slope).0;
        if shift.to_f64().abs() < LEAST_SHIFT { S::ZERO } else { shift }
    })
}

/// A number that tells on which smooth piece a shift lies.
pub(super) fn piece<S: Scalar>(circle: &Circle<S>, slope: [S; 2]) -> u64 {
    let shift = shift(circle, slope);
    (0..2).fold(0_u64, |piece, k| {
        let (_, is_cut) = cut(circle.by_distance * slope[k]);
        let shift = shift[k].to_f64();
        let is_largest = shift.abs() >= LARGEST_SHIFT * f64::from(1_u32 << MOST_HALVINGS);
        let kind = i64::from(is_cut) + 2 * i64::from(is_largest) + 4 * i64::from(shift == 0.0);
        piece.wrapping_mul(4099).wrapping_add((8 * shift.floor() as i64 + kind) as u64)
    })
}

/// A component of g, and whether it is cut. What is infinitely far and infinitely steep is not moved.
fn cut<S: Scalar>(gradient: S) -> (S, bool) {
    let most = S::from_f64(STEEPEST);
    match gradient {
        _ if gradient > most => (most, true),
        _ if gradient < -most => (-most, true),
        _ if gradient.to_f64().is_nan() => (S::ZERO, true),
        _ => (gradient, false),
    }
}

/// Gradients of what a shift is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct TiltBar<S> {
    /// Of the circle's radius, and of its derivative by the distance.
    pub(super) radius: S,
    pub(super) by_distance: S,
    /// Of the gradient of the distance.
    pub(super) slope: [S; 2],
}

impl<S: Scalar> TiltBar<S> {
    pub(super) const ZERO: Self =
        Self { radius: S::ZERO, by_distance: S::ZERO, slope: [S::ZERO; 2] };

    /// From the gradients of a shift.
    pub(super) fn new(circle: &Circle<S>, slope: [S; 2], shift_bar: [S; 2]) -> Self {
        let mut bar = Self::ZERO;
        let quarter = S::from_f64(0.25);
        for k in 0..2 {
            let (gradient, is_cut) = cut(circle.by_distance * slope[k]);
            bar.radius += quarter * shift_bar[k] * gradient;
            if !is_cut {
                let gradient_bar = quarter * shift_bar[k] * circle.radius;
                bar.by_distance += gradient_bar * slope[k];
                bar.slope[k] = gradient_bar * circle.by_distance;
            }
        }
        bar
    }
}

/// Two neighbouring rows, or columns, with their shares, and the derivatives of these by the shift.
pub(super) type Taps<S> = [(usize, S, S); 2];

/// Among which columns and which rows of an image, halved so often to `small`, a shift shares a pixel.
pub(super) fn taps<S: Scalar>(
    small: Size,
    halvings: usize,
    [row, column]: [usize; 2],
    shift: [S; 2],
) -> [Taps<S>; 2] {
    let scale = 1.0 / f64::from(1_u32 << halvings);
    let along = |index: usize, shift: S, extent: usize| {
        let most = S::from_f64(LARGEST_SHIFT);
        let shift = shift * S::from_f64(scale);
        let (shift, slope) = match shift {
            _ if shift > most => (most, S::ZERO),
            _ if shift < -most => (-most, S::ZERO),
            _ if shift == S::ZERO => (shift, S::ZERO),
            _ => (shift, S::from_f64(scale)),
        };
        let whole = shift.to_f64().floor();
        let rest = shift - S::from_f64(whole);
        let first = (index >> halvings) as isize + whole as isize;
        let at = |index: isize| index.clamp(0, extent as isize - 1) as usize;
        [(at(first), S::ONE - rest, -slope), (at(first + 1), rest, slope)]
    };
    [along(column, shift[0], small.width), along(row, shift[1], small.height)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const CIRCLE: Circle<f64> =
        Circle { radius: -6.0, by_distance: 3.0, by_aperture: 0.0, by_focus: 0.0 };

    #[test]
    fn a_shift_is_a_quarter_of_the_radius_times_its_gradient() {
        let [x, y] = shift(&CIRCLE, [0.1, 0.0]);
        assert!((x + 0.45).abs() < 1e-15 && y == 0.0);
        // Cut.
        assert_eq!(shift(&CIRCLE, [9.0, -f64::INFINITY]), [-0.75, 0.75]);
        let far = Circle { by_distance: 0.0, ..CIRCLE };
        assert_eq!(shift(&far, [f64::INFINITY, f64::NAN]), [0.0, 0.0]);
    }

    #[test]
    fn gradients_of_a_shift_are_those_of_differences() {
        let (slope, bar, step) = ([0.1, -0.4], [0.7, 1.9], 1e-6);
        let found = TiltBar::new(&CIRCLE, slope, bar);
        let value = |circle: Circle<f64>, slope| {
            let moved = shift(&circle, slope);
            moved[0] * bar[0] + moved[1] * bar[1]
        };
        let quotient = |at: &dyn Fn(f64) -> f64| (at(step) - at(-step)) / (2.0 * step);
        let radius = |d| value(Circle { radius: CIRCLE.radius + d, ..CIRCLE }, slope);
        let by = |d| value(Circle { by_distance: CIRCLE.by_distance + d, ..CIRCLE }, slope);
        let x = |d| value(CIRCLE, [slope[0] + d, slope[1]]);
        let y = |d| value(CIRCLE, [slope[0], slope[1] + d]);
        assert!((found.radius - quotient(&radius)).abs() < 1e-8);
        assert!((found.by_distance - quotient(&by)).abs() < 1e-8);
        assert!((found.slope[0] - quotient(&x)).abs() < 1e-8);
        // Cut.
        assert!(found.slope[1] == 0.0 && quotient(&y).abs() < 1e-8);
    }

    #[test]
    fn taps_sum_to_one_and_have_the_shift_as_their_mean() {
        let small = Size { width: 40, height: 40 };
        for halvings in 0..4 {
            for shift in [-1.3, -0.2, 0.0, 0.9, 1.5] {
                let scale = f64::from(1 << halvings);
                let at = [10 << halvings, 20 << halvings];
                let [columns, rows] = taps(small, halvings, at, [shift * scale, 0.0]);
                let sum: f64 = columns.iter().map(|tap| tap.1).sum();
                let mean: f64 = columns.iter().map(|tap| tap.1 * tap.0 as f64).sum();
                assert!((sum - 1.0).abs() < 1e-15 && (mean - 20.0 - shift).abs() < 1e-12);
                assert_eq!(rows[0], (10, 1.0, 0.0));
            }
        }
    }
}
