//! Values of options: what their texts may be.

use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::threads::MOST_THREADS;

/// One of some words, each of which `T` can be read from.
pub(super) fn words<T>(all: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: std::str::FromStr<Err: std::error::Error + Send + Sync + 'static>,
    T: Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(all).try_map(|word| word.parse::<T>())
}

/// A whole number within bounds.
fn whole(text: &str, least: u64, most: u64) -> Result<u64, String> {
    let number = text.parse().ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| format!("needs a whole number from {least} to {most}"))
}

/// A history takes about 100 bytes per step: at most 1 GB.
pub(super) fn steps(text: &str) -> Result<u64, String> {
    whole(text, 1, 10_000_000)
}

/// A time that a fit may take.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number.is_finite());
    number.ok_or_else(|| "needs a number of seconds above 0".to_owned())
}

/// A number of threads.
pub fn threads(text: &str) -> Result<usize, String> {
    whole(text, 1, MOST_THREADS as u64).map(|number| number as usize)
}

/// A size of memory in bytes: a number and a unit.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40)];
    let size = units.into_iter().find_map(|(unit, power)| {
        let number: f64 = text.strip_suffix(unit)?.trim_end().parse().ok()?;
        let bytes = number * (1_u64 << power) as f64;
        (bytes >= 1.0 && bytes < (1_u64 << 63) as f64).then_some(bytes as u64)
    });
    size.ok_or_else(|| "needs a size in KiB, MiB, GiB or TiB, such as 8GiB".to_owned())
}

/// Larger images would need more memory than a report of them is worth.
pub(super) fn resolution(text: &str) -> Result<usize, String> {
    whole(text, 1, 4096).map(|number| number as usize)
}

/// A number of seeds.
pub fn seeds(text: &str) -> Result<u64, String> {
    whole(text, 1, 1000)
}

pub(super) fn seed(text: &str) -> Result<u64, String> {
    whole(text, 0, u64::MAX)
}

/// Wider than that, a blur leaves nothing of an image.
pub(super) fn sigma(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number| number > 0.0 && number <= 1e3);
    number.ok_or_else(|| "needs a number of pixels above 0 and up to 1000".to_owned())
}
