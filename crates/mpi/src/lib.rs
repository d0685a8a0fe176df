//! Fits that the ranks of an MPI job share.
//!
//! [`World`] is the communicator that [`Views::among`](bokashi_fit::Views::among) and fits of scenes
//! take. The program `bokashi-mpi` does with it what `bokashi fit scene.toml` does alone.
//!
//! All of it needs the feature `mpi`, and an MPI.
#![cfg(feature = "mpi")]

pub mod job;
pub mod sweep;
pub mod world;

pub use world::World;
