//! Primitives: the parts of meshes, each with a material of its own.
//!
//! - Triangles, strips and fans, with indices of 8, 16 or 32 bits or none.
//! - `POSITION` and `NORMAL`, of any type that `KHR_mesh_quantization` allows.
//! - `COLOR_0`, linear, of integers (which are fractions) or floats; an opacity is left out.
//! - The set of `TEXCOORD` that the material's images use; the first one without an image. v runs down, as
//!   everywhere here.
//!
//! Primitives that name the same accessors and material are one geometry.

use std::borrow::Cow;
use std::collections::HashMap;
use std::rc::Rc;

use ::gltf::json::accessor::Accessor;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root};

use super::accessors::Named;
use super::buffers::Buffers;
use super::materials::{Mapping, Transform};
use crate::error::SceneError;
use crate::mesh::beside::Beside;
use crate::mesh::notes::name;
use crate::mesh::weld::{Corners, Raw, Welder};
use crate::model::Model;

/// The rows of an accessor, which primitives share.
type Rows<const N: usize> = Rc<Vec<[f32; N]>>;

/// What tells primitives apart: accessors of positions, normals, colours, coordinates and indices, the mode,
/// and the material.
type Key = ([Option<Index<Accessor>>; 5], u32, Option<usize>);

/// What was read of a file's accessors.
#[derive(Debug, Default)]
struct Read {
    vectors: HashMap<usize, Rows<3>>,
    colors: HashMap<usize, Rows<3>>,
    /// By accessor, and by the bits of a transform.
    coordinates: HashMap<(usize, [[u32; 3]; 2]), Rows<2>>,
    geometries: HashMap<Key, Option<usize>>,
}

/// Reads the meshes into the model. Of each mesh, the numbers of its geometries.
pub(super) fn read(
    root: &Root,
    buffers: &mut Buffers<'_>,
    mapped: &[Mapping],
    model: &mut Model,
    beside: &mut Beside<'_>,
) -> Result<Vec<Vec<usize>>, SceneError> {
    let (mut read, mut welder, mut meshes) = (Read::default(), Welder::default(), Vec::new());
    for (number, mesh) in root.meshes.iter().enumerate() {
        let mut geometries = Vec::new();
        let name = name(mesh.name.as_deref().unwrap_or_default());
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            if primitive.targets.is_some() {
                beside.notes.add("morph targets were left out");
            }
            let of = Of { root, mapped, primitive, name: &name };
            let found = of.geometry(&mut read, &mut welder, buffers, model, beside);
            let found = found.map_err(|error| match error {
                SceneError::Content { place, message } => {
                    let message = format!("mesh {number}, primitive {k}: {message}");
                    SceneError::Content { place, message }
                }
                other => other,
            })?;
            geometries.extend(found);
        }
        meshes.push(geometries);
    }
    Ok(meshes)
}

/// A primitive of a file.
#[derive(Debug, Clone, Copy)]
struct Of<'r> {
    root: &'r Root,
    mapped: &'r [Mapping],
    primitive: &'r Primitive,
    /// The mesh's name.
    name: &'r str,
}

impl Of<'_> {
    /// The number of the primitive's geometry, where it has a face.
    fn geometry(
        self,
        read: &mut Read,
        welder: &mut Welder,
        buffers: &mut Buffers<'_>,
        model: &mut Model,
        beside: &mut Beside<'_>,
    ) -> Result<Option<usize>, SceneError> {
        let refused = |beside: &Beside<'_>, rule: String| SceneError::content(beside.place(), rule);
        let Checked::Valid(mode) = self.primitive.mode else {
            return Err(refused(beside, "its mode is one of the specification".to_owned()));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            beside.notes.add("points and lines were left out");
            return Ok(None);
        }
        let material = self.primitive.material.map(|material| material.value());
        let mapping = match material.map(|material| self.mapped.get(material)) {
            None => Mapping::default(),
            Some(Some(mapping)) => *mapping,
            Some(None) => {
                let found = self.mapped.len();
                let rule = format!("the file has {found} materials, and this names {material:?}");
                return Err(refused(beside, rule));
            }
        };
        let named = |what| self.primitive.attributes.get(&Checked::Valid(what)).copied();
        let accessors = [
            named(Semantic::Positions),
            named(Semantic::Normals),
            named(Semantic::Colors(0)),
            named(Semantic::TexCoords(mapping.set)),
            self.primitive.indices,
        ];
        let key = (accessors, mode.as_gl_enum(), material);
        if let Some(found) = read.geometries.get(&key) {
            return Ok(*found);
        }
        let [Some(positions), normals, colors, coordinates, indices] = accessors else {
            return Err(refused(beside, "a primitive has positions, and this has none".to_owned()));
        };
        let positions = read.vectors(self.root, positions, buffers, beside)?;
        let count = positions.len();
        let normals = normals.map(|index| read.vectors(self.root, index, buffers, beside));
        let colors = colors.map(|index| read.colors(self.root, index, buffers, beside));
        let coordinates = coordinates
            .map(|index| read.coordinates(self.root, index, mapping.transform, buffers, beside));
        let (normals, colors, coordinates) =
            (normals.transpose()?, colors.transpose()?, coordinates.transpose()?);
        let counts = [
            ("normals", normals.as_ref().map(|rows| rows.len())),
            ("colours", colors.as_ref().map(|rows| rows.len())),
            ("coordinates", coordinates.as_ref().map(|rows| rows.len())),
        ];
        for (what, found) in counts {
            if let Some(found) = found.filter(|&found| found != count) {
                let rule = format!("there are as many {what} as positions, {count}");
                return Err(refused(beside, format!("{rule}, and these are {found}")));
            }
        }
        let indices = match indices {
            Some(index) => Named::of(self.root, index, beside)?.indices(buffers, beside)?,
            None => {
                buffers.budget.spend(count as u64, size_of::<u32>(), &beside.place())?;
                (0..count as u32).collect()
            }
        };
        if let Some(k) = indices.iter().position(|&index| index as usize >= count) {
            let rule = format!("an index is below the number of positions, {count}");
            return Err(refused(beside, format!("{rule}, and index {k} is {}", indices[k])));
        }
        // As many faces as indices where they are a strip; index buffers for each attribute, and the rows.
        let bytes = 4 * size_of::<[u32; 3]>() + size_of::<[f32; 11]>();
        buffers.budget.spend(indices.len() as u64, bytes, &beside.place())?;
        let faces = faces(&indices, mode).map_err(|rule| refused(beside, rule))?;
        drop(indices);
        let faces = Cow::Borrowed(faces.as_slice());
        let raw = Raw {
            name: self.name.to_owned(),
            material,
            positions: Corners { rows: &positions, faces: faces.clone() },
            colors: colors.as_ref().map(|rows| Corners { rows, faces: faces.clone() }),
            coordinates: coordinates.as_ref().map(|rows| Corners { rows, faces: faces.clone() }),
            normals: normals.as_ref().map(|rows| Corners { rows, faces: faces.clone() }),
        };
        let welded = welder.weld(raw, &beside.place(), &mut beside.notes)?;
        let found = welded.map(|geometry| {
            model.geometries.push(geometry);
            model.geometries.len() - 1
        });
        read.geometries.insert(key, found);
        Ok(found)
    }
}

impl Read {
    fn vectors(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        buffers: &mut Buffers<'_>,
        beside: &Beside<'_>,
    ) -> Result<Rows<3>, SceneError> {
        if let Some(rows) = self.vectors.get(&index.value()) {
            return Ok(rows.clone());
        }
        let rows = Named::of(root, index, beside)?.rows(&[3], false, buffers, beside)?;
        Ok(self.vectors.entry(index.value()).or_insert(rows.into()).clone())
    }

    fn colors(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        buffers: &mut Buffers<'_>,
        beside: &mut Beside<'_>,
    ) -> Result<Rows<3>, SceneError> {
        if let Some(rows) = self.colors.get(&index.value()) {
            return Ok(rows.clone());
        }
        let rows = Named::of(root, index, beside)?.rows::<4>(&[3, 4], true, buffers, beside)?;
        if rows.iter().any(|row| row[3] != 1.0) {
            beside.notes.add("opacities of vertices were left out");
        }
        let rows: Vec<[f32; 3]> = rows.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
        Ok(self.colors.entry(index.value()).or_insert(rows.into()).clone())
    }

    fn coordinates(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        transform: Option<Transform>,
        buffers: &mut Buffers<'_>,
        beside: &Beside<'_>,
    ) -> Result<Rows<2>, SceneError> {
        let transform = transform.unwrap_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let key = (index.value(), transform.map(|row| row.map(f32::to_bits)));
        if let Some(rows) = self.coordinates.get(&key) {
            return Ok(rows.clone());
        }
        let mut rows = Named::of(root, index, beside)?.rows::<2>(&[2], false, buffers, beside)?;
        if transform != [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            for row in &mut rows {
                *row = transform.map(|[u, v, shift]| u * row[0] + v * row[1] + shift);
            }
        }
        Ok(self.coordinates.entry(key).or_insert(rows.into()).clone())
    }
}

/// The triangles of a primitive, in the order of the specification.
fn faces(indices: &[u32], mode: Mode) -> Result<Vec<[u32; 3]>, String> {
    if mode == Mode::Triangles {
        let (faces, rest) = indices.as_chunks::<3>();
        return match rest.is_empty() {
            true => Ok(faces.to_vec()),
            false => Err(format!("a triangle has three corners, and here are {}", indices.len())),
        };
    }
    if mode == Mode::TriangleFan {
        let pairs = indices.get(1..).unwrap_or_default().windows(2);
        return Ok(pairs.map(|pair| [pair[0], pair[1], indices[0]]).collect());
    }
    let triangle = |(k, corners): (usize, &[u32])| match k % 2 {
        0 => [corners[0], corners[1], corners[2]],
        // Every second triangle of a strip runs the other way.
        _ => [corners[0], corners[2], corners[1]],
    };
    Ok(indices.windows(3).enumerate().map(triangle).collect())
}
