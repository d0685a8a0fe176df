//! The report's tables: error beside time, stuck fits, every fit.

use std::fmt::Write as _;

use bokashi_report::{ReportError, digits, escaped, plain};

use super::digest::{Fit, Group};
use super::gallery;
use crate::{self as scenes, CubeSettings, Experiment, FACES, STUCK, Silhouettes, VERTEX_COUNT};

/// How many stuck fits are shown as pictures; beyond, they are in the table of all fits.
const MOST_PICTURES: usize = 24;

/// Milliseconds per step on an NVIDIA RTX 3060 Ti, as the paper prints them.
fn paper_ms(settings: &CubeSettings) -> Option<&'static str> {
    if settings.resolution != 32 {
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

/// One row per group: time per step beside the error that it buys, and the paper's time.
pub(crate) fn speed(groups: &[&Group]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\"><table class=\"wide\"><thead>\
         <tr><th rowspan=2>Fit<th rowspan=2>seeds<th rowspan=2>stuck\
         <th colspan=3>ms per step<th rowspan=2>seconds<br>per fit\
         <th colspan=4>error at the end, median\
         <tr><th class=\"first\">ours<th>target<br>image<th>paper’s<br>GPU\
         <th class=\"first\">vertices<th>vertices,<br>last tenth<th>colours<th>sigma\
         </thead><tbody>",
    );
    let mut experiment = None;
    for group in groups {
        if experiment.replace(group.settings.experiment) != Some(group.settings.experiment) {
            let heading = super::panels::heading(group.settings.experiment);
            let _ = write!(html, "<tr class=\"part\"><th colspan=11>{heading}");
        }
        let middle = |number: &dyn Fn(&Fit) -> Option<f64>| {
            let applies = group.fits.iter().any(|fit| number(fit).is_some());
            applies.then(|| group.quartiles(number)[1])
        };
        let median = |number: &dyn Fn(&Fit) -> Option<f64>| digits(middle(number));
        let time = |number: &dyn Fn(&Fit) -> Option<f64>| plain(middle(number));
        let stuck = group.fits.iter().filter(|fit| fit.is_stuck()).count();
        let stuck = match (group.settings.experiment, stuck) {
            (Experiment::Sigma, _) => "–".to_owned(),
            (_, 0) => "0".to_owned(),
            (_, count) => format!("<span class=\"stuck\">{count}</span>"),
        };
        let ours = time(&|fit| fit.outcome.ms_per_step_median);
        let target = match group.settings.experiment {
            Experiment::Sigma => "once".to_owned(),
            _ => time(&|fit| fit.outcome.target_ms_per_step_median),
        };
        let seconds = time(&|fit| Some(fit.outcome.wall_seconds));
        let errors = [
            median(&|fit| fit.outcome.vertex_error_final),
            median(&|fit| fit.outcome.vertex_error_tail),
            median(&|fit| fit.outcome.color_error_final),
            median(&Fit::sigma_error),
        ];
        let _ = write!(
            html,
            "<tr><th>{}<td>{}<td>{stuck}<td class=\"first ours\">{ours}<td>{target}<td>{}\
             <td>{seconds}<td class=\"first\">{}",
            escaped(&group.name()),
            group.fits.len(),
            paper_ms(&group.settings).unwrap_or("–"),
            errors.join("<td>"),
        );
    }
    html.push_str("</tbody></table></div>");
    html
}

/// How far each vertex ended from its place, under the automorphism that fits best.
fn distances(fit: &Fit) -> Option<[f64; VERTEX_COUNT]> {
    let last = fit.snapshots.last()?;
    let truth = scenes::truth(None);
    let (learnt, truth) = (last.vertices.data(), truth.vertices.data());
    let away = |v: usize, place: usize| {
        (0..3).map(|k| (learnt[3 * v + k] - truth[3 * place + k]).powi(2)).sum::<f64>().sqrt()
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

/// The fits that did not find the cube, with pictures; `None` where all did.
pub(crate) fn stuck(groups: &[&Group]) -> Result<Option<String>, ReportError> {
    let fits = || groups.iter().flat_map(|group| group.fits.iter().map(move |fit| (group, fit)));
    // Nothing holds a aliased silhouette: none finds the cube, and the gallery and the table of all
    // fits say so.
    let fits = || fits().filter(|(_, fit)| fit.settings.silhouettes != Silhouettes::Aliased);
    let stuck: Vec<_> = fits().filter(|(_, fit)| fit.is_stuck()).collect();
    let all = fits().filter(|(_, fit)| fit.main_error().is_some());
    let all = all.filter(|(_, fit)| fit.settings.experiment != Experiment::Sigma).count();
    if stuck.is_empty() {
        return Ok(None);
    }
    let mut html = format!(
        "<p>{} of the {all} fits that learn vertices, those with aliased silhouettes aside, end \
         more than {STUCK} from the cube, and they are in every number of this report. Each is \
         shown at its end: white the learnt wireframe, yellow the true one.",
        stuck.len()
    );
    if stuck.len() > MOST_PICTURES {
        let _ = write!(html, " The first {MOST_PICTURES} are shown here.");
    }
    html.push_str("</p><div class=\"cards\">");
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
    html.push_str("</div>");
    Ok(Some(html))
}

/// Fits that ended in an error.
pub(crate) fn failures(failures: &[(CubeSettings, String)]) -> String {
    let mut html = String::from("<ul>");
    for (settings, error) in failures {
        let CubeSettings { experiment, preset, resolution, sigma_target, seed, .. } = settings;
        let error = escaped(error);
        let _ = write!(
            html,
            "<li>{experiment}, {preset}, {resolution} px, σ = {sigma_target}, seed {seed}: {error}"
        );
    }
    html.push_str("</ul>");
    html
}

/// Every fit: one folded table per group, or per experiment where each group is a single fit.
pub(crate) fn every_fit(groups: &[&Group]) -> String {
    let single = groups.iter().all(|group| group.fits.len() == 1);
    let mut html = String::new();
    let together =
        |a: &&Group, b: &&Group| single && a.settings.experiment == b.settings.experiment;
    for groups in groups.chunk_by(together) {
        let heading = super::panels::heading(groups[0].settings.experiment);
        let rows: Vec<(String, &Fit)> = if single {
            let name = |group: &Group| format!("{}, seed {}", group.name(), group.settings.seed);
            groups.iter().map(|group| (name(group), &group.fits[0])).collect()
        } else {
            let fits = groups.iter().flat_map(|group| &group.fits);
            fits.map(|fit| (fit.settings.seed.to_string(), fit)).collect()
        };
        let title = if single {
            heading.to_owned()
        } else {
            format!("{heading}: {} <small>{} fits</small>", groups[0].name(), rows.len())
        };
        let open = if single { " open" } else { "" };
        let _ = write!(
            html,
            "<details{open}><summary>{title}</summary>\
             <div class=\"scroll\"><table><thead><tr><th>{}<th>vertex error<br>at the end\
             <th>at the<br>start<th>largest of<br>last tenth<th>own vertex<br>to own place\
             <th>colour<br>error<th>sigma<th>sigma<br>error<th>loss<br>first<th>loss<br>last\
             <th>ms per<br>step<th>seconds<th></thead><tbody>",
            if single { "fit" } else { "seed" },
        );
        for (name, fit) in rows {
            let _ = write!(html, "<tr><th>{}{}", escaped(&name), numbers(fit));
        }
        html.push_str("</tbody></table></div></details>");
    }
    html
}

/// The cells of one fit.
fn numbers(fit: &Fit) -> String {
    let outcome = &fit.outcome;
    let numbers = [
        outcome.vertex_error_final,
        outcome.vertex_error_initial,
        outcome.vertex_error_tail,
        outcome.vertex_error_plain,
        outcome.color_error_final,
        outcome.sigma_final,
        fit.sigma_error(),
        Some(outcome.loss_initial),
        Some(outcome.loss_final),
    ];
    let times = [outcome.ms_per_step_median, Some(outcome.wall_seconds)];
    let mark = if fit.is_stuck() { "<span class=\"stuck\">stuck</span>" } else { "" };
    let (numbers, times) = (numbers.map(digits).join("<td>"), times.map(plain).join("<td>"));
    format!("<td>{numbers}<td>{times}<td>{mark}")
}
