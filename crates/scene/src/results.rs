//! What a scene leaves behind: its objects, cameras and numbers as files that other programs read.

use std::fs;
use std::path::{Path, PathBuf};

use bokashi_core::Tensor;
use glam::DMat4;
use serde_json::{Map, Value, json};

use crate::cameras::transforms_json;
use crate::description::{LightPlace, Tone};
use crate::error::{Place, SceneError};
use crate::file::write_result;
use crate::mesh::{glb, ply};
use crate::object::SurfaceLook;
use crate::picture::{ColorSpace, Picture};
use crate::scene::Scene;

impl Scene {
    /// Writes the scene's objects to `mesh.glb` and to a PLY file each, its cameras to `transforms.json`, its
    /// environment to `environment.exr`, and its numbers to `numbers.json`, all in the folder `out`, which is
    /// made where it is missing. Paths of images start at `out`. Each file is written whole or not at all.
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
            for geometry in &model.geometries {
                write(&format!("{}.ply", geometry.name), &ply(geometry)?)?;
            }
        }
        let mut cameras = self.cameras();
        let way = self.folder.seen_from(out)?;
        cameras.iter_mut().for_each(|view| view.image = way.join(&view.image));
        if !cameras.is_empty() {
            write("transforms.json", transforms_json(&cameras).as_bytes())?;
        }
        if let Some(texels) = &self.environment {
            let [side, all] = [texels.shape()[1], texels.data().len()];
            let faces = Tensor::from_flat_fn([all / (3 * side), side, 3], |k| texels.data()[k]);
            let place = Place::of("environment.exr");
            write("environment.exr", &Picture::of_numbers(&faces)?.encode_exr(&place)?)?;
        }
        let numbers = serde_json::to_string_pretty(&self.numbers()).unwrap_or_default();
        write("numbers.json", format!("{numbers}\n").as_bytes())?;
        Ok(written)
    }

    /// The names of all files that [`Scene::save_results`] may write, to be checked before a fit.
    pub fn result_names(&self) -> Vec<PathBuf> {
        let usual = ["mesh.glb", "transforms.json", "environment.exr", "numbers.json"];
        let meshes =
            self.objects.iter().map(|object| PathBuf::from(format!("{}.ply", object.name)));
        usual.into_iter().map(PathBuf::from).chain(meshes).collect()
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
        add("aperture", pipeline.lens.map(|lens| lens.aperture.0));
        add("focus", pipeline.lens.map(|lens| lens.focus.0));
        let lights = self.description.lights.iter().map(|light| match light.place() {
            None => json!({ "color": light.color() }),
            Some(LightPlace::Direction(own)) => {
                json!({ "color": light.color(), "direction": own.to_array() })
            }
            Some(LightPlace::Position(own)) => {
                json!({ "color": light.color(), "position": own.to_array() })
            }
        });
        numbers.insert("lights".to_owned(), lights.collect());
        let objects = self.objects.iter().map(|object| {
            let looks = object.looks.iter().map(|look| {
                let SurfaceLook { name, base_color, roughness, metallic, .. } = look;
                json!({
                    "name": name, "base_color": base_color, "roughness": roughness, "metallic": metallic
                })
            });
            let places = object.places.iter().map(rows);
            let own = json!({
                "materials": looks.collect::<Value>(),
                "places": places.collect::<Value>(),
            });
            (object.name.clone(), own)
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
        Picture::of_color(image, space)?.encode_png(&Place::of("a picture"))
    }
}

/// The rows of a matrix.
fn rows(matrix: &DMat4) -> Value {
    let rows = matrix.transpose().to_cols_array_2d();
    rows.iter().map(|row| json!(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_environment_is_read_again_as_it_was_written() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("scene.toml");
        fs::write(&file, "[environment]\ncolor = [1, 0.5, 3]\nsize = 8\n").unwrap();
        let mut scene = Scene::load(&file).unwrap();
        let texels = Tensor::from_flat_fn([6, 8, 8, 3], |k| 0.01 * k as f32);
        scene.environment = Some(texels.clone());
        let written = scene.save_results(place.path()).unwrap();
        assert!(written.contains(&place.path().join("environment.exr")));
        fs::write(&file, "[environment]\nimage = \"environment.exr\"\n").unwrap();
        assert_eq!(Scene::load(&file).unwrap().environment, Some(texels));
    }
}
