//! Materials of metallic-roughness, and which texture coordinates their images use.
//!
//! A geometry here has one set of coordinates. So the images of a material share a set and a transform: those
//! of the base colour, or of the first image that there is. An image with others is left out with a note.
//! A texture transform is applied to the coordinates, so a material has none. Each image goes on beyond its
//! edges as its sampler says; the sampler's filters are noted where they are others than linear ones.
//!
//! The opacity of an opaque material is 1, whatever the file says.

use std::collections::{BTreeMap, BTreeSet};

use ::gltf::json::Index;
use ::gltf::json::extensions::texture::{Info, TextureTransform};
use ::gltf::json::material::{AlphaMode, Material};
use ::gltf::json::texture::{MagFilter, MinFilter, Texture, WrappingMode};
use ::gltf::json::validation::Checked;
use bokashi_render_ops::TextureBorder;

use super::file::GltfFile;
use crate::error::SceneError;
use crate::mesh::notes::{Notes, name};
use crate::model::{Borders, MaterialFile, MaterialMap, Model};

/// From the coordinates of a file to those of an image: u' = a u + b v + c, v' = d u + e v + f, as rows.
pub(super) type Transform = [[f32; 3]; 2];

/// Which coordinates a material's images use.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Mapping {
    /// The number of `TEXCOORD`.
    pub(super) set: u32,
    pub(super) transform: Option<Transform>,
}

impl Mapping {
    fn new(set: u32, transform: Option<&TextureTransform>) -> Self {
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(set);
        let transform = transform.map(|transform| {
            let (sin, cos) = transform.rotation.0.sin_cos();
            let ([x, y], [u, v]) = (transform.scale.0, transform.offset.0);
            // Counter-clockwise as the image is seen, and v runs down.
            [[cos * x, sin * y, u], [-sin * x, cos * y, v]]
        });
        Self { set, transform }
    }
}

/// A texture that a material uses.
#[derive(Debug, Clone, Copy)]
struct Used {
    texture: Index<Texture>,
    mapping: Mapping,
}

impl Used {
    fn new(info: &::gltf::json::texture::Info) -> Self {
        let transform = |extensions: &Info| extensions.texture_transform.clone();
        let transform = info.extensions.as_ref().and_then(transform);
        Self { texture: info.index, mapping: Mapping::new(info.tex_coord, transform.as_ref()) }
    }
}

/// Reads the materials and their images into the model. Of each material, the coordinates that it uses.
pub(super) fn read(
    file: &mut GltfFile<'_, '_>,
    model: &mut Model,
) -> Result<Vec<Mapping>, SceneError> {
    let root = file.root;
    let mut mapped = Vec::with_capacity(root.materials.len());
    // Of each material the images, by their numbers in the file.
    let mut used = Vec::with_capacity(root.materials.len());
    for material in &root.materials {
        let textures = textures(material);
        let mapping = textures.iter().flatten().map(|used| used.mapping).next().unwrap_or_default();
        let mut maps = [MaterialMap::default(); 3];
        for (map, texture) in maps.iter_mut().zip(textures) {
            let Some(texture) = texture else { continue };
            match texture.mapping == mapping {
                true => (map.image, map.borders) = image_of(texture.texture, file)?,
                false => file.note(
                    "an image was left out: its coordinates are others than those of the base colour",
                ),
            }
            map.is_missing = map.image.is_none();
        }
        mapped.push(mapping);
        used.push(maps);
    }
    let numbers: BTreeSet<usize> = used.iter().flatten().filter_map(|map| map.image).collect();
    let mut images = BTreeMap::new();
    for number in numbers {
        images.insert(number, file.image(number)?);
    }
    for (material, mut maps) in root.materials.iter().zip(used) {
        for map in &mut maps {
            if let Some(number) = map.image {
                map.image = images[&number];
                map.is_missing = map.image.is_none();
            }
        }
        model.materials.push(material_of(material, maps, &mut file.context.notes));
    }
    Ok(mapped)
}

/// The textures of base colour, of metallic and roughness, and of normals.
fn textures(material: &Material) -> [Option<Used>; 3] {
    let surface = &material.pbr_metallic_roughness;
    // The library knows the extension only at other textures.
    let normal = material.normal_texture.as_ref().map(|info| {
        let value =
            info.extensions.as_ref().and_then(|all| all.others.get("KHR_texture_transform"));
        let transform = value.and_then(|value| serde_json::from_value(value.clone()).ok());
        Used { texture: info.index, mapping: Mapping::new(info.tex_coord, transform.as_ref()) }
    });
    [
        surface.base_color_texture.as_ref().map(Used::new),
        surface.metallic_roughness_texture.as_ref().map(Used::new),
        normal,
    ]
}

/// The number of a texture's image in the file, where it has one, and how the image goes on.
fn image_of(
    index: Index<Texture>,
    file: &mut GltfFile<'_, '_>,
) -> Result<(Option<usize>, Borders), SceneError> {
    let root = file.root;
    let (number, count) = (index.value(), root.textures.len());
    let Some(texture) = root.textures.get(number) else {
        let message = format!("the file has {count} textures, and a material names {number}");
        return Err(file.error(message));
    };
    // So the library has a texture without an image.
    let (number, count) = (texture.source.value(), root.images.len());
    if number == u32::MAX as usize {
        file.note("a texture has no image that is read, and was left out");
        return Ok((None, Borders::default()));
    }
    if number >= count {
        return Err(
            file.error(format!("the file has {count} images, and a texture names {number}"))
        );
    }
    let Some(sampler) = texture.sampler else { return Ok((Some(number), Borders::default())) };
    let (index, count) = (sampler.value(), root.samplers.len());
    let Some(sampler) = root.samplers.get(index) else {
        return Err(
            file.error(format!("the file has {count} samplers, and a texture names {index}"))
        );
    };
    let mut borders = Borders::default();
    for (border, mode) in borders.iter_mut().zip([sampler.wrap_s, sampler.wrap_t]) {
        *border = match mode {
            Checked::Valid(WrappingMode::Repeat) => TextureBorder::Wrap,
            Checked::Valid(WrappingMode::MirroredRepeat) => TextureBorder::Mirror,
            Checked::Valid(WrappingMode::ClampToEdge) => TextureBorder::Clamp,
            Checked::Invalid => {
                let rule = "a wrap mode is 10497, 33071 or 33648";
                return Err(file.error(format!("{rule}, and one of sampler {index} is another")));
            }
        };
    }
    let finer = sampler.mag_filter.is_none_or(|filter| filter == Checked::Valid(MagFilter::Linear));
    let coarser = Checked::Valid(MinFilter::LinearMipmapLinear);
    if !finer || sampler.min_filter.is_some_and(|filter| filter != coarser) {
        file.note("filters of a texture were left out: `texture_filter` of the scene is for all");
    }
    Ok((Some(number), borders))
}

fn material_of(material: &Material, maps: [MaterialMap; 3], notes: &mut Notes) -> MaterialFile {
    let surface = &material.pbr_metallic_roughness;
    let [base_color_map, metallic_roughness_map, normal_map] = maps;
    let mut base_color = surface.base_color_factor.0;
    match material.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => base_color[3] = 1.0,
        Checked::Valid(AlphaMode::Mask) => {
            let cutoff = material.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
            notes.add(format!("a material is invisible below the opacity {cutoff}: left out"));
        }
        Checked::Valid(AlphaMode::Blend) => {
            notes.add("the opacity of a material was left out: all of it is drawn");
        }
        Checked::Invalid => notes.add("a mode of opacity that no one knows was left out"),
    }
    if material.emissive_factor.0 != [0.0; 3] {
        notes.add("light that a material emits was left out");
    }
    if material.emissive_texture.is_some() {
        notes.add("an image of light that a material emits was left out");
    }
    if material.occlusion_texture.is_some() {
        notes.add("an image of occlusion was left out");
    }
    MaterialFile {
        name: name(material.name.as_deref().unwrap_or_default()),
        base_color,
        base_color_map,
        metallic: surface.metallic_factor.0,
        roughness: surface.roughness_factor.0,
        metallic_roughness_map,
        normal_map,
        normal_scale: material.normal_texture.as_ref().map_or(1.0, |texture| texture.scale),
    }
}
