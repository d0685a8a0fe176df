//! Pages of a report's folder: HTML files that need nothing beside them.
//!
//! Figures are inline SVG, pictures are inline PNG; there is no font and no address to load, and
//! no script but that of meshes to turn. Light and dark follow the reader's setting. Each page names the others that lie
//! beside it: [`Rendered::write`] brings those lines up to date whenever a page is added.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::ReportError;
use crate::figure::{GRID, INK, PALETTE, PALETTE_DARK};
use crate::markup::escaped;
use crate::section::Section;
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

/// Circumstances of a report: who made it, and how.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// The program and its version.
    pub program: String,
    /// The command that made the report.
    pub command: String,
    /// How many threads it had.
    pub threads: usize,
}

/// One page, with the files beside it: a CSV file of each table that has a name, and others.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// The name of its file, without the ending: one of those that [`Rendered::write`] lists.
    pub name: &'static str,
    /// The heading, as text.
    pub heading: String,
    /// What the page shows, as text.
    pub introduction: String,
    /// The sections, in order; those that show nothing are left out.
    pub sections: Vec<Section>,
    /// Files beside it: paths below the folder, and contents.
    pub files: Vec<(PathBuf, Vec<u8>)>,
    /// Who made the page.
    pub about: About,
}

/// A page and the files beside it, not yet written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rendered {
    name: String,
    /// The page, as HTML.
    pub html: String,
    /// Paths below the page's folder, and contents.
    pub files: Vec<(PathBuf, Vec<u8>)>,
}

impl Document {
    /// Makes the page and the files beside it, in memory. The table `t` of the page `index` has the file
    /// `t.csv`, that of another `page` the file `page-t.csv`.
    ///
    /// # Errors
    /// [`ReportError::Figure`] where a figure can't be drawn.
    pub fn render(&self) -> Result<Rendered, ReportError> {
        let prefix = if self.name == "index" { "" } else { &format!("{}-", self.name) };
        let tables = self.sections.iter().flat_map(Section::tables);
        let tables = tables.filter(|table| !table.name.is_empty());
        let tables = tables.map(|table| (format!("{prefix}{}.csv", table.name), table.csv()));
        let tables = tables.map(|(name, csv)| (PathBuf::from(name), csv.into_bytes()));
        let files: Vec<_> = tables.chain(self.files.iter().cloned()).collect();
        let html = self.html(&files)?;
        Ok(Rendered { name: format!("{}.html", self.name), html, files })
    }

    fn html(&self, files: &[(PathBuf, Vec<u8>)]) -> Result<String, ReportError> {
        let (mut contents, mut body) = (String::new(), String::new());
        for section in &self.sections {
            let (id, title, html) = (section.id, escaped(section.title), section.html()?);
            if !html.is_empty() {
                let _ = write!(contents, "<li><a href=\"#{id}\">{title}</a>");
                let _ = write!(body, "<section id=\"{id}\"><h2>{title}</h2>{html}</section>");
            }
        }
        let script = match holds_viewer(&body) {
            true => format!("<script>{VIEWER_SCRIPT}</script>"),
            false => String::new(),
        };
        let heading = escaped(&self.heading);
        Ok(format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>Bokashi: {heading}</title><style>{}</style></head><body>\
             <header><h1>{heading}</h1><p>{}</p>{BESIDE}{END}<nav><ul>{contents}</ul></nav></header>\
             <main>{body}</main><footer>{}{}</footer>{script}</body></html>\n",
            style(),
            escaped(&self.introduction),
            self.about.html(),
            links(files),
        ))
    }
}

impl About {
    /// As the last lines of a page.
    fn html(&self) -> String {
        let Self { program, command, threads } = self;
        let [program, command] = [program, command].map(|text| escaped(text));
        format!("<p>Made by {program}, {threads} threads: <code>{command}</code></p>")
    }
}

/// Links to files beside a page, to a folder where they lie in one.
fn links(files: &[(PathBuf, Vec<u8>)]) -> String {
    let mut names: Vec<String> = Vec::new();
    for (path, _) in files {
        let mut parts = path.components().map(|part| part.as_os_str().to_string_lossy());
        let first = parts.next().unwrap_or_default();
        let name = if parts.next().is_some() { format!("{first}/") } else { first.into_owned() };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let link = |name: &String| format!("<a href=\"{name}\">{name}</a>", name = escaped(name));
    match &names[..] {
        [] => String::new(),
        names => {
            let links = names.iter().map(link).collect::<Vec<_>>().join(", ");
            format!("<p>Files of this page: {links}</p>")
        }
    }
}

impl Rendered {
    /// Writes the files and then the page into `folder`, which is made where it is missing. Every page of the
    /// folder then names the others: `index.html`, `samples.html`, `bench.html`, `elision.html`, `stability.html`,
    /// `stiff.html`. Returns the path of the page.
    ///
    /// # Errors
    /// [`ReportError::Write`] where the file system refuses, and where a link in the folder leads out of it.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, ReportError> {
        for (name, bytes) in &self.files {
            let failed = |error| ReportError::Write { path: folder.join(name), error };
            write_below(folder, name, bytes).map_err(failed)?;
        }
        // The page last: whoever sees it finds the rest in place.
        add_page(folder, &self.name, &self.html)
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

/// Writes `html` into `folder` as one of [`PAGES`]: see [`Rendered::write`].
fn add_page(folder: &Path, name: &str, html: &str) -> Result<PathBuf, ReportError> {
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
    use crate::table::{Cell, Table};

    fn document(name: &'static str, heading: &str) -> Rendered {
        let mut one = Section::new("one", "A & B", "");
        one.push_html("<p>1</p>");
        let mut table = Table::new("t", "", &[("a", "a")]);
        table.push(vec![Cell::Count(1)]);
        one.push_table(table);
        let document = Document {
            name,
            heading: heading.to_owned(),
            introduction: "a < b".to_owned(),
            sections: vec![one, Section::new("none", "A & B", "")],
            files: vec![("more/1.png".into(), Vec::new()), ("more/2.png".into(), Vec::new())],
            about: About { command: "<c>".to_owned(), ..About::default() },
        };
        document.render().expect("no figure")
    }

    #[test]
    fn text_is_escaped_and_empty_sections_are_left_out() {
        let html = document("index", "1 < 2").html;
        assert!(html.contains("<title>Bokashi: 1 &lt; 2</title>") && html.contains("a &lt; b"));
        assert!(html.contains("<h2>A &amp; B</h2><p>1</p>") && html.contains("<code>&lt;c&gt;"));
        assert!(!html.contains("id=\"none\""));
    }

    #[test]
    fn pages_of_a_folder_name_one_another() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("new");
        let read = |name| fs::read_to_string(folder.join(name)).unwrap();
        document("stability", "cases").write(&folder).unwrap();
        assert_eq!(read("stability-t.csv"), "a\n1\n");
        let links = "<a href=\"stability-t.csv\">stability-t.csv</a>, <a href=\"more/\">more/</a>";
        assert!(read("stability.html").contains(links) && folder.join("more/2.png").exists());
        assert!(!read("stability.html").contains("Beside this page"));
        // A page of someone else's is left alone.
        fs::write(folder.join("stiff.html"), "mine").unwrap();
        document("index", "fits").write(&folder).unwrap();
        assert!(read("index.html").contains("<a href=\"stability.html\">Extreme cases</a>"));
        let once = read("stability.html");
        assert!(once.contains("<a href=\"index.html\">Fits</a>"));
        document("index", "fits").write(&folder).unwrap();
        assert_eq!((read("stability.html"), read("stiff.html")), (once, "mine".to_owned()));
    }
}
