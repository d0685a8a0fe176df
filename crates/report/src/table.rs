//! Tables: as Markdown for people, as CSV for programs, as HTML for a page.

use std::fmt::Write as _;

use crate::digits::{digits, plain};
use crate::markup::{escaped, folded};
use crate::quartiles::quartiles;

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// An entry that stands out as what is shown here is about.
    Strong(Box<Cell>),
    /// An entry that stands out as something gone wrong.
    Flagged(Box<Cell>),
    /// A whole number.
    Count(usize),
    /// A number with its mark for people: three digits of it, then the mark.
    Number(f64, &'static str),
    /// A number without an exponent for people: a time.
    Time(f64),
    /// What does not apply or was not measured.
    Nothing,
}

impl Cell {
    /// Words.
    pub fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    /// A number without a mark.
    pub fn number(number: f64) -> Self {
        Self::Number(number, "")
    }

    /// The number, or nothing.
    pub fn maybe(number: Option<f64>) -> Self {
        number.map_or(Self::Nothing, Self::number)
    }

    /// The time, or nothing.
    pub fn maybe_time(number: Option<f64>) -> Self {
        number.map_or(Self::Nothing, Self::Time)
    }

    /// So many of all.
    pub fn part([some, all]: [usize; 2]) -> Self {
        Self::text(format!("{some} of {all}"))
    }

    /// The median, where it is a number: nothing where half of them or more are infinite.
    pub fn median(numbers: impl Iterator<Item = f64>) -> Self {
        Self::maybe(Some(quartiles(numbers)[1]).filter(|median| median.is_finite()))
    }

    /// The same, made to stand out as what is shown here is about.
    #[must_use]
    pub fn strong(self) -> Self {
        Self::Strong(Box::new(self))
    }

    /// The same, made to stand out as something gone wrong.
    #[must_use]
    pub fn flagged(self) -> Self {
        Self::Flagged(Box::new(self))
    }

    /// As people read it.
    fn shown(&self) -> String {
        match self {
            Self::Text(words) => words.clone(),
            Self::Strong(cell) | Self::Flagged(cell) => cell.shown(),
            Self::Count(count) => count.to_string(),
            Self::Number(number, mark) => digits(Some(*number)) + mark,
            Self::Time(number) => plain(Some(*number)),
            Self::Nothing => "–".to_owned(),
        }
    }

    /// As programs read it: numbers so that reading them gives the same bits.
    fn field(&self) -> String {
        match self {
            Self::Text(words) => match words.contains(['"', ',', '\n', '\r']) {
                true => format!("\"{}\"", words.replace('"', "\"\"")),
                false => words.clone(),
            },
            Self::Strong(cell) | Self::Flagged(cell) => cell.field(),
            Self::Count(count) => count.to_string(),
            Self::Number(number, _) | Self::Time(number) if number.is_finite() => {
                format!("{number:e}")
            }
            Self::Number(..) | Self::Time(_) | Self::Nothing => String::new(),
        }
    }

    /// As an element of a row, its first or not, over so many columns.
    fn html(&self, is_first: bool, columns: usize) -> String {
        let class = match self {
            Self::Text(_) => " class=\"words\"",
            Self::Strong(_) => " class=\"strong\"",
            _ => "",
        };
        let tag = if is_first { "th" } else { "td" };
        let span = if columns > 1 { format!(" colspan={columns}") } else { String::new() };
        let shown = escaped(&self.shown()).replace('\n', "<br>");
        match self {
            Self::Flagged(_) if !shown.is_empty() => {
                format!("<{tag}{span}><span class=\"stuck\">{shown}</span>")
            }
            _ => format!("<{tag}{class}{span}>{shown}"),
        }
    }
}

/// A column: its name for people, its name for programs.
pub type Column = (&'static str, &'static str);

/// A table. A row has an entry per column; in a row of fewer the last one spans those that are left.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// The name of its CSV file, without the ending; a table without a name has no file.
    pub name: &'static str,
    /// The heading for people; without one it stands under the section's.
    pub title: String,
    /// Its columns.
    pub columns: Vec<Column>,
    /// Its rows.
    pub rows: Vec<Vec<Cell>>,
    /// Whether people get to see it in print, and unfolded: long lists are for the files and the page.
    pub is_printed: bool,
    /// Headings over several columns, in their order, each with a number of columns; one without words
    /// has no heading of its own.
    groups: Vec<(&'static str, usize)>,
    /// Headings within the table, each with the row that it stands before.
    parts: Vec<(usize, String)>,
    /// Whether cells are sentences: they begin at the left, and lines are broken.
    has_sentences: bool,
}

impl Table {
    /// A table without rows.
    pub fn new(name: &'static str, title: impl Into<String>, columns: &[Column]) -> Self {
        let (title, columns) = (title.into(), columns.to_vec());
        Self { name, title, columns, is_printed: true, ..Self::default() }
    }

    /// The same, for files and the page alone.
    #[must_use]
    pub fn not_printed(self) -> Self {
        Self { is_printed: false, ..self }
    }

    /// The same of sentences.
    #[must_use]
    pub fn with_sentences(self) -> Self {
        Self { has_sentences: true, ..self }
    }

    /// The same with headings over several columns: see [`Table`]. The numbers of columns sum up to all.
    #[must_use]
    pub fn with_groups(self, groups: &[(&'static str, usize)]) -> Self {
        debug_assert_eq!(groups.iter().map(|group| group.1).sum::<usize>(), self.columns.len());
        Self { groups: groups.to_vec(), ..self }
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<Cell>) {
        debug_assert!((1..=self.columns.len()).contains(&row.len()), "a row of {}", self.name);
        self.rows.push(row);
    }

    /// Adds a heading over the rows that follow.
    pub fn push_part(&mut self, heading: impl Into<String>) {
        self.parts.push((self.rows.len(), heading.into()));
    }

    /// As Markdown, columns of even width.
    pub fn markdown(&self) -> String {
        let head = self.columns.iter().map(|(title, _)| (*title).to_owned()).collect();
        // What would end a cell or a row.
        let cell = |cell: &Cell| cell.shown().replace('|', "\\|").replace(['\n', '\r'], " ");
        let shown = self.rows.iter().map(|row| row.iter().map(cell).collect());
        let lines: Vec<Vec<String>> = std::iter::once(head).chain(shown).collect();
        let width = |column: usize| {
            let cells = lines.iter().filter_map(|line: &Vec<String>| line.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0).max(3)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let mut text = String::new();
        for (index, line) in lines.iter().enumerate() {
            for (column, &width) in widths.iter().enumerate() {
                let cell = line.get(column).map_or("", String::as_str);
                // Writing to a string cannot fail.
                let _ = write!(text, "| {cell:width$} ");
            }
            text.push_str("|\n");
            if index == 0 {
                widths.iter().for_each(|&width| {
                    let _ = write!(text, "|{}", "-".repeat(width + 2));
                });
                text.push_str("|\n");
            }
        }
        text
    }

    /// As CSV, with the names for programs as its head.
    pub fn csv(&self) -> String {
        let head: Vec<&str> = self.columns.iter().map(|(_, key)| *key).collect();
        let mut text = head.join(",") + "\n";
        for row in &self.rows {
            let mut fields: Vec<String> = row.iter().map(Cell::field).collect();
            fields.resize(self.columns.len(), String::new());
            text.push_str(&(fields.join(",") + "\n"));
        }
        text
    }

    /// As HTML, under its heading.
    pub(crate) fn html(&self) -> String {
        let class = if self.has_sentences { " class=\"sentences\"" } else { "" };
        let mut html = format!("<div class=\"scroll\"><table{class}>{}<tbody>", self.head());
        let mut parts = self.parts.iter().peekable();
        for (number, row) in self.rows.iter().enumerate() {
            while let Some((_, heading)) = parts.next_if(|part| part.0 == number) {
                let (columns, heading) = (self.columns.len(), escaped(heading));
                let _ = write!(html, "<tr class=\"part\"><th colspan={columns}>{heading}");
            }
            html.push_str("<tr>");
            for (index, cell) in row.iter().enumerate() {
                let is_last = index + 1 == row.len();
                let columns = if is_last { self.columns.len() - index } else { 1 };
                html.push_str(&cell.html(index == 0, columns));
            }
        }
        html.push_str("</table></div>");
        match (&*self.title, self.is_printed) {
            ("", _) => html,
            (title, true) => format!("<h3>{}</h3>{html}", escaped(title)),
            (title, false) => folded(title, &html),
        }
    }

    /// The names of the columns as rows of HTML; nothing where none has one.
    fn head(&self) -> String {
        if self.columns.iter().all(|(title, _)| title.is_empty()) {
            return String::new();
        }
        let (mut first, mut second) = (String::new(), String::new());
        let no_groups = [("", self.columns.len())];
        let groups = if self.groups.is_empty() { &no_groups[..] } else { &self.groups };
        let mut columns = self.columns.iter().enumerate();
        for &(heading, count) in groups {
            if !heading.is_empty() {
                let _ = write!(first, "<th colspan={count}>{}", escaped(heading));
            }
            for (index, (title, _)) in columns.by_ref().take(count) {
                let is_of_words = |row: &Vec<Cell>| matches!(row.get(index), Some(Cell::Text(_)));
                let has_words = self.rows.iter().any(is_of_words);
                let class = if has_words { " class=\"words\"" } else { "" };
                let title = escaped(title);
                let _ = match heading.is_empty() {
                    true if self.groups.is_empty() => write!(first, "<th{class}>{title}"),
                    true => write!(first, "<th{class} rowspan=2>{title}"),
                    false => write!(second, "<th{class}>{title}"),
                };
            }
        }
        let second = if second.is_empty() { second } else { format!("<tr>{second}") };
        format!("<thead><tr>{first}{second}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let columns = [("scene", "scene"), ("time, ms", "milliseconds"), ("error", "error")];
        let mut table = Table::new("speed", "Speed", &columns);
        table.push(vec![Cell::text("a \"b\", <c>"), Cell::number(0.012345), Cell::Time(0.0012)]);
        table.push(vec![Cell::text("d"), Cell::Number(f64::NAN, "*"), Cell::Nothing]);
        table.push_part("<part>");
        table.push(vec![Cell::Nothing, Cell::Count(7), Cell::number(1.2345e-5).flagged()]);
        table.push(vec![Cell::text("e"), Cell::text("no < yes").flagged()]);
        table.push(vec![Cell::text("f"), Cell::Time(0.98765).strong(), Cell::Nothing.strong()]);
        table
    }

    #[test]
    fn markdown_has_even_columns_and_the_marks_of_numbers() {
        let text = table().markdown();
        let widths: Vec<usize> = text.lines().map(|line| line.chars().count()).collect();
        assert!(widths.iter().all(|&width| width == widths[0]), "{text}");
        assert!(text.contains("| 0.0123 ") && text.contains("| NaN* "), "{text}");
        assert!(text.contains("| 0.0012 ") && text.contains("| 1.2e-5 "), "{text}");
    }

    #[test]
    fn files_hold_all_digits_and_no_number_where_there_is_none() {
        let csv = "scene,milliseconds,error\n\"a \"\"b\"\", <c>\",1.2345e-2,1.2e-3\nd,,\n,7,1.2345e-5\ne,no < yes,\n\
            f,9.8765e-1,\n";
        assert_eq!(table().csv(), csv);
    }

    #[test]
    fn words_cannot_break_the_page_and_a_short_row_spans_all_columns() {
        let html = table().html();
        assert!(html.starts_with("<h3>Speed</h3>") && html.contains("a &quot;b&quot;, &lt;c&gt;"));
        assert!(html.contains("<tr class=\"part\"><th colspan=3>&lt;part&gt;<tr><th>–<td>7"));
        assert!(html.contains("<td colspan=2><span class=\"stuck\">no &lt; yes</span>"));
        let folded = table().not_printed().html();
        assert!(folded.starts_with("<details><summary>Speed</summary>"));
    }

    #[test]
    fn groups_stand_over_their_columns() {
        let table = table().with_groups(&[("", 1), ("a & b", 2)]);
        let head = "<thead><tr><th class=\"words\" rowspan=2>scene<th colspan=2>a &amp; b\
            <tr><th>time, ms<th>error<tbody>";
        assert!(table.html().contains(head), "{}", table.html());
    }
}
