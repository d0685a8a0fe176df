//! Quartiles and other quantiles of numbers some of which may be NaN.

/// `[lower quartile, median, upper quartile]`; NaN where there is no number. A number that is NaN
/// counts as the largest.
pub fn quartiles(values: impl Iterator<Item = f64>) -> [f64; 3] {
    quantiles(values, [0.25, 0.5, 0.75])
}

/// The median as [`quartiles`] has it; `None` without numbers.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values = values.peekable();
    values.peek().is_some().then(|| quartiles(values)[1])
}

/// The values under which these `parts` of the numbers lie, as [`quartiles`]: under 0 the least, under
/// 1 the largest.
pub fn quantiles<const N: usize>(values: impl Iterator<Item = f64>, parts: [f64; N]) -> [f64; N] {
    let values = sorted(values);
    parts.map(|part| quantile(&values, part))
}

/// Numbers by size, those that are NaN at the end: a fit that broke counts as the worst.
fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    // Positive, whatever the sign of the NaN was: the total order then puts it last.
    let mut values: Vec<f64> =
        values.map(|value| if value.is_nan() { f64::NAN } else { value }).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The value under which a part of sorted numbers lies, linear between neighbours.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let position = part * last as f64;
    let (below, above) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    if below == above { below } else { below + (above - below) * position.fract() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_neighbours_and_nan_counts_as_the_worst() {
        assert_eq!(quartiles([4.0, 1.0, 3.0, 2.0, 5.0].into_iter()), [2.0, 3.0, 4.0]);
        assert_eq!(quartiles([1.0, 2.0].into_iter()), [1.25, 1.5, 1.75]);
        let [low, middle, high] = quartiles([1.0, -f64::NAN, 2.0, 3.0, f64::NAN].into_iter());
        assert_eq!((low, middle), (2.0, 3.0));
        assert!(high.is_nan());
        assert!(quartiles(std::iter::empty())[1].is_nan());
        assert_eq!(quartiles([f64::INFINITY, f64::INFINITY].into_iter())[1], f64::INFINITY);
    }
}
