//! Meshes that are surfaces of learnt fields: their topology changes, and then they are meshes like others.

use std::f64::consts::TAU;
use std::fs;

use bokashi_mesh::{Connectivity, signed_volume};
use bokashi_scene::{Scene, SceneFit};
use glam::DVec3;

use crate::fits::{held_out, views};
use crate::fixtures::{bits, check_interruptions, end, load};
use crate::rays::Ball;

/// Balls that overlap in a ring around an axis that is none of the grid's.
fn ring() -> Vec<Ball> {
    let [u, v] = [DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.36, 0.48, 0.8)];
    let center = |k: usize| {
        let angle = TAU * k as f64 / 16.0;
        0.75 * (angle.cos() * u + angle.sin() * v)
    };
    (0..16).map(|k| Ball::motley(center(k), 0.3)).collect()
}

const BALL: &str = "[[meshes]]\nshape = \"sphere\"\nfaces = 500\nplace = { scale = 1.1 }\n\
                    material = { vertex_colors = true }\n";

#[test]
fn a_ball_becomes_a_ring_whose_hole_silhouettes_open() {
    let folder = tempfile::tempdir().unwrap();
    let text = views(folder.path(), &ring(), 24, 6, 64)
        + "[learn.field]\ncells = 24\n[learn.vertices]\nsmoothing = 10.0\n[learn.colors]\n\
           [pipeline]\ncull = \"back\"\n[loss]\nkind = \"huber\"\nsilhouette = 1.0\n\
           [[stages]]\nsteps = 120\nviews_per_step = 4\nlearn = [\"field\", \"colors\"]\n\
           [[stages]]\nsteps = 60\nviews_per_step = 4\nrates = 0.5\nlearn = [\"vertices\", \"colors\"]\n\
           remesh = { length = 0.1, every = 30 }\n";
    let mut fit = SceneFit::new(load(folder.path(), &(BALL.to_owned() + &text))).unwrap();
    let topology = |fit: &SceneFit| {
        let object = fit.learnt().unwrap().objects.swap_remove(0);
        let all = Connectivity::new(&object.mesh);
        assert!(all.is_closed() && all.is_manifold());
        assert!(signed_volume(&object.positions, &object.mesh).unwrap() > 0.0);
        (all.parts(), all.euler_characteristic())
    };
    assert_eq!(topology(&fit), (1, 2));
    while fit.steps_done() < 120 {
        fit.step().unwrap();
    }
    // What is drawn is what is left.
    let iou = held_out(&fit)[1];
    assert!(iou > 0.93, "{iou}");
    assert_eq!(topology(&fit), (1, 0));
    fit.run(|_| ()).unwrap();
    let [psnr, iou] = held_out(&fit);
    assert!(psnr > 24.0 && iou > 0.965, "{psnr} dB, {iou}");
    assert_eq!(topology(&fit), (1, 0));
}

/// A fit whose field is learnt in two stages, then left, whose mesh then changes and gets a texture at last.
const FIT: &str = "[learn.field]\ncells = 10\n[learn.vertices]\nsmoothing = 5.0\nlaplacian = 1e-3\n[learn.colors]\n\
                   [learn.texture]\n[learn.pose]\n[learn.cameras]\n[loss]\nsilhouette = 1.0\n\
                   [[stages]]\nsteps = 3\nreduce = 2\nviews_per_step = 3\nrates = 8.0\nlearn = [\"field\", \"colors\", \"pose\"]\n\
                   [[stages]]\nsteps = 2\nviews_per_step = 2\nrates = 8.0\nlearn = [\"field\", \"cameras\"]\n\
                   [[stages]]\nsteps = 2\nviews_per_step = 3\nlearn = [\"vertices\", \"colors\", \"pose\"]\n\
                   [[stages]]\nsteps = 2\nviews_per_step = 3\nlearn = [\"vertices\", \"colors\"]\n\
                   remesh = { length = 0.3 }\n\
                   [[stages]]\nsteps = 2\nviews_per_step = 3\nlearn = [\"vertices\", \"texture\"]\n\
                   texture = { size = 64 }\n";

#[test]
fn a_fit_of_a_field_has_the_same_bits_however_it_is_interrupted_or_shared() {
    let folder = tempfile::tempdir().unwrap();
    let text = BALL.to_owned() + FIT + &views(folder.path(), &ring(), 8, 9, 32);
    let mut meshes = Vec::new();
    check_interruptions(folder.path(), &text, |fit| {
        let object = fit.learnt().unwrap().objects.swap_remove(0);
        assert_eq!(object.coordinates.is_some(), fit.steps_done() > 9);
        meshes.push(object.mesh.faces().to_vec());
    });
    let changes: Vec<_> = meshes.windows(2).map(|pair| pair[0] != pair[1]).collect();
    // A field's mesh may be another in each step; that of vertices is one until it is remeshed.
    assert!(changes[..5].iter().filter(|is_other| **is_other).count() >= 3, "{changes:?}");
    assert_eq!(changes[5..9], [false, false, true, false]);
}

#[test]
fn what_is_changed_of_a_field_takes_effect_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = BALL.to_owned() + FIT + &views(folder.path(), &ring(), 4, 5, 16);
    let saved = folder.path().join("saved");
    let mut fit = SceneFit::new(load(folder.path(), &text)).unwrap();
    fit.step().unwrap();
    fit.save(&saved).unwrap();
    let whole = end(fit);
    let resumed = |from: &str, to: &str| {
        let text = text.replacen(from, to, 1);
        SceneFit::resume(load(folder.path(), &text), &saved)
    };
    let fit = resumed("[learn.field]", "[learn.field]\nrate = 0.1").unwrap();
    assert!(fit.changed()[0].contains("`learn.field."), "{:?}", fit.changed());
    assert!(end(fit) != whole);
    for (to, rule) in [
        ("cells = 11", "the scene's parameters"),
        ("cells = 10\nsmoothing = 1", "the surface that it learnt from: `learn.field.smoothing`"),
    ] {
        let error = resumed("cells = 10", to).err().unwrap().to_string();
        assert!(error.contains(rule), "{error}");
    }
    // A stage under way goes on with a field or with a mesh, as it began.
    let mut fit = SceneFit::new(load(folder.path(), &text)).unwrap();
    for (steps, from, to, rule) in [
        (4, "[\"field\", \"cameras\"]", "[\"vertices\"]", "learns the `field`, as it did"),
        (6, "[\"vertices\", \"colors\", \"pose\"]", "[\"field\"]", "learns no `field`, as it did"),
    ] {
        while fit.steps_done() < steps {
            fit.step().unwrap();
        }
        fit.save(&saved).unwrap();
        let text = text.replacen(from, to, 1);
        let error = SceneFit::resume(load(folder.path(), &text), &saved).err().unwrap();
        assert!(error.to_string().contains(rule), "{error}");
    }
}

#[test]
fn fields_that_cannot_be_learnt_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = views(folder.path(), &ring(), 4, 5, 16);
    let refused = |head: &str, rule: &str| {
        fs::write(folder.path().join("scene.toml"), head.to_owned() + &text).unwrap();
        let fit = Scene::load(folder.path().join("scene.toml")).and_then(SceneFit::new);
        let error = fit.err().map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.contains(rule)), "{error:?}");
    };
    let field = "[learn.field]\ncells = 8\n";
    let mesh = |rest: &str| format!("[[meshes]]\n{rest}\n{field}");
    refused(&mesh("shape = \"plane\""), "\"plane\" has a border");
    refused(
        &mesh("shape = \"sphere\"\nmaterial = { texture_size = 8 }"),
        "\"sphere\" has textures",
    );
    refused(&(mesh("shape = \"sphere\"") + "meshes = [\"cube\"]\n"), "`meshes` of `learn.field`");
    refused(&mesh("shape = \"sphere\"").replace("cells = 8", "cells = 3"), "from 4 to 512");
    let ball = mesh("shape = \"sphere\"");
    refused(&(ball.clone() + "[learn.vertices]\n"), "either the `field` or the `vertices`");
    let stage = |learn: &str| format!("[[stages]]\nsteps = 1\nlearn = [{learn}]\n");
    let later = format!("{ball}[learn.vertices]\n{}{}", stage("\"vertices\""), stage("\"field\""));
    refused(&later, "stage 2 does after stage 1");
    let never = format!("{ball}[learn.vertices]\n{}", stage("\"vertices\""));
    refused(&never, "a `field` is learnt in the first stage");
    let remeshed =
        format!("{ball}[learn.vertices]\n{}remesh = {{ length = 0.1 }}\n", stage("\"field\""));
    refused(&remeshed, "a stage with `remesh` learns no `field`");
    let textured = format!("{ball}{}texture = {{ size = 64 }}\n", stage("\"field\""));
    refused(&textured, "a stage with `texture` learns no `field`");
}

/// All views say that nothing is there.
#[test]
fn a_field_without_a_surface_ends_the_fit_with_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = [Ball::motley(DVec3::new(0.0, 0.0, 50.0), 0.001)];
    let text = "[[meshes]]\nshape = \"sphere\"\nplace = { scale = 0.3 }\n[learn.field]\ncells = 8\nrate = 1.0\n\
                [loss]\nsilhouette = 1.0\n[stop]\nsteps = 40\nviews_per_step = 4\n"
        .to_owned()
        + &views(folder.path(), &nothing, 4, 5, 16);
    let mut fit = SceneFit::new(load(folder.path(), &text)).unwrap();
    let error = fit.run(|_| ()).unwrap_err().to_string();
    assert_eq!(error, "a field that is learnt needs a point inside, got none of \"sphere\"");
    // The step before it is saved as any other.
    let saved = folder.path().join("saved");
    fit.save(&saved).unwrap();
    let again = SceneFit::resume(load(folder.path(), &text), &saved).unwrap();
    assert_eq!(bits(&again), bits(&fit));
}
