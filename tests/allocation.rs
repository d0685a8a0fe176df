//! A step that repeats the last one allocates nothing, on one thread.

use std::sync::Arc;

use allocation_counter::measure;
use bokashi_core::parallel::ENTRIES_PER_PIECE;
use bokashi_core::{Tape, Tensor, TensorError, Var};
use rayon::ThreadPoolBuilder;

/// The leaves of a step.
struct Parameters {
    points: Tensor<f32>,
    weights: Tensor<f32>,
    image: Tensor<f32>,
    rows: Arc<[u32]>,
}

impl Parameters {
    fn new(pixels: usize) -> Self {
        Self {
            points: Tensor::from_fn([9, 4], |k| 0.1 * k as f32 - 1.0),
            weights: Tensor::from_fn([4, 3], |k| 0.3 - 0.1 * k as f32),
            image: Tensor::from_fn([pixels, 3], |k| (k % 7) as f32 * 0.1),
            rows: Arc::from([0, 8, 3, 3, 1]),
        }
    }
}

/// Records every kind of operation, reads gradients of two passes at once, and ends the step.
fn step(tape: &mut Tape<f32>, parameters: &Parameters) -> Result<f32, TensorError> {
    let sum = record(tape, parameters)?;
    tape.reset();
    Ok(sum)
}

fn record(tape: &Tape<f32>, parameters: &Parameters) -> Result<f32, TensorError> {
    let points = tape.leaf(&parameters.points);
    let weights = tape.leaf_copied(&parameters.weights);
    let image = tape.leaf(&parameters.image);
    let scale = tape.scalar(0.7);
    let offset = tape.constant_full([3], 0.1);

    let corners = points.gather_rows(&parameters.rows)?.matmul(weights)? + offset;
    let shapes = corners.transpose()?.permute(&[1, 0])?.reshape([5, 3, 1])?.slice(0, 1..4)?;
    let parts = [scale.reshape([1])?; 6];
    let joined = Var::concat(&parts, 0)?.tanh();
    let smooth = image.sigmoid() + image.softplus() + image.exp().sqrt() + (image + 1.0).ln();
    let rough = image.abs().minimum(image.cos())?.maximum(image.sin())?.clamp(-0.5, 0.5)?;
    let colour = (smooth / (rough.square() + 1.0) - 2.0 * rough.powi(3)) * offset * scale;

    let first = shapes.mean()? + joined.sum() - shapes.detach().sum();
    let second = colour.sum_axis(0)?.mean_axis(0)? + colour.mean()? + colour.square().sum();
    let (first, second) = (first.backward()?, (second * scale).backward_to(&[image, scale])?);
    let [a, b] = [first.get(weights), second.get(image)].map(|g| g.expect("both are used"));
    Ok(a.data()[0] + b.data()[0] + first.get_or_zeros(scale).item())
}

fn assert_steady_from_step_3(pixels: usize) {
    let mut tape = Tape::new();
    let parameters = Parameters::new(pixels);
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| {
        let first = step(&mut tape, &parameters).unwrap();
        assert_eq!(step(&mut tape, &parameters), Ok(first));
        for k in 3..6 {
            let mut sum = 0.0;
            let counted = measure(|| sum = step(&mut tape, &parameters).unwrap());
            assert_eq!(counted.count_total, 0, "step {k} allocates");
            assert_eq!(sum, first);
        }
    });
}

#[test]
fn a_steady_step_on_small_arrays_allocates_nothing() {
    assert_steady_from_step_3(8);
}

#[test]
fn a_steady_step_on_arrays_of_many_pieces_allocates_nothing() {
    assert_steady_from_step_3(ENTRIES_PER_PIECE + 5);
}
