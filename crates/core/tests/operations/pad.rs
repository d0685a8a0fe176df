use bokashi_core::{Padding, Tape, Tensor, Var};

const ALL: [Padding<f64>; 4] =
    [Padding::Constant(9.0), Padding::Clamp, Padding::Mirror, Padding::Wrap];

#[test]
fn an_axis_goes_on_by_rule() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from([0.0, 1.0, 2.0]));
    let of = |padding| x.pad(0, [5, 4], padding).unwrap().value();
    let expected = [
        [9.0, 9.0, 9.0, 9.0, 9.0, 0.0, 1.0, 2.0, 9.0, 9.0, 9.0, 9.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0],
        [1.0, 2.0, 2.0, 1.0, 0.0, 0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 0.0],
        [1.0, 2.0, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 0.0],
    ];
    assert_eq!(ALL.map(of), expected.map(Tensor::from));
}

/// The source that position `p` shows, where `before` positions stand before `extent` sources.
fn source(padding: Padding<f64>, p: usize, before: usize, extent: usize) -> Option<usize> {
    let (i, n) = (p as isize - before as isize, extent as isize);
    let source = match padding {
        Padding::Constant(_) => (0..n).contains(&i).then_some(i)?,
        Padding::Clamp => i.clamp(0, n - 1),
        Padding::Wrap => i.rem_euclid(n),
        Padding::Mirror => i.rem_euclid(2 * n).min(2 * n - 1 - i.rem_euclid(2 * n)),
        other => unreachable!("{other:?} has no rule here"),
    };
    Some(source as usize)
}

#[test]
fn every_position_gives_its_gradient_to_its_source_along_every_axis() {
    for (shape, axis) in
        [([2, 3, 4], 0), ([2, 3, 4], 1), ([2, 3, 4], 2), ([2, 40, 3], 1), ([3, 1, 9000], 1)]
    {
        for padding in ALL {
            let tape = Tape::new();
            let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| k as f64));
            let y = x.pad(axis, [3, 7], padding).unwrap();
            let extent = shape[axis];
            let slice = |p: usize| match source(padding, p, 3, extent) {
                Some(i) => x.slice(axis, i..i + 1).unwrap(),
                None => {
                    let mut row = shape;
                    row[axis] = 1;
                    tape.constant_full(row, 9.0)
                }
            };
            let parts: Vec<_> = (0..extent + 10).map(slice).collect();
            let joined = Var::concat(&parts, axis).unwrap();
            let upstream = Tensor::from_flat_fn(y.shape(), |k| (k % 13) as f64);
            let of = |y| {
                let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
                (y.value(), gradients.get_or_zeros(x))
            };
            assert_eq!(of(y), of(joined), "{shape:?} {axis} {padding:?}");
        }
    }
}

#[test]
fn many_copies_of_an_entry_keep_their_digits_in_f32() {
    let tape = Tape::<f32>::new();
    let x = tape.leaf(&Tensor::from([0.0]));
    let n = 1 << 18;
    let exact = (f64::from(0.1_f32) * f64::from(n + 1)) as f32;
    for padding in [Padding::Clamp, Padding::Mirror, Padding::Wrap] {
        let y = x.pad(0, [0, n as usize], padding).unwrap();
        let upstream = Tensor::full([n as usize + 1], 0.1);
        assert_eq!(tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x).item(), exact);
    }
}

#[test]
fn nothing_added_is_the_identity_and_nothing_there_can_be_repeated() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::zeros([0, 3]));
    assert_eq!(*x.pad(0, [1, 1], Padding::Constant(2.0)).unwrap().value().data(), [2.0; 6]);
    let message = "pad needs an entry along the axis to repeat, got shape [0, 3]";
    assert_eq!(x.pad(0, [1, 0], Padding::Clamp).unwrap_err().to_string(), message);
    assert_eq!(*x.pad(1, [1, 0], Padding::Wrap).unwrap().shape(), [0, 4]);
    let count = tape.len();
    assert_eq!(*x.pad(0, [0, 0], Padding::Mirror).unwrap().shape(), [0, 3]);
    assert_eq!(tape.len(), count);
    let message = "pad needs an axis below the rank 2, got axis 2 of shape [0, 3]";
    assert_eq!(x.pad(2, [0, 0], Padding::Wrap).unwrap_err().to_string(), message);
    let few = tape.leaf_full([2, 2], 1.0);
    for beyond in [[usize::MAX, 0], [0, usize::MAX - 2], [1 << 63, 1 << 63], [1 << 63, 0]] {
        let message = few.pad(0, beyond, Padding::Mirror).unwrap_err().to_string();
        assert!(message.starts_with("pad needs fewer entries than fit an index, got "));
    }
}
