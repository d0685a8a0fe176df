//! The grid as text, 80 columns wide.

use super::row::Row;

/// A row: whether it passed, and below it, where it did not, why.
///
/// `ok    21 f32 fan of 512 faces                     error 0.0e0, bound 0.0e0`
pub fn line(row: &Row) -> String {
    let verdict = if row.pass { "ok  " } else { "FAIL" };
    let numbers = match (row.error, row.bound) {
        (Some(error), Some(bound)) => format!("error {error:.1e}, bound {bound:.1e}"),
        (None, Some(bound)) => format!("error not finite, bound {bound:.1e}"),
        _ if row.outcome.starts_with("error: ") => "refused".to_owned(),
        _ => String::new(),
    };
    let Row { case, name, precision, .. } = row;
    let number = case.map_or_else(String::new, |number| number.to_string());
    let mut text = format!("{verdict} {number:>3} {precision} {name:<37}{numbers}");
    text.truncate(text.trim_end().len());
    if !row.pass {
        text.push_str(&format!("\n     expected: {}\n     got: {}", row.expected, row.outcome));
    }
    text
}

/// How many rows passed.
pub fn summary(rows: &[Row]) -> String {
    let passed = rows.iter().filter(|row| row.pass).count();
    let failed = rows.len() - passed;
    format!("{} rows: {passed} passed, {failed} failed", rows.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(pass: bool, error: Option<f64>, bound: Option<f64>) -> Row {
        let outcome = "each pixel once".to_owned();
        let (name, expected) = ("fan of 512 faces".to_owned(), "each pixel once");
        Row { case: Some(21), name, precision: "f32", expected, outcome, pass, error, bound }
    }

    #[test]
    fn a_row_is_one_line_and_a_failed_one_says_why() {
        let ok = line(&row(true, Some(0.0), Some(0.0)));
        assert_eq!(
            ok,
            "ok    21 f32 fan of 512 faces                     error 0.0e0, bound 0.0e0"
        );
        let failed = line(&row(false, None, Some(1e-7)));
        assert!(failed.starts_with("FAIL  21 f32") && failed.contains("error not finite"));
        assert!(failed.ends_with("got: each pixel once") && failed.lines().count() == 3);
        assert_eq!(line(&row(true, None, None)), "ok    21 f32 fan of 512 faces");
        let rows = [row(true, None, None), row(false, None, None)];
        assert_eq!(summary(&rows), "2 rows: 1 passed, 1 failed");
    }

    #[test]
    fn every_row_fits_a_terminal_of_80_columns() {
        for case in super::super::cases() {
            let row = Row {
                case: case.number,
                name: case.name.clone(),
                ..row(true, Some(f64::MIN_POSITIVE), Some(f64::MIN_POSITIVE))
            };
            assert!(line(&row).chars().count() <= 80, "{}", line(&row));
            assert!(line(&row).contains(&format!("{} ", case.name)), "{}", line(&row));
        }
    }
}
