//! A mesh from a file, as a study takes it: all of its surfaces as one, in a sphere of radius 1.

use std::path::Path;

use bokashi_core::Tensor;
use bokashi_render_ops::Mesh;
use bokashi_scene::{LoadedMesh, SceneError, load_mesh};
use glam::{DVec3, Vec3};

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
/// As [`load_mesh`].
pub fn read_mesh(file: &Path) -> Result<MeshFile, SceneError> {
    let name = file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
    Ok(MeshFile::new(name, load_mesh(file)?))
}

impl MeshFile {
    /// The mesh of a file, moved into a sphere of radius 1.
    fn new(name: String, loaded: LoadedMesh) -> Self {
        let LoadedMesh { mesh, positions, colors, coordinates, texture, .. } = loaded;
        let points: Vec<DVec3> = positions
            .data()
            .as_chunks::<3>()
            .0
            .iter()
            .map(|&point| Vec3::from_array(point).as_dvec3())
            .collect();
        let corners = || mesh.faces().as_flattened().iter().map(|&vertex| points[vertex as usize]);
        let ends = corners().map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
        let middle = ends.map_or(DVec3::ZERO, |[low, high]| 0.5 * (low + high));
        let radius = corners().map(|point| point.distance(middle)).fold(0.0, f64::max);
        let scale = if radius > 0.0 { 1.0 / radius } else { 1.0 };
        let flat: Vec<f64> =
            points.iter().flat_map(|point| (scale * (*point - middle)).to_array()).collect();
        let positions = Tensor::from_flat_fn([points.len(), 3], |k| flat[k]);
        let look = match (texture, coordinates, colors) {
            (Some(texels), Some(attribute), _) => {
                Look::Texture(attribute.rows, attribute.indices, texels)
            }
            (_, _, Some(attribute)) => Look::Colors(attribute.rows, attribute.indices),
            _ => Look::Places(by_place(&positions)),
        };
        Self { name, mesh, positions, look }
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
                let sum = &mut colors[3 * vertex as usize..][..3];
                sum.iter_mut().zip(color(row as usize)).for_each(|(sum, x)| *sum = f64::from(x));
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
                    let texel = |x: f32, count: usize| {
                        ((x.rem_euclid(1.0) * count as f32) as usize).min(count - 1)
                    };
                    row(texels, texel(v, height) * width + texel(u, width))
                });
            }
        }
        Tensor::from_flat_fn([self.mesh.vertex_count(), 3], |k| colors[k])
    }
}

/// As the spheres of the step's table have them.
fn by_place(positions: &Tensor<f64>) -> Tensor<f32> {
    positions.map(|x: f64| (0.5 * x + 0.5) as f32)
}

#[cfg(test)]
mod tests {
    use bokashi_scene::Attribute;

    use super::*;

    fn loaded() -> LoadedMesh {
        let flat = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0, -2.0, 0.0, 0.0];
        let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4).unwrap();
        LoadedMesh {
            colors: Some(Attribute {
                rows: Tensor::from([[0.25; 3], [0.5; 3]]),
                indices: Mesh::new(vec![[0, 1, 1], [0, 1, 1]], 2).unwrap(),
            }),
            positions: Tensor::from_flat_fn([4, 3], |k| flat[k]),
            offset: DVec3::ZERO,
            mesh,
            coordinates: None,
            normals: None,
            texture: None,
            base_color: [1.0; 3],
            notes: Vec::new(),
        }
    }

    #[test]
    fn a_mesh_is_moved_into_a_sphere_of_radius_one() {
        let file = MeshFile::new("a".to_owned(), loaded());
        // From -2 to 2 across and 0 to 2 down: the middle is (0, 1), the farthest corner sqrt(5) away.
        let unit = 5.0_f64.sqrt().recip();
        let expected = [0.0, -1.0, 0.0, 2.0, -1.0, 0.0].map(|x| x * unit);
        for (found, expected) in file.positions.data().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
        assert_eq!(file.look_name(), "vertices");
        assert_eq!(file.vertex_colors().data()[..6], [0.25, 0.25, 0.25, 0.5, 0.5, 0.5]);
    }

    #[test]
    fn without_colours_and_a_texture_the_place_is_the_colour() {
        let coordinates = Attribute {
            rows: Tensor::from([[0.0, 0.0], [0.9, 0.1]]),
            indices: Mesh::new(vec![[0, 1, 1], [0, 1, 1]], 2).unwrap(),
        };
        let texels = Tensor::from_flat_fn([1, 2, 3], |k| if k < 3 { 0.0 } else { 1.0 });
        let bare = || LoadedMesh { colors: None, ..loaded() };
        let textured =
            LoadedMesh { coordinates: Some(coordinates), texture: Some(texels), ..bare() };
        let file = MeshFile::new("a".to_owned(), textured);
        assert_eq!(file.look_name(), "texture, 2 x 1");
        assert_eq!(file.vertex_colors().data()[..6], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let file = MeshFile::new("a".to_owned(), bare());
        assert_eq!(file.look_name(), "by place");
        let half = (0.5 * file.positions.data()[3] + 0.5) as f32;
        assert_eq!(file.vertex_colors().data()[3], f64::from(half));
    }
}
