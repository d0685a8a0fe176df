//! The report of a set of fits: one page, pictures, a film and tables.
//!
//! A [`Report`] is given fits one by one and keeps what it will show of each; [`Report::render`]
//! makes the files, [`Rendered::write`] writes them into a folder:
//!
//! - `index.html`: the whole report in one file that needs nothing else, online or beside it.
//!   First of all it shows error against run time, then what the paper's Figures 3 to 7 show,
//!   then every fit and every choice.
//! - `fits.csv`: one row per fit. `histories.csv`: the histories, thinned evenly in the
//!   logarithm of the step.
//! - `pictures/`: the learnt cubes beside their targets, one PNG per group of fits that differ
//!   in their seed alone; `fit.png`, the film, an animated PNG.
//!
//! Each file is written whole or not at all.

mod animation;
mod digest;
mod figure;
mod film;
mod gallery;
mod page;
mod panels;
mod picture;
mod results;
mod table;
mod write;

use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::error::FitError;
use crate::scenes::{CubeSettings, Outcome};

use digest::{Fit, Group};
pub use write::{check_folder, write_whole};

/// What can go wrong with a report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A picture could not be rendered.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A figure could not be drawn.
    #[error("a figure could not be drawn: {0}")]
    Figure(String),
    /// A picture is none, or could not be encoded.
    #[error("{0}")]
    Picture(String),
    /// A file could not be written.
    #[error("{path} could not be written: {error}", path = path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the file system said.
        error: io::Error,
    },
}

/// Circumstances of a report that its fits don't know.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// The program and its version.
    pub program: String,
    /// The command that made the report.
    pub command: String,
    /// How many threads it had.
    pub threads: usize,
}

/// A report in the making: see the module.
#[derive(Debug, Default)]
pub struct Report {
    about: About,
    fits: Vec<Fit>,
    failures: Vec<(CubeSettings, String)>,
}

impl Report {
    /// A report without fits.
    pub fn new(about: About) -> Self {
        Self { about, fits: Vec::new(), failures: Vec::new() }
    }

    /// Adds a fit. Of its history only what will be shown is kept.
    pub fn add(&mut self, settings: &CubeSettings, outcome: Outcome) {
        self.fits.push(Fit::new(settings, outcome));
    }

    /// Adds a fit that ended in an error: the report shows it too.
    pub fn add_failure(&mut self, settings: &CubeSettings, error: &FitError) {
        self.failures.push((settings.clone(), error.to_string()));
    }

    /// Whether there is nothing to show.
    pub fn is_empty(&self) -> bool {
        self.fits.is_empty()
    }

    /// Makes every file of the report, in memory.
    ///
    /// # Errors
    /// Where a figure or a picture can't be made.
    pub fn render(&self) -> Result<Rendered, ReportError> {
        let groups = Group::sorted(&self.fits);
        let groups: Vec<&Group> = groups.iter().collect();
        let film = film::film(&film::cast(&groups))?;
        let mut files: Vec<(PathBuf, Vec<u8>)> = Vec::new();
        for (at, group) in groups.iter().enumerate() {
            if let Some(sheet) = gallery::file(group)? {
                let name = group.file_name();
                let taken = groups[..at].iter().any(|group| group.file_name() == name);
                let number = if taken { format!("-{at}") } else { String::new() };
                files.push((format!("pictures/{name}{number}.png").into(), sheet));
            }
        }
        let page = page::page(&self.about, &groups, &self.failures, film.as_ref())?;
        files.extend(film.map(|film| (PathBuf::from("fit.png"), film.moving)));
        files.push(("fits.csv".into(), table::fits(&self.fits).into()));
        files.push(("histories.csv".into(), table::histories(&self.fits).into()));
        // The page last: whoever sees it finds the rest in place.
        files.push((PAGE.into(), page.into()));
        Ok(Rendered { files })
    }
}

/// The name of the page.
const PAGE: &str = "index.html";

/// The files of a report, not yet written.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// Paths below the report's folder, and contents.
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl Rendered {
    /// Writes the report into `folder`, which is made where it is missing; returns the path of
    /// the page.
    ///
    /// # Errors
    /// [`ReportError::Write`] where the file system refuses.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, ReportError> {
        for (name, bytes) in &self.files {
            let path = folder.join(name);
            let parent = path.parent().unwrap_or(folder);
            let written = fs::create_dir_all(parent).and_then(|()| write_whole(&path, bytes));
            written.map_err(|error| ReportError::Write { path, error })?;
        }
        Ok(folder.join(PAGE))
    }
}
