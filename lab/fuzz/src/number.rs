//! Numbers, sizes and tensors from bytes, aimed at trouble.

use arbitrary::{Result, Unstructured};
use bokashi_core::mixing::{GOLDEN, mixed};
use bokashi_core::{Scalar, Tensor};

/// The bytes of an input: with an odd first byte, followed by 4 kB that are drawn from the next
/// four bytes, so that a short input can be a whole mesh or image.
fn expanded(bytes: &[u8]) -> Vec<u8> {
    /// Enough for the largest input.
    const DRAWN: usize = 512;
    let Some((how, seed, rest)) = bytes
        .split_first()
        .and_then(|(how, rest)| rest.split_first_chunk().map(|(s, r)| (how, s, r)))
    else {
        return bytes.to_vec();
    };
    let mut all = rest.to_vec();
    if how % 2 == 1 {
        // SplitMix64: any generator would do.
        let mut state = u64::from(u32::from_le_bytes(*seed));
        for _ in 0..DRAWN {
            state = state.wrapping_add(GOLDEN);
            all.extend(mixed(state).to_le_bytes());
        }
    }
    all
}

/// What a run in `f32` or in `f64` answers of an input: a first bit says in which. Bytes that end too early stand
/// for nothing.
pub fn in_either_precision(
    bytes: &[u8],
    single: fn(&mut Unstructured<'_>) -> Result<usize>,
    double: fn(&mut Unstructured<'_>) -> Result<usize>,
) -> usize {
    let bytes = expanded(bytes);
    let mut bytes = Unstructured::new(&bytes);
    let run = if bytes.arbitrary().unwrap_or(false) { double } else { single };
    run(&mut bytes).unwrap_or(0)
}

/// Which numbers an input is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// 0 and those whose absolute value is from `1 / most` to `most`: values and gradients have to
    /// stay finite.
    Stated {
        /// The largest absolute value.
        most: f64,
    },
    /// All of them, infinities and NaN included.
    Any,
}

impl Range {
    /// Mostly the stated one of numbers of type `T`: up to 1e30, or for `f32` up to 1e6, since a
    /// gradient is a product of several of them.
    pub fn choose<T: Scalar>(bytes: &mut Unstructured<'_>) -> Result<Self> {
        let most = if size_of::<T>() == 4 { 1e6 } else { 1e30 };
        Ok(if bytes.ratio(3, 4)? { Self::Stated { most } } else { Self::Any })
    }

    /// Whether values and gradients have to stay finite.
    pub fn is_stated(self) -> bool {
        self != Self::Any
    }

    /// A number of the range.
    pub fn number(self, bytes: &mut Unstructured<'_>) -> Result<f64> {
        let number = match bytes.int_in_range(0..=7)? {
            // Multiples of 1/8: pixel centres, shared edges, equal depths, zeros.
            0..=3 => f64::from(bytes.arbitrary::<i8>()?) / 8.0,
            4 | 5 => f64::from(bytes.arbitrary::<i16>()?) / 16384.0,
            6 => {
                let exponent = bytes.int_in_range(-100..=100)?;
                let sign = if bytes.arbitrary()? { 1.0 } else { -1.0 };
                sign * 2.0_f64.powi(exponent) * (1.0 + f64::from(bytes.arbitrary::<u8>()?) / 256.0)
            }
            _ => f64::from_bits(bytes.arbitrary()?),
        };
        Ok(match self {
            Self::Any => number,
            Self::Stated { most } if (most.recip()..=most).contains(&number.abs()) => number,
            Self::Stated { .. } => 0.0,
        })
    }

    /// A tensor of shape `shape` with entries of the range.
    pub fn tensor<T: Scalar>(
        self,
        bytes: &mut Unstructured<'_>,
        shape: &[usize],
    ) -> Result<Tensor<T>> {
        let size = shape.iter().product();
        let entries = (0..size).map(|_| self.number(bytes).map(T::from_f64));
        let entries = entries.collect::<Result<Vec<_>>>()?;
        Ok(Tensor::new(shape, entries).expect("as many entries as the shape has"))
    }
}

/// Whether every entry is finite.
pub fn all_finite<T: Scalar>(entries: &[T]) -> bool {
    entries.iter().all(|entry| entry.is_finite())
}

/// The bits of the entries, whatever they are.
pub fn bits<T: Scalar>(entries: &[T]) -> Vec<u64> {
    entries.iter().map(|entry| entry.to_f64().to_bits()).collect()
}
