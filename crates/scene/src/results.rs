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
use crate::error::{Location, SceneError};
use crate::file::{check_results, unwritten, write_result};
use crate::mesh::{glb, ply};
use crate::model::Model;
use crate::object::SurfaceMaterial;
use crate::picture::{ColorSpace, Picture};
use crate::scene::Scene;
use crate::scene_view::SceneView;
use crate::summary::named_files;

impl Scene {
    /// Writes the scene's objects to `mesh.glb` and to a PLY file each, and textures to a PNG each. Cameras go to
    /// `transforms.json`, the environment to `environment.exr`, and all other numbers to `numbers.json`. All of
    /// them lie in the folder `out`, which is made where it is missing. Paths of images start at `out`. Each
    /// file is written whole or not at all.
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
        let model = self.model()?;
        if !model.geometries.is_empty() {
            write("mesh.glb", &glb(&model)?)?;
            let files = self.texture_names(&model);
            for geometry in &model.geometries {
                let bytes = ply(geometry, &model.materials, |image| files.get(&image).cloned())?;
                write(&format!("{}.ply", geometry.name), &bytes)?;
            }
        }
        for (name, texels) in self.textures() {
            write(&name, &texture_png(texels, &name)?)?;
        }
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
            let location = Location::new("environment.exr");
            write("environment.exr", &Picture::from_numbers(&faces)?.encode_exr(&location)?)?;
        }
        let numbers = serde_json::to_string_pretty(&self.numbers()).unwrap_or_default();
        write("numbers.json", format!("{numbers}\n").as_bytes())?;
        Ok(written)
    }

    /// The names of all files that [`Scene::save_results`] may write, to be checked before a fit.
    pub fn result_names(&self) -> Vec<PathBuf> {
        let usual = ["mesh.glb", "transforms.json", "environment.exr", "numbers.json"];
        let meshes = self.objects.iter().map(|object| format!("{}.ply", object.name));
        let textures = self.textures().map(|(name, _)| name);
        usual
            .into_iter()
            .map(String::from)
            .chain(meshes)
            .chain(textures)
            .map(PathBuf::from)
            .collect()
    }

    /// Of each texture the name of its file, and its texels.
    fn textures(&self) -> impl Iterator<Item = (String, &Tensor<f32>)> {
        let materials = self.objects.iter();
        let materials = materials
            .flat_map(|object| object.materials.iter().map(move |material| (object, material)));
        // Materials of one name are one.
        let mut seen = HashSet::new();
        materials.filter_map(move |(object, material)| {
            let name = object.material_name(material);
            let texels = material.texture.texels.as_ref()?;
            seen.insert(name.clone()).then(|| (texture_name(&name), texels))
        })
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
            // From the coordinates of its file, which its PLY has, too.
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
    use super::*;
    use crate::folder::Folder;
    use crate::mesh::read_model;

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
