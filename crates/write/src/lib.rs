//! Files that are written whole or not at all, and below the folder that a user named.

mod below;
mod whole;

pub use below::{check_below, check_inside, place_below, write_below};
pub use whole::{check_file, check_folder, resolved, write_whole};
