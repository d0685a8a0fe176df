//! What a surface does with light, as all models of it are asked.

use bokashi_core::Scalar;

use crate::vector::Vector3;

/// A point of a surface, as the camera sees it. Directions are unit vectors that point away from the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShadingPoint<T, const M: usize> {
    /// The normal.
    pub(super) n: Vector3<T>,
    /// The direction to the eye.
    pub(super) v: Vector3<T>,
    pub(super) material: [T; M],
}

/// Gradients of what is given at a point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bars<T, const M: usize> {
    pub(super) normal: Vector3<T>,
    pub(super) view: Vector3<T>,
    pub(super) light: Vector3<T>,
    pub(super) material: [T; M],
}

/// What reaches the eye in two ways, colour by colour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layers<T> {
    /// From below the surface, where light loses its direction.
    pub(super) below: [T; 3],
    /// From the surface itself, which mirrors it more or less.
    pub(super) above: [T; 3],
}

/// A model of reflection, whose materials have `M` numbers.
pub(super) trait Model<const M: usize>: Copy + Send + Sync + 'static {
    /// What the numbers of a material are, in the plural, and how many of the `M` each takes.
    const PARTS: &'static [(&'static str, usize)];

    /// The BRDF times `max(n . l, 0)`: radiance per irradiance that faces the light in direction `l`.
    fn reflect<T: Scalar>(self, point: ShadingPoint<T, M>, l: Vector3<T>) -> [T; 3];

    /// The same, and the gradients that its gradient `bar` leads to.
    fn pull_back<T: Scalar>(
        self,
        point: ShadingPoint<T, M>,
        l: Vector3<T>,
        bar: [T; 3],
    ) -> ([T; 3], Bars<T, M>);

    /// What reaches the eye of light that has the radiance 1 from everywhere.
    fn everywhere<T: Scalar>(self, point: ShadingPoint<T, M>) -> Layers<T>;

    /// The same, and the gradients that its gradients `bars` lead to, none of them to a light.
    fn pull_back_everywhere<T: Scalar>(
        self,
        point: ShadingPoint<T, M>,
        bars: Layers<T>,
    ) -> (Layers<T>, Bars<T, M>);
}
