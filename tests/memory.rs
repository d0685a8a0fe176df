//! How much memory a step takes at its peak.

use allocation_counter::measure;
use bokashi_bench::largest_steps;
use rayon::ThreadPoolBuilder;

#[test]
fn a_step_of_80_thousand_faces_peaks_below_200_bytes_per_pixel() {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let peak = alone.install(|| {
        let mut pixels = 0;
        // Target and parameters count, and so does the mesh with its adjacency.
        let counted = measure(|| {
            let (mut step, count) = largest_steps().unwrap();
            pixels = count;
            (0..3).for_each(|_| step().unwrap());
        });
        counted.bytes_max as f64 / pixels as f64
    });
    println!("{peak:.1} bytes per pixel");
    assert!(peak > 12.0, "the target alone takes 12, got {peak}");
    assert!(peak < 200.0, "{peak} bytes per pixel");
}
