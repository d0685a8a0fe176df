//! What a scene leaves behind: its objects, textures, cameras and numbers as files that other programs read.
//! They are checked before the work that makes them.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use bokashi_core::Tensor;
use glam::DMat4;
use serde_json::{Map, Value, json};

use crate::cameras::transforms_json;
use crate::description::{Description, LightPlace, Tone, ViewLens};
use crate::environment::panorama_from_cube;
use crate::error::{Location, SceneError};
use crate::file::{check_results, unwritten, write_result};
use crate::mesh::{ObjFiles, glb, is_word, obj, ply};
use crate::model::Model;
use crate::object::{Object, SurfaceMaterial};
use crate::picture::{ColorSpace, Picture};
use crate::scene::Scene;
use crate::scene_view::SceneView;
use crate::summary::named_files;

/// The file of the environment's faces, and that of its panorama.
const FACES: &str = "environment.exr";
const PANORAMA: &str = "environment-panorama.exr";
/// What the files of all meshes together are called, without their endings.
const MESH: &str = "mesh";

impl Scene {
    /// Writes the scene's objects to `mesh.glb`, to `mesh.obj` with its MTL, and to a PLY file each, all of them in
    /// the world, and textures to a PNG each. A PLY has its object once for each of its places. Cameras go to
    /// `transforms.json`, the environment to `environment.exr`, its six faces, and as a panorama to
    /// `environment-panorama.exr`, and all other numbers to `numbers.json`. All of them lie in the folder `out`,
    /// which is made where it is missing. Paths of images start at `out`. Each file is written whole or not at all.
    ///
    /// # Errors
    /// [`SceneError::Write`] where the file system refuses; [`SceneError::Content`] for what a format can't
    /// hold.
    pub fn save_results(&self, out: impl AsRef<Path>) -> Result<Vec<PathBuf>, SceneError> {
        let out = out.as_ref();
        fs::create_dir_all(out)
            .map_err(|error| SceneError::Write { path: out.to_owned(), error })?;
        let mut written = Vec::new();
        let mut write = |name: &str, bytes: &[u8]| {
            written.push(write_result(out, name, bytes)?);
            Ok::<_, SceneError>(())
        };
        self.write_meshes(&mut write)?;
        let mut cameras = self.cameras();
        let way = self.folder.seen_from(out)?;
        for view in &mut cameras {
            view.image = way.join(&view.image);
            view.mask = view.mask.take().map(|mask| way.join(mask));
        }
        if !cameras.is_empty() {
            write("transforms.json", transforms_json(&cameras).as_bytes())?;
        }
        if let Some(texels) = &self.environment {
            let [side, all] = [texels.shape()[1], texels.data().len()];
            let faces = Tensor::from_flat_fn([all / (3 * side), side, 3], |k| texels.data()[k]);
            for (name, image) in [(FACES, faces), (PANORAMA, panorama_from_cube(texels)?)] {
                let bytes = Picture::from_numbers(&image)?.encode_exr(&Location::new(name))?;
                write(name, &bytes)?;
            }
        }
        let numbers = serde_json::to_string_pretty(&self.numbers()).unwrap_or_default();
        write("numbers.json", format!("{numbers}\n").as_bytes())?;
        Ok(written)
    }

    /// Meshes and textures.
    fn write_meshes(
        &self,
        write: &mut impl FnMut(&str, &[u8]) -> Result<(), SceneError>,
    ) -> Result<(), SceneError> {
        let model = self.model()?;
        if !model.geometries.is_empty() {
            write("mesh.glb", &glb(&model)?)?;
            let files = self.texture_names(&model);
            let image = |image| files.get(&image).cloned();
            let ObjFiles { obj, mtl, images } = obj(&model, MESH, image)?;
            write("mesh.obj", obj.as_bytes())?;
            write("mesh.mtl", mtl.as_bytes())?;
            images.iter().try_for_each(|(name, bytes)| write(name, bytes))?;
            for (geometry, places) in model.geometries.iter().zip(model.places()) {
                // Without a place it is not in the world.
                if !places.is_empty() {
                    let bytes = ply(geometry, &places, &model.materials, image)?;
                    write(&format!("{}.ply", geometry.name), &bytes)?;
                }
            }
        }
        for (name, texels) in self.textures() {
            write(&name, &texture_png(texels, &name)?)?;
        }
        Ok(())
    }

    /// The names of all files that [`Scene::save_results`] may write, to be checked before a fit.
    pub fn result_names(&self) -> Vec<PathBuf> {
        let meshes_of_all = ["mesh.glb", "mesh.obj", "mesh.mtl"];
        let usual = ["transforms.json", FACES, PANORAMA, "numbers.json"];
        let images = (1..=self.obj_image_count()).map(|number| format!("{MESH}-{number}.png"));
        let meshes = self.objects.iter().map(|object| format!("{}.ply", object.name));
        let textures = self.named_materials().filter(|(_, object, material)| {
            material.texture.texels.is_some() || self.awaits_texture(object)
        });
        let textures = textures.map(|(name, ..)| texture_name(&name));
        meshes_of_all
            .into_iter()
            .chain(usual)
            .map(String::from)
            .chain(images)
            .chain(meshes)
            .chain(textures)
            .map(PathBuf::from)
            .collect()
    }

    /// Materials with what their files are called after. Those of one name are one.
    fn named_materials(&self) -> impl Iterator<Item = (String, &Object, &SurfaceMaterial)> {
        let materials = self.objects.iter();
        let materials = materials
            .flat_map(|object| object.materials.iter().map(move |material| (object, material)));
        let mut seen = HashSet::new();
        materials.filter_map(move |(object, material)| {
            let name = object.material_name(material);
            seen.insert(name.clone()).then_some((name, object, material))
        })
    }

    /// Of each texture the name of its file, and its texels.
    fn textures(&self) -> impl Iterator<Item = (String, &Tensor<f32>)> {
        self.named_materials().filter_map(|(name, _, material)| {
            Some((texture_name(&name), material.texture.texels.as_ref()?))
        })
    }

    /// How many images the OBJ has that no other result is.
    fn obj_image_count(&self) -> usize {
        let counts = self.named_materials().map(|(name, object, material)| {
            let SurfaceMaterial { texture, roughness_metallic, normal_map, .. } = material;
            let has_texture = texture.texels.is_some() || self.awaits_texture(object);
            let is_own = has_texture && !is_word(&texture_name(&name));
            // Roughness and metallic are two.
            let gray = 2 * usize::from(roughness_metallic.texels.is_some());
            usize::from(is_own) + gray + usize::from(normal_map.texels.is_some())
        });
        counts.sum()
    }

    /// The names of the files of textures, by the numbers of their images in `model`, which is the scene's.
    fn texture_names(&self, model: &Model) -> HashMap<usize, String> {
        let images = model.materials.iter().filter_map(|material| material.base_color_map.image);
        images.zip(self.textures().map(|(name, _)| name)).collect()
    }

    /// Checks, before the work that makes them, that results can be written to these paths below the folder
    /// `out`. None takes the place of a file that the scene reads.
    ///
    /// # Errors
    /// [`SceneError::Write`] for the first that can't, for two results that would be one file, and for a file
    /// of the scene.
    pub fn check_results(
        &self,
        out: impl AsRef<Path>,
        paths: &[PathBuf],
    ) -> Result<(), SceneError> {
        let out = out.as_ref();
        check_results(out, paths)?;
        let there =
            paths.iter().filter_map(|path| Some((path, fs::canonicalize(out.join(path)).ok()?)));
        let there: Vec<_> = there.collect();
        if there.is_empty() {
            return Ok(());
        }
        let read = self.files();
        match there.iter().find(|(_, file)| read.contains(file)) {
            None => Ok(()),
            Some((path, _)) => {
                let rule = "a result has another place than a file that the scene reads";
                Err(unwritten(&out.join(path), io::Error::other(rule)))
            }
        }
    }

    /// The files that the scene reads, without links.
    fn files(&self) -> HashSet<PathBuf> {
        let Description { meshes, cameras, environment, .. } = &self.description;
        let meshes = || meshes.iter().map(|entry| entry.get_ref());
        let files = meshes().filter_map(|mesh| mesh.file.as_ref());
        let named = files.clone().flat_map(|file| {
            let parent = file.parent().unwrap_or(Path::new("")).to_owned();
            let named = named_files(&self.folder, file).unwrap_or_default();
            named.into_iter().map(move |name| parent.join(name))
        });
        let maps = meshes().flat_map(|mesh| [&mesh.material.texture, &mesh.material.normals]);
        let views = self.views.iter().flat_map(|view| [&view.image, &view.mask]);
        let cameras = cameras.iter().filter_map(|camera| camera.get_ref().transforms.as_ref());
        let environment = environment.iter().filter_map(|entry| entry.get_ref().image.as_ref());
        let name = self.path.file_name().map(PathBuf::from);
        let all =
            files.clone().chain(maps.chain(views).flatten()).chain(cameras).chain(environment);
        let all = all.cloned().chain(named).chain(name);
        all.filter_map(|file| self.folder.find(file).ok()).collect()
    }

    /// The numbers that no mesh or camera holds, by name.
    fn numbers(&self) -> Value {
        let pipeline = &self.description.pipeline;
        let mut numbers = Map::new();
        let mut add = |name: &str, number: Option<f64>| {
            if let Some(number) = number {
                numbers.insert(name.to_owned(), json!(number));
            }
        };
        add("exposure", pipeline.exposure.map(|stops| stops.0));
        add("blur", pipeline.blur.map(|sigma| sigma.0));
        if let Some(lens) = pipeline.lens {
            add(lens.opening.key(), Some(lens.opening.number()));
            add("focus", Some(lens.focus.0));
        }
        let exposures = self.views.iter().filter(|view| view.exposure != 0.0);
        let exposures: Map<_, _> =
            exposures.map(|view| (view.name.clone(), json!(view.exposure))).collect();
        if !exposures.is_empty() {
            numbers.insert("exposures".to_owned(), Value::Object(exposures));
        }
        let lenses = self.views.iter().filter(|view| view.lens != ViewLens::default());
        let lenses = lenses.map(|SceneView { name, lens, .. }| {
            let opening = lens.opening.map(|opening| (opening.key(), opening.number()));
            let numbers = opening.into_iter().chain(lens.focus.map(|focus| ("focus", focus.0)));
            (name.clone(), numbers.map(|(key, number)| (key.to_owned(), json!(number))).collect())
        });
        let lenses: Map<_, _> = lenses.collect();
        if !lenses.is_empty() {
            numbers.insert("lenses".to_owned(), Value::Object(lenses));
        }
        let lights = self.description.lights.iter().map(|light| match light.place() {
            None => json!({ "color": light.color() }),
            Some(LightPlace::Direction(direction)) => {
                json!({ "color": light.color(), "direction": direction.to_array() })
            }
            Some(LightPlace::Position(position)) => {
                json!({ "color": light.color(), "position": position.to_array() })
            }
        });
        numbers.insert("lights".to_owned(), lights.collect());
        let objects = self.objects.iter().map(|object| {
            let materials = object.materials.iter().map(|material| {
                let SurfaceMaterial { name, base_color, roughness, metallic, .. } = material;
                json!({
                    "name": name, "base_color": base_color, "roughness": roughness, "metallic": metallic
                })
            });
            // From the coordinates of its file.
            let back = DMat4::from_translation(-object.offset);
            let places = object.places.iter().map(|transform| rows(&(*transform * back)));
            let value = json!({
                "materials": materials.collect::<Value>(),
                "places": places.collect::<Value>(),
            });
            (object.name.clone(), value)
        });
        numbers.insert("objects".to_owned(), Value::Object(objects.collect()));
        Value::Object(numbers)
    }

    /// A picture of the renderer, `[H, W, 3]` as pixels stand for it, as a PNG.
    ///
    /// # Errors
    /// [`SceneError::Render`] for a tensor of another shape.
    pub fn png_of(&self, image: &Tensor<f32>) -> Result<Vec<u8>, SceneError> {
        let space = match self.description.pipeline.tone {
            // Encoded already.
            Tone::Srgb => ColorSpace::Linear,
            Tone::Linear => ColorSpace::Srgb,
        };
        Picture::from_color(image, space)?.encode_png(&Location::new("a picture"))
    }
}

/// What the file of a texture is called.
fn texture_name(material: &str) -> String {
    format!("{}-texture.png", material.replace('/', "-"))
}

/// Linear texels `[H, W, 3]` as a PNG of sRGB colours. `name` names it in errors.
///
/// # Errors
/// [`SceneError::Render`] for a tensor of another shape.
fn texture_png(texels: &Tensor<f32>, name: &str) -> Result<Vec<u8>, SceneError> {
    Picture::from_color(texels, ColorSpace::Srgb)?.encode_png(&Location::new(name))
}

/// The rows of a matrix.
fn rows(matrix: &DMat4) -> Value {
    let rows = matrix.transpose().to_cols_array_2d();
    rows.iter().map(|row| json!(row)).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::folder::Folder;
    use crate::mesh::read_model;
    use crate::model::Geometry;

    #[test]
    fn an_environment_is_read_again_as_it_was_written() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("scene.toml");
        fs::write(&file, "[environment]\ncolor = [1, 0.5, 3]\nsize = 8\n").unwrap();
        let mut scene = Scene::load(&file).unwrap();
        let texels = Tensor::from_flat_fn([6, 8, 8, 3], |k| 0.01 * k as f32);
        scene.environment = Some(texels.clone());
        let written = scene.save_results(directory.path()).unwrap();
        assert!(written.contains(&directory.path().join("environment.exr")));
        fs::write(&file, "[environment]\nimage = \"environment.exr\"\n").unwrap();
        assert_eq!(Scene::load(&file).unwrap().environment, Some(texels));
    }

    #[test]
    fn an_environment_is_read_again_from_its_panorama() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("scene.toml");
        // From 128 texels on a scene has to ask for so many.
        for (side, size) in [(8, ""), (64, ""), (128, "size = 128\n")] {
            fs::write(&file, format!("[environment]\ncolor = [1, 0.5, 3]\nsize = {side}\n"))
                .unwrap();
            let mut scene = Scene::load(&file).unwrap();
            let texels = scene.environment.as_mut().unwrap();
            // Brighter from face to face.
            let whole = texels.data().len();
            *texels = Tensor::from_flat_fn(texels.shape(), |k| 1.0 + (6 * k / whole) as f32);
            let texels = texels.clone();
            let written = scene.save_results(directory.path()).unwrap();
            assert!(written.contains(&directory.path().join("environment-panorama.exr")));
            let text = format!("[environment]\nimage = \"environment-panorama.exr\"\n{size}");
            fs::write(&file, text).unwrap();
            let again = Scene::load(&file).unwrap().environment.unwrap();
            assert_eq!(again.shape(), texels.shape());
            // But beside the edges of faces.
            let is_inside = |k: usize| {
                let (row, column) = (k / 3 / side % side, k / 3 % side);
                [row, column].iter().all(|at| (side / 4..side - side / 4).contains(at))
            };
            for k in (0..whole).filter(|&k| is_inside(k)) {
                let off = (again.data()[k] - texels.data()[k]).abs();
                assert!(off < 1e-5, "{side} {k}: {off}");
            }
        }
    }

    #[test]
    fn meshes_are_written_in_the_world() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("scene.toml");
        let text = "[[meshes]]\nname = \"-my skin\"\nshape = \"cube\"\nmaterial = { texture_size = 2 }\n\
                    place = { scale = 2, rotation = [0, 0, 1, 1], translation = [5, 0, 0] }\n\
                    instances = [{ translation = [1, 0, 0] }]\n\
                    [[meshes]]\nname = \"b\"\nshape = \"plane\"\nmaterial = { texture_size = 2 }\n\
                    place = { translation = [0, 0, 1e6] }\n";
        fs::write(&file, text).unwrap();
        let scene = Scene::load(&file).unwrap();
        let out = directory.path().join("out");
        let written = scene.save_results(&out).unwrap();
        let names = scene.result_names();
        let is_named = |file: &PathBuf| names.contains(&file.strip_prefix(&out).unwrap().into());
        assert!(written.iter().all(is_named), "{written:?}");
        // MTL would take the name of the first texture for options; that of the second is there once.
        assert!(names.contains(&"mesh-1.png".into()) && !names.contains(&"mesh-2.png".into()));
        assert!(fs::read_to_string(out.join("mesh.mtl")).unwrap().contains(" b-texture.png\n"));
        let folder = Folder::new(&out).unwrap();
        let corners = |files: &[&str]| {
            let models = files.iter().map(|file| read_model(&folder, file).unwrap());
            let mut corners = Vec::new();
            for model in models {
                assert!(!model.images.is_empty(), "{files:?}: {:?}", model.notes);
                for placed in &model.placed {
                    let Geometry { positions, faces, .. } = &model.geometries[placed.geometry];
                    let point = |&vertex: &u32| {
                        let point = DVec3::from(positions[vertex as usize].map(f64::from));
                        placed.transform.transform_point3(point)
                    };
                    corners.extend(faces.as_flattened().iter().map(point));
                }
            }
            corners
        };
        let expected = corners(&["mesh.glb"]);
        assert_eq!(expected.len(), 3 * (12 + 12 + 2));
        for files in [&["mesh.obj"][..], &["-my skin.ply", "b.ply"]] {
            let found = corners(files);
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                assert!(found.distance(*expected) < 1e-5, "{files:?}: {found} {expected}");
            }
        }
        // Without a place an object is not in the world.
        let mut scene = scene;
        scene.objects[1].places.clear();
        let out = directory.path().join("less");
        let written = scene.save_results(&out).unwrap();
        assert!(!written.contains(&out.join("b.ply")) && written.contains(&out.join("mesh.obj")));
    }

    /// A scene of a plane with a texture that is learnt.
    fn textured(folder: &Path) -> Scene {
        let text = "[[meshes]]\nname = \"a\"\nshape = \"plane\"\nmaterial = { texture_size = 2 }\n\
                    [[meshes]]\nname = \"b\"\nshape = \"plane\"\nmaterial = { texture_size = 2 }\n\
                    [learn.texture]\nmeshes = [\"a\"]\n";
        fs::write(folder.join("scene.toml"), text).unwrap();
        Scene::load(folder.join("scene.toml")).unwrap()
    }

    #[test]
    fn textures_are_written_as_photographs_are_and_named_by_their_meshes() {
        let directory = tempfile::tempdir().unwrap();
        let mut scene = textured(directory.path());
        let texels = Tensor::from_flat_fn([2, 2, 3], |k| k as f32 / 11.0);
        scene.objects[0].materials[0].texture.texels = Some(texels.clone());
        let out = directory.path().join("out");
        let written = scene.save_results(&out).unwrap();
        assert!(written.contains(&out.join("a-texture.png")));
        // Its PLY names it, learnt or not.
        assert!(written.contains(&out.join("b-texture.png")));
        let folder = Folder::new(&out).unwrap();
        for name in ["a", "b"] {
            let model = read_model(&folder, format!("{name}.ply")).unwrap();
            assert_eq!((model.images.len(), model.materials.len()), (1, 1), "{:?}", model.notes);
            let file = format!("{name}-texture.png");
            let bytes = fs::read(out.join(&file)).unwrap();
            assert_eq!(model.images[0], Picture::decode(&bytes, &Location::new(&file)).unwrap());
        }
        let names = scene.result_names();
        assert!(
            written.iter().all(|file| names.contains(&file.strip_prefix(&out).unwrap().into()))
        );
        let bytes = fs::read(out.join("a-texture.png")).unwrap();
        let read = Picture::decode(&bytes, &Location::new("a-texture.png")).unwrap();
        assert_eq!(read.channels, 3);
        // Half a step of 8 bits, where sRGB is flattest.
        approx::assert_abs_diff_eq!(
            read.color(ColorSpace::Srgb).data(),
            texels.data(),
            epsilon = 0.006
        );
    }

    #[test]
    fn no_result_takes_the_place_of_what_the_scene_reads() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        let scene = textured(folder);
        fs::write(folder.join("mesh.glb"), crate::mesh::glb(&scene.model().unwrap()).unwrap())
            .unwrap();
        fs::create_dir(folder.join("out")).unwrap();
        fs::write(folder.join("out/mesh.glb"), "an earlier result").unwrap();
        fs::write(folder.join("own.toml"), "[[meshes]]\nfile = \"mesh.glb\"\n").unwrap();
        let scene = Scene::load(folder.join("own.toml")).unwrap();
        let names = scene.result_names();
        scene.check_results(folder.join("out"), &names).unwrap();
        let message = scene.check_results(folder, &names).unwrap_err().to_string();
        assert!(message.ends_with("another place than a file that the scene reads"), "{message}");
        assert!(message.contains("mesh.glb could not be written"), "{message}");
        let scene_file = [PathBuf::from("own.toml")];
        assert!(scene.check_results(folder, &scene_file).is_err());
    }
}
