//! The entries of a tensor: in a buffer of the engine, or where somebody else keeps them.

use std::fmt;
use std::ops::Deref;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;

/// Memory of somebody else, which is read where it lies.
pub(crate) type Owner<T> = Arc<dyn AsRef<[T]> + Send + Sync>;

/// Entries that several may know. Cloning copies none of them.
pub(crate) enum Entries<T> {
    /// In a buffer that can be used again.
    Own(Arc<Vec<T>>),
    /// Somebody else's. They are only read, so a panic leaves nothing half done.
    Foreign(AssertUnwindSafe<Owner<T>>),
}

impl<T> Entries<T> {
    /// The entries. In a place of its own: many ask.
    #[inline(never)]
    pub(crate) fn get(&self) -> &[T] {
        match self {
            Self::Own(buffer) => buffer,
            Self::Foreign(owner) => (***owner).as_ref(),
        }
    }
}

impl<T: Clone> Entries<T> {
    /// The buffer for writing, after a copy where it is shared or somebody else's.
    pub(crate) fn make_mut(&mut self) -> &mut [T] {
        if let Self::Foreign(owner) = self {
            *self = (***owner).as_ref().to_vec().into();
        }
        let Self::Own(buffer) = self else { unreachable!("it was just copied") };
        let buffer: &mut Vec<T> = Arc::make_mut(buffer);
        buffer
    }

    /// The buffer, after a copy where it is shared or somebody else's.
    pub(crate) fn into_vec(self) -> Vec<T> {
        match self {
            Self::Own(buffer) => Arc::unwrap_or_clone(buffer),
            Self::Foreign(owner) => (**owner).as_ref().to_vec(),
        }
    }
}

impl<T> Clone for Entries<T> {
    fn clone(&self) -> Self {
        match self {
            Self::Own(buffer) => Self::Own(Arc::clone(buffer)),
            Self::Foreign(owner) => Self::Foreign(AssertUnwindSafe(Arc::clone(owner))),
        }
    }
}

impl<T> From<Owner<T>> for Entries<T> {
    fn from(owner: Owner<T>) -> Self {
        Self::Foreign(AssertUnwindSafe(owner))
    }
}

impl<T> From<Vec<T>> for Entries<T> {
    fn from(entries: Vec<T>) -> Self {
        Self::Own(Arc::new(entries))
    }
}

impl<T> Deref for Entries<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        self.get()
    }
}

impl<T: fmt::Debug> fmt::Debug for Entries<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
