//! Every operation of Bokashi once: its subjects, strategies for their inputs, and what it refuses.
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
mod clip_scene;
mod entry;
mod extreme;
mod footprints;
mod fragments;
mod inputs;
mod losses;
mod materials;
mod measures;
mod oracle;
mod references;
mod rendering;
mod surfaces;
mod tensors;

pub mod blends;
pub mod scenes;

pub use areas::visible_areas;
pub use entry::Entry;
pub use extreme::{Extreme, Failure, Outcome, Verdict};

/// Calls the macro `walk` with the names of all entries, by the crate that has the operations: a walk can
/// make an item of each.
#[macro_export]
macro_rules! for_each_operation {
    ($walk:ident) => {
        $walk! {
            tensors:
                abs add affine clamp compositions concat cos cross div
                dot exp gather_rows keepdim ln matmul maximum mean minimum mul norm
                normalize pad permute pow powf powi relu reshape scatter_add_rows select
                sigmoid sin slice softplus sparse_product sqrt squared_error stack sub
                sum sum_over tanh;
            rendering:
                affine antialias blurred_pictures composite composite_layers depth
                depth_of_field differentials downsample environment exact_coverage
                eye_depth face_normals gaussian_blur interpolate irradiance lenses
                motions over perturbed_normals pictures pipeline project
                project_instances projections rasterize rasterize_behind reflect
                sample_cube_map sample_texture shade still_fragments tangents tone
                transform_normals vertex_normals;
            losses:
                depth_error halved mean_error silhouette_error ssim_error
                total_variation vertices weighted_error;
        }
    };
}

macro_rules! listed {
    ($($room:ident: $($name:ident)*;)*) => { &[$($($room::$name::entry),*),*] };
}

/// What makes each entry.
pub static ENTRIES: &[fn() -> Entry] = for_each_operation!(listed);
