use bokashi_core::{Tape, Tensor};

fn matrix(shape: [usize; 2], entries: &[f64]) -> Tensor<f64> {
    Tensor::new(shape, entries.to_vec()).unwrap()
}

#[test]
fn value_and_gradients_by_hand() {
    let tape = Tape::new();
    let x = tape.leaf(&matrix([2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    let y = tape.leaf(&matrix([3, 1], &[7.0, 8.0, 9.0]));
    let z = x.matmul(y).unwrap();
    assert_eq!(z.value(), matrix([2, 1], &[50.0, 122.0]));
    let gradients = tape.vjp(&[(z, &matrix([2, 1], &[1.0, 10.0]))]).unwrap();
    assert_eq!(gradients.get(x).unwrap().data(), [7.0, 8.0, 9.0, 70.0, 80.0, 90.0]);
    assert_eq!(gradients.get(y).unwrap().data(), [41.0, 52.0, 63.0]);
}

#[test]
fn the_unit_matrix_changes_nothing() {
    let tape = Tape::new();
    // Two blocks of the sixteen partial sums of a dot product, and three more.
    let n = 35;
    let x = tape.leaf(&Tensor::from_flat_fn([n, n], |k| (k as f64).sin()));
    let unit = tape.constant(&Tensor::from_flat_fn([n, n], |k| f64::from(k % (n + 1) == 0)));
    for product in [x.matmul(unit).unwrap(), unit.matmul(x).unwrap()] {
        assert_eq!(product.value(), x.value());
        let gradients = tape.vjp(&[(product, &x.value())]).unwrap();
        assert_eq!(gradients.get(x), Some(&x.value()));
    }
}

#[test]
fn an_empty_inner_axis_gives_zeros() {
    let tape = Tape::<f64>::new();
    let [x, y] = [[2, 0], [0, 3]].map(|shape| tape.leaf(&Tensor::zeros(shape)));
    let z = x.matmul(y).unwrap();
    assert_eq!(z.value(), Tensor::zeros([2, 3]));
    assert_eq!(z.sum().backward().unwrap().get_or_zeros(x).size(), 0);
}

#[test]
fn a_nan_is_not_masked_by_a_zero() {
    let tape = Tape::new();
    let x = tape.constant(&matrix([1, 2], &[0.0, 1.0]));
    let y = tape.constant(&matrix([2, 1], &[f64::NAN, 1.0]));
    assert!(x.matmul(y).unwrap().item().is_nan());
}
