//! Tables: as Markdown for people, as CSV and JSON for programs, as HTML for the report.

use std::fmt::Write as _;

use bokashi_report::{digits, escaped, quartiles};
use serde_json::{Map, Value};

use crate::bench::sampling::Timing;

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cell {
    /// Words.
    Text(String),
    /// A whole number.
    Count(usize),
    /// A number with its mark for people: three digits of it, then the mark.
    Number(f64, &'static str),
    /// What does not apply or was not measured.
    Nothing,
}

/// Stands beside figures that come from fewer samples than are enough.
pub(crate) const FEW_SAMPLES: &str = "*";

impl Cell {
    /// Words.
    pub(crate) fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    /// A number without a mark.
    pub(crate) fn number(number: f64) -> Self {
        Self::Number(number, "")
    }

    /// The number, or nothing.
    pub(crate) fn maybe(number: Option<f64>) -> Self {
        number.map_or(Self::Nothing, Self::number)
    }

    /// So many of all.
    pub(crate) fn part([some, all]: [usize; 2]) -> Self {
        Self::text(format!("{some} of {all}"))
    }

    /// The median, where it is a number: nothing where half of them or more are infinite.
    pub(crate) fn median(numbers: impl Iterator<Item = f64>) -> Self {
        Self::maybe(Some(quartiles(numbers)[1]).filter(|median| median.is_finite()))
    }

    /// A figure of `timing`, marked where it has few samples.
    pub(crate) fn timed(timing: &Timing, figure: f64) -> Self {
        Self::Number(figure, if timing.has_enough_samples() { "" } else { FEW_SAMPLES })
    }

    /// As people read it.
    fn shown(&self) -> String {
        match self {
            Self::Text(words) => words.clone(),
            Self::Count(count) => count.to_string(),
            Self::Number(number, mark) => digits(Some(*number)) + mark,
            Self::Nothing => "–".to_owned(),
        }
    }

    /// As programs read it.
    fn field(&self) -> String {
        match self {
            Self::Text(words) => format!("\"{}\"", words.replace('"', "\"\"")),
            Self::Count(count) => count.to_string(),
            Self::Number(number, _) if number.is_finite() => format!("{number:e}"),
            Self::Number(..) | Self::Nothing => String::new(),
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Text(words) => Value::from(words.as_str()),
            Self::Count(count) => Value::from(*count),
            // Infinity and NaN become null.
            Self::Number(number, _) => Value::from(*number),
            Self::Nothing => Value::Null,
        }
    }
}

/// A column: its name for people, its name for programs.
pub(crate) type Column = (&'static str, &'static str);

/// A table; every row has an entry per column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    /// The name of its CSV file, without the ending.
    pub(crate) name: &'static str,
    /// The heading for people.
    pub(crate) title: &'static str,
    pub(crate) columns: Vec<Column>,
    pub(crate) rows: Vec<Vec<Cell>>,
    /// Whether people get to see it in print: long lists are for the files and the report.
    pub(crate) printed: bool,
}

impl Table {
    /// A table without rows.
    pub(crate) fn new(name: &'static str, title: &'static str, columns: &[Column]) -> Self {
        Self { name, title, columns: columns.to_vec(), rows: Vec::new(), printed: true }
    }

    /// The same, for files and the report alone.
    pub(crate) fn not_printed(self) -> Self {
        Self { printed: false, ..self }
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, row: Vec<Cell>) {
        debug_assert_eq!(row.len(), self.columns.len(), "a row of {}", self.name);
        self.rows.push(row);
    }

    /// As Markdown, columns of even width.
    pub(crate) fn markdown(&self) -> String {
        let head = self.columns.iter().map(|(title, _)| (*title).to_owned()).collect();
        let shown = self.rows.iter().map(|row| row.iter().map(Cell::shown).collect());
        let lines: Vec<Vec<String>> = std::iter::once(head).chain(shown).collect();
        let width = |column: usize| {
            let cells = lines.iter().map(|line: &Vec<String>| line[column].chars().count());
            cells.max().unwrap_or(0).max(3)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let mut text = String::new();
        for (at, line) in lines.iter().enumerate() {
            for (cell, &width) in line.iter().zip(&widths) {
                // Writing to a string cannot fail.
                let _ = write!(text, "| {cell:width$} ");
            }
            text.push_str("|\n");
            if at == 0 {
                widths.iter().for_each(|&width| {
                    let _ = write!(text, "|{}", "-".repeat(width + 2));
                });
                text.push_str("|\n");
            }
        }
        text
    }

    /// As CSV, with the names for programs as its head.
    pub(crate) fn csv(&self) -> String {
        let head: Vec<&str> = self.columns.iter().map(|(_, key)| *key).collect();
        let mut text = head.join(",") + "\n";
        for row in &self.rows {
            let fields: Vec<String> = row.iter().map(Cell::field).collect();
            text.push_str(&(fields.join(",") + "\n"));
        }
        text
    }

    /// As a list of objects.
    pub(crate) fn json(&self) -> Value {
        let object = |row: &Vec<Cell>| {
            let keys = self.columns.iter().map(|(_, key)| (*key).to_owned());
            Value::Object(keys.zip(row.iter().map(Cell::json)).collect::<Map<_, _>>())
        };
        self.rows.iter().map(object).collect()
    }

    /// As HTML, under its heading.
    pub(crate) fn html(&self) -> String {
        let mut html = String::from("<div class=\"scroll\"><table><thead><tr>");
        for (at, (title, _)) in self.columns.iter().enumerate() {
            let has_words = self.rows.iter().any(|row| matches!(row[at], Cell::Text(_)));
            let class = if has_words { " class=\"words\"" } else { "" };
            let _ = write!(html, "<th{class}>{}", escaped(title));
        }
        html.push_str("<tbody>");
        for row in &self.rows {
            html.push_str("<tr>");
            for (at, cell) in row.iter().enumerate() {
                let tag = match cell {
                    _ if at == 0 => "th",
                    Cell::Text(_) => "td class=\"words\"",
                    _ => "td",
                };
                let _ = write!(html, "<{tag}>{}", escaped(&cell.shown()));
            }
        }
        html.push_str("</table></div>");
        if self.printed {
            return format!("<h3>{}</h3>{html}", escaped(self.title));
        }
        format!("<details><summary>{}</summary>{html}</details>", escaped(self.title))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table =
            Table::new("speed", "Speed", &[("scene", "scene"), ("time, ms", "milliseconds")]);
        table.push(vec![Cell::text("a \"b\", <c>"), Cell::number(0.012345)]);
        table.push(vec![Cell::text("d"), Cell::Number(f64::NAN, FEW_SAMPLES)]);
        table.push(vec![Cell::Nothing, Cell::Count(7)]);
        table
    }

    #[test]
    fn markdown_has_even_columns_and_marks_few_samples() {
        let text = table().markdown();
        let widths: Vec<usize> = text.lines().map(|line| line.chars().count()).collect();
        assert!(widths.iter().all(|&width| width == widths[0]), "{text}");
        assert!(text.contains("| 0.0123 ") && text.contains("| NaN* "), "{text}");
    }

    #[test]
    fn files_hold_all_digits_and_no_number_where_there_is_none() {
        let csv = "scene,milliseconds\n\"a \"\"b\"\", <c>\",1.2345e-2\n\"d\",\n,7\n";
        assert_eq!(table().csv(), csv);
        let json = table().json();
        assert_eq!(json[0]["milliseconds"], 0.012345);
        assert!(json[1]["milliseconds"].is_null() && json[2]["scene"].is_null());
        assert_eq!(json[2]["milliseconds"], 7);
    }

    #[test]
    fn words_cannot_break_the_page() {
        assert!(table().html().contains("a &quot;b&quot;, &lt;c&gt;"));
    }
}
