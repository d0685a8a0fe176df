//! Maps from raw numbers to the values that a parameter may have.

use bokashi_core::{Scalar, Var};

/// A smooth one-to-one map from all numbers to the allowed numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "save", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "save", serde(rename_all = "kebab-case", deny_unknown_fields))]
#[non_exhaustive]
pub enum Mapping {
    /// All numbers: `value = raw`.
    #[default]
    Identity,
    /// Positive numbers: `value = ln(1 + e^raw)`, which is `raw` for large numbers. Steps in raw are
    /// steps of about the same size in value.
    Softplus,
    /// Positive numbers: `value = e^raw`. Steps in raw are relative steps in value.
    Exp,
    /// Numbers between 0 and 1, as colours are: `value = 1 / (1 + e^-raw)`. In `f32` values round to 1
    /// from a raw number of about 17 on.
    Sigmoid,
}

impl Mapping {
    /// The value of `raw`, bitwise as [`Mapping::record`] computes it.
    pub fn value<T: Scalar>(self, raw: T) -> T {
        match self {
            Self::Identity => raw,
            Self::Softplus => raw.maximum_or_nan(T::ZERO) + (-raw.abs()).exp().ln_1p(),
            Self::Exp => raw.exp(),
            // As the tape's: no exponential overflows.
            Self::Sigmoid => {
                let e = (-raw.abs()).exp();
                (if raw < T::ZERO { e } else { T::ONE }) / (T::ONE + e)
            }
        }
    }

    /// The raw number of `value`: the inverse, rounded from `f64`. Infinite or NaN for a value
    /// that the mapping does not reach.
    pub fn raw<T: Scalar>(self, value: T) -> T {
        let y = value.to_f64();
        T::from_f64(match self {
            Self::Identity => return value,
            // ln(e^y - 1), which overflows for large y.
            Self::Softplus => y + (-(-y).exp_m1()).ln(),
            Self::Exp => y.ln(),
            Self::Sigmoid => y.ln() - (-y).ln_1p(),
        })
    }

    /// Records the values of `raw`.
    pub fn record<T: Scalar>(self, raw: Var<'_, T>) -> Var<'_, T> {
        match self {
            Self::Identity => raw,
            Self::Softplus => raw.softplus(),
            Self::Exp => raw.exp(),
            Self::Sigmoid => raw.sigmoid(),
        }
    }

    /// The rule that values obey, as the end of "... needs ...".
    pub(super) fn rule(self) -> &'static str {
        match self {
            Self::Identity => "finite entries",
            Self::Softplus | Self::Exp => "finite entries above 0 under its mapping",
            Self::Sigmoid => "entries above 0 and below 1 under its mapping",
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tape;

    use super::*;

    const MAPPINGS: [Mapping; 4] =
        [Mapping::Identity, Mapping::Softplus, Mapping::Exp, Mapping::Sigmoid];

    #[test]
    fn raw_undoes_value_and_value_undoes_raw() {
        for mapping in MAPPINGS {
            let is_reached = |y: &f64| mapping != Mapping::Sigmoid || *y < 1.0;
            let values = [1e-300, 1e-9, 0.3, 1.0 - 1e-9, 1.0, 2.0, 40.0, 1e3, 1e8];
            for y in values.into_iter().filter(is_reached) {
                // e^x loses |x| units of the last place.
                let back = mapping.value(mapping.raw(y));
                assert!((back - y).abs() <= 1e-15 * y * 700.0, "{mapping:?} {y} {back}");
            }
            for y in [0.5_f32, 0.99, 2.0, 4.0].into_iter().filter(|y| is_reached(&f64::from(*y))) {
                let back = mapping.value(mapping.raw(y));
                assert!((back - y).abs() <= 3e-7 * y, "{mapping:?} {y} {back}");
            }
        }
    }

    #[test]
    fn a_value_is_bitwise_what_the_tape_records() {
        let tape = Tape::<f32>::new();
        for mapping in MAPPINGS {
            for k in -400..400 {
                let raw = 0.1 * k as f32;
                let recorded = mapping.record(tape.leaf_scalar(raw)).item();
                assert_eq!(mapping.value(raw).to_bits(), recorded.to_bits(), "{mapping:?} {raw}");
            }
        }
    }
}
