//! The options of each command but those that fit the cube.

use std::path::{Path, PathBuf};

use bokashi_examples::SAMPLES;
use bokashi_paper::Silhouettes;
use clap::Args;
use clap::builder::PossibleValuesParser;

use super::values::{bytes, seconds, seed, seeds, steps, threads, words};

/// The folder of reports and results, where the user names none.
pub(crate) const USUAL_OUT: &str = "out";

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
