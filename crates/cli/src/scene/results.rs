//! What a fit of a scene leaves behind at its end: pictures, results, the report, JSON, and a summary.

use std::path::{Path, PathBuf};
use std::time::Duration;

use bokashi_report::ReportError;
use bokashi_scene::{Scene, SceneError, SceneFit, Tensor, ViewScore};

use super::checkpoint::CHECKPOINT;
use super::film::{self, Film};
use super::live_page::LivePage;
use super::outcome::{Outcome, fall};
use super::page::page;
use super::pictures::{KINDS, Pictures, block, path};
use super::record::Record;
use super::turntable;
use crate::failure::Failure;
use crate::live::Ended;
use crate::output::{say, say_json};

fn not_reported(error: ReportError) -> Failure {
    Failure::Work(error.to_string())
}

/// Where the files of a fit lie in the folder of results.
pub(super) fn files(scene: &Scene, has_turntable: bool) -> Vec<PathBuf> {
    let [film, end] = film::FILES;
    let all = ["index.html", CHECKPOINT, film, end].map(PathBuf::from);
    let turntable = has_turntable.then(turntable::files).into_iter().flatten();
    let all = all.into_iter().chain(turntable).chain(scene.result_names());
    let views = scene.views.iter();
    all.chain(views.flat_map(|view| KINDS.map(|what| path(&view.name, what)))).collect()
}

/// Writes the pictures of all views to the folder `out`. Ranks share it: each draws and writes some, of which it
/// has one at a time in memory.
pub(super) fn save_views(fit: &SceneFit, out: &Path) -> Result<Vec<ViewScore>, SceneError> {
    let scene = fit.scene();
    let views: Vec<_> = (0..scene.views.len()).collect();
    fit.scores_with(&views, |seen| {
        Pictures::from_view(scene, seen)?.save(&scene.views[seen.score.view].name, out)
    })
}

/// Where results go.
pub(super) struct Results<'a> {
    pub(super) out: &'a Path,
    pub(super) json: Option<&'a Path>,
    pub(super) page: Option<&'a LivePage<'a>>,
    pub(super) film: &'a Film,
    /// Whether a camera goes around what was learnt.
    pub(super) has_turntable: bool,
    /// Whether a summary is told.
    pub(super) speaks: bool,
    /// What the steps took.
    pub(super) time: Duration,
}

impl Results<'_> {
    /// Writes what came out of `fit`, but for the pictures of its views. `first` is what its parameters were.
    pub(super) fn write(
        &self,
        fit: &SceneFit,
        record: &Record,
        first: &[(String, Tensor<f32>)],
        scores: Vec<ViewScore>,
    ) -> Result<(), Failure> {
        let [loss_initial, loss_final] = record.losses.unwrap_or([f64::NAN; 2]);
        let left_out = match scores.first() {
            Some(score) => fit.left_out(score.view)?,
            None => Vec::new(),
        };
        let outcome = Outcome {
            loss_initial,
            loss_final,
            steps: fit.steps_done(),
            steps_before: record.first_step,
            time: self.time,
            step_ms: record.step_ms.clone(),
            first: first.to_vec(),
            scores,
            left_out,
            // More steps are no advice where a rule ended them.
            fell: fall(&record.stage_losses).filter(|_| fit.ended().is_none()),
        };
        if let Some(page) = self.page {
            page.show(fit, Some(Ended::Done(outcome.message())))?;
        }
        let learnt = fit.learnt()?;
        learnt.save_results(self.out)?;
        let model = learnt.model()?;
        let viewer = match model.geometries.is_empty() {
            true => String::new(),
            false => block(&model, "Drag to turn, roll to zoom.").map_err(not_reported)?,
        };
        let film = self.film.save(self.out)?;
        let turntable = match self.has_turntable {
            true => turntable::write_for_page(&learnt, self.out)?,
            false => String::new(),
        };
        let page = page(fit, &outcome, &record.curves, [film, turntable, viewer]).render();
        let report = page.and_then(|page| page.write(self.out)).map_err(not_reported)?;
        if let Some(file) = self.json {
            say_json(file, &outcome.json(fit).to_string())?;
        }
        if self.speaks {
            summarize(fit, record, &outcome)?;
            say(&format!("Report: {}\n", report.display()))?;
        }
        self.page.into_iter().for_each(LivePage::wait_for_pages);
        Ok(())
    }
}

/// Says how a fit went, in a few lines.
fn summarize(fit: &SceneFit, record: &Record, outcome: &Outcome) -> Result<(), Failure> {
    let loss = record
        .losses
        .map_or(String::new(), |[initial, last]| format!(": loss {initial:.2e} to {last:.2e}"));
    let held_out = outcome
        .psnr_held_out(fit)
        .map_or(String::new(), |psnr| format!(", held-out views {psnr:.1} dB"));
    let sent = match fit.size() {
        1 => String::new(),
        size => {
            let steps = (record.step_ms.len() as u64).max(1);
            format!(", {size} ranks sent {} bytes per step", record.sent / steps)
        }
    };
    say(&format!("{}{loss}{held_out}{sent}\n", outcome.message()))?;
    outcome.remarks(fit).try_for_each(|words| say(&format!("{words}\n")))
}
