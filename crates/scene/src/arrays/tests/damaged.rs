//! Whatever the bytes of a file are, the answer is an array or an error, and memory is taken in proportion to
//! the file.

use allocation_counter::measure;
use bokashi_core::Tensor;

use super::*;

/// Reads bytes as an array, all of it.
type Read = fn(&[u8]);

fn read_as_npy(bytes: &[u8]) {
    if let Ok(array) = read_npy_bytes(bytes, &location()) {
        look(&array);
    }
}

fn read_as_safetensors(bytes: &[u8]) {
    if let Ok(arrays) = read_safetensors_bytes(bytes, &location()) {
        arrays.names().for_each(|name| arrays.get(name).map_or((), look));
    }
}

#[cfg(feature = "npz")]
fn read_as_npz(bytes: &[u8]) {
    if let Ok(arrays) = read_npz_bytes(bytes, &location()) {
        arrays.names().for_each(|name| arrays.get(name).map_or((), look));
    }
}

/// What is read of an array has its shape.
fn look(array: &RawArray) {
    if let Ok(tensor) = array.tensor::<f64>() {
        assert_eq!(tensor.shape(), array.shape());
    }
    if let Ok(rows) = array.indices::<3>() {
        assert_eq!(rows.len(), array.shape()[0]);
    }
}

/// Files of each format, what reads them, and how many bytes of memory it may take for each of theirs.
fn files() -> Vec<(String, Vec<u8>, Read, u64)> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(data()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let bytes = std::fs::read(&path).unwrap();
        match path.extension().and_then(|ending| ending.to_str()).unwrap() {
            "npy" => files.push((name, bytes, read_as_npy as Read, 16)),
            "safetensors" => files.push((name, bytes, read_as_safetensors as Read, 32)),
            #[cfg(feature = "npz")]
            "npz" => files.push((name, bytes, read_as_npz as Read, 64)),
            _ => {}
        }
    }
    let mut arrays = ArrayFile::new();
    arrays.insert("a", Tensor::from_flat_fn([3, 5], |k| k as f64));
    arrays.insert("b", &[[1_u32, 2, 3]][..]);
    arrays.metadata.insert("key".to_owned(), "text".to_owned());
    let bytes = safetensors(&arrays).unwrap();
    files.push(("own.safetensors".to_owned(), bytes, read_as_safetensors, 32));
    assert!(files.len() > 40);
    files
}

/// What is taken for any file: names, messages, and what a library begins with.
const SURPLUS: u64 = 100_000;

fn check((name, file, read, factor): &(String, Vec<u8>, Read, u64), bytes: &[u8]) {
    let counted = measure(|| read(bytes));
    let most = SURPLUS + factor * bytes.len() as u64;
    let peak = counted.bytes_max;
    assert!(peak < most, "{name} of {} bytes: {} bytes took {peak}", file.len(), bytes.len());
}

#[test]
fn files_that_are_cut_short_have_an_answer() {
    for case in files() {
        for length in 0..=case.1.len() {
            check(&case, &case.1[..length]);
        }
    }
}

#[test]
fn files_with_a_wrong_byte_have_an_answer() {
    for case in files() {
        for index in 0..case.1.len() {
            for value in [0, 1, b'(', b'9', 0x7f, 0x80, 0xff] {
                let mut bytes = case.1.clone();
                bytes[index] = value;
                check(&case, &bytes);
            }
        }
    }
}

#[test]
fn files_that_grew_have_an_answer() {
    for case in files() {
        for index in (0..case.1.len()).step_by(3) {
            let (before, after) = case.1.split_at(index);
            for middle in [&b"0"[..], b"99999999", b"\xff\xff\xff\xff\xff\xff\xff\xff", before] {
                check(&case, &[before, middle, after].concat());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_have_an_answer(
        noise in vec(bytes(), 0..300),
        which: prop::sample::Index,
        index: prop::sample::Index,
    ) {
        let files = files();
        let case = &files[which.index(files.len())];
        check(case, &noise);
        // Noise after a true beginning.
        let beginning = &case.1[..index.index(case.1.len())];
        check(case, &[beginning, &noise].concat());
    }

    #[test]
    fn several_wrong_bytes_have_an_answer(
        which: prop::sample::Index,
        wrong in vec((any::<prop::sample::Index>(), bytes()), 1..20),
    ) {
        let files = files();
        let case = &files[which.index(files.len())];
        let mut bytes = case.1.clone();
        for (index, byte) in wrong {
            let index = index.index(bytes.len());
            bytes[index] = byte;
        }
        check(case, &bytes);
    }
}

#[test]
fn headers_that_claim_too_much_take_no_memory() {
    let headers = [
        "{'descr': '<f8', 'fortran_order': True, 'shape': (1000000000, 1000000), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (18446744073709551615,), }",
    ];
    for header in headers {
        let length = (header.len() as u32).to_le_bytes();
        let file = [b"\x93NUMPY\x02\x00", &length[..], header.as_bytes(), &[0; 80]].concat();
        check(&("claim".to_owned(), file.clone(), read_as_npy, 16), &file);
    }
    let header =
        r#"{"a":{"dtype":"F64","shape":[1000000000000],"data_offsets":[0,8000000000000]}}"#;
    let file = [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &[0; 80]].concat();
    check(&("claim".to_owned(), file.clone(), read_as_safetensors, 32), &file);
}

#[cfg(feature = "npz")]
#[test]
fn archives_that_claim_too_much_take_no_memory() {
    let plain = file("several.npz");
    let end = plain.len() - 22;
    assert!(plain[end..].starts_with(b"PK\x05\x06"));
    // The end of the directory in 64 bits, with a count, a size and a place of the directory.
    let claim = |count: u64, size: u64, start: u64| {
        let mut file = plain[..end].to_vec();
        let record = file.len() as u64;
        file.extend(b"PK\x06\x06");
        file.extend(44_u64.to_le_bytes());
        file.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        [count, count, size, start].iter().for_each(|case| file.extend(case.to_le_bytes()));
        file.extend(b"PK\x06\x07\0\0\0\0");
        file.extend(record.to_le_bytes());
        file.extend([1, 0, 0, 0]);
        file.extend(b"PK\x05\x06\0\0\0\0");
        file.extend([0xff; 12]);
        file.extend([0, 0]);
        file
    };
    let directory = u32::from_le_bytes(plain[end + 16..end + 20].try_into().unwrap()).into();
    // As it is, and then with more of everything.
    assert_eq!(read_npz_bytes(&claim(5, 1000, directory), &location()).unwrap().names().len(), 5);
    let large = [1 << 20, 1 << 31, 1 << 40, u64::MAX / 46, u64::MAX];
    for count in [5].into_iter().chain(large) {
        for size in [1000].into_iter().chain(large) {
            for start in [directory, 1 << 20, 1 << 40, u64::MAX - 1] {
                let file = claim(count, size, start);
                check(&("claim".to_owned(), file.clone(), read_as_npz, 64), &file);
            }
        }
    }
}
