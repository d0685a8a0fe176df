//! The header of a PLY file, checked against what follows it before memory is taken.

use std::collections::HashSet;

use crate::error::SceneError;
use crate::mesh::context::{MeshContext, unquoted};
use crate::mesh::notes::name;

/// The longest header that is read, in bytes.
const LONGEST_HEADER: usize = 1 << 20;
/// The words that begin a line of a header.
const KEYWORDS: [&str; 7] =
    ["ply", "format", "comment", "obj_info", "element", "property", "end_header"];

/// How rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// How many bytes it has in a binary file.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The least and the largest whole number; nothing for fractions.
    pub(super) fn range(self) -> Option<[f64; 2]> {
        Some(match self {
            Self::I8 => [i8::MIN.into(), i8::MAX.into()],
            Self::U8 => [0.0, u8::MAX.into()],
            Self::I16 => [i16::MIN.into(), i16::MAX.into()],
            Self::U16 => [0.0, u16::MAX.into()],
            Self::I32 => [i32::MIN.into(), i32::MAX.into()],
            Self::U32 => [0.0, u32::MAX.into()],
            Self::F32 | Self::F64 => return None,
        })
    }
}

/// A property of an element: a number, or a list of them after its length.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) number: Number,
    pub(super) length: Option<Number>,
}

/// Rows of the same properties.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

/// What a header says.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// What the comments `TextureFile` name.
    pub(super) images: Vec<String>,
    /// How many lines and bytes it has.
    pub(super) lines: usize,
    pub(super) bytes: usize,
}

impl Header {
    /// That of a file with these bytes.
    ///
    /// In one piece: a match over the keywords of lines.
    pub(super) fn read(bytes: &[u8], context: &MeshContext<'_>) -> Result<Self, SceneError> {
        let refused = |message: String| context.error(message);
        if !bytes.starts_with(b"ply") {
            return Err(refused(
                "a PLY file begins with the line ply, and this does not".to_owned(),
            ));
        }
        let (mut encoding, mut elements, mut images) = (None, Vec::<Element>::new(), Vec::new());
        let (mut end, mut lines) = (0, 0);
        // With how many elements there were before.
        let mut names = HashSet::new();
        loop {
            let left = &bytes[end..bytes.len().min(LONGEST_HEADER)];
            let Some(length) = left.iter().position(|&byte| byte == b'\n') else {
                let rule = "a header ends with the line end_header";
                return Err(refused(format!("{rule}, and {end} bytes of lines have none")));
            };
            end += length + 1;
            lines += 1;
            // Comments are in any encoding.
            let line = String::from_utf8_lossy(&left[..length]);
            let mut words = line.split_whitespace();
            let result = match words.next() {
                Some("end_header") => break,
                Some("format") => match Self::encoding(&line) {
                    Ok(value) => {
                        encoding = Some(value);
                        Ok(())
                    }
                    Err(message) => Err(message),
                },
                Some("element") => Element::parse(words).and_then(|element| {
                    let result = is_new(&mut names, 0, &element.name, "elements");
                    elements.push(element);
                    result
                }),
                Some("property") => Property::parse(words).and_then(|property| {
                    let result = is_new(&mut names, elements.len(), &property.name, "properties");
                    let rule = "a property follows its element, and this has none";
                    elements.last_mut().ok_or(rule)?.properties.push(property);
                    result
                }),
                Some("comment") => {
                    let text = line.trim_start()["comment".len()..].trim();
                    if let Some(file) = text.strip_prefix("TextureFile") {
                        images.push(unquoted(file.trim()).to_owned());
                    }
                    Ok(())
                }
                Some("obj_info") | None => Ok(()),
                Some("ply") if lines == 1 => Ok(()),
                Some(other) => {
                    let rule = format!("a line of a header begins with {}", KEYWORDS.join(", "));
                    Err(format!("{rule}, and this begins with {:?}", name(other)))
                }
            };
            result.map_err(|message| context.error_in(lines, message))?;
        }
        let Some(encoding) = encoding else {
            let rule = "a header has a line that begins with format";
            return Err(refused(format!("{rule}, and this has none")));
        };
        let header = Self { encoding, elements, images, lines, bytes: end };
        header.check_counts(bytes.len() - end).map_err(refused)?;
        Ok(header)
    }

    fn encoding(line: &str) -> Result<Encoding, String> {
        let words: Vec<&str> = line.split_whitespace().skip(1).collect();
        match words[..] {
            ["ascii", "1.0"] => Ok(Encoding::Ascii),
            ["binary_little_endian", "1.0"] => Ok(Encoding::LittleEndian),
            ["binary_big_endian", "1.0"] => Ok(Encoding::BigEndian),
            _ => {
                let rule = "a format is ascii, binary_little_endian or binary_big_endian, and 1.0";
                Err(format!("{rule}, and this is {:?}", name(&words.join(" "))))
            }
        }
    }

    /// Refuses counts of rows that can't be in so many bytes after the header.
    fn check_counts(&self, left: usize) -> Result<(), String> {
        let is_ascii = self.encoding == Encoding::Ascii;
        let mut needed = 0_u64;
        for Element { name: element_name, count, properties } in &self.elements {
            let least: usize = match is_ascii {
                // A digit and what separates it from the next.
                true => 2 * properties.len(),
                // A list may be empty.
                false => properties
                    .iter()
                    .map(|property| property.length.unwrap_or(property.number).bytes())
                    .sum(),
            };
            if least == 0 && *count > 0 {
                let message = format!("{:?} has {count} rows of none", name(element_name));
                return Err(format!("an element has properties, and {message}"));
            }
            needed = needed.saturating_add((*count as u64).saturating_mul(least as u64));
        }
        // The last line of an ascii file may have no end.
        if needed > left as u64 + u64::from(is_ascii) {
            let message = format!("need {needed} bytes, and {left} follow the header");
            return Err(format!("the elements' rows {message}"));
        }
        Ok(())
    }
}

/// Refuses a name that is among `names` of the same `part`, which it joins.
fn is_new(
    names: &mut HashSet<(usize, String)>,
    part: usize,
    key: &str,
    what: &str,
) -> Result<(), String> {
    match names.insert((part, key.to_owned())) {
        true => Ok(()),
        false => Err(format!("{what} have different names, and {:?} is repeated", name(key))),
    }
}

impl Element {
    /// That of the words after the first one of its line.
    fn parse<'w>(words: impl Iterator<Item = &'w str>) -> Result<Self, String> {
        let words: Vec<&str> = words.collect();
        let rule = "an element has a name and a count";
        let [word, count] = words[..] else {
            return Err(format!("{rule}, and this has {} words", words.len()));
        };
        let Ok(count) = count.parse() else {
            return Err(format!("{rule}, and {:?} is no count", name(count)));
        };
        Ok(Self { name: word.to_owned(), count, properties: Vec::new() })
    }
}

impl Property {
    /// That of the words after the first one of its line.
    fn parse<'w>(words: impl Iterator<Item = &'w str>) -> Result<Self, String> {
        let words: Vec<&str> = words.collect();
        let (length, number, word) = match words[..] {
            ["list", length, number, word] => (Some(length), number, word),
            [number, word] => (None, number, word),
            _ => {
                let rule = "a property is a type and a name, or list, two types and a name";
                return Err(format!("{rule}, and this has {} words", words.len()));
            }
        };
        let parse_number = |word: &str| {
            let rule = "a type is char, uchar, short, ushort, int, uint, float or double, or int8 to \
                        uint32, float32 or float64";
            Number::from_name(word).ok_or(format!("{rule}, and this is {:?}", name(word)))
        };
        let (length, number) = (length.map(parse_number).transpose()?, parse_number(number)?);
        if length.is_some_and(|length| length.range().is_none()) {
            return Err("the length of a list is a whole number, and this has fractions".to_owned());
        }
        Ok(Self { name: word.to_owned(), number, length })
    }
}
