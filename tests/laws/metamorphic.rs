//! What may change in a scene without a change of the picture, or with a known one.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Kernel, Mesh, Radius, Size, antialias, composite, gaussian_blur,
    interpolate, rasterize,
};
use proptest::collection::vec;
use proptest::prelude::*;

/// Vertices in clip space with colours, faces, and an image size.
#[derive(Debug, Clone)]
struct Scene {
    clip: Vec<[f64; 4]>,
    colors: Vec<[f64; 2]>,
    faces: Vec<[u32; 3]>,
    size: Size,
    background: [f64; 2],
}

const BLUR: Blur =
    Blur { kernel: Kernel::Sampled, border: Border::Mirror, radius: Radius::Fixed(3) };

/// An image `[H, W, 2]` and the gradients of `sum u . image` with respect to clip positions and
/// colours.
#[derive(Debug, PartialEq)]
struct Rendered {
    image: Vec<f64>,
    clip_bar: Vec<f64>,
    color_bar: Vec<f64>,
}

impl Scene {
    /// The antialiased and, if asked for, blurred image.
    fn image<'t>(&self, clip: Var<'t, f64>, colors: Var<'t, f64>, blurs: bool) -> Var<'t, f64> {
        let tape = clip.tape();
        let mesh = Mesh::new(self.faces.clone(), self.clip.len()).unwrap();
        let fragments = rasterize(clip, &mesh, self.size).unwrap();
        let surface = interpolate(colors, &fragments).unwrap();
        let background = tape.constant(&Tensor::new([2], self.background.to_vec()).unwrap());
        let picture =
            antialias(composite(surface, &fragments, Background::Color(background)).unwrap())
                .unwrap();
        let image = picture.image().unwrap();
        let sigma = tape.leaf_scalar(0.8);
        if blurs { gaussian_blur(image, sigma, &BLUR).unwrap() } else { image }
    }

    fn leaves<'t>(&self, tape: &'t Tape<f64>) -> [Var<'t, f64>; 2] {
        let vertices = self.clip.len();
        [
            tape.leaf(&Tensor::new([vertices, 4], self.clip.as_flattened().to_vec()).unwrap()),
            tape.leaf(&Tensor::new([vertices, 2], self.colors.as_flattened().to_vec()).unwrap()),
        ]
    }

    /// The picture, and gradients for the upstream `upstream(pixel, channel)`.
    fn rendered(&self, upstream: impl Fn(usize, usize) -> f64) -> Rendered {
        let tape = Tape::new();
        let [clip, colors] = self.leaves(&tape);
        let image = self.image(clip, colors, true);
        let upstream = Tensor::from_flat_fn(image.shape(), |k| upstream(k / 2, k % 2));
        let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
        let gradient = |leaf: Var<'_, f64>| gradients.get_or_zeros(leaf).data().to_vec();
        let (clip_bar, color_bar) = (gradient(clip), gradient(colors));
        Rendered { image: image.value().data().to_vec(), clip_bar, color_bar }
    }

    /// The picture before the blur, whose border would see what was beyond the border.
    fn sharp(&self) -> Vec<f64> {
        let tape = Tape::new();
        let [clip, colors] = self.leaves(&tape);
        self.image(clip, colors, false).value().data().to_vec()
    }

    fn with_faces(&self, faces: Vec<[u32; 3]>) -> Self {
        Self { faces, ..self.clone() }
    }

    fn with_clip(&self, map: impl Fn([f64; 4]) -> [f64; 4]) -> Self {
        Self { clip: self.clip.iter().map(|&p| map(p)).collect(), ..self.clone() }
    }
}

/// Numbers of which no two are alike.
fn motley(pixel: usize, channel: usize) -> f64 {
    ((pixel * 7919 + channel * 131 + 13) % 1009) as f64 / 1009.0 - 0.4
}

/// Faces in general position: a strip, a loose one, one that may be behind the eye in part.
fn scenes() -> impl Strategy<Value = Scene> {
    let w = prop_oneof![6 => 0.6..1.6, 1 => -0.6..-0.1];
    let vertex = (-1.2..1.2, -1.2..1.2, -0.8..0.8, w);
    let sizes = (3..14_usize, 3..14_usize);
    (vec(vertex, 8), vec(prop::array::uniform2(0.0..1.0), 8), sizes).prop_map(
        |(vertices, colors, (width, height))| Scene {
            clip: vertices.into_iter().map(|(x, y, z, w)| [x, y, z * f64::abs(w), w]).collect(),
            colors,
            faces: vec![[0, 1, 2], [2, 1, 3], [2, 3, 4], [5, 6, 7], [1, 0, 7]],
            size: Size { width, height },
            background: [0.3, -0.2],
        },
    )
}

/// Of powers of two that all products stand, and of some about 1e-60 and 1e60, where a face's small
/// vertices and its large ones may come to be treated each in its own way.
fn exponents() -> impl Strategy<Value = i32> {
    prop_oneof![-900..900, -204..-194, 195..205]
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(1.0, |largest: f64, entry| largest.max(entry.abs()));
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        prop_assert!(error <= tolerance * largest, "entry {k}: {found} instead of {expected}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn permuting_the_faces_changes_no_bit_of_the_image(scene in scenes(), by in 1..5_usize) {
        let mut faces = scene.faces.clone();
        faces.rotate_left(by);
        faces.swap(0, 1);
        let (one, other) = (scene.rendered(motley), scene.with_faces(faces).rendered(motley));
        prop_assert_eq!(&one.image, &other.image);
        // The gradients are summed in the order of the pixels.
        prop_assert_eq!(one, other);
    }

    // To rounding: a pixel's three terms are added in another order.
    #[test]
    fn rotating_the_indices_of_faces_changes_nothing(scene in scenes(), by in vec(0..3_usize, 5)) {
        let mut faces = scene.faces.clone();
        faces.iter_mut().zip(&by).for_each(|(face, &by)| face.rotate_left(by));
        let (one, other) = (scene.rendered(motley), scene.with_faces(faces).rendered(motley));
        assert_close(&other.image, &one.image, 1e-12)?;
        assert_close(&other.color_bar, &one.color_bar, 1e-12)?;
        assert_close(&other.clip_bar, &one.clip_bar, 1e-9)?;
    }

    // To rounding, as above.
    #[test]
    fn reversing_windings_changes_nothing(scene in scenes(), which in vec(any::<bool>(), 5)) {
        let mut faces = scene.faces.clone();
        let reversed = faces.iter_mut().zip(&which).filter(|&(_, &reverses)| reverses);
        reversed.for_each(|(face, _)| face.reverse());
        let (one, other) = (scene.rendered(motley), scene.with_faces(faces).rendered(motley));
        assert_close(&other.image, &one.image, 1e-12)?;
        assert_close(&other.color_bar, &one.color_bar, 1e-12)?;
        assert_close(&other.clip_bar, &one.clip_bar, 1e-9)?;
    }

    #[test]
    fn a_hidden_face_changes_no_bit(scene in scenes(), which in 0..5_usize, first in any::<bool>()) {
        // The same face once more, with vertices of its own, a little further back where it is in
        // the depth range, and out of that range where the face is.
        let mut more = scene.clone();
        let hidden = [8, 9, 10];
        for corner in scene.faces[which] {
            let [x, y, z, w] = scene.clip[corner as usize];
            more.clip.push([x, y, z + 0.005 * (z + w), w]);
            more.colors.push([9.0, 9.0]);
        }
        more.faces.insert(if first { 0 } else { 5 }, hidden);
        let (one, other) = (scene.rendered(motley), more.rendered(motley));
        prop_assert_eq!(&one.image, &other.image);
        prop_assert_eq!(&one.clip_bar, &other.clip_bar[..32]);
        prop_assert_eq!(&one.color_bar, &other.color_bar[..16]);
        prop_assert!(other.clip_bar[32..].iter().chain(&other.color_bar[16..]).all(|&g| g == 0.0));
    }

    #[test]
    fn unused_vertices_change_no_bit(scene in scenes(), vertex in prop::array::uniform4(-1.0..1.0)) {
        let mut more = scene.clone();
        more.clip.push(vertex);
        more.colors.push([5.0, 5.0]);
        let (one, other) = (scene.rendered(motley), more.rendered(motley));
        prop_assert_eq!(&one.image, &other.image);
        prop_assert_eq!(&one.clip_bar, &other.clip_bar[..32]);
        prop_assert_eq!(&other.clip_bar[32..], &[0.0; 4]);
    }

    #[test]
    fn moving_by_whole_pixels_moves_the_image(scene in scenes(), right in -3..=3_isize, down in -3..=3_isize) {
        let Size { width, height } = scene.size;
        let (dx, dy) = (2.0 * right as f64 / width as f64, -2.0 * down as f64 / height as f64);
        let moved = scene.with_clip(|[x, y, z, w]| [x + dx * w, y + dy * w, z, w]).sharp();
        let image = scene.sharp();
        // Pixels that are in sight, with their neighbours, in both.
        let inner = |at: isize, extent: usize| (1..extent as isize - 1).contains(&at);
        for row in (0..height as isize).filter(|&row| inner(row, height) && inner(row + down, height)) {
            for column in (0..width as isize).filter(|&c| inner(c, width) && inner(c + right, width)) {
                let entry = |row: isize, column: isize| 2 * (row as usize * width + column as usize);
                let (from, to) = (entry(row, column), entry(row + down, column + right));
                assert_close(&moved[to..to + 2], &image[from..from + 2], 1e-10)?;
            }
        }
    }

    #[test]
    fn a_quarter_turn_turns_the_image_and_the_gradients(scene in scenes()) {
        // Counter-clockwise: (x, y) becomes (-y, x); the right column becomes the top row.
        let Size { width, height } = scene.size;
        let turned = Scene {
            size: Size { width: height, height: width },
            ..scene.with_clip(|[x, y, z, w]| [-y, x, z, w])
        };
        // Where a pixel of the turned image comes from.
        let source = |pixel: usize| {
            let (row, column) = (pixel / height, pixel % height);
            column * width + (width - 1 - row)
        };
        let one = scene.rendered(motley);
        let other = turned.rendered(|pixel, channel| motley(source(pixel), channel));
        let image: Vec<_> = (0..2 * width * height).map(|k| one.image[2 * source(k / 2) + k % 2]).collect();
        assert_close(&other.image, &image, 1e-11)?;
        assert_close(&other.color_bar, &one.color_bar, 1e-11)?;
        let clip_bar: Vec<_> = one.clip_bar.chunks(4).flat_map(|g| [-g[1], g[0], g[2], g[3]]).collect();
        assert_close(&other.clip_bar, &clip_bar, 1e-9)?;
    }

    #[test]
    fn a_loss_times_a_power_of_two_gives_gradients_times_it_exactly(scene in scenes(), k in -60..60_i32) {
        let factor = 2.0_f64.powi(k);
        let (one, other) = (scene.rendered(motley), scene.rendered(|p, c| factor * motley(p, c)));
        let scaled = |bars: &[f64]| bars.iter().map(|bar| factor * bar).collect::<Vec<_>>();
        prop_assert_eq!(other.clip_bar, scaled(&one.clip_bar));
        prop_assert_eq!(other.color_bar, scaled(&one.color_bar));
    }

    #[test]
    fn scaling_all_clip_positions_changes_no_bit_and_divides_the_gradient(scene in scenes(), k in exponents()) {
        let factor = 2.0_f64.powi(k);
        let (one, other) = (scene.rendered(motley), scene.with_clip(|p| p.map(|c| factor * c)).rendered(motley));
        prop_assert_eq!(&one.image, &other.image);
        prop_assert_eq!(&one.color_bar, &other.color_bar);
        let scaled: Vec<_> = one.clip_bar.iter().map(|bar| bar / factor).collect();
        prop_assert_eq!(scaled, other.clip_bar);
    }

    #[test]
    fn the_gradient_is_orthogonal_to_the_positions(scene in scenes()) {
        // All positions times one factor are the same points.
        let one = scene.rendered(motley);
        let terms = || one.clip_bar.iter().zip(scene.clip.as_flattened()).map(|(bar, c)| bar * c);
        let size: f64 = terms().map(f64::abs).sum();
        prop_assert!(terms().sum::<f64>().abs() <= 1e-11 * size);
    }

    #[test]
    fn a_constant_added_to_all_colours_is_added_to_the_image(scene in scenes(), more in -3.0..3.0) {
        let mut brighter = scene.clone();
        brighter.colors.iter_mut().for_each(|color| color.iter_mut().for_each(|c| *c += more));
        brighter.background.iter_mut().for_each(|c| *c += more);
        let (one, other) = (scene.rendered(motley), brighter.rendered(motley));
        let image: Vec<_> = one.image.iter().map(|c| c + more).collect();
        assert_close(&other.image, &image, 1e-13)?;
        assert_close(&other.clip_bar, &one.clip_bar, 1e-10)?;
    }

    #[test]
    fn views_on_one_tape_are_the_views_one_by_one(scene in scenes(), turns in vec(0.0..6.0, 2)) {
        // The same vertices and colours seen from several sides, in one recording and in a loop.
        let turned = |angle: f64| -> [f64; 16] {
            let (sin, cos) = f64::sin_cos(angle);
            [cos, sin, 0., 0., -sin, cos, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]
        };
        let views: Vec<_> =
            turns.iter().map(|&angle| Tensor::new([4, 4], turned(angle).to_vec()).unwrap()).collect();
        let run = |views: &[Tensor<f64>]| -> (Vec<f64>, [Tensor<f64>; 2]) {
            let tape = Tape::new();
            let [positions, colors] = scene.leaves(&tape);
            let images: Vec<_> = views
                .iter()
                .map(|view| {
                    let clip = positions.matmul(tape.constant(view)).unwrap();
                    scene.image(clip, colors, true)
                })
                .collect();
            let losses = images.iter().map(|image| image.square().sum());
            let loss = losses.reduce(|sum, loss| sum + loss).unwrap();
            let gradients = loss.backward().unwrap();
            let images = images.iter().flat_map(|image| image.value().data().to_vec()).collect();
            (images, [positions, colors].map(|leaf| gradients.get_or_zeros(leaf)))
        };
        let (images, bars) = run(&views);
        let each: Vec<_> = views.chunks(1).map(run).collect();
        let one_by_one: Vec<_> = each.iter().flat_map(|(images, _)| images.clone()).collect();
        prop_assert_eq!(images, one_by_one);
        for (k, bar) in bars.iter().enumerate() {
            // Up to the order in which the terms are added.
            let sums = each[0].1[k].data().iter().zip(each[1].1[k].data()).map(|(a, b)| a + b);
            assert_close(bar.data(), &sums.collect::<Vec<_>>(), 1e-11)?;
        }
    }

    #[test]
    fn an_upstream_gradient_of_zero_gives_zeros(scene in scenes()) {
        let rendered = scene.rendered(|_, _| 0.0);
        prop_assert!(rendered.clip_bar.iter().chain(&rendered.color_bar).all(|&bar| bar == 0.0));
    }
}

#[test]
fn a_nan_upstream_is_never_masked() {
    let scene = Scene {
        clip: vec![[-0.8, -0.9, 0.0, 1.0], [0.9, -0.7, 0.0, 1.0], [0.1, 0.8, 0.0, 1.0]],
        colors: vec![[0.1, 0.2], [0.5, 0.6], [0.9, 0.4]],
        faces: vec![[0, 1, 2]],
        size: Size::square(8),
        background: [0.0; 2],
    };
    let rendered = scene.rendered(|pixel, _| if pixel == 36 { f64::NAN } else { 0.0 });
    assert!(rendered.clip_bar.iter().any(|bar| bar.is_nan()));
    assert!(rendered.color_bar.iter().any(|bar| bar.is_nan()));
}

#[test]
fn a_target_that_is_the_picture_gives_a_loss_and_gradients_of_exactly_zero() {
    let tape = Tape::<f32>::new();
    let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let colors = tape.leaf(&Tensor::from_flat_fn([3, 3], |k| 0.1 * k as f32));
    let sigma = tape.leaf_scalar(1.1);
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let fragments = rasterize(clip, &mesh, Size::square(16)).unwrap();
    let surface = interpolate(colors, &fragments).unwrap();
    let picture = antialias(composite(surface, &fragments, Background::Zero).unwrap()).unwrap();
    let image = picture.image().unwrap();
    let image = gaussian_blur(image, sigma, &Blur::default()).unwrap();
    let loss = (image - tape.constant(&image.value())).square().sum();
    assert_eq!(loss.item(), 0.0);
    let gradients = loss.backward().unwrap();
    for leaf in [clip, colors, sigma] {
        assert!(gradients.get(leaf).unwrap().data().iter().all(|&entry| entry == 0.0));
    }
}
