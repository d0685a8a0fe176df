//! The rows as a section of a page.

use bokashi_report::{Cell, Section, Table};

use super::row::Row;

/// The rows as a section.
pub fn section(rows: &[Row]) -> Section {
    let mut section = Section::new("rows", "With and without", NOTE);
    section.push_table(table(rows));
    section
}

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
            with.cell(row.microseconds_with()),
            with.cell(1e6 * with.median),
            without.cell(row.microseconds_without()),
            without.cell(1e6 * without.median),
            Cell::number(without.minimum / with.minimum),
            with.cell(100.0 * with.spread().max(without.spread())),
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
