//! How fast Bokashi is, at what error, and what it leaves out.
//!
//! [`bench()`] answers one question after the other. They ask for steps beside other renderers and on
//! meshes from files, the gradient of silhouettes, fits to an error and to photographs. They ask for
//! blurs and operations by time and error, and for a pipeline node by node. [`elision()`] sets steps that compute
//! something beside steps that have no need of it.

mod descent;
mod difference;
mod effort;
mod elision;
mod machine;
mod mesh_file;
mod operation;
mod page;
mod pipeline;
mod questions;
mod sampling;
mod scenes;
mod setting;
mod studies;

pub use effort::Effort;
pub use elision::{Row, elision, section as elision_section};
pub use machine::Machine;
pub use mesh_file::{MeshFile, read_mesh};
pub use page::{ELISION_FILES, elision_page, page};
pub use questions::{STUDIES, bench, files, json, markdown};
pub use scenes::{Scene, scenes};
pub use setting::{Peer, read_peers};
pub use studies::MESHES;
