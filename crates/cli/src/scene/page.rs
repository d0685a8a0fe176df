//! The report of a fit of a scene: error against run time first.

use std::fmt::Write as _;

use bokashi_report::{
    Curve, Document, Figure, Panel, ReportError, SIZES, Scale, Section, Stroke, escaped, row,
};
use bokashi_scene::SceneFit;

use super::outcome::Outcome;
use super::pictures::{GAIN, KINDS, VIEWS, file_name};
use crate::about::footer;

/// The name of the page.
pub(super) const PAGE: &str = "index.html";

/// Curves over the seconds of a fit.
#[derive(Debug, Default)]
pub(super) struct Curves {
    pub(super) losses: Vec<(f64, f64)>,
    pub(super) held_out: Vec<(f64, f64)>,
}

/// The page. `viewer` is a block that turns the learnt mesh.
pub(super) fn render(
    fit: &SceneFit,
    outcome: &Outcome,
    curves: &Curves,
    viewer: Option<String>,
) -> Result<String, ReportError> {
    let mut sections =
        vec![Section { id: "error", title: "Error against run time", body: row(&panels(curves))? }];
    sections.push(Section { id: "views", title: "Views", body: views(fit, outcome) });
    if let Some(body) = viewer {
        sections.push(Section { id: "mesh", title: "The learnt mesh", body });
    }
    sections.push(Section { id: "learnt", title: "What was learnt", body: learnt(fit, outcome) });
    sections.push(Section { id: "left-out", title: "What was left out", body: left_out(outcome) });
    let name = fit.scene().path.display().to_string();
    let held_out = outcome.psnr_held_out(fit).map_or(String::new(), |psnr| {
        format!(" Views that were never learnt from are matched to {psnr:.1} dB.")
    });
    let document = Document {
        title: format!("Bokashi: {name}"),
        heading: name,
        introduction: format!("{}.{held_out}{}", outcome.message(), remarks(fit, outcome)),
        sections,
        footer: footer(),
    };
    Ok(document.html())
}

/// What else to know of the fit, as HTML after a sentence.
fn remarks(fit: &SceneFit, outcome: &Outcome) -> String {
    let ended = fit.ended().map(|rule| format!("It ended by a rule: {rule}."));
    let held_out = outcome.held_out_in_words(fit).map(str::to_owned);
    let all = [ended, outcome.fell_in_words(), outcome.worst_in_words(fit), held_out].into_iter();
    all.flatten().map(|words| format!(" {}", escaped(&words))).collect()
}

fn panels(curves: &Curves) -> Vec<Panel> {
    let panel = |title: &str, y: Scale, points: &[(f64, f64)]| Panel {
        title: title.to_owned(),
        figure: Figure {
            x: Scale::Seconds,
            y,
            x_title: "wall-clock time",
            size: SIZES[0],
            spoken: format!("{title} against wall-clock time."),
            curves: vec![Curve {
                color: 0,
                stroke: Stroke::Solid,
                dots: false,
                points: points.iter().map(|&(x, y)| [x, y, y, y]).collect(),
            }],
            marks: Vec::new(),
        },
    };
    let all = [
        panel("PSNR of held-out views, in dB", Scale::Linear, &curves.held_out),
        panel("Loss", Scale::Logarithmic, &curves.losses),
    ];
    all.into_iter().filter(|panel| !panel.figure.is_empty()).collect()
}

/// Held-out views first, each with its figures and pictures.
fn views(fit: &SceneFit, outcome: &Outcome) -> String {
    let mut html = format!(
        "<p>Results, targets, and differences {GAIN} times as large: grey where both agree. Views that are \
         held out come first.</p>"
    );
    let scene = fit.scene();
    let mut all: Vec<_> = outcome.scores.iter().collect();
    all.sort_by_key(|score| !scene.views[score.view].held_out);
    for score in all {
        let view = &scene.views[score.view];
        let name = escaped(&view.name);
        let mut said = format!("{name}{}", if view.held_out { ", held out" } else { "" });
        // Writing to a string cannot fail.
        if let Some(psnr) = score.psnr {
            let _ = write!(said, ": {psnr:.1} dB");
        }
        if let Some(ssim) = score.ssim {
            let _ = write!(said, ", SSIM {ssim:.4}");
        }
        if let Some(iou) = score.silhouette_iou {
            let _ = write!(said, ", IoU {iou:.4}");
        }
        let _ = write!(html, "<h3>{said}</h3><div class=\"film\">");
        let count = if view.image.is_some() { KINDS.len() } else { 1 };
        for what in &KINDS[..count] {
            let address = format!("{VIEWS}/{}", address(&file_name(&view.name, what)));
            let _ = write!(
                html,
                "<figure><a href=\"{address}\"><img class=\"seen\" height=\"192\" loading=\"lazy\" \
                 src=\"{address}\" alt=\"{what} of {name}\"></a><figcaption>{what}</figcaption></figure>"
            );
        }
        html.push_str("</div>");
    }
    html
}

/// A file's name in an address.
fn address(name: &str) -> String {
    let bytes = name.bytes().map(|byte| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
            char::from(byte).to_string()
        }
        other => format!("%{other:02X}"),
    });
    bytes.collect()
}

fn learnt(fit: &SceneFit, outcome: &Outcome) -> String {
    let mut html = String::from(
        "<div class=\"scroll\"><table><thead><tr><th class=\"words\">parameter</th>\
         <th class=\"words\">shape</th><th class=\"words\">first</th><th class=\"words\">last</th></tr></thead>\
         <tbody>",
    );
    for ((name, first), last) in outcome.first.iter().zip(fit.parameters().iter()) {
        let last = last.value();
        let numbers = |tensor: &bokashi_scene::Tensor<f32>| match tensor.size() {
            0..=6 => {
                let all = tensor.data().iter().map(|x| format!("{x:.4}"));
                all.collect::<Vec<_>>().join(", ")
            }
            size => format!("{size} numbers"),
        };
        let (name, shape) = (escaped(name), last.shape());
        let _ = write!(
            html,
            "<tr><th class=\"words\">{name}</th><td class=\"words\">{shape}</td><td class=\"words\">{}</td>\
             <td class=\"words\">{}</td></tr>",
            numbers(first),
            numbers(&last)
        );
    }
    html.push_str(
        "</tbody></table></div><p><code>mesh.glb</code> stands in the world. A <code>.ply</code> has its mesh's \
         own coordinates: <code>places</code> in <code>numbers.json</code> are the matrices that bring it there.</p>",
    );
    html
}

fn left_out(outcome: &Outcome) -> String {
    if outcome.left_out.is_empty() {
        return "<p>Nothing: all that the scene names is needed.</p>".to_owned();
    }
    let rows = outcome.left_out.iter().map(|(operation, reason)| {
        format!("<li><code>{operation}</code>: {}</li>", escaped(reason))
    });
    format!("<ul>{}</ul>", rows.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_addresses() {
        assert_eq!(address("IMG 1#ü?.png"), "IMG%201%23%C3%BC%3F.png");
    }
}
