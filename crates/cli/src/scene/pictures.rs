//! Pictures of a scene as files: what is seen, what was to be seen, how the two differ.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bokashi_report::{ReportError, ViewerMesh, ViewerTexture, viewer, viewer_data};
use bokashi_scene::Tensor;
use bokashi_scene::{
    ColorSpace, Geometry, Indexed, Location, Model, Picture, Scene, SceneError, Submesh,
    ViewComparison, write_result,
};
use glam::DMat4;

/// Differences are shown so many times as large.
pub(super) const GAIN: f32 = 4.0;

/// What the files of a view show. A view without an image has the first alone.
pub(super) const KINDS: [&str; 3] = ["result", "target", "difference"];

/// The folder of the views' pictures, beside the page.
pub(super) const VIEWS: &str = "views";

/// What a file of a view is called.
pub(super) fn file_name(view: &str, what: &str) -> String {
    format!("{view}-{what}.png")
}

/// Where a file of a view lies in the folder of results.
pub(super) fn path(view: &str, what: &str) -> PathBuf {
    Path::new(VIEWS).join(file_name(view, what))
}

/// The PNGs of a view.
#[derive(Debug, Clone)]
pub(super) struct Pictures {
    pub(super) picture: Arc<[u8]>,
    pub(super) target: Option<Arc<[u8]>>,
    pub(super) difference: Option<Arc<[u8]>>,
}

impl Pictures {
    pub(super) fn from_view(scene: &Scene, compared: &ViewComparison) -> Result<Self, SceneError> {
        let png = |image: &Tensor<f32>| Ok::<_, SceneError>(Arc::from(scene.png_of(image)?));
        let target = compared.target.as_ref();
        let difference = target.map(|target| {
            let (image, target) = (compared.image.data(), target.data());
            // Grey where they agree.
            let off = |k: usize| 0.5 + 0.5 * GAIN * (image[k] - target[k]);
            let image = Tensor::from_flat_fn(compared.image.shape(), off);
            let picture = Picture::from_color(&image, ColorSpace::Linear)?;
            Ok::<_, SceneError>(Arc::from(picture.encode_png(&Location::new("a difference"))?))
        });
        Ok(Self {
            picture: png(&compared.image)?,
            target: target.map(png).transpose()?,
            difference: difference.transpose()?,
        })
    }

    /// Writes the files of a view into the folder of results: [`path`] says where they lie.
    pub(super) fn save(&self, view: &str, out: &Path) -> Result<(), SceneError> {
        let all = [Some(&self.picture), self.target.as_ref(), self.difference.as_ref()];
        for (what, png) in KINDS.into_iter().zip(all) {
            if let Some(png) = png {
                write_result(out, path(view, what), png)?;
            }
        }
        Ok(())
    }
}

/// A submesh as a page shows it, with the vertices that it names.
struct Shown {
    positions: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    colors: Vec<[f32; 3]>,
    coordinates: Option<Indexed<2>>,
    png: Option<Vec<u8>>,
    transform: [f32; 16],
}

impl Shown {
    fn new(model: &Model, geometry: &Geometry, submesh: &Submesh, transform: &DMat4) -> Self {
        let material = submesh.material.and_then(|k| model.materials.get(k));
        let image = material.and_then(|material| material.base_color_map.image);
        let image = image.and_then(|k| model.images.get(k));
        let base = material.map_or([1.0; 3], |material| {
            let [red, green, blue, _] = material.base_color;
            [red, green, blue]
        });
        let range = submesh.faces.clone();
        let (vertices, faces) = picked(&geometry.faces[range.clone()]);
        let positions = vertices.iter().map(|&vertex| geometry.positions[vertex as usize]);
        let mut colors = vec![base; vertices.len()];
        if let Some(rows) = geometry.colors.as_ref().filter(|rows| rows.covers(&range)) {
            // A vertex with several has the last.
            let corners = faces.as_flattened().iter().zip(rows.faces[range.clone()].as_flattened());
            for (&vertex, &row) in corners {
                let color = rows.rows[row as usize];
                colors[vertex as usize] = [0, 1, 2].map(|k| color[k] * base[k]);
            }
        }
        let coordinates = geometry.coordinates.as_ref().filter(|rows| rows.covers(&range));
        Self {
            positions: positions.collect(),
            faces,
            colors: colors.into_iter().map(|color| color.map(encoded)).collect(),
            coordinates: coordinates.map(|rows| {
                let (named, faces) = picked(&rows.faces[range]);
                let named = named.into_iter().map(|row| rows.rows[row as usize]);
                Indexed { rows: named.collect(), faces }
            }),
            png: image.and_then(|image| image.encode_png(&Location::new("a texture")).ok()),
            transform: transform.to_cols_array().map(|x| x as f32),
        }
    }
}

/// The rows that faces name, in their order, and the faces with the numbers that the rows have there.
fn picked(faces: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut rows: Vec<u32> = faces.as_flattened().to_vec();
    rows.sort_unstable();
    rows.dedup();
    let number = |row: u32| rows.partition_point(|&other| other < row) as u32;
    let faces = faces.iter().map(|face| face.map(number)).collect();
    (rows, faces)
}

/// A linear number as sRGB has it.
fn encoded(x: f32) -> f32 {
    match x.clamp(0.0, 1.0) {
        x if x <= 0.003_130_8 => 12.92 * x,
        x => 1.055 * x.powf(1.0 / 2.4) - 0.055,
    }
}

/// Calls `with` with the meshes of a model, one for each submesh of a geometry.
fn with_meshes<R>(
    model: &Model,
    with: impl FnOnce(&[ViewerMesh<'_>]) -> Result<R, ReportError>,
) -> Result<R, ReportError> {
    let shown = model.placed.iter().flat_map(|placed| {
        let geometry = &model.geometries[placed.geometry];
        let submeshes = geometry.submeshes.iter();
        submeshes.map(|submesh| Shown::new(model, geometry, submesh, &placed.transform))
    });
    let shown: Vec<Shown> = shown.collect();
    let meshes = shown.iter().map(|mesh| {
        let texture = mesh.coordinates.as_ref().zip(mesh.png.as_deref());
        ViewerMesh {
            positions: &mesh.positions,
            faces: &mesh.faces,
            colors: Some(&mesh.colors),
            texture: texture.map(|(coordinates, png)| ViewerTexture {
                coordinates: &coordinates.rows,
                faces: &coordinates.faces,
                png,
            }),
            transform: mesh.transform,
        }
    });
    with(&meshes.collect::<Vec<_>>())
}

/// The meshes as a block of a page.
pub(super) fn block(model: &Model, caption: &str) -> Result<String, ReportError> {
    with_meshes(model, |meshes| viewer(meshes, caption))
}

/// The meshes as the live page takes them.
pub(super) fn data(model: &Model) -> Result<String, ReportError> {
    with_meshes(model, viewer_data)
}
