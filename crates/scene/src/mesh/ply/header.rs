//! The header of a PLY file, checked against what follows it before memory is taken.

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType};

use crate::error::SceneError;
use crate::mesh::beside::Beside;
use crate::mesh::notes::name;

/// So many characters of a library's message are kept: it has names that are as long as a file likes.
const LONGEST_MESSAGE: usize = 200;

/// The longest header that is read, in bytes.
const LONGEST_HEADER: usize = 1 << 20;

/// A file whose header was read.
#[derive(Debug)]
pub(super) struct Opened<'b> {
    pub(super) header: Header,
    /// The bytes after the header that were not read yet.
    pub(super) left: &'b [u8],
    /// The number of the line that was read last, in an ascii file.
    pub(super) line: usize,
}

impl<'b> Opened<'b> {
    pub(super) fn new(bytes: &'b [u8], beside: &Beside<'_>) -> Result<Self, SceneError> {
        let refused = |found: String| SceneError::content(beside.place(), found);
        if !bytes.starts_with(b"ply") {
            return Err(refused(
                "a PLY file begins with the line ply, and this does not".to_owned(),
            ));
        }
        let mut end = 0;
        let mut lines = 0;
        let mut promised = [0_usize; 2];
        loop {
            let left = &bytes[end..bytes.len().min(LONGEST_HEADER)];
            let Some(length) = left.iter().position(|&byte| byte == b'\n') else {
                let rule = "a header ends with the line end_header";
                return Err(refused(format!("{rule}, and {end} bytes of lines have none")));
            };
            let line = left[..length].trim_ascii();
            end += length + 1;
            lines += 1;
            promised[0] += usize::from(line.starts_with(b"element"));
            promised[1] += usize::from(line.starts_with(b"property"));
            if line == b"end_header" {
                break;
            }
        }
        // Comments are in any encoding.
        let text = String::from_utf8_lossy(&bytes[..end]);
        let header = Parser::<DefaultElement>::new().read_header(&mut Reader::new(text.as_bytes()));
        let header = header.map_err(|error| match error.line() {
            Some(line) => {
                let found = unknown(&text, line).unwrap_or_else(|| {
                    format!("a header has the lines of the format: {}", message(&error))
                });
                SceneError::content(beside.line(line), found)
            }
            None => refused(message(&error)),
        })?;
        let properties = |element: &ElementDef| element.properties.len();
        let found = [header.elements.len(), header.elements.values().map(properties).sum()];
        // The library keeps the last of two that are called the same, with the rows of both to read.
        if found != promised {
            let rule = "elements have different names, and so have the properties of an element";
            return Err(refused(format!("{rule}, and some of this header are the same")));
        }
        let opened = Self { header, left: &bytes[end..], line: lines };
        opened.check_counts(beside)?;
        Ok(opened)
    }

    /// Refuses counts of rows that can't be in the bytes that follow.
    fn check_counts(&self, beside: &Beside<'_>) -> Result<(), SceneError> {
        let is_ascii = self.header.encoding == Encoding::Ascii;
        let mut needed = 0_u64;
        for ElementDef { name, count, properties } in self.header.elements.values() {
            let least: u64 = match is_ascii {
                // A digit and what separates it from the next.
                true => 2 * properties.len() as u64,
                false => properties.values().map(|property| least_bytes(&property.data_type)).sum(),
            };
            if least == 0 && *count > 0 {
                let found = format!("{name:?} has {count} rows of none");
                let rule = "an element has properties";
                return Err(SceneError::content(beside.place(), format!("{rule}, and {found}")));
            }
            needed = needed.saturating_add((*count as u64).saturating_mul(least));
        }
        // The last line of an ascii file may have no end.
        let left = self.left.len() as u64 + u64::from(is_ascii);
        if needed > left {
            let found = format!("need {needed} bytes, and {} follow the header", self.left.len());
            let found = format!("the elements' rows {found}");
            return Err(SceneError::content(beside.place(), found));
        }
        Ok(())
    }

    /// The next line that says something: the empty one after the last where there is none.
    pub(super) fn next_line(&mut self) -> &'b [u8] {
        loop {
            let end = self.left.iter().position(|&byte| byte == b'\n');
            let (line, left) = match end {
                Some(end) => (&self.left[..end], &self.left[end + 1..]),
                None => (self.left, &[][..]),
            };
            self.left = left;
            self.line += 1;
            let line = line.trim_ascii();
            if !line.is_empty() || left.is_empty() {
                return line;
            }
        }
    }
}

/// What is wrong with a line of a header that begins with none of the format's words.
fn unknown(header: &str, line: usize) -> Option<String> {
    const KEYWORDS: [&str; 7] =
        ["ply", "format", "comment", "obj_info", "element", "property", "end_header"];
    let first = header.lines().nth(line.checked_sub(1)?)?.split_whitespace().next()?;
    let rule = format!("a line of a header begins with {}", KEYWORDS.join(", "));
    let is_unknown = !KEYWORDS.contains(&first);
    is_unknown.then(|| format!("{rule}, and this begins with {:?}", name(first)))
}

/// The least bytes that a property has in a row of a binary file: a list may be empty.
fn least_bytes(property: &PropertyType) -> u64 {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = property;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// What the library says, without the line's number, which the place has, and the line itself.
pub(super) fn message(error: &ParseError) -> String {
    let text = error.to_string();
    let text = text.lines().next().unwrap_or_default();
    let text = match error.line().and_then(|line| text.strip_prefix(&format!("Line {line}: "))) {
        Some(rest) => rest,
        None => text,
    };
    text.chars().take(LONGEST_MESSAGE).collect()
}
