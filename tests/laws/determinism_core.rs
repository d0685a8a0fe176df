//! The same bits for any number of threads, on arrays of many pieces.

use std::sync::Arc;

use bokashi_core::parallel::ENTRIES_PER_PIECE;
use bokashi_core::{Padding, Scalar, SparseMatrix, Tape, Tensor, TensorError, Var};
use rayon::ThreadPoolBuilder;

const ROWS: usize = ENTRIES_PER_PIECE + 77;
const COLUMNS: usize = 3;

/// Numbers between -1 and 1 whose sums depend on the order of summation.
fn numbers<T: Scalar>(shape: [usize; 2], phase: f64) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| T::from_f64((k as f64 * 0.731 + phase).sin()))
}

/// Every operation that runs in parallel, forward and backward: the values and gradients.
fn everything<T: Scalar>() -> Result<Vec<Tensor<T>>, TensorError> {
    let tape = Tape::<T>::new();
    let x = tape.leaf(&numbers([ROWS, COLUMNS], 0.0));
    let y = tape.leaf(&numbers([ROWS, COLUMNS], 1.0));
    let row = tape.leaf(&numbers([1, COLUMNS], 2.0));
    let column = tape.leaf(&numbers([ROWS, 1], 3.0));
    let one = tape.leaf_scalar(T::from_f64(0.3));
    let left = tape.leaf(&numbers([300, 190], 4.0));
    let right = tape.leaf(&numbers([190, 310], 5.0));
    let rows: Arc<[u32]> = (0..2 * ROWS).map(|k| (k * k % ROWS) as u32).collect();

    let columns = x.reshape([COLUMNS, ROWS])?;
    let entry = |k: u32| (k * 31 % 400, k * 7919 % ROWS as u32, T::from_f64(f64::from(k).sin()));
    let matrix = SparseMatrix::new(400, ROWS, (0..90_000).map(entry))?;
    let (all, little) = (Arc::from(vec![0; ROWS]), T::from_f64(0.2));

    let outputs: [Var<'_, T>; 24] = [
        (x * y + x / (y.square() + T::ONE)).sum(),
        (x * row).sigmoid().sum(),
        (x * column).tanh().mean()?,
        (one * x).maximum(y * one)?.sum(),
        x.exp().sum_axis(0)?.square().sum(),
        x.sum_axis(1)?.square().sum(),
        y.mean_axis(0)?.square().sum(),
        x.reshape([COLUMNS, ROWS])?.mean_axis(1)?.square().sum(),
        left.matmul(right)?.square().mean()?,
        (x.gather_rows(&rows)? * T::from_f64(0.1)).sin().sum(),
        Var::concat(&[x.slice(0, 1..ROWS)?, y], 0)?.softplus().sum(),
        x.transpose()?.matmul(y)?.square().sum(),
        (x.dot(y)? + x.dot(row)?).sin().sum(),
        columns.dot(columns.slice(0, 1..2)?)?.sin().sum(),
        (x.cross(y)? + x.cross(row)?).sin().sum(),
        x.norm()?.sin().sum() + columns.norm()?.sin().sum(),
        x.normalize()?.sin().sum() + columns.normalize()?.sin().sum(),
        (x.square() + little).pow(row)?.sum(),
        x.is_less(y)?.select(x.powf(T::from_f64(3.0)), one)?.relu().sin().sum(),
        Var::stack(&[x, y], 2)?.sin().sum() + row.keepdim(0)?.sum(),
        x.pad(0, [ROWS, 3 * ROWS], Padding::Mirror)?.sin().sum(),
        row.pad(0, [ROWS, 0], Padding::Clamp)?.sin().sum(),
        x.scatter_add_rows(&all, 1)?.sin().sum() + y.gather_rows(&all)?.sin().sum(),
        matrix.product(x)?.sin().sum() + matrix.transposed().product(y.slice(0, 0..400)?)?.sum(),
    ];
    let loss = outputs.into_iter().reduce(|sum, output| sum + output).expect("there are outputs");
    let gradients = loss.backward()?;
    let leaves = [x, y, row, column, one, left, right];
    let gradients = leaves.iter().map(|&leaf| gradients.get(leaf).expect("all are used").clone());
    Ok(outputs.iter().map(|output| output.value()).chain(gradients).collect())
}

fn bits<T: Scalar>(tensors: &[Tensor<T>]) -> Vec<u64> {
    tensors.iter().flat_map(|tensor| tensor.data()).map(|x| x.to_f64().to_bits()).collect()
}

fn assert_same_bits<T: Scalar>() {
    let run = |threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(everything::<T>).unwrap();
        assert!(found.iter().all(Tensor::is_finite), "a NaN hides what follows from it");
        bits(&found)
    };
    let alone = run(1);
    for threads in [2, 4, 8] {
        assert!(run(threads) == alone, "{threads} threads give other bits than one");
    }
}

#[test]
fn f32_results_are_the_same_bits_for_any_number_of_threads() {
    assert_same_bits::<f32>();
}

#[test]
fn f64_results_are_the_same_bits_for_any_number_of_threads() {
    assert_same_bits::<f64>();
}
