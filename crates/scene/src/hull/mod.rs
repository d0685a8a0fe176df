//! The visual hull: the largest shape whose images lie inside the silhouettes of all views.
//!
//! # Formula
//! The field at a point is the largest of the distances of its images from the silhouettes, over all views; distances
//! are below 0 inside a silhouette. The hull is the surface on which the field is 0. A view with a wrong mask or a
//! wrong camera would carve the object away. So some of the largest distances are left out at each point. Their number
//! is the one for which the images of the hull overlap with the masks most.
//!
//! # Errors
//! If all views are right, the hull contains the object, but where [`webs`] are removed. There edges become rounder,
//! and a thin part of the object vanishes that no silhouette shows by itself. Hollows that no silhouette shows are
//! filled. Parts thinner than a cell of the grid may be cut.
//!
//! # Source
//! Laurentini, *The visual hull concept for silhouette-based image understanding*, IEEE PAMI 16(2), 1994.

mod field;
mod silhouette;
mod webs;

use bokashi_core::Tensor;
use bokashi_core::parallel::for_each_item_mut;
use bokashi_mesh::{
    Connectivity, Grid, MeshError, RemeshOptions, extract_surface, remesh, surface_area,
};
use bokashi_render_ops::Mesh;
use glam::DVec3;
use smallvec::SmallVec;

use self::field::{agreed, sampled, smoothed};
use self::silhouette::{Blocks, Silhouette};
use self::webs::{find_webs, values_without};
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::gaze::gaze_of_most;
use crate::model::{Geometry, NO_ROW, Submesh, far_offset};
use crate::picture::reduced;
use crate::scene_view::SceneView;

/// The size of the first box, over the ball that half of the views see whole.
const FARTHER: f64 = 1.5;
/// Cells along the longest side of three grids. The first finds the box of the hull. The second compares images with
/// masks and finds webs. The third, which has at most so many, gives the surface.
const CELLS: [usize; 3] = [40, 64, 128];
/// The least gain of overlap for which more views are left out: the grid is too coarse for smaller gains.
const WORTH: f64 = 0.02;
/// Cells of the finest grid at the surface per face: about three along each edge of a face.
const CELLS_PER_FACE: f64 = 9.0;
/// The least width of a cell in pixels of the [masks](LONGEST), but for grids of 64 cells.
const CELL_IN_PIXELS: f64 = 0.5;
/// Passes of smoothing. Where views barely agree, a hull has sheets and gaps thinner than a cell, and so many handles.
const SMOOTHINGS: usize = 2;
/// The field, in cells, below which a neighbour of a point may be inside. Distances in images change faster than
/// distances in the world near a camera.
const NEAR: f64 = 2.0;
/// The longest side of a mask, in pixels; longer ones are made smaller. A cell is as large as several of these pixels.
const LONGEST: usize = 640;

/// The bytes of the distances of a mask.
const OF_SILHOUETTE: u64 = 4 * (LONGEST * LONGEST) as u64;

/// The least share of views that agree, where a scene does not say.
pub(crate) const AGREEMENT: f64 = 0.8;
/// Parts of a hull with less than this share of the largest volume are left out. They lie where no view shows that
/// nothing is there.
const SMALLEST: f64 = 0.02;

/// Makes the hull of all `views` that have a mask and are not held out, with about so many faces. At each point at
/// least a share `agreement` of these views agree. The inner error says in words why the views have no hull.
///
/// # Errors
/// Those of files of masks; [`SceneError::Memory`] for more masks than there is room for.
pub(crate) fn hull_of_views(
    folder: &Folder,
    views: &[SceneView],
    faces: usize,
    agreement: f64,
) -> Result<Result<Geometry, String>, SceneError> {
    let views: Vec<_> = views.iter().filter(|view| !view.held_out).collect();
    let what = || format!("the masks of {} views", views.len());
    let bytes = views.len() as u64 * OF_SILHOUETTE;
    folder.memory().check(bytes, &Location::new(folder.path()), what)?;
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
    let Some((middle, radius)) = gaze_of_most(&cameras, agreement) else {
        let rule = "a hull needs cameras that look at one place from several sides";
        return Ok(Err(format!("{rule}, and those of {} views with masks do not", cameras.len())));
    };
    // A tenth of 20 views are two of them, whatever rounding says.
    let most = ((1.0 - agreement) * silhouettes.len() as f64 + 1e-9) as usize;
    let hull = Hull { silhouettes, middle, radius };
    let Some((positions, mesh)) = hull.surface(most, faces)? else {
        let rule = "a hull needs a place that is inside the masks";
        return Ok(Err(format!("{rule} of {agreement} of all views, and there is none")));
    };
    // The length of the edges of an equilateral face: `area = sqrt(3) / 4 length^2`.
    let area = surface_area(&positions, &mesh)? / faces as f64;
    let length = (4.0 / 3.0_f64.sqrt() * area).sqrt();
    let even = remesh(&positions, &mesh, &RemeshOptions::uniform(length))?;
    Ok(Ok(geometry(&even.positions, &even.mesh, middle)))
}

/// The surface without its [small](SMALLEST) parts.
fn without_small_parts(
    positions: &Tensor<f32>,
    mesh: &Mesh,
) -> Result<(Tensor<f32>, Mesh), MeshError> {
    let connectivity = Connectivity::new(mesh);
    let points = positions.data().as_chunks::<3>().0;
    let point = |vertex: u32| DVec3::from(points[vertex as usize].map(f64::from));
    let mut volumes = vec![0.0; connectivity.parts()];
    let parts = || (0..mesh.faces().len()).map(|face| connectivity.part_of(face).unwrap_or(0));
    for (face, part) in mesh.faces().iter().zip(parts()) {
        let [a, b, c] = face.map(point);
        volumes[part] += a.cross(b).dot(c);
    }
    let least = SMALLEST * volumes.iter().copied().fold(0.0, f64::max);
    let kept = mesh.faces().iter().zip(parts()).filter(|&(_, part)| volumes[part] >= least);
    let faces: Vec<_> = kept.map(|(face, _)| *face).collect();
    let mut names = vec![NO_ROW; points.len()];
    faces.as_flattened().iter().for_each(|&vertex| names[vertex as usize] = 0);
    let mut rows = Vec::new();
    for (name, row) in names.iter_mut().zip(points).filter(|(name, _)| **name != NO_ROW) {
        *name = rows.len() as u32;
        rows.push(*row);
    }
    let faces = faces.into_iter().map(|face| face.map(|vertex| names[vertex as usize])).collect();
    let mesh = Mesh::new(faces, rows.len())?;
    Ok((Tensor::from(rows.as_slice()), mesh))
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

/// The silhouettes of which a hull is made.
struct Hull {
    silhouettes: Vec<Silhouette>,
    /// The middle and the radius of the ball that half of the views see whole.
    middle: DVec3,
    radius: f64,
}

/// A box around the middle: its least and its largest corner.
type Extent = [DVec3; 2];

impl Hull {
    /// The surface: vertices `[V, 3]` around the middle, and faces. `None` where no point is inside. Up to `most` views
    /// are left out at each point. The grid is as fine as a surface of about so many `faces` needs.
    ///
    /// # Errors
    /// None: those of a grid that numbers of `f32` do not tell apart.
    fn surface(&self, most: usize, faces: usize) -> Result<Option<(Tensor<f32>, Mesh)>, MeshError> {
        let Some(extent) = self.extent(most)? else { return Ok(None) };
        // 0, 1, 2, 4, 8 ..: a hull grows with the number.
        let doubled = std::iter::successors(Some(1), |count| Some(2 * count));
        let rough = around(extent, CELLS[1])?;
        let blocks = self.silhouettes.iter().map(|it| it.blocks(self.middle, rough.spacing()));
        let blocks: Vec<_> = blocks.collect();
        let mut best = (0, f64::NEG_INFINITY, Vec::new());
        for left_out in std::iter::once(0).chain(doubled).take_while(|&count| count <= most) {
            let values = self.values(&rough, extent, left_out);
            let overlap = self.overlap(&rough, &values, &blocks);
            if overlap > best.1 + WORTH {
                best = (left_out, overlap, values);
            }
        }
        let grid = around(extent, self.cells(extent, faces))?;
        let values = self.values(&grid, extent, best.0);
        let Some(plain) = surface_of(&grid, values.clone())? else { return Ok(None) };
        let [parts, handles] = parts_and_handles(&plain.1);
        // Without handles there are no bars across holes.
        if handles > 0
            && let Some(webs) = find_webs(&rough, &best.2, self.middle, &blocks)
            && let Some(open) = surface_of(&grid, values_without(&webs, &rough, &grid, &values))?
        {
            let [open_parts, open_handles] = parts_and_handles(&open.1);
            // Otherwise nothing but edges became rounder.
            if open_handles < handles && open_parts <= parts {
                return Ok(Some(open));
            }
        }
        Ok(Some(plain))
    }

    /// The cells of the last grid along its longest side. A face of the hull is some cells wide, and a cell is not
    /// smaller than [`CELL_IN_PIXELS`].
    fn cells(&self, [low, high]: Extent, faces: usize) -> usize {
        let pixel = self.silhouettes.iter().map(|it| it.unit(self.middle));
        let pixel = pixel.fold(f64::INFINITY, f64::min);
        let most = (high - low).max_element() / (CELL_IN_PIXELS * pixel);
        let [_, least, finest] = CELLS;
        let cells = (CELLS_PER_FACE * faces as f64).sqrt().min(most).ceil() as usize;
        cells.clamp(least, finest)
    }

    /// A box around the hull, with so many views left out. `None` where no point is inside. Two rounds: the grid of the
    /// second lies in the box of the first.
    fn extent(&self, left_out: usize) -> Result<Option<Extent>, MeshError> {
        let mut extent = [-FARTHER, FARTHER].map(|share| DVec3::splat(share * self.radius));
        for _ in 0..2 {
            let grid = around(extent, CELLS[0])?;
            let values = self.values(&grid, extent, left_out);
            let near = NEAR.max(self.steepness(extent)).min(4.0 * NEAR) * grid.spacing();
            let points = (0..).zip(&values).filter(|&(_, &value)| f64::from(value) < near);
            let places = points.map(|(point, _)| DVec3::from(grid.position(point)));
            let Some([low, high]) =
                places.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
            else {
                return Ok(None);
            };
            extent = [low.max(extent[0]), high.min(extent[1])];
        }
        Ok(Some(extent))
    }

    /// The mean over all views of the intersection over union of its mask and the image of the points inside.
    fn overlap(&self, grid: &Grid, values: &[f32], blocks: &[Blocks]) -> f64 {
        let inside = (0..).zip(values).filter(|(_, value)| **value < 0.0);
        let points = inside.map(|(point, _)| self.middle + DVec3::from(grid.position(point)));
        let points: Vec<_> = points.collect();
        let mut shares = vec![0.0; self.silhouettes.len()];
        for_each_item_mut(&mut shares, |view, share| {
            *share = self.silhouettes[view].overlap(&points, &blocks[view]);
        });
        shares.iter().sum::<f64>() / shares.len() as f64
    }

    /// The field at the points of a grid. Beyond `extent` all points are outside.
    fn values(&self, grid: &Grid, [low, high]: Extent, left_out: usize) -> Vec<f32> {
        let distances: Vec<_> =
            self.silhouettes.iter().map(|silhouette| silhouette.distances(self.middle)).collect();
        sampled(grid, self.steepness([low, high]), |place| {
            let beyond = (low - place).max(place - high).max_element();
            let point = self.middle + place;
            let mut said: SmallVec<[f64; 64]> =
                distances.iter().filter_map(|distance| distance(point)).collect();
            Some(agreed(&mut said, distances.len(), left_out)?.max(beyond))
        })
    }

    /// A bound on how many times faster than distances in the world the field changes inside a box. Distances in an
    /// image are measured as at the middle: at distance d from the eye they change `D / d` times as fast, with D the
    /// middle's.
    fn steepness(&self, [low, high]: Extent) -> f64 {
        let reach = low.abs().max(high.abs()).length();
        let steepness = self.silhouettes.iter().map(|silhouette| {
            let eye = silhouette.camera().opencv_pose().w_axis.truncate();
            let distance = eye.distance(self.middle);
            if distance > reach { distance / (distance - reach) } else { f64::INFINITY }
        });
        steepness.fold(1.0, f64::max)
    }
}

/// The surface of a field, smoothed, without [small](SMALLEST) parts. `None` where nothing is inside.
fn surface_of(grid: &Grid, values: Vec<f32>) -> Result<Option<(Tensor<f32>, Mesh)>, MeshError> {
    let values = (0..SMOOTHINGS).fold(values, |values, _| smoothed(grid, values));
    let values = Tensor::new(grid.shape(), values).map_err(MeshError::from)?;
    let (positions, mesh) = extract_surface(&values, None, grid)?;
    if mesh.faces().is_empty() {
        return Ok(None);
    }
    without_small_parts(&positions, &mesh).map(Some)
}

/// The number of parts of a closed surface, and of their handles: `euler = 2 parts - 2 handles`.
fn parts_and_handles(mesh: &Mesh) -> [i64; 2] {
    let connectivity = Connectivity::new(mesh);
    let parts = connectivity.parts() as i64;
    [parts, parts - connectivity.euler_characteristic() / 2]
}

/// The grid around a box with so many cells along its longest side.
fn around([low, high]: Extent, cells: usize) -> Result<Grid, MeshError> {
    Grid::around(low.to_array(), high.to_array(), cells)
}
