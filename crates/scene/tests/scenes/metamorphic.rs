//! A scene in another unit, of smaller images, with its views in another order or its meshes as instances learns
//! the same.

use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_scene::{Location, Picture, Scene, SceneFit};

/// What a fit did: the loss of each step, and what it learnt, by name.
struct Learnt {
    losses: Vec<f64>,
    parameters: Vec<(String, Tensor<f32>)>,
}

impl Learnt {
    fn new(scene: Scene) -> Self {
        let mut fit = SceneFit::new(scene).unwrap();
        let losses = std::iter::from_fn(|| fit.step().unwrap()).map(|step| step.loss).collect();
        let values = fit
            .parameters()
            .iter()
            .map(|parameter| (parameter.name().to_owned(), parameter.value()));
        Self { losses, parameters: values.collect() }
    }

    fn get(&self, name: &str) -> &Tensor<f32> {
        let found = self.parameters.iter().find(|(values, _)| values == name);
        &found.unwrap_or_else(|| panic!("{name} is learnt")).1
    }
}

/// How far two lists of numbers are from each other, as a share of how far the one is from its start.
fn apart(found: &[f64], expected: &[f64], start: &[f64]) -> f64 {
    assert!(found.len() == expected.len() && expected.len() == start.len());
    let distance =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let moved = distance(expected, start);
    assert!(moved > 0.0, "something is learnt");
    distance(found, expected) / moved
}

fn numbers(tensor: &Tensor<f32>) -> Vec<f64> {
    tensor.data().iter().map(|&x| x.into()).collect()
}

/// A picture of soft colours whose numbers are multiples of 1/64: means of 16 of them are exact. Made smaller
/// so many times.
fn picture(file: &Path, view: usize, pixels: usize, reduce: usize) {
    let number = |x: usize, y: usize, c: usize| {
        let [x, y] = [x, y].map(|coordinate| (coordinate as f64 + 0.5) / pixels as f64 - 0.5);
        let inside = 1.0 - ((x.hypot(y) - 0.25 - 0.02 * view as f64) / 0.1).clamp(0.0, 1.0);
        (64.0 * inside * (0.4 + 0.2 * ((5 + c) as f64 * x + c as f64).sin())).round() as f32 / 64.0
    };
    let side = pixels / reduce;
    let image = Tensor::from_flat_fn([side, side, 3], |k| {
        let [x, y, c] = [k / 3 % side, k / 3 / side, k % 3];
        let all = (0..reduce * reduce)
            .map(|k| number(reduce * x + k % reduce, reduce * y + k / reduce, c));
        all.sum::<f32>() / (reduce * reduce) as f32
    });
    let location = Location::new(file);
    fs::write(file, Picture::from_numbers(&image).unwrap().encode_exr(&location).unwrap()).unwrap();
}

/// Where the cameras stand, in units of the scene.
const PLACES: [[f64; 3]; 4] =
    [[0.0, 1.0, 4.0], [4.0, 0.5, 0.5], [-3.0, 1.5, 2.0], [0.5, -2.0, -3.5]];

/// Pixels along a side.
const PIXELS: usize = 32;

/// Entries of views in this order, in a unit that is `k` times smaller, with images that are made smaller.
fn views(folder: &Path, order: [usize; 4], k: f64, reduce: usize) -> String {
    let entry = |view: usize| {
        let file = format!("{view}-{reduce}.exr");
        picture(&folder.join(&file), view, PIXELS, reduce);
        let [x, y, z] = PLACES[view].map(|coordinate| coordinate * k);
        format!(
            "[[views]]\nname = \"{view}\"\nimage = {file:?}\n\
             camera = {{ position = [{x:?}, {y:?}, {z:?}], angle = 40.0 }}\n"
        )
    };
    order.map(entry).concat()
}

fn load(folder: &Path, text: &str) -> Scene {
    fs::write(folder.join("scene.toml"), text).unwrap();
    Scene::load(folder.join("scene.toml")).unwrap()
}

/// Corners and faces of a lopsided octahedron, in a unit that is `k` times smaller.
fn octahedron(folder: &Path, k: f64) {
    let mut text = String::new();
    for corner in [
        [1.0, 0.0, 0.125],
        [-1.0, 0.25, 0.0],
        [0.0, 0.75, 0.0],
        [0.125, -0.75, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.125, -1.0],
    ] {
        let [x, y, z] = corner.map(|coordinate: f64| coordinate * k);
        text += &format!("v {x:?} {y:?} {z:?}\n");
    }
    for face in ["1 3 5", "3 2 5", "2 4 5", "4 1 5", "3 1 6", "2 3 6", "4 2 6", "1 4 6"] {
        text += &format!("f {face}\n");
    }
    fs::write(folder.join("octahedron.obj"), text).unwrap();
}

/// A scene in a unit that is `k` times smaller.
fn in_unit(folder: &Path, k: f64, smoothing: &str) -> Scene {
    octahedron(folder, k);
    let number = |x: f64| format!("{:?}", x * k);
    let light = format!("{:?}", 20.0 * k * k);
    let text = format!(
        "[[meshes]]\nfile = \"octahedron.obj\"\n\
         place = {{ translation = [{}, 0, 0], rotation = [0, 0.1, 0, 1] }}\n\
         [[lights]]\nkind = \"point\"\nposition = [{}, {}, {}]\ncolor = [{light}, {light}, {light}]\n\
         [pipeline]\nsurface = \"lambert\"\ntone = \"linear\"\n\
         lens = {{ aperture = 1.0, focus = {} }}\n\
         [learn.vertices]\n{smoothing}rigid = 0.5\nlaplacian = 0.25\nedge_length = 0.125\nnormals = 0.25\n\
         [learn.pose]\n[learn.cameras]\n[learn.light_places]\n[learn.lens]\n\
         [stop]\nsteps = 12\nviews_per_step = 4\n",
        number(0.125),
        number(2.0),
        number(3.0),
        number(4.0),
        number(3.5),
    );
    load(folder, &(text + &views(folder, [0, 1, 2, 3], k, 1)))
}

#[test]
fn a_scene_in_another_unit_learns_the_same() {
    let directory = tempfile::tempdir().unwrap();
    for smoothing in ["", "smoothing = 4.0\n"] {
        let scene = in_unit(directory.path(), 1.0, smoothing);
        let starts = [numbers(&scene.objects[0].positions), vec![2.0, 3.0, 4.0]];
        let expected = Learnt::new(scene);
        // Powers of two: numbers of all lengths have other exponents and the same digits.
        for k in [4.0, 0.125] {
            let found = Learnt::new(in_unit(directory.path(), k, smoothing));
            assert_eq!(found.losses[0], expected.losses[0], "to the bit, in 1/{k} of the unit");
            let back = |name: &str| -> Vec<f64> {
                numbers(found.get(name)).iter().map(|x| x / k).collect()
            };
            // Adam adds 1e-8 to the size of a gradient, which has the unit's inverse.
            let lengths = ["vertices/octahedron", "light_place/0"].into_iter().zip(&starts);
            for (name, start) in lengths {
                let apart = apart(&back(name), &numbers(expected.get(name)), start);
                assert!(apart < 2e-3, "{name}: {apart} in 1/{k} of the unit");
            }
            for name in ["pose/octahedron", "cameras", "aperture"] {
                let values = numbers(expected.get(name));
                let start = vec![if name == "aperture" { 1.0 } else { 0.0 }; values.len()];
                let apart = apart(&numbers(found.get(name)), &values, &start);
                assert!(apart < 2e-3, "{name}: {apart} in 1/{k} of the unit");
            }
            for (found, expected) in found.losses.iter().zip(&expected.losses) {
                assert!((found / expected - 1.0).abs() < 1e-4, "{found}, {expected}");
            }
        }
    }
}

#[test]
fn a_stage_of_smaller_images_learns_as_a_scene_of_smaller_images() {
    let directory = tempfile::tempdir().unwrap();
    octahedron(directory.path(), 1.0);
    let scene = |stage: usize, file: usize| {
        // Blurs are in pixels.
        let text = format!(
            "[[meshes]]\nfile = \"octahedron.obj\"\n\
             [pipeline]\ntone = \"linear\"\nblur = {:?}\nlens = {{ aperture = {:?}, focus = 3.5 }}\n\
             [learn.vertices]\n[learn.texture]\n[learn.cameras]\n\
             [[stages]]\nsteps = 6\nviews_per_step = 4\nreduce = {stage}\n",
            4.0 / file as f64,
            2.0 / file as f64,
        );
        load(directory.path(), &(text + &views(directory.path(), [0, 1, 2, 3], 1.0, file)))
    };
    for reduce in [2, 4] {
        let (found, expected) = (Learnt::new(scene(reduce, 1)), Learnt::new(scene(1, reduce)));
        for (found, expected) in found.losses.iter().zip(&expected.losses) {
            assert!((found / expected - 1.0).abs() < 1e-5, "{reduce}: {found}, {expected}");
        }
        let start = numbers(&scene(1, 1).objects[0].positions);
        let name = "vertices/octahedron";
        let apart = apart(&numbers(found.get(name)), &numbers(expected.get(name)), &start);
        assert!(apart < 1e-3, "{reduce}: {apart}");
    }
}

#[test]
fn views_in_another_order_learn_the_same() {
    let directory = tempfile::tempdir().unwrap();
    octahedron(directory.path(), 1.0);
    let scene = |order: [usize; 4]| {
        let text = "[[meshes]]\nfile = \"octahedron.obj\"\n[pipeline]\ntone = \"linear\"\n\
             [learn.vertices]\n[learn.cameras]\n[learn.texture]\n\
             [stop]\nsteps = 10\nviews_per_step = 3\n";
        // One of them is held out, and the others are seen in each step: draws of steps are by place in the list.
        let held_out = "name = \"2\"\n";
        let views = views(directory.path(), order, 1.0, 1)
            .replace(held_out, &format!("{held_out}held_out = true\n"));
        load(directory.path(), &(text.to_owned() + &views))
    };
    let expected = Learnt::new(scene([0, 1, 2, 3]));
    let still: Vec<_> = numbers(expected.get("cameras"))[12..18].to_vec();
    assert_eq!(still, [0.0; 6], "a camera that is held out");
    for order in [[3, 1, 0, 2], [2, 3, 1, 0]] {
        let found = Learnt::new(scene(order));
        for (found, expected) in found.losses.iter().zip(&expected.losses) {
            assert!((found / expected - 1.0).abs() < 1e-5, "{found}, {expected}");
        }
        let cameras = numbers(found.get("cameras"));
        let mut sorted = vec![0.0; 24];
        for (coordinate, view) in order.into_iter().enumerate() {
            sorted[6 * view..6 * view + 6]
                .copy_from_slice(&cameras[6 * coordinate..6 * coordinate + 6]);
        }
        let apart = apart(&sorted, &numbers(expected.get("cameras")), &[0.0; 24]);
        assert!(apart < 1e-3, "{order:?}: {apart}");
    }
}

#[test]
fn instances_learn_as_meshes_of_their_own() {
    let directory = tempfile::tempdir().unwrap();
    octahedron(directory.path(), 1.0);
    let scene = |meshes: &str| {
        let text = "[pipeline]\nsurface = \"lambert\"\ntone = \"linear\"\n\
             [[lights]]\nkind = \"directional\"\ndirection = [1, 2, 1]\ncolor = [2, 2, 2]\n\
             [learn.cameras]\n[learn.intrinsics]\n[learn.lights]\n[learn.light_places]\n[learn.exposure]\n\
             [stop]\nsteps = 10\nviews_per_step = 4\n";
        load(
            directory.path(),
            &(meshes.to_owned() + text + &views(directory.path(), [0, 1, 2, 3], 1.0, 1)),
        )
    };
    let file = "[[meshes]]\nfile = \"octahedron.obj\"\n";
    let whole = "place = { scale = 0.5, translation = [0.5, 0, 0] }\n";
    let second = "place = { scale = 0.25, translation = [-0.5, 0.25, 0] }\n";
    let instances = format!(
        "{file}{whole}instances = [{{ scale = 1.0 }}, {{ scale = 0.5, translation = [-2, 0.5, 0] }}]\n"
    );
    // The mesh stands where its `place` leads, and again at each of `instances`.
    let meshes = format!(
        "{file}{whole}name = \"a\"\n{file}{whole}name = \"b\"\n{file}{second}name = \"c\"\n"
    );
    let (found, expected) = (Learnt::new(scene(&instances)), Learnt::new(scene(&meshes)));
    for (found, expected) in found.losses.iter().zip(&expected.losses) {
        assert!((found / expected - 1.0).abs() < 1e-5, "{found}, {expected}");
    }
    for name in ["cameras", "intrinsics", "light/0", "light_place/0", "exposure"] {
        let values = numbers(expected.get(name));
        let start = match name {
            "light/0" => vec![2.0; 3],
            "light_place/0" => [1.0, 2.0, 1.0].map(|x: f64| x / 6.0_f64.sqrt()).to_vec(),
            _ => vec![0.0; values.len()],
        };
        let apart = apart(&numbers(found.get(name)), &values, &start);
        assert!(apart < 1e-3, "{name}: {apart}");
    }
}

#[test]
fn each_so_many_th_view_of_a_file_is_held_out_the_first_among_them() {
    let directory = tempfile::tempdir().unwrap();
    let frame = |view: usize| {
        picture(&directory.path().join(format!("{view}.exr")), view % 4, 8, 1);
        format!(
            "{{\"file_path\": \"{view}.exr\", \
             \"transform_matrix\": [[1,0,0,{view}],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}}"
        )
    };
    let frames: Vec<_> = (0..7).map(frame).collect();
    let text = format!(
        "{{\"camera_angle_x\": 0.7, \"w\": 8, \"h\": 8, \"frames\": [{}]}}",
        frames.join(",")
    );
    fs::write(directory.path().join("transforms.json"), text).unwrap();
    for (every, expected) in [(1, vec![0, 1, 2, 3, 4, 5, 6]), (3, vec![0, 3, 6]), (8, vec![0])] {
        let text =
            format!("[cameras]\ntransforms = \"transforms.json\"\nheld_out_every = {every}\n");
        let scene = load(directory.path(), &text);
        let held_out = scene.views.iter().filter(|view| view.held_out);
        let names: Vec<_> = held_out.map(|view| view.name.clone()).collect();
        assert_eq!(names, expected.iter().map(ToString::to_string).collect::<Vec<_>>());
    }
}
