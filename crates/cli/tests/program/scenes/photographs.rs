//! Photographs and masks as people have them: in folders, turned, in formats that are not read.

use jpeg_encoder::{ColorType, Encoder};

use super::*;

/// A JPEG of 32 x 16 pixels, dark on the left, whose Exif data say this orientation.
fn turned(orientation: u8) -> Vec<u8> {
    let pixels: Vec<u8> = (0..32 * 16).map(|k| if k % 32 < 16 { 20 } else { 230 }).collect();
    let mut plain = Vec::new();
    Encoder::new(&mut plain, 95).encode(&pixels, 32, 16, ColorType::Luma).unwrap();
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    let length = u16::try_from(exif.len() + 2).unwrap().to_be_bytes();
    [&plain[..2], &[0xff, 0xe1], &length, &exif, &plain[2..]].concat()
}

/// A gray image whose pixels are this inside the middle half of its columns, and 0 elsewhere.
fn gray(width: usize, height: usize, inside: u8) -> Vec<u8> {
    let sample =
        |k: usize| if (width / 4..width * 3 / 4).contains(&(k % width)) { inside } else { 0 };
    let samples = Samples::U8((0..width * height).map(sample).collect());
    Picture { width, height, channels: 1, samples }.encode_png(&Location::new("gray")).unwrap()
}

fn views(folder: &Path, scene: &str) -> Vec<(String, String)> {
    let views = Scene::load(folder.join(scene)).unwrap().views;
    views
        .iter()
        .map(|view| (view.name.clone(), view.image.as_ref().unwrap().display().to_string()))
        .collect()
}

#[test]
fn images_that_are_not_read_are_counted_with_a_command() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "photos/a.png", disk(32, 32, 3));
    for name in ["b.heic", "c.WEBP", "d.bmp", "e.bmp", "f.tif", ".hidden.bmp", "notes.txt"] {
        write(folder, &format!("photos/{name}"), "x");
    }
    let told = said(folder, &["new", "a", "--images", "photos"]);
    let note = "note: 5 images left out, 2 .bmp, 1 .heic, 1 .tif, 1 .webp: images are PNG, JPEG, EXR or HDR; \
        ImageMagick makes PNGs: magick mogrify -format png photos/*.WEBP photos/*.bmp photos/*.heic ";
    assert!(told.contains(note), "{told}");
    // Of nothing but such images there is no scene, and it is said why.
    write(folder, "raw/a.NEF", "x");
    let [_, error] = ended(folder, &["new", "b", "--images", "raw"], 1);
    let rule = "and this has none; 1 image left out, 1 .nef: images are PNG, JPEG, EXR or HDR; a camera's raw";
    assert!(error.contains(rule), "{error}");
}

#[test]
fn images_of_one_stem_and_of_several_folders_are_views_of_their_own() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "photos/a.png", disk(32, 32, 3));
    write(folder, "photos/a.jpg", turned(1));
    write(folder, "photos/front/b.png", disk(32, 32, 3));
    write(folder, "photos/masks/a.png", gray(32, 32, 255));
    said(folder, &["new", "a", "--images", "photos"]);
    let own = |name: &str, image: &str| (name.to_owned(), format!("images/{image}"));
    let expected = [
        own("images-a-jpg", "a.jpg"),
        own("images-a-png", "a.png"),
        own("images-front-b-png", "front/b.png"),
    ];
    assert_eq!(views(folder, "a/scene.toml"), expected);
    // Names that are their own stay short.
    fs::remove_file(folder.join("photos/a.jpg")).unwrap();
    said(folder, &["new", "b", "--images", "photos"]);
    assert_eq!(views(folder, "b/scene.toml"), [own("a", "a.png"), own("b", "front/b.png")]);
}

#[test]
fn a_photograph_without_a_camera_is_written_upright() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "photos/a.jpg", turned(1));
    write(folder, "photos/b.jpg", turned(6));
    let told = said(folder, &["new", "a", "--images", "photos"]);
    assert!(told.contains("note: images were turned as viewers show them"), "{told}");
    assert!(told.contains("copied as PNG: b.jpg\n"), "{told}");
    let expected = [("a", "images/a.jpg"), ("b-upright", "images/b-upright.png")];
    let expected = expected.map(|(name, image)| (name.to_owned(), image.to_owned()));
    assert_eq!(views(folder, "a/scene.toml"), expected);
    let scene = Scene::load(folder.join("a/scene.toml")).unwrap();
    let size = scene.views[1].camera.size;
    assert_eq!([size.width, size.height], [16, 32]);
    let upright = Picture::read(&scene.folder, "images/b-upright.png").unwrap();
    let gray = upright.channel(0).unwrap();
    assert!(gray[[4, 8]] < 0.1 && gray[[28, 8]] > 0.8);
    assert!(!folder.join("a/images/b.jpg").exists());
    // Once more into the same folder: what is there is the same.
    fs::remove_file(folder.join("a/scene.toml")).unwrap();
    said(folder, &["new", "a", "--images", "photos"]);
}

#[test]
fn cameras_of_other_programs_are_those_of_the_pixels_as_they_are_stored() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(
        folder,
        "sparse/0/cameras.txt",
        "1 PINHOLE 32 16 40 40 16 8\n2 PINHOLE 16 32 40 40 8 16\n",
    );
    let shots = "1 1 0 0 0 0 0 4 1 a.jpg\n\n2 0.7 0 0.7 0 0 0 4 2 b.jpg\n\n";
    write(folder, "sparse/0/images.txt", shots);
    write(folder, "sparse/0/points3D.txt", "");
    write(folder, "images/a.jpg", turned(3));
    write(folder, "images/b.jpg", turned(6));
    write(folder, "images/c.jpg", turned(1));
    let text = "[[meshes]]\nshape = \"sphere\"\n[cameras]\ncolmap = \"sparse/0\"\n";
    write(folder, "scene.toml", text);
    let [told, _] = ended(folder, &["inspect", "scene.toml"], 1);
    for rule in [
        "note: images/a.jpg: viewers turn it by a half, as its Exif data say",
        "problem: images/b.jpg: an image has the size of its camera, 16 x 32, and this is 32 x 16; viewers turn \
         it by a quarter to the right, as its Exif data say",
    ] {
        assert!(told.contains(rule), "{rule}: {told}");
    }
    // Of images that have cameras none is turned, and one without is named.
    let told = said(folder, &["new", "a", "--images", "."]);
    assert!(told.contains("note: images without a camera were left out: images/c.jpg\n"), "{told}");
    assert!(!told.contains("were turned"), "{told}");
    assert_eq!(fs::read(folder.join("a/images/a.jpg")).unwrap(), turned(3));
}

#[test]
fn what_masks_mean_is_told_and_one_for_two_views_is_a_problem() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]);
    let names = ["front/1.png", "back/1.png", "side/2.png"];
    let frames: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(k, name)| {
            write(folder, &format!("images/{name}"), disk(32, 32, 3));
            json!({ "file_path": format!("images/{name}"), "transform_matrix": pose(k as f64) })
        })
        .collect();
    write(folder, "transforms.json", json!({ "fl_x": 40, "frames": frames }).to_string());
    write(folder, "masks/1.png", gray(32, 32, 1));
    write(folder, "masks/side/2.png.png", gray(32, 32, 255));
    let text = "[[meshes]]\nshape = \"sphere\"\n[cameras]\ntransforms = \"transforms.json\"\n\
        masks = \"masks\"\n[learn.texture]\n";
    write(folder, "scene.toml", text);
    let [told, _] = ended(folder, &["inspect", "scene.toml", "--json", "a.json"], 1);
    assert!(told.contains("  at least      50 % of pixels are the object, in "), "{told}");
    assert!(told.contains("  they say by   two values (3)\n"), "{told}");
    let rule =
        "problem: view \"images-back-1\": it has the mask of \"images-front-1\", masks/1.png\n";
    assert!(told.contains(rule), "{told}");
    let json: Value = serde_json::from_slice(&fs::read(folder.join("a.json")).unwrap()).unwrap();
    assert_eq!(json["views"][2]["mask"], "masks/side/2.png.png");
    assert_eq!(json["views"][0]["mask_share"], 0.5);
    // In a tree like that of the images each has its own, and `new` takes them.
    write(folder, "masks/front/1.png", gray(32, 32, 255));
    write(folder, "masks/back/1.png", gray(32, 32, 128));
    let told = said(folder, &["inspect", "scene.toml"]);
    assert!(told.contains("  they say by   two values (3)\n"), "{told}");
    let told = said(folder, &["new", "a", "--images", "."]);
    assert!(told.contains("masks    a file for each image"), "{told}");
    let fit = step(folder, "a/scene.toml");
    assert_eq!(fit.scene().views[1].mask.as_deref(), Some(Path::new("masks/back/1.png")));
    // A photograph in place of a mask is refused, by the program as by a fit.
    write(folder, "masks/back/1.png", disk(16, 16, 1));
    let [told, _] = ended(folder, &["inspect", "scene.toml"], 1);
    assert!(told.contains("masks/back/1.png: an image has the size of its camera"), "{told}");
}

#[test]
fn masks_that_a_file_of_cameras_names_are_taken() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]);
    let frames: Vec<_> = (0..2)
        .map(|k| {
            write(folder, &format!("in/images/{k}.png"), disk(32, 32, 3));
            write(folder, &format!("in/cut/{k}.png"), gray(32, 32, 255));
            let (file, mask) = (format!("images/{k}.png"), format!("./cut/{k}.png"));
            json!({ "file_path": file, "mask_path": mask, "transform_matrix": pose(k as f64) })
        })
        .collect();
    write(folder, "in/transforms.json", json!({ "fl_x": 40, "frames": frames }).to_string());
    let told = said(folder, &["inspect", "in/transforms.json"]);
    assert!(told.contains("  views         2\n  masks         2\n"), "{told}");
    let told = said(folder, &["new", "a", "--images", "in"]);
    assert!(told.contains("masks    a file for each image"), "{told}");
    assert!(
        told.contains("note: the masks that `mask_path` names, 2, show where objects are"),
        "{told}"
    );
    let fit = step(folder, "a/scene.toml");
    assert_eq!(fit.scene().views[1].mask.as_deref(), Some(Path::new("cut/1.png")));
    assert_eq!(fit.scene().description.loss.silhouette.unwrap().0, 1.0);
    // Written with the cameras, and read again.
    fs::create_dir(folder.join("a/out")).unwrap();
    fit.scene().save_results(folder.join("a/out")).unwrap();
    let text = fs::read_to_string(folder.join("a/out/transforms.json")).unwrap();
    assert!(text.contains("\"mask_path\": \"../cut/1.png\""), "{text}");
    fs::remove_file(folder.join("in/cut/1.png")).unwrap();
    let [told, _] = ended(folder, &["inspect", "in/transforms.json"], 1);
    assert!(told.contains("problem: in/cut/1.png could not be read"), "{told}");
}

#[test]
fn opacity_that_tells_nothing_is_no_mask() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let opaque =
        Samples::U8((0..32 * 32 * 4).map(|k| if k % 4 == 3 { 255 } else { k as u8 }).collect());
    let opaque = Picture { width: 32, height: 32, channels: 4, samples: opaque };
    write(folder, "photos/a.png", opaque.encode_png(&Location::new("a")).unwrap());
    let told = said(folder, &["new", "a", "--images", "photos"]);
    assert!(told.contains("note: the opacity of the images is the same everywhere"), "{told}");
    let scene = fs::read_to_string(folder.join("a/scene.toml")).unwrap();
    assert!(scene.contains("\n# silhouette = 1.0\n"), "{scene}");
    write(folder, "a/scene.toml", scene.replace("\n# silhouette", "\nsilhouette"));
    let [told, _] = ended(folder, &["inspect", "a/scene.toml"], 1);
    let rule = "images/a.png: a mask tells objects from background, and this has no background";
    assert!(told.contains(rule), "{told}");
}

#[test]
fn pictures_are_encoded_once() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let photo = Samples::U8((0..24 * 24 * 3).map(|k| (k * 29 % 256) as u8).collect());
    let photo = Picture { width: 24, height: 24, channels: 3, samples: photo };
    write(folder, "p.png", photo.encode_png(&Location::new("p")).unwrap());
    for tone in ["srgb", "linear"] {
        // A wall that fills the view. 188, 124 and 64 are 0.5029, 0.202 and 0.0513 of the light.
        let text = format!(
            "[[meshes]]\nshape = \"plane\"\nmaterial = {{ base_color = [0.5029, 0.202, 0.0513] }}\n\
             [[views]]\nimage = \"p.png\"\ncamera = {{ position = [0, 0, 1], angle = 40 }}\n\
             [pipeline]\ntone = \"{tone}\"\n[learn.texture]\nrate = 1e-6\n[stop]\nsteps = 1\n"
        );
        write(folder, "scene.toml", text);
        said(folder, &["render", "scene.toml", "--out", "drawn"]);
        run(PROGRAM, folder, &["fit", "scene.toml", "--out", "out"]);
        let read = |name: &str| Picture::read(&Folder::new(folder).unwrap(), name).unwrap();
        assert_eq!(read("out/views/p-target.png"), photo, "{tone}");
        for name in ["drawn/p.png", "out/views/p-result.png"] {
            let Samples::U8(samples) = read(name).samples else { panic!("bytes") };
            let off = samples.iter().enumerate().map(|(k, &x)| x.abs_diff([188, 124, 64][k % 3]));
            assert!(off.max() <= Some(1), "{tone} {name}: {:?}", &samples[..3]);
        }
    }
}
