//! Laws of antialiasing.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Cull, Fragments, Mesh, RasterOptions, Sampling, Size, antialias, antialias_image,
    composite, rasterize,
};

/// Vertices and faces.
#[derive(Clone)]
struct Scene {
    clip: Vec<[f64; 4]>,
    faces: Vec<[u32; 3]>,
    size: Size,
}

impl Scene {
    /// A scene of points in pixels from the image's top left corner, and their depths.
    fn from_points(points: &[[f64; 3]], faces: &[[u32; 3]], size: Size) -> Self {
        let (width, height) = (size.width as f64, size.height as f64);
        let clip =
            points.iter().map(|&[x, y, z]| [2.0 * x / width - 1.0, 1.0 - 2.0 * y / height, z, 1.0]);
        Self { clip: clip.collect(), faces: faces.to_vec(), size }
    }

    fn positions<'t, T: Scalar>(&self, tape: &'t Tape<T>) -> Var<'t, T> {
        tape.leaf(&Tensor::from_flat_fn([self.clip.len(), 4], |k| {
            T::from_f64(self.clip[k / 4][k % 4])
        }))
    }

    fn rasterized<'t, T: Scalar>(&self, clip: Var<'t, T>) -> Fragments<'t, T> {
        let mesh = Mesh::new(self.faces.clone(), self.clip.len()).unwrap();
        rasterize(clip, &mesh, self.size).unwrap()
    }

    /// The antialiased picture `[H, W]` whose entry at pixel k is `color(k, id of its face)`.
    fn picture<T: Scalar>(&self, color: impl Fn(usize, u32) -> f64) -> Vec<f64> {
        let tape = Tape::<T>::new();
        let clip = self.positions(&tape);
        let fragments = self.rasterized(clip);
        let image = tape.leaf(&self.image(&fragments, color));
        let out = antialiased(image, &fragments).value();
        out.data().iter().map(|entry| entry.to_f64()).collect()
    }

    fn image<T: Scalar>(
        &self,
        fragments: &Fragments<'_, T>,
        color: impl Fn(usize, u32) -> f64,
    ) -> Tensor<T> {
        let ids = fragments.coverage.triangle_ids();
        Tensor::from_flat_fn([self.size.height, self.size.width, 1], |k| {
            T::from_f64(color(k, ids[k]))
        })
    }

    /// The gradient of `sum out_bar . out` with respect to the image and the positions.
    fn gradients(&self, image: &[f64], out_bar: &[f64]) -> [Vec<f64>; 2] {
        let tape = Tape::<f64>::new();
        let clip = self.positions(&tape);
        let fragments = self.rasterized(clip);
        let image = tape.leaf(&self.image(&fragments, |k, _| image[k]));
        let out = antialiased(image, &fragments);
        let upstream = Tensor::new(out.shape(), out_bar.to_vec()).unwrap();
        let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
        [image, clip].map(|variable| gradients.get_or_zeros(variable).data().to_vec())
    }
}

/// The antialiased image of `image: [H, W, 1]`, whose uncovered pixels are the background.
fn antialiased<'t, T: Scalar>(image: Var<'t, T>, fragments: &Fragments<'t, T>) -> Var<'t, T> {
    antialias_image(image, fragments).unwrap()
}

/// Colours that differ from pixel to pixel.
fn motley(k: usize) -> f64 {
    ((k * 7919 + 13) % 101) as f64 / 101.0
}

fn is_covered(_: usize, id: u32) -> f64 {
    f64::from(id.min(1))
}

const SIZE: Size = Size { width: 9, height: 6 };

/// A face whose only edge in sight runs down the image at `x` px, on the left of it or the right.
fn upright(x: f64, on_left: bool) -> Scene {
    let far = if on_left { -200.0 } else { 200.0 };
    Scene::from_points(&[[x, -300.0, 0.0], [x, 300.0, 0.0], [far, 3.0, 0.0]], &[[0, 1, 2]], SIZE)
}

/// The same across the image.
fn level(y: f64, above: bool) -> Scene {
    let far = if above { -200.0 } else { 200.0 };
    Scene::from_points(&[[-300.0, y, 0.0], [300.0, y, 0.0], [3.0, far, 0.0]], &[[0, 1, 2]], SIZE)
}

/// The image with its rows and columns exchanged.
fn transposed(image: &[f64], width: usize) -> Vec<f64> {
    let height = image.len() / width;
    (0..image.len()).map(|k| image[k % height * width + k / height]).collect()
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() <= tolerance, "entry {k}: {found} instead of {expected}");
    }
}

#[test]
fn an_upright_or_level_edge_gives_the_area_that_is_covered() {
    for part in [0.02, 0.25, 0.4999, 0.5, 0.5001, 0.75, 0.98] {
        for first in [1.0, 4.0] {
            let edge = first + part;
            let share = |at: usize| (edge - at as f64).clamp(0.0, 1.0);
            for near in [true, false] {
                let share = |at: usize| if near { share(at) } else { 1.0 - share(at) };
                let columns: Vec<_> = (0..54).map(|k| share(k % 9)).collect();
                assert_close(&upright(edge, near).picture::<f64>(is_covered), &columns, 1e-13);
                assert_close(&upright(edge, near).picture::<f32>(is_covered), &columns, 1e-5);
                let rows: Vec<_> = (0..54).map(|k| share(k / 9)).collect();
                assert_close(&level(edge, near).picture::<f64>(is_covered), &rows, 1e-13);
                assert_close(&level(edge, near).picture::<f32>(is_covered), &rows, 1e-5);
            }
        }
    }
}

#[test]
fn a_face_seen_edge_on_to_within_rounding_makes_a_silhouette() {
    // Its third vertex lies on the edge that it shares, or off it by less than rounding: then its
    // area has a sign, by accident.
    for near in [true, false] {
        let alone = upright(4.25, near);
        let expected = alone.picture::<f64>(is_covered);
        for nudge in [-1e-15, 0.0, 1e-15] {
            let mut scene = alone.clone();
            let [x, ..] = scene.clip[0];
            scene.clip.push([x + nudge, 0.1, 0.0, 1.0]);
            for face in [[1, 0, 3], [0, 1, 3]] {
                scene.faces.truncate(1);
                scene.faces.push(face);
                let tape = Tape::<f64>::new();
                let fragments = scene.rasterized(scene.positions(&tape));
                assert_eq!(fragments.coverage.culled().degenerate, 1);
                assert_close(&scene.picture::<f64>(is_covered), &expected, 0.0);
            }
        }
    }
}

#[test]
fn moving_an_upright_or_level_edge_moves_the_sum_of_the_image_by_the_area() {
    // The area is H x or W y pixels, and a pixel is 2 / W by 2 / H; y runs up.
    let image = |scene: &Scene| {
        scene.rasterized(scene.positions(&Tape::<f64>::new())).coverage.triangle_ids()
    };
    for (part, near) in [(0.25, true), (0.75, true), (0.25, false), (0.75, false)] {
        let direction = if near { 1.0 } else { -1.0 };
        for (scene, axis, area) in
            [(upright(4.0 + part, near), 0, 27.0), (level(3.0 + part, near), 1, -27.0)]
        {
            let image: Vec<_> = image(&scene).into_iter().map(f64::from).collect();
            let [_, clip_bar] = scene.gradients(&image, &[1.0; 54]);
            let moved = clip_bar[axis] + clip_bar[4 + axis];
            approx::assert_relative_eq!(moved, direction * area, max_relative = 1e-12);
            // The third vertex is on no edge in sight, and depth plays no part.
            assert!(clip_bar[8..].iter().all(|&entry| entry == 0.0));
            assert!(clip_bar.chunks(4).all(|vertex| vertex[2] == 0.0));
        }
    }
}

#[test]
fn a_constant_image_is_unchanged() {
    let out = star().picture::<f64>(|_, _| 0.7);
    assert!(out.iter().all(|&entry| entry == 0.7));
    let [_, clip_bar] = star().gradients(&[0.7; 54], &[1.0; 54]);
    assert!(clip_bar.iter().all(|&entry| entry == 0.0));
}

/// Two faces at an edge, a third one that hides parts of them, in general position.
fn star() -> Scene {
    let points = [
        [0.7, 0.9, 0.3],
        [7.8, 1.3, 0.2],
        [4.2, 5.4, 0.1],
        [8.9, 5.2, 0.4],
        [2.3, -1.1, -0.3],
        [5.9, 2.8, -0.2],
        [0.2, 4.6, -0.4],
    ];
    Scene::from_points(&points, &[[0, 1, 2], [2, 1, 3], [4, 5, 6]], SIZE)
}

#[test]
fn transposing_the_scene_transposes_the_image() {
    for scene in [star(), upright(4.3, true), level(2.2, false)] {
        let mut across = scene.clone();
        across.size = Size { width: scene.size.height, height: scene.size.width };
        across.clip.iter_mut().for_each(|[x, y, ..]| (*x, *y) = (-*y, -*x));
        let colors: Vec<_> = (0..54).map(motley).collect();
        let turned = transposed(&colors, 9);
        let [image, turned] =
            [scene.picture::<f64>(|k, _| colors[k]), across.picture::<f64>(|k, _| turned[k])];
        assert!(image != colors);
        assert_close(&turned, &transposed(&image, 9), 1e-13);
    }
}

/// A speck around a pixel's centre, blended on three sides: the shares would add up to more than 1.
#[test]
fn a_speck_does_not_leave_the_range_of_its_neighbours() {
    let speck = |shift: f64| {
        let at = |x: f64, y: f64| [4.5 + shift + 0.02 * x, 2.5 + 0.02 * y, 0.0];
        Scene::from_points(&[at(-1.0, -1.2), at(2.0, -0.9), at(-0.7, 2.1)], &[[0, 1, 2]], SIZE)
    };
    for (inside, outside) in [(1.0, 0.0), (0.0, 1.0)] {
        let color = |_: usize, id: u32| if id > 0 { inside } else { outside };
        let image = speck(0.0).picture::<f64>(color);
        assert!(image.iter().all(|value| (0.0..=1.0).contains(value)), "{image:?}");
        // All of it has gone to the neighbours.
        assert!((image[2 * 9 + 4] - outside).abs() < 1e-15);
    }
    // Neighbours of colours of their own, and the difference quotient.
    let image: Vec<_> = (0..54).map(motley).collect();
    let out_bar: Vec<_> = (0..54).map(|k| motley(3 * k + 1) - 0.5).collect();
    let [_, clip_bar] = speck(0.0).gradients(&image, &out_bar);
    let loss = |scene: &Scene| -> f64 {
        let out = scene.picture::<f64>(|k, _| image[k]);
        out.iter().zip(&out_bar).map(|(out, bar)| out * bar).sum()
    };
    let scene = speck(0.0);
    for k in (0..12).filter(|k| k % 4 != 2) {
        let by = |step: f64| {
            let mut moved = scene.clone();
            moved.clip[k / 4][k % 4] += step;
            loss(&moved)
        };
        let quotient = (by(1e-6) - by(-1e-6)) / 2e-6;
        let size = 1.0 + quotient.abs();
        assert!((clip_bar[k] - quotient).abs() < 1e-7 * size, "{k}: {} {quotient}", clip_bar[k]);
    }
}

/// A face of some hundredths of a pixel around the centre of a pixel is blended with all four neighbours. Their
/// colours are white, or nearly alike, so that sums are rounded beyond them.
#[test]
fn sums_of_blends_stay_within_the_range_of_what_they_blend_to_the_bit() {
    fn check<T: Scalar>(colors: impl Fn(usize) -> f64, seed: usize) {
        let share = |k: usize| ((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0;
        let size = Size::square(3);
        let radius = if seed.is_multiple_of(2) { 0.02 } else { 0.6 };
        let corner = |k: usize| {
            let angle = std::f64::consts::TAU * (k as f64 + 0.6 * share(k)) / 3.0;
            let reach = radius * (0.6 + share(k + 3));
            [1.5 + reach * angle.cos(), 1.5 + reach * angle.sin(), 0.0]
        };
        let speck = Scene::from_points(&[corner(0), corner(1), corner(2)], &[[0, 1, 2]], size);
        let out = speck.picture::<T>(|k, _| colors(k));
        let value = |k: usize| T::from_f64(colors(k)).to_f64();
        let neighbors = |k: usize| {
            let (row, column) = (k / 3, k % 3);
            let beside = [(k + 1, column < 2), (k + 3, row < 2)];
            let before = [(k.wrapping_sub(1), column > 0), (k.wrapping_sub(3), row > 0)];
            beside.into_iter().chain(before).filter(|value| value.1).map(|value| value.0)
        };
        for (k, &found) in out.iter().enumerate() {
            let all = || neighbors(k).chain([k]).map(value);
            let (least, most) = (all().fold(f64::MAX, f64::min), all().fold(f64::MIN, f64::max));
            assert!(least <= found && found <= most, "{seed}: {k}: {found:e} {least:e} {most:e}");
        }
    }
    let ulps = |k: usize, ulp: f64| 1.0 + (k * 5 % 7) as f64 * ulp;
    for seed in 0..2000 {
        check::<f64>(|k| f64::from(k == 4), seed);
        check::<f64>(|k| f64::from(k != 4), seed);
        check::<f32>(|k| f64::from(k == 4), seed);
        check::<f64>(|k| ulps(k + seed, f64::EPSILON), seed);
        check::<f32>(|k| ulps(k + seed, f64::from(f32::EPSILON)), seed);
    }
}

#[test]
fn an_inner_edge_is_no_silhouette_and_leaves_the_image_itself() {
    // Two faces that cover the image, whichever way they are cut and wound.
    let points = [[-9.0, -9.0, 0.0], [20.0, -8.0, 0.1], [22.0, 18.0, 0.2], [-8.0, 15.0, 0.0]];
    for faces in [[[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [3, 2, 0]], [[1, 2, 3], [0, 1, 3]]] {
        let scene = Scene::from_points(&points, &faces, SIZE);
        let tape = Tape::<f32>::new();
        let clip = scene.positions(&tape);
        let fragments = scene.rasterized(clip);
        assert_eq!(fragments.coverage.count(), 54);
        assert!((0..2).all(|face| fragments.coverage.faces().any(|other| other == face)));
        let image = tape.leaf(&scene.image(&fragments, |k, _| motley(k)));
        let out = antialiased(image, &fragments);
        assert_eq!(out.value(), image.value());
        assert!(tape.take_report().left_out.iter().any(|entry| entry.name == "antialias_image"));
        // The gradient passes through, and there is none for the positions.
        let gradients = out.square().sum().backward().unwrap();
        let doubled: Vec<_> = image.value().data().iter().map(|c| 2.0 * c).collect();
        assert_eq!(gradients.get(image).unwrap().data(), doubled);
        assert!(gradients.get_or_zeros(clip).data().iter().all(|&entry| entry == 0.0));
    }
}

#[test]
fn where_a_surface_turns_away_its_edge_is_as_good_as_a_boundary() {
    // A roof seen along its ridge: the second face hides behind the first.
    let points = [[4.3, -300.0, 0.0], [4.4, 300.0, 0.0], [-200.0, 3.0, -0.2], [-190.0, 4.0, 0.2]];
    for second in [[0, 3, 1], [1, 0, 3]] {
        let roof = Scene::from_points(&points, &[[0, 1, 2], second], SIZE);
        let alone = Scene::from_points(&points, &[[0, 1, 2]], SIZE);
        let color = |k: usize, id: u32| motley(k) + f64::from(id);
        assert_eq!(roof.picture::<f64>(color), alone.picture::<f64>(color));
        // With the fourth vertex on the other side the surface goes on.
        let mut flat = roof.clone();
        flat.clip[3][0] *= -1.0;
        assert_eq!(flat.picture::<f64>(|k, _| motley(k)), (0..54).map(motley).collect::<Vec<_>>());
    }
}

/// However it is wound: the surface ends at a face that is not drawn.
#[test]
fn a_culled_neighbor_makes_a_silhouette() {
    let points = [[1.2, 0.7, 0.0], [7.8, 1.1, 0.0], [1.4, 5.3, 0.0], [7.6, 5.2, 0.0]];
    let picture = |faces: &[[u32; 3]]| {
        let scene = Scene::from_points(&points, faces, SIZE);
        let tape = Tape::<f64>::new();
        let clip = scene.positions(&tape);
        let mesh = Mesh::new(scene.faces.clone(), points.len()).unwrap();
        let options = RasterOptions::new(SIZE).cull(Cull::Back);
        let fragments = rasterize(clip, &mesh, options).unwrap();
        let image = tape.leaf(&scene.image(&fragments, |k, id| motley(k) + f64::from(id)));
        let out = antialiased(image, &fragments);
        let upstream = Tensor::from_flat_fn(out.shape(), motley);
        let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
        (out.value(), gradients.get_or_zeros(clip))
    };
    // The front is counter-clockwise where y points up, which it does not here.
    let alone = picture(&[[0, 2, 1]]);
    assert!(alone.1.data().iter().any(|&entry| entry != 0.0));
    for culled in [[1, 3, 2], [3, 2, 1], [2, 1, 3]] {
        assert_eq!(picture(&[[0, 2, 1], culled]), alone, "{culled:?}");
    }
    assert_ne!(picture(&[[0, 2, 1], [1, 2, 3]]), alone);
}

#[test]
fn of_two_faces_the_nearer_ones_edge_counts() {
    // A near face on the left of x = 4.3, a far one everywhere: the same as the near one before a
    // background of the far one's colours.
    let points = [[4.3, -300.0, -0.1], [4.4, 300.0, -0.1], [-200.0, 3.0, -0.1]];
    let behind = [[-300.0, -300.0, 0.1], [900.0, -300.0, 0.1], [-300.0, 900.0, 0.1]];
    let both: Vec<_> = points.into_iter().chain(behind).collect();
    let alone = Scene::from_points(&points, &[[0, 1, 2]], SIZE);
    let expected = alone.picture::<f64>(|k, _| motley(k));
    assert!(expected != (0..54).map(motley).collect::<Vec<_>>());
    for faces in [[[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]] {
        let scene = Scene::from_points(&both, &faces, SIZE);
        assert_eq!(scene.picture::<f64>(|k, _| motley(k)), expected);
    }
}

#[test]
fn a_face_partly_behind_the_eye_blends_as_its_visible_part() {
    // Vertex 2 lies behind the eye; the part with w > 0.02 is two faces that end far outside the
    // image. The depth is the same everywhere, and no corner is in sight: at a corner the blends
    // depend on how the surface is cut into faces.
    let upwards = [[-0.44, -1.65, 0.11, 1.1], [0.27, -1.26, 0.09, 0.9], [-0.05, 2.0, -0.05, -0.5]];
    let rightwards =
        [[-1.65, -0.55, 0.11, 1.1], [-1.26, 0.36, 0.09, 0.9], [1.2, -0.03, -0.03, -0.3]];
    for clip in [upwards, rightwards] {
        let cut = |from: [f64; 4], to: [f64; 4]| -> [f64; 4] {
            let t = (from[3] - 0.02) / (from[3] - to[3]);
            std::array::from_fn(|k| from[k] + t * (to[k] - from[k]))
        };
        let whole = Scene { clip: clip.to_vec(), faces: vec![[0, 1, 2]], size: SIZE };
        let part = Scene {
            clip: vec![clip[0], clip[1], cut(clip[1], clip[2]), cut(clip[0], clip[2])],
            faces: vec![[0, 1, 2], [0, 2, 3]],
            size: SIZE,
        };
        let [image, expected] = [&whole, &part].map(|scene| scene.picture::<f64>(|k, _| motley(k)));
        assert_close(&image, &expected, 1e-12);
        let blended = image.iter().enumerate().filter(|&(k, &entry)| entry != motley(k)).count();
        assert!(blended >= 4, "{blended}");
        let single = whole.picture::<f32>(|k, _| motley(k));
        assert_close(&single, &expected, 1e-4);
        let [_, clip_bar] = whole.gradients(&image, &[1.0; 54]);
        assert!(clip_bar.iter().all(|entry| entry.is_finite()));
        assert!(clip_bar[8..].iter().any(|&entry| entry != 0.0));
    }
}

#[test]
fn a_crossing_beyond_the_pair_by_rounding_is_clamped_and_gets_no_gradient() {
    // An edge through the centres of column 4, which belong to the face on its right; it is moved
    // after rasterization, so that it passes on the wrong side of them.
    for (edge, alpha) in [(4.53, 0.5), (4.47, 0.5 - 0.03)] {
        let tape = Tape::<f64>::new();
        let (drawn, moved) = (upright(4.5, false), upright(edge, false));
        let clip = moved.positions(&tape);
        let fragments = Fragments { clip, ..drawn.rasterized(drawn.positions(&tape)) };
        let image = tape.leaf(&drawn.image(&fragments, is_covered));
        assert_eq!(image.value().data()[4], 1.0);
        let out = antialiased(image, &fragments);
        // Half of the pixel belongs to the background, and no more.
        approx::assert_relative_eq!(out.value().data()[4], 1.0 - alpha, epsilon = 1e-12);
        let gradients = out.sum().backward().unwrap();
        let has_gradient = gradients.get_or_zeros(clip).data().iter().any(|&entry| entry != 0.0);
        assert_eq!(has_gradient, alpha < 0.5);
    }
}

#[test]
fn a_mesh_that_nobody_sees_leaves_the_image_itself() {
    let scene = upright(-40.0, true);
    assert_eq!(scene.picture::<f32>(|_, _| 0.5), [0.5; 54]);
}

#[test]
fn exact_coverage_has_nothing_to_antialias() {
    let tape = Tape::<f32>::new();
    let scene = star();
    let mesh = Mesh::new(scene.faces.clone(), scene.clip.len()).unwrap();
    let options = RasterOptions::new(SIZE).sampling(Sampling::Exact);
    let fragments = rasterize(scene.positions(&tape), &mesh, options.creases(&[])).unwrap();
    let values = tape.leaf(&Tensor::full([fragments.coverage.count(), 1], 0.5));
    let error = antialias(composite(values, &fragments, Background::Zero).unwrap()).unwrap_err();
    let pixels = fragments.coverage.boundary_counts().pixels;
    let rule = "antialias needs one fragment per pixel, got exact coverage with";
    assert_eq!(error.to_string(), format!("{rule} {pixels} boundary pixels"));
}

#[test]
fn between_two_silhouettes_the_nearer_faces_one_counts_and_of_equally_near_ones_the_first_pixels() {
    // Both end between the centres of columns 3 and 4: the left one at 3.8, the right one at 4.1.
    let scene = |depth: f64, slope: f64| {
        let z = |x: f64| depth + slope * (x - 4.5);
        let left = [[3.8, -300.0, 0.0], [3.8, 300.0, 0.0], [-200.0, 3.0, 0.0]];
        let right = [[4.1, -300.0, z(4.1)], [4.1, 300.0, z(4.1)], [200.0, 3.0, z(200.0)]];
        Scene::from_points(&[left, right].concat(), &[[0, 1, 2], [3, 4, 5]], SIZE)
    };
    let color = |_: usize, id: u32| f64::from(id);
    for (depth, slope, expected) in [
        // The left one: the first pixel gets 1/2 - 0.3 of the second.
        (0.0, 0.0, [1.2, 2.0]),
        (0.1, 0.0, [1.2, 2.0]),
        // The right one: the second pixel gets 1/2 - 0.4 of the first.
        (-0.1, 0.0, [1.0, 1.9]),
        // It is the depths of what is seen that count, each at its own pixel.
        (-0.005, -0.01, [1.0, 1.9]),
        (0.005, 0.01, [1.2, 2.0]),
    ] {
        let picture = scene(depth, slope).picture::<f64>(color);
        assert_close(&picture[3..5], &expected, 1e-12);
    }
}

#[test]
fn an_edge_is_blended_across_and_not_along() {
    // It rises by a third of a pixel per column: steep enough for pairs of rows alone.
    let scene = Scene::from_points(
        &[[-30.0, 13.1, 0.0], [39.0, -9.9, 0.0], [9.0, 90.0, 0.0]],
        &[[0, 1, 2]],
        SIZE,
    );
    // Colours that are the same along columns: pairs of rows move nothing.
    let columns = |k: usize, _: u32| motley(k % 9);
    let expected: Vec<_> = (0..54).map(|k| motley(k % 9)).collect();
    assert_close(&scene.picture::<f64>(columns), &expected, 0.0);
    let rows = |k: usize, _: u32| motley(k / 9);
    let before: Vec<_> = (0..54).map(|k| motley(k / 9)).collect();
    assert_ne!(scene.picture::<f64>(rows), before);
}

#[test]
fn scaling_a_vertex_moves_no_silhouette() {
    // So its gradient is orthogonal to its position.
    let mut scene = star();
    for (k, vertex) in scene.clip.iter_mut().enumerate() {
        *vertex = vertex.map(|entry| (0.6 + 0.1 * k as f64) * entry);
    }
    let pixels = scene.size.pixels();
    let [image, out_bar] = [3, 8].map(|k| (0..pixels).map(|at| motley(k * at)).collect::<Vec<_>>());
    let [_, clip_bar] = scene.gradients(&image, &out_bar);
    for (bar, vertex) in clip_bar.chunks(4).zip(&scene.clip) {
        let terms = || bar.iter().zip(vertex).map(|(bar, entry)| bar * entry);
        assert!(terms().sum::<f64>().abs() <= 1e-12 * terms().map(f64::abs).sum::<f64>());
    }
    assert!(clip_bar.iter().skip(3).step_by(4).any(|&w_bar| w_bar != 0.0));
}

#[test]
fn outlines_that_are_found_in_pieces_are_those_found_at_once() {
    // More faces than the 2048 of a piece, each with its own outline.
    let size = Size::square(250);
    let count = 2048 + 300;
    let corner = |k: usize| [[0.0, 0.0], [3.7, 0.4], [1.1, 3.6]][k % 3];
    let points: Vec<_> = (0..3 * count)
        .map(|k| {
            let ([x, y], at) = (corner(k), [k / 3 % 60, k / 3 / 60].map(|at| 4.1 * at as f64));
            [at[0] + x, at[1] + y, 0.0]
        })
        .collect();
    let faces: Vec<_> = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let scene = Scene::from_points(&points, &faces, size);
    let picture = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| scene.picture::<f64>(|k, id| motley(k) + f64::from(id)))
    };
    assert_eq!(picture(4), picture(1));
}

#[test]
fn what_an_earlier_step_found_is_forgotten() {
    let mut tape = Tape::<f64>::new();
    for scene in [star(), upright(4.3, true), star()] {
        let clip = scene.positions(&tape);
        let fragments = scene.rasterized(clip);
        let image = tape.leaf(&scene.image(&fragments, |k, _| motley(k)));
        let found = antialiased(image, &fragments).value();
        assert_eq!(found.data(), scene.picture::<f64>(|k, _| motley(k)));
        drop((fragments, found));
        tape.reset();
    }
}
