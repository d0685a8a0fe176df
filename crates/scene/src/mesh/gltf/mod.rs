//! glTF 2.0, as text (`.gltf`) or as one binary file (`.glb`).
//!
//! # What is read
//! - Buffers and images: the chunk of a GLB, `data:` URIs, and files beside the mesh file.
//! - Primitives of triangles, strips and fans: `POSITION`, `NORMAL`, `TANGENT`, `COLOR_0`, and the set of texture
//!   coordinates that the material's images use. Accessors may be sparse, or have integers. See
//!   [`primitives`].
//! - Materials of metallic-roughness: see [`materials`]. `KHR_texture_transform` is applied to coordinates.
//! - Nodes of the default scene, or of the first where there is none: see [`nodes`].
//! - Morph targets with the weights of the file, and skins: see [`poses`], [`posed`] and [`skins`].
//!
//! Left out with a note: animations, cameras, lights, points, lines, opacities of vertices, emission, occlusion,
//! filters of textures, and all else that the text has: see [`keys`]. A required extension that is not known is
//! an error.
//!
//! The library reads the JSON text. Its checks are not used: they panic where a primitive names an accessor
//! that is not there, and refuse files without bounds of positions, which nothing here needs. So every
//! number that stands for a part of the file is checked where it is used.
//!
//! # Source
//! Khronos Group, glTF 2.0 Specification.

mod accessors;
mod budget;
mod file;
mod keys;
mod materials;
mod nodes;
mod posed;
mod poses;
mod primitives;
mod skins;
mod uri;

use ::gltf::json;
use bokashi_description::{gltf_root, gltf_version, json_message};
use serde_json::error::Category;

use self::budget::Budget;
use self::file::GltfFile;
use self::nodes::Nodes;
use self::poses::Poses;
pub(crate) use self::uri::unescaped;
use crate::error::{Location, SceneError};
use crate::mesh::context::MeshContext;
use crate::mesh::notes::name;
use crate::model::Model;

/// The first bytes of a GLB.
const MAGIC: &[u8] = b"glTF";
/// The bytes before the chunks of a GLB.
const GLB_HEADER: u32 = 12;

/// What an object of the text takes in memory: it may be as short as two letters.
const BYTES_OF_AN_OBJECT: usize = 640;

/// The extensions that a file may require: those that are read, and those about looks, of which the rest of
/// the file has a simpler version.
const KNOWN: [&str; 4] =
    ["KHR_texture_transform", "KHR_mesh_quantization", "KHR_lights_punctual", "KHR_materials_"];

/// The model of a glTF file with these bytes.
pub(super) fn read(bytes: &[u8], context: &mut MeshContext<'_>) -> Result<Model, SceneError> {
    let location = context.location();
    let refused = |message: String| SceneError::content(location.clone(), message);
    let is_binary = bytes.starts_with(MAGIC);
    let (text, chunk) = match is_binary {
        true => {
            let word = |begin: usize| bytes.get(begin..).and_then(<[u8]>::first_chunk);
            let [version, length] =
                [4, 8].map(|begin| word(begin).map(|word| u32::from_le_bytes(*word)));
            if version.is_some_and(|version| version != 2) {
                return Err(refused(wrong_version(version.unwrap_or(0))));
            }
            // The library subtracts the header's length.
            if length.unwrap_or(0) < GLB_HEADER {
                let found = length.map_or("none".to_owned(), |length| length.to_string());
                let rule = format!("a GLB has a length of {GLB_HEADER} bytes or more");
                return Err(refused(format!("{rule}, and this has {found}")));
            }
            let file = ::gltf::Glb::from_slice(bytes);
            let rule = "a GLB has a chunk of JSON and perhaps one of bytes";
            let file = file.map_err(|error| refused(format!("{rule}: {error}")))?;
            (file.json, file.bin)
        }
        false => (bytes.into(), None),
    };
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let objects = text.iter().filter(|&&byte| byte == b'{').count();
    Budget::new(bytes.len()).spend(objects as u64, BYTES_OF_AN_OBJECT, &location)?;
    let root = gltf_root(text).map_err(|error| {
        // A file of version 1 has other parts altogether.
        if let Some(version) = gltf_version(text).filter(|version| !is_read(version)) {
            return refused(wrong_version(name(&version)));
        }
        let rule = match error.classify() {
            Category::Data => "a glTF file has the parts of the specification",
            _ => "a glTF file has a JSON text",
        };
        let [line, column] = [error.line(), error.column()]
            .map(|number| Some(number).filter(|&number| !is_binary && number > 0));
        let location = Location { line, column, ..location.clone() };
        SceneError::content(location, format!("{rule}: {}", json_message(&error)))
    })?;
    let version = root.asset.min_version.as_ref().unwrap_or(&root.asset.version);
    if !is_read(version) {
        return Err(refused(wrong_version(name(version))));
    }
    check_extensions(&root, context)?;
    keys::note(text, &mut context.notes).map_err(|error| refused(json_message(&error)))?;
    let nodes = Nodes::new(&root, &mut context.notes).map_err(&refused)?;
    let mut file = GltfFile::new(&root, chunk.as_deref(), bytes.len(), context);
    let mut model = Model::default();
    let mapped = materials::read(&mut file, &mut model)?;
    let poses = Poses::new(&nodes, &mut file)?;
    let geometries = primitives::read(&mut file, &mapped, &poses, &mut model)?;
    poses.add_to_model(&nodes, &geometries, &mut model, &mut file)?;
    model.images = std::mem::take(&mut context.images);
    model.notes = std::mem::take(&mut context.notes).finish();
    Ok(model)
}

/// Whether a file of this version is read.
fn is_read(version: &str) -> bool {
    version.split('.').next() == Some("2")
}

fn wrong_version(found: impl std::fmt::Display) -> String {
    format!("glTF of version 2 is read, and this is of version {found}")
}

fn check_extensions(root: &json::Root, context: &MeshContext<'_>) -> Result<(), SceneError> {
    let is_known = |extension: &&String| KNOWN.iter().any(|known| extension.starts_with(known));
    let mut unknown = root.extensions_required.iter().filter(|extension| !is_known(extension));
    if let Some(extension) = unknown.next() {
        let message = format!("the file requires {:?}", name(extension));
        let message = format!("a required extension is one that is read, and {message}");
        return Err(context.error(message));
    }
    Ok(())
}
