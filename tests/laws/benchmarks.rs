//! Every operation on the inputs of its benchmarks: it is what the label says, and gives the same bits on any
//! number of threads.

use std::sync::Arc;

use bokashi_catalogue::setting::Setting;
use bokashi_catalogue::{Benchmark, ENTRIES};
use bokashi_check::{Case, Number};
use bokashi_core::{OperationReport, Tape, Tensor};
use rayon::{ThreadPool, ThreadPoolBuilder};

fn benchmarks() -> impl Iterator<Item = Benchmark> {
    ENTRIES.iter().flat_map(|entry| entry().benchmarks().to_vec())
}

/// An upstream gradient for each entry of a sum, no two alike.
fn motley<T: Number>(k: usize) -> T {
    T::from_f64((k as f64 * 0.731).sin())
}

/// The output, and the gradient of each input.
fn results<T: Number>(case: &Case) -> Vec<Tensor<T>> {
    let tape = Tape::new();
    let inputs: Vec<_> =
        case.inputs().iter().map(|input| tape.leaf(&input.tensor.cast())).collect();
    let output = case.record(&tape, &inputs).unwrap();
    let upstream = Tensor::from_flat_fn(output.shape(), motley);
    let gradients = tape.vjp(&[(output, &upstream)]).unwrap();
    let bars = inputs.iter().map(|&input| gradients.get_or_zeros(input));
    std::iter::once(output.value()).chain(bars).collect()
}

fn bits<T: Number>(tensors: &[Tensor<T>]) -> Vec<u64> {
    tensors.iter().flat_map(|tensor| tensor.data()).map(|x| x.to_f64().to_bits()).collect()
}

fn assert_same_bits<T: Number>() {
    // Several pieces of work: vertices, faces, pixels and entries.
    let setting = Arc::new(Setting::with_sphere(120, 90, 192).unwrap());
    let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let pools = [1, 2, 3, 7].map(pool);
    for benchmark in benchmarks() {
        let case = benchmark.case(&setting);
        let on = |pool: &ThreadPool| pool.install(|| results::<T>(&case));
        let alone = on(&pools[0]);
        let label = benchmark.label();
        assert!(alone.iter().all(Tensor::is_finite), "{label}: a NaN hides what follows from it");
        for pool in &pools[1..] {
            assert!(bits(&on(pool)) == bits(&alone), "{label}: threads change bits");
        }
    }
}

#[test]
fn f32_results_are_the_same_bits_for_any_number_of_threads() {
    assert_same_bits::<f32>();
}

#[test]
fn f64_results_are_the_same_bits_for_any_number_of_threads() {
    assert_same_bits::<f64>();
}

#[test]
fn every_benchmark_is_on_the_tape_under_its_name_and_is_walked_back() {
    let setting = Arc::new(Setting::new(32).unwrap());
    for benchmark in benchmarks() {
        let (case, name, tape) = (benchmark.case(&setting), benchmark.name(), Tape::<f32>::new());
        let inputs: Vec<_> =
            case.inputs().iter().map(|input| tape.leaf(&input.tensor.cast())).collect();
        let output = case.record(&tape, &inputs).unwrap();
        tape.vjp(&[(output, &Tensor::full(output.shape(), 1.0))]).unwrap();
        let report = tape.take_report();
        let is_walked = |entry: &OperationReport| entry.calls > 0 && entry.backward_calls > 0;
        if COMPOSITIONS.contains(&name) {
            assert!(!report.operations.iter().any(|entry| entry.name == name), "{report}");
            assert!(report.operations.iter().any(is_walked), "{report}");
            continue;
        }
        let operation = report.operations.iter().find(|entry| entry.name == name);
        let operation = operation.unwrap_or_else(|| panic!("{name} is not in {report}"));
        assert!(is_walked(operation), "{report}");
    }
}

/// Benchmarks of functions that record other operations.
const COMPOSITIONS: [&str; 10] = [
    "chamfer_distance",
    "draw_points",
    "keepdim",
    "mean_absolute_error",
    "mean_charbonnier_error",
    "mean_huber_error",
    "mean_relative_error",
    "mean_squared_error",
    "silhouette_error",
    "total_variation",
];

/// What is made of operations that have benchmarks.
const COMPOSED: [&str; 7] = [
    "blurred_pictures",
    "compositions",
    "constant_fragments",
    "constant_textures",
    "environment",
    "exact_coverage",
    "pipeline",
];

#[test]
fn every_entry_has_a_benchmark_or_is_composed() {
    for entry in ENTRIES.iter().map(|entry| entry()) {
        let is_composed = COMPOSED.contains(&entry.name());
        assert!(entry.benchmarks().is_empty() == is_composed, "{}", entry.name());
    }
}
