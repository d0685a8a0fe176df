//! What is kept of a fit of a scene for its pages and its summary: losses, times, and how held-out views fare.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_fit::{Answer, Listener, Stepped, every};
use bokashi_scene::{SceneError, SceneFit};

use super::outcome::mean_held_out;
use super::page::Curves;

/// How often held-out views are measured over a fit.
const MEASUREMENTS: u64 = 20;
/// Points of a curve at most: of more, every second is kept.
const MOST_POINTS: usize = 4000;

/// What is known of a fit under way.
pub(super) struct Record {
    pub(super) started: Instant,
    /// How many steps were done before this run.
    pub(super) first_step: u64,
    pub(super) curves: Curves,
    pub(super) step_ms: Vec<f64>,
    /// The first and the last.
    pub(super) losses: Option<[f64; 2]>,
    /// Those of the stage.
    pub(super) stage_losses: Vec<f64>,
    stage: usize,
    /// What all ranks together sent for gradients, in bytes.
    pub(super) sent: u64,
}

impl Record {
    /// Of a run of `fit` that begins now.
    pub(super) fn new(fit: &SceneFit) -> Self {
        Self {
            started: Instant::now(),
            first_step: fit.steps_done(),
            curves: Curves::default(),
            step_ms: Vec::new(),
            losses: None,
            stage_losses: Vec::new(),
            stage: fit.stage(),
            sent: 0,
        }
    }

    /// Seconds of the run.
    pub(super) fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }
}

/// Adds each step to a record.
pub(super) struct Recorder<'a>(pub(super) &'a RefCell<Record>);

impl Listener<SceneFit> for Recorder<'_> {
    fn after_step(&mut self, fit: &SceneFit, stepped: &Stepped) -> Answer<SceneError> {
        let mut record = self.0.borrow_mut();
        let loss = stepped.loss;
        record.sent += fit.bytes_sent();
        record.step_ms.push(stepped.ms);
        if record.stage != fit.stage() {
            record.stage = fit.stage();
            record.stage_losses.clear();
        }
        record.stage_losses.push(loss);
        record.losses = Some([record.losses.map_or(loss, |[first, _]| first), loss]);
        let point = (record.seconds(), loss);
        add_point(&mut record.curves.losses, point);
        Ok(ControlFlow::Continue(()))
    }
}

/// A listener that measures the views that are held out, now and then over a fit of `steps`, for the curve of
/// `record`. Ranks share it.
pub(super) fn held_out(steps: u64, record: &RefCell<Record>) -> impl Listener<SceneFit> {
    every((steps / MEASUREMENTS).max(1), |fit: &SceneFit| {
        let scores = fit.scores(&fit.scene().views_with_image(true).collect::<Vec<_>>())?;
        if let Some(psnr) = mean_held_out(fit, &scores) {
            let mut record = record.borrow_mut();
            let seconds = record.seconds();
            record.curves.held_out.push((seconds, psnr));
        }
        Ok(())
    })
}

/// Adds a point to a curve, which stays short.
fn add_point(curve: &mut Vec<(f64, f64)>, point: (f64, f64)) {
    if curve.len() >= MOST_POINTS {
        let mut index = 0;
        curve.retain(|_| {
            index += 1;
            index % 2 == 1
        });
    }
    curve.push(point);
}
