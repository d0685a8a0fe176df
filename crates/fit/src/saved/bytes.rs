//! Fields of a file: numbers with the lowest byte first, texts with their length before them.

use bokashi_core::{Shape, Tensor};

use super::stored::Stored;
use crate::error::FitError;

/// The most axes of a tensor: more than any operation takes.
const MOST_AXES: usize = 8;

/// Fields to be written.
#[derive(Debug, Default)]
pub struct Writer {
    /// The bytes so far.
    pub bytes: Vec<u8>,
}

impl Writer {
    /// A byte.
    pub fn byte(&mut self, byte: u8) {
        self.bytes.push(byte);
    }

    /// A whole number.
    pub fn count(&mut self, count: u64) {
        self.bytes.extend(count.to_le_bytes());
    }

    /// A number, by its bits.
    pub fn number(&mut self, number: f64) {
        self.bytes.extend(number.to_le_bytes());
    }

    /// Bytes after their number.
    pub fn block(&mut self, bytes: &[u8]) {
        self.count(bytes.len() as u64);
        self.bytes.extend(bytes);
    }

    /// A byte that says whether there is one, and then the field itself.
    pub fn option<V>(&mut self, value: Option<V>, put: impl FnOnce(&mut Self, V)) {
        self.byte(u8::from(value.is_some()));
        if let Some(value) = value {
            put(self, value);
        }
    }

    /// The number of axes, their extents, the entries.
    pub fn tensor<T: Stored>(&mut self, tensor: &Tensor<T>) {
        self.byte(tensor.shape().rank() as u8);
        tensor.shape().iter().for_each(|&extent| self.count(extent as u64));
        tensor.data().iter().for_each(|entry| entry.put(&mut self.bytes));
    }

    /// A byte that says whether there are any, and then the entries.
    pub fn entries<T: Stored>(&mut self, entries: &[T]) {
        self.byte(u8::from(!entries.is_empty()));
        entries.iter().for_each(|entry| entry.put(&mut self.bytes));
    }
}

/// Fields to be read. Nothing is allocated for what the bytes are too few for.
#[derive(Debug)]
pub struct Reader<'a> {
    left: &'a [u8],
}

impl<'a> Reader<'a> {
    /// The fields of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { left: bytes }
    }

    /// The next `count` bytes, which hold `what`.
    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], FitError> {
        let Some((taken, left)) = self.left.split_at_checked(count) else {
            let found = format!("{} of them", self.left.len());
            return Err(FitError::saved(format!("{count} bytes for {what}"), found));
        };
        self.left = left;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], FitError> {
        let mut own = [0; N];
        own.copy_from_slice(self.take(N, what)?);
        Ok(own)
    }

    /// A whole number.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn count(&mut self, what: &str) -> Result<u64, FitError> {
        self.array(what).map(u64::from_le_bytes)
    }

    /// A number.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn number(&mut self, what: &str) -> Result<f64, FitError> {
        self.array(what).map(f64::from_le_bytes)
    }

    /// A byte that stands for one of `all`.
    pub fn one_of<V: Copy>(&mut self, all: &[V], what: &str) -> Result<V, FitError> {
        let [tag] = self.array(what)?;
        all.get(usize::from(tag))
            .copied()
            .ok_or_else(|| FitError::saved(format!("a byte below {} for {what}", all.len()), tag))
    }

    /// Yes or no.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn flag(&mut self, what: &str) -> Result<bool, FitError> {
        self.one_of(&[false, true], what)
    }

    /// A block of bytes.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn block(&mut self, what: &str) -> Result<&'a [u8], FitError> {
        let count = self.count(what)?;
        self.take(usize::try_from(count).unwrap_or(usize::MAX), what)
    }

    /// A text.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn text(&mut self, what: &str) -> Result<&'a str, FitError> {
        let bytes = self.block(what)?;
        std::str::from_utf8(bytes).map_err(|_| {
            FitError::saved(format!("UTF-8 for {what}"), format!("\"{}\"", bytes.escape_ascii()))
        })
    }

    /// What `get` reads, where there is something.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn option<V>(
        &mut self,
        what: &str,
        get: impl FnOnce(&mut Self, &str) -> Result<V, FitError>,
    ) -> Result<Option<V>, FitError> {
        if self.flag(what)? { get(self, what).map(Some) } else { Ok(None) }
    }

    /// A tensor.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none, or end before.
    pub fn tensor<T: Stored>(&mut self, what: &str) -> Result<Tensor<T>, FitError> {
        let [rank] = self.array(what)?;
        if usize::from(rank) > MOST_AXES {
            return Err(FitError::saved(format!("at most {MOST_AXES} axes for {what}"), rank));
        }
        let extents = (0..rank).map(|_| self.count(what)).collect::<Result<Vec<_>, _>>()?;
        let extents: Vec<_> =
            extents.iter().map(|&extent| usize::try_from(extent).unwrap_or(usize::MAX)).collect();
        let size = match extents.contains(&0) {
            true => 0,
            false => extents.iter().fold(1, |size: usize, &extent| size.saturating_mul(extent)),
        };
        let entries = self.finite(size, what)?;
        Ok(Tensor::new(Shape::from(&extents[..]), entries)?)
    }

    /// None, or `size` entries.
    pub fn entries<T: Stored>(&mut self, size: usize, what: &str) -> Result<Vec<T>, FitError> {
        if self.flag(what)? { self.finite(size, what) } else { Ok(Vec::new()) }
    }

    /// `size` numbers, all finite.
    fn finite<T: Stored>(&mut self, size: usize, what: &str) -> Result<Vec<T>, FitError> {
        let bytes = self.take(size.saturating_mul(T::BYTES), what)?;
        let entries: Vec<T> = bytes.chunks_exact(T::BYTES).map(T::get).collect();
        match entries.iter().find(|entry| !entry.is_finite()) {
            Some(entry) => Err(FitError::saved(format!("finite numbers for {what}"), entry)),
            None => Ok(entries),
        }
    }

    /// Checks that nothing is left.
    pub fn end(&self) -> Result<(), FitError> {
        match self.left {
            [] => Ok(()),
            left => Err(FitError::saved(
                "to end with its last field",
                format!("{} bytes more", left.len()),
            )),
        }
    }
}
