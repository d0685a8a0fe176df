//! `bokashi fit scene.toml` and `bokashi render scene.toml`: a user's own meshes, images and cameras.

mod fit;
mod outcome;
mod page;
mod pictures;
mod render;

pub(crate) use self::fit::{Asked, run};
pub(crate) use self::outcome::HELD_OUT;
pub(crate) use self::render::render;
