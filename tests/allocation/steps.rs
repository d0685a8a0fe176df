//! A step that repeats the last one allocates nothing on one thread, and on several no more than
//! lists of what its pieces find.

use std::sync::{Arc, Mutex};
use std::thread;

use allocation_counter::measure;
use bokashi_catalogue::setting::Setting;
use bokashi_catalogue::{Benchmark, ENTRIES};
use bokashi_core::parallel::ENTRIES_PER_PIECE;
use bokashi_core::{SparseMatrix, Tape, Tensor, TensorError, Var};
use bokashi_fit::{Fit, FitError, FitSettings, Parameter, Parameters, from_fn, squared_error};
use bokashi_paper::FACES;
use bokashi_render_ops::{
    Background, Blur, Coverage, Kernel, Mesh, PixelLoss, Pose, Radius, RasterOptions, Sampling,
    Size, gaussian_blur, interpolate, project, rasterize,
};
use glam::dcamera::rh::proj::opengl::perspective;
use rayon::{ThreadBuilder, ThreadPoolBuilder};

/// The leaves of a step.
struct Leaves {
    points: Tensor<f32>,
    weights: Tensor<f32>,
    image: Tensor<f32>,
    rows: Arc<[u32]>,
    matrix: SparseMatrix<f32>,
}

impl Leaves {
    fn new(pixels: usize) -> Self {
        Self {
            points: Tensor::from_flat_fn([9, 4], |k| 0.1 * k as f32 - 1.0),
            weights: Tensor::from_flat_fn([4, 3], |k| 0.3 - 0.1 * k as f32),
            image: Tensor::from_flat_fn([pixels, 3], |k| (k % 7) as f32 * 0.1),
            rows: Arc::from([0, 8, 3, 3, 1]),
            matrix: SparseMatrix::new(
                pixels,
                pixels,
                (0..2 * pixels as u32).map(|k| (k / 2, k * 31 % pixels as u32, 0.5)),
            )
            .expect("entries lie within"),
        }
    }
}

/// Records operations of many kinds, reads gradients of two passes at once, and ends the step.
fn step(tape: &mut Tape<f32>, parameters: &Leaves) -> Result<f32, TensorError> {
    let sum = record(tape, parameters)?;
    tape.reset();
    Ok(sum)
}

fn record(tape: &Tape<f32>, parameters: &Leaves) -> Result<f32, TensorError> {
    let points = tape.leaf(&parameters.points);
    let weights = tape.leaf_copied(&parameters.weights);
    let image = tape.leaf(&parameters.image);
    let scale = tape.leaf_scalar(0.7);
    let offset = tape.constant_full([3], 0.1);

    let corners = points.gather_rows(&parameters.rows)?.matmul(weights)? + offset;
    let shapes = corners.transpose()?.permute(&[1, 0])?.reshape([5, 3, 1])?.slice(0, 1..4)?;
    let parts = [scale.reshape([1])?; 6];
    let joined = Var::concat(&parts, 0)?.tanh();
    let smooth = image.sigmoid() + image.softplus() + image.exp().sqrt() + (image + 1.0).ln();
    let rough = image.abs().minimum(image.cos())?.maximum(image.sin())?.clamp(-0.5, 0.5)?;
    let colour = (smooth / (rough.square() + 1.0) - 2.0 * rough.powi(3)) * offset * scale;

    let chosen = image.is_less(scale)?.select(image, scale)?;
    let vectors = parameters.matrix.product(chosen)?.mean()?;

    let first = shapes.mean()? + joined.sum() - shapes.detach().sum();
    let second =
        colour.sum_axis(0)?.mean_axis(0)? + colour.mean()? + colour.square().sum() + vectors;
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
    target: PixelLoss<f32>,
    sampling: Sampling,
    /// Whether the picture is blurred and compared before a constant colour, without its image.
    is_blurred_by_rows: bool,
}

impl Scene {
    fn new(side: usize, sampling: Sampling) -> Self {
        let entries = |entries: &[f32]| Tensor::new([entries.len()], entries.to_vec()).unwrap();
        Self {
            mesh: Mesh::new(FACES.to_vec(), 8).unwrap(),
            vertices: Tensor::from_flat_fn([8, 3], |k| ((k / 3) >> (2 - k % 3) & 1) as f32 - 0.5),
            rotation: entries(&[0.1, 0.3, 0.2, 0.9]),
            translation: entries(&[0.1, 0.0, -3.0]),
            background: entries(&[0.2, 0.1, 0.3]),
            target: PixelLoss::squared(&Tensor::full([side, side, 3], 0.5), &Tensor::zeros([3]))
                .unwrap(),
            sampling,
            is_blurred_by_rows: false,
        }
    }

    fn step(&self, tape: &mut Tape<f32>) -> Result<f32, FitError> {
        let sum = self.record(tape)?;
        tape.reset();
        Ok(sum)
    }

    fn record(&self, tape: &Tape<f32>) -> Result<f32, FitError> {
        let leaves = [&self.vertices, &self.rotation, &self.translation, &self.background];
        let [vertices, rotation, translation, background] = leaves.map(|of| tape.leaf_copied(of));
        let sigma = tape.leaf_scalar(1.2);
        let variables = [vertices, rotation, translation, background, sigma];
        let gradients = self.loss(variables)?.backward()?;
        let of = [vertices, rotation, background, sigma].map(|leaf| gradients.get(leaf));
        Ok(of.into_iter().map(|gradient| gradient.expect("each is used").data()[0]).sum())
    }

    fn loss<'t>(
        &self,
        [vertices, rotation, translation, background, sigma]: [Var<'t, f32>; 5],
    ) -> Result<Var<'t, f32>, FitError> {
        let pose = Pose { rotation, translation };
        let clip = project(vertices, &perspective(0.7, 1.0, 1.0, 50.0), Some(pose))?;
        let size = Size::square(self.target.reference().shape()[0]);
        let options = RasterOptions::new(size).sampling(self.sampling);
        let fragments = rasterize(clip, &self.mesh, options.creases(&[]))?;
        let surface = interpolate(vertices, &fragments)?;
        let behind = if self.is_blurred_by_rows { background.detach() } else { background };
        let picture = fragments.picture(surface, Background::Color(behind))?;
        if self.is_blurred_by_rows {
            let loss = picture.blurred(sigma, &Blur::default()).loss(&self.target)?;
            return Ok(loss + background.square().sum());
        }
        let image = gaussian_blur(picture.image()?, sigma, &Blur::default())?;
        Ok(self.target.evaluate(image)?)
    }
}

/// Operations on constants, and the identities among them: values, but no nodes.
fn infer(tape: &mut Tape<f32>, parameters: &Leaves) -> Result<f32, TensorError> {
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

/// Steps 3 to 5 allocate nothing.
fn assert_nothing_allocated_from_step_3(mut step: impl FnMut() + Send) {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| {
        step();
        step();
        for k in 3..6 {
            assert_eq!(measure(&mut step).count_total, 0, "step {k} allocates");
        }
    });
}

/// The same of steps that are all the same: they give the same number, too.
fn assert_steady_from_step_3(mut step: impl FnMut() -> f32 + Send) {
    let mut first = None;
    assert_nothing_allocated_from_step_3(|| {
        let sum = step();
        assert_eq!(*first.get_or_insert(sum), sum);
    });
}

/// A step of tensor operations on `pixels` pixels.
fn tensor_steps(pixels: usize) -> impl FnMut() -> f32 + Send {
    let (mut tape, parameters) = (Tape::new(), Leaves::new(pixels));
    move || step(&mut tape, &parameters).unwrap()
}

/// A step from vertices to a loss on an image of `side` x `side` pixels.
fn rendering_steps(side: usize) -> impl FnMut() -> f32 + Send {
    let (mut tape, scene) = (Tape::new(), Scene::new(side, Sampling::Center));
    move || scene.step(&mut tape).unwrap()
}

/// Operations that return lists, of levels or of layers.
const LISTS: [&str; 5] =
    ["mipmaps", "sample_texture", "sample_cube_map", "composite_layers", "lens_picture"];

/// What makes something in each step: a matrix, a reference image, a list of creases, tapes of parts, a mesh, trees of
/// points. The first three have steps of their own below.
const MAKING: [&str; 7] = [
    "sparse_product",
    "squared_error, a picture",
    "rasterize, exact",
    "sum_over",
    "field_surface",
    "chamfer_distance",
    "draw_points",
];

#[test]
fn a_steady_step_of_every_operation_allocates_nothing() {
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let benchmarks: Vec<_> =
        ENTRIES.iter().flat_map(|entry| entry().benchmarks().to_vec()).collect();
    // A name that no operation has any more excepts nothing.
    for label in MAKING {
        assert!(benchmarks.iter().any(|benchmark| benchmark.label() == label), "no {label}");
    }
    for name in LISTS {
        assert!(benchmarks.iter().any(|benchmark| benchmark.name() == name), "no {name}");
    }
    let steady = |benchmark: &&Benchmark| !MAKING.contains(&benchmark.label());
    // One piece of work and several.
    for (around, along, pixels) in [(12, 7, 32), (90, 60, 160)] {
        let setting = Arc::new(Setting::with_sphere(around, along, pixels).unwrap());
        for benchmark in benchmarks.iter().filter(steady) {
            let case = benchmark.case(&setting);
            let inputs: Vec<Tensor<f32>> =
                case.inputs().iter().map(|input| input.tensor.cast()).collect();
            let (mut tape, mut upstream) = (Tape::new(), None);
            let mut step = || {
                {
                    let leaf = |k: usize| tape.leaf(&inputs[k.min(inputs.len() - 1)]);
                    let leaves: [_; 7] = std::array::from_fn(leaf);
                    let output = case.record(&tape, &leaves[..inputs.len()]).unwrap();
                    let ones = || Tensor::full(output.shape(), 1.0);
                    let upstream = upstream.get_or_insert_with(ones);
                    drop(tape.vjp(&[(output, upstream)]).unwrap());
                }
                tape.reset();
            };
            let counted = alone.install(|| {
                (0..4).for_each(|_| step());
                measure(&mut step)
            });
            let (label, is_list) = (benchmark.label(), LISTS.contains(&benchmark.name()));
            // The list of outputs that a subject gives is the only one.
            let is_steady = counted.count_total == 1 || is_list && counted.bytes_total < 500;
            assert!(is_steady, "{label}: {counted:?}");
        }
    }
}

#[test]
fn steady_inference_allocates_nothing() {
    for pixels in [8, ENTRIES_PER_PIECE + 5] {
        let (mut tape, parameters) = (Tape::new(), Leaves::new(pixels));
        assert_steady_from_step_3(move || infer(&mut tape, &parameters).unwrap());
    }
}

#[test]
fn steps_that_leave_out_other_work_by_turns_allocate_nothing() {
    let (mut tape, parameters) = (Tape::new(), Leaves::new(100));
    assert_steady_from_step_3(move || {
        let mut sum = 0.0;
        for (frozen, exponent) in [(false, 1), (true, 3), (false, 3), (true, 1)] {
            let image = &parameters.image;
            let image = if frozen { tape.constant(image) } else { tape.leaf(image) };
            let loss = (image.powi(exponent).exp() * tape.leaf_scalar(0.7)).sum();
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
    let (mut tape, parameters) = (Tape::new(), Leaves::new(1000));
    let mut steps = |count: usize| {
        let held = measure(|| {
            for _ in 0..count {
                // A tensor of the caller's own, a new one each time, and one that outlives its step.
                let image = Leaves::new(1000).image;
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
fn a_steady_step_with_a_picture_that_is_blurred_by_rows_allocates_nothing() {
    for side in [32, 300] {
        let scene = Scene::new(side, Sampling::Center);
        let (mut tape, scene) = (Tape::new(), Scene { is_blurred_by_rows: true, ..scene });
        assert_steady_from_step_3(move || scene.step(&mut tape).unwrap());
    }
}

#[test]
fn a_steady_step_with_a_target_made_aside_allocates_nothing() {
    let (mut tape, entries) = (Tape::<f32>::new(), 1 << 18);
    let x = Tensor::full([entries], 0.5);
    let mut target: Option<Tensor<f32>> = None;
    assert_steady_from_step_3(move || {
        if let Some(target) = target.take() {
            tape.recycle(target);
        }
        let made = tape.aside(|tape| (tape.constant(&x).exp() * 0.5).value());
        let sum = {
            let leaf = tape.leaf(&x);
            let loss = squared_error(leaf.exp(), tape.constant(&made)).unwrap();
            let gradients = loss.backward().unwrap();
            loss.item() + gradients.get(leaf).unwrap().data()[7]
        };
        target = Some(made);
        tape.reset();
        sum
    });
}

// The memory of parts' gradients is used again. That of their sum leaves with the step.
#[test]
fn a_steady_step_of_a_sum_over_parts_allocates_no_more_than_the_gradient_of_the_sum() {
    let (mut tape, entries) = (Tape::<f32>::new(), 1 << 18);
    let x = Tensor::full([entries], 0.5);
    let mut step = move || {
        let leaf = tape.leaf(&x);
        let sum = tape.sum_over(8, &[leaf], |_, _, x| Ok::<_, TensorError>(x[0].square().sum()));
        let found = sum.unwrap().backward().unwrap().get(leaf).unwrap().data()[7];
        assert_eq!(found, 8.0);
        tape.reset();
    };
    let alone = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    alone.install(|| {
        step();
        step();
        for k in 3..6 {
            let bytes = measure(&mut step).bytes_total as usize;
            assert!(bytes < 2 * 4 * entries, "step {k} allocates {bytes} bytes");
        }
    });
}

#[test]
fn a_steady_step_with_exact_coverage_allocates_nothing() {
    for side in [32, 300] {
        let (mut tape, scene) = (Tape::new(), Scene::new(side, Sampling::Exact));
        assert_steady_from_step_3(move || scene.step(&mut tape).unwrap());
    }
}

#[test]
fn a_steady_step_of_training_allocates_nothing() {
    for side in [32, 300] {
        let scene = Scene::new(side, Sampling::Center);
        // The cube moves by so little that it covers the same pixels.
        let moved = |name, value: &Tensor<f32>| Parameter::new(name, value.clone()).rate(1e-6);
        let parameters = Parameters::new()
            .with(moved("vertices", &scene.vertices))
            .and_then(|all| all.with(moved("rotation", &scene.rotation)))
            .and_then(|all| all.with(moved("translation", &scene.translation)))
            .and_then(|all| all.with(Parameter::new("background", scene.background.clone())))
            .and_then(|all| all.with(Parameter::new("sigma", Tensor::scalar(1.2))));
        let mut fit = Fit::new(parameters.unwrap(), FitSettings::default()).unwrap();
        let mut pipeline =
            from_fn(|_, variables| scene.loss(std::array::from_fn(|at| variables[at])));
        let mut before = f64::INFINITY;
        assert_nothing_allocated_from_step_3(|| {
            let loss = fit.step(&mut pipeline).unwrap().loss;
            assert!(loss < before, "{loss} after {before}");
            before = loss;
        });
    }
}

#[test]
fn a_steady_step_of_every_blur_allocates_nothing() {
    let half_size = Radius::Tolerance(0.15);
    let usual = Blur::default().radius;
    for (kernel, sigma, radius) in [
        (Kernel::Sampled, 3.0, usual),
        (Kernel::Discrete, 3.0, usual),
        (Kernel::Discrete, 40.0, usual),
        (Kernel::Disc, 3.0, usual),
        (Kernel::Disc, 10.0, half_size),
    ] {
        let image = Tensor::from_flat_fn([150, 160, 3], |k| (k % 101) as f32);
        let blur = Blur { kernel, radius, ..Blur::default() };
        let mut tape = Tape::new();
        assert_steady_from_step_3(|| {
            let sum = {
                let (image, sigma) = (tape.leaf_copied(&image), tape.leaf_scalar(sigma));
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

/// Bent sheets of faces, a first one that hides the others, as a picture that is fitted.
struct Sheets {
    mesh: Mesh,
    vertices: Tensor<f32>,
    reference: PixelLoss<f32>,
    options: RasterOptions,
    /// Whether colours are known, and only the shape is learnt.
    has_fixed_colors: bool,
}

/// What a step collects, and what shows that it did its work.
struct Found {
    bands: usize,
    /// Faces that are seen in a band, over all bands.
    slots: usize,
    /// Pairs of neighbouring pixels of which one is covered.
    pairs: usize,
    /// The squared error.
    loss: f32,
}

impl Sheets {
    /// A sheet of `side` x `side` quads and `hidden` ones of 20 x 20 behind it, in an image of
    /// `pixels` x `pixels`.
    fn new(side: usize, hidden: usize, pixels: usize) -> Self {
        let (mut corners, mut faces) = (Vec::new(), Vec::new());
        for sheet in 0..=hidden {
            let (side, scale, behind) =
                if sheet == 0 { (side, 1.3, 0.0) } else { (20, 1.0, 0.1 + 0.001 * sheet as f32) };
            let first = corners.len() as u32 / 3;
            for k in 0..(side + 1) * (side + 1) {
                let [column, row] = [k % (side + 1), k / (side + 1)];
                let [x, y] = [column, row].map(|at| scale * (at as f32 / side as f32 - 0.5));
                corners.extend([x, y, -3.0 - behind - 0.2 * x * y]);
                if column < side && row < side {
                    let [above, below] = [k, k + side + 1].map(|corner| first + corner as u32);
                    faces.extend([[above, above + 1, below + 1], [above, below + 1, below]]);
                }
            }
        }
        let count = corners.len() / 3;
        let mesh = Mesh::new(faces, count).unwrap();
        mesh.adjacency();
        let image = Tensor::from_flat_fn([pixels, pixels, 3], |k| (k % 5) as f32 * 0.2);
        Self {
            mesh,
            vertices: Tensor::new([count, 3], corners).unwrap(),
            reference: PixelLoss::squared(&image, &Tensor::zeros([3])).unwrap(),
            options: Size::square(pixels).into(),
            has_fixed_colors: false,
        }
    }

    /// The same with exact coverage.
    fn exactly(self) -> Self {
        let options = self.options.sampling(Sampling::Exact);
        Self { options, ..self }
    }

    fn step(&self, tape: &mut Tape<f32>) -> Result<Found, FitError> {
        let found = self.record(tape)?;
        tape.reset();
        Ok(found)
    }

    fn record(&self, tape: &Tape<f32>) -> Result<Found, FitError> {
        let vertices = tape.leaf_copied(&self.vertices);
        let clip = project(vertices, &perspective(0.7, 1.0, 1.0, 50.0), None)?;
        let fragments = rasterize(clip, &self.mesh, self.options.creases(&[]))?;
        let colors = if self.has_fixed_colors { tape.constant(&self.vertices) } else { vertices };
        let surface = interpolate(colors, &fragments)?;
        let picture = fragments.picture(surface, Background::Zero)?;
        let loss = picture.loss(&self.reference)?;
        let gradients = loss.backward()?;
        assert!(gradients.get(vertices).is_some());
        Ok(self.found(&fragments.coverage, loss.item()))
    }

    fn found(&self, coverage: &Coverage, loss: f32) -> Found {
        let Size { width, height } = self.options.size;
        // Whole rows, of 2^14 pixels or a little more.
        let bands = height.div_ceil((1_usize << 14).div_ceil(width));
        // A face can be the last one of a band and the first one of the next.
        let next = coverage.faces().skip(1);
        let changes = coverage.faces().zip(next).filter(|(face, next)| face != next).count();
        let is_seen = |pixel: usize| coverage.fragment_at(pixel).is_some();
        let [across, down] = [1, width].map(|step| {
            let places = (0..width * height - step).filter(|k| step > 1 || (k + 1) % width > 0);
            places.filter(|&k| is_seen(k) != is_seen(k + step)).count()
        });
        Found { bands, slots: changes + bands, pairs: across + down, loss }
    }

    /// What all threads of a pool allocate while it takes `count` steps, from the start of the
    /// threads to their end: how often, and how many bytes; and what the last step found.
    fn allocated(&self, threads: usize, count: usize) -> ([u64; 2], Found) {
        let total = Mutex::new([0, 0]);
        let found = thread::scope(|scope| {
            let spawn = |worker: ThreadBuilder| {
                scope.spawn(|| {
                    let counted = measure(|| worker.run());
                    let mut total = total.lock().unwrap();
                    *total = [total[0] + counted.count_total, total[1] + counted.bytes_total];
                });
                Ok(())
            };
            let pool = ThreadPoolBuilder::new().num_threads(threads).spawn_handler(spawn);
            pool.build().unwrap().install(|| {
                let mut tape = Tape::new();
                (0..count).map(|_| self.step(&mut tape).unwrap()).last().unwrap()
            })
        });
        (total.into_inner().unwrap(), found)
    }
}

#[test]
fn a_steady_step_of_one_band_with_exact_coverage_allocates_nothing_on_several_threads() {
    let sheets = Sheets::new(6, 1, 48).exactly();
    // What the background costs is summed once.
    sheets.step(&mut Tape::new()).unwrap();
    for threads in [2, 4] {
        let (before, Found { bands, .. }) = sheets.allocated(threads, 4);
        let (after, _) = sheets.allocated(threads, 20);
        assert_eq!((bands, after), (1, before), "{threads} threads");
    }
}

#[test]
fn a_steady_step_of_a_picture_allocates_nothing() {
    // One band and several, few faces and many, and many that are hidden.
    for (side, hidden, pixels) in [(2, 0, 48), (40, 0, 300), (2, 250, 200)] {
        let (mut tape, sheets) = (Tape::new(), Sheets::new(side, hidden, pixels));
        assert_steady_from_step_3(|| {
            let Found { slots, pairs, loss, .. } = sheets.step(&mut tape).unwrap();
            assert!(slots > 0 && pairs > 0);
            loss
        });
    }
}

// Antialiasing takes over the gradient of its picture, and has no use for it.
#[test]
fn a_steady_step_of_a_shape_with_fixed_colors_allocates_nothing() {
    let sheets = Sheets { has_fixed_colors: true, ..Sheets::new(2, 0, 300) };
    let mut tape = Tape::new();
    assert_steady_from_step_3(|| sheets.step(&mut tape).unwrap().loss);
}

#[test]
fn steady_steps_on_several_threads_keep_their_lists() {
    // Few faces on many pixels, many faces, and many that are hidden.
    for (side, hidden, pixels) in [(2, 0, 48), (2, 0, 512), (40, 0, 300), (2, 250, 200)] {
        let sheets = Sheets::new(side, hidden, pixels);
        // What the background costs is summed once.
        sheets.step(&mut Tape::new()).unwrap();
        for threads in [2, 4] {
            // Many: where cores are taken away from threads, their lists reach their lengths late.
            let (start, steps) = (8, 128);
            let per_step = || {
                let (before, _) = sheets.allocated(threads, start);
                let (after, found) = sheets.allocated(threads, start + steps);
                ([0, 1].map(|k| (after[k] as f64 - before[k] as f64) / steps as f64), found)
            };
            let ([count, bytes], Found { bands, slots, .. }) = per_step();
            if bands == 1 {
                assert!(count <= 0.0 && bytes <= 0.0, "{count} allocations of {bytes} bytes");
                continue;
            }
            // In a backward pass three rows of four and of three numbers for each face, which are kept. Now and then many
            // results wait. A thread that first takes part late has its memory late: then steps are taken again.
            let rows = (3 * (4 + 3) * 4 * slots) as f64;
            let bounds = [4.0, 32768.0 + rows / 8.0];
            let is_steady = |[count, bytes]: [f64; 2]| count <= bounds[0] && bytes <= bounds[1];
            let mut found = vec![[count, bytes]];
            while !found.last().copied().is_some_and(is_steady) {
                assert!(
                    found.len() < 3,
                    "allocations and bytes of a step {found:?}, not {bounds:?}"
                );
                found.push(per_step().0);
            }
        }
    }
}
