//! Filters that make one pixel of many.
//!
//! A filter is a function h of the distance from the centre of an output pixel, in output pixels. With
//! k input pixels to an output pixel, input pixel i of a block has its centre at
//! `x_i = (2 i + 1 - k) / (2 k)`, and the weight `w_i = h(x_i) / sum h(x)`, `|x_i|` below the filter's
//! radius. So all output pixels have the same weights, and a constant image stays as it is.
//!
//! | filter | `h(x)` | radius |
//! |---|---|---|
//! | box | 1 | 1/2 |
//! | triangle | `1 - abs(x)` | 1 |
//! | Mitchell | piecewise cubic, B = C = 1/3 | 2 |
//! | Lanczos | `sinc(x) sinc(x / a)`, `sinc(x) = sin(pi x) / (pi x)` | a |
//!
//! # Source
//! Mitchell and Netravali, *Reconstruction filters in computer graphics*, SIGGRAPH 1988, equation (8);
//! Duchon, *Lanczos filtering in one and two dimensions*, Journal of Applied Meteorology 18, 1979.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use bokashi_core::TensorError;

use crate::error::RenderError;

/// How [`downsample`](crate::downsample()) weighs the pixels around an output pixel. Along either axis
/// the weight is a function of the distance in output pixels.
#[derive(Debug, Clone, Default)]
pub enum Filter {
    /// The mean of a block: the area that a pixel covers. The fastest one.
    #[default]
    Box,
    /// Falls linearly to 0 at the neighbouring pixels' centres.
    Triangle,
    /// The cubic of Mitchell and Netravali: a little blur, a little ringing. It also filters where the
    /// factor is 1.
    Mitchell,
    /// A sinc under the window of a wider one, with this many lobes to either side, 1 to 64: 3 is usual,
    /// 2 rings less. Weights can be negative, and so can pixels of a positive image.
    Lanczos(u32),
    /// A function of one's own: see [`Filter::custom`].
    Custom(CustomFilter),
}

/// The weights of [`Filter::custom`].
#[derive(Clone)]
pub struct CustomFilter {
    radius: f64,
    weight: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
}

impl fmt::Debug for CustomFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CustomFilter").field("radius", &self.radius).finish_non_exhaustive()
    }
}

/// The widest filter, in output pixels.
const LARGEST_RADIUS: f64 = 64.0;

impl Filter {
    /// The filter with the weight `weight(x)` at distance x from the centre of an output pixel, in output
    /// pixels, to the right and downwards, for `|x| < radius`, up to a radius of 64. The weights are
    /// divided by their sum.
    pub fn custom(radius: f64, weight: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Self {
        Self::Custom(CustomFilter { radius, weight: Arc::new(weight) })
    }

    fn radius(&self) -> f64 {
        match self {
            Self::Box => 0.5,
            Self::Triangle => 1.0,
            Self::Mitchell => 2.0,
            Self::Lanczos(lobes) => f64::from(*lobes),
            Self::Custom(filter) => filter.radius,
        }
    }

    fn weight(&self, x: f64) -> f64 {
        match self {
            Self::Box => 1.0,
            Self::Triangle => 1.0 - x.abs(),
            Self::Mitchell => mitchell(x.abs()),
            Self::Lanczos(lobes) => sinc(x) * sinc(x / f64::from(*lobes)),
            Self::Custom(filter) => (filter.weight)(x),
        }
    }

    /// Fills in the weights of the input pixels that an output pixel of `factor` input pixels sees, and
    /// returns the place of the first, counted from the output pixel's own first input pixel. The first
    /// and the last weight are not 0.
    ///
    /// # Errors
    /// `TensorError::Value` for a radius that is not above 0 and at most 64, and for weights whose sum is
    /// not finite, or 0 to within rounding.
    pub(crate) fn fill_weights(
        &self,
        factor: usize,
        weights: &mut Vec<f64>,
    ) -> Result<isize, RenderError> {
        let refused = |rule: &'static str, value| {
            Err(TensorError::Value { operation: "downsample", rule: rule.into(), value }.into())
        };
        let radius = self.radius();
        if !(radius > 0.0 && radius <= LARGEST_RADIUS) {
            return refused("a filter radius above 0 and up to 64 output pixels", radius);
        }
        let k = factor as isize;
        let reach = (radius * factor as f64) as isize + 1;
        // Twice the distances, in input pixels: whole numbers.
        let twice = |i: isize| 2 * i + 1 - k;
        let is_within =
            |i: &isize| (twice(*i).unsigned_abs() as f64) < 2.0 * radius * factor as f64;
        let weight = |i: isize| self.weight(twice(i) as f64 / (2 * k) as f64);
        let mut indices = (-reach..k + reach).filter(is_within).skip_while(|&i| weight(i) == 0.0);
        weights.clear();
        let first = indices.next();
        weights.extend(first.into_iter().chain(indices).map(weight));
        weights.truncate(weights.iter().rposition(|&w| w != 0.0).map_or(0, |last| last + 1));
        // From +0: a sum of no terms would be -0.
        let sum = weights.iter().fold(0.0, |sum, w| sum + w);
        let size: f64 = weights.iter().map(|w| w.abs()).sum();
        if !(sum.is_finite() && sum.abs() > f64::EPSILON * weights.len() as f64 * size) {
            return refused("filter weights with a finite sum other than 0", sum);
        }
        weights.iter_mut().for_each(|w| *w /= sum);
        Ok(first.unwrap_or_default())
    }
}

/// Mitchell's cubic at a distance.
fn mitchell(x: f64) -> f64 {
    if x < 1.0 {
        (7.0 * x * x * x - 12.0 * x * x + 16.0 / 3.0) / 6.0
    } else {
        // The cubic has a double root at 2.
        (2.0 - x) * (2.0 - x) * (8.0 - 7.0 * x) / 18.0
    }
}

/// `sin(pi x) / (pi x)`, exactly 0 at whole numbers but 0.
fn sinc(x: f64) -> f64 {
    if x == 0.0 {
        1.0
    } else if x.fract() == 0.0 {
        0.0
    } else {
        (PI * x).sin() / (PI * x)
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn weights(filter: &Filter, factor: usize) -> (isize, Vec<f64>) {
        let mut weights = vec![7.0; 3];
        let first = filter.fill_weights(factor, &mut weights).unwrap();
        (first, weights)
    }

    fn all() -> Vec<Filter> {
        let skewed = |x: f64| 1.0 + 0.3 * x + (-x * x).exp();
        let lanczos = [1, 2, 3, 64].map(Filter::Lanczos);
        let plain = [Filter::Box, Filter::Triangle, Filter::Mitchell, Filter::custom(1.3, skewed)];
        plain.into_iter().chain(lanczos).collect()
    }

    #[test]
    fn weights_sum_to_1_and_those_of_even_filters_are_symmetric_about_the_block() {
        for filter in all() {
            for factor in [1, 2, 3, 4, 7, 100] {
                let (first, weights) = weights(&filter, factor);
                assert_relative_eq!(weights.iter().sum::<f64>(), 1.0, epsilon = 1e-14);
                assert_eq!(first + first + weights.len() as isize, factor as isize, "{filter:?}");
                let mut reversed = weights.iter().rev();
                if !matches!(filter, Filter::Custom(_)) {
                    let mirrored = |w: &f64| (w - reversed.next().unwrap()).abs() < 1e-16;
                    assert!(weights.iter().all(mirrored));
                }
            }
        }
    }

    #[test]
    fn weights_by_hand() {
        assert_eq!(weights(&Filter::Box, 4), (0, vec![0.25; 4]));
        assert_eq!(weights(&Filter::Box, 1), (0, vec![1.0]));
        // At 1/4, 3/4, and beyond.
        assert_eq!(weights(&Filter::Triangle, 2), (-1, vec![0.125, 0.375, 0.375, 0.125]));
        let (first, triangle) = weights(&Filter::Triangle, 3);
        assert_eq!((first, triangle.len()), (-1, 5));
        for (found, expected) in triangle.iter().zip([1.0, 2.0, 3.0, 2.0, 1.0]) {
            assert_relative_eq!(*found, expected / 9.0, epsilon = 1e-16);
        }
        // 1/18 = B / 6 at either side.
        let (first, mitchell) = weights(&Filter::Mitchell, 1);
        assert_eq!(first, -1);
        for (found, expected) in mitchell.iter().zip([1.0 / 18.0, 16.0 / 18.0, 1.0 / 18.0]) {
            assert_relative_eq!(*found, expected, epsilon = 1e-16);
        }
        let (_, lanczos) = weights(&Filter::Lanczos(2), 2);
        assert!(lanczos.len() == 8 && lanczos[1] < 0.0 && lanczos[3] > 0.4);
    }

    #[test]
    fn filters_that_interpolate_see_one_pixel_of_as_many() {
        for filter in [Filter::Box, Filter::Triangle, Filter::Lanczos(1), Filter::Lanczos(3)] {
            assert_eq!(weights(&filter, 1), (0, vec![1.0]), "{filter:?}");
        }
        assert_eq!(weights(&Filter::Mitchell, 1).1.len(), 3);
    }

    #[test]
    fn a_custom_filter_may_see_less_than_a_block_and_one_side_of_it() {
        assert_eq!(weights(&Filter::custom(0.2, |_| 3.0), 5), (2, vec![1.0]));
        let right = Filter::custom(0.5, |x| if x > 0.0 { x } else { 0.0 });
        assert_eq!(weights(&right, 4), (2, vec![0.25, 0.75]));
        assert_eq!(weights(&Filter::custom(0.5, |_| -2.0), 2), (0, vec![0.5; 2]));
    }

    #[test]
    fn weights_that_have_no_sum_are_refused() {
        let said = |filter: Filter, factor| {
            filter.fill_weights(factor, &mut Vec::new()).unwrap_err().to_string()
        };
        let rule = "downsample needs a filter radius above 0 and up to 64 output pixels, got";
        for radius in [0.0, -1.0, 65.0, f64::INFINITY, f64::NAN] {
            assert_eq!(said(Filter::custom(radius, |_| 1.0), 2), format!("{rule} {radius}"));
        }
        assert_eq!(said(Filter::Lanczos(0), 2), format!("{rule} 0"));
        let rule = "downsample needs filter weights with a finite sum other than 0, got";
        assert_eq!(said(Filter::custom(1.0, |_| f64::NAN), 2), format!("{rule} NaN"));
        assert_eq!(said(Filter::custom(1.0, |_| 0.0), 2), format!("{rule} 0"));
        assert_eq!(said(Filter::custom(1.0, |x| x), 2), format!("{rule} 0"));
        // No pixel's centre is that near.
        assert_eq!(said(Filter::custom(0.1, |_| 1.0), 4), format!("{rule} 0"));
    }
}
