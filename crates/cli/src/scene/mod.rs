//! `bokashi fit scene.toml` and `bokashi render scene.toml`: a user's own meshes, images and cameras.

mod checkpoint;
mod film;
mod fit;
mod live_page;
mod outcome;
mod page;
mod pictures;
mod progress_bar;
mod record;
mod render;
mod results;
mod turntable;

pub(crate) use self::fit::run;
pub(crate) use self::outcome::HELD_OUT;
pub(crate) use self::render::render;
