//! How much memory steps take at their peak.

use allocation_counter::measure;
use bokashi_lab::bench::Scene;
use rayon::ThreadPoolBuilder;

#[test]
fn steps_on_80_thousand_faces_peak_below_200_bytes_per_pixel() {
    // The mesh and its adjacency are not the steps'.
    let scene = Scene::largest().unwrap();
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let counted = alone.install(|| {
        // Parameters, target and tape are.
        measure(|| {
            let mut step = scene.steps().unwrap();
            (0..3).for_each(|_| step().unwrap());
        })
    });
    let peak = counted.bytes_max as f64 / scene.pixels() as f64;
    assert!(peak > 12.0, "the target alone takes 12 bytes per pixel, got {peak}");
    assert!(peak < 200.0, "{peak} bytes per pixel");
    println!("{peak:.1} bytes per pixel");
}
