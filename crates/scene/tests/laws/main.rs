//! Laws of fits of scenes.

mod metamorphic;
mod ranks;
mod resuming;
