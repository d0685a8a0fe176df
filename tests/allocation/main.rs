//! What steps allocate, and how much memory they take: each counts what its own threads do.

mod memory;
mod steps;
