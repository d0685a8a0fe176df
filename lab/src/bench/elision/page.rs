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
    faces (f32, one thread). Where the row does not say otherwise, positions, colours and sigma \
    are learnt, sigma is 1, and the background is empty. Beside sigma 0 stands a window with \
    nothing but its centre. Beside an empty background stands a background of zeros that is \
    learnt. A scene without discontinuities is a wall that fills the image; beside it stands the \
    same wall with all faces apart. Beside a scene without a face near the near plane stands the \
    scene with such a face, which reaches through the plane beside the image. Beside a depth that \
    nobody asks for stands a depth with an upstream gradient of zeros. A lit surface has a directional \
    light that is learnt, and no blur. A texture is learnt with its coordinates, and a bias \
    keeps all samples at its finest level; beside fixed coordinates stands a step with frozen \
    positions, too. Layers are opaque. Beside inference stands a \
    step with all gradients. The picture, the loss, and each gradient that both steps have are \
    compared. Samples of both are taken in turns. Times are equal where the ranges between their \
    quartiles meet; the wider range is given as a share of its median.";

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
