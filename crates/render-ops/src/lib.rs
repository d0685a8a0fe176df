//! Differentiable rendering operations on the Bokashi tape.
//!
//! An operation has a backward pass of its own, recorded through the same trait that is open to everyone, or is
//! composed of such operations. Surface first, image last:
//!
//! ```
//! use bokashi_core::{Tape, Tensor};
//! use bokashi_render_ops::{
//!     Background, Blur, Mesh, RasterOptions, Silhouettes, Size, project, render,
//! };
//!
//! let mesh = Mesh::new(vec![[0, 1, 2]], 3)?;
//! let tape = Tape::<f32>::new();
//! let corners = vec![-0.5, -0.5, 0.0, 0.5, -0.5, 0.0, 0.0, 0.6, 0.0];
//! let positions = tape.leaf(&Tensor::new([3, 3], corners)?);
//! let colors = tape.leaf(&Tensor::full([3, 3], 0.8));
//! let sigma = tape.leaf_scalar(1.0);
//!
//! let clip = project(positions, &glam::DMat4::IDENTITY, None)?;
//! let options = RasterOptions::new(Size::square(16)).silhouettes(Silhouettes::Exact);
//! let picture = render(clip, &mesh, colors, options, Background::Zero)?;
//! let image = picture.blurred(sigma, &Blur::default()).image()?;
//! let gradients = image.square().sum().backward()?;
//! assert!(gradients.get(positions).is_some() && gradients.get(sigma).is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What there is
//!
//! | topic | operations and types |
//! |---|---|
//! | cameras | [`project()`], [`project_instances()`], [`Pose`]; on the tape [`pinhole()`], [`orthographic()`], [`rigid()`], [`se3`], [`affine_inverse()`]; lenses [`distort()`], [`fisheye()`]; fixed ones in [`camera`] |
//! | meshes | [`Mesh`], [`Assembly`] of several; [`face_normals()`], [`vertex_normals()`], [`tangents()`], [`transform_points()`], [`transform_normals()`], [`perturbed_normals()`] |
//! | visibility | [`rasterize()`] with [`RasterOptions`], [`Sampling`] and [`Cull`] gives [`Fragments`]; [`Coverage`], also of [triangle ids](Coverage::from_ids); [`rasterize_behind()`], [`depth_layers()`] |
//! | at fragments | [`interpolate()`], [`interpolate_indexed()`], [`depth()`], [`eye_depth()`], [`eye_depth_slope()`], [`differentials()`], [`interpolate_differentials()`] |
//! | textures | [`sample_texture()`] of a [`Texture`], [`sample_cube_map()`] of a [`CubeMap`], with a [`Sampler`] |
//! | light | [`shade()`] a [`Surface`] of a [`Material`] under [`Light`]s; [`Environment`], [`irradiance()`], [`reflect()`] |
//! | a picture in one call | [`render()`] with [`RasterOptions`] and [`Silhouettes`]; after a shader [`Fragments::picture`] |
//! | pictures | [`composite()`] before a [`Background`], [`antialias()`], [`antialias_image()`], [`Picture`], [`composite_layers()`], [`over()`] |
//! | through a lens | [`lens_picture()`] of a [`LensLayer`] and those behind it, by a [`ThinLens`] |
//! | images | [`gaussian_blur()`], [`depth_of_field()`], [`downsample()`], [`srgb_encode()`], [`srgb_decode()`], [`exposure()`] |
//! | losses of pictures | [`Picture::loss`] and [`Blurred::loss`] by a [`PixelLoss`], at the cost of what is covered |
//!
//! Shapes are those of `docs/notation.md`: `V` vertices, `F` faces, `N` fragments, `C` channels. Which silhouettes
//! suit which fit is in `docs/silhouettes.md`. Whatever a fit does not learn costs no gradient.
//!
//! # Features
//!
//! `parallel`, on by default, shares large kernels among threads; the bits stay the same without it.

mod antialias;
mod assembly;
mod attributes;
mod background;
mod border;
mod boundary;
pub mod camera;
mod composite;
mod composite_layers;
mod convolution;
mod copy;
mod corner_sums;
mod corners;
mod coverage;
mod creases;
mod cube_faces;
mod defocus;
mod depth;
mod depth_image;
mod depth_of_field;
mod differentials;
mod direct_gradients;
mod dispatch;
mod downsample;
mod edge_functions;
#[doc(hidden)]
pub mod edges;
mod environment;
mod error;
mod eye_depth;
mod face_normals;
mod face_quotients;
mod face_sums;
mod facet;
mod fetch;
mod filter;
#[cfg(test)]
mod fixtures;
mod fragments;
mod gaussian_blur;
mod homogeneous;
mod image;
mod interpolate;
mod interpolate_differentials;
mod lens;
mod losses;
mod matrix;
mod mesh;
mod mipmaps;
mod order;
mod over;
mod perturbed_normals;
mod picture;
mod picture_rows;
mod pixel_loss;
mod planes;
mod point_map;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;
mod project;
mod project_instances;
mod projection;
mod raster_options;
mod rasterize;
mod reference_rows;
mod reflect;
mod render;
mod rotation;
mod row_map;
mod rows;
mod run_reader;
mod runs;
mod scratch;
mod shading;
mod size;
mod slopes;
mod squared_error;
mod srgb;
mod tangents;
mod taps;
mod texture;
mod transform_normals;
mod transform_points;
mod vector;
mod vertex_attributes;
mod vertex_normals;
mod weighted_sums;

pub use antialias::{antialias, antialias_image};
pub use assembly::{Assembly, Place};
pub use background::Background;
pub use border::Border;
pub use boundary::BoundaryCounts;
pub use camera::{affine_inverse, distort, fisheye, orthographic, pinhole, rigid, se3};
pub use composite::composite;
pub use composite_layers::{Layer, composite_layers};
pub use coverage::{Coverage, Culled, PixelRun};
pub use defocus::Iris;
pub use depth::depth;
pub use depth_image::DepthImage;
pub use depth_of_field::{Focused, Lens, LensOptions, depth_of_field};
pub use differentials::differentials;
pub use downsample::downsample;
pub use environment::{Environment, Prefilter, irradiance};
pub use error::RenderError;
pub use eye_depth::{EyeDepth, eye_depth};
pub use face_normals::face_normals;
pub use filter::{CustomFilter, Filter};
pub use fragments::{ConstantFragments, Fragments};
pub use gaussian_blur::{Blurred, gaussian_blur};
/// The matrices, vectors and quaternions that cameras and poses are made of.
pub use glam;
pub use interpolate::{interpolate, interpolate_indexed};
pub use interpolate_differentials::{interpolate_differentials, interpolate_differentials_indexed};
pub use lens::{LensLayer, LensPicture, ThinLens, ThinLensOptions, lens_picture};
pub use mesh::{Adjacency, Mesh};
pub use over::over;
pub use perturbed_normals::perturbed_normals;
pub use picture::{Composite, Picture};
pub use pixel_loss::PixelLoss;
pub use project::{Pose, project};
pub use project_instances::project_instances;
pub use projection::Camera;
#[doc(hidden)]
pub use raster_options::Limits;
pub use raster_options::{Cull, RasterOptions, Rasterization, Sampling, Silhouettes};
pub use rasterize::{depth_layers, rasterize, rasterize_behind};
pub use reflect::reflect;
pub use render::render;
pub use shading::{LEAST_ROUGHNESS, Light, Material, Surface, shade};
pub use size::Size;
pub use slopes::eye_depth_slope;
pub use srgb::{exposure, srgb_decode, srgb_encode};
pub use tangents::tangents;
pub use taps::{Blur, Kernel, Radius};
pub use texture::{
    ConstantCubeMap, ConstantTexture, CubeMap, Detail, MOST_PROBES, Sampler, Texture,
    TextureBorder, TextureFilter, sample_cube_map, sample_texture,
};
pub use transform_normals::transform_normals;
pub use transform_points::transform_points;
pub use vertex_attributes::VertexAttributes;
pub use vertex_normals::{Weighting, vertex_normals};
