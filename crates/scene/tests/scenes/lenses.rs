//! Lenses of scenes: drawn, learnt, and where edges should be bent.

use std::fs;

use bokashi_scene::{Scene, SceneFit, most_bent_edges};

use super::fits::{balls_and_eye, paint, two_balls};
use super::fixtures::{drawn, furthest, load, png};
use super::rays::through_lens;

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
        let first = fit.compare(0).unwrap().image;
        while fit.step().unwrap().is_some() {}
        let last = fit.compare(0).unwrap().image;
        let learnt = fit.learnt().unwrap();
        let coefficients = learnt.views[1].camera.distortion;
        assert!(
            coefficients.coefficients().iter().all(|&coefficient| coefficient != 0.0),
            "{coefficients:?}"
        );
        let again = SceneFit::new(learnt).unwrap().compare(0).unwrap().image;
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

#[test]
fn a_thin_lens_sees_what_rays_through_its_points_see() {
    let folder = tempfile::tempdir().unwrap();
    let (balls, eye) = balls_and_eye();
    for (radius, focus) in [(0.14, 3.4), (0.2, 2.6), (0.1, 5.0)] {
        let truth = through_lens(&balls, &eye, radius, focus);
        let off = |lens: &str| {
            let pipeline = format!("[pipeline]\ntone = \"linear\"\ncull = \"back\"\n{lens}");
            let mut scene = two_balls(folder.path(), &truth, &pipeline);
            paint(&mut scene, &balls);
            let image = drawn(scene);
            let squares = image.data().iter().zip(truth.data()).map(|(a, b)| (a - b).powi(2));
            (squares.sum::<f32>() / truth.size() as f32).sqrt()
        };
        let aperture = eye.focal_length() * radius / focus;
        let sharp = off("");
        let found = [("radius", radius), ("aperture", aperture)].map(|(key, number)| {
            off(&format!("lens = {{ {key} = {number:?}, focus = {focus:?} }}\n"))
        });
        let leaning =
            format!("lens = {{ radius = {radius:?}, focus = {focus:?}, slopes = true }}\n");
        let leaning = off(&leaning);
        println!("radius {radius}, focus {focus}: {found:?}, {leaning}, without a lens {sharp}");
        assert!(found.iter().all(|off| *off < 0.01), "{found:?}");
        // Balls lean everywhere.
        assert!(leaning < 0.95 * found[0], "{leaning} {found:?}");
        assert!(sharp > 4.0 * found[0], "{sharp}");
    }
}

/// A board in front of the eye, and what a scene says besides.
fn board(rest: &str) -> String {
    format!(
        "[[meshes]]\nshape = \"plane\"\n[[views]]\nname = \"v\"\n\
         camera = {{ size = [32, 24], angle = 40, position = [0.5, 0, 4] }}\n{rest}"
    )
}

#[test]
fn a_lens_that_is_closed_costs_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let image = |rest: &str| drawn(load(folder.path(), &board(rest)));
    let plain = image("");
    assert_eq!(image("[pipeline]\nlens = { aperture = 0, focus = 2 }\n"), plain);
    let own = "lens = { radius = 0 }\n[pipeline]\nlens = { radius = 0.2, focus = 2 }\n";
    assert_eq!(image(own), plain);
    assert_ne!(image("[pipeline]\nlens = { radius = 0.2, focus = 2 }\n"), plain);
}

/// A speck in front of the focus has the form of the iris, and behind it that of the iris upside down.
#[test]
fn a_speck_out_of_focus_has_the_form_of_the_iris() {
    let folder = tempfile::tempdir().unwrap();
    let reach = |aperture: f64, focus: f64, iris: &str| {
        let text = format!(
            "[[meshes]]\nshape = \"plane\"\nplace = {{ scale = 0.02 }}\n\
             [[views]]\nname = \"v\"\ncamera = {{ size = [81, 81], focal = 80, position = [0, 0, 4] }}\n\
             [pipeline]\ntone = \"linear\"\nlens = {{ aperture = {aperture:?}, focus = {focus:?}{iris} }}\n"
        );
        let image = drawn(load(folder.path(), &text));
        // How far light goes from the middle: to the left, the right, the top, the bottom.
        [(0, -1), (0, 1), (-1, 0), (1, 0)].map(|(down, right): (isize, isize)| {
            let lit = |k: &isize| {
                let [row, column] = [40 + k * down, 40 + k * right].map(|at| at as usize);
                image.data()[3 * (81 * row + column)] > 4e-4
            };
            (0..40).take_while(lit).count()
        })
    };
    let disc = reach(20.0, 2.0, "");
    assert!(disc.iter().all(|&reach| (9..=12).contains(&reach)), "{disc:?}");
    // A triangle with the variance of the disc reaches sqrt 2 of its radius at corners, and half of that at sides.
    let is_corner =
        |corner: usize, side: usize| (12..=16).contains(&corner) && (6..=9).contains(&side);
    let turned = ", iris = { blades = 3, rotation = 90 }";
    let [left, right, ..] = reach(10.0, 8.0, ", iris = { blades = 3 }");
    assert!(is_corner(right, left), "{left} {right}");
    let [.., top, bottom] = reach(10.0, 8.0, turned);
    assert!(is_corner(bottom, top), "{top} {bottom}");
    let [.., top, bottom] = reach(20.0, 2.0, turned);
    assert!(is_corner(top, bottom), "{top} {bottom}");
}

#[test]
fn what_a_lens_can_not_draw_or_learn_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    let said = |rest: &str| {
        fs::write(&file, board(rest)).unwrap();
        Scene::load(&file).err().map_or_else(|| "fine".to_owned(), |error| error.to_string())
    };
    let lens = "[pipeline.lens]\nradius = 0.1\nfocus = 2\n";
    assert_eq!(said(&format!("lens = {{ radius = 0.2, focus = 3 }}\n{lens}")), "fine");
    for (rest, expected) in [
        (
            format!("[pipeline]\nsilhouettes = \"antialias\"\n{lens}"),
            "are \"exact\" or \"aliased\"",
        ),
        ("lens = { focus = 3 }\n".to_owned(), "where `pipeline.lens` is there"),
        (format!("lens = {{ aperture = 3 }}\n{lens}"), "`radius`, and this has `aperture`"),
    ] {
        let said = said(&rest);
        assert!(said.contains(expected), "{rest}: {said}");
    }
    png(folder.path());
    let refused = |rest: &str| {
        let text = board(rest)
            .replace("name = \"v\"", "image = \"a.png\"")
            .replace("size = [32, 24], ", "");
        SceneFit::new(load(folder.path(), &text)).err().map(|error| error.to_string())
    };
    let learnt = |keys: &str| format!("[learn.lens]\n{keys}\n");
    assert_eq!(refused(&(lens.to_owned() + &learnt("per_view = [\"focus\"]"))), None);
    for (rest, expected) in [
        (learnt(""), "a lens that is learnt is in the pipeline"),
        (
            lens.to_owned() + &learnt("per_view = [\"aperture\"]"),
            "lists what the lens has, and that is \"radius\" and \"focus\"",
        ),
        (lens.replace("0.1", "0") + &learnt(""), "a `radius` that is learnt is above 0"),
    ] {
        let message = refused(&rest).unwrap_or_default();
        assert!(message.contains(expected), "{rest}: {message}");
    }
}
