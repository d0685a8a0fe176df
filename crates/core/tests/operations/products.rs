use bokashi_core::{Dual, ForwardDual, Scalar, Tape, Tensor, TensorError, Var, hvp, jvp};

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
    let refused =
        jvp(&mut Tape::<ForwardDual<f64>>::new(), &[(&x, &v)], |x| Ok::<_, TensorError>(x[0]));
    assert_eq!(refused.unwrap_err().to_string(), message);
    let refused = hvp(&mut Tape::new(), &[(&x, &x)], |x| Ok::<_, TensorError>(x[0]));
    assert!(matches!(refused, Err(TensorError::NotScalar { .. })));
}

#[test]
fn forward_only_numbers_have_the_same_bits() {
    let [x, v, w] = [[0.3, -0.7], [0.9, 0.4], [1.5, 0.25]].map(|x| Tensor::new([1, 2], x.to_vec()));
    let (x, v, w) = (x.unwrap(), v.unwrap(), w.unwrap());
    let columns = [&v, &w].map(|x| Tensor::new([2, 1], x.data().to_vec()).unwrap());
    let point = [(&x, &v), (&columns[0], &columns[1])];
    let both = jvp(&mut Tape::<Dual<f64>>::new(), &point, curved).unwrap();
    let forward = jvp(&mut Tape::<ForwardDual<f64>>::new(), &point, curved).unwrap();
    assert_eq!(forward, both);
}

#[test]
fn forward_only_numbers_keep_nothing_and_a_backward_pass_over_them_is_refused() {
    let tape = Tape::new();
    let x = tape.leaf_scalar(ForwardDual { value: 3.0, tangent: 1.0 });
    let parts = tape.sum_over(2, &[x], |_, _, x| Ok::<_, TensorError>(x[0].square()));
    let y = parts.unwrap() + x;
    assert_eq!((y.item().value, y.item().tangent), (21.0, 13.0));
    assert!(!y.needs_gradient());
    assert_eq!(format!("{tape:?}"), "Tape { values: 3, nodes: [] }");
    let one = Tensor::scalar(ForwardDual { value: 1.0, tangent: 0.0 });
    let refused = [
        y.backward(),
        y.backward_to(&[x]),
        tape.vjp(&[(y, &one)]),
        tape.vjp_to(&[(y, &one)], &[x]),
        x.backward(),
    ];
    for refused in refused {
        assert!(matches!(refused, Err(TensorError::ForwardOnly { .. })));
    }
}
