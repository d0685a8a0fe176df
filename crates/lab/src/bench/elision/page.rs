//! The rows in print and as a page.

use std::path::{Path, PathBuf};

use bokashi_report::{Document, ReportError, Section, add_page, escaped};

use super::row::Row;
use crate::bench::effort::Effort;
use crate::bench::page::write_csv;
use crate::bench::setting::method;
use crate::bench::study::wrapped;
use crate::bench::table::{Cell, Table};

/// The rows as a table.
fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "rows",
        "Microseconds of a step with it computed and without",
        &[
            ("left out", "row"),
            ("with, µs", "microseconds_with"),
            ("median", "median_microseconds_with"),
            ("without, µs", "microseconds_without"),
            ("median", "median_microseconds_without"),
            ("without / with", "ratio"),
            ("quartiles apart, %", "spread_percent"),
            ("without it is", "time_without"),
            ("samples", "samples"),
            ("same bits", "bitwise_equal"),
            ("results", "results"),
            ("named in the report", "left_out"),
        ],
    );
    for row in rows {
        let Row { with, without, .. } = row;
        table.push(vec![
            Cell::text(row.row),
            Cell::timed(with, row.microseconds_with()),
            Cell::timed(with, 1e6 * with.median),
            Cell::timed(without, row.microseconds_without()),
            Cell::timed(without, 1e6 * without.median),
            Cell::number(without.minimum / with.minimum),
            Cell::timed(with, 100.0 * with.spread().max(without.spread())),
            Cell::text(row.verdict()),
            Cell::Count(with.samples.min(without.samples)),
            Cell::text(if row.bitwise_equal() { "yes" } else { "NO" }),
            Cell::Count(row.results.len()),
            match row.left_out.is_empty() {
                true => Cell::Nothing,
                false => Cell::text(row.left_out.join("; ")),
            },
        ]);
    }
    table
}

/// What the table shows.
const NOTE: &str = "Each step is taken with one thing computed and without it, on a sphere of 1024 \
    faces (f32, one thread): positions, colours and sigma are learnt, sigma is 1, the background \
    empty, where the row does not say otherwise. The counterpart of sigma 0 is a window with nothing \
    but its centre; of an empty background one of zeros that is learnt; of a scene without \
    discontinuities, a wall that fills the image, the same wall with all faces apart; of no face near \
    the near plane one that reaches through it beside the image; of a depth that nobody asks for one \
    with an upstream gradient of zeros; of inference a step with all gradients. Compared are the \
    picture, the loss, and each gradient that both steps have. Samples of both are taken in turns; \
    times are equal where the ranges between their quartiles meet, of which the wider is given as a \
    share of its median.";

/// The rows as Markdown.
pub fn elision_markdown(rows: &[Row], effort: Effort) -> String {
    let method = wrapped(&method(effort));
    format!("{method}\n\n{}\n\n{}", wrapped(NOTE), table(rows).markdown())
}

/// Writes the page `elision.html` and `elision-rows.csv` into `folder`; returns the path of the page.
///
/// # Errors
/// [`ReportError::Write`] where the file system refuses.
pub fn write_elision_page(
    rows: &[Row],
    effort: Effort,
    footer: &str,
    folder: &Path,
) -> Result<PathBuf, ReportError> {
    let table = table(rows);
    let page = Document {
        title: "Bokashi: what is left out".to_owned(),
        heading: "What a scene does not need".to_owned(),
        introduction: escaped(&method(effort)),
        sections: vec![Section {
            id: "rows",
            title: "With and without",
            body: format!("<p>{}</p>{}", escaped(NOTE), table.html()),
        }],
        footer: format!("{footer} Beside this page: <code>elision-rows.csv</code>."),
    };
    write_csv(&table, "elision", folder)?;
    add_page(folder, "elision.html", &page.html())
}
