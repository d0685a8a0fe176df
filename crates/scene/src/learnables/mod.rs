//! What a scene can learn, as a table: a row for each.
//!
//! A row says where a fit starts, how raw numbers become values, the usual rate, and how a value is put into the
//! scene. Whatever draws, learns, saves or inspects names a row, and none of them knows more of it. To make another
//! number learnable: add its table to [`Learn`](crate::description::Learn), a row to `table.rs` and to
//! `docs/scene.md`, and let the renderer ask [`Values`] for the number.

mod exposure;
mod frame;
mod learnable;
mod lens;
mod table;
#[cfg(test)]
mod tests;
mod values;

pub(crate) use self::frame::{Frame, scaled_intrinsics};
pub(crate) use self::learnable::{Learnable, Moves};
pub(crate) use self::table::{
    BLUR, CAMERAS, COLORS, DISTORTION, ENVIRONMENT, FIELD, INTRINSICS, LIGHT_COLORS, LIGHT_PLACES,
    METALLIC, POSE, ROUGHNESS, TABLE, TEXTURE, VERTICES,
};
pub use self::table::{LearntKey, learnt_keys};
pub(crate) use self::values::Recorded;
pub use self::values::Values;
