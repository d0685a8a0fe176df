//! How good is the gradient of a silhouette, and what does it cost?
//!
//! The truth is the gradient of `<g, a(p)>`, where `a` is the picture of vertices `p` averaged over
//! the area of each pixel (`scanlines`). Here `g` is one fixed upstream gradient per image: the
//! gradient of the squared error against a reference image. A method gives the gradient of
//! `<g, image(p)>` for an image of its own.

mod cases;
mod figure;
mod method;
mod row;
mod scanlines;
mod truth;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::Cull;
use bokashi_report::{Cell, Section, Table};

use self::cases::{Case, Kind};
use self::figure::figures;
use self::method::{METHODS, Method, Seams};
use self::row::{Errors, Row};
use self::truth::{Truth, truths};
use crate::bench::effort::USUAL;
use crate::bench::sampling::{Contestant, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;

/// The sizes of the images, in pixels: each a divisor of the last one.
/// A quick run takes the first two.
const PIXELS: [usize; 4] = [8, 16, 32, 64];

/// A scene at one size as a method takes it.
struct Subject {
    scene: Scene,
    cull: Cull,
    positions: Tensor<f32>,
    colors: Tensor<f32>,
    upstream: Tensor<f32>,
}

impl Subject {
    fn new(method: &Method, case: &Case, cull: Cull, truth: &Truth) -> Self {
        let mut scene = case.scene.with_pixels(truth.pixels);
        match method.seams {
            Seams::None => {}
            Seams::Creases => scene.has_creases = true,
            Seams::All => scene.mesh = scene.mesh.with_seams(|_, _| true),
        }
        let (positions, colors) = (scene.positions.cast(), scene.colors.cast());
        Self { scene, cull, positions, colors, upstream: truth.upstream.cast() }
    }

    /// The image and the gradient that `method` gives.
    fn gradient(
        &self,
        method: &Method,
        tape: &mut Tape<f32>,
    ) -> Result<[Tensor<f32>; 2], FitError> {
        let image_and_gradient = {
            let positions = tape.leaf(&self.positions);
            let colors = tape.constant(&self.colors);
            let image = (method.image)(&self.scene, self.cull, positions, colors)?;
            let gradients = tape.vjp(&[(image, &self.upstream)])?;
            [image.value(), gradients.get_or_zeros(positions)]
        };
        tape.reset();
        Ok(image_and_gradient)
    }
}

/// Measures a case at `sizes`.
fn measure(
    bench: &Bench,
    study: &mut Section,
    kind: &Kind,
    sizes: &[usize],
) -> Result<Vec<Row>, FitError> {
    let seeds = bench.effort.choose(1, kind.seeds);
    let kind = &Kind { height: bench.effort.choose(0.25, kind.height), ..*kind };
    let mut rows = Vec::new();
    for seed in 0..seeds {
        let case = (kind.make)(seed)?;
        let truths = bench.widest().install(|| truths(&case, kind, sizes));
        for (index, truth) in truths.iter().enumerate() {
            if seed == 0 {
                let mut contestants = Vec::new();
                for method in &METHODS {
                    let subject = Subject::new(method, &case, kind.cull, truth);
                    let mut tape = Tape::new();
                    contestants.push(Contestant::new(bench.one(), move || {
                        subject.gradient(method, &mut tape).map(drop)
                    }));
                }
                let timings = interleaved(&mut contestants, bench.effort, USUAL);
                let noted = METHODS.iter().zip(timings).map(|(method, timing)| {
                    let what = format!("{}, {} at {} px", kind.name, method.name, truth.pixels);
                    study.noted(&what, timing)
                });
                rows.push(Row {
                    case: kind.name.to_owned(),
                    pixels: truth.pixels,
                    errors: vec![Errors::default(); METHODS.len()],
                    timings: noted.collect(),
                    noise: 0.0,
                    pixel_noise: 0.0,
                });
            }
            let row = &mut rows[index];
            row.noise = row.noise.max(truth.noise);
            row.pixel_noise = row.pixel_noise.max(truth.pixel_noise);
            for (method, errors) in METHODS.iter().zip(&mut row.errors) {
                let subject = Subject::new(method, &case, kind.cull, truth);
                errors.add(truth, &subject.gradient(method, &mut Tape::new())?);
            }
        }
    }
    Ok(rows)
}

/// The relative error of the vertex gradient of `scene` against the picture of other vertices, by each of
/// `methods`, named as in the tables; and how well the truth is known, last.
pub(super) fn errors_of(
    bench: &Bench,
    scene: Scene,
    target: Tensor<f64>,
    cull: Cull,
    methods: &[&str],
) -> Result<Vec<f64>, FitError> {
    let (kind, pixels) = (cases::of_mesh(cull), scene.size.width);
    let case = Case { scene, target };
    let truths = bench.widest().install(|| truths(&case, &kind, &[pixels]));
    let truth = truths.first().expect("one size has one truth");
    let mut errors = Vec::new();
    for name in methods {
        let method = METHODS.iter().find(|method| method.name == *name).expect("it is a method");
        let subject = Subject::new(method, &case, cull, truth);
        let [_, gradient] = subject.gradient(method, &mut Tape::new())?;
        errors.push(truth.error(gradient.cast::<f64>().data()));
    }
    errors.push(truth.noise);
    Ok(errors)
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let mut study =
        Section::new("silhouettes", "The gradient of a silhouette, against the true one", "");
    let mut rows = Vec::new();
    let kinds = cases::cases(bench.effort);
    let sizes = &PIXELS[..bench.effort.choose(2, PIXELS.len())];
    for kind in &kinds {
        rows.extend(measure(bench, &mut study, kind, sizes)?);
    }
    for kind in &cases::of_bench(bench.effort) {
        rows.extend(measure(bench, &mut study, kind, &[kind.pixels])?);
    }
    study.note = format!(
        "Each method gives the gradient of <g, image> with respect to all vertices, in f32. The \
         truth is the gradient of <g, area-averaged image>. Here g is one fixed upstream gradient \
         per scene and size: that of the squared error against the picture of other vertices. The \
         error is the length of the difference over the length of the truth, for the gradient as a \
         whole. It is a median over {} poses of the cube, with each coordinate of each vertex up \
         to {} of a side off, and over {} seeds of each other scene. The scenes of the step's \
         table have one seed. The truth comes from differences of pictures that are integrated \
         along scanlines. Where a scene has more than 24 coordinates, the differences are along 8 \
         random directions in which all vertices move. Truth, ±: how far half as many scanlines \
         move the truth, at most. 2x2 and 4x4: rendered so much larger, then averaged down. Exact: \
         edges at which colours bend are seams; no seams: none is; all edges: every edge is. Back faces are culled in closed meshes of the step's table, \
         and drawn in all other scenes.",
        bench.effort.choose(1, kinds[0].seeds),
        cases::SHIFT,
        bench.effort.choose(1, kinds[1].seeds),
    );
    study.push_figures(figures(&rows));
    let percent = |share: f64| Cell::number(100.0 * share);
    let noise = |row: &Row| percent(row.noise);
    study.push_tables([
        table(
            &rows,
            "silhouettes",
            "Relative error of the vertex gradient, %, median",
            Some(&noise),
            &|row, index| percent(row.errors[index].of_gradient()[1]),
        ),
        table(&rows, "silhouettes_largest", "The same, largest", Some(&noise), &|row, index| {
            percent(row.errors[index].of_gradient()[2])
        }),
        table(
            &rows,
            "silhouettes_pixels",
            "Error of the worst pixel, % of full intensity",
            Some(&|row| percent(row.pixel_noise)),
            &|row, index| percent(row.errors[index].pixel),
        ),
        table(
            &rows,
            "silhouettes_times",
            "Milliseconds of an image and its gradient, one thread",
            None,
            &|row, index| match &row.timings[index] {
                Some(timing) => timing.cell(1e3 * timing.minimum),
                None => Cell::Nothing,
            },
        ),
    ]);
    Ok(study)
}

/// A row per case and size, a column per method, and perhaps one for the truth.
fn table(
    rows: &[Row],
    name: &'static str,
    title: &'static str,
    truth: Option<&dyn Fn(&Row) -> Cell>,
    cell: &dyn Fn(&Row, usize) -> Cell,
) -> Table {
    let mut columns = vec![("scene", "scene"), ("pixels", "pixels")];
    columns.extend(METHODS.iter().map(|method| (method.name, method.key)));
    columns.extend(truth.map(|_| ("truth, ±", "truth")));
    let mut table = Table::new(name, title, &columns);
    for row in rows {
        let mut cells = vec![Cell::text(&row.case), Cell::Count(row.pixels)];
        cells.extend((0..METHODS.len()).map(|index| cell(row, index)));
        cells.extend(truth.map(|truth| truth(row)));
        table.push(cells);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::effort::Effort;

    /// At 16 and 32 px: what is left is the truth's own error.
    #[test]
    fn with_exact_coverage_the_gradient_is_the_true_one() {
        let cases = [(0, 5, 0.002), (0, 6, 0.002), (2, 5, 0.004), (3, 5, 0.005), (3, 6, 0.005)];
        for (case, exact, bound) in cases {
            let kind = &cases::cases(Effort::Full)[case];
            let case = (kind.make)(1).unwrap();
            for truth in truths(&case, kind, &[16, 32]) {
                let gradient_error = |method: &Method| {
                    let subject = Subject::new(method, &case, kind.cull, &truth);
                    let found = subject.gradient(method, &mut Tape::new()).unwrap();
                    let mut errors = Errors::default();
                    errors.add(&truth, &found);
                    (errors.of_gradient()[1], errors.pixel)
                };
                let (exact, pixel) = gradient_error(&METHODS[exact]);
                let what = format!("{} at {} px: {exact:.4} {pixel:.4}", kind.name, truth.pixels);
                assert!(truth.noise < bound && exact < bound && pixel < 0.01, "{what}");
                let (antialiased, _) = gradient_error(&METHODS[1]);
                assert!(antialiased > 10.0 * exact, "{what}, {antialiased:.4}");
            }
        }
    }
}
