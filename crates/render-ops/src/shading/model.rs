//! What a surface does with light, as all models of it are asked.

use bokashi_core::Scalar;

/// What reaches the eye of light from one direction, and what a gradient leads to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflected<T, const M: usize> {
    /// The BRDF times the cosine of the light's angle: radiance per irradiance that faces the light.
    pub(super) value: [T; 3],
    pub(super) normal_bar: [T; 3],
    pub(super) view_bar: [T; 3],
    pub(super) light_bar: [T; 3],
    pub(super) material_bar: [T; M],
}

/// A model of reflection, whose materials have `M` numbers. All directions are unit vectors that point
/// away from the surface.
pub(super) trait Model<const M: usize>: Copy + Send + Sync + 'static {
    /// What the numbers of a material are, in the plural, and how many of the `M` each takes.
    const PARTS: &'static [(&'static str, usize)];

    /// The BRDF times `max(n . l, 0)`.
    fn reflect<T: Scalar>(self, n: [T; 3], v: [T; 3], l: [T; 3], material: [T; M]) -> [T; 3];

    /// The same, with the gradients that `bar` leads to.
    fn pull_back<T: Scalar>(
        self,
        n: [T; 3],
        v: [T; 3],
        l: [T; 3],
        material: [T; M],
        bar: [T; 3],
    ) -> Reflected<T, M>;

    /// What reaches the eye of light that has the radiance 1 from everywhere.
    fn ambient<T: Scalar>(self, n: [T; 3], v: [T; 3], material: [T; M]) -> [T; 3];

    /// The same, with the gradients that `bar` leads to, none of them to a light.
    fn pull_back_ambient<T: Scalar>(
        self,
        n: [T; 3],
        v: [T; 3],
        material: [T; M],
        bar: [T; 3],
    ) -> Reflected<T, M>;
}
