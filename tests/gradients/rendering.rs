//! One law, a list of operations: every rendering operation keeps the laws of `bokashi-check`, on
//! scenes that aim at trouble; and the check catches every wrong adjoint made from it.

use std::cell::Cell;
use std::fs;
use std::ops::Range;
use std::path::Path;

use bokashi_check::strategy::{
    camera, closed_mesh, image, image_of, number, sigma, tensor, unit_quaternion,
};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Border, Composite, DepthImage, Fragments, Kernel, Lens, LensOptions, Mesh,
    Pose, Radius, RenderError, Size, antialias, composite, depth, depth_of_field, gaussian_blur,
    interpolate, interpolate_indexed, project, rasterize,
};
use glam::DMat4;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

use crate::blends;
use crate::scenes::{Scene, motley, scene, scenes, size};

const CASES: u32 = 24;

/// The laws, and that they see every wrong adjoint.
pub(crate) fn check(check: Check) {
    let check = check.cases(CASES);
    check.assert();
    let kills = check.kills().unwrap_or_else(|failure| panic!("{failure}"));
    println!("{kills}");
    assert!(kills.tried > 0 && kills.survivors.is_empty(), "{kills}");
}

pub(crate) fn wide<T: Scalar>(var: Var<'_, T>) -> Tensor<f64> {
    var.value().cast()
}

// ---- The operations

#[derive(Debug)]
struct Project {
    camera: [[f64; 4]; 4],
}

impl Subject for Project {
    /// Positions, or positions with a rotation and a translation.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let camera = DMat4::from_cols_array_2d(&self.camera);
        let pose = match *inputs {
            [_, rotation, translation] => Some(Pose { rotation, translation }),
            _ => None,
        };
        Ok(project(inputs[0], &camera, pose)?.into())
    }
}

#[test]
fn project_with_and_without_a_pose() {
    let positions = |count| tensor([count, 3], number()).prop_map(Input::leaf);
    let bare = (camera(), positions(5));
    let bare = bare.prop_map(|(camera, p)| Case::new(Project { camera }, [p]));
    let not_a_point = Input::leaf(Tensor::zeros([5, 4]));
    let mut blind = DMat4::IDENTITY.to_cols_array_2d();
    blind[2][1] = f64::NAN;
    check(
        Check::of_cases("project", bare)
            .refuses("points of four coordinates", project_by(identity(), &[not_a_point]))
            .refuses("a camera that is not finite", project_by(blind, &[leaf([2, 3], 0.5)])),
    );
    let posed = (camera(), positions(4), unit_quaternion(), 0.5..2.0, tensor([3], number()));
    let posed = posed.prop_map(|(camera, p, q, length, t)| {
        let rotation = Tensor::from_flat_fn([4], |k| length * q[k]);
        Case::new(Project { camera }, [p, Input::leaf(rotation), Input::leaf(t)])
    });
    let points = leaf([2, 3], 0.5);
    let no_rotation = [points.clone(), leaf([4], 0.0), leaf([3], 0.0)];
    let no_shift = [points, leaf([4], 1.0), leaf([2], 0.0)];
    check(
        Check::of_cases("project with a pose", posed)
            .refuses("a quaternion of zeros", project_by(identity(), &no_rotation))
            .refuses("a translation of two entries", project_by(identity(), &no_shift)),
    );
}

fn identity() -> [[f64; 4]; 4] {
    DMat4::IDENTITY.to_cols_array_2d()
}

fn project_by(camera: [[f64; 4]; 4], inputs: &[Input]) -> Case {
    Case::new(Project { camera }, inputs)
}

/// A leaf with all entries alike.
pub(crate) fn leaf<const N: usize>(axes: [usize; N], entry: f64) -> Input {
    Input::leaf(Tensor::full(axes, entry))
}

#[derive(Debug)]
struct Rasterize {
    scene: Scene,
    outputs: Range<usize>,
}

impl Subject for Rasterize {
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let all = [fragments.barycentrics, depth(&fragments)?];
        let outputs = all[self.outputs.clone()].to_vec();
        Ok(Outcome::from(outputs).with_state(fragments.coverage.triangle_ids()))
    }
}

#[test]
fn rasterize_to_barycentrics_and_depth() {
    for (kind, scenes) in scenes() {
        for (what, outputs) in [("barycentrics", 0..1), ("depth", 1..2), ("both", 0..2)] {
            let cases = scenes.clone().prop_map(move |scene| {
                let clip = Input::leaf(scene.clip.clone());
                Case::new(Rasterize { scene, outputs: outputs.clone() }, [clip])
            });
            let [face] = [[[0.0, 0.0, 0.0, 1.0]; 3]];
            let one = scene(face.to_vec(), vec![[0, 1, 2]], size(4, 4));
            let of_one = |clip| Case::new(Rasterize { scene: one.clone(), outputs: 0..1 }, [clip]);
            let none = Scene { size: size(0, 4), ..one.clone() };
            let on_none = Rasterize { scene: none, outputs: 0..1 };
            check(
                Check::of_cases(format!("rasterize {kind} to {what}"), cases)
                    .refuses("another number of vertices", of_one(leaf([2, 4], 1.0)))
                    .refuses("points of three coordinates", of_one(leaf([3, 3], 1.0)))
                    .refuses("an infinite position", of_one(leaf([3, 4], f64::INFINITY)))
                    .refuses("no pixels", Case::new(on_none, [leaf([3, 4], 1.0)])),
            );
        }
    }
}

/// Fragments of a fixed scene, whose barycentrics are a variable of their own.
pub(crate) fn fixed_fragments<'t, T: Scalar>(
    tape: &'t Tape<T>,
    barycentrics: Option<Var<'t, T>>,
) -> Result<Fragments<'t, T>, RenderError> {
    let clip = [
        [-0.9, -0.8, 0.0, 1.0],
        [1.9, -1.6, 0.0, 2.0],
        [1.2, 1.4, 0.1, 1.5],
        [-0.4, 0.4, 0.0, 0.5],
    ];
    let clip = tape.constant(&Tensor::from_flat_fn([4, 4], |k| T::from_f64(clip[k / 4][k % 4])));
    let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4)?;
    let fragments = rasterize(clip, &mesh, size(6, 4))?;
    let barycentrics = barycentrics.unwrap_or(fragments.barycentrics);
    Ok(Fragments { barycentrics, ..fragments })
}

/// How many fragments [`fixed_fragments`] has.
pub(crate) fn fixed_count() -> usize {
    fixed_fragments::<f64>(&Tape::new(), None).unwrap().coverage.count()
}

#[derive(Debug, Clone)]
struct Interpolate {
    indices: Option<Mesh>,
}

impl Subject for Interpolate {
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = fixed_fragments(tape, Some(inputs[1]))?;
        Ok(match &self.indices {
            None => interpolate(inputs[0], &fragments)?.into(),
            Some(indices) => interpolate_indexed(inputs[0], indices, &fragments)?.into(),
        })
    }
}

/// Leaves of these shapes.
fn leaves(shapes: &[&[usize]]) -> BoxedStrategy<Vec<Input>> {
    let tensors: Vec<_> = shapes.iter().map(|&axes| tensor(axes, number())).collect();
    tensors.prop_map(|tensors| tensors.into_iter().map(Input::leaf).collect()).boxed()
}

#[test]
fn interpolate_attributes_at_weights() {
    let fragments = fixed_count();
    for channels in [1, 3, 9] {
        let inputs = leaves(&[&[4, channels], &[fragments, 2]]);
        let subject = Interpolate { indices: None };
        let of = move |inputs: Vec<Input>| Case::new(subject.clone(), inputs);
        let of_five = of(vec![leaf([5, channels], 1.0), leaf([fragments, 2], 0.3)]);
        let one_short = of(vec![leaf([4, channels], 1.0), leaf([fragments - 1, 2], 0.3)]);
        check(
            Check::of_cases("interpolate", inputs.prop_map(of))
                .refuses_midway("another number of vertices", of_five)
                .refuses_midway("a fragment without weights", one_short),
        );
    }
    // More attributes than vertices, one of them used by both faces, one by none, one twice.
    let indices = Some(Mesh::new(vec![[5, 0, 2], [2, 3, 3]], 6).unwrap());
    let (inputs, subject) = (leaves(&[&[6, 2], &[fragments, 2]]), Interpolate { indices });
    let of = move |inputs: Vec<Input>| Case::new(subject.clone(), inputs);
    let of_five = of(vec![leaf([5, 2], 1.0), leaf([fragments, 2], 0.3)]);
    let name = "interpolate with an index buffer of its own";
    check(
        Check::of_cases(name, inputs.prop_map(of))
            .refuses_midway("fewer attributes than indices", of_five),
    );
}

#[derive(Debug, Clone, Copy)]
struct Image;

impl Subject for Image {
    /// Fragments' values, and perhaps a background: a colour or an image.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let background = match *inputs {
            [_, background] if background.shape().rank() == 1 => Background::Color(background),
            [_, background] => Background::Image(background),
            _ => Background::Zero,
        };
        Ok(composite(inputs[0], &fixed_fragments(tape, None)?, background)?.image()?.into())
    }
}

#[test]
fn images_before_every_background() {
    let fragments = [fixed_count(), 2];
    for background in [None, Some(&[2][..]), Some(&[4, 6, 2])] {
        let shapes: Vec<&[usize]> = [&fragments[..]].into_iter().chain(background).collect();
        let of = |inputs: Vec<Input>| Case::new(Image, inputs);
        let one_more = of(vec![leaf([fragments[0] + 1, 2], 0.5)]);
        let turned = of(vec![leaf(fragments, 0.5), leaf([6, 4, 2], 0.5)]);
        check(
            Check::of_cases("image", leaves(&shapes).prop_map(of))
                .refuses_midway("a value without a fragment", one_more)
                .refuses_midway("a background of another size", turned),
        );
    }
}

#[derive(Debug)]
struct Antialias {
    scene: Scene,
}

impl Subject for Antialias {
    /// Clip positions and an image.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let choices = blends::choices(&fragments, &wide(inputs[0]));
        let image = antialias(Composite::of_image(inputs[1], &fragments)?)?.image()?;
        let ids = fragments.coverage.triangle_ids();
        Ok(Outcome::from(image).with_state(ids).with_state(choices))
    }
}

#[test]
fn antialias_an_image_along_moving_edges() {
    for (kind, scenes) in scenes() {
        let cases = scenes.prop_flat_map(|scene| {
            let Size { width, height } = scene.size;
            image_of([height, width, 2]).prop_map(move |image| {
                let inputs = [scene.clip.clone(), image].map(Input::leaf);
                Case::new(Antialias { scene: scene.clone() }, inputs)
            })
        });
        let face = scene(vec![[0.0, 0.0, 0.0, 1.0]; 3], vec![[0, 1, 2]], size(4, 4));
        let another_size = [Input::leaf(face.clip.clone()), leaf([4, 5, 1], 0.5)];
        check(Check::of_cases(format!("antialias {kind}"), cases).refuses_midway(
            "an image of another size",
            Case::new(Antialias { scene: face }, another_size),
        ));
    }
}

#[test]
fn antialias_is_the_sum_of_the_blends_of_its_definition() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) };
    for (kind, scenes) in scenes() {
        let count = Cell::new(0);
        TestRunner::new_with_rng(config.clone(), TestRng::deterministic_rng(RngAlgorithm::ChaCha))
            .run(&scenes, |Scene { mesh, clip, size }| {
                let tape = Tape::<f64>::new();
                let clip = tape.leaf(&clip);
                let fragments = rasterize(clip, &mesh, size).unwrap();
                let image = Tensor::from_flat_fn([size.height, size.width, 1], motley);
                let out = Composite::of_image(tape.leaf(&image), &fragments).unwrap();
                let out = antialias(out).unwrap().image().unwrap().value();
                // Shares that add up to more than 1 are divided by their sum.
                let mut moved = vec![[0.0; 2]; image.data().len()];
                for blend in blends::blends(&fragments, &clip.value()) {
                    let [first, second] = blend.pair;
                    let target = if blend.alpha > 0.0 { first } else { second };
                    moved[target][0] += blend.alpha.abs();
                    moved[target][1] += blend.alpha * (image.data()[second] - image.data()[first]);
                    count.set(count.get() + 1);
                }
                let expected = image.data().iter().zip(moved);
                let expected = expected.map(|(value, [sum, step])| value + step / sum.max(1.0));
                for (found, expected) in out.data().iter().zip(expected) {
                    prop_assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
                }
                Ok(())
            })
            .unwrap();
        println!("{kind}: {} blends", count.get());
        assert!(count.get() > 20, "{kind}: {} blends", count.get());
    }
}

#[derive(Debug)]
struct GaussianBlur {
    blur: Blur,
}

impl Subject for GaussianBlur {
    /// An image and a sigma.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let state = match self.blur.radius {
            // Where the window is fixed, taps that are cut off as negligible are no kink.
            Radius::Fixed(_) => 0,
            Radius::Tolerance(_) => reach(inputs[1], &self.blur)?,
        };
        let image = gaussian_blur(inputs[0], inputs[1], &self.blur)?;
        Ok(Outcome::from(image).with_state(state))
    }
}

/// The number of taps of a window: the pixels that an impulse reaches. On a tape of its own, so
/// that a refusal leaves the other as it was.
fn reach<T: Scalar>(sigma: Var<'_, T>, blur: &Blur) -> Result<usize, RenderError> {
    let tape = Tape::new();
    let impulse = Tensor::from_flat_fn([1, 201, 1], |k| T::from_f64(f64::from(u8::from(k == 100))));
    let blur = Blur { border: Border::Zero, ..*blur };
    let out = gaussian_blur(tape.constant(&impulse), tape.constant(&sigma.value()), &blur)?;
    Ok(out.value().data().iter().filter(|&&entry| entry != T::ZERO).count())
}

#[test]
fn gaussian_blur_of_an_image_by_a_sigma() {
    // Radii that are smaller and larger than the image, and one by tolerance.
    for radius in [Radius::Fixed(2), Radius::Fixed(12), Radius::Tolerance(1e-4)] {
        for kernel in [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete] {
            let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
            let cases = (borders, image(), sigma()).prop_map(move |(border, image, sigma)| {
                // The unnormalized kernel's gain at smaller ones is 1 / sigma^2.
                let sigma = if kernel == Kernel::Unnormalized { sigma.max(0.3) } else { sigma };
                let inputs = [image, Tensor::scalar(sigma)].map(Input::leaf);
                Case::new(GaussianBlur { blur: Blur { kernel, border, radius } }, inputs)
            });
            let blur = Blur { kernel, border: Border::Mirror, radius };
            let by = |sigma: Input| Case::new(GaussianBlur { blur }, [leaf([3, 3, 1], 0.5), sigma]);
            let flat = [leaf([3, 3], 0.5), leaf([], 1.0)];
            check(
                Check::of_cases(format!("gaussian_blur, {kernel:?}, {radius:?}"), cases)
                    .large(1, Just(large_blur(blur)))
                    .refuses("a negative sigma", by(leaf([], -1.0)))
                    .refuses("a sigma that is no number", by(leaf([], f64::NAN)))
                    .refuses("two sigmas", by(leaf([2], 1.0)))
                    .refuses("an image without channels", Case::new(GaussianBlur { blur }, flat)),
            );
        }
    }
}

#[test]
fn gaussian_blur_by_tridiagonal_systems() {
    // Tolerances and the number of poles that each takes, conjugates left out. `reach` is how far a
    // window would have to reach, as a share of the reach from which on the systems take less time.
    let by = |border, (tolerance, poles): (f64, usize), more: [usize; 2], reach: f64| {
        let blur = Blur { kernel: Kernel::Discrete, border, radius: Radius::Tolerance(tolerance) };
        let least = 34 + 5 * poles;
        let [height, width] = more.map(|more| least + more);
        let image = Input::leaf(Tensor::from_flat_fn([height, width, 1], motley));
        let sigma = reach * least as f64 / (-2.0 * tolerance.ln()).sqrt();
        Case::new(GaussianBlur { blur }, [image, leaf([], sigma)])
    };
    let tolerances = select(&[(1e-2, 2), (1e-3, 2), (1e-4, 3), (1e-5, 3), (1e-6, 4)][..]);
    let borders = select(&[Border::Zero, Border::Mirror][..]);
    let cases = (borders, tolerances, [1..=5_usize, 1..=5_usize], 1.03..2.0_f64)
        .prop_map(move |(border, tolerance, more, reach)| by(border, tolerance, more, reach));
    check(
        Check::of_cases("gaussian_blur by tridiagonal systems", cases)
            .large(1, Just(by(Border::Mirror, (1e-6, 4), [100, 80], 1.5))),
    );
}

/// An image that is blurred in several pieces.
fn large_blur(blur: Blur) -> Case {
    let image = Input::leaf(Tensor::from_flat_fn([150, 130, 3], motley));
    Case::new(GaussianBlur { blur }, [image, leaf([], 1.7)])
}

#[derive(Debug)]
struct DepthOfField {
    options: LensOptions,
}

impl Subject for DepthOfField {
    /// An image, its depths, an aperture and a focus.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let lens = Lens { aperture: inputs[2], focus: inputs[3] };
        let distances = DepthImage::of_distances(inputs[1]);
        let focused = depth_of_field(inputs[0], distances, lens, &self.options)?;
        let (aperture, focus) = (wide(inputs[2]).item(), wide(inputs[3]).item());
        let is_capped = |z: &f64| aperture * (1.0 - focus / z).abs() > self.options.largest_sigma;
        let capped: Vec<_> = wide(inputs[1]).data().iter().map(is_capped).collect();
        Ok(Outcome::from(focused.image).with_state(capped))
    }
}

#[test]
fn depth_of_field_of_an_image_by_its_depths_and_the_lens() {
    // Windows that are smaller and larger than the image, and caps that some pixels reach.
    for (radius, largest_sigma) in
        [(Radius::Fixed(3), 32.0), (Radius::Fixed(12), 2.0), (Radius::Tolerance(1e-13), 1.5)]
    {
        let options = LensOptions { radius, largest_sigma };
        let sizes = (1..6_usize, 2..7_usize);
        let lenses = (0.5..3.0, 1.8..2.2);
        // Depths from far before the focus to far behind it, some of them near it.
        let depth = prop_oneof![4 => 0.7..6.0, 1 => 1.9..2.1];
        let cases = (sizes, vec(number(), 72), vec(depth, 36), lenses).prop_map(
            move |((height, width), colors, depths, (aperture, focus))| {
                let inputs = [
                    Tensor::from_flat_fn([height, width, 2], |k| colors[k]),
                    Tensor::from_flat_fn([height, width], |k| depths[k]),
                    Tensor::scalar(aperture),
                    Tensor::scalar(focus),
                ];
                Case::new(DepthOfField { options }, inputs.map(Input::leaf))
            },
        );
        let by = |depth: Input, aperture: f64, focus: f64| {
            let inputs = [leaf([3, 3, 1], 0.5), depth, leaf([], aperture), leaf([], focus)];
            Case::new(DepthOfField { options }, inputs)
        };
        check(
            Check::of_cases(format!("depth_of_field, {radius:?}"), cases)
                .large(1, Just(large_view(options)))
                .refuses("a negative depth", by(leaf([3, 3], -1.0), 1.0, 2.0))
                .refuses("a negative aperture", by(leaf([3, 3], 1.0), -1.0, 2.0))
                .refuses("a focus of 0", by(leaf([3, 3], 1.0), 1.0, 0.0))
                .refuses("depths of another size", by(leaf([3, 2], 1.0), 1.0, 2.0)),
        );
    }
}

/// An image that is gathered in several pieces.
fn large_view(options: LensOptions) -> Case {
    let inputs = [
        Tensor::from_flat_fn([31, 27, 2], motley),
        Tensor::from_flat_fn([31, 27], |k| 2.0 + 0.9 * motley(3 * k)),
        Tensor::scalar(1.1),
        Tensor::scalar(2.0),
    ];
    Case::new(DepthOfField { options }, inputs.map(Input::leaf))
}

#[derive(Debug)]
struct Pipeline {
    mesh: Mesh,
    camera: [[f64; 4]; 4],
    blur: Blur,
    size: Size,
}

impl Subject for Pipeline {
    /// Positions, rotation, translation, colours, background and sigma.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let &[positions, rotation, translation, colors, background, sigma] = inputs else {
            return Err("six inputs".into());
        };
        let camera = DMat4::from_cols_array_2d(&self.camera);
        let clip = project(positions, &camera, Some(Pose { rotation, translation }))?;
        let fragments = rasterize(clip, &self.mesh, self.size)?;
        let choices = blends::choices(&fragments, &wide(clip));
        let surface = interpolate(colors, &fragments)?;
        let picture = antialias(composite(surface, &fragments, Background::Color(background))?)?;
        let image = picture.image()?;
        let image = gaussian_blur(image, sigma, &self.blur)?;
        let ids = fragments.coverage.triangle_ids();
        Ok(Outcome::from(image.square()).with_state(ids).with_state(choices))
    }
}

/// Pipelines of any closed mesh, camera and blur, on an image of one size.
fn pipelines(size: Size) -> impl Strategy<Value = Case> {
    let blurs = select(vec![
        Blur { radius: Radius::Fixed(4), ..Blur::default() },
        Blur { kernel: Kernel::Unnormalized, border: Border::Zero, radius: Radius::Fixed(3) },
        Blur { border: Border::Clamp, radius: Radius::Fixed(12), ..Blur::default() },
    ]);
    let view = (closed_mesh(), camera(), unit_quaternion(), blurs);
    let looks = (vec(number(), 96), tensor([3], number()), tensor([3], number()), 0.4..2.0);
    (view, looks).prop_map(move |((mesh, camera, q, blur), (colors, shift, back, sigma))| {
        let vertices = mesh.positions.len();
        let inputs = [
            Tensor::from_flat_fn([vertices, 3], |k| mesh.positions[k / 3][k % 3]),
            Tensor::from_flat_fn([4], |k| q[k]),
            shift.map(|entry| 0.1 * entry),
            Tensor::from_flat_fn([vertices, 3], |k| colors[k]),
            back,
            Tensor::scalar(sigma),
        ];
        let mesh = Mesh::new(mesh.faces, vertices).unwrap();
        Case::new(Pipeline { mesh, camera, blur, size }, inputs.map(Input::leaf))
    })
}

#[test]
fn the_whole_pipeline() {
    let pipeline = Check::of_cases("the whole pipeline", pipelines(size(11, 8)));
    check(pipeline.large(2, pipelines(size(190, 150))));
}

/// The parts of a source file from a line that starts with `head` to the next one that is `}`.
fn blocks<'a>(source: &'a str, head: &str) -> Vec<&'a str> {
    let starts = source.match_indices(head).map(|(at, _)| at);
    let starts = starts.filter(|&at| at == 0 || source[..at].ends_with('\n'));
    starts.map(|at| source[at..].split("\n}\n").next().unwrap()).collect()
}

/// Whether `source` calls a function of that name, or a method where the name starts with a dot.
fn calls(source: &str, name: &str) -> bool {
    let is_other = |before: char| before.is_alphanumeric() || "_.".contains(before);
    let call = format!("{name}(");
    let mut before = source.match_indices(&call).map(|(at, _)| &source[..at]);
    before.any(|before| name.starts_with('.') || !before.ends_with(is_other))
}

/// The methods that the folders in an operation's folder give to pictures.
fn methods_of_pictures(folder: &Path) -> String {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    let files =
        entries.map(|path| path.join("mod.rs")).filter_map(|file| fs::read_to_string(file).ok());
    files.map(|file| blocks(&file, "impl<'t, T: Scalar> Picture<'t, T>").concat()).collect()
}

#[test]
fn no_operation_is_forgotten() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates/render-ops/src");
    let exports = fs::read_to_string(source.join("lib.rs")).unwrap();
    let modules: Vec<_> = exports.lines().filter_map(|line| line.strip_prefix("mod ")).collect();
    let exports = exports.lines().filter_map(|line| line.strip_prefix("pub use "));
    let functions = exports.flat_map(|line| {
        let names = line.split("::").last().unwrap_or("").trim_matches(|c| "{};".contains(c));
        names.split(", ").map(str::to_owned).collect::<Vec<_>>()
    });
    // Which edges are creases has no gradient.
    let others = ["glam", "mark_creases", "mark_creases_indexed"];
    let is_function = |name: &String| {
        name.starts_with(|c: char| c.is_ascii_lowercase()) && !others.contains(&name.as_str())
    };
    let functions: Vec<_> = functions.filter(is_function).collect();
    // Methods of what lies on a tape are operations too.
    let methods = modules.iter().flat_map(|module| {
        let module = source.join(module.trim_end_matches(';'));
        let files = [module.with_extension("rs"), module.join("mod.rs")];
        let file = files.iter().find_map(|file| fs::read_to_string(file).ok());
        let mut blocks = blocks(&file.expect("the module is there"), "impl<'t, ").concat();
        blocks += &methods_of_pictures(&module);
        let methods = blocks.lines().filter_map(|line| line.strip_prefix("    pub fn "));
        let names = methods.map(|method| format!(".{}", method.split(['(', '<']).next().unwrap()));
        names.collect::<Vec<_>>()
    });
    let methods: Vec<_> = methods.collect();
    assert!(functions.len() >= 9, "{functions:?}");
    assert!(methods.len() >= 3, "{methods:?}");

    // What a subject does itself, under the name that it has: a helper could do anything.
    let tests = [
        include_str!("rendering.rs"),
        include_str!("pictures.rs"),
        include_str!("exact.rs"),
        include_str!("textures.rs"),
        include_str!("layers.rs"),
        include_str!("light.rs"),
        include_str!("cameras.rs"),
        include_str!("distances.rs"),
        include_str!("surfaces.rs"),
    ]
    .concat();
    let subjects = blocks(&tests, "impl Subject for ").concat();
    for name in functions.iter().chain(&methods) {
        // An associated function stands behind the name of its type.
        let is_called =
            calls(&subjects, name) || subjects.contains(&format!(":{}(", name.replace('.', ":")));
        assert!(is_called, "{name} has no law");
        let helpers = ["(", "<"].map(|end| format!("fn {}{end}", name.trim_start_matches('.')));
        assert!(!helpers.iter().any(|helper| tests.contains(helper)), "{name} is something else");
    }
    assert!(!calls("deep_blur(x).blur(x)", "blur") && !calls("blur(x)", ".blur"));
}
