//! Sections of a page: figures, tables, pictures and words under a heading, and what failed.

use std::fmt::Display;
use std::fmt::Write as _;

use crate::error::ReportError;
use crate::figures::Figures;
use crate::markup::escaped;
use crate::table::Table;

/// A picture with its caption.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Captioned {
    /// Where the picture lies, as an address.
    pub address: String,
    /// What it shows, as text.
    pub caption: String,
    /// What it shows for readers who hear the page, as text.
    pub spoken: String,
    /// Whether it is an address of its own that a reader can open.
    pub is_linked: bool,
}

/// What a section shows.
#[derive(Debug, Clone, PartialEq)]
enum Block {
    Figures(Figures),
    Table(Table),
    Pictures(Vec<Captioned>),
    Html(String),
    Failure(String),
}

/// A section of a page.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// Its anchor.
    pub id: &'static str,
    /// Its heading, as text.
    pub title: &'static str,
    /// What is shown, and how to read it; as text.
    pub note: String,
    blocks: Vec<Block>,
}

/// The least height of a small picture on a page, in pixels.
pub const PICTURE_HEIGHT: u32 = 192;

impl Section {
    /// A section that shows nothing yet but its note, which may be empty.
    pub fn new(id: &'static str, title: &'static str, note: impl Into<String>) -> Self {
        Self { id, title, note: note.into(), blocks: Vec::new() }
    }

    /// Adds figures.
    pub fn push_figures(&mut self, figures: Figures) {
        self.blocks.push(Block::Figures(figures));
    }

    /// Adds a table.
    pub fn push_table(&mut self, table: Table) {
        self.blocks.push(Block::Table(table));
    }

    /// Adds tables.
    pub fn push_tables(&mut self, tables: impl IntoIterator<Item = Table>) {
        self.blocks.extend(tables.into_iter().map(Block::Table));
    }

    /// Adds pictures, side by side, under a heading as text, which may be empty.
    pub fn push_pictures(&mut self, heading: &str, pictures: Vec<Captioned>) {
        if !heading.is_empty() {
            self.push_html(format!("<h3>{}</h3>", escaped(heading)));
        }
        self.blocks.push(Block::Pictures(pictures));
    }

    /// Adds what is written in HTML.
    pub fn push_html(&mut self, html: impl Into<String>) {
        self.blocks.push(Block::Html(html.into()));
    }

    /// Adds what failed, as text.
    pub fn push_failure(&mut self, failure: impl Into<String>) {
        self.blocks.push(Block::Failure(failure.into()));
    }

    /// The value, or `None` where there is an error, which is added as the failure of `what`.
    pub fn noted<V, E: Display>(&mut self, what: &str, result: Result<V, E>) -> Option<V> {
        result.map_err(|error| self.push_failure(format!("{what}: {error}"))).ok()
    }

    /// Its tables, in order.
    pub fn tables(&self) -> impl Iterator<Item = &Table> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Table(table) => Some(table),
            _ => None,
        })
    }

    /// What failed, in order.
    pub fn failures(&self) -> impl Iterator<Item = &str> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Failure(failure) => Some(&**failure),
            _ => None,
        })
    }

    /// The note, the tables that are printed and what failed, as Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("### {}\n\n{}\n", self.title, wrapped(&self.note));
        for table in self.tables().filter(|table| table.is_printed) {
            let _ = write!(text, "\n{}:\n\n{}", table.title, table.markdown());
        }
        for failure in self.failures() {
            let _ = write!(text, "\nFailed: {failure}\n");
        }
        text
    }

    /// What stands below its heading, as HTML; empty where it shows nothing but its note.
    ///
    /// # Errors
    /// [`ReportError::Figure`] where a figure can't be drawn.
    pub(crate) fn html(&self) -> Result<String, ReportError> {
        let mut html = String::new();
        for block in &self.blocks {
            match block {
                Block::Figures(figures) => html.push_str(&figures.html()?),
                Block::Table(table) if table.rows.is_empty() => {}
                Block::Table(table) => html.push_str(&table.html()),
                Block::Pictures(pictures) => html.push_str(&strip(pictures)),
                Block::Html(text) => html.push_str(text),
                Block::Failure(failure) => {
                    let flag = "<p class=\"note\"><span class=\"stuck\">failed</span>";
                    let _ = write!(html, "{flag} {}</p>", escaped(failure));
                }
            }
        }
        if html.is_empty() || self.note.is_empty() {
            return Ok(html);
        }
        Ok(format!("<p>{}</p>{html}", escaped(&self.note)))
    }
}

/// Pictures side by side, as HTML.
fn strip(pictures: &[Captioned]) -> String {
    if pictures.is_empty() {
        return String::new();
    }
    let mut html = String::from("<div class=\"film\">");
    for Captioned { address, caption, spoken, is_linked } in pictures {
        let (caption, spoken) = (escaped(caption), escaped(spoken));
        let image = format!(
            "<img class=\"seen\" height=\"{PICTURE_HEIGHT}\" loading=\"lazy\" src=\"{address}\" \
             alt=\"{spoken}\">"
        );
        let image = match is_linked {
            true => format!("<a href=\"{address}\">{image}</a>"),
            false => image,
        };
        let _ = write!(html, "<figure>{image}<figcaption>{caption}</figcaption></figure>");
    }
    html + "</div>"
}

/// Text in lines of at most 100 characters.
pub fn wrapped(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("there is one at least");
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= 100 {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_stands_in_print_and_on_the_page() {
        let mut section = Section::new("a", "A", "What it is.");
        assert_eq!(section.noted("cube <1>", Err::<(), _>("x needs y < 1, got 2")), None);
        assert!(section.markdown().contains("Failed: cube <1>: x needs y < 1, got 2"));
        let html = section.html().expect("no figure");
        assert!(html.contains("failed</span> cube &lt;1&gt;: x needs y &lt; 1"), "{html}");
    }

    #[test]
    fn lines_are_wrapped_between_words() {
        let text = wrapped(&"word ".repeat(100));
        assert!(text.lines().all(|line| line.len() <= 100 && line.len() > 90 || line.len() < 100));
        assert_eq!(text.split_whitespace().count(), 100);
    }
}
