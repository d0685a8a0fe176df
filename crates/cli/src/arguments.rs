//! What the program is asked to do: its commands and options.

use std::ffi::OsString;
use std::path::PathBuf;

use bokashi_examples::{SAMPLES, Silhouettes as Shown};
use bokashi_paper::{Experiment, Precision, Preset, Saving, Silhouettes};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::failure::{EXIT_STATUSES, Failure};
use crate::threads::MOST_THREADS;

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

/// The folder of reports and results, where the user names none.
pub(crate) const USUAL_OUT: &str = "out";

/// What to do other than the default.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// One fit: of a scene of your own (docs/scene.md), or without one of the paper's cube, which then
    /// writes files only where --out, --json or --save asks for them.
    Fit(FitArguments),
    /// All of the paper's experiments 5.1, 5.2 and 5.3, with a report in out/.
    ///
    /// 5.1 at 8, 16 and 32 px, with antialias, exact and aliased; 5.2 and 5.3 for sigma 1, 1.4, 2.8
    /// and 4. With the paper's learning rates, and with tuned ones for 5.1 (32 px, antialias) and
    /// 5.3. Then, once, in f64: what other choices do where the paper leaves one open.
    Reproduce(ReproduceArguments),
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

/// The options of `completions`.
#[derive(Debug, Clone, Args)]
pub(crate) struct CompletionsArguments {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub(crate) shell: clap_complete::Shell,
}

/// The options of `man`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ManArguments {
    /// The page of this command [default: of the program, which names the others]
    #[arg(value_name = "COMMAND")]
    pub(crate) command: Option<String>,
}

/// The options of every command.
#[derive(Debug, Clone, Args)]
pub(crate) struct Common {
    /// Updates per fit
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = steps)]
    pub(crate) steps: u64,
    /// Numbers to compute with
    #[arg(long, value_name = "WORD", default_value = "f32", value_parser = words::<Precision>(&["f32", "f64"]))]
    pub(crate) precision: Precision,
    /// Threads [default: one per core]; results are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Folder for the report [default: out, for fit: no report]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// No progress bar and no summary
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// The options of `fit`.
#[derive(Debug, Clone, Args)]
#[command(group = clap::ArgGroup::new("saved").args(["save", "scene"]).multiple(true))]
pub(crate) struct FitArguments {
    /// Your own scene: meshes, images, cameras, and what is learnt. Results go to --out, by default out/;
    /// it ends as the scene says, and --steps can end it earlier
    #[arg(value_name = "SCENE.TOML", conflicts_with_all = ["experiment", "preset", "resolution", "sigma", "seed", "silhouettes", "precision", "save"])]
    pub(crate) scene: Option<PathBuf>,
    /// Of a scene: stop after so many seconds
    #[arg(long, value_name = "SECONDS", requires = "scene", value_parser = seconds)]
    pub(crate) time: Option<f64>,
    /// Of a scene: a page on this port of 127.0.0.1 that shows the fit as it goes [default: any free port]
    #[arg(long, value_name = "PORT", requires = "scene", num_args = 0..=1, default_missing_value = "0")]
    pub(crate) live: Option<u16>,
    /// What is learnt: vertices and colours (5.1), sigma (5.2), or all of them (5.3)
    #[arg(long, value_name = "WORD", default_value = "joint", value_parser = words::<Experiment>(&["vertices", "sigma", "joint"]))]
    pub(crate) experiment: Experiment,
    /// Learning rates: as printed in the paper, larger ones that fall over the run, or those and
    /// then second-order steps
    #[arg(long, value_name = "WORD", default_value = "paper", value_parser = words::<Preset>(&["paper", "tuned", "second-order"]))]
    pub(crate) preset: Preset,
    /// Width and height of the images, in pixels
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = resolution)]
    pub(crate) resolution: usize,
    /// Blur of the reference image, in pixels [default: 4]; not for --experiment vertices
    #[arg(long, value_name = "S", value_parser = sigma, allow_negative_numbers = true)]
    pub(crate) sigma: Option<f64>,
    /// Seed of the start and of the poses
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = seed)]
    pub(crate) seed: u64,
    /// Silhouettes, in the learnt image and in the reference image: of pixel centres alone,
    /// blended, or of all that lies in a pixel
    #[arg(long, value_name = "WORD", default_value = "antialias", value_parser = words::<Silhouettes>(&["aliased", "antialias", "exact"]))]
    pub(crate) silhouettes: Silhouettes,
    /// File for the outcome as a JSON object; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// File to save the fit to at its end, or when it is interrupted, to go on with --resume
    #[arg(long, value_name = "FILE")]
    pub(crate) save: Option<PathBuf>,
    /// Save after every N updates, too; a scene's fit is saved in --out
    #[arg(long, value_name = "N", requires = "saved", value_parser = steps)]
    pub(crate) save_every: Option<u64>,
    /// Saved fit to go on with, to the same bits as if it had not ended; settings are the file's. Of a scene:
    /// by default the checkpoint in --out
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    pub(crate) resume: Option<Option<PathBuf>>,
    /// Of a scene: memory that its files may ask for, such as 8GiB [default: half of what there is]
    #[arg(long, value_name = "SIZE", requires = "scene", value_parser = bytes)]
    pub(crate) memory: Option<u64>,
    /// The names of the options that the command line has.
    #[arg(skip)]
    pub(crate) given: Vec<String>,
    #[command(flatten)]
    pub(crate) common: Common,
}

/// The options of `render`.
#[derive(Debug, Clone, Args)]
pub(crate) struct RenderArguments {
    /// The scene
    #[arg(value_name = "SCENE.TOML")]
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) memory: MostMemory,
    /// Only this view [default: all]
    #[arg(long, value_name = "NAME")]
    pub(crate) view: Option<String>,
    /// Folder for the files [default: out]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Threads [default: one per core]; files are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// No summary
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// The options of `reproduce`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ReproduceArguments {
    /// Seeds per experiment and setting, counted from 0
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = seeds)]
    pub(crate) seeds: u64,
    #[command(flatten)]
    pub(crate) common: Common,
}

/// The options of `samples`.
#[derive(Debug, Clone, Args)]
pub(crate) struct SamplesArguments {
    /// Only this sample; may be given several times [default: all]
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(SAMPLES.iter().map(|sample| sample.name)))]
    pub(crate) only: Vec<String>,
    /// Seeds per sample
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seeds)]
    pub(crate) seeds: u64,
    /// The first seed
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = seed)]
    pub(crate) first_seed: u64,
    /// Silhouettes [default: exact for cube and depth-of-field, antialias for the others]
    #[arg(long, value_name = "WORD", value_parser = words::<Shown>(&["aliased", "antialias", "exact"]))]
    pub(crate) silhouettes: Option<Shown>,
    /// Most updates per fit, to see that all of it runs [default: what each sample needs]
    #[arg(long, value_name = "N", value_parser = steps)]
    pub(crate) steps: Option<u64>,
    /// Folder for the report, samples.html [default: no report]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// File for the figures as a JSON list; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Threads [default: one per core]; figures are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// No table
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// The options of `inspect`.
#[derive(Debug, Clone, Args)]
pub(crate) struct InspectArguments {
    /// .obj .ply .gltf .glb, .png .jpg .jpeg .exr, scene.toml, transforms.json, .safetensors
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) memory: MostMemory,
    /// File for the facts as a JSON object; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

/// The options of `new`.
#[derive(Debug, Clone, Args)]
pub(crate) struct NewArguments {
    /// Folder that is made; one that is there must have no scene.toml
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
    /// Mesh to copy, with the files that it names [default: a sphere to start from]
    #[arg(long, value_name = "MESH")]
    pub(crate) from: Option<PathBuf>,
    /// Folder of images to copy, with transforms.json or sparse and masks if it has them
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) memory: MostMemory,
}

/// The option of commands that read meshes, images and scenes.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct MostMemory {
    /// Memory that files may ask for, such as 8GiB [default: half of what there is]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub(crate) memory: Option<u64>,
}

impl Request {
    /// The options that every command of fits has.
    pub(crate) fn common(&self) -> &Common {
        match &self.command {
            Some(Command::Fit(fit)) => &fit.common,
            Some(Command::Reproduce(reproduce)) => &reproduce.common,
            _ => &self.common,
        }
    }

    /// Where the report goes; `None`: there is none.
    pub(crate) fn out(&self) -> Option<PathBuf> {
        let out = self.common().out.clone();
        match &self.command {
            Some(Command::Fit(_)) => out,
            _ => Some(out.unwrap_or_else(|| USUAL_OUT.into())),
        }
    }

    /// Whether the user named the folder of the report.
    pub(crate) fn is_out_named(&self) -> bool {
        self.common().out.is_some()
    }

    /// Where the outcome goes as JSON.
    pub(crate) fn json(&self) -> Option<&PathBuf> {
        match &self.command {
            Some(Command::Fit(fit)) => fit.json.as_ref(),
            _ => None,
        }
    }

    /// Where the fit is saved.
    pub(crate) fn save(&self) -> Option<&PathBuf> {
        match &self.command {
            Some(Command::Fit(fit)) => fit.save.as_ref(),
            _ => None,
        }
    }

    /// The saved fit to go on with.
    pub(crate) fn resume(&self) -> Option<&PathBuf> {
        match &self.command {
            Some(Command::Fit(fit)) => fit.resume.as_ref().and_then(Option::as_ref),
            _ => None,
        }
    }

    /// Where the fit is saved, and what it goes on from.
    pub(crate) fn saving(&self) -> Saving {
        match &self.command {
            Some(Command::Fit(fit)) => {
                let resume = fit.resume.clone().flatten();
                Saving { resume, save: fit.save.clone(), every: fit.save_every }
            }
            _ => Saving::default(),
        }
    }

    /// How many bytes of memory files may ask for, where that is said.
    pub(crate) fn memory(&self) -> Option<u64> {
        match self.command.as_ref()? {
            Command::Fit(own) => own.memory,
            Command::Render(own) => own.memory.memory,
            Command::Inspect(own) => own.memory.memory,
            Command::New(own) => own.memory.memory,
            _ => None,
        }
    }

    /// How many threads to compute with; `None`: one per core.
    pub(crate) fn threads(&self) -> Option<usize> {
        self.common().threads
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
    let stopped = |error| stopped(error, &Request::command());
    let matches = Request::command().try_get_matches_from(arguments).map_err(stopped)?;
    let mut request = Request::from_arg_matches(&matches).map_err(stopped)?;
    if let (Some(Command::Fit(fit)), Some((_, matches))) =
        (&mut request.command, matches.subcommand())
    {
        let names = matches.ids().map(|id| id.as_str());
        let given = |name: &&str| matches.value_source(name) == Some(ValueSource::CommandLine);
        fit.given = names.filter(given).map(str::to_owned).collect();
    }
    match &request.command {
        Some(Command::Fit(fit))
            if fit.sigma.is_some() && fit.experiment == Experiment::Vertices =>
        {
            let rule =
                "--sigma needs --experiment sigma or joint: vertices are learnt without blur";
            Err(Stopped::Wrong(Failure::Use(rule.to_owned())))
        }
        Some(Command::Fit(fit)) if fit.scene.is_none() && fit.resume == Some(None) => {
            let rule = "--resume needs the file of a saved fit, but for a fit of a scene";
            Err(Stopped::Wrong(Failure::Use(rule.to_owned())))
        }
        _ => Ok(request),
    }
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

/// One of some words, each of which `T` can be read from.
fn words<T>(all: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: std::str::FromStr<Err: std::error::Error + Send + Sync + 'static>,
    T: Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(all).try_map(|word| word.parse::<T>())
}

/// A whole number within bounds.
fn whole(text: &str, least: u64, most: u64) -> Result<u64, String> {
    let number = text.parse().ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| format!("needs a whole number from {least} to {most}"))
}

/// A history takes about 100 bytes per step: at most 1 GB.
fn steps(text: &str) -> Result<u64, String> {
    whole(text, 1, 10_000_000)
}

/// A time that a fit may take.
fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number.is_finite());
    number.ok_or_else(|| "needs a number of seconds above 0".to_owned())
}

/// A number of threads.
pub fn threads(text: &str) -> Result<usize, String> {
    whole(text, 1, MOST_THREADS as u64).map(|number| number as usize)
}

/// A size of memory in bytes: a number and a unit.
fn bytes(text: &str) -> Result<u64, String> {
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40)];
    let found = units.into_iter().find_map(|(unit, power)| {
        let number: f64 = text.strip_suffix(unit)?.trim_end().parse().ok()?;
        let bytes = number * (1_u64 << power) as f64;
        (bytes >= 1.0 && bytes < (1_u64 << 63) as f64).then_some(bytes as u64)
    });
    found.ok_or_else(|| "needs a size in KiB, MiB, GiB or TiB, such as 8GiB".to_owned())
}

/// Larger images would need more memory than a report of them is worth.
fn resolution(text: &str) -> Result<usize, String> {
    whole(text, 1, 4096).map(|number| number as usize)
}

/// A number of seeds.
pub fn seeds(text: &str) -> Result<u64, String> {
    whole(text, 1, 1000)
}

fn seed(text: &str) -> Result<u64, String> {
    whole(text, 0, u64::MAX)
}

/// Wider than that, a blur leaves nothing of an image.
fn sigma(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number| number > 0.0 && number <= 1e3);
    number.ok_or_else(|| "needs a number of pixels above 0 and up to 1000".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Result<Request, Stopped> {
        parse(std::iter::once("bokashi").chain(line.split_whitespace()))
    }

    fn wrong(line: &str) -> String {
        match read(line) {
            Err(Stopped::Wrong(failure)) if failure.status() == 2 => failure.to_string(),
            other => panic!("{line}: {other:?}"),
        }
    }

    #[test]
    fn the_parser_itself_is_sound() {
        Request::command().debug_assert();
    }

    #[test]
    fn help_fits_a_terminal_of_eighty_columns() {
        let mut all = Request::command().term_width(80);
        all.build();
        let names: Vec<_> = all.get_subcommands().map(|own| own.get_name().to_owned()).collect();
        let mut texts = vec![all.render_long_help().to_string()];
        for name in &names {
            let own = all.find_subcommand_mut(name).expect("a command");
            texts.push(own.clone().term_width(80).render_long_help().to_string());
        }
        for line in texts.iter().flat_map(|text| text.lines()) {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }

    #[test]
    fn without_a_command_the_report_goes_to_out() {
        let request = read("").expect("nothing is needed");
        assert!(request.command.is_none());
        assert_eq!(request.out(), Some("out".into()));
        assert_eq!(request.common().steps, 10_000);
        let request = read("--out here --quiet --steps 5").expect("options without a command");
        assert_eq!((request.out(), request.common().steps), (Some("here".into()), 5));
    }

    #[test]
    fn a_fit_has_the_papers_defaults_and_writes_nothing() {
        let request = read("fit").expect("nothing is needed");
        assert_eq!((request.out(), request.json()), (None, None));
        let Some(Command::Fit(fit)) = request.command else { panic!("fit") };
        assert_eq!((fit.experiment, fit.preset), (Experiment::Joint, Preset::Paper));
        assert_eq!((fit.resolution, fit.seed), (32, 0));
        assert_eq!(fit.silhouettes, Silhouettes::Antialias);
        assert_eq!((fit.sigma, fit.common.threads), (None, None));
        assert_eq!(fit.common.precision, Precision::F32);
    }

    #[test]
    fn every_option_of_a_fit_is_read() {
        let line = "fit --experiment sigma --preset tuned --resolution 16 --sigma 2.8 --steps 7 \
             --seed 3 --silhouettes exact --precision f64 --threads 2 --out a --json - --quiet \
             --save b --save-every 4 --resume c";
        let request = read(line).expect("all of them");
        assert_eq!(request.out(), Some("a".into()));
        let Some(Command::Fit(fit)) = request.command else { panic!("fit") };
        assert_eq!((fit.experiment, fit.preset), (Experiment::Sigma, Preset::Tuned));
        assert_eq!((fit.resolution, fit.sigma, fit.seed), (16, Some(2.8), 3));
        assert_eq!((fit.common.steps, fit.common.threads), (7, Some(2)));
        assert_eq!(fit.common.precision, Precision::F64);
        assert_eq!(fit.json, Some("-".into()));
        assert!(fit.silhouettes == Silhouettes::Exact && fit.common.quiet);
        assert_eq!((fit.save, fit.save_every), (Some("b".into()), Some(4)));
        assert_eq!(fit.resume, Some(Some("c".into())));
    }

    #[test]
    fn memory_is_a_number_with_a_unit() {
        for (text, expected) in [("8GiB", 8 << 30), ("1.5 MiB", 3 << 19), ("512KiB", 1 << 19)] {
            assert_eq!(bytes(text), Ok(expected));
        }
        for line in ["fit a.toml", "render a.toml", "inspect a.toml", "new a"] {
            assert_eq!(read(line).expect(line).memory(), None);
            let line = format!("{line} --memory 8GiB");
            assert_eq!(read(&line).expect(&line).memory(), Some(8 << 30));
        }
    }

    #[test]
    fn options_that_were_given_are_told_from_defaults() {
        let Some(Command::Fit(fit)) = read("fit --seed 0 --steps 10000").expect("both").command
        else {
            panic!("fit")
        };
        for (option, expected) in [("seed", true), ("steps", true), ("resolution", false)] {
            assert_eq!(fit.given.iter().any(|name| name == option), expected, "{option}");
        }
    }

    #[test]
    fn reproduce_has_twenty_seeds() {
        let request = read("reproduce").expect("nothing is needed");
        assert_eq!(request.out(), Some("out".into()));
        let Some(Command::Reproduce(reproduce)) = request.command else { panic!("reproduce") };
        assert_eq!(reproduce.seeds, 20);
    }

    #[test]
    fn bad_use_says_what_is_allowed() {
        let table = [
            ("fit --experiment all", "'all'", "[possible values: vertices, sigma, joint]"),
            ("fit --preset best", "'best'", "[possible values: paper, tuned, second-order]"),
            ("fit --silhouettes sharp", "'sharp'", "[possible values: aliased, antialias, exact]"),
            ("fit --no-antialias", "'--no-antialias'", "--help"),
            ("fit --precision f16", "'f16'", "[possible values: f32, f64]"),
            ("fit --resolution 0", "'0'", "needs a whole number from 1 to 4096"),
            ("fit --resolution 3.5", "'3.5'", "needs a whole number from 1 to 4096"),
            ("fit --resolution 99999999999999999999", "--resolution", "from 1 to 4096"),
            ("fit --sigma 0", "'0'", "needs a number of pixels above 0 and up to 1000"),
            ("fit --sigma -1", "'-1'", "needs a number of pixels above 0 and up to 1000"),
            ("fit --sigma NaN", "'NaN'", "needs a number of pixels above 0 and up to 1000"),
            ("fit --sigma inf", "'inf'", "needs a number of pixels above 0 and up to 1000"),
            ("fit --experiment vertices --sigma 1", "--sigma", "--experiment sigma or joint"),
            ("fit --steps 0", "'0'", "needs a whole number from 1 to 10000000"),
            ("fit --save-every 3", "--save <FILE>", "required"),
            ("fit --save a --save-every 0", "'0'", "needs a whole number from 1 to 10000000"),
            ("fit --seed 0.5", "'0.5'", "needs a whole number from 0 to"),
            ("fit --threads 0", "'0'", "needs a whole number from 1 to 1024"),
            ("samples --only cub", "'cub'", "cube"),
            (
                "samples --silhouettes soft",
                "'soft'",
                "[possible values: aliased, antialias, exact]",
            ),
            ("samples --seeds 0", "'0'", "needs a whole number from 1 to 1000"),
            ("reproduce --seeds 0", "'0'", "needs a whole number from 1 to 1000"),
            ("fit --steps", "a value is required", "--steps <N>"),
            ("fit --stepz 3", "'--stepz'", "'--steps'"),
            ("fitt", "'fitt'", "fit"),
            ("fit scene.toml extra", "'extra'", "--help"),
            ("fit scene.toml --seed 3", "'--seed <N>'", "[SCENE.TOML]"),
            ("fit --time 3", "<SCENE.TOML>", "required"),
            ("inspect a.obj --memory 8", "'8'", "needs a size in KiB, MiB, GiB or TiB"),
            ("inspect a.obj --memory -8GiB", "'-8'", "--help"),
            ("inspect a.obj --memory 0GiB", "'0GiB'", "such as 8GiB"),
            ("inspect a.obj --memory NaNGiB", "'NaNGiB'", "such as 8GiB"),
            ("fit --memory 8GiB", "<SCENE.TOML>", "required"),
            ("fit --resume", "the file of a saved fit", "of a scene"),
            ("--seed 3", "'--seed'", "--help"),
        ];
        for (line, what, allowed) in table {
            let text = wrong(line);
            assert!(text.contains(what) && text.contains(allowed), "{line}: {text}");
        }
    }

    #[test]
    fn a_wrong_word_is_answered_with_the_parsers_whole_message_and_the_nearest_right_one() {
        let usage = "Usage: bokashi [OPTIONS]\n       bokashi <COMMAND>\n";
        for (line, tip) in [
            ("fitt", "tip: a similar subcommand exists: 'fit'"),
            ("sampels", "tip: a similar subcommand exists: 'samples'"),
            ("fooo", "tip: the commands are fit, reproduce, samples"),
        ] {
            let text = wrong(line);
            assert!(
                text.starts_with(&format!("error: unrecognized subcommand '{line}'")),
                "{text}"
            );
            assert!(text.contains(tip) && text.contains(usage), "{text}");
            assert!(text.ends_with("For more information, try '--help'."), "{text}");
        }
    }

    #[test]
    fn help_and_version_are_no_failures() {
        for line in ["--help", "-h", "--version", "-V", "help", "fit --help", "reproduce -h"] {
            let Err(Stopped::Shown(text)) = read(line) else { panic!("{line}") };
            assert!(text.contains("bokashi"), "{line}: {text}");
        }
    }
}
