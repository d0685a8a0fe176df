//! How lenses bend what a pinhole would show.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::camera::{distortion_radius, fisheye_limit};
use bokashi_render_ops::{RenderError, distort, fisheye};
use glam::{DVec2, DVec3};

/// How a lens bends what a pinhole would show, by OpenCV's coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// A polynomial of the radius, and two tangential terms: k1, k2, p1, p2, k3.
    Polynomial([f64; 5]),
    /// A quotient of two polynomials: k1, k2, p1, p2, k3, k4, k5, k6.
    Rational([f64; 8]),
    /// A polynomial of the angle off the axis: k1, k2, k3, k4. All 0 is a fisheye, too.
    Fisheye([f64; 4]),
}

impl Distortion {
    /// That of a pinhole.
    pub const NONE: Self = Self::Polynomial([0.0; 5]);

    /// The coefficients, in OpenCV's order.
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::Polynomial(numbers) => numbers,
            Self::Rational(numbers) => numbers,
            Self::Fisheye(numbers) => numbers,
        }
    }

    /// A lens of the same kind; coefficients that are missing are 0.
    pub fn with_coefficients(&self, coefficients: &[f64]) -> Self {
        fn all<const N: usize>(numbers: &[f64]) -> [f64; N] {
            std::array::from_fn(|k| numbers.get(k).copied().unwrap_or_default())
        }
        match self {
            Self::Polynomial(_) => Self::Polynomial(all(coefficients)),
            Self::Rational(_) => Self::Rational(all(coefficients)),
            Self::Fisheye(_) => Self::Fisheye(all(coefficients)),
        }
    }

    /// Whether a pinhole shows the same.
    pub fn is_none(&self) -> bool {
        !matches!(self, Self::Fisheye(_))
            && self.coefficients().iter().all(|&coefficient| coefficient == 0.0)
    }

    /// How `scene.toml` says lenses of this formula.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Polynomial(_) => "`distortion` of five numbers",
            Self::Rational(_) => "`distortion` of eight numbers",
            Self::Fisheye(_) => "`fisheye`",
        }
    }

    /// Whether another lens has the same formula.
    pub fn is_kind_of(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }

    /// Points in camera coordinates `[V, 3]` as the lens shows them to a pinhole, with these coefficients in place
    /// of its own.
    ///
    /// # Errors
    /// What the operation refuses.
    pub(crate) fn bend<'t, T: Scalar>(
        &self,
        points: Var<'t, T>,
        coefficients: Var<'t, T>,
    ) -> Result<Var<'t, T>, RenderError> {
        match self {
            Self::Fisheye(_) => fisheye(points, coefficients),
            _ => distort(points, coefficients),
        }
    }

    /// [`Distortion::bend`] with the lens's own coefficients, of fixed points.
    ///
    /// # Errors
    /// What the operation refuses.
    pub(crate) fn bent(&self, points: &Tensor<f64>) -> Result<Tensor<f64>, RenderError> {
        let tape = Tape::new();
        let coefficients = tape.constant(&Tensor::from(self.coefficients()));
        Ok(self.bend(tape.constant(points), coefficients)?.value())
    }

    /// Normalized coordinates of what is seen, for points in camera coordinates. None where the lens shows
    /// nothing: in the plane of a pinhole and behind it, and beyond where the lens's formula holds.
    pub(super) fn shows(self) -> impl Fn(DVec3) -> Option<DVec2> {
        let limit = match self {
            Self::Polynomial(coefficients) => distortion_radius(coefficients),
            Self::Rational(coefficients) => distortion_radius(coefficients),
            Self::Fisheye(coefficients) => fisheye_limit(coefficients),
        };
        let is_none = self.is_none();
        move |point| {
            if let Self::Fisheye([k1, k2, k3, k4]) = self {
                let radius = point.truncate().length();
                let angle = radius.atan2(point.z);
                // False for what is not a number, too.
                let is_shown = angle <= limit;
                let s = angle * angle;
                let shown = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
                let scale = if radius > 0.0 { shown / radius } else { 0.0 };
                return is_shown.then(|| scale * point.truncate());
            }
            if point.z.is_nan() || point.z <= 0.0 {
                return None;
            }
            let projected = point.truncate() / point.z;
            if is_none {
                return Some(projected);
            }
            let DVec2 { x, y } = projected;
            let s = x * x + y * y;
            let (five, [k4, k5, k6]) = match self {
                Self::Rational([k1, k2, p1, p2, k3, rest @ ..]) => ([k1, k2, p1, p2, k3], rest),
                Self::Polynomial(coefficients) => (coefficients, [0.0; 3]),
                Self::Fisheye(_) => return None,
            };
            let [k1, k2, p1, p2, k3] = five;
            let radial =
                (1.0 + s * (k1 + s * (k2 + s * k3))) / (1.0 + s * (k4 + s * (k5 + s * k6)));
            let shown = DVec2::new(
                x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            );
            (s.sqrt() <= limit).then_some(shown)
        }
    }
}
