//! Light on surfaces.
//!
//! `shade` has the operation, `light` and `material` what it is given. `model` says what a model of
//! reflection has to know; `metallic_roughness` and `matte` have the formulas, `albedo` the integrals that
//! some of them need. `layout` says which input is what, `blocks` makes vectors of rows, and `lighting`
//! has the loops over them.

mod albedo;
mod blocks;
mod direction;
mod lamp;
mod layout;
mod light;
mod lighting;
mod material;
mod matte;
mod metallic_roughness;
mod model;
mod shade;

pub use self::light::{Light, Surface};
pub use self::material::Material;
pub use self::metallic_roughness::LEAST_ROUGHNESS;
pub use self::shade::shade;
pub(crate) use self::shade::{share_above, share_below};
