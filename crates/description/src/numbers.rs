//! Numbers and words with a rule, which a file's parser checks where they stand.

use std::fmt;

use schemars::JsonSchema;
use serde::de::Visitor;
use serde::{Deserialize, Deserializer, Serialize};

/// A number, and how a message says it: of a large whole number the nearest that has 53 bits is another one.
struct Written {
    number: f64,
    text: String,
}

impl<'de> Deserialize<'de> for Written {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfNumber;

        impl Visitor<'_> for OfNumber {
            type Value = Written;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("f64")
            }

            fn visit_i64<E>(self, number: i64) -> Result<Written, E> {
                Ok(Written { number: number as f64, text: number.to_string() })
            }

            fn visit_u64<E>(self, number: u64) -> Result<Written, E> {
                Ok(Written { number: number as f64, text: number.to_string() })
            }

            fn visit_f64<E>(self, number: f64) -> Result<Written, E> {
                Ok(Written { number, text: number.to_string() })
            }
        }

        deserializer.deserialize_f64(OfNumber)
    }
}

/// Makes a number with a rule: its name, the rule in words, the test, and what a schema says.
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident: $kind:ty, $rule:literal, $test:expr, [$($schema:tt)*];)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[serde(try_from = "Written")]
        // In its place: an editor shows what the key is, not what the number is.
        #[schemars(inline, with = "f64", extend($($schema)*))]
        pub struct $name(pub $kind);

        impl TryFrom<Written> for $name {
            type Error = String;

            fn try_from(Written { number, text }: Written) -> Result<Self, String> {
                let is_kept: fn(f64) -> bool = $test;
                match is_kept(number) {
                    true => Ok(Self(number as $kind)),
                    false => Err(format!("{} is needed here, and this is {text}", $rule)),
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
    /// A whole number from 1 to a thousand million.
    Count: usize, "a whole number from 1 to 1000000000", |x| (1.0..=1e9).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 1, "maximum" = 1_000_000_000];
    /// A whole number from 1 to 4096.
    StartCount: usize, "a whole number from 1 to 4096", |x| (1.0..=4096.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 1, "maximum" = 4096];
    /// A power of two from 16 to 8192.
    TextureSize: usize, "a power of two from 16 to 8192",
        |x| (16.0..=8192.0).contains(&x) && x.fract() == 0.0 && (x as u64).is_power_of_two(),
        ["type" = "integer", "format" = "uint", "minimum" = 16, "maximum" = 8192];
    /// A whole number from 4 to 512.
    CellCount: usize, "a whole number from 4 to 512", |x| (4.0..=512.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 4, "maximum" = 512];
    /// A whole number from 0 to 16.
    PassCount: usize, "a whole number from 0 to 16", |x| (0.0..=16.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 0, "maximum" = 16];
    /// A whole number from 0 to 8.
    SurfaceCount: usize, "a whole number from 0 to 8", |x| (0.0..=8.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 0, "maximum" = 8];
    /// A whole number from 1 to 8.
    SampleCount: usize, "a whole number from 1 to 8", |x| (1.0..=8.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 1, "maximum" = 8];
    /// A whole number from 3 to 16.
    BladeCount: usize, "a whole number from 3 to 16", |x| (3.0..=16.0).contains(&x) && x.fract() == 0.0,
        ["type" = "integer", "format" = "uint", "minimum" = 3, "maximum" = 16];
    /// A number from 1 to 1024.
    CircleRadius: f64, "a number from 1 to 1024", |x| (1.0..=1024.0).contains(&x), ["minimum" = 1, "maximum" = 1024];
}
