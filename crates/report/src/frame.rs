//! Sections in a frame: for pages of others, such as the output of a notebook.

use std::fmt::Write as _;

use crate::document::style;
use crate::error::ReportError;
use crate::markup::escaped;
use crate::section::Section;
use crate::viewer::{VIEWER_SCRIPT, holds_viewer};

/// In a frame a section is no chapter.
const STYLE: &str = "main{padding:2px}h3:first-child{margin-top:0}h3{margin-top:1rem}";

/// The frame becomes as high as what it holds, where scripts may run.
const GROW: &str = "this.style.height=this.contentDocument.documentElement.scrollHeight+4+'px'";

/// Sections one below the other as an `<iframe>`, which holds a whole page: neither page's style and scripts reach the
/// other. Its title is for readers who hear the page, its height in pixels for where no script runs. Headings of sections
/// stand where they are not empty.
///
/// # Errors
/// [`ReportError::Figure`] where a figure can't be drawn.
pub fn framed(title: &str, sections: &[Section], height: u32) -> Result<String, ReportError> {
    let mut body = String::new();
    for section in sections {
        let html = section.html()?;
        if !html.is_empty() && !section.title.is_empty() {
            // Writing to a string cannot fail.
            let _ = write!(body, "<h3>{}</h3>", escaped(section.title));
        }
        body.push_str(&html);
    }
    let script = match holds_viewer(&body) {
        true => format!("<script>{VIEWER_SCRIPT}</script>"),
        false => String::new(),
    };
    let (title, style) = (escaped(title), style());
    let page = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <style>{style}{STYLE}</style></head><body><main>{body}</main>{script}</body></html>"
    );
    let page = escaped(&page);
    Ok(format!(
        "<iframe title=\"{title}\" srcdoc=\"{page}\" onload=\"{GROW}\" \
         style=\"width:100%;height:{height}px;border:0\"></iframe>"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Scale;
    use crate::figure::{Curve, Figure, Stroke};
    use crate::figures::Figures;
    use crate::viewer::{ViewerMesh, viewer};

    #[test]
    fn a_frame_holds_a_page_as_text_and_the_script_where_a_mesh_is_shown() {
        let mut figures = Section::new("a", "A \"curve\" & more", "");
        let curve = Curve::line(0, Stroke::Solid, [(0.0, 1.0), (1.0, 0.5)]);
        let x = (Scale::Linear, "step");
        figures.push_figures(Figures::new([Figure::new("f", x, Scale::Linear, [curve])], []));
        let empty = Section::new("b", "Nothing", "");
        let html = framed("a <title>", &[figures, empty], 300).unwrap();
        assert!(html.starts_with("<iframe title=\"a &lt;title&gt;\" srcdoc=\"&lt;!doctype html"));
        assert!(html.contains("&lt;svg") && html.contains("height:300px"));
        assert!(html.contains("&lt;h3&gt;A &amp;quot;curve&amp;quot; &amp;amp; more"));
        assert!(!html.contains("Nothing") && !html.contains("&lt;script"));
        // One element, whose page can't end it.
        assert_eq!((html.matches('<').count(), html.matches('>').count()), (2, 2));
        let mut mesh = Section::new("c", "", "");
        let positions = &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let (faces, mut transform) = (&[[0, 1, 2]], [0.0; 16]);
        (0..4).for_each(|k| transform[5 * k] = 1.0);
        let mesh_shown = ViewerMesh { positions, faces, colors: None, texture: None, transform };
        mesh.push_html(viewer(&[mesh_shown], "a mesh").unwrap());
        let html = framed("a mesh", &[mesh], 300).unwrap();
        assert_eq!(html.matches(&escaped(VIEWER_SCRIPT)).count(), 1);
        assert_eq!((html.matches('<').count(), html.matches('>').count()), (2, 2));
    }
}
