//! Exact coverage: the pixels that a discontinuity crosses, resolved into what is visible in them.
//!
//! Visible surfaces are found per pixel, analytically, as Catmull did (*A hidden-surface algorithm
//! with anti-aliasing*, SIGGRAPH 1978). Polygons are clipped to the pixel and against each other as
//! by Weiler and Atherton (*Hidden surface removal using polygon area sorting*, SIGGRAPH 1977).
//!
//! ```text
//! canvas, one band of rows                     the faces that were drawn in it: BandFaces (band_faces)
//!   |
//!   v
//! BoundarySearch (boundary_pixels)             forward
//!   |-- mark            outline edges, seams and ends of the depth range mark pixels (PixelMask)
//!   |-- mark_crossings  pixels in which surface layers may pass through each other
//!   |     |-- Regions          unmarked pixels with one number of layers each (regions)
//!   |     |-- FacesByPixel     the faces that may reach into a pixel (faces_by_pixel)
//!   |     `-- DepthInterval    their depths there (depth_intervals), from their planes (planes): one layer
//!   |                          in front ends the search
//!   `-- Resolution      per marked pixel, depth group by depth group, the nearest first (resolution)
//!         |-- share_planes     faces in one plane, to within rounding (ties)
//!         |-- Crowd            a crowded pixel in smaller cells (cell, cells)
//!         |-- Visible          cut to the pixel or cell, and to what no other face hides (visible)
//!         |     |-- side_by_side   faces of which none can hide another are not held against each other
//!         |     `-- Parts      what is visible, and its sides (parts)
//!         |           `-- Polygons   convex polygons, cut by lines (polygon)
//!         |-- pixel_border     sides that lie on the pixel's border
//!         `-- Extent           centroid and spread under perspective (extent, reciprocal), and so the
//!                              mean of the barycentrics (mean)
//!   |
//!   v
//! Pieces (pieces)                              areas, barycentrics, and their sides with sources
//!   |
//!   |--> PieceFragments (piece_fragments)     forward: the pieces as fragments, sorted by face
//!   `--> PiecePullBack, Adjoints (pull_back)   backward: through means and sides to the vertices
//! ```

mod band_faces;
mod boundary_pixels;
mod cell;
mod cells;
mod depth_intervals;
mod extent;
mod faces_by_pixel;
mod mean;
mod parts;
mod piece_fragments;
mod pieces;
mod pixel_border;
mod pixel_mask;
mod planes;
mod polygon;
mod pull_back;
#[cfg(test)]
pub(super) mod quadrature;
mod reciprocal;
mod regions;
mod resolution;
mod side_by_side;
mod ties;
mod visible;

pub(super) use self::band_faces::BandFaces;
pub(super) use self::boundary_pixels::BoundarySearch;
pub(super) use self::piece_fragments::PieceFragments;
pub(super) use self::pieces::Pieces;
pub(super) use self::pull_back::{Adjoints, PiecePullBack};
