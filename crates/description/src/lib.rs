//! Descriptions of scenes as texts: `scene.toml`, whose keys are checked one by one, its schema for editors, and
//! the JSON of glTF.
//!
//! Parsers are long and run once per file. So they are a crate of their own, which needs nothing of the engine:
//! it is compiled beside the engine, and for size rather than speed.

mod description;
mod error;
mod gltf_json;
mod learn;
mod location;
mod meshes;
mod numbers;
mod pipeline;
mod schema;
mod views;
mod words;

pub use description::{Description, schema};
pub use error::DescriptionError;
pub use gltf_json::{gltf_root, gltf_version};
pub use learn::{
    HeldOutEntry, Learn, LearnExposure, LearnField, LearnLens, LearnMaps, LearnNumbers,
    LearnObjects, LearnPose, LearnVertices, LensNumber, LossEntry, LossKind, Remesh, Stage,
    StageTexture, StopEntry,
};
pub use location::{Location, shortened, shortened_path};
pub use meshes::{MaterialEntry, MeshEntry, Placement, Rotation, Shape};
pub use numbers::{
    BladeCount, CellCount, CircleRadius, Count, Finite, NotNegative, PassCount, Positive, Share,
    StartCount, SurfaceCount, TextureSize,
};
pub use pipeline::{
    CullName, EnvironmentEntry, FilterName, IrisEntry, KernelName, LensEntry, LightEntry,
    LightPlace, Opening, PipelineEntry, SilhouettesName, SurfaceModel, Tone,
};
pub use views::{
    CameraEntry, CamerasEntry, Coefficients, ColorSpaceName, Convention, Focal, ViewEntry, ViewLens,
};
pub use words::json_message;
