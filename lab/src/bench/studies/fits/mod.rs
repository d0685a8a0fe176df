//! How many steps and seconds does a fit take to an error, with antialias, with supersampling and with
//! exact coverage?
//!
//! The paper's cube from random starts, with the tuned rates. All kinds of silhouettes take the same
//! starts and poses, in turns, so that whatever else the machine does falls on all alike. A fit's
//! history has every step, so steps to an error are exact.

mod supersampled;

use std::ops::ControlFlow;

use bokashi_fit::FitError;
use bokashi_paper::{
    CubeSettings, Experiment, Outcome, Precision, Preset, Record, STUCK, Silhouettes, run_cube,
};
use bokashi_report::{Cell, Figures, PALETTE, Section, Stroke, Table};

use self::supersampled::TIMES;
use crate::bench::descent::{COLUMNS, Descent, cells, panel};
use crate::bench::setting::Bench;

/// A way to draw silhouettes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// One of the paper's crate.
    Own(Silhouettes),
    Supersampled,
}

/// What is compared; the place of each is its colour's.
const WAYS: [Way; 3] =
    [Way::Own(Silhouettes::Antialias), Way::Own(Silhouettes::Exact), Way::Supersampled];
/// The places of two of them.
const ANTIALIAS: usize = 0;
const EXACT: usize = 1;

impl Way {
    fn name(self) -> String {
        match self {
            Self::Own(silhouettes) => silhouettes.to_string(),
            Self::Supersampled => format!("antialias, {TIMES}x{TIMES}"),
        }
    }
}

/// What is fitted: the experiment, pixels, and the blur of the reference image.
struct Case {
    experiment: Experiment,
    pixels: usize,
    sigma: f64,
}

/// All cases; another one is another row.
const CASES: [Case; 5] = [
    Case { experiment: Experiment::Vertices, pixels: 4, sigma: 0.0 },
    Case { experiment: Experiment::Vertices, pixels: 8, sigma: 0.0 },
    Case { experiment: Experiment::Vertices, pixels: 16, sigma: 0.0 },
    Case { experiment: Experiment::Vertices, pixels: 32, sigma: 0.0 },
    Case { experiment: Experiment::Joint, pixels: 32, sigma: 1.0 },
];

impl Case {
    fn name(&self) -> String {
        match self.experiment {
            Experiment::Joint => format!("5.3, sigma {}", self.sigma),
            _ => "5.1".to_owned(),
        }
    }

    fn settings(&self, silhouettes: Silhouettes, steps: u64, seed: u64) -> CubeSettings {
        CubeSettings {
            resolution: self.pixels,
            sigma_target: self.sigma,
            silhouettes,
            steps,
            seed,
            precision: Precision::F64,
            ..CubeSettings::new(self.experiment, Preset::Tuned)
        }
    }
}

/// What is kept of a fit of the paper's.
fn descent(outcome: &Outcome) -> Descent {
    let error = |record: &Record| record.vertex_error.unwrap_or(f64::NAN);
    let history = outcome.history.iter().map(|record| [record.seconds, error(record)]);
    Descent::new(&history.collect::<Vec<_>>(), outcome.wall_seconds)
}

/// A start's fits, one for each of [`WAYS`].
type Runs = [Descent; WAYS.len()];

fn runs(bench: &Bench, case: &Case, steps: u64, seed: u64) -> Result<Runs, FitError> {
    let run = |way| match way {
        Way::Own(silhouettes) => {
            let settings = case.settings(silhouettes, steps, seed);
            let outcome = || run_cube(&settings, &mut |_| ControlFlow::Continue(()));
            Ok::<_, FitError>(descent(&bench.one().install(outcome)?))
        }
        Way::Supersampled => {
            let settings = case.settings(Silhouettes::Antialias, steps, seed);
            let (history, seconds) = bench.one().install(|| supersampled::run(&settings))?;
            Ok(Descent::new(&history, seconds))
        }
    };
    Ok([run(WAYS[0])?, run(WAYS[1])?, run(WAYS[2])?])
}

/// How many of the seeds that are stuck with one way are not with another.
fn freed(all: &[Runs], stuck_with: usize, with: usize) -> [usize; 2] {
    let stuck = all.iter().filter(|runs| runs[stuck_with].is_stuck(STUCK));
    let free = stuck.clone().filter(|runs| !runs[with].is_stuck(STUCK));
    [free.count(), stuck.count()]
}

/// The rows of a case in both tables.
fn tabulate(case: &Case, all: &[Runs], [to_errors, ends]: [&mut Table; 2]) {
    for (with, way) in WAYS.iter().enumerate() {
        let runs = || all.iter().map(move |runs| &runs[with]);
        let head = [Cell::text(case.name()), Cell::Count(case.pixels), Cell::text(way.name())];
        to_errors.push([head.to_vec(), cells(runs())].concat());
        let worst = runs().map(|run| run.last).max_by(f64::total_cmp);
        let mut row = head.to_vec();
        row.extend([
            Cell::median(runs().map(|run| 1e3 * run.step_seconds)),
            Cell::median(runs().map(|run| run.last)),
            Cell::maybe(worst),
            Cell::part([runs().filter(|run| run.is_stuck(STUCK)).count(), all.len()]),
            match with {
                ANTIALIAS => Cell::Nothing,
                _ => Cell::part(freed(all, ANTIALIAS, with)),
            },
        ]);
        ends.push(row);
    }
}

fn tables() -> [Table; 2] {
    let head = [("experiment", "experiment"), ("pixels", "pixels"), ("silhouettes", "silhouettes")];
    let ends = [
        ("ms per step", "median_milliseconds_per_step"),
        ("median error", "median_vertex_error"),
        ("worst", "worst_vertex_error"),
        ("stuck", "stuck"),
        ("free of those stuck with antialias", "free_of_stuck_with_antialias"),
    ];
    let with = |name, title, columns: &[(&'static str, &'static str)]| {
        Table::new(name, title, &[&head[..], columns].concat())
    };
    [
        with(
            "fits_to_errors",
            "Steps and seconds to a vertex error, medians over all seeds",
            &COLUMNS,
        ),
        with("fits_ends", "The vertex error at the end", &ends),
    ]
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let seeds: u64 = bench.effort.choose(2, 20);
    let steps = bench.effort.choose(60, 3_000);
    let title = "Steps and seconds to an error: antialias, supersampling, exact coverage";
    let mut study = Section::new("fits", title, "");
    let [mut to_errors, mut ends] = tables();
    let (mut panels, mut every) = (Vec::new(), Vec::new());
    for case in &CASES {
        let mut all = Vec::new();
        for seed in 0..seeds {
            let what = format!("{}, {} px, seed {seed}", case.name(), case.pixels);
            all.extend(study.noted(&what, runs(bench, case, steps, seed)));
        }
        tabulate(case, &all, [&mut to_errors, &mut ends]);
        let ways = (0..WAYS.len()).map(|way| all.iter().map(|runs| &runs[way]).collect());
        panels.push(panel(format!("Vertex error: {}, {} px", case.name(), case.pixels), ways));
        every.extend(all);
    }
    let [exact_frees, with_antialias] = freed(&every, ANTIALIAS, EXACT);
    let [antialias_frees, with_exact] = freed(&every, EXACT, ANTIALIAS);
    study.note = format!(
        "Experiment 5.1 learns vertices and colours, 5.3 a blur's sigma too, from 2 pixels; {seeds} \
         seeds, fits of {steps} steps, tuned rates, f64, one thread. All kinds of silhouettes take \
         the same starts and poses; each has a reference image of its own kind, rendered anew in each \
         step. {TIMES}x{TIMES}: antialiased at so many times the size, then averaged down. The vertex error is the mean distance of the vertices from the truth, in sides of the \
         cube. An error counts as reached at the first step that has it; a seed that never does \
         counts as infinite, and a median that is infinite is a dash. Seconds are wall-clock time \
         since the start of a fit, all included: poses, reference images, updates, and measuring the \
         errors in every step. Stuck: more than {STUCK} off at the end. Over all rows antialias leaves \
         {with_antialias} fits stuck, of which {exact_frees} come free with exact coverage; exact \
         coverage leaves {with_exact}, of which {antialias_frees} come free with antialias.",
    );
    let legend = WAYS.iter().zip(PALETTE);
    let legend = legend.map(|(way, color)| (way.name(), color, Stroke::Solid));
    study.push_figures(Figures::new(panels, legend));
    study.push_tables([to_errors, ends]);
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::effort::Effort;

    /// A run that ends at `last`, and reaches each level after so many steps.
    fn run(steps: [f64; 3], last: f64) -> Descent {
        let levels = steps.map(|steps| [steps, 1e-3 * steps]);
        let curve = vec![[1e-3, 1.0], [2e-3, last]];
        Descent { levels, last, step_seconds: 1e-3, curve }
    }

    #[test]
    fn a_run_has_the_first_step_of_each_error_and_where_it_ended() {
        let bench = Bench::new(Effort::Quick).unwrap();
        let settings = CASES[1].settings(Silhouettes::Exact, 300, 3);
        let outcome =
            bench.one().install(|| run_cube(&settings, &mut |_| ControlFlow::Continue(())));
        let outcome = outcome.unwrap();
        let found = descent(&outcome);
        for (level, [steps, seconds]) in [0.1, 0.01, 1e-3].into_iter().zip(found.levels) {
            let below = |step: usize| outcome.history[step].vertex_error.unwrap() <= level;
            if steps.is_finite() {
                let at = steps as usize;
                assert!(below(at) && !(0..at).any(below), "{level}: {steps}");
                assert_eq!(seconds, outcome.history[at].seconds);
            } else {
                assert!(!(0..=300).any(below) && seconds.is_infinite(), "{level}");
            }
        }
        assert!(found.levels[0][0].is_finite(), "{:?}", found.levels);
        assert_eq!(Some(found.last), outcome.vertex_error_final);
        assert_eq!(found.curve[found.curve.len() - 1][1], found.last);
        assert!(found.curve.windows(2).all(|pair| pair[0][0] < pair[1][0]));
    }

    #[test]
    fn seeds_that_never_get_there_count_as_infinite_and_as_stuck() {
        const NEVER: f64 = f64::INFINITY;
        let stuck = run([50.0, NEVER, NEVER], 0.2);
        let free = run([10.0, 10.0, 10.0], 0.0);
        let all = [
            [stuck.clone(), run([10.0, 20.0, NEVER], 0.004), free.clone()],
            [stuck.clone(), run([30.0, 40.0, 90.0], 1e-6), stuck.clone()],
            [run([20.0, 30.0, 40.0], 0.0), stuck, free],
        ];
        assert_eq!([freed(&all, 1, 0), freed(&all, 0, 1)], [[1, 1], [2, 2]]);
        assert_eq!(freed(&all, 0, 2), [1, 2]);
        let [mut to_errors, mut ends] = tables();
        tabulate(&CASES[0], &all, [&mut to_errors, &mut ends]);
        let row = |seeds: [usize; 3], medians: [Option<f64>; 3]| -> Vec<Cell> {
            let cells = seeds.iter().zip(medians).flat_map(|(&count, steps)| {
                [
                    Cell::part([count, 3]),
                    Cell::maybe(steps),
                    Cell::maybe(steps.map(|steps| 1e-3 * steps)),
                ]
            });
            cells.collect()
        };
        assert_eq!(to_errors.rows[0][3..], row([3, 1, 1], [Some(50.0), None, None]));
        assert_eq!(to_errors.rows[1][3..], row([3, 2, 1], [Some(30.0), Some(40.0), None]));
        let text = ends.markdown();
        assert!(text.contains("| 2 of 3 | – ") && text.contains("| 1 of 3 | 2 of 2 "), "{text}");
        let ways = (0..WAYS.len()).map(|way| all.iter().map(|runs| &runs[way]).collect());
        let panel = panel(String::new(), ways);
        assert_eq!(panel.curves[0].points[1], [2e-3, 0.1, 0.2, 0.2]);
    }
}
