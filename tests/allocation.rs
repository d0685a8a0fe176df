//! A step that repeats the last one allocates nothing, on one thread.

use std::sync::Arc;

use allocation_counter::measure;
use bokashi_core::parallel::ENTRIES_PER_PIECE;
use bokashi_core::{Tape, Tensor, TensorError, Var};
use bokashi_fit::scenes::FACES;
use bokashi_fit::{FitError, squared_error};
use bokashi_render_ops::{
    Background, Blur, Kernel, Mesh, Pose, Size, antialias, gaussian_blur, interpolate, project,
    rasterize, resolve,
};
use glam::dcamera::rh::proj::opengl::perspective;
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

/// A cube in a pose before a learnt colour, from vertices to a loss, with every gradient.
struct Scene {
    mesh: Mesh,
    vertices: Tensor<f32>,
    rotation: Tensor<f32>,
    translation: Tensor<f32>,
    background: Tensor<f32>,
    target: Tensor<f32>,
}

impl Scene {
    fn new(side: usize) -> Self {
        let entries = |entries: &[f32]| Tensor::new([entries.len()], entries.to_vec()).unwrap();
        Self {
            mesh: Mesh::new(FACES.to_vec(), 8).unwrap(),
            vertices: Tensor::from_fn([8, 3], |k| ((k / 3) >> (2 - k % 3) & 1) as f32 - 0.5),
            rotation: entries(&[0.1, 0.3, 0.2, 0.9]),
            translation: entries(&[0.1, 0.0, -3.0]),
            background: entries(&[0.2, 0.1, 0.3]),
            target: Tensor::full([side, side, 3], 0.5),
        }
    }

    fn step(&self, tape: &mut Tape<f32>) -> Result<f32, FitError> {
        let sum = self.record(tape)?;
        tape.reset();
        Ok(sum)
    }

    fn record(&self, tape: &Tape<f32>) -> Result<f32, FitError> {
        let vertices = tape.leaf_copied(&self.vertices);
        let rotation = tape.leaf_copied(&self.rotation);
        let pose = Pose { rotation, translation: tape.leaf_copied(&self.translation) };
        let background = tape.leaf_copied(&self.background);
        let sigma = tape.scalar(1.2);

        let clip = project(vertices, &perspective(0.7, 1.0, 1.0, 50.0), Some(pose))?;
        let fragments = rasterize(clip, &self.mesh, Size::square(self.target.shape()[0]))?;
        let surface = interpolate(vertices, &fragments)?;
        let image = resolve(surface, &fragments, Background::Color(background))?;
        let image = antialias(image, &fragments, clip)?;
        let image = gaussian_blur(image, sigma, &Blur::default())?;
        let loss = squared_error(image, tape.constant(&self.target))?;
        let gradients = loss.backward()?;
        let of = [vertices, rotation, background, sigma].map(|leaf| gradients.get(leaf));
        Ok(of.into_iter().map(|gradient| gradient.expect("each is used").data()[0]).sum())
    }
}

/// Every kind of operation on constants, and the identities among them: values, but no nodes.
fn infer(tape: &mut Tape<f32>, parameters: &Parameters) -> Result<f32, TensorError> {
    let item = {
        let image = tape.constant(&parameters.image);
        let points = tape.constant(&parameters.points);
        let same = image.reshape(image.shape())?.powi(1).permute(&[0, 1])?.slice(1, 0..3)?;
        let colour = Var::concat(&[same], 0)?.sigmoid() * tape.constant_full([3], 0.1);
        let corners = points.gather_rows(&parameters.rows)?.transpose()?.reshape([5, 4])?;
        (colour.mean()? + corners.square().sum()).item()
    };
    tape.reset();
    Ok(item)
}

/// Steps 3 to 5 of many that are all the same give the same number and allocate nothing.
fn assert_steady_from_step_3(mut step: impl FnMut() -> f32 + Send) {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| {
        let first = step();
        assert_eq!(step(), first);
        for k in 3..6 {
            let mut sum = 0.0;
            let counted = measure(|| sum = step());
            assert_eq!(counted.count_total, 0, "step {k} allocates");
            assert_eq!(sum, first);
        }
    });
}

/// A step of every tensor operation on `pixels` pixels.
fn tensor_steps(pixels: usize) -> impl FnMut() -> f32 + Send {
    let (mut tape, parameters) = (Tape::new(), Parameters::new(pixels));
    move || step(&mut tape, &parameters).unwrap()
}

/// A step of every rendering operation on an image of `side` x `side` pixels.
fn rendering_steps(side: usize) -> impl FnMut() -> f32 + Send {
    let (mut tape, scene) = (Tape::new(), Scene::new(side));
    move || scene.step(&mut tape).unwrap()
}

#[test]
fn steady_inference_allocates_nothing() {
    for pixels in [8, ENTRIES_PER_PIECE + 5] {
        let (mut tape, parameters) = (Tape::new(), Parameters::new(pixels));
        assert_steady_from_step_3(move || infer(&mut tape, &parameters).unwrap());
    }
}

#[test]
fn steps_that_leave_out_other_work_by_turns_allocate_nothing() {
    let (mut tape, parameters) = (Tape::new(), Parameters::new(100));
    assert_steady_from_step_3(move || {
        let mut sum = 0.0;
        for (frozen, exponent) in [(false, 1), (true, 3), (false, 3), (true, 1)] {
            let image = &parameters.image;
            let image = if frozen { tape.constant(image) } else { tape.leaf(image) };
            let loss = (image.powi(exponent).exp() * tape.scalar(0.7)).sum();
            let gradients = loss.backward().unwrap();
            sum += loss.item() + gradients.get(image).map_or(0.0, |x_bar| x_bar.data()[0]);
            drop(gradients);
            tape.reset();
        }
        sum
    });
}

#[test]
fn the_memory_of_many_steps_is_that_of_the_first_ones() {
    let (mut tape, parameters) = (Tape::new(), Parameters::new(1000));
    let mut steps = |count: usize| {
        let held = measure(|| {
            for _ in 0..count {
                // A tensor of the caller's own, a new one each time, and one that outlives its step.
                let image = Parameters::new(1000).image;
                let held = (tape.leaf(&image).exp() * 2.0).value();
                tape.reset();
                step(&mut tape, &parameters).unwrap();
                drop(held);
            }
        });
        held.bytes_current
    };
    ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| {
        assert!(steps(5) > 0);
        assert_eq!(steps(50), 0);
    });
}

#[test]
fn gradients_of_inner_values_share_a_few_buffers() {
    let (entries, operations) = (1000, 100);
    let x = Tensor::full([entries], 0.5_f32);
    let tape = Tape::new();
    let leaf = tape.leaf(&x);
    let loss = (0..operations).fold(leaf, |y, _| y.sin()).sum();
    let peak = measure(|| drop(loss.backward().unwrap())).bytes_max;
    // The gradients of three values at one time, in buffers of a power of two, and small lists.
    assert!(peak < 3 * 1024 * 4 + 100 * operations, "{peak} bytes");
}

#[test]
fn a_steady_step_on_small_arrays_allocates_nothing() {
    assert_steady_from_step_3(tensor_steps(8));
}

#[test]
fn a_steady_step_on_arrays_of_many_pieces_allocates_nothing() {
    assert_steady_from_step_3(tensor_steps(ENTRIES_PER_PIECE + 5));
}

#[test]
fn a_steady_step_of_rendering_allocates_nothing() {
    assert_steady_from_step_3(rendering_steps(32));
}

#[test]
fn a_steady_step_of_rendering_in_many_pieces_allocates_nothing() {
    assert_steady_from_step_3(rendering_steps(300));
}

#[test]
fn a_steady_step_of_every_blur_allocates_nothing() {
    for (kernel, sigma) in
        [(Kernel::Sampled, 3.0), (Kernel::Discrete, 3.0), (Kernel::Discrete, 40.0)]
    {
        let image = Tensor::from_fn([150, 160, 3], |k| (k % 101) as f32);
        let blur = Blur { kernel, ..Blur::default() };
        let mut tape = Tape::new();
        assert_steady_from_step_3(|| {
            let sum = {
                let (image, sigma) = (tape.leaf_copied(&image), tape.scalar(sigma));
                let loss = gaussian_blur(image, sigma, &blur).unwrap().square().sum();
                let gradients = loss.backward().unwrap();
                let of = [image, sigma].map(|leaf| gradients.get(leaf).unwrap().data()[0]);
                loss.item() + of[0] + of[1]
            };
            tape.reset();
            sum
        });
    }
}
