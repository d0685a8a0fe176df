//! A hull: what the silhouettes of all views allow.
//!
//! # Formula
//! A point is outside of the hull as far as its image is outside of a silhouette: the field is the largest of its distances
//! over all views, below 0 inside. The hull is where it is 0. A view may be wrong, its mask or its camera. So a share of
//! the largest distances is left out: those of views that the others do not agree with.
//!
//! # Errors
//! A hull is never smaller than the object, but for views that are wrong. Hollows that no silhouette shows are filled. Things
//! thinner than a cell of the grid may be cut.
//!
//! # Source
//! Laurentini, *The visual hull concept for silhouette-based image understanding*, IEEE PAMI 16(2), 1994.

mod field;
mod silhouette;

use bokashi_core::Tensor;
use bokashi_core::parallel::for_each_item_mut;
use bokashi_mesh::{Grid, MeshError, extract_surface};
use bokashi_render_ops::Mesh;
use glam::DVec3;
use smallvec::SmallVec;

use self::field::{agreed, sampled};
use self::silhouette::Silhouette;
use crate::error::SceneError;
use crate::folder::Folder;
use crate::gaze::gaze;
use crate::model::{Geometry, Submesh, far_offset};
use crate::picture::reduced;
use crate::scene_view::SceneView;

/// How much farther than the ball that all views see whole a hull is looked for.
const FARTHER: f64 = 1.5;
/// Cells along the longest side: where the hull is looked for, twice, and at last.
const CELLS: [usize; 3] = [40, 40, 128];
/// How far from the hull a point may be, in cells, whose neighbour may be inside: distances of images change faster
/// than those of the world where something is near.
const NEAR: f64 = 2.0;
/// Masks are made smaller where they are longer, in pixels: a cell is as large as several of these.
const LONGEST: usize = 640;

/// The share of views that agree, where a scene does not say.
pub(crate) const AGREEMENT: f64 = 0.9;
/// Parts of a hull that are smaller than this share of the largest are left out: places that no view can tell are empty.
const SMALLEST: f64 = 0.02;

/// The hull of all `views` that have a mask and are not held out, with about so many faces; of these views a share
/// `agreement` has to agree. What is wrong with them is said in words.
///
/// # Errors
/// Whatever is wrong with a file of a mask.
pub(crate) fn hull_of_views(
    folder: &Folder,
    views: &[SceneView],
    faces: usize,
    agreement: f64,
) -> Result<Result<Geometry, String>, SceneError> {
    let views: Vec<_> = views.iter().filter(|view| !view.held_out).collect();
    let mut read: Vec<_> = views.iter().map(|_| None).collect();
    for_each_item_mut(&mut read, |k, read| *read = Some(silhouette_of(folder, views[k])));
    let read: Result<Vec<_>, _> = read.into_iter().flatten().collect();
    let silhouettes: Vec<_> = read?.into_iter().flatten().collect();
    if silhouettes.is_empty() {
        let rule = "a hull needs views with masks, or images with opacity";
        return Ok(Err(format!(
            "{rule}, and of {} that are learnt from none has one",
            views.len()
        )));
    }
    let cameras: Vec<_> = silhouettes.iter().map(Silhouette::camera).collect();
    let Some((middle, radius)) = gaze(&cameras) else {
        let rule = "a hull needs cameras that look at one place from several sides";
        return Ok(Err(format!("{rule}, and those of {} views with masks do not", cameras.len())));
    };
    let hull = Hull { silhouettes, middle, radius, left_out: 1.0 - agreement };
    let Some((positions, mesh)) = hull.surface()? else {
        let rule = "a hull needs a place that is inside the masks";
        return Ok(Err(format!("{rule} of {agreement} of all views, and there is none")));
    };
    Ok(Ok(geometry(&positions, &mesh, middle)))
}

/// The silhouette of a view, if it has a mask.
fn silhouette_of(folder: &Folder, view: &SceneView) -> Result<Option<Silhouette>, SceneError> {
    let reduce = view.camera.size.width.max(view.camera.size.height).div_ceil(LONGEST);
    let mask = view.read_mask(folder)?;
    Ok(mask.map(|mask| Silhouette::new(view.camera.scaled(reduce), &reduced(&mask, reduce))))
}

/// The geometry of a surface around `middle`.
fn geometry(positions: &Tensor<f32>, mesh: &Mesh, middle: DVec3) -> Geometry {
    let points = positions.data().as_chunks::<3>().0.iter();
    let points = points.map(|&point| middle + DVec3::from(point.map(f64::from)));
    let extent = points.clone().map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    let offset = extent.map_or(DVec3::ZERO, far_offset);
    Geometry {
        name: "hull".to_owned(),
        positions: points.map(|point| (point - offset).as_vec3().to_array()).collect(),
        offset,
        faces: mesh.faces().to_vec(),
        colors: None,
        coordinates: None,
        normals: None,
        tangents: None,
        submeshes: vec![Submesh { material: None, faces: 0..mesh.faces().len() }],
    }
}

/// What silhouettes allow.
struct Hull {
    silhouettes: Vec<Silhouette>,
    /// The middle and the radius of the ball that all views see whole.
    middle: DVec3,
    radius: f64,
    /// The share of the views that may be wrong.
    left_out: f64,
}

impl Hull {
    /// Its surface: vertices `[V, 3]` around its middle, and faces. `None` where no place is inside.
    ///
    /// # Errors
    /// None: those of a grid that numbers of `f32` do not tell apart.
    fn surface(&self) -> Result<Option<(Tensor<f32>, Mesh)>, MeshError> {
        let mut extent = [-FARTHER, FARTHER].map(|share| DVec3::splat(share * self.radius));
        let [rough @ .., fine] = CELLS;
        for cells in rough {
            let grid = Grid::around(extent[0].to_array(), extent[1].to_array(), cells)?;
            let values = self.values(&grid, extent);
            let near = NEAR * grid.spacing();
            let points = (0..).zip(&values).filter(|&(_, &value)| f64::from(value) < near);
            let places = points.map(|(point, _)| DVec3::from(grid.position(point)));
            let Some([low, high]) =
                places.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
            else {
                return Ok(None);
            };
            extent = [low.max(extent[0]), high.min(extent[1])];
        }
        let grid = Grid::around(extent[0].to_array(), extent[1].to_array(), fine)?;
        let values =
            Tensor::new(grid.shape(), self.values(&grid, extent)).map_err(MeshError::from)?;
        let (positions, mesh) = extract_surface(&values, None, &grid)?;
        Ok((!mesh.faces().is_empty()).then_some((positions, mesh)))
    }

    /// The field at the points of a grid; beyond `extent` all is outside.
    fn values(&self, grid: &Grid, [low, high]: [DVec3; 2]) -> Vec<f32> {
        let distances: Vec<_> =
            self.silhouettes.iter().map(|silhouette| silhouette.distances(self.middle)).collect();
        sampled(grid, |place| {
            let beyond = (low - place).max(place - high).max_element();
            let point = self.middle + place;
            let mut said: SmallVec<[f64; 64]> =
                distances.iter().filter_map(|distance| distance(point)).collect();
            agreed(&mut said, distances.len(), self.left_out, self.radius).max(beyond)
        })
    }
}
