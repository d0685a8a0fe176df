//! What the program is asked to do: its commands and options.

mod cube;
mod options;
#[cfg(test)]
mod tests;
mod values;

use std::ffi::OsString;

use bokashi_paper::Experiment;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use self::cube::{Common, PaperArguments, PaperCommand, ReproduceArguments};
pub(crate) use self::cube::{CubeArguments, CubeRequest};
pub(crate) use self::options::{
    CompletionsArguments, FitArguments, InspectArguments, ManArguments, NewArguments,
    RenderArguments, SamplesArguments, USUAL_OUT,
};
pub use self::values::{seeds, threads};
use crate::failure::{EXIT_STATUSES, Failure};

/// Learns a cube and its blur from pictures, by gradient descent through a renderer.
///
/// Without a command: the paper's experiment 5.3 (vertices, colours and sigma together) for all
/// four sigmas, at the paper's rates and at tuned ones, one seed each, with a report in out/.
#[derive(Debug, Parser)]
#[command(name = "bokashi", version, args_conflicts_with_subcommands = true)]
#[command(after_help = EXIT_STATUSES)]
pub struct Request {
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
    #[command(flatten)]
    pub(crate) common: Common,
}

/// What to do other than the default.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// A fit of a scene of your own: meshes, images, cameras, and what is learnt (docs/scene.md).
    Fit(FitArguments),
    /// The paper's experiments on a cube: one fit, or all of them.
    Paper(PaperArguments),
    /// The samples that people know, with what each has to reach: a cube of a few pixels, poses,
    /// textures, light, lenses, silhouettes, cameras.
    Samples(SamplesArguments),
    /// Pictures, depth, normals and ids of a scene's views, as PNG and EXR.
    Render(RenderArguments),
    /// What is in a mesh, an image, a scene, a file of cameras or a saved fit, and what is wrong
    /// with it: then the exit status is 1.
    Inspect(InspectArguments),
    /// A folder with a scene to begin with: a mesh, images, cameras, and scene.toml.
    New(NewArguments),
    /// A script with which a shell completes commands and options.
    ///
    /// For bash: bokashi completions bash > ~/.local/share/bash-completion/completions/bokashi
    ///
    /// For zsh: bokashi completions zsh > _bokashi, in a folder of $fpath
    ///
    /// For fish: bokashi completions fish > ~/.config/fish/completions/bokashi.fish
    #[command(verbatim_doc_comment)]
    Completions(CompletionsArguments),
    /// Manual pages, for man.
    ///
    /// To read one: bokashi man > bokashi.1 && man ./bokashi.1
    Man(ManArguments),
}

impl Request {
    /// The fits of the cube that are asked for, if it is that.
    pub(crate) fn cube(&self) -> Option<CubeRequest<'_>> {
        let common = &self.common;
        match &self.command {
            None => Some(CubeRequest { common, fit: None, seeds: None }),
            Some(Command::Paper(paper)) => Some(match &paper.command {
                PaperCommand::Fit(fit) => {
                    CubeRequest { common: &fit.common, fit: Some(fit), seeds: None }
                }
                PaperCommand::Reproduce(ReproduceArguments { seeds, common }) => {
                    CubeRequest { common, fit: None, seeds: Some(*seeds) }
                }
            }),
            Some(_) => None,
        }
    }

    /// How many bytes of memory files may ask for, where that is given.
    pub(crate) fn memory(&self) -> Option<u64> {
        match self.command.as_ref()? {
            Command::Fit(fit) => fit.memory.memory,
            Command::Render(render) => render.memory.memory,
            Command::Inspect(inspect) => inspect.memory.memory,
            Command::New(new) => new.memory.memory,
            _ => None,
        }
    }
}

/// Why there is no request.
#[derive(Debug)]
pub enum Stopped {
    /// Help or the version was asked for; the text is for standard output.
    Shown(String),
    /// The command line is wrong.
    Wrong(Failure),
}

/// Reads a command line, the program's name first.
pub fn parse(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<Request, Stopped> {
    let words: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    let all = Request::command();
    // A wrong word after a command with commands of its own is held against those.
    let first = words.get(1).and_then(|word| all.find_subcommand(word));
    let command = first.filter(|first| first.has_subcommands()).unwrap_or(&all);
    let stopped = |error| stopped(error, command);
    let matches = all.clone().try_get_matches_from(&words).map_err(stopped)?;
    let request = Request::from_arg_matches(&matches).map_err(stopped)?;
    let cube = request.cube().and_then(|cube| cube.fit);
    if let Some(fit) = cube.filter(|fit| fit.experiment == Some(Experiment::Vertices)) {
        let of_blur = [("sigma", fit.sigma.is_some()), ("kernel", fit.common.kernel.is_some())];
        if let Some((option, _)) = of_blur.into_iter().find(|(_, is_given)| *is_given) {
            let rule = "needs --experiment sigma or joint: vertices are learnt without blur";
            return Err(Stopped::Wrong(Failure::Use(format!("--{option} {rule}"))));
        }
    }
    Ok(request)
}

/// What a parser's error comes to: help and versions are asked for, all else is wrong. Where no
/// command is near a wrong one, the message has all of `command`.
pub fn stopped(mut error: clap::Error, command: &clap::Command) -> Stopped {
    if let ErrorKind::DisplayHelp | ErrorKind::DisplayVersion = error.kind() {
        return Stopped::Shown(error.to_string());
    }
    if error.kind() == ErrorKind::InvalidSubcommand
        && error.get(ContextKind::SuggestedSubcommand).is_none()
    {
        let names: Vec<_> = command.get_subcommands().map(clap::Command::get_name).collect();
        let tip = format!("the commands are {}", names.join(", "));
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    Stopped::Wrong(Failure::CommandLine(error.to_string()))
}
