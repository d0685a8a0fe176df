use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var, hvp, jvp};

/// `exp(2 x y)` of `[1, 2]` and `[2, 1]`, as the square of `exp(x y)`.
fn curved<'t, T: Scalar>(inputs: &[Var<'t, T>]) -> Result<Var<'t, T>, TensorError> {
    let &[x, y] = inputs else { unreachable!("there are two") };
    let root = x.matmul(y)?.exp();
    root.matmul(root)
}

#[test]
fn products_by_hand_on_one_tape() {
    let mut tape = Tape::new();
    let ([x, y], [v, w]) = ([[0.3, -0.7], [0.9, 0.4]], [[1.5, 0.25], [-2.0, 0.5]]);
    let [row, column] = [[1, 2], [2, 1]]
        .map(|shape| move |entries: [f64; 2]| Tensor::new(shape, entries.to_vec()).unwrap());
    let point = [(&row(x), &row(v)), (&column(y), &column(w))];
    let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
    let f = (2.0 * dot(x, y)).exp();
    // How fast `x y` grows along `(v, w)`.
    let growth = dot(y, v) + dot(x, w);
    let near = |found: &Tensor<f64>, expected: &[f64]| {
        let pairs = found.data().iter().zip(expected);
        assert_eq!(found.size(), expected.len());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{a} {b}"));
    };
    for _ in 0..2 {
        let [value, slope] = jvp(&mut tape, &point, curved).unwrap();
        near(&value, &[f]);
        near(&slope, &[2.0 * f * growth]);
        let products = hvp(&mut tape, &point, curved).unwrap();
        near(&products[0][0], &y.map(|y| 2.0 * f * y));
        near(&products[1][0], &x.map(|x| 2.0 * f * x));
        let along = |other: [f64; 2], change: [f64; 2]| {
            [0, 1].map(|k| 2.0 * f * (change[k] + 2.0 * growth * other[k]))
        };
        near(&products[0][1], &along(y, w));
        near(&products[1][1], &along(x, v));
    }
}

#[test]
fn an_input_that_is_not_used_has_products_of_zero() {
    let (x, v) = (Tensor::scalar(2.0), Tensor::scalar(1.0));
    let point = [(&x, &v), (&x, &v)];
    let of = hvp(&mut Tape::new(), &point, |x| Ok::<_, TensorError>(x[0].square())).unwrap();
    assert_eq!((of[1][0].item(), of[1][1].item()), (0.0, 0.0));
    assert_eq!((of[0][0].item(), of[0][1].item()), (4.0, 2.0));
}

#[test]
fn a_tangent_has_the_shape_of_its_value_and_a_hessian_is_of_a_scalar() {
    let (x, v) = (Tensor::full([2], 1.0_f64), Tensor::full([3], 1.0));
    let message = "dual needs a tangent of its value's shape, got shapes [3] and [2]";
    let refused = jvp(&mut Tape::new(), &[(&x, &v)], |x| Ok::<_, TensorError>(x[0]));
    assert_eq!(refused.unwrap_err().to_string(), message);
    let refused = hvp(&mut Tape::new(), &[(&x, &x)], |x| Ok::<_, TensorError>(x[0]));
    assert!(matches!(refused, Err(TensorError::NotScalar { .. })));
}
