//! What notebooks show: meshes to turn, and fits.

use bokashi_report::{
    Captioned, Cell, Curve, Figure, Figures, ReportError, Scale, Section, Stroke, Table,
    ViewerMesh, data_uri, digits, escaped, framed, viewer,
};
use bokashi_scene as scene;
use bokashi_scene::ViewComparison;
use pyo3::prelude::*;

use crate::array::Array;
use crate::error::{Refusal, RenderError};
use crate::mesh::Mesh;

/// Views that a fit shows at most: each is drawn anew.
const MOST_VIEWS: usize = 4;

/// Points of a curve at most, more than can be told apart.
const MOST_POINTS: usize = 400;

/// Rows `[V, 3]`, or with one column grey, as numbers of the viewer.
fn rows(what: &str, array: &Array<'_>) -> PyResult<Vec<[f32; 3]>> {
    let (shape, entries) = array.constant()?;
    let row = |row: &[f64; 3]| row.map(|x| x as f32);
    match shape {
        [_, 3] => Ok(entries.as_chunks::<3>().0.iter().map(row).collect()),
        [_, 1] if what == "colors" => Ok(entries.iter().map(|&grey| [grey as f32; 3]).collect()),
        _ => {
            Err(RenderError::new_err(format!("{what} of a view need shape [V, 3], got {shape:?}")))
        }
    }
}

/// A mesh that a reader turns, as HTML: positions `[V, 3]`, and colours `[V, 3]` or `[V, 1]` as pixels stand for them.
#[pyfunction]
#[pyo3(signature = (positions, mesh, colors=None, caption=""))]
pub fn mesh_page(
    positions: Array<'_>,
    mesh: &Mesh,
    colors: Option<Array<'_>>,
    caption: &str,
) -> PyResult<String> {
    let positions = rows("positions", &positions)?;
    if positions.len() != mesh.0.vertex_count() {
        let (expected, given) = (mesh.0.vertex_count(), positions.len());
        return Err(RenderError::new_err(format!(
            "a view needs a position for each of {expected} vertices, got {given}"
        )));
    }
    if let Some(vertex) = positions.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
        let [x, y, z] = positions[vertex];
        return Err(RenderError::new_err(format!(
            "positions of a view need to be finite, got ({x}, {y}, {z}) at vertex {vertex}"
        )));
    }
    let colors = colors.map(|colors| rows("colors", &colors)).transpose()?;
    let mut transform = [0.0; 16];
    (0..4).for_each(|k| transform[5 * k] = 1.0);
    let shown = ViewerMesh {
        positions: &positions,
        faces: mesh.0.faces(),
        colors: colors.as_deref(),
        texture: None,
        transform,
    };
    let caption = if caption.is_empty() { "A mesh" } else { caption };
    let page = || {
        let mut section = Section::new("mesh", "", "");
        section.push_html(viewer(&[shown], caption)?);
        framed(caption, &[section], 640)
    };
    Ok(page().map_err(refused)?)
}

fn refused(error: ReportError) -> Refusal {
    RenderError::new_err(error.to_string()).into()
}

/// The losses over the steps. Of many steps each point stands for some: their range is a band.
fn curve(losses: &[f64]) -> Figure {
    let per_point = losses.len().div_ceil(MOST_POINTS).max(1);
    let points = losses.chunks(per_point).enumerate().map(|(k, losses)| {
        let (low, high) = losses
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
        let last = *losses.last().expect("no chunk is empty");
        [(k * per_point + losses.len()) as f64, low, last, high]
    });
    // Where a loss becomes zero it lies on the end of its axis.
    let has_ratios = losses.iter().all(|&loss| loss >= 0.0) && losses[0] > 0.0;
    let y = if has_ratios { Scale::Logarithmic } else { Scale::Linear };
    let curve = Curve::new(0, Stroke::Solid, points.collect());
    Figure::new("Loss before each step", (Scale::Linear, "step"), y, [curve])
}

/// What is said of a fit, and its curve.
fn loss_section(words: &str, losses: &[f64]) -> Section {
    let mut section = Section::new("loss", "", "");
    section.push_html(format!("<p>{}</p>", escaped(words)));
    // A single point is no curve.
    if losses.len() > 1 {
        section.push_figures(Figures::new([curve(losses)], []));
    }
    section
}

/// Name, shape, and the numbers or their range.
fn parameters_section(parameters: &[(String, Array<'_>)]) -> PyResult<Section> {
    let mut table = Table::new("", "", &["parameter", "shape", "numbers"].map(|title| (title, "")));
    for (name, array) in parameters {
        let (shape, numbers) = array.constant()?;
        let words = match numbers[..] {
            [] => String::new(),
            ref few if few.len() <= 6 => {
                few.iter().map(|&x| digits(Some(x))).collect::<Vec<_>>().join(", ")
            }
            ref many => {
                let low = many.iter().copied().fold(f64::INFINITY, f64::min);
                let high = many.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                format!("{} to {}", digits(Some(low)), digits(Some(high)))
            }
        };
        table.push([name.clone(), format!("{shape:?}"), words].map(Cell::Text).into());
    }
    let mut section = Section::new("learnt", "", "");
    section.push_table(table);
    Ok(section)
}

/// A fit of a function, as HTML: a curve of losses, and the parameters.
#[pyfunction]
pub fn learning_page(
    words: &str,
    losses: Vec<f64>,
    parameters: Vec<(String, Array<'_>)>,
) -> PyResult<String> {
    let sections = [loss_section(words, &losses), parameters_section(&parameters)?];
    Ok(framed("A fit", &sections, 480).map_err(refused)?)
}

/// What a view shows: the result beside the target.
fn push_view(
    section: &mut Section,
    scene: &scene::Scene,
    compared: &ViewComparison,
) -> Result<(), Refusal> {
    let view = &scene.views[compared.score.view];
    let captioned = |what: &str, image| {
        Ok::<_, Refusal>(Captioned {
            address: data_uri(&scene.png_of(image)?),
            caption: what.to_owned(),
            spoken: format!("{what} of {}", view.name),
            is_linked: false,
        })
    };
    let mut pictures = vec![captioned("result", &compared.image)?];
    pictures
        .extend(compared.target.as_ref().map(|target| captioned("target", target)).transpose()?);
    section.push_pictures(&view.name, pictures);
    Ok(())
}

/// A fit of a scene, as HTML: a curve of losses, and of some views the scores and the pictures. Views that are held out
/// come first.
pub fn fit_page(words: &str, losses: &[f64], fit: &scene::SceneFit) -> Result<String, Refusal> {
    let scene = fit.scene();
    let mut views: Vec<usize> = (0..scene.views.len()).collect();
    views.sort_by_key(|&view| !scene.views[view].held_out);
    let columns = ["view", "PSNR in dB", "SSIM", "silhouette IoU"].map(|title| (title, ""));
    let (mut table, mut pictures) = (Table::new("", "", &columns), Section::new("views", "", ""));
    for &view in views.iter().take(MOST_VIEWS) {
        let compared = fit.compare(view)?;
        let held_out = if scene.views[view].held_out { ", held out" } else { "" };
        let numbers = [compared.score.psnr, compared.score.ssim, compared.score.silhouette_iou];
        let name = Cell::text(format!("{}{held_out}", scene.views[view].name));
        table.push(std::iter::once(name).chain(numbers.map(Cell::maybe)).collect());
        push_view(&mut pictures, scene, &compared)?;
    }
    let mut scores = Section::new("scores", "", "");
    scores.push_table(table);
    if views.len() > MOST_VIEWS {
        scores.push_html(format!("<p>{MOST_VIEWS} of {} views.</p>", views.len()));
    }
    framed("A fit", &[loss_section(words, losses), scores, pictures], 900).map_err(refused)
}
