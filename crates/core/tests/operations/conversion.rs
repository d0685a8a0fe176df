use bokashi_core::Tensor;

#[test]
fn shapes_are_those_of_what_was_given() {
    let rows = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]];
    let matrix = Tensor::new([3, 2], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
    for same in [
        Tensor::from(rows),
        Tensor::from(&rows[..]),
        Tensor::from(rows.to_vec()),
        rows.iter().copied().collect(),
    ] {
        assert_eq!(same, matrix);
    }
    let list = Tensor::new([3], vec![1.0_f32, 2.0, 3.0]).unwrap();
    for same in [
        Tensor::from([1.0, 2.0, 3.0]),
        Tensor::from(vec![1.0, 2.0, 3.0]),
        Tensor::from(&[1.0, 2.0, 3.0][..]),
        (1..4).map(|k| k as f32).collect(),
    ] {
        assert_eq!(same, list);
    }
    assert_eq!(Tensor::from(2.5_f64), Tensor::scalar(2.5));
    assert_eq!(*Tensor::<f64>::from(Vec::<[f64; 3]>::new()).shape(), [0, 3].into());
}

#[test]
fn what_came_from_rows_goes_back_to_them() {
    let rows = vec![[1.0_f64, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let matrix = Tensor::from(rows.clone());
    assert_eq!(Vec::<[f64; 3]>::try_from(&matrix).as_ref(), Ok(&rows));
    assert_eq!(Vec::<[f64; 3]>::try_from(matrix.clone()), Ok(rows));
    assert_eq!(matrix.as_ref(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let error = Vec::<[f64; 2]>::try_from(matrix.clone()).unwrap_err();
    assert_eq!(error.to_string(), "rows needs shape [n, 2], got shape [2, 3]");
    assert_eq!(Vec::from(matrix), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
}
