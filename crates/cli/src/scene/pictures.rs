//! Pictures of a scene as files: what is seen, what was to be seen, how the two differ.

use std::path::Path;
use std::sync::Arc;

use bokashi_report::{ReportError, ViewerMesh, ViewerTexture, viewer, viewer_data};
use bokashi_scene::Tensor;
use bokashi_scene::{
    ColorSpace, Geometry, Model, Picture, Place, Scene, SceneError, SeenView, write_file,
};

/// Differences are shown so many times as large.
pub(super) const GAIN: f32 = 4.0;

/// What the files of a view show. A view without an image has the first alone.
pub(super) const KINDS: [&str; 3] = ["result", "target", "difference"];

/// What a file of a view is called.
pub(super) fn file_name(view: &str, what: &str) -> String {
    format!("{view}-{what}.png")
}

/// The PNGs of a view.
#[derive(Debug, Clone)]
pub(super) struct Pictures {
    pub(super) picture: Arc<[u8]>,
    pub(super) target: Option<Arc<[u8]>>,
    pub(super) difference: Option<Arc<[u8]>>,
}

impl Pictures {
    pub(super) fn of(scene: &Scene, seen: &SeenView) -> Result<Self, SceneError> {
        let png = |image: &Tensor<f32>| Ok::<_, SceneError>(Arc::from(scene.png_of(image)?));
        let target = seen.target.as_ref();
        let difference = target.map(|target| {
            let (own, other) = (seen.image.data(), target.data());
            // Grey where they agree.
            let off = |k: usize| 0.5 + 0.5 * GAIN * (own[k] - other[k]);
            let image = Tensor::from_flat_fn(seen.image.shape(), off);
            let picture = Picture::of_color(&image, ColorSpace::Linear)?;
            Ok::<_, SceneError>(Arc::from(picture.encode_png(&Place::of("a difference"))?))
        });
        Ok(Self {
            picture: png(&seen.image)?,
            target: target.map(png).transpose()?,
            difference: difference.transpose()?,
        })
    }

    /// Writes the files of a view into a folder: [`file_name`] says what they are called.
    pub(super) fn save(&self, view: &str, folder: &Path) -> Result<(), SceneError> {
        let all = [Some(&self.picture), self.target.as_ref(), self.difference.as_ref()];
        for (what, png) in KINDS.into_iter().zip(all) {
            if let Some(png) = png {
                write_file(&folder.join(file_name(view, what)), png)?;
            }
        }
        Ok(())
    }
}

/// A geometry as a page shows it.
struct Shown {
    colors: Option<Vec<[f32; 3]>>,
    png: Option<Vec<u8>>,
    place: [f32; 16],
    geometry: usize,
}

/// Calls `with` with the meshes of a model.
fn with_meshes<R>(
    model: &Model,
    with: impl FnOnce(&[ViewerMesh<'_>]) -> Result<R, ReportError>,
) -> Result<R, ReportError> {
    let shown: Vec<_> = model
        .placed
        .iter()
        .map(|placed| {
            let geometry = &model.geometries[placed.geometry];
            let material = geometry.material.and_then(|k| model.materials.get(k));
            let image = material.and_then(|own| own.base_color_image);
            let image = image.and_then(|k| model.images.get(k));
            let png = image.and_then(|image| image.encode_png(&Place::of("a texture")).ok());
            let base = material.map_or([1.0; 3], |own| {
                let [red, green, blue, _] = own.base_color;
                [red, green, blue]
            });
            let place = placed.transform.to_cols_array().map(|x| x as f32);
            let colors = vertex_colors(geometry, base);
            Shown { colors: Some(colors), png, place, geometry: placed.geometry }
        })
        .collect();
    let meshes: Vec<_> = shown
        .iter()
        .map(|own| {
            let geometry = &model.geometries[own.geometry];
            let texture = geometry.coordinates.as_ref().zip(own.png.as_deref());
            ViewerMesh {
                positions: &geometry.positions,
                faces: &geometry.faces,
                colors: own.colors.as_deref(),
                texture: texture.map(|(coordinates, png)| ViewerTexture {
                    coordinates: &coordinates.rows,
                    faces: &coordinates.faces,
                    png,
                }),
                place: own.place,
            }
        })
        .collect();
    with(&meshes)
}

/// Colours at vertices, encoded as sRGB; a vertex with several has the last.
fn vertex_colors(geometry: &Geometry, base: [f32; 3]) -> Vec<[f32; 3]> {
    let mut colors = vec![base; geometry.positions.len()];
    if let Some(own) = &geometry.colors {
        for (vertices, rows) in geometry.faces.iter().zip(&own.faces) {
            for (&vertex, &row) in vertices.iter().zip(rows) {
                let color = own.rows[row as usize];
                colors[vertex as usize] = [0, 1, 2].map(|k| color[k] * base[k]);
            }
        }
    }
    let encoded = |x: f32| match x.clamp(0.0, 1.0) {
        x if x <= 0.003_130_8 => 12.92 * x,
        x => 1.055 * x.powf(1.0 / 2.4) - 0.055,
    };
    colors.into_iter().map(|color| color.map(encoded)).collect()
}

/// The meshes as a block of a page.
pub(super) fn block(model: &Model, caption: &str) -> Result<String, ReportError> {
    with_meshes(model, |meshes| viewer(meshes, caption))
}

/// The meshes as the live page takes them.
pub(super) fn data(model: &Model) -> Result<String, ReportError> {
    with_meshes(model, viewer_data)
}
