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
    check_folder(Path::new("")).expect("the current folder");
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
    assert_eq!(resolved(Path::new("")).expect("a path"), here);
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
