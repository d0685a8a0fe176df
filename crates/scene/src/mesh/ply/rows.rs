//! Rows of a PLY file as numbers, and which property is which of them.

use std::str;

use super::header::{Element, Encoding, Header, Number, Property};
use crate::error::{Location, SceneError};
use crate::mesh::colors::Written;
use crate::mesh::context::MeshContext;
use crate::mesh::notes::{left_out, name};

/// The names of colours.
const COLORS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// The numbers of a row, those of each property after those of the one before.
#[derive(Debug, Default)]
pub(super) struct Row {
    numbers: Vec<f64>,
    /// For each property where its numbers end.
    ends: Vec<usize>,
}

impl Row {
    /// The numbers of the property with this number.
    pub(super) fn list(&self, property: usize) -> &[f64] {
        let begin = if property == 0 { 0 } else { self.ends[property - 1] };
        &self.numbers[begin..self.ends[property]]
    }

    /// The numbers of properties that are no lists.
    pub(super) fn scalars<const N: usize>(&self, properties: [usize; N]) -> [f64; N] {
        properties.map(|property| self.list(property)[0])
    }
}

/// The properties of an element, and which of them somebody reads.
#[derive(Debug)]
pub(super) struct Named<'e> {
    element: &'e Element,
    is_read: Vec<bool>,
}

impl<'e> Named<'e> {
    pub(super) fn new(element: &'e Element) -> Self {
        Self { element, is_read: vec![false; element.properties.len()] }
    }

    fn find(&self, is_list: bool, sought: &str) -> Option<usize> {
        let is_it =
            |property: &Property| property.length.is_some() == is_list && property.name == sought;
        self.element.properties.iter().position(is_it)
    }

    /// The list with the first of these names that there is.
    pub(super) fn list(&mut self, names: &[&str]) -> Option<usize> {
        let property = names.iter().find_map(|name| self.find(true, name))?;
        self.is_read[property] = true;
        Some(property)
    }

    /// The numbers with the first of these sets of names that is there as a whole.
    pub(super) fn scalars<const N: usize>(&mut self, sets: &[[&str; N]]) -> Option<[usize; N]> {
        let properties = sets.iter().find_map(|names| {
            let properties = names.map(|names| self.find(false, names));
            properties
                .iter()
                .all(Option::is_some)
                .then(|| properties.map(Option::unwrap_or_default))
        })?;
        properties.iter().for_each(|&property| self.is_read[property] = true);
        Some(properties)
    }

    /// Colours, and how they are written; nothing where their types differ, which is noted.
    pub(super) fn colors(
        &mut self,
        context: &mut MeshContext<'_>,
    ) -> Option<([usize; 3], Written)> {
        let properties = self.scalars(&COLORS)?;
        let written = properties.map(|property| match self.number(property) {
            Number::I8 | Number::U8 => Written::Bytes,
            number if number.range().is_some() => Written::Whole,
            _ => Written::Fractions,
        });
        if written[0] != written[1] || written[1] != written[2] {
            context.notes.add("colours were left out: red, green and blue differ in type");
            return None;
        }
        Some((properties, written[0]))
    }

    /// The type of a property.
    pub(super) fn number(&self, property: usize) -> Number {
        self.element.properties[property].number
    }

    /// Notes which properties nobody reads.
    pub(super) fn note_others(self, context: &mut MeshContext<'_>) {
        let all = self.element.properties.iter().zip(self.is_read);
        let others: Vec<&str> = all
            .filter(|(_, is_read)| !is_read)
            .map(|(property, _)| property.name.as_str())
            .collect();
        if !others.is_empty() {
            let whose = format!(" of the element {:?}", name(&self.element.name));
            context.notes.add(left_out(["property", "properties"], &others, &whose));
        }
    }
}

/// The rows of a file that were not read yet.
#[derive(Debug)]
pub(super) struct Rows<'b> {
    encoding: Encoding,
    left: &'b [u8],
    /// The number of the line that was read last.
    line: usize,
}

impl<'b> Rows<'b> {
    /// Those after a header.
    pub(super) fn after(header: &Header, bytes: &'b [u8]) -> Self {
        Self { encoding: header.encoding, left: &bytes[header.bytes..], line: header.lines }
    }

    /// Gives each row of an element, which are the next in the file, to `take` with its number.
    pub(super) fn read(
        &mut self,
        element: &Element,
        context: &MeshContext<'_>,
        mut take: impl FnMut(&Row, usize) -> Result<(), String>,
    ) -> Result<(), SceneError> {
        let mut row = Row::default();
        for number in 0..element.count {
            row.numbers.clear();
            row.ends.clear();
            let read = self.row(element, &mut row);
            let kind = || format!("{} {number}", name(&element.name));
            read.map_err(|message| format!("{} {message}", kind()))
                .and_then(|()| take(&row, number))
                .map_err(|message| SceneError::content(self.location(context), message))?;
        }
        Ok(())
    }

    fn location(&self, context: &MeshContext<'_>) -> Location {
        match self.encoding {
            Encoding::Ascii => context.line(self.line),
            _ => context.location(),
        }
    }

    /// Reads a row; an error is what the row has and should not.
    fn row(&mut self, element: &Element, row: &mut Row) -> Result<(), String> {
        let mut words = match self.encoding {
            Encoding::Ascii => {
                let line = self.next_line();
                Some(line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()))
            }
            _ => None,
        };
        for property in &element.properties {
            let mut next = |number: Number| match &mut words {
                Some(words) => words
                    .next()
                    .ok_or_else(|| {
                        format!("has the property {:?}, and the line ends", name(&property.name))
                    })
                    .and_then(|word| parse_number(word, number, &property.name)),
                None => self.binary(number).ok_or_else(|| {
                    format!("has the property {:?}, and the file ends", name(&property.name))
                }),
            };
            let count = match property.length {
                None => 1.0,
                Some(length) => next(length)?,
            };
            if count < 0.0 {
                return Err(format!("has a list of a length from 0 on, and this is {count}"));
            }
            // Each number has bytes of its own, so that a long list meets the end.
            for _ in 0..count as u64 {
                let number = next(property.number)?;
                row.numbers.push(number);
            }
            row.ends.push(row.numbers.len());
        }
        match words.and_then(|mut words| words.next()) {
            Some(word) => {
                let word = name(&String::from_utf8_lossy(word));
                Err(format!("has the properties of the header, and {word:?} follows them"))
            }
            None => Ok(()),
        }
    }

    fn binary(&mut self, number: Number) -> Option<f64> {
        let (bytes, left) = self.left.split_at_checked(number.bytes())?;
        self.left = left;
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if self.encoding == Encoding::BigEndian {
            little[..bytes.len()].reverse();
        }
        let [a, b, c, d, ..] = little;
        Some(match number {
            Number::I8 => i8::from_le_bytes([a]).into(),
            Number::U8 => a.into(),
            Number::I16 => i16::from_le_bytes([a, b]).into(),
            Number::U16 => u16::from_le_bytes([a, b]).into(),
            Number::I32 => i32::from_le_bytes([a, b, c, d]).into(),
            Number::U32 => u32::from_le_bytes([a, b, c, d]).into(),
            Number::F32 => f32::from_le_bytes([a, b, c, d]).into(),
            Number::F64 => f64::from_le_bytes(little),
        })
    }

    /// The next line that says something: the empty one after the last where there is none.
    fn next_line(&mut self) -> &'b [u8] {
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

/// The number of a word.
fn parse_number(word: &[u8], number: Number, property: &str) -> Result<f64, String> {
    let text = str::from_utf8(word).unwrap_or_default();
    let refused = |rule: &str| {
        let found = name(&String::from_utf8_lossy(word));
        Err(format!("has {rule} as {:?}, and {found:?} is none", name(property)))
    };
    let value = match text.parse::<f64>() {
        Ok(value) => value,
        Err(_) if is_odd_nan(text) => f64::NAN,
        Err(_) => return refused("a number"),
    };
    match number.range() {
        Some([least, most]) if value.fract() != 0.0 || !(least..=most).contains(&value) => {
            refused(&format!("a whole number from {least} to {most}"))
        }
        _ => Ok(value),
    }
}

/// Whether a word is one of those that C's libraries print for what is no number.
fn is_odd_nan(text: &str) -> bool {
    let text = text.trim_start_matches(['+', '-']).to_ascii_lowercase();
    text.starts_with("nan(") || text.starts_with("1.#")
}
