//! One mesh or one image of a file as tensors, for programs that need no scene.

use std::path::Path;

use bokashi_core::Tensor;
use bokashi_render_ops::Mesh;
use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::error::{Location, SceneError};
use crate::file::read_file;
use crate::folder::Folder;
use crate::memory::Memory;
use crate::mesh::read_model;
use crate::model::{Geometry, Indexed, MaterialFile, Model, Submesh, covers, far_offset};
use crate::object::{Attribute, SurfaceMaterial};
use crate::picture::{ColorSpace, Picture};

/// Bytes of a vertex and of a face, with what may be at them, as they are joined.
const OF_CORNER: u64 = 96;

/// A mesh of a file as operations take it: all of its surfaces as one, where the file places them.
#[derive(Debug, Clone)]
pub struct LoadedMesh {
    /// Its faces, counter-clockwise seen from outside.
    pub mesh: Mesh,
    /// Vertices `[V, 3]`, without `offset`.
    pub positions: Tensor<f32>,
    /// What was taken off positions that lie far from the origin, as those of maps do: whole numbers, mostly 0.
    pub offset: DVec3,
    /// Linear colours `[A, 3]`, where all surfaces have some.
    pub colors: Option<Attribute>,
    /// Texture coordinates `[A, 2]`, v down from row 0 of the texture, where all surfaces have some.
    pub coordinates: Option<Attribute>,
    /// Unit normals `[A, 3]`, where all surfaces have some.
    pub normals: Option<Attribute>,
    /// Base colours `[H, W, 3]`, linear, where all surfaces have the same texture.
    pub texture: Option<Tensor<f32>>,
    /// The linear base colour of a mesh without a texture; white where surfaces differ.
    pub base_color: [f32; 3],
    /// What the file holds that was left out or mended, in words.
    pub notes: Vec<String>,
}

/// The mesh file at `path`, in any format that scenes take, with the materials and images that it names. A surface
/// that the file places several times is there as often.
///
/// # Errors
/// As [`read_model`].
pub fn load_mesh(path: impl AsRef<Path>) -> Result<LoadedMesh, SceneError> {
    let path = path.as_ref();
    let folder = Folder::new(path.parent().unwrap_or(Path::new("")))?;
    let name = path.file_name().map_or(path, Path::new);
    LoadedMesh::from_model(&read_model(&folder, name)?, &Location::new(path))
}

/// The light of the image at `path`, a PNG, JPEG, EXR or HDR: `[H, W, C]`, with the channels that it has, one to
/// four. The second of two and the fourth of four are opacity. Colours of PNG and JPEG are read as sRGB, those of
/// EXR and HDR as linear; [`Picture`] reads others.
///
/// # Errors
/// [`SceneError::Read`] where the file can't be read; otherwise as [`Picture::decode`].
pub fn load_image(path: impl AsRef<Path>) -> Result<Tensor<f32>, SceneError> {
    let path = path.as_ref();
    let picture = Picture::decode(&read_file(path)?, &Location::new(path))?;
    Ok(picture.light(ColorSpace::for_picture(&picture)))
}

/// A surface, and where it stands.
type Part<'m> = (&'m Geometry, DMat4);

impl LoadedMesh {
    fn from_model(model: &Model, location: &Location) -> Result<Self, SceneError> {
        let placed = model.placed.iter();
        let parts: Vec<Part<'_>> =
            placed.map(|placed| (&model.geometries[placed.geometry], placed.transform)).collect();
        check_memory(&parts, location)?;
        let (mut points, mut faces) = (Vec::<DVec3>::new(), Vec::new());
        for (geometry, matrix) in &parts {
            let first = points.len() as u32;
            let moved = |&point: &[f32; 3]| matrix.transform_point3(Vec3::from(point).as_dvec3());
            points.extend(geometry.positions.iter().map(moved));
            faces.extend(turned(&geometry.faces, matrix).map(|face| face.map(|k| first + k)));
        }
        let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let offset = far_offset(
            points.iter().fold(bounds, |[least, most], &point| [least.min(point), most.max(point)]),
        );
        let near = |&point: &DVec3| (point - offset).as_vec3().to_array();
        let positions: Vec<[f32; 3]> = points.iter().map(near).collect();
        let mut notes = model.notes.clone();
        let colors = joined(
            &parts,
            "colours",
            |geometry| geometry.colors.as_ref(),
            |_, row| row,
            &mut notes,
        )?;
        let coordinates = joined(
            &parts,
            "texture coordinates",
            |geometry| geometry.coordinates.as_ref(),
            |_, row| row,
            &mut notes,
        )?;
        let turn = |matrix: &DMat4, row: [f32; 3]| {
            let normal =
                DMat3::from_mat4(*matrix).inverse().transpose() * DVec3::from(row.map(f64::from));
            normal.normalize_or_zero().as_vec3().to_array()
        };
        let normals =
            joined(&parts, "normals", |geometry| geometry.normals.as_ref(), turn, &mut notes)?;

        let BaseColor { base_color, image } = base_color(&parts, model, &mut notes);
        let texture = image.filter(|_| coordinates.is_some()).and_then(|k| model.images.get(k));
        let texture = texture.map(|image| {
            let texels = image.color(ColorSpace::Srgb);
            Tensor::from_flat_fn(texels.shape(), |k| texels.data()[k] * base_color[k % 3])
        });
        Ok(Self {
            mesh: Mesh::new(faces, positions.len())?,
            positions: positions.into(),
            offset,
            colors,
            coordinates,
            normals,
            texture,
            base_color,
            notes,
        })
    }
}

/// Checks that memory holds the mesh of all parts.
fn check_memory(parts: &[Part<'_>], location: &Location) -> Result<(), SceneError> {
    let corners = parts.iter().map(|(geometry, _)| geometry.positions.len() + geometry.faces.len());
    let corners = corners.map(|count| count as u64).sum::<u64>();
    let what = || format!("a mesh of {corners} vertices and faces");
    Memory::default().check(corners.saturating_mul(OF_CORNER), location, what)
}

/// The base colour of all parts, and notes of what a loaded mesh has not.
fn base_color(parts: &[Part<'_>], model: &Model, notes: &mut Vec<String>) -> BaseColor {
    let colors_of_parts = parts.iter().flat_map(|(geometry, _)| {
        geometry.submeshes.iter().map(move |submesh| BaseColor::new(geometry, submesh, model))
    });
    let mut base_colors: Vec<BaseColor> = colors_of_parts.collect();
    base_colors.dedup();
    let all = match base_colors[..] {
        [only] => only,
        _ => {
            notes.push("surfaces have several materials, which were left out".to_owned());
            BaseColor { base_color: [1.0; 3], image: None }
        }
    };
    if materials(parts, model).any(says_more) {
        let rest = "roughness, metallic, normal maps and opacity of materials were left out";
        notes.push(format!("{rest}: a loaded mesh has its base colour alone"));
    }
    all
}

/// The materials of parts.
fn materials<'m>(parts: &[Part<'m>], model: &'m Model) -> impl Iterator<Item = &'m MaterialFile> {
    let numbers = parts.iter().flat_map(|(geometry, _)| geometry.materials().flatten());
    numbers.filter_map(|number| model.materials.get(number))
}

/// Whether a material says more than its base colour.
fn says_more(material: &MaterialFile) -> bool {
    let MaterialFile {
        base_color, metallic, roughness, metallic_roughness_map, normal_map, ..
    } = material;
    // A dielectric of roughness 1 is what a file without a word is.
    (*metallic, *roughness, base_color[3]) != (0.0, 1.0, 1.0)
        || metallic_roughness_map.image.is_some()
        || normal_map.image.is_some()
}

/// The base colour of a surface, and the number of its texture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct BaseColor {
    base_color: [f32; 3],
    image: Option<usize>,
}

impl BaseColor {
    fn new(geometry: &Geometry, submesh: &Submesh, model: &Model) -> Self {
        match submesh.material.and_then(|k| model.materials.get(k)) {
            Some(material) => {
                let [red, green, blue, _] = material.base_color;
                Self { base_color: [red, green, blue], image: material.base_color_map.image }
            }
            // Colours stand for themselves.
            None if covers(&geometry.colors, &submesh.faces) => {
                Self { base_color: [1.0; 3], image: None }
            }
            None => Self { base_color: SurfaceMaterial::plain().base_color, image: None },
        }
    }
}

/// Faces as they are seen from outside where they stand.
fn turned<'a>(faces: &'a [[u32; 3]], matrix: &DMat4) -> impl Iterator<Item = [u32; 3]> + use<'a> {
    let mirrors = matrix.determinant() < 0.0;
    faces.iter().map(move |&[a, b, c]| if mirrors { [a, c, b] } else { [a, b, c] })
}

/// The numbers at corners of all surfaces, moved with them, where all have them. Of a part of the surfaces they
/// are left out, which is noted.
fn joined<'m, const N: usize>(
    parts: &[Part<'m>],
    what: &str,
    attribute: impl Fn(&'m Geometry) -> Option<&'m Indexed<N>>,
    moved: impl Fn(&DMat4, [f32; N]) -> [f32; N],
    notes: &mut Vec<String>,
) -> Result<Option<Attribute>, SceneError> {
    let submeshes = parts.iter().flat_map(|(geometry, _)| {
        geometry.submeshes.iter().map(move |submesh| (*geometry, submesh))
    });
    let covers = |(geometry, submesh): &(&'m Geometry, &Submesh)| {
        attribute(geometry).is_some_and(|attribute| attribute.covers(&submesh.faces))
    };
    let (count, missing) = (submeshes.clone().count(), submeshes.filter(|k| !covers(k)).count());
    if missing > 0 {
        if missing < count {
            notes.push(format!("{missing} of {count} surfaces have no {what}: they were left out"));
        }
        return Ok(None);
    }
    let (mut rows, mut faces) = (Vec::new(), Vec::new());
    for (geometry, matrix) in parts {
        let Some(attribute) = attribute(geometry) else { continue };
        let first = rows.len() as u32;
        rows.extend(attribute.rows.iter().map(|&row| moved(matrix, row)));
        faces.extend(turned(&attribute.faces, matrix).map(|face| face.map(|k| first + k)));
    }
    let indices = Mesh::new(faces, rows.len())?;
    Ok(Some(Attribute { rows: rows.into(), indices }))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::model::Placed;
    use crate::picture::Samples;

    fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(folder.join(name), bytes).unwrap();
    }

    fn png(samples: &[u8], [width, height, channels]: [usize; 3]) -> Vec<u8> {
        let samples = Samples::U8(samples.to_vec());
        let picture = Picture { width, height, channels, samples };
        picture.encode_png(&Location::new("a.png")).unwrap()
    }

    #[test]
    fn a_mesh_comes_with_all_that_its_file_names() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        write(folder, "t.png", png(&[255, 188, 0, 0, 0, 255], [2, 1, 3]));
        write(folder, "m.mtl", "newmtl m\nKd 1 0.5 1\nmap_Kd t.png\n");
        let text = "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 2 0 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n\
                    f 1/1/1 2/2/1 3/3/1\n";
        write(folder, "a.obj", text);
        let loaded = load_mesh(folder.join("a.obj")).unwrap();
        assert_eq!(loaded.mesh.faces(), [[0, 1, 2]]);
        assert_eq!(loaded.positions.data(), [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
        let coordinates = loaded.coordinates.unwrap();
        // v goes down here, and up in the file.
        let corner = coordinates.indices.faces()[0][0] as usize;
        assert_eq!(coordinates.rows.data()[2 * corner..][..2], [0.0, 1.0]);
        assert_eq!(loaded.normals.unwrap().rows.data()[..3], [0.0, 0.0, 1.0]);
        let texture = loaded.texture.unwrap();
        assert_eq!(**texture.shape(), [1, 2, 3]);
        approx::assert_abs_diff_eq!(
            texture.data(),
            &[1.0, 0.2515, 0.0, 0.0, 0.0, 1.0][..],
            epsilon = 1e-4
        );
        assert!(loaded.colors.is_none() && loaded.notes.is_empty(), "{:?}", loaded.notes);
    }

    #[test]
    fn an_image_comes_as_light_with_its_channels() {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        write(folder, "a.png", png(&[188, 128, 0, 255], [2, 1, 2]));
        let image = load_image(folder.join("a.png")).unwrap();
        assert_eq!(**image.shape(), [1, 2, 2]);
        let expected = [0.5029, 128.0 / 255.0, 0.0, 1.0];
        approx::assert_abs_diff_eq!(image.data(), &expected[..], epsilon = 1e-4);
        let light = Tensor::from_flat_fn([1, 2, 3], |k| 0.5 * k as f32);
        let exr =
            Picture::from_numbers(&light).unwrap().encode_exr(&Location::new("a.exr")).unwrap();
        write(folder, "a.exr", exr);
        assert_eq!(load_image(folder.join("a.exr")).unwrap(), light);
        assert!(matches!(load_image(folder.join("b.png")), Err(SceneError::Read { .. })));
    }

    /// A triangle with a side of 2, and what its corners have.
    fn triangle() -> Geometry {
        Geometry {
            name: String::new(),
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            offset: DVec3::ZERO,
            faces: vec![[0, 1, 2]],
            colors: Some(Indexed { rows: vec![[0.25; 3], [0.5; 3]], faces: vec![[0, 1, 1]] }),
            coordinates: None,
            normals: Some(Indexed { rows: vec![[0.6, 0.0, 0.8]], faces: vec![[0, 0, 0]] }),
            tangents: None,
            submeshes: vec![Submesh { material: None, faces: 0..1 }],
        }
    }

    fn placed(geometry: usize, transform: DMat4) -> Placed {
        Placed { name: String::new(), geometry, transform }
    }

    fn loaded(model: &Model) -> LoadedMesh {
        LoadedMesh::from_model(model, &Location::new("a.glb")).unwrap()
    }

    #[test]
    fn surfaces_are_joined_where_they_stand() {
        let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 2.0));
        let model = Model {
            geometries: vec![triangle()],
            placed: vec![placed(0, DMat4::IDENTITY), placed(0, mirrored)],
            ..Model::default()
        };
        let joined = loaded(&model);
        // The mirrored one is seen from the same side.
        assert_eq!(joined.mesh.faces(), [[0, 1, 2], [3, 5, 4]]);
        assert_eq!(joined.positions.data()[12..15], [-2.0, 0.0, 0.0]);
        let colors = joined.colors.unwrap();
        assert_eq!(
            (colors.rows.shape()[0], colors.indices.faces()),
            (4, &[[0, 1, 1], [2, 3, 3]][..])
        );
        // Normals stay at right angles to the surface: (0.6, 0, 0.8) becomes (-0.6, 0, 0.4).
        let normals = joined.normals.unwrap();
        let length = 0.52_f32.sqrt();
        let expected = [0.6, 0.0, 0.8, -0.6 / length, 0.0, 0.4 / length];
        approx::assert_abs_diff_eq!(normals.rows.data(), &expected[..], epsilon = 1e-6);
        assert_eq!(joined.base_color, [1.0; 3]);
    }

    #[test]
    fn what_only_some_surfaces_have_is_noted() {
        let bare = Geometry { colors: None, ..triangle() };
        let all = [0, 1].map(|k| placed(k, DMat4::IDENTITY));
        let model =
            Model { geometries: vec![triangle(), bare], placed: all.to_vec(), ..Model::default() };
        let joined = loaded(&model);
        assert!(joined.colors.is_none() && joined.normals.is_some());
        let notes = joined.notes.join("\n");
        assert!(notes.contains("1 of 2 surfaces have no colours"), "{notes}");
        assert!(notes.contains("several materials"), "{notes}");
        assert_eq!(joined.base_color, [1.0; 3]);
    }
}
