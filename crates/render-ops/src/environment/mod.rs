//! Light from all sides, as a cube map.
//!
//! # Forward
//! Of the light that a surface reflects towards the eye, one part comes from below it: `below E(n) / pi`, with the
//! irradiance E along its normal. The other part is mirrored: `above P(r)`, with P the environment as a surface
//! of this roughness mirrors it, and `r = 2 (n . v) n - v`. The shares `below` and `above` are those of light
//! from everywhere (`shading`); there lies the split: the product of two integrals stands for the integral of
//! a product. In an environment that is the same everywhere it is exact.
//!
//! # Backward
//! It is a composition of operations, linear in the texels.
//!
//! # Source
//! Karis, *Real shading in Unreal Engine 4*, SIGGRAPH 2013 course (the split sum).

mod harmonics;
mod prefilter;

use std::f64::consts::FRAC_1_PI;

use bokashi_core::{Scalar, Var};

pub use self::harmonics::irradiance;
pub use self::prefilter::Prefilter;
use crate::error::RenderError;
use crate::reflect::reflect;
use crate::shading::{Material, Surface, share_above, share_below};
use crate::texture::{CubeMap, Detail, Sampler, sample_cube_map};

/// Light from all sides, as surfaces see it.
#[derive(Debug, Clone)]
pub struct Environment<'t, T: Scalar> {
    /// Coefficients of the radiance in spherical harmonics, `[9, 3]`, as [`irradiance`] has them.
    pub harmonics: Var<'t, T>,
    /// What surfaces of roughness 0 to 1 mirror, in equal steps from level to level; three channels.
    pub reflections: CubeMap<'t, T>,
}

impl<'t, T: Scalar> Environment<'t, T> {
    /// The environment with the radiance `texels: [6, S, S, 3]`, for whose S the `prefilter` was made. Make it once
    /// per step, and not once per surface.
    ///
    /// # Errors
    /// [`RenderError::Shape`] for texels of another shape.
    pub fn from_texels(texels: Var<'t, T>, prefilter: &Prefilter<T>) -> Result<Self, RenderError> {
        Ok(Self {
            harmonics: prefilter.harmonics(texels)?,
            reflections: prefilter.cube_map(texels)?,
        })
    }

    /// The radiance that reaches the eye from `surface`, made of `material`, in the light of the environment:
    /// `[N, 3]`. It is added to that of other lights ([`shade`](crate::shade())).
    ///
    /// Materials without a roughness mirror nothing: Lambert, Phong and Blinn-Phong reflect as a matte surface
    /// does. Gradients go to surface, material and environment.
    ///
    /// # Errors
    /// As [`shade`](crate::shade()), [`irradiance`] and [`sample_cube_map`].
    pub fn shade(
        &self,
        surface: &Surface<'t, T>,
        material: &Material<'t, T>,
    ) -> Result<Var<'t, T>, RenderError> {
        let below = share_below(surface, material)?;
        let irradiance = irradiance(self.harmonics, surface.normals)?;
        let diffuse = below.try_mul(irradiance * T::from_f64(FRAC_1_PI))?;
        let Material::MetallicRoughness { roughness, .. } = *material else { return Ok(diffuse) };

        let normals = surface.normals;
        // A view of all rows is a view of each.
        let zeros = normals.tape().constant_full(normals.shape(), T::ZERO);
        let views = if surface.views.shape() == normals.shape() {
            surface.views
        } else {
            surface.views.try_add(zeros)?
        };
        let mirrored = -reflect(views, normals)?;
        let steps = T::from_f64((self.reflections.levels().len() - 1) as f64);
        let level = Detail::Level(roughness * steps);
        let radiance = sample_cube_map(&self.reflections, mirrored, level, Sampler::new())?;
        Ok(diffuse.try_add(share_above(surface, material)?.try_mul(radiance)?)?)
    }
}
