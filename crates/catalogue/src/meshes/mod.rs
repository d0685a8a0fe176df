//! Operations of `bokashi-mesh`, a file for each operation.

pub(crate) mod chamfer_distance;
pub(crate) mod draw_points;
pub(crate) mod field_surface;
