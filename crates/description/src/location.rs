//! Locations in files, for messages.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

/// The most characters of a path or a message: both may have names that are as long as a file likes.
const LONGEST: usize = 1000;

/// A text without its middle where it is long: messages begin with what they are about, and end with a rule.
pub fn shortened(text: &str) -> Cow<'_, str> {
    let count = text.chars().count();
    if count <= LONGEST {
        return Cow::Borrowed(text);
    }
    let end = |index: usize| text.char_indices().nth(index).map_or(text.len(), |(end, _)| end);
    let (begin, rest) = (&text[..end(LONGEST / 2)], &text[end(count - LONGEST / 2)..]);
    Cow::Owned(format!("{begin} ... {rest}"))
}

/// A path in a message.
pub fn shortened_path(path: &Path) -> String {
    shortened(&path.display().to_string()).into_owned()
}

/// A location in a file: the file, and where that is known a line and a column, both from 1 on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The file.
    pub path: PathBuf,
    /// The line.
    pub line: Option<usize>,
    /// The column, in characters.
    pub column: Option<usize>,
}

impl Location {
    /// All of a file.
    pub fn new(path: impl AsRef<Path>) -> Self {
        Self { path: path.as_ref().to_owned(), line: None, column: None }
    }

    /// A line of a file.
    pub fn line(path: impl AsRef<Path>, line: usize) -> Self {
        Self { line: Some(line), ..Self::new(path) }
    }

    /// Where a byte of the text of the file `path` stands.
    pub fn from_byte(text: &str, path: &Path, byte: usize) -> Self {
        let before = &text.as_bytes()[..byte.min(text.len())];
        let line = before.iter().filter(|&&letter| letter == b'\n').count() + 1;
        let start = before.iter().rposition(|&letter| letter == b'\n').map_or(0, |end| end + 1);
        let column = String::from_utf8_lossy(&before[start..]).chars().count() + 1;
        Self { path: path.to_owned(), line: Some(line), column: Some(column) }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", shortened_path(&self.path))?;
        let numbers = [self.line, self.column].into_iter().map_while(|number| number);
        numbers.into_iter().try_for_each(|number| write!(f, ":{number}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_long_texts_lose_their_middle() {
        let whole = "ä".repeat(LONGEST);
        assert_eq!(shortened(&whole), whole);
        let long = format!("a {whole} z");
        let short = shortened(&long);
        assert!(short.starts_with("a ä") && short.contains("ä ... ä") && short.ends_with("ä z"));
        assert_eq!(short.chars().count(), LONGEST + 5);
    }

    #[test]
    fn a_byte_has_a_line_and_a_column_of_characters() {
        let shown = |byte| Location::from_byte("ab\näöc\n", Path::new("a.toml"), byte).to_string();
        assert_eq!([0, 1, 3].map(shown), ["a.toml:1:1", "a.toml:1:2", "a.toml:2:1"]);
        // Each of the two letters has two bytes.
        assert_eq!([7, 9, 99].map(shown), ["a.toml:2:3", "a.toml:3:1", "a.toml:3:1"]);
        assert_eq!(Location::line("a.toml", 7).to_string(), "a.toml:7");
    }
}
