//! What views are compared with, and what counts of the difference.

use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_scene::{Location, Picture, Samples, Scene, SceneFit};

use super::fixtures::{SIZE, furthest, load, picture, png};

#[test]
fn images_with_opacity_stand_before_the_background() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let exr = picture(true).encode_exr(&Location::new("b.exr")).unwrap();
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
        let target = fit.compare(view).unwrap().target.unwrap();
        assert!(furthest(&target, &expected) < 1e-5, "{view}");
    }
}

#[test]
fn a_mask_of_its_own_goes_before_the_opacity_of_the_image() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let [width, height] = SIZE;
    let white =
        Picture { width, height, channels: 1, samples: Samples::U8(vec![255; width * height]) };
    let bytes = white.encode_png(&Location::new("m.png")).unwrap();
    fs::write(folder.path().join("m.png"), bytes).unwrap();
    let text = "[[meshes]]\nshape = \"sphere\"\nmaterial = { base_color = [1, 1, 1] }\n\
        [[views]]\nimage = \"a.png\"\nmask = \"m.png\"\ncamera = { position = [0, 0, 6], angle = 40 }\n\
        [pipeline]\ntone = \"linear\"\n[learn.texture]\n";
    let seen = SceneFit::new(load(folder.path(), text)).unwrap().compare(0).unwrap();
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
    write("images/b.exr", &picture(true).encode_exr(&Location::new("b.exr")).unwrap());
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
        picture.encode_exr(&Location::new("sky.exr")).unwrap()
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
