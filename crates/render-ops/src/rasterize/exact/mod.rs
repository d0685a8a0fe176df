//! Exact coverage: the pixels that a discontinuity crosses, resolved into what is visible in them.

mod polygon;
mod visible;
