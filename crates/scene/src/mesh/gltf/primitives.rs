//! Primitives: the parts of meshes, each with a material of its own.
//!
//! - Triangles, strips and fans, with indices of 8, 16 or 32 bits or none.
//! - `POSITION`, `NORMAL` and `TANGENT`, of any type that `KHR_mesh_quantization` allows.
//! - `COLOR_0`, linear unless the caller says otherwise, of integers (which are fractions) or floats; an opacity
//!   is left out.
//! - The set of `TEXCOORD` that the material's images use; the first one without an image. v runs down, as
//!   everywhere here.
//!
//! Morph targets and skins are applied, as the poses have them: see [`posed`](super::posed).
//!
//! The primitives of a mesh in a pose are one geometry, whose submeshes they are: their vertices are welded
//! together. Meshes whose primitives name the same accessors and materials are one geometry, where no pose moves
//! them.

use std::borrow::Cow;
use std::collections::HashMap;
use std::iter::repeat_n;
use std::rc::Rc;

use ::gltf::json::accessor::Accessor;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root};

use super::accessors::Named;
use super::buffers::Buffers;
use super::materials::{Mapping, Transform};
use super::posed::{Posed, Rows, Vertices};
use super::poses::Poses;
use crate::error::SceneError;
use crate::mesh::colors::decoded;
use crate::mesh::context::MeshContext;
use crate::mesh::notes::name;
use crate::mesh::weld::{Corners, Raw, Welder};
use crate::model::{Geometry, Model, NO_ROW, Submesh};
use crate::picture::ColorSpace;

/// What tells primitives apart: accessors of positions, normals, tangents, colours, coordinates and indices, the
/// mode, the material, and the pose where it moves vertices.
type Key = ([Option<Index<Accessor>>; 6], u32, Option<usize>, Option<usize>);

/// What was read of a file's accessors.
#[derive(Debug, Default)]
struct Read {
    vectors: HashMap<usize, Rows<3>>,
    tangents: HashMap<usize, Rows<4>>,
    colors: HashMap<usize, Rows<3>>,
    /// By accessor, and by the bits of a transform.
    coordinates: HashMap<(usize, [[u32; 3]; 2]), Rows<2>>,
    geometries: HashMap<Vec<Key>, Option<usize>>,
}

/// A primitive with its rows.
#[derive(Debug)]
struct Piece {
    material: Option<usize>,
    faces: Vec<[u32; 3]>,
    positions: Rows<3>,
    normals: Option<Rows<3>>,
    tangents: Option<Rows<4>>,
    colors: Option<Rows<3>>,
    coordinates: Option<Rows<2>>,
}

/// The rows of several accessors, one after another, and the faces of pieces that name them.
#[derive(Debug, Default)]
struct Joined<const N: usize> {
    accessors: Vec<Rows<N>>,
    /// Of each accessor, by where its rows are, the number of the first.
    firsts: HashMap<*const Vec<[f32; N]>, u32>,
    count: usize,
    faces: Vec<[u32; 3]>,
}

/// The primitives of a mesh as one surface.
#[derive(Debug, Default)]
struct Surface {
    submeshes: Vec<Submesh>,
    positions: Joined<3>,
    normals: Joined<3>,
    tangents: Joined<4>,
    colors: Joined<3>,
    coordinates: Joined<2>,
}

/// Reads the meshes into the model, in all of their poses. Of each pose, the number of its geometry, where it has
/// a face.
pub(super) fn read(
    root: &Root,
    buffers: &mut Buffers<'_>,
    mapped: &[Mapping],
    poses: &Poses,
    model: &mut Model,
    context: &mut MeshContext<'_>,
) -> Result<Vec<Option<usize>>, SceneError> {
    let (mut read, mut welder, mut all) = (Read::default(), Welder::default(), Vec::new());
    for (at, pose) in poses.all.iter().enumerate() {
        let (number, mesh) = (pose.mesh, &root.meshes[pose.mesh]);
        let mut drawn = Vec::new();
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let posed = Posed { root, primitive, pose, skins: &poses.skins };
            let of = Of { root, mapped, primitive, posed, pose: at };
            let key = of.key(context).map_err(|error| in_mesh(error, number, Some(k)))?;
            drawn.extend(key.map(|key| (k, of, key)));
        }
        let keys: Vec<Key> = drawn.iter().map(|(.., key)| *key).collect();
        if let Some(found) = read.geometries.get(&keys) {
            all.push(*found);
            continue;
        }
        let mut pieces = Vec::with_capacity(drawn.len());
        for (k, of, key) in drawn {
            let piece = of.piece(key, &mut read, buffers, context);
            pieces.push(piece.map_err(|error| in_mesh(error, number, Some(k)))?);
        }
        let surface = Surface::from_pieces(&pieces);
        buffers.budget.spend(surface.copies() as u64, size_of::<f32>(), &context.place())?;
        let name = name(mesh.name.as_deref().unwrap_or_default());
        let welded = surface.weld(name, &mut welder, context);
        let found = welded.map_err(|error| in_mesh(error, number, None))?.map(|geometry| {
            model.geometries.push(geometry);
            model.geometries.len() - 1
        });
        read.geometries.insert(keys, found);
        all.push(found);
    }
    Ok(all)
}

/// An error of a mesh's primitive, or of the mesh.
fn in_mesh(error: SceneError, mesh: usize, primitive: Option<usize>) -> SceneError {
    let of = primitive.map_or(String::new(), |primitive| format!(", primitive {primitive}"));
    match error {
        SceneError::Content { place, message } => {
            SceneError::Content { place, message: format!("mesh {mesh}{of}: {message}") }
        }
        other => other,
    }
}

impl<const N: usize> Joined<N> {
    /// Adds faces that name these rows; without rows, faces that name none.
    fn add(&mut self, rows: Option<&Rows<N>>, faces: &[[u32; 3]]) {
        let Some(rows) = rows else {
            self.faces.extend(repeat_n([NO_ROW; 3], faces.len()));
            return;
        };
        let next = self.count as u32;
        let first = *self.firsts.entry(Rc::as_ptr(rows)).or_insert_with(|| {
            self.accessors.push(rows.clone());
            self.count += rows.len();
            next
        });
        self.faces.extend(faces.iter().map(|face| face.map(|row| first + row)));
    }

    /// How many numbers [`Joined::rows`] copies.
    fn copies(&self) -> usize {
        if self.accessors.len() > 1 { N * self.count } else { 0 }
    }

    /// All rows: a copy where there are several accessors.
    fn rows(&self) -> Cow<'_, [[f32; N]]> {
        match self.accessors.as_slice() {
            [only] => Cow::Borrowed(only),
            all => Cow::Owned(all.iter().flat_map(|rows| rows.iter().copied()).collect()),
        }
    }
}

/// The corners with these rows; nothing where there are none.
fn corners<'a, const N: usize>(
    rows: &'a [[f32; N]],
    joined: &'a Joined<N>,
) -> Option<Corners<'a, N>> {
    let faces = Cow::Borrowed(joined.faces.as_slice());
    (!rows.is_empty()).then_some(Corners { rows, faces })
}

impl Surface {
    fn from_pieces(pieces: &[Piece]) -> Self {
        let mut all = Self::default();
        for piece in pieces {
            let Piece { faces, positions, normals, tangents, colors, coordinates, .. } = piece;
            let begin = all.positions.faces.len();
            all.positions.add(Some(positions), faces);
            all.normals.add(normals.as_ref(), faces);
            all.tangents.add(tangents.as_ref(), faces);
            all.colors.add(colors.as_ref(), faces);
            all.coordinates.add(coordinates.as_ref(), faces);
            let faces = begin..all.positions.faces.len();
            all.submeshes.push(Submesh { material: piece.material, faces });
        }
        all
    }

    /// How many numbers are copied to bring the rows together.
    fn copies(&self) -> usize {
        let Self { positions, normals, tangents, colors, coordinates, .. } = self;
        let vectors = [positions, normals, colors].map(Joined::copies);
        vectors.iter().sum::<usize>() + tangents.copies() + coordinates.copies()
    }

    fn weld(
        self,
        name: String,
        welder: &mut Welder,
        context: &mut MeshContext<'_>,
    ) -> Result<Option<Geometry>, SceneError> {
        let [positions, normals, colors] =
            [&self.positions, &self.normals, &self.colors].map(Joined::rows);
        let (tangents, coordinates) = (self.tangents.rows(), self.coordinates.rows());
        let Some(places) = corners(&positions, &self.positions) else { return Ok(None) };
        let raw = Raw {
            name,
            submeshes: self.submeshes.clone(),
            is_welded: context.options.weld.unwrap_or(true),
            positions: places,
            colors: corners(&colors, &self.colors),
            coordinates: corners(&coordinates, &self.coordinates),
            normals: corners(&normals, &self.normals),
            tangents: corners(&tangents, &self.tangents),
        };
        welder.weld(raw, &context.place(), &mut context.notes)
    }
}

/// A primitive of a file.
#[derive(Debug, Clone, Copy)]
struct Of<'r> {
    root: &'r Root,
    mapped: &'r [Mapping],
    primitive: &'r Primitive,
    posed: Posed<'r>,
    /// The pose's number.
    pose: usize,
}

fn refused(context: &MeshContext<'_>, rule: String) -> SceneError {
    SceneError::content(context.place(), rule)
}

impl Of<'_> {
    /// The coordinates that the primitive's material uses.
    fn mapping(self, context: &MeshContext<'_>) -> Result<Mapping, SceneError> {
        let Some(material) = self.primitive.material else { return Ok(Mapping::default()) };
        self.mapped.get(material.value()).copied().ok_or_else(|| {
            let (found, number) = (self.mapped.len(), material.value());
            refused(context, format!("the file has {found} materials, and this names {number}"))
        })
    }

    fn mode(self, context: &MeshContext<'_>) -> Result<Mode, SceneError> {
        match self.primitive.mode {
            Checked::Valid(mode) => Ok(mode),
            Checked::Invalid => {
                Err(refused(context, "its mode is one of the specification".to_owned()))
            }
        }
    }

    /// What tells the primitive from others; nothing where it has no faces.
    fn key(self, context: &mut MeshContext<'_>) -> Result<Option<Key>, SceneError> {
        let mode = self.mode(context)?;
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            context.notes.add("points and lines were left out");
            return Ok(None);
        }
        let set = self.mapping(context)?.set;
        let named = |what| self.primitive.attributes.get(&Checked::Valid(what)).copied();
        let accessors = [
            named(Semantic::Positions),
            named(Semantic::Normals),
            named(Semantic::Tangents),
            named(Semantic::Colors(0)),
            named(Semantic::TexCoords(set)),
            self.primitive.indices,
        ];
        let material = self.primitive.material.map(|material| material.value());
        let pose = self.posed.moves().then_some(self.pose);
        Ok(Some((accessors, mode.as_gl_enum(), material, pose)))
    }

    /// The primitive with its rows. `key` is its own.
    fn piece(
        self,
        (accessors, _, material, _): Key,
        read: &mut Read,
        buffers: &mut Buffers<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<Piece, SceneError> {
        let mapping = self.mapping(context)?;
        let is_unused = |what: &&Checked<Semantic>| matches!(what, Checked::Valid(Semantic::TexCoords(set)) if *set != mapping.set);
        let unused = self.primitive.attributes.keys().filter(is_unused).count();
        context.notes.count("texture coordinates that no image uses were left out", unused);
        let [Some(positions), normals, tangents, colors, coordinates, indices] = accessors else {
            return Err(refused(
                context,
                "a primitive has positions, and this has none".to_owned(),
            ));
        };
        let positions = read.vectors(self.root, positions, buffers, context)?;
        let count = positions.len();
        let normals = normals.map(|index| read.vectors(self.root, index, buffers, context));
        // So the format has it.
        let tangents = match normals.is_none() && tangents.is_some() {
            true => {
                context.notes.add("tangents of a mesh without normals were left out");
                None
            }
            false => tangents.map(|index| read.tangents(self.root, index, buffers, context)),
        };
        let colors = colors.map(|index| read.colors(self.root, index, buffers, context));
        let coordinates = coordinates
            .map(|index| read.coordinates(self.root, index, mapping.transform, buffers, context));
        let (normals, tangents) = (normals.transpose()?, tangents.transpose()?);
        let (colors, coordinates) = (colors.transpose()?, coordinates.transpose()?);
        let counts = [
            ("normals", normals.as_ref().map(|rows| rows.len())),
            ("tangents", tangents.as_ref().map(|rows| rows.len())),
            ("colours", colors.as_ref().map(|rows| rows.len())),
            ("coordinates", coordinates.as_ref().map(|rows| rows.len())),
        ];
        for (what, found) in counts {
            if let Some(found) = found.filter(|&found| found != count) {
                let rule = format!("there are as many {what} as positions, {count}");
                return Err(refused(context, format!("{rule}, and these are {found}")));
            }
        }
        let posed = Vertices { positions, normals, tangents, is_mirrored: false };
        let Vertices { positions, normals, tangents, is_mirrored } =
            self.posed.vertices(posed, buffers, context)?;
        let indices = match indices {
            Some(index) => Named::of(self.root, index, context)?.indices(buffers, context)?,
            None => {
                buffers.budget.spend(count as u64, size_of::<u32>(), &context.place())?;
                (0..count as u32).collect()
            }
        };
        if let Some(k) = indices.iter().position(|&index| index as usize >= count) {
            let rule = format!("an index is below the number of positions, {count}");
            return Err(refused(context, format!("{rule}, and index {k} is {}", indices[k])));
        }
        // As many faces as indices where they are a strip; index buffers for each attribute, and the rows.
        let bytes = 4 * size_of::<[u32; 3]>() + size_of::<[f32; 15]>();
        buffers.budget.spend(indices.len() as u64, bytes, &context.place())?;
        let mut faces =
            faces(&indices, self.mode(context)?).map_err(|rule| refused(context, rule))?;
        if is_mirrored {
            faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        Ok(Piece { material, faces, positions, normals, tangents, colors, coordinates })
    }
}

impl Read {
    fn vectors(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Rows<3>, SceneError> {
        if let Some(rows) = self.vectors.get(&index.value()) {
            return Ok(rows.clone());
        }
        let rows = Named::of(root, index, context)?.rows(&[3], false, buffers, context)?;
        Ok(self.vectors.entry(index.value()).or_insert(rows.into()).clone())
    }

    fn tangents(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Rows<4>, SceneError> {
        if let Some(rows) = self.tangents.get(&index.value()) {
            return Ok(rows.clone());
        }
        let rows = Named::of(root, index, context)?.rows(&[4], false, buffers, context)?;
        Ok(self.tangents.entry(index.value()).or_insert(rows.into()).clone())
    }

    fn colors(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        buffers: &mut Buffers<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<Rows<3>, SceneError> {
        if let Some(rows) = self.colors.get(&index.value()) {
            return Ok(rows.clone());
        }
        let rows = Named::of(root, index, context)?.rows::<4>(&[3, 4], true, buffers, context)?;
        if rows.iter().any(|row| row[3] != 1.0) {
            context.notes.add("opacities of vertices were left out");
        }
        let light = |number: f32| match context.options.vertex_color_space {
            Some(ColorSpace::Srgb) => decoded(number.into()),
            Some(ColorSpace::Linear) | None => number,
        };
        let rows: Vec<[f32; 3]> =
            rows.into_iter().map(|[r, g, b, _]| [r, g, b].map(light)).collect();
        Ok(self.colors.entry(index.value()).or_insert(rows.into()).clone())
    }

    fn coordinates(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        transform: Option<Transform>,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Rows<2>, SceneError> {
        let transform = transform.unwrap_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let key = (index.value(), transform.map(|row| row.map(f32::to_bits)));
        if let Some(rows) = self.coordinates.get(&key) {
            return Ok(rows.clone());
        }
        let mut rows = Named::of(root, index, context)?.rows::<2>(&[2], false, buffers, context)?;
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
