//! Fits that start from what masks allow, and whose meshes get other vertices.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_mesh::{Connectivity, self_intersections, signed_volume};
use bokashi_render_ops::Mesh;
use bokashi_scene::{Attribute, Location, Object, Picture, Samples, Scene, SceneFit};
use glam::DVec3;

use crate::fits::{ANGLE, views, views_from};
use crate::fixtures::{check_interruptions, load};
use crate::rays::{Ball, Eye, photograph};

/// Balls that overlap in a ring around z.
fn ring() -> Vec<Ball> {
    let center = |k: usize| {
        let angle = TAU * k as f64 / 16.0;
        DVec3::new(0.75 * angle.cos(), 0.75 * angle.sin(), 0.0)
    };
    (0..16).map(|k| Ball::motley(center(k), 0.3)).collect()
}

/// The angle of lines through a hole with its axis.
const TILT: f64 = 0.3;

const HULL: &str = "[[meshes]]\nshape = \"hull\"\nfaces = 1500\n\
                    material = { vertex_colors = true }\n";

/// Photographs of the ring in a folder, of which the last of `every` is held out, and their entries.
pub(crate) fn photographs(folder: &Path, count: usize, every: usize, pixels: usize) -> String {
    views(folder, &ring(), count, every, pixels)
}

fn connectivity(object: &Object) -> Connectivity {
    Connectivity::new(&object.mesh)
}

#[test]
fn a_hull_of_a_ring_is_closed_and_has_a_hole() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 24, 24, 96);
    let scene = load(folder.path(), &(HULL.to_owned() + &text));
    let object = &scene.objects[0];
    let all = connectivity(object);
    assert!(all.is_closed() && all.is_manifold());
    assert_eq!((all.parts(), all.euler_characteristic()), (1, 0));
    assert!(self_intersections(&object.positions, &object.mesh).unwrap().is_empty());
    let count = object.mesh.faces().len();
    assert!((1100..2000).contains(&count), "{count} faces");
    // Nothing of the ring is cut off by more than a pixel, and fronts are outside.
    let volume = signed_volume(&object.positions, &object.mesh).unwrap();
    assert!(volume > 0.0, "{volume}");
    let balls = ring();
    for point in object.positions.data().chunks_exact(3) {
        let point = DVec3::new(point[0].into(), point[1].into(), point[2].into());
        let outside = balls.iter().map(|ball| point.distance(ball.center) - ball.radius);
        let outside = outside.fold(f64::INFINITY, f64::min);
        assert!((-0.04..0.15).contains(&outside), "{outside} at {point}");
    }
}

/// Between the lines there is something, for all that silhouettes say: with it the Euler characteristic is -2.
#[test]
fn a_hole_that_is_seen_through_along_crossing_lines_is_one_hole() {
    let folder = tempfile::tempdir().unwrap();
    let tube = [-0.6, -0.2, 0.2, 0.6].into_iter().flat_map(|z| {
        ring().into_iter().map(move |ball| Ball::motley(ball.center + z * DVec3::Z, 0.3))
    });
    let tube: Vec<_> = tube.collect();
    let beside = (0..12).map(|k| {
        let angle = TAU * k as f64 / 12.0;
        DVec3::new(angle.cos(), angle.sin(), 0.3 * (3.0 * angle).sin()).normalize()
    });
    let through = [-TILT, TILT].map(|tilt: f64| DVec3::new(tilt.sin(), 0.0, tilt.cos()));
    let text = views_from(folder.path(), &tube, beside.chain(through), 99, 64);
    let scene = load(folder.path(), &(HULL.to_owned() + &text));
    let all = connectivity(&scene.objects[0]);
    assert!(all.is_closed() && all.is_manifold());
    assert_eq!((all.parts(), all.euler_characteristic()), (1, 0));
}

#[test]
fn no_wrong_mask_and_no_other_camera_carves_a_hull_away() {
    const PIXELS: usize = 48;
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 16, 16, PIXELS);
    let volume = |scene: &Scene| {
        let object = &scene.objects[0];
        signed_volume(&object.positions, &object.mesh).unwrap()
    };
    let truth = volume(&load(folder.path(), &(HULL.to_owned() + &text)));
    // Nothing is in the mask of one view, and all of it in that of another.
    let mask = |name: &str, share: u8| {
        let samples =
            Samples::U8((0..PIXELS * PIXELS).map(|k| if k == 0 { 255 } else { share }).collect());
        let picture = Picture { width: PIXELS, height: PIXELS, channels: 1, samples };
        let png = picture.encode_png(&Location::new(name)).unwrap();
        fs::write(folder.path().join(name), png).unwrap();
    };
    mask("empty.png", 0);
    mask("full.png", 255);
    let wrong =
        text.replace("image = \"images/3.png\"", "image = \"images/3.png\"\nmask = \"empty.png\"");
    let wrong =
        wrong.replace("image = \"images/7.png\"", "image = \"images/7.png\"\nmask = \"full.png\"");
    let found = volume(&load(folder.path(), &(HULL.to_owned() + &wrong)));
    assert!((0.9..1.3).contains(&(found / truth)), "{found} for {truth}");
    // A camera that is close sees a part of the object, and says nothing of the rest.
    let towards = DVec3::new(0.6, 0.5, 0.9).normalize();
    let eye = Eye { position: 2.0 * towards, angle: ANGLE, pixels: PIXELS };
    fs::write(folder.path().join("close.png"), photograph(&ring(), &eye)).unwrap();
    let [x, y, z] = eye.position.to_array();
    let close = format!(
        "{text}[[views]]\nimage = \"close.png\"\ncamera = {{ position = [{x}, {y}, {z}], angle = {ANGLE:?} }}\n"
    );
    let found = volume(&load(folder.path(), &(HULL.to_owned() + &close)));
    assert!((0.9..1.05).contains(&(found / truth)), "{found} for {truth}");
    // One that looks elsewhere says nothing.
    let aside = |text: &str, image: &str, rest: &str| {
        let view = text.find(image).unwrap();
        let end = view + text[view..].find(", angle").unwrap();
        format!("{}{rest}{}", &text[..end], &text[end..])
    };
    let away = aside(&text, "images/5.png", ", target = [100, 100, 100]");
    let found = volume(&load(folder.path(), &(HULL.to_owned() + &away)));
    assert!((0.9..1.3).contains(&(found / truth)), "{found} for {truth}");
    // Who asks that all agree is told that they do not.
    let all = HULL.replace("faces = 1500", "agreement = 1");
    fs::write(folder.path().join("scene.toml"), all + &wrong).unwrap();
    let error = Scene::load(folder.path().join("scene.toml")).unwrap_err().to_string();
    assert!(
        error.ends_with(
            "a hull needs a place that is inside the masks of 1 of all views, and there is none"
        ),
        "{error}"
    );
}

/// Numbers of `f32` tell places a few centimetres apart there.
#[test]
fn a_hull_far_from_the_origin_is_the_hull_there() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 16, 16, 48);
    let offset = DVec3::new(500_000.0, 4_649_776.0, 100.0);
    let far = |line: &str| {
        let Some((head, rest)) = line.split_once("position = [") else { return line.to_owned() };
        let (place, tail) = rest.split_once(']').unwrap();
        let place: Vec<f64> = place.split(',').map(|x| x.trim().parse().unwrap()).collect();
        let [place, target] = [offset + DVec3::from_slice(&place), offset].map(|p| p.to_array());
        format!("{head}position = {place:?}, target = {target:?}{tail}")
    };
    let moved = text.lines().map(far).collect::<Vec<_>>().join("\n");
    let scenes = [text, moved].map(|text| load(folder.path(), &(HULL.to_owned() + &text)));
    let [near, far] = scenes.each_ref().map(|scene| &scene.objects[0]);
    assert_eq!((near.offset, far.offset.distance(offset) < 2.0), (DVec3::ZERO, true));
    let volume = |object: &Object| signed_volume(&object.positions, &object.mesh).unwrap();
    assert!((volume(far) / volume(near) - 1.0).abs() < 1e-3, "{} {}", volume(far), volume(near));
    let [middle, moved] = scenes.each_ref().map(|scene| scene.ball().0);
    assert!((moved - offset).distance(middle) < 0.01, "{middle} {moved}");
}

#[test]
fn what_makes_no_hull_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 4, 5, 16);
    let refused = |text: &str, rule: &str| {
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        let error = Scene::load(folder.path().join("scene.toml")).unwrap_err().to_string();
        assert!(error.contains(rule), "{error}");
    };
    let hull = HULL.to_owned();
    refused(&hull, "of 0 that are learnt from none has one");
    refused(
        &(hull.clone() + &text.replace("held_out = false", "held_out = true")),
        "of 0 that are learnt from none has one",
    );
    let first = text.find("[[views]]").unwrap();
    let one = &text[first..][..text[first + 1..].find("[[views]]").unwrap()];
    refused(&(hull.clone() + one), "cameras that look at one place from several sides");
    let sphere = "[[meshes]]\nshape = \"sphere\"\nagreement = 0.9\n";
    refused(&(sphere.to_owned() + &text), "`agreement` is that of a hull");
}

/// A fit of the ring whose mesh changes every two steps.
const FIT: &str = "[[meshes]]\nshape = \"hull\"\nfaces = 500\nmaterial = { vertex_colors = true }\n\
                   [learn.vertices]\nsmoothing = 5.0\nlaplacian = 1e-3\n[learn.colors]\n\
                   [learn.pose]\n[learn.cameras]\n[loss]\nsilhouette = 1.0\n\
                   [[stages]]\nsteps = 3\nreduce = 2\nviews_per_step = 3\n\
                   remesh = { length = 0.15, every = 2 }\n\
                   [[stages]]\nsteps = 4\nviews_per_step = 3\n\
                   remesh = { length = 0.1 }\n";

#[test]
fn a_fit_whose_mesh_changes_has_the_same_bits_however_it_is_interrupted_or_shared() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 8, 9, 32);
    let mut counts = Vec::new();
    check_interruptions(folder.path(), &(FIT.to_owned() + &text), |fit| {
        counts.push(fit.scene().objects[0].mesh.faces().len());
    });
    // Steps 0, 2 and 3 changed the mesh.
    let changes: Vec<_> = counts.windows(2).map(|pair| pair[0] != pair[1]).collect();
    assert_eq!(changes[..4], [true, false, true, true], "{counts:?}");
    assert_eq!(changes[4..], [false; 3], "{counts:?}");
}

#[test]
fn a_ring_is_learnt_and_keeps_its_hole() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 24, 6, 96)
        + "[learn.vertices]\nsmoothing = 10.0\n[learn.colors]\n[pipeline]\ncull = \"back\"\n\
           [loss]\nkind = \"huber\"\nsilhouette = 1.0\n\
           [[stages]]\nsteps = 60\nreduce = 2\nviews_per_step = 4\n\
           remesh = { length = 0.1, every = 30 }\n\
           [[stages]]\nsteps = 90\nviews_per_step = 4\nrates = 0.5\n\
           remesh = { length = 0.06, every = 45 }\n";
    let scene = load(folder.path(), &(HULL.to_owned() + &text));
    let fit = crate::fits::fitted(scene);
    let [psnr, iou] = crate::fits::held_out(&fit);
    assert!(iou > 0.97, "{iou}");
    assert!(psnr > 26.0, "{psnr} dB");
    let learnt = fit.learnt().unwrap();
    let all = connectivity(&learnt.objects[0]);
    assert!(all.is_closed());
    assert_eq!(all.euler_characteristic(), 0);
    let object = &learnt.objects[0];
    assert!(self_intersections(&object.positions, &object.mesh).unwrap().is_empty());
}

#[test]
fn meshes_that_cannot_change_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 4, 5, 16);
    let stage = "[[stages]]\nsteps = 1\nremesh = { length = 0.1 }\n";
    let refused = |rest: &str, rule: &str| {
        let scene = load(folder.path(), &(stage.to_owned() + rest + &text));
        let error = SceneFit::new(scene).err().map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.contains(rule)), "{error:?}");
    };
    let hull = "[[meshes]]\nshape = \"hull\"\nfaces = 100\n";
    refused(&format!("{hull}[learn.texture]\n"), "`remesh` needs `learn.vertices`");
    refused(&format!("{hull}[learn.vertices]\nrigid = 0.1\n"), "`remesh` goes without");
    let sphere =
        "[[meshes]]\nshape = \"sphere\"\nmaterial = { texture_size = 8 }\n[learn.vertices]\n";
    refused(sphere, "\"sphere\" has textures");
    // Coordinates that nothing is looked up by are no hindrance.
    let scene = load(
        folder.path(),
        &(stage.to_owned() + &sphere.replace("texture_size = 8", "vertex_colors = true") + &text),
    );
    assert!(SceneFit::new(scene).unwrap().step().unwrap().is_some());
    // So short that no memory holds the faces.
    let short = stage.replace("0.1", "1e-9") + &format!("{hull}[learn.vertices]\n");
    let error = SceneFit::new(load(folder.path(), &(short + &text))).err().unwrap().to_string();
    assert!(error.contains("of memory"), "{error}");
    // Colours are at vertices, in whatever order a file has them.
    let colored = format!(
        "{stage}{hull}material = {{ vertex_colors = true }}\n[learn.vertices]\n[learn.colors]\n"
    );
    let mut scene = load(folder.path(), &(colored + &text));
    let object = &mut scene.objects[0];
    let faces = object.mesh.faces().iter().map(|face| face.map(|vertex| vertex % 2)).collect();
    let rows = Tensor::from([[0.2_f32, 0.4, 0.6], [0.8, 0.6, 0.4]]);
    object.colors = Some(Attribute { rows, indices: Mesh::new(faces, 2).unwrap() });
    let mut split = scene.clone();
    let mut fit = SceneFit::new(scene).unwrap();
    fit.step().unwrap();
    let [object] = fit.scene().objects.as_slice() else { unreachable!("there is one") };
    let colors = object.colors.as_ref().unwrap();
    assert_eq!(colors.indices.faces(), object.mesh.faces());
    assert!(colors.rows.data().iter().all(|share| (0.2..=0.8).contains(share)));
    assert!(colors.rows.data().chunks(3).any(|row| (row[0] - 0.5).abs() < 0.25));
    // A vertex of two colours has an edge between them.
    let colors = split.objects[0].colors.as_mut().unwrap();
    let mut faces = colors.indices.faces().to_vec();
    faces[0] = faces[0].map(|row| 1 - row);
    colors.indices = Mesh::new(faces, 2).unwrap();
    let error = SceneFit::new(split).err().unwrap().to_string();
    assert!(error.contains("several colours"), "{error}");
}
