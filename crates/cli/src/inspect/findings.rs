//! Facts about a file, in sections, and what is wrong with it.

use std::fmt::{self, Display, Write as _};
use std::path::Path;

use serde_json::{Map, Value, json};

use crate::failure::one_line;

/// Labels take so many columns.
const LABEL: usize = 12;
/// Problems of a kind that are told; the others are counted. JSON has all.
const MOST_OF_A_KIND: usize = 10;

/// A mesh, a material, a stage, or the whole file.
#[derive(Debug, Default)]
pub(super) struct Section {
    title: String,
    /// The label, the text, and what JSON has under the label. What has no text is for JSON alone.
    facts: Vec<(String, String, Value)>,
}

/// Where JSON has a section.
#[derive(Debug, Clone, Copy)]
enum Home {
    /// In the object of the file itself.
    File,
    /// In a list of such sections.
    List(&'static str),
    /// Under a name, alone.
    Name(&'static str),
}

impl Section {
    pub(super) fn new(title: impl Display) -> Self {
        Self { title: title.to_string(), facts: Vec::new() }
    }

    /// Adds a fact, in words and for JSON.
    pub(super) fn fact(
        &mut self,
        label: impl Into<String>,
        text: impl Display,
        value: impl Into<Value>,
    ) -> &mut Self {
        self.facts.push((label.into(), text.to_string(), value.into()));
        self
    }

    /// Adds a fact for JSON alone.
    pub(super) fn silent(&mut self, label: impl Into<String>, value: impl Into<Value>) {
        self.facts.push((label.into(), String::new(), value.into()));
    }

    /// Adds a fact that is the same in words and for JSON.
    pub(super) fn plain<T: Display + Clone + Into<Value>>(
        &mut self,
        label: impl Into<String>,
        value: T,
    ) -> &mut Self {
        self.fact(label, value.clone(), value)
    }
}

/// All that is found.
#[derive(Debug)]
pub(super) struct Findings {
    /// What kind of file it is: "a mesh".
    kind: &'static str,
    sections: Vec<(Home, Section)>,
    notes: Vec<String>,
    /// By kinds.
    problems: Vec<Vec<String>>,
}

impl Findings {
    pub(super) fn new(kind: &'static str) -> Self {
        Self { kind, sections: Vec::new(), notes: Vec::new(), problems: Vec::new() }
    }

    /// Adds what is said of the whole file.
    pub(super) fn whole(&mut self, section: Section) {
        self.sections.push((Home::File, section));
    }

    /// Adds what is said of a part, one of a list that JSON has under this name.
    pub(super) fn part(&mut self, list: &'static str, section: Section) {
        self.sections.push((Home::List(list), section));
    }

    /// Adds what JSON has under this name.
    pub(super) fn named(&mut self, name: &'static str, section: Section) {
        self.sections.push((Home::Name(name), section));
    }

    /// Adds what is neither right nor wrong.
    pub(super) fn note(&mut self, note: impl Display) {
        self.notes.push(one_line(&note.to_string()));
    }

    /// Adds a problem.
    pub(super) fn problem(&mut self, problem: impl Display) {
        self.all_of_a_kind([problem.to_string()]);
    }

    /// Adds problems of one kind.
    pub(super) fn all_of_a_kind(&mut self, problems: impl IntoIterator<Item = String>) {
        let problems: Vec<_> = problems.into_iter().map(|problem| one_line(&problem)).collect();
        if !problems.is_empty() {
            self.problems.push(problems);
        }
    }

    /// How many problems there are.
    pub(super) fn problems(&self) -> usize {
        self.problems.iter().map(Vec::len).sum()
    }

    /// One fact a line.
    pub(super) fn text(&self, file: &Path) -> String {
        let mut text = format!("{}: {}\n", file.display(), self.kind);
        // Strings take all that is written to them.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> fmt::Result {
        for (_, section) in &self.sections {
            if !section.title.is_empty() {
                writeln!(text, "\n{}", one_line(&section.title))?;
            }
            for (label, words, _) in section.facts.iter().filter(|(_, words, _)| !words.is_empty())
            {
                writeln!(text, "  {label:LABEL$}  {}", one_line(words))?;
            }
        }
        if !self.notes.is_empty() || !self.problems.is_empty() {
            text.push('\n');
        }
        for note in &self.notes {
            writeln!(text, "note: {note}")?;
        }
        for kind in &self.problems {
            for problem in kind.iter().take(MOST_OF_A_KIND) {
                writeln!(text, "problem: {problem}")?;
            }
            let further = kind.len().saturating_sub(MOST_OF_A_KIND);
            if further > 0 {
                writeln!(text, "problem: and {further} more of this kind")?;
            }
        }
        Ok(())
    }

    /// An object with all that [`Findings::text`] says, in numbers.
    pub(super) fn json(&self, file: &Path) -> String {
        let mut all = Map::new();
        let kind = self.kind.split_once(' ').map_or(self.kind, |(_, kind)| kind);
        all.insert("file".to_owned(), json!(file.display().to_string()));
        all.insert("kind".to_owned(), json!(kind));
        for (home, section) in &self.sections {
            let facts = section.facts.iter();
            let facts = facts.map(|(label, _, value)| (label.clone(), value.clone()));
            // What stands beside other keys is a key.
            let keys = facts.clone().map(|(label, value)| (label.replace(' ', "_"), value));
            match home {
                Home::File => all.extend(keys),
                Home::Name(name) => {
                    all.insert((*name).to_owned(), Value::Object(facts.collect()));
                }
                Home::List(list) => {
                    let list = all.entry(*list).or_insert_with(|| json!([]));
                    if let Value::Array(list) = list {
                        list.push(Value::Object(keys.collect()));
                    }
                }
            }
        }
        all.insert("notes".to_owned(), json!(self.notes));
        let problems: Vec<_> = self.problems.iter().flatten().collect();
        all.insert("problems".to_owned(), json!(problems));
        Value::Object(all).to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_of_a_kind_are_told_up_to_a_number_and_counted_in_all() {
        let mut findings = Findings::new("a thing");
        findings.all_of_a_kind((0..13).map(|k| format!("wrong\n{k}")));
        findings.problem("other");
        let text = findings.text(Path::new("a"));
        assert_eq!(text.matches("\nproblem: wrong").count(), 10, "{text}");
        assert!(text.contains("\nproblem: and 3 more of this kind\nproblem: other\n"), "{text}");
        assert_eq!(findings.problems(), 14);
        let json: Value = serde_json::from_str(&findings.json(Path::new("a"))).unwrap();
        assert_eq!(json["problems"].as_array().unwrap().len(), 14);
        assert_eq!(json["kind"], "thing");
    }
}
