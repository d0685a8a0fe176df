//! Materials of MTL files.
//!
//! # What is read
//! - `Kd` and `map_Kd`: base colour and its image. `Kd` is a linear colour, as converters to glTF take it.
//! - `d` or `Tr`: opacity, and 1 minus it.
//! - `Pr`, `Pm`, `map_Pr`, `map_Pm`: roughness and metallic, by the extension of Clara.io. The two images
//!   become one with roughness in green and metallic in blue. Without them a material is a dielectric of
//!   roughness 1.
//! - `norm`: a normal map, with the factor of its option `-bm`.
//! - `-clamp on` of an image: beyond its edges it goes on as on them.
//!
//! Keywords are of any case. An image is multiplied by its number, and so a material whose `Kd` is 0 is black
//! beside an image: a note says so.
//!
//! A note names what is left out: height maps (`map_Bump`, `bump`), an opacity map, images that are missing or
//! can't be read, options of images, and all other keywords, such as `Ka`, `Ks`, `Ns` and `illum` of older
//! models.
//!
//! A material that no file has is noted, and a mesh with it has none.
//!
//! # Sources
//! Wavefront Technologies, Advanced Visualizer, MTL material format; the PBR extension of Clara.io.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::Path;

use super::maps::{Map, Packed};
use super::statements::{Statements, numbers, rest, text};
use crate::error::{Location, SceneError};
use crate::mesh::context::{MeshContext, unquoted};
use crate::mesh::notes::{left_out, name};
use crate::model::{MaterialFile, MaterialMap};

/// What programs, and we, write for faces without a material.
pub(in crate::mesh) const NO_MATERIAL: &str = "(null)";

/// A material as a file describes it.
#[derive(Debug, Default)]
struct Described {
    color: Option<[f32; 3]>,
    opacity: Option<f32>,
    metallic: Option<f32>,
    roughness: Option<f32>,
    color_map: Option<Map>,
    metallic_map: Option<Map>,
    roughness_map: Option<Map>,
    normal_map: Option<Map>,
    /// What was left out.
    left_out: Vec<&'static str>,
    /// Keywords that were left out.
    others: BTreeSet<String>,
}

/// The materials `used` of the files `libraries`, and for each used name the number of its material.
pub(super) fn read(
    libraries: &[String],
    used: &[String],
    context: &mut MeshContext<'_>,
) -> Result<(Vec<MaterialFile>, Vec<Option<usize>>), SceneError> {
    let mut described = HashMap::new();
    let mut seen = HashSet::new();
    for library in libraries {
        // A path may have spaces, and a line several paths.
        let library = unquoted(library);
        let mut names = vec![library];
        if context.find(library)?.is_none() && library.contains(char::is_whitespace) {
            names = library.split_whitespace().collect();
        }
        for file in names {
            let Some(path) = context.find(file)? else {
                let file = name(file);
                context
                    .notes
                    .add(format!("the material file {file:?} is missing and was left out"));
                continue;
            };
            if seen.insert(path) {
                read_file(file, &mut described, context)?;
            }
        }
    }
    let (mut materials, mut numbers, mut packed) = (Vec::new(), Vec::new(), Packed::default());
    let mut others = BTreeSet::new();
    for name in used {
        numbers.push(described.get(name).map(|_| materials.len()));
        match described.get(name) {
            Some((folder, described)) => {
                others.extend(described.others.iter().map(String::as_str));
                materials.push(material(name, folder, described, &mut packed, context)?);
            }
            None if name.is_empty() || name == NO_MATERIAL => {}
            None => context.notes.add(format!("the material {name:?} is missing and was left out")),
        }
    }
    if !others.is_empty() {
        let others: Vec<&str> = others.into_iter().collect();
        context.notes.add(left_out(["statement", "statements"], &others, " of materials"));
    }
    Ok((materials, numbers))
}

/// Adds the materials of a file, each with the folder that the file lies in.
fn read_file(
    file: &str,
    described: &mut HashMap<String, (String, Described)>,
    context: &mut MeshContext<'_>,
) -> Result<(), SceneError> {
    let (bytes, path) = (context.read(file)?, context.location_of(file).path);
    let slashes = file.replace('\\', "/");
    let folder = Path::new(&slashes).parent().unwrap_or(Path::new(""));
    let folder = folder.to_string_lossy().into_owned();
    let mut current = None;
    let mut finish = |current: Option<(String, Described)>, context: &mut MeshContext<'_>| {
        let Some((name, finished)) = current else { return };
        if described.insert(name.clone(), (folder.clone(), finished)).is_some() {
            let note = format!("the material {name:?} is described again: the last time counts");
            context.notes.add(note);
        }
    };
    for (number, line) in Statements::new(&text(&bytes, &Location::new(&path))?) {
        let Some(keyword) = line.split_whitespace().next() else { continue };
        let arguments = rest(&line, keyword);
        match (&*keyword.to_ascii_lowercase(), &mut current) {
            ("newmtl", current) => {
                finish(current.take(), context);
                *current = Some((name(arguments), Described::default()));
            }
            (_, Some((_, material))) => {
                material.set(keyword, arguments, || Location::line(&path, number))?;
            }
            (word, None) if word.starts_with('#') => {}
            (_, None) => context.notes.add("statements before the first material were left out"),
        }
    }
    finish(current, context);
    Ok(())
}

impl Described {
    /// Takes the statement `keyword` with these arguments.
    fn set(
        &mut self,
        keyword: &str,
        arguments: &str,
        location: impl Fn() -> Location,
    ) -> Result<(), SceneError> {
        let number = || -> Result<Option<f32>, SceneError> {
            let ([number], count) = numbers(arguments.split_whitespace(), keyword, &location)?;
            Ok((count == 1).then_some(number))
        };
        match &*keyword.to_ascii_lowercase() {
            "kd" => match arguments.starts_with("spectral") || arguments.starts_with("xyz") {
                true => self.left_out.push("Kd of another colour space"),
                false => {
                    let words = arguments.split_whitespace();
                    let ([r, g, b], count) = numbers(words, keyword, &location)?;
                    self.color = match count {
                        // The format lets green and blue be left out.
                        1 => Some([r; 3]),
                        3 => Some([r, g, b]),
                        _ => {
                            let message = format!("Kd has three numbers, and this has {count}");
                            return Err(SceneError::content(location(), message));
                        }
                    };
                }
            },
            "d" if arguments.starts_with('-') => self.left_out.push("d -halo"),
            "d" => self.opacity = number()?.or(self.opacity),
            "tr" => self.opacity = number()?.map(|number| 1.0 - number).or(self.opacity),
            "pm" => self.metallic = number()?.or(self.metallic),
            "pr" => self.roughness = number()?.or(self.roughness),
            "map_kd" => self.color_map = Map::parse(arguments),
            "map_pm" => self.metallic_map = Map::parse(arguments),
            "map_pr" => self.roughness_map = Map::parse(arguments),
            "norm" => {
                self.normal_map = Map::parse(arguments);
                if let Some(map) = self.normal_map.as_mut().filter(|map| map.factor != 1.0) {
                    map.left_out.retain(|&option| option != "-bm");
                }
            }
            "map_bump" | "bump" => self.left_out.push("a height map"),
            "map_d" => self.left_out.push("an opacity map"),
            "map_ke" => self.left_out.push("an image of emitted light"),
            // No light of its own.
            "ke" if arguments.split_whitespace().all(|word| word.parse() == Ok(0.0)) => {}
            _ if keyword.starts_with('#') => {}
            _ => {
                self.others.insert(name(keyword));
            }
        }
        Ok(())
    }
}

/// A material with its images.
fn material(
    name: &str,
    folder: &str,
    described: &Described,
    packed: &mut Packed,
    context: &mut MeshContext<'_>,
) -> Result<MaterialFile, SceneError> {
    for what in &described.left_out {
        context.notes.add(format!("{what} of a material was left out"));
    }
    let mut read = |map: &Option<Map>| -> Result<MaterialMap, SceneError> {
        let Some(map) = map else { return Ok(MaterialMap::default()) };
        for option in &map.left_out {
            context.notes.add(format!("the option {option} of an image was left out"));
        }
        let image = context.image(&match folder {
            "" => map.file.clone(),
            _ => format!("{folder}/{}", map.file),
        })?;
        Ok(MaterialMap { image, borders: map.borders, is_missing: image.is_none() })
    };
    let (base_color_map, normal_map) = (read(&described.color_map)?, read(&described.normal_map)?);
    let (roughness, metallic) = (read(&described.roughness_map)?, read(&described.metallic_map)?);
    if base_color_map.image.is_some() && described.color == Some([0.0; 3]) {
        let note = format!("the material {name:?} is black: its Kd of 0 multiplies its image");
        context.notes.add(note);
    }
    let are_named = [&described.roughness_map, &described.metallic_map].map(Option::is_some);
    let metallic_roughness_map = MaterialMap {
        image: packed.image([roughness.image, metallic.image], context),
        borders: if are_named[0] { roughness.borders } else { metallic.borders },
        is_missing: roughness.is_missing || metallic.is_missing,
    };
    if are_named == [true; 2] && roughness.borders != metallic.borders {
        let note = "`-clamp` of an image of metallic was left out: that of roughness is for both";
        context.notes.add(note);
    }
    // Where an image says it, the factor is 1.
    let factor = |map: MaterialMap| map.image.map(|_| 1.0);
    let [r, g, b] = described.color.unwrap_or([1.0; 3]);
    Ok(MaterialFile {
        name: name.to_owned(),
        base_color: [r, g, b, described.opacity.unwrap_or(1.0)],
        base_color_map,
        metallic: described.metallic.or(factor(metallic)).unwrap_or(0.0),
        roughness: described.roughness.or(factor(roughness)).unwrap_or(1.0),
        metallic_roughness_map,
        normal_map,
        normal_scale: described.normal_map.as_ref().map_or(1.0, |map| map.factor),
    })
}
