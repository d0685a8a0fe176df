//! Blurs through an iris, which [`lens_picture`](crate::lens_picture()) and
//! [`depth_of_field`](crate::depth_of_field()) mix.

mod blur;
mod blurs;
mod iris;
mod rungs;
mod strips;

pub(crate) use self::blur::{Blur, Memory, Part};
pub(crate) use self::blurs::Blurs;
pub use self::iris::Iris;
pub(crate) use self::iris::broken_rule;
pub(crate) use self::rungs::{MOST_HALVINGS, Position, Rungs};
pub(crate) use self::strips::{Bands, ROWS, Strip, Strips, halved, mean_weight};
