//! The structure as docs/architecture-floors.md describes it: which files there are, and which of them
//! import which.

mod imports;
mod manifest;
mod modules;
mod operations;
mod sizes;
