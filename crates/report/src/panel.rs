//! Panels side by side, and what a legend is made of.

use std::fmt::Write as _;

use crate::error::ReportError;
use crate::figure::{Figure, Stroke};
use crate::markup::escaped;

/// A figure with its heading.
#[derive(Debug, Clone)]
pub struct Panel {
    /// What is shown, with its unit.
    pub title: String,
    /// The panel.
    pub figure: Figure,
}

/// A stretch of line for a legend, as HTML.
pub fn legend_line(color: &str, stroke: Stroke) -> String {
    let dashes = match stroke {
        Stroke::Solid => "",
        Stroke::Dashed => " stroke-dasharray=\"7 4\"",
        Stroke::Dotted => " stroke-dasharray=\"0.5 4.5\"",
        Stroke::DashDotted => " stroke-dasharray=\"7 4.5 0.5 4.5\"",
    };
    format!(
        "<svg viewBox=\"0 0 34 10\" aria-hidden=\"true\"><line x1=\"2\" y1=\"5\" x2=\"32\" \
         y2=\"5\" stroke=\"{color}\" stroke-width=\"2.5\" stroke-linecap=\"round\"{dashes}/></svg>"
    )
}

/// Panels side by side, as HTML.
///
/// # Errors
/// [`ReportError::Figure`] where one can't be drawn.
pub fn row(panels: &[Panel]) -> Result<String, ReportError> {
    let class = if panels.len() == 3 { "panels three" } else { "panels" };
    let mut html = format!("<div class=\"{class}\">");
    for panel in panels {
        let (title, svg) = (escaped(&panel.title), panel.figure.svg()?);
        let _ = write!(html, "<figure><figcaption>{title}</figcaption>{svg}</figure>");
    }
    html.push_str("</div>");
    Ok(html)
}
