//! What examines Bokashi: extreme cases, stiff problems with known minima, mesh files of other people, and
//! how fast it is, at what error. Nobody who uses Bokashi needs it; the program `bokashi-lab` runs it.

pub mod bench;
pub mod models;
pub mod program;
pub mod stability;
pub mod stiff;
