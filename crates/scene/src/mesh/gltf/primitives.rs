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
use std::collections::hash_map::Entry;
use std::hash::Hash;
use std::iter::repeat_n;
use std::rc::Rc;

use ::gltf::json::Index;
use ::gltf::json::accessor::Accessor;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;

use super::file::GltfFile;
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
    file: &mut GltfFile<'_, '_>,
    mapped: &[Mapping],
    poses: &Poses,
    model: &mut Model,
) -> Result<Vec<Option<usize>>, SceneError> {
    let (mut read, mut welder, mut all) = (Read::default(), Welder::default(), Vec::new());
    for (index, pose) in poses.all.iter().enumerate() {
        let (number, mesh) = (pose.mesh, &file.root.meshes[pose.mesh]);
        let mut drawn = Vec::new();
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let posed = Posed { primitive, pose, skins: &poses.skins };
            let primitives_drawn = Drawn::new(posed, index, mapped, file);
            drawn.extend(
                primitives_drawn
                    .map_err(|error| in_mesh(error, number, Some(k)))?
                    .map(|primitive| (k, primitive)),
            );
        }
        let keys: Vec<Key> = drawn.iter().map(|(_, drawn)| drawn.key).collect();
        if let Some(geometry) = read.geometries.get(&keys) {
            all.push(*geometry);
            continue;
        }
        let mut pieces = Vec::with_capacity(drawn.len());
        for (k, drawn) in drawn {
            let piece = drawn.piece(&mut read, file);
            pieces.push(piece.map_err(|error| in_mesh(error, number, Some(k)))?);
        }
        let surface = Surface::from_pieces(&pieces);
        file.spend(surface.copies() as u64, size_of::<f32>())?;
        let name = name(mesh.name.as_deref().unwrap_or_default());
        let welded = surface.weld(name, &mut welder, file.context);
        let geometry = welded.map_err(|error| in_mesh(error, number, None))?.map(|geometry| {
            model.geometries.push(geometry);
            model.geometries.len() - 1
        });
        read.geometries.insert(keys, geometry);
        all.push(geometry);
    }
    Ok(all)
}

/// An error of a mesh's primitive, or of the mesh.
fn in_mesh(error: SceneError, mesh: usize, primitive: Option<usize>) -> SceneError {
    let suffix = primitive.map_or(String::new(), |primitive| format!(", primitive {primitive}"));
    match error {
        SceneError::Content { location, message } => {
            SceneError::Content { location, message: format!("mesh {mesh}{suffix}: {message}") }
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
        welder.weld(raw, &context.location(), &mut context.notes)
    }
}

/// A primitive with faces, whose rows are not read yet.
#[derive(Debug, Clone, Copy)]
struct Drawn<'r> {
    posed: Posed<'r>,
    mode: Mode,
    mapping: Mapping,
    key: Key,
}

impl<'r> Drawn<'r> {
    /// That of a primitive in the pose with this number; nothing for points and lines.
    fn new(
        posed: Posed<'r>,
        pose: usize,
        mapped: &[Mapping],
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Option<Self>, SceneError> {
        let Primitive { attributes, indices, material, mode, .. } = posed.primitive;
        let Checked::Valid(mode) = *mode else {
            return Err(file.error("its mode is one of the specification"));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            file.note("points and lines were left out");
            return Ok(None);
        }
        let material = material.map(|material| material.value());
        let mapping = match material {
            None => Mapping::default(),
            Some(number) => *mapped.get(number).ok_or_else(|| {
                let count = mapped.len();
                file.error(format!("the file has {count} materials, and this names {number}"))
            })?,
        };
        let named = |what| attributes.get(&Checked::Valid(what)).copied();
        let accessors = [
            named(Semantic::Positions),
            named(Semantic::Normals),
            named(Semantic::Tangents),
            named(Semantic::Colors(0)),
            named(Semantic::TexCoords(mapping.set)),
            *indices,
        ];
        let pose = posed.moves().then_some(pose);
        let key = (accessors, mode.as_gl_enum(), material, pose);
        Ok(Some(Self { posed, mode, mapping, key }))
    }

    /// The primitive with its rows.
    fn piece(self, read: &mut Read, file: &mut GltfFile<'_, '_>) -> Result<Piece, SceneError> {
        let Self { posed, mode, mapping, key: (accessors, _, material, _) } = self;
        let is_unused = |what: &&Checked<Semantic>| matches!(what, Checked::Valid(Semantic::TexCoords(set)) if *set != mapping.set);
        let unused = posed.primitive.attributes.keys().filter(is_unused).count();
        let note = "texture coordinates that no image uses were left out";
        file.context.notes.count(note, unused);
        let [Some(positions), normals, tangents, colors, coordinates, indices] = accessors else {
            return Err(file.error("a primitive has positions, and this has none"));
        };
        let positions = read.vectors(positions, file)?;
        let count = positions.len();
        let normals = normals.map(|index| read.vectors(index, file)).transpose();
        // So the format has it.
        let tangents = match accessors[1].is_none() && tangents.is_some() {
            true => {
                file.note("tangents of a mesh without normals were left out");
                None
            }
            false => tangents,
        };
        let tangents = tangents.map(|index| read.tangents(index, file)).transpose();
        let colors = colors.map(|index| read.colors(index, file)).transpose();
        let coordinates =
            coordinates.map(|index| read.coordinates(index, mapping.transform, file)).transpose();
        let (normals, tangents, colors, coordinates) = (normals?, tangents?, colors?, coordinates?);
        let counts = [
            ("normals", normals.as_ref().map(|rows| rows.len())),
            ("tangents", tangents.as_ref().map(|rows| rows.len())),
            ("colours", colors.as_ref().map(|rows| rows.len())),
            ("coordinates", coordinates.as_ref().map(|rows| rows.len())),
        ];
        for (what, found) in counts {
            if let Some(found) = found.filter(|&found| found != count) {
                let rule = format!("there are as many {what} as positions, {count}");
                return Err(file.error(format!("{rule}, and these are {found}")));
            }
        }
        let vertices = Vertices { positions, normals, tangents, is_mirrored: false };
        let Vertices { positions, normals, tangents, is_mirrored } =
            posed.vertices(vertices, file)?;
        let indices = match indices {
            Some(index) => file.indices(index)?,
            None => {
                file.spend(count as u64, size_of::<u32>())?;
                (0..count as u32).collect()
            }
        };
        if let Some(k) = indices.iter().position(|&index| index as usize >= count) {
            let rule = format!("an index is below the number of positions, {count}");
            return Err(file.error(format!("{rule}, and index {k} is {}", indices[k])));
        }
        // As many faces as indices where they are a strip; index buffers for each attribute, and the rows.
        let bytes = 4 * size_of::<[u32; 3]>() + size_of::<[f32; 15]>();
        file.spend(indices.len() as u64, bytes)?;
        let mut faces = faces(&indices, mode).map_err(|rule| file.error(rule))?;
        if is_mirrored {
            faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        Ok(Piece { material, faces, positions, normals, tangents, colors, coordinates })
    }
}

impl Read {
    fn vectors(
        &mut self,
        index: Index<Accessor>,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Rows<3>, SceneError> {
        once(&mut self.vectors, index.value(), || file.rows(index, &[3], false))
    }

    fn tangents(
        &mut self,
        index: Index<Accessor>,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Rows<4>, SceneError> {
        once(&mut self.tangents, index.value(), || file.rows(index, &[4], false))
    }

    fn colors(
        &mut self,
        index: Index<Accessor>,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Rows<3>, SceneError> {
        once(&mut self.colors, index.value(), || {
            let rows = file.rows::<4>(index, &[3, 4], true)?;
            if rows.iter().any(|row| row[3] != 1.0) {
                file.note("opacities of vertices were left out");
            }
            let light = |number: f32| match file.context.options.vertex_color_space {
                Some(ColorSpace::Srgb) => decoded(number.into()),
                Some(ColorSpace::Linear) | None => number,
            };
            Ok(rows.into_iter().map(|[r, g, b, _]| [r, g, b].map(light)).collect())
        })
    }

    fn coordinates(
        &mut self,
        index: Index<Accessor>,
        transform: Option<Transform>,
        file: &mut GltfFile<'_, '_>,
    ) -> Result<Rows<2>, SceneError> {
        const IDENTITY: Transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let transform = transform.unwrap_or(IDENTITY);
        let key = (index.value(), transform.map(|row| row.map(f32::to_bits)));
        once(&mut self.coordinates, key, || {
            let mut rows = file.rows::<2>(index, &[2], false)?;
            for row in rows.iter_mut().filter(|_| transform != IDENTITY) {
                *row = transform.map(|[u, v, shift]| u * row[0] + v * row[1] + shift);
            }
            Ok(rows)
        })
    }
}

/// The rows with this key, which are read the first time.
fn once<K: Eq + Hash, const N: usize>(
    all: &mut HashMap<K, Rows<N>>,
    key: K,
    read: impl FnOnce() -> Result<Vec<[f32; N]>, SceneError>,
) -> Result<Rows<N>, SceneError> {
    Ok(match all.entry(key) {
        Entry::Occupied(entry) => entry.get().clone(),
        Entry::Vacant(entry) => entry.insert(read()?.into()).clone(),
    })
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
