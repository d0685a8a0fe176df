//! What does a silhouette mask cost, and how much of its gradient is found?

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Cull, Picture, PixelLoss, RasterOptions, Sampling, project, render,
};
use bokashi_report::{Cell, Section, Table};
use glam::DMat4;

use crate::bench::effort::USUAL;
use crate::bench::sampling::{Contestant, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;

/// The ways to make a mask.
const WAYS: [Sampling; 3] = [Sampling::Center, Sampling::Outline, Sampling::Exact];

/// A sphere of so many faces, from all around.
struct Case {
    faces: usize,
    /// Along a side of the image.
    pixels: usize,
    views: usize,
    /// How far vertices are off, in pixels.
    shift: f64,
}

const CASES: [Case; 3] = [
    Case { faces: 1_024, pixels: 128, views: 8, shift: 0.15 },
    Case { faces: 1_024, pixels: 128, views: 8, shift: 1.0 },
    Case { faces: 80_000, pixels: 1024, views: 1, shift: 1.0 },
];

/// Of the spheres whose radius is asked for.
const SMOOTH_FACES: [usize; 2] = [1_000, 20_000];
const SMOOTH_PIXELS: [usize; 3] = [16, 64, 512];
/// Of the central difference.
const STEP: f64 = 1e-4;

/// The mask `[H, W, 1]` of a scene: 1 where it is. Pixel centres are antialiased.
fn mask<'t, T: Scalar>(
    scene: &Scene,
    options: RasterOptions,
    camera: &DMat4,
    positions: Var<'t, T>,
) -> Result<Picture<'t, T>, FitError> {
    let clip = project(positions, camera, None)?;
    let ones = positions.tape().constant(&Tensor::full([positions.shape()[0], 1], T::ONE));
    Ok(render(clip, &scene.mesh, ones, options, Background::Zero)?)
}

/// A fit to masks.
struct Masks {
    scene: Scene,
    options: RasterOptions,
    cameras: Vec<DMat4>,
    positions: Tensor<f32>,
    references: Vec<PixelLoss<f32>>,
    tape: Tape<f32>,
}

impl Masks {
    /// From positions that are off to the masks of `scene`, as a camera sees them: means over pixels.
    fn new(
        scene: &Scene,
        shift: f64,
        views: usize,
        cull: Cull,
        sampling: Sampling,
    ) -> Result<Self, FitError> {
        let turn = |view: usize| std::f64::consts::TAU * view as f64 / views as f64;
        let cameras: Vec<_> =
            (0..views).map(|view| scene.camera * DMat4::from_rotation_y(turn(view))).collect();
        let options = RasterOptions::new(scene.size).cull(cull).sampling(Sampling::Outline);
        let reference = |camera: &DMat4| {
            let tape = Tape::new();
            let positions = tape.constant(&scene.positions.cast());
            let image = mask::<f32>(scene, options, camera, positions)?.image()?.value();
            Ok::<_, FitError>(PixelLoss::squared(&image, &Tensor::zeros([1]))?)
        };
        let references = cameras.iter().map(reference).collect::<Result<_, _>>()?;
        let (positions, tape) = (scene.jittered(shift, 0).cast(), Tape::new());
        let options = options.sampling(sampling);
        Ok(Self { scene: scene.clone(), options, cameras, positions, references, tape })
    }

    /// The gradient of the squared error of all masks.
    fn step(&mut self) -> Result<Tensor<f32>, FitError> {
        let Self { scene, options, cameras, positions, references, tape } = self;
        let gradient = {
            let positions = tape.leaf(positions);
            let mut loss: Option<Var<'_, f32>> = None;
            for (camera, reference) in cameras.iter().zip(references) {
                let term = mask(scene, *options, camera, positions)?.loss(reference)?;
                loss = Some(loss.map_or(term, |sum| sum + term));
            }
            loss.expect("there is a view").backward()?.get_or_zeros(positions)
        };
        tape.reset();
        Ok(gradient)
    }
}

/// The length of a gradient less another, as a share of the other's.
fn error(found: &Tensor<f32>, truth: &Tensor<f32>) -> f64 {
    let length =
        |entries: &mut dyn Iterator<Item = f64>| entries.map(|x| x * x).sum::<f64>().sqrt();
    let pairs = found.data().iter().zip(truth.data());
    length(&mut pairs.map(|(&found, &truth)| f64::from(found - truth)))
        / length(&mut truth.data().iter().map(|&x| f64::from(x)))
}

/// The area of a scene's mask whose radius is multiplied, and its derivative by that.
fn area(scene: &Scene, sampling: Sampling, radius: f64) -> Result<[f64; 2], FitError> {
    let tape = Tape::<f64>::new();
    let factor = tape.leaf(&Tensor::scalar(radius));
    let positions = tape.constant(&scene.positions) * factor;
    let options = RasterOptions::new(scene.size).cull(Cull::Back).sampling(sampling);
    let area = mask(scene, options, &scene.camera, positions)?.image()?.sum();
    Ok([area.item(), area.backward()?.get_or_zeros(factor).data()[0]])
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let mut study = Section::new(
        "masks",
        "Silhouette masks",
        String::from(
            "Spheres whose vertices are off (standard deviation, pixels): by 1 px they fold everywhere. Masks of \
             one channel, squared error against the masks of the sphere itself, gradient; all views on \
             one tape, f32, one thread. The error is the length of the difference from the gradient \
             with exact coverage, as a share of that; what exact coverage itself is off by is in the \
             tables above. The radius: the derivative of the area of a sphere by its radius, f64, as a \
             share of the true one. The truth is a central difference of areas with exact coverage.",
        ),
    );
    let columns = [
        ("faces", "faces"),
        ("pixels", "pixels"),
        ("views", "views"),
        ("off by, px", "shift"),
        ("back faces", "cull"),
        ("antialias, ms", "antialias_milliseconds"),
        ("outline, ms", "outline_milliseconds"),
        ("exact, ms", "exact_milliseconds"),
        ("error, antialias, %", "antialias_error"),
        ("error, outline, %", "outline_error"),
    ];
    let mut costs = Table::new("masks", "Cost of a step, and error of its gradient", &columns);
    for Case { faces, pixels, views, shift } in
        CASES.into_iter().take(bench.effort.choose(1, CASES.len()))
    {
        let scene = Scene::sphere_of(faces, bench.effort.choose(32, pixels))?;
        for (name, cull) in [("culled", Cull::Back), ("drawn", Cull::None)] {
            let (mut gradients, mut contestants) = (Vec::new(), Vec::new());
            for sampling in WAYS {
                let mut masks = Masks::new(&scene, shift, views, cull, sampling)?;
                gradients.push(masks.step()?);
                contestants.push(Contestant::new(bench.one(), move || masks.step().map(drop)));
            }
            let timings = interleaved(&mut contestants, bench.effort, USUAL);
            let timings = timings.into_iter().collect::<Result<Vec<_>, _>>();
            let Some(timings) = study.noted(name, timings) else { continue };
            let times = timings.iter().map(|timing| timing.cell(1e3 * timing.minimum));
            let [antialias, outline, exact] = &gradients[..] else { unreachable!("three ways") };
            let errors =
                [antialias, outline].map(|found| Cell::number(100.0 * error(found, exact)));
            let mut cells =
                [scene.mesh.faces().len(), scene.size.width, views].map(Cell::Count).to_vec();
            cells.extend([Cell::number(shift), Cell::text(name)]);
            cells.extend(times.chain(errors));
            costs.push(cells);
        }
    }
    let columns = [
        ("faces", "faces"),
        ("pixels", "pixels"),
        ("antialias, %", "antialias_percent"),
        ("outline, %", "outline_percent"),
        ("exact, %", "exact_percent"),
    ];
    let mut radius =
        Table::new("masks_radius", "How much of the radius' gradient is found", &columns);
    for faces in SMOOTH_FACES {
        for pixels in &SMOOTH_PIXELS[..bench.effort.choose(1, SMOOTH_PIXELS.len())] {
            let scene = Scene::sphere_of(faces, *pixels)?;
            let area_at =
                |radius: f64| Ok::<_, FitError>(area(&scene, Sampling::Exact, radius)?[0]);
            let truth = (area_at(1.0 + STEP)? - area_at(1.0 - STEP)?) / (2.0 * STEP);
            let mut cells = vec![Cell::Count(scene.mesh.faces().len()), Cell::Count(*pixels)];
            for sampling in WAYS {
                cells.push(Cell::number(100.0 * area(&scene, sampling, 1.0)?[1] / truth));
            }
            radius.push(cells);
        }
    }
    study.push_tables([costs, radius]);
    Ok(study)
}
