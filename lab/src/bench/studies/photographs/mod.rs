//! How well is a pose found from a picture that is integrated over areas, as photographs are?
//!
//! The pose of a textured cube, from one picture of it. The picture comes from elsewhere (`photograph`), so
//! no way of drawing has made its own reference. All take the same starts, in turns, so that whatever else
//! the machine does falls on all alike.

mod object;
mod photograph;

use std::time::Instant;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::{Fit, FitError, FitSettings, Parameter, Parameters, Schedule, from_fn};
use bokashi_render_ops::{
    Background, Border, Cull, Detail, Filter, Picture, PixelLoss, RasterOptions, Sampler,
    Silhouettes, Size, Texture, TextureBorder, TextureFilter, downsample, interpolate_indexed,
    project, rasterize, sample_texture, se3,
};
use bokashi_report::{Cell, Figures, PALETTE, Section, Stroke, Table};
use glam::DMat4;

use self::object::{MOST_DEGREES, MOST_MOVED, Object, PoseError, camera, poses};
use self::photograph::photograph;
use crate::bench::descent::{COLUMNS, Descent, cells, panel};
use crate::bench::setting::Bench;

/// Along either side of the images, quick and full.
const PIXELS: [&[usize]; 2] = [&[16], &[32, 64, 128]];
/// A fit that ends farther off is stuck, in pixels.
const STUCK: f64 = 0.5;
/// Of radians and of sides, for each step of Adam; it falls to 0 along a cosine.
const RATE: f64 = 0.02;
/// As many pixels along a side make one.
const TIMES: usize = 4;

/// How silhouettes are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Antialias,
    Supersampled,
    Exact,
}

/// The place of each is its colour's.
const WAYS: [Way; 3] = [Way::Antialias, Way::Supersampled, Way::Exact];

impl Way {
    fn name(self) -> &'static str {
        match self {
            Self::Antialias => "antialias",
            Self::Supersampled => "antialias, 4x4",
            Self::Exact => "exact",
        }
    }
}

/// The cube in `pose: [4, 4]`, rasterized, textured, before black.
fn drawn<'t>(
    object: &Object,
    pose: Var<'t, f64>,
    size: Size,
    silhouettes: Silhouettes,
) -> Result<Picture<'t, f64>, FitError> {
    let tape = pose.tape();
    let camera = camera().transpose().to_cols_array();
    let to_clip = tape.constant(&Tensor::new([4, 4], camera.to_vec())?).matmul(pose)?;
    let clip = project(tape.constant(&object.positions), to_clip, None)?;
    let coordinates = tape.constant(&object.coordinates);
    let Object { mesh, indices, .. } = object;
    let options = RasterOptions::new(size).cull(Cull::Back).silhouettes(silhouettes);
    let fragments = rasterize(clip, mesh, options.creases(&[(coordinates, indices).into()]))?;
    let places = interpolate_indexed(coordinates, indices, &fragments)?;
    let texture = Texture::new(tape.constant(&object.texels))?;
    let sampler = Sampler::new().filter(TextureFilter::Bilinear).border(TextureBorder::Clamp);
    let surface = sample_texture(&texture, places, Detail::Finest, sampler)?;
    Ok(fragments.picture(surface, Background::Zero)?)
}

/// The squared error of the cube in `pose` against a photograph.
fn loss<'t>(
    way: Way,
    object: &Object,
    pose: Var<'t, f64>,
    reference: &PixelLoss<f64>,
) -> Result<Var<'t, f64>, FitError> {
    let [height, width] = [0, 1].map(|axis| reference.reference().shape()[axis]);
    let size = Size { width, height };
    Ok(match way {
        Way::Antialias => drawn(object, pose, size, Silhouettes::Antialias)?.loss(reference)?,
        Way::Exact => drawn(object, pose, size, Silhouettes::Exact)?.loss(reference)?,
        Way::Supersampled => {
            let large = Size { width: TIMES * width, height: TIMES * height };
            let large = drawn(object, pose, large, Silhouettes::Antialias)?.image()?;
            let image = downsample(large, TIMES, &Filter::Box, Border::Clamp)?;
            reference.evaluate(image)?
        }
    })
}

/// What is fitted to, and from where.
struct Case {
    reference: PixelLoss<f64>,
    start: DMat4,
    truth: DMat4,
}

/// What is kept of a fit.
#[derive(Debug, Clone, PartialEq)]
struct Run {
    /// How far vertices are off in the image, in pixels.
    descent: Descent,
    last: PoseError,
    pose: DMat4,
}

/// The pose that an increment has made of `start`.
fn moved(increment: &Tensor<f64>, start: &DMat4) -> Result<DMat4, FitError> {
    let pose = se3(Tape::new().constant(increment), start)?.value();
    let rows: &[f64; 16] = pose.data().try_into().expect("a matrix has 16 entries");
    Ok(DMat4::from_cols_array(rows).transpose())
}

/// Fits the pose. Errors are measured while the clock stands.
fn fit(way: Way, object: &Object, case: &Case, steps: u64) -> Result<Run, FitError> {
    let Case { reference, start, truth } = case;
    let [height, width] = [0, 1].map(|axis| reference.reference().shape()[axis]);
    let size = Size { width, height };
    let increment = Parameter::new("increment", Tensor::zeros([6])).rate(RATE);
    let schedule = Schedule::Cosine { steps, floor: 0.0 };
    let settings = FitSettings { steps, schedule, ..FitSettings::default() };
    let mut fit = Fit::<f64>::new(Parameters::new().with(increment)?, settings)?;
    let mut pipeline = from_fn(|_, variables| {
        loss(way, object, se3(variables.get("increment")?, start)?, reference)
    });
    let (mut seconds, mut history) = (0.0, vec![[0.0, PoseError::new(start, truth, size).pixels]]);
    for _ in 0..steps {
        let clock = Instant::now();
        fit.step(&mut pipeline)?;
        seconds += clock.elapsed().as_secs_f64();
        let pose = moved(&fit.parameters().value("increment")?, start)?;
        history.push([seconds, PoseError::new(&pose, truth, size).pixels]);
    }
    let pose = moved(&fit.parameters().value("increment")?, start)?;
    let last = PoseError::new(&pose, truth, size);
    Ok(Run { descent: Descent::new(&history, seconds), last, pose })
}

/// All that is known of a seed at one size.
struct Seed {
    /// One for each of [`WAYS`].
    runs: [Run; 3],
    /// How far apart two photographs' pixels are at most, one of half as many points.
    pixel_noise: f64,
    /// How far apart the fits with exact coverage to both of them end, in pixels.
    noise: f64,
}

fn seed(
    bench: &Bench,
    object: &Object,
    pixels: usize,
    steps: u64,
    seed: u64,
) -> Result<Seed, FitError> {
    let size = Size::square(pixels);
    let [truth, start] = poses(seed);
    let cells: usize = bench.effort.choose(8, 64);
    let case = |cells: [usize; 2], seed: u64| {
        let take = || photograph(object, &(camera() * truth), size, cells, seed);
        let reference = PixelLoss::squared(&bench.widest().install(take), &Tensor::zeros([3]))?;
        Ok::<_, FitError>(Case { reference, start, truth })
    };
    // Points of their own, so that the difference is that of two pictures that know nothing of each other.
    let (whole, half) = (case([cells; 2], 2 * seed)?, case([cells, cells / 2], 2 * seed + 1)?);
    let run = |way, case: &Case| bench.one().install(|| fit(way, object, case, steps));
    let runs = [run(WAYS[0], &whole)?, run(WAYS[1], &whole)?, run(WAYS[2], &whole)?];
    let other = run(Way::Exact, &half)?;
    let pairs = whole.reference.reference().data().iter().zip(half.reference.reference().data());
    Ok(Seed {
        noise: PoseError::new(&other.pose, &runs[2].pose, size).pixels,
        runs,
        pixel_noise: pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
    })
}

/// The rows of a size in both tables.
fn tabulate(pixels: usize, seeds: &[Seed], [ends, to_errors]: [&mut Table; 2]) {
    for (with, way) in WAYS.iter().enumerate() {
        let runs = || seeds.iter().map(move |seed| &seed.runs[with]);
        let head = [Cell::Count(pixels), Cell::text(way.name())];
        let mut row = head.to_vec();
        row.push(Cell::median(runs().map(|run| 1e3 * run.descent.step_seconds)));
        let errors: [fn(&Run) -> f64; 3] =
            [|run| run.last.pixels, |run| run.last.degrees, |run| run.last.translation];
        for error in errors {
            row.push(Cell::median(runs().map(error)));
            row.push(Cell::maybe(runs().map(error).max_by(f64::total_cmp)));
        }
        row.push(Cell::part([
            runs().filter(|run| !run.descent.is_stuck(STUCK)).count(),
            seeds.len(),
        ]));
        ends.push(row);
        to_errors.push([head.to_vec(), cells(runs().map(|run| &run.descent))].concat());
    }
}

fn tables() -> [Table; 3] {
    let head = [("pixels", "pixels"), ("silhouettes", "silhouettes")];
    let ends = [
        ("ms per step", "median_milliseconds_per_step"),
        ("off, px", "median_pixels"),
        ("worst", "worst_pixels"),
        ("rotation, °", "median_degrees"),
        ("worst", "worst_degrees"),
        ("translation, sides", "median_translation"),
        ("worst", "worst_translation"),
        ("free", "free"),
    ];
    let known = [
        ("pixels", "pixels"),
        ("worst pixel, ±", "largest_pixel_difference"),
        ("pose, px, ±", "median_pose_pixels"),
        ("worst", "worst_pose_pixels"),
    ];
    [
        Table::new("photographs_ends", "Where fits end", &[&head[..], &ends].concat()),
        Table::new(
            "photographs_to_errors",
            "Steps and seconds to an error in pixels, medians over all seeds",
            &[&head[..], &COLUMNS].concat(),
        ),
        Table::new("photographs_known", "How well the photographs are known", &known),
    ]
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let seeds: u64 = bench.effort.choose(2, 20);
    let steps = bench.effort.choose(40, 400);
    let cells: usize = bench.effort.choose(8, 64);
    let mut study = Section::new(
        "photographs",
        "A pose from a photograph",
        format!(
            "The pose of a cube with six textures is learnt from one picture, by se3: rotation and translation \
             together; {seeds} seeds, {steps} steps of Adam at a rate of {RATE} that falls to 0 along a \
             cosine, f64, one thread. A seed has its own pose, and a start that is up to {MOST_DEGREES} \
             degrees and {MOST_MOVED} sides of the cube off. The picture is integrated over the area of each \
             pixel, as photographs are: the mean of {cells} x {cells} points of it, one anywhere in each \
             cell, by rays through the cube's slabs. Nothing of that is shared with what is fitted. 4x4: \
             antialiased at four times the size, then averaged down. Exact: edges at which texture \
             coordinates bend or jump are seams. Textures are a quarter of a wave per side and channel, looked up \
             bilinearly without mipmaps, so that a pixel's centre hardly differs from its mean. Off: how far \
             the vertices are from their places in the image, their mean. Free: at most {STUCK} px off at \
             the end. Seconds are those of steps; measuring errors is no part of them. How well a photograph \
             is known: the difference from one of half as many points, of its worst pixel, and of the poses \
             that fits with exact coverage find in both."
        ),
    );
    let object = Object::new()?;
    let [mut ends, mut to_errors, mut known] = tables();
    let mut panels = Vec::new();
    for &pixels in bench.effort.choose(PIXELS[0], PIXELS[1]) {
        let mut seeds_done = Vec::new();
        for number in 0..seeds {
            let what = format!("{pixels} px, seed {number}");
            seeds_done.extend(study.noted(&what, seed(bench, &object, pixels, steps, number)));
        }
        tabulate(pixels, &seeds_done, [&mut ends, &mut to_errors]);
        known.push(vec![
            Cell::Count(pixels),
            Cell::maybe(seeds_done.iter().map(|seed| seed.pixel_noise).max_by(f64::total_cmp)),
            Cell::median(seeds_done.iter().map(|seed| seed.noise)),
            Cell::maybe(seeds_done.iter().map(|seed| seed.noise).max_by(f64::total_cmp)),
        ]);
        let of_way = |way: usize| seeds_done.iter().map(|seed| &seed.runs[way].descent).collect();
        let title = format!("Pose error in pixels: {pixels} px");
        panels.push(panel(title, (0..WAYS.len()).map(of_way)));
    }
    let legend = WAYS.iter().zip(PALETTE);
    let legend = legend.map(|(way, color)| (way.name().to_owned(), color, Stroke::Solid));
    study.push_figures(Figures::new(panels, legend));
    study.push_tables([ends, to_errors, known]);
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How far a picture is from another at most.
    fn apart(one: &[f64], other: &[f64]) -> f64 {
        one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn exact_coverage_draws_the_photograph() {
        let object = Object::new().unwrap();
        let (size, [truth, _]) = (Size::square(48), poses(2));
        let seen = photograph(&object, &(camera() * truth), size, [48; 2], 0);
        let tape = Tape::new();
        let pose = se3(tape.constant(&Tensor::zeros([6])), &truth).unwrap();
        let of = |silhouettes| drawn(&object, pose, size, silhouettes).unwrap();
        let exact = of(Silhouettes::Exact).image().unwrap().value();
        let centers = of(Silhouettes::Aliased).image().unwrap().value();
        // The photograph's own error at an edge, and what a wave's mean differs from its centre.
        let found = apart(exact.data(), seen.data());
        assert!(found < 0.02, "{found}");
        assert!(apart(centers.data(), seen.data()) > 0.2);
    }

    #[test]
    fn a_fit_finds_the_pose_and_says_when() {
        let object = Object::new().unwrap();
        let (size, [truth, start]) = (Size::square(24), poses(0));
        let image = photograph(&object, &(camera() * truth), size, [16; 2], 0);
        let reference = PixelLoss::squared(&image, &Tensor::zeros([3])).unwrap();
        let case = Case { reference, start, truth };
        let run = fit(Way::Exact, &object, &case, 150).unwrap();
        assert!(!run.descent.is_stuck(STUCK) && run.last.pixels < 0.05, "{:?}", run.last);
        let Descent { levels, last, curve, .. } = &run.descent;
        assert!(levels[0][0] > 1.0 && levels[0][0] <= 150.0, "{levels:?}");
        assert_eq!((curve[curve.len() - 1][1], *last), (run.last.pixels, run.last.pixels));
        assert!(curve.windows(2).all(|pair| pair[0][0] < pair[1][0]));
        let away = fit(Way::Exact, &object, &case, 1).unwrap().descent;
        assert!(away.is_stuck(STUCK) && away.levels[0][0].is_infinite());
    }
}
