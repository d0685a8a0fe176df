//! Pages of a report's folder: HTML files that need nothing beside them.
//!
//! Figures are inline SVG, pictures are inline PNG; there is no font and no address to load, and
//! no script but that of meshes to turn. Light and dark follow the reader's setting. Each page names the others that lie
//! beside it: [`add_page`] brings those lines up to date whenever a page is added.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::ReportError;
use crate::figure::{GRID, INK, PALETTE, PALETTE_DARK};
use crate::markup::escaped;
use crate::viewer::{VIEWER_SCRIPT, holds_viewer};
use bokashi_write::{check_below, write_below};

/// The style sheet, without the colours of the figures.
const STYLE: &str = include_str!("page.css");

/// Exchanges the colours that figures are drawn in for those of a dark page.
fn dark_figures() -> String {
    let mut style = String::from("@media (prefers-color-scheme:dark){");
    let pairs = PALETTE.iter().zip(PALETTE_DARK);
    for (light, dark) in pairs.chain([(&INK[0], INK[1]), (&GRID[0], GRID[1])]) {
        // Writing to a string cannot fail.
        let _ = write!(
            style,
            "svg [stroke=\"{light}\"]{{stroke:{dark}}}svg [fill=\"{light}\"]{{fill:{dark}}}"
        );
    }
    style.push('}');
    style
}

/// The style sheet of a page, for pages that are put together elsewhere.
#[must_use]
pub fn style() -> String {
    format!("{STYLE}{}", dark_figures())
}

/// One page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    /// What a browser's tab says, as text.
    pub title: String,
    /// The heading, as text.
    pub heading: String,
    /// What the page shows, as HTML.
    pub introduction: String,
    /// The sections, in order; those without a body are left out.
    pub sections: Vec<Section>,
    /// Who made the page, as HTML.
    pub footer: String,
}

/// A section of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Its anchor.
    pub id: &'static str,
    /// Its heading, as text.
    pub title: &'static str,
    /// What it shows, as HTML.
    pub body: String,
}

impl Document {
    /// The page as HTML.
    #[must_use]
    pub fn html(&self) -> String {
        let (mut contents, mut body) = (String::new(), String::new());
        let views = self.sections.iter().any(|section| holds_viewer(&section.body));
        let script =
            if views { format!("<script>{VIEWER_SCRIPT}</script>") } else { String::new() };
        for Section { id, title, body: section } in &self.sections {
            if section.is_empty() {
                continue;
            }
            let title = escaped(title);
            let _ = write!(contents, "<li><a href=\"#{id}\">{title}</a>");
            let _ = write!(body, "<section id=\"{id}\"><h2>{title}</h2>{section}</section>");
        }
        format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>{}</title><style>{}</style></head><body>\
             <header><h1>{}</h1><p>{}</p>{BESIDE}{END}<nav><ul>{contents}</ul></nav></header>\
             <main>{body}</main><footer>{}</footer>{script}</body></html>\n",
            escaped(&self.title),
            style(),
            escaped(&self.heading),
            self.introduction,
            self.footer,
        )
    }
}

/// Between these a page names the pages beside it.
const BESIDE: &str = "<!--beside-->";
const END: &str = "<!--end-->";

/// The pages that a folder may hold, and what they show.
const PAGES: [(&str, &str); 6] = [
    ("index.html", "Fits"),
    ("samples.html", "Samples"),
    ("bench.html", "Speed"),
    ("elision.html", "What is left out"),
    ("stability.html", "Extreme cases"),
    ("stiff.html", "Stiff problems"),
];

/// Writes `html` into `folder`, which is made where it is missing, under the name of one of the
/// pages that a report's folder may hold: `index.html`, `samples.html`,
/// `bench.html`, `elision.html`, `stability.html`, `stiff.html`. Then every page in the folder names the others. Returns the path
/// of the page.
///
/// # Errors
/// [`ReportError::Write`] where the file system refuses, and where a link in the folder leads out of it.
pub fn add_page(folder: &Path, name: &str, html: &str) -> Result<PathBuf, ReportError> {
    debug_assert!(PAGES.iter().any(|&(page, _)| page == name), "{name} is no page of a report");
    let path = folder.join(name);
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |error| ReportError::Write { path, error }
    };
    write_below(folder, name, html.as_bytes()).map_err(failed(&path))?;
    // A link to what lies elsewhere is no page of this folder.
    let is_there = |page: &str| folder.join(page).is_file() && check_below(folder, page).is_ok();
    let present: Vec<_> = PAGES.iter().filter(|(page, _)| is_there(page)).collect();
    for (page, _) in &present {
        let path = folder.join(page);
        let html = fs::read_to_string(&path).map_err(failed(&path))?;
        let others = present.iter().filter(|(other, _)| other != page);
        if let Some(html) = naming(&html, others.copied()) {
            write_below(folder, page, html.as_bytes()).map_err(failed(&path))?;
        }
    }
    Ok(path)
}

/// `html` with links to `others`; `None` where it is no page of ours, or needs no change.
fn naming<'a>(
    html: &str,
    others: impl Iterator<Item = &'a (&'static str, &'static str)>,
) -> Option<String> {
    let (head, rest) = html.split_once(BESIDE)?;
    let (old, tail) = rest.split_once(END)?;
    let links: Vec<_> =
        others.map(|(page, shows)| format!("<a href=\"{page}\">{shows}</a>")).collect();
    let new = match &links[..] {
        [] => String::new(),
        links => format!("<p class=\"beside\">Beside this page: {}</p>", links.join(", ")),
    };
    (old != new).then(|| format!("{head}{BESIDE}{new}{END}{tail}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(heading: &str) -> String {
        let section = |id, body: &str| Section { id, title: "A & B", body: body.to_owned() };
        Document {
            title: "<title>".to_owned(),
            heading: heading.to_owned(),
            introduction: String::new(),
            sections: vec![section("one", "<p>1</p>"), section("none", "")],
            footer: String::new(),
        }
        .html()
    }

    #[test]
    fn text_is_escaped_and_empty_sections_are_left_out() {
        let html = document("1 < 2");
        assert!(html.contains("<title>&lt;title&gt;</title>") && html.contains("1 &lt; 2"));
        assert!(html.contains("<h2>A &amp; B</h2><p>1</p>"));
        assert!(!html.contains("id=\"none\""));
    }

    #[test]
    fn pages_of_a_folder_name_one_another() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("new");
        let read = |name| fs::read_to_string(folder.join(name)).unwrap();
        add_page(&folder, "stability.html", &document("cases")).unwrap();
        assert!(!read("stability.html").contains("Beside this page"));
        // A page of someone else's is left alone.
        fs::write(folder.join("stiff.html"), "mine").unwrap();
        add_page(&folder, "index.html", &document("fits")).unwrap();
        assert!(read("index.html").contains("<a href=\"stability.html\">Extreme cases</a>"));
        let once = read("stability.html");
        assert!(once.contains("<a href=\"index.html\">Fits</a>"));
        add_page(&folder, "index.html", &document("fits")).unwrap();
        assert_eq!((read("stability.html"), read("stiff.html")), (once, "mine".to_owned()));
    }
}
