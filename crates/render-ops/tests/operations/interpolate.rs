use bokashi_core::{Dependence, Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, Mesh, Size, interpolate, interpolate_indexed, rasterize};

const SIZE: Size = Size { width: 7, height: 5 };

fn quad() -> Mesh {
    Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4).unwrap()
}

/// The fragments of a quad in perspective.
fn fragments<T: Scalar>(tape: &Tape<T>, size: Size) -> Fragments<'_, T> {
    let clip = [
        [-0.9, -0.8, 0.0, 1.0],
        [1.9, -1.6, 0.0, 2.0],
        [1.2, 1.4, 0.1, 1.5],
        [-0.4, 0.4, 0.0, 0.5],
    ];
    let clip = tape.leaf(&Tensor::from_flat_fn([4, 4], |k| T::from_f64(clip[k / 4][k % 4])));
    rasterize(clip, &quad(), size).unwrap()
}

fn numbers<T: Scalar>(rows: usize, channels: usize) -> Tensor<T> {
    let entry = |k: usize| ((k * 7919 + 5) % 101) as f64 / 101.0 - 0.3;
    Tensor::from_flat_fn([rows, channels], |k| T::from_f64(entry(k)))
}

#[test]
fn a_constant_attribute_comes_out_exactly() {
    let tape = Tape::<f32>::new();
    let fragments = fragments(&tape, SIZE);
    let attributes = tape.leaf(&Tensor::from_flat_fn([4, 2], |k| [0.1, 1e30][k % 2]));
    let values = interpolate(attributes, &fragments).unwrap().value();
    assert!(fragments.coverage.count() > 10);
    assert_eq!(*values.shape(), [fragments.coverage.count(), 2].into());
    assert!(values.data().chunks(2).all(|value| value == [0.1, 1e30]));
}

#[test]
fn attributes_that_are_one_constant_have_the_same_values_and_end_the_way_to_the_vertices() {
    let run = |attributes: &Tensor<f64>| {
        let tape = Tape::new();
        let fragments = fragments(&tape, SIZE);
        let ends = |attributes: Var<'_, f64>| {
            let values = interpolate(attributes, &fragments).unwrap();
            (
                format!("{:?}", values.value()),
                values.sum().dependence_on(fragments.barycentrics).unwrap(),
            )
        };
        let (frozen, learnt) = (ends(tape.constant(attributes)), ends(tape.leaf(attributes)));
        assert_eq!((frozen.0, learnt.1), (learnt.0, Dependence::Recorded));
        frozen.1
    };
    let ended = Dependence::None { end: Some("rasterize"), is_detached: true };
    assert_eq!(run(&Tensor::full([4, 1], 1.0)), ended);
    let two =
        |last: f64| Tensor::from_flat_fn([4, 2], |k| if k == 7 { last } else { (k % 2) as f64 });
    assert_eq!([run(&two(1.0)), run(&two(1.5))], [ended, Dependence::Recorded]);
    assert_eq!(run(&Tensor::full([4, 1], f64::INFINITY)), Dependence::Recorded);
}

#[test]
fn each_value_is_the_weighted_mean_of_its_corners() {
    // More fragments than a piece of work holds, with one channel and with several.
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Size { width: 211, height: 203 });
    let uv = fragments.barycentrics.value();
    let faces: Vec<_> = fragments.coverage.faces().collect();
    for channels in [1, 3, 9] {
        let attributes = numbers(4, channels);
        let values = interpolate(tape.leaf(&attributes), &fragments).unwrap().value();
        for (n, value) in values.data().chunks(channels).enumerate() {
            let face = quad().faces()[faces[n]];
            let (u, v) = (uv.data()[2 * n], uv.data()[2 * n + 1]);
            for (c, &value) in value.iter().enumerate() {
                let [a, b, d] =
                    face.map(|vertex| attributes.data()[vertex as usize * channels + c]);
                let expected = u * a + v * b + (1.0 - u - v) * d;
                approx::assert_relative_eq!(value, expected, epsilon = 1e-14);
            }
        }
    }
}

#[test]
fn backward_is_the_adjoint_in_the_attributes_and_in_the_weights() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Size { width: 211, height: 203 });
    for channels in [1, 3, 9] {
        let attributes = tape.leaf(&numbers(4, channels));
        let values = interpolate(attributes, &fragments).unwrap();
        let upstream = numbers::<f64>(fragments.coverage.count(), channels);
        let wanted = [attributes, fragments.barycentrics];
        let gradients = tape.vjp_to(&[(values, &upstream)], &wanted).unwrap();
        let dot = |x: &Tensor<f64>, y: &Tensor<f64>| -> f64 {
            x.data().iter().zip(y.data()).map(|(x, y)| x * y).sum()
        };
        // Linear in the attributes; in the weights but for the value at (0, 0), corner 2's.
        let whole = dot(&values.value(), &upstream);
        let by_attributes = dot(gradients.get(attributes).unwrap(), &attributes.value());
        approx::assert_relative_eq!(by_attributes, whole, max_relative = 1e-11);
        let faces: Vec<_> = fragments.coverage.faces().collect();
        let offset: f64 = upstream
            .data()
            .iter()
            .enumerate()
            .map(|(k, bar)| {
                let face = faces[k / channels];
                let last = quad().faces()[face][2] as usize;
                bar * attributes.value().data()[last * channels + k % channels]
            })
            .sum();
        let uv_bar = gradients.get(fragments.barycentrics).unwrap();
        let by_weights = dot(uv_bar, &fragments.barycentrics.value());
        approx::assert_relative_eq!(by_weights, whole - offset, max_relative = 1e-11);
    }
}

#[test]
fn attributes_of_the_same_fragments_add_to_the_gradients_of_their_weights() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, SIZE);
    let uv_bar = |channels: &[usize]| {
        let values = channels.iter().map(|&channels| {
            interpolate(tape.leaf(&numbers(4, channels)), &fragments).unwrap().square().sum()
        });
        let loss = values.reduce(|sum, value| sum + value).unwrap();
        loss.backward_to(&[fragments.barycentrics]).unwrap().get_or_zeros(fragments.barycentrics)
    };
    for channels in [1, 3, 9] {
        let (both, other, alone) = (uv_bar(&[channels, 2]), uv_bar(&[2]), uv_bar(&[channels]));
        for ((both, other), alone) in both.data().iter().zip(other.data()).zip(alone.data()) {
            approx::assert_relative_eq!(*both, other + alone, max_relative = 1e-12);
        }
    }
}

#[test]
fn an_index_buffer_of_its_own_gives_faces_their_own_attributes() {
    let tape = Tape::<f32>::new();
    let fragments = fragments(&tape, SIZE);
    // One attribute per face: every corner of a face names the same.
    let flat = Mesh::new(vec![[1, 1, 1], [0, 0, 0]], 2).unwrap();
    let attributes = tape.leaf(&Tensor::new([2, 1], vec![10.0, 20.0]).unwrap());
    let values = interpolate_indexed(attributes, &flat, &fragments).unwrap();
    let faces = fragments.coverage.faces();
    let expected: Vec<_> = faces.clone().map(|face| [20.0, 10.0][face]).collect();
    assert_eq!(values.value().data(), expected);
    // Each attribute's gradient is the number of its face's pixels.
    let gradients = values.sum().backward().unwrap();
    let count = |face| faces.clone().filter(|&other| other == face).count() as f32;
    let found = gradients.get(attributes).unwrap();
    approx::assert_relative_eq!(found.data()[0], count(1), max_relative = 1e-6);
    approx::assert_relative_eq!(found.data()[1], count(0), max_relative = 1e-6);
}
