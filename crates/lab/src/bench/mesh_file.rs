//! A mesh from a file, as a study takes it: all of its surfaces as one, in a sphere of radius 1.

use std::path::Path;

use bokashi_core::Tensor;
use bokashi_render_ops::Mesh;
use bokashi_scene::{ColorSpace, Folder, Geometry, Indexed, Model, Place, SceneError, read_model};
use glam::{DMat4, DVec3, Vec3};

/// A mesh from a file.
#[derive(Debug, Clone)]
pub struct MeshFile {
    /// The name of the file, without its ending.
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    /// `[V, 3]`, around the origin, within a distance of 1 from it.
    pub(crate) positions: Tensor<f64>,
    pub(crate) look: Look,
}

/// What colours a mesh.
#[derive(Debug, Clone)]
pub(crate) enum Look {
    /// Linear colours `[A, 3]` of the file, and which of them the corners of faces have.
    Colors(Tensor<f32>, Mesh),
    /// Texture coordinates `[A, 2]`, which of them the corners have, and texels `[H, W, 3]`, linear.
    Texture(Tensor<f32>, Mesh, Tensor<f32>),
    /// Colours `[V, 3]` by place, since the file has none.
    Places(Tensor<f32>),
}

/// Reads a mesh from a file of any format that scenes take. Surfaces that the file places several times are
/// there as often.
///
/// # Errors
/// As [`read_model`], and [`SceneError::Content`] for a file without a face.
pub fn read_mesh(file: &Path) -> Result<MeshFile, SceneError> {
    let parent = file.parent().filter(|parent| !parent.as_os_str().is_empty());
    let folder = Folder::new(parent.unwrap_or(Path::new(".")))?;
    let name = file.file_name().unwrap_or(file.as_os_str());
    let model = read_model(&folder, Path::new(name))?;
    let name = file.file_stem().unwrap_or(name).to_string_lossy().into_owned();
    MeshFile::of(name, &model).and_then(|mesh| {
        mesh.ok_or_else(|| SceneError::Content {
            place: Place::of(file),
            message: "a mesh needs a face, got none".to_owned(),
        })
    })
}

impl MeshFile {
    /// All surfaces of a model; `None` where there is no face.
    fn of(name: String, model: &Model) -> Result<Option<Self>, SceneError> {
        let (mut points, mut faces): (Vec<DVec3>, Vec<[u32; 3]>) = Default::default();
        let parts: Vec<(&Geometry, DMat4)> = model
            .placed
            .iter()
            .map(|placed| (&model.geometries[placed.geometry], placed.transform))
            .collect();
        for (geometry, place) in &parts {
            let first = points.len() as u32;
            let of = |&point| place.transform_point3(Vec3::from_array(point).as_dvec3());
            points.extend(geometry.positions.iter().map(of));
            faces.extend(turned(&geometry.faces, place).map(|face| face.map(|k| first + k)));
        }
        let seen = || faces.as_flattened().iter().map(|&vertex| points[vertex as usize]);
        let Some([low, high]) =
            seen().map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
        else {
            return Ok(None);
        };
        let middle = 0.5 * (low + high);
        let radius = seen().map(|point| point.distance(middle)).fold(0.0, f64::max);
        let scale = if radius > 0.0 { 1.0 / radius } else { 1.0 };
        let positions: Vec<f64> =
            points.iter().flat_map(|point| (scale * (*point - middle)).to_array()).collect();
        let positions = Tensor::from_flat_fn([points.len(), 3], |k| positions[k]);
        let mesh = Mesh::new(faces, points.len())?;
        let look = match textured(model, &parts)? {
            Some(look) => look,
            None => match joined(&parts, |geometry| geometry.colors.as_ref())? {
                Some((rows, indices)) => Look::Colors(rows, indices),
                None => Look::Places(by_place(&positions)),
            },
        };
        Ok(Some(Self { name, mesh, positions, look }))
    }

    /// A ball with bumps, coloured by place, of `2 around (along - 1)` faces.
    pub(crate) fn bumpy(name: &str, mesh: Mesh, positions: &Tensor<f64>) -> Self {
        let bumps = positions.data().as_chunks::<3>().0.iter().flat_map(|&point| {
            let point = DVec3::from_array(point);
            let height = (5.0 * point.x).sin() * (6.0 * point.y).cos() * (4.0 * point.z).cos();
            ((0.85 + 0.15 * height) * point.normalize()).to_array()
        });
        let bumps: Vec<f64> = bumps.collect();
        let positions = Tensor::from_flat_fn(positions.shape(), |k| bumps[k]);
        Self { name: name.to_owned(), mesh, look: Look::Places(by_place(&positions)), positions }
    }

    /// What colours it, for people.
    pub(crate) fn look_name(&self) -> String {
        match &self.look {
            Look::Colors(..) => "vertices".to_owned(),
            Look::Texture(.., texels) => {
                format!("texture, {} x {}", texels.shape()[1], texels.shape()[0])
            }
            Look::Places(_) => "by place".to_owned(),
        }
    }

    /// A colour per vertex: where corners have several, that of one of them.
    pub(crate) fn vertex_colors(&self) -> Tensor<f64> {
        let mut colors = vec![0.0; 3 * self.mesh.vertex_count()];
        let mut set = |indices: &Mesh, color: &dyn Fn(usize) -> [f32; 3]| {
            let corners = self.mesh.faces().as_flattened().iter();
            for (&vertex, &row) in corners.zip(indices.faces().as_flattened()) {
                let own = &mut colors[3 * vertex as usize..][..3];
                own.iter_mut().zip(color(row as usize)).for_each(|(own, x)| *own = f64::from(x));
            }
        };
        let row = |rows: &Tensor<f32>, k: usize| [0, 1, 2].map(|c| rows.data()[3 * k + c]);
        match &self.look {
            Look::Colors(rows, indices) => set(indices, &|k| row(rows, k)),
            Look::Places(rows) => set(&self.mesh, &|k| row(rows, k)),
            Look::Texture(coordinates, indices, texels) => {
                let [height, width] = [texels.shape()[0], texels.shape()[1]];
                set(indices, &|k| {
                    let [u, v] = [0, 1].map(|c| coordinates.data()[2 * k + c]);
                    // The texture, again and again.
                    let at = |x: f32, count: usize| {
                        ((x.rem_euclid(1.0) * count as f32) as usize).min(count - 1)
                    };
                    row(texels, at(v, height) * width + at(u, width))
                });
            }
        }
        Tensor::from_flat_fn([self.mesh.vertex_count(), 3], |k| colors[k])
    }
}

/// Faces as they are seen from outside where they are placed.
fn turned<'a>(faces: &'a [[u32; 3]], place: &DMat4) -> impl Iterator<Item = [u32; 3]> + use<'a> {
    let mirrors = place.determinant() < 0.0;
    faces.iter().map(move |&[a, b, c]| if mirrors { [a, c, b] } else { [a, b, c] })
}

/// The numbers at corners of all surfaces, where all have them.
fn joined<'a, const N: usize>(
    parts: &[(&'a Geometry, DMat4)],
    own: impl Fn(&'a Geometry) -> Option<&'a Indexed<N>>,
) -> Result<Option<(Tensor<f32>, Mesh)>, SceneError> {
    let (mut rows, mut faces) = (Vec::new(), Vec::new());
    for (geometry, place) in parts {
        let covers = |own: &&Indexed<N>| geometry.submeshes.iter().all(|k| own.covers(&k.faces));
        let Some(own) = own(geometry).filter(covers) else { return Ok(None) };
        let first = rows.len() as u32;
        rows.extend_from_slice(&own.rows);
        faces.extend(turned(&own.faces, place).map(|face| face.map(|k| first + k)));
    }
    let (count, flat) = (rows.len(), rows.as_flattened());
    let tensor = Tensor::from_flat_fn([count, N], |k| flat[k]);
    Ok(Some((tensor, Mesh::new(faces, count)?)))
}

/// The texture, where all surfaces have the same one.
fn textured(model: &Model, parts: &[(&Geometry, DMat4)]) -> Result<Option<Look>, SceneError> {
    let materials = || parts.iter().flat_map(|(geometry, _)| geometry.materials());
    let image_of = |material: Option<usize>| {
        let material = material.and_then(|k| model.materials.get(k));
        material.and_then(|material| material.base_color_image)
    };
    let Some(image) = materials().next().and_then(image_of) else { return Ok(None) };
    if materials().any(|material| image_of(material) != Some(image)) {
        return Ok(None);
    }
    let Some(picture) = model.images.get(image) else { return Ok(None) };
    let all = joined(parts, |geometry| geometry.coordinates.as_ref())?;
    Ok(all.map(|(rows, indices)| Look::Texture(rows, indices, picture.color(ColorSpace::Srgb))))
}

/// As the spheres of the step's table have them.
fn by_place(positions: &Tensor<f64>) -> Tensor<f32> {
    positions.map(|x: f64| (0.5 * x + 0.5) as f32)
}

#[cfg(test)]
mod tests {
    use bokashi_scene::{MaterialFile, Placed, Submesh};

    use super::*;

    /// A triangle with a side of 2, and what its corners have.
    fn triangle() -> Geometry {
        Geometry {
            name: String::new(),
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            offset: DVec3::ZERO,
            faces: vec![[0, 1, 2]],
            colors: Some(Indexed { rows: vec![[0.25; 3], [0.5; 3]], faces: vec![[0, 1, 1]] }),
            coordinates: None,
            normals: None,
            tangents: None,
            submeshes: vec![Submesh { material: None, faces: 0..1 }],
        }
    }

    fn placed(transform: DMat4) -> Placed {
        Placed { name: String::new(), geometry: 0, transform }
    }

    #[test]
    fn surfaces_are_joined_and_moved_into_a_sphere_of_radius_one() {
        let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let model = Model {
            geometries: vec![triangle()],
            placed: vec![placed(DMat4::IDENTITY), placed(mirrored)],
            ..Model::default()
        };
        let file = MeshFile::of("a".to_owned(), &model).unwrap().unwrap();
        // The mirrored one is seen from the same side.
        assert_eq!(file.mesh.faces(), [[0, 1, 2], [3, 5, 4]]);
        // From -2 to 2 across and 0 to 2 down: the middle is (0, 1), the farthest corner sqrt(5) away.
        let unit = 5.0_f64.sqrt().recip();
        let expected = [0.0, -1.0, 0.0, 2.0, -1.0, 0.0].map(|x| x * unit);
        for (found, expected) in file.positions.data().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
        let Look::Colors(rows, indices) = &file.look else { panic!("{:?}", file.look) };
        assert_eq!((rows.shape()[0], indices.faces()), (4, &[[0, 1, 1], [2, 3, 3]][..]));
        let colors = file.vertex_colors();
        assert_eq!(colors.data()[..6], [0.25, 0.25, 0.25, 0.5, 0.5, 0.5]);
        assert!(MeshFile::of("a".to_owned(), &Model::default()).unwrap().is_none());
    }

    #[test]
    fn without_colours_and_a_texture_of_all_the_place_is_the_colour() {
        let bare = Geometry { colors: None, ..triangle() };
        let coordinates = Indexed { rows: vec![[0.0, 0.0], [0.9, 0.1]], faces: vec![[0, 1, 1]] };
        let submeshes = vec![Submesh { material: Some(0), faces: 0..1 }];
        let charted = Geometry { coordinates: Some(coordinates), submeshes, ..bare.clone() };
        let texels = Tensor::from_flat_fn([1, 2, 3], |k| if k < 3 { 0.0 } else { 1.0 });
        let picture = bokashi_scene::Picture::of_color(&texels, ColorSpace::Srgb).unwrap();
        let model = Model {
            geometries: vec![charted, bare],
            materials: vec![MaterialFile { base_color_image: Some(0), ..MaterialFile::default() }],
            images: vec![picture],
            placed: vec![placed(DMat4::IDENTITY)],
            ..Model::default()
        };
        let file = MeshFile::of("a".to_owned(), &model).unwrap().unwrap();
        assert_eq!(file.look_name(), "texture, 2 x 1");
        assert_eq!(file.vertex_colors().data(), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        let other = Placed { geometry: 1, ..placed(DMat4::IDENTITY) };
        let model = Model { placed: vec![placed(DMat4::IDENTITY), other], ..model };
        let file = MeshFile::of("a".to_owned(), &model).unwrap().unwrap();
        assert_eq!(file.look_name(), "by place");
        let half = (0.5 * file.positions.data()[3] + 0.5) as f32;
        assert_eq!(file.vertex_colors().data()[3], f64::from(half));
    }
}
