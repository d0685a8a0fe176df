//! Arrays of the crate `ndarray`, in any order in memory.

use ::ndarray::{Array, Array2, ArrayD, ArrayView1, Axis, IxDyn, ShapeBuilder as _, Slice};
use bokashi_core::Tensor;

use super::*;

#[test]
fn entries_follow_their_indices_wherever_they_lie() {
    let array = Array::from_shape_fn((2, 3, 4), |(i, j, k)| (100 * i + 10 * j + k) as f64);
    let expected = |shape: [usize; 3], at: &dyn Fn([usize; 3]) -> [usize; 3]| {
        Tensor::from_fn(shape, |index| array[at(index)])
    };
    let plain = Tensor::from_fn([2, 3, 4], |[i, j, k]| (100 * i + 10 * j + k) as f64);
    assert_eq!(tensor_of_ndarray(&array), plain);
    assert_eq!(tensor_of_ndarray(array.t()), expected([4, 3, 2], &|[k, j, i]| [i, j, k]));
    let mut turned = array.view();
    turned.slice_axis_inplace(Axis(1), Slice::new(0, None, -1));
    turned.slice_axis_inplace(Axis(2), Slice::new(1, None, 2));
    assert_eq!(tensor_of_ndarray(turned), expected([2, 3, 2], &|[i, j, k]| [i, 2 - j, 1 + 2 * k]));
    let columns =
        Array2::from_shape_vec((2, 3).f(), vec![0.0_f32, 3.0, 1.0, 4.0, 2.0, 5.0]).unwrap();
    assert_eq!(tensor_of_ndarray(&columns), Tensor::from([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]));
    // All of one entry, repeated by steps of 0.
    let one = Array::from_elem((1, 3), 7.0_f64);
    assert_eq!(tensor_of_ndarray(one.broadcast((4, 3)).unwrap()), Tensor::full([4, 3], 7.0));
    let line = ArrayView1::from(&[1.0_f32, 2.0]);
    assert_eq!(tensor_of_ndarray(line), Tensor::from([1.0, 2.0]));
    let mut moved = array.clone();
    moved.invert_axis(Axis(0));
    moved.swap_axes(0, 2);
    assert_eq!(tensor_of_ndarray(&moved), expected([4, 3, 2], &|[k, j, i]| [1 - i, j, k]));
}

#[test]
fn a_view_shares_the_buffer() {
    let tensor = Tensor::from([[1.0, 2.0], [3.0, 4.0]]);
    let view = ndarray_view(&tensor).unwrap();
    assert_eq!(view.as_ptr(), tensor.data().as_ptr());
    assert_eq!((view[[0, 1]], view[[1, 0]]), (2.0, 3.0));
}

#[test]
fn what_ndarray_does_not_take_is_an_error() {
    let tensor = Tensor::<f32>::zeros(&[0, 1 << 40, 1 << 40][..]);
    let message = ndarray_of(&tensor).unwrap_err().to_string();
    assert!(message.starts_with("ndarray_view needs a shape that ndarray takes"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_tensor_comes_back_with_every_bit(shape in shapes(), seed: u64, is_fortran: bool) {
        let number = |k: usize| f64::from_bits(seed.wrapping_mul(2 * k as u64 + 1));
        let tensor = Tensor::from_flat_fn(shape.as_slice(), number);
        let array = ndarray_of(&tensor).unwrap();
        prop_assert_eq!(array.shape(), &shape[..]);
        let array = match is_fortran {
            // The same entries in another order in memory.
            true => {
                let mut other = ArrayD::zeros(IxDyn(&shape).f());
                other.assign(&array);
                other
            }
            false => array,
        };
        let back = tensor_of_ndarray(&array);
        prop_assert_eq!(back.shape(), tensor.shape());
        let bits = |tensor: &Tensor<f64>| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back), bits(&tensor));
    }
}
