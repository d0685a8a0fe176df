//! Differentiable rendering pipelines of your own, on a CPU: a tape, rendering operations and fits
//! under one name.
//!
//! Where is this cube, and how blurred is its picture?
//!
//! ```
//! use bokashi::glam::DMat4;
//! use bokashi::prelude::*;
//!
//! /// What is known: the cube and the camera.
//! struct Scene {
//!     mesh: Mesh,
//!     vertices: Tensor<f64>,
//!     colors: Tensor<f64>,
//!     camera: DMat4,
//! }
//!
//! impl Scene {
//!     fn picture<'t>(
//!         &self,
//!         tape: &'t Tape<f64>,
//!         variables: &Variables<'t, f64>,
//!     ) -> Result<Blurred<'t, f64>, FitError> {
//!         let pose = Pose {
//!             rotation: variables.get("rotation")?,
//!             translation: variables.get("translation")?,
//!         };
//!         let clip = project(tape.constant(&self.vertices), &self.camera, Some(pose))?;
//!         let colors = tape.constant(&self.colors);
//!         let exact = RasterOptions::new(Size::square(32)).silhouettes(Silhouettes::Exact);
//!         let picture = render(clip, &self.mesh, colors, exact, Background::Zero)?;
//!         Ok(picture.blurred(variables.get("sigma")?, &Blur::default()))
//!     }
//! }
//!
//! fn parameters(pose: [f64; 7], sigma: f64) -> Result<Parameters<f64>, FitError> {
//!     let part = |from: usize, length: usize| Tensor::from_flat_fn([length], |k| pose[from + k]);
//!     let sigma = Parameter::new("sigma", Tensor::scalar(sigma)).mapping(Mapping::Softplus);
//!     Parameters::new()
//!         .with(Parameter::new("rotation", part(0, 4)).rate(0.02))?
//!         .with(Parameter::new("translation", part(4, 3)).rate(0.01))?
//!         .with(sigma.rate(0.02))
//! }
//!
//! fn main() -> Result<(), FitError> {
//!     let sides: [[u32; 4]; 6] =
//!         [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
//!     let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
//!     // Vertex k has the bits of k as its coordinates, and as its colours.
//!     let bit = |entry: usize| ((entry / 3) >> (2 - entry % 3) & 1) as f64;
//!     let scene = Scene {
//!         mesh: Mesh::new(faces, 8)?,
//!         vertices: Tensor::from_flat_fn([8, 3], |entry| bit(entry) - 0.5),
//!         colors: Tensor::from_flat_fn([8, 3], bit),
//!         camera: perspective(0.7, 1.0, 1.0, 50.0),
//!     };
//!
//!     let tape = Tape::new();
//!     let truth = parameters([0.1, 0.3, -0.1, 0.9, 0.2, -0.1, -4.0], 1.5)?;
//!     let photo = scene.picture(&tape, &truth.record(&tape))?.image()?.value();
//!     let photo = PixelLoss::squared(&photo, &Tensor::zeros([3]))?;
//!
//!     let start = parameters([0.0, 0.2, 0.0, 1.0, 0.1, 0.0, -3.9], 3.0)?;
//!     let settings = FitSettings { steps: 100, ..FitSettings::default() };
//!     let history = Fit::new(start, settings)?.run(&mut from_fn(|tape, variables| {
//!         Ok(scene.picture(tape, variables)?.loss(&photo)?)
//!     }))?;
//!     assert!(history.last().loss < 0.1 * history.initial().loss);
//!     Ok(())
//! }
//! ```
//!
//! A method that can be refused returns a `Result`; operators, indexing and `item()` panic at the
//! caller's line ([`core`] has the rule).
//!
//! The engine's crates have names of their own, for those who need one of them alone: [`core`], the
//! tape and what it records; [`render_ops`], the rendering operations; [`fit`], the loop around them. With the
//! feature `mesh` there is `mesh`, too: remeshing, subdivision, distances between surfaces, surfaces of fields.

pub use bokashi_core as core;
pub use bokashi_fit as fit;
#[cfg(feature = "mesh")]
pub use bokashi_mesh as mesh;
pub use bokashi_render_ops as render_ops;
/// The matrices and quaternions that cameras and poses are made of.
pub use glam;

/// What nearly every pipeline names: `use bokashi::prelude::*;`.
pub mod prelude {
    pub use bokashi_core::{
        Accumulators, Gradients, Inputs, Keep, Kept, Mask, Op, Outputs, Padding, Scalar, Shape,
        SparseMatrix, Tape, Tensor, TensorError, Var,
    };
    pub use bokashi_fit::{
        DepthAlignment, Fit, FitError, FitSettings, History, Mapping, Optimizer, Parameter,
        Parameters, Penalty, Pipeline, Preconditioner, RigidWeights, Rigidity, Schedule, Topology,
        Variables, View, Views, depth_error, edge_length_error, from_fn, halved, iou,
        laplacian_error, masked_error, mean_error, mean_squared_error, multiscale_ssim_error,
        normal_error, psnr, pyramid_error, silhouette_error, squared_error, ssim, ssim_error,
        total_variation, views, weighted_error,
    };
    pub use bokashi_render_ops::camera::{look_at, perspective};
    // All operations, their types and their error. No module: it would hide a crate of the same name, and a
    // program may have a glam of its own.
    pub use bokashi_render_ops::{
        Adjacency, Assembly, Background, Blur, Blurred, Border, BoundaryCounts, Camera, Composite,
        ConstantCubeMap, ConstantFragments, ConstantTexture, Coverage, CubeMap, Cull, Culled,
        CustomFilter, DepthImage, Detail, Environment, EyeDepth, Filter, Focused, Fragments, Iris,
        Kernel, LEAST_ROUGHNESS, Layer, Lens, LensLayer, LensOptions, LensPicture, Light,
        MOST_PROBES, Material, Mesh, Picture, PixelLoss, PixelRun, Place, Pose, Prefilter, Radius,
        RasterOptions, Rasterization, RenderError, Sampler, Sampling, Silhouettes, Size, Surface,
        Texture, TextureBorder, TextureFilter, ThinLens, ThinLensOptions, VertexAttributes,
        Weighting, affine_inverse, antialias, antialias_image, composite, composite_layers, depth,
        depth_layers, depth_of_field, differentials, distort, downsample, exposure, eye_depth,
        eye_depth_slope, face_normals, fisheye, gaussian_blur, interpolate,
        interpolate_differentials, interpolate_differentials_indexed, interpolate_indexed,
        irradiance, lens_picture, orthographic, over, perturbed_normals, pinhole, project,
        project_instances, rasterize, rasterize_behind, reflect, render, rigid, sample_cube_map,
        sample_texture, se3, shade, srgb_decode, srgb_encode, tangents, transform_normals,
        transform_points, vertex_normals,
    };
}

/// The programs of the tutorial are compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/tutorial.md")]
struct Tutorial;

/// The program of the recipes is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/recipes.md")]
struct Recipes;

/// The program in the README is compiled.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
