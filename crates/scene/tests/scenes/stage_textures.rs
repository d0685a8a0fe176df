//! Meshes that get a texture in the middle of a fit.

use bokashi_scene::{Folder, Scene, SceneFit, read_model};
use glam::DVec3;

use crate::fits::{fitted, held_out, views};
use crate::fixtures::{check_interruptions, end, load};
use crate::hulls::photographs;
use crate::rays::Ball;

/// A ring whose mesh changes, and which gets a texture then.
const FIT: &str = "[[meshes]]\nshape = \"hull\"\nfaces = 500\nmaterial = { vertex_colors = true }\n\
                   [learn.vertices]\nsmoothing = 5.0\n[learn.colors]\n\
                   [learn.texture]\ntotal_variation = 1e-3\n\
                   [learn.pose]\n[learn.cameras]\n[loss]\nsilhouette = 1.0\n\
                   [[stages]]\nsteps = 3\nreduce = 2\nviews_per_step = 3\n\
                   remesh = { length = 0.15, every = 2 }\n\
                   [[stages]]\nsteps = 4\nviews_per_step = 3\n\
                   remesh = { length = 0.12 }\ntexture = { size = 64 }\n\
                   [[stages]]\nsteps = 2\nlearn = [\"texture\"]\n";

/// The names of what is learnt.
fn names(fit: &SceneFit) -> Vec<&str> {
    fit.parameters().iter().map(|parameter| parameter.name()).collect()
}

#[test]
fn a_fit_whose_mesh_gets_a_texture_has_the_same_bits_however_it_is_interrupted_or_shared() {
    let folder = tempfile::tempdir().unwrap();
    let text = photographs(folder.path(), 8, 9, 32);
    let fit = check_interruptions(folder.path(), &(FIT.to_owned() + &text), |fit| {
        let done = fit.steps_done();
        let own = if done > 3 { "texture/hull" } else { "colors/hull" };
        assert_eq!(names(fit), ["vertices/hull", own, "pose/hull", "cameras"], "{done}");
    });
    let load = || Scene::load(folder.path().join("scene.toml")).unwrap();
    let saved = folder.path().join("saved");
    // What is drawn of a fit that was resumed is what is drawn of one that was not.
    let learnt = |fit: &SceneFit| fit.learnt().unwrap().objects[0].clone();
    let [one, other] = [&fit, &SceneFit::resume(load(), &saved).unwrap()].map(learnt);
    let texels = |object: &bokashi_scene::Object| object.materials[0].texture.texels.clone();
    assert!(texels(&one).is_some() && texels(&one) == texels(&other));
    assert_eq!(one.coordinates.unwrap().rows, other.coordinates.unwrap().rows);
}

#[test]
fn a_mesh_that_is_no_hull_and_keeps_its_faces_gets_a_texture_too() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[[meshes]]\nshape = \"sphere\"\nfaces = 200\nmaterial = { vertex_colors = true }\n\
                [[meshes]]\nname = \"other\"\nshape = \"cube\"\nplace = { scale = 0.3, translation = [0, 0, 1.4] }\n\
                material = { texture_size = 4 }\n\
                [learn.colors]\nmeshes = [\"sphere\"]\n[learn.texture]\n\
                [[stages]]\nsteps = 2\nlearn = [\"texture\"]\nviews_per_step = 4\n\
                [[stages]]\nsteps = 2\nviews_per_step = 4\ntexture = { size = 32 }\n"
        .to_owned()
        + &photographs(folder.path(), 4, 5, 16);
    let mut fit = SceneFit::new(load(folder.path(), &text)).unwrap();
    let load = || Scene::load(folder.path().join("scene.toml")).unwrap();
    let saved = folder.path().join("saved");
    let whole = end(SceneFit::new(load()).unwrap());
    assert_eq!(names(&fit), ["colors/sphere", "texture/other"]);
    while fit.step().unwrap().is_some() {
        fit.save(&saved).unwrap();
        assert!(end(SceneFit::resume(load(), &saved).unwrap()) == whole);
    }
    assert_eq!(names(&fit), ["texture/sphere", "texture/other"]);
}

#[test]
fn a_texture_begins_as_the_colours_were_and_is_among_the_results() {
    let folder = tempfile::tempdir().unwrap();
    let fit = FIT.replace("[[stages]]\nsteps = 2\nlearn = [\"texture\"]\n", "");
    let text = fit.replace("texture = { size = 64 }", "texture = { size = 256 }\nrates = 1e-9");
    let text = text + &photographs(folder.path(), 8, 4, 48);
    let scene = load(folder.path(), &text);
    let expected = scene.result_names();
    let mut fit = SceneFit::new(scene).unwrap();
    while fit.steps_done() < 3 {
        fit.step().unwrap();
    }
    let [before, _] = held_out(&fit);
    while fit.step().unwrap().is_some() {}
    let [after, _] = held_out(&fit);
    // The mesh got other faces, too.
    assert!((after - before).abs() < 0.5, "{before} dB, and {after} dB with a texture");
    let out = folder.path().join("out");
    let written = fit.learnt().unwrap().save_results(&out).unwrap();
    for file in &written {
        let name = file.strip_prefix(&out).unwrap().to_path_buf();
        assert!(expected.contains(&name), "{name:?} is not in {expected:?}");
    }
    assert!(written.contains(&out.join("hull-texture.png")));
    let folder = Folder::new(&out).unwrap();
    for file in ["mesh.glb", "mesh.obj", "hull.ply"] {
        let model = read_model(&folder, file).unwrap();
        assert_eq!(model.images.len(), 1, "{file}");
        let geometry = &model.geometries[0];
        assert!(geometry.coordinates.is_some() && geometry.colors.is_none(), "{file}");
    }
}

#[test]
fn a_texture_shows_more_than_colours_at_few_vertices() {
    let folder = tempfile::tempdir().unwrap();
    let stages = |last: &str| {
        "[[meshes]]\nshape = \"sphere\"\nfaces = 320\nplace = { scale = 0.9 }\n\
         material = { vertex_colors = true }\n[learn.colors]\n[learn.texture]\n\
         [[stages]]\nsteps = 40\nviews_per_step = 4\n\
         [[stages]]\nsteps = 60\nviews_per_step = 4\n"
            .to_owned()
            + last
    };
    let views = views(folder.path(), &[Ball::motley(DVec3::ZERO, 0.9)], 16, 8, 64);
    let psnr = |text: &str| held_out(&fitted(load(folder.path(), &(text.to_owned() + &views))))[0];
    let colors = psnr(&stages("").replace("[learn.texture]\n", ""));
    let texture = psnr(&stages("texture = { size = 128 }\n"));
    assert!(texture > colors + 0.3, "{colors} dB, and {texture} dB with a texture");
}

#[test]
fn meshes_that_can_get_no_texture_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let views = photographs(folder.path(), 4, 5, 16);
    let refused = |rest: &str, rule: &str| {
        let scene = load(folder.path(), &(rest.to_owned() + &views));
        let error = SceneFit::new(scene).err().map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.contains(rule)), "{rest}: {error:?}");
    };
    let mesh = "[[meshes]]\nshape = \"sphere\"\nfaces = 100\nmaterial = { vertex_colors = true }\n";
    let learn = "[learn.colors]\n[learn.texture]\n";
    let stage = "[[stages]]\nsteps = 1\ntexture = { size = 32 }\n";
    let with = |rest: &str| format!("{mesh}{learn}{rest}");
    refused(&format!("{mesh}[learn.texture]\n{stage}"), "there is no `learn.colors`");
    refused(&format!("{mesh}[learn.colors]\n{stage}"), "there is no `learn.texture`");
    refused(&with(&format!("{stage}{stage}")), "one stage has a `texture`, and here are several");
    refused(
        &with(&format!("[learn.vertices]\n{stage}remesh = {{ length = 0.2, every = 3 }}\n")),
        "`remesh` comes after `texture`",
    );
    refused(
        &with(&format!(
            "[learn.vertices]\n{stage}[[stages]]\nsteps = 1\nremesh = {{ length = 0.2 }}\n"
        )),
        "`remesh` comes after `texture`",
    );
    refused(
        &with(&format!("[[stages]]\nsteps = 1\nlearn = [\"texture\"]\n{stage}")),
        "meshes get a texture in stage 2, and stage 1 learns \"texture\": there is none before",
    );
    refused(
        &with(&format!("{stage}[[stages]]\nsteps = 1\nlearn = [\"colors\"]\n")),
        "and stage 2 learns \"colors\": they are in the texture from there on",
    );
    let other = "[[meshes]]\nname = \"b\"\nshape = \"cube\"\nmaterial = { texture_size = 4 }\n";
    refused(
        &format!(
            "{mesh}{other}[learn.colors]\nmeshes = [\"sphere\"]\n[learn.texture]\nmeshes = [\"b\"]\n{stage}"
        ),
        "they name none in common",
    );
    refused(&format!("{mesh}{other}{learn}{stage}"), "and \"b\" has none");
    let both = other.replace("texture_size = 4", "texture_size = 4, vertex_colors = true");
    refused(&format!("{mesh}{both}{learn}{stage}"), "and \"b\" has textures");
    let size = with(&stage.replace("32", "33"));
    std::fs::write(folder.path().join("scene.toml"), size + &views).unwrap();
    let error = Scene::load(folder.path().join("scene.toml")).unwrap_err().to_string();
    assert!(
        error.contains("a power of two from 16 to 8192 is needed here, and this is 33"),
        "{error}"
    );
}
