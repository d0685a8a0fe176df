//! COLMAP's text files: a record a line, numbers between spaces, comments after `#`.

use std::str::{FromStr, SplitWhitespace};

use glam::{DQuat, DVec3};

use super::records::{ColmapPoint, Lens, Numbered, Shot, camera};
use crate::error::{Location, SceneError};

/// A record, and where it is for errors.
struct Record<'t> {
    line: usize,
    rest: SplitWhitespace<'t>,
    location: &'t Location,
}

impl<'t> Record<'t> {
    fn error(&self, message: impl std::fmt::Display) -> SceneError {
        SceneError::content(Location { line: Some(self.line), ..self.location.clone() }, message)
    }

    /// The next word.
    fn word(&mut self, what: &str) -> Result<&'t str, SceneError> {
        self.rest.next().ok_or_else(|| self.error(format!("{what} is missing")))
    }

    /// The next number.
    fn number<N: FromStr>(&mut self, what: &str) -> Result<N, SceneError> {
        let word = self.word(what)?;
        let message = format!("{what} is a number in its range, and this is {word:?}");
        word.parse().map_err(|_| self.error(message))
    }

    fn vector(&mut self, names: [&str; 3]) -> Result<DVec3, SceneError> {
        let [x, y, z] = names;
        Ok(DVec3::new(self.number(x)?, self.number(y)?, self.number(z)?))
    }
}

/// The lines that are neither empty nor comments, with their numbers.
fn records<'t>(text: &'t str, location: &'t Location) -> impl Iterator<Item = Record<'t>> {
    let lines = text.lines().enumerate();
    lines.filter(|(_, line)| is_record(line)).map(move |(index, line)| Record {
        line: index + 1,
        rest: line.split_whitespace(),
        location,
    })
}

fn is_record(line: &str) -> bool {
    let line = line.trim_start();
    !line.is_empty() && !line.starts_with('#')
}

/// `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`.
pub(super) fn lenses(text: &str, location: &Location) -> Result<Vec<Lens>, SceneError> {
    let lens = |mut record: Record<'_>| {
        let number = record.number("a camera's number")?;
        let model = record.word("a camera's model")?;
        let size = [record.number("a width")?, record.number("a height")?];
        // No model has more.
        let mut parameters = Vec::new();
        while record.rest.clone().next().is_some() && parameters.len() <= 16 {
            parameters.push(record.number("a camera's parameter")?);
        }
        let camera = camera(model, size, &parameters).map_err(|message| record.error(message))?;
        Ok(Lens { number, camera })
    };
    records(text, location).map(lens).collect()
}

/// `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, and a line of features, which may be empty.
pub(super) fn shots(text: &str, location: &Location) -> Result<Vec<Shot>, SceneError> {
    let mut shots = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((index, line)) = lines.next() {
        if !is_record(line) {
            continue;
        }
        let mut record = Record { line: index + 1, rest: line.split_whitespace(), location };
        record.number::<u32>("an image's number")?;
        let w = record.number("QW")?;
        let DVec3 { x, y, z } = record.vector(["QX", "QY", "QZ"])?;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let translation = record.vector(["TX", "TY", "TZ"])?;
        let camera = record.number("an image's camera")?;
        // A name may have spaces.
        let name = after_words(line, 9).trim().to_owned();
        if name.is_empty() {
            return Err(record.error("an image's name is missing"));
        }
        shots.push(Shot { rotation, translation, camera, name });
        if let Some((index, features)) = lines.next()
            && !are_features(features)
        {
            let rule =
                "after an image's line comes one of its points, of three numbers each or empty";
            let location = Location { line: Some(index + 1), ..location.clone() };
            return Err(SceneError::content(location, format!("{rule}, and this is neither")));
        }
    }
    Ok(shots)
}

/// Whether a line can be that of an image's features: `X Y POINT3D_ID`, again and again. The name in an image's
/// line begins with its tenth word.
fn are_features(line: &str) -> bool {
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    line.split_whitespace().count().is_multiple_of(3)
        && line.split_whitespace().take(12).all(is_number)
}

/// What follows the first `count` words of a line.
fn after_words(line: &str, count: usize) -> &str {
    let after = |rest: &'_ str| -> usize {
        let rest_length = rest.len();
        let rest = rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        rest_length - rest.len() + end
    };
    (0..count).fold(line, |rest, _| &rest[after(rest)..])
}

/// `POINT3D_ID X Y Z R G B ERROR TRACK[]`.
pub(super) fn points(text: &str, location: &Location) -> Result<Vec<Numbered>, SceneError> {
    let point = |mut record: Record<'_>| {
        let number = record.number("a point's number")?;
        let position = record.vector(["X", "Y", "Z"])?;
        if !position.is_finite() {
            return Err(record.error(format!("a point is finite, and this is {position}")));
        }
        let color = [record.number("R")?, record.number("G")?, record.number("B")?];
        Ok(Numbered { number, point: ColmapPoint { position, color } })
    };
    records(text, location).map(point).collect()
}
