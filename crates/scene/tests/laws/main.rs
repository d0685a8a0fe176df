//! Laws of fits of scenes.

mod ranks;
mod resuming;
