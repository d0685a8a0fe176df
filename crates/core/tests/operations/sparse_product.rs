use bokashi_core::{SparseMatrix, Tape, Tensor};

/// A matrix with some ten entries in a row, and the same one dense.
fn matrix(rows: usize, columns: usize) -> (SparseMatrix<f64>, Tensor<f64>) {
    let count = if rows * columns == 0 { 0 } else { 10 * rows };
    let entries = (0..count).map(|k| {
        let at = [k * 31 % rows, k * k % columns].map(|at| at as u32);
        (at[0], at[1], (k % 7) as f64 - 3.0)
    });
    let sparse = SparseMatrix::new(rows, columns, entries).unwrap();
    let mut dense = Tensor::zeros([rows, columns]);
    for (i, j, value) in sparse.triplets() {
        dense[[i as usize, j as usize]] = value;
    }
    (sparse, dense)
}

#[test]
fn a_sparse_product_is_that_of_the_dense_matrix() {
    for (rows, columns) in [(1, 1), (7, 5), (40, 90), (300, 200), (0, 3), (3, 0)] {
        let (sparse, dense) = matrix(rows, columns);
        for width in [0, 1, 2, 3, 4, 5, 9] {
            let tape = Tape::new();
            let entry = |k: usize| (k % 11) as f64 - 5.0;
            let x = tape.leaf(&Tensor::from_flat_fn([columns, width], entry));
            let products = [sparse.product(x).unwrap(), tape.constant(&dense).matmul(x).unwrap()];
            let upstream = Tensor::from_flat_fn([rows, width], |k| (k % 5) as f64);
            let [found, expected] = products.map(|product| {
                let gradients = tape.vjp(&[(product, &upstream)]).unwrap();
                (product.value(), gradients.get_or_zeros(x))
            });
            assert_eq!(found, expected, "{rows} {columns} {width}");
        }
    }
}

#[test]
fn the_transpose_pulls_back() {
    let (sparse, _) = matrix(20, 30);
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([30], |k| k as f64));
    let y = Tensor::from_flat_fn([20], |k| (k % 7) as f64);
    let gradients = tape.vjp(&[(sparse.product(x).unwrap(), &y)]).unwrap();
    let pulled = sparse.transposed().product(tape.constant(&y)).unwrap();
    assert_eq!(gradients.get(x), Some(&pulled.value()));
}

#[test]
fn a_row_of_many_entries_keeps_its_digits_in_f32() {
    let n = 1 << 17;
    let ones = (0..n).map(|k| (0, k, 1.0_f32));
    let sum = SparseMatrix::new(1, n as usize, ones).unwrap();
    let tape = Tape::new();
    let tenths = tape.leaf_full([n as usize], 0.1);
    let exact = (f64::from(0.1_f32) * f64::from(n)) as f32;
    assert_eq!(sum.product(tenths).unwrap().item(), exact);
}
