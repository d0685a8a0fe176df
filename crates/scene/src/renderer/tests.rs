mod lens;
mod maps;

use std::fs;
use std::sync::Arc;

use approx::assert_abs_diff_eq;
use bokashi_core::{Tape, Tensor};
use bokashi_fit::{Parameter, Parameters};
use bokashi_render_ops::TextureBorder;
use glam::{DMat4, DVec3};

use super::Renderer;
use crate::learnables::Values;
use crate::mesh::glb;
use crate::model::{
    Borders, Geometry, Indexed, MaterialFile, MaterialMap, Model, NO_ROW, Placed, Submesh,
};
use crate::picture::{Picture, Samples};
use crate::scene::Scene;
use crate::shapes;

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
    let parameters = pose.into_iter().fold(parameters, |all, next| all.with(next).unwrap());
    let variables = parameters.record(&tape);
    let values = Values { tape: &tape, learnt: Some(&variables) };
    // What is kept while nothing is learnt is none of a pose's.
    for _ in 0..2 {
        renderer.draw_again(&Values { learnt: None, ..values }, 0, 1, false).unwrap();
    }
    let image = |drawn| renderer.image(&values, &drawn, 1).unwrap().value();
    let first = image(renderer.draw(&values, 0, 1, false).unwrap());
    // Drawn once more to be kept, and then of what was kept.
    for step in 0..2 {
        assert_eq!(image(renderer.draw_again(&values, 0, 1, false).unwrap()), first, "{step}");
    }
    first
}

/// What draws a scene without files.
fn renderer_of(text: &str) -> Renderer {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    fs::write(&file, text).unwrap();
    Renderer::new(Arc::new(Scene::load(&file).unwrap())).unwrap()
}

/// The image of the only view of a scene without files, made smaller so many times.
fn draw_text(text: &str, reduce: usize) -> Tensor<f32> {
    let renderer = renderer_of(text);
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let drawn = renderer.draw(&values, 0, reduce, false).unwrap();
    renderer.image(&values, &drawn, reduce).unwrap().value()
}

/// The red of the pixel that sees a point of the plane z = 0.
fn seen(image: &Tensor<f32>, x: f64, y: f64) -> f32 {
    let focal = 32.0 / 22.5_f64.to_radians().tan();
    let shifted = |x: f64| (32.0 + focal * x / 10.0) as usize;
    image.data()[3 * (64 * shifted(-y) + shifted(x))]
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
        materials: vec![
            grey.clone(),
            MaterialFile { normal_map: MaterialMap::new(0, Borders::default()), ..grey },
        ],
        images: vec![map],
        placed: placed.collect(),
        notes: vec![],
    }
}

#[test]
fn normal_maps_turn_with_the_instances_and_mirrors() {
    let bytes = [180, 90, 230];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let shifted = |x: f64, y: f64| DMat4::from_translation(DVec3::new(x, y, 0.0));
    let turn = DMat4::from_rotation_z(0.5 * std::f64::consts::PI);
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let model = walls(
        bytes,
        &[
            (1, shifted(-2.1, 1.1)),
            (1, shifted(0.0, 1.1) * mirror),
            (1, shifted(2.1, 1.1) * turn),
            (0, shifted(0.0, -1.1)),
            (0, shifted(2.1, -1.1) * mirror),
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
    let shifted = |x: f64, y: f64| DMat4::from_translation(DVec3::new(x, y, 0.0));
    let turn = DMat4::from_rotation_z(0.5 * std::f64::consts::PI);
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mut model = walls_with_tangents(
        bytes,
        &[
            (1, shifted(-2.1, 1.1)),
            (1, shifted(0.0, 1.1) * mirror),
            (1, shifted(2.1, 1.1) * turn),
            (0, shifted(0.0, -1.1)),
            (2, shifted(2.1, -1.1)),
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
    let rough_borders = image(&model, LIGHT);
    assert_abs_diff_eq!(seen(&rough_borders, -2.1, 1.1), lit(DVec3::new(y, x, z)), epsilon = 1e-6);
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
    let rendered = |meshes: &str| {
        let learnt = image(&model, &format!("{LIGHT}[learn.vertices]\n{meshes}"));
        seen(&learnt, 0.0, 0.0)
    };
    assert_abs_diff_eq!(rendered(""), lit(DVec3::new(x, y, z)), epsilon = 1e-6);
    assert_abs_diff_eq!(rendered("meshes = []\n"), lit(DVec3::new(-y, x, z)), epsilon = 1e-6);
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

/// The texel among `count` that stands in the place of one.
fn brought_back(texel: f64, count: usize, border: TextureBorder) -> usize {
    let count = count as f64;
    (match border {
        TextureBorder::Wrap => texel.rem_euclid(count),
        TextureBorder::Mirror => {
            let phase = texel.rem_euclid(2.0 * count);
            phase.min(2.0 * count - 1.0 - phase)
        }
        _ => texel.clamp(0.0, count - 1.0),
    }) as usize
}

/// Of a texture with these rows of 0 and 1, what a bilinear sample at (u, v) is, from the definition.
fn bilinear<const N: usize>(rows: &[[u8; N]], [u, v]: [f64; 2], borders: Borders) -> f64 {
    let [x, y] = [u * N as f64 - 0.5, v * rows.len() as f64 - 0.5];
    let mut sum = 0.0;
    for (i, j) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)] {
        let [row, column] = [y.floor() + i, x.floor() + j];
        let weight = (1.0 - (x - column).abs()) * (1.0 - (y - row).abs());
        let texel =
            rows[brought_back(row, rows.len(), borders[1])][brought_back(column, N, borders[0])];
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
                base_color_map: MaterialMap::new(0, borders),
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

#[test]
fn a_blur_shrinks_with_the_image() {
    let scene = |rest: &str| {
        format!(
            "[[meshes]]\nshape = \"cube\"\nmaterial = {{ base_color = [1, 0.5, 0.2] }}\n[[views]]\nname = \"a\"\n\
             [views.camera]\nsize = [96, 96]\nangle = 40\nposition = [2, 3, 5]\n\
             [pipeline]\ntone = \"linear\"\n{rest}"
        )
    };
    let lens = "[pipeline.lens]\naperture = 8\nfocus = 20\n";
    for (rest, bound) in [("blur = 6\n", 1e-3), (lens, 0.01)] {
        let whole = draw_text(&scene(rest), 1);
        for reduce in [2, 3] {
            let small = draw_text(&scene(rest), reduce);
            let side = 96 / reduce;
            // Means over blocks of the whole image.
            let mean = |row: usize, column: usize, k: usize| {
                let block = (0..reduce * reduce)
                    .map(|n| whole[[row * reduce + n / reduce, column * reduce + n % reduce, k]]);
                block.sum::<f32>() / (reduce * reduce) as f32
            };
            let all = (0..side * side * 3)
                .map(|shifted| (shifted / 3 / side, shifted / 3 % side, shifted % 3));
            let off = all.map(|(i, j, k)| (small[[i, j, k]] - mean(i, j, k)).abs());
            let off = off.sum::<f32>() / (side * side * 3) as f32;
            assert!(off < bound, "{rest:?} {reduce}: {off}");
        }
    }
}

#[test]
fn light_of_lamps_and_of_an_environment_adds_up() {
    let scene = "[[meshes]]\nshape = \"sphere\"\nmaterial = { roughness = 0.4, metallic = 0.3 }\n\
        [[views]]\nname = \"a\"\n[views.camera]\nsize = [32, 32]\nangle = 40\nposition = [0, 1, 3]\n\
        [pipeline]\ntone = \"linear\"\n";
    let lamp = "[[lights]]\nkind = \"directional\"\ndirection = [1, 2, 3]\ncolor = [1, 2, 3]\n";
    let sky = "[environment]\ncolor = [0.5, 0.25, 1]\nsize = 8\n";
    let [both, lamp, sky] =
        [format!("{scene}{lamp}{sky}"), format!("{scene}{lamp}"), format!("{scene}{sky}")]
            .map(|text| draw_text(&text, 1));
    let mean = |image: &Tensor<f32>| image.data().iter().sum::<f32>() / image.size() as f32;
    assert!(mean(&lamp) > 0.02 && mean(&sky) > 0.02);
    for (k, both) in both.data().iter().enumerate() {
        assert_abs_diff_eq!(*both, lamp.data()[k] + sky.data()[k], epsilon = 1e-5);
    }
}

#[test]
fn texture_base_colour_and_colours_at_vertices_are_multiplied() {
    // 188 is 0.5029 of the light.
    let image = Picture { width: 1, height: 1, channels: 3, samples: Samples::U8(vec![188; 3]) };
    let texel = 0.502_886_f32;
    for has_image in [false, true] {
        for has_colors in [false, true] {
            let mut model = walls([128, 128, 255], &[(0, DMat4::IDENTITY)]);
            model.images.push(image.clone());
            model.materials[0].base_color_map.image = has_image.then_some(1);
            let wall = &mut model.geometries[0];
            let faces = wall.faces.clone();
            wall.colors = has_colors.then(|| Indexed { rows: vec![[0.25, 0.5, 0.75]; 4], faces });
            let found = self::image(&model, "surface = \"unlit\"\n");
            let of_image = if has_image { texel } else { 1.0 };
            let of_colors = if has_colors { 0.25 } else { 1.0 };
            assert_abs_diff_eq!(seen(&found, 0.0, 0.0), 0.8 * of_image * of_colors, epsilon = 1e-4);
        }
    }
}

/// An image of three by three of these images, as it goes on beyond its edges.
fn continued(image: &Picture, borders: Borders) -> Picture {
    let Samples::U8(samples) = &image.samples else { panic!("bytes") };
    let [width, height] = [3 * image.width, 3 * image.height];
    let pixel = |k: usize| {
        let shifted =
            |k: usize, count: usize, border| brought_back(k as f64 - count as f64, count, border);
        let row = shifted(k / width, image.height, borders[1]);
        let column = shifted(k % width, image.width, borders[0]);
        &samples[3 * (row * image.width + column)..][..3]
    };
    let samples = (0..width * height).flat_map(pixel).copied().collect();
    Picture { width, height, channels: 3, samples: Samples::U8(samples) }
}

#[test]
fn maps_of_normals_and_roughness_go_on_as_their_files_say() {
    use TextureBorder::{Clamp, Mirror, Wrap};
    let map = |bytes: [[u8; 3]; 6]| Picture {
        width: 3,
        height: 2,
        channels: 3,
        samples: Samples::U8(bytes.as_flattened().to_vec()),
    };
    let normals = map([
        [180, 90, 230],
        [100, 128, 250],
        [128, 128, 255],
        [90, 160, 230],
        [128, 60, 220],
        [200, 150, 200],
    ]);
    let roughness =
        map([[0, 255, 0], [0, 90, 200], [0, 120, 0], [0, 70, 255], [0, 200, 30], [0, 100, 100]]);
    let rest = "surface = \"metallic-roughness\"\ntexture_filter = \"bilinear\"\n\
                silhouettes = \"aliased\"\n[[lights]]\nkind = \"directional\"\n\
                direction = [1, 2, 9]\ncolor = [3, 3, 3]\n";
    let drawn = |images: [Picture; 2], [normals, roughness]: [Borders; 2], is_wide: bool| {
        let mut model = walls([0; 3], &[(0, DMat4::IDENTITY)]);
        model.images = images.to_vec();
        model.materials = vec![MaterialFile {
            base_color: [0.8, 0.8, 0.8, 1.0],
            normal_map: MaterialMap::new(0, normals),
            metallic_roughness_map: MaterialMap::new(1, roughness),
            ..MaterialFile::default()
        }];
        model.geometries.truncate(1);
        if is_wide {
            let coordinates = model.geometries[0].coordinates.as_mut().unwrap();
            coordinates.rows.as_flattened_mut().iter_mut().for_each(|x| *x = 3.0 * *x - 1.0);
        }
        image(&model, rest)
    };
    for (normal_borders, rough_borders) in
        [([Clamp, Mirror], [Wrap, Clamp]), ([Mirror, Wrap], [Clamp, Wrap])]
    {
        let found =
            drawn([normals.clone(), roughness.clone()], [normal_borders, rough_borders], true);
        let images = [continued(&normals, normal_borders), continued(&roughness, rough_borders)];
        let expected = drawn(images, [Borders::default(); 2], false);
        let mut lit = 0;
        for (pixel, (found, expected)) in
            found.data().chunks(3).zip(expected.data().chunks(3)).enumerate()
        {
            // At its own edges the image of nine goes on in another way.
            let focal = 32.0 / 22.5_f64.to_radians().tan();
            let [x, y] = [pixel % 64, pixel / 64].map(|k| (k as f64 - 31.5) * 10.0 / focal);
            if x.abs().max(y.abs()) < 0.8 {
                lit += usize::from(found[0] > 0.05);
                assert_abs_diff_eq!(found[0], expected[0], epsilon = 2e-4);
            }
        }
        assert!(lit > 50, "{lit}");
    }
}

/// The walls without a normal map, with normals of their file that lean.
fn leaning_walls(normal: DVec3, placed: &[(usize, DMat4)]) -> Model {
    let mut model = walls([0; 3], placed);
    let wall = &mut model.geometries[0];
    let one = vec![[0; 3]; wall.faces.len()];
    wall.normals = Some(Indexed { rows: vec![normal.as_vec3().to_array()], faces: one });
    model
}

#[test]
fn normals_of_the_file_go_along_with_the_instances_and_mirrors() {
    let lean = DVec3::new(0.48, 0.36, 0.8);
    let shifted = |x: f64, y: f64| DMat4::from_translation(DVec3::new(x, y, 0.0));
    let turn = DMat4::from_rotation_z(0.5 * std::f64::consts::PI);
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let flat = DMat4::from_scale(DVec3::new(1.0, 1.0, 0.5));
    let mut model = leaning_walls(
        lean,
        &[
            (0, shifted(-2.1, 1.1)),
            (0, shifted(0.0, 1.1) * mirror),
            (0, shifted(2.1, 1.1) * turn),
            (0, shifted(-2.1, -1.1) * flat),
            (2, shifted(0.0, -1.1)),
        ],
    );
    // Another wall, whose normals follow from its faces.
    let plain = Geometry { normals: None, ..model.geometries[0].clone() };
    model.geometries.push(plain);
    let expected = [
        (-2.1, 1.1, lean),
        (0.0, 1.1, DVec3::new(-lean.x, lean.y, lean.z)),
        (2.1, 1.1, DVec3::new(-lean.y, lean.x, lean.z)),
        (-2.1, -1.1, DVec3::new(lean.x, lean.y, 2.0 * lean.z)),
        (0.0, -1.1, DVec3::Z),
    ];
    let given = image(&model, LIGHT);
    for (x, y, normal) in expected {
        assert_abs_diff_eq!(seen(&given, x, y), lit(normal), epsilon = 1e-6);
    }
}

#[test]
fn normals_of_the_file_turn_with_a_learnt_pose_and_give_way_where_vertices_are_learnt() {
    let lean = DVec3::new(0.48, 0.36, 0.8);
    let model = leaning_walls(lean, &[(0, DMat4::IDENTITY)]);
    let quarter = [0.0, 0.0, 0.0, 0.0, 0.0, std::f32::consts::FRAC_PI_2];
    let turned = image_with(&model, LIGHT, Some(quarter));
    let expected = lit(DVec3::new(-lean.y, lean.x, lean.z));
    assert_abs_diff_eq!(seen(&turned, 0.0, 0.0), expected, epsilon = 1e-6);
    let learnt = image(&model, &format!("{LIGHT}[learn.vertices]\n"));
    assert_abs_diff_eq!(seen(&learnt, 0.0, 0.0), lit(DVec3::Z), epsilon = 1e-6);
}

#[test]
fn faces_without_normals_stand_beside_faces_with_normals_of_their_file() {
    let mut model = walls([128, 128, 255], &[(0, DMat4::IDENTITY), (0, mirrored_at(2.5))]);
    let tilted = DVec3::new(0.6, 0.0, 0.8);
    let wall = &mut model.geometries[0];
    wall.submeshes = vec![
        Submesh { material: Some(0), faces: 0..1 },
        Submesh { material: Some(0), faces: 1..2 },
    ];
    let rows = vec![tilted.as_vec3().to_array()];
    wall.normals = Some(Indexed { rows, faces: vec![[0; 3], [NO_ROW; 3]] });
    let image = image(&model, LIGHT);
    assert_abs_diff_eq!(seen(&image, -0.5, -0.5), lit(tilted), epsilon = 1e-6);
    assert_abs_diff_eq!(seen(&image, 0.5, 0.5), lit(DVec3::Z), epsilon = 1e-6);
    // In a mirror, the first face is at the right.
    let turned = DVec3::new(-0.6, 0.0, 0.8);
    assert_abs_diff_eq!(seen(&image, 3.0, -0.5), lit(turned), epsilon = 1e-6);
    assert_abs_diff_eq!(seen(&image, 2.0, 0.5), lit(DVec3::Z), epsilon = 1e-6);
}

fn mirrored_at(x: f64) -> DMat4 {
    DMat4::from_translation(DVec3::new(x, 0.0, 0.0)) * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0))
}

#[test]
fn tangents_of_one_material_stay_where_another_has_none() {
    // Along y in the file, and along x by coordinates.
    let bytes = [228, 128, 200];
    let [x, y, z] = bytes.map(|byte| 2.0 * f64::from(byte) / 255.0 - 1.0);
    let mut model = walls(bytes, &[(1, DMat4::IDENTITY)]);
    let wall = &mut model.geometries[1];
    wall.submeshes = vec![
        Submesh { material: Some(1), faces: 0..1 },
        Submesh { material: Some(1), faces: 1..2 },
    ];
    wall.normals = Some(Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: vec![[0; 3]; 2] });
    let rows = vec![[0.0, 1.0, 0.0, 1.0]];
    wall.tangents = Some(Indexed { rows, faces: vec![[0; 3], [NO_ROW; 3]] });
    let image = image(&model, LIGHT);
    // The bitangent is n x t = -x where the tangent is y.
    assert_abs_diff_eq!(seen(&image, -0.5, -0.5), lit(DVec3::new(-y, x, z)), epsilon = 1e-6);
    assert_abs_diff_eq!(seen(&image, 0.5, 0.5), lit(DVec3::new(x, y, z)), epsilon = 1e-6);
}
