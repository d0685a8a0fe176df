//! Fits in files: saved, and resumed to the same bits.
//!
//! # The file
//! One line of text, `bokashi-fit 1 f64`: what it is, the version of what follows, the precision of
//! the numbers. Then the length of the contents (a `u64`), the contents, and the CRC-32 of all that
//! comes before it. Whole numbers and the bits of the others have their lowest byte first.
//!
//! The contents are the settings, how many updates are done, the least loss of the run and its step,
//! the parameters (name, raw numbers with their shape, rate, mapping, whether frozen, moments, how
//! many updates these have seen), and what the pipeline saved of itself.
//!
//! # Trust
//! Nothing that a file says is believed before it is checked: whatever the bytes are, the answer is
//! a fit or an error, and no more memory is taken than the file has bytes.

mod bytes;
mod fields;
mod stored;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

pub(crate) use self::bytes::{Reader, Writer};
#[cfg(feature = "scenes")]
pub(crate) use self::fields::tag;
pub use self::stored::Stored;
use crate::error::FitError;
use crate::fit::{Fit, LoopState, StepState};
use crate::parameter::{Parameter, Parameters};
use crate::write::write_whole;
use bokashi_core::Scalar;

/// What a file begins with.
const MAGIC: &str = "bokashi-fit";
/// The version of the contents.
const VERSION: u64 = 1;
/// The first line is no longer than this.
const LONGEST_LINE: usize = 40;
/// The bytes of the length before the contents, and of the checksum after them.
const AROUND: usize = 8 + 4;
/// The largest count of updates: it leaves room to count on.
const MOST_UPDATES: u64 = 1 << 63;

impl<T: Stored> Fit<T> {
    /// Saves the fit to the file `path`: it then holds all of the fit or, after an error, what it
    /// held before.
    ///
    /// # Errors
    /// [`FitError::File`] where the file cannot be written; [`FitError::NotFinite`] for a parameter
    /// whose value is not finite.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FitError> {
        write(path.as_ref(), &self.to_bytes()?)
    }

    /// What [`Fit::save`] writes.
    ///
    /// # Errors
    /// [`FitError::NotFinite`] for a parameter whose value is not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>, FitError> {
        encode(&self.loop_state(), self.parameters())
    }

    /// The fit that was saved to the file `path`. It goes on to the same bits as if it had not been
    /// interrupted; its pipeline gets its state back in the first step.
    ///
    /// # Errors
    /// [`FitError::File`] where the file cannot be read; as [`Fit::from_bytes`].
    pub fn resume(path: impl AsRef<Path>) -> Result<Self, FitError> {
        Self::from_bytes(&read(path.as_ref())?)
    }

    /// The fit that [`Fit::to_bytes`] gave `bytes` of.
    ///
    /// # Errors
    /// [`FitError::Saved`] for bytes that are something else, of another version or precision, too
    /// few or changed; [`FitError::Setting`] and [`FitError::NotFinite`] for contents that no fit
    /// has.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FitError> {
        let head = Head::of(bytes)?;
        if head.precision != T::NAME {
            let rule = format!("numbers in {}, as the fit that resumes it", T::NAME);
            return Err(FitError::saved(rule, head.precision));
        }
        let mut contents = Reader::new(head.contents(bytes)?);
        let (parameters, loop_state) = decode(&mut contents)?;
        contents.end()?;
        Self::restored(parameters, loop_state)
    }
}

impl<T: Stored, M> StepState<'_, T, M> {
    /// Saves the fit as it is in this step: as [`Fit::save`], while it runs.
    ///
    /// # Errors
    /// As [`Fit::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FitError> {
        write(path.as_ref(), &encode(&self.loop_state, self.parameters)?)
    }
}

/// What the first line says, and how long the file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Head<'a> {
    precision: &'a str,
    /// Bytes before the contents.
    before: usize,
    /// Bytes of the whole file.
    total: usize,
}

impl<'a> Head<'a> {
    /// The head of a file that begins with `bytes`.
    fn of(bytes: &'a [u8]) -> Result<Self, FitError> {
        let start = &bytes[..bytes.len().min(LONGEST_LINE)];
        let foreign = || {
            let rule = format!("to begin with {MAGIC:?}");
            let found = &start[..start.len().min(MAGIC.len())];
            Err(FitError::saved(rule, format!("\"{}\"", found.escape_ascii())))
        };
        let Some(end) = start.iter().position(|&byte| byte == b'\n') else {
            // The beginning of a right line is a file cut short.
            return match start.starts_with(MAGIC.as_bytes()) {
                true => Err(FitError::saved(
                    "a whole first line",
                    format!("\"{}\"", start.escape_ascii()),
                )),
                false => foreign(),
            };
        };
        let Ok(line) = std::str::from_utf8(&start[..end]) else { return foreign() };
        let mut words = line.split(' ');
        if words.next() != Some(MAGIC) {
            return foreign();
        }
        let version = words.next().unwrap_or_default();
        if version != VERSION.to_string() {
            return Err(FitError::saved(
                format!("version {VERSION}"),
                format!("version {version:?}"),
            ));
        }
        let precision = words.next().unwrap_or_default();
        if words.next().is_some() || !matches!(precision, "f32" | "f64") {
            return Err(FitError::saved("f32 or f64 after its version", format!("{line:?}")));
        }
        let line = end + 1;
        let Some(length) = bytes[line..].first_chunk() else {
            return Err(FitError::saved(
                "the length of its contents",
                format!("{} bytes", bytes.len()),
            ));
        };
        let contents = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let total = contents.saturating_add(line + AROUND);
        Ok(Self { precision, before: line + 8, total })
    }

    /// The contents of the file, which is `bytes`.
    fn contents<'b>(&self, bytes: &'b [u8]) -> Result<&'b [u8], FitError> {
        if bytes.len() != self.total {
            return Err(FitError::saved(format!("{} bytes", self.total), bytes.len()));
        }
        let (checked, stored) = bytes.split_at(self.total - 4);
        let (stored, computed) =
            (u32::from_le_bytes(stored.try_into().expect("4 bytes")), crc32fast::hash(checked));
        if stored != computed {
            let rule = format!("contents with the checksum {stored:08x} that it ends with");
            return Err(FitError::saved(rule, format!("{computed:08x}")));
        }
        Ok(&checked[self.before..])
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), FitError> {
    write_whole(path, bytes).map_err(|error| file_error(path, "written", &error))
}

/// The bytes of a file, of which no more are read than its head says.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, FitError> {
    let failed = |error: io::Error| file_error(path, "read", &error);
    let mut file = File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    let start = LONGEST_LINE + AROUND;
    file.by_ref().take(start as u64).read_to_end(&mut bytes).map_err(failed)?;
    let total = Head::of(&bytes)?.total;
    // One byte more shows that there are too many.
    let left = total.saturating_sub(bytes.len()).saturating_add(1);
    file.take(left as u64).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

fn file_error(path: &Path, done: &'static str, error: &io::Error) -> FitError {
    FitError::File { path: path.to_owned(), done, said: error.to_string() }
}

fn encode<T: Stored>(
    loop_state: &LoopState<'_>,
    parameters: &Parameters<T>,
) -> Result<Vec<u8>, FitError> {
    parameters.check_values()?;
    let mut contents = Writer::default();
    contents.fit_settings(&loop_state.settings);
    contents.count(loop_state.step);
    contents.number(loop_state.best.0);
    contents.count(loop_state.best.1);
    contents.count(parameters.updates);
    contents.count(parameters.list.len() as u64);
    for parameter in &parameters.list {
        contents.block(parameter.name().as_bytes());
        contents.tensor(&parameter.raw);
        contents.number(parameter.rate);
        contents.mapping(parameter.mapping);
        contents.byte(u8::from(parameter.frozen));
        contents.count(parameter.updates);
        contents.entries(&parameter.first);
        contents.entries(&parameter.second);
        contents.entries(&parameter.greatest);
    }
    contents.option(loop_state.pipeline, Writer::block);

    let mut file = Writer { bytes: format!("{MAGIC} {VERSION} {}\n", T::NAME).into_bytes() };
    file.block(&contents.bytes);
    let checksum = crc32fast::hash(&file.bytes);
    file.bytes.extend(checksum.to_le_bytes());
    Ok(file.bytes)
}

/// The precision that the fit in `file` computes with, and its pipeline's state.
#[cfg(feature = "scenes")]
pub(crate) fn precision_and_state(file: &[u8]) -> Result<(&str, Option<&[u8]>), FitError> {
    let head = Head::of(file)?;
    let mut contents = Reader::new(head.contents(file)?);
    let state = match head.precision {
        "f32" => decode::<f32>(&mut contents)?.1.pipeline,
        _ => decode::<f64>(&mut contents)?.1.pipeline,
    };
    contents.end()?;
    Ok((head.precision, state))
}

/// What [`encode`] wrote.
fn decode<'a, T: Stored>(
    contents: &mut Reader<'a>,
) -> Result<(Parameters<T>, LoopState<'a>), FitError> {
    let settings = contents.fit_settings()?;
    let step = updates(contents, "the updates done")?;
    let best = (contents.number("the least loss")?, contents.count("the step of the least loss")?);
    if best.0.is_nan() || best.1 > step {
        let rule = "a least loss of a step that was done";
        return Err(FitError::saved(rule, format!("{} of step {} of {step}", best.0, best.1)));
    }
    let all_updates = updates(contents, "the updates of the parameters")?;
    let count = contents.count("the number of parameters")?;
    let mut list = Vec::new();
    for _ in 0..count {
        list.push(parameter(contents)?);
    }
    let pipeline = contents.option("the state of the pipeline", Reader::block)?;
    let parameters = Parameters::restored(list, all_updates)?;
    Ok((parameters, LoopState { settings, step, best, pipeline }))
}

fn updates(contents: &mut Reader<'_>, what: &str) -> Result<u64, FitError> {
    let updates = contents.count(what)?;
    if updates > MOST_UPDATES {
        return Err(FitError::saved(format!("at most 2^63 for {what}"), updates));
    }
    Ok(updates)
}

fn parameter<T: Stored>(contents: &mut Reader<'_>) -> Result<Parameter<T>, FitError> {
    let name = contents.text("a parameter's name")?;
    let raw = contents.tensor::<T>("a parameter")?;
    let size = raw.size();
    let mut parameter = Parameter::new(name, raw);
    parameter.rate = contents.number("a learning rate")?;
    parameter.mapping = contents.mapping()?;
    parameter.frozen = contents.flag("whether a parameter is frozen")?;
    parameter.updates = updates(contents, "the updates of a parameter")?;
    parameter.first = contents.entries(size, "average gradients")?;
    parameter.second = contents.entries(size, "average squares")?;
    parameter.greatest = contents.entries(size, "largest average squares")?;
    let squares = parameter.second.iter().chain(&parameter.greatest);
    match squares.copied().find(|&square| square < T::ZERO) {
        Some(square) => Err(FitError::saved("average squares from 0 up", Scalar::to_f64(square))),
        None => Ok(parameter),
    }
}
