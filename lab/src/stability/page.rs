//! The grid as a page of the report.

use bokashi_report::{About, Cell, Document, Section, Table};

use super::row::Row;
use super::table::summary;

/// The files of [`page`].
pub const FILES: [&str; 2] = ["stability.html", ROWS];

const ROWS: &str = "stability-rows.csv";

/// The page that shows `rows`, with a CSV file of them.
pub fn page(rows: &[Row], about: About) -> Document {
    let section = |id, title, is_in: fn(&Row) -> bool| {
        let mut section = Section::new(id, title, "");
        section.push_table(table(&rows.iter().filter(|row| is_in(row)).collect::<Vec<_>>()));
        section
    };
    let sections = vec![
        section("failed", "What failed", |row| !row.pass),
        section("cases", "The cases that were set out", |row| row.case.is_some_and(|k| k <= 50)),
        section("further", "Cases met on the way", |row| row.case.is_some_and(|k| k > 50)),
        section("refused", "What is refused", |row| row.case.is_none()),
    ];
    let introduction = format!(
        "Input from the edges: each has a defined result or a clear error, in both precisions. {}. An \
         error is the distance from an answer that was worked out another way; where the bound is 0, \
         nothing but the exact answer passes.",
        summary(rows)
    );
    Document {
        name: "stability",
        heading: "Extreme cases".to_owned(),
        introduction,
        sections,
        files: vec![(ROWS.into(), row_table(rows).csv().into_bytes())],
        about,
    }
}

/// One line per case, the precisions side by side.
fn table(rows: &[&Row]) -> Table {
    let columns = ["Case", "Expected", "What came out", "f32", "bound", "f64", "bound"];
    let mut table = Table::new("", "", &columns.map(|title| (title, ""))).with_sentences();
    for group in rows.chunk_by(|a, b| a.name == b.name) {
        let first = group[0];
        let same = group.iter().all(|row| row.outcome == first.outcome);
        let outcomes = group.iter().map(|row| match same {
            true => row.outcome.clone(),
            false => format!("{}: {}", row.precision, row.outcome),
        });
        let mut outcomes: Vec<_> = outcomes.collect();
        outcomes.dedup();
        let numbers = ["f32", "f64"].into_iter().flat_map(|precision| {
            let row = group.iter().find(|row| row.precision == precision);
            row.map_or([Cell::Nothing, Cell::Nothing], |row| cells(row))
        });
        let number = first.case.map_or(String::new(), |number| format!("{number} "));
        let words = [format!("{number}{}", first.name), first.expected.to_owned()];
        let words = words.into_iter().chain([outcomes.join("\n")]);
        table.push(words.map(Cell::Text).chain(numbers).collect());
    }
    table
}

/// One row per case and precision, under the names that JSON has for them.
fn row_table(rows: &[Row]) -> Table {
    let columns = ["case", "name", "precision", "expected", "outcome", "pass", "error", "bound"];
    let mut table = Table::new("rows", "", &columns.map(|name| (name, name)));
    for row in rows {
        table.push(vec![
            row.case.map_or(Cell::Nothing, |number| Cell::Count(number as usize)),
            Cell::text(&row.name),
            Cell::text(row.precision),
            Cell::text(row.expected),
            Cell::text(&row.outcome),
            Cell::text(row.pass.to_string()),
            Cell::maybe(row.error),
            Cell::maybe(row.bound),
        ]);
    }
    table
}

/// The error of a row, or whether it passed, and the bound.
fn cells(row: &Row) -> [Cell; 2] {
    let error = match (row.error, row.bound) {
        (Some(error), _) => digits(error),
        (None, Some(_)) => "not finite".to_owned(),
        (None, None) => if row.pass { "passed" } else { "failed" }.to_owned(),
    };
    let error = Cell::Text(error);
    [
        if row.pass { error } else { error.flagged() },
        row.bound.map_or(Cell::Nothing, |bound| Cell::Text(digits(bound))),
    ]
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
        let html = |rows: &[Row]| page(rows, About::default()).render().expect("no figure").html;
        let text = html(&[row(6, true), row(51, false)]);
        let at = |words: &str| text.find(words).expect("it is there");
        assert!(at("What failed") < at("The cases that were set out"));
        assert!(text.contains("panicked: a &lt; b") && text.contains("all w &lt;= 0"));
        assert!(text.contains("2 rows: 1 passed, 1 failed"));
        assert!(text.contains("<span class=\"stuck\">0</span>"));
        assert!(!html(&[row(6, true)]).contains("What failed"));
    }
}
