//! The page of a run, and its files.

use std::path::{Path, PathBuf};

use bokashi_report::{Document, ReportError, Section, add_page, escaped};
use bokashi_write::write_below;

use crate::bench::effort::Effort;
use crate::bench::setting::method;
use crate::bench::study::Study;
use crate::bench::table::Table;

/// Writes the page `bench.html` and a CSV file per table into `folder`; returns the path of the
/// page.
///
/// # Errors
/// Where a figure can't be drawn or the file system refuses.
pub fn write_page(
    studies: &[Study],
    effort: Effort,
    footer: &str,
    folder: &Path,
) -> Result<PathBuf, ReportError> {
    let mut sections = Vec::new();
    for study in studies {
        sections.push(Section { id: study.id, title: study.title, body: study.html()? });
    }
    let page = Document {
        title: "Bokashi: speed".to_owned(),
        heading: "How fast, and at what error".to_owned(),
        introduction: escaped(&method(effort)),
        sections,
        footer: format!("{footer} Beside this page: <code>bench-*.csv</code>."),
    };
    for table in studies.iter().flat_map(|study| &study.tables) {
        write_csv(table, "bench", folder)?;
    }
    add_page(folder, "bench.html", &page.html())
}

/// Writes the file `prefix-name.csv`.
pub(crate) fn write_csv(table: &Table, prefix: &str, folder: &Path) -> Result<(), ReportError> {
    let name = format!("{prefix}-{}.csv", table.name);
    let failed = |error| ReportError::Write { path: folder.join(&name), error };
    write_below(folder, &name, table.csv().as_bytes()).map(drop).map_err(failed)
}
