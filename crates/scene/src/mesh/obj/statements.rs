//! The statements of OBJ and MTL files: lines, joined where a backslash continues them.

use std::borrow::Cow;
use std::str::{FromStr, Lines, SplitWhitespace};

use crate::error::{Location, SceneError};
use crate::mesh::notes::name;

/// The statements of a text, each with the number of its first line, from 1 on.
#[derive(Debug)]
pub(super) struct Statements<'t> {
    lines: Lines<'t>,
    number: usize,
}

impl<'t> Statements<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { lines: text.lines(), number: 0 }
    }
}

impl<'t> Iterator for Statements<'t> {
    type Item = (usize, Cow<'t, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.lines.next()?;
        self.number += 1;
        let first = self.number;
        let Some(begin) = line.trim_end().strip_suffix('\\') else {
            return Some((first, Cow::Borrowed(line)));
        };
        let mut joined = begin.to_owned();
        for line in self.lines.by_ref() {
            self.number += 1;
            joined.push(' ');
            match line.trim_end().strip_suffix('\\') {
                Some(more) => joined.push_str(more),
                None => {
                    joined.push_str(line);
                    break;
                }
            }
        }
        Some((first, Cow::Owned(joined)))
    }
}

/// The numbers among `words`, which are all numbers, at most `N` of them; and how many there are.
pub(super) fn numbers<T, const N: usize>(
    words: SplitWhitespace<'_>,
    what: &str,
    location: impl Fn() -> Location,
) -> Result<([T; N], usize), SceneError>
where
    T: FromStr + Default + Copy + Into<f64>,
{
    let mut numbers = [T::default(); N];
    let mut count = 0;
    // A comment may follow what a line says.
    for word in words.take_while(|word| !word.starts_with('#')) {
        let value = match word.parse::<T>() {
            // In the end they are those of `f32`.
            Ok(number) if (number.into() as f32).is_finite() => number,
            _ => {
                let message = format!("{what} has finite numbers, and {:?} is none", name(word));
                return Err(SceneError::content(location(), message));
            }
        };
        let Some(number) = numbers.get_mut(count) else {
            let message = format!("{what} has at most {N} numbers, and there are more");
            return Err(SceneError::content(location(), message));
        };
        *number = value;
        count += 1;
    }
    Ok((numbers, count))
}

/// The text of a file. Old files have names in other encodings than UTF-8: those letters are lost, and
/// the mesh is not.
pub(super) fn text<'b>(bytes: &'b [u8], location: &Location) -> Result<Cow<'b, str>, SceneError> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        let message = "text is UTF-8, and this is UTF-16";
        return Err(SceneError::content(location.clone(), message));
    }
    Ok(String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)))
}

/// What follows the keyword of a line. A name or a path may have spaces.
pub(super) fn rest<'l>(line: &'l str, keyword: &str) -> &'l str {
    line.trim_start().strip_prefix(keyword).unwrap_or_default().trim()
}
