//! Figures side by side under one legend.

use std::fmt::Write as _;

use crate::error::ReportError;
use crate::figure::{Figure, SIZES, Stroke};
use crate::markup::{escaped, folded};

/// Panels under one legend.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Figures {
    /// What the panels have in common, where there are others.
    pub heading: Option<String>,
    /// Whether they are folded away under it.
    pub is_folded: bool,
    /// Name, colour and line.
    pub legend: Vec<(String, &'static str, Stroke)>,
    /// What else there is to say of all lines, as text at the end of the legend.
    pub remarks: Vec<String>,
    /// The panels; those without a line are left out.
    pub panels: Vec<Figure>,
}

impl Figures {
    /// Panels under a legend, without a heading.
    pub fn new(
        panels: impl IntoIterator<Item = Figure>,
        legend: impl IntoIterator<Item = (String, &'static str, Stroke)>,
    ) -> Self {
        let (panels, legend) = (panels.into_iter().collect(), legend.into_iter().collect());
        Self { panels, legend, ..Self::default() }
    }

    /// The same under a heading.
    #[must_use]
    pub fn with_heading(self, heading: impl Into<String>) -> Self {
        Self { heading: Some(heading.into()), ..self }
    }

    /// Whether no panel has a line.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().all(Figure::is_empty)
    }

    /// As HTML; nothing where there is nothing to draw.
    ///
    /// # Errors
    /// [`ReportError::Figure`] where one can't be drawn.
    pub(crate) fn html(&self) -> Result<String, ReportError> {
        let panels: Vec<_> = self.panels.iter().filter(|panel| !panel.is_empty()).collect();
        let mut html = String::new();
        if !self.legend.is_empty() && !panels.is_empty() {
            html.push_str("<ul class=\"legend\">");
            // Writing to a string cannot fail.
            for (name, color, stroke) in &self.legend {
                let _ = write!(html, "<li>{}{}", legend_line(color, *stroke), escaped(name));
            }
            for remark in &self.remarks {
                let _ = write!(html, "<li class=\"apart\"><small>{}</small>", escaped(remark));
            }
            html.push_str("</ul>");
        }
        let (class, size) = match panels.len() {
            0 => return Ok(html),
            3 => ("panels three", SIZES[1]),
            _ => ("panels", SIZES[0]),
        };
        let _ = write!(html, "<div class=\"{class}\">");
        for panel in panels {
            let (title, svg) = (escaped(&panel.title), panel.svg(size)?);
            let _ = write!(html, "<figure><figcaption>{title}</figcaption>{svg}</figure>");
        }
        html.push_str("</div>");
        Ok(match &self.heading {
            None => html,
            Some(heading) if self.is_folded => folded(heading, &html),
            Some(heading) => format!("<h3>{}</h3>{html}", escaped(heading)),
        })
    }
}

/// A stretch of line, as HTML.
fn legend_line(color: &str, stroke: Stroke) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Scale;
    use crate::figure::Curve;

    #[test]
    fn panels_without_a_line_are_left_out_and_names_are_escaped() {
        let panel = |points: &[(f64, f64)]| {
            let curve = Curve::line(0, Stroke::Solid, points.iter().copied());
            Figure::new("a < b", (Scale::Linear, "x"), Scale::Linear, [curve])
        };
        let legend = || [("<one>".to_owned(), "#0072B2", Stroke::Dashed)];
        let points = &[(1.0, 2.0), (2.0, 3.0)];
        let figures = Figures::new([panel(points), panel(&[])], legend()).with_heading("1 & 2");
        let html = figures.html().expect("figures");
        assert_eq!(html.matches("<figcaption>a &lt; b").count(), 1);
        assert!(html.starts_with("<h3>1 &amp; 2</h3>") && html.contains("</svg>&lt;one&gt;"));
        let none = Figures::new([panel(&[])], legend());
        assert!(none.is_empty() && none.html().expect("nothing").is_empty());
        let folded = Figures { is_folded: true, ..figures }.html().expect("figures");
        assert!(folded.starts_with("<details><summary>1 &amp; 2</summary>"));
    }
}
