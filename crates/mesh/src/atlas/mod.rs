//! An atlas: texture coordinates for a surface that has none.
//!
//! # Method
//! The surface is cut into charts, whose normals lie within a cone. Each chart is projected along its axis, and cut
//! further where the projection would overlap. So a texel shows at most `1 / cos(cone)` times the area that it shows on
//! a face across the axis. Charts are packed into a square with gutters around them.
//!
//! # Seams
//! A sample of level k is made of texels at most `1.5 2^k` from its place along each axis. The gutters around each
//! chart are that wide, and hold copies of its border ([`TexelMap`]). So up to level [`Atlas::levels`] no sample mixes
//! two charts; coarser samples do.

mod charts;
mod flat;
mod options;
mod packing;
#[cfg(test)]
mod tests;
mod texels;

use bokashi_core::{Scalar, Tensor};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec2;

use crate::error::MeshError;
use crate::placed::Placed;
use charts::{Faces, NONE};
use flat::{FlatChart, flattened};
pub use options::AtlasOptions;
use options::reach;
use packing::{Packing, packed};
pub use texels::TexelMap;

/// The least share of a texture that charts cover. Below it, gutters are made smaller as long as they can be.
const COVERED: f64 = 0.3;

/// The most attempts with larger texels.
const ATTEMPTS: usize = 12;

/// The factor by which texels grow between attempts beyond what packing needs: charts that are cut anew need more room.
const GROWN: f64 = 1.1;

/// Texture coordinates of a surface.
#[derive(Debug, Clone)]
pub struct Atlas<T> {
    /// Coordinates `[T, 2]` from 0 to 1, u to the right and v down. Each row belongs to one vertex.
    pub coordinates: Tensor<T>,
    /// The rows of the coordinates at the corners of each face.
    pub corners: Mesh,
    /// The vertex of each of the `T` rows.
    pub vertices: Vec<u32>,
    /// The number of texels along each side of the texture.
    pub size: usize,
    /// The coarsest level of detail at which no sample mixes charts.
    pub levels: usize,
    /// The number of charts.
    pub charts: usize,
    /// The chart of each face; `None` for a face without an area.
    pub chart_of: Vec<Option<u32>>,
}

/// Makes texture coordinates for the faces of `mesh` at `positions: [V, 3]`.
///
/// Faces without an area lie at one place of some chart, or at (0, 0). The time is about linear in the number of faces,
/// as long as charts seldom overlap themselves and seldom join: 200,000 faces take a second.
///
/// ```
/// use bokashi_core::Tensor;
/// use bokashi_mesh::{AtlasOptions, TexelMap, atlas};
/// use bokashi_render_ops::Mesh;
///
/// // Two sides of a cube, and a brightness at each of their corners.
/// let corners = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0., 0., 1.], [1., 0., 1.]];
/// let mesh = Mesh::new(vec![[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]], 6)?;
/// let mut options = AtlasOptions::new(128);
/// // At 45 degrees and more, one chart would have both.
/// options.cone = 40.0;
/// let found = atlas(&Tensor::<f32>::from(corners), &mesh, &options)?;
/// assert_eq!((found.charts, found.levels), (2, 2));
/// // The edge between them is a seam: its two vertices have two coordinates each.
/// assert_eq!(found.vertices.len(), 6 + 2);
///
/// let map = TexelMap::new(&found.coordinates, &found.corners, found.size)?;
/// let brightness = Tensor::<f32>::from_flat_fn([6, 1], |vertex| vertex as f32);
/// assert_eq!(**map.bake(&brightness, &mesh)?.shape(), [128, 128, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TensorError::Shape`](bokashi_core::TensorError::Shape) unless there is a position for each vertex;
/// [`TensorError::Value`](bokashi_core::TensorError::Value) for positions that are not finite, and for options out of
/// their range; [`MeshError::AtlasSize`] where the texture has no room for all charts.
pub fn atlas<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
    options: &AtlasOptions,
) -> Result<Atlas<T>, MeshError> {
    options.check()?;
    let placed = Placed::new("atlas", positions, mesh)?;
    let faces = Faces::new(&placed, mesh);
    let size = options.size;
    // No texture has more than 14 coarser levels.
    let mut levels = options.levels.min(14);
    let charts = faces.charts(options.cone.to_radians().cos());
    let flat = |levels: usize, texel: f64| {
        flattened(&charts, &faces, &placed, mesh.faces(), reach(levels) * texel)
    };
    // The largest width of a texel on the surface at which charts cover enough.
    let mut texel = (faces.area() / COVERED).sqrt() / size as f64;
    while levels > 0 {
        let charts = flat(levels, texel);
        let packing = packed(&charts, size, reach(levels));
        if let Some(packing) = packing.filter(|it| it.covered(&charts, size) >= COVERED) {
            return Atlas::new(&charts, &packing, mesh, size, levels);
        }
        levels -= 1;
    }
    let mut charts = flat(0, texel);
    for _ in 0..ATTEMPTS {
        let Some(packing) = packed(&charts, size, reach(0)) else { break };
        if packing.scale.recip() <= texel {
            return Atlas::new(&charts, &packing, mesh, size, 0);
        }
        // Charts cover less, so texels are larger, and more faces of a chart that winds beside itself share them.
        texel = GROWN / packing.scale;
        charts = flat(0, texel);
    }
    Err(MeshError::AtlasSize { size, charts: charts.len() })
}

impl<T: Scalar> Atlas<T> {
    fn new(
        charts: &[FlatChart],
        packing: &Packing,
        mesh: &Mesh,
        size: usize,
        levels: usize,
    ) -> Result<Self, MeshError> {
        let (mut coordinates, mut vertices) = (Vec::new(), Vec::new());
        let mut corners = vec![[NONE; 3]; mesh.faces().len()];
        let mut chart_of = vec![None; mesh.faces().len()];
        // A row of the coordinates of each vertex.
        let mut some_of = vec![NONE; mesh.vertex_count()];
        for ((chart, corner), number) in charts.iter().zip(&packing.corners).zip(0..) {
            let first = vertices.len() as u32;
            for (vertex, point) in chart.vertices.iter().zip(&chart.points) {
                let at = (*corner + *point * packing.scale) / size as f64;
                // v runs down, so that the front of a face shows the texture unmirrored.
                let at = DVec2::new(at.x, 1.0 - at.y).clamp(DVec2::ZERO, DVec2::ONE);
                coordinates.extend(at.to_array().map(T::from_f64));
                some_of[*vertex as usize] = vertices.len() as u32;
                vertices.push(*vertex);
            }
            for (face, own) in chart.faces.iter().zip(&chart.corners) {
                corners[*face as usize] = own.map(|row| first + row);
                chart_of[*face as usize] = Some(number);
            }
        }
        for (face, own) in mesh.faces().iter().zip(&mut corners).filter(|(_, own)| own[0] == NONE) {
            for (vertex, row) in face.iter().zip(own) {
                let some = &mut some_of[*vertex as usize];
                if *some == NONE {
                    *some = vertices.len() as u32;
                    vertices.push(*vertex);
                    coordinates.extend([T::ZERO; 2]);
                }
                *row = *some;
            }
        }
        let coordinates = Tensor::new([vertices.len(), 2], coordinates)?;
        let corners = Mesh::new(corners, vertices.len())?;
        Ok(Self { coordinates, corners, vertices, size, levels, charts: charts.len(), chart_of })
    }
}
