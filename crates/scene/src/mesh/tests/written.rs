//! What is written comes back, and is what other readers expect.

use bokashi_render_ops::TextureBorder;
use glam::{DMat4, DVec3};

use super::{HERE, message, read, read_with};
use crate::error::SceneError;
use crate::mesh::MeshKind::{Gltf, Obj, Ply};
use crate::mesh::{glb, obj, ply};
use crate::model::{Geometry, Indexed, MaterialFile, MaterialMap, Model, NO_ROW, Placed, Submesh};
use crate::picture::{Picture, Samples};

/// A pyramid with a seam: attributes are indexed each in its own way, as welding numbers them.
fn pyramid() -> Geometry {
    let coordinates = vec![[0.5, 0.25], [1.0, 0.5], [0.0, 1.0], [0.25, 0.125], [2.0, -1.0]];
    let normals = vec![[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]];
    Geometry {
        name: "pyramid".to_owned(),
        positions: vec![[0.0, 1.0, 0.1], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1e-20]],
        offset: DVec3::ZERO,
        faces: vec![[2, 1, 0], [0, 1, 3], [3, 2, 0]],
        colors: Some(Indexed {
            rows: vec![[0.0, 0.5, 1.0], [0.1, 0.2, 0.3]],
            faces: vec![[0, 0, 1], [1, 0, 0], [0, 1, 1]],
        }),
        coordinates: Some(Indexed {
            rows: coordinates,
            faces: vec![[0, 1, 2], [3, 1, 4], [4, 0, 2]],
        }),
        normals: Some(Indexed { rows: normals, faces: vec![[0; 3], [1; 3], [2; 3]] }),
        tangents: Some(Indexed {
            rows: vec![[1.0, 0.0, 0.0, -1.0], [0.0, 0.6, 0.8, 1.0]],
            faces: vec![[0; 3], [1, 0, 1], [1; 3]],
        }),
        submeshes: vec![Submesh { material: Some(1), faces: 0..3 }],
    }
}

/// The pyramid with three submeshes, of which the second has no attributes and the third no normals.
fn patchwork() -> Geometry {
    let mut geometry = pyramid();
    let materials = [Some(1), None, Some(0)];
    let submeshes = materials.into_iter().enumerate();
    geometry.submeshes =
        submeshes.map(|(k, material)| Submesh { material, faces: k..k + 1 }).collect();
    geometry.colors.as_mut().unwrap().faces[1] = [NO_ROW; 3];
    geometry.coordinates = Some(Indexed {
        rows: vec![[0.5, 0.25], [1.0, 0.5], [0.0, 1.0]],
        faces: vec![[0, 1, 2], [NO_ROW; 3], [2, 0, 1]],
    });
    geometry.normals = Some(Indexed {
        rows: vec![[0.0, 0.0, 1.0]],
        faces: vec![[0; 3], [NO_ROW; 3], [NO_ROW; 3]],
    });
    // Only where there are normals.
    geometry.tangents = Some(Indexed {
        rows: vec![[1.0, 0.0, 0.0, -1.0]],
        faces: vec![[0; 3], [NO_ROW; 3], [NO_ROW; 3]],
    });
    geometry
}

fn model() -> Model {
    let bare = Geometry {
        name: String::new(),
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        offset: DVec3::ZERO,
        faces: vec![[0, 1, 2]],
        colors: None,
        coordinates: None,
        normals: None,
        tangents: None,
        submeshes: vec![Submesh { material: None, faces: 0..1 }],
    };
    let painted = MaterialFile {
        name: "painted".to_owned(),
        base_color: [0.1, 0.2, 0.3, 0.4],
        base_color_map: MaterialMap::new(1, [TextureBorder::Clamp, TextureBorder::Mirror]),
        metallic: 0.25,
        roughness: 0.75,
        metallic_roughness_map: MaterialMap::new(0, [TextureBorder::Wrap; 2]),
        normal_map: MaterialMap::new(0, [TextureBorder::Wrap, TextureBorder::Clamp]),
        normal_scale: 0.5,
    };
    let images = vec![
        Picture { width: 2, height: 1, channels: 3, samples: Samples::U8(vec![1, 2, 3, 4, 5, 6]) },
        Picture { width: 1, height: 2, channels: 4, samples: Samples::U16(vec![9; 8]) },
    ];
    let moved = DMat4::from_scale_rotation_translation(
        DVec3::new(1.0, 2.0, 0.5),
        glam::DQuat::from_rotation_y(0.5),
        DVec3::new(3.0, 4.0, 5.0),
    );
    // What a file holds: its matrices have numbers of 32 bits.
    let moved = DMat4::from_cols_array(&moved.to_cols_array().map(|x| f64::from(x as f32)));
    let placed =
        |name: &str, geometry, transform| Placed { name: name.to_owned(), geometry, transform };
    Model {
        geometries: vec![bare, pyramid(), patchwork()],
        materials: vec![MaterialFile::default(), painted],
        images,
        placed: vec![
            placed("b", 1, moved),
            placed("", 0, DMat4::IDENTITY),
            placed("c", 1, DMat4::IDENTITY),
            placed("d", 2, DMat4::IDENTITY),
        ],
        notes: Vec::new(),
    }
}

#[test]
fn a_model_comes_back_from_glb() {
    let mut model = model();
    let found = read(Gltf, glb(&model).unwrap()).unwrap();
    // One material is blended.
    model.notes = vec!["the opacity of a material was left out: all of it is drawn".to_owned()];
    assert_eq!(found, model);
}

#[test]
fn a_glb_keeps_the_rules_of_the_specification() {
    let bytes = glb(&model()).unwrap();
    assert_eq!(bytes.len() % 4, 0);
    assert_eq!(bytes[8..12], (bytes.len() as u32).to_le_bytes());
    // The library checks numbers of parts and what must be there.
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let buffer = file.blob.as_ref().unwrap();
    // A chunk is filled up to a multiple of four.
    let length = file.document.buffers().next().unwrap().length();
    assert_eq!(length.next_multiple_of(4), buffer.len());
    for accessor in file.document.accessors() {
        let view = accessor.view().unwrap();
        assert_eq!(view.offset() % accessor.data_type().size(), 0);
        assert!(accessor.size() * accessor.count() <= view.length());
        assert!(view.target().is_some() && view.stride().is_none());
    }
    for mesh in file.document.meshes() {
        for primitive in mesh.primitives() {
            let reader = primitive.reader(|_| Some(buffer));
            let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
            let bounds = primitive.bounding_box();
            for k in 0..3 {
                let along = || positions.iter().map(|row| row[k]);
                assert_eq!(bounds.min[k], along().fold(f32::INFINITY, f32::min));
                assert_eq!(bounds.max[k], along().fold(f32::NEG_INFINITY, f32::max));
            }
            let indices = reader.read_indices().unwrap().into_u32();
            assert!(indices.into_iter().all(|index| (index as usize) < positions.len()));
        }
    }
}

#[test]
fn an_empty_model_is_a_valid_file_without_a_mesh() {
    let bytes = glb(&Model::default()).unwrap();
    gltf::Gltf::from_slice(&bytes).unwrap();
    assert!(message(read(Gltf, bytes)).contains("has a face with three vertices"));
}

#[test]
fn a_geometry_comes_back_from_ply() {
    let mut geometry = pyramid();
    let bytes = ply(&geometry, HERE, &[], |_| None).unwrap();
    let back = read(Ply, bytes).unwrap();
    geometry.name = String::new();
    geometry.submeshes[0].material = None;
    // The format has none.
    geometry.tangents = None;
    let colors = std::mem::take(&mut geometry.colors).unwrap();
    let mut found = back.geometries[0].clone();
    let rounded = std::mem::take(&mut found.colors).unwrap();
    assert_eq!(found, geometry);
    // Colours have 8 bits there, which come back from then on.
    assert_eq!(rounded.faces, colors.faces);
    for (rounded, exact) in rounded.rows.iter().flatten().zip(colors.rows.iter().flatten()) {
        assert!((rounded - exact).abs() < 0.005, "{rounded} {exact}");
    }
    let again = read(Ply, ply(&back.geometries[0], HERE, &[], |_| None).unwrap()).unwrap();
    assert_eq!(again, back);
    let bare = model().geometries.swap_remove(0);
    assert_eq!(read(Ply, ply(&bare, HERE, &[], |_| None).unwrap()).unwrap().geometries, [bare]);
}

#[test]
fn an_obj_file_comes_back_from_glb() {
    let text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\nvt 0 0\nvt 1 0\n\
                vt .5 .5\nv 1 0 2\nv 0 0 2\nv 0 1 2\no a\nf 4/1 3/2 2/3\nf 1/3 2/2 3/1\n\
                usemtl x\nf 1 3 4\no b\nf 5/1 6/2 7/1\nmtllib m.mtl\n";
    let folder = tempfile::tempdir().unwrap();
    let files = [("m.mtl", &b"newmtl x\nKd 1 0 0\n"[..])];
    let model = read_with(Obj, text, &files, folder.path()).unwrap();
    assert_eq!(model.geometries.len(), 2);
    assert_eq!(model.geometries[0].submeshes.len(), 2);
    assert_eq!(read(Gltf, glb(&model).unwrap()).unwrap(), model);
}

#[test]
fn materials_come_back_from_ply_and_obj() {
    let mut model = model();
    model.materials[1].base_color = [0.1, 0.2, 0.3, 1.0];
    let mesh = &model.geometries[2];
    // An image of a file that is not there is noted, and the material stays.
    let bytes = ply(mesh, HERE, &model.materials, |image| Some(format!("{image}.png"))).unwrap();
    let back = read(Ply, bytes).unwrap();
    let found: Vec<_> = back.geometries[0].submeshes.iter().map(|k| k.material).collect();
    assert_eq!(found, [Some(0), None, Some(1)]);
    assert_eq!(back.geometries[0].faces, mesh.faces);
    for (found, expected) in back.materials.iter().zip([&model.materials[1], &model.materials[0]]) {
        assert_eq!([found.roughness, found.metallic], [expected.roughness, expected.metallic]);
        for (found, expected) in found.base_color.iter().zip(expected.base_color) {
            assert!((found - expected).abs() < 0.005, "{found} {expected}");
        }
    }
    let expected = "the image \"1.png\" is missing and was left out";
    assert!(back.notes.iter().any(|note| note == expected), "{:?}", back.notes);

    let files = obj(&model, "a", |_| None).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut beside = vec![("a.mtl", files.mtl.as_bytes())];
    beside.extend(files.images.iter().map(|(name, bytes)| (&**name, &bytes[..])));
    let back = read_with(Obj, &files.obj, &beside, folder.path()).unwrap();
    assert_eq!(back.geometries.len(), model.placed.len());
    for (found, placed) in back.geometries.iter().zip(&model.placed) {
        let mesh = &model.geometries[placed.geometry];
        let materials = |original: &Geometry, parsed: &Model| -> Vec<_> {
            let original = original.submeshes.iter();
            let name = |k: usize| parsed.materials[k].base_color;
            original.map(|k| (k.material.map(name), k.faces.clone())).collect()
        };
        assert_eq!(materials(found, &back), materials(mesh, &model));
        assert_eq!(found.faces, mesh.faces);
        for (found, original) in found.positions.iter().zip(&mesh.positions) {
            let original = glam::Vec3::from(*original).as_dvec3();
            let expected = placed.transform.transform_point3(original).as_vec3().to_array();
            assert_eq!(*found, expected);
        }
        let rows = |original: &Option<Indexed<2>>| {
            original.as_ref().map(|original| original.faces.clone())
        };
        assert_eq!(rows(&found.coordinates), rows(&mesh.coordinates));
        let rows = |original: &Option<Indexed<3>>| {
            original.as_ref().map(|original| original.faces.clone())
        };
        assert_eq!(rows(&found.normals), rows(&mesh.normals));
    }
    let names: Vec<&str> = back.materials.iter().map(|material| &*material.name).collect();
    let painted = &back.materials[names.iter().position(|name| *name == "painted").unwrap()];
    let original = &model.materials[1];
    assert_eq!(painted.base_color, original.base_color);
    assert_eq!([painted.roughness, painted.metallic], [original.roughness, original.metallic]);
    assert_eq!(painted.normal_scale, original.normal_scale);
    let image = |original: Option<usize>, parsed: &Model| parsed.images[original.unwrap()].clone();
    assert_eq!(
        image(painted.base_color_map.image, &back),
        image(original.base_color_map.image, &model)
    );
    assert_eq!(image(painted.normal_map.image, &back), image(original.normal_map.image, &model));
    assert!(obj(&model, "a\nb", |_| None).is_err());
}

#[test]
fn models_that_break_a_rule_are_not_written() {
    type Change = fn(&mut Model);
    let cases: [(Change, &str); 13] = [
        (|model| model.geometries[1].submeshes[0].faces = 0..2, "has submeshes of its 3 faces"),
        (|model| model.geometries[2].submeshes[1].faces = 2..2, "faces, one after another"),
        (|model| model.geometries[0].faces = Vec::new(), "has a face or more"),
        (|model| model.geometries[0].faces[0] = [0, 1, 3], "has 3 positions, and face 0 names"),
        (|model| model.geometries[0].positions[1][0] = f32::NAN, "has finite positions"),
        (
            |model| model.geometries[1].submeshes[0].material = Some(2),
            "has 2 of the kind \"material\"",
        ),
        (|model| model.placed[0].geometry = 3, "has 3 of the kind \"geometry\""),
        (|model| model.placed[0].transform.x_axis.x = 1e300, "a matrix is finite"),
        (|model| model.materials[0].roughness = f32::NAN, "the numbers of the material"),
        (|model| model.materials[0].normal_map.image = Some(2), "has 2 of the kind \"image\""),
        (|model| model.images[0].samples = Samples::F32(vec![0.0; 6]), "8 or 16 bits"),
        (|model| model.images[0].width = 3, "an image of 3 x 1"),
        (
            |model| model.geometries[1].colors.as_mut().unwrap().faces.truncate(1),
            "colours for each of its 3 faces",
        ),
    ];
    for (change, expected) in cases {
        let mut model = model();
        change(&mut model);
        let error = glb(&model).unwrap_err();
        assert!(matches!(error, SceneError::Content { .. }), "{error:?}");
        assert!(error.to_string().contains(expected), "{expected}: {error}");
    }
    let mut geometry = pyramid();
    geometry.normals.as_mut().unwrap().faces[0] = [7; 3];
    assert!(ply(&geometry, HERE, &[], |_| None).unwrap_err().to_string().contains("has 3 normals"));
}

/// The corners of the faces of a PLY that was written.
fn written_corners(geometry: &Geometry, places: &[DMat4]) -> Vec<[DVec3; 3]> {
    let back = read(Ply, ply(geometry, places, &[], |_| None).unwrap()).unwrap();
    let [mesh] = &back.geometries[..] else { panic!("{} meshes", back.geometries.len()) };
    let point =
        |vertex: u32| DVec3::from(mesh.positions[vertex as usize].map(f64::from)) + mesh.offset;
    mesh.faces.iter().map(|face| face.map(point)).collect()
}

#[test]
fn a_ply_and_an_obj_stand_in_the_world_in_all_places() {
    let geometry =
        Geometry { submeshes: vec![Submesh { material: None, faces: 0..3 }], ..pyramid() };
    let corners = geometry.faces.iter().map(|face| {
        face.map(|vertex| DVec3::from(geometry.positions[vertex as usize].map(f64::from)))
    });
    let corners: Vec<_> = corners.collect();
    let normal_of = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).normalize();
    let turn = DMat4::from_rotation_x(0.3) * DMat4::from_scale(DVec3::new(1.0, 4.0, 0.5));
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    // The last is as far as a map's coordinates.
    let shift = DMat4::from_translation(DVec3::new(500_000.0, 4_649_776.0, 100.0));
    for places in [&[turn][..], &[DMat4::IDENTITY, mirror], &[turn, shift * mirror, shift]] {
        let found = written_corners(&geometry, places);
        assert_eq!(found.len(), 3 * places.len());
        for (k, (place, expected)) in places
            .iter()
            .flat_map(|place| corners.iter().map(move |face| (place, face)))
            .enumerate()
        {
            let expected = expected.map(|point| place.transform_point3(point));
            let [a, b, c] = expected;
            // Seen from outside a mirrored face is clockwise, unless it was turned around.
            let expected = if place.determinant() < 0.0 { [a, c, b] } else { expected };
            for (found, expected) in found[k].iter().zip(expected) {
                // Far apart, the mesh that is read has the bits that are left; the file has all of them.
                let epsilon = if places.len() == 3 { 0.3 } else { 1e-6 };
                assert!(found.distance(expected) < epsilon, "{k}: {found} {expected}");
            }
        }
        // The PLY has the bits that the OBJ has.
        let placed =
            places.iter().map(|&transform| Placed { name: String::new(), geometry: 0, transform });
        let model = Model {
            geometries: vec![geometry.clone()],
            placed: placed.collect(),
            ..Model::default()
        };
        let files = obj(&model, "a", |_| None).unwrap();
        let text = files.obj.lines().filter_map(|line| line.strip_prefix("v "));
        let text: Vec<DVec3> = text
            .map(|line| {
                let all = line.split(' ').map(|x| x.parse::<f64>().unwrap());
                DVec3::from_slice(&all.collect::<Vec<_>>())
            })
            .collect();
        let expected = places.iter().flat_map(|place| {
            geometry.positions.iter().map(|p| place.transform_point3(DVec3::from(p.map(f64::from))))
        });
        for (found, expected) in text.iter().zip(expected) {
            assert!(found.distance(expected) < 1e-6);
        }
        assert_eq!(text.len(), 4 * places.len());
    }
    // Normals stay normal to a surface that is squeezed, and are of length 1.
    let flat = Geometry {
        normals: Some(Indexed {
            rows: corners.iter().map(|&face| normal_of(face).as_vec3().to_array()).collect(),
            faces: vec![[0; 3], [1; 3], [2; 3]],
        }),
        ..geometry.clone()
    };
    let back = read(Ply, ply(&flat, &[turn, mirror * turn], &[], |_| None).unwrap()).unwrap();
    let normals = back.geometries[0].normals.as_ref().unwrap();
    for (face, normal) in written_corners(&flat, &[turn, mirror * turn]).iter().zip(&normals.faces)
    {
        let normal = DVec3::from(normals.rows[normal[0] as usize].map(f64::from));
        assert!(normal.distance(normal_of(*face)) < 1e-5, "{normal} {face:?}");
    }
}

#[test]
fn positions_are_doubles_where_floats_are_too_coarse() {
    let geometry =
        Geometry { submeshes: vec![Submesh { material: None, faces: 0..3 }], ..pyramid() };
    let is_double = |places: &[DMat4]| {
        let bytes = ply(&geometry, places, &[], |_| None).unwrap();
        String::from_utf8_lossy(&bytes).contains("property double x")
    };
    let at = |x: f64| DMat4::from_translation(DVec3::new(x, 0.0, 0.0));
    assert!(!is_double(&[at(10.0)]) && is_double(&[at(100.0)]));
    // Together they are as wide as they are far; one by one the second is far.
    assert!(is_double(&[at(0.0), at(1e6)]));
    assert!(is_double(&[DMat4::from_scale(DVec3::splat(1e60))]));
    assert!(!is_double(&[DMat4::from_scale(DVec3::splat(1e-60))]));
    let refused = |places: &[DMat4], expected: &str| {
        let error = ply(&geometry, places, &[], |_| None).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    };
    refused(&[], "these are 0");
    let wide = DMat4::from_scale(DVec3::splat(1.7e308)) * DMat4::from_scale(DVec3::splat(10.0));
    refused(&[wide], "has finite positions in the world");
    refused(&[at(f64::NAN)], "has finite positions in the world");
    let placed = vec![Placed { name: String::new(), geometry: 0, transform: wide }];
    let model = Model { geometries: vec![geometry.clone()], placed, ..Model::default() };
    assert!(obj(&model, "a", |_| None).is_err());
    // A place that is flat leaves no normal.
    let flat = ply(&geometry, &[DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0))], &[], |_| None);
    let normals = read(Ply, flat.unwrap()).unwrap().geometries[0].normals.clone();
    assert!(normals.is_none_or(|rows| rows.rows.as_flattened().iter().all(|x| x.is_finite())));
}

#[test]
fn an_obj_names_the_file_of_an_image_that_has_one_unless_mtl_would_misread_it() {
    let model = model();
    let own = obj(&model, "a", |_| None).unwrap();
    let shared = obj(&model, "a", |_| Some("b-texture.png".to_owned())).unwrap();
    assert!(
        shared.mtl.contains("map_Kd b-texture.png\n") || shared.mtl.contains(" b-texture.png\n")
    );
    assert_eq!(shared.images.len() + 1, own.images.len());
    for name in ["", "-s 1 2 3.png", "-clamp", "my skin.png", "a\nKd 0 0 0", "a#b.png", "a\\b.png"]
    {
        assert_eq!(obj(&model, "a", |_| Some(name.to_owned())).unwrap(), own, "{name:?}");
    }
}
