//! Bokashi from Python: arrays come in, values and pull-backs go out.
//!
//! Each function records one step on a tape of its own, with the interpreter's lock released. It returns what it
//! computed, and a `PullBack`, which holds the tape until Python lets go of it. What Python users call stands in
//! `python/bokashi`.

mod array;
mod cameras;
mod casts;
mod coverage;
mod environment;
mod error;
mod fragments;
mod layers;
mod learning;
mod light;
mod losses;
mod materials;
mod mesh;
mod meshes;
mod operations;
mod page;
mod pull_back;
mod rendering;
mod scene;
mod step;
mod tensors;
mod texture;
mod threads;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::cameras::{orthographic, pinhole, se3};
    #[pymodule_export]
    use super::coverage::Coverage;
    #[pymodule_export]
    use super::environment::{Prefilter, irradiance, prefiltered, shade_in_environment};
    #[pymodule_export]
    use super::error::{RenderError, SceneError};
    #[pymodule_export]
    use super::layers::{composite_layers, depth_layers, lens_picture};
    #[pymodule_export]
    use super::learning::Learning;
    #[pymodule_export]
    use super::light::{depth_of_field, shade, tangents};
    #[pymodule_export]
    use super::losses::{
        Rigidity, Topology, depth_error, edge_length_error, halved, laplacian_error, mean_error,
        multiscale_ssim_error, normal_error, rigid_error, silhouette_error, ssim_error,
        total_variation,
    };
    #[pymodule_export]
    use super::mesh::Mesh;
    #[pymodule_export]
    use super::meshes::{
        Connectivity, Grid, chamfer_distance, draw_points, f_score, field_surface,
        nearest_on_surface, nearest_points, normal_consistency, remesh, self_intersections,
        signed_volume, smooth, subdivide, surface_area,
    };
    #[pymodule_export]
    use super::operations::{
        affine_inverse, distort, downsample, exposure, face_normals, fisheye, gaussian_blur, over,
        perturbed_normals, project, project_instances, reflect, rigid, srgb_decode, srgb_encode,
        transform_normals, transform_points, vertex_normals,
    };
    #[pymodule_export]
    use super::page::{learning_page, mesh_page};
    #[pymodule_export]
    use super::pull_back::PullBack;
    #[pymodule_export]
    use super::rendering::{
        antialias_image, depth, differentials, eye_depth, eye_depth_slope, interpolate,
        interpolate_differentials, picture, rasterize, render,
    };
    #[pymodule_export]
    use super::scene::{Scene, SceneFit, encode_png};
    #[pymodule_export]
    use super::tensors::{
        Sparse, cross, dot, gather_rows, matmul, norm, normalize, scatter_add_rows, sigmoid,
        softplus, sparse_product, squared_error,
    };
    #[pymodule_export]
    use super::texture::{Texture, mipmaps, sample_cube_map, sample_texture};
    #[pymodule_export]
    use super::threads::{num_threads, set_num_threads};
}
