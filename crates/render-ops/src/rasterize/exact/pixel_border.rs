//! Sides that lie on a pixel's border.
//!
//! # Derivative
//! A side on the border between two pixels is a kink. If it moves to one side, it changes the pixel
//! there; if it moves to the other side, it changes the other pixel. The derivative is the central
//! derivative, the mean of both slopes: in each pixel the side counts half. At the image's own border
//! there is only the pixel inside, and the derivative is half of its slope.
//!
//! # Which sides
//! Closed pixels share their border, so cutting a face to a pixel either leaves the whole pixel or
//! nothing, and no side. Wherever a line lies on the border of a pixel, the pixel is therefore resolved
//! once more, a little wider ([`WIDER`]). The sides on the border are now inside, with what is seen on
//! both sides of them. They are clipped to the pixel and count half; no other side is taken from the
//! wide pixel, and no area.
//!
//! # Unseen faces
//! A face that ends at the pixel's border has no area in the pixel. It still becomes two pieces of
//! weight 0, so that a pipeline shades it and the weights have gradients.
//! Each piece moves with a half of the side. It is shaded at a third of the side's length from the
//! side's middle. A value that is linear along the side then has two integrals right, its own and its
//! first moment, since `2 (L / 2) (L / 4) (L / 3) = L^3 / 12`.

use bokashi_core::Scalar;

use super::polygon::{Line, value_at};

/// How far the wide pixel reaches, in half pixels: much more than sides are off their border, and less
/// than the margin within which faces are gathered (`band_faces::REACH`).
pub(super) const WIDER: f64 = 1.0 + 1.0 / (1 << 22) as f64;

/// Sides within this many half pixels are on a border: pieces as thin as this are dropped.
const NEAR: f64 = 2.5e-14;

/// However coarsely a line is known, sides beyond this distance are not on a border.
pub(super) const FAR: f64 = 1e-9;

/// Whether a line runs along rows or columns; no line does whose value is the same everywhere.
#[inline(always)]
pub(super) fn is_along_axis<S: Scalar>([_, x, y]: Line<S>) -> bool {
    let (x, y) = (x.abs(), y.abs());
    x.minimum_or_nan(y) < S::from_f64(FAR) * x.maximum_or_nan(y)
}

/// Whether a line lies on the border of the pixel with the centre `center`. Its values are off by up to
/// `error`, within which it is on the border. The two pixels of a border agree, for they look at the
/// line in one point.
#[inline(always)]
pub(super) fn lies_on_border<S: Scalar>(line: Line<S>, center: [S; 2], error: S) -> bool {
    is_along_axis(line) && is_near_border(line, center, error)
}

/// [`lies_on_border`] of a line along rows or columns.
#[cold]
#[inline(never)]
fn is_near_border<S: Scalar>(line: Line<S>, center: [S; 2], error: S) -> bool {
    let (x, y) = (line[1].abs(), line[2].abs());
    let (across, along) = (x.maximum_or_nan(y), x.minimum_or_nan(y));
    let tolerance =
        error.maximum_or_nan(S::from_f64(NEAR) * across).minimum_or_nan(S::from_f64(FAR) * across);
    [-S::ONE, S::ONE].into_iter().any(|offset| {
        let mut point = center;
        point[usize::from(x < y)] += offset;
        value_at(line, point).abs() + along <= tolerance
    })
}

/// What a side on a border, of a line with the normal `normal`, has within the pixel.
#[inline]
pub(super) fn clipped<S: Scalar>(ends: [[S; 2]; 2], normal: [S; 2]) -> Option<[[S; 2]; 2]> {
    let along = usize::from(normal[0].abs() >= normal[1].abs());
    let clipped = ends.map(|mut end| {
        end[along] = end[along].maximum_or_nan(-S::ONE).minimum_or_nan(S::ONE);
        end
    });
    (clipped[0][along] != clipped[1][along]).then_some(clipped)
}

/// The halves of a side, each with the place where what has no area beside it is shaded.
#[inline]
pub(super) fn halves<S: Scalar>([p, q]: [[S; 2]; 2]) -> [([[S; 2]; 2], [S; 2]); 2] {
    let point_at = |share: f64| {
        let share = S::from_f64(share);
        [0, 1].map(|axis| p[axis] + share * (q[axis] - p[axis]))
    };
    let middle = point_at(0.5);
    [([p, middle], point_at(1.0 / 6.0)), ([middle, q], point_at(5.0 / 6.0))]
}
