//! The live page of a fit of a scene.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bokashi_fit::{Answer, Listener, Stepped};
use bokashi_scene::{SceneError, SceneFit, ViewComparison};

use super::pictures::{Pictures, data};
use super::record::Record;
use crate::live::{Ended, Live, Snapshot, View};

/// Between two updates of the page's pictures.
const BETWEEN_PICTURES: Duration = Duration::from_secs(2);
/// Views on the page.
const LIVE_VIEWS: usize = 4;
/// How long the page's server waits at the end: a page asks each second.
const LAST_LOOK: Duration = Duration::from_millis(1500);

/// A page that shows a fit while it runs.
pub(super) struct LivePage<'a> {
    live: Live,
    record: &'a RefCell<Record>,
    /// Of the fit in all.
    steps: u64,
    shown: Option<Instant>,
}

impl<'a> LivePage<'a> {
    /// `live` as the page of a fit of `steps`, with what `record` knows of it.
    pub(super) fn new(live: Live, steps: u64, record: &'a RefCell<Record>) -> Self {
        Self { live, record, steps, shown: None }
    }

    /// Shows the fit as it is, and how it ended.
    pub(super) fn show(&self, fit: &SceneFit, ended: Option<Ended>) -> Result<(), SceneError> {
        let views = match ended {
            Some(Ended::Failed(_)) => Vec::new(),
            _ => compare_views(fit)?,
        };
        self.live.publish(Snapshot { ended, ..self.snapshot(fit, &views) });
        Ok(())
    }

    /// Lets pages ask a last time.
    pub(super) fn wait_for_pages(&self) {
        std::thread::sleep(LAST_LOOK);
    }

    fn snapshot(&self, fit: &SceneFit, compared: &[ViewComparison]) -> Snapshot {
        let (scene, record) = (fit.scene(), self.record.borrow());
        let views = compared.iter().filter_map(|compared| {
            let view = &scene.views[compared.score.view];
            let Pictures { picture, target, difference } =
                Pictures::from_view(scene, compared).ok()?;
            let (target, difference) = (target?, difference?);
            let (name, held_out, psnr) = (view.name.clone(), view.held_out, compared.score.psnr);
            Some(View { name, held_out, psnr, picture, target, difference })
        });
        let model = fit.learnt().and_then(|learnt| learnt.model()).ok();
        let mesh = model.and_then(|model| data(&model).ok());
        Snapshot {
            title: scene.path.display().to_string(),
            step: fit.steps_done(),
            first_step: record.first_step,
            steps: self.steps,
            seconds: record.seconds(),
            loss: record.losses.map_or(f64::NAN, |[_, last]| last),
            losses: record.curves.losses.clone(),
            held_out: record.curves.held_out.clone(),
            views: views.collect(),
            mesh: mesh.map(|mesh| Arc::from(mesh.into_bytes())),
            ended: None,
        }
    }
}

/// The first views that are held out, and the first others.
fn compare_views(fit: &SceneFit) -> Result<Vec<ViewComparison>, SceneError> {
    let scene = fit.scene();
    let held_out: Vec<_> = scene.views_with_image(true).take(LIVE_VIEWS / 2).collect();
    let more = LIVE_VIEWS - held_out.len();
    let all = held_out.into_iter().chain(scene.views_with_image(false).take(more));
    all.map(|view| fit.compare(view)).collect()
}

impl Listener<SceneFit> for LivePage<'_> {
    fn after_step(&mut self, fit: &SceneFit, _stepped: &Stepped) -> Answer<SceneError> {
        if self.shown.is_none_or(|shown| shown.elapsed() > BETWEEN_PICTURES) {
            self.show(fit, None)?;
            self.shown = Some(Instant::now());
        }
        Ok(ControlFlow::Continue(()))
    }
}
