//! What was chosen where the paper leaves a choice, and what else makes the numbers of a report.

use bokashi_fit::{Optimizer, Schedule};
use bokashi_render_ops::{Kernel, Radius};
use bokashi_report::{About, Cell, Section, Table, grouped};

use super::digest::Group;
use crate::{CubeSettings, Experiment};

/// Every choice of a report.
pub(crate) fn section(about: &About, groups: &[&Group]) -> Section {
    let has = |what: &dyn Fn(&CubeSettings) -> bool| groups.iter().any(|one| what(&one.settings));
    let blurred: Vec<&Group> =
        groups.iter().copied().filter(|group| group.settings.blurs()).collect();
    let mut rows = vec![
        ("Program", about.program.clone()),
        ("Command", about.command.clone()),
        ("Threads", about.threads.to_string()),
        ("Numbers", each(groups, |settings| settings.precision.to_string())),
        ("Steps", each(groups, |settings| grouped(settings.steps as f64))),
        ("Seeds", seeds(groups)),
        ("Learning rates", each(groups, rates)),
        ("Optimizer", each(groups, |settings| optimizer(settings.optimizer))),
        ("Loss", "sum of squared differences over all pixels and channels".to_owned()),
        ("Cube", "vertices {−½, ½}³, colours {0, 1}³, 12 faces".to_owned()),
    ];
    if has(&|settings| settings.experiment != Experiment::Sigma) {
        let fixed = [("Start", START), ("Poses", POSES), ("Vertex error", VERTEX_ERROR)];
        rows.extend(fixed.map(|(what, text)| (what, text.to_owned())));
    }
    rows.push(("Camera", CAMERA.to_owned()));
    if !blurred.is_empty() {
        let word = |word: &dyn std::fmt::Debug| format!("{word:?}").to_lowercase();
        rows.push(("Blur kernel", each(&blurred, |settings| settings.kernel.to_string())));
        rows.push(("Blur border", each(&blurred, |settings| word(&settings.border))));
        rows.push(("Blur radius", each(&blurred, radius)));
        let mapping = each(&blurred, |settings| word(&settings.sigma_mapping));
        rows.push(("Sigma stays positive by", mapping));
        rows.push(("Sigma starts at", each(&blurred, |settings| settings.sigma_start.to_string())));
    }
    rows.push(("Time", TIME.to_owned()));
    let mut table = Table::new("", "", &[("", ""), ("", "")]).with_sentences();
    rows.into_iter()
        .for_each(|(what, value)| table.push([what.to_owned(), value].map(Cell::Text).into()));
    let mut section = Section::new("choices", "Every choice", "");
    section.push_table(table);
    section
}

const START: &str =
    "true vertices, each shifted by a uniform offset in [−½, ½]³, and uniform colours";
const POSES: &str = "a rotation uniform over all rotations, anew at each step; the target image is \
    rendered with it (5.2: one fixed pose)";
const VERTEX_ERROR: &str = "mean distance of the 8 vertices to their places, the least over the 24 \
    automorphisms of the triangulation: each of them gives the same images";
const CAMERA: &str = "3.5 from the cube’s centre, half-width 0.4 at distance 1; pictures here are \
    all from the pose of 5.2";
const TIME: &str = "wall clock from the start of a fit, all included: poses, target images, \
    updates, and measuring the errors; ms per step: forward, backward and optimizer of the learnt \
    image, median over a fit";

/// What `what` says of each group, once.
fn each(groups: &[&Group], what: impl Fn(&CubeSettings) -> String) -> String {
    let mut words: Vec<String> = Vec::new();
    for word in groups.iter().map(|group| what(&group.settings)) {
        if !words.contains(&word) {
            words.push(word);
        }
    }
    words.join("; ")
}

/// Which seeds were run.
fn seeds(groups: &[&Group]) -> String {
    let all = || groups.iter().flat_map(|group| &group.fits).map(|fit| fit.settings.seed);
    let seeds = match (all().min(), all().max()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
        (least, _) => least.map(|seed| seed.to_string()).unwrap_or_default(),
    };
    format!("{seeds}; a seed gives the same fit, bit for bit, with any number of threads")
}

/// Learning rates and their schedule, in words.
fn rates(settings: &CubeSettings) -> String {
    let rates = settings.learning_rates();
    let (v, c, s) = (rates.vertices, rates.colors, rates.sigma);
    let rates = match settings.experiment {
        Experiment::Vertices => format!("vertices {v}, colours {c}"),
        Experiment::Sigma => format!("sigma {s}"),
        Experiment::Joint => format!("vertices {v}, colours {c}, sigma {s}"),
    };
    let number = super::panels::number(settings.experiment);
    format!("{number} {}: {rates}, {}", settings.preset, schedule(settings.rate_schedule()))
}

/// How rates change, in words.
fn schedule(schedule: Schedule) -> String {
    match schedule {
        Schedule::Constant => "constant".to_owned(),
        Schedule::Cosine { steps, floor } => {
            let steps = grouped(steps as f64);
            format!("down to {floor} of that along half a cosine of {steps} steps")
        }
        Schedule::Polynomial { steps, power } => {
            let steps = grouped(steps as f64);
            format!("times (1 − step/{steps}) to the power {power}, down to 0")
        }
        other => format!("{other:?}"),
    }
}

/// An optimizer, in words.
fn optimizer(optimizer: Optimizer) -> String {
    match optimizer {
        Optimizer::Adam { beta1, beta2, epsilon } => {
            format!("Adam, β₁ = {beta1}, β₂ = {beta2}, ε = {epsilon:e}")
        }
        Optimizer::AmsGrad { beta1, beta2, epsilon } => {
            format!("AMSGrad, β₁ = {beta1}, β₂ = {beta2}, ε = {epsilon:e}")
        }
        Optimizer::GradientDescent => "gradient descent".to_owned(),
        other => format!("{other:?}"),
    }
}

/// The blur's window, in words.
fn radius(settings: &CubeSettings) -> String {
    let sigma = settings.sigma_target;
    match settings.blur_radius() {
        Radius::Fixed(radius) => {
            format!("{radius} px to either side for σ = {sigma}, fixed during a fit")
        }
        Radius::Tolerance(_) if settings.kernel == Kernel::Disc => "the whole disc".to_owned(),
        Radius::Tolerance(share) => format!("for σ = {sigma}, what misses {share:e} of the weight"),
    }
}
