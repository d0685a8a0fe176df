//! The types of numbers that files of arrays have, and numbers out of their bytes.

use std::fmt;

use bokashi_fit::Stored;
use half::{bf16, f16};
use safetensors::Dtype;

/// The type of the numbers of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NumberType {
    /// Truth values: a byte each, 0 or 1.
    Bool,
    /// Whole numbers of 8 bits from 0 up.
    U8,
    /// Whole numbers of 16 bits from 0 up.
    U16,
    /// Whole numbers of 32 bits from 0 up.
    U32,
    /// Whole numbers of 64 bits from 0 up.
    U64,
    /// Whole numbers of 8 bits.
    I8,
    /// Whole numbers of 16 bits.
    I16,
    /// Whole numbers of 32 bits.
    I32,
    /// Whole numbers of 64 bits.
    I64,
    /// Half precision, binary16 of IEEE 754.
    F16,
    /// The upper half of an `f32`, "brain float".
    Bf16,
    /// Single precision, binary32.
    F32,
    /// Double precision, binary64.
    F64,
}

/// A number that can't be read as what is asked for: which of them, and what it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Refused {
    /// Each of them can lose digits.
    All,
    /// This one loses digits, or is none of the type's.
    One(usize, i128),
}

impl NumberType {
    /// All of them.
    pub const ALL: [Self; 13] = {
        use NumberType::*;
        [Bool, U8, U16, U32, U64, I8, I16, I32, I64, F16, Bf16, F32, F64]
    };

    /// The name, the bytes of a number, what safetensors calls it, and what NumPy does.
    const fn row(self) -> (&'static str, usize, Dtype, Option<&'static str>) {
        match self {
            Self::Bool => ("bool", 1, Dtype::BOOL, Some("b1")),
            Self::U8 => ("u8", 1, Dtype::U8, Some("u1")),
            Self::U16 => ("u16", 2, Dtype::U16, Some("u2")),
            Self::U32 => ("u32", 4, Dtype::U32, Some("u4")),
            Self::U64 => ("u64", 8, Dtype::U64, Some("u8")),
            Self::I8 => ("i8", 1, Dtype::I8, Some("i1")),
            Self::I16 => ("i16", 2, Dtype::I16, Some("i2")),
            Self::I32 => ("i32", 4, Dtype::I32, Some("i4")),
            Self::I64 => ("i64", 8, Dtype::I64, Some("i8")),
            Self::F16 => ("f16", 2, Dtype::F16, Some("f2")),
            Self::Bf16 => ("bf16", 2, Dtype::BF16, None),
            Self::F32 => ("f32", 4, Dtype::F32, Some("f4")),
            Self::F64 => ("f64", 8, Dtype::F64, Some("f8")),
        }
    }

    /// The type of the numbers `T`.
    pub(super) fn for_stored<T: Stored>() -> Self {
        if T::NAME == "f32" { Self::F32 } else { Self::F64 }
    }

    /// The bytes of a number.
    pub const fn bytes(self) -> usize {
        self.row().1
    }

    /// The name in Rust; that of `Bf16` is `bf16`.
    pub const fn name(self) -> &'static str {
        self.row().0
    }

    /// What NumPy calls it after the order of bytes, as `f4`; nothing for `bf16`.
    pub(super) const fn numpy(self) -> Option<&'static str> {
        self.row().3
    }

    /// What safetensors calls it.
    pub(super) const fn dtype(self) -> Dtype {
        self.row().2
    }

    /// The numbers of `bytes`, the lowest byte of each first, where `T` has them all.
    pub(super) fn numbers<T: Stored>(self, bytes: &[u8]) -> Result<Vec<T>, Refused> {
        Ok(match self {
            // The same bits, of a NaN too.
            same if same == Self::for_stored::<T>() => T::numbers(bytes),
            // As f32 nearly all of them would be rounded.
            Self::F64 => return Err(Refused::All),
            Self::F32 => each(bytes, |b| T::from_f64(f32::from_le_bytes(b).into())),
            Self::F16 => each(bytes, |b| T::from_f64(f16::from_le_bytes(b).to_f64())),
            Self::Bf16 => each(bytes, |b| T::from_f64(bf16::from_le_bytes(b).to_f64())),
            whole => {
                return whole.whole_numbers(bytes, |number| {
                    let nearest = T::from_f64(number as f64);
                    (nearest.to_f64() as i128 == number).then_some(nearest)
                });
            }
        })
    }

    /// What `read` makes of the whole numbers of `bytes`, the lowest byte of each first.
    pub(super) fn whole_numbers<R>(
        self,
        bytes: &[u8],
        read: impl Fn(i128) -> Option<R>,
    ) -> Result<Vec<R>, Refused> {
        match self {
            Self::Bool => {
                let truth = |number| if number > 1 { None } else { read(number) };
                each_whole(bytes, |b| u8::from_le_bytes(b).into(), truth)
            }
            Self::U8 => each_whole(bytes, |b| u8::from_le_bytes(b).into(), read),
            Self::U16 => each_whole(bytes, |b| u16::from_le_bytes(b).into(), read),
            Self::U32 => each_whole(bytes, |b| u32::from_le_bytes(b).into(), read),
            Self::U64 => each_whole(bytes, |b| u64::from_le_bytes(b).into(), read),
            Self::I8 => each_whole(bytes, |b| i8::from_le_bytes(b).into(), read),
            Self::I16 => each_whole(bytes, |b| i16::from_le_bytes(b).into(), read),
            Self::I32 => each_whole(bytes, |b| i32::from_le_bytes(b).into(), read),
            Self::I64 => each_whole(bytes, |b| i64::from_le_bytes(b).into(), read),
            Self::F16 | Self::Bf16 | Self::F32 | Self::F64 => Err(Refused::All),
        }
    }
}

/// What numbers are, and what was found in their place.
pub(super) fn foreign(found: impl fmt::Display) -> String {
    let rule =
        "numbers are truth values, whole numbers of up to 64 bits, or floats of 16 to 64 bits";
    format!("{rule}, and these are {found}")
}

/// What `number` makes of each `N` bytes.
fn each<const N: usize, R>(bytes: &[u8], number: impl Fn([u8; N]) -> R) -> Vec<R> {
    bytes.as_chunks().0.iter().map(|&chunk| number(chunk)).collect()
}

/// What `read` makes of the whole number in each `N` bytes.
fn each_whole<const N: usize, R>(
    bytes: &[u8],
    whole: impl Fn([u8; N]) -> i128,
    read: impl Fn(i128) -> Option<R>,
) -> Result<Vec<R>, Refused> {
    let numbers = bytes.as_chunks().0.iter().map(|&chunk| whole(chunk)).enumerate();
    numbers.map(|(index, number)| read(number).ok_or(Refused::One(index, number))).collect()
}

impl fmt::Display for NumberType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
