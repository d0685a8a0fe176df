//! The commands `bench` and `bench elision`: times beside errors, and what is left out.

use std::io;

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use indicatif::ProgressBar;

use super::arguments::{BenchArguments, BenchCommand, BenchOptions};
use super::files::failed;
use crate::bench::{
    Effort, bench, elision, elision_page, elision_section, json, markdown, page, read_mesh,
    read_peers,
};

/// Does what was asked for.
pub(crate) fn run(arguments: &BenchArguments, writing: &Writing) -> Result<(), Failure> {
    match &arguments.command {
        None => studies(arguments, writing),
        Some(BenchCommand::Elision(options)) => left_out(options, writing),
    }
}

impl BenchOptions {
    /// How much to measure.
    pub(super) fn effort(&self) -> Effort {
        if self.quick { Effort::Quick } else { Effort::Full }
    }
}

fn studies(arguments: &BenchArguments, writing: &Writing) -> Result<(), Failure> {
    let effort = arguments.options.effort();
    let mut peers = Vec::new();
    for file in &arguments.peers {
        let to_failure = |error: io::Error| {
            let file = file.display();
            Failure::Use(format!("--peers needs a file that lab/peers wrote: {file}: {error}"))
        };
        peers.extend(read_peers(file).map_err(to_failure)?);
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
    let sections = bench(effort, &arguments.only, peers, meshes, on_study).map_err(failed)?;
    bar.finish_and_clear();
    let (text, json) = (markdown(&sections, effort), json(&sections, effort));
    arguments.options.files.write(&json, &text, |about| page(sections, effort, about), writing)
}

fn left_out(options: &BenchOptions, writing: &Writing) -> Result<(), Failure> {
    let effort = options.effort();
    let rows = elision(effort).map_err(failed)?;
    let section = elision_section(&rows);
    let text = markdown(std::slice::from_ref(&section), effort);
    options.files.write(&rows, &text, |about| elision_page(section, effort, about), writing)?;
    match rows.iter().find(|row| !row.bitwise_equal()) {
        None => Ok(()),
        Some(row) => {
            Err(failed(format!("{}: results differ from those with it computed", row.row)))
        }
    }
}
