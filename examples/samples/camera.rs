//! Cameras from pictures of a known object: the intrinsics and the distortion that twelve cameras share, and
//! the pose of each, from noisy starts. A pose is learnt as an increment in the tangent space of SE(3). The
//! pictures are blurred, less and less, so that starts that are some pixels off find their way. The object is
//! a crowd of balls: before a single ball, the principal point can hardly be told from the poses.

use bokashi::glam::DMat4;
use bokashi::prelude::*;
use bokashi_examples::stage::{Random, Shape, cluster, learn, motley, root_mean_square};
use bokashi_examples::{Goal, Outcome, Request};

bokashi_examples::sample!("camera", "calibrates twelve cameras by pictures of a known object");

const SIDE: usize = 256;
const CAMERAS: usize = 12;
const INTRINSICS: [f32; 4] = [170.0, 166.0, 129.0, 126.0];
const DISTORTION: [f32; 5] = [-0.12, 0.05, -0.002, 0.003, -0.01];

struct Scene {
    balls: Shape,
    colors: Tensor<f32>,
    silhouettes: Silhouettes,
}

/// The increments of all poses `[12, 6]` and where they start, intrinsics and distortion.
struct Cameras<'a, 't>(&'a [DMat4], [Var<'t, f32>; 3]);

impl Scene {
    /// The object before camera k: its faces are small enough for bent edges.
    fn clip<'t>(&self, cameras: &Cameras<'_, 't>, k: usize) -> Result<Var<'t, f32>, FitError> {
        let Cameras(starts, [increments, intrinsics, distortion]) = *cameras;
        let view = se3(increments.slice(0, k..k + 1)?.reshape([6])?, &starts[k])?;
        let points = transform_points(view.tape().constant(&self.balls.vertices), view)?;
        let camera = pinhole(intrinsics, Size::square(SIDE), 0.1, 100.0)?;
        Ok(project(distort(points, distortion)?, camera, None)?)
    }

    fn image<'t>(&self, cameras: &Cameras<'_, 't>, k: usize) -> Result<Var<'t, f32>, FitError> {
        let clip = self.clip(cameras, k)?;
        let options = RasterOptions::new(Size::square(SIDE)).cull(Cull::Back);
        let (options, colors) =
            (options.silhouettes(self.silhouettes), clip.tape().constant(&self.colors));
        Ok(render(clip, &self.balls.mesh, colors, options, Background::Zero)?.image()?)
    }

    /// The vertices in pixels, before all cameras.
    fn pixels(&self, cameras: &Cameras<'_, '_>) -> Result<Vec<f32>, FitError> {
        let mut all = Vec::new();
        for k in 0..CAMERAS {
            let clip = self.clip(cameras, k)?.value();
            let pixels = clip.data().chunks(4).flat_map(|p| [p[0] / p[3], p[1] / p[3]]);
            all.extend(pixels.map(|x| 0.5 * SIDE as f32 * x));
        }
        Ok(all)
    }
}

fn run(request: &Request) -> Result<Vec<Outcome>, FitError> {
    let mut random = Random::new(request.seed, 0);
    let balls = cluster(40, &mut random)?;
    let colors = motley(&balls.vertices, &mut random);
    let scene = Scene { balls, colors, silhouettes: request.silhouettes };
    let truth: Vec<_> = (0..CAMERAS).map(|_| random.view(2.6, 0.1)).collect();
    let starts: Vec<_> = truth.iter().map(|view| random.nearby(0.03, 0.02) * *view).collect();
    let tape = Tape::new();
    let zeros = tape.constant(&Tensor::zeros([CAMERAS, 6]));
    let [intrinsics, distortion] =
        [&INTRINSICS[..], &DISTORTION].map(|numbers| tape.constant(&Tensor::from(numbers)));
    let known = Cameras(&truth, [zeros, intrinsics, distortion]);
    let images = (0..CAMERAS).map(|k| Ok(scene.image(&known, k)?.value()));
    let (targets, places) = (images.collect::<Result<Vec<_>, FitError>>()?, scene.pixels(&known)?);

    let noisy = Tensor::from(INTRINSICS).map(|x| x * (1.0 + 0.02 * random.normal() as f32));
    let parameters = Parameters::new()
        .with(Parameter::new("increments", Tensor::zeros([CAMERAS, 6])).rate(3e-3))?
        .with(Parameter::new("intrinsics", noisy).rate(1.0))?
        .with(Parameter::new("distortion", Tensor::zeros([5])).rate(5e-3))?;
    let steps = request.steps(1000);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut pipeline = views(CAMERAS, |view, tape: &Tape<f32>, variables| {
        let learnt = Cameras(&starts, [variables[0], variables[1], variables[2]]);
        // 6 pixels at first, and none in the last three quarters.
        let sigma = 6.0 * (1.0 - 4.0 * view.step as f64 / steps as f64).max(0.0);
        let sigma = tape.constant_scalar(sigma as f32);
        let blur = |image| gaussian_blur(image, sigma, &Blur::default());
        let target = blur(tape.constant(&targets[view.index]))?;
        Ok(mean_squared_error(blur(scene.image(&learnt, view.index)?)?, target)?)
    });
    let error = |learnt: &Parameters<f32>| {
        let tape = Tape::new();
        let list = learnt.record(&tape);
        let pixels = scene.pixels(&Cameras(&starts, [list[0], list[1], list[2]]))?;
        // Of a distance, not of one of its two parts.
        Ok([2_f64.sqrt() * root_mean_square(&pixels, &places)])
    };
    let (_, [curve]) = learn(parameters, settings, &mut pipeline, 20, error)?;
    let outcome = Outcome::last("reprojection error, in pixels", Goal::Below(0.05), steps, curve);
    Ok(vec![outcome.picture("first camera", &targets[0]).picture("second camera", &targets[1])])
}
