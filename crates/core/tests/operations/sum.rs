use bokashi_core::{Tape, Tensor};

#[test]
fn a_sum_of_nothing_is_zero() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::zeros([2, 0]));
    assert_eq!(x.sum().item(), 0.0);
    assert_eq!(x.sum_axis(1).unwrap().value(), Tensor::zeros([2]));
    assert_eq!(x.sum_axis(0).unwrap().value(), Tensor::zeros([0]));
    assert_eq!(x.sum().backward().unwrap().get_or_zeros(x).size(), 0);
}

#[test]
fn sums_along_every_axis_by_hand() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 3], |k| k as f64));
    assert_eq!(x.sum().item(), 15.0);
    assert_eq!(x.sum_axis(0).unwrap().value(), Tensor::new([3], vec![3.0, 5.0, 7.0]).unwrap());
    assert_eq!(x.sum_axis(1).unwrap().value(), Tensor::new([2], vec![3.0, 12.0]).unwrap());
}

#[test]
fn a_sum_in_f32_is_rounded_once() {
    let tape = Tape::<f32>::new();
    let tenths = tape.leaf(&Tensor::full([1 << 20], 0.1));
    let exact = f64::from(0.1_f32) * f64::from(1 << 20);
    assert_eq!(tenths.sum().item(), exact as f32);
}
