//! An array of numbers of any type, as files have it.

use bokashi_core::{Shape, Tensor};
use bokashi_fit::Stored;

use super::number_type::{NumberType, Refused};
use crate::error::{Location, SceneError};

/// The most axes of an array: as many as NumPy has.
pub(super) const MOST_AXES: usize = 64;

/// What errors call an array that comes from no file.
const NOWHERE: &str = "an array";

/// An array of numbers of any type, as files have it.
///
/// What is read of it is exact: [`RawArray::tensor`] refuses numbers that it would have to round, and
/// [`RawArray::indices`] those that no index can be.
#[derive(Debug, Clone)]
pub struct RawArray {
    /// The file that it is in, for errors.
    location: Location,
    kind: NumberType,
    shape: Shape,
    /// Row-major, the lowest byte of each number first.
    bytes: Vec<u8>,
}

/// The same numbers of the same type in the same shape, bit by bit.
impl PartialEq for RawArray {
    fn eq(&self, other: &Self) -> bool {
        (self.kind, &self.shape, &self.bytes) == (other.kind, &other.shape, &other.bytes)
    }
}

impl RawArray {
    /// The array of `shape` with the numbers of `bytes`: row-major, the lowest byte of each first.
    ///
    /// # Errors
    /// [`SceneError::Content`] unless there are as many bytes as the shape needs, and at most 64 axes.
    pub fn new(
        kind: NumberType,
        shape: impl Into<Shape>,
        bytes: Vec<u8>,
    ) -> Result<Self, SceneError> {
        Self::from_file(Location::new(NOWHERE), kind, shape.into(), bytes)
    }

    /// [`RawArray::new`] of an array in the file at `location`.
    pub(super) fn from_file(
        location: Location,
        kind: NumberType,
        shape: Shape,
        bytes: Vec<u8>,
    ) -> Result<Self, SceneError> {
        if bytes_of(kind, &shape) != Some(bytes.len()) {
            let rule = format!("an array of shape {shape} has {}", needed(kind, &shape));
            let message = format!("{rule}, and there are {} bytes", bytes.len());
            return Err(SceneError::content(location, message));
        }
        let array = Self { location, kind, shape, bytes };
        array.check_axes()?;
        Ok(array)
    }

    /// Whether a file can have so many axes.
    pub(super) fn check_axes(&self) -> Result<(), SceneError> {
        match self.shape.rank() {
            0..=MOST_AXES => Ok(()),
            more => {
                let rule = format!("an array has at most {MOST_AXES} axes");
                Err(self.wrong(format!("{rule}, and this has {more}")))
            }
        }
    }

    /// What is wrong with this array.
    pub(super) fn wrong(&self, message: impl std::fmt::Display) -> SceneError {
        SceneError::content(self.location.clone(), message)
    }

    /// The extents per axis, outermost first.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The type of the numbers.
    pub fn number_type(&self) -> NumberType {
        self.kind
    }

    /// The numbers, row-major, the lowest byte of each first.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The numbers as those of a tensor of `f32` or `f64`, exactly. Truth values become 0 and 1.
    ///
    /// `f64` is never read as `f32`: read it as `f64`, and [`Tensor::cast`] rounds it.
    ///
    /// # Errors
    /// [`SceneError::Content`] for `f64` read as `f32`, and for a whole number that would be rounded.
    pub fn tensor<T: Stored>(&self) -> Result<Tensor<T>, SceneError> {
        let kind = self.kind;
        let numbers = kind.numbers(&self.bytes).map_err(|refused| match refused {
            Refused::All => {
                let rule = format!("numbers are read as {} without rounding", T::NAME);
                self.wrong(format!("{rule}, and these are {kind}: read {kind}, and `cast` rounds"))
            }
            Refused::One(index, number) => {
                let rule = format!("{kind} are read as {} without rounding", T::NAME);
                self.refused(&rule, index, number)
            }
        })?;
        Ok(Tensor::new(&self.shape, numbers).map_err(bokashi_fit::FitError::from)?)
    }

    /// The whole numbers of an array `[n, N]` as rows, of indices say.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another shape, for numbers of a type that is not whole, and for a number
    /// that is not from 0 to `u32::MAX`.
    pub fn indices<const N: usize>(&self) -> Result<Vec<[u32; N]>, SceneError> {
        let wrong =
            |rule: String, found: String| self.wrong(format!("{rule}, and this has {found}"));
        if !matches!(*self.shape, [_, columns] if columns == N) {
            let message = format!("shape {}", self.shape);
            return Err(wrong(format!("rows of indices have shape [n, {N}]"), message));
        }
        let read = |number: i128| u32::try_from(number).ok();
        let flat = self.kind.whole_numbers(&self.bytes, read).map_err(|refused| match refused {
            Refused::All => wrong("indices are whole numbers".to_owned(), self.kind.to_string()),
            Refused::One(index, number) => {
                self.refused(&format!("indices are from 0 to {}", u32::MAX), index, number)
            }
        })?;
        Ok(flat.as_chunks().0.to_vec())
    }

    /// An entry that breaks a rule.
    fn refused(&self, rule: &str, index: usize, number: i128) -> SceneError {
        let mut rest = index;
        let mut index: Vec<_> = self
            .shape
            .iter()
            .rev()
            .map(|&extent| {
                let coordinate = rest % extent;
                rest /= extent;
                coordinate
            })
            .collect();
        index.reverse();
        self.wrong(format!("{rule}, and the entry at {index:?} is {number}"))
    }
}

/// The bytes that an array takes, or `None` where no index could count them.
pub(super) fn bytes_of(kind: NumberType, shape: &[usize]) -> Option<usize> {
    if shape.contains(&0) {
        return Some(0);
    }
    shape.iter().try_fold(kind.bytes(), |bytes, &extent| bytes.checked_mul(extent))
}

/// How many bytes an array needs, in words.
pub(super) fn needed(kind: NumberType, shape: &[usize]) -> String {
    match bytes_of(kind, shape) {
        Some(bytes) => format!("{bytes} bytes of {kind}"),
        None => format!("more bytes of {kind} than fit an index"),
    }
}

impl<T: Stored> From<&Tensor<T>> for RawArray {
    fn from(tensor: &Tensor<T>) -> Self {
        Self {
            location: Location::new(NOWHERE),
            kind: NumberType::for_stored::<T>(),
            shape: tensor.shape().clone(),
            bytes: T::bytes(tensor.data()),
        }
    }
}

impl<T: Stored> From<Tensor<T>> for RawArray {
    fn from(tensor: Tensor<T>) -> Self {
        Self::from(&tensor)
    }
}

/// `[n, N]` of `u32`: faces, say.
impl<const N: usize> From<&[[u32; N]]> for RawArray {
    fn from(rows: &[[u32; N]]) -> Self {
        Self {
            location: Location::new(NOWHERE),
            kind: NumberType::U32,
            shape: [rows.len(), N].into(),
            bytes: rows.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect(),
        }
    }
}
