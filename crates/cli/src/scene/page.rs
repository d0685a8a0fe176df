//! The report of a fit of a scene: error against run time first.

use bokashi_report::{
    Captioned, Cell, Curve, Document, Figure, Figures, Scale, Section, Stroke, Table,
};
use bokashi_scene::{SceneFit, Tensor};

use super::outcome::Outcome;
use super::pictures::{GAIN, KINDS, VIEWS, file_name};
use crate::about::about;

/// Curves over the seconds of a fit.
#[derive(Debug, Default)]
pub(super) struct Curves {
    pub(super) losses: Vec<(f64, f64)>,
    pub(super) held_out: Vec<(f64, f64)>,
}

/// The page. `film` is a block that shows the fit in motion, `turntable` one that goes around what was learnt, and
/// `viewer` one that turns the learnt mesh; or empty.
pub(super) fn page(
    fit: &SceneFit,
    outcome: &Outcome,
    curves: &Curves,
    [film, turntable, viewer]: [String; 3],
) -> Document {
    let mut motion = Section::new("film", "The fit in motion", "");
    motion.push_html(film);
    let mut mesh = Section::new("mesh", "The learnt mesh", "");
    mesh.push_html(turntable);
    mesh.push_html(viewer);
    let mut words = vec![format!("{}.", outcome.message())];
    words.extend(
        outcome
            .psnr_held_out(fit)
            .map(|psnr| format!("Views that were never learnt from are matched to {psnr:.1} dB.")),
    );
    words.extend(outcome.remarks(fit));
    Document {
        name: "index",
        heading: fit.scene().path.display().to_string(),
        introduction: words.join(" "),
        sections: vec![
            errors(fit, curves),
            motion,
            views(fit, outcome),
            mesh,
            learnt(fit, outcome),
            left_out(outcome),
        ],
        files: Vec::new(),
        about: about("bokashi"),
    }
}

fn errors(fit: &SceneFit, curves: &Curves) -> Section {
    let panel = |title: &str, y: Scale, points: &[(f64, f64)]| {
        let curve = Curve::line(0, Stroke::Solid, points.iter().copied());
        Figure::new(title, (Scale::Seconds, "wall-clock time"), y, [curve])
    };
    let held_out = match fit.aligned_views().next() {
        None => "PSNR of held-out views, in dB",
        Some(_) => "PSNR of held-out views before they were aligned, in dB",
    };
    let panels = [
        panel(held_out, Scale::Linear, &curves.held_out),
        panel("Loss", Scale::Logarithmic, &curves.losses),
    ];
    let mut section = Section::new("error", "Error against run time", "");
    section.push_figures(Figures::new(panels, []));
    section
}

/// Held-out views first, each with its figures and pictures.
fn views(fit: &SceneFit, outcome: &Outcome) -> Section {
    let note = format!(
        "Results, targets, and differences {GAIN} times as large: grey where both agree. Views that are \
         held out come first."
    );
    let mut section = Section::new("views", "Views", note);
    let scene = fit.scene();
    let mut all: Vec<_> = outcome.scores.iter().collect();
    all.sort_by_key(|score| !scene.views[score.view].held_out);
    for score in all {
        let view = &scene.views[score.view];
        let scores = [
            score.psnr.map(|psnr| format!("{psnr:.1} dB")),
            score.ssim.map(|ssim| format!("SSIM {ssim:.4}")),
            score.silhouette_iou.map(|iou| format!("IoU {iou:.4}")),
        ];
        let scores = scores.into_iter().flatten().collect::<Vec<_>>().join(", ");
        let held_out = match (view.held_out, score.psnr_before) {
            (true, Some(_)) => ", held out, aligned",
            (true, None) => ", held out",
            _ => "",
        };
        let colon = if scores.is_empty() { "" } else { ": " };
        let count = if view.image.is_some() { KINDS.len() } else { 1 };
        let pictures = KINDS[..count].iter().map(|what| Captioned {
            address: format!("{VIEWS}/{}", address(&file_name(&view.name, what))),
            caption: (*what).to_owned(),
            spoken: format!("{what} of {}", view.name),
            is_linked: true,
        });
        let heading = format!("{}{held_out}{colon}{scores}", view.name);
        section.push_pictures(&heading, pictures.collect());
    }
    section
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

fn learnt(fit: &SceneFit, outcome: &Outcome) -> Section {
    let numbers = |tensor: &Tensor<f32>| match tensor.size() {
        0..=6 => {
            let all = tensor.data().iter().map(|x| format!("{x:.4}"));
            all.collect::<Vec<_>>().join(", ")
        }
        size => format!("{size} numbers"),
    };
    let mut table =
        Table::new("", "", &["parameter", "shape", "first", "last"].map(|title| (title, "")));
    for parameter in fit.parameters().iter() {
        let (name, last) = (parameter.name(), parameter.value());
        let first = outcome.first.iter().find(|(own, _)| own == name);
        let first = first.map_or("made in the fit".to_owned(), |(_, first)| numbers(first));
        let words = [name.to_owned(), last.shape().to_string(), first, numbers(&last)];
        table.push(words.map(Cell::Text).into());
    }
    let mut section = Section::new("learnt", "What was learnt", "");
    section.push_table(table);
    section.push_html(
        "<p><code>mesh.glb</code>, <code>mesh.obj</code> and each <code>.ply</code> stand in the world. \
         <code>places</code> in <code>numbers.json</code> are the matrices that brought a mesh there from its own \
         coordinates.</p>",
    );
    section
}

fn left_out(outcome: &Outcome) -> Section {
    let mut section = Section::new("left-out", "What was left out", "");
    if outcome.left_out.is_empty() {
        section.push_html("<p>Nothing: all that the scene names is needed.</p>");
    }
    let mut table =
        Table::new("", "", &["operation", "why"].map(|title| (title, ""))).with_sentences();
    for (operation, reason) in &outcome.left_out {
        table.push([(*operation).to_owned(), reason.clone()].map(Cell::Text).into());
    }
    section.push_table(table);
    section
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_addresses() {
        assert_eq!(address("IMG 1#ü?.png"), "IMG%201%23%C3%BC%3F.png");
    }
}
