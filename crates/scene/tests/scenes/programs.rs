//! Scenes as programs use them: what a fit learns from, what it compares, and what it leaves.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor};
use bokashi_scene::glam::{DMat4, DVec3};
use bokashi_scene::{
    Borders, Folder, Geometry, Indexed, MaterialFile, MaterialMap, Model, Picture, Place, Placed,
    Renderer, Samples, Scene, SceneFit, Submesh, Values, glb, most_bent_edges, read_model,
};

/// Columns and rows of all images here.
const SIZE: [usize; 2] = [24, 16];

fn load(folder: &Path, text: &str) -> Scene {
    let file = folder.join("scene.toml");
    fs::write(&file, text).unwrap();
    Scene::load(&file).unwrap()
}

/// An image of light and opacity that differ from pixel to pixel; as a file of floats the light is multiplied by
/// the opacity.
fn picture(is_float: bool) -> Picture {
    let [width, height] = SIZE;
    let sample = |k: usize| (7 * k + k / 96 * 5) % 256;
    let count = 4 * width * height;
    let opacity = |k: usize| sample(k / 4 * 4 + 3) as f32 / 255.0;
    let samples = match is_float {
        false => Samples::U8((0..count).map(|k| sample(k) as u8).collect()),
        true => Samples::F32(
            (0..count)
                .map(|k| match k % 4 {
                    3 => opacity(k),
                    _ => sample(k) as f32 / 255.0 * opacity(k),
                })
                .collect(),
        ),
    };
    Picture { width, height, channels: 4, samples }
}

fn png(folder: &Path) {
    let place = Place::new("a.png");
    fs::write(folder.join("a.png"), picture(false).encode_png(&place).unwrap()).unwrap();
}

fn furthest(a: &Tensor<f32>, b: &Tensor<f32>) -> f32 {
    assert_eq!(a.shape(), b.shape());
    a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn what_was_learnt_is_drawn_as_the_fit_drew_it() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let head = r#"
[[meshes]]
shape = "sphere"
faces = 200
material = { texture_size = 8, roughness = 0.5, metallic = 0.3 }
place = { translation = [0.4, 0.1, -0.3], rotation = [0, 0.6, 0, 0.8], scale = 0.9 }
instances = [{ translation = [1, 0, 0], scale = 0.4 }]
[[views]]
image = "a.png"
camera = { position = [0.5, 0.4, 4], target = [0.2, 0, 0], angle = 40, distortion = [0.01, 0, 0, 0, 0] }
[[lights]]
kind = "directional"
direction = [1, 2, 3]
color = [3, 2, 3]
[[lights]]
kind = "point"
position = [-2, 2, 3]
color = [9, 10, 9]
[pipeline]
exposure = 0.1
blur = 0.7
background = [0.1, 0.2, 0.3]
[stop]
steps = 6
"#;
    let keys = [
        "vertices",
        "texture",
        "roughness",
        "metallic",
        "pose",
        "cameras",
        "intrinsics",
        "distortion",
        "lights",
        "light_places",
        "exposure",
        "blur",
    ];
    for key in keys {
        let scene = load(folder.path(), &format!("{head}[learn.{key}]\nrate = 0.1\n"));
        let mut fit = SceneFit::new(scene).unwrap();
        let first = fit.seen(0).unwrap().image;
        while fit.step().unwrap().is_some() {}
        let last = fit.seen(0).unwrap().image;
        let again = SceneFit::new(fit.learnt().unwrap()).unwrap().seen(0).unwrap().image;
        let [moved, off] = [furthest(&first, &last), furthest(&again, &last)];
        println!("{key}: moved {moved}, off {off}");
        assert!(moved > 5e-3 && off < 1e-4, "{key}: moved {moved}, off {off}");
    }
}

#[test]
fn images_with_opacity_stand_before_the_background() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let exr = picture(true).encode_exr(&Place::new("b.exr")).unwrap();
    fs::write(folder.path().join("b.exr"), exr).unwrap();
    let camera = "camera = { position = [0, 0, 4], angle = 40 }";
    let text = format!(
        "[[meshes]]\nshape = \"sphere\"\nfaces = 80\n\
         [[views]]\nimage = \"a.png\"\ncolor_space = \"linear\"\n{camera}\n\
         [[views]]\nimage = \"b.exr\"\n{camera}\n\
         [pipeline]\ntone = \"linear\"\nbackground = [0.5, 0.25, 1]\n[learn.texture]\n"
    );
    let fit = SceneFit::new(load(folder.path(), &text)).unwrap();
    let light = picture(true);
    let Samples::F32(light) = &light.samples else { panic!("floats") };
    let expected = Tensor::from_flat_fn([SIZE[1], SIZE[0], 3], |k| {
        let (pixel, channel) = (k / 3, k % 3);
        light[4 * pixel + channel] + (1.0 - light[4 * pixel + 3]) * [0.5, 0.25, 1.0][channel]
    });
    for view in 0..2 {
        let target = fit.seen(view).unwrap().target.unwrap();
        assert!(furthest(&target, &expected) < 1e-5, "{view}");
    }
}

#[test]
fn an_instance_stands_where_the_place_of_its_mesh_leads_it() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[[meshes]]\nshape = \"cube\"\n\
        place = { scale = 2, rotation = [0, 0, 1, 1], translation = [5, 0, 0] }\n\
        instances = [{ translation = [1, 0, 0] }]\n";
    let scene = load(folder.path(), text);
    let [first, second] = scene.objects[0].places[..] else { panic!("two places") };
    // A quarter of a turn about z brings x to y.
    let expected = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let origin = |place: DMat4| place.transform_point3(DVec3::ZERO);
    assert!(origin(first).distance(expected(5.0, 0.0)) < 1e-12);
    assert!(origin(second).distance(expected(5.0, 2.0)) < 1e-12);
    assert!(second.transform_point3(DVec3::X).distance(expected(5.0, 4.0)) < 1e-12);
}

#[test]
fn a_mask_of_its_own_goes_before_the_opacity_of_the_image() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let [width, height] = SIZE;
    let white =
        Picture { width, height, channels: 1, samples: Samples::U8(vec![255; width * height]) };
    let bytes = white.encode_png(&Place::new("m.png")).unwrap();
    fs::write(folder.path().join("m.png"), bytes).unwrap();
    let text = "[[meshes]]\nshape = \"sphere\"\nmaterial = { base_color = [1, 1, 1] }\n\
        [[views]]\nimage = \"a.png\"\nmask = \"m.png\"\ncamera = { position = [0, 0, 6], angle = 40 }\n\
        [pipeline]\ntone = \"linear\"\n[learn.texture]\n";
    let seen = SceneFit::new(load(folder.path(), text)).unwrap().seen(0).unwrap();
    // The mask is everywhere: of it the ball covers its share.
    let covered = seen.image.data().iter().step_by(3).filter(|&&red| red > 0.5).count();
    assert!(covered > 50 && covered < width * height / 2, "{covered}");
    let expected = covered as f64 / (width * height) as f64;
    assert!((seen.score.silhouette_iou.unwrap() - expected).abs() < 1e-12);
}

#[test]
fn masks_have_the_names_of_their_images_or_end_in_png() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    };
    write("images/b.exr", &picture(true).encode_exr(&Place::new("b.exr")).unwrap());
    let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]";
    let frame = format!("{{\"file_path\": \"images/b.exr\", \"transform_matrix\": {pose}}}");
    write("transforms.json", format!("{{\"fl_x\": 30, \"frames\": [{frame}]}}").as_bytes());
    let text = "[cameras]\ntransforms = \"transforms.json\"\nmasks = \"masks\"\n";
    let mask = || load(folder.path(), text).views[0].mask.clone();
    assert_eq!(mask(), Some("masks/b.png".into()));
    write("masks/b.png", b"");
    write("masks/b.exr", b"");
    assert_eq!(mask(), Some("masks/b.exr".into()));
}

#[test]
fn an_environment_is_a_panorama_or_six_faces() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(directory.path().join(name), bytes).unwrap();
    // A pixel is a byte times 2^(e - 136): 2 above the horizon, 1/4 below it.
    let pixels = (0..64 * 32).map(|k| [128, 128, 128, if k / 64 < 16 { 130 } else { 127 }]);
    let pixels: Vec<[u8; 4]> = pixels.collect();
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n";
    let hdr = [&head[..], pixels.as_flattened()].concat();
    write("sky.hdr", &hdr);
    // Twice as bright: its numbers were halved.
    let start = hdr.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    write("dark.hdr", &[&hdr[..start], b"EXPOSURE=0.5\n", &hdr[start..]].concat());
    let exr = |width: usize, height: usize| {
        let samples = Samples::F32(vec![1.0; width * height * 3]);
        let picture = Picture { width, height, channels: 3, samples };
        picture.encode_exr(&Place::new("sky.exr")).unwrap()
    };
    write("sky.exr", &exr(64, 32));
    write("faces.exr", &exr(8, 48));
    write("cross.exr", &exr(32, 24));
    let load = |text: &str| {
        fs::write(directory.path().join("scene.toml"), format!("[environment]\n{text}\n")).unwrap();
        Scene::load(directory.path().join("scene.toml")).map_err(|error| error.to_string())
    };
    for (text, side, above, below) in [
        ("image = \"sky.hdr\"", 16, 2.0, 0.25),
        ("image = \"sky.hdr\"\nsize = 32", 32, 2.0, 0.25),
        ("image = \"dark.hdr\"\nsize = 8", 8, 4.0, 0.5),
        ("image = \"sky.exr\"", 16, 1.0, 1.0),
        ("image = \"faces.exr\"", 8, 1.0, 1.0),
    ] {
        let texels = load(text).unwrap().environment.unwrap();
        assert_eq!(**texels.shape(), [6, side, side, 3], "{text}");
        // All of +y, the middle of -y, and both halves of +z.
        assert!((0..side * side).all(|k| texels[[2, k / side, k % side, 1]] == above), "{text}");
        assert_eq!(texels[[3, side / 2, side / 2, 0]], below, "{text}");
        assert_eq!([texels[[4, 0, 0, 2]], texels[[4, side - 1, 0, 2]]], [above, below], "{text}");
    }
    for (text, rule) in [
        ("image = \"faces.exr\"\nsize = 8", "or without `size` six faces"),
        ("image = \"cross.exr\"", "twice as wide as high, or without `size` six faces"),
        ("image = \"sky.hdr\"\nsize = 24", "a power of two from 8 to 256, and this is 24"),
        ("image = \"sky.hdr\"\ncolor = [1, 1, 1]", "either `image` or `color`"),
    ] {
        let message = load(text).unwrap_err();
        assert!(message.contains(rule), "{text}: {message}");
    }
}

/// The loss of the first step of a scene of one view, whose loss has these keys.
fn first_loss(folder: &Path, keys: &str) -> (f64, f64) {
    let text = format!(
        "[[meshes]]\nshape = \"sphere\"\nfaces = 80\nmaterial = {{ base_color = [0.5, 0.4, 0.3] }}\n\
         [[views]]\nimage = \"a.png\"\ncamera = {{ position = [0, 0, 4], angle = 40 }}\n\
         [learn.texture]\n[loss]\n{keys}"
    );
    let mut fit = SceneFit::new(load(folder, &text)).unwrap();
    let ssim = fit.score(0).unwrap().ssim.unwrap();
    (fit.step().unwrap().unwrap().loss, ssim)
}

#[test]
fn a_loss_over_pixels_is_that_over_images() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let mut all = Vec::new();
    for kind in ["squared", "absolute", "huber"] {
        for silhouette in [0.0, 0.7] {
            let keys = format!("kind = \"{kind}\"\nsilhouette = {silhouette}\n");
            let (over_pixels, _) = first_loss(folder.path(), &keys);
            // Structure is of neighbouring pixels; of this little a share is no number.
            let (over_images, _) = first_loss(folder.path(), &format!("{keys}ssim = 1e-12\n"));
            let off = (over_pixels / over_images - 1.0).abs();
            assert!(off < 1e-5, "{keys}: {over_pixels} and {over_images}");
            all.push(over_pixels);
        }
    }
    assert!(all.chunks(2).all(|pair| pair[1] > 1.1 * pair[0]), "{all:?}");
}

#[test]
fn structure_takes_its_share_of_the_loss() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let (pixels, ssim) = first_loss(folder.path(), "");
    for share in [0.25, 1.0] {
        let (loss, _) = first_loss(folder.path(), &format!("ssim = {share:?}\n"));
        let expected = (1.0 - share) * pixels + share * (1.0 - ssim);
        assert!((loss / expected - 1.0).abs() < 1e-4, "{share}: {loss} and {expected}");
    }
}

/// A ball before three cameras whose images are one.
fn three_views(folder: &Path, rest: &str) -> Scene {
    png(folder);
    let views = [1.0, 2.0, 3.0].map(|x| {
        format!(
            "[[views]]\nname = \"{x}\"\nimage = \"a.png\"\n\
             camera = {{ position = [{x}, 0, 4], angle = 40 }}\n"
        )
    });
    let mesh = "[[meshes]]\nshape = \"sphere\"\nfaces = 80\n";
    load(folder, &format!("{rest}{mesh}{}[pipeline]\nexposure = 0.0\n", views.concat()))
}

fn value(fit: &SceneFit, name: &str) -> Vec<f32> {
    fit.parameters().value(name).unwrap().data().to_vec()
}

#[test]
fn a_stage_learns_what_it_names_and_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    let stages = "[learn.exposure]\n[learn.texture]\n\
        [[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"exposure\"]\n";
    let second = "[[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"texture\"]\n";
    let third = "[[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"exposure\"]\n";
    let scene = three_views(folder.path(), &format!("{stages}{second}{third}"));
    let mut fit = SceneFit::new(scene).unwrap();
    let both = |fit: &SceneFit| [value(fit, "exposure"), value(fit, "texture/sphere")];
    let mut all = vec![both(&fit)];
    let mut learnt = Vec::new();
    while fit.step().unwrap().is_some() {
        if fit.steps_done().is_multiple_of(3) {
            all.push(both(&fit));
            learnt.push(fit.learnt().unwrap());
        }
    }
    let changed = |stage: usize, which: usize| all[stage][which] != all[stage + 1][which];
    assert_eq!([changed(0, 0), changed(0, 1)], [true, false]);
    assert_eq!([changed(1, 0), changed(1, 1)], [false, true]);
    // Its third stage is a fit of its own of what the second has left.
    let mut scene = learnt.swap_remove(1);
    scene.description.stages.drain(..2);
    let mut alone = SceneFit::new(scene).unwrap();
    while alone.step().unwrap().is_some() {}
    let [found, expected] = [value(&alone, "exposure")[0], all[3][0][0]];
    assert!((found - expected).abs() < 1e-5, "{found} and {expected}");
}

#[test]
fn the_views_of_steps_follow_from_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let losses = |seed: u64| {
        let rest = format!("seed = {seed}\n[learn.exposure]\nrate = 1e-6\n[stop]\nsteps = 8\n");
        let mut fit = SceneFit::new(three_views(folder.path(), &rest)).unwrap();
        let mut losses = Vec::new();
        while let Some(step) = fit.step().unwrap() {
            losses.push(step.loss);
        }
        losses
    };
    let all: Vec<_> = (1..4).map(losses).collect();
    assert_eq!(all[0], losses(1));
    assert!(all[0] != all[1] || all[0] != all[2], "{all:?}");
}

/// The light of a scene's first view.
fn drawn(scene: Scene) -> Tensor<f32> {
    let renderer = Renderer::new(Arc::new(scene)).unwrap();
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let view = renderer.draw(&values, 0, 1, false).unwrap();
    renderer.image(&values, &view, 1).unwrap().value()
}

#[test]
fn a_fisheye_sees_a_ball_where_its_angle_is_before_and_behind_the_eye() {
    let folder = tempfile::tempdir().unwrap();
    for degrees in [30.0_f64, 80.0, 100.0, 140.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        // Small, so that the middle of its picture is the picture of its middle.
        let text = format!(
            "[[meshes]]\nshape = \"sphere\"\nplace = {{ scale = 0.1, translation = [{}, 0, {}] }}\n\
             material = {{ base_color = [1, 1, 1] }}\n[[views]]\nname = \"v\"\n\
             [views.camera]\nsize = [261, 201]\nfocal = 45\nfisheye = [0.02, -0.001, 0, 0]\n\
             pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
             [pipeline]\ntone = \"linear\"\n",
            3.0 * sin,
            3.0 * cos
        );
        let image = drawn(load(folder.path(), &text));
        let (mut all, mut sums) = (0.0, [0.0; 2]);
        for (k, &light) in image.data().iter().step_by(3).enumerate() {
            all += f64::from(light);
            sums[0] += f64::from(light) * (k % 261) as f64;
            sums[1] += f64::from(light) * (k / 261) as f64;
        }
        let angle = degrees.to_radians();
        let radius = angle * (1.0 + 0.02 * angle.powi(2) - 0.001 * angle.powi(4));
        let found = sums.map(|sum| sum / all);
        let off = [found[0] - (130.0 + 45.0 * radius), found[1] - 100.0];
        assert!(off.iter().all(|off| off.abs() < 0.1), "{degrees}: {found:?} is off by {off:?}");
        // The solid angle of the ball, times the pixels of one.
        let slope = 1.0 + 0.06 * angle.powi(2) - 0.005 * angle.powi(4);
        let pixels = 45.0 * 45.0 * slope * radius / angle.sin();
        let expected = std::f64::consts::PI * (0.1_f64 / 3.0).powi(2) * pixels;
        assert!((all / expected - 1.0).abs() < 0.02, "{degrees}: {all} and not {expected}");
    }
}

#[test]
fn every_kind_of_lens_is_learnt_and_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let head = |keys: [&str; 2]| {
        let view = |keys: &str| {
            let place = "position = [0.5, 0.4, 3], target = [0.2, 0, 0]";
            format!(
                "[[views]]\nname = \"{}\"\nimage = \"a.png\"\n\
                     camera = {{ {place}, focal = 30, {keys} }}\n",
                keys.len()
            )
        };
        format!(
            "[[meshes]]\nshape = \"sphere\"\nfaces = 200\n{}{}[stop]\nsteps = 6\n\
             [learn.distortion]\nrate = 0.05\n",
            view(keys[0]),
            view(keys[1])
        )
    };
    let lenses = ["distortion = [0.01, 0, 0, 0, 0, 0.02, 0, 0]", "fisheye = [0.01, 0, 0, 0]"];
    for lens in lenses {
        let other = lens.replace("0.01", "0.013");
        let scene = load(folder.path(), &head([lens, &other]));
        assert_eq!(scene.notes.len(), 1, "{:?}", scene.notes);
        assert!(scene.notes[0].contains("`learn.distortion` learns one lens for all views"));
        let mut fit = SceneFit::new(scene).unwrap();
        let first = fit.seen(0).unwrap().image;
        while fit.step().unwrap().is_some() {}
        let last = fit.seen(0).unwrap().image;
        let learnt = fit.learnt().unwrap();
        let coefficients = learnt.views[1].camera.distortion;
        assert!(
            coefficients.coefficients().iter().all(|&coefficient| coefficient != 0.0),
            "{coefficients:?}"
        );
        let again = SceneFit::new(learnt).unwrap().seen(0).unwrap().image;
        let [moved, off] = [furthest(&first, &last), furthest(&again, &last)];
        assert!(moved > 5e-3 && off < 1e-4, "{lens}: moved {moved}, off {off}");
    }
    let message = SceneFit::new(load(folder.path(), &head(lenses))).err().unwrap().to_string();
    let rule = "a `distortion` that is learnt is of one kind of lens, and those of the views are \
                `distortion` of eight numbers and `fisheye`";
    assert!(message.contains(rule), "{message}");
}

#[test]
fn the_edge_that_a_lens_bends_most_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let edge = |faces: &str, lens: &str| {
        let text = format!(
            "[[meshes]]\nshape = \"plane\"\nplace = {{ scale = 2.0 }}\n{faces}\n[[views]]\nname = \"v\"\n\
             camera = {{ size = [320, 240], focal = 200, {lens}, position = [0, 0, 4] }}\n"
        );
        most_bent_edges(&load(folder.path(), &text), 0.5).unwrap()
    };
    // Corners at (1/2, 1/2) go to 0.85 of that, and the middle of a side at 1/2 to 0.925: 200 (0.4625 - 0.425).
    let found = edge("", "distortion = [-0.3, 0, 0, 0, 0]");
    assert_eq!((found.len(), found[0].view.as_str(), found[0].object.as_str()), (1, "v", "plane"));
    assert!((found[0].pixels - 7.5).abs() < 1e-5, "{}", found[0].pixels);
    assert_eq!(edge("", "distortion = [0, 0, 0, 0, 0]"), []);
    assert_eq!(edge("faces = 5000", "distortion = [-0.3, 0, 0, 0, 0]"), []);
    // The same of a fisheye: a side at the angle atan(1/2) from the axis, corners at atan(sqrt(1/2)).
    let [side, corner] = [0.5_f64, 0.5_f64.sqrt()].map(f64::atan);
    let expected = 200.0 * (side - corner * 0.5_f64.sqrt());
    let found = edge("", "fisheye = [0, 0, 0, 0]");
    assert!((found[0].pixels - expected).abs() < 1e-5, "{} {expected}", found[0].pixels);
}

/// The sphere of a scene as an OBJ file, with `offset` added to its positions.
fn sphere_at(folder: &Path, name: &str, offset: DVec3) {
    let scene = load(folder, "[[meshes]]\nshape = \"sphere\"\nfaces = 300\n");
    let mut text = String::new();
    for row in scene.objects[0].positions.data().chunks_exact(3) {
        // So many bits that the sum with the offset has all of them.
        let row = [0, 1, 2].map(|k| (f64::from(row[k]) * 1048576.0).round() / 1048576.0);
        let [x, y, z] = (DVec3::from(row) + offset).to_array();
        text.push_str(&format!("v {x:?} {y:?} {z:?}\n"));
    }
    for face in scene.objects[0].mesh.faces() {
        let [a, b, c] = face.map(|vertex| vertex + 1);
        text.push_str(&format!("f {a} {b} {c}\n"));
    }
    fs::write(folder.join(name), text).unwrap();
}

#[test]
fn a_mesh_of_a_map_is_drawn_learnt_and_written_as_one_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let offset = DVec3::new(500_000.0, 4_649_776.0, 100.0);
    let image_of = |file: &str, at: DVec3| {
        sphere_at(folder, file, at);
        let [x, y, z] = (-at).to_array();
        let text = format!(
            "[[meshes]]\nfile = \"{file}\"\nname = \"ball\"\nplace = {{ translation = [{x}, {y}, {z}] }}\n\
             [[views]]\nimage = \"a.png\"\ncamera = {{ position = [0.5, 0.4, 4], angle = 40 }}\n\
             [learn.vertices]\n[stop]\nsteps = 3\n"
        );
        let mut fit = SceneFit::new(load(folder, &text)).unwrap();
        let mut images = vec![fit.seen(0).unwrap().image];
        while fit.step().unwrap().is_some() {}
        images.push(fit.seen(0).unwrap().image);
        let out = folder.join("out").join(file);
        fit.learnt().unwrap().save_results(&out).unwrap();
        let notes = fit.scene().notes.clone();
        (images, value(&fit, "vertices/ball"), Folder::new(out).unwrap(), notes)
    };
    let (near, far) = (image_of("near.obj", DVec3::ZERO), image_of("far.obj", offset));
    assert_eq!(near.0, far.0);
    assert_eq!(near.1, far.1);
    assert!(near.3.is_empty() && far.3[0].contains("[500000.0, 4649776.0, 100.0]"), "{:?}", far.3);
    // In the world they are the same, and in the mesh's own coordinates they are where its file had them.
    let model = |folder: &Folder, file: &str| read_model(folder, file).unwrap();
    assert_eq!(model(&near.2, "mesh.glb"), model(&far.2, "mesh.glb"));
    let written = [&near, &far].map(|keys| model(&keys.2, "ball.ply").geometries.remove(0));
    assert_eq!([written[0].offset, written[1].offset], [DVec3::ZERO, offset]);
    assert_eq!(written[0].positions, written[1].positions);
    assert_eq!(written[0].faces, written[1].faces);

    // Without a place the world is that of the file.
    let scene = load(folder, "[[meshes]]\nfile = \"far.obj\"\n");
    scene.save_results(folder.join("out")).unwrap();
    let again = model(&Folder::new(folder.join("out")).unwrap(), "mesh.glb");
    assert_eq!(again.placed[0].transform, DMat4::from_translation(offset));
    assert_eq!(again.geometries[0].faces.len(), scene.objects[0].mesh.faces().len());
    // The PLY has the coordinates of the file, and the places lead from there.
    let numbers = fs::read_to_string(folder.join("out/numbers.json")).unwrap();
    let numbers: serde_json::Value = serde_json::from_str(&numbers).unwrap();
    let rows =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    assert_eq!(numbers["objects"]["far"]["places"], serde_json::json!([rows]));
}

#[test]
fn vertex_colours_are_of_the_space_that_the_scene_names_and_are_written_as_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = "v 0 0 0 .5 .5 .5\nv 1 0 0 .5 .5 .5\nv 0 1 0 .5 .5 .5\nf 1 2 3\n";
    fs::write(folder.join("a.obj"), text).unwrap();
    let image_of = |file: &str, space: &str| {
        let scene = load(folder, &format!("[[meshes]]\nfile = \"{file}\"\n{space}"));
        scene.save_results(folder.join("out")).unwrap();
        fs::copy(folder.join("out/a.ply"), folder.join("a.ply")).unwrap();
        scene.objects[0].colors.as_ref().unwrap().rows.data()[0]
    };
    // The same grey as a byte of 128, to within the steps of bytes.
    for (space, light) in [("linear", 0.5), ("srgb", 0.214_041)] {
        let found = image_of("a.obj", &format!("vertex_color_space = \"{space}\"\n"));
        assert!((found - light).abs() < 1e-6, "{space}: {found}");
        let again = image_of("a.ply", "");
        assert!((again - light).abs() < 4e-3, "{space}: {again}");
    }
    assert_eq!(image_of("a.obj", ""), image_of("a.obj", "vertex_color_space = \"srgb\"\n"));
    let file = folder.join("scene.toml");
    let shape = "[[meshes]]\nshape = \"cube\"\nvertex_color_space = \"srgb\"\n";
    fs::write(&file, shape).unwrap();
    let error = Scene::load(&file).unwrap_err().to_string();
    assert!(error.contains("vertex_color_space"), "{error}");
}

#[test]
fn what_a_scene_does_not_do_of_its_meshes_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let faces = vec![[0, 1, 2]];
    let one = vec![[0; 3]];
    let triangle = Geometry {
        name: String::new(),
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        offset: DVec3::ZERO,
        faces: faces.clone(),
        colors: None,
        coordinates: Some(Indexed { rows: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], faces }),
        normals: Some(Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: one.clone() }),
        tangents: Some(Indexed { rows: vec![[1.0, 0.0, 0.0, 1.0]], faces: one }),
        submeshes: vec![Submesh { material: Some(0), faces: 0..1 }],
    };
    let notes = |geometry: Geometry, rest: &str| {
        let material = MaterialFile {
            normal_map: MaterialMap::new(0, Borders::default()),
            ..MaterialFile::default()
        };
        let placed = Placed { name: String::new(), geometry: 0, transform: DMat4::IDENTITY };
        let model = Model {
            geometries: vec![geometry],
            materials: vec![material],
            images: vec![picture(false)],
            placed: vec![placed],
            notes: vec![],
        };
        fs::write(folder.path().join("a.glb"), glb(&model).unwrap()).unwrap();
        load(folder.path(), &format!("[[meshes]]\nfile = \"a.glb\"\n{rest}")).notes
    };
    let light = "[[lights]]\nkind = \"ambient\"\ncolor = [1, 1, 1]\n";
    assert_eq!(notes(triangle.clone(), light), Vec::<String>::new());
    let learnt = format!("{light}[learn.vertices]\n");
    let rebuilt =
        "a: its vertices are learnt, so tangents follow from its coordinates, not from its file";
    assert_eq!(notes(triangle.clone(), &learnt), [rebuilt]);
    assert_eq!(notes(triangle.clone(), &format!("{learnt}meshes = []\n")), Vec::<String>::new());
    let bare = Geometry { coordinates: None, ..triangle.clone() };
    let without = "a: images of its material were left out, as it has no texture coordinates";
    assert_eq!(notes(bare, light), [without]);
    let flat = Geometry { normals: None, tangents: None, ..triangle };
    let smooth = "a: its file has no normals: they are smooth, where glTF has flat ones";
    assert_eq!(notes(flat.clone(), light), [smooth]);
    assert_eq!(notes(flat, ""), Vec::<String>::new(), "nothing is lit");
}

/// A ball of two materials, by the side of each face, as an OBJ beside `m.mtl`; its faces, those of the first
/// material first.
fn two_halves(folder: &Path) -> Vec<[u32; 3]> {
    let scene = load(folder, "[[meshes]]\nshape = \"sphere\"\nfaces = 300\n");
    let object = &scene.objects[0];
    let point = |vertex: u32| &object.positions.data()[3 * vertex as usize..][..3];
    let is_left = |face: &[u32; 3]| face.iter().map(|&vertex| point(vertex)[0]).sum::<f32>() < 0.0;
    let mut faces = object.mesh.faces().to_vec();
    faces.sort_by_key(|face| !is_left(face));
    let mut text = "mtllib m.mtl\n".to_owned();
    for row in object.positions.data().chunks_exact(3) {
        text.push_str(&format!("v {} {} {}\n", row[0], row[1], row[2]));
    }
    for (name, is_of) in [("a", true), ("b", false)] {
        text.push_str(&format!("usemtl {name}\n"));
        for face in faces.iter().filter(|face| is_left(face) == is_of) {
            let [a, b, c] = face.map(|vertex| vertex + 1);
            text.push_str(&format!("f {a} {b} {c}\n"));
        }
    }
    fs::write(folder.join("two.obj"), &text).unwrap();
    let one: String = text
        .lines()
        .filter(|line| !line.starts_with("usemtl"))
        .fold(String::new(), |text, line| text + line + "\n");
    fs::write(folder.join("one.obj"), one).unwrap();
    faces
}

const VIEW: &str =
    "[[views]]\nimage = \"a.png\"\ncamera = { position = [0.5, 0.4, 4], angle = 40 }\n";

#[test]
fn a_surface_of_several_materials_is_learnt_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let faces = two_halves(folder);
    fs::write(folder.join("m.mtl"), "newmtl a\nKd .5 .5 .5\nnewmtl b\nKd .5 .5 .5\n").unwrap();
    let fitted = |file: &str, learn: &str| {
        let mut fit = SceneFit::new(load(
            folder,
            &format!(
                "[[meshes]]\nfile = \"{file}.obj\"\nname = \"ball\"\n{VIEW}[[lights]]\nkind = \"directional\"\n\
                 direction = [1, 2, 3]\ncolor = [2, 2, 2]\n[learn.vertices]\nsmoothing = 10.0\n\
                 rigid = 0.1\nlaplacian = 0.1\n{learn}[stop]\nsteps = 5\n"
            ),
        ))
        .unwrap();
        while fit.step().unwrap().is_some() {}
        fit
    };
    // With the same materials it is the mesh of one: the same vertices, and regularizers across the border.
    let [one, two] = ["one", "two"].map(|file| fitted(file, ""));
    let [a, b] = [&one, &two].map(|fit| value(fit, "vertices/ball"));
    let off = |a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(off(&a, &b) < 1e-5, "{}", off(&a, &b));
    assert!(off(&a, one.scene().objects[0].positions.data()) > 1e-3);
    // Each material keeps what is learnt of it, by its own name.
    let both = fitted("two", "[learn.texture]\n[learn.roughness]\nmeshes = [\"ball/b\"]\n");
    let names: Vec<_> =
        both.parameters().iter().map(|parameter| parameter.name().to_owned()).collect();
    let expected = ["vertices/ball", "texture/ball/a", "texture/ball/b", "roughness/ball/b"];
    assert_eq!(names, expected);
    let [left, right] = ["texture/ball/a", "texture/ball/b"].map(|name| value(&both, name));
    assert_ne!(left, right);
    let learnt = both.learnt().unwrap();
    let materials = &learnt.objects[0].materials;
    assert_eq!(
        [&materials[0].base_color[..], &materials[1].base_color[..]],
        [&left[..], &right[..]]
    );
    // What is written has them, and one set of vertices.
    let out = folder.join("out");
    learnt.save_results(&out).unwrap();
    let out = Folder::new(&out).unwrap();
    for file in ["mesh.glb", "ball.ply"] {
        let model = read_model(&out, file).unwrap();
        let [mesh] = &model.geometries[..] else { panic!("{file}: {}", model.geometries.len()) };
        assert_eq!((mesh.faces.as_slice(), mesh.submeshes.len()), (faces.as_slice(), 2), "{file}");
        for (submesh, expected) in mesh.submeshes.iter().zip([&left, &right]) {
            let found = model.materials[submesh.material.unwrap()].base_color;
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 5e-3, "{file}: {found} {expected}");
            }
        }
    }
    let text =
        format!("[[meshes]]\nfile = \"two.obj\"\n{VIEW}[learn.texture]\nmeshes = [\"two/c\"]\n");
    let error = SceneFit::new(load(folder, &text)).err().unwrap().to_string();
    assert!(error.contains("are among two, two/a, two/b, and \"two/c\" is not"), "{error}");
}

#[test]
fn a_texture_that_is_learnt_is_one_that_was_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    two_halves(folder);
    png(folder);
    let text = fs::read_to_string(folder.join("one.obj")).unwrap() + "vt 0 0\n";
    let text = text.replacen("\nv ", "\nusemtl a\nv ", 1);
    let with_places = |line: &str| match line.strip_prefix("f ") {
        Some(corners) => corners.split(' ').fold("f".to_owned(), |all, k| all + &format!(" {k}/1")),
        None => line.to_owned(),
    };
    let text = text.lines().map(with_places).collect::<Vec<_>>().join("\n");
    fs::write(folder.join("a.obj"), text).unwrap();
    fs::write(folder.join("a.tga"), [0; 18]).unwrap();
    for (file, note) in [("a.tga", "can't be read"), ("b.png", "is missing")] {
        fs::write(folder.join("m.mtl"), format!("newmtl a\nmap_Kd {file}\n")).unwrap();
        let mesh = format!("{VIEW}[[meshes]]\nfile = \"a.obj\"\n");
        let scene = load(folder, &format!("{mesh}[learn.vertices]\n"));
        assert!(scene.notes.iter().any(|keys| keys.contains(note)), "{:?}", scene.notes);
        assert!(SceneFit::new(scene).is_ok());
        let error = SceneFit::new(load(folder, &format!("{mesh}[learn.texture]\n")));
        let error = error.err().unwrap().to_string();
        assert!(error.contains("`learn.texture` learns is there, and of \"a\""), "{error}");
        let keys = format!("{mesh}material = {{ texture_size = 4 }}\n[learn.texture]\n");
        assert!(SceneFit::new(load(folder, &keys)).is_ok());
        fs::write(folder.join("m.mtl"), format!("newmtl a\nmap_Pm {file}\n")).unwrap();
        let error = SceneFit::new(load(folder, &format!("{mesh}[learn.roughness]\n")));
        let error = error.err().unwrap().to_string();
        assert!(error.contains("`learn.roughness` learns is there"), "{error}");
    }
}

#[test]
fn a_scene_far_from_the_origin_is_drawn_and_learnt_as_one_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let offset = DVec3::new(500_000.0, 4_649_776.0, 100.0);
    let fitted = |file: &str, at: DVec3| {
        sphere_at(folder, file, at);
        let place = |keys: [f64; 3]| format!("{:?}", (DVec3::from(keys) + at).to_array());
        let (eye, target) = (place([0.5, 0.4, 4.0]), place([0.0; 3]));
        let lamp = place([2.0, 1.0, 3.0]);
        let mut fit = SceneFit::new(load(
            folder,
            &format!(
                "[[meshes]]\nfile = \"{file}\"\nname = \"ball\"\n[[views]]\nimage = \"a.png\"\n\
                 camera = {{ position = {eye}, target = {target}, angle = 40 }}\n[[lights]]\n\
                 kind = \"point\"\nposition = {lamp}\ncolor = [30, 30, 30]\n[learn.vertices]\n\
                 [learn.pose]\n[learn.cameras]\n[stop]\nsteps = 3\n"
            ),
        ))
        .unwrap();
        let mut images = vec![fit.seen(0).unwrap().image];
        while fit.step().unwrap().is_some() {}
        images.push(fit.seen(0).unwrap().image);
        // Put back, it is the same scene once more.
        let again = SceneFit::new(fit.learnt().unwrap()).unwrap();
        images.push(again.seen(0).unwrap().image);
        (images, value(&fit, "vertices/ball"))
    };
    let (near, far) = (fitted("near.obj", DVec3::ZERO), fitted("far.obj", offset));
    assert!(furthest(&near.0[0], &near.0[1]) > 1e-3);
    for (near, far) in near.0.iter().zip(&far.0) {
        assert!(furthest(near, far) < 1e-4, "{}", furthest(near, far));
    }
    assert!(furthest(&far.0[1], &far.0[2]) < 1e-4);
    let off = near.1.iter().zip(&far.1).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 1e-4, "{off}");
}
