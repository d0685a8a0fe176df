//! Files below a folder that a user named.
//!
//! Whoever gives a folder away may have put links into it. So a link that the user names is followed, and a
//! link inside the folder only where it leads to what is inside, too. Hard links need no care: a file is
//! replaced, never written over. What somebody else changes between the check and the writing is not seen.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

use crate::whole::{folder_of, resolved, write_whole};

/// Writes `bytes` to `path` below `folder`, as [`write_whole`] does; folders on the way are made. Returns the
/// whole path.
///
/// # Errors
/// As [`place_below`] and [`write_whole`].
pub fn write_below(folder: &Path, path: impl AsRef<Path>, bytes: &[u8]) -> io::Result<PathBuf> {
    let file = place_below(folder, path)?;
    write_whole(&file, bytes)?;
    Ok(file)
}

/// Where `path` below `folder` is, with the folders on the way, which are made.
///
/// # Errors
/// As [`check_below`]; where a folder can't be made.
pub fn place_below(folder: &Path, path: impl AsRef<Path>) -> io::Result<PathBuf> {
    check_below(folder, &path)?;
    let file = folder.join(path);
    fs::create_dir_all(folder_of(&file))?;
    Ok(file)
}

/// Whether a file at `path` below `folder` may be written, without leaving a trace. The folder itself may
/// be missing.
///
/// # Errors
/// As [`check_inside`]; where something that is no regular file has the place: a device or a FIFO that came with
/// the folder.
pub fn check_below(folder: &Path, path: impl AsRef<Path>) -> io::Result<()> {
    check_inside(folder, &path)?;
    let file = folder.join(path);
    match fs::metadata(&file) {
        Ok(metadata) if metadata.is_dir() => {
            let message = format!("{} is a folder", file.display());
            Err(io::Error::new(ErrorKind::IsADirectory, message))
        }
        Ok(metadata) if !metadata.is_file() => {
            let message = format!("{} is no regular file", file.display());
            Err(io::Error::new(ErrorKind::PermissionDenied, message))
        }
        _ => Ok(()),
    }
}

/// Whether `path` stays below `folder` when links inside the folder are followed.
///
/// # Errors
/// For a path that is no names of files and folders below it, for a link that leads out, and for a name that
/// the file system does not take.
pub fn check_inside(folder: &Path, path: impl AsRef<Path>) -> io::Result<()> {
    let path = path.as_ref();
    let is_name = |part| matches!(part, Component::Normal(_));
    if path.as_os_str().is_empty() || !path.components().all(is_name) {
        let message = format!("a file in a folder has a plain name, and this is {path:?}");
        return Err(io::Error::new(ErrorKind::InvalidInput, message));
    }
    let root = resolved(folder)?;
    let mut there = root.clone();
    while !there.is_dir() && there.pop() {}
    let mut way = folder.to_owned();
    for part in path.components() {
        // Where a folder on the way is missing, the nearest one says whether it would take the name.
        if let Err(error) = fs::symlink_metadata(there.join(part))
            && error.kind() == ErrorKind::InvalidFilename
        {
            let length = part.as_os_str().len();
            let message = format!("a name of {length} bytes is too long for a file");
            return Err(io::Error::new(ErrorKind::InvalidFilename, message));
        }
        if way.exists() && !way.is_dir() {
            let message = format!("{} is not a folder", way.display());
            return Err(io::Error::new(ErrorKind::NotADirectory, message));
        }
        way.push(part);
        let end = resolved(&way)?;
        if !end.starts_with(&root) {
            let (way, folder, end) = (way.display(), folder.display(), end.display());
            let message = format!("links in {folder} stay in it, and {way} leads to {end}");
            return Err(io::Error::new(ErrorKind::PermissionDenied, message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_on_the_way_are_made_and_checking_makes_none() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a/out");
        check_below(&folder, "views/b.png").unwrap();
        assert!(!place.path().join("a").exists());
        let written = write_below(&folder, "views/b.png", b"b").unwrap();
        assert_eq!(written, folder.join("views/b.png"));
        assert_eq!(fs::read(written).unwrap(), b"b");
        assert!(check_below(&folder, "views").unwrap_err().to_string().ends_with("is a folder"));
        let said = check_below(&folder, "views/b.png/c").unwrap_err().to_string();
        assert!(said.ends_with("b.png is not a folder"), "{said}");
    }

    #[test]
    fn what_is_no_plain_name_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        for path in ["", "..", "../a", "a/../../b", "/a", ".", "./a"] {
            let said = write_below(&folder, path, b"b").unwrap_err().to_string();
            assert!(said.starts_with("a file in a folder has a plain name"), "{path}: {said}");
        }
        assert!(write_below(&folder, "a\0b", b"b").is_err());
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_name_that_is_too_long_is_refused_though_its_folder_is_missing() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        for path in ["a".repeat(300), format!("views/{}", "a".repeat(300))] {
            let said = check_below(&folder, path).unwrap_err().to_string();
            assert_eq!(said, "a name of 300 bytes is too long for a file");
        }
        check_below(&folder, "a".repeat(255)).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn a_link_inside_is_followed_where_it_stays_inside() {
        use std::os::unix::fs::symlink;
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::create_dir_all(at("real/inner")).unwrap();
        fs::create_dir(at("elsewhere")).unwrap();
        fs::write(at("victim"), "mine").unwrap();
        // The folder itself is named by a link.
        symlink("real", at("out")).unwrap();
        let links = [
            ("page", "../victim"),
            ("new", "../made"),
            ("through", "page"),
            ("views", "../elsewhere"),
            ("up", ".."),
            ("loop", "loop"),
        ];
        for (name, to) in links {
            symlink(to, at("real").join(name)).unwrap();
        }
        symlink(at("elsewhere"), at("real/absolute")).unwrap();
        symlink("inner", at("real/here")).unwrap();
        symlink("../out/inner/own", at("real/round")).unwrap();
        let out = at("out");
        for path in ["page", "new", "through", "views/a", "up/real/a", "up/out/a", "absolute/a"] {
            let said = write_below(&out, path, b"b").unwrap_err();
            assert_eq!(said.kind(), ErrorKind::PermissionDenied, "{path}: {said}");
            assert!(said.to_string().contains(" leads to "), "{path}: {said}");
        }
        assert!(write_below(&out, "loop", b"b").is_err());
        assert_eq!(fs::read(at("victim")).unwrap(), b"mine");
        assert!(!at("made").exists());
        assert_eq!(fs::read_dir(at("elsewhere")).unwrap().count(), 0);
        write_below(&out, "here/a", b"a").unwrap();
        write_below(&out, "round", b"r").unwrap();
        assert_eq!(fs::read(at("real/inner/a")).unwrap(), b"a");
        assert_eq!(fs::read(at("real/inner/own")).unwrap(), b"r");
    }

    #[cfg(unix)]
    #[test]
    fn nobody_waits_for_a_fifo_that_came_with_the_folder() {
        let place = tempfile::tempdir().unwrap();
        let fifo = place.path().join("page");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        let said = write_below(place.path(), "page", b"b").unwrap_err().to_string();
        assert!(said.ends_with("page is no regular file"), "{said}");
    }
}
