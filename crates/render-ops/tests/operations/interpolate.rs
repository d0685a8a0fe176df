use bokashi_core::{Dependence, Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Fragments, Mesh, RasterOptions, Sampling, Size, interpolate, interpolate_indexed, rasterize,
};
use proptest::prelude::*;
use rayon::ThreadPoolBuilder;

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

#[test]
fn three_channels_are_each_of_them_alone_for_small_faces_beside_large_ones() {
    // Two large faces, and in front of them small ones of a few pixels to some dozens.
    let mut corners = vec![[-2.0, -1.0, 0.5], [2.0, -1.0, 0.5], [-2.0, 3.0, 0.5], [2.0, 3.0, 0.5]];
    let mut faces = vec![[0, 1, 2], [1, 3, 2]];
    for k in 0..900_u32 {
        let (x, y) = (-0.97 + 0.0645 * f64::from(k % 30), -0.97 + 0.0645 * f64::from(k / 30));
        let side = 0.02 + 0.05 * (2.4 * f64::from(k)).sin().powi(2);
        faces.push([0, 1, 2].map(|corner| 4 + 3 * k + corner));
        corners.extend([[x, y, 0.0], [x + side, y, 0.0], [x, y + side, 0.0]]);
    }
    let count = corners.len();
    let mesh = Mesh::new(faces, count).unwrap();
    let clip = Tensor::from_flat_fn([count, 4], |k| match k % 4 {
        3 => 1.0_f32,
        axis => corners[k / 4][axis] as f32,
    });
    let colors = numbers::<f32>(count, 3);
    for sampling in [Sampling::Center, Sampling::Exact] {
        let tape = Tape::new();
        let options = RasterOptions::new(Size { width: 300, height: 200 }).sampling(sampling);
        let fragments = rasterize(tape.leaf(&clip), &mesh, options.creases(&[])).unwrap();
        let values = interpolate(tape.leaf(&colors), &fragments).unwrap().value();
        let mut counts = vec![0; mesh.faces().len()];
        fragments.coverage.faces().for_each(|face| counts[face] += 1);
        let small = counts.iter().filter(|count| (1..32).contains(*count)).count();
        let middle = counts.iter().filter(|count| (32..1000).contains(*count)).count();
        assert!(small > 200 && middle > 100 && counts[0] > 1000, "{small} {middle}");
        for channel in 0..3 {
            let alone = Tensor::from_flat_fn([count, 1], |k| colors.data()[3 * k + channel]);
            let alone = interpolate(tape.leaf(&alone), &fragments).unwrap().value();
            let of_three = values.data().iter().skip(channel).step_by(3);
            assert!(of_three.map(|x| x.to_bits()).eq(alone.data().iter().map(|x| x.to_bits())));
        }
    }
}

/// Vertices before the eye, near it and behind it, and faces of them.
#[derive(Debug)]
struct Drawn {
    clip: Tensor<f64>,
    mesh: Mesh,
    size: Size,
    sampling: Sampling,
    /// What the gradients of the values are multiplied by.
    scale: f64,
    /// Whether the attributes have an index buffer of their own.
    has_own: bool,
}

fn drawn() -> impl Strategy<Value = Drawn> {
    let w = prop_oneof![6 => 0.2..2.0, 1 => 1e-4..0.02, 1 => -1.5..0.2];
    let vertex = (-1.6..1.6, -1.6..1.6, -0.9..0.9, w).prop_map(|(x, y, z, w)| [x, y, z, w]);
    let vertices = prop::collection::vec(vertex, 12);
    let faces = prop::collection::vec(prop::array::uniform3(0..12_u32), 1..20);
    let size = prop_oneof![3 => (1..24_usize, 1..24_usize), 1 => Just((150, 230))];
    let sampling = prop_oneof![Just(Sampling::Center), Just(Sampling::Exact)];
    let scale = prop_oneof![4 => Just(1.0), 1 => Just(1e-290), 1 => Just(1e300), 1 => Just(1e306)];
    let all = (vertices, faces, size, sampling, scale, any::<bool>());
    all.prop_map(|(vertices, faces, size, sampling, scale, has_own)| {
        let clip = Tensor::new([12, 4], vertices.concat()).unwrap();
        let size = Size { width: size.0, height: size.1 };
        Drawn { clip, mesh: Mesh::new(faces, 12).unwrap(), size, sampling, scale, has_own }
    })
}

impl Drawn {
    /// The gradients of positions and attributes, through those of the barycentrics or past them.
    fn gradients<T: Scalar>(&self, is_through: bool) -> [Tensor<T>; 2] {
        let tape = Tape::<T>::new();
        let (clip, colors) = (tape.leaf(&self.clip.cast()), tape.leaf(&numbers(12, 3)));
        let turned = self.mesh.faces().iter().map(|&[a, b, c]| [c, (a + 1) % 12, b]).collect();
        let indices = if self.has_own { &Mesh::new(turned, 12).unwrap() } else { &self.mesh };
        let options = RasterOptions::new(self.size).sampling(self.sampling);
        let fragments = rasterize(clip, &self.mesh, options.creases(&[colors.into()])).unwrap();
        let values = interpolate_indexed(colors, indices, &fragments).unwrap();
        let upstream = numbers::<T>(fragments.coverage.count(), 3);
        let upstream = upstream.map(|x: T| T::from_f64(self.scale) * x);
        let seeds = [(values, &upstream)];
        let wrt = [clip, colors, fragments.barycentrics];
        let wrt = if is_through { &wrt[..] } else { &wrt[..2] };
        let gradients = tape.vjp_to(&seeds, wrt).unwrap();
        let [of_clip, of_colors] = [clip, colors].map(|of| gradients.get(of).cloned().unwrap());
        // Alone they are the same, to the bit.
        let is_same = |(a, b): (&T, &T)| a == b || a.to_f64().is_nan() && b.to_f64().is_nan();
        for (of, all) in [(clip, &of_clip), (colors, &of_colors)] {
            let alone = tape.vjp_to(&seeds, &[of]).unwrap().get(of).cloned().unwrap();
            assert!(is_through || alone.data().iter().zip(all.data()).all(is_same));
        }
        [of_clip, of_colors]
    }
}

/// The largest of those that are finite.
fn largest<T: Scalar>(numbers: &[T]) -> f64 {
    let finite = numbers.iter().filter(|number| number.is_finite());
    finite.fold(0.0, |most, number| number.abs().to_f64().max(most))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn gradients_past_those_of_barycentrics_are_those_through_them(drawn in drawn()) {
        let [through, past] = [true, false].map(|is_through| drawn.gradients::<f64>(is_through));
        for (through, past) in through.iter().zip(&past) {
            let most = largest(through.data());
            for (&a, &b) in through.data().iter().zip(past.data()) {
                let is_close = a == b || (a - b).abs() <= 1e-9 * most || a.is_nan() && b.is_nan();
                prop_assert_eq!(a.is_finite(), b.is_finite());
                prop_assert!(is_close, "{a} {b} of {most}");
            }
        }
    }

    #[test]
    fn gradients_past_those_of_barycentrics_have_the_same_bits_on_any_number_of_threads(drawn in drawn()) {
        let bits = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let gradients = pool.install(|| drawn.gradients::<f32>(false));
            gradients.map(|gradient| gradient.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        };
        let alone = bits(1);
        prop_assert!(bits(2) == alone && bits(4) == alone);
    }
}

#[test]
fn a_gradient_of_barycentrics_that_is_asked_for_is_there() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, SIZE);
    let colors = tape.leaf(&numbers(4, 3));
    let loss = interpolate(colors, &fragments).unwrap().square().sum();
    let all = loss.backward_to(&[fragments.barycentrics, fragments.clip]).unwrap();
    let past = loss.backward_to(&[fragments.clip]).unwrap();
    assert!(largest(all.get(fragments.barycentrics).unwrap().data()) > 0.1);
    let [all, past] = [all, past].map(|gradients| gradients.get(fragments.clip).cloned().unwrap());
    let off = all.data().iter().zip(past.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-12 * largest(all.data()));
}
