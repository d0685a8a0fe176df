//! One file, written whole or not at all.
//!
//! # Where the bytes go
//! Links are followed to the file at their end, there or not, and that file is replaced. The bytes go
//! to a temporary file beside it, which then takes its name, its mode and, where the system allows
//! it, its owner. A hard link under another name keeps the old bytes. What is no regular file is
//! written in place: a device, a FIFO, a descriptor such as `/dev/stdout`. A read-only file is
//! refused by its permission bits, to root as well.
//!
//! # Killed runs
//! A temporary file is named after the file that it becomes, `.{name}.bokashi-` and six letters, and
//! is locked while its writer lives. Whoever writes to the same path next removes such files that
//! nobody holds a lock on.

#[cfg(test)]
mod tests;

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
    match Target::find(path)? {
        Target::Output => write_through(io::stdout().lock(), bytes),
        Target::Error => write_through(io::stderr().lock(), bytes),
        Target::Stream(stream) => {
            // To append changes nothing for a device, and leaves what a descriptor's file has.
            write_through(OpenOptions::new().append(true).open(stream)?, bytes)
        }
        Target::File(file, metadata) => replace(&file, metadata.as_ref(), bytes),
    }
}

/// Whether `path` could be written, without leaving a trace.
///
/// # Errors
/// As [`write_whole`], but for those that only writing shows.
pub fn check_file(path: &Path) -> io::Result<()> {
    match Target::find(path)? {
        Target::Output | Target::Error | Target::Stream(_) => Ok(()),
        Target::File(file, metadata) => {
            if metadata.is_some() {
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
            Ok(metadata) if metadata.is_dir() => break,
            Ok(_) => {
                let message = format!("{} is not a folder", nearest.display());
                return Err(io::Error::new(ErrorKind::NotADirectory, message));
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
    // No path at all is the current folder.
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    resolved_through(path, MOST_LINKS)
}

fn resolved_through(path: &Path, links: usize) -> io::Result<PathBuf> {
    match fs::canonicalize(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        result => return result,
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
enum Target {
    /// A file without links on the way, and what is known of it where it is there.
    File(PathBuf, Option<Metadata>),
    /// What is written in place: a device, a FIFO, a descriptor.
    Stream(PathBuf),
    /// Standard output.
    Output,
    /// Standard error.
    Error,
}

impl Target {
    fn find(path: &Path) -> io::Result<Self> {
        let mut path = path.to_owned();
        for _ in 0..=MOST_LINKS {
            let is_folder = || {
                let message = format!("{} is a folder", path.display());
                io::Error::new(ErrorKind::IsADirectory, message)
            };
            let ends_as_folder = path.as_os_str().as_encoded_bytes().ends_with(b"/");
            let name = path.file_name().filter(|_| !ends_as_folder).ok_or_else(is_folder)?;
            let folder = fs::canonicalize(folder_of(&path)).and_then(|folder| {
                let message = || format!("{} is not a folder", folder.display());
                let is_file = || io::Error::new(ErrorKind::NotADirectory, message());
                if folder.is_dir() { Ok(folder) } else { Err(is_file()) }
            })?;
            let file = folder.join(name);
            match descriptor(&folder, name) {
                Some(1) => return Ok(Self::Output),
                Some(2) => return Ok(Self::Error),
                Some(_) => return Ok(Self::Stream(file)),
                None => {}
            }
            let metadata = match fs::symlink_metadata(&file) {
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    return Ok(Self::File(file, None));
                }
                result => result?,
            };
            if metadata.is_symlink() {
                path = folder.join(fs::read_link(&file)?);
                continue;
            }
            if metadata.is_dir() {
                return Err(is_folder());
            }
            if metadata.permissions().readonly() {
                let message = format!("{} is read-only", file.display());
                return Err(io::Error::new(ErrorKind::PermissionDenied, message));
            }
            return Ok(match metadata.is_file() {
                true => Self::File(file, Some(metadata)),
                false => Self::Stream(file),
            });
        }
        Err(loop_of_links(&path))
    }
}

/// The number of this program's descriptor that `name` is in `folder`, which has no links.
fn descriptor(folder: &Path, name: &OsStr) -> Option<u32> {
    let descriptors = format!("/proc/{}/", std::process::id());
    let is_ours = folder.starts_with(&descriptors) && folder.ends_with("fd")
        || folder == Path::new("/dev/fd");
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

/// Puts `bytes` in the place of `file`, of which `metadata` is known.
fn replace(file: &Path, metadata: Option<&Metadata>, bytes: &[u8]) -> io::Result<()> {
    if metadata.is_some() {
        check_writable(file)?;
    }
    let prefix = prefix(file);
    remove_strays(folder_of(file), &prefix);
    let temporary = temporary(folder_of(file), &prefix, metadata)?;
    // By the file itself: its errors name no temporary path.
    temporary.as_file().write_all(bytes)?;
    if let Some(metadata) = metadata {
        keep_owner_and_mode(temporary.as_file(), metadata)?;
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
fn temporary(
    folder: &Path,
    prefix: &str,
    metadata: Option<&Metadata>,
) -> io::Result<NamedTempFile> {
    loop {
        let mut builder = tempfile::Builder::new();
        builder.prefix(prefix).rand_bytes(RANDOM_LETTERS);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // A new file is for whom the user's mask says; one that takes another's place is nobody
            // else's until it has the other's mode.
            let mode = if metadata.is_some() { 0o600 } else { 0o666 };
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

/// Gives `file` the owner, where the system lets us, and the mode that `metadata` has.
#[cfg(unix)]
fn keep_owner_and_mode(file: &File, metadata: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
    // Only root may give files away; a user may still keep the group.
    if fchown(file, Some(metadata.uid()), Some(metadata.gid())).is_err() {
        let _ = fchown(file, None, Some(metadata.gid()));
    }
    // Reading, writing, executing: another owner's program must not run as its new owner.
    file.set_permissions(fs::Permissions::from_mode(metadata.permissions().mode() & 0o777))
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
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) => Path::new("."),
        None if path.as_os_str().is_empty() => Path::new("."),
        None => path,
    }
}
