//! Laws across the crates live in the files beside this package's manifest.
