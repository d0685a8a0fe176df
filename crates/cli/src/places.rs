//! Where the program is to write: checked before hours are spent on what is to be written.

use std::path::{Path, PathBuf};

use bokashi_write::{check_below, check_folder, check_inside, resolved};

use crate::failure::Failure;
use crate::output::is_standard_output;

/// Ends of the names of a report's files.
const OF_REPORTS: [&str; 3] = ["html", "csv", "png"];

/// What the program is to write, and what it reads.
#[derive(Debug, Clone, Default)]
pub struct Places<'a> {
    /// The folder of the report.
    pub out: Option<&'a Path>,
    /// Whether the user named it: else a link in the current folder may not lead it elsewhere.
    pub is_out_named: bool,
    /// Files of the report with fixed names.
    pub report: &'a [&'a str],
    /// Other files, each with the option that names it.
    pub files: Vec<(&'static str, &'a Path)>,
    /// Files that are read.
    pub read: Vec<(&'static str, &'a Path)>,
}

impl Places<'_> {
    /// Checks that all of it can be written, and that nothing takes the place of something else.
    ///
    /// # Errors
    /// [`Failure::Use`] for the first option that breaks a rule.
    pub fn check(&self) -> Result<(), Failure> {
        let mut known: Vec<(&str, PathBuf)> = Vec::new();
        let out = match self.out {
            Some(out) => Some(check_out(out, self.is_out_named, self.report)?),
            None => None,
        };
        let files = self.files.iter().filter(|(_, file)| !is_standard_output(file));
        for &(option, file) in files {
            let failed = |error: std::io::Error| {
                Failure::Use(format!("{option} needs a file to write to: {error}"))
            };
            bokashi_write::check_file(file).map_err(failed)?;
            let path = resolved(file).map_err(failed)?;
            if is_device(&path) {
                continue;
            }
            if let Some((other, _)) = known.iter().find(|(_, known)| *known == path) {
                return Err(same(option, other, file));
            }
            if let Some(out) = &out {
                check_apart_from_report(option, file, &path, out)?;
            }
            known.push((option, path));
        }
        for &(option, file) in &self.read {
            let Ok(path) = resolved(file) else { continue };
            // A fit may be saved to where it came from.
            let other = known.iter().find(|(other, known)| *other != "--save" && *known == path);
            if let Some((other, _)) = other {
                return Err(same(other, option, file));
            }
        }
        Ok(())
    }
}

/// The path of a report's folder that can be written to.
fn check_out(out: &Path, is_named: bool, report: &[&str]) -> Result<PathBuf, Failure> {
    let failed =
        |error: std::io::Error| Failure::Use(format!("--out needs a folder to write to: {error}"));
    if !is_named {
        check_inside(Path::new("."), out).map_err(|error| {
            let out = out.display();
            let rule = "a folder of results that is a link is named";
            Failure::Use(format!("{rule}, as --out {out}, and it was not: {error}"))
        })?;
    }
    check_folder(out).map_err(failed)?;
    for &name in report {
        check_below(out, name).map_err(failed)?;
        let file = out.join(name);
        if file.exists() {
            bokashi_write::check_file(&file).map_err(failed)?;
        }
    }
    resolved(out).map_err(failed)
}

/// Checks that the file `path` is neither a folder of the report in `out` nor one of its files.
fn check_apart_from_report(
    option: &str,
    file: &Path,
    path: &Path,
    out: &Path,
) -> Result<(), Failure> {
    if out.starts_with(path) {
        return Err(same(option, "--out", file));
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if path.starts_with(out) && OF_REPORTS.contains(&&*extension) {
        let rule =
            "needs a file that is not of the report in --out, which are .html, .csv and .png";
        return Err(Failure::Use(format!("{option} {rule}: got {}", file.display())));
    }
    Ok(())
}

fn same(option: &str, other: &str, file: &Path) -> Failure {
    Failure::Use(format!("{option} needs another file than {other}, got {}", file.display()))
}

/// Whether `path` is a device that takes anything: `/dev/null` loses nothing twice.
#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_char_device())
}

#[cfg(not(unix))]
fn is_device(_: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn check(out: Option<&Path>, files: &[(&'static str, &Path)]) -> Result<(), String> {
        let report = &["index.html"];
        let files = files.to_vec();
        let places = Places { out, is_out_named: true, report, files, read: Vec::new() };
        places.check().map_err(|failure| failure.to_string())
    }

    #[test]
    fn two_options_that_name_one_file_are_refused_however_it_is_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("d")).expect("a folder");
        let save = at("d/../new");
        for json in ["new", "./new", "d/../new"] {
            let message = check(None, &[("--json", &at(json)), ("--save", &save)]).unwrap_err();
            assert!(message.starts_with("--save needs another file than --json, got"), "{message}");
        }
        assert_eq!(check(None, &[("--json", &at("other")), ("--save", &save)]), Ok(()));
        let twice = Path::new("-");
        assert_eq!(check(None, &[("--json", twice), ("--save", &save)]), Ok(()));
    }

    #[test]
    fn a_file_may_not_take_the_place_of_the_report_or_of_a_folder_above_it() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        for out in ["d", "d/below", "d/../d"] {
            let message = check(Some(&at(out)), &[("--save", &at("d"))]).unwrap_err();
            assert!(message.starts_with("--save needs another file than --out, got"), "{message}");
        }
        fs::create_dir_all(at("o/pictures")).expect("folders");
        for file in ["o/index.html", "o/fits.csv", "o/pictures/a.PNG", "o/../o/new.html"] {
            let message = check(Some(&at("o")), &[("--json", &at(file))]).unwrap_err();
            let rule = "--json needs a file that is not of the report in --out, which are .html";
            assert!(message.starts_with(rule), "{message}");
        }
        for file in ["o/outcome.json", "index.html", "o/html"] {
            assert_eq!(check(Some(&at("o")), &[("--json", &at(file))]), Ok(()));
        }
    }

    #[test]
    fn what_is_read_is_not_written_over_but_by_its_successor() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let kept = folder.path().join("kept");
        fs::write(&kept, "a fit").expect("a file");
        let check = |option| {
            let (files, read) = (vec![(option, &*kept)], vec![("--resume", &*kept)]);
            let places = Places { files, read, ..Places::default() };
            places.check().map_err(|failure| failure.to_string())
        };
        assert_eq!(check("--save"), Ok(()));
        let message = check("--json").unwrap_err();
        assert!(message.starts_with("--json needs another file than --resume, got"), "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn links_to_one_file_are_one_file_and_a_device_may_be_named_twice() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        symlink("end", at("dangling")).expect("a link");
        symlink(folder.path(), at("here")).expect("a link to the folder");
        for other in ["dangling", "here/end", "here/dangling"] {
            let message = check(None, &[("--json", &at("end")), ("--save", &at(other))]);
            assert!(message.unwrap_err().starts_with("--save needs another file than --json"));
        }
        let null = Path::new("/dev/null");
        assert_eq!(check(None, &[("--json", null), ("--save", null)]), Ok(()));
    }

    #[cfg(unix)]
    #[test]
    fn a_read_only_page_is_found_before_the_work() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let page = folder.path().join("index.html");
        fs::write(&page, "mine").expect("a file");
        assert_eq!(check(Some(folder.path()), &[]), Ok(()));
        fs::set_permissions(&page, fs::Permissions::from_mode(0o444)).expect("its mode");
        let message = check(Some(folder.path()), &[]).unwrap_err();
        assert!(message.starts_with("--out needs a folder to write to: "), "{message}");
        assert!(message.ends_with("index.html is read-only"), "{message}");
    }
}
