//! Laws of values, beside those of gradients: the same bits whatever the threads and the memory, what a
//! scene's symmetries do, pictures that are known, the messages of wrong input, and where whole fits end.

mod benchmarks;
mod determinism;
mod errors;
mod fits;
mod golden;
mod lens;
mod metamorphic;
mod prelude;
mod references;
