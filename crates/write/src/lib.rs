//! Files that are written whole or not at all.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Writes `bytes` to `path`: into a hidden file beside it, which then takes its place.
///
/// A reader sees the old file or the new one, never a part; after an error the old file stands.
///
/// # Errors
/// Those of the file system: the folder is missing, not writable, or full.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = tempfile::Builder::new().prefix(".bokashi-").tempfile_in(folder_of(path))?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    // A temporary file is its owner's alone; what it becomes is for whoever may read the rest.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        file.as_file().set_permissions(fs::Permissions::from_mode(0o644))?;
    }
    file.persist(path)?;
    Ok(())
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
                return Err(io::Error::new(io::ErrorKind::NotADirectory, said));
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                nearest = folder_of(&nearest).to_owned();
            }
            Err(error) => return Err(error),
        }
    }
    tempfile::Builder::new().prefix(".bokashi-").tempfile_in(nearest).map(drop)
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
        assert!(write_whole(&path, b"text").is_err());
        assert!(write_whole(&folder.path().join("no/such/file"), b"text").is_err());
        assert_eq!(names(folder.path()), ["taken"]);
    }

    #[test]
    fn checking_a_folder_leaves_no_trace() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        check_folder(&folder.path().join("a/b/c")).expect("could be made");
        assert!(names(folder.path()).is_empty());
        fs::write(folder.path().join("file"), "").expect("a file");
        assert!(check_folder(&folder.path().join("file")).is_err());
        assert!(check_folder(&folder.path().join("file/under")).is_err());
        check_folder(Path::new("relative/and/missing")).expect("under the current folder");
    }
}
