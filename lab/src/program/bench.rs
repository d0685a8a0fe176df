//! The commands `bench` and `bench elision`: times beside errors, and what is left out.

use std::io;
use std::path::Path;
use std::sync::PoisonError;

use bokashi_cli::about::about;
use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::{is_standard_output, say, say_json};
use bokashi_report::{ReportError, escaped};
use indicatif::ProgressBar;

use super::arguments::{BenchArguments, BenchCommand, BenchFiles};
use crate::bench::{
    Effort, bench, elision, elision_markdown, json, markdown, read_mesh, read_peers,
    write_elision_page, write_page,
};

/// Does what was asked for.
pub(crate) fn run(arguments: &BenchArguments, writing: &Writing) -> Result<(), Failure> {
    match &arguments.command {
        None => studies(arguments, writing),
        Some(BenchCommand::Elision(files)) => left_out(files, writing),
    }
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Work(error.to_string())
}

fn effort(files: &BenchFiles) -> Effort {
    if files.quick { Effort::Quick } else { Effort::Full }
}

fn studies(arguments: &BenchArguments, writing: &Writing) -> Result<(), Failure> {
    let files = &arguments.files;
    let mut peers = Vec::new();
    for file in &arguments.peers {
        let said = |error: io::Error| {
            let file = file.display();
            Failure::Use(format!("--peers needs a file that lab/peers wrote: {file}: {error}"))
        };
        peers.extend(read_peers(file).map_err(said)?);
    }
    let mut meshes = Vec::new();
    for file in &arguments.mesh {
        let mesh = read_mesh(file);
        meshes.push(
            mesh.map_err(|error| Failure::Use(format!("--mesh needs a mesh file: {error}")))?,
        );
    }
    // Where standard error is no terminal there is no bar.
    let bar = ProgressBar::new_spinner();
    let on_study = &mut |name: &str| {
        bar.set_message(name.to_owned());
        bar.tick();
    };
    let found = bench(effort(files), &arguments.only, peers, meshes, on_study).map_err(failed)?;
    bar.finish_and_clear();
    let json = serde_json::to_string(&json(&found, effort(files))).map_err(failed)?;
    let text = markdown(&found, effort(files));
    let page = |out: &Path| write_page(&found, effort(files), &footer(), out);
    write(files, &json, &text, page, writing)
}

fn left_out(files: &BenchFiles, writing: &Writing) -> Result<(), Failure> {
    let rows = elision(effort(files)).map_err(failed)?;
    let json = serde_json::to_string(&rows).map_err(failed)?;
    let text = elision_markdown(&rows, effort(files));
    let page = |out: &Path| write_elision_page(&rows, effort(files), &footer(), out);
    write(files, &json, &text, page, writing)?;
    match rows.iter().find(|row| !row.bitwise_equal()) {
        None => Ok(()),
        Some(row) => {
            Err(Failure::Work(format!("{}: results differ from those with it computed", row.row)))
        }
    }
}

fn footer() -> String {
    let about = about("bokashi-lab");
    format!("Made by {}: <code>{}</code>.", escaped(&about.program), escaped(&about.command))
}

/// Writes and says what was asked for.
fn write(
    files: &BenchFiles,
    json: &str,
    text: &str,
    page: impl FnOnce(&Path) -> Result<std::path::PathBuf, ReportError>,
    writing: &Writing,
) -> Result<(), Failure> {
    let held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    let only_json = files.json.as_ref().is_some_and(|file| is_standard_output(file));
    if let Some(file) = &files.json {
        say_json(file, json)?;
    }
    let mut last = String::new();
    if let Some(out) = &files.out {
        last = format!("\nPage: {}\n", page(out).map_err(failed)?.display());
    }
    drop(held);
    if only_json { Ok(()) } else { say(&format!("{text}{last}")) }
}
