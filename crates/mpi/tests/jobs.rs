//! Jobs of one to four ranks, started with `mpirun` on this machine, and what becomes of them.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use bokashi_scene::{Location, Picture, Samples, Scene, SceneFit};
use serde_json::Value;

const CHECKPOINT: &str = "checkpoint.safetensors";

/// Views of the scene: no power of two, and no multiple of the numbers of ranks.
const VIEWS: usize = 13;

/// More steps than there is time for.
const ENDLESS: usize = 100_000;

/// Far more than anything here takes, on a busy machine too.
const LIMIT: Duration = Duration::from_secs(300);

/// The same for a job that is about to end.
const SOON: Duration = Duration::from_secs(60);

/// Between two looks.
const PAUSE: Duration = Duration::from_millis(5);

/// A disk of 24 x 24 pixels, somewhat different in each view.
fn disk(view: usize) -> Vec<u8> {
    let is_inside = |k: usize| {
        let [x, y] = [k % 24, k / 24].map(|at| at as f64 - 11.5);
        x.hypot(y) < 6.0 + (view % 4) as f64
    };
    let sample = |k: usize| match is_inside(k / 3) {
        true => 60 + (k % 3 * 40 + 5 * view) as u8,
        false => 0,
    };
    let samples = Samples::U8((0..24 * 24 * 3).map(sample).collect());
    Picture { width: 24, height: 24, channels: 3, samples }
        .encode_png(&Location::new("disk"))
        .unwrap()
}

/// A scene of a ball that is learnt from a ring of views, of which each step sees `per_step`.
fn scene(folder: &Path, steps: usize, per_step: usize) -> PathBuf {
    let mut text = String::new();
    fs::create_dir_all(folder.join("images")).unwrap();
    for view in 0..VIEWS {
        fs::write(folder.join(format!("images/{view}.png")), disk(view)).unwrap();
        let angle = view as f64 / VIEWS as f64 * std::f64::consts::TAU;
        let (x, z) = (4.0 * angle.sin(), 4.0 * angle.cos());
        text += &format!(
            "[[views]]\nimage = \"images/{view}.png\"\nheld_out = {}\n\
             camera = {{ position = [{x}, 0.5, {z}], angle = 38.0 }}\n",
            view == 7
        );
    }
    text += &format!(
        "[[meshes]]\nshape = \"sphere\"\nfaces = 200\n[learn.vertices]\n[learn.cameras]\n\
         [stop]\nsteps = {steps}\nviews_per_step = {per_step}\n"
    );
    fs::write(folder.join("scene.toml"), text).unwrap();
    folder.join("scene.toml")
}

/// The command that starts a job of `size` ranks in `folder`.
fn command(folder: &Path, size: usize, words: &[&str]) -> Command {
    let mut job = Command::new("nice");
    let size = size.to_string();
    job.args(["mpirun", "-n", &size, env!("CARGO_BIN_EXE_bokashi-mpi")]).args(words);
    // Open MPI does not like root, nor more ranks than cores; MPICH has nothing against them.
    for (name, value) in [
        ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
        ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
        ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
    ] {
        job.env(name, value);
    }
    job.current_dir(folder).stdin(Stdio::null());
    job
}

/// Open MPI waits this long before it terminates the ranks of a job, and again before it kills them; a second
/// unless it is told. What a rank saves on a busy machine takes longer.
fn with_seconds_to_end(job: &mut Command, seconds: u32) -> &mut Command {
    job.env("OMPI_MCA_odls_base_sigkill_timeout", seconds.to_string())
}

/// A job under way. It is killed with all its ranks where a test ends before it does.
struct Job {
    mpirun: Child,
    folder: PathBuf,
}

/// How a job ended.
struct Ended {
    status: ExitStatus,
    /// On standard output and standard error.
    said: String,
}

/// The file in a job's folder with what it says.
const SAID: &str = "job.txt";

impl Job {
    fn start(command: &mut Command) -> Self {
        let folder =
            command.get_current_dir().expect("jobs run in folders of their own").to_owned();
        let said = File::create(folder.join(SAID)).unwrap();
        let mpirun = command.stdout(said.try_clone().unwrap()).stderr(said).spawn();
        Self { mpirun: mpirun.expect("mpirun is installed"), folder }
    }

    /// Waits until `ready`, which comes before the job ends.
    fn wait_until<R>(&mut self, mut ready: impl FnMut() -> Option<R>) -> R {
        wait_until(LIMIT, || {
            let found = ready();
            let is_over = found.is_none() && self.mpirun.try_wait().unwrap().is_some();
            assert!(!is_over, "it has ended, and said: {}", self.said());
            found
        })
    }

    /// How the job ends, which takes no longer than `limit`.
    fn ended_within(mut self, limit: Duration) -> Ended {
        let started = Instant::now();
        let status = loop {
            if let Some(status) = self.mpirun.try_wait().unwrap() {
                break status;
            }
            assert!(started.elapsed() < limit, "it does not end, and said: {}", self.said());
            std::thread::sleep(PAUSE);
        };
        Ended { status, said: self.said() }
    }

    /// How a job ends that a signal or a mistake is about to end.
    fn failed(self) -> Ended {
        let ended = self.ended_within(SOON);
        assert!(!ended.status.success(), "{}", ended.said);
        ended
    }

    fn said(&self) -> String {
        String::from_utf8_lossy(&fs::read(self.folder.join(SAID)).unwrap()).into_owned()
    }

    fn rank(&self, rank: usize) -> u32 {
        process(&self.folder, rank).expect("the rank runs")
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        let _ = self.mpirun.kill().and_then(|()| self.mpirun.wait());
        // They may outlive mpirun, and a rank may start another one.
        while let Some(process) = processes(&self.folder).next() {
            let _ = try_send("KILL", process);
        }
    }
}

/// What becomes of a job that nothing disturbs.
fn run(command: &mut Command) -> Ended {
    Job::start(command).ended_within(LIMIT)
}

/// Fits the scene in `folder` on `size` ranks, to its end; returns the last checkpoint.
fn fitted(folder: &Path, size: usize, out: &str, more: &[&str]) -> Vec<u8> {
    let words =
        [&["fit", "scene.toml", "--out", out, "--json", "fit.json", "--threads", "1"], more];
    let Ended { status, said } = run(&mut command(folder, size, &words.concat()));
    assert!(status.success(), "{size} ranks: {said}");
    checkpoint(folder, out)
}

fn checkpoint(folder: &Path, out: &str) -> Vec<u8> {
    fs::read(folder.join(out).join(CHECKPOINT)).unwrap()
}

/// The pictures of all views by their names.
fn pictures(folder: &Path, out: &str) -> BTreeMap<OsString, Vec<u8>> {
    let all = fs::read_dir(folder.join(out).join("views")).unwrap().map(|entry| entry.unwrap());
    all.map(|entry| (entry.file_name(), fs::read(entry.path()).unwrap())).collect()
}

/// The checkpoint of a fit alone, without MPI, after `steps` or as many as the scene has.
fn alone(file: &Path, steps: usize) -> Vec<u8> {
    let mut fit = SceneFit::new(Scene::load(file).unwrap()).unwrap();
    let _ = (0..steps).map_while(|_| fit.step().unwrap()).count();
    let saved = file.with_file_name("alone.safetensors");
    fit.save(&saved).unwrap();
    fs::read(saved).unwrap()
}

/// What Linux knows of a process.
fn known(process: u32, what: &str) -> PathBuf {
    PathBuf::from(format!("/proc/{process}/{what}"))
}

/// The processes of our program that run in `folder`.
fn processes(folder: &Path) -> impl Iterator<Item = u32> {
    let folder = folder.canonicalize().unwrap();
    let is_own = move |&process: &u32| {
        let [program, place] =
            ["exe", "cwd"].map(|what| fs::read_link(known(process, what)).unwrap_or_default());
        place == folder && program == Path::new(env!("CARGO_BIN_EXE_bokashi-mpi"))
    };
    let all = fs::read_dir("/proc").unwrap();
    all.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok()).filter(is_own)
}

/// The process of a rank.
fn process(folder: &Path, rank: usize) -> Option<u32> {
    let own = [
        format!("OMPI_COMM_WORLD_RANK={rank}"),
        format!("PMI_RANK={rank}"),
        format!("PMIX_RANK={rank}"),
    ];
    let is_own = |&process: &u32| {
        let [environment, asked] =
            ["environ", "cmdline"].map(|what| fs::read(known(process, what)).unwrap_or_default());
        let mut words = environment.split(|&byte| byte == 0);
        // The fits of a sweep are processes of their own, with the rank's environment.
        let is_fit_of_sweep = asked.split(|&byte| byte == 0).nth(1) == Some(b"alone");
        !is_fit_of_sweep && words.any(|word| own.iter().any(|own| own.as_bytes() == word))
    };
    processes(folder).find(is_own)
}

/// Sends a signal; returns whether there was such a process.
fn try_send(signal: &str, process: u32) -> bool {
    let sent = Command::new("kill").args(["-s", signal, &process.to_string()]).status();
    sent.expect("kill runs").success()
}

fn send(signal: &str, process: u32) {
    assert!(try_send(signal, process));
}

/// Waits until `ready`, which comes within `limit`.
fn wait_until<R>(limit: Duration, mut ready: impl FnMut() -> Option<R>) -> R {
    let started = Instant::now();
    loop {
        if let Some(found) = ready() {
            return found;
        }
        assert!(started.elapsed() < limit, "it did not come within {limit:?}");
        std::thread::sleep(PAUSE);
    }
}

#[test]
fn the_bits_are_those_of_a_fit_alone_for_any_number_of_ranks_and_threads() {
    for per_step in [VIEWS, 5] {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path();
        let expected = alone(&scene(folder, 6, per_step), 6);
        let (mut hashes, mut drawn) = (Vec::new(), Vec::new());
        for size in 1..=4 {
            let out = format!("out-{size}");
            let found = fitted(folder, size, &out, &[]);
            assert!(found == expected, "{size} ranks, {per_step} views per step");
            drawn.push(pictures(folder, &out));
            let json: Value =
                serde_json::from_slice(&fs::read(folder.join("fit.json")).unwrap()).unwrap();
            assert!(json["psnr_held_out"].as_f64().is_some());
            hashes.push(json["parameters_hash"].to_string());
        }
        let words = ["fit", "scene.toml", "--out", "two", "--threads", "2"];
        let said = run(&mut command(folder, 2, &words)).said;
        assert!(said.contains("2 ranks sent "), "{said}");
        assert!(checkpoint(folder, "two") == expected, "two threads each");
        hashes.dedup();
        assert_eq!(hashes.len(), 1);
        // The picture, the target and their difference; the film, and its end.
        assert_eq!(drawn[0].len(), 3 * VIEWS + 2);
        assert!(drawn.iter().all(|own| *own == drawn[0]), "pictures differ");
    }
}

#[test]
fn ranks_without_work_are_named() {
    for per_step in [1, 3] {
        let place = tempfile::tempdir().unwrap();
        scene(place.path(), 1, per_step);
        let Ended { status, said } = run(&mut command(place.path(), 3, &["fit", "scene.toml"]));
        assert!(status.success(), "{said}");
        let is_named =
            said.contains("note: a step draws 1 view, so at least 2 of 3 ranks have none");
        assert_eq!(is_named, per_step == 1, "{said}");
    }
}

/// Ranks of one job that are given other scenes: of these some waited for each other for ever, and some ended with
/// other bits.
#[test]
fn a_rank_that_sees_other_files_or_settings_is_named_and_all_end() {
    type Change = fn(&Path);
    let changes: [(&str, Change); 5] = [
        ("images/2.png", |folder| fs::write(folder.join("images/2.png"), disk(3)).unwrap()),
        ("`seed`", |folder| change(folder, "[[meshes]]", "[[meshes]]", "seed = 5\n")),
        ("`stop.views_per_step`", |folder| {
            change(folder, "views_per_step = 5", "views_per_step = 7", "");
        }),
        ("`stop.steps`", |folder| change(folder, "steps = 6\n", "steps = 3\n", "")),
        ("`pipeline.background`", |folder| {
            change(
                folder,
                "[learn.vertices]",
                "[pipeline]\nbackground = [1, 1, 1]\n[learn.vertices]",
                "",
            );
        }),
    ];
    for (name, change) in changes {
        let place = tempfile::tempdir().unwrap();
        for folder in ["one", "two"] {
            scene(&place.path().join(folder), 6, 5);
        }
        change(&place.path().join("two"));
        let program = env!("CARGO_BIN_EXE_bokashi-mpi");
        let mut job = command(place.path(), 1, &["fit", "one/scene.toml", "--out", "out"]);
        job.args([":", "-n", "1", program, "fit", "two/scene.toml", "--out", "out"]);
        let Ended { said, .. } = Job::start(&mut job).failed();
        assert!(said.contains(&format!("got another {name} on rank")), "{said}");
        assert!(!place.path().join("out").exists(), "nothing was learnt");
    }
}

/// Replaces what stands in a scene's file, and puts something before all of it.
fn change(folder: &Path, from: &str, to: &str, before: &str) {
    let file = folder.join("scene.toml");
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains(from));
    fs::write(file, before.to_owned() + &text.replacen(from, to, 1)).unwrap();
}

#[test]
fn a_fit_goes_on_with_another_number_of_ranks_to_the_same_bits() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let expected = alone(&scene(folder, 9, VIEWS), 9);
    assert!(fitted(folder, 3, "out", &["--steps", "3"]) != expected);
    assert!(fitted(folder, 1, "out", &["--resume", "--steps", "5"]) != expected);
    assert!(fitted(folder, 4, "out", &["--resume"]) == expected);
}

#[test]
fn a_killed_rank_ends_the_job_and_the_last_checkpoint_goes_on_to_the_same_bits() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    const STEPS: usize = 60;
    let expected = alone(&scene(folder, STEPS, VIEWS), STEPS);
    // The first rank writes a checkpoint after each step: some of these moments are in the middle of one.
    // They are told by checkpoints, so that none comes after the last step, however fast the machine.
    for (rank, checkpoints, ms) in [(0, 1, 0), (1, 6, 3), (2, 11, 7), (0, 16, 11)] {
        let out = format!("out-{rank}-{checkpoints}");
        let words = ["fit", "scene.toml", "--out", &out, "--save-every", "1", "--threads", "1"];
        let mut job = Job::start(with_seconds_to_end(&mut command(folder, 3, &words), 0));
        let (mut last, mut count) = (Vec::new(), 0);
        job.wait_until(|| {
            let now = fs::read(folder.join(&out).join(CHECKPOINT)).ok()?;
            count += u64::from(now != last);
            last = now;
            (count >= checkpoints).then_some(())
        });
        std::thread::sleep(Duration::from_millis(ms));
        send("KILL", job.rank(rank));
        job.failed();
        let found = fitted(folder, 2, &out, &["--resume"]);
        assert!(found == expected, "rank {rank} after {checkpoints} checkpoints and {ms} ms");
    }
}

#[test]
fn the_first_rank_killed_as_it_writes_leaves_a_whole_checkpoint() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let file = scene(folder, ENDLESS, VIEWS);
    let words = ["fit", "scene.toml", "--out", "out", "--save-every", "1", "--threads", "1"];
    let mut job = Job::start(&mut command(folder, 3, &words));
    job.wait_until(|| folder.join("out").join(CHECKPOINT).exists().then_some(()));
    let writer = job.rank(0);
    // A checkpoint is written beside the last one, under another name, and then takes its name.
    let unfinished = || {
        let entries = fs::read_dir(folder.join("out")).unwrap().flatten();
        let is_unfinished = |name: &std::ffi::OsString| {
            name.to_string_lossy().starts_with(&format!(".{CHECKPOINT}.bokashi-"))
        };
        entries.map(|entry| entry.file_name()).find(is_unfinished)
    };
    // It may be done before it is stopped: then it goes on.
    let half = job.wait_until(|| {
        unfinished()?;
        send("STOP", writer);
        wait_until(SOON, || is_stopped(writer).then_some(()));
        let found = unfinished();
        if found.is_none() {
            send("CONT", writer);
        }
        found
    });
    send("KILL", writer);
    job.failed();
    assert_eq!(unfinished(), Some(half), "it was killed before it could rename");
    let last = folder.join("out").join(CHECKPOINT);
    let saved = SceneFit::resume(Scene::load(&file).unwrap(), last).unwrap().steps_done();
    let steps = saved as usize + 3;
    let found = fitted(folder, 2, "out", &["--resume", "--steps", &steps.to_string()]);
    assert!(found == alone(&file, steps), "after {saved} steps");
    assert_eq!(unfinished(), None, "what a killed rank left is removed");
}

/// Whether a process takes no further step until it is continued.
fn is_stopped(process: u32) -> bool {
    let status = fs::read_to_string(known(process, "status")).unwrap();
    status.lines().any(|line| line.starts_with("State:") && line.contains('T'))
}

#[test]
fn a_signal_saves_first() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let file = scene(folder, ENDLESS, VIEWS);
    // Ctrl-C; to each process, as Slurm does; and to one rank.
    for (signal, whom) in [("INT", "mpirun"), ("TERM", "all"), ("TERM", "rank-1")] {
        let words = ["fit", "scene.toml", "--out", whom, "--save-every", "1", "--threads", "1"];
        let mut command = command(folder, 3, &words);
        let mut job = Job::start(with_seconds_to_end(&mut command, 2));
        job.wait_until(|| folder.join(whom).join(CHECKPOINT).exists().then_some(()));
        let mpirun = job.mpirun.id();
        let signalled = match whom {
            "mpirun" => vec![mpirun],
            "all" => processes(folder).chain([mpirun]).collect(),
            _ => vec![job.rank(1)],
        };
        signalled.into_iter().for_each(|process| send(signal, process));
        let Ended { status, said } = job.failed();
        assert!(said.contains("go on with: mpirun -n 3 bokashi-mpi fit scene.toml"), "{said}");
        // An abort while mpirun ends the job may leave mpirun waiting for ever.
        assert!(!said.to_lowercase().contains("mpi_abort"), "{said}");
        if whom == "rank-1" {
            assert_eq!(status.code(), Some(143), "{said}");
        }
        let (_, after) = said.split_once("interrupted after ").expect(&said);
        let steps = after.split_whitespace().next().unwrap().parse::<usize>().unwrap() + 3;
        let found = fitted(folder, 2, whom, &["--resume", "--steps", &steps.to_string()]);
        assert!(found == alone(&file, steps), "{whom} after {steps} steps");
    }
}

#[test]
fn what_is_wrong_on_one_rank_ends_all_with_its_message() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    scene(folder, 6, VIEWS);
    // Its size is there, and its pixels are not: the rank that has the view finds out.
    fs::write(folder.join("images/12.png"), &disk(12)[..60]).unwrap();
    let failed = |size, words: &[&str]| {
        let ended = Job::start(&mut command(folder, size, words)).failed();
        (ended.status.code(), ended.said)
    };
    let (status, said) = failed(3, &["fit", "scene.toml", "--out", "out"]);
    assert!(said.contains("bokashi-mpi: rank 2: view 11: "), "{said}");
    assert_eq!(said.matches("12.png").count(), 1, "one rank says it: {said}");
    assert_eq!(status, Some(1), "{said}");

    let (_, said) = failed(2, &["fit", "none.toml"]);
    assert!(said.contains("bokashi-mpi: ") && said.contains("none.toml"), "{said}");
    let (status, said) = failed(2, &["fit", "scene.toml", "--steps", "0.5"]);
    assert_eq!(status, Some(2), "{said}");
    let (status, said) = failed(2, &["fit", "--threads", "1"]);
    assert!(status == Some(2) && said.contains("<SCENE.TOML>"), "{said}");
}

#[test]
fn ranks_take_the_fits_of_a_sweep_and_one_that_fails_harms_no_other() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let expected = alone(&scene(folder, 6, 5), 6);
    let mut list = String::new();
    let fits = [
        ("scene", vec!["scene.toml"]),
        ("none", vec!["none.toml"]),
        ("cube-0", vec!["--resolution", "8", "--steps", "2"]),
        ("cube-1", vec!["--resolution", "8", "--steps", "3", "--seed", "1"]),
        ("cube-2", vec!["--resolution", "8", "--steps", "3", "--seed", "2"]),
    ];
    for (name, arguments) in &fits {
        let paper = name.starts_with("cube");
        list += &format!("[[fit]]\nname = {name:?}\npaper = {paper}\narguments = {arguments:?}\n");
    }
    fs::write(folder.join("sweep.toml"), list).unwrap();
    for size in [1, 3] {
        let out = format!("out-{size}");
        let words = ["sweep", "sweep.toml", "--out", &out];
        let Ended { status, said } = run(&mut command(folder, size, &words));
        assert!(said.contains("1 of 5 fits failed, the first: none: "), "{said}");
        assert_eq!(status.code(), Some(1), "{said}");
        let table = fs::read_to_string(folder.join(&out).join("sweep.csv")).unwrap();
        let rows: Vec<_> =
            table.lines().skip(1).map(|row| row.split(',').next().unwrap()).collect();
        assert_eq!(rows, fits.iter().map(|(name, _)| *name).collect::<Vec<_>>(), "{table}");
        assert_eq!(table.matches("none.toml").count(), 1, "{table}");
        let (_, medians) = said.split_once("Medians over seeds:\n").expect(&said);
        let cube = medians.lines().next().unwrap().split_whitespace().collect::<Vec<_>>();
        assert_eq!(cube[..4], ["cube", "3", "of", "3"], "{said}");
        assert!(medians.contains("  steps 3  loss_final "), "{said}");
        assert!(checkpoint(folder, &format!("{out}/scene")) == expected);
    }
}

#[test]
fn no_fit_of_a_sweep_begins_after_a_signal_and_those_under_way_are_saved() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    scene(folder, ENDLESS, VIEWS);
    let of = |fit: usize| {
        let arguments = r#"["scene.toml", "--save-every", "1", "--threads", "1"]"#;
        format!("[[fit]]\nname = \"fit-{fit}\"\narguments = {arguments}\n")
    };
    fs::write(folder.join("sweep.toml"), (0..5).map(of).collect::<String>()).unwrap();
    // mpirun signals what ranks have started, too.
    for whom in ["rank-1", "mpirun"] {
        let mut command = command(folder, 2, &["sweep", "sweep.toml", "--out", whom]);
        let mut job = Job::start(with_seconds_to_end(&mut command, 2));
        let at = |fit| folder.join(whom).join(format!("fit-{fit}"));
        let runs = |fit| at(fit).join(CHECKPOINT).exists();
        job.wait_until(|| (runs(0) && runs(1)).then_some(()));
        send("TERM", if whom == "mpirun" { job.mpirun.id() } else { job.rank(1) });
        let said = job.failed().said;
        assert!(said.contains("interrupted with 0 of 5 fits done"), "{whom}: {said}");
        for fit in [0, 1] {
            let said = fs::read_to_string(at(fit).join("errors.txt")).unwrap();
            assert!(said.contains("interrupted after "), "{whom}: {said}");
        }
        assert!(!at(2).exists(), "{whom}");
    }
}

#[test]
fn the_papers_experiments_are_a_sweep() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let words = ["reproduce", "--seeds", "1", "--steps", "2"];
    let Ended { status, said } = run(&mut command(folder, 2, &words));
    assert!(status.success(), "{said}");
    let table = fs::read_to_string(folder.join("out/sweep.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 22, "{table}");
    assert!(table.contains("\njoint-tuned-32-antialias-2.8-0,"), "{table}");
    // What a fit reaches is what it reaches alone.
    let arguments = "--experiment joint --preset tuned --sigma 2.8 --steps 2 --json fit.json";
    let mut alone = Command::new(env!("CARGO_BIN_EXE_bokashi-mpi"));
    alone.args(["alone", "paper", "fit"]).args(arguments.split(' ')).current_dir(folder);
    assert!(alone.output().unwrap().status.success());
    let loss = |file: &str| {
        let json: Value = serde_json::from_slice(&fs::read(folder.join(file)).unwrap()).unwrap();
        json["loss_final"].as_f64().unwrap()
    };
    assert_eq!(loss("out/joint-tuned-32-antialias-2.8-0/fit.json"), loss("fit.json"));
}
