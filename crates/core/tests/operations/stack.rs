use bokashi_core::{Tape, Tensor, Var};

#[test]
fn slices_of_a_stack_are_its_parts_along_every_axis() {
    for shape in [&[2, 3][..], &[], &[4], &[0, 2], &[1, 1], &[20_000], &[3, 9_000]] {
        for axis in 0..=shape.len() {
            let tape = Tape::new();
            let parts: Vec<_> = (0..3)
                .map(|i| tape.leaf(&Tensor::from_flat_fn(shape, |k| (10 * k + i) as f64)))
                .collect();
            let stacked = Var::stack(&parts, axis).unwrap();
            let upstream = stacked.value().map(|z| 0.5 * z);
            let gradients = tape.vjp(&[(stacked, &upstream)]).unwrap();
            for (i, &part) in parts.iter().enumerate() {
                let slice = stacked.slice(axis, i..i + 1).unwrap();
                assert_eq!(slice.reshape(shape).unwrap().value(), part.value());
                assert_eq!(gradients.get_or_zeros(part), part.value().map(|x| 0.5 * x));
            }
        }
    }
}

#[test]
fn a_single_part_shares_its_buffer() {
    let tape = Tape::new();
    let x = tape.leaf_full([2, 3], 1.0);
    let y = Var::stack(&[x], 1).unwrap();
    assert_eq!(*y.shape(), [2, 1, 3]);
    assert_eq!(x.value().data().as_ptr(), y.value().data().as_ptr());
    let gradients = (y * 3.0).sum().backward().unwrap();
    assert_eq!(gradients.get(x), Some(&Tensor::full([2, 3], 3.0)));
}
