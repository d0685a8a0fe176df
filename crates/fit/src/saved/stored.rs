//! The numbers that can be saved: by their bits.

use bokashi_core::Scalar;

/// A number that can be saved and comes back to the bit: `f32` and `f64`.
pub trait Stored: Scalar + Bits {}

/// Bits in files; not to be implemented elsewhere.
pub trait Bits: Sized {
    /// The name of the precision in files.
    const NAME: &'static str;
    /// Bytes of a number.
    const BYTES: usize;

    /// Appends the bits, the lowest byte first.
    fn put(self, bytes: &mut Vec<u8>);

    /// The number of `BYTES` bytes.
    fn get(bytes: &[u8]) -> Self;
}

macro_rules! stored {
    ($t:ident) => {
        impl Bits for $t {
            const NAME: &'static str = stringify!($t);
            const BYTES: usize = size_of::<$t>();

            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }

            fn get(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$t>()];
                own.copy_from_slice(bytes);
                Self::from_le_bytes(own)
            }
        }

        impl Stored for $t {}
    };
}

stored!(f32);
stored!(f64);
