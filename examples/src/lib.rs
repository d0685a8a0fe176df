//! The examples live in the files beside this package's manifest.
