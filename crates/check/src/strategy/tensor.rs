//! Numbers, shapes and tensors.

use std::ops::Range;

use bokashi_core::{Shape, Tensor};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

/// Numbers in `[-3, 3]`; every fifth is 0, -0, 1, -1, or close to 0.
pub fn number() -> BoxedStrategy<f64> {
    prop_oneof![
        8 => -3.0..3.0,
        1 => select(&[0.0, -0.0, 1.0, -1.0][..]),
        1 => -1e-4..1e-4,
    ]
    .boxed()
}

/// Numbers that are not close to 0: from 0.1 to 3 in size, of both signs.
pub fn non_zero() -> BoxedStrategy<f64> {
    prop_oneof![0.1..3.0, -3.0..-0.1].boxed()
}

/// Numbers in `range`; every fourth is beside one of `kinks`, and a few lie on it, or a millionth
/// off.
pub fn around(kinks: &'static [f64], range: Range<f64>) -> BoxedStrategy<f64> {
    let near = select(&[-2e-3, 2e-3, -1e-2, 1e-2, -1e-4, 1e-4][..]);
    let offset = prop_oneof![5 => near, 1 => select(&[-1e-6, 1e-6, 0.0][..])];
    let near_kink = (select(kinks), offset).prop_map(|(kink, offset)| kink + offset);
    prop_oneof![3 => range, 1 => near_kink].boxed()
}

/// Shapes of every rank up to 3, with extents of 0 and 1 among them.
pub fn shape() -> BoxedStrategy<Shape> {
    let extent = prop_oneof![1 => Just(0_usize), 9 => 1..4_usize];
    vec(extent, 0..=3).prop_map(|axes| axes[..].into()).boxed()
}

/// Two shapes that broadcast: equal, or shortened, or with extents of 1, on either side.
pub fn broadcasting_shapes() -> BoxedStrategy<[Shape; 2]> {
    let parts = (shape(), vec(any::<[bool; 2]>(), 3), 0..=3_usize, any::<bool>());
    let shapes = parts.prop_map(|(full, repeats, shortened, left_is_short)| {
        let mut sides = [full.to_vec(), full.to_vec()];
        for (axis, &[left, right]) in repeats.iter().enumerate().take(full.len()) {
            // Both would make the axis 1 on both sides.
            if left != right {
                sides[usize::from(right)][axis] = 1;
            }
        }
        let short = &mut sides[usize::from(!left_is_short)];
        short.drain(..shortened.min(short.len()));
        sides.map(|side| Shape::from(&side[..]))
    });
    shapes.boxed()
}

/// Tensors of `shape` with entries from `entries`.
pub fn tensor(
    shape: impl Into<Shape>,
    entries: impl Strategy<Value = f64> + 'static,
) -> BoxedStrategy<Tensor<f64>> {
    let shape = shape.into();
    let data = vec(entries, shape.size());
    data.prop_map(move |data| Tensor::from_flat_fn(&shape, |k| data[k])).boxed()
}

#[cfg(test)]
mod tests {
    use super::super::draws;
    use super::*;

    #[test]
    fn numbers_hit_zero_and_one() {
        let numbers = draws(number(), 400);
        assert!(numbers.iter().all(|x| x.abs() <= 3.0));
        for special in [0.0_f64, -0.0, 1.0, -1.0] {
            assert!(numbers.iter().any(|x| x.to_bits() == special.to_bits()), "{special}");
        }
        assert!(numbers.iter().any(|x| *x != 0.0 && x.abs() < 1e-4));
        assert!(draws(non_zero(), 400).iter().all(|x| (0.1..=3.0).contains(&x.abs())));
    }

    #[test]
    fn kinks_are_hit_and_missed_by_little() {
        let numbers = draws(around(&[-1.0, 0.5], -2.0..2.0), 1000);
        for kink in [-1.0, 0.5] {
            let near = |range: Range<f64>| {
                numbers.iter().filter(|&&x| range.contains(&(x - kink))).count()
            };
            assert!(numbers.contains(&kink));
            assert!(near(-2e-2..0.0) > 20 && near(0.0..2e-2) > 20);
        }
    }

    #[test]
    fn shapes_have_every_rank_and_are_sometimes_empty() {
        let shapes = draws(shape(), 400);
        assert!((0..=3).all(|rank| shapes.iter().any(|shape| shape.rank() == rank)));
        assert!(shapes.iter().any(|shape| shape.size() == 0));
        assert!(shapes.iter().any(|shape| shape.rank() == 3 && shape.size() == 27));
    }

    #[test]
    fn pairs_of_shapes_broadcast_in_every_way() {
        let pairs = draws(broadcasting_shapes(), 400);
        for [x, y] in &pairs {
            for (x, y) in x.iter().rev().zip(y.iter().rev()) {
                assert!(x == y || *x == 1 || *y == 1);
            }
        }
        let some = |way: fn(&[Shape; 2]) -> bool| pairs.iter().any(way);
        assert!(some(|[x, y]| x == y && x.rank() > 1));
        assert!(some(|[x, y]| x.rank() < y.rank()) && some(|[x, y]| x.rank() > y.rank()));
        assert!(some(|[x, y]| x.rank() == y.rank() && x.size() > y.size() && y.size() > 0));
        assert!(some(|[x, y]| {
            let wider = |x: &Shape, y: &Shape| x.iter().zip(y.iter()).any(|(x, y)| x > y);
            x.rank() == y.rank() && wider(x, y) && wider(y, x)
        }));
    }

    #[test]
    fn a_tensor_has_its_shape() {
        for tensor in draws(tensor([2, 0, 3], number()), 3) {
            assert_eq!(tensor.shape(), &Shape::from([2, 0, 3]));
        }
    }
}
