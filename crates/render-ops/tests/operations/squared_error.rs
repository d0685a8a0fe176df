use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{Background, Mesh, PixelLoss, Size, antialias, composite, rasterize};

#[test]
fn the_error_is_exactly_zero_where_the_reference_is_the_picture() {
    let tape = Tape::<f32>::new();
    let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let fragments = rasterize(clip, &mesh, Size::square(100)).unwrap();
    let values = Tensor::from_flat_fn([fragments.coverage.count(), 3], |k| (k as f32).sqrt());
    let values = tape.leaf(&values);
    let color = Tensor::full([3], 0.3);
    let background = Background::Color(tape.constant(&color));
    let picture = antialias(composite(values, &fragments, background).unwrap()).unwrap();
    let reference = PixelLoss::squared(&picture.image().unwrap().value(), &color).unwrap();
    let loss = picture.loss(&reference).unwrap();
    assert_eq!(loss.item(), 0.0);
    let gradients = loss.backward().unwrap();
    assert!(gradients.get(values).unwrap().data().iter().all(|&bar| bar == 0.0));
}

#[test]
fn passes_over_one_recording_have_the_same_bits_though_the_first_one_gives_its_slopes_away() {
    let mut tape = Tape::<f32>::new();
    let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = Tensor::new([3, 4], clip.to_vec()).unwrap();
    let goal = Tensor::from_flat_fn([40, 40, 3], |k| (k * 7 % 31) as f32 / 31.0);
    let reference = PixelLoss::squared(&goal, &Tensor::zeros([3])).unwrap();
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let mut seen = Vec::new();
    // The second step finds the memory of the first.
    for _ in 0..2 {
        {
            let clip = tape.leaf(&clip);
            let fragments = rasterize(clip, &mesh, Size::square(40)).unwrap();
            let count = fragments.coverage.count();
            let values = Tensor::from_flat_fn([count, 3], |k| (k as f32).sin());
            let values = tape.leaf(&values);
            let before = composite(values, &fragments, Background::Zero).unwrap();
            let picture = antialias(before).unwrap();
            let after = picture.values();
            let loss = picture.loss(&reference).unwrap();
            let leaves = [values, clip];
            let of_all = |loss: Var<'_, f32>| {
                let gradients = loss.backward_to(&[values, clip, after]).unwrap();
                [values, clip, after].map(|of| gradients.get(of).unwrap().clone())
            };
            let of_leaves = |loss: Var<'_, f32>| {
                let gradients = loss.backward().unwrap();
                leaves.map(|of| gradients.get(of).unwrap().clone())
            };
            let first = of_leaves(loss);
            assert_eq!(of_leaves(loss), first);
            let all = of_all(loss);
            assert_eq!(all[..2], first);
            assert_eq!(of_all(loss), all);
            // A power of two changes no bit but of the exponent.
            assert_eq!(of_all(loss * 2.0), all.clone().map(|bar| bar.map(|bar| 2.0 * bar)));
            assert_eq!(of_leaves(loss), first);
            assert_eq!(values.value().data().len(), 3 * count);
            seen.push((loss.item(), first));
        }
        tape.reset();
    }
    assert_eq!(seen[0], seen[1]);
}

#[test]
fn the_error_before_a_large_reference_is_that_of_a_dense_image() {
    // More than a megabyte, of which rows are read beforehand where runs are short.
    let size = Size { width: 400, height: 300 };
    let tape = Tape::<f64>::new();
    let corners = (0..600).flat_map(|k| {
        let (x, y) = (-0.95 + 0.063 * f64::from(k % 30), -0.95 + 0.09 * f64::from(k / 30));
        [[x, y, 0.0, 1.0], [x + 0.04, y + 0.01, 0.0, 1.0], [x + 0.01, y + 0.07, 0.0, 1.0]]
    });
    let clip = tape.leaf(&Tensor::new([1800, 4], corners.flatten().collect()).unwrap());
    let mesh = Mesh::new((0..600).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 1800).unwrap();
    let fragments = rasterize(clip, &mesh, size).unwrap();
    let runs = fragments.coverage.runs().count();
    assert!(fragments.coverage.count() > 2000 && fragments.coverage.count() < 16 * runs);
    let values = Tensor::from_flat_fn([fragments.coverage.count(), 3], |k| (k % 13) as f64);
    let values = tape.leaf(&values);
    let picture = composite(values, &fragments, Background::Zero).unwrap();
    // Whole numbers: sums are exact.
    let goal = Tensor::from_flat_fn([size.height, size.width, 3], |k| (k * 7 % 31) as f64);
    let loss = picture.loss(&PixelLoss::squared(&goal, &Tensor::zeros([3])).unwrap()).unwrap();
    let image = picture.image().unwrap().value();
    let square = |(x, r): (&f64, &f64)| (x - r) * (x - r);
    assert_eq!(loss.item(), image.data().iter().zip(goal.data()).map(square).sum::<f64>());
    let bars = loss.backward().unwrap();
    let slopes = image.data().iter().zip(goal.data()).map(|(x, r)| 2.0 * (x - r));
    let slopes: Vec<_> = slopes.collect();
    let mut expected = vec![0.0; 3 * fragments.coverage.count()];
    fragments.coverage.gather(&slopes, 3, &mut expected);
    assert_eq!(bars.get(values).unwrap().data(), expected);
}
