//! How much memory steps take at their peak.

use std::ops::ControlFlow;

use allocation_counter::measure;
use bokashi_catalogue::scenes::motley;
use bokashi_catalogue::setting::sphere;
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_paper::{CubeSettings, Experiment, Precision, Preset, Silhouettes, View, run_cube};
use bokashi_render_ops::{
    Background, Cull, Mesh, Picture, PixelLoss, RasterOptions, Sampling, Size, interpolate,
    project, rasterize,
};
use rayon::ThreadPoolBuilder;

/// The side of the images, in pixels.
const SIDE: usize = 1024;

/// The radius of the spheres.
const RADIUS: f64 = 0.8;

/// Positions are off by up to half of this along each axis, which is a standard deviation of 1.2 pixels: a fine
/// surface folds everywhere.
const SHIFT: f64 = 0.0114;

/// Colours are this far off.
const TINT: f64 = 0.05;

/// The picture of a mesh with these positions and colours, seen as the paper's cube.
fn picture<'t, T: Scalar>(
    mesh: &Mesh,
    options: RasterOptions,
    [positions, colors]: [Var<'t, T>; 2],
) -> Result<Picture<'t, T>, FitError> {
    let clip = project(positions, &View::fixed().camera(), None)?;
    let fragments = rasterize(clip, mesh, options.creases(&[]))?;
    Ok(fragments.picture(interpolate(colors, &fragments)?, Background::Zero)?)
}

/// The largest number of bytes that `work` holds at a time, for each of `pixels` pixels, on one thread.
fn bytes_per_pixel(pixels: usize, work: impl FnOnce() -> Result<(), FitError> + Send) -> f64 {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let counted = alone.install(|| measure(|| work().unwrap()));
    counted.bytes_max as f64 / pixels as f64
}

/// Three steps on a sphere of `around` x `along` quads with a colour at each vertex: parameters, target, tape.
fn bytes_of_steps<T: Scalar>([around, along]: [usize; 2], options: RasterOptions) -> f64 {
    let (faces, positions) = sphere(RADIUS, around, along);
    let colors = positions.map(|x: f64| x / (2.0 * RADIUS) + 0.5);
    let mesh = Mesh::new(faces, positions.shape()[0]).unwrap();
    // The mesh and its adjacency are not the steps'.
    mesh.adjacency();
    bytes_per_pixel(options.size.pixels(), || {
        let mut tape = Tape::<T>::new();
        let target = {
            let truth = [&positions, &colors].map(|of| tape.constant(&of.cast()));
            picture(&mesh, options, truth)?.image()?.value()
        };
        tape.reset();
        let target = PixelLoss::squared(&target, &Tensor::zeros([3]))?;
        let off = |k: usize| T::from_f64(positions.data()[k] + SHIFT * motley(k));
        let parameters = [
            Tensor::from_flat_fn(positions.shape(), off),
            colors.map(|color: f64| T::from_f64((color + TINT).min(1.0))),
        ];
        for _ in 0..3 {
            let leaves = [0, 1].map(|k| tape.leaf(&parameters[k]));
            let gradients = picture(&mesh, options, leaves)?.loss(&target)?.backward()?;
            assert!(leaves.iter().all(|leaf| gradients.get(*leaf).is_some()));
            drop(gradients);
            tape.reset();
        }
        Ok(())
    })
}

/// A fit of the cube in images of `side` x `side` pixels, with its targets: three steps, in `f64`.
fn of_fit(experiment: Experiment, silhouettes: Silhouettes, side: usize) -> f64 {
    let settings = CubeSettings::new(experiment, Preset::Paper);
    let precision = Precision::F64;
    let settings = CubeSettings { resolution: side, silhouettes, precision, steps: 3, ..settings };
    bytes_per_pixel(side * side, || {
        run_cube(&settings, &mut |_| ControlFlow::Continue(())).map(drop)
    })
}

#[test]
fn steps_on_80_thousand_faces_peak_below_100_bytes_per_pixel() {
    let peak = bytes_of_steps::<f32>([288, 140], RasterOptions::new(Size::square(SIDE)));
    assert!(peak > 12.0, "the target alone takes 12 bytes per pixel, got {peak}");
    assert!(peak < 100.0, "{peak} bytes per pixel");
    println!("{peak:.1} bytes per pixel");
}

#[test]
fn steps_in_f64_on_large_images_peak_below_100_bytes_per_pixel() {
    for sampling in [Sampling::Center, Sampling::Exact] {
        let options = RasterOptions::new(Size::square(SIDE)).cull(Cull::Back).sampling(sampling);
        let peak = bytes_of_steps::<f64>([32, 17], options);
        assert!(peak > 24.0, "the target alone takes 24 bytes per pixel, got {peak}");
        assert!(peak < 100.0, "{sampling:?}: {peak} bytes per pixel");
        println!("{sampling:?}: {peak:.1} bytes per pixel");
    }
}

/// A step and its target share their memory, and a blur has no image but its target. Buffers are powers of
/// two, so that a target takes 32 bytes per pixel.
#[test]
fn fits_of_the_paper_in_f64_peak_below_160_bytes_per_pixel() {
    for (experiment, silhouettes) in [
        (Experiment::Vertices, Silhouettes::Antialias),
        (Experiment::Joint, Silhouettes::Antialias),
        (Experiment::Joint, Silhouettes::Exact),
    ] {
        let peak = of_fit(experiment, silhouettes, SIDE);
        assert!(peak < 160.0, "{experiment}, {silhouettes}: {peak} bytes per pixel");
        println!("{experiment}, {silhouettes}: {peak:.1} bytes per pixel");
    }
}
