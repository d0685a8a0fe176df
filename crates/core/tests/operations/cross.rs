use bokashi_core::{Tape, Tensor, Var};

#[test]
fn unit_vectors_turn_to_the_right() {
    let tape = Tape::new();
    let unit = tape.constant(&Tensor::from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
    let next = unit.gather_rows(&std::sync::Arc::from([1, 2, 0])).unwrap();
    let last = unit.gather_rows(&std::sync::Arc::from([2, 0, 1])).unwrap();
    assert_eq!(unit.cross(next).unwrap().value(), last.value());
    assert_eq!(unit.cross(unit).unwrap().value(), Tensor::zeros([3, 3]));
}

fn part(x: Var<'_, f64>, k: usize) -> Var<'_, f64> {
    x.slice(x.shape().rank() - 1, k..k + 1).unwrap()
}

#[test]
fn cross_products_are_those_of_slices_whichever_axes_broadcast() {
    let shapes: [&[usize]; 6] = [&[4, 2, 3], &[4, 1, 3], &[2, 3], &[1, 2, 3], &[1, 3], &[3]];
    for (left, right) in shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r))) {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn(left, |k| (k % 7) as f64 - 3.0));
        let y = tape.leaf(&Tensor::from_flat_fn(right, |k| (k % 5) as f64 - 1.0));
        let fused = x.cross(y).unwrap();
        let parts = [[1, 2], [2, 0], [0, 1]].map(|[j, k]| {
            let [a, b] = [j, k].map(|k| (part(x, k), part(y, k)));
            a.0 * b.1 - b.0 * a.1
        });
        let apart = Var::concat(&parts, fused.shape().rank() - 1).unwrap();
        let upstream = Tensor::from_flat_fn(apart.shape(), |k| 1.0 + k as f64);
        let results = |z| {
            let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
            (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
        };
        assert_eq!(results(fused), results(apart), "{left:?} {right:?}");
    }
}

#[test]
fn nearly_parallel_vectors_lose_no_digits_in_f32() {
    let tape = Tape::<f32>::new();
    let x = tape.constant(&Tensor::from([1.0 + f32::EPSILON, 1.0, 0.0]));
    let y = tape.constant(&Tensor::from([1.0, 1.0 - f32::EPSILON, 0.0]));
    // (1 + e)(1 - e) - 1 = -e^2.
    let z = x.cross(y).unwrap().value();
    assert_eq!(z.data(), [0.0, 0.0, -f32::EPSILON * f32::EPSILON]);
}
