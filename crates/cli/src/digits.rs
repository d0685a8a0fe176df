//! Numbers for people, of six digits.

/// Numbers with six digits, without what is not needed.
pub(crate) fn number(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let digits = 5 - (x.abs().log10().floor() as i32).clamp(-300, 300);
    if !(0..=9).contains(&digits) {
        let short = format!("{x:.5e}");
        let (digits, power) = short.split_once('e').unwrap_or((&short, "0"));
        return format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'));
    }
    let text = format!("{x:.*}", digits as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// Several numbers, a space between two.
pub(crate) fn numbers(all: impl IntoIterator<Item = f64>) -> String {
    all.into_iter().map(number).collect::<Vec<_>>().join(" ")
}

/// "1 face", "2 faces".
pub(crate) fn count(count: usize, what: &str) -> String {
    match count {
        1 => format!("1 {what}"),
        _ => format!("{count} {what}s"),
    }
}

/// "62 %", rounded away from neither end.
pub(crate) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        0.0 => "0 %".to_owned(),
        p if p < 1.0 => "below 1 %".to_owned(),
        p if p < 100.0 => format!("{:.0} %", p.floor()),
        _ => "100 %".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let rows = [
            (0.0, "0"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (1.0 / 3.0, "0.333333"),
            (1234.5, "1234.5"),
            (999_999.4, "999999"),
            (1e7, "1e7"),
            (-2.5e-8, "-2.5e-8"),
            (100_000.0, "100000"),
        ];
        for (x, expected) in rows {
            assert_eq!(number(x), expected);
        }
        assert_eq!(
            [0.0, 0.001, 0.5, 0.999, 1.0].map(percent),
            ["0 %", "below 1 %", "50 %", "99 %", "100 %"]
        );
    }
}
