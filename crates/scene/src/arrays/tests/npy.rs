//! Files of NumPy's, and those that NumPy would write.

use bokashi_core::Tensor;

use super::*;

/// The entries that NumPy counted, in row-major order.
fn counted(shape: &[usize]) -> Tensor<f64> {
    Tensor::from_flat_fn(shape, |k| k as f64 - 2.0)
}

fn read(name: &str) -> RawArray {
    read_npy(data().join(format!("{name}.npy"))).unwrap()
}

fn message(bytes: &[u8]) -> String {
    read_npy_bytes(bytes, &location()).unwrap_err().to_string()
}

/// A file of version 1.0 with this header.
fn with_header(header: &str, numbers: &[u8]) -> Vec<u8> {
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), numbers].concat()
}

#[test]
fn numpys_files_are_read_and_come_back_byte_for_byte() {
    use NumberType::{F16, F32, F64, I8, I16, I32, I64};
    let rows: [(&str, NumberType, &[usize]); 16] = [
        ("f2", F16, &[2, 3]),
        ("f4", F32, &[2, 3]),
        ("f8", F64, &[2, 3]),
        ("i1", I8, &[7]),
        ("i2", I16, &[7]),
        ("i4", I32, &[7]),
        ("i8", I64, &[7]),
        ("scalar", F64, &[]),
        ("one_axis", F32, &[11]),
        ("five_axes", F64, &[2, 1, 3, 1, 2]),
        ("no_rows", F32, &[0, 3]),
        ("no_columns", F64, &[3, 0, 2]),
        ("long", F32, &[12_345_678_901, 0]),
        ("many_axes", F32, &{
            let mut shape = [1; 32];
            shape[31] = 2;
            shape
        }),
        // A header that needs no padding has a block of it.
        ("aligned", F32, &{
            let mut shape = [1; 36];
            shape[35] = 0;
            shape
        }),
        ("nearly_aligned", F32, &{
            let mut shape = [1; 14];
            (shape[12], shape[13]) = (10, 0);
            shape
        }),
    ];
    for (name, kind, shape) in rows {
        let array = read(name);
        assert_eq!((array.number_type(), &**array.shape()), (kind, shape), "{name}");
        assert_eq!(array.tensor::<f64>().unwrap(), counted(shape), "{name}");
        assert_eq!(npy(&array).unwrap(), file(&format!("{name}.npy")), "{name}");
    }
}

#[test]
fn the_extremes_of_whole_numbers_are_read_where_they_are_exact() {
    let two = |power: i32| 2.0_f64.powi(power);
    let rows = [
        ("u1", [0.0, 255.0]),
        ("u2", [0.0, 65535.0]),
        ("u4", [0.0, two(32) - 1.0]),
        ("i1", [-128.0, 127.0]),
        ("i2", [-two(15), two(15) - 1.0]),
        ("i4", [-two(31), two(31) - 1.0]),
    ];
    for (name, expected) in rows {
        let array = read(&format!("extreme_{name}"));
        assert_eq!(array.tensor::<f64>().unwrap().data(), expected, "{name}");
        assert_eq!(npy(&array).unwrap(), file(&format!("extreme_{name}.npy")));
    }
    for (name, largest) in [("u8", "18446744073709551615"), ("i8", "9223372036854775807")] {
        let array = read(&format!("extreme_{name}"));
        let message = array.tensor::<f64>().unwrap_err().to_string();
        let rule = "are read as f64 without rounding, and the entry at [1] is";
        assert!(message.ends_with(&format!("{rule} {largest}")), "{message}");
        assert_eq!(npy(&array).unwrap(), file(&format!("extreme_{name}.npy")));
    }
    let truth = read("truth");
    assert_eq!(truth.tensor::<f32>().unwrap(), Tensor::from([[1.0, 0.0], [0.0, 1.0]]));
    assert_eq!(npy(&truth).unwrap(), file("truth.npy"));
}

#[test]
fn bits_of_zeros_and_nans_stay() {
    let four = read("bits_f4");
    let bits: Vec<_> = four.tensor::<f32>().unwrap().data().iter().map(|x| x.to_bits()).collect();
    let expected = [0, 1 << 31, 1, 0x7f80_0000, 0xff80_0000, 0x7fc0_0001, 0xff80_0001];
    assert_eq!(bits, expected);
    let eight = read("bits_f8");
    let bits: Vec<_> = eight.tensor::<f64>().unwrap().data().iter().map(|x| x.to_bits()).collect();
    let nans = [(0x7ff8 << 48) + 1, (0xfff << 52) + 1];
    assert_eq!(bits[..5], [0, 1 << 63, 1, 0x7ff << 52, 0xfff << 52]);
    assert_eq!(bits[5..], nans);
    let two = read("bits_f2").tensor::<f32>().unwrap();
    let least = 2.0_f32.powi(-24);
    assert_eq!(two.data()[..5], [0.0, -0.0, least, f32::INFINITY, f32::NEG_INFINITY]);
    assert!(two.data()[1].is_sign_negative() && two.data()[5..].iter().all(|x| x.is_nan()));
    for name in ["bits_f2", "bits_f4", "bits_f8"] {
        assert_eq!(npy(&read(name)).unwrap(), file(&format!("{name}.npy")));
    }
    assert_eq!(four.tensor::<f64>().unwrap().data()[2], 2.0_f64.powi(-149));
}

#[test]
fn other_orders_of_bytes_and_axes_hold_the_same_entries() {
    for name in ["big_f2", "big_f4", "big_f8", "big_i2", "fortran_f8", "version_2", "version_3"] {
        assert_eq!(read(name).tensor::<f64>().unwrap(), counted(&[2, 3]), "{name}");
    }
    let four = read("fortran_four_axes");
    assert_eq!(four.tensor::<f32>().unwrap().cast(), counted(&[2, 3, 4, 5]));
    assert_eq!(read("fortran_big_i8").tensor::<f64>().unwrap(), counted(&[3, 2, 2]));
    let truth = Tensor::from([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(read("fortran_truth").tensor::<f64>().unwrap(), truth);
    assert_eq!(read("big_u4").indices::<3>().unwrap(), [[1, 2, 3], [4, 5, 6]]);
}

#[test]
fn what_is_no_array_of_numbers_is_refused_by_name() {
    let rows = [
        ("objects", "Python objects, \"|O\""),
        ("records", "records"),
        ("records_3", "records"),
        ("complex", "complex numbers, \"<c16\""),
        ("texts", "texts, \"<U2\""),
        ("byte_texts", "texts, \"|S2\""),
        ("times", "times, \"<M8[D]\""),
        ("long_double", "none that is known, \"<f16\""),
        ("raw", "raw bytes, \"|V3\""),
    ];
    let rule = "file: numbers are truth values, whole numbers of up to 64 bits, or floats of 16 to 64 bits";
    for (name, expected) in rows {
        let message = message(&file(&format!("{name}.npy")));
        assert_eq!(message, format!("{rule}, and these are {expected}"));
    }
}

#[test]
fn headers_are_read_as_python_writes_them_and_no_other_way() {
    let number = 7.0_f64.to_le_bytes();
    let fine = [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (), }\n",
        "{\"shape\":(1,),\"fortran_order\":True,\"descr\":\"<f8\"}",
        " { 'shape' : ( 1 , 1 ) , 'descr' : '<f8' , 'fortran_order' : False , } \n  ",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1L, 1L), }\n",
    ];
    for header in fine {
        let array = read_npy_bytes(&with_header(header, &number), &location()).unwrap();
        assert_eq!(array.tensor::<f64>().unwrap().data(), [7.0], "{header}");
    }
    let rows = [
        ("", "a header has \"{\" here, and this has \"\""),
        ("{'descr': '<f8', 'fortran_order': False}", "and it lacks some of them"),
        ("{'descr': '<f8', 'descr': '<f8'}", "each once, and there is \"descr\""),
        ("{'shape': (), 'order': 1}", "each once, and there is \"order\""),
        ("{'shape': (3)}", "a comma after the only extent here, and this has \")}\""),
        ("{'shape': 3}", "has \"(\" here, and this has \"3}\""),
        ("{'shape': (-1,)}", "has an extent here, and this has \"-1,)}\""),
        ("{'shape': (01,)}", "has an extent here"),
        ("{'shape': (,)}", "has an extent here"),
        ("{'shape': (1.5,)}", "here, and this has \".5,)}\""),
        ("{'shape': (99999999999999999999,)}", "an extent is an index, and this is 9999"),
        ("{'fortran_order': 0}", "has True or False here, and this has \"0}\""),
        ("{'descr': <f8}", "has a string here"),
        ("{'descr': '<f8}", "has a string here"),
        ("{'descr': ['", "has a string here"),
        ("{'descr': [[[[", "has the end of a list here"),
        ("{'descr': '<f8' 'shape': ()}", "has \"}\" here"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': ()} x", "has its end here"),
        ("{'descr': 'f8', 'fortran_order': False, 'shape': ()}", "none that is known, \"f8\""),
        ("{'descr': '|f8', 'fortran_order': False, 'shape': ()}", "of no order of bytes, \"|f8\""),
        ("{'descr': '', 'fortran_order': False, 'shape': ()}", "none that is known, \"\""),
    ];
    for (header, expected) in rows {
        let message = message(&with_header(header, &number));
        assert!(message.contains(expected), "{header}: {message}");
    }
    let axes = "1, ".repeat(65);
    let header = format!("{{'shape': ({axes})}}");
    assert_eq!(
        message(&with_header(&header, &[])),
        "file: an array has at most 64 axes, and this has more"
    );
}

#[test]
fn lengths_against_the_shape_are_refused() {
    let header =
        |shape: &str| format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    for (length, expected) in [(0, "0"), (23, "23"), (25, "25"), (48, "48")] {
        let message = message(&with_header(&header("(2, 3)"), &vec![0; length]));
        let rule = "file: an array of shape [2, 3] has 24 bytes of f32";
        assert_eq!(message, format!("{rule}, and {expected} bytes follow the header"));
    }
    let huge = message(&with_header(&header("(4294967296, 4294967296)"), &[0; 24]));
    assert!(
        huge.contains("has more bytes of f32 than fit an index, and 24 bytes follow"),
        "{huge}"
    );
    let wraps = message(&with_header(&header("(4611686018427387904, 4)"), &[]));
    assert!(wraps.contains("has more bytes of f32 than fit an index"), "{wraps}");
    // With no entries the other extents are no matter.
    for order in ["True", "False"] {
        let header =
            header("(0, 18446744073709551615, 18446744073709551615)").replace("False", order);
        let array = read_npy_bytes(&with_header(&header, &[]), &location()).unwrap();
        assert_eq!(array.tensor::<f32>().unwrap().size(), 0);
        assert_eq!(npy(&array).unwrap().len() % 64, 0);
    }
}

#[test]
fn what_is_no_npy_file_is_refused() {
    let rule = "file: an npy file begins with the bytes 93 4e 55 4d 50 59";
    assert_eq!(message(b"hello you"), format!("{rule}, and this with \"68 65 6c 6c 6f 20\""));
    assert_eq!(message(b""), format!("{rule}, and this with \"\""));
    let of_version = message(b"\x93NUMPY\x04\x00");
    assert_eq!(of_version, "file: versions 1.0, 2.0 and 3.0 of npy are read, and this is 4.0");
    for short in [&b"\x93NUMPY"[..], b"\x93NUMPY\x01\x00\x01", b"\x93NUMPY\x02\x00\xff\xff\xff\xff"]
    {
        assert!(message(short).ends_with("has a whole header, and this ends before"));
    }
    assert!(message(b"\x93NUMPY\x03\x00\x01\x00\x00\x00\xff").contains("is UTF-8"));
    let missing = read_npy("no such file.npy").unwrap_err().to_string();
    assert!(missing.starts_with("no such file.npy could not be read"), "{missing}");
}

#[test]
fn what_numpy_does_not_have_is_not_written() {
    let array = RawArray::new(NumberType::Bf16, [1], vec![0, 0]).unwrap();
    let message = npy(&array).unwrap_err().to_string();
    assert_eq!(message, "an array: NumPy has no numbers of bf16: read them as f32");
    let axes = RawArray::from(&Tensor::<f32>::zeros(&[1; 65][..]));
    let message = npy(&axes).unwrap_err().to_string();
    assert_eq!(message, "an array: an array has at most 64 axes, and this has 65");
}

#[test]
fn a_file_holds_a_tensor_or_rows_of_indices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let tensor = Tensor::from([[1.5_f32, -0.0], [f32::MIN_POSITIVE, 3.0]]);
    write_npy(&path, &tensor).unwrap();
    assert_eq!(read_npy(&path).unwrap().tensor::<f32>().unwrap(), tensor);
    assert_eq!(read_npy(&path).unwrap().tensor::<f64>().unwrap(), tensor.cast());
    let faces = [[0_u32, 1, u32::MAX], [2, 1, 3]];
    write_npy(&path, &faces[..]).unwrap();
    assert_eq!(read_npy(&path).unwrap().indices::<3>().unwrap(), faces);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_array_comes_back(array in arrays()) {
        prop_assume!(array.number_type() != NumberType::Bf16);
        let bytes = npy(&array).unwrap();
        prop_assert_eq!(read_npy_bytes(&bytes, &location()).unwrap(), array);
    }

    #[test]
    fn axes_and_bytes_turned_round_are_turned_back(array in arrays(), is_big: bool, is_fortran: bool) {
        prop_assume!(array.number_type() != NumberType::Bf16);
        let size = array.number_type().bytes();
        let shape = array.shape();
        // Entry by entry, where the first axis would have it.
        let mut numbers = vec![0; array.bytes().len()];
        for (at, number) in array.bytes().chunks(size).enumerate() {
            let (mut rest, mut there, mut stride) = (at, 0, array.bytes().len() / size);
            for &extent in shape.iter().rev() {
                stride /= extent;
                there += rest % extent * stride;
                rest /= extent;
            }
            let there = if is_fortran { there } else { at };
            let to = &mut numbers[there * size..][..size];
            to.copy_from_slice(number);
            if is_big {
                to.reverse();
            }
        }
        let written = npy(&array).unwrap();
        let header = String::from_utf8(written[10..written.len() - numbers.len()].to_vec()).unwrap();
        let header = if is_big { header.replace('<', ">") } else { header };
        let header = if is_fortran { header.replace("False", "True") } else { header };
        let found = read_npy_bytes(&with_header(&header, &numbers), &location()).unwrap();
        prop_assert_eq!(found, array);
    }
}
