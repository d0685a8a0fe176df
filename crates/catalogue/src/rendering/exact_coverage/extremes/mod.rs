//! Scenes with exact coverage: against a sweep (`areas`), by hand, or by what is alike.

pub(crate) mod borders;
pub(crate) mod depths;
pub(crate) mod inputs;
pub(crate) mod shapes;

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    Background, Coverage, Fragments, Mesh, RasterOptions, Sampling, Size, composite, interpolate,
    rasterize,
};

use crate::areas::visible_areas;
use crate::clip_scene::{BACKGROUND, ClipScene};
use crate::extreme::{Failure, Verdict};
use crate::measures::{difference, largest, motley, numbers, rounding};

const SIZE: Size = Size { width: 7, height: 6 };

fn options(size: Size) -> RasterOptions {
    RasterOptions::new(size).sampling(Sampling::Exact)
}

/// How much of each pixel each face covers, from fragments and weights: `[H W, F]`.
fn areas<T: Scalar>(fragments: &Fragments<'_, T>) -> Vec<f64> {
    let coverage = &fragments.coverage;
    let weights = fragments.weight.map_or_else(Vec::new, |weight| numbers(&weight.value()));
    let count = coverage.mesh().faces().len();
    let mut areas = vec![0.0; coverage.size().pixels() * count];
    for (n, (pixel, face)) in coverage.pixels().zip(coverage.faces()).enumerate() {
        areas[pixel * count + face] +=
            n.checked_sub(coverage.centers()).map_or(1.0, |piece| weights[piece]);
    }
    areas
}

/// A picture with exact coverage, and the gradients of `sum u . image`.
#[derive(Debug, PartialEq)]
struct Picture {
    areas: Vec<f64>,
    image: Vec<f64>,
    clip_bar: Vec<f64>,
    color_bar: Vec<f64>,
    background_bar: Vec<f64>,
    /// How far areas and background are from a partition of the pixels.
    parts: f64,
    sampled: f64,
    /// How many faces were not drawn.
    culled: usize,
    /// Numbers that are not finite.
    wrong: usize,
}

impl Picture {
    fn new<T: Scalar>(scene: &ClipScene) -> Result<Self, Failure> {
        Self::with::<T>(scene, scene.mesh()?, options(scene.size), |k| motley(3 * k + 1))
    }

    fn with<T: Scalar>(
        scene: &ClipScene,
        mesh: Mesh,
        options: RasterOptions,
        upstream: impl Fn(usize) -> f64,
    ) -> Result<Self, Failure> {
        let tape = Tape::<T>::new();
        let clip = scene.leaf(&tape);
        let number = |k: usize| T::from_f64(motley(k));
        // The last channel is 1 on all faces and 0 behind them: the share that they cover.
        let color = |k: usize| if k % 3 == 2 { T::ONE } else { number(k) };
        let colors = tape.leaf(&Tensor::from_flat_fn([scene.clip.len(), 3], color));
        let behind = [BACKGROUND[0], BACKGROUND[1], 0.0];
        let behind = tape.leaf(&Tensor::from_flat_fn([3], |k| T::from_f64(behind[k])));
        let fragments = rasterize(clip, &mesh, options.creases(&[]))?;
        let surface = interpolate(colors, &fragments)?;
        let background = Background::Color(behind);
        let image = composite(surface, &fragments, background)?.image()?;
        let upstream = Tensor::from_flat_fn(image.shape(), |k| T::from_f64(upstream(k)));
        let gradients = tape.vjp(&[(image, &upstream)])?;
        let gradient = |leaf| numbers(&gradients.get_or_zeros(leaf));

        let (areas, faces) = (areas(&fragments), mesh.faces().len());
        let pixels = numbers(&image.value());
        let mut parts = 0.0_f64;
        for (pixel, values) in pixels.chunks_exact(3).enumerate() {
            let own = &areas[pixel * faces..][..faces];
            let covered: f64 = own.iter().sum();
            parts = parts.maximum_or_nan((covered - values[2]).abs()).maximum_or_nan(covered - 1.0);
            parts = own.iter().fold(parts, |parts, &area| parts.maximum_or_nan(-area));
        }
        let [clip_bar, color_bar, background_bar] = [clip, colors, behind].map(gradient);
        let all = [&pixels, &clip_bar, &color_bar, &background_bar];
        let wrong = all.iter().flat_map(|all| all.iter()).filter(|entry| !entry.is_finite());
        let coverage: &Coverage = &fragments.coverage;
        let culled = coverage.culled();
        Ok(Self {
            parts,
            sampled: coverage.boundary_counts().sampled,
            culled: culled.degenerate + culled.outside + culled.facing,
            wrong: wrong.count(),
            areas,
            image: pixels,
            clip_bar,
            color_bar,
            background_bar,
        })
    }

    /// The share of each pixel that some face covers.
    fn covered(&self) -> Vec<f64> {
        self.image.iter().skip(2).step_by(3).copied().collect()
    }
}

/// What may be missing to 1 in a pixel.
fn parts_bound<T: Scalar>() -> f64 {
    if rounding::<T>() > 1e-10 { 1e-6 } else { 1e-12 }
}

/// What is found of some scenes.
#[derive(Debug, Default)]
struct Checked {
    /// The largest difference of an area from that of the sweep.
    error: f64,
    /// The largest difference of a gradient of areas from the sweep's difference quotient, as a share
    /// of the scene's largest one.
    slope: f64,
    parts: f64,
    wrong: usize,
    sampled: f64,
    /// Pixels that are neither empty nor full.
    partial: usize,
}

impl Checked {
    /// Takes in a scene, whose gradients are those of difference quotients if it is `smooth`.
    fn add<T: Scalar>(&mut self, scene: &ClipScene, smooth: bool) -> Result<(), Failure> {
        let rounded = scene.clip.iter().map(|p| p.map(|c| T::from_f64(c).to_f64())).collect();
        let scene = ClipScene { clip: rounded, ..scene.clone() };
        let picture = Picture::new::<T>(&scene)?;
        let width = scene.size.width;
        let swept = |clip: &[[f64; 4]], pixel: usize| {
            visible_areas(clip, &scene.faces, scene.size, [pixel % width, pixel / width])
        };
        let faces = scene.faces.len();
        let mut boundary = Vec::new();
        for (pixel, found) in picture.areas.chunks_exact(faces).enumerate() {
            let expected = swept(&scene.clip, pixel);
            self.error = self.error.maximum_or_nan(difference(found, &expected));
            if expected.iter().any(|&area| 0.0 < area && area < 1.0) {
                boundary.push(pixel);
            }
        }
        self.partial += boundary.len();
        self.parts = self.parts.maximum_or_nan(picture.parts);
        self.wrong += picture.wrong;
        self.sampled += picture.sampled;
        if !smooth {
            return Ok(());
        }
        let found = area_gradient::<T>(&scene)?;
        let most = largest(found.iter().copied()).maximum_or_nan(1e-3);
        for (k, found) in found.into_iter().enumerate() {
            let step = 1e-6 * (1.0 + scene.clip[k / 4][k % 4].abs());
            let loss = |sign: f64| -> f64 {
                let mut clip = scene.clip.clone();
                clip[k / 4][k % 4] += sign * step;
                let areas = boundary.iter().map(|&pixel| (pixel, swept(&clip, pixel)));
                let terms = areas.flat_map(|(pixel, areas)| {
                    let terms = areas.into_iter().enumerate();
                    terms.map(move |(face, area)| motley(pixel * faces + face) * area)
                });
                terms.sum()
            };
            let quotient = (loss(1.0) - loss(-1.0)) / (2.0 * step);
            self.slope = self.slope.maximum_or_nan((found - quotient).abs() / most);
        }
        Ok(())
    }

    /// Areas within `bound`, or the rounding of `T` where that is more.
    fn verdict<T: Scalar>(self, outcome: &str, bound: f64) -> Verdict {
        let Self { error, slope, parts, wrong, sampled, partial } = self;
        let outcome = format!("{partial} boundary pixels, {outcome}");
        // Difference quotients are off by 1e-6 where an area's second derivative leaps.
        let steep = 64.0 * rounding::<T>() + 1e-5;
        Verdict::within(outcome, error, bound.max(2.0 * rounding::<T>()))
            .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
            .and(slope <= steep, format!("a gradient is off by {slope:.1e} of the largest"))
            .and(wrong == 0, format!("{wrong} numbers are not finite"))
            .and(sampled == 0.0, format!("{sampled:e} of a pixel is sampled"))
            .and(partial > 0, "no pixel is covered in part")
    }
}

/// The gradient of motley sums of areas with respect to the clip positions.
fn area_gradient<T: Scalar>(scene: &ClipScene) -> Result<Vec<f64>, Failure> {
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let fragments = rasterize(clip, &scene.mesh()?, options(scene.size).creases(&[]))?;
    let weight = fragments.weight.ok_or("exact coverage has weights")?;
    let coverage = &fragments.coverage;
    let places: Vec<_> = coverage.pixels().zip(coverage.faces()).skip(coverage.centers()).collect();
    let count = scene.faces.len();
    let entry = |k: usize| T::from_f64(motley(places[k].0 * count + places[k].1));
    let upstream = Tensor::from_flat_fn(weight.shape(), entry);
    Ok(numbers(&tape.vjp(&[(weight, &upstream)])?.get_or_zeros(clip)))
}
