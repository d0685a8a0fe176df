//! The program as its users meet it: exit statuses, what it prints, what it writes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use bokashi_examples::{SAMPLES, Sample, Silhouettes};
use serde_json::Value;

use crate::PROGRAM;
use crate::run::{files, folder, loads_nothing, object, run, text};

/// Runs the program in `folder`.
fn bokashi(folder: &Path, line: &str) -> Output {
    run(PROGRAM, folder, &line.split_whitespace().collect::<Vec<_>>())
}

/// The keys of the JSON object, in order.
const KEYS: [&str; 21] = [
    "experiment",
    "preset",
    "resolution",
    "seed",
    "steps",
    "silhouettes",
    "precision",
    "kernel",
    "sigma_target",
    "sigma_final",
    "vertex_error_initial",
    "vertex_error_final",
    "vertex_error_plain",
    "vertex_error_tail",
    "color_error_final",
    "loss_initial",
    "loss_final",
    "ms_per_step_median",
    "target_ms_per_step_median",
    "wall_seconds",
    "history",
];

#[test]
fn json_on_standard_output_is_one_object_with_every_key() {
    let folder = folder();
    let value = object(&bokashi(folder.path(), "paper fit --resolution 8 --steps 12 --json -"));
    let object = value.as_object().expect("an object");
    for key in KEYS {
        assert!(object.contains_key(key), "{key}");
    }
    assert_eq!(object.len(), KEYS.len());
    assert_eq!(value["experiment"], "joint");
    assert_eq!((&value["precision"], &value["silhouettes"]), (&"f32".into(), &"antialias".into()));
    assert_eq!((&value["kernel"], &value["sigma_target"]), (&"sampled".into(), &4.0.into()));
    let history = value["history"].as_array().expect("a list");
    assert_eq!(history.len(), 13);
    for key in ["step", "seconds", "loss", "vertex_error", "sigma"] {
        assert!(history[12][key].is_number(), "{key}");
    }
    assert!(files(folder.path()).is_empty());
}

#[test]
fn keys_that_do_not_apply_are_null() {
    let folder = folder();
    let line = "paper fit --resolution 8 --steps 2 --json - --experiment";
    let vertices = object(&bokashi(folder.path(), &format!("{line} vertices")));
    assert!(vertices["sigma_target"].is_null() && vertices["sigma_final"].is_null());
    assert!(vertices["vertex_error_final"].is_number());
    let sigma = object(&bokashi(folder.path(), &format!("{line} sigma")));
    assert!(sigma["vertex_error_final"].is_null() && sigma["color_error_final"].is_null());
    assert!(sigma["sigma_final"].is_number());
}

#[test]
fn the_same_seed_gives_the_same_bits_for_any_number_of_threads() {
    let folder = folder();
    let run = |threads: usize| {
        let line =
            format!("paper fit --resolution 16 --steps 30 --json - --quiet --threads {threads}");
        let value = object(&bokashi(folder.path(), &line));
        let history = value["history"].as_array().expect("a list");
        let step = |step: &Value| (step["loss"].clone(), step["vertex_error"].clone());
        (value["sigma_final"].clone(), history.iter().map(step).collect::<Vec<_>>())
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(5), one);
}

/// Checks that the program refuses each line before it does anything, in a folder with `file`: with
/// what is right in its message.
fn refuses(table: &[(&str, &str)], is_right: impl Fn(&str) -> bool) {
    let folder = folder();
    fs::write(folder.path().join("file"), "mine").expect("a file");
    for (line, allowed) in table {
        let output = bokashi(folder.path(), line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(output.stdout.is_empty(), "{line}");
        assert!(is_right(&said) && said.contains(allowed), "{line}: {said}");
        assert_eq!(files(folder.path()), ["file"], "{line}");
    }
    assert_eq!(fs::read(folder.path().join("file")).expect("still there"), b"mine");
}

/// Whether a message is the program's own: one line.
fn is_one_line(said: &str) -> bool {
    said.starts_with("bokashi: ") && said.trim_end_matches('\n').lines().count() == 1
}

#[test]
fn a_command_line_that_cannot_be_read_is_status_2_and_the_parsers_message() {
    let table = [
        ("paper fit --experiment all", "vertices, sigma, joint"),
        ("paper fit --resolution 0", "from 1 to 4096"),
        ("paper fit --sigma 0", "above 0"),
        ("paper fit --sigma -1", "above 0"),
        ("paper fit --sigma NaN", "above 0"),
        ("paper fit --steps 0", "from 1"),
        ("paper fit --threads 0", "from 1"),
        ("paper fit --threads 1025", "to 1024"),
        ("paper fit --precision f16", "f32, f64"),
        ("paper fit --unknown", "--help"),
        ("paper fit --save-every 3", "--save <FILE>"),
        ("dance", "the commands are fit, paper, samples"),
        ("paper dance", "the commands are fit, reproduce"),
        ("fooo", "Usage: bokashi [OPTIONS]\n       bokashi <COMMAND>\n"),
        ("fitt", "similar subcommand exists: 'fit'"),
        ("stability", "--help"),
        ("bench", "--help"),
        ("paper reproduce --seeds 0", "from 1"),
    ];
    refuses(&table, |said| {
        said.starts_with("error: ") && said.ends_with("For more information, try '--help'.\n")
    });
}

#[test]
fn a_wrong_request_is_status_2_and_one_line() {
    let table = [
        ("paper fit --steps 1 --out file", "--out"),
        ("paper fit --steps 1 --out file/below", "--out"),
        ("--steps 1 --out file", "--out"),
        ("paper fit --steps 1 --json .", "--json"),
        ("paper fit --steps 1 --json no/such/folder.json", "--json"),
        ("paper fit --steps 1 --json file/below", "--json"),
        ("paper fit --experiment vertices --sigma 1", "--sigma needs --experiment sigma or joint"),
        ("paper fit --steps 1 --preset second-order --save kept", "needs a first-order preset"),
        ("paper fit --steps 1 --json a --save a", "--save needs another file than --json, got a"),
        ("paper fit --steps 1 --json a --save no/.././a", "--save needs"),
        (
            "paper fit --steps 1 --json file --resume file",
            "--json needs another file than --resume",
        ),
        ("paper fit --steps 1 --out d --save d", "--save needs another file than --out, got d"),
        ("paper fit --steps 1 --out a/b --json a", "--json needs another file than --out, got a"),
        (
            "paper fit --steps 1 --out . --json index.html",
            "--json needs a file that is not of the report",
        ),
        (
            "paper fit --steps 1 --out . --save fits.csv",
            "--save needs a file that is not of the report",
        ),
    ];
    refuses(&table, is_one_line);
}

#[test]
fn more_threads_than_can_be_started_are_refused_wherever_they_are_asked_for() {
    let folder = folder();
    let mut command = Command::new(PROGRAM);
    command.args(["paper", "fit", "--resolution", "8", "--steps", "1"]).current_dir(folder.path());
    let output = command.env("RAYON_NUM_THREADS", "999999").output().expect("it starts");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(is_one_line(&said), "{said}");
    assert!(said.ends_with("RAYON_NUM_THREADS needs a whole number up to 1024, got 999999\n"));
    // What is asked for comes before what the environment says.
    let output = command.args(["--threads", "1", "--quiet"]).output().expect("it starts");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn help_and_version_are_status_0() {
    let folder = folder();
    for line in [
        "--help",
        "fit --help",
        "paper --help",
        "paper fit --help",
        "paper reproduce --help",
        "--version",
    ] {
        let output = bokashi(folder.path(), line);
        assert_eq!(output.status.code(), Some(0), "{line}");
        assert!(text(&output.stdout).contains("bokashi"), "{line}");
        assert!(output.stderr.is_empty(), "{line}");
    }
}

#[test]
fn quiet_prints_nothing_and_a_fit_writes_only_what_it_is_asked_for() {
    let folder = folder();
    let output = bokashi(folder.path(), "paper fit --resolution 8 --steps 3 --quiet");
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
    assert!(files(folder.path()).is_empty());

    let line = "paper fit --resolution 8 --steps 3 --quiet --json fit.json";
    let output = bokashi(folder.path(), line);
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
    assert_eq!(files(folder.path()), ["fit.json"]);
}

#[test]
fn a_fit_ends_with_its_errors_and_times() {
    let folder = folder();
    let output = bokashi(folder.path(), "paper fit --resolution 8 --steps 3");
    let said = text(&output.stdout);
    assert!(said.contains("vertices") && said.contains("ms/step"), "{said}");
    assert!(output.stderr.is_empty(), "no bar without a terminal");
}

#[test]
fn a_report_is_a_page_that_needs_nothing_else_with_tables_and_pictures_beside_it() {
    let folder = folder();
    let line = "paper fit --resolution 8 --steps 20 --sigma 1.4 --out made/here";
    let output = bokashi(folder.path(), line);
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    assert!(text(&output.stdout).contains("Report: "));
    let made = folder.path().join("made/here");
    assert_eq!(
        files(&made),
        [
            "fit.png",
            "fits.csv",
            "histories.csv",
            "index.html",
            "pictures/joint-8px-sigma-1.4-paper-f32.png"
        ]
    );
    let page = fs::read_to_string(made.join("index.html")).expect("a page");
    assert!(page.contains("Error against run time"));
    assert!(page.find("Error against run time") < page.find("Every fit"));
    loads_nothing(&page);
    // With a comma, a quote or a bracket: the letters alone may be part of a picture.
    for wrong in [">NaN", "NaN,", ",NaN", "\"NaN", "inf,", ">inf"] {
        assert!(!page.contains(wrong), "{wrong}");
    }
    let table = fs::read_to_string(made.join("fits.csv")).expect("a table");
    let columns: Vec<usize> = table.lines().map(|row| row.split(',').count()).collect();
    assert_eq!(columns, [22, 22]);
}

#[test]
fn without_a_command_four_sigmas_are_fitted_at_two_sets_of_rates_into_out() {
    let folder = folder();
    let output = bokashi(folder.path(), "--steps 2");
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    let table = fs::read_to_string(folder.path().join("out/fits.csv")).expect("a table");
    assert_eq!(table.lines().count(), 9);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_status_1_and_one_line() {
    let folder = folder();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("a full device");
    let mut command = Command::new(PROGRAM);
    command.args(["paper", "fit", "--resolution", "8", "--steps", "2", "--json", "-"]);
    let output = command.current_dir(folder.path()).stdout(full).output().expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(text(&output.stderr).lines().count(), 1);
}

/// The figures of samples, without their seconds.
fn figures(value: &Value) -> Vec<Value> {
    let mut figures = value.as_array().expect("a list").clone();
    for figure in &mut figures {
        assert!(figure["seconds"].take().is_number());
    }
    figures
}

#[test]
fn samples_are_a_list_of_figures_and_the_same_bits_for_any_number_of_threads() {
    let folder = folder();
    let line = "samples --only pose --only triangle --steps 20 --seeds 2 --first-seed 5 --json -";
    let run = |options: &str| object(&bokashi(folder.path(), &format!("{line} {options}")));
    let value = run("--threads 1");
    let keys = ["sample", "seed", "metric", "value", "goal", "pass", "steps", "seconds"];
    for figure in value.as_array().expect("a list") {
        assert_eq!(figure.as_object().expect("an object").len(), keys.len());
        assert!(keys.iter().all(|key| figure.get(key).is_some()), "{figure}");
    }
    let found = figures(&value);
    let pose = |seed: u64| {
        let is_it = |figure: &&Value| figure["sample"] == "pose" && figure["seed"] == seed;
        found.iter().find(is_it).expect("a figure")
    };
    assert_eq!((&pose(5)["goal"], &pose(5)["steps"]), (&"below 0.5".into(), &20.into()));
    assert_ne!(pose(5)["value"], pose(6)["value"]);
    assert_eq!(figures(&run("--threads 3 --silhouettes antialias")), found);
    assert_ne!(figures(&run("--silhouettes exact")), found);
    assert!(files(folder.path()).is_empty());
}

#[test]
fn the_page_of_the_samples_needs_nothing_else() {
    let folder = folder();
    let line = "samples --only triangle --only cube --steps 3 --out report --json figures.json";
    let output = bokashi(folder.path(), line);
    assert_eq!(output.status.code(), Some(0));
    // A figure of the triangle, and six of the cube.
    assert_eq!(text(&output.stdout).lines().filter(|line| line.contains("(seed 0)")).count(), 7);
    assert_eq!(files(folder.path()), ["figures.json", "report/samples.html"]);
    let page = fs::read_to_string(folder.path().join("report/samples.html")).expect("a page");
    loads_nothing(&page);
    let words = [
        "<svg",
        "data:image/png;base64,",
        "vertex distance, 4 px, 24 colours",
        "above 25",
        "Silhouettes: exact.",
    ];
    for word in words {
        assert!(page.contains(word), "{word}");
    }
}

#[test]
fn the_help_of_samples_says_which_have_exact_silhouettes() {
    let help = text(&bokashi(folder().path(), "samples --help").stdout);
    let is_exact = |sample: &&Sample| sample.silhouettes == Silhouettes::Exact;
    let names: Vec<_> = SAMPLES.iter().filter(is_exact).map(|sample| sample.name).collect();
    let (last, others) = names.split_last().expect("a sample");
    let expected = format!("exact for {} and {last}, antialias", others.join(", "));
    let words: Vec<_> = help.split_whitespace().collect();
    assert!(words.join(" ").contains(&expected), "{help}");
}

/// The object without what depends on the clock, and its history from `step` on.
fn timeless(mut value: Value, step: u64) -> (Value, Vec<Value>) {
    for key in ["ms_per_step_median", "target_ms_per_step_median", "wall_seconds"] {
        value[key] = Value::Null;
    }
    // The tail is that of the run.
    value["vertex_error_tail"] = Value::Null;
    let history = value["history"].take();
    let mut history = history.as_array().expect("a list").clone();
    history.retain(|record| record["step"].as_u64().expect("a number") >= step);
    history.iter_mut().for_each(|record| record["seconds"] = Value::Null);
    (value, history)
}

#[test]
fn a_saved_fit_goes_on_to_the_same_bits() {
    let folder = folder();
    let fit = "paper fit --resolution 8 --seed 3 --sigma 1.4";
    for (precision, silhouettes, kernel) in
        [("f32", "antialias", "sampled"), ("f64", "exact", "disc")]
    {
        let run = |line: &str| object(&bokashi(folder.path(), &format!("{line} --json -")));
        let precise = format!("{fit} --precision {precision} --silhouettes {silhouettes}");
        let precise = format!("{precise} --kernel {kernel}");
        let whole = run(&format!("{precise} --steps 20"));
        run(&format!("{precise} --steps 7 --save kept"));
        assert_eq!(files(folder.path()), ["kept"]);
        // By the file alone, with its options repeated, and on another number of threads.
        for line in [
            "paper fit --resume kept --steps 20".to_owned(),
            format!("{precise} --resume kept --steps 20"),
            "paper fit --resume kept --steps 20 --threads 3".to_owned(),
        ] {
            assert_eq!(timeless(run(&line), 0), timeless(whole.clone(), 7), "{line}");
        }
        // And on from there, in the same file.
        run("paper fit --resume kept --steps 12 --save kept");
        let rest = run("paper fit --resume kept --steps 20 --save kept --save-every 3");
        assert_eq!(timeless(rest, 0), timeless(whole, 12));
    }
}

#[test]
fn a_file_that_cannot_be_resumed_is_bad_use_in_one_line() {
    let folder = folder();
    let saved = bokashi(folder.path(), "paper fit --resolution 8 --steps 5 --save kept --quiet");
    assert_eq!((saved.status.code(), text(&saved.stderr)), (Some(0), String::new()));
    let bytes = fs::read(folder.path().join("kept")).expect("saved");
    fs::write(folder.path().join("short"), &bytes[..bytes.len() - 1]).expect("written");
    fs::write(folder.path().join("foreign"), b"{}").expect("written");
    for (line, allowed) in [
        ("paper fit --resume missing", "missing could not be read"),
        ("paper fit --resume foreign", "a saved fit needs a safetensors file, got 2 bytes"),
        ("paper fit --resume short", "a saved fit needs"),
        ("paper fit --resume kept --seed 1", "--seed needs to be that of the saved fit, 0, got 1"),
        ("paper fit --resume kept --silhouettes exact", "the saved fit, antialias, got exact"),
        ("paper fit --resume kept --precision f64", "the saved fit, f32, got f64"),
        ("paper fit --resume kept --kernel disc", "the saved fit, sampled, got disc"),
        (
            "paper fit --resume kept --steps 4",
            "steps needs no fewer than are already done, got 4 of 5",
        ),
        ("paper fit --resume kept --preset second-order", "the saved fit, paper, got second-order"),
        ("paper fit --save no/such/folder/kept", "--save needs a file to write to"),
    ] {
        let output = bokashi(folder.path(), line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(allowed) && said.lines().count() == 1, "{line}: {said}");
    }
    assert_eq!(files(folder.path()), ["foreign", "kept", "short"]);
}

/// The program with no signal ignored, whatever those who run the tests ignore.
#[cfg(target_os = "linux")]
fn heedful() -> Command {
    let mut command = Command::new("env");
    command.args(["--default-signal=HUP,INT,TERM", PROGRAM]);
    command
}

/// A long fit in `folder` with more options, under way: it has saved itself.
#[cfg(target_os = "linux")]
fn under_way(folder: &Path, options: &str) -> std::process::Child {
    let fit = "paper fit --resolution 16 --steps 200000 --experiment sigma --quiet --save kept";
    let mut command = heedful();
    command.args(fit.split_whitespace()).args(["--save-every", "50"]);
    command.args(options.split_whitespace()).current_dir(folder).stdin(Stdio::null());
    let child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
    let mut looks = 0;
    while !folder.join("kept").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
        looks += 1;
        assert!(looks < 20_000, "nothing was saved");
    }
    child
}

/// Sends a signal to the program.
#[cfg(target_os = "linux")]
fn send(signal: &str, child: &std::process::Child) {
    let mut kill = Command::new("kill");
    let sent = kill.args(["-s", signal, &child.id().to_string()]).status().expect("kill runs");
    assert!(sent.success());
}

#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_a_fit_with_128_and_its_number() {
    for (signal, status) in [("HUP", 129), ("INT", 130), ("TERM", 143)] {
        let folder = folder();
        let child = under_way(folder.path(), "");
        send(signal, &child);
        let output = child.wait_with_output().expect("it ends");
        assert_eq!(output.status.code(), Some(status), "{}", text(&output.stderr));
        assert!(text(&output.stderr).starts_with("bokashi: interrupted at step "));
        assert_eq!(files(folder.path()), ["kept"]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_signal_that_was_ignored_stays_ignored() {
    let folder = folder();
    let program = PROGRAM;
    let fit = "paper fit --resolution 16 --steps 3000 --experiment sigma --quiet --json out.json";
    // The shell tells its number, which the program keeps.
    let script = format!("trap '' HUP; echo $$; exec '{program}' {fit}");
    let mut command = Command::new("sh");
    command.args(["-c", &script]).current_dir(folder.path()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    let mut number = String::new();
    let output = child.stdout.as_mut().expect("piped");
    std::io::BufRead::read_line(&mut std::io::BufReader::new(output), &mut number).expect("a line");
    std::thread::sleep(std::time::Duration::from_millis(50));
    send("HUP", &child);
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
    assert_eq!(files(folder.path()), ["out.json"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_that_never_ends_is_left_at_the_second_signal() {
    let folder = folder();
    let fifo = folder.path().join("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success());
    let mut command = heedful();
    let fit = "paper fit --resolution 8 --steps 2 --quiet --json fifo";
    command.args(fit.split_whitespace()).current_dir(folder.path());
    let mut child = command.spawn().expect("it starts");
    // Until it ends: the first ones wait for a reader of the FIFO, who never comes.
    let mut sent = 0;
    let status = loop {
        std::thread::sleep(std::time::Duration::from_millis(100));
        if let Some(status) = child.try_wait().expect("a child") {
            break status;
        }
        send("INT", &child);
        sent += 1;
        assert!(sent < 100, "it does not end");
    };
    assert_eq!(status.code(), Some(130));
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_ends_the_program_without_a_word() {
    let folder = folder();
    let mut command = Command::new(PROGRAM);
    // Long enough: until it has started, a program of another test holds the pipe's other end, too.
    command.args(["paper", "fit", "--resolution", "8", "--steps", "5000", "--json", "-"]);
    command.current_dir(folder.path()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(141), String::new()));
}

#[cfg(target_os = "linux")]
#[test]
fn what_is_no_regular_file_is_written_in_place() {
    let folder = folder();
    let fit = "paper fit --resolution 8 --steps 2 --quiet --json";
    let value = object(&bokashi(folder.path(), &format!("{fit} /dev/stdout")));
    assert_eq!(value["steps"], 2);
    let output = bokashi(folder.path(), &format!("{fit} /dev/stderr"));
    assert_eq!((output.status.code(), text(&output.stdout)), (Some(0), String::new()));
    assert!(serde_json::from_slice::<Value>(&output.stderr).is_ok());
    assert!(files(folder.path()).is_empty());
    // A descriptor that the shell opened, whose file keeps what is there.
    let program = PROGRAM;
    let script = format!("echo before > log; exec 5>> log; '{program}' {fit} /dev/fd/5");
    let mut shell = Command::new("sh");
    let status = shell.args(["-c", &script]).current_dir(folder.path()).status().expect("a shell");
    assert_eq!(status.code(), Some(0));
    let log = fs::read_to_string(folder.path().join("log")).expect("a file");
    assert!(log.starts_with("before\n{") && log.lines().count() == 2, "{log}");
    let full = bokashi(folder.path(), &format!("{fit} /dev/full"));
    assert_eq!(full.status.code(), Some(1));
    assert!(is_one_line(&text(&full.stderr)));
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_a_mode_is_kept_and_a_read_only_file_is_refused() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let mode = |mode| fs::Permissions::from_mode(mode);
    fs::write(at("end"), "old").expect("a file");
    fs::set_permissions(at("end"), mode(0o600)).expect("its mode");
    symlink("end", at("link")).expect("a link");
    let line = "paper fit --resolution 8 --steps 2 --quiet --json link --save kept";
    assert_eq!(bokashi(folder.path(), line).status.code(), Some(0));
    assert!(fs::symlink_metadata(at("link")).expect("there").is_symlink());
    let found = fs::metadata(at("end")).expect("there");
    assert_eq!(found.permissions().mode() & 0o777, 0o600);
    assert!(found.len() > 100);

    fs::set_permissions(at("end"), mode(0o444)).expect("its mode");
    let output = bokashi(folder.path(), line);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(is_one_line(&said) && said.trim_end().ends_with("end is read-only"), "{said}");
    let twice = bokashi(folder.path(), "paper fit --resolution 8 --steps 2 --json end --save link");
    assert_eq!(twice.status.code(), Some(2));
    assert_eq!(files(folder.path()), ["end", "kept", "link"]);
}

#[cfg(unix)]
#[test]
fn what_a_killed_run_left_behind_is_removed_by_the_next() {
    let folder = folder();
    let stray = folder.path().join(".kept.bokashi-k1ll3d");
    fs::write(&stray, "half a file").expect("a file");
    let line = "paper fit --resolution 8 --steps 2 --quiet --save";
    assert_eq!(bokashi(folder.path(), &format!("{line} other")).status.code(), Some(0));
    assert_eq!(files(folder.path()), [".kept.bokashi-k1ll3d", "other"]);
    assert_eq!(bokashi(folder.path(), &format!("{line} kept")).status.code(), Some(0));
    assert_eq!(files(folder.path()), ["kept", "other"]);
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupted_fit_is_saved_and_goes_on_to_the_same_bits() {
    let folder = folder();
    let child = under_way(folder.path(), "--json out.json");
    // Twice at once: a parent may send it, and whoever signals all of its children.
    send("INT", &child);
    send("INT", &child);
    let output = child.wait_with_output().expect("it ends");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    let rest = said.strip_prefix("bokashi: interrupted at step ").expect("where it was");
    assert!(
        said.trim_end().ends_with("it goes on with: bokashi paper fit --resume kept"),
        "{said}"
    );
    let done: u64 = rest.split(' ').next().expect("a number").parse().expect("a number");
    assert!(done < 200_000);
    // The file and nothing else: no outcome of half a fit, no temporary file.
    assert_eq!(files(folder.path()), ["kept"]);

    let steps = done + 20;
    let short = format!("--steps {steps} --json -");
    let rest = object(&bokashi(folder.path(), &format!("paper fit --resume kept {short}")));
    let whole = "paper fit --resolution 16 --experiment sigma";
    let whole = object(&bokashi(folder.path(), &format!("{whole} {short}")));
    assert_eq!(timeless(rest, 0), timeless(whole, done));
}
