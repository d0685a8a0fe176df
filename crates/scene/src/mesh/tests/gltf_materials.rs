//! What is read of the materials and images of glTF files.

use bokashi_render_ops::TextureBorder;
use serde_json::{Value, json};

use super::gltf::{Change, File};
use super::{message, of_corners, only};
use crate::error::{Location, SceneError};
use crate::picture::{Picture, Samples};

/// A file with two images, and a material of this JSON.
fn with_material(material: Value) -> File {
    let mut file = File::square();
    for byte in [7, 8] {
        let samples = Samples::U8(vec![byte; 3]);
        let picture = Picture { width: 1, height: 1, channels: 3, samples };
        let png = picture.encode_png(&Location::new("image")).unwrap();
        let view = file.list("bufferViews").len();
        file.accessor(&png, 5121, "SCALAR", png.len());
        file.list("images").push(json!({"bufferView": view, "mimeType": "image/png"}));
    }
    file.root["textures"] = json!([{"source": 1}, {"source": 0}, {"source": 1}]);
    file.root["materials"] = json!([material]);
    file.primitive()["material"] = json!(0);
    file
}

#[test]
fn materials_have_factors_and_images_each_once() {
    let file = with_material(json!({
        "name": "m", "alphaMode": "BLEND", "normalTexture": {"index": 1, "scale": 0.5},
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 0.75], "metallicFactor": 0.125,
            "roughnessFactor": 0.375, "baseColorTexture": {"index": 0},
            "metallicRoughnessTexture": {"index": 2}
        }
    }));
    let model = file.read().unwrap();
    let material = &model.materials[0];
    assert_eq!(material.base_color, [0.5, 0.25, 1.0, 0.75]);
    assert_eq!([material.metallic, material.roughness, material.normal_scale], [0.125, 0.375, 0.5]);
    let bytes = |number: Option<usize>| match &model.images[number.unwrap()].samples {
        Samples::U8(samples) => samples[0],
        other => panic!("{other:?}"),
    };
    assert_eq!(bytes(material.base_color_map.image), 8);
    assert_eq!(bytes(material.metallic_roughness_map.image), 8);
    assert_eq!(bytes(material.normal_map.image), 7);
    assert_eq!(model.images.len(), 2);
    assert!(only(&model).materials().eq([Some(0)]));
    let opaque =
        with_material(json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}}));
    assert_eq!(opaque.read().unwrap().materials[0].base_color, [1.0; 4]);
    assert!(opaque.read().unwrap().images.is_empty());
}

#[test]
fn coordinates_are_those_of_the_images_with_their_transform() {
    // The sample model TextureTransformTest of Khronos tells which way a rotation goes.
    let turned = |angle: f64| {
        json!({"KHR_texture_transform": {
            "offset": [0.5, 0.25], "scale": [2, 4], "rotation": angle, "texCoord": 1
        }})
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut file = with_material(json!({
        "normalTexture": {"index": 1, "extensions": turned(quarter)},
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0, "extensions": turned(quarter)},
            "metallicRoughnessTexture": {"index": 2}
        }
    }));
    let rows = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let number = file.floats(&rows, "VEC2");
    file.primitive()["attributes"]["TEXCOORD_1"] = json!(number);
    let model = file.read().unwrap();
    let found = of_corners(&only(&model).coordinates);
    // Counter-clockwise where v runs down: u becomes -v, and v becomes u.
    let expected = [[0.5, 0.25], [0.5, -1.75], [4.5, -1.75]];
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
    let material = &model.materials[0];
    assert!(material.base_color_map.image.is_some() && material.normal_map.image.is_some());
    assert!(material.metallic_roughness_map.image.is_none());
    assert!(model.notes[0].contains("its coordinates are others"), "{:?}", model.notes);
}

#[test]
fn what_is_left_out_is_noted() {
    let mut file = with_material(json!({
        "emissiveFactor": [1, 0, 0], "emissiveTexture": {"index": 0}, "alphaMode": "MASK",
        "alphaCutoff": 0.25, "extensions": {"KHR_materials_clearcoat": {}},
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}
    }));
    file.root["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]);
    file.root["animations"] = json!([{"channels": [], "samplers": []}]);
    file.root["textures"][0] = json!({"source": 1, "sampler": 0});
    file.root["samplers"] = json!([{"magFilter": 9728}]);
    let number = file.floats(&[[0.0, 0.0]; 4], "VEC2");
    file.primitive()["attributes"]["TEXCOORD_1"] = json!(number);
    let notes = file.read().unwrap().notes.join("; ");
    for expected in [
        "the extension \"KHR_materials_clearcoat\" of a material",
        "cameras",
        "animations",
        "light that",
        "image of light",
        "below the opacity 0.25",
        "filters",
        "coordinates that no image uses",
    ] {
        assert!(notes.contains(expected), "{expected}: {notes}");
    }
}

#[test]
fn broken_textures_and_images_are_errors_and_missing_ones_notes() {
    let material = || json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let parsed = |change: Change| {
        let mut file = with_material(material());
        change(&mut file.root);
        file.read()
    };
    let model = parsed(|root| root["images"][1] = json!({"uri": "no.png"})).unwrap();
    assert_eq!(model.notes, ["the image \"no.png\" is missing and was left out"]);
    let model = parsed(|root| root["textures"][0] = json!({})).unwrap();
    assert!(model.notes[0].contains("a texture has no image"), "{:?}", model.notes);
    let model = parsed(|root| root["images"][1] = json!({"bufferView": 0})).unwrap();
    let note = "the image 1 can't be read and was left out: an image is a PNG";
    assert!(model.notes.iter().any(|own| own.starts_with(note)), "{:?}", model.notes);
    let cases: [(Change, &str); 6] = [
        (|root| root["textures"][0]["sampler"] = json!(0), "0 samplers, and a texture names 0"),
        (
            |root| {
                root["textures"][0]["sampler"] = json!(0);
                root["samplers"] = json!([{"wrapT": 7}]);
            },
            "a wrap mode is 10497, 33071 or 33648, and one of sampler 0 is another",
        ),
        (|root| root["textures"] = json!([]), "0 textures, and a material names 0"),
        (|root| root["textures"][0]["source"] = json!(2), "2 images, and a texture names 2"),
        (|root| root["images"][1] = json!({}), "a buffer view or a URI, and image 1 has neither"),
        (|root| root["images"][1] = json!({"uri": "https://a/b.png"}), "the scheme \"https\""),
    ];
    for (change, expected) in cases {
        let error = message(parsed(change));
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

#[test]
fn images_go_on_as_their_samplers_say() {
    let mut file = with_material(json!({
        "normalTexture": {"index": 1},
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 2}
        }
    }));
    file.root["textures"] = json!([
        {"source": 1, "sampler": 1}, {"source": 1, "sampler": 0}, {"source": 1}
    ]);
    file.root["samplers"] =
        json!([{"wrapS": 10497, "wrapT": 33071}, {"wrapS": 33648, "minFilter": 9987}]);
    let model = file.read().unwrap();
    let material = &model.materials[0];
    assert_eq!(material.base_color_map.borders, [TextureBorder::Mirror, TextureBorder::Wrap]);
    assert_eq!(material.normal_map.borders, [TextureBorder::Wrap, TextureBorder::Clamp]);
    assert_eq!(material.metallic_roughness_map.borders, [TextureBorder::Wrap; 2]);
    assert_eq!(model.images.len(), 1);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
}

#[test]
fn images_that_overlap_are_refused() {
    let mut file = with_material(json!({}));
    // What follows a PNG is not read.
    let png = file.root["bufferViews"][4].clone();
    let length = png["byteLength"].as_u64().unwrap();
    let count = 1000;
    file.bytes.resize(file.bytes.len() + 4 * count, 0);
    for k in 0..count {
        let mut view = png.clone();
        view["byteLength"] = json!(length + 4 * k as u64);
        let number = file.list("bufferViews").len();
        file.list("bufferViews").push(view);
        file.list("images").push(json!({"bufferView": number}));
        file.list("textures").push(json!({"source": 2 + k}));
        let texture = json!({"baseColorTexture": {"index": 3 + k}});
        file.list("materials").push(json!({"pbrMetallicRoughness": texture}));
    }
    let found = file.read();
    assert!(matches!(found, Err(SceneError::TooLarge { .. })), "{found:?}");
    for name in ["bufferViews", "images", "textures", "materials"] {
        let kept = file.list(name).len() - count + 5;
        file.list(name).truncate(kept);
    }
    assert_eq!(file.read().unwrap().images.len(), 5);
}
