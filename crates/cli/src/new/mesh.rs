//! The mesh of a new scene.

use std::path::{Path, PathBuf};

use bokashi_scene::{Folder, Geometry, Indexed, SceneError, Submesh, named_files, read_model};
use glam::DVec3;

use super::copies::Copies;

/// Where the mesh and its files go.
const HOME: &str = "mesh";

/// What of a mesh a fit can learn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Paint {
    /// The textures that it has.
    Textures,
    /// The colours at its vertices.
    Colors,
    /// A texture that it gets: it has coordinates.
    Coordinates,
    /// One colour.
    Bare,
}

/// A mesh that the scene starts from.
#[derive(Debug)]
pub(super) struct Start {
    /// Its file, in the scene's folder.
    pub(super) file: PathBuf,
    /// How many files it names.
    pub(super) named: usize,
    pub(super) paint: Paint,
    /// The middle and the radius of a ball around it.
    pub(super) ball: (DVec3, f64),
}

impl Start {
    /// The mesh of the file `mesh`, with all that it names among the `copies`.
    ///
    /// # Errors
    /// What is wrong with its files.
    pub(super) fn read(mesh: &Path, copies: &mut Copies<'_>) -> Result<Self, SceneError> {
        let folder = Folder::new(mesh.parent().unwrap_or(Path::new("")))?;
        let name = mesh.file_name().map_or(mesh, Path::new);
        let model = read_model(&folder, name)?;
        let named = named_files(&folder, name)?;
        let home = copies.home(&folder, HOME);
        for file in &named {
            copies.add(&folder, file, &home)?;
        }
        let file = copies.add(&folder, name, &home)?;

        let shown = |k: usize| model.placed.iter().filter(move |placed| placed.geometry == k);
        let all = model.geometries.iter().enumerate();
        let drawn: Vec<_> = all.filter(|(k, _)| shown(*k).next().is_some()).collect();
        let material = |index: Option<usize>| index.and_then(|index| model.materials.get(index));
        let has_image =
            |index| material(index).is_some_and(|material| material.base_color_map.image.is_some());
        let covered = drawn
            .iter()
            .flat_map(|(_, geometry)| geometry.submeshes.iter().map(move |k| (geometry, k)));
        let colored =
            |(geometry, part): (&&Geometry, &Submesh)| covers(geometry.colors.as_ref(), part);
        let charted =
            |(geometry, part): (&&Geometry, &Submesh)| covers(geometry.coordinates.as_ref(), part);
        let paint = if drawn.iter().any(|(_, geometry)| geometry.materials().any(has_image)) {
            Paint::Textures
        } else if covered.clone().all(colored) {
            Paint::Colors
        } else if covered.clone().all(charted) {
            Paint::Coordinates
        } else {
            Paint::Bare
        };
        let places = drawn.iter().flat_map(|(k, geometry)| {
            shown(*k).flat_map(|placed| {
                let rows = geometry.positions.iter().map(|row| DVec3::from(row.map(f64::from)));
                rows.map(|row| placed.transform.transform_point3(row))
            })
        });
        let extent = places.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
        let ball = extent.map_or((DVec3::ZERO, 1.0), |[a, b]| (0.5 * (a + b), 0.5 * a.distance(b)));
        Ok(Self { file, named: named.len(), paint, ball })
    }
}

fn covers<const N: usize>(attribute: Option<&Indexed<N>>, submesh: &Submesh) -> bool {
    attribute.is_some_and(|geometry| geometry.covers(&submesh.faces))
}
