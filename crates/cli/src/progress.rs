//! The progress bar.
//!
//! A fit's step takes some hundredths of a millisecond, so a step may not wait for a terminal. A step
//! costs a look at the clock, and the bar is drawn at most [`PER_SECOND`] times a second.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use bokashi_paper::{CubeSettings, Experiment, Preset, Progress, Silhouettes};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::plan::Planned;

/// How often the bar is drawn.
const PER_SECOND: u32 = 12;

/// About what a step of a fit costs, in arbitrary units, so that the time left is about right
/// where fits of several sizes follow each other.
fn cost(settings: &CubeSettings) -> u64 {
    let pixels = (settings.resolution * settings.resolution) as u64;
    let step = match settings.experiment {
        Experiment::Vertices => 200 + pixels,
        Experiment::Sigma => 200 + pixels / 2,
        Experiment::Joint => 200 + 2 * pixels,
    };
    if settings.silhouettes == Silhouettes::Exact { 4 * step } else { step }
}

/// A bar over the steps of all fits, on standard error; nothing where that is no terminal.
#[derive(Debug)]
pub(crate) struct Bar {
    bar: Option<ProgressBar>,
    drawn: Instant,
    /// What the fits before this one cost, and what a step of this one costs.
    before: u64,
    cost: u64,
    /// Milliseconds and number of the updates since the bar was drawn.
    spent: (f64, u32),
}

impl Bar {
    /// A bar for the fits of `plan`.
    pub(crate) fn new(plan: &[Planned], quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let total = plan.iter().map(|fit| cost(&fit.settings) * fit.settings.steps).sum();
            let target = ProgressDrawTarget::stderr_with_hz(PER_SECOND as u8);
            let bar = ProgressBar::with_draw_target(Some(total), target);
            let style = "{prefix}  {wide_bar:.blue/8}  {eta} left\n{msg}";
            // The template is fixed; where it were wrong, the default bar is as good.
            let style = ProgressStyle::with_template(style);
            bar.set_style(
                style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("━━─"),
            );
            bar
        });
        Self { bar, drawn: Instant::now(), before: 0, cost: 0, spent: (0.0, 0) }
    }

    /// Names the fit that begins.
    pub(crate) fn begin(&mut self, settings: &CubeSettings, name: &str) {
        self.cost = cost(settings);
        if let Some(bar) = &self.bar {
            bar.set_prefix(name.to_owned());
        }
    }

    /// Shows a step, or passes it over if the last one shown is recent.
    pub(crate) fn step(&mut self, progress: &Progress) {
        let Some(bar) = &self.bar else { return };
        self.spent = (self.spent.0 + progress.ms, self.spent.1 + 1);
        let now = Instant::now();
        if now - self.drawn < Duration::from_secs(1) / PER_SECOND {
            return;
        }
        let ms = self.spent.0 / f64::from(self.spent.1);
        (self.drawn, self.spent) = (now, (0.0, 0));
        bar.set_message(message(progress, ms));
        bar.set_position(self.before + self.cost * progress.step);
    }

    /// Ends a fit of `steps` updates.
    pub(crate) fn end(&mut self, steps: u64) {
        self.before += self.cost * steps;
        if let Some(bar) = &self.bar {
            bar.set_position(self.before);
        }
    }

    /// Says what is done after the fits.
    pub(crate) fn say(&self, what: &str) {
        if let Some(bar) = &self.bar {
            bar.set_prefix(what.to_owned());
            bar.set_message("");
        }
    }

    /// Takes the bar away.
    pub(crate) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A step in words, of a width that hardly changes.
fn message(progress: &Progress, ms: f64) -> String {
    let error = match (progress.vertex_error, progress.sigma) {
        (Some(error), _) => format!("  error {error:.1e}"),
        (None, Some(sigma)) => format!("  sigma {sigma:.4}"),
        (None, None) => String::new(),
    };
    let steps = progress.steps.to_string();
    let (step, width) = (progress.step, steps.len());
    format!("step {step:>width$}/{steps}  loss {:.1e}{error}  {ms:.3} ms/step", progress.loss)
}

/// A fit in a few words, the `number`-th of `count`.
pub(crate) fn name(planned: &Planned, number: usize, count: usize) -> String {
    let settings = &planned.settings;
    let what = match settings.experiment {
        Experiment::Vertices => format!("5.1 {} px", settings.resolution),
        Experiment::Sigma => format!("5.2 σ {}", settings.sigma_target),
        Experiment::Joint => format!("5.3 σ {}", settings.sigma_target),
    };
    let tuned = match settings.preset {
        Preset::Paper => "",
        Preset::Tuned => " tuned",
        Preset::SecondOrder => " second-order",
    };
    let silhouettes = match settings.silhouettes {
        Silhouettes::Antialias => "",
        Silhouettes::Aliased => " aliased",
        Silhouettes::Exact => " exact",
    };
    if let Some(alternative) = planned.alternative {
        let choice =
            alternative.choice.map_or("our choices".to_owned(), |choice| choice.to_string());
        return format!("{number}/{count}  {what}{tuned} {choice} {}", alternative.name);
    }
    match count {
        1 => format!("{what}{tuned}{silhouettes}"),
        _ => format!("{number}/{count}  {what}{tuned}{silhouettes} seed {}", settings.seed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bokashi_paper::{Alternative, Choice};

    fn at(vertex_error: Option<f64>, sigma: Option<f64>) -> Progress {
        let (step, steps, seconds) = (420, 10_000, 1.0);
        Progress { step, steps, seconds, loss: 12.5, vertex_error, sigma, ms: 0.03 }
    }

    #[test]
    fn a_step_says_where_it_is_and_what_it_reached() {
        let text = message(&at(Some(0.01), Some(2.0)), 0.0312);
        assert_eq!(text, "step   420/10000  loss 1.2e1  error 1.0e-2  0.031 ms/step");
        let text = message(&at(None, Some(2.0)), 0.0312);
        assert_eq!(text, "step   420/10000  loss 1.2e1  sigma 2.0000  0.031 ms/step");
    }

    #[test]
    fn a_quiet_bar_takes_steps_and_shows_nothing() {
        let settings = CubeSettings::new(Experiment::Joint, Preset::Paper);
        let planned = Planned { settings: settings.clone(), alternative: None };
        let mut bar = Bar::new(&[planned], true);
        bar.begin(&settings, "name");
        bar.step(&at(None, None));
        bar.end(10);
        bar.clear();
        assert!(bar.bar.is_none());
    }

    #[test]
    fn a_fit_is_named_by_what_sets_it_apart() {
        let mut settings = CubeSettings::new(Experiment::Joint, Preset::Tuned);
        settings.sigma_target = 1.4;
        let mut fit = Planned { settings, alternative: None };
        assert_eq!(name(&fit, 1, 1), "5.3 σ 1.4 tuned");
        fit.alternative = Some(Alternative { choice: Some(Choice::Border), name: "mirror" });
        assert_eq!(name(&fit, 2, 8), "2/8  5.3 σ 1.4 tuned border mirror");
        for (silhouettes, word) in [
            (Silhouettes::Aliased, " aliased"),
            (Silhouettes::Exact, " exact"),
            (Silhouettes::Antialias, ""),
        ] {
            let new = CubeSettings::new(Experiment::Vertices, Preset::Paper);
            let settings = CubeSettings { silhouettes, ..new };
            let fit = Planned { settings, alternative: None };
            assert_eq!(name(&fit, 3, 8), format!("3/8  5.1 32 px{word} seed 0"));
        }
    }
}
