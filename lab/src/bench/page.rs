//! The pages of runs.

use bokashi_report::{About, Document, Section};

use crate::bench::effort::Effort;
use crate::bench::setting::method;

/// The page of the studies, with a CSV file per table.
pub fn page(studies: Vec<Section>, effort: Effort, about: About) -> Document {
    page_of(("bench", "How fast, and at what error"), studies, effort, about)
}

/// The files of [`elision_page`].
pub const ELISION_FILES: [&str; 2] = ["elision.html", "elision-rows.csv"];

/// The page of what is left out, with a CSV file of its rows.
pub fn elision_page(rows: Section, effort: Effort, about: About) -> Document {
    page_of(("elision", "What a scene does not need"), vec![rows], effort, about)
}

fn page_of(
    (name, heading): (&'static str, &str),
    sections: Vec<Section>,
    effort: Effort,
    about: About,
) -> Document {
    let (heading, introduction) = (heading.to_owned(), method(effort));
    Document { name, heading, introduction, sections, files: Vec::new(), about }
}
