//! Exact coverage: the pixels that a discontinuity crosses, resolved into what is visible in them.

mod boundary;
mod marks;
mod mean;
mod polygon;
mod pull_back;
mod resolved;
mod samples;
mod sheets;
mod visible;

pub(super) use self::boundary::{Drawn, Pieces, Search};
pub(super) use self::pull_back::{Adjoints, PullBack};
pub(super) use self::resolved::Resolved;
