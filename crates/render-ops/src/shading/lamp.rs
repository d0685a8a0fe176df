//! Lights in numbers, as the loops over rows read them.

use bokashi_core::Scalar;

use super::direction::{pull_back_unit, unit};
use crate::vector::{Vector3, difference};

/// From where light comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// From far away.
    Directional,
    /// From a point.
    Point,
    /// From everywhere, the same; what of it is reflected below surfaces may count, and at them.
    Everywhere { below: bool, above: bool },
}

impl Kind {
    /// What its strength is called.
    pub(super) fn strength(self) -> &'static str {
        match self {
            Self::Directional => "an irradiance",
            Self::Point => "an intensity",
            Self::Everywhere { .. } => "a radiance",
        }
    }

    /// What its place is called, if it has one.
    pub(super) fn place(self) -> Option<&'static str> {
        match self {
            Self::Directional => Some("a light's direction"),
            Self::Point => Some("a light's position"),
            Self::Everywhere { .. } => None,
        }
    }
}

/// A light, in numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lamp<T> {
    pub(super) kind: Kind,
    /// Its position, or the unit vector to it.
    pub(super) place: Vector3<T>,
    /// The length of its direction.
    length: T,
    /// Irradiance, intensity or radiance, by colour.
    pub(super) strength: [T; 3],
}

impl<T: Scalar> Lamp<T> {
    /// The light that has such a `place`, if its kind has one.
    pub(super) fn new(kind: Kind, place: Option<Vector3<T>>, strength: [T; 3]) -> Self {
        let place = place.unwrap_or([T::ZERO; 3]);
        let (place, length) = if kind == Kind::Directional { unit(place) } else { (place, T::ONE) };
        Self { kind, place, length, strength }
    }

    /// The unit vector to a point light from `position`, the distance and its inverse square.
    #[inline(always)]
    pub(super) fn seen_from(&self, position: Vector3<T>) -> (Vector3<T>, T, T) {
        let (l, distance) = unit(difference(self.place, position));
        (l, distance, T::ONE / distance / distance)
    }

    /// The gradient of the place that was given, from that of `place`.
    pub(super) fn pull_back_place(&self, bar: Vector3<T::Wide>) -> Vector3<T::Wide> {
        if self.kind == Kind::Directional {
            pull_back_unit(self.place.map(T::widen), self.length.widen(), bar)
        } else {
            bar
        }
    }
}
