//! What the program is asked to do: its commands and options.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use bokashi_examples::SAMPLES;
use bokashi_paper::{Experiment, Kernel, Precision, Preset, Saving, Silhouettes};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
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

/// The options of every command that fits the cube.
#[derive(Debug, Clone, Args)]
pub(crate) struct Common {
    /// Updates per fit [default: 10000]
    #[arg(long, value_name = "N", value_parser = steps)]
    pub(crate) steps: Option<u64>,
    /// Numbers to compute with [default: f32]
    #[arg(long, value_name = "WORD", value_parser = words::<Precision>(&["f32", "f64"]))]
    pub(crate) precision: Option<Precision>,
    /// Weights of the blur, in the learnt image and in the reference image: a Gaussian at pixel
    /// centres, divided by its sum or not, a Gaussian of diffusion, or a disc of the radius 2 sigma
    /// [default: sampled]; of no effect in experiment 5.1, which has no blur
    #[arg(long, value_name = "WORD", value_parser = words::<Kernel>(&["sampled", "unnormalized", "discrete", "disc"]))]
    pub(crate) kernel: Option<Kernel>,
    /// Threads [default: one per core]; results are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Folder for the report [default: out, for paper fit: no report]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// No progress bar and no summary
    #[arg(long)]
    pub(crate) quiet: bool,
}

impl Common {
    /// Updates per fit.
    pub(crate) fn steps(&self) -> u64 {
        self.steps.unwrap_or(10_000)
    }

    /// Numbers to compute with.
    pub(crate) fn precision(&self) -> Precision {
        self.precision.unwrap_or(Precision::F32)
    }

    /// Weights of the blur.
    pub(crate) fn kernel(&self) -> Kernel {
        self.kernel.unwrap_or_default()
    }
}

/// The options of `fit`.
#[derive(Debug, Clone, Args)]
pub(crate) struct FitArguments {
    /// The scene; the fit ends as it says, and --steps and --time can end it earlier
    #[arg(value_name = "SCENE.TOML")]
    pub(crate) scene: PathBuf,
    /// Stop after so many steps, those before --resume included
    #[arg(long, value_name = "N", value_parser = steps)]
    pub(crate) steps: Option<u64>,
    /// Stop after so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub(crate) time: Option<f64>,
    /// A page on this port of 127.0.0.1 that shows the fit as it goes [default: any free port]
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "0")]
    pub(crate) live: Option<u16>,
    /// File for the outcome as a JSON object; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// At the end an animated picture from all around what was learnt, views/turntable.png in --out
    #[arg(long)]
    pub(crate) turntable: bool,
    /// Save the fit in --out after every N steps; it is saved each minute and at its end anyway
    #[arg(long, value_name = "N", value_parser = steps)]
    pub(crate) save_every: Option<u64>,
    /// Saved fit to go on with, to the same bits as if it had not ended [default: the checkpoint in --out]
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    pub(crate) resume: Option<Option<PathBuf>>,
    #[command(flatten)]
    pub(crate) memory: MostMemory,
    /// Threads [default: one per core]; results are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Folder for results and the report [default: out]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// No progress bar and no summary
    #[arg(long)]
    pub(crate) quiet: bool,
}

impl FitArguments {
    /// The folder for results.
    pub(crate) fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(USUAL_OUT))
    }
}

/// The options of `paper`.
#[derive(Debug, Clone, Args)]
pub(crate) struct PaperArguments {
    #[command(subcommand)]
    pub(crate) command: PaperCommand,
}

/// What to do of the paper's experiments.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum PaperCommand {
    /// One fit of the cube, which writes files only where --out, --json or --save asks for them.
    Fit(CubeArguments),
    /// All of the paper's experiments 5.1, 5.2 and 5.3, with a report in out/.
    ///
    /// 5.1 at 8, 16 and 32 px, with antialias, exact and aliased; 5.2 and 5.3 for sigma 1, 1.4, 2.8
    /// and 4. With the paper's learning rates, and with tuned ones for 5.1 (32 px, antialias) and
    /// 5.3. Then, once, in f64: what other choices do where the paper leaves one open.
    Reproduce(ReproduceArguments),
}

/// The options of `paper fit`. A setting that is not given has its usual value, or that of the saved fit.
#[derive(Debug, Clone, Args)]
pub(crate) struct CubeArguments {
    /// What is learnt: vertices and colours (5.1), sigma (5.2), or all of them (5.3) [default: joint]
    #[arg(long, value_name = "WORD", value_parser = words::<Experiment>(&["vertices", "sigma", "joint"]))]
    pub(crate) experiment: Option<Experiment>,
    /// Learning rates: as printed in the paper, larger ones that fall over the run, or those and
    /// then second-order steps [default: paper]
    #[arg(long, value_name = "WORD", value_parser = words::<Preset>(&["paper", "tuned", "second-order"]))]
    pub(crate) preset: Option<Preset>,
    /// Width and height of the images, in pixels [default: 32]
    #[arg(long, value_name = "N", value_parser = resolution)]
    pub(crate) resolution: Option<usize>,
    /// Blur of the reference image, in pixels [default: 4]; not for --experiment vertices
    #[arg(long, value_name = "S", value_parser = sigma, allow_negative_numbers = true)]
    pub(crate) sigma: Option<f64>,
    /// Seed of the start and of the poses [default: 0]
    #[arg(long, value_name = "N", value_parser = seed)]
    pub(crate) seed: Option<u64>,
    /// Silhouettes, in the learnt image and in the reference image: of pixel centres alone,
    /// blended, or of all that lies in a pixel [default: antialias]
    #[arg(long, value_name = "WORD", value_parser = words::<Silhouettes>(&["aliased", "antialias", "exact"]))]
    pub(crate) silhouettes: Option<Silhouettes>,
    /// File for the outcome as a JSON object; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// File to save the fit to at its end, or when it is interrupted, to go on with --resume
    #[arg(long, value_name = "FILE")]
    pub(crate) save: Option<PathBuf>,
    /// Save after every N updates, too
    #[arg(long, value_name = "N", requires = "save", value_parser = steps)]
    pub(crate) save_every: Option<u64>,
    /// Saved fit to go on with, to the same bits as if it had not ended; settings are the file's
    #[arg(long, value_name = "FILE")]
    pub(crate) resume: Option<PathBuf>,
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
    /// An animated picture from all around the scene, too, turntable.png in --out
    #[arg(long)]
    pub(crate) turntable: bool,
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

/// The options of `paper reproduce`.
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
    /// Silhouettes [default: exact for cube, depth-of-field and focal-stack, antialias for the others]
    #[arg(long, value_name = "WORD", value_parser = words::<Silhouettes>(&["aliased", "antialias", "exact"]))]
    pub(crate) silhouettes: Option<Silhouettes>,
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
    /// Cameras are known roughly only: they are learnt, too
    #[arg(long, requires = "images")]
    pub(crate) rough_cameras: bool,
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

/// Fits of the cube that are asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CubeRequest<'a> {
    pub(crate) common: &'a Common,
    /// Of a single fit.
    pub(crate) fit: Option<&'a CubeArguments>,
    /// Of all experiments: seeds for each.
    pub(crate) seeds: Option<u64>,
}

impl<'a> CubeRequest<'a> {
    /// Where the report goes; `None`: there is none.
    pub(crate) fn out(&self) -> Option<&'a Path> {
        let usual = self.fit.is_none().then_some(Path::new(USUAL_OUT));
        self.common.out.as_deref().or(usual)
    }

    /// Where the outcome goes as JSON.
    pub(crate) fn json(&self) -> Option<&'a Path> {
        self.fit?.json.as_deref()
    }

    /// Where the fit is saved, and what it goes on from.
    pub(crate) fn saving(&self) -> Saving {
        self.fit.map_or_else(Saving::default, |fit| Saving {
            resume: fit.resume.clone(),
            save: fit.save.clone(),
            every: fit.save_every,
        })
    }
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
    let size = units.into_iter().find_map(|(unit, power)| {
        let number: f64 = text.strip_suffix(unit)?.trim_end().parse().ok()?;
        let bytes = number * (1_u64 << power) as f64;
        (bytes >= 1.0 && bytes < (1_u64 << 63) as f64).then_some(bytes as u64)
    });
    size.ok_or_else(|| "needs a size in KiB, MiB, GiB or TiB, such as 8GiB".to_owned())
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
        let mut texts = Vec::new();
        let mut open = vec![all];
        while let Some(command) = open.pop() {
            open.extend(command.get_subcommands().cloned());
            texts.push(command.term_width(80).render_long_help().to_string());
        }
        assert!(texts.len() > 10);
        for line in texts.iter().flat_map(|text| text.lines()) {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }

    #[test]
    fn without_a_command_the_report_goes_to_out() {
        let request = read("").expect("nothing is needed");
        assert!(request.command.is_none());
        let cube = request.cube().expect("fits of the cube");
        assert_eq!((cube.out(), cube.common.steps()), (Some(Path::new("out")), 10_000));
        let request = read("--out here --quiet --steps 5").expect("options without a command");
        let cube = request.cube().expect("fits of the cube");
        assert_eq!((cube.out(), cube.common.steps()), (Some(Path::new("here")), 5));
    }

    #[test]
    fn a_fit_of_the_cube_writes_nothing_that_is_not_asked_for() {
        let request = read("paper fit").expect("nothing is needed");
        let cube = request.cube().expect("a fit of the cube");
        assert_eq!((cube.out(), cube.json(), cube.saving()), (None, None, Saving::default()));
        assert_eq!((cube.common.threads, cube.common.precision()), (None, Precision::F32));
    }

    #[test]
    fn every_option_of_a_fit_of_the_cube_is_read() {
        let line = "paper fit --experiment sigma --preset tuned --resolution 16 --sigma 2.8 --steps 7 \
             --seed 3 --silhouettes exact --precision f64 --threads 2 --out a --json - --quiet \
             --save b --save-every 4 --resume c --kernel disc";
        let request = read(line).expect("all of them");
        let cube = request.cube().expect("a fit of the cube");
        let (common, fit) = (cube.common, cube.fit.expect("one"));
        assert_eq!((fit.experiment, fit.preset), (Some(Experiment::Sigma), Some(Preset::Tuned)));
        assert_eq!((fit.resolution, fit.sigma, fit.seed), (Some(16), Some(2.8), Some(3)));
        assert_eq!((common.steps(), common.threads), (7, Some(2)));
        assert_eq!((common.precision(), common.quiet), (Precision::F64, true));
        assert_eq!(common.kernel(), Kernel::Disc);
        assert_eq!(fit.silhouettes, Some(Silhouettes::Exact));
        assert_eq!((cube.out(), cube.json()), (Some(Path::new("a")), Some(Path::new("-"))));
        let saving = Saving { resume: Some("c".into()), save: Some("b".into()), every: Some(4) };
        assert_eq!(cube.saving(), saving);
    }

    #[test]
    fn every_option_of_a_fit_of_a_scene_is_read() {
        let line = "fit a.toml --steps 7 --time 2.5 --live --json - --save-every 4 --resume c --turntable \
             --memory 8GiB --threads 2 --out a --quiet";
        let Some(Command::Fit(fit)) = read(line).expect("all of them").command else {
            panic!("fit")
        };
        assert_eq!((fit.scene, fit.steps, fit.time), ("a.toml".into(), Some(7), Some(2.5)));
        assert_eq!((fit.live, fit.json, fit.save_every), (Some(0), Some("-".into()), Some(4)));
        assert_eq!((fit.resume, fit.threads), (Some(Some("c".into())), Some(2)));
        assert!(fit.turntable);
        assert_eq!(
            (fit.memory.memory, fit.out, fit.quiet),
            (Some(8 << 30), Some("a".into()), true)
        );
        let resumed = read("fit a.toml --resume").expect("the checkpoint").command;
        let Some(Command::Fit(fit)) = resumed else { panic!("fit") };
        assert_eq!((fit.resume, fit.live, fit.steps), (Some(None), None, None));
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
    fn reproducing_has_twenty_seeds_and_a_report() {
        let request = read("paper reproduce").expect("nothing is needed");
        let cube = request.cube().expect("fits of the cube");
        assert_eq!((cube.seeds, cube.out()), (Some(20), Some(Path::new("out"))));
    }

    #[test]
    fn bad_use_says_what_is_allowed() {
        let table = [
            ("paper fit --experiment all", "'all'", "[possible values: vertices, sigma, joint]"),
            ("paper fit --preset best", "'best'", "[possible values: paper, tuned, second-order]"),
            ("paper fit --silhouettes sharp", "'sharp'", "values: aliased, antialias, exact]"),
            ("paper fit --no-antialias", "'--no-antialias'", "--help"),
            ("paper fit --precision f16", "'f16'", "[possible values: f32, f64]"),
            ("paper fit --resolution 0", "'0'", "needs a whole number from 1 to 4096"),
            ("paper fit --resolution 3.5", "'3.5'", "needs a whole number from 1 to 4096"),
            ("paper fit --resolution 99999999999999999999", "--resolution", "from 1 to 4096"),
            ("paper fit --sigma 0", "'0'", "needs a number of pixels above 0 and up to 1000"),
            ("paper fit --sigma -1", "'-1'", "needs a number of pixels above 0 and up to 1000"),
            ("paper fit --sigma NaN", "'NaN'", "needs a number of pixels above 0 and up to 1000"),
            ("paper fit --sigma inf", "'inf'", "needs a number of pixels above 0 and up to 1000"),
            ("paper fit --experiment vertices --sigma 1", "--sigma", "sigma or joint"),
            ("paper fit --experiment vertices --kernel disc", "--kernel", "sigma or joint"),
            ("paper fit --kernel disk", "'disk'", "sampled, unnormalized, discrete, disc]"),
            ("paper fit --steps 0", "'0'", "needs a whole number from 1 to 10000000"),
            ("paper fit --save-every 3", "--save <FILE>", "required"),
            ("paper fit --save a --save-every 0", "'0'", "a whole number from 1 to 10000000"),
            ("paper fit --seed 0.5", "'0.5'", "needs a whole number from 0 to"),
            ("paper fit --threads 0", "'0'", "needs a whole number from 1 to 1024"),
            ("paper fit --steps", "a value is required", "--steps <N>"),
            ("paper fit --stepz 3", "'--stepz'", "'--steps'"),
            ("paper fit --resume", "a value is required", "--resume <FILE>"),
            ("paper fit scene.toml", "'scene.toml'", "--help"),
            ("paper reproduce --seeds 0", "'0'", "needs a whole number from 1 to 1000"),
            ("samples --only cub", "'cub'", "cube"),
            (
                "samples --silhouettes soft",
                "'soft'",
                "[possible values: aliased, antialias, exact]",
            ),
            ("samples --seeds 0", "'0'", "needs a whole number from 1 to 1000"),
            ("fitt", "'fitt'", "fit"),
            ("fit", "<SCENE.TOML>", "not provided"),
            ("fit --time 3", "<SCENE.TOML>", "not provided"),
            ("fit scene.toml extra", "'extra'", "--help"),
            ("fit scene.toml --seed 3", "'--seed'", "--help"),
            ("fit scene.toml --steps 0", "'0'", "needs a whole number from 1 to 10000000"),
            ("inspect a.obj --memory 8", "'8'", "needs a size in KiB, MiB, GiB or TiB"),
            ("inspect a.obj --memory -8GiB", "'-8'", "--help"),
            ("inspect a.obj --memory 0GiB", "'0GiB'", "such as 8GiB"),
            ("inspect a.obj --memory NaNGiB", "'NaNGiB'", "such as 8GiB"),
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
        let of_paper = "Usage: bokashi paper <COMMAND>\n";
        for (line, tip, usage) in [
            ("fitt", "tip: a similar subcommand exists: 'fit'", usage),
            ("sampels", "tip: a similar subcommand exists: 'samples'", usage),
            ("fooo", "tip: the commands are fit, paper, samples", usage),
            ("paper fooo", "tip: the commands are fit, reproduce", of_paper),
        ] {
            let text = wrong(line);
            let word = line.split(' ').next_back().unwrap();
            assert!(
                text.starts_with(&format!("error: unrecognized subcommand '{word}'")),
                "{text}"
            );
            assert!(text.contains(tip) && text.contains(usage), "{text}");
            assert!(text.ends_with("For more information, try '--help'."), "{text}");
        }
    }

    #[test]
    fn help_and_version_are_no_failures() {
        for line in ["--help", "-h", "--version", "-V", "help", "fit --help", "paper reproduce -h"]
        {
            let Err(Stopped::Shown(text)) = read(line) else { panic!("{line}") };
            assert!(text.contains("bokashi"), "{line}: {text}");
        }
    }
}
