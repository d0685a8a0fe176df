//! The program as those who work on Bokashi meet it: exit statuses, what it prints, what it writes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use bokashi_lab::bench::Effort;
use serde_json::Value;

use crate::run::{files, folder, loads_nothing, object, run, text, write};

/// Runs the program in `folder`.
fn lab(folder: &Path, line: &str) -> Output {
    run(env!("CARGO_BIN_EXE_bokashi-lab"), folder, &line.split_whitespace().collect::<Vec<_>>())
}

#[test]
fn every_row_of_the_grid_passes_and_is_printed_kept_and_added_to_a_report() {
    let folder = folder();
    // Two at once: another run says the same, on other threads.
    let [printed, alone] = std::thread::scope(|scope| {
        let alone = scope.spawn(|| lab(folder.path(), "stability --json - --threads 1"));
        let printed = lab(folder.path(), "stability --out made --json grid.json --threads 2");
        [printed, alone.join().expect("it ends")]
    });
    let said = text(&printed.stdout);
    assert_eq!((printed.status.code(), text(&printed.stderr)), (Some(0), String::new()), "{said}");
    assert!(said.contains("ok     4 f64 repeated index in a face"), "{said}");
    assert!(said.contains("error 0.0e0, bound 0.0e0") && said.contains(" passed, 0 failed"));
    assert!(said.lines().all(|line| line.chars().count() <= 80), "{said}");
    let expected = ["grid.json", "made/stability-rows.csv", "made/stability.html"];
    assert_eq!(files(folder.path()), expected);
    let page = fs::read_to_string(folder.path().join("made/stability.html")).expect("a page");
    assert!(page.contains("fan of 512 faces") && page.contains("each pixel once"));
    loads_nothing(&page);
    let csv = fs::read_to_string(folder.path().join("made/stability-rows.csv")).expect("a file");
    assert!(csv.starts_with("case,name,precision,expected,outcome,pass,error,bound\n"), "{csv}");
    assert!(csv.contains("\n21,fan of 512 faces,f64,each pixel once,"), "{csv}");

    let json = fs::read(folder.path().join("grid.json")).expect("a file");
    assert_eq!((alone.status.code(), text(&alone.stderr)), (Some(0), String::new()));
    assert_eq!(text(&alone.stdout).trim_end(), text(&json).trim_end());
    let rows: Value = serde_json::from_slice(&json).expect("a list");
    let rows = rows.as_array().expect("a list");
    assert_eq!(rows.len(), bokashi_lab::stability::row_count());
    assert_eq!(rows.len(), said.lines().filter(|line| line.starts_with("ok ")).count());
    // Messages of several lines are in quotes.
    assert_eq!(csv.matches(",true,").count(), rows.len(), "{csv}");
    for precision in ["f32", "f64"] {
        let cases = rows.iter().filter(|row| row["precision"] == precision);
        let cases: Vec<u64> = cases.filter_map(|row| row["case"].as_u64()).collect();
        assert!(cases.contains(&1) && cases.contains(&189));
    }
    for row in rows {
        assert_eq!(row["pass"], true, "{row}");
        let mut keys: Vec<_> = row.as_object().expect("objects").keys().collect();
        keys.sort_unstable();
        let expected =
            ["bound", "case", "error", "expected", "name", "outcome", "pass", "precision"];
        assert_eq!(keys, expected);
        assert!(row["error"].is_number() || row["error"].is_null());
        assert_eq!(row["error"].is_number(), row["bound"].is_number(), "{row}");
        assert!(!row["case"].is_null() || row["expected"] == "an error", "{row}");
        assert!(row["case"] != 21 || row["error"].is_number(), "{row}");
    }
}

#[test]
fn a_bench_has_every_study_as_markdown_json_csv_and_a_page() {
    let folder = folder();
    let output = lab(folder.path(), "bench --quick --out made --json bench.json");
    let said = text(&output.stdout);
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()), "{said}");
    assert!(said.contains("THIS IS A QUICK RUN") && said.contains("rustc"), "{said}");
    assert!(said.contains("| cube@32 "), "{said}");
    let json = fs::read(folder.path().join("bench.json")).expect("a file");
    let found: Value = serde_json::from_slice(&json).expect("an object");
    assert_eq!(found["quick"], true);
    let studies = found["studies"].as_array().expect("a list");
    let names: Vec<&str> = studies.iter().filter_map(|study| study["study"].as_str()).collect();
    let all = "scenes meshes silhouettes fits photographs blur lens \
               lens_fits lens_times operations surfaces nodes";
    assert_eq!(names.join(" "), all);
    let page = fs::read_to_string(folder.path().join("made/bench.html")).expect("a page");
    loads_nothing(&page);
    assert!(page.contains("THIS IS A QUICK RUN") && !page.contains("NaN"));
    for study in studies {
        assert_eq!(study["failures"], Value::Array(Vec::new()));
        assert!(page.contains(&format!("<section id={}", study["study"])), "{study}");
        for (name, rows) in study["tables"].as_object().expect("tables by name") {
            let rows = rows.as_array().expect("a list");
            assert!(!rows.is_empty(), "{name}");
            let file = format!("made/bench-{name}.csv");
            let csv = fs::read_to_string(folder.path().join(&file)).expect("a file");
            assert_eq!(csv.lines().count(), rows.len() + 1, "{file}");
        }
    }
    // What was looked at before the work: all but a table beside others' libraries, of which none were given.
    let mut known = bokashi_lab::bench::files(Effort::Quick, &[], false);
    known.retain(|name| name != "bench-blur_libraries.csv");
    known.sort();
    assert_eq!(files(&folder.path().join("made")), known);
}

#[test]
fn a_table_that_cannot_be_written_is_found_before_the_work() {
    for (line, file) in [
        ("bench --only nodes", "bench-nodes.csv"),
        ("bench elision", "elision-rows.csv"),
        ("stability", "stability-rows.csv"),
        ("stiff", "stiff-conditions.csv"),
    ] {
        let folder = folder();
        fs::create_dir_all(folder.path().join("made").join(file)).expect("a folder in its place");
        let output = lab(folder.path(), &format!("{line} --out made"));
        let said = text(&output.stderr);
        assert_eq!(
            (output.status.code(), text(&output.stdout)),
            (Some(2), String::new()),
            "{line}"
        );
        assert!(said.contains("--out needs a folder to write to") && said.contains(file), "{said}");
    }
}

#[test]
fn a_bench_takes_meshes_from_files() {
    let folder = folder();
    let line = |name: &str| format!("bench --quick --only meshes --mesh {name}");
    let corners =
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let mesh = corners.concat() + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(folder.path().join("corner.obj"), mesh).expect("a file");
    let output = lab(folder.path(), &line("corner.obj"));
    let said = text(&output.stdout);
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()), "{said}");
    assert!(
        said.contains("| corner | 4     | 4        | 0 ") && !said.contains("Failed"),
        "{said}"
    );
    fs::write(folder.path().join("none.obj"), "v 0 0 0\n").expect("a file");
    let output = lab(folder.path(), &line("none.obj"));
    let said = text(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("--mesh needs a mesh file"), "{said}");
}

#[test]
fn a_bench_sets_the_times_of_others_beside_ours() {
    let folder = folder();
    let peers = r#"[{"study": "scenes", "name": "DEODR", "scene": "cube@32",
        "minimum_microseconds": 70000.0, "median_microseconds": 80000.0},
        {"study": "surfaces", "name": "PyTorch", "scene": "forward", "threads": 2,
        "minimum_microseconds": 6000.0, "median_microseconds": 7000.0, "error": 0.25},
        {"study": "surfaces", "name": "PyTorch", "scene": "forward and backward", "threads": 2,
        "minimum_microseconds": 28000.0, "median_microseconds": 29000.0, "error": 0.5}]"#;
    fs::write(folder.path().join("peers.json"), peers).expect("a file");
    let value = object(&lab(
        folder.path(),
        "bench --quick --only scenes --only surfaces --peers peers.json --json -",
    ));
    let table = |study: usize, name: &str| value["studies"][study]["tables"][name].clone();
    assert_eq!(table(0, "scenes")[0]["deodr_milliseconds"], 70.0);
    let surfaces = table(1, "surfaces");
    let theirs = surfaces.as_array().and_then(|rows| rows.last()).expect("rows");
    assert_eq!((&theirs["operation"], &theirs["threads"]), (&"PyTorch".into(), &2.into()));
    assert_eq!(theirs["forward_minimum_milliseconds"], 6.0);
    assert_eq!(theirs["step_minimum_milliseconds"], 28.0);
    assert_eq!(theirs["step_median_milliseconds"], 29.0);
    assert_eq!((&theirs["output_error"], &theirs["gradient_error"]), (&0.25.into(), &0.5.into()));
}

#[test]
fn what_is_left_out_is_a_list_of_rows_with_four_keys() {
    let folder = folder();
    let output = lab(folder.path(), "bench elision --quick --json - --out made");
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    let rows: Value = serde_json::from_slice(&output.stdout).expect("one list");
    let rows = rows.as_array().expect("a list");
    let names: Vec<&str> = rows.iter().filter_map(|row| row["row"].as_str()).collect();
    let expected = [
        "frozen positions",
        "frozen colours",
        "frozen sigma",
        "sigma 0",
        "antialias without discontinuities",
        "empty background",
        "no face near the near plane",
        "depth not asked for",
        "frozen positions of a lit surface",
        "frozen light",
        "texture without mipmaps",
        "differentials not asked for",
        "frozen texels",
        "fixed coordinates",
        "a single layer",
        "hidden layers",
        "inference without gradients",
    ];
    assert_eq!(names, expected);
    for row in rows {
        let mut keys: Vec<_> = row.as_object().expect("objects").keys().collect();
        keys.sort_unstable();
        assert_eq!(keys, ["bitwise_equal", "microseconds_with", "microseconds_without", "row"]);
        assert_eq!(row["bitwise_equal"], true, "{row}");
        assert!(row["microseconds_with"].is_number() && row["microseconds_without"].is_number());
    }
    assert_eq!(files(folder.path()), ["made/elision-rows.csv", "made/elision.html"]);
    let page = fs::read_to_string(folder.path().join("made/elision.html")).expect("a page");
    loads_nothing(&page);
    // Another command's page in the same folder: each names the other.
    let output = lab(folder.path(), "bench --quick --only nodes --out made");
    assert_eq!(output.status.code(), Some(0));
    let read = |name| fs::read_to_string(folder.path().join(name)).expect("a page");
    assert!(read("made/bench.html").contains("<a href=\"elision.html\">What is left out</a>"));
    assert!(read("made/elision.html").contains("<a href=\"bench.html\">Speed</a>"));
}

#[cfg(unix)]
#[test]
fn a_grid_that_nobody_reads_ends_without_a_word() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bokashi-lab"));
    command.arg("stability").stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(141), String::new()));
}

#[test]
fn bad_use_is_status_2_and_says_what_is_allowed() {
    let folder = folder();
    fs::write(folder.path().join("file"), "mine").expect("a file");
    let table = [
        ("stability --out file", "--out"),
        ("stability --json .", "--json"),
        ("stability --threads 0", "from 1"),
        ("bench --out file", "--out"),
        ("bench --peers no-such-file", "--peers needs a file that lab/peers wrote"),
        ("bench --peers file", "--peers needs a file that lab/peers wrote"),
        ("bench elision --json .", "--json"),
        ("bench --peers file --json file", "--json needs another file than --peers"),
        (
            "stability --out . --json stability.html",
            "--json needs a file that is not of the report",
        ),
        ("bench elision --peers file", "--help"),
        ("stiff --seeds 0", "from 1"),
        ("stiff --out file", "--out"),
        ("dance", "--help"),
        ("", "subcommand"),
    ];
    for (line, allowed) in table {
        let output = lab(folder.path(), line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(output.stdout.is_empty(), "{line}");
        assert!(said.contains(allowed), "{line}: {said}");
        // One line, or what the parser says of a command line.
        let is_one_line = said.trim_end_matches('\n').lines().count() == 1;
        let is_the_parsers = said.starts_with("error: ") && said.contains("--help");
        assert!(
            is_the_parsers || said.starts_with("bokashi-lab: ") && is_one_line,
            "{line}: {said}"
        );
        assert_eq!(files(folder.path()), ["file"], "{line}");
    }
    assert_eq!(fs::read(folder.path().join("file")).expect("still there"), b"mine");
}

#[test]
fn help_and_version_are_status_0() {
    let folder = folder();
    for line in ["--help", "stability --help", "stiff --help", "bench elision --help", "--version"]
    {
        let output = lab(folder.path(), line);
        assert_eq!(output.status.code(), Some(0), "{line}");
        assert!(text(&output.stdout).contains("bokashi-lab"), "{line}");
        assert!(output.stderr.is_empty(), "{line}");
    }
}

#[test]
fn models_of_others_are_counted_and_refusals_say_why() {
    let folder = folder();
    write(folder.path(), "m/a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write(folder.path(), "m/below/B.OBJ", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    write(folder.path(), "m/below/c.ply", "plx");
    write(folder.path(), "m/d.stl", "no mesh that is read");
    let output = lab(folder.path(), "models m --expect obj=1/2 --expect ply=0/1 --json m.json");
    let said = text(&output.stdout);
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()), "{said}");
    assert!(said.contains("| obj    | 2     | 1      | 1       | 0      |"), "{said}");
    let why = "- refused: below/B.OBJ:4: the file has 3 of the kind \"vertex\", and a face names number 9";
    assert!(said.contains(why), "{said}");
    let json = fs::read(folder.path().join("m.json")).expect("a file");
    let found: Value = serde_json::from_slice(&json).expect("a list");
    assert_eq!(found.as_array().map(Vec::len), Some(3));
    assert_eq!(
        (&found[0]["path"], &found[0]["outcome"]["loaded"]["faces"]),
        (&"a.obj".into(), &1.into())
    );

    let output = lab(folder.path(), "models m --expect obj=2/2 --json -");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("2 of 2 files of the format obj load, and these are 1 of 2"), "{error}");
    assert_eq!(text(&output.stdout), text(&json));
    let output = lab(folder.path(), "models missing");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
}
