//! The report of a set of fits: one page, pictures, a film and tables.
//!
//! A [`Report`] is given fits one by one and keeps what it will show of each; [`Report::render`]
//! makes the files, [`Rendered::write`] writes them into a folder:
//!
//! - `index.html`: the whole report in one file that needs nothing else, online or beside it.
//!   First of all it shows error against run time, then what the paper's Figures 3 to 7 show,
//!   then every fit, every choice, and what other choices do.
//! - `fits.csv`: one row per fit. `histories.csv`: the histories, thinned evenly in the
//!   logarithm of the step.
//! - `pictures/`: the learnt cubes beside their targets, one PNG per group of fits that differ
//!   in their seed alone; `fit.png`, the film, an animated PNG.
//!
//! Each file is written whole or not at all.

mod alternatives;
mod choices;
mod digest;
mod film;
mod gallery;
mod panels;
mod results;
mod sections;
mod table;

use std::path::PathBuf;

use bokashi_fit::FitError;
use bokashi_report::{About, Document, Rendered, ReportError};

use self::alternatives::Trial;
use self::digest::{Fit, Group};
use self::sections::{Content, sections};
use crate::{Alternative, CubeSettings, Outcome};

/// A report in the making: see the module.
#[derive(Debug, Default)]
pub struct Report {
    about: About,
    fits: Vec<Fit>,
    failures: Vec<(CubeSettings, String)>,
    trials: Vec<Trial>,
}

impl Report {
    /// A report without fits.
    pub fn new(about: About) -> Self {
        Self { about, ..Self::default() }
    }

    /// Adds a fit. Of its history only what will be shown is kept.
    pub fn add(&mut self, settings: &CubeSettings, outcome: Outcome) {
        self.fits.push(Fit::new(settings, outcome));
    }

    /// Adds a fit that ended in an error: the report shows it too.
    pub fn add_failure(&mut self, settings: &CubeSettings, error: &FitError) {
        self.failures.push((settings.clone(), error.to_string()));
    }

    /// Adds a fit that shows what another choice does, or the error it ended in. It has a section
    /// of its own, apart from all other fits.
    pub fn add_alternative(
        &mut self,
        alternative: Alternative,
        settings: &CubeSettings,
        outcome: Result<Outcome, FitError>,
    ) {
        let outcome = outcome.map_err(|error| error.to_string());
        self.trials.push(Trial::new(alternative, settings, outcome));
    }

    /// What the fits reached and how long they took, medians over seeds: a row per setting, as Markdown.
    pub fn summary(&self) -> String {
        let groups = Group::sorted(&self.fits);
        results::summary(&groups.iter().collect::<Vec<_>>()).markdown()
    }

    /// Whether there is nothing to show.
    pub fn is_empty(&self) -> bool {
        self.fits.is_empty()
    }

    /// Makes every file of the report, in memory.
    ///
    /// # Errors
    /// Where a figure or a picture can't be made.
    pub fn render(&self) -> Result<Rendered, ReportError> {
        let groups = Group::sorted(&self.fits);
        let groups: Vec<&Group> = groups.iter().collect();
        let film = film::film(&film::cast(&groups))?;
        let mut files: Vec<(PathBuf, Vec<u8>)> = Vec::new();
        for (index, group) in groups.iter().enumerate() {
            if let Some(sheet) = gallery::file(group)? {
                let name = group.file_name();
                let taken = groups[..index].iter().any(|group| group.file_name() == name);
                let number = if taken { format!("-{index}") } else { String::new() };
                files.push((format!("pictures/{name}{number}.png").into(), sheet));
            }
        }
        let count = self.fits.len();
        let fits = match count {
            1 => "one fit".to_owned(),
            count => format!("{count} fits, none left out"),
        };
        let sections = sections(&Content {
            about: &self.about,
            groups: &groups,
            film: film.as_ref(),
            failures: &self.failures,
            trials: &self.trials,
        })?;
        files.extend(film.map(|film| (PathBuf::from("fit.png"), film.moving)));
        for table in [table::fits(&self.fits), table::histories(&self.fits)] {
            files.push((format!("{}.csv", table.name).into(), table.csv().into()));
        }
        let introduction = format!(
            "Vertices, colours and the strength of a blur, found by gradient descent through a \
             renderer, on a CPU. This report shows {fits}."
        );
        let heading = "A cube, learnt from its blurred pictures".to_owned();
        let about = self.about.clone();
        Document { name: "index", heading, introduction, sections, files, about }.render()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Experiment, Kernel, Preset, Record, Silhouettes, random_start, truth};

    /// A made-up outcome whose errors fall from 1 to `last`.
    pub(super) fn outcome(settings: &CubeSettings, last: f64) -> Outcome {
        let learns = settings.experiment != Experiment::Sigma;
        let sigma = settings.blurs().then_some(settings.sigma_target);
        let record = |step: u64| {
            let error = if step == settings.steps { last } else { 1.0 / (1 + step) as f64 };
            Record {
                step,
                seconds: 1e-3 * step as f64,
                loss: error,
                vertex_error: learns.then_some(error),
                sigma: sigma.map(|sigma| sigma + error),
                color_error: learns.then_some(error),
            }
        };
        Outcome {
            experiment: settings.experiment,
            preset: settings.preset,
            resolution: settings.resolution,
            seed: settings.seed,
            steps: settings.steps,
            silhouettes: settings.silhouettes,
            precision: settings.precision,
            kernel: sigma.map(|_| settings.kernel),
            sigma_target: sigma,
            sigma_final: sigma.map(|sigma| sigma + last),
            vertex_error_initial: learns.then_some(1.0),
            vertex_error_final: learns.then_some(last),
            vertex_error_plain: learns.then_some(last),
            vertex_error_tail: learns.then_some(last),
            color_error_final: learns.then_some(last),
            loss_initial: 1.0,
            loss_final: last,
            ms_per_step_median: Some(0.03),
            target_ms_per_step_median: Some(0.02),
            wall_seconds: 1.0,
            history: (0..=settings.steps).map(record).collect(),
            snapshots: vec![random_start(settings.seed, sigma), truth(sigma)],
        }
    }

    fn page(fits: &[(CubeSettings, f64)]) -> String {
        let mut report = Report::new(About::default());
        for (settings, last) in fits {
            report.add(settings, outcome(settings, *last));
        }
        report.render().expect("a report").html
    }

    fn settings(experiment: Experiment) -> CubeSettings {
        CubeSettings { resolution: 8, steps: 20, ..CubeSettings::new(experiment, Preset::Paper) }
    }

    #[test]
    fn seeds_of_one_setting_share_a_row_of_the_summary() {
        let mut report = Report::new(About::default());
        for (resolution, seed, last) in [(8, 0, 1.0), (8, 1, 3.0), (16, 0, 5.0)] {
            let settings = CubeSettings { resolution, seed, ..settings(Experiment::Vertices) };
            report.add(&settings, outcome(&settings, last));
        }
        let text = report.summary();
        let expected = [
            "| 5.1 8 px            | 2     | 2.00     | –     | 2.00    | 0.0300  | 1.00    |",
            "| 5.1 16 px           | 1     | 5.00     | –     | 5.00    | 0.0300  | 1.00    |",
        ];
        assert_eq!(text.lines().skip(2).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn what_was_not_run_leaves_no_section() {
        let page = page(&[(settings(Experiment::Sigma), 1e-9)]);
        assert!(page.contains("5.2 Sigma alone") && page.contains("Sigma error"));
        for missing in ["5.1 ", "5.3 ", "Vertex error", "Colour error", "stuck</h2>"] {
            assert!(!page.contains(missing), "{missing}");
        }
    }

    #[test]
    fn a_stuck_seed_is_shown_and_counted() {
        let fits = [1e-6, 0.4, 1e-7].iter().enumerate().map(|(seed, &last)| {
            (CubeSettings { seed: seed as u64, ..settings(Experiment::Vertices) }, last)
        });
        let page = page(&fits.collect::<Vec<_>>());
        assert!(page.contains("<b>8 px, seed 1</b><br>vertex error 0.400"));
        assert!(page.contains("1 of the 3 fits"));
        assert_eq!(page.matches("<span class=\"stuck\">stuck</span>").count(), 1);
    }

    #[test]
    fn silhouettes_have_files_and_lines_of_their_own_and_aliased_ones_are_not_stuck() {
        let mut report = Report::new(About::default());
        for (silhouettes, last) in
            [(Silhouettes::Antialias, 1e-6), (Silhouettes::Exact, 0.4), (Silhouettes::Aliased, 0.9)]
        {
            let settings = CubeSettings { silhouettes, ..settings(Experiment::Vertices) };
            report.add(&settings, outcome(&settings, last));
        }
        let Rendered { files, html: page, .. } = report.render().expect("a report");
        for name in ["8px-paper-f32", "8px-paper-exact-f32", "8px-paper-aliased-f32"] {
            let path = PathBuf::from(format!("pictures/vertices-{name}.png"));
            assert!(files.iter().any(|(file, _)| *file == path), "{name}");
        }
        assert!(page.contains("1 of the 2 fits that learn vertices, those with aliased"));
        assert!(page.contains("<b>8 px, exact coverage, seed 0</b><br>vertex error 0.400"));
        assert!(!page.contains("<b>8 px, aliased"));
        for name in ["the paper’s rates", "exact coverage", "aliased"] {
            assert!(page.contains(&format!("</svg>{name}")), "{name}");
        }
        // The film has the paper's.
        assert!(page.contains("From left to right: 8 px."));
        let table = files.iter().find(|(file, _)| file.ends_with("fits.csv")).expect("a table");
        let table = String::from_utf8_lossy(&table.1);
        for words in ["steps,silhouettes,precision", ",exact,f32", ",aliased,f32"] {
            assert!(table.contains(words), "{words}");
        }
    }

    #[test]
    fn zero_and_broken_numbers_make_a_page() {
        for last in [0.0, 1e-300, f64::NAN, f64::INFINITY] {
            for experiment in [Experiment::Vertices, Experiment::Sigma, Experiment::Joint] {
                for seeds in [1, 2] {
                    let fits = (0..seeds)
                        .map(|seed| (CubeSettings { seed, ..settings(experiment) }, last));
                    let page = page(&fits.collect::<Vec<_>>());
                    let drawn = page.split("points=\"").skip(1);
                    let points = drawn.map(|text| text.split('"').next().unwrap_or(""));
                    for points in points {
                        let number = |c: char| c.is_ascii_digit() || " ,-".contains(c);
                        assert!(points.chars().all(number), "{points}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_fit_that_failed_is_named() {
        let mut report = Report::new(About::default());
        let (good, bad) = (settings(Experiment::Joint), settings(Experiment::Sigma));
        report.add(&good, outcome(&good, 1e-3));
        report.add_failure(&bad, &FitError::setting("a < b", "c", "d"));
        let page = report.render().expect("a report").html;
        assert!(page.contains("Fits that ended in an error") && page.contains("a &lt; b needs c"));
    }

    #[test]
    fn other_choices_stay_out_of_everything_but_their_section() {
        let ours = settings(Experiment::Sigma);
        let mut report = Report::new(About::default());
        report.add(&ours, outcome(&ours, 1e-3));
        let without = report.render().expect("a report");
        for (alternative, settings) in crate::alternatives(20, Kernel::Sampled) {
            let outcome = outcome(&settings, 1e-3);
            report.add_alternative(alternative, &settings, Ok(outcome));
        }
        let with = report.render().expect("a report");
        let text = with.html;
        let start = text.find("<section id=\"others\">").expect("a section");
        let end = start + text[start..].find("</section>").expect("its end") + "</section>".len();
        let link = "<li><a href=\"#others\">What other choices do</a>";
        assert!(text[..start].replace(link, "") + &text[end..] == without.html);
        assert!(with.files == without.files);
    }

    #[test]
    fn groups_of_one_name_have_files_of_their_own() {
        let mut report = Report::new(About::default());
        for steps in [20, 30] {
            let settings = CubeSettings { steps, ..settings(Experiment::Vertices) };
            report.add(&settings, outcome(&settings, 0.0));
        }
        let rendered = report.render().expect("a report");
        let mut names: Vec<_> = rendered.files.iter().map(|(name, _)| name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), rendered.files.len());
    }
}
