//! Scenes in files: meshes, images, cameras, and fits of their parameters.
//!
//! File formats live here, and the engine's crates never depend on them. What is read of a file that
//! somebody else wrote is checked: it is refused with the rule that it breaks, and takes memory in
//! proportion to its length.
//!
//! A scene is a folder with a file `scene.toml`; `docs/scene.md` has its keys. To load one, learn what it names, and
//! write what was learnt:
//!
//! ```no_run
//! use bokashi_scene::{Scene, SceneError, SceneFit};
//!
//! let mut fit = SceneFit::new(Scene::load("vase/scene.toml")?)?;
//! fit.run(|step| println!("step {}: loss {:.3e}", step.step, step.loss))?;
//! fit.learnt()?.save_results("vase/out")?;
//! # Ok::<(), SceneError>(())
//! ```
//!
//! | topic | what |
//! |---|---|
//! | scenes and their fits | [`Scene`], [`SceneFit`]; [`description`] is `scene.toml` as types |
//! | one file | [`load_mesh`], [`load_image`] |
//! | arrays from and to NumPy, safetensors, ndarray, glam and images | [`arrays`] |
//! | cameras of other programs | [`read_transforms`], [`read_colmap`] |
//! | how much memory files may ask for | [`limit_memory`] |

pub mod arrays;
mod cameras;
mod environment;
mod error;
mod field;
mod file;
mod file_names;
mod fitting;
mod folder;
mod gaze;
mod given;
mod hull;
mod learnables;
mod learning;
mod learnt_scene;
mod loading;
mod mask_files;
mod memory;
mod mesh;
mod model;
mod object;
mod picture;
mod rendered;
mod renderer;
mod results;
mod running;
mod saved_fit;
mod scene;
mod scene_view;
mod shapes;
mod stage_texture;
mod stopping;
mod summary;
mod targets;
mod turntable;
mod viewpoint;

/// What images, positions and parameters are.
pub use bokashi_core::Tensor;
/// What `scene.toml` says.
pub use bokashi_description as description;
/// Fits that several processes share.
pub use bokashi_fit::{Alone, Communicator, Ranks};
/// What a fit learns, a step of it, and the numbers that files have.
pub use bokashi_fit::{Parameters, Stepped, Stored};
/// What lies beyond the edges of an image.
pub use bokashi_render_ops::TextureBorder;
pub use cameras::{
    Camera, CameraFile, ColmapPoint, Distortion, NamedView, find_colmap, read_colmap,
    read_colmap_points, read_transforms, transforms_json,
};
pub use error::{Location, SceneError};
pub use file::{MOST_BYTES, write_result};
pub use fitting::{SceneFit, ViewComparison, ViewScore};
pub use folder::Folder;
pub use gaze::{gaze, share_seen};
/// Matrices and vectors of cameras and places.
pub use glam;
/// The images of [`arrays::tensor_of_image`].
#[cfg(feature = "image")]
pub use image;
pub use learnables::{LearntKey, Values, learnt_keys};
pub use loading::{LoadedMesh, load_image, load_mesh};
pub use mask_files::find_mask;
pub use memory::{limit_memory, memory_limit};
pub use mesh::{
    MeshKind, MeshOptions, ObjFiles, glb, obj, ply, read_model, read_model_bytes, read_model_with,
};
pub use model::{
    Borders, Geometry, Indexed, MaterialFile, MaterialMap, Model, NO_ROW, Placed, Submesh,
};
/// The arrays of [`arrays::tensor_of_ndarray`].
#[cfg(feature = "ndarray")]
pub use ndarray;
pub use object::{Attribute, Object, SurfaceMap, SurfaceMaterial};
pub use picture::{
    ColorSpace, Depth, MOST_SAMPLES, Mask, MaskKind, Picture, Samples, Turn, is_guarded,
};
pub use rendered::{Rendered, capped_note};
pub use renderer::{Drawn, Renderer};
pub use scene::Scene;
pub use scene_view::SceneView;
pub use summary::{BentEdge, MeshSummary, lens_note, most_bent_edges, named_files};

/// The programs in docs/arrays.md are compiled and run.
#[cfg(all(doctest, feature = "image"))]
#[doc = include_str!("../../../docs/arrays.md")]
struct Arrays;
