//! Laws of exact coverage.

use super::*;
use bokashi_render_ops::{
    Background, Cull, Mesh, RasterOptions, RenderError, Sampling, Size, composite, interpolate,
    rasterize,
};

pub(super) fn exact(size: Size) -> RasterOptions {
    RasterOptions::new(size).sampling(Sampling::Exact)
}

/// The picture `[H, W, 2]` of vertices with colours, before a background.
pub(super) fn picture<'t>(
    clip: bokashi_core::Var<'t, f64>,
    colors: bokashi_core::Var<'t, f64>,
    mesh: &Mesh,
    options: RasterOptions,
) -> bokashi_core::Var<'t, f64> {
    let fragments = rasterize(clip, mesh, options.creases(&[])).unwrap();
    let surface = interpolate(colors, &fragments).unwrap();
    let background = clip.tape().constant(&Tensor::new([2], vec![0.1, 0.9]).unwrap());
    composite(surface, &fragments, Background::Color(background)).unwrap().image().unwrap()
}

/// The mean over `times` x `times` samples per pixel.
pub(super) fn supersampled(
    clip: &Clip,
    colors: &Tensor<f64>,
    mesh: &Mesh,
    size: Size,
    times: usize,
) -> Vec<f64> {
    let Size { width, height } = size;
    let tape = Tape::<f64>::new();
    let large = Size { width: times * width, height: times * height };
    let large = picture(tape.leaf(&tensor(clip)), tape.leaf(colors), mesh, large.into());
    let mut means = vec![0.0; 2 * size.pixels()];
    for (k, value) in large.value().data().iter().enumerate() {
        let (pixel, channel) = (k / 2, k % 2);
        let (row, column) = (pixel / (times * width) / times, pixel % (times * width) / times);
        means[2 * (row * width + column) + channel] += value / (times * times) as f64;
    }
    means
}

/// Faces of one colour each, which may overlap, pass through each other, and reach out of the depth
/// range and behind the eye.
pub(super) fn loose_faces() -> impl Strategy<Value = (Clip, Tensor<f64>, Vec<[u32; 3]>)> {
    let depth = prop_oneof![4 => -0.9..0.9, 1 => -1.6..1.6];
    let w = prop_oneof![8 => 0.5..2.0, 1 => -0.6..-0.1];
    let vertex = (-1.3..1.3, -1.3..1.3, depth, w)
        .prop_map(|(x, y, z, w): (f64, f64, f64, f64)| [x * w.abs(), y * w.abs(), z * w.abs(), w]);
    let faces =
        proptest::collection::vec((prop::array::uniform3(vertex), 0.0..1.0, 0.0..1.0), 1..5);
    faces.prop_map(|faces| {
        let clip = faces.iter().flat_map(|(corners, ..)| *corners).collect();
        let colors: Vec<f64> = faces.iter().flat_map(|&(_, a, b)| [a, b].repeat(3)).collect();
        let count = faces.len();
        let faces = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        (clip, Tensor::new([3 * count, 2], colors).unwrap(), faces)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn a_pixel_is_the_mean_of_many_samples(
        (clip, colors, faces) in loose_faces(),
        width in 1..9_usize,
        height in 1..9_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 64);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.02, "{found} instead of {expected}");
        }
    }

    // Wide enough for blocks of pixels; more than a sample's width off means a pixel that was not
    // resolved.
    #[test]
    fn a_wide_image_is_the_mean_of_some_samples(
        (clip, colors, faces) in loose_faces(),
        width in 20..50_usize,
        height in 1..6_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 32);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.08, "{found} instead of {expected}");
        }
    }

    // Some hundred times what rounding can be in such scenes: ties are no wider than they have to be.
    #[test]
    fn faces_whose_depths_differ_by_more_than_rounding_are_no_tie(
        shifts in prop::array::uniform3((-0.3..0.3, -0.3..0.3, -0.9..0.9, 0.5..2.0)),
        is_large in any::<bool>(),
        (width, height) in (1..24_usize, 1..24_usize),
    ) {
        let reach = if is_large { 6.0 } else { 1.0 };
        let corners = [[-0.7, -0.6], [0.8, -0.5], [0.0, 0.8]];
        let front = [0, 1, 2].map(|k| {
            let ((dx, dy, z, w), [x, y]) = (shifts[k], corners[k]);
            [reach * (x + dx) * w, reach * (y + dy) * w, z * w, w]
        });
        // The lower face lies behind the other.
        let behind = front.map(|[x, y, z, w]| [x, y, z + 1e-9 * w, w]);
        let size = Size { width, height };
        let tape = Tape::<f64>::new();
        let seen = |clip: Clip, faces: &[[u32; 3]], colors: Vec<f64>| {
            let mesh = Mesh::new(faces.to_vec(), clip.len()).unwrap();
            let colors = tape.leaf(&Tensor::new([clip.len(), 2], colors).unwrap());
            picture(tape.leaf(&tensor(&clip)), colors, &mesh, exact(size)).value()
        };
        let both = [[0.0; 6], [1.0; 6]].concat();
        let found = seen([behind, front].concat(), &[[0, 1, 2], [3, 4, 5]], both);
        let expected = seen(front.to_vec(), &[[0, 1, 2]], vec![1.0; 6]);
        for (found, expected) in found.data().iter().zip(expected.data()) {
            prop_assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
        }
    }

    // No edge is in sight, and whole blocks of pixels see both faces.
    #[test]
    fn faces_that_cover_the_image_pass_through_each_other_where_they_do(
        depths in prop::array::uniform6(-0.9..0.9),
        width in 1..60_usize,
        height in 1..20_usize,
    ) {
        let size = Size { width, height };
        let corners = [[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]];
        let clip: Clip = (0..6).map(|k| [corners[k % 3][0], corners[k % 3][1], depths[k], 1.0]).collect();
        let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
        let colors = Tensor::from_flat_fn([6, 2], |k| if k < 6 { 0.0 } else { 1.0 });
        let tape = Tape::<f64>::new();
        let image = picture(tape.leaf(&tensor(&clip)), tape.leaf(&colors), &mesh, exact(size));
        let expected = supersampled(&clip, &colors, &mesh, size, 16);
        for (&found, expected) in image.value().data().iter().zip(expected) {
            prop_assert!((found - expected).abs() < 0.08, "{found} instead of {expected}");
        }
    }

    #[test]
    fn the_gradient_is_the_difference_quotient(
        (clip, _, faces) in loose_faces(),
        width in 1..9_usize,
        height in 1..9_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        // Other ones at each vertex, so that means move, too.
        let colors = Tensor::from_flat_fn([clip.len(), 2], |k| ((k * 29 + 5) % 13) as f64 / 13.0);
        let upstream = Tensor::from_flat_fn([height, width, 2], |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
        let loss = |clip: &Clip| -> f64 {
            let tape = Tape::<f64>::new();
            let image = picture(tape.leaf(&tensor(clip)), tape.leaf(&colors), &mesh, exact(size));
            image.value().data().iter().zip(upstream.data()).map(|(x, u)| x * u).sum()
        };
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&clip));
        let image = picture(positions, tape.leaf(&colors), &mesh, exact(size));
        let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
        let found = gradients.get_or_zeros(positions);
        let here = loss(&clip);
        for k in 0..4 * clip.len() {
            // To both sides: a face may flip within a step, and the slope is then that of one side.
            let quotients = |step: f64| {
                [1.0, -1.0].map(|sign| {
                    let mut moved = clip.clone();
                    moved[k / 4][k % 4] += sign * step;
                    (loss(&moved) - here) / (sign * step)
                })
            };
            let [coarse, fine] = [1e-5, 5e-6].map(quotients);
            let mean = |[ahead, behind]: [f64; 2]| 0.5 * (ahead + behind);
            let error = (mean(coarse) - mean(fine)).abs();
            let found = found.data()[k];
            let nearest = found.clamp(fine[0].min(fine[1]), fine[0].max(fine[1]));
            prop_assert!(
                (found - nearest).abs() < 1e-5 * (1.0 + nearest.abs()) + 3.0 * error,
                "entry {k}: {found} instead of {fine:?} ({coarse:?})"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

    /// Loops over three channels have a number that the compiler knows.
    #[test]
    fn three_channels_are_mixed_as_each_alone(
        (clip, _, faces) in loose_faces(),
        width in 1..9_usize,
        height in 1..9_usize,
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap();
        let number = |k: usize| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4;
        // The picture of some of three channels, and the gradients of values, background and positions.
        let run = |channels: std::ops::Range<usize>| {
            let tape = Tape::<f64>::new();
            let some = |rows: usize, shift: usize| -> Vec<f64> {
                let row = |k: usize| channels.clone().map(move |c| number(3 * k + c + shift));
                (0..rows).flat_map(row).collect()
            };
            let positions = tape.leaf(&tensor(&clip));
            let fragments = rasterize(positions, &mesh, exact(size).creases(&[])).unwrap();
            let count = fragments.coverage.count();
            let shape = [height, width, channels.len()];
            let values = Tensor::new([count, channels.len()], some(count, 0)).unwrap();
            let [sky, upstream] =
                [5, 9].map(|shift| Tensor::new(shape, some(size.pixels(), shift)).unwrap());
            let [values, sky] = [values, sky].map(|tensor| tape.leaf(&tensor));
            let image = composite(values, &fragments, Background::Image(sky)).unwrap();
            let image = image.image().unwrap();
            let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
            let [of_values, of_sky, of_positions] =
                [values, sky, positions].map(|var| gradients.get_or_zeros(var).data().to_vec());
            ([image.value().data().to_vec(), of_values, of_sky], of_positions)
        };
        let (found, of_positions) = run(0..3);
        let alone = [0, 1, 2].map(|c| run(c..c + 1));
        for (index, found) in found.iter().enumerate() {
            for (k, found) in found.iter().enumerate() {
                let expected = alone[k % 3].0[index][k / 3];
                prop_assert_eq!(found.to_bits(), expected.to_bits(), "{} {}: {}", index, k, found);
            }
        }
        for (k, found) in of_positions.iter().enumerate() {
            let parts = alone.each_ref().map(|(_, of_positions)| of_positions[k]);
            let bound = 1e-10 * (1.0 + parts.iter().map(|part| part.abs()).sum::<f64>());
            let expected: f64 = parts.iter().sum();
            prop_assert!((found - expected).abs() < bound, "{k}: {found} instead of {expected}");
        }
    }
}

/// The loss and the gradient of a picture of faces with a colour per vertex.
fn loss_and_gradient(
    clip: &Clip,
    faces: &[[u32; 3]],
    colors: &[f64],
    options: RasterOptions,
) -> (f64, Vec<f64>) {
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(faces.to_vec(), clip.len()).unwrap();
    let (positions, colors) = (
        tape.leaf(&tensor(clip)),
        tape.leaf(&Tensor::from_flat_fn([clip.len(), 2], |k| colors[k / 2] * (1 + k % 2) as f64)),
    );
    let image = picture(positions, colors, &mesh, options);
    let upstream =
        Tensor::from_flat_fn(image.shape(), |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
    let loss = image.value().data().iter().zip(upstream.data()).map(|(x, u)| x * u).sum();
    (loss, tape.vjp(&[(image, &upstream)]).unwrap().get_or_zeros(positions).data().to_vec())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    /// A second face in the plane of the first one, in another order of corners, however thin both are:
    /// nothing is seen of it, and nothing tells where the two would pass through each other.
    #[test]
    fn of_two_faces_in_one_place_the_first_is_seen_alone(
        middle in prop::array::uniform2(-0.5..0.5),
        angle in 0.0..6.3,
        thickness in prop_oneof![Just(0), -6..1],
        slope in prop_oneof![Just([0.0; 2]), prop::array::uniform2(-1.0..1.0)],
        ws in prop_oneof![Just([1.0; 3]), prop::array::uniform3(0.5..2.0)],
        order in 0..6_usize,
    ) {
        let (sine, cosine) = f64::sin_cos(angle);
        let place = |([along, across], w): ([f64; 2], f64)| {
            let across = across * f64::powi(10.0, thickness);
            let [x, y] = [cosine * along - sine * across, sine * along + cosine * across];
            let depth = 0.1 + slope[0] * x + slope[1] * y;
            [(middle[0] + x) * w, (middle[1] + y) * w, depth * w, w]
        };
        let corners = [[-0.5, -0.1], [0.5, -0.1], [0.1, 0.1]];
        let mut clip: Clip = corners.into_iter().zip(ws).map(place).collect();
        let size = Size::square(8);
        let colors = [1.0, 0.9, 0.8, 0.2, 0.1, 0.3];
        let alone = loss_and_gradient(&clip, &[[0, 1, 2]], &colors[..3], exact(size));
        clip.extend_from_within(..);
        let faces = [[0, 1, 2], orders([3, 4, 5])[order]];
        let both = loss_and_gradient(&clip, &faces, &colors, exact(size));
        prop_assert_eq!(both.0, alone.0);
        prop_assert_eq!(&both.1[..12], &alone.1);
        prop_assert!(both.1[12..].iter().all(|&entry| entry == 0.0), "{:?}", &both.1[12..]);
        // The same of a wall in its plane, at this depth, as of one behind it.
        let mut before_wall = |depth: f64| {
            let wall = [[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]].map(|[x, y]| [x, y, depth, 1.0]);
            clip.splice(3.., wall);
            loss_and_gradient(&clip, &[[0, 1, 2], [3, 4, 5]], &colors, exact(size))
        };
        if slope == [0.0; 2] {
            let (apart, touching) = (before_wall(0.3), before_wall(0.1));
            prop_assert!((apart.0 - touching.0).abs() < 1e-12, "{} {}", apart.0, touching.0);
            prop_assert_eq!(apart.1, touching.1);
        }
    }
}

/// However it is wound: the surface ends at a face that is not drawn.
#[test]
fn a_culled_neighbor_is_as_good_as_none() {
    let size = Size::square(8);
    let clip: Clip = vec![
        [-0.83, -0.83, 0.0, 1.0],
        [0.83, -0.81, 0.0, 1.0],
        [-0.8, 0.83, 0.0, 1.0],
        [0.8, 0.9, 0.0, 1.0],
    ];
    let colors = [1.0, 0.9, 0.8, 0.7];
    for cull in [Cull::Back, Cull::Front] {
        let options = exact(size).cull(cull);
        let face = if cull == Cull::Back { [0, 1, 2] } else { [0, 2, 1] };
        let alone = loss_and_gradient(&clip, &[face], &colors, options);
        for other in orders([1, 2, 3]) {
            let both = loss_and_gradient(&clip, &[face, other], &colors, options);
            let is_culled =
                draw::<f64>(&clip, &[other], RasterOptions::new(size).cull(cull)).count() == 0;
            assert_eq!(both == alone, is_culled, "{cull:?}, {other:?}");
        }
    }
}

/// Its depth leaves the range of the numbers: nothing is seen of it, and it hides nothing.
#[test]
fn a_face_without_a_depth_is_not_there() {
    let size = Size::square(8);
    let sizes = [1e300, 1e304, f64::MAX];
    for [first, second] in sizes.into_iter().flat_map(|z| [[z, -z], [z, 0.0], [0.0, -z]]) {
        let at = |[x, y, z]: [f64; 3]| [x, y, z, 1.0];
        let mut clip: Clip =
            [[-0.83, -0.83, first], [0.83, -0.81, second], [-0.1, 0.83, 0.0]].map(at).into();
        let (nothing, gradient) = loss_and_gradient(&clip, &[[0, 1, 2]], &[0.5; 3], exact(size));
        let empty = loss_and_gradient(&clip, &[], &[0.5; 3], exact(size));
        assert_eq!((nothing, gradient), empty);
        clip.extend([[-3.0, -3.0, 0.5], [9.0, -3.0, 0.5], [-3.0, 9.0, 0.5]].map(at));
        let colors = [0.5, 0.5, 0.5, 0.2, 0.2, 0.2];
        let wall = loss_and_gradient(&clip, &[[3, 4, 5]], &colors, exact(size));
        let both = loss_and_gradient(&clip, &[[0, 1, 2], [3, 4, 5]], &colors, exact(size));
        assert!((both.0 - wall.0).abs() < 1e-12, "{} {}", both.0, wall.0);
    }
}

/// Colours and a background whose difference is beyond the largest number have a mean.
#[test]
fn a_pixel_of_extreme_colors_has_their_mean() {
    let size = Size::square(4);
    let clip: Clip =
        vec![[-0.83, -0.83, 0.0, 1.0], [0.83, -0.81, 0.0, 1.0], [-0.1, 0.83, 0.0, 1.0]];
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let image = |scale: f64| {
        let tape = Tape::<f64>::new();
        let fragments =
            rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
        let surface = interpolate(tape.constant(&Tensor::full([3, 1], scale)), &fragments).unwrap();
        let background = tape.leaf(&Tensor::full([1], -scale));
        let image =
            composite(surface, &fragments, Background::Color(background)).unwrap().image().unwrap();
        let by_background = image.sum().backward().unwrap().get_or_zeros(background).item();
        (image.value(), by_background)
    };
    let ((plain, of_plain), (huge, of_huge)) = (image(1.0), image(f64::MAX));
    assert_eq!(of_plain, of_huge);
    for (plain, huge) in plain.data().iter().zip(huge.data()) {
        approx::assert_relative_eq!(*plain, huge / f64::MAX, epsilon = 1e-15);
    }
}

/// Far from the middle of a large image, where a plane around that middle says little of so thin a
/// face: it is seen before what fills all its pixels, and has its slope.
#[test]
fn a_needle_before_a_surface_has_its_slope() {
    let size = Size::square(2048);
    let width = 1e-8;
    let (p, along) = ([1_100.2, 1_070.3], [903.1, 911.7]);
    let length = f64::hypot(along[0], along[1]);
    let q = [p[0] + along[0], p[1] + along[1]];
    let across = [along[1] / length, -along[0] / length];
    let r = [q[0] + width * across[0], q[1] + width * across[1]];
    let place = |[x, y]: [f64; 2], w: f64, depth: f64| {
        [w * (x / 1024.0 - 1.0), w * (1.0 - y / 1024.0), w * depth, w]
    };
    for depth in [0.1, 0.1 + 1e-12, -0.3] {
        let mut clip: Clip = [p, q, r].map(|point| place(point, 3.0, depth)).into();
        let cover = [[-9e3, -9e3], [9e3, -9e3], [0.0, 2e4]];
        clip.extend(cover.map(|point| place(point, 1.0, depth + 1e-6)));
        let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&tensor(&clip));
        let fragments = rasterize(positions, &mesh, exact(size).creases(&[])).unwrap();
        let is_needle = |face: usize| f64::from(u8::from(face == 0));
        let coverage = &fragments.coverage;
        let of_pieces = coverage.faces().skip(coverage.centers());
        let weight = fragments.weight.unwrap();
        let upstream = Tensor::new(weight.shape(), of_pieces.map(is_needle).collect()).unwrap();
        let gradient = tape.vjp(&[(weight, &upstream)]).unwrap().get_or_zeros(positions);
        // r moves across: half the length for each pixel, 3 units of clip space for 1024 of them.
        let [x, y] = [gradient.data()[8], -gradient.data()[9]].map(|bar| bar * 3.0 / 1024.0);
        let slope = x * across[0] + y * across[1];
        assert!((slope / (0.5 * length) - 1.0).abs() < 1e-6, "{depth}: {slope}");
    }
}

/// From behind the eye to beyond the far plane, before a wall: nothing but where it meets that is a
/// boundary.
#[test]
fn a_ground_that_is_clipped_makes_no_boundary_of_its_inside() {
    let size = Size::square(64);
    // At height -1 below the eye, at the distances -1 and 50, far at about 11; a wall at 8.
    let ground = |x: f64, w: f64| [x, -1.0, 1.2 * w - 2.2, w];
    let wall = |x: f64, y: f64| [8.0 * x, 8.0 * y, 1.2 * 8.0 - 2.2, 8.0];
    let clip: Clip = vec![
        ground(-90.0, -1.0),
        ground(90.0, -1.0),
        ground(0.0, 50.0),
        wall(-3.0, -3.0),
        wall(9.0, -3.0),
        wall(-3.0, 9.0),
    ];
    let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
    let tape = Tape::<f64>::new();
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, exact(size).creases(&[])).unwrap();
    let counts = fragments.coverage.boundary_counts();
    // A row of pixels, or two beside its line, and where the ground leaves the near plane.
    let seen = fragments.coverage.faces().filter(|&face| face == 0).count();
    assert!(seen > 64 * 10 && (64..=4 * 64).contains(&counts.pixels), "{seen} {counts:?}");
}

/// A plane that reaches far away within a pixel: 1 / w nearly vanishes along its far edge, and the loss
/// has a limit.
#[test]
fn the_gradient_of_a_horizon_is_the_difference_quotient() {
    let (size, mesh) = (Size::square(16), Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4).unwrap());
    let colors = Tensor::from_flat_fn([4, 2], |k| ((k * 29 + 5) % 13) as f64 / 13.0);
    let upstream = Tensor::from_flat_fn([16, 16, 2], |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
    for power in [0, 1, 2, 4, 6, 8, 10, 12, 14, 16] {
        let far = f64::powi(10.0, power);
        let at = |height: f64| -> (f64, f64) {
            let corner = |x: f64, y: f64, w: f64| [x * w, y * w, 0.0, w];
            let clip = vec![
                corner(-1.2, -0.8, 1.0),
                corner(1.2, -0.8, 1.0),
                corner(0.8, height, far),
                corner(-0.7, height, far),
            ];
            let tape = Tape::<f64>::new();
            let positions = tape.leaf(&tensor(&clip));
            let image = picture(positions, tape.constant(&colors), &mesh, exact(size));
            let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
            let found = gradients.get_or_zeros(positions);
            assert!(found.data().iter().all(|entry| entry.is_finite()), "{far}");
            let loss = image.value().data().iter().zip(upstream.data()).map(|(x, u)| x * u).sum();
            (loss, far * (found.data()[9] + found.data()[13]))
        };
        let (_, found) = at(0.33);
        let step = 1e-6;
        let quotient = (at(0.33 + step).0 - at(0.33 - step).0) / (2.0 * step);
        assert!(
            (found - quotient).abs() < 1e-6 * (1.0 + quotient.abs()),
            "{far}: {found} {quotient}"
        );
        assert!(power <= 10 || (found + 1.667_754_7).abs() < 1e-6, "{far}: {found}");
    }
}

#[test]
fn exact_coverage_without_a_word_on_creases_is_refused() {
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let clip = tape.leaf(&Tensor::zeros([3, 4]));
    let error = rasterize(clip, &mesh, exact(Size::square(4))).unwrap_err();
    assert_eq!(error, RenderError::UnnamedCreases);
    assert!(error.to_string().ends_with("got options alone"));
    // Of pixel centres nothing is asked.
    rasterize(clip, &mesh, RasterOptions::new(Size::square(4))).unwrap();
}

#[test]
fn pixels_at_the_creases_of_named_attributes_are_resolved_and_at_no_others() {
    let tape = Tape::<f64>::new();
    let mesh = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4).unwrap();
    let corners = [[-2.0, -2.0], [2.0, -2.0], [-2.0, 2.0], [2.0, 2.0]];
    let clip = tape.leaf(&Tensor::from_fn([4, 4], |[vertex, k]| match k {
        0 | 1 => corners[vertex][k],
        2 => 0.0,
        _ => 1.0,
    }));
    let attribute = |last: f64| tape.constant(&Tensor::from([[0.0], [1.0], [1.0], [last]]));
    // Linear over both faces, and bent at the edge between them.
    let (flat, bent) = (attribute(2.0), attribute(0.0));
    let options = exact(Size::square(8));
    let pixels = |attributes: &[_]| {
        let fragments = rasterize(clip, &mesh, options.creases(attributes)).unwrap();
        fragments.coverage.boundary_counts().pixels
    };
    assert_eq!([pixels(&[]), pixels(&[flat.into()])], [0, 0]);
    assert!(pixels(&[flat.into(), bent.into()]) >= 8);
    // They are the seams of the mesh that was rasterized.
    let seams = mesh.with_seams(|face, corner| mesh.faces()[face][corner].is_multiple_of(3));
    let by_hand = rasterize(clip, &seams, options.creases(&[])).unwrap();
    let found = rasterize(clip, &mesh, options.creases(&[bent.into()])).unwrap();
    assert_eq!(found.barycentrics.value(), by_hand.barycentrics.value());
    assert!(found.coverage.mesh().is_seam(0, 0) && found.coverage.mesh().is_seam(1, 2));
    let loose = options.crease_tolerance(10.0).creases(&[]);
    assert_eq!(rasterize(clip, &mesh, loose).unwrap().coverage.boundary_counts().pixels, 0);
}
