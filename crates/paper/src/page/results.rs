//! The report's tables: error beside time, stuck fits, every fit.

use std::fmt::Write as _;

use bokashi_render_ops::Kernel;
use bokashi_report::{Cell, ReportError, Section, Table, digits, escaped};

use super::digest::{Fit, Group};
use super::gallery;
use super::table::NUMBERS;
use crate::{self as scenes, CubeSettings, Experiment, FACES, STUCK, Silhouettes, VERTEX_COUNT};

/// How many stuck fits are shown as pictures; beyond, they are in the table of all fits.
const MOST_PICTURES: usize = 24;

/// Milliseconds per step on an NVIDIA RTX 3060 Ti, as the paper prints them.
fn paper_ms(settings: &CubeSettings) -> Option<&'static str> {
    if settings.resolution != 32 || settings.kernel == Kernel::Disc {
        return None;
    }
    match (settings.experiment, settings.sigma_target, settings.silhouettes) {
        (Experiment::Vertices, _, Silhouettes::Aliased) => Some("1.4"),
        (Experiment::Vertices, _, Silhouettes::Antialias) => Some("2.0"),
        (Experiment::Sigma, 1.0, Silhouettes::Antialias) => Some("1.7"),
        (Experiment::Sigma, 4.0, Silhouettes::Antialias) => Some("2.4"),
        (Experiment::Joint, 1.0, Silhouettes::Antialias) => Some("1.7"),
        (Experiment::Joint, 4.0, Silhouettes::Antialias) => Some("2.9"),
        _ => None,
    }
}

/// Time per step beside the error that it buys, and the paper's time: one row per group.
pub(crate) fn speed(groups: &[&Group]) -> Section {
    let columns = [
        "Fit",
        "seeds",
        "stuck",
        "ours",
        "target image",
        "paper’s GPU",
        "seconds per fit",
        "vertices",
        "vertices, last tenth",
        "colours",
        "sigma",
    ];
    let mut table = Table::new("", "", &columns.map(|title| (title, ""))).with_groups(&[
        ("", 3),
        ("ms per step", 3),
        ("", 1),
        ("error at the end, median", 4),
    ]);
    for part in groups.chunk_by(|a, b| a.settings.experiment == b.settings.experiment) {
        table.push_part(super::panels::heading(part[0].settings.experiment));
        part.iter().for_each(|group| table.push(speed_row(group)));
    }
    let note = format!(
        "Medians over seeds of medians over steps: forward, backward and optimizer of the learnt image; \
         rendering the target of a new pose is apart, under “target image”. Paper’s GPU: an NVIDIA RTX 3060 \
         Ti, as printed. Last tenth: the largest error within the last tenth of a run, since Adam at a \
         constant rate can jump back after it has converged. Stuck: ended farther than {STUCK} from the cube."
    );
    let mut section = Section::new("speed", "Time per step, and the error it buys", note);
    section.push_table(table);
    section
}

fn speed_row(group: &Group) -> Vec<Cell> {
    let median = |number: &dyn Fn(&Fit) -> Option<f64>| {
        bokashi_report::median(group.fits.iter().filter_map(number))
    };
    let is_of_sigma = group.settings.experiment == Experiment::Sigma;
    vec![
        Cell::text(group.name()),
        Cell::Count(group.fits.len()),
        match group.fits.iter().filter(|fit| fit.is_stuck()).count() {
            _ if is_of_sigma => Cell::Nothing,
            0 => Cell::Count(0),
            count => Cell::Count(count).flagged(),
        },
        Cell::maybe_time(median(&|fit| fit.outcome.ms_per_step_median)).strong(),
        match is_of_sigma {
            true => Cell::text("once"),
            false => Cell::maybe_time(median(&|fit| fit.outcome.target_ms_per_step_median)),
        },
        paper_ms(&group.settings).map_or(Cell::Nothing, Cell::text),
        Cell::maybe_time(median(&|fit| Some(fit.outcome.wall_seconds))),
        Cell::maybe(median(&|fit| fit.outcome.vertex_error_final)),
        Cell::maybe(median(&|fit| fit.outcome.vertex_error_tail)),
        Cell::maybe(median(&|fit| fit.outcome.color_error_final)),
        Cell::maybe(median(&Fit::sigma_error)),
    ]
}

/// The same in few columns, for a terminal.
pub(crate) fn summary(groups: &[&Group]) -> Table {
    const COLUMNS: [(&str, usize); 6] = [
        ("seeds", 1),
        ("vertices", 7),
        ("sigma", 10),
        ("colours", 9),
        ("ms/step", 3),
        ("seconds", 6),
    ];
    let columns = COLUMNS.map(|(title, _)| (title, ""));
    let mut table = Table::new("", "", &[&[("error at the end of", "")][..], &columns].concat());
    for group in groups {
        let row = speed_row(group);
        let number = super::panels::number(group.settings.experiment);
        let name = Cell::text(format!("{number} {}", group.name()));
        let numbers = COLUMNS.map(|(_, column)| row[column].clone());
        table.push(std::iter::once(name).chain(numbers).collect());
    }
    table
}

/// How far each vertex ended from its place, under the automorphism that fits best.
fn distances(fit: &Fit) -> Option<[f64; VERTEX_COUNT]> {
    let last = fit.snapshots.last()?;
    let truth = scenes::truth(None);
    let (learnt, truth) = (last.vertices.data(), truth.vertices.data());
    let away = |v: usize, corner: usize| {
        (0..3).map(|k| (learnt[3 * v + k] - truth[3 * corner + k]).powi(2)).sum::<f64>().sqrt()
    };
    let all = scenes::automorphisms(&FACES, VERTEX_COUNT);
    let all = all.iter().map(|places| std::array::from_fn(|v| away(v, places[v])));
    all.min_by(|a: &[f64; VERTEX_COUNT], b| a.iter().sum::<f64>().total_cmp(&b.iter().sum::<f64>()))
}

/// What holds a stuck fit, in words.
fn diagnosis(fit: &Fit) -> String {
    let Some(away) = distances(fit) else { return String::new() };
    let far = away.iter().filter(|&&distance| distance.is_nan() || distance > STUCK).count();
    let most = away.iter().copied().fold(0.0, f64::max);
    format!("{far} of {VERTEX_COUNT} vertices away from their places, the farthest by {most:.2}")
}

/// The fits that did not find the cube, with pictures; nothing where all did.
pub(crate) fn stuck(groups: &[&Group]) -> Result<Section, ReportError> {
    let mut section = Section::new("stuck", "Fits that are stuck", "");
    let fits = || groups.iter().flat_map(|group| group.fits.iter().map(move |fit| (group, fit)));
    // Nothing holds an aliased silhouette: none finds the cube, and the gallery and the table of all
    // fits say so.
    let fits = || fits().filter(|(_, fit)| fit.settings.silhouettes != Silhouettes::Aliased);
    let stuck: Vec<_> = fits().filter(|(_, fit)| fit.is_stuck()).collect();
    let all = fits().filter(|(_, fit)| fit.main_error().is_some());
    let all = all.filter(|(_, fit)| fit.settings.experiment != Experiment::Sigma).count();
    if stuck.is_empty() {
        return Ok(section);
    }
    section.note = format!(
        "{} of the {all} fits that learn vertices, those with aliased silhouettes aside, end more than \
         {STUCK} from the cube, and they are in every number of this report. Each is shown at its end: \
         white the learnt wireframe, yellow the true one.",
        stuck.len()
    );
    if stuck.len() > MOST_PICTURES {
        section.note.push_str(&format!(" The first {MOST_PICTURES} are shown here."));
    }
    let mut html = String::from("<div class=\"cards\">");
    for (group, fit) in stuck.iter().take(MOST_PICTURES) {
        let picture = gallery::last_of(fit)?.unwrap_or_default();
        let outcome = &fit.outcome;
        let _ = write!(
            html,
            "<figure>{picture}<figcaption><b>{}, seed {}</b><br>vertex error {}, last tenth at \
             most {}, loss {}. {}.</figcaption></figure>",
            escaped(&group.name()),
            outcome.seed,
            digits(outcome.vertex_error_final),
            digits(outcome.vertex_error_tail),
            digits(Some(outcome.loss_final)),
            diagnosis(fit),
        );
    }
    section.push_html(html + "</div>");
    Ok(section)
}

/// Fits that ended in an error.
pub(crate) fn failures(failures: &[(CubeSettings, String)]) -> Section {
    let mut section = Section::new("failures", "Fits that ended in an error", "");
    for (settings, error) in failures {
        let CubeSettings { experiment, preset, resolution, sigma_target, seed, .. } = settings;
        section.push_failure(format!(
            "{experiment}, {preset}, {resolution} px, σ = {sigma_target}, seed {seed}: {error}"
        ));
    }
    section
}

/// Every fit: one folded table per group, or one in plain sight per experiment where each group is a single
/// fit.
pub(crate) fn every_fit(groups: &[&Group]) -> Section {
    let note = "Without renaming: the vertex error without automorphisms; it is about \
                1 where a fit found the cube with its corners renamed, which no picture can tell.";
    let mut section = Section::new("fits", "Every fit", note);
    let single = groups.iter().all(|group| group.fits.len() == 1);
    let together =
        |a: &&Group, b: &&Group| single && a.settings.experiment == b.settings.experiment;
    let first = if single { "fit" } else { "seed" };
    let columns = NUMBERS.map(|number| number.0);
    let columns = [&[(first, first)][..], &columns, &[("", "stuck")]].concat();
    for groups in groups.chunk_by(together) {
        let heading = super::panels::heading(groups[0].settings.experiment);
        let mut table = Table::new("", heading, &columns);
        if !single {
            let (name, count) = (groups[0].name(), groups[0].fits.len());
            table.title = format!("{heading}: {name}, {count} fits");
            table = table.not_printed();
        }
        for (group, fit) in
            groups.iter().flat_map(|group| group.fits.iter().map(move |fit| (group, fit)))
        {
            let seed = fit.settings.seed;
            let name =
                if single { format!("{}, seed {seed}", group.name()) } else { seed.to_string() };
            let numbers = NUMBERS.iter().map(|(_, number)| number(fit));
            let mark = Cell::text(if fit.is_stuck() { "stuck" } else { "" }).flagged();
            table.push(std::iter::once(Cell::text(name)).chain(numbers).chain([mark]).collect());
        }
        section.push_table(table);
    }
    section
}
