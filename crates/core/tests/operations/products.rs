use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var, hvp, jvp};

/// `sum x exp(x y)` of `[2]` and `[]`.
fn curved<'t, T: Scalar>(inputs: &[Var<'t, T>]) -> Result<Var<'t, T>, TensorError> {
    let &[x, y] = inputs else { unreachable!("there are two") };
    Ok((x * (x * y).exp()).sum())
}

#[test]
fn products_by_hand_on_one_tape() {
    let mut tape = Tape::new();
    let (x, y) = (Tensor::new([2], vec![0.3, -0.7]).unwrap(), Tensor::scalar(0.9_f64));
    let (v, w) = (Tensor::new([2], vec![1.5, 0.25]).unwrap(), Tensor::scalar(-2.0));
    let e = x.map(|x| (0.9 * x).exp());
    let near = |got: &Tensor<f64>, expected: &[f64]| {
        let pairs = got.data().iter().zip(expected);
        assert_eq!(got.size(), expected.len());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{a} {b}"));
    };
    for _ in 0..2 {
        let [value, slope] = jvp(&mut tape, &[(&x, &v), (&y, &w)], curved).unwrap();
        let sum = |term: &dyn Fn(f64, f64, f64) -> f64| {
            (0..2).map(|k| term(x.data()[k], e.data()[k], v.data()[k])).sum::<f64>()
        };
        near(&value, &[sum(&|x, e, _| x * e)]);
        let slope_to_x = |x: f64, e: f64| (1.0 + 0.9 * x) * e;
        let along = sum(&|x, e, v| slope_to_x(x, e) * v - 2.0 * x * x * e);
        near(&slope, &[along]);
        let products = hvp(&mut tape, &[(&x, &v), (&y, &w)], curved).unwrap();
        let of_x = |term: &dyn Fn(f64, f64, f64) -> f64| {
            [0, 1].map(|k| term(x.data()[k], e.data()[k], v.data()[k]))
        };
        near(&products[0][0], &of_x(&|x, e, _| slope_to_x(x, e)));
        near(&products[1][0], &[sum(&|x, e, _| x * x * e)]);
        let mixed = |x: f64, e: f64| (2.0 * x + 0.9 * x * x) * e;
        let h = of_x(&|x, e, v| (1.8 + 0.81 * x) * e * v - 2.0 * mixed(x, e));
        near(&products[0][1], &h);
        near(&products[1][1], &[sum(&|x, e, v| mixed(x, e) * v - 2.0 * x.powi(3) * e)]);
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
