//! What Bokashi is put through: extreme cases, and stiff problems with known minima.

mod areas;
pub mod stability;
pub mod stiff;

pub use areas::visible_areas;
