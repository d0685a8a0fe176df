//! Poles and residues of a rational approximation of the exponential.
//!
//! `r(x) = 1 + 2 Re sum_j g_j x / (x - z_j)` is near `exp(x)` for all `x <= 0`. In this form
//! `r(0) = 1` to the last digit, whatever the rounding of `g` and `z`.
//!
//! The poles come from the Caratheodory-Fejer approximation: from the singular value decomposition
//! of the Hankel matrix of the Chebyshev coefficients of `exp(9 (s - 1) / (s + 1))`. The `g_j` are
//! its residues divided by the poles. It has a constant term; to leave it out, so that `r(0) = 1`,
//! doubles the least possible error.
//!
//! # Source
//! Trefethen, Weideman and Schmelzer, *Talbot quadratures and rational approximations*, BIT 46,
//! 2006, section 4.

/// A rational approximation of the exponential.
#[derive(Debug, PartialEq)]
pub(crate) struct Order {
    /// A bound on the error of a window of any sigma, against the discrete Gaussian, summed over
    /// all taps.
    pub(crate) error: f64,
    /// One of each pair of conjugate poles: `z_j`, `g_j`, each as real and imaginary part.
    pub(crate) poles: &'static [[[f64; 2]; 2]],
}

impl Order {
    /// The smallest order that is within `tolerance`.
    pub(crate) fn within(tolerance: f64) -> Option<&'static Self> {
        ORDERS.iter().find(|order| order.error <= tolerance)
    }
}

/// Orders 4, 6, 8, 10 and 12.
static ORDERS: [Order; 5] = [
    Order {
        error: 7e-4,
        poles: &[
            [[1.5484005705394042, 1.1918258539276103], [-0.6196998776215684, -0.7533484179409423]],
            [
                [-0.36783831439985787, 3.658133272063309],
                [0.11978635616129309, -0.03210775054851546],
            ],
        ],
    },
    Order {
        error: 1e-5,
        poles: &[
            [[2.4006029389319967, 1.1931293084021029], [-0.9051466136610427, -1.3358858974168855]],
            [[1.1585525717180862, 3.6147726008197267], [0.4174286219121753, -0.04962798131797522]],
            [
                [-1.7819882759221513, 6.196512467347284],
                [-0.012280999750206627, 0.017020253777169786],
            ],
        ],
    },
    Order {
        error: 1.2e-7,
        poles: &[
            [[3.2209452450546716, 1.193619605419487], [-1.4636556317769565, -2.41499295407745]],
            [[2.2922491478213183, 3.6007714960773725], [1.0410372431278931, -0.013864806352963815]],
            [[0.2694909873676443, 6.0820325927005205], [-0.0774458029692457, 0.10057774247330585]],
            [
                [-3.40853950146179, 8.773034564408771],
                [6.420334091095713e-05, -0.0032313330783445594],
            ],
        ],
    },
    Order {
        error: 1.5e-9,
        poles: &[
            [[4.027732483731141, 1.193856067333943], [-2.5239977186685985, -4.479271570216564]],
            [[3.283752900100038, 3.594386774813735], [2.323445996018543, 0.14257155677933817]],
            [[1.7154060337885453, 6.038934929045367], [-0.29805356619606826, 0.34017622899060646]],
            [
                [-0.8944046821709826, 8.582756902508674],
                [-0.0016360630265794404, -0.03158934665284296],
            ],
            [
                [-5.161191251646408, 11.375156254840705],
                [0.0002413520088147027, 0.0003990485931961241],
            ],
        ],
    },
    Order {
        error: 2e-11,
        poles: &[
            [[4.827494174589331, 1.1939879377104055], [-4.54407849539873, -8.490137909060733]],
            [[4.206124927741714, 3.590920590671856], [4.95932052683391, 0.5774364576959604]],
            [[2.9178692532280994, 6.017345628910197], [-0.9137213388107465, 0.9260134275955589]],
            [
                [0.8517077580007295, 8.503832410634207],
                [-0.005981680779981324, -0.15575412413882123],
            ],
            [
                [-2.235967649889935, 11.109295737049763],
                [0.0045176088172641255, 0.0052631860042843615],
            ],
            [
                [-6.998687356009195, 13.995916098140277],
                [-5.662066011789151e-05, -3.0163323901645118e-05],
            ],
        ],
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_is_near_the_exponential_on_the_whole_half_line() {
        for order in &ORDERS {
            let value = |x: f64| {
                let terms = order.poles.iter().map(|[[a, b], [g, h]]| {
                    // Re (g + i h) / (x - a - i b)
                    let (re, im) = (x - a, -b);
                    (g * re + h * im) / (re * re + im * im)
                });
                1.0 + 2.0 * x * terms.sum::<f64>()
            };
            assert_eq!(value(0.0), 1.0);
            let errors = (-600..800).map(|k| {
                let x = -(10_f64.powf(f64::from(k) / 100.0));
                (value(x) - x.exp()).abs()
            });
            let error = errors.fold(0.0, f64::max);
            // The errors of a window's taps add up to several times the error of its transform.
            assert!(error < 0.5 * order.error && error > 0.1 * order.error, "{error}");
        }
    }

    #[test]
    fn a_tolerance_chooses_the_smallest_order_that_is_within_it() {
        let poles = |tolerance: f64| Order::within(tolerance).map(|order| order.poles.len());
        let found = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12].map(poles);
        let some = [2, 2, 3, 3, 4, 5, 6].map(Some);
        assert_eq!(found[..7], some);
        assert_eq!(found[7], None);
    }
}
