//! The grid as a page of the report.

use std::fmt::Write as _;

use bokashi_report::{Document, Section, escaped};

use super::row::Row;
use super::table::summary;

/// The page that shows `rows`, made by `program`, as HTML that needs nothing beside it.
pub fn page(rows: &[Row], program: &str) -> String {
    let failed: Vec<&Row> = rows.iter().filter(|row| !row.pass).collect();
    let failures = if failed.is_empty() { String::new() } else { table(&failed) };
    let section = |is_in: fn(&Row) -> bool| {
        let rows: Vec<&Row> = rows.iter().filter(|row| is_in(row)).collect();
        if rows.is_empty() { String::new() } else { table(&rows) }
    };
    let listed = section(|row| row.case.is_some_and(|number| number <= 50));
    let further = section(|row| row.case.is_some_and(|number| number > 50));
    let refused = section(|row| row.case.is_none());
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
            Section { id: "cases", title: "The cases that were set out", body: listed },
            Section { id: "further", title: "Cases met on the way", body: further },
            Section { id: "refused", title: "What is refused", body: refused },
        ],
        footer: format!("Made by {}.", escaped(program)),
    }
    .html()
}

/// One line per case, the precisions side by side.
fn table(rows: &[&Row]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\"><table class=\"wide cases\"><thead><tr><th>Case<th>Expected\
         <th>What came out<th>f32<th>f64<tbody>",
    );
    for group in rows.chunk_by(|a, b| a.name == b.name) {
        let first = group[0];
        let same = group.iter().all(|row| row.outcome == first.outcome);
        let outcomes = group.iter().map(|row| match (same, escaped(&row.outcome)) {
            (true, outcome) => outcome.replace('\n', "<br>"),
            (false, outcome) => format!("{}: {}", row.precision, outcome.replace('\n', "<br>")),
        });
        let mut outcomes: Vec<_> = outcomes.collect();
        outcomes.dedup();
        // Writing to a string cannot fail.
        let _ = write!(
            html,
            "<tr><th>{}{}<td>{}<td>{}",
            first.case.map_or_else(String::new, |number| format!("{number}&ensp;")),
            escaped(&first.name),
            escaped(first.expected),
            outcomes.join("<br>")
        );
        for precision in ["f32", "f64"] {
            let row = group.iter().find(|row| row.precision == precision);
            let _ = write!(html, "<td>{}", row.map_or(String::new(), |row| cell(row)));
        }
    }
    html.push_str("</table></div>");
    html
}

/// Whether a row passed, its error, and the bound below it.
fn cell(row: &Row) -> String {
    let verdict = if row.pass { "" } else { "<span class=\"stuck\">failed</span> " };
    match (row.error, row.bound) {
        (None, None) if row.pass => "passed".to_owned(),
        (None, None) => verdict.to_owned(),
        (error, bound) => {
            let error = error.map_or("not finite".to_owned(), digits);
            let bound = bound.map_or(String::new(), digits);
            format!("{verdict}{error}<br><small>bound {bound}</small>")
        }
    }
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
            case: Some(case),
            name: "all w <= 0".to_owned(),
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
        assert!(html.contains("<span class=\"stuck\">failed</span> 0<br>"));
        assert!(!page(&[row(6, true)], "bokashi").contains("What failed"));
    }
}
