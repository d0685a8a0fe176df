//! Laws of values, beside those of gradients: the same bits whatever the threads and the memory, what a
//! scene's symmetries do, pictures that are known, and what is said of wrong input.

mod determinism_core;
mod determinism_render;
mod errors;
mod golden;
mod metamorphic;
mod prelude;
