//! What surfaces are made of.

use bokashi_core::{Scalar, Var};

/// What a surface is made of, and by which model it reflects light. Each variable has a row per
/// fragment, or none and then holds for all of them: colours are `[N, 3]` or `[3]`, numbers `[N]` or
/// `[]`.
#[derive(Debug, Clone, Copy)]
pub enum Material<'t, T: Scalar> {
    /// Metals and dielectrics with microfacets: GGX, as in glTF.
    ///
    /// Roughness and metallic outside of [0, 1] are taken as the nearest number in it, and get no
    /// gradient; so is a roughness below [`LEAST_ROUGHNESS`](crate::LEAST_ROUGHNESS).
    MetallicRoughness {
        /// The diffuse colour of a dielectric, the specular colour of a metal.
        base_color: Var<'t, T>,
        /// Perceptual roughness: its square is the alpha of GGX.
        roughness: Var<'t, T>,
        /// 1 for a metal, 0 for a dielectric; between them, the share of metal in a mix of both.
        metallic: Var<'t, T>,
        /// Whether a white surface reflects all light. Else light that microfacets reflect more than
        /// once is lost, and smooth dielectrics gain some from the side.
        conserves_energy: bool,
    },
    /// A matte surface.
    Lambert {
        /// The share of the light that is reflected.
        color: Var<'t, T>,
    },
    /// A matte surface with highlights around the mirrored light.
    Phong {
        /// The share of the light that is reflected in all directions.
        color: Var<'t, T>,
        /// The share that is reflected in the highlight.
        specular: Var<'t, T>,
        /// The exponent: the larger, the smaller the highlight. Below 0 it is taken as 0, and gets no
        /// gradient.
        exponent: Var<'t, T>,
    },
    /// The same, with highlights around the normal halfway between eye and light.
    BlinnPhong {
        /// The share of the light that is reflected in all directions.
        color: Var<'t, T>,
        /// The share that is reflected in the highlight.
        specular: Var<'t, T>,
        /// The exponent, as that of [`Material::Phong`].
        exponent: Var<'t, T>,
    },
}
