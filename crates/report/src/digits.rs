//! Numbers for people.

/// A time for people: without an exponent.
pub fn plain(number: Option<f64>) -> String {
    match number {
        Some(number) if (1e-4..0.01).contains(&number) => format!("{number:.4}"),
        number => digits(number),
    }
}

/// A number for people: three digits, as short as they allow.
pub fn digits(number: Option<f64>) -> String {
    match number {
        None => "–".to_owned(),
        Some(number) if number.is_nan() => "NaN".to_owned(),
        Some(0.0) => "0".to_owned(),
        Some(number) if (0.01..1e4).contains(&number.abs()) => {
            let digits = (2 - number.abs().log10().floor() as i32).clamp(0, 4);
            format!("{number:.*}", digits as usize)
        }
        Some(number) => format!("{number:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people_are_short() {
        let table = [
            (None, "–"),
            (Some(f64::NAN), "NaN"),
            (Some(0.0), "0"),
            (Some(1.5e-7), "1.5e-7"),
            (Some(0.0321), "0.0321"),
            (Some(0.5), "0.500"),
            (Some(12.34), "12.3"),
            (Some(1234.5), "1234"),
            (Some(f64::INFINITY), "inf"),
        ];
        for (number, text) in table {
            assert_eq!(digits(number), text);
        }
        assert_eq!(plain(Some(0.0019)), "0.0019");
    }
}
