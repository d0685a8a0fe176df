//! A hull: what the silhouettes of all views allow.
//!
//! # Formula
//! A point is outside of the hull as far as its image is outside of a silhouette: the field is the largest of its distances
//! over all views, below 0 inside. The hull is where it is 0. A view may be wrong, its mask or its camera, and would carve
//! the object away. So some of the largest distances are left out at each place. How many, the masks say: the hull
//! is taken whose images overlap with them most.
//!
//! # Errors
//! Views that are wrong aside, a hull is never smaller than the object but where [`webs`] are taken away: there edges
//! are rounder, and a real thin part goes that no silhouette shows by itself. Hollows that no silhouette shows are
//! filled. Things thinner than a cell of the grid may be cut.
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

/// How much farther than the ball that half of the views see whole a hull is looked for.
const FARTHER: f64 = 1.5;
/// Cells along the longest side: where a hull is looked for, where its images are compared with the masks and webs are
/// found, and at most where its surface is.
const CELLS: [usize; 3] = [40, 64, 128];
/// How much more has to overlap where another view is left out: places of the grid tell no less apart.
const WORTH: f64 = 0.02;
/// Cells of the finest grid, of which there are some thrice as many at the surface along a side as edges of faces.
const CELLS_PER_FACE: f64 = 9.0;
/// The least width of a cell in pixels of the [masks](LONGEST), unless there are fewer than 64 cells then.
const CELL_IN_PIXELS: f64 = 0.5;
/// Where views barely agree, a hull has sheets and gaps thinner than a cell, which would be a net of handles.
const SMOOTHINGS: usize = 2;
/// How far from the hull a point may be, in cells, whose neighbour may be inside: distances of images change faster
/// than those of the world where something is near.
const NEAR: f64 = 2.0;
/// Masks are made smaller where they are longer, in pixels: a cell is as large as several of these.
const LONGEST: usize = 640;

/// Bytes of the distances of a mask.
const OF_SILHOUETTE: u64 = 4 * (LONGEST * LONGEST) as u64;

/// The least share of views that agree, where a scene does not say.
pub(crate) const AGREEMENT: f64 = 0.8;
/// Parts of a hull that are smaller than this share of the largest are left out: places that no view can tell are empty.
const SMALLEST: f64 = 0.02;

/// The hull of all `views` that have a mask and are not held out, with about so many faces; at each place a share
/// `agreement` of these views and more agree. What is wrong with them is said in words.
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
    // That of a face of equal edges.
    let area = surface_area(&positions, &mesh)? / faces as f64;
    let length = (4.0 / 3.0_f64.sqrt() * area).sqrt();
    let even = remesh(&positions, &mesh, &RemeshOptions::uniform(length))?;
    Ok(Ok(geometry(&even.positions, &even.mesh, middle)))
}

/// The surface without parts that are [smaller](SMALLEST) than the largest.
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

/// What silhouettes allow.
struct Hull {
    silhouettes: Vec<Silhouette>,
    /// The middle and the radius of the ball that half of the views see whole.
    middle: DVec3,
    radius: f64,
}

/// A box around the middle: its least and its largest corner.
type Extent = [DVec3; 2];

impl Hull {
    /// Its surface: vertices `[V, 3]` around its middle, and faces. `None` where no place is inside. Up to `most` views
    /// are left out at each place. It is to have about so many `faces`.
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

    /// How many cells the last grid has along its longest side: a face of the hull is some cells wide, and a cell at
    /// least so many [pixels](CELL_IN_PIXELS).
    fn cells(&self, [low, high]: Extent, faces: usize) -> usize {
        let pixel = self.silhouettes.iter().map(|it| it.unit(self.middle));
        let pixel = pixel.fold(f64::INFINITY, f64::min);
        let most = (high - low).max_element() / (CELL_IN_PIXELS * pixel);
        let [_, least, finest] = CELLS;
        let cells = (CELLS_PER_FACE * faces as f64).sqrt().min(most).ceil() as usize;
        cells.clamp(least, finest)
    }

    /// A box that the hull lies in, with so many views left out; `None` where there is none.
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

    /// How alike the masks and the images of the hull with these values are: the mean over all views of the share
    /// that both cover of what one of them covers.
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

    /// The field at the points of a grid; beyond `extent` all is outside.
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

    /// How many times faster than the distance in the world the field may change inside a box: distances of images
    /// do where something is nearer than the middle.
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

/// How many parts a closed surface has, and how many handles these have.
fn parts_and_handles(mesh: &Mesh) -> [i64; 2] {
    let connectivity = Connectivity::new(mesh);
    let parts = connectivity.parts() as i64;
    [parts, parts - connectivity.euler_characteristic() / 2]
}

/// The grid around a box with so many cells along its longest side.
fn around([low, high]: Extent, cells: usize) -> Result<Grid, MeshError> {
    Grid::around(low.to_array(), high.to_array(), cells)
}
