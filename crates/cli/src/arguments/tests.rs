//! What command lines come to.

use std::path::Path;

use bokashi_paper::{Experiment, Kernel, Precision, Preset, Saving, Silhouettes};
use clap::CommandFactory as _;

use super::values::bytes;
use super::{Command, Request, Stopped, parse};

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
    let Some(Command::Fit(fit)) = read(line).expect("all of them").command else { panic!("fit") };
    assert_eq!((fit.scene, fit.steps, fit.time), ("a.toml".into(), Some(7), Some(2.5)));
    assert_eq!((fit.live, fit.json, fit.save_every), (Some(0), Some("-".into()), Some(4)));
    assert_eq!((fit.resume, fit.threads), (Some(Some("c".into())), Some(2)));
    assert!(fit.turntable);
    assert_eq!((fit.memory.memory, fit.out, fit.quiet), (Some(8 << 30), Some("a".into()), true));
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
        ("samples --silhouettes soft", "'soft'", "[possible values: aliased, antialias, exact]"),
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
        assert!(text.starts_with(&format!("error: unrecognized subcommand '{word}'")), "{text}");
        assert!(text.contains(tip) && text.contains(usage), "{text}");
        assert!(text.ends_with("For more information, try '--help'."), "{text}");
    }
}

#[test]
fn help_and_version_are_no_failures() {
    for line in ["--help", "-h", "--version", "-V", "help", "fit --help", "paper reproduce -h"] {
        let Err(Stopped::Shown(text)) = read(line) else { panic!("{line}") };
        assert!(text.contains("bokashi"), "{line}: {text}");
    }
}
