//! Property-based gradient tests for anyone's operations on the Bokashi tape.

mod dual;

pub use dual::Dual;
