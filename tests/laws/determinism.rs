//! The same bits for any number of threads, and on recycled memory, through the whole pipeline.

use bokashi_catalogue::setting::sphere;
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Mesh, PixelLoss, Pose, RasterOptions, RenderError, Sampling, Size, antialias,
    composite, depth, gaussian_blur, interpolate, project, rasterize,
};
use glam::dcamera::rh::proj::opengl::perspective;
use rayon::ThreadPoolBuilder;

/// A sphere of `4 stacks (stacks - 1)` faces, its vertices off the sphere by a bit.
struct Sphere {
    mesh: Mesh,
    positions: Vec<f64>,
    size: Size,
}

impl Sphere {
    fn new(stacks: usize, size: Size) -> Self {
        let (faces, positions) = sphere(1.0, 2 * stacks, stacks);
        let mesh = Mesh::new(faces, positions.shape()[0]).unwrap();
        let radius = |k: usize| 1.0 + 0.002 * ((k / 3 * 7919) % 101) as f64 / 101.0;
        let positions = (0..).zip(positions.data()).map(|(k, x)| radius(k) * x).collect();
        Self { mesh, positions, size }
    }

    /// The image, a picture of the same surface before black, and every gradient of a loss of both,
    /// on `tape`.
    fn step<T: Scalar>(&self, tape: &Tape<T>) -> Result<Vec<Tensor<T>>, RenderError> {
        let vertices = self.mesh.vertex_count();
        let leaf = |shape: &[usize], entry: &dyn Fn(usize) -> f64| {
            tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(entry(k))))
        };
        let positions = leaf(&[vertices, 3], &|k| self.positions[k]);
        let colors = leaf(&[vertices, 3], &|k| ((k * 31) % 97) as f64 / 97.0);
        let rotation = leaf(&[4], &|k| [0.1, 0.7, -0.5, 0.3][k]);
        let translation = leaf(&[3], &|k| [0.1, -0.1, -2.6][k]);
        let Size { width, height } = self.size;
        let background = leaf(&[height, width, 3], &|k| ((k * 17) % 89) as f64 / 89.0);
        let sigma = tape.leaf_scalar(T::from_f64(1.3));

        let camera = perspective(0.9, width as f64 / height as f64, 0.1, 10.0);
        let clip = project(positions, &camera, Some(Pose { rotation, translation }))?;
        let fragments = rasterize(clip, &self.mesh, self.size)?;
        let surface = interpolate(colors, &fragments)?;
        let picture = antialias(composite(surface, &fragments, Background::Image(background))?)?;
        let smooth = picture.image()?;
        let blurred = gaussian_blur(smooth, sigma, &Blur::default())?;
        let options = RasterOptions::new(self.size).sampling(Sampling::Exact);
        let exact = rasterize(clip, &self.mesh, options.creases(&[]))?;
        let counts = exact.coverage.boundary_counts();
        assert!(counts.pixels > 0 && counts.pieces > counts.pixels, "{counts:?}");
        let exact_surface = interpolate(colors, &exact)?;
        let exact_image =
            composite(exact_surface, &exact, Background::Image(background))?.image()?;
        let exact_loss = exact_image.square().sum() + depth(&exact)?.square().sum();
        let dark = antialias(composite(surface, &fragments, Background::Zero)?)?;
        assert!(dark.values().shape()[0] > fragments.coverage.count(), "some pixels are blended");
        // Several, for a sum in another order may be the same.
        let errors = (0..8).map(|k| {
            let goal = |at: usize| T::from_f64(((at + k) * 7919 % 83) as f64 / 83.0);
            let goal = Tensor::from_flat_fn([height, width, 3], goal);
            let error = dark.loss(&PixelLoss::squared(&goal, &Tensor::zeros([3]))?)?;
            Ok(error.reshape([1])?)
        });
        let errors = Var::concat(&errors.collect::<Result<Vec<_>, RenderError>>()?, 0)?;
        let loss = blurred.square().sum() + errors.sum() + depth(&fragments)?.square().sum();
        let loss = loss + exact_loss;
        let gradients = loss.backward()?;
        let leaves = [positions, colors, rotation, translation, background, sigma];
        let mut results: Vec<_> =
            leaves.iter().map(|&leaf| gradients.get(leaf).unwrap().clone()).collect();
        let exact_weight = exact.weight.expect("exact coverage has weights");
        let values = [fragments.barycentrics, smooth, blurred, dark.values(), errors, loss];
        let values = values.into_iter().chain([exact.barycentrics, exact_weight, exact_image]);
        results.extend(values.map(|var| var.value()));
        let ids = fragments.coverage.triangle_ids();
        results.push(Tensor::from_flat_fn([height, width], |k| T::from_f64(ids[k].into())));
        assert!(results.iter().all(Tensor::is_finite));
        assert!(fragments.coverage.count() * 4 > self.size.pixels(), "there is much to see");
        Ok(results)
    }
}

fn assert_the_same_for_any_number_of_threads<T: Scalar>() {
    // About 20 000 faces; several pieces of work in every operation, of several rows and parts of
    // rows.
    let sphere = Sphere::new(72, Size { width: 500, height: 300 });
    assert!(sphere.mesh.faces().len() > 20_000);
    let with = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| sphere.step::<T>(&Tape::new()).unwrap())
    };
    let alone = with(1);
    for threads in [2, 4, 8] {
        let together = with(threads);
        for (k, (one, other)) in alone.iter().zip(&together).enumerate() {
            assert!(one == other, "result {k} differs on {threads} threads");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits_in_f64() {
    assert_the_same_for_any_number_of_threads::<f64>();
}

#[test]
fn any_number_of_threads_gives_the_same_bits_in_f32() {
    assert_the_same_for_any_number_of_threads::<f32>();
}

fn assert_the_same_on_recycled_memory<T: Scalar>() {
    let scenes = [
        Sphere::new(12, Size { width: 61, height: 40 }),
        Sphere::new(7, Size { width: 33, height: 150 }),
        Sphere::new(30, Size { width: 200, height: 190 }),
        // More faces than one piece of the search for silhouettes holds.
        Sphere::new(72, Size { width: 500, height: 300 }),
    ];
    let fresh: Vec<_> = scenes.iter().map(|scene| scene.step::<T>(&Tape::new()).unwrap()).collect();
    let mut tape = Tape::<T>::new();
    let pools = [1, 2, 4].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build());
    for (turn, k) in [0, 0, 1, 3, 2, 1, 0, 2, 2, 3, 3, 0, 1].into_iter().enumerate() {
        let pool = pools[turn % 3].as_ref().unwrap();
        let (tape, scenes, fresh) = (&mut tape, &scenes, &fresh);
        pool.install(move || {
            assert!(scenes[k].step(tape).unwrap() == fresh[k], "scene {k}");
            tape.reset();
        });
    }
}

#[test]
fn recycled_memory_gives_the_same_bits_as_fresh_memory() {
    assert_the_same_on_recycled_memory::<f64>();
    assert_the_same_on_recycled_memory::<f32>();
}

#[test]
fn a_step_that_failed_leaves_no_trace_in_the_next_one() {
    let scene = Sphere::new(9, Size { width: 40, height: 30 });
    let fresh = scene.step::<f32>(&Tape::new()).unwrap();
    let mut bad = Sphere::new(9, Size { width: 50, height: 20 });
    bad.positions[10] = f64::NAN;
    let mut tape = Tape::<f32>::new();
    for _ in 0..3 {
        let error = bad.step(&tape).unwrap_err();
        assert!(matches!(error, RenderError::Position { vertex: 3, .. }), "{error}");
        tape.reset();
        assert!(scene.step(&tape).unwrap() == fresh);
        tape.reset();
    }
}

#[test]
fn a_second_backward_pass_gives_the_same_bits() {
    let sphere = Sphere::new(20, Size { width: 150, height: 130 });
    let tape = Tape::<f64>::new();
    let vertices = sphere.mesh.vertex_count();
    let clip = Tensor::from_flat_fn([vertices, 4], |k| match k % 4 {
        3 => 1.0,
        axis => 0.7 * sphere.positions[k / 4 * 3 + axis],
    });
    let clip = tape.leaf(&clip);
    let colors = tape.leaf(&Tensor::from_flat_fn([vertices, 2], |k| (k % 13) as f64));
    let sigma = tape.leaf_scalar(2.0);
    let fragments = rasterize(clip, &sphere.mesh, sphere.size).unwrap();
    let surface = interpolate(colors, &fragments).unwrap();
    let picture = antialias(composite(surface, &fragments, Background::Zero).unwrap()).unwrap();
    let image = picture.image().unwrap();
    let loss = gaussian_blur(image, sigma, &Blur::default()).unwrap().square().sum();
    let pass = || {
        let gradients = loss.backward().unwrap();
        [clip, colors, sigma].map(|leaf| gradients.get(leaf).unwrap().clone())
    };
    assert!(pass() == pass());
}
