//! What Bokashi is put through: extreme cases, and stiff problems with known minima.

pub mod stability;
pub mod stiff;
