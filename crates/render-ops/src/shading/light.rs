//! Surfaces and the lights on them.

use bokashi_core::{Scalar, Var};

/// Where surfaces face, and from where they are seen: a row per fragment.
#[derive(Debug, Clone, Copy)]
pub struct Surface<'t, T: Scalar> {
    /// Normals `[N, 3]`, of any length but 0.
    pub normals: Var<'t, T>,
    /// Directions to the eye, `[N, 3]` or `[3]` for all rows, of any length but 0.
    pub views: Var<'t, T>,
    /// Positions `[N, 3]`, where a light is a point.
    pub positions: Option<Var<'t, T>>,
}

/// A source of light. All of its vectors are `[3]`; radiometric ones have a number per colour.
#[derive(Debug, Clone, Copy)]
pub enum Light<'t, T: Scalar> {
    /// Light from far away.
    Directional {
        /// The direction to the light, of any length but 0.
        direction: Var<'t, T>,
        /// The irradiance of a surface that faces the light.
        irradiance: Var<'t, T>,
    },
    /// Light from a point: its irradiance falls with the square of the distance.
    Point {
        /// Where the light is, in the space of the surface's positions.
        position: Var<'t, T>,
        /// The radiant intensity: the irradiance at distance 1.
        intensity: Var<'t, T>,
    },
    /// The same light from everywhere.
    Ambient {
        /// Its radiance.
        radiance: Var<'t, T>,
    },
}
