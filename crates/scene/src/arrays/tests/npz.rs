//! NumPy's archives, and archives that mean no good.

use bokashi_core::Tensor;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;

fn read(bytes: &[u8]) -> ArrayFile {
    read_npz_bytes(bytes, &location()).unwrap()
}

fn message(bytes: &[u8]) -> String {
    read_npz_bytes(bytes, &location()).unwrap_err().to_string()
}

/// A zip archive of these files, stored.
fn zipped(files: &[(&str, &[u8])]) -> Vec<u8> {
    use std::io::{Cursor, Write as _};
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in files {
        archive.start_file(name, options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn numpys_archives_are_read_in_order() {
    let counted = |shape: &[usize]| Tensor::from_flat_fn(shape, |k| k as f64 - 2.0);
    for name in ["several.npz", "compressed.npz"] {
        let arrays = read_npz(data().join(name)).unwrap();
        let names: Vec<_> = arrays.names().collect();
        assert_eq!(names, ["vertices", "faces", "a/weights", "names", "江"]);
        assert_eq!(arrays.tensor::<f32>("vertices").unwrap().cast(), counted(&[4, 3]));
        assert_eq!(arrays.get("faces").unwrap().indices::<3>().unwrap(), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(arrays.tensor::<f64>("a/weights").unwrap(), counted(&[2, 2]));
        assert_eq!(arrays.tensor::<f64>("江").unwrap().item(), 7.0);
        // Texts stand in nobody's way until they are asked for.
        let message = arrays.get("names").unwrap_err().to_string();
        assert!(
            message.contains(":names: numbers are") && message.ends_with("texts, \"<U3\""),
            "{message}"
        );
        assert_eq!(npz(&arrays, Packing::Stored).unwrap_err().to_string(), message);
    }
    assert_eq!(read(&file("none.npz")).names().len(), 0);
}

#[test]
fn archives_hold_files_that_numpy_would_write() {
    let mut arrays = ArrayFile::new();
    let zeros = Tensor::<f32>::zeros([100, 100]);
    arrays.insert("b/zeros", &zeros);
    arrays.insert("a", &[[1_u32, 2, 3]][..]);
    let stored = npz(&arrays, Packing::Stored).unwrap();
    let array = npy(arrays.get("b/zeros").unwrap()).unwrap();
    assert!(stored.windows(array.len()).any(|window| window == array));
    let deflated = npz(&arrays, Packing::Deflated).unwrap();
    assert!(deflated.len() < 1000, "{}", deflated.len());
    for bytes in [&stored, &deflated] {
        let found = read(bytes);
        assert_eq!(found.names().collect::<Vec<_>>(), ["b/zeros", "a"]);
        assert_eq!(found.tensor::<f32>("b/zeros").unwrap(), zeros);
        assert_eq!(found.get("a").unwrap().indices::<3>().unwrap(), [[1, 2, 3]]);
    }
    assert_eq!(npz(&arrays, Packing::Deflated).unwrap(), deflated);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    write_npz(&path, &arrays, Packing::Stored).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), stored);
}

#[test]
fn names_are_those_of_files_in_a_folder() {
    let bytes = npy(&Tensor::scalar(1.0_f32).into()).unwrap();
    let rule = "file: the name of an array in an npz file is that of a file in a folder";
    for name in
        ["", "/a", "a/", "a//b", ".", "..", "../a", "a/../b", "a/./b", "a\\b", "C:a", "a\n", "\0"]
    {
        let message = message(&zipped(&[(&format!("{name}.npy"), &bytes)]));
        // What ends in a dot before the ending is a part like any other.
        assert_eq!(message, format!("{rule}, and there is {name:?}"));
        let mut arrays = ArrayFile::new();
        arrays.insert(name, Tensor::scalar(1.0_f32));
        let message = npz(&arrays, Packing::Stored).unwrap_err().to_string();
        assert!(
            message.ends_with(&format!("a file in a folder, and there is {name:?}")),
            "{message}"
        );
    }
    for name in ["a", "a.npy", "...", "a b", "raw/vertices/bunny", "江", "a'\"{}"] {
        let mut arrays = ArrayFile::new();
        arrays.insert(name, Tensor::scalar(1.0_f32));
        let found = read(&npz(&arrays, Packing::Deflated).unwrap());
        assert_eq!(found.names().collect::<Vec<_>>(), [name]);
    }
    let mut arrays = ArrayFile::new();
    arrays.insert("a".repeat(70_000), Tensor::scalar(1.0_f32));
    assert!(npz(&arrays, Packing::Stored).is_err());
}

#[test]
fn other_files_and_folders_stand_in_nobodys_way() {
    let bytes = npy(&Tensor::scalar(1.0_f32).into()).unwrap();
    let arrays =
        read(&zipped(&[("folder/", b""), ("folder/read me.txt", b"hi"), ("folder/a.npy", &bytes)]));
    assert_eq!(arrays.names().collect::<Vec<_>>(), ["folder/read me.txt", "folder/a"]);
    let of_text = arrays.get("folder/read me.txt").unwrap_err().to_string();
    let expected = "the arrays of an npz file end in .npy, and this does not";
    assert_eq!(of_text, format!("file:folder/read me.txt: {expected}"));
    assert!(message(&zipped(&[("../secret", b"hi")])).contains("is that of a file in a folder"));
    // A file that is called an array and is none.
    let broken = message(&zipped(&[("a.npy", b"hi")]));
    assert!(broken.starts_with("file:a: an npy file begins with"), "{broken}");
}

#[test]
fn a_name_that_is_there_twice_is_refused() {
    let one = npy(&Tensor::scalar(1.0_f32).into()).unwrap();
    let two = npy(&Tensor::scalar(2.0_f32).into()).unwrap();
    let mut bytes = zipped(&[("ab.npy", &one), ("ac.npy", &two)]);
    while let Some(at) = bytes.windows(6).position(|window| window == b"ac.npy") {
        bytes[at + 1] = b'b';
    }
    assert_eq!(
        message(&bytes),
        "file: a name is that of one array, and this archive has one twice"
    );
    // By another way: an array, and a file of the same name.
    let twice = message(&zipped(&[("a", b"hi"), ("a.npy", &one)]));
    assert_eq!(twice, "file: a name is that of one array, and \"a\" is that of two");
}

#[test]
fn numbers_that_changed_are_noticed() {
    let mut arrays = ArrayFile::new();
    arrays.insert("a", Tensor::from_flat_fn([64], |k| k as f32));
    for packing in [Packing::Stored, Packing::Deflated] {
        let bytes = npz(&arrays, packing).unwrap();
        let mut changed = bytes.clone();
        // Among the numbers: 30 bytes of a header before them, and those of the npy file.
        changed[200] ^= 1;
        let message = message(&changed);
        assert!(message.starts_with("file:a: the file can't be unpacked"), "{message}");
    }
}

#[test]
fn files_that_share_their_bytes_are_refused() {
    let bytes = npy(&Tensor::<f32>::zeros([1000]).into()).unwrap();
    let mut archive = zipped(&[("a.npy", &bytes), ("b.npy", &bytes)]);
    // The second entry of the directory leads to the first file.
    let entries: Vec<_> =
        (0..archive.len() - 4).filter(|&at| archive[at..].starts_with(b"PK\x01\x02")).collect();
    assert_eq!(entries.len(), 2);
    archive[entries[1] + 42..entries[1] + 46].copy_from_slice(&[0; 4]);
    let message = message(&archive);
    assert!(message.contains("each file of an archive has bytes of its own"), "{message}");
}

#[test]
fn no_more_is_unpacked_than_may_be() {
    let mut arrays = ArrayFile::new();
    arrays.insert("a", Tensor::<f32>::zeros([1000]));
    arrays.insert("b", Tensor::<f32>::zeros([1000]));
    let bytes = npz(&arrays, Packing::Deflated).unwrap();
    let unpacked = 2 * (128 + 4000);
    let most = |most: u64| super::super::npz::unpacked(&bytes, &location(), most);
    assert!(most(unpacked).is_ok());
    for least in [0, 128, 4127, 4128, unpacked - 1] {
        let message = most(least).unwrap_err().to_string();
        let expected =
            format!("file: at most {least} bytes of unpacked arrays are read, and there are");
        assert!(message.starts_with(&expected), "{message}");
    }
    // Nor is memory taken for what would be too much.
    arrays.insert("a", Tensor::<f32>::zeros([10_000_000]));
    let bytes = npz(&arrays, Packing::Deflated).unwrap();
    let counted = allocation_counter::measure(|| {
        assert!(super::super::npz::unpacked(&bytes, &location(), 1000).is_err());
    });
    assert!(counted.bytes_max < 200_000, "{}", counted.bytes_max);
}

#[test]
fn what_is_no_archive_is_refused() {
    assert_eq!(message(b""), "file: an npz file is a zip archive, and this is none");
    assert_eq!(message(b"\x93NUMPY"), "file: an npz file is a zip archive, and this is none");
    assert!(message(b"PK\x03\x04").starts_with("file: the archive can't be read"));
    let mut arrays = ArrayFile::new();
    arrays.metadata.insert("a".to_owned(), "b".to_owned());
    let message = npz(&arrays, Packing::Stored).unwrap_err().to_string();
    assert_eq!(message, "arrays in memory: an npz file has no metadata, and there is \"a\"");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_array_comes_back(
        list in vec(("[a-z .é江/]{0,6}", arrays()), 0..5),
        is_deflated: bool,
    ) {
        let mut arrays = ArrayFile::new();
        for (at, (name, array)) in list.into_iter().enumerate() {
            prop_assume!(array.number_type() != NumberType::Bf16);
            // Parts that no file could be are tested above.
            arrays.insert(format!("{at}{}", name.replace('/', "/_")), array);
        }
        let packing = if is_deflated { Packing::Deflated } else { Packing::Stored };
        let bytes = npz(&arrays, packing).unwrap();
        let found = read(&bytes);
        prop_assert!(found.names().eq(arrays.names()));
        for name in arrays.names() {
            prop_assert_eq!(found.get(name).unwrap(), arrays.get(name).unwrap());
        }
        prop_assert_eq!(npz(&found, packing).unwrap(), bytes);
    }
}
