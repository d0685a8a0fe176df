//! Numbers and words with a rule, which a file's parser checks where they stand.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Makes a number with a rule: its name, the rule in words, the test, and what a schema says.
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident: $kind:ty, $rule:literal, $test:expr, [$($schema:tt)*];)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[serde(try_from = "f64")]
        // In its place: an editor shows what the key is, not what the number is.
        #[schemars(inline, extend($($schema)*))]
        pub struct $name(pub $kind);

        impl TryFrom<f64> for $name {
            type Error = String;

            fn try_from(number: f64) -> Result<Self, String> {
                let is_kept: fn(f64) -> bool = $test;
                match is_kept(number) {
                    true => Ok(Self(number as $kind)),
                    false => Err(format!("{} is needed here, and this is {number}", $rule)),
                }
            }
        }
    )*};
}

numbers! {
    /// A finite number.
    Finite: f64, "a finite number", |x| x.is_finite(), ["type" = "number"];
    /// A finite number above 0.
    Positive: f64, "a finite number above 0", |x| x > 0.0 && x.is_finite(), ["exclusiveMinimum" = 0];
    /// A finite number, 0 or above.
    NotNegative: f64, "a finite number, 0 or above,", |x| x >= 0.0 && x.is_finite(), ["minimum" = 0];
    /// A number from 0 to 1.
    Share: f64, "a number from 0 to 1", |x| (0.0..=1.0).contains(&x), ["minimum" = 0, "maximum" = 1];
    /// A whole number, 1 or above.
    Count: usize, "a whole number, 1 or above,", |x| (1.0..=1e9).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 1, "maximum" = 1_000_000_000];
}
