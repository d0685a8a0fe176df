//! The state of a fit, as a page shows it.

use std::sync::Arc;

/// The state of a fit at one time.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// What is fitted, in a few words.
    pub title: String,
    /// Steps that are done.
    pub step: u64,
    /// The step at which this run began: 0, but for a fit that goes on from a file.
    pub first_step: u64,
    /// Steps in all.
    pub steps: u64,
    /// Seconds since this run began. The page reckons from them how long the rest takes.
    pub seconds: f64,
    /// The loss of the last step.
    pub loss: f64,
    /// (Seconds, loss), in order.
    pub losses: Vec<(f64, f64)>,
    /// (Seconds, PSNR in dB over all views that are held out), in order; empty where none is.
    pub held_out: Vec<(f64, f64)>,
    /// Some views, in an order that stays: a view is compared with the one in its place before.
    pub views: Vec<View>,
    /// The mesh as [`bokashi_report::viewer_data`] writes it.
    pub mesh: Option<Arc<[u8]>>,
    /// How the fit ended, once it has.
    pub ended: Option<Ended>,
}

/// A view beside its target. Pictures are PNG files of one size; those that may have changed are
/// compared byte by byte, and those that are the same `Arc` are not.
#[derive(Debug, Clone)]
pub struct View {
    /// Its name, for people.
    pub name: String,
    /// Whether it is kept from the fit.
    pub held_out: bool,
    /// How near the picture is to its target, in dB.
    pub psnr: Option<f64>,
    /// What the fit shows.
    pub picture: Arc<[u8]>,
    /// What it is to show.
    pub target: Arc<[u8]>,
    /// How the two differ.
    pub difference: Arc<[u8]>,
}

/// How a fit ended, with a sentence for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// It came to its end.
    Done(String),
    /// It did not.
    Failed(String),
}
