//! What a reader left out or mended, in words.

use std::collections::HashMap;

/// So many different notes are kept: a file could give each of its materials a note.
const MOST_NOTES: usize = 100;
/// So many bytes of them are kept: names of a file are as long as it likes.
const MOST_BYTES: usize = 48 << 10;
/// Names of a file are cut to so many characters: a name is repeated for each part of a mesh.
const LONGEST_NAME: usize = 256;
/// So many names are listed in a note.
const MOST_NAMES: usize = 20;

/// Notes, each once with how often it was made.
#[derive(Debug, Default)]
pub(super) struct Notes {
    texts: Vec<(String, usize)>,
    numbers: HashMap<String, usize>,
    /// How many bytes the texts have.
    bytes: usize,
    further: usize,
}

impl Notes {
    /// Adds a note.
    pub(super) fn add(&mut self, text: impl Into<String>) {
        self.count(text, 1);
    }

    /// Adds a note for each of `times` occasions.
    pub(super) fn count(&mut self, text: impl Into<String>, times: usize) {
        let text = text.into();
        if times == 0 {
            return;
        }
        if let Some(&number) = self.numbers.get(&text) {
            self.texts[number].1 += times;
        } else if self.texts.len() < MOST_NOTES && self.bytes + text.len() <= MOST_BYTES {
            self.bytes += text.len();
            self.numbers.insert(text.clone(), self.texts.len());
            self.texts.push((text, times));
        } else {
            self.further += 1;
        }
    }

    /// The notes, in the order in which each was made first.
    pub(super) fn finish(self) -> Vec<String> {
        let text = |(text, times): (String, usize)| match times {
            1 => text,
            _ => format!("{text} ({times} times)"),
        };
        let mut notes: Vec<String> = self.texts.into_iter().map(text).collect();
        if self.further > 0 {
            notes.push(format!("there are {} further notes", self.further));
        }
        notes
    }
}

/// That what has these names was left out: `the statements "a" and "b" of a material were left out`.
pub(super) fn left_out(what: [&str; 2], names: &[&str], whose: &str) -> String {
    let quoted: Vec<String> = names.iter().take(MOST_NAMES).map(|name| quoted(name)).collect();
    let more = match names.len() - quoted.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let [one, many] = what;
    let (what, verb) = if names.len() == 1 { (one, "was") } else { (many, "were") };
    format!("the {what} {}{more}{whose} {verb} left out", quoted.join(", "))
}

/// A name of a file, without space around it, and cut where it is very long.
pub(super) fn name(text: &str) -> String {
    let text = text.trim();
    let end = text.char_indices().nth(LONGEST_NAME).map_or(text.len(), |(end, _)| end);
    // A cut may leave space at the end.
    text[..end].trim_end().to_owned()
}

/// A name of a file as notes have it.
pub(super) fn quoted(text: &str) -> String {
    format!("{:?}", name(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_name_is_itself() {
        let long = "ä".repeat(LONGEST_NAME);
        let spaced = format!(" {} b", "a".repeat(LONGEST_NAME - 1));
        let names = [
            ("", ""),
            (" a b\n", "a b"),
            (&long, &*long),
            (&spaced, spaced[1..LONGEST_NAME].trim()),
        ];
        for (text, expected) in names {
            assert_eq!(name(text), expected);
            assert_eq!(name(&name(text)), expected);
        }
        assert_eq!(name(&format!("{long}c")), long);
    }
}
