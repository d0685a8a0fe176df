//! What is compiled, by figures that are the same on any machine: units and foreign crates as cargo plans
//! them, bytes of machine code in a release build, and how much of that the program has.
//!
//! `table.txt` has today's figures. None may grow by more than a twentieth.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::Path;
use std::process::Command;

use object::read::archive::ArchiveFile;
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionKind, SymbolKind};
use serde_json::Value;

/// How much larger than in the table a figure may be.
const GROWTH: f64 = 1.05;

/// Cargo for this workspace. The network has nothing that a build of it has not fetched.
fn cargo(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO"));
    command.args(words).arg("--offline").current_dir(root());
    command
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// What a command that succeeds says on standard output.
fn output(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?} fails: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// A call of the compiler, or of a build script.
struct Unit {
    package: String,
    target: String,
    mode: String,
    features: String,
    is_program: bool,
    /// Hash of all that it is compiled from: units of one identity are compiled once.
    identity: u64,
}

impl Unit {
    /// What may be compiled several times, with other features or dependencies.
    fn name(&self) -> [&str; 3] {
        [&self.package, &self.target, &self.mode]
    }
}

/// All units that cargo plans for a command.
fn plan(words: &[&str]) -> Vec<Unit> {
    let plan = ["--unit-graph", "-Zunstable-options"];
    // Nothing is compiled. What stable cargo plans is what it does, though it has no stable way to say so.
    let json = output(cargo(&[words, &plan].concat()).env("RUSTC_BOOTSTRAP", "1"));
    let graph: Value = serde_json::from_str(&json).unwrap();
    let units = graph["units"].as_array().unwrap();
    let mut identities = HashMap::new();
    let read = |(index, unit): (usize, &Value)| {
        let kind = unit["target"]["kind"][0].as_str().unwrap();
        let mode = unit["mode"].as_str().unwrap();
        Unit {
            package: unit["pkg_id"].as_str().unwrap().to_owned(),
            target: unit["target"]["name"].to_string(),
            mode: mode.to_owned(),
            features: unit["features"].to_string(),
            is_program: mode == "test" || (mode == "build" && ["bin", "example"].contains(&kind)),
            identity: identity(units, index, &mut identities),
        }
    };
    units.iter().enumerate().map(read).collect()
}

fn identity(units: &[Value], index: usize, known: &mut HashMap<usize, u64>) -> u64 {
    if let Some(&identity) = known.get(&index) {
        return identity;
    }
    let mut unit = units[index].clone();
    let dependencies = unit["dependencies"].take();
    let mut hasher = DefaultHasher::new();
    unit.to_string().hash(&mut hasher);
    for dependency in dependencies.as_array().unwrap() {
        dependency["extern_crate_name"].to_string().hash(&mut hasher);
        let index = dependency["index"].as_u64().unwrap() as usize;
        identity(units, index, known).hash(&mut hasher);
    }
    known.insert(index, hasher.finish());
    hasher.finish()
}

/// Holds figures against their lines of the table.
fn assert_no_larger(figures: &[(String, usize)]) {
    let table = fs::read_to_string(root().join("tests/weight/table.txt")).unwrap();
    let rows = table.lines().filter(|line| !line.starts_with('#'));
    let rows = rows.map(|line| line.trim_start().split_once(' ').unwrap());
    let today: BTreeMap<_, f64> =
        rows.map(|(figure, name)| (name, figure.parse().unwrap())).collect();
    let is_larger = |(name, figure): &&(String, usize)| {
        let today = today.get(name.as_str()).copied().unwrap_or(0.0);
        *figure as f64 > GROWTH * today
    };
    let now: Vec<_> = figures.iter().map(|(name, figure)| format!("{figure:>9} {name}")).collect();
    let larger: Vec<_> = figures.iter().filter(is_larger).collect();
    let now = now.join("\n");
    println!("{now}");
    assert!(larger.is_empty(), "outgrown: {larger:?}; tests/weight/table.txt would be\n{now}");
}

/// Whoever builds the program and then the laboratory, or an example, compiles the engine once.
#[test]
#[ignore = "reads a plan that stable cargo does not promise"]
fn no_choice_of_packages_compiles_a_crate_of_the_program_anew() {
    let program = plan(&["build", "--release"]);
    let names: BTreeSet<_> = program.iter().map(Unit::name).collect();
    let identities: BTreeSet<_> = program.iter().map(|unit| unit.identity).collect();
    for choice in [
        &["--package", "bokashi-lab"][..],
        &["--package", "bokashi-examples", "--example", "custom_op"],
        &["--package", "bokashi-examples", "--examples"],
    ] {
        let other = plan(&[&["build", "--release"], choice].concat());
        let anew = other.iter().filter(|unit| names.contains(&unit.name()));
        let anew = anew.filter(|unit| !identities.contains(&unit.identity));
        let anew: Vec<_> = anew.map(|unit| (unit.name(), &unit.features)).collect();
        assert!(anew.is_empty(), "{choice:?} compiles anew, with other features: {anew:#?}");
    }
}

#[test]
#[ignore = "reads a plan that stable cargo does not promise"]
fn few_units_and_foreign_crates_are_compiled() {
    let mut figures = Vec::new();
    for command in ["build --release", "test --workspace"] {
        let units = plan(&command.split(' ').collect::<Vec<_>>());
        let packages: BTreeSet<_> = units.iter().map(|unit| &unit.package).collect();
        let foreign = packages.iter().filter(|package| !package.starts_with("path+")).count();
        let programs = units.iter().filter(|unit| unit.is_program).count();
        for (what, figure) in
            [("units", units.len()), ("foreign crates", foreign), ("programs", programs)]
        {
            figures.push((format!("{what} of cargo {command}"), figure));
        }
    }
    assert_no_larger(&figures);
}

/// Bytes of machine code, and those of functions that a program has too.
#[derive(Debug, Default)]
struct Code {
    all: usize,
    functions: usize,
    linked: usize,
}

impl Code {
    /// Adds what is in a library's file.
    fn add(&mut self, library: &str, program: &BTreeSet<Vec<u8>>) {
        let bytes = fs::read(library).unwrap();
        let archive = ArchiveFile::parse(&*bytes).unwrap();
        for member in archive.members() {
            let member = member.unwrap();
            if !member.name().ends_with(b".o") {
                continue;
            }
            let file = object::File::parse(member.data(&*bytes).unwrap()).unwrap();
            let code = file.sections().filter(|section| section.kind() == SectionKind::Text);
            self.all += code.map(|section| section.size() as usize).sum::<usize>();
            let functions = file.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
            for function in functions.filter(|function| function.is_definition()) {
                let size = function.size() as usize;
                let is_linked = program.contains(function.name_bytes().unwrap());
                self.functions += size;
                self.linked += if is_linked { size } else { 0 };
            }
        }
    }
}

/// Names of the functions of a program.
fn functions(program: &str) -> BTreeSet<Vec<u8>> {
    let bytes = fs::read(program).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let symbols = file.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
    symbols.map(|symbol| symbol.name_bytes().unwrap().to_vec()).collect()
}

/// The figures are those of the compiler that the table names, for x86-64 under Linux.
#[test]
#[ignore = "builds the program, as a release"]
fn the_machine_code_of_the_program_is_small() {
    let messages = output(&mut cargo(&["build", "--release", "--message-format=json"]));
    let messages = messages.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let artifacts: Vec<_> = messages.filter(|m| m["reason"] == "compiler-artifact").collect();
    let program = artifacts.iter().find_map(|artifact| artifact["executable"].as_str()).unwrap();
    let program = functions(program);
    let mut crates = BTreeMap::<_, Code>::new();
    for artifact in &artifacts {
        let is_foreign = !artifact["package_id"].as_str().unwrap().starts_with("path+");
        let name = if is_foreign {
            "foreign crates"
        } else {
            artifact["target"]["name"].as_str().unwrap()
        };
        let files = artifact["filenames"].as_array().unwrap().iter().filter_map(Value::as_str);
        for library in files.filter(|file| file.ends_with(".rlib")) {
            crates.entry(name).or_default().add(library, &program);
        }
    }
    let mut figures: Vec<_> =
        crates.iter().map(|(name, code)| (format!("bytes of code in {name}"), code.all)).collect();
    let unlinked = |code: &Code| code.functions - code.linked;
    let foreign = unlinked(&crates["foreign crates"]);
    let all: usize = crates.values().map(unlinked).sum();
    assert!(all < crates.values().map(|code| code.functions).sum(), "nothing is linked");
    figures.push(("bytes of our code that the program lacks".to_owned(), all - foreign));
    figures.push(("bytes of foreign code that the program lacks".to_owned(), foreign));
    assert_no_larger(&figures);
}
