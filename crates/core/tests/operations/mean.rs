use bokashi_core::{Shape, Tape, Tensor};

#[test]
fn the_mean_of_equal_numbers_is_that_number() {
    let tape = Tape::<f32>::new();
    let tenths = tape.leaf(&Tensor::full([7, 1000], 0.1));
    assert_eq!(tenths.mean().unwrap().item(), 0.1);
    assert_eq!(tenths.mean_axis(0).unwrap().value(), Tensor::full([1000], 0.1));
    assert_eq!(tenths.mean_axis(1).unwrap().value(), Tensor::full([7], 0.1));
}

#[test]
fn every_entry_gets_the_same_share() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 4], |k| k as f64));
    let all = x.mean().unwrap().backward().unwrap();
    assert_eq!(all.get(x), Some(&Tensor::full([2, 4], 1.0 / 8.0)));
    let rows = x.mean_axis(1).unwrap().sum().backward().unwrap();
    assert_eq!(rows.get(x), Some(&Tensor::full([2, 4], 1.0 / 4.0)));
}

#[test]
fn a_mean_of_nothing_is_refused() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::zeros([2, 0]));
    let message = "mean needs at least one entry to take the mean of, got shape [2, 0]";
    assert_eq!(x.mean().unwrap_err().to_string(), message);
    assert_eq!(x.mean_axis(1).unwrap_err().to_string(), message);
    assert_eq!(x.mean_axis(0).unwrap().shape(), Shape::from([0]));
    assert!(x.mean_axis(2).is_err());
}
