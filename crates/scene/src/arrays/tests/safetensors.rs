//! Files of safetensors: Python's, fits', and our own.

use std::collections::BTreeMap;
use std::fs;

use bokashi_core::Tensor;

use super::*;
use crate::{Scene, SceneFit};

fn read(bytes: &[u8]) -> ArrayFile {
    read_safetensors_bytes(bytes, &location()).unwrap()
}

fn message(bytes: &[u8]) -> String {
    read_safetensors_bytes(bytes, &location()).unwrap_err().to_string()
}

fn with_header(header: &str, numbers: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), numbers].concat()
}

#[test]
fn files_of_python_are_read() {
    let arrays = read_safetensors(data().join("several.safetensors")).unwrap();
    let expected = ["faces", "a.weights", "scalar", "none", "vertices", "half", "bytes", "truth"];
    let mut names: Vec<_> = arrays.names().collect();
    names.sort_unstable();
    let mut sorted = expected;
    sorted.sort_unstable();
    assert_eq!(names, sorted);
    let counted = |shape: &[usize]| Tensor::from_flat_fn(shape, |k| k as f64 - 2.0);
    assert_eq!(arrays.tensor::<f32>("vertices").unwrap().cast(), counted(&[4, 3]));
    assert_eq!(arrays.tensor::<f64>("a.weights").unwrap(), counted(&[2, 2]));
    assert_eq!(arrays.tensor::<f64>("half").unwrap(), counted(&[3]));
    assert_eq!(arrays.tensor::<f64>("scalar").unwrap(), counted(&[]));
    assert_eq!(arrays.tensor::<f32>("none").unwrap(), Tensor::zeros([0, 3]));
    assert_eq!(arrays.tensor::<f32>("bytes").unwrap().data(), [0.0, 255.0]);
    assert_eq!(arrays.tensor::<f32>("truth").unwrap().data(), [1.0, 0.0]);
    assert_eq!(arrays.get("faces").unwrap().indices::<3>().unwrap(), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(arrays.metadata["made by"], "NumPy");
    let message = arrays.tensor::<f32>("a.weights").unwrap_err().to_string();
    assert!(
        message.contains("several.safetensors:a.weights: numbers are read as f32 without"),
        "{message}"
    );
    // Written again they are the same arrays; the crate reads them, too.
    let bytes = safetensors(&arrays).unwrap();
    let file = ::safetensors::SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(file.len(), 8);
    assert_eq!(file.tensor("vertices").unwrap().shape(), [4, 3]);
}

#[test]
fn a_saved_fit_is_a_file_of_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let text = r#"
[[meshes]]
shape = "sphere"
faces = 80
[[views]]
name = "front"
camera = { size = [8, 8], angle = 40.0, position = [0, 0, 4] }
[learn.vertices]
[learn.exposure]
[stop]
steps = 2
"#;
    let path = folder.path().join("scene.toml");
    fs::write(&path, text).unwrap();
    let mut scene = Scene::load(&path).unwrap();
    let drawn = scene.rendered(&[0]).unwrap().next().unwrap().unwrap();
    fs::write(folder.path().join("front.png"), &drawn.files[0].1).unwrap();
    scene.views[0].image = Some("front.png".into());
    scene.objects[0].positions = scene.objects[0].positions.map(|x| 0.9 * x);
    let mut fit = SceneFit::new(scene).unwrap();
    while fit.step().unwrap().is_some() {}
    let saved = folder.path().join("fit.safetensors");
    fit.save(&saved).unwrap();
    let arrays = read_safetensors(&saved).unwrap();
    let mut count = 0;
    for parameter in fit.parameters().iter() {
        let raw = arrays.tensor::<f32>(&format!("raw/{}", parameter.name())).unwrap();
        assert_eq!(raw, *parameter.raw());
        let moments = arrays.tensor::<f32>(&format!("first_moment/{}", parameter.name())).unwrap();
        assert_eq!(moments.shape(), raw.shape());
        count += 1;
    }
    assert_eq!(count, 2);
    assert!(arrays.metadata.contains_key("bokashi_fit"));
    // Bytes of the pipeline, whole numbers all of them.
    assert_eq!(arrays.get("pipeline").unwrap().number_type(), NumberType::U8);
}

#[test]
fn arrays_of_other_types_are_refused_when_they_are_asked_for() {
    let header = [
        r#"{"a":{"dtype":"F8_E4M3","shape":[2],"data_offsets":[0,2]},"#,
        r#""b":{"dtype":"U8","shape":[1],"data_offsets":[2,3]}}"#,
    ];
    let arrays = read(&with_header(&header.concat(), &[1, 2, 3]));
    assert_eq!(arrays.names().collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(arrays.tensor::<f32>("b").unwrap().item(), 3.0);
    let error = arrays.get("a").unwrap_err().to_string();
    let rule = "file:a: numbers are truth values, whole numbers of up to 64 bits, or floats of 16 to 64 bits";
    assert_eq!(error, format!("{rule}, and these are F8_E4M3"));
    // Nor is such a file written with a part left out.
    assert_eq!(safetensors(&arrays).unwrap_err().to_string(), error);
}

#[test]
fn what_is_no_safetensors_file_is_refused() {
    let entry = |shape: &str, from: usize, to: usize| {
        format!(r#"{{"a":{{"dtype":"F32","shape":{shape},"data_offsets":[{from},{to}]}}}}"#)
    };
    assert!(read(&with_header(&entry("[1]", 0, 4), &[0; 4])).get("a").is_ok());
    for bytes in [
        vec![],
        vec![0; 7],
        vec![0xff; 16],
        with_header("", &[]),
        with_header("[]", &[]),
        with_header("{", &[]),
        with_header(&entry("[1]", 0, 4), &[0; 3]),
        with_header(&entry("[1]", 0, 4), &[0; 5]),
        with_header(&entry("[2]", 0, 4), &[0; 4]),
        with_header(&entry("[1]", 4, 8), &[0; 8]),
        with_header(&entry("[1]", 4, 0), &[0; 4]),
        with_header(&entry("[4294967296,4294967296]", 0, 4), &[0; 4]),
        with_header(&entry("[-1]", 0, 4), &[0; 4]),
    ] {
        assert!(
            message(&bytes).starts_with("file: a safetensors file is needed here"),
            "{bytes:?}"
        );
    }
    let axes = format!("[{}1]", "1,".repeat(64));
    let many = message(&with_header(&entry(&axes, 0, 4), &[0; 4]));
    assert_eq!(many, "file:a: an array has at most 64 axes, and this has 65");
}

#[test]
fn what_such_a_file_can_not_hold_is_not_written() {
    let mut arrays = ArrayFile::new();
    arrays.insert("__metadata__", Tensor::scalar(1.0_f32));
    let message = |arrays: &ArrayFile| safetensors(arrays).unwrap_err().to_string();
    assert!(
        message(&arrays).ends_with("no array of a safetensors file is called \"__metadata__\"")
    );
    let mut arrays = ArrayFile::new();
    arrays.insert("a", Tensor::<f32>::zeros([1 << 40, 1 << 40, 0]));
    assert!(message(&arrays).starts_with("arrays in memory: the safetensors file can't be made"));
}

#[test]
fn types_with_more_bytes_come_first_and_all_else_in_order() {
    let mut arrays = ArrayFile::new();
    arrays.insert("z", Tensor::scalar(1.0_f32));
    arrays.insert("y", &[[1_u32, 2]][..]);
    arrays.insert("x", Tensor::scalar(2.0_f64));
    arrays.metadata = BTreeMap::from([("b", "1"), ("a", "2")].map(|(k, v)| (k.into(), v.into())));
    let bytes = safetensors(&arrays).unwrap();
    let header = [
        r#"{"__metadata__":{"a":"2","b":"1"},"#,
        r#""x":{"dtype":"F64","shape":[],"data_offsets":[0,8]},"#,
        r#""z":{"dtype":"F32","shape":[],"data_offsets":[8,12]},"#,
        r#""y":{"dtype":"U32","shape":[1,2],"data_offsets":[12,20]}}"#,
    ]
    .concat();
    assert_eq!(std::str::from_utf8(&bytes[8..8 + header.len()]).unwrap(), header);
    assert_eq!(bytes.len() % 4, 0);
    assert_eq!(read(&bytes).names().collect::<Vec<_>>(), ["x", "z", "y"]);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_array_comes_back(
        list in vec((".{0,8}", arrays()), 0..6),
        metadata in proptest::collection::btree_map(".{0,8}", ".{0,8}", 0..4),
    ) {
        let mut arrays = ArrayFile::new();
        for (name, array) in list {
            arrays.insert(name, array);
        }
        arrays.metadata = metadata;
        let bytes = safetensors(&arrays).unwrap();
        let found = read(&bytes);
        prop_assert_eq!(&found.metadata, &arrays.metadata);
        prop_assert_eq!(found.names().len(), arrays.names().len());
        for name in arrays.names() {
            prop_assert_eq!(found.get(name).unwrap(), arrays.get(name).unwrap());
        }
        // Those without entries have come into the order of their names.
        let again = safetensors(&found).unwrap();
        prop_assert_eq!(again.len(), bytes.len());
        prop_assert_eq!(safetensors(&read(&again)).unwrap(), again);
    }
}
