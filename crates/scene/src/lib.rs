//! Scenes in files: meshes, images, cameras, and fits of their parameters.
//!
//! File formats live here, and the engine's crates never depend on them. What is read of a file that
//! somebody else wrote is checked: it is refused with the rule that it breaks, and takes memory in
//! proportion to its length.

mod cameras;
pub mod description;
mod error;
mod fitting;
mod folder;
mod learning;
mod learnt_scene;
mod mesh;
mod model;
mod object;
mod outline;
mod picture;
mod rendered;
mod renderer;
mod results;
mod scene;
mod shapes;
mod targets;
mod values;
mod viewpoint;
mod words;

/// What images, positions and parameters are.
pub use bokashi_core::Tensor;
pub use cameras::{
    Camera, ColmapPoint, NamedView, read_colmap, read_colmap_points, read_transforms,
    transforms_json,
};
pub use error::{Place, SceneError};
pub use fitting::{SceneFit, ViewScore};
pub use folder::{Folder, MOST_BYTES};
pub use mesh::{MeshKind, glb, ply, read_model, read_model_bytes};
pub use model::{Geometry, Indexed, MaterialFile, Model, Placed};
pub use object::{Attribute, Object, SurfaceLook};
pub use outline::{Outline, gaze, named_files, share_seen};
pub use picture::{ColorSpace, MOST_SAMPLES, Picture, Samples, is_guarded};
pub use rendered::Rendered;
pub use renderer::{Drawn, Renderer};
pub use results::write_file;
pub use scene::{Scene, SceneView};
pub use values::Values;
