//! The grid as a page of the report.

use std::fmt::Write as _;

use bokashi_fit::report::{Document, Section, escaped};

use super::row::Row;
use super::table::summary;

/// The page that shows `rows`, made by `program`, as HTML that needs nothing beside it.
pub fn page(rows: &[Row], program: &str) -> String {
    let failed: Vec<&Row> = rows.iter().filter(|row| !row.pass).collect();
    let failures = if failed.is_empty() { String::new() } else { table(&failed) };
    let (listed, found): (Vec<&Row>, Vec<&Row>) = rows.iter().partition(|row| row.case <= 50);
    let of = |rows: &[&Row]| if rows.is_empty() { String::new() } else { table(rows) };
    Document {
        title: "Bokashi: extreme cases".to_owned(),
        heading: "Extreme cases".to_owned(),
        introduction: format!(
            "Input from the edges: each has a defined result or a clear error, in both precisions. \
             {}. An error is the distance from an answer that was worked out another way; where \
             the bound is 0, nothing but the exact answer passes.",
            summary(rows)
        ),
        sections: vec![
            Section { id: "failed", title: "What failed", body: failures },
            Section { id: "cases", title: "The cases that were set out", body: of(&listed) },
            Section { id: "found", title: "Cases found on the way", body: of(&found) },
        ],
        footer: format!("Made by {}.", escaped(program)),
    }
    .html()
}

/// One line per case where both precisions say the same, else one per row.
fn table(rows: &[&Row]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\"><table class=\"choices\"><thead><tr><th>Case<th>Expected\
         <th>What came out<th>Numbers<th>Error<th>Bound<th>Passed<tbody>",
    );
    for group in rows.chunk_by(|a, b| a.case == b.case) {
        for (at, row) in group.iter().enumerate() {
            let head = match at {
                0 => format!("{}&ensp;{}", row.case, escaped(row.name)),
                _ => String::new(),
            };
            let repeats = at > 0 && row.outcome == group[0].outcome;
            let outcome = if repeats { "the same".to_owned() } else { escaped(&row.outcome) };
            let expected = if at > 0 { String::new() } else { escaped(row.expected) };
            let number = |number: Option<f64>| number.map_or("–".to_owned(), digits);
            let pass = if row.pass { "yes" } else { "<span class=\"stuck\">no</span>" };
            // Writing to a string cannot fail.
            let _ = write!(
                html,
                "<tr><th>{head}<td>{expected}<td>{outcome}<td>{}<td>{}<td>{}<td>{pass}",
                row.precision,
                number(row.error),
                number(row.bound)
            );
        }
    }
    html.push_str("</table></div>");
    html
}

fn digits(number: f64) -> String {
    if number == 0.0 { "0".to_owned() } else { format!("{number:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_row_stands_first_and_text_is_escaped() {
        let row = |case, pass| Row {
            case,
            name: "all w <= 0",
            precision: "f32",
            expected: "nothing",
            outcome: "panicked: a < b".to_owned(),
            pass,
            error: Some(0.0),
            bound: None,
        };
        let html = page(&[row(6, true), row(51, false)], "bokashi");
        let at = |text: &str| html.find(text).expect("it is there");
        assert!(at("What failed") < at("The cases that were set out"));
        assert!(html.contains("panicked: a &lt; b") && html.contains("all w &lt;= 0"));
        assert!(html.contains("2 rows: 1 passed, 1 failed"));
        assert!(!page(&[row(6, true)], "bokashi").contains("What failed"));
    }
}
