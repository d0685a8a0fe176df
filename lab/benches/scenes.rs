//! What does a step cost, from vertices to gradients, by scene and number of threads? In `f32`, both
//! sides drawn. The table with errors and other renderers is that of `bokashi-lab bench`.

use bokashi_lab::bench::{Scene, scenes};
use divan::Bencher;
use rayon::ThreadPoolBuilder;

fn main() {
    divan::main();
}

/// The scenes, each on one thread and on two.
fn cases() -> Vec<(String, usize)> {
    let names = scenes().expect("six scenes").iter().map(|scene| scene.name().to_owned()).collect();
    let names: Vec<String> = names;
    names.iter().flat_map(|name| [1, 2].map(|threads| (name.clone(), threads))).collect()
}

#[divan::bench(args = cases())]
fn step(bencher: Bencher<'_, '_>, (name, threads): &(String, usize)) {
    let all = scenes().expect("six scenes");
    let scene: &Scene = all.iter().find(|scene| scene.name() == name).expect("one of the scenes");
    let pool = ThreadPoolBuilder::new().num_threads(*threads).build().expect("a pool of threads");
    let mut step = scene.steps().expect("steps that nothing refuses");
    bencher.bench_local(move || pool.install(&mut step).expect("a step that nothing refuses"));
}
