//! One law, a list of operations: the gradient of every rendering operation agrees with difference
//! quotients, on scenes that aim at trouble.

#[path = "support/blends.rs"]
mod blends;
#[path = "support/difference.rs"]
mod difference;

use std::cell::Cell;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Fragments, Kernel, Lens, Mesh, Pose, Radius, RenderError, Size,
    antialias, depth_of_field, gaussian_blur, interpolate, interpolate_indexed, project, rasterize,
    resolve,
};
use difference::{Input, assert_gradients};
use glam::dcamera::rh::proj::opengl::perspective;
use glam::dcamera::rh::view::look_at_mat4;
use glam::{DMat4, DVec3};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

const CASES: u32 = 24;

/// Vertices move by this times the entries that the difference quotients move, so that a quotient
/// seldom reaches across the next pixel.
const ZOOM: f64 = 0.02;

// ---- Scenes

/// A family of scenes: faces, a distribution of clip positions `[V, 4]`, and an image size.
struct Scenes {
    name: &'static str,
    mesh: Mesh,
    positions: BoxedStrategy<Vec<f64>>,
    size: Size,
}

const CUBE: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 5, 7],
    [1, 7, 3],
];

fn size(width: usize, height: usize) -> Size {
    Size { width, height }
}

/// The corners of a cube of side 1 about the origin, each coordinate off by up to `jitter`.
fn cube(jitter: f64) -> BoxedStrategy<Vec<f64>> {
    let corner = |k: usize| (((k / 3) >> (2 - k % 3)) & 1) as f64 - 0.5;
    vec(-jitter..jitter, 24)
        .prop_map(move |offsets| (0..24).map(|k| corner(k) + offsets[k]).collect())
        .boxed()
}

fn camera(eye: DVec3, near: f64) -> DMat4 {
    perspective(1.2, 1.2, near, 20.0) * look_at_mat4(eye, DVec3::ZERO, DVec3::Y)
}

/// Jittered cubes seen from `eye`, in clip space.
fn cubes(eye: DVec3, near: f64) -> BoxedStrategy<Vec<f64>> {
    let camera = camera(eye, near);
    let clip = move |p: &[f64]| (camera * DVec3::from_slice(p).extend(1.0)).to_array();
    cube(0.2).prop_map(move |positions| positions.chunks(3).flat_map(clip).collect()).boxed()
}

/// Vertices anywhere, most of them before the eye.
fn anywhere(count: usize) -> BoxedStrategy<Vec<f64>> {
    let w = prop_oneof![4 => 0.5..2.0, 1 => -0.8..0.2];
    let vertex = (-1.3..1.3, -1.3..1.3, -0.9..0.9, w);
    vec(vertex, count)
        .prop_map(|vertices| {
            let place = |(x, y, z, w): (f64, f64, f64, f64)| [x * w.abs(), y * w.abs(), z * w, w];
            vertices.into_iter().flat_map(place).collect()
        })
        .boxed()
}

/// Vertices on pixel centres, corners and sides of an image of `size`, off by very little.
fn aligned(count: usize, size: Size) -> BoxedStrategy<Vec<f64>> {
    let vertex = (0..=2 * size.width, 0..=2 * size.height, -0.8..0.8, 1e-3..1e-2, -1e-2..-1e-3);
    vec(vertex, count)
        .prop_map(move |vertices| {
            let place = |(x, y, z, dx, dy): (usize, usize, f64, f64, f64)| {
                let (x, y) = (x as f64 / size.width as f64, y as f64 / size.height as f64);
                [x - 1.0 + dx, 1.0 - y + dy, z, 1.0]
            };
            vertices.into_iter().flat_map(place).collect()
        })
        .boxed()
}

/// Long faces less than a pixel wide, side by side.
fn slivers() -> BoxedStrategy<Vec<f64>> {
    (0.0..std::f64::consts::TAU, vec((0.002..0.05, -0.5..0.5), 6))
        .prop_map(|(angle, steps)| {
            let (sin, cos) = angle.sin_cos();
            let mut across = -0.1;
            let vertex = |(k, (step, z)): (usize, (f64, f64))| {
                across += step;
                let along = if k % 2 == 0 { -0.9 } else { 0.8 };
                [along * cos - across * sin, along * sin + across * cos, z, 1.0]
            };
            steps.into_iter().enumerate().flat_map(vertex).collect()
        })
        .boxed()
}

fn scenes() -> Vec<Scenes> {
    let scenes = |name, faces: &[[u32; 3]], vertices, positions, size| {
        let mesh = Mesh::new(faces.to_vec(), vertices).unwrap();
        Scenes { name, mesh, positions, size }
    };
    let strip = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]];
    let loose = [[0, 1, 2], [3, 4, 5], [2, 1, 6], [6, 5, 0]];
    let (eye, near_eye) = (DVec3::new(1.1, 0.9, 1.7), DVec3::new(0.8, 0.4, 0.9));
    vec![
        scenes("cubes", &CUBE, 8, cubes(eye, 0.1), size(11, 8)),
        scenes("cubes through the near plane", &CUBE, 8, cubes(near_eye, 0.8), size(9, 9)),
        scenes(
            "open cubes around the eye",
            &CUBE[..7],
            8,
            cubes(0.3 * near_eye, 0.01),
            size(8, 11),
        ),
        scenes("faces anywhere", &loose, 7, anywhere(7), size(10, 7)),
        scenes("aligned faces", &strip, 6, aligned(6, size(7, 5)), size(7, 5)),
        scenes("slivers", &strip, 6, slivers(), size(12, 12)),
        scenes("one pixel", &loose, 7, anywhere(7), size(1, 1)),
        scenes("one row", &CUBE, 8, cubes(eye, 0.1), size(13, 1)),
        scenes("one column", &loose, 7, anywhere(7), size(1, 9)),
    ]
}

impl Scenes {
    /// The inputs of a pipeline that starts with [`moved`]: fixed positions, and how far they move.
    fn inputs(&self) -> BoxedStrategy<Vec<Input>> {
        let vertices = self.mesh.vertex_count();
        self.positions
            .clone()
            .prop_map(move |positions| {
                let positions = Tensor::new([vertices, 4], positions).unwrap();
                vec![Input::constant(positions), Input::leaf(Tensor::zeros([vertices, 4]))]
            })
            .boxed()
    }
}

fn moved<'t>(vars: &[Var<'t, f64>]) -> Var<'t, f64> {
    vars[0] + vars[1] * ZOOM
}

/// Numbers in `[-1, 1]`.
fn numbers(shape: &[usize]) -> BoxedStrategy<Tensor<f64>> {
    let shape = shape.to_vec();
    let count = shape.iter().product::<usize>();
    vec(-1.0..1.0, count).prop_map(move |data| Tensor::new(shape.as_slice(), data).unwrap()).boxed()
}

/// Numbers of which no two are alike, for upstream images of a size that is known only later.
fn motley(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5
}

// ---- The operations

#[test]
fn project_without_a_pose() {
    let camera = camera(DVec3::new(1.0, 2.0, 3.0), 0.1);
    let inputs = numbers(&[5, 3]).prop_map(|positions| vec![Input::leaf(positions)]);
    assert_gradients("project", CASES, inputs, |_, vars| -> Result<_, RenderError> {
        Ok((vec![project(vars[0], &camera, None)?], ()))
    });
}

#[test]
fn project_with_a_pose() {
    let camera = camera(DVec3::new(1.0, 2.0, 3.0), 0.1);
    let quaternion = numbers(&[4]).prop_filter("a rotation", |q| {
        q.data().iter().map(|entry| entry * entry).sum::<f64>() > 0.1
    });
    let inputs = (numbers(&[4, 3]), quaternion, numbers(&[3]))
        .prop_map(|(p, q, t)| [p, q, t].map(Input::leaf).to_vec());
    assert_gradients("project with a pose", CASES, inputs, |_, vars| -> Result<_, RenderError> {
        let pose = Pose { rotation: vars[1], translation: vars[2] };
        Ok((vec![project(vars[0], &camera, Some(pose))?], ()))
    });
}

#[test]
fn rasterize_to_barycentrics_and_depth() {
    for scenes in scenes() {
        for (what, outputs) in [("barycentrics", 0..1), ("depth", 1..2), ("both", 0..2)] {
            let name = format!("rasterize to {what}, {}", scenes.name);
            assert_gradients(&name, CASES, scenes.inputs(), |_, vars| -> Result<_, RenderError> {
                let fragments = rasterize(moved(vars), &scenes.mesh, scenes.size)?;
                let all = [fragments.barycentrics, fragments.depth];
                Ok((all[outputs.clone()].to_vec(), fragments.coverage.triangle_ids()))
            });
        }
    }
}

/// Fragments of a fixed scene, whose barycentrics are a variable of their own.
fn fixed_fragments<'t>(
    tape: &'t Tape<f64>,
    barycentrics: Option<Var<'t, f64>>,
) -> Result<Fragments<'t, f64>, RenderError> {
    let clip = [
        [-0.9, -0.8, 0.0, 1.0],
        [1.9, -1.6, 0.0, 2.0],
        [1.2, 1.4, 0.1, 1.5],
        [-0.4, 0.4, 0.0, 0.5],
    ];
    let clip = tape.constant(&Tensor::from_fn([4, 4], |k| clip[k / 4][k % 4]));
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4)?;
    let fragments = rasterize(clip, &mesh, size(6, 4))?;
    let barycentrics = barycentrics.unwrap_or(fragments.barycentrics);
    Ok(Fragments { barycentrics, ..fragments })
}

/// How many fragments [`fixed_fragments`] has.
fn fixed_count() -> usize {
    fixed_fragments(&Tape::new(), None).unwrap().coverage.count()
}

#[test]
fn interpolate_attributes_at_weights() {
    for channels in [1, 3, 9] {
        let inputs = (numbers(&[4, channels]), numbers(&[fixed_count(), 2]))
            .prop_map(|(attributes, uv)| vec![Input::leaf(attributes), Input::leaf(uv)]);
        assert_gradients("interpolate", CASES, inputs, |tape, vars| -> Result<_, RenderError> {
            let fragments = fixed_fragments(tape, Some(vars[1]))?;
            Ok((vec![interpolate(vars[0], &fragments)?], ()))
        });
    }
}

#[test]
fn interpolate_with_an_index_buffer_of_its_own() {
    // More attributes than vertices, one of them used by both faces, one by none, one twice.
    let indices = Mesh::new(vec![[5, 0, 2], [2, 3, 3]], 6).unwrap();
    let inputs = (numbers(&[6, 2]), numbers(&[fixed_count(), 2]))
        .prop_map(|(attributes, uv)| vec![Input::leaf(attributes), Input::leaf(uv)]);
    assert_gradients(
        "interpolate_indexed",
        CASES,
        inputs,
        |tape, vars| -> Result<_, RenderError> {
            let fragments = fixed_fragments(tape, Some(vars[1]))?;
            Ok((vec![interpolate_indexed(vars[0], &indices, &fragments)?], ()))
        },
    );
}

#[test]
fn resolve_before_every_background() {
    let values = || numbers(&[fixed_count(), 2]);
    let alone = values().prop_map(|values| vec![Input::leaf(values)]);
    assert_gradients("resolve", CASES, alone, |tape, vars| -> Result<_, RenderError> {
        let fragments = fixed_fragments(tape, None)?;
        Ok((vec![resolve(vars[0], &fragments, Background::Zero)?], ()))
    });
    for shape in [&[2][..], &[4, 6, 2]] {
        let inputs =
            (values(), numbers(shape)).prop_map(|(v, b)| vec![Input::leaf(v), Input::leaf(b)]);
        assert_gradients(
            "resolve before a background",
            CASES,
            inputs,
            |tape, vars| -> Result<_, RenderError> {
                let fragments = fixed_fragments(tape, None)?;
                let background = match vars[1].shape().rank() {
                    1 => Background::Color(vars[1]),
                    _ => Background::Image(vars[1]),
                };
                Ok((vec![resolve(vars[0], &fragments, background)?], ()))
            },
        );
    }
}

#[test]
fn antialias_an_image_along_moving_edges() {
    for scenes in scenes() {
        let Size { width, height } = scenes.size;
        let inputs =
            (scenes.inputs(), numbers(&[height, width, 2])).prop_map(|(mut inputs, image)| {
                inputs.push(Input::leaf(image));
                inputs
            });
        let name = format!("antialias, {}", scenes.name);
        assert_gradients(&name, CASES, inputs, |_, vars| -> Result<_, RenderError> {
            let clip = moved(vars);
            let fragments = rasterize(clip, &scenes.mesh, scenes.size)?;
            let blends = blends::blends(&fragments, &clip.value());
            let choices: Vec<_> = blends.iter().map(|blend| blend.choice()).collect();
            let image = antialias(vars[2], &fragments, clip)?;
            Ok((vec![image], (fragments.coverage.triangle_ids(), choices)))
        });
    }
}

#[test]
fn antialias_is_the_sum_of_the_blends_of_its_definition() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) };
    for scenes in scenes() {
        let count = Cell::new(0);
        TestRunner::new_with_rng(config.clone(), TestRng::deterministic_rng(RngAlgorithm::ChaCha))
            .run(&scenes.positions, |positions| {
                let tape = Tape::<f64>::new();
                let vertices = scenes.mesh.vertex_count();
                let clip = tape.leaf(&Tensor::new([vertices, 4], positions).unwrap());
                let fragments = rasterize(clip, &scenes.mesh, scenes.size).unwrap();
                let Size { width, height } = scenes.size;
                let image = Tensor::from_fn([height, width, 1], motley);
                let out = antialias(tape.leaf(&image), &fragments, clip).unwrap().value();
                let mut expected = image.data().to_vec();
                for blend in blends::blends(&fragments, &clip.value()) {
                    let [first, second] = blend.pair;
                    let target = if blend.alpha > 0.0 { first } else { second };
                    expected[target] += blend.alpha * (image.data()[second] - image.data()[first]);
                    count.set(count.get() + 1);
                }
                for (found, expected) in out.data().iter().zip(expected) {
                    prop_assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
                }
                Ok(())
            })
            .unwrap();
        let pairs = scenes.size.pixels() > 1;
        println!("{}: {} blends", scenes.name, count.get());
        assert!(count.get() > 20 || !pairs, "{}: {} blends", scenes.name, count.get());
    }
}

/// Every kernel and border, with fixed radii that are smaller and larger than the image, and one
/// by tolerance.
fn blurs() -> Vec<Blur> {
    let mut blurs = Vec::new();
    for kernel in [Kernel::Seed, Kernel::Sampled] {
        for border in [Border::Zero, Border::Mirror, Border::Clamp] {
            for radius in [Radius::Fixed(2), Radius::Fixed(12), Radius::Tolerance(1e-4)] {
                blurs.push(Blur { kernel, border, radius });
            }
        }
    }
    blurs
}

/// The number of taps of a window: the pixels that an impulse reaches.
fn reach(sigma: Var<'_, f64>, blur: &Blur) -> Result<usize, RenderError> {
    let impulse = Tensor::from_fn([1, 101, 1], |k| if k == 50 { 1.0 } else { 0.0 });
    let image = sigma.tape().constant(&impulse);
    let blur = Blur { border: Border::Zero, ..*blur };
    let out = gaussian_blur(image, sigma.detach(), &blur)?.value();
    Ok(out.data().iter().filter(|&&entry| entry != 0.0).count())
}

#[test]
fn gaussian_blur_of_an_image_by_a_sigma() {
    for blur in blurs() {
        for shape in [[5, 8, 2], [1, 1, 1], [1, 9, 1], [7, 1, 2]] {
            let inputs = (numbers(&shape), 0.35..3.0).prop_map(|(image, sigma)| {
                vec![Input::leaf(image), Input::leaf(Tensor::scalar(sigma))]
            });
            let name = format!("{blur:?} of {shape:?}");
            assert_gradients(&name, 4, inputs, |_, vars| -> Result<_, RenderError> {
                // Where the window is fixed, taps that are cut off as negligible are no kink.
                let state = match blur.radius {
                    Radius::Fixed(_) => 0,
                    Radius::Tolerance(_) => reach(vars[1], &blur)?,
                };
                Ok((vec![gaussian_blur(vars[0], vars[1], &blur)?], state))
            });
        }
    }
}

#[test]
fn depth_of_field_of_an_image_by_its_depths_and_the_lens() {
    for (radius, largest_sigma) in
        [(Radius::Fixed(3), 32.0), (Radius::Fixed(12), 2.0), (Radius::Tolerance(1e-13), 1.5)]
    {
        let lens = Lens { radius, largest_sigma };
        for shape in [[5, 8, 2], [1, 1, 1], [1, 9, 1]] {
            let pixels = shape[0] * shape[1];
            // Depths from far before the focus to far behind it, many of them near it.
            let depth = prop_oneof![0.6..6.0, 1.9..2.1];
            let lenses = (0.3..3.0, 1.8..2.2);
            let inputs = (numbers(&shape), vec(depth, pixels), lenses).prop_map(
                move |(image, depths, (aperture, focus))| {
                    let depths = Tensor::new([shape[0], shape[1]], depths).unwrap();
                    let numbers = [aperture, focus].map(Tensor::scalar);
                    [image, depths].into_iter().chain(numbers).map(Input::leaf).collect()
                },
            );
            let name = format!("{lens:?} of {shape:?}");
            assert_gradients(&name, 4, inputs, |_, vars| -> Result<_, RenderError> {
                let (aperture, focus) = (vars[2].item(), vars[3].item());
                let sigmas = vars[1].value().map(|z| aperture * (1.0 - focus / z).abs());
                let capped: Vec<_> = sigmas.data().iter().map(|&s| s > largest_sigma).collect();
                let focused = depth_of_field(vars[0], vars[1], vars[2], vars[3], &lens)?;
                assert_eq!(focused.capped, capped.iter().filter(|&&capped| capped).count());
                Ok((vec![focused.image], capped))
            });
        }
    }
}

#[test]
fn the_whole_pipeline() {
    let mesh = Mesh::new(CUBE.to_vec(), 8).unwrap();
    let blurs = [
        Blur { radius: Radius::Fixed(4), ..Blur::default() },
        Blur { kernel: Kernel::Seed, border: Border::Zero, radius: Radius::Fixed(3) },
        Blur { border: Border::Clamp, radius: Radius::Fixed(12), ..Blur::default() },
    ];
    for (blur, eye, near) in [
        (blurs[0], DVec3::new(1.3, 1.0, 2.1), 0.1),
        (blurs[1], DVec3::new(-1.3, 0.4, 1.5), 0.1),
        (blurs[2], DVec3::new(0.6, 0.5, 0.9), 0.7),
    ] {
        let camera = camera(eye, near);
        let fixed = (cube(0.15), numbers(&[4]), numbers(&[3]));
        let inputs = (fixed, numbers(&[8, 3]), numbers(&[3]), 0.4..2.0).prop_map(
            |((positions, turn, shift), colors, background, sigma)| {
                let positions = Tensor::new([8, 3], positions).unwrap();
                let turn = Tensor::from_fn([4], |k| 0.3 * turn.data()[k] + (k / 3) as f64);
                let shift = Tensor::from_fn([3], |k| 0.2 * shift.data()[k]);
                let mut inputs = Vec::new();
                for tensor in [positions, turn, shift] {
                    let shape = tensor.shape().clone();
                    inputs.extend([Input::constant(tensor), Input::leaf(Tensor::zeros(&shape))]);
                }
                inputs.extend([colors, background, Tensor::scalar(sigma)].map(Input::leaf));
                inputs
            },
        );
        assert_gradients("the whole pipeline", 12, inputs, |_, vars| -> Result<_, RenderError> {
            let [positions, rotation, translation] = [0, 2, 4].map(|k| moved(&vars[k..]));
            let clip = project(positions, &camera, Some(Pose { rotation, translation }))?;
            let fragments = rasterize(clip, &mesh, size(12, 9))?;
            let blends = blends::blends(&fragments, &clip.value());
            let choices: Vec<_> = blends.iter().map(|blend| blend.choice()).collect();
            let surface = interpolate(vars[6], &fragments)?;
            let image = resolve(surface, &fragments, Background::Color(vars[7]))?;
            let image = antialias(image, &fragments, clip)?;
            let image = gaussian_blur(image, vars[8], &blur)?;
            Ok((vec![image.square()], (fragments.coverage.triangle_ids(), choices)))
        });
    }
}
