//! Recycled buffers, so that a steady step allocates nothing.

use std::sync::Arc;

use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::tensor::Tensor;

/// Buffers that nobody uses, by the power of two that their capacity reaches.
#[derive(Debug)]
pub(crate) struct Pool<T> {
    classes: Vec<Vec<Arc<Vec<T>>>>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self { classes: Vec::new() }
    }
}

impl<T: Scalar> Pool<T> {
    /// A tensor of `shape` in a buffer of its own. Its entries are whatever an earlier use left
    /// (NaN in a build with debug assertions): the taker writes every one of them.
    pub(crate) fn take(&mut self, shape: Shape) -> Tensor<T> {
        let length = shape.size();
        let class = class_of(length);
        let mut buffer = match self.classes.get_mut(class).and_then(Vec::pop) {
            Some(buffer) => buffer,
            None => Arc::new(Vec::with_capacity(1 << class)),
        };
        // A look at the length is cheaper than a check that nobody shares the buffer.
        if buffer.len() != length || cfg!(debug_assertions) {
            let data = Arc::get_mut(&mut buffer).expect("the pool holds unshared buffers alone");
            data.resize(length, T::ZERO);
            if cfg!(debug_assertions) {
                data.fill(T::from_f64(f64::NAN));
            }
        }
        Tensor::from_buffer(shape, buffer)
    }

    /// A copy of `tensor` in a buffer of the pool.
    pub(crate) fn copy(&mut self, tensor: &Tensor<T>) -> Tensor<T> {
        let mut copy = self.take(tensor.shape().clone());
        copy.own_data_mut().copy_from_slice(tensor.data());
        copy
    }

    /// Takes a buffer back, unless somebody else still holds it.
    pub(crate) fn give(&mut self, tensor: Tensor<T>) {
        let buffer = tensor.into_buffer();
        // There are no weak references, and nobody can copy a reference that is the only one.
        if Arc::strong_count(&buffer) > 1 {
            return;
        }
        // The largest class that the capacity fills, so that whoever takes it has room.
        let Some(class) = buffer.capacity().checked_ilog2() else { return };
        let class = class as usize;
        if self.classes.len() <= class {
            self.classes.resize_with(class + 1, Vec::new);
        }
        self.classes[class].push(buffer);
    }

    /// How many buffers wait to be taken.
    #[cfg(test)]
    pub(crate) fn count(&self) -> usize {
        self.classes.iter().map(Vec::len).sum()
    }
}

/// The smallest class whose buffers hold `length` entries.
fn class_of(length: usize) -> usize {
    length.max(1).next_power_of_two().ilog2() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_returned_buffer_is_taken_again() {
        let mut pool = Pool::<f64>::default();
        let tensor = pool.take([5].into());
        let address = tensor.data().as_ptr();
        pool.give(tensor);
        assert_eq!(pool.take([7].into()).data().as_ptr(), address);
    }

    #[test]
    fn a_shared_buffer_is_never_recycled() {
        let mut pool = Pool::<f64>::default();
        let mut tensor = pool.take([2].into());
        tensor.data_mut().fill(3.0);
        let held = tensor.clone();
        pool.give(tensor);
        pool.take([2].into()).data_mut().fill(4.0);
        assert_eq!(held.data(), [3.0, 3.0]);
    }

    #[test]
    fn foreign_buffers_of_odd_capacity_are_never_handed_out_too_small() {
        let mut pool = Pool::<f32>::default();
        pool.give(Tensor::zeros([6]));
        pool.give(Tensor::zeros([0]));
        for length in 0..20 {
            assert_eq!(pool.take([length].into()).size(), length);
        }
    }
}
