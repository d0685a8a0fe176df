//! How much memory steps take at their peak.

use std::ops::ControlFlow;

use allocation_counter::measure;
use bokashi_core::Scalar;
use bokashi_fit::FitError;
use bokashi_lab::bench::Scene;
use bokashi_paper::{CubeSettings, Experiment, Precision, Preset, Silhouettes, run_cube};
use bokashi_render_ops::{Cull, RasterOptions, Sampling};
use rayon::ThreadPoolBuilder;

/// The largest number of bytes that `work` holds at a time, for each of `pixels` pixels, on one thread.
fn bytes_per_pixel(pixels: usize, work: impl FnOnce() -> Result<(), FitError> + Send) -> f64 {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let counted = alone.install(|| measure(|| work().unwrap()));
    counted.bytes_max as f64 / pixels as f64
}

/// Parameters, target, tape and three steps.
fn of_steps<T: Scalar>(scene: &Scene, options: RasterOptions) -> f64 {
    // The mesh and its adjacency are not the steps'.
    bytes_per_pixel(scene.pixels(), || {
        let mut step = scene.steps_with::<T>(options)?;
        (0..3).try_for_each(|_| step())
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
    let scene = Scene::largest().unwrap();
    let peak = of_steps::<f32>(&scene, RasterOptions::new(scene.size()));
    assert!(peak > 12.0, "the target alone takes 12 bytes per pixel, got {peak}");
    assert!(peak < 100.0, "{peak} bytes per pixel");
    println!("{peak:.1} bytes per pixel");
}

#[test]
fn steps_in_f64_on_large_images_peak_below_100_bytes_per_pixel() {
    let scene = Scene::sphere_of(1_000, 1024).unwrap();
    for sampling in [Sampling::Center, Sampling::Exact] {
        let options = RasterOptions::new(scene.size()).cull(Cull::Back).sampling(sampling);
        let peak = of_steps::<f64>(&scene, options);
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
        let peak = of_fit(experiment, silhouettes, 1024);
        assert!(peak < 160.0, "{experiment}, {silhouettes}: {peak} bytes per pixel");
        println!("{experiment}, {silhouettes}: {peak:.1} bytes per pixel");
    }
}
