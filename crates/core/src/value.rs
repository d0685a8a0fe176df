//! A value on the tape, and who else knows its buffer.
//!
//! When a step ends, a small value stays in its place with its shape and buffer: a step that repeats
//! the last one finds there what it needs. The buffer of a large one goes to whoever needs one first.

use crate::entries::Entries;
use crate::pool::{Pool, is_large};
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
        data: Entries<T>,
        /// Whether it goes back to the pool from here: not for what a user handed in, nor for a
        /// second name of a buffer that another value returns.
        pooled: bool,
    },
}

/// How a way from a value to later ones was parted, beside those that were recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parting {
    /// It was not.
    None,
    /// The operation of this entry took the value in and passed another input on.
    Idle(u32),
    /// The value went on as a constant.
    Detached,
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
    pub(crate) parting: Parting,
}

impl<T: Scalar> Value<T> {
    /// A place for a value, without one.
    pub(crate) fn vacant() -> Self {
        let (shape, buffer) = ([0].into(), Buffer::Own(Vec::new()));
        Self { shape, buffer, needs: false, entry: None, parting: Parting::None }
    }

    /// Makes this a value of `shape` and gives its entries. They are whatever an earlier use left
    /// (NaN in a build with debug assertions): the caller writes every one of them.
    #[inline]
    pub(crate) fn renew(&mut self, shape: &[usize], pool: &mut Pool<T>) -> &mut [T] {
        if !self.shape.is(shape) {
            self.resize(shape, pool);
        }
        let entries = self.data_mut();
        if cfg!(debug_assertions) {
            entries.fill(T::from_f64(f64::NAN));
        }
        entries
    }

    #[cold]
    fn resize(&mut self, shape: &[usize], pool: &mut Pool<T>) {
        let shape = Shape::from(shape);
        self.release(pool);
        self.buffer = Buffer::Own(pool.take(shape.size()));
        self.shape = shape;
    }

    /// Makes this a second name of an array that a user holds.
    pub(crate) fn hold(&mut self, tensor: &Tensor<T>, pool: &mut Pool<T>) {
        let (shape, data) = tensor.clone().into_parts();
        self.rename(shape, data, pool);
    }

    /// Makes this a second name of a buffer that somebody else returns.
    pub(crate) fn rename(&mut self, shape: Shape, data: Entries<T>, pool: &mut Pool<T>) {
        debug_assert_eq!(shape.size(), data.len());
        self.release(pool);
        self.buffer = Buffer::Shared { data, pooled: false };
        self.shape = shape;
    }

    /// The entries.
    #[inline]
    pub(crate) fn data(&self) -> &[T] {
        match &self.buffer {
            Buffer::Own(entries) => entries,
            Buffer::Shared { data, .. } => data.get(),
        }
    }

    /// The entries for writing.
    ///
    /// # Panics
    /// Where the buffer is shared.
    #[inline]
    pub(crate) fn data_mut(&mut self) -> &mut [T] {
        let Buffer::Own(entries) = &mut self.buffer else {
            unreachable!("what is shared was let go when its step ended")
        };
        entries
    }

    /// The buffer, from now on shared.
    pub(crate) fn share(&mut self, pool: &mut Pool<T>) -> Entries<T> {
        if let Buffer::Own(entries) = &mut self.buffer {
            let data = Entries::Own(pool.share(std::mem::take(entries)));
            self.buffer = Buffer::Shared { data, pooled: true };
        }
        let Buffer::Shared { data, .. } = &self.buffer else { unreachable!("it was just shared") };
        data.clone()
    }

    /// Lets go of what is shared or large, and keeps the rest for the next step.
    #[inline]
    pub(crate) fn end_step(&mut self, pool: &mut Pool<T>) {
        match &self.buffer {
            Buffer::Own(entries) if !is_large(entries.len()) => {}
            _ => self.release(pool),
        }
    }

    /// Leaves the place vacant; gives the buffer back to the pool if it is the one to do so.
    pub(crate) fn release(&mut self, pool: &mut Pool<T>) {
        self.shape = [0].into();
        match std::mem::replace(&mut self.buffer, Buffer::Own(Vec::new())) {
            Buffer::Own(entries) => pool.give(entries),
            Buffer::Shared { data, pooled: true } => pool.give_shared(data),
            Buffer::Shared { pooled: false, .. } => {}
        }
    }
}
