//! The bar of a fit of a scene on a terminal.

use std::cell::RefCell;
use std::io::IsTerminal as _;
use std::ops::ControlFlow;

use bokashi_fit::{Answer, Listener, Stepped};
use bokashi_scene::{SceneError, SceneFit};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::record::Record;
use crate::failure::one_line;

/// A bar over the steps of a fit, on standard error; nothing where that is no terminal. It goes when it is dropped.
pub(super) struct Bar<'a> {
    bar: Option<ProgressBar>,
    record: &'a RefCell<Record>,
}

impl<'a> Bar<'a> {
    /// A bar over `steps`, with what `record` knows of the fit.
    pub(super) fn new(is_quiet: bool, steps: u64, record: &'a RefCell<Record>) -> Self {
        let bar = (!is_quiet && std::io::stderr().is_terminal()).then(|| {
            let target = ProgressDrawTarget::stderr_with_hz(12);
            let bar = ProgressBar::with_draw_target(Some(steps), target);
            let style =
                ProgressStyle::with_template("{pos}/{len}  {wide_bar:.blue/8}  {eta} left\n{msg}");
            let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style.progress_chars("━━─"));
            bar
        });
        Self { bar, record }
    }

    /// What says on standard error, above the bar, what is wrong.
    pub(super) fn warner(&self) -> impl Fn(&str) + use<> {
        let bar = self.bar.clone();
        move |message| {
            let message = format!("bokashi: {}", one_line(message));
            match &bar {
                Some(bar) => bar.suspend(|| eprintln!("{message}")),
                None => eprintln!("{message}"),
            }
        }
    }
}

impl Listener<SceneFit> for Bar<'_> {
    fn after_step(&mut self, fit: &SceneFit, stepped: &Stepped) -> Answer<SceneError> {
        if let Some(bar) = &self.bar {
            let held_out = self.record.borrow().curves.held_out.last().copied();
            let held_out =
                held_out.map_or(String::new(), |(_, psnr)| format!("  held out {psnr:.1} dB"));
            let (loss, ms) = (stepped.loss, stepped.ms);
            bar.set_message(format!("loss {loss:.2e}{held_out}  {ms:.1} ms/step"));
            bar.set_position(fit.steps_done());
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
