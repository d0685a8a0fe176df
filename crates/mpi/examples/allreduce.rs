//! What the same bits cost: sums of numbers in the fits' tree, beside MPI's own allreduce.
//!
//! `mpirun -n 4 cargo run --release --package bokashi-mpi --features mpi --example allreduce`, or the built
//! example in place of cargo.
//! A single number tells what a message costs by itself, a million how fast they travel.

use bokashi_fit::{Communicator, sum_over_ranks};
use bokashi_mpi::World;
use bokashi_report::median;
use bokashi_scene::Tensor;
use mpi::collective::SystemOperation;
use mpi::traits::CommunicatorCollectives as _;

/// Numbers of a sum.
const SIZES: [usize; 3] = [1, 1 << 14, 1_000_000];
/// Sums of each kind, which take turns.
const TIMES: usize = 101;

fn main() {
    let universe = mpi::initialize().expect("MPI starts once");
    let world = World::new(&universe);
    let ranks: &dyn Communicator<f32> = &world;
    for numbers in SIZES {
        let own = Tensor::from_flat_fn([numbers], |k| ((k * (ranks.rank() + 1)) as f32).sin());
        let mut found = vec![0.0_f32; numbers];
        let (mut of_mpi, mut of_tree) = (Vec::new(), Vec::new());
        for _ in 0..TIMES {
            ranks.barrier();
            let start = mpi::time();
            universe.world().all_reduce_into(own.data(), &mut found[..], SystemOperation::sum());
            of_mpi.push(mpi::time() - start);

            ranks.barrier();
            let own = own.clone();
            let start = mpi::time();
            let sum = sum_over_ranks(ranks, own).expect("no rank fails");
            of_tree.push(mpi::time() - start);
            let off = sum.data().iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-5, "sums differ by {off}");
        }
        if ranks.rank() == 0 {
            let [of_mpi, of_tree] = [of_mpi, of_tree]
                .map(|seconds| 1e6 * median(seconds.into_iter()).unwrap_or(f64::NAN));
            let (size, ratio) = (ranks.size(), of_tree / of_mpi);
            println!(
                "{size} ranks, {numbers} numbers: MPI {of_mpi:.1} us, tree {of_tree:.1} us, ratio {ratio:.2}"
            );
        }
    }
}
