//! The public interface, tested from outside.

mod distances;
mod field;
