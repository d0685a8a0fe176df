//! GLB: a glTF 2.0 file with its buffer and its images inside.
//!
//! A geometry is a mesh, each of its submeshes a primitive, and a placed one a node with its matrix. The
//! primitives of a mesh share their vertices. glTF indexes all attributes alike, so a vertex is written once
//! for each combination of attributes that corners give it.
//!
//! Images are PNG, and a texture is an image with its wrap modes. A material is opaque where its opacity is 1,
//! and else blended. The format has factors of materials from 0 to 1: those beyond are cut. It has no matrices
//! that shear, which some readers refuse.
//!
//! # Source
//! Khronos Group, glTF 2.0 Specification.

use std::collections::HashMap;
use std::mem;

use bokashi_render_ops::TextureBorder;
use serde_json::{Value, json};

use super::check::{check, check_number, location};
use super::unweld::{Unwelded, row_or};
use crate::error::SceneError;
use crate::model::{Borders, Geometry, Indexed, MaterialFile, MaterialMap, Model, Placed, Submesh};

/// Targets of buffer views and types of components, as the specification numbers them.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
/// Wrap modes of samplers.
const REPEAT: u32 = 10497;
const MIRRORED_REPEAT: u32 = 33648;
const CLAMP_TO_EDGE: u32 = 33071;
/// What a chunk's length is a multiple of, and where accessors begin.
const ALIGNMENT: usize = 4;

/// A GLB file with the model. Its notes are not in there.
///
/// # Errors
/// [`SceneError::Content`] where something names what is not there, a number is not finite, a geometry has no
/// face, or an image has samples of 32 bits, which PNG does not have; [`SceneError::TooLarge`] where the file
/// would have 4 GiB or more.
pub fn glb(model: &Model) -> Result<Vec<u8>, SceneError> {
    let mut file = File::default();
    let meshes: Vec<Value> = model
        .geometries
        .iter()
        .map(|geometry| file.mesh(geometry, model.materials.len()))
        .collect::<Result<_, _>>()?;
    let mut images = Vec::new();
    for image in &model.images {
        let view = file.view(&image.encode_png(&location())?, None);
        images.push(json!({"bufferView": view, "mimeType": "image/png"}));
    }
    let mut textures = Textures { images: images.len(), ..Textures::default() };
    let materials: Vec<Value> = model
        .materials
        .iter()
        .map(|material| material_of(material, &mut textures))
        .collect::<Result<_, _>>()?;
    let nodes: Vec<Value> =
        model.placed.iter().map(|placed| node(placed, meshes.len())).collect::<Result<_, _>>()?;
    let scenes: Vec<Value> = match nodes.is_empty() {
        true => Vec::new(),
        false => vec![json!({"nodes": (0..nodes.len()).collect::<Vec<_>>()})],
    };
    let mut root = json!({"asset": {"version": "2.0", "generator": "Bokashi"}});
    let lists = [
        ("accessors", mem::take(&mut file.accessors)),
        ("bufferViews", mem::take(&mut file.views)),
        ("images", images),
        ("materials", materials),
        ("meshes", meshes),
        ("nodes", nodes),
        ("samplers", textures.samplers()),
        ("scenes", scenes),
        ("textures", textures.values),
    ];
    // The specification has no empty lists.
    for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
        root[name] = Value::Array(list);
    }
    if root.get("scenes").is_some() {
        root["scene"] = json!(0);
    }
    if !file.bytes.is_empty() {
        root["buffers"] = json!([{"byteLength": file.bytes.len()}]);
    }
    packed(root.to_string().into_bytes(), file.bytes)
}

/// The parts of a file that are being written.
#[derive(Debug, Default)]
struct File {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    /// Adds bytes to the buffer: the number of their view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        pad(&mut self.bytes, 0);
        let mut view =
            json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds rows: the number of their accessor. `has_bounds` writes the least and largest of each number.
    fn rows<const N: usize>(
        &mut self,
        rows: impl Iterator<Item = [f32; N]> + Clone,
        has_bounds: bool,
    ) -> usize {
        let bytes: Vec<u8> = rows.clone().flatten().flat_map(f32::to_le_bytes).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let count = bytes.len() / (N * size_of::<f32>());
        let kind = format!("VEC{N}");
        let mut accessor =
            json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": kind});
        if has_bounds {
            let bound = |start: f32, pick: fn(f32, f32) -> f32| {
                let both = |bound: [f32; N], row: [f32; N]| {
                    std::array::from_fn::<f32, N, _>(|k| pick(bound[k], row[k]))
                };
                json!(rows.clone().fold([start; N], both).as_slice())
            };
            accessor["min"] = bound(f32::INFINITY, f32::min);
            accessor["max"] = bound(f32::NEG_INFINITY, f32::max);
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds the rows of an attribute that vertices have, `none` where they have none: the number of their accessor,
    /// and which submeshes have the attribute.
    fn attribute<const N: usize>(
        &mut self,
        indexed: &Option<Indexed<N>>,
        vertices: impl Iterator<Item = u32> + Clone,
        none: [f32; N],
        submeshes: &[Submesh],
    ) -> Option<(usize, Vec<bool>)> {
        let indexed = indexed.as_ref()?;
        let accessor = self.rows(vertices.map(|row| row_or(indexed, row, none)), false);
        let covered = submeshes.iter().map(|submesh| indexed.covers(&submesh.faces));
        Some((accessor, covered.collect()))
    }

    fn mesh(&mut self, geometry: &Geometry, materials: usize) -> Result<Value, SceneError> {
        check(geometry)?;
        let Geometry { name, positions, colors, coordinates, normals, tangents, submeshes, .. } =
            geometry;
        let Unwelded { vertices, faces } = Unwelded::new(geometry);
        let named = |k: usize| vertices.iter().map(move |vertex| vertex[k]);
        let rows = named(0).map(|row| positions[row as usize]);
        let positions = self.rows(rows, true);
        // What stands where a vertex has no row is named by no primitive.
        let attributes = [
            ("COLOR_0", self.attribute(colors, named(1), [1.0; 3], submeshes)),
            ("TEXCOORD_0", self.attribute(coordinates, named(2), [0.0; 2], submeshes)),
            ("NORMAL", self.attribute(normals, named(3), [0.0, 0.0, 1.0], submeshes)),
            ("TANGENT", self.attribute(tangents, named(4), [1.0, 0.0, 0.0, 1.0], submeshes)),
        ];
        let mut primitives = Vec::with_capacity(submeshes.len());
        for (k, Submesh { material, faces: range }) in submeshes.iter().enumerate() {
            let mut named = json!({"POSITION": positions});
            for (what, attribute) in &attributes {
                if let Some((accessor, _)) = attribute.as_ref().filter(|(_, is_there)| is_there[k])
                {
                    named[what] = json!(accessor);
                }
            }
            let corners = faces[range.clone()].as_flattened();
            let bytes: Vec<u8> = corners.iter().flat_map(|index| index.to_le_bytes()).collect();
            let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
            let (kind, count) = (UNSIGNED_INT, corners.len());
            self.accessors.push(json!(
                {"bufferView": view, "componentType": kind, "count": count, "type": "SCALAR"}
            ));
            let mut primitive = json!({"attributes": named, "indices": self.accessors.len() - 1});
            if let Some(material) = *material {
                check_number("material", material, materials)?;
                primitive["material"] = json!(material);
            }
            primitives.push(primitive);
        }
        Ok(named_value(json!({"primitives": primitives}), name))
    }
}

fn node(placed: &Placed, meshes: usize) -> Result<Value, SceneError> {
    check_number("geometry", placed.geometry, meshes)?;
    // Readers of doubles have all of it: a place may be far from the origin.
    let matrix = placed.transform.to_cols_array();
    if !matrix.iter().all(|&number| (number as f32).is_finite()) {
        let message = format!("a matrix is finite, and that of {:?} is {matrix:?}", placed.name);
        return Err(SceneError::content(location(), message));
    }
    let mut node = json!({"mesh": placed.geometry});
    if placed.transform != glam::DMat4::IDENTITY {
        node["matrix"] = json!(matrix);
    }
    Ok(named_value(node, &placed.name))
}

/// Pairs of images and samplers, each once.
#[derive(Debug, Default)]
struct Textures {
    /// How many images there are.
    images: usize,
    /// Samplers: how images go on.
    borders: Vec<Borders>,
    numbers: HashMap<(usize, usize), usize>,
    values: Vec<Value>,
}

impl Textures {
    /// The texture of an image that goes on so.
    fn texture(&mut self, map: &MaterialMap) -> Result<Option<Value>, SceneError> {
        let MaterialMap { image: Some(image), borders, .. } = *map else { return Ok(None) };
        check_number("image", image, self.images)?;
        let sampler =
            self.borders.iter().position(|border| *border == borders).unwrap_or_else(|| {
                self.borders.push(borders);
                self.borders.len() - 1
            });
        let number = *self.numbers.entry((image, sampler)).or_insert_with(|| {
            self.values.push(json!({"sampler": sampler, "source": image}));
            self.values.len() - 1
        });
        Ok(Some(json!({"index": number})))
    }

    fn samplers(&self) -> Vec<Value> {
        let mode = |border| match border {
            TextureBorder::Wrap => REPEAT,
            TextureBorder::Mirror => MIRRORED_REPEAT,
            // The format has no zeros.
            TextureBorder::Clamp | TextureBorder::Zero => CLAMP_TO_EDGE,
        };
        let sampler = |&[u, v]: &Borders| json!({"wrapS": mode(u), "wrapT": mode(v)});
        self.borders.iter().map(sampler).collect()
    }
}

fn material_of(material: &MaterialFile, textures: &mut Textures) -> Result<Value, SceneError> {
    let MaterialFile { name, base_color, metallic, roughness, normal_scale, .. } = material;
    let numbers = base_color.iter().chain([metallic, roughness, normal_scale]);
    if !numbers.clone().all(|number| number.is_finite()) {
        let all: Vec<f32> = numbers.copied().collect();
        let message =
            format!("the numbers of the material {name:?} are finite, and these are {all:?}");
        return Err(SceneError::content(location(), message));
    }
    let base_color = base_color.map(|number| number.clamp(0.0, 1.0));
    let [metallic, roughness] = [metallic, roughness].map(|number| number.clamp(0.0, 1.0));
    let mut surface = json!({
        "baseColorFactor": base_color, "metallicFactor": metallic, "roughnessFactor": roughness
    });
    if let Some(texture) = textures.texture(&material.base_color_map)? {
        surface["baseColorTexture"] = texture;
    }
    if let Some(texture) = textures.texture(&material.metallic_roughness_map)? {
        surface["metallicRoughnessTexture"] = texture;
    }
    let mut value = json!({"pbrMetallicRoughness": surface});
    if let Some(mut texture) = textures.texture(&material.normal_map)? {
        texture["scale"] = json!(normal_scale);
        value["normalTexture"] = texture;
    }
    if base_color[3] != 1.0 {
        value["alphaMode"] = json!("BLEND");
    }
    Ok(named_value(value, name))
}

fn named_value(mut value: Value, name: &str) -> Value {
    if !name.is_empty() {
        value["name"] = json!(name);
    }
    value
}

/// Fills up to a multiple of [`ALIGNMENT`].
fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), with);
}

/// A GLB of a text and a buffer.
fn packed(mut text: Vec<u8>, mut buffer: Vec<u8>) -> Result<Vec<u8>, SceneError> {
    pad(&mut text, b' ');
    pad(&mut buffer, 0);
    let chunk = if buffer.is_empty() { 0 } else { 8 + buffer.len() };
    let length = 12 + 8 + text.len() + chunk;
    let Ok(total) = u32::try_from(length) else {
        let (what, most) = ("bytes of a GLB", u64::from(u32::MAX));
        return Err(SceneError::TooLarge {
            location: location(),
            what,
            most,
            found: length as u64,
        });
    };
    let mut bytes = Vec::with_capacity(length);
    bytes.extend_from_slice(b"glTF");
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(total.to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", buffer)] {
        if !chunk.is_empty() {
            // Less than the whole, which was checked.
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend_from_slice(kind);
            bytes.extend(chunk);
        }
    }
    Ok(bytes)
}
