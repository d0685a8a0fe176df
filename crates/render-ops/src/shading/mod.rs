//! Light on surfaces.
//!
//! `shade` has the operation, `light` and `material` what it is given. `model` says what a model of
//! reflection has to know; `metallic_roughness` and `matt` have the formulas, `albedo` the integrals that
//! some of them need, and `rows` the blocks of rows that vectors are made of.

mod albedo;
mod blocks;
mod direction;
mod light;
mod material;
mod matt;
mod metallic_roughness;
mod model;
mod shade;
#[cfg(test)]
mod tests;

pub use self::light::{Light, Surface};
pub use self::material::Material;
pub use self::metallic_roughness::LEAST_ROUGHNESS;
pub use self::shade::shade;
