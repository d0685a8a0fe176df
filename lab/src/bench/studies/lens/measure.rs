//! How far what is drawn, and its gradient, lie from what points of the lens see.

use bokashi_catalogue::lens::{
    Frame, LensScene, draw_samples, gather, mean_through, pinhole, point, through,
};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::ssim;
use bokashi_render_ops::{RenderError, ThinLens};

/// By how much the truth is moved for its differences.
const MOVED: f64 = 1.03;
/// The same of what is drawn, whose rounding is small.
const NUDGED: f64 = 1.0 + 1e-4;
/// How spirals of points are turned against each other: of two, what is noise differs.
const TURNS: [f64; 2] = [0.0, 2.0];

/// How the spiral of views is turned: like none of the truth's.
const TURN: f64 = 1.0;

/// What draws what a lens sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// A pinhole.
    Pinhole,
    /// `lens_picture`, with so many samples along each side of a pixel.
    Picture(usize),
    /// `depth_of_field`.
    Gather,
    /// The mean through so many points of the lens.
    Views(usize),
}

impl Way {
    /// Its image in a picture of `pixels`; `numbers` are the aperture of a picture of [`UNIT`] pixels, and the
    /// focus.
    pub(super) fn image<T: Scalar>(
        self,
        scene: &LensScene,
        pixels: usize,
        numbers: [f64; 2],
    ) -> Result<Tensor<T>, RenderError> {
        let frame = Frame::new(pixels);
        let numbers = [numbers[0] * frame.scale(), numbers[1]];
        if let Self::Views(count) = self {
            return mean_through(scene, frame.without_margin(), numbers, count, TURN);
        }
        let tape = Tape::<T>::new();
        let [aperture, focus] = numbers.map(|number| tape.constant_scalar(T::from_f64(number)));
        Ok(self.drawn(scene, frame, ThinLens { aperture, focus }, 0)?.value())
    }

    /// What it records of an image: all of it, or a view.
    pub(super) fn drawn<'t, T: Scalar>(
        self,
        scene: &LensScene,
        frame: Frame,
        lens: ThinLens<'t, T>,
        view: usize,
    ) -> Result<Var<'t, T>, RenderError> {
        let tape = lens.focus.tape();
        let inner = frame.without_margin();
        let clip = |frame: Frame| tape.constant(&scene.clip(frame));
        match self {
            Self::Pinhole => pinhole(scene, inner, clip(inner)),
            Self::Picture(samples) => draw_samples(scene, frame, clip(frame), lens, samples),
            Self::Gather => gather(scene, frame, clip(frame), lens),
            Self::Views(count) => {
                through(scene, inner, clip(inner), lens, point(view, count, TURN))
            }
        }
    }
}

/// The mean through the points of two spirals.
#[derive(Debug, Clone)]
pub(super) struct Truth {
    pub(super) image: Tensor<f64>,
    /// The root mean square of its own noise, in percent of full intensity.
    pub(super) noise: f64,
    /// How each spiral's mean moves with the aperture and with the focus, per unit of each.
    pub(super) moves: [[Tensor<f64>; 2]; 2],
}

fn zip(a: &Tensor<f64>, b: &Tensor<f64>, f: impl Fn(f64, f64) -> f64) -> Tensor<f64> {
    Tensor::from_flat_fn(a.shape().clone(), |k| f(a.data()[k], b.data()[k]))
}

fn dot(a: &Tensor<f64>, b: &Tensor<f64>) -> f64 {
    a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
}

/// The root mean square of a difference, in percent of full intensity.
fn percent_off(a: &Tensor<f64>, b: &Tensor<f64>) -> f64 {
    let difference = zip(a, b, |a, b| a - b);
    100.0 * (dot(&difference, &difference) / difference.data().len() as f64).sqrt()
}

impl Truth {
    /// With `points` on each spiral, and `moved` for the differences.
    pub(super) fn new(
        scene: &LensScene,
        pixels: usize,
        numbers: [f64; 2],
        [points, moved]: [usize; 2],
    ) -> Result<Self, RenderError> {
        let frame = Frame::new(pixels).without_margin();
        let mean = |numbers: [f64; 2], count: usize, turn: f64| {
            mean_through(scene, frame, [numbers[0] * frame.scale(), numbers[1]], count, turn)
        };
        let [a, b] = TURNS.map(|turn| mean(numbers, points, turn));
        let (a, b) = (a?, b?);
        let by = |turn: f64, k: usize| -> Result<_, RenderError> {
            let [mut before, mut after] = [numbers; 2];
            before[k] /= MOVED;
            after[k] *= MOVED;
            let step = after[k] - before[k];
            let [before, after] = [before, after].map(|numbers| mean(numbers, moved, turn));
            Ok(zip(&after?, &before?, |after, before| (after - before) / step))
        };
        let moves = TURNS.map(|turn| Ok::<_, RenderError>([by(turn, 0)?, by(turn, 1)?]));
        let [first, second] = moves;
        let image = zip(&a, &b, |a, b| 0.5 * (a + b));
        Ok(Self { image, noise: 0.5 * percent_off(&a, &b), moves: [first?, second?] })
    }
}

/// A gradient of a picture against the truth's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slope {
    /// Its projection on the truth's, as a share of that.
    pub(super) size: f64,
    /// The norm of its error, as a share of the truth's.
    pub(super) off: f64,
}

/// How far off a way to draw is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// The root mean square, in percent of full intensity.
    pub(super) rms: f64,
    pub(super) ssim: f64,
    /// By the aperture and by the focus.
    pub(super) slopes: [Slope; 2],
}

/// How far `way` is off from `truth`.
pub(super) fn measure(
    way: Way,
    scene: &LensScene,
    pixels: usize,
    numbers: [f64; 2],
    truth: &Truth,
) -> Result<Measured, RenderError> {
    let image = way.image(scene, pixels, numbers)?;
    let slope = |k: usize| -> Result<Slope, RenderError> {
        let [mut before, mut after] = [numbers; 2];
        before[k] /= NUDGED;
        after[k] *= NUDGED;
        let step = after[k] - before[k];
        let [before, after] = [before, after].map(|numbers| way.image(scene, pixels, numbers));
        let found = zip(&after?, &before?, |after, before: f64| (after - before) / step);
        let [a, b] = [0, 1].map(|turn| &truth.moves[turn][k]);
        // Noise of the two is independent: it drops out of products of both.
        let square = dot(a, b);
        let [from_a, from_b] = [a, b].map(|moves| zip(&found, moves, |x, y| x - y));
        let size = 0.5 * (dot(&found, a) + dot(&found, b)) / square;
        Ok(Slope { size, off: (dot(&from_a, &from_b).max(0.0) / square).sqrt() })
    };
    let rms = percent_off(&image, &truth.image);
    let slopes = [slope(0)?, slope(1)?];
    Ok(Measured { rms, ssim: ssim(&image, &truth.image, 1.0)?, slopes })
}
