//! Exact coverage: the pixels that a discontinuity crosses, resolved into what is visible in them.

mod boundary;
mod drawn;
mod gathered;
mod marks;
mod mean;
mod pieces;
mod pixel_border;
mod polygon;
mod pull_back;
mod resolved;
mod samples;
mod sheets;
mod visible;

pub(super) use self::boundary::Search;
pub(super) use self::drawn::Drawn;
pub(super) use self::pieces::Pieces;
pub(super) use self::pull_back::{Adjoints, PullBack};
pub(super) use self::resolved::Resolved;
