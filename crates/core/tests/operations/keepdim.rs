use bokashi_core::{Tape, Tensor};

#[test]
fn the_buffer_is_shared_and_the_shape_that_of_the_reduced_array_with_extent_one() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 3, 4], |k| k as f64));
    for axis in 0..3 {
        let sum = x.sum_axis(axis).unwrap();
        let kept = sum.keepdim(axis).unwrap();
        let mut expected = [2, 3, 4];
        expected[axis] = 1;
        assert_eq!(*kept.shape(), expected);
        assert_eq!(kept.value().data().as_ptr(), sum.value().data().as_ptr());
        let gradients = kept.square().sum().backward().unwrap();
        let apart = sum.square().sum().backward().unwrap();
        assert_eq!(gradients.get(x), apart.get(x));
    }
    let message = "keepdim needs a new axis up to the rank 3, got 4";
    assert_eq!(x.keepdim(4).unwrap_err().to_string(), message);
    assert_eq!(*tape.leaf_scalar(1.0).keepdim(0).unwrap().shape(), [1]);
}
