use std::fs;
use std::sync::Arc;

use approx::assert_abs_diff_eq;
use bokashi_core::{Tape, Tensor};
use bokashi_fit::{Parameter, Parameters};
use bokashi_render_ops::TextureBorder;
use glam::{DMat4, DVec3};

use super::Renderer;
use crate::mesh::glb;
use crate::model::{Borders, Geometry, Indexed, MaterialFile, Model, NO_ROW, Placed, Submesh};
use crate::picture::{Picture, Samples};
use crate::scene::Scene;
use crate::shapes;
use crate::values::Values;

/// The image of the first view of a scene with this model, tone linear, 64 pixels square, from (0, 0, 10)
/// towards the origin.
fn image(model: &Model, rest: &str) -> Tensor<f32> {
    image_with(model, rest, None)
}

/// [`image`] of a scene whose first object has a learnt pose.
fn image_with(model: &Model, rest: &str, pose: Option<[f32; 6]>) -> Tensor<f32> {
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
    let name = &renderer.scene().objects[0].name;
    let pose = pose.map(|pose| Parameter::new(format!("pose/{name}"), Tensor::from(pose)));
    let parameters = Parameters::new();
    let parameters = pose.into_iter().fold(parameters, |all, own| all.with(own).unwrap());
    let variables = parameters.record(&tape);
    let values = Values { tape: &tape, learnt: Some(&variables) };
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

/// The walls, with tangents of their file along y, where coordinates have them along x.
fn walls_with_tangents(bytes: [u8; 3], placed: &[(usize, DMat4)]) -> Model {
    let mut model = walls(bytes, placed);
    let wall = &mut model.geometries[1];
    let one = vec![[0; 3]; wall.faces.len()];
    wall.normals = Some(Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: one.clone() });
    wall.tangents = Some(Indexed { rows: vec![[0.0, 1.0, 0.0, 1.0]], faces: one });
    model
}

#[test]
fn tangents_of_the_file_turn_with_the_instances_and_mirrors() {
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let at = |x: f64, y: f64| DMat4::from_translation(DVec3::new(x, y, 0.0));
    let turn = DMat4::from_rotation_z(0.5 * std::f64::consts::PI);
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mut model = walls_with_tangents(
        bytes,
        &[
            (1, at(-2.1, 1.1)),
            (1, at(0.0, 1.1) * mirror),
            (1, at(2.1, 1.1) * turn),
            (0, at(0.0, -1.1)),
            (2, at(2.1, -1.1)),
        ],
    );
    // Another wall with a map, whose tangents follow from its coordinates.
    let plain = Geometry { tangents: None, ..model.geometries[1].clone() };
    model.geometries.push(plain);
    let expected = [
        // The tangent is y, and the bitangent -x.
        (-2.1, 1.1, DVec3::new(-y, x, z)),
        (0.0, 1.1, DVec3::new(y, x, z)),
        (2.1, 1.1, DVec3::new(-x, -y, z)),
        (0.0, -1.1, DVec3::Z),
        (2.1, -1.1, DVec3::new(x, y, z)),
    ];
    let given = image(&model, LIGHT);
    for (x, y, normal) in expected {
        assert_abs_diff_eq!(seen(&given, x, y), lit(normal), epsilon = 1e-6);
    }
    // A handedness of -1 is the other bitangent.
    model.geometries[1].tangents.as_mut().unwrap().rows[0][3] = -1.0;
    let other = image(&model, LIGHT);
    assert_abs_diff_eq!(seen(&other, -2.1, 1.1), lit(DVec3::new(y, x, z)), epsilon = 1e-6);
}

#[test]
fn tangents_of_the_file_turn_with_a_learnt_pose() {
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let model = walls_with_tangents(bytes, &[(1, DMat4::IDENTITY)]);
    let quarter = [0.0, 0.0, 0.0, 0.0, 0.0, std::f32::consts::FRAC_PI_2];
    let turned = image_with(&model, LIGHT, Some(quarter));
    assert_abs_diff_eq!(seen(&turned, 0.0, 0.0), lit(DVec3::new(-x, -y, z)), epsilon = 1e-6);
}

#[test]
fn where_vertices_are_learnt_tangents_follow_from_coordinates() {
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let model = walls_with_tangents(bytes, &[(1, DMat4::IDENTITY)]);
    let of = |meshes: &str| {
        let learnt = image(&model, &format!("{LIGHT}[learn.vertices]\n{meshes}"));
        seen(&learnt, 0.0, 0.0)
    };
    assert_abs_diff_eq!(of(""), lit(DVec3::new(x, y, z)), epsilon = 1e-6);
    assert_abs_diff_eq!(of("meshes = []\n"), lit(DVec3::new(-y, x, z)), epsilon = 1e-6);
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

/// Of a texture with these rows of 0 and 1, what a bilinear sample at (u, v) is, from the definition.
fn bilinear<const N: usize>(rows: &[[u8; N]], [u, v]: [f64; 2], borders: Borders) -> f64 {
    let at = |at: f64, count: usize, border: TextureBorder| {
        let count = count as f64;
        (match border {
            TextureBorder::Wrap => at.rem_euclid(count),
            TextureBorder::Mirror => {
                let phase = at.rem_euclid(2.0 * count);
                phase.min(2.0 * count - 1.0 - phase)
            }
            _ => at.clamp(0.0, count - 1.0),
        }) as usize
    };
    let [x, y] = [u * N as f64 - 0.5, v * rows.len() as f64 - 0.5];
    let mut sum = 0.0;
    for (i, j) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)] {
        let [row, column] = [y.floor() + i, x.floor() + j];
        let weight = (1.0 - (x - column).abs()) * (1.0 - (y - row).abs());
        let texel = rows[at(row, rows.len(), borders[1])][at(column, N, borders[0])];
        sum += weight * f64::from(texel);
    }
    sum
}

#[test]
fn textures_go_on_beyond_their_edges_as_their_files_say() {
    use TextureBorder::{Clamp, Mirror, Wrap};
    let rows = [[1, 0, 0], [0, 0, 1]];
    let samples = Samples::U8(rows.as_flattened().iter().flat_map(|&x| [255 * x; 3]).collect());
    let texture = Picture { width: 3, height: 2, channels: 3, samples };
    // Coordinates that go on, and some that stay inside: there half a texel at each edge sees beyond it.
    for (scale, shift) in [(3.0, -1.0), (1.0, 0.0)] {
        for borders in [[Clamp, Mirror], [Mirror, Wrap], [Wrap, Clamp], [Clamp; 2]] {
            let mut model = walls([0; 3], &[(0, DMat4::IDENTITY)]);
            model.images = vec![texture.clone()];
            model.materials = vec![MaterialFile {
                base_color_image: Some(0),
                base_color_borders: borders,
                ..MaterialFile::default()
            }];
            model.geometries.truncate(1);
            let coordinates = model.geometries[0].coordinates.as_mut().unwrap();
            for number in coordinates.rows.as_flattened_mut() {
                *number = scale * *number + shift;
            }
            // Samples at the middles of pixels.
            let image = image(
                &model,
                "surface = \"unlit\"\ntexture_filter = \"bilinear\"\nsilhouettes = \"aliased\"\n",
            );
            let focal = 32.0 / 22.5_f64.to_radians().tan();
            for (pixel, found) in image.data().chunks(3).enumerate() {
                let [x, y] = [pixel % 64, pixel / 64].map(|k| (k as f64 - 31.5) * 10.0 / focal);
                if x.abs().max(y.abs()) < 1.0 {
                    let place =
                        [x, y].map(|x| f64::from(scale) * 0.5 * (x + 1.0) + f64::from(shift));
                    let expected = bilinear(&rows, place, borders) as f32;
                    assert_abs_diff_eq!(found[0], expected, epsilon = 1e-4);
                }
            }
        }
    }
}
