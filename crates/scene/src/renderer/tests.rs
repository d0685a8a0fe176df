use std::fs;
use std::sync::Arc;

use approx::assert_abs_diff_eq;
use bokashi_core::{Tape, Tensor};
use glam::{DMat4, DVec3};

use super::Renderer;
use crate::mesh::glb;
use crate::model::{Geometry, Indexed, MaterialFile, Model, NO_ROW, Placed, Submesh};
use crate::picture::{Picture, Samples};
use crate::scene::Scene;
use crate::shapes;
use crate::values::Values;

/// The image of the first view of a scene with this model, tone linear, 64 pixels square, from (0, 0, 10)
/// towards the origin.
fn image(model: &Model, rest: &str) -> Tensor<f32> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("model.glb"), glb(model).unwrap()).unwrap();
    let text = format!(
        "[[meshes]]\nfile = \"model.glb\"\n[[views]]\nname = \"a\"\n[views.camera]\nsize = [64, 64]\n\
         angle = 45\nposition = [0, 0, 10]\n[pipeline]\ntone = \"linear\"\n{rest}"
    );
    let file = folder.path().join("scene.toml");
    fs::write(&file, text).unwrap();
    let renderer = Renderer::new(Arc::new(Scene::load(&file).unwrap())).unwrap();
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let image = |drawn| renderer.image(&values, &drawn, 1).unwrap().value();
    let first = image(renderer.draw(&values, 0, 1, false).unwrap());
    // Drawn once more to be kept, and then of what was kept.
    for step in 0..2 {
        assert_eq!(image(renderer.draw_again(&values, 0, 1, false).unwrap()), first, "{step}");
    }
    first
}

/// The red of the pixel that sees a point of the plane z = 0.
fn seen(image: &Tensor<f32>, x: f64, y: f64) -> f32 {
    let focal = 32.0 / 22.5_f64.to_radians().tan();
    let at = |x: f64| (32.0 + focal * x / 10.0) as usize;
    image.data()[3 * (64 * at(-y) + at(x))]
}

const LIGHT: &str = "surface = \"lambert\"\ncull = \"back\"\n[[lights]]\nkind = \"directional\"\n\
                     direction = [1, 2, 3]\ncolor = [1, 1, 1]\n";

/// What a wall with this normal sends to the eye under [`LIGHT`].
fn lit(normal: DVec3) -> f32 {
    let cosine = normal.normalize().dot(DVec3::new(1.0, 2.0, 3.0).normalize());
    (0.8 * cosine / std::f64::consts::PI) as f32
}

/// The geometry with all of its faces of one material.
fn of_material(geometry: Geometry, material: usize) -> Geometry {
    let faces = 0..geometry.faces.len();
    Geometry { submeshes: vec![Submesh { material: Some(material), faces }], ..geometry }
}

/// A model of these placed geometries, each of them a wall of the grey 0.8. The second geometry has a normal map
/// that says the same everywhere.
fn walls(bytes: [u8; 3], placed: &[(usize, DMat4)]) -> Model {
    let grey = MaterialFile { base_color: [0.8, 0.8, 0.8, 1.0], ..MaterialFile::default() };
    let map = Picture { width: 1, height: 1, channels: 3, samples: Samples::U8(bytes.to_vec()) };
    let wall = |material| of_material(shapes::plane(2), material);
    let placed = placed.iter().map(|&(geometry, transform)| {
        let name = String::new();
        Placed { name, geometry, transform }
    });
    Model {
        geometries: vec![wall(0), wall(1)],
        materials: vec![grey.clone(), MaterialFile { normal_image: Some(0), ..grey }],
        images: vec![map],
        placed: placed.collect(),
        notes: vec![],
    }
}

#[test]
fn normal_maps_turn_with_the_instances_and_mirrors() {
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let at = |x: f64, y: f64| DMat4::from_translation(DVec3::new(x, y, 0.0));
    let turn = DMat4::from_rotation_z(0.5 * std::f64::consts::PI);
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let model = walls(
        bytes,
        &[
            (1, at(-2.1, 1.1)),
            (1, at(0.0, 1.1) * mirror),
            (1, at(2.1, 1.1) * turn),
            (0, at(0.0, -1.1)),
            (0, at(2.1, -1.1) * mirror),
        ],
    );
    let image = image(&model, LIGHT);
    let expected = [
        (-2.1, 1.1, DVec3::new(x, y, z)),
        (0.0, 1.1, DVec3::new(-x, y, z)),
        (2.1, 1.1, DVec3::new(-y, x, z)),
        (0.0, -1.1, DVec3::Z),
        (2.1, -1.1, DVec3::Z),
    ];
    for (x, y, normal) in expected {
        assert_abs_diff_eq!(seen(&image, x, y), lit(normal), epsilon = 1e-6);
    }
    assert_eq!(seen(&image, -2.1, -1.1), 0.0, "nothing stands there");
}

#[test]
fn unlit_surfaces_show_their_colour_under_a_normal_map() {
    let model = walls([180, 90, 230], &[(1, DMat4::IDENTITY)]);
    let unlit = image(&model, "surface = \"unlit\"\n");
    assert_abs_diff_eq!(seen(&unlit, 0.0, 0.0), 0.8, epsilon = 1e-6);
}

#[test]
fn a_mirrored_mesh_shows_its_front() {
    // Faces of a ball that is turned inside out would be dark on the side of the light.
    let ball = of_material(shapes::sphere(320), 0);
    let mut model = walls([0; 3], &[(0, DMat4::from_scale(DVec3::new(1.0, 1.0, -2.0)))]);
    model.geometries[0] = ball;
    let mirrored = image(&model, LIGHT);
    model.placed[0].transform = DMat4::from_scale(DVec3::new(1.0, 1.0, 2.0));
    let plain = image(&model, LIGHT);
    assert_abs_diff_eq!(seen(&mirrored, 0.0, 0.0), seen(&plain, 0.0, 0.0), epsilon = 2e-3);
    assert!(seen(&plain, 0.0, 0.0) > 0.1);
}

#[test]
fn each_material_of_a_mesh_is_seen_on_its_own_faces() {
    // The face at the lower left has the normal map, the other one a colour at its corners alone.
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let mut model = walls(bytes, &[(0, DMat4::IDENTITY)]);
    let wall = &mut model.geometries[0];
    wall.submeshes =
        vec![Submesh { material: Some(1), faces: 0..1 }, Submesh { material: None, faces: 1..2 }];
    wall.coordinates.as_mut().unwrap().faces[1] = [NO_ROW; 3];
    wall.colors = Some(Indexed { rows: vec![[0.4; 3]], faces: vec![[NO_ROW; 3], [0; 3]] });
    let image = image(&model, LIGHT);
    assert_abs_diff_eq!(seen(&image, -0.5, -0.5), lit(DVec3::new(x, y, z)), epsilon = 1e-6);
    // A material that the file does not have is rough and no metal.
    assert_abs_diff_eq!(seen(&image, 0.5, 0.5), 0.5 * lit(DVec3::Z), epsilon = 1e-6);
}
