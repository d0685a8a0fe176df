//! Triangle meshes that change: remeshing, subdivision, distances between surfaces, surfaces of fields.
//!
//! ```
//! use bokashi_core::{Tape, Tensor};
//! use bokashi_mesh::{Grid, PointDistance, chamfer_distance, draw_points, field_surface};
//!
//! let grid = Grid::around([-1.0; 3], [1.0; 3], 16)?;
//! let tape = Tape::<f32>::new();
//! let ball = grid.sampled(|[x, y, z]| (x * x + y * y + z * z).sqrt() - 0.7);
//! let field = tape.leaf(&ball);
//! let surface = field_surface(field, None, &grid)?;
//! assert_eq!(surface.mesh.adjacency().boundary_edges(), 0);
//!
//! let drawn = draw_points(&surface.positions.value(), &surface.mesh, 500, 1)?;
//! let points = drawn.interpolate(surface.positions)?;
//! let target = tape.constant(&Tensor::from_flat_fn([1, 3], |_| 0.4));
//! let loss = chamfer_distance(points, target, PointDistance::Squared)?;
//! assert!(loss.backward()?.get(field).is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What there is
//!
//! | topic | operations and types |
//! |---|---|
//! | other meshes of one | [`remesh()`], [`subdivide()`]; a [`DerivedMesh`] carries over what stood at vertices |
//! | other positions | [`smooth()`] |
//! | numbers of a mesh | [`Connectivity`]; [`surface_area()`], [`signed_volume()`], [`self_intersections()`] |
//! | texture coordinates | [`atlas()`], packed charts; a [`TexelMap`] bakes values at vertices into texels |
//! | surfaces of fields | [`field_surface()`] at the points of a [`Grid`], [`extract_surface()`] without a tape |
//! | points on surfaces | [`draw_points()`], [`nearest_on_surface()`]; [`SurfacePoints`] move with the surface |
//! | distances | [`chamfer_distance()`]; [`nearest_points()`], [`f_score()`], [`normal_consistency()`] |

mod atlas;
mod box_tree;
mod connectivity;
mod crossing;
mod derived_mesh;
mod distances;
mod error;
mod field;
#[cfg(test)]
mod fixtures;
mod grid;
mod groups;
mod measures;
mod placed;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;
mod remesh;
mod rings;
mod smooth;
mod subdivide;
mod triangle;

pub use atlas::{Atlas, AtlasOptions, TexelMap, atlas};
pub use connectivity::Connectivity;
pub use derived_mesh::DerivedMesh;
pub use distances::{
    FScore, NearestPoints, PointDistance, SurfacePoints, chamfer_distance, draw_points, f_score,
    nearest_on_surface, nearest_points, normal_consistency,
};
pub use error::MeshError;
pub use field::{FieldSurface, extract_surface, field_surface};
pub use grid::Grid;
pub use measures::{self_intersections, signed_volume, surface_area};
pub use remesh::{EdgeLengths, RemeshOptions, remesh};
pub use smooth::{Smoothing, smooth};
pub use subdivide::{Subdivision, subdivide};
