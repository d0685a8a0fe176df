//! Inputs and values that subjects of every kind need.

use bokashi_check::Input;
use bokashi_check::strategy::{number, tensor};
use bokashi_core::{Scalar, Tensor, Var};
use proptest::prelude::*;

pub(crate) fn wide<T: Scalar>(var: Var<'_, T>) -> Tensor<f64> {
    var.value().cast()
}

/// A leaf with all entries alike.
pub(crate) fn leaf<const N: usize>(axes: [usize; N], entry: f64) -> Input {
    Input::leaf(Tensor::full(axes, entry))
}

/// Leaves of these shapes.
pub(crate) fn leaves_of_shapes(shapes: &[&[usize]]) -> BoxedStrategy<Vec<Input>> {
    let tensors: Vec<_> = shapes.iter().map(|&axes| tensor(axes, number())).collect();
    tensors.prop_map(|tensors| tensors.into_iter().map(Input::leaf).collect()).boxed()
}

pub(crate) fn leaves(tensors: impl IntoIterator<Item = Tensor<f64>>) -> Vec<Input> {
    tensors.into_iter().map(Input::leaf).collect()
}

/// A leaf of ones, but one entry.
pub(crate) fn with_one<const N: usize>(axes: [usize; N], k: usize, entry: f64) -> Input {
    Input::leaf(Tensor::from_flat_fn(axes, |other| if other == k { entry } else { 1.0 }))
}
