use std::sync::Arc;

use bokashi_core::{Tape, Tensor, Var};

#[test]
fn rows_of_one_index_are_added_and_each_gets_the_gradient_of_its_sum() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]));
    let y = x.scatter_add_rows(&Arc::from([2, 0, 2]), 4).unwrap();
    assert_eq!(y.value(), Tensor::from([[3.0, 4.0], [0.0, 0.0], [6.0, 8.0], [0.0, 0.0]]));
    let upstream = Tensor::from_flat_fn([4, 2], |k| k as f64);
    let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
    assert_eq!(gradients.get(x), Some(&Tensor::from([[4.0, 5.0], [0.0, 1.0], [4.0, 5.0]])));
}

#[test]
fn scattering_is_the_adjoint_of_gathering() {
    for (count, length, inner) in [(5, 9, 3), (1, 40_000, 2), (30_000, 20_000, 1), (3, 7, 19)] {
        let rows: Arc<[u32]> = (0..length).map(|r| (r * 7919 % count) as u32).collect();
        let number = |k: usize| (k * 31 % 11) as f64 - 5.0;
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([length, inner], number));
        let y = tape.leaf(&Tensor::from_flat_fn([count, inner], number));
        let (scattered, gathered) =
            (x.scatter_add_rows(&rows, count).unwrap(), y.gather_rows(&rows).unwrap());
        let of_gather = tape.vjp(&[(gathered, &x.value())]).unwrap().get_or_zeros(y);
        let of_scatter = tape.vjp(&[(scattered, &y.value())]).unwrap().get_or_zeros(x);
        assert_eq!((scattered.value(), gathered.value()), (of_gather, of_scatter));
    }
}

#[test]
fn many_rows_of_an_index_keep_their_digits_in_f32() {
    let tape = Tape::<f32>::new();
    let n = 1 << 17;
    let x = tape.leaf(&Tensor::full([n], 0.1));
    let all: Arc<[u32]> = vec![0; n].into();
    let sum = x.scatter_add_rows(&all, 1).unwrap();
    assert_eq!(sum.item(), (f64::from(0.1_f32) * n as f64) as f32);
}

#[test]
fn the_list_is_let_go_with_the_step() {
    let mut tape = Tape::new();
    let rows = Arc::from([0]);
    let _ = tape.leaf(&Tensor::full([1, 1], 1.0)).scatter_add_rows(&rows, 2).unwrap();
    assert_eq!(Arc::strong_count(&rows), 2);
    tape.reset();
    assert_eq!(Arc::strong_count(&rows), 1);
}

#[test]
fn another_list_of_a_later_step_is_sorted_anew() {
    let mut tape = Tape::new();
    for k in 0..4 {
        let rows: Arc<[u32]> = Arc::from([k % 2, 1, k % 2]);
        let x = tape.leaf(&Tensor::from([1.0, 10.0, 100.0]));
        let sums = x.scatter_add_rows(&rows, 2).unwrap().value();
        let expected = if k % 2 == 0 { [101.0, 10.0] } else { [0.0, 111.0] };
        assert_eq!(sums, Tensor::from(expected));
        tape.reset();
    }
}

#[test]
fn there_is_a_row_per_index_and_each_index_has_its_place() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::zeros([3, 2]));
    let of = |rows: &[u32], count| x.scatter_add_rows(&Arc::from(rows), count).map(Var::value);
    let message = "scatter_add_rows needs 2 rows, one per index, got shape [3, 2]";
    assert_eq!(of(&[0, 1], 2).unwrap_err().to_string(), message);
    let message = "scatter_add_rows needs indices within an axis of extent 3, got 3";
    assert_eq!(of(&[0, 3, 9], 3).unwrap_err().to_string(), message);
    assert!(tape.leaf_scalar(0.0).scatter_add_rows(&Arc::from([]), 1).is_err());
    let message =
        "scatter_add_rows needs memory for its output, got shape [9223372036854775808, 2]";
    assert_eq!(of(&[0, 0, 0], 1 << 63).unwrap_err().to_string(), message);

    let none = tape.leaf(&Tensor::zeros([0, 2]));
    let sums = none.scatter_add_rows(&Arc::from([]), 2).unwrap();
    assert_eq!(sums.value(), Tensor::zeros([2, 2]));
    assert_eq!(none.scatter_add_rows(&Arc::from([]), 0).unwrap().shape().size(), 0);
    let empty = tape.leaf(&Tensor::zeros([2, 0]));
    let sums = empty.scatter_add_rows(&Arc::from([1, 1]), usize::MAX).unwrap();
    assert_eq!(*sums.shape(), [usize::MAX, 0]);
    assert_eq!(sums.sum().backward().unwrap().get_or_zeros(empty).size(), 0);
}
