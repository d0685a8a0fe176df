//! The header of an npy file: a dictionary as Python writes it.
//!
//! `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }`. It has these three keys, in any order,
//! each of them once. Of Python's literals no others are read than those.

use crate::arrays::number_type::{NumberType, foreign};
use crate::arrays::raw_array::MOST_AXES;

/// What a header says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) element: Element,
    /// Whether the *first* axis is the one whose entries lie side by side.
    pub(super) is_fortran: bool,
    pub(super) shape: Vec<usize>,
}

/// What an array is made of.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Element {
    Number {
        kind: NumberType,
        is_big_endian: bool,
    },
    /// No number that is read: in words.
    Foreign(String),
}

/// The header in `text`, or what is wrong with it.
pub(super) fn parse(text: &str) -> Result<Header, String> {
    let mut rest = Rest(text);
    rest.expect("{")?;
    let (mut element, mut is_fortran, mut shape) = (None, None, None);
    while !rest.skip("}") {
        let key = rest.string()?;
        rest.expect(":")?;
        let is_new = match key {
            "descr" => element.replace(rest.element()?).is_none(),
            "fortran_order" => is_fortran.replace(rest.truth()?).is_none(),
            "shape" => shape.replace(rest.shape()?).is_none(),
            _ => false,
        };
        if !is_new {
            let rule = "the keys of a header are descr, fortran_order and shape, each once";
            return Err(format!("{rule}, and there is {key:?}"));
        }
        if !rest.skip(",") {
            rest.expect("}")?;
            break;
        }
    }
    rest.end()?;
    let (Some(element), Some(is_fortran), Some(shape)) = (element, is_fortran, shape) else {
        let rule = "the keys of a header are descr, fortran_order and shape, each once";
        return Err(format!("{rule}, and it lacks some of them"));
    };
    Ok(Header { element, is_fortran, shape })
}

/// What is not read yet.
struct Rest<'a>(&'a str);

impl<'a> Rest<'a> {
    /// Skips `word` and spaces before it, where it is next.
    fn skip(&mut self, word: &str) -> bool {
        self.0 = self.0.trim_ascii_start();
        match self.0.strip_prefix(word) {
            Some(rest) => {
                self.0 = rest;
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, word: &str) -> Result<(), String> {
        if self.skip(word) { Ok(()) } else { Err(self.wrong(&format!("{word:?}"))) }
    }

    /// What stands where `expected` should.
    fn wrong(&self, expected: &str) -> String {
        let found: String = self.0.chars().take(20).collect();
        format!("a header has {expected} here, and this has {found:?}")
    }

    /// Nothing but spaces.
    fn end(&self) -> Result<(), String> {
        if self.0.trim_ascii().is_empty() { Ok(()) } else { Err(self.wrong("its end")) }
    }

    /// A string without escapes.
    fn string(&mut self) -> Result<&'a str, String> {
        let quote = ["'", "\""].into_iter().find(|quote| self.skip(quote));
        let end = quote.and_then(|quote| self.0.split_once(quote));
        match end {
            Some((string, rest)) if !string.contains(['\\', '\n']) => {
                self.0 = rest;
                Ok(string)
            }
            _ => Err(self.wrong("a string")),
        }
    }

    fn truth(&mut self) -> Result<bool, String> {
        if self.skip("True") {
            return Ok(true);
        }
        if self.skip("False") { Ok(false) } else { Err(self.wrong("True or False")) }
    }

    /// A tuple of whole numbers.
    fn shape(&mut self) -> Result<Vec<usize>, String> {
        self.expect("(")?;
        let mut shape = Vec::new();
        while !self.skip(")") {
            shape.push(self.extent()?);
            if shape.len() > MOST_AXES {
                return Err(format!("an array has at most {MOST_AXES} axes, and this has more"));
            }
            let is_last = !self.skip(",");
            // `(3)` is a number.
            if is_last && shape.len() == 1 {
                return Err(self.wrong("a comma after the only extent"));
            }
            if is_last {
                self.expect(")")?;
                break;
            }
        }
        Ok(shape)
    }

    fn extent(&mut self) -> Result<usize, String> {
        self.0 = self.0.trim_ascii_start();
        let end = self.0.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.0.len());
        let (digits, rest) = self.0.split_at(end);
        if digits.is_empty() || (digits.len() > 1 && digits.starts_with('0')) {
            return Err(self.wrong("an extent"));
        }
        let extent = digits.parse();
        // Python 2 wrote long numbers with an L.
        self.0 = rest.strip_prefix('L').unwrap_or(rest);
        extent.map_err(|_| format!("an extent is an index, and this is {digits}"))
    }

    /// What an array is made of: a string, or of a structured array a list.
    fn element(&mut self) -> Result<Element, String> {
        if !self.skip("[") {
            return Ok(element(self.string()?));
        }
        // To its end: brackets in strings, which names of fields can have, count for nothing.
        let mut depth = 1;
        while depth > 0 {
            self.0 = self.0.trim_ascii_start();
            match self.0.chars().next() {
                Some('\'' | '"') => drop(self.string()?),
                Some(letter) => {
                    depth += i32::from(letter == '[') - i32::from(letter == ']');
                    self.0 = &self.0[letter.len_utf8()..];
                }
                None => return Err(self.wrong("the end of a list")),
            }
        }
        Ok(Element::Foreign(foreign("records")))
    }
}

/// What NumPy calls `code`: the order of bytes, a letter for the kind, and the number of bytes.
fn element(code: &str) -> Element {
    let mut letters = code.chars();
    let order = letters.next();
    let is_big_endian = order == Some('>');
    let letters = letters.as_str();
    let Some(kind) = NumberType::ALL.into_iter().find(|kind| kind.numpy() == Some(letters)) else {
        let what = match letters.chars().next() {
            Some('O') => "Python objects",
            Some('c') => "complex numbers",
            Some('U' | 'S' | 'a') => "texts",
            Some('M' | 'm') => "times",
            Some('V') => "raw bytes",
            _ => "none that is known",
        };
        return Element::Foreign(foreign(format!("{what}, {code:?}")));
    };
    match order {
        Some('<' | '>') => Element::Number { kind, is_big_endian },
        Some('|') if kind.bytes() == 1 => Element::Number { kind, is_big_endian },
        _ => Element::Foreign(foreign(format!("of no order of bytes, {code:?}"))),
    }
}

/// What NumPy calls numbers of this type, the lowest byte first; it has no `bf16`.
pub(super) fn code(kind: NumberType) -> Option<String> {
    let order = if kind.bytes() == 1 { '|' } else { '<' };
    Some(format!("{order}{}", kind.numpy()?))
}
