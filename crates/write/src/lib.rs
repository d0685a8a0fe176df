//! Files that are written whole or not at all.
//!
//! # Where the bytes go
//! Links are followed to the file at their end, there or not, and that file is replaced: the bytes go
//! to a temporary file beside it, which then takes its name, its mode and, where the system allows
//! it, its owner. A hard link under another name keeps the old bytes. What is no regular file is
//! written in place: a device, a FIFO, a descriptor such as `/dev/stdout`. A read-only file is refused
//! by its permission bits, to root as well.
//!
//! # Killed runs
//! A temporary file is named after the file that it becomes, `.{name}.bokashi-` and six letters, and
//! is locked while its writer lives. Whoever writes to the same path next removes such files that
//! nobody holds a lock on.

use std::ffi::OsStr;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Links are followed so often, as Linux does; more are a loop.
const MOST_LINKS: usize = 40;
/// Letters of a file's name in the name of its temporary file: with four bytes each, and what stands
/// around them, they stay below the 255 bytes that file systems allow.
const LETTERS_OF_NAME: usize = 48;
/// Random letters at the end of a temporary file's name.
const RANDOM_LETTERS: usize = 6;

/// Writes `bytes` to `path`, in the place of what is there.
///
/// A reader sees the old file or the new one, never a part; after an error the old file stands. What
/// is no regular file is written in place.
///
/// # Errors
/// Those of the file system: the folder is missing, not writable, or full; `path` is a folder or a
/// read-only file.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    match Place::of(path)? {
        Place::Output => write_through(io::stdout().lock(), bytes),
        Place::Error => write_through(io::stderr().lock(), bytes),
        Place::Stream(stream) => {
            // To append changes nothing for a device, and leaves what a descriptor's file has.
            write_through(OpenOptions::new().append(true).open(stream)?, bytes)
        }
        Place::File(file, found) => replace(&file, found.as_ref(), bytes),
    }
}

/// Whether `path` could be written, without leaving a trace.
///
/// # Errors
/// As [`write_whole`], but for those that only writing shows.
pub fn check_file(path: &Path) -> io::Result<()> {
    match Place::of(path)? {
        Place::Output | Place::Error | Place::Stream(_) => Ok(()),
        Place::File(file, found) => {
            if found.is_some() {
                check_writable(&file)?;
            }
            tempfile::tempfile_in(folder_of(&file)).map(drop)
        }
    }
}

/// Whether a folder could be written, without leaving a trace: it, or the nearest folder above
/// it that exists, takes a temporary file.
///
/// # Errors
/// Those of the file system: a part of the path is a file, or the folder is not writable.
pub fn check_folder(folder: &Path) -> io::Result<()> {
    let mut nearest = PathBuf::from(folder);
    loop {
        match fs::metadata(&nearest) {
            Ok(found) if found.is_dir() => break,
            Ok(_) => {
                let said = format!("{} is not a folder", nearest.display());
                return Err(io::Error::new(ErrorKind::NotADirectory, said));
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                nearest = folder_of(&nearest).to_owned();
            }
            Err(error) => return Err(error),
        }
    }
    // It has no name, so that not even a killed run leaves it behind.
    tempfile::tempfile_in(nearest).map(drop)
}

/// The path that `path` comes to, without links, `.` and `..`; what is missing is kept as it is
/// written. Two paths are one file where they come to the same.
///
/// # Errors
/// Those of the file system: links in a loop, a folder that may not be searched.
pub fn resolved(path: &Path) -> io::Result<PathBuf> {
    resolved_through(path, MOST_LINKS)
}

fn resolved_through(path: &Path, links: usize) -> io::Result<PathBuf> {
    match fs::canonicalize(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        found => return found,
    }
    let folder = folder_of(path);
    // A link whose end is missing, or the name of what is.
    if let Ok(to) = fs::read_link(path) {
        let links = links.checked_sub(1).ok_or_else(|| loop_of_links(path))?;
        return resolved_through(&folder.join(to), links);
    }
    if folder == path {
        return Ok(path.to_owned());
    }
    let mut resolved = resolved_through(folder, links)?;
    match path.file_name() {
        Some(name) => resolved.push(name),
        None => drop(resolved.pop()),
    }
    Ok(resolved)
}

/// Where the bytes for a path go.
#[derive(Debug)]
enum Place {
    /// A file without links on the way, and what is known of it where it is there.
    File(PathBuf, Option<Metadata>),
    /// What is written in place: a device, a FIFO, a descriptor.
    Stream(PathBuf),
    /// Standard output.
    Output,
    /// Standard error.
    Error,
}

impl Place {
    fn of(path: &Path) -> io::Result<Self> {
        let mut path = path.to_owned();
        for _ in 0..=MOST_LINKS {
            let is_folder = || {
                let said = format!("{} is a folder", path.display());
                io::Error::new(ErrorKind::IsADirectory, said)
            };
            let ends_as_folder = path.as_os_str().as_encoded_bytes().ends_with(b"/");
            let name = path.file_name().filter(|_| !ends_as_folder).ok_or_else(is_folder)?;
            let folder = fs::canonicalize(folder_of(&path)).and_then(|folder| {
                let said = || format!("{} is not a folder", folder.display());
                let is_file = || io::Error::new(ErrorKind::NotADirectory, said());
                if folder.is_dir() { Ok(folder) } else { Err(is_file()) }
            })?;
            let file = folder.join(name);
            match descriptor(&folder, name) {
                Some(1) => return Ok(Self::Output),
                Some(2) => return Ok(Self::Error),
                Some(_) => return Ok(Self::Stream(file)),
                None => {}
            }
            let found = match fs::symlink_metadata(&file) {
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    return Ok(Self::File(file, None));
                }
                found => found?,
            };
            if found.is_symlink() {
                path = folder.join(fs::read_link(&file)?);
                continue;
            }
            if found.is_dir() {
                return Err(is_folder());
            }
            if found.permissions().readonly() {
                let said = format!("{} is read-only", file.display());
                return Err(io::Error::new(ErrorKind::PermissionDenied, said));
            }
            return Ok(match found.is_file() {
                true => Self::File(file, Some(found)),
                false => Self::Stream(file),
            });
        }
        Err(loop_of_links(&path))
    }
}

/// The number of this program's descriptor that `name` is in `folder`, which has no links.
fn descriptor(folder: &Path, name: &OsStr) -> Option<u32> {
    let own = format!("/proc/{}/", std::process::id());
    let is_ours =
        folder.starts_with(&own) && folder.ends_with("fd") || folder == Path::new("/dev/fd");
    if is_ours { name.to_str()?.parse().ok() } else { None }
}

fn loop_of_links(path: &Path) -> io::Error {
    io::Error::other(format!("{} is one of more than {MOST_LINKS} links", path.display()))
}

fn write_through(mut stream: impl Write, bytes: &[u8]) -> io::Result<()> {
    stream.write_all(bytes)?;
    stream.flush()
}

/// Whether the user may write to a file that is there: to take its name needs its folder alone.
fn check_writable(file: &Path) -> io::Result<()> {
    OpenOptions::new().write(true).open(file).map(drop)
}

/// Puts `bytes` in the place of `file`, of which `found` is known.
fn replace(file: &Path, found: Option<&Metadata>, bytes: &[u8]) -> io::Result<()> {
    if found.is_some() {
        check_writable(file)?;
    }
    let prefix = prefix(file);
    remove_strays(folder_of(file), &prefix);
    let mut temporary = temporary(folder_of(file), &prefix, found)?;
    temporary.write_all(bytes)?;
    if let Some(found) = found {
        keep_owner_and_mode(temporary.as_file(), found)?;
    }
    temporary.as_file().sync_all()?;
    temporary.persist(file)?;
    Ok(())
}

/// What the names of the temporary files for `file` begin with.
fn prefix(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    format!(".{}.bokashi-", name.chars().take(LETTERS_OF_NAME).collect::<String>())
}

/// A locked temporary file in `folder`.
fn temporary(folder: &Path, prefix: &str, found: Option<&Metadata>) -> io::Result<NamedTempFile> {
    loop {
        let mut builder = tempfile::Builder::new();
        builder.prefix(prefix).rand_bytes(RANDOM_LETTERS);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // A new file is for whom the user's mask says; one that takes another's place is nobody
            // else's until it has the other's mode.
            let mode = if found.is_some() { 0o600 } else { 0o666 };
            builder.permissions(fs::Permissions::from_mode(mode));
        }
        let temporary = builder.tempfile_in(folder)?;
        // Without locks on this file system nobody removes anything.
        let _ = temporary.as_file().lock();
        // Before it was locked, another run could take it for a killed run's.
        if fs::symlink_metadata(temporary.path()).is_ok() {
            return Ok(temporary);
        }
    }
}

/// Gives `file` the owner, where the system lets us, and the mode that `found` has.
#[cfg(unix)]
fn keep_owner_and_mode(file: &File, found: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
    // Only root may give files away; a user may still keep the group.
    if fchown(file, Some(found.uid()), Some(found.gid())).is_err() {
        let _ = fchown(file, None, Some(found.gid()));
    }
    // Reading, writing, executing: another owner's program must not run as its new owner.
    file.set_permissions(fs::Permissions::from_mode(found.permissions().mode() & 0o777))
}

#[cfg(not(unix))]
fn keep_owner_and_mode(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Removes the temporary files of this prefix that no living run holds. What cannot be removed stays.
fn remove_strays(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let end = name.to_str().and_then(|name| name.strip_prefix(prefix));
        let is_ours = end.is_some_and(|end| {
            end.len() == RANDOM_LETTERS && end.bytes().all(|byte| byte.is_ascii_alphanumeric())
        });
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // The lock is held until the file is gone: its writer, if it is just beginning, then sees
        // that it needs another.
        if let Ok(stray) = File::open(entry.path())
            && stray.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The folder that holds `path`.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) => Path::new("."),
        None => path,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder");
        let mut names: Vec<_> =
            entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_and_nothing_stays_beside_it() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.txt");
        write_whole(&path, b"one").expect("first");
        write_whole(&path, b"two").expect("second");
        assert_eq!(fs::read(&path).expect("the file"), b"two");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failed_write_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("taken");
        fs::create_dir(&path).expect("a folder in the file's place");
        let file = folder.path().join("file");
        fs::write(&file, "old").expect("a file");
        for (path, said) in [
            (path, "taken is a folder"),
            (folder.path().join("no/such/file"), ""),
            (folder.path().join("new/"), "new/ is a folder"),
            (folder.path().join(".."), ".. is a folder"),
            (file.join("below"), "file is not a folder"),
        ] {
            let error = write_whole(&path, b"text").unwrap_err().to_string();
            assert!(error.ends_with(said), "{error}");
            assert_eq!(check_file(&path).unwrap_err().to_string(), error);
        }
        assert_eq!(names(folder.path()), ["file", "taken"]);
        assert_eq!(fs::read(&file).expect("the file"), b"old");
    }

    #[test]
    fn a_name_may_be_as_long_as_the_file_system_allows() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["a".repeat(255), "\u{1f3b4}".repeat(63)] {
            write_whole(&folder.path().join(&name), b"text").expect("a long name");
            assert!(names(folder.path()).contains(&name));
        }
    }

    #[test]
    fn checking_leaves_no_trace() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        check_folder(&folder.path().join("a/b/c")).expect("could be made");
        check_file(&folder.path().join("a")).expect("could be made");
        assert!(names(folder.path()).is_empty());
        let file = folder.path().join("file");
        fs::write(&file, "old").expect("a file");
        check_file(&file).expect("could be replaced");
        assert_eq!(fs::read(&file).expect("the file"), b"old");
        assert!(check_folder(&file).is_err());
        assert!(check_folder(&file.join("under")).is_err());
        check_folder(Path::new("relative/and/missing")).expect("under the current folder");
    }

    #[test]
    fn temporary_files_of_killed_runs_are_removed_and_those_of_living_ones_stay() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let stray = |name: &str| folder.path().join(name);
        for name in [".a.bokashi-abcdEF", ".a.bokashi-012345", ".b.bokashi-abcdef"] {
            fs::write(stray(name), "half").expect("of a killed run");
        }
        for name in [".a.bokashi-abc", ".a.bokashi-ab.def", "a.bokashi-abcdef", ".a.abcdef"] {
            fs::write(stray(name), "mine").expect("of somebody else");
        }
        let living = File::create(stray(".a.bokashi-living")).expect("of a living run");
        living.lock().expect("a lock");
        write_whole(&stray("a"), b"whole").expect("a file");
        let stay = [
            ".a.abcdef",
            ".a.bokashi-ab.def",
            ".a.bokashi-abc",
            ".a.bokashi-living",
            ".b.bokashi-abcdef",
            "a",
            "a.bokashi-abcdef",
        ];
        assert_eq!(names(folder.path()), stay);
        drop(living);
        write_whole(&stray("a"), b"whole").expect("a file");
        assert!(!stray(".a.bokashi-living").exists());
    }

    #[test]
    fn runs_that_write_one_path_at_once_all_succeed_and_the_file_is_whole() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        std::thread::scope(|scope| {
            for letter in b'a'..b'i' {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..40 {
                        write_whole(path, &[letter; 5000]).expect("no run disturbs another");
                        let found = fs::read(path).expect("a file");
                        assert_eq!(found.len(), 5000);
                        assert!(found.iter().all(|byte| *byte == found[0]));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), ["a"]);
    }

    #[test]
    fn what_is_missing_comes_to_the_path_that_it_would_have() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let root = fs::canonicalize(folder.path()).expect("a path");
        fs::create_dir(root.join("d")).expect("a folder");
        fs::write(root.join("d/file"), "").expect("a file");
        for (path, expected) in [
            ("d/file", "d/file"),
            ("d/../d/./file", "d/file"),
            ("d/new", "d/new"),
            ("./new", "new"),
            ("no/such", "no/such"),
            ("no/such/..", "no"),
            ("no/../d/file", "d/file"),
        ] {
            let found = resolved(&folder.path().join(path)).expect("a path");
            assert_eq!(found, root.join(expected), "{path}");
        }
        let here = fs::canonicalize(".").expect("a path");
        assert_eq!(resolved(Path::new("no-such-file")).expect("a path"), here.join("no-such-file"));
    }

    #[cfg(unix)]
    mod unix {
        use std::io::Read as _;
        use std::os::unix::fs::{
            FileTypeExt as _, MetadataExt as _, PermissionsExt as _, chown, symlink,
        };
        use std::process::Command;

        use super::*;

        fn mode(path: &Path) -> u32 {
            fs::metadata(path).expect("a file").permissions().mode() & 0o7777
        }

        #[test]
        fn links_are_followed_to_the_file_at_their_end() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let at = |name: &str| folder.path().join(name);
            fs::create_dir(at("d")).expect("a folder");
            fs::write(at("d/file"), "old").expect("a file");
            symlink("d/file", at("relative")).expect("a link");
            symlink(at("relative"), at("absolute")).expect("a link to a link");
            symlink("../d/new", at("d/dangling")).expect("a link to nothing");
            symlink("d/dangling", at("twice")).expect("a link to a link to nothing");
            for (link, end) in [
                ("relative", "d/file"),
                ("absolute", "d/file"),
                ("d/dangling", "d/new"),
                ("twice", "d/new"),
            ] {
                let same = [resolved(&at(link)), resolved(&at(end))];
                let [link_end, end] = same.map(|path| path.expect("a path"));
                assert_eq!(link_end, end);
                check_file(&at(link)).expect("could be written");
                write_whole(&at(link), link.as_bytes()).expect("through the link");
                assert!(fs::symlink_metadata(at(link)).expect("there").is_symlink());
                assert_eq!(fs::read(end).expect("the end"), link.as_bytes());
            }
            assert_eq!(names(folder.path()), ["absolute", "d", "relative", "twice"]);
            assert_eq!(names(&at("d")), ["dangling", "file", "new"]);
        }

        #[test]
        fn links_in_a_loop_are_an_error() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
            symlink(&a, &b).expect("a link");
            symlink(&b, &a).expect("a link back");
            let error = write_whole(&a, b"text").unwrap_err().to_string();
            assert!(error.ends_with("is one of more than 40 links"), "{error}");
            assert!(check_file(&a).is_err() && resolved(&a).is_err());
            assert_eq!(names(folder.path()), ["a", "b"]);
        }

        #[test]
        fn a_fifo_is_written_in_place() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let fifo = folder.path().join("fifo");
            assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success());
            check_file(&fifo).expect("does not wait for a reader");
            std::thread::scope(|scope| {
                let reader = scope.spawn(|| {
                    let mut text = String::new();
                    File::open(&fifo).expect("a reader").read_to_string(&mut text).map(|_| text)
                });
                write_whole(&fifo, b"through").expect("to the reader");
                assert!(fs::symlink_metadata(&fifo).expect("there").file_type().is_fifo());
                assert_eq!(reader.join().expect("no panic").expect("text"), "through");
            });
            assert_eq!(names(folder.path()), ["fifo"]);
        }

        #[test]
        fn modes_are_kept_and_a_new_file_has_the_mode_of_any_other() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let path = folder.path().join("a");
            for kept in [0o600, 0o640, 0o666, 0o755, 0o200] {
                fs::write(&path, "old").expect("a file");
                fs::set_permissions(&path, fs::Permissions::from_mode(kept)).expect("its mode");
                write_whole(&path, b"new").expect("a write");
                assert_eq!(mode(&path), kept);
                fs::remove_file(&path).expect("removed");
            }
            let other = folder.path().join("other");
            fs::write(&other, "").expect("a file");
            write_whole(&path, b"new").expect("a write");
            assert_eq!(mode(&path), mode(&other));
        }

        #[test]
        fn the_owner_is_kept_where_the_system_allows_it() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let path = folder.path().join("a");
            fs::write(&path, "old").expect("a file");
            // Root alone may give a file away; for anyone else the owner is the user.
            let _ = chown(&path, Some(1), Some(1));
            let owner = |path: &Path| {
                let found = fs::metadata(path).expect("a file");
                (found.uid(), found.gid())
            };
            let before = owner(&path);
            write_whole(&path, b"new").expect("a write");
            assert_eq!(owner(&path), before);
        }

        #[test]
        fn a_read_only_file_is_refused_and_keeps_its_bytes() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let [path, link] = ["a", "link"].map(|name| folder.path().join(name));
            fs::write(&path, "old").expect("a file");
            symlink(&path, &link).expect("a link");
            fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).expect("its mode");
            for path in [&path, &link] {
                for refused in [write_whole(path, b"new"), check_file(path)] {
                    let error = refused.unwrap_err();
                    assert_eq!(error.kind(), ErrorKind::PermissionDenied);
                    assert!(error.to_string().ends_with("a is read-only"), "{error}");
                }
            }
            assert_eq!(fs::read(&path).expect("the file"), b"old");
            assert_eq!(names(folder.path()), ["a", "link"]);
        }
    }
}
