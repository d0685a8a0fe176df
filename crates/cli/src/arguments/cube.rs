//! The options of commands that fit the cube: plain `bokashi`, and `bokashi paper`.

use std::path::{Path, PathBuf};

use bokashi_paper::{Experiment, Kernel, Precision, Preset, Saving, Silhouettes};
use clap::{Args, Subcommand};

use super::options::USUAL_OUT;
use super::values::{resolution, seed, seeds, sigma, steps, threads, words};

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

/// The options of `paper reproduce`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ReproduceArguments {
    /// Seeds per experiment and setting, counted from 0
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = seeds)]
    pub(crate) seeds: u64,
    #[command(flatten)]
    pub(crate) common: Common,
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
