//! What the program is asked to do: its commands and options.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use bokashi_cli::arguments::{Stopped, seeds, stopped, threads};
use bokashi_cli::failure::{EXIT_STATUSES, Failure};
use clap::builder::PossibleValuesParser;
use clap::{Args, CommandFactory as _, Parser, Subcommand};

use crate::bench::{MESHES, STUDIES};
use crate::models::Expected;

/// Examines Bokashi: extreme cases, stiff problems, times beside errors, files of other people.
#[derive(Debug, Parser)]
#[command(name = "bokashi-lab", version, arg_required_else_help = false)]
#[command(after_help = EXIT_STATUSES)]
pub(crate) struct Request {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The grid of extreme cases, in f32 and f64: what has to come out, and what does.
    ///
    /// Prints a row per case and precision, with the measured error and its bound; ends with
    /// status 1 if any of them fails.
    Stability(StabilityArguments),
    /// Optimizers against stiff problems with known minima, and against our own scenes.
    ///
    /// Prints shares of problems solved, errors and conditions; takes about a minute. Writes files
    /// only where --out or --json asks for them.
    Stiff(StiffArguments),
    /// How fast, and at what error: beside other renderers, per operation, node by node.
    ///
    /// Prints tables as Markdown; takes a quarter of an hour. Its times are worth something on a
    /// machine that does nothing else, from a build with --release. Writes files only where --out or
    /// --json asks for them.
    Bench(BenchArguments),
    /// Mesh files of other people: how many of each format load, and why the others don't.
    ///
    /// Loads each .obj, .ply, .gltf and .glb file below a folder, and reads again what is written of it;
    /// ends with status 1 if anything panics or comes back as something else.
    Models(ModelsArguments),
}

/// Where what was found is written.
#[derive(Debug, Clone, Args)]
pub(crate) struct Files {
    /// File for what was found as JSON; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Folder of the report to add a page to, and CSV files of tables that have names [default: no page]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// The options of `stability`.
#[derive(Debug, Clone, Args)]
pub(crate) struct StabilityArguments {
    #[command(flatten)]
    pub(crate) files: Files,
    /// Threads [default: one per core]; results are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
}

/// The options of `stiff`.
#[derive(Debug, Clone, Args)]
pub(crate) struct StiffArguments {
    /// Rotations of the quadratic and starts of each scene, counted from 0
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seeds)]
    pub(crate) seeds: u64,
    /// Threads [default: one per core]; results are the same bits for any number
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    #[command(flatten)]
    pub(crate) files: Files,
    /// No progress bar and no tables
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// The options of `bench`.
#[derive(Debug, Clone, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct BenchArguments {
    #[command(subcommand)]
    pub(crate) command: Option<BenchCommand>,
    /// Do this study alone; may be given again
    #[arg(long, value_name = "STUDY", value_parser = PossibleValuesParser::new(STUDIES))]
    pub(crate) only: Vec<String>,
    /// File of other people's times, as lab/peers writes it, to set beside ours; may be given
    /// again
    #[arg(long, value_name = "FILE")]
    pub(crate) peers: Vec<PathBuf>,
    /// Mesh file, .obj, .ply, .gltf or .glb, for the study `meshes`; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) mesh: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) options: BenchOptions,
}

/// What to bench other than everything.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum BenchCommand {
    /// What a scene does not need: the time with it computed and without, and whether the results
    /// are the same to the bit.
    ///
    /// Prints a table as Markdown; ends with status 1 if any result differs.
    Elision(BenchOptions),
}

/// How much a bench measures, and where it writes.
#[derive(Debug, Clone, Args)]
pub(crate) struct BenchOptions {
    #[command(flatten)]
    pub(crate) files: Files,
    /// Small sizes and three samples each, to see that all of it runs: the times mean nothing
    #[arg(long)]
    pub(crate) quick: bool,
}

/// The options of `models`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ModelsArguments {
    /// Folder to look in, and in all folders below
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
    /// How many files of a format load, and how many there are: status 1 where that is not so; may be
    /// given again
    #[arg(long, value_name = "FORMAT=LOADED/FILES")]
    pub(crate) expect: Vec<Expected>,
    /// File for every outcome as a JSON list; - for standard output, and then nothing else there
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
}

impl BenchArguments {
    /// The options of whatever is asked for.
    fn options(&self) -> &BenchOptions {
        match &self.command {
            None => &self.options,
            Some(BenchCommand::Elision(options)) => options,
        }
    }

    /// Whether nothing is left to do for want of a mesh file.
    fn lacks_a_mesh(&self) -> bool {
        let has_meshes = self.options.quick || !self.mesh.is_empty();
        !has_meshes && !self.only.is_empty() && self.only.iter().all(|study| study == MESHES)
    }
}

impl Request {
    /// Where what was found is written.
    pub(crate) fn files(&self) -> Files {
        match &self.command {
            Command::Stability(stability) => stability.files.clone(),
            Command::Stiff(stiff) => stiff.files.clone(),
            Command::Bench(bench) => bench.options().files.clone(),
            Command::Models(models) => Files { json: models.json.clone(), out: None },
        }
    }

    /// Files that are read, with the options that name them.
    pub(crate) fn read(&self) -> Vec<(&'static str, &Path)> {
        let Command::Bench(bench) = &self.command else { return Vec::new() };
        let peers = bench.peers.iter().map(|file| ("--peers", file.as_path()));
        peers.chain(bench.mesh.iter().map(|file| ("--mesh", file.as_path()))).collect()
    }

    /// How many threads to compute with; `None`: one per core.
    pub(crate) fn threads(&self) -> Option<usize> {
        match &self.command {
            Command::Stability(stability) => stability.threads,
            Command::Stiff(stiff) => stiff.threads,
            Command::Bench(_) | Command::Models(_) => None,
        }
    }
}

/// Reads a command line, the program's name first.
pub(crate) fn parse(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<Request, Stopped> {
    let request = Request::try_parse_from(arguments);
    let request = request.map_err(|error| stopped(error, &Request::command()))?;
    match &request.command {
        Command::Bench(bench) if bench.lacks_a_mesh() => Err(Stopped::Wrong(Failure::Use(
            "--only meshes needs --mesh FILE, or --quick for meshes of its own".to_owned(),
        ))),
        _ => Ok(request),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Result<Request, Stopped> {
        parse(std::iter::once("bokashi-lab").chain(line.split_whitespace()))
    }

    fn wrong(line: &str) -> String {
        match read(line) {
            Err(Stopped::Wrong(failure)) if failure.status() == 2 => failure.to_string(),
            other => panic!("{line}: {other:?}"),
        }
    }

    /// The folder, the JSON and the threads that are asked for.
    fn written(request: &Request) -> (Option<PathBuf>, Option<PathBuf>, Option<usize>) {
        let Files { json, out } = request.files();
        (out, json, request.threads())
    }

    #[test]
    fn the_parser_itself_is_sound() {
        Request::command().debug_assert();
    }

    #[test]
    fn the_grid_writes_nothing_unless_asked() {
        let request = read("stability").expect("nothing is needed");
        assert_eq!(written(&request), (None, None, None));
        let request = read("stability --json - --out a --threads 3").expect("all of them");
        assert_eq!(written(&request), (Some("a".into()), Some("-".into()), Some(3)));
    }

    #[test]
    fn stiff_writes_only_what_it_is_asked_for() {
        let request = read("stiff").expect("nothing is needed");
        assert_eq!(written(&request), (None, None, None));
        let line = "stiff --seeds 3 --threads 2 --json a.json --out b --quiet";
        let request = read(line).expect("all of them");
        assert_eq!(written(&request), (Some("b".into()), Some("a.json".into()), Some(2)));
        let Command::Stiff(stiff) = request.command else { panic!("stiff") };
        assert!(stiff.seeds == 3 && stiff.quiet);
    }

    #[test]
    fn a_bench_has_its_files_and_its_elision_its_own() {
        let request = read("bench").expect("nothing is needed");
        assert_eq!(written(&request), (None, None, None));
        let request =
            read("bench --quick --out a --json b --peers c --peers d --only blur --mesh e")
                .expect("all");
        let files =
            [("--peers", "c".as_ref()), ("--peers", "d".as_ref()), ("--mesh", "e".as_ref())];
        assert_eq!(request.read(), files);
        assert_eq!(written(&request), (Some("a".into()), Some("b".into()), None));
        let Command::Bench(bench) = request.command else { panic!("bench") };
        assert!(bench.options.quick && bench.command.is_none());
        assert_eq!((bench.peers, bench.only), (vec!["c".into(), "d".into()], vec!["blur".into()]));
        let request = read("bench elision --out a --json -").expect("all of them");
        assert_eq!(written(&request), (Some("a".into()), Some("-".into()), None));
    }

    #[test]
    fn models_may_be_expected() {
        let request = read("models a --expect obj=18/25 --expect ply=4/9").expect("all of them");
        assert_eq!(written(&request), (None, None, None));
        let Command::Models(models) = request.command else { panic!("models") };
        let formats: Vec<_> = models.expect.iter().map(|expected| expected.format).collect();
        assert_eq!((models.folder.as_path(), formats), ("a".as_ref(), vec!["obj", "ply"]));
    }

    #[test]
    fn bad_use_says_what_is_allowed() {
        let table = [
            ("", "subcommand", "stability, stiff, bench, models"),
            ("stability --threads 0", "'0'", "needs a whole number from 1 to 1024"),
            ("stability --steps 3", "'--steps'", "--help"),
            ("bench --only all", "'all'", "scenes, meshes, silhouettes"),
            ("bench --only meshes", "--only meshes", "needs --mesh FILE"),
            ("bench --threads 2", "'--threads'", "--help"),
            ("stiff --seeds 0", "'0'", "needs a whole number from 1 to 1000"),
            ("stiff --steps 5", "'--steps'", "--help"),
            ("models", "DIR", "--help"),
            (
                "models a --expect stl=1/2",
                "'stl=1/2'",
                "needs a format and two counts, as obj=18/25",
            ),
            ("models a --expect obj=1", "'obj=1'", "the formats are obj, ply, gltf, glb"),
            ("fit", "'fit'", "the commands are stability, stiff, bench, models"),
        ];
        for (line, what, allowed) in table {
            let text = wrong(line);
            assert!(text.contains(what) && text.contains(allowed), "{line}: {text}");
        }
    }

    #[test]
    fn help_and_version_are_no_failures() {
        for line in [
            "--help",
            "-h",
            "--version",
            "help",
            "stability --help",
            "bench --help",
            "bench elision --help",
            "models --help",
        ] {
            let Err(Stopped::Shown(text)) = read(line) else { panic!("{line}") };
            assert!(text.contains("bokashi-lab"), "{line}: {text}");
        }
    }
}
