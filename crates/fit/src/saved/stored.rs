//! The numbers that can be saved: by their bits.

use bokashi_core::Scalar;
use safetensors::Dtype;

/// A number that can be saved and comes back to the bit: `f32` and `f64`.
pub trait Stored: Scalar + Bits {}

/// Bits in files; not to be implemented elsewhere.
pub trait Bits: Sized {
    /// The name of the precision in files.
    const NAME: &'static str;
    /// The type of a tensor of such numbers.
    const DTYPE: Dtype;

    /// The bits of `numbers`, the lowest byte of each first.
    fn bytes(numbers: &[Self]) -> Vec<u8>;

    /// The numbers of [`Bits::bytes`].
    fn numbers(bytes: &[u8]) -> Vec<Self>;
}

macro_rules! stored {
    ($t:ident, $dtype:ident) => {
        impl Bits for $t {
            const NAME: &'static str = stringify!($t);
            const DTYPE: Dtype = Dtype::$dtype;

            fn bytes(numbers: &[Self]) -> Vec<u8> {
                numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
            }

            fn numbers(bytes: &[u8]) -> Vec<Self> {
                let (chunks, _) = bytes.as_chunks();
                chunks.iter().map(|chunk| Self::from_le_bytes(*chunk)).collect()
            }
        }

        impl Stored for $t {}
    };
}

stored!(f32, F32);
stored!(f64, F64);
