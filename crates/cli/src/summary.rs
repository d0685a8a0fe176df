//! The last words of a run: what the fits reached, and how long they took.

use bokashi_paper::{CubeSettings, Experiment, Outcome, Silhouettes};
use bokashi_report::{Cell, Table, quartiles};

/// What is kept of a fit for the summary.
#[derive(Debug, Clone)]
struct Line {
    settings: CubeSettings,
    /// Vertex error, sigma error, colour error, milliseconds per step, seconds.
    numbers: [Option<f64>; 5],
}

/// A summary in the making: one row per setting, medians over its seeds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Summary {
    lines: Vec<Line>,
}

impl Summary {
    /// Adds a fit.
    pub(crate) fn add(&mut self, settings: &CubeSettings, outcome: &Outcome) {
        let sigma_error = outcome.sigma_final.zip(outcome.sigma_target).map(|(a, b)| (a - b).abs());
        self.lines.push(Line {
            settings: settings.clone(),
            numbers: [
                outcome.vertex_error_final,
                sigma_error,
                outcome.color_error_final,
                outcome.ms_per_step_median,
                Some(outcome.wall_seconds),
            ],
        });
    }

    /// The rows, as Markdown.
    pub(crate) fn table(&self) -> String {
        let columns =
            ["error at the end of", "seeds", "vertices", "sigma", "colours", "ms/step", "seconds"];
        let mut table = Table::new("", "", &columns.map(|title| (title, "")));
        for group in self.lines.chunk_by(|a, b| alike(&a.settings, &b.settings)) {
            let median = |at: usize| median(group.iter().filter_map(|line| line.numbers[at]));
            let mut row = vec![Cell::text(name(&group[0].settings)), Cell::Count(group.len())];
            row.extend([0, 1, 2].map(|at| Cell::maybe(median(at))));
            row.extend([3, 4].map(|at| Cell::maybe_time(median(at))));
            table.push(row);
        }
        table.markdown()
    }
}

/// Whether two fits differ in their seeds at most.
fn alike(a: &CubeSettings, b: &CubeSettings) -> bool {
    CubeSettings { seed: b.seed, ..a.clone() } == *b
}

/// Settings in words.
fn name(settings: &CubeSettings) -> String {
    let what = match settings.experiment {
        Experiment::Vertices => format!("5.1 vertices, {} px", settings.resolution),
        Experiment::Sigma => format!("5.2 sigma {}", settings.sigma_target),
        Experiment::Joint => format!("5.3 joint, sigma {}", settings.sigma_target),
    };
    let silhouettes = match settings.silhouettes {
        Silhouettes::Antialias => String::new(),
        other => format!(", {other}"),
    };
    format!("{what}, {}{silhouettes}", settings.preset)
}

/// The median, the mean of the two in the middle of an even number; `None` without numbers.
pub fn median(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let mut numbers = numbers.peekable();
    numbers.peek().is_some().then(|| quartiles(numbers)[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use bokashi_paper::Preset;

    #[test]
    fn a_setting_is_named_by_its_silhouettes_where_they_are_not_the_papers() {
        for (silhouettes, word) in [
            (Silhouettes::Aliased, ", aliased"),
            (Silhouettes::Antialias, ""),
            (Silhouettes::Exact, ", exact"),
        ] {
            let new = CubeSettings::new(Experiment::Vertices, Preset::Paper);
            let text = name(&CubeSettings { silhouettes, ..new });
            assert_eq!(text, format!("5.1 vertices, 32 px, paper{word}"));
        }
    }

    #[test]
    fn seeds_of_one_setting_share_a_row() {
        let mut summary = Summary::default();
        for (resolution, seed, error) in [(8, 0, 1.0), (8, 1, 3.0), (16, 0, 5.0)] {
            let new = CubeSettings::new(Experiment::Vertices, Preset::Paper);
            let settings = CubeSettings { resolution, seed, ..new };
            let numbers = [Some(error), None, Some(error), Some(0.03), Some(1.0)];
            summary.lines.push(Line { settings, numbers });
        }
        let table = summary.table();
        let rows: Vec<&str> = table.lines().skip(2).collect();
        let expected = [
            "| 5.1 vertices, 8 px, paper  | 2     | 2.00     | –     | 2.00    | 0.0300  | 1.00    |",
            "| 5.1 vertices, 16 px, paper | 1     | 5.00     | –     | 5.00    | 0.0300  | 1.00    |",
        ];
        assert_eq!(rows, expected);
    }
}
