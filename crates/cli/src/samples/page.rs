//! The page of the samples: error against run time first, then figures and pictures.

use std::fmt::Write as _;

use bokashi_examples::Found;
use bokashi_report::{
    Curve, Document, Figure, Panel, ReportError, SIZES, Scale, Section, Stroke, data_uri, enlarged,
    escaped, picture_of, png, row,
};

use super::figures::Run;
use crate::about::footer;

/// The name of the page.
pub(super) const PAGE: &str = "samples.html";

/// The least height of a picture on the page.
const HEIGHT: u32 = 192;

/// The page of all runs.
pub(super) fn render(runs: &[Run]) -> Result<String, ReportError> {
    let mut sections = Vec::new();
    for group in runs.chunk_by(|a, b| a.sample.name == b.sample.name) {
        let sample = group[0].sample;
        let silhouettes = group[0].silhouettes;
        let about = escaped(sample.about);
        let mut body = format!("<p>It {about}. Silhouettes: {silhouettes}.</p>");
        body.push_str(&row(&panels(group))?);
        body.push_str(&table(group));
        body.push_str(&pictures(group)?);
        sections.push(Section { id: sample.name, title: sample.name, body });
    }
    let seeds = runs.iter().map(|run| run.seed);
    let (first, last) = (seeds.clone().min().unwrap_or(0), seeds.max().unwrap_or(0));
    let document = Document {
        title: "Bokashi: samples".to_owned(),
        heading: "Samples".to_owned(),
        introduction: format!(
            "<p>What people in this field run first, learnt from pictures: seeds {first} to {last}. \
             Each line of a figure is a run.</p>"
        ),
        sections,
        footer: footer(),
    };
    Ok(document.html())
}

/// A figure for each metric that was followed: its value against run time, a line per seed.
fn panels(runs: &[Run]) -> Vec<Panel> {
    let all = || runs.iter().flat_map(|run| run.result.iter().flatten());
    let mut metrics: Vec<&str> = Vec::new();
    for found in all().filter(|found| found.curve.len() > 1) {
        if !metrics.contains(&&*found.metric) {
            metrics.push(&found.metric);
        }
    }
    let panel = |metric: &str| {
        let of_metric = || all().filter(|found| found.metric == metric);
        let curves = of_metric().enumerate().map(|(k, found)| Curve {
            color: k,
            stroke: Stroke::Solid,
            dots: false,
            points: found
                .curve
                .iter()
                .map(|&(seconds, value)| [seconds, value, value, value])
                .collect(),
        });
        let positive = of_metric().flat_map(|found| &found.curve).all(|&(_, value)| value >= 0.0);
        let figure = Figure {
            x: Scale::Seconds,
            y: if positive && !metric.contains("PSNR") {
                Scale::Logarithmic
            } else {
                Scale::Linear
            },
            x_title: "wall-clock time",
            size: SIZES[0],
            spoken: format!("{metric} against wall-clock time."),
            curves: curves.collect(),
            marks: Vec::new(),
        };
        Panel { title: metric.to_owned(), figure }
    };
    metrics.into_iter().map(panel).filter(|panel| !panel.figure.is_empty()).collect()
}

fn table(runs: &[Run]) -> String {
    let head = "<div class=\"scroll\"><table><thead><tr><th>seed</th><th class=\"words\">figure</th>\
                <th>value</th><th class=\"words\">goal</th><th>steps</th><th>seconds</th></tr></thead><tbody>";
    let mut html = String::from(head);
    for run in runs {
        // Writing to a string cannot fail.
        let _ = match &run.result {
            Err(error) => write!(
                html,
                "<tr><th>{}</th><td class=\"words\" colspan=\"5\"><span class=\"stuck\">{}</span></td></tr>",
                run.seed,
                escaped(error)
            ),
            Ok(found) => found.iter().try_for_each(|found| write!(html, "{}", line(run, found))),
        };
    }
    html.push_str("</tbody></table></div>");
    html
}

fn line(run: &Run, found: &Found) -> String {
    let value = format!("{:.3e}", found.value);
    let value = match found.passes() {
        true => value,
        false => format!("<span class=\"stuck\">{value}</span>"),
    };
    format!(
        "<tr><th>{}</th><td class=\"words\">{}</td><td>{value}</td><td class=\"words\">{}</td><td>{}</td>\
         <td>{:.1}</td></tr>",
        run.seed,
        escaped(&found.metric),
        escaped(&found.goal.to_string()),
        found.steps,
        found.seconds
    )
}

/// The pictures of the first run that has any.
fn pictures(runs: &[Run]) -> Result<String, ReportError> {
    let all = |run: &Run| run.result.iter().flatten().any(|found| !found.pictures.is_empty());
    let Some(run) = runs.iter().find(|run| all(run)) else { return Ok(String::new()) };
    let mut html = String::from("<div class=\"film\">");
    for (name, image) in run.result.iter().flatten().flat_map(|found| &found.pictures) {
        let address = data_uri(&png(&enlarged(&picture_of(image)?, HEIGHT))?);
        let name = escaped(name);
        let _ = write!(
            html,
            "<figure><img class=\"seen\" height=\"{HEIGHT}\" src=\"{address}\" alt=\"{name}\">\
             <figcaption>{name}</figcaption></figure>"
        );
    }
    html.push_str("</div>");
    Ok(html)
}
