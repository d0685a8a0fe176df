//! Every operation of Bokashi once: its subjects, strategies for their inputs, what it refuses, and benchmarks.
//!
//! All that examines operations walks this list: the laws of gradients, threads, precision and refusals,
//! benchmarks, and the test of what is compiled ahead. With its entry a new operation gets all of them.
//! [`for_each_operation!`] has the names.
//!
//! ```
//! let over = bokashi_catalogue::ENTRIES.iter().map(|entry| entry()).find(|entry| entry.name() == "over");
//! for check in over.expect("it has an entry").checks() {
//!     check.assert();
//! }
//! ```

mod areas;
mod benchmark;
mod clip_scene;
mod entry;
mod extreme;
mod footprints;
mod fragments;
mod inputs;
mod losses;
mod materials;
mod measures;
mod meshes;
mod references;
mod rendering;
mod surfaces;
mod tensors;

pub mod blends;
pub mod lens;
pub mod oracle;
pub mod scenes;
pub mod setting;

pub use areas::visible_areas;
pub use benchmark::Benchmark;
pub use entry::Entry;
pub use extreme::{Extreme, Failure, Outcome, Verdict};

/// Calls the macro `walk` with the names of all entries, by the crate that has the operations: a walk can
/// make an item of each.
#[macro_export]
macro_rules! for_each_operation {
    ($walk:ident) => {
        $walk! {
            rendering:
                project projections motions affine lenses project_instances
                face_normals vertex_normals transform_normals tangents
                perturbed_normals shade irradiance environment reflect tone rasterize
                rasterize_behind differentials sample_texture sample_cube_map
                interpolate composite composite_layers over antialias depth eye_depth
                depth_of_field lens_picture gaussian_blur downsample pictures blurred_pictures
                constant_fragments constant_textures exact_coverage pipeline;
            losses:
                mean_error ssim_error silhouette_error depth_error halved
                total_variation vertices weighted_error;
            meshes:
                field_surface chamfer_distance draw_points;
            tensors:
                squared_error add sub mul div pow select minimum maximum affine exp ln
                sqrt powi powf sin cos tanh sigmoid softplus relu abs clamp sum mean
                sum_over dot cross norm normalize sparse_product matmul permute reshape
                keepdim slice pad stack concat gather_rows scatter_add_rows
                compositions;
        }
    };
}

macro_rules! listed {
    ($($room:ident: $($name:ident)*;)*) => { &[$($($room::$name::entry),*),*] };
}

/// What makes each entry.
pub static ENTRIES: &[fn() -> Entry] = for_each_operation!(listed);
