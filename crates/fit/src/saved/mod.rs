//! Fits in files: saved, and resumed to the same bits.
//!
//! # The file
//! A [safetensors](https://huggingface.co/docs/safetensors) file. Its tensors, in the precision of
//! the fit, by the names of the parameters:
//!
//! | tensor | what |
//! |---|---|
//! | `raw/NAME` | the numbers that an update changes, before the parameter's mapping |
//! | `first_moment/NAME` | average gradients |
//! | `second_moment/NAME` | average squared gradients |
//! | `largest_second_moment/NAME` | the largest of these so far |
//! | `pipeline` | bytes (`U8`) that the pipeline saved of itself |
//!
//! Moments that an optimizer does not have, and a pipeline that has not begun, have no tensor.
//!
//! Everything else is a JSON text in the metadata, under `bokashi_fit`. It has the version, the
//! settings, how many updates are done, and the least loss of the run with its step. For each
//! parameter it has the rate, the mapping, whether it is frozen, and how many updates it had. The
//! text begins with a checksum: the CRC-32 of the rest of the text and of all tensors by name. A
//! tensor counts with its name, its type and shape (as `F32[8, 3]`), and its bytes.
//!
//! A preconditioned parameter is saved by its raw numbers. The preconditioner itself is not saved. Whoever resumes
//! the fit makes it again, and a fingerprint of its edges and lambda tells whether it is the same.
//!
//! # Trust
//! All contents of a file are checked before they are used. Any bytes give a fit or an error, and memory is taken in
//! proportion to the bytes of the file.

mod contents;
mod stored;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use bokashi_core::{Scalar, Shape, Tensor};
use bokashi_write::write_whole;
use safetensors::tensor::{Metadata, TensorView};
use safetensors::{Dtype, SafeTensors, View};

use self::contents::{Contents, Described, fingerprint};
pub use self::stored::Stored;
use crate::error::FitError;
use crate::fit::{Fit, LoopState, StepState};
use crate::parameter::{Parameter, Parameters};
use crate::preconditioner::Preconditioner;

/// The text's key in the metadata.
const KEY: &str = "bokashi_fit";
/// The beginning of the text, before the digits of the checksum.
const BEFORE_CHECKSUM: &str = "{\"checksum\":\"";
/// The hexadecimal digits of the checksum.
const DIGITS: usize = 8;
/// The name of the pipeline's state.
const PIPELINE: &str = "pipeline";
/// The prefixes of a parameter's name, for its raw numbers and its three kinds of moments.
const RAW: &str = "raw";
const MOMENTS: [&str; 3] = ["first_moment", "second_moment", "largest_second_moment"];
/// The most axes of a tensor: more than any operation takes.
const MOST_AXES: usize = 8;
/// The most bytes of the part before the tensors, as the format has it.
const LONGEST_HEADER: u64 = 100_000_000;

impl<T: Stored> Fit<T> {
    /// Saves the fit to the file `path`. After an error the file is as it was before.
    ///
    /// # Errors
    /// [`FitError::File`] where the file cannot be written; [`FitError::NotFinite`] for a parameter
    /// whose value is not finite.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FitError> {
        write(path.as_ref(), &self.to_bytes()?)
    }

    /// The bytes that [`Fit::save`] writes.
    ///
    /// # Errors
    /// [`FitError::NotFinite`] for a parameter whose value is not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>, FitError> {
        encode(&self.loop_state(), self.parameters())
    }

    /// Resumes the fit that was saved to the file `path`. It goes on to the same bits as without an interruption. The
    /// first step restores the state of its pipeline.
    ///
    /// # Errors
    /// [`FitError::File`] where the file cannot be read; as [`Fit::from_bytes`].
    pub fn resume(path: impl AsRef<Path>) -> Result<Self, FitError> {
        Self::from_bytes(&read(path.as_ref())?)
    }

    /// [`Fit::resume`] for a fit with preconditioned parameters. `preconditioners` has them by the names of parameters.
    ///
    /// # Errors
    /// As [`Fit::resume`] and [`Fit::from_bytes_with`].
    pub fn resume_with(
        path: impl AsRef<Path>,
        preconditioners: &[(&str, &Preconditioner)],
    ) -> Result<Self, FitError> {
        Self::from_bytes_with(&read(path.as_ref())?, preconditioners)
    }

    /// The fit with the `bytes` of [`Fit::to_bytes`].
    ///
    /// # Errors
    /// [`FitError::Saved`] for bytes that are something else, of another version or precision, too
    /// few or changed; [`FitError::Setting`] and [`FitError::NotFinite`] for contents that no fit
    /// has.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FitError> {
        Self::from_bytes_with(bytes, &[])
    }

    /// [`Fit::from_bytes`] for a fit with preconditioned parameters. `preconditioners` has them by the names of
    /// parameters.
    ///
    /// # Errors
    /// As [`Fit::from_bytes`]; [`FitError::Saved`] where a preconditioner is missing, differs from the
    /// one that the fit was saved with, or is not used.
    pub fn from_bytes_with(
        bytes: &[u8],
        preconditioners: &[(&str, &Preconditioner)],
    ) -> Result<Self, FitError> {
        let file = Opened::new(bytes)?;
        if file.contents.precision != T::NAME {
            let rule = format!("numbers in {}, as the fit that resumes it", T::NAME);
            return Err(FitError::saved(rule, file.contents.precision));
        }
        let (parameters, loop_state) = file.decoded(Some(preconditioners))?;
        Self::restored(parameters, loop_state)
    }
}

impl<T: Stored, M> StepState<'_, T, M> {
    /// Saves the fit as it is in this step, while it runs, as [`Fit::save`].
    ///
    /// # Errors
    /// As [`Fit::save`]; [`FitError::Saved`] for a step of something else than a fit.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FitError> {
        let other = || FitError::saved("steps of a fit by gradients", "others");
        let loop_state = self.loop_state.as_ref().ok_or_else(other)?;
        write(path.as_ref(), &encode(loop_state, self.parameters)?)
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), FitError> {
    write_whole(path, bytes).map_err(|error| file_error(path, "written", &error))
}

fn file_error(path: &Path, done: &'static str, error: &io::Error) -> FitError {
    FitError::File { path: path.to_owned(), done, message: error.to_string() }
}

/// The error for bytes that are no file of this format.
fn foreign(error: impl std::fmt::Display) -> FitError {
    FitError::saved("a safetensors file", error)
}

/// Reads the bytes of a file, and no more of them than its header says.
///
/// # Errors
/// [`FitError::File`] where it cannot be read; [`FitError::Saved`] where its header is not that of a
/// fit.
pub fn read(path: &Path) -> Result<Vec<u8>, FitError> {
    let failed = |error: io::Error| file_error(path, "read", &error);
    let mut file = File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    file.by_ref().take(8).read_to_end(&mut bytes).map_err(failed)?;
    let Some(length) = bytes.first_chunk().map(|&length| u64::from_le_bytes(length)) else {
        return Err(foreign(format!("{} bytes", bytes.len())));
    };
    if length > LONGEST_HEADER {
        return Err(foreign(format!("a header of {length} bytes")));
    }
    file.by_ref().take(length).read_to_end(&mut bytes).map_err(failed)?;
    let header: Metadata = serde_json::from_slice(&bytes[8..]).map_err(foreign)?;
    text_of(&header)?;
    // One byte more shows that there are too many.
    let left = (header.data_len() as u64).saturating_add(1);
    file.take(left).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// The text in a file's metadata.
fn text_of(header: &Metadata) -> Result<&str, FitError> {
    let text = header.metadata().as_ref().and_then(|metadata| metadata.get(KEY));
    let rule = || format!("a safetensors file with {KEY:?} in its metadata");
    Ok(text.ok_or_else(|| FitError::saved(rule(), "one without"))?)
}

/// A tensor to be written.
#[derive(Debug)]
struct Block {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Block {
    fn new<T: Stored>(shape: &Shape, numbers: &[T]) -> Self {
        Self { dtype: T::DTYPE, shape: shape.to_vec(), bytes: T::bytes(numbers) }
    }
}

impl View for &Block {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

fn encode<T: Stored>(
    loop_state: &LoopState<'_>,
    parameters: &Parameters<T>,
) -> Result<Vec<u8>, FitError> {
    parameters.check_values()?;
    let mut tensors = BTreeMap::new();
    for parameter in &parameters.list {
        let (name, shape) = (parameter.name(), parameter.raw.shape());
        tensors.insert(format!("{RAW}/{name}"), Block::new(shape, parameter.raw.data()));
        let moments = [&parameter.first, &parameter.second, &parameter.greatest];
        for (kind, moments) in MOMENTS.into_iter().zip(moments) {
            if !moments.is_empty() {
                tensors.insert(format!("{kind}/{name}"), Block::new(shape, moments));
            }
        }
    }
    if let Some(state) = loop_state.pipeline {
        let block = Block { dtype: Dtype::U8, shape: vec![state.len()], bytes: state.to_vec() };
        tensors.insert(PIPELINE.to_owned(), block);
    }
    let contents = Contents::new(T::NAME, loop_state, parameters);
    let mut text = serde_json::to_string(&contents).map_err(foreign)?;
    let rest = &text[BEFORE_CHECKSUM.len() + DIGITS..];
    let views =
        tensors.iter().map(|(name, block)| (&**name, block.dtype, &*block.shape, &*block.bytes));
    let checksum = checksum(rest, views);
    text.replace_range(BEFORE_CHECKSUM.len()..BEFORE_CHECKSUM.len() + DIGITS, &checksum);
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    safetensors::serialize(&tensors, Some(metadata)).map_err(foreign)
}

/// The checksum, in digits, of a text after its own checksum, and of tensors in the order of their
/// names.
fn checksum<'a>(
    rest: &str,
    tensors: impl Iterator<Item = (&'a str, Dtype, &'a [usize], &'a [u8])>,
) -> String {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(rest.as_bytes());
    for (name, dtype, shape, bytes) in tensors {
        hasher.update(format!("{name}{dtype}{shape:?}").as_bytes());
        hasher.update(bytes);
    }
    format!("{:0DIGITS$x}", hasher.finalize())
}

/// A file whose checksum is right.
#[derive(Debug)]
struct Opened<'a> {
    contents: Contents,
    tensors: BTreeMap<String, TensorView<'a>>,
}

impl<'a> Opened<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, FitError> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(foreign)?;
        let text = text_of(&header)?;
        let contents = Contents::from_text(text)?;
        let file = SafeTensors::deserialize(bytes).map_err(foreign)?;
        let tensors: BTreeMap<_, _> = file.tensors().into_iter().collect();
        let begins =
            text.strip_prefix(BEFORE_CHECKSUM).and_then(|text| text.split_at_checked(DIGITS));
        let Some((stored, rest)) = begins else {
            let rule = format!("contents that begin with a checksum of {DIGITS} digits");
            return Err(FitError::saved(rule, format!("{:?}", contents.checksum)));
        };
        let views =
            tensors.iter().map(|(name, view)| (&**name, view.dtype(), view.shape(), view.data()));
        let computed = checksum(rest, views);
        if stored != computed {
            let rule = format!("contents with the checksum {stored} that it has");
            return Err(FitError::saved(rule, computed));
        }
        Ok(Self { contents, tensors })
    }

    /// Decodes the bytes of [`encode`].
    ///
    /// Without a list of preconditioners the parameters are only checked, and make no fit.
    fn decoded<T: Stored>(
        mut self,
        preconditioners: Option<&[(&str, &Preconditioner)]>,
    ) -> Result<(Parameters<T>, LoopState<'a>), FitError> {
        let mut list = Vec::new();
        for described in std::mem::take(&mut self.contents.parameters) {
            let saved = described.preconditioner.clone();
            let mut parameter = self.parameter(described)?;
            if let Some(given) = preconditioners {
                parameter.preconditioner = preconditioner(parameter.name(), saved, given)?;
            }
            list.push(parameter);
        }
        let names = |name: &str| list.iter().any(|p: &Parameter<T>| p.name() == name);
        let mut unknown = preconditioners.unwrap_or_default().iter().map(|(name, _)| *name);
        if let Some(name) = unknown.find(|name| !names(name)) {
            let rule = "a parameter for each preconditioner";
            return Err(FitError::saved(rule, format!("none for that of {name:?}")));
        }
        let pipeline = self.tensors.remove(PIPELINE);
        if let Some(other) = pipeline.as_ref().filter(|view| view.dtype() != Dtype::U8) {
            return Err(FitError::saved(format!("U8 for {PIPELINE:?}"), other.dtype()));
        }
        if let Some((name, _)) = self.tensors.first_key_value() {
            return Err(FitError::saved(
                "no tensor but those of its parameters",
                format!("{name:?}"),
            ));
        }
        let loop_state = self.contents.loop_state(pipeline.map(|view| view.data()))?;
        let counts = list.iter().map(|parameter: &Parameter<T>| parameter.updates);
        contents::check_updates(counts)?;
        Ok((Parameters::restored(list, self.contents.updates)?, loop_state))
    }

    /// Takes the numbers of a parameter out of the file, so that no other parameter has the same tensors.
    fn parameter<T: Stored>(&mut self, described: Described) -> Result<Parameter<T>, FitError> {
        let Described { name, rate, mapping, frozen, updates, uniform, .. } = described;
        let raw = format!("{RAW}/{name}");
        let Some(numbers) = self.tensor::<T>(&raw)? else {
            return Err(FitError::saved(format!("a tensor {raw:?}, and one alone"), "none"));
        };
        let mut moments = [const { Vec::new() }; 3];
        for (kind, moments) in MOMENTS.into_iter().zip(&mut moments) {
            let tensor_name = format!("{kind}/{name}");
            let Some(tensor) = self.tensor::<T>(&tensor_name)? else { continue };
            if tensor.shape() != numbers.shape() {
                let rule =
                    format!("the shape {:?} of {raw:?} for {tensor_name:?}", numbers.shape());
                return Err(FitError::saved(rule, format!("{:?}", tensor.shape())));
            }
            *moments = tensor.data().to_vec();
        }
        let [first, second, greatest] = moments;
        let squares = second.iter().chain(&greatest);
        if let Some(square) = squares.copied().find(|&square| square < T::ZERO) {
            return Err(FitError::saved("average squares from 0 up", Scalar::to_f64(square)));
        }
        let mut parameter = Parameter::new(name, numbers);
        (parameter.rate, parameter.mapping, parameter.frozen) = (rate, mapping, frozen);
        (parameter.updates, parameter.is_uniform) = (updates, uniform);
        (parameter.first, parameter.second, parameter.greatest) = (first, second, greatest);
        Ok(parameter)
    }

    /// Takes the tensor of this name out of the file.
    fn tensor<T: Stored>(&mut self, name: &str) -> Result<Option<Tensor<T>>, FitError> {
        let Some(view) = self.tensors.remove(name) else { return Ok(None) };
        if view.dtype() != T::DTYPE {
            return Err(FitError::saved(format!("{} for {name:?}", T::DTYPE), view.dtype()));
        }
        if view.shape().len() > MOST_AXES {
            let rule = format!("at most {MOST_AXES} axes for {name:?}");
            return Err(FitError::saved(rule, view.shape().len()));
        }
        let numbers = T::numbers(view.data());
        if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(FitError::saved(format!("finite numbers for {name:?}"), number));
        }
        Ok(Some(Tensor::new(Shape::from(view.shape()), numbers)?))
    }
}

/// Finds the preconditioner with which the parameter `name` was saved.
fn preconditioner(
    name: &str,
    saved: Option<String>,
    given: &[(&str, &Preconditioner)],
) -> Result<Option<Preconditioner>, FitError> {
    let given = given.iter().find(|(given_name, _)| *given_name == name).map(|(_, given)| *given);
    let present = given.map(fingerprint);
    if saved == present {
        return Ok(given.cloned());
    }
    let described = |print: Option<String>| match print {
        Some(print) => format!("{name:?} with the preconditioner of {print}"),
        None => format!("{name:?} without a preconditioner"),
    };
    Err(FitError::saved(described(saved), described(present)))
}

/// The precision of the fit in `file`, and the state of its pipeline.
///
/// # Errors
/// As [`Fit::from_bytes`].
pub fn precision_and_state(file: &[u8]) -> Result<(&'static str, Option<&[u8]>), FitError> {
    let file = Opened::new(file)?;
    Ok(match &*file.contents.precision {
        "f32" => ("f32", file.decoded::<f32>(None)?.1.pipeline),
        _ => ("f64", file.decoded::<f64>(None)?.1.pipeline),
    })
}
