use bokashi_core::SparseMatrix;

#[test]
fn triplets_come_back_by_row_and_column_with_duplicates_added_in_their_order() {
    let large = [(2, 1, 1e30), (0, 3, 2.0), (2, 1, -1e30), (0, 0, 5.0)];
    let small = [(2, 1, 0.5), (1, 1, 0.0), (2, 1, 0.25)];
    let given = large.into_iter().chain(small);
    let matrix = SparseMatrix::<f64>::new(4, 5, given).unwrap();
    let expected = [(0, 0, 5.0), (0, 3, 2.0), (1, 1, 0.0), (2, 1, 0.75)];
    assert_eq!(matrix.triplets().collect::<Vec<_>>(), expected);
    assert_eq!((matrix.rows(), matrix.columns(), matrix.entries()), (4, 5, 4));
    assert_eq!(matrix.row(0), (&[0, 3][..], &[5.0, 2.0][..]));
    assert_eq!(matrix.row(3), (&[][..], &[][..]));
    let again = SparseMatrix::new(4, 5, matrix.triplets()).unwrap();
    assert_eq!(again, matrix);
    let text = "SparseMatrix[4, 5] [(0, 0, 5.0), (0, 3, 2.0), (1, 1, 0.0), (2, 1, 0.75)]";
    assert_eq!(format!("{matrix:?}"), text);
}

#[test]
fn the_transpose_has_the_places_exchanged_and_the_transpose_of_that_is_the_matrix() {
    let entries = (0..200).map(|k| (k * 7 % 13, k * 5 % 9, f64::from(k)));
    let matrix = SparseMatrix::new(13, 9, entries).unwrap();
    let transposed = matrix.transposed();
    let mut exchanged: Vec<_> = matrix.triplets().map(|(i, j, a)| (j, i, a)).collect();
    exchanged.sort_by_key(|&(i, j, _)| (i, j));
    assert_eq!(transposed.triplets().collect::<Vec<_>>(), exchanged);
    assert_eq!((transposed.rows(), transposed.columns()), (9, 13));
    assert_eq!(transposed.transposed(), matrix);
    assert_eq!(matrix.cast::<f32>().cast::<f64>(), matrix);
}

#[test]
fn a_matrix_may_have_no_row_or_no_entry() {
    for (rows, columns) in [(0, 0), (0, 3), (3, 0), (2, 2)] {
        let matrix = SparseMatrix::<f32>::new(rows, columns, []).unwrap();
        assert_eq!((matrix.rows(), matrix.columns(), matrix.entries()), (rows, columns, 0));
    }
}

#[test]
fn entries_lie_within_the_matrix() {
    let of = |entry| SparseMatrix::new(2, 3, [(0, 0, 1.0_f64), entry]).map(drop);
    let message = "sparse_matrix needs indices within an axis of extent 2, got 2";
    assert_eq!(of((2, 9, 1.0)).unwrap_err().to_string(), message);
    let message = "sparse_matrix needs indices within an axis of extent 3, got 3";
    assert_eq!(of((1, 3, 1.0)).unwrap_err().to_string(), message);
    let message = "sparse_matrix needs at most 2^32 rows and columns, got 4294967297";
    let large = SparseMatrix::<f32>::new((1 << 32) + 1, 1, []).unwrap_err();
    assert_eq!(large.to_string(), message);
}

#[test]
#[should_panic(expected = "a row needs to be below 2, got 2")]
fn a_row_must_be_there() {
    SparseMatrix::<f32>::new(2, 3, []).unwrap().row(2);
}
