//! A value on the tape, and who else knows its buffer.

use std::sync::Arc;

use crate::pool::Pool;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tensor::Tensor;

/// The entries of a value, row-major.
#[derive(Debug)]
enum Buffer<T> {
    /// The tape's alone: no reference is counted until somebody asks for the value.
    Own(Vec<T>),
    /// Known under several names, on the tape or outside.
    Shared {
        data: Arc<Vec<T>>,
        /// Whether it goes back to the pool from here: not for what a user handed in, nor for a
        /// second name of a buffer that another value returns.
        pooled: bool,
    },
}

/// A value on the tape.
#[derive(Debug)]
pub(crate) struct Value<T> {
    pub(crate) shape: Shape,
    buffer: Buffer<T>,
    /// Whether some leaf below could need a gradient through it.
    pub(crate) needs: bool,
    /// The report's entry of the operation that computed it; none for a leaf or a constant.
    pub(crate) entry: Option<u32>,
}

impl<T: Scalar> Value<T> {
    /// A value in a buffer of the pool.
    #[inline]
    pub(crate) fn own(shape: Shape, entries: Vec<T>, needs: bool, entry: Option<u32>) -> Self {
        debug_assert_eq!(shape.size(), entries.len());
        Self { shape, buffer: Buffer::Own(entries), needs, entry }
    }

    /// A value whose buffer somebody else returns, or a user handed in.
    pub(crate) fn shared(tensor: Tensor<T>, needs: bool, entry: Option<u32>) -> Self {
        let (shape, data) = tensor.into_parts();
        Self { shape, buffer: Buffer::Shared { data, pooled: false }, needs, entry }
    }

    /// The entries.
    #[inline]
    pub(crate) fn data(&self) -> &[T] {
        match &self.buffer {
            Buffer::Own(entries) => entries,
            Buffer::Shared { data, .. } => data,
        }
    }

    /// The value as an array that shares the buffer.
    pub(crate) fn tensor(&mut self, pool: &mut Pool<T>) -> Tensor<T> {
        if let Buffer::Own(entries) = &mut self.buffer {
            let data = pool.share(std::mem::take(entries));
            self.buffer = Buffer::Shared { data, pooled: true };
        }
        let Buffer::Shared { data, .. } = &self.buffer else { unreachable!("it was just shared") };
        Tensor::from_parts(self.shape.clone(), Arc::clone(data))
    }

    /// Gives the buffer back to the pool if it is the one to do so.
    #[inline]
    pub(crate) fn recycle(self, pool: &mut Pool<T>) {
        match self.buffer {
            Buffer::Own(entries) => pool.give(entries),
            Buffer::Shared { data, pooled: true } => pool.give_shared(data),
            Buffer::Shared { pooled: false, .. } => {}
        }
    }
}
