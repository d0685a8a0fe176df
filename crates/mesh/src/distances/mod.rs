//! Distances between surfaces: points on them, the nearest ones, and what follows from these.

mod chamfer;
mod nearest;
mod scores;
mod surface_points;

pub use chamfer::{PointDistance, chamfer_distance};
pub use nearest::{NearestPoints, nearest_on_surface, nearest_points};
pub use scores::{FScore, f_score, normal_consistency};
pub use surface_points::{SurfacePoints, draw_points};
