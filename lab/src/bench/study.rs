//! What a study found: tables, figures, and what failed.

use bokashi_fit::FitError;
use bokashi_report::{Panel, ReportError, Stroke, escaped, legend_line, row};

use crate::bench::table::Table;

/// What a study found.
#[derive(Debug, Clone)]
pub struct Study {
    /// Its anchor.
    pub(crate) id: &'static str,
    /// The question, as a heading.
    pub(crate) title: &'static str,
    /// What was measured, and how to read it; as text.
    pub(crate) note: String,
    pub(crate) tables: Vec<Table>,
    pub(crate) figures: Vec<Figures>,
    /// What ended in an error, and which: it stands with the figures that it is missing from.
    pub(crate) failures: Vec<String>,
}

/// Panels under one legend.
#[derive(Debug, Clone)]
pub(crate) struct Figures {
    /// What the panels have in common, where there are others.
    pub(crate) heading: Option<String>,
    /// Whether they are folded away under it.
    pub(crate) is_folded: bool,
    /// Name, colour and line.
    pub(crate) legend: Vec<(String, &'static str, Stroke)>,
    pub(crate) panels: Vec<Panel>,
}

impl Study {
    /// A study that found nothing yet.
    pub(crate) fn new(id: &'static str, title: &'static str, note: impl Into<String>) -> Self {
        let (tables, figures, failures) = Default::default();
        Self { id, title, note: note.into(), tables, figures, failures }
    }

    /// The value, or `None` where there is an error, which is noted under `what`.
    pub(crate) fn noted<V>(&mut self, what: &str, result: Result<V, FitError>) -> Option<V> {
        result.map_err(|error| self.failures.push(format!("{what}: {error}"))).ok()
    }

    /// What goes to the terminal, and into lab/docs/benchmarks-tables.md.
    pub(crate) fn markdown(&self) -> String {
        let mut text = format!("### {}\n\n{}\n", self.title, wrapped(&self.note));
        for table in self.tables.iter().filter(|table| table.printed) {
            text.push_str(&format!("\n{}:\n\n{}", table.title, table.markdown()));
        }
        for failure in &self.failures {
            text.push_str(&format!("\nFailed: {failure}\n"));
        }
        text
    }

    /// The body of its section of the page.
    pub(crate) fn html(&self) -> Result<String, ReportError> {
        let mut html = format!("<p>{}</p>", escaped(&self.note));
        for figures in &self.figures {
            html.push_str(&figures.html()?);
        }
        for failure in &self.failures {
            let failure = escaped(failure);
            html.push_str(&format!(
                "<p class=\"note\"><span class=\"stuck\">failed</span> {failure}</p>"
            ));
        }
        self.tables.iter().for_each(|table| html.push_str(&table.html()));
        Ok(html)
    }
}

impl Figures {
    fn html(&self) -> Result<String, ReportError> {
        let mut html = String::from("<ul class=\"legend\">");
        for (name, color, stroke) in &self.legend {
            html.push_str(&format!("<li>{}{}", legend_line(color, *stroke), escaped(name)));
        }
        html.push_str("</ul>");
        html.push_str(&row(&self.panels)?);
        Ok(match &self.heading {
            None => html,
            Some(what) if self.is_folded => {
                format!("<details><summary>{}</summary>{html}</details>", escaped(what))
            }
            Some(what) => format!("<h3>{}</h3>{html}", escaped(what)),
        })
    }
}

/// Text in lines of at most 100 characters.
pub(crate) fn wrapped(text: &str) -> String {
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
        let mut study = Study::new("a", "A", "What it is.");
        let error = FitError::Setting { setting: "x", rule: "y < 1", value: "2".to_owned() };
        assert_eq!(study.noted("cube <1>", Err::<(), _>(error)), None);
        assert!(study.markdown().contains("Failed: cube <1>: x needs y < 1, got 2"));
        let html = study.html().expect("no figure");
        assert!(html.contains("failed</span> cube &lt;1&gt;: x needs y &lt; 1"), "{html}");
    }

    #[test]
    fn lines_are_wrapped_between_words() {
        let text = wrapped(&"word ".repeat(100));
        assert!(text.lines().all(|line| line.len() <= 100 && line.len() > 90 || line.len() < 100));
        assert_eq!(text.split_whitespace().count(), 100);
    }
}
