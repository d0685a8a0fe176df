//! A face with texture coordinates: in which direction u grows on it, as its corners see that.
//!
//! # Forward
//! With the corner k that faces the longest edge, `dv_i = v_i - v_k`, and `e` the edges of the face,
//! `t = s (dv_(k+1) e_(k+1) + dv_(k+2) e_(k+2))`. This is dp/du times the size of the determinant
//! `du_(k+1) dv_(k+2) - dv_(k+1) du_(k+2)`, whose sign is s. A corner with unit normal m sees
//!
//! - the direction `d = q / |q|`, `q = t - m (m . t)`;
//! - the angle `phi = atan2(|A|, D)` between the edges a and b that begin there, seen along m:
//!   `A = m . (a x b)`, `D = a' . b'` with `a' = a - m (m . a)` and `b'` alike.
//!
//! # Backward
//! `q_bar = (d_bar - d (d . d_bar)) / |q|`, `t_bar += q_bar - m (m . q_bar)`,
//! `m_bar -= (m . t) q_bar + (m . q_bar) t`; and with `h = A^2 + D^2`,
//! `A_bar = sign(A) phi_bar D / h`, `D_bar = -phi_bar |A| / h`, `a_bar = D_bar b'` beside what A has,
//! and `m_bar += A_bar (a x b) - D_bar ((m . b) a' + (m . a) b')`. Components along m are left out of
//! `m_bar`: normalizing removes them.
//!
//! # Degenerate faces
//! No corner sees anything where the face has no normal (`facet`), or where the determinant is no
//! larger than a bound on its rounding error. A corner sees nothing where its normal is zero, where t
//! is along the normal to within rounding, or one of the corner's edges is.

use bokashi_core::Scalar;

use crate::facet::Facet;
use crate::vector::{
    Direction, ROUNDING, Vector3, across, cross, difference, dot, larger, power_of_two_to_1,
    scaled, sum,
};

/// A face on which u has a direction.
pub(super) struct Textured<S> {
    facet: Facet<S>,
    /// The unit normals at the corners, where they are not zero.
    normals: [Option<Vector3<S>>; 3],
    /// The differences of v along the edges after and before the corner that faces the longest edge,
    /// times `factor` and the determinant's sign.
    dv: [S; 2],
    factor: S,
    /// Whether the texture is mirrored, seen from the front.
    pub(super) is_mirrored: bool,
    /// Along dp/du, and a bound on its error.
    t: Vector3<S>,
    error: S,
}

/// The tangent at a corner, and its angle.
pub(super) struct CornerTangent<S> {
    /// The unit normal.
    m: Vector3<S>,
    direction: Direction<S>,
    /// `A` and `D`.
    area: S,
    product: S,
    /// A bound on the error of the direction.
    pub(super) doubt: S,
}

impl<S: Scalar> CornerTangent<S> {
    pub(super) fn direction(&self) -> Vector3<S> {
        self.direction.unit
    }

    pub(super) fn angle(&self) -> S {
        self.area.abs().atan2(self.product)
    }
}

/// The gradient of a corner's tangent.
pub(super) struct CornerTangentBar<S> {
    pub(super) direction_bar: Vector3<S>,
    pub(super) angle_bar: S,
}

/// Gradients of a face's corners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bars<S> {
    pub(super) positions: [Vector3<S>; 3],
    /// Of the unit normals.
    pub(super) normals: [Vector3<S>; 3],
    /// Of the texture coordinates: those of u are zero.
    pub(super) coordinates: [[S; 2]; 3],
}

impl<S: Scalar> Bars<S> {
    pub(super) const ZERO: Self = Self {
        positions: [[S::ZERO; 3]; 3],
        normals: [[S::ZERO; 3]; 3],
        coordinates: [[S::ZERO; 2]; 3],
    };
}

impl<S: Scalar<Wide = S>> Textured<S> {
    /// The face with these corners in the rows of positions and normals, `[V, 3]`, and of coordinates,
    /// `[A, 2]`; `None` where it is degenerate.
    #[inline(always)]
    pub(super) fn new<T: Scalar<Wide = S>>(
        [positions, normals, coordinates]: [&[T]; 3],
        face: [u32; 3],
        named: [u32; 3],
    ) -> Option<Self> {
        let facet = Facet::new(positions, face)?;
        let rows = coordinates.as_chunks::<2>().0;
        let corners = named.map(|index| rows[index as usize].map(T::widen));
        let ([[du, dv], [eu, ev]], factor) = differences(corners, facet.apex);
        let [one, other] = [du * ev, dv * eu];
        let determinant = one - other;
        if determinant.abs() <= S::from_f64(ROUNDING) * (one.abs() + other.abs()) {
            return None;
        }
        // Rows run downwards: unmirrored, v falls to the left of where u grows.
        let is_mirrored = determinant > S::ZERO;
        let dv = [dv, ev].map(|dv| if is_mirrored { dv } else { -dv });
        let edges = ends(&facet);
        let [by_next, by_last] = [0, 1].map(|i| scaled(dv[i], edges[i]));
        let sizes = [by_next, by_last].map(|[x, y, z]| x.abs() + y.abs() + z.abs());
        let error = S::from_f64(ROUNDING) * (sizes[0] + sizes[1]);
        let rows = normals.as_chunks::<3>().0;
        let unit = |direction: Direction<S>| direction.unit;
        let normals =
            face.map(|vertex| Direction::new(rows[vertex as usize].map(T::widen)).map(unit));
        Some(Self { dv, factor, is_mirrored, t: sum(by_next, by_last), error, normals, facet })
    }

    /// The edges that begin at a corner: to the next corner, and to the last one.
    #[inline(always)]
    fn edges_at(&self, corner: usize) -> [Vector3<S>; 2] {
        let edges = &self.facet.edges;
        [edges[(corner + 2) % 3], edges[(corner + 1) % 3].map(|entry| -entry)]
    }

    /// The tangent at a corner, and its angle.
    #[inline(always)]
    pub(super) fn corner_tangent(&self, corner: usize) -> Option<CornerTangent<S>> {
        let m = self.normals[corner]?;
        let direction = Direction::beyond(across(m, self.t), self.error)?;
        let [a, b] = self.edges_at(corner);
        let area = self.facet.area * dot(m, self.facet.normal);
        let product = dot(across(m, a), across(m, b));
        let least = S::from_f64(16.0 * ROUNDING * ROUNDING) * dot(a, a) * dot(b, b);
        if area * area + product * product <= least {
            return None;
        }
        let doubt = self.error * direction.factor / direction.length;
        Some(CornerTangent { m, direction, area, product, doubt })
    }

    /// The gradients of the corners, from each corner's tangent and its gradient.
    #[inline(always)]
    pub(super) fn pull_back(
        &self,
        corners: [Option<(CornerTangent<S>, CornerTangentBar<S>)>; 3],
    ) -> Bars<S> {
        let mut bars = Bars::ZERO;
        let Facet { normal, area, factor, apex, .. } = self.facet;
        let c = scaled(area, normal);
        let (mut c_bar, mut t_bar, mut edge_bars) = ([S::ZERO; 3], [S::ZERO; 3], [[S::ZERO; 3]; 3]);
        for (k, corner) in corners.into_iter().enumerate() {
            let Some((tangent, CornerTangentBar { direction_bar, angle_bar })) = corner else {
                continue;
            };
            let m = tangent.m;
            let q_bar = tangent.direction.pull_back(direction_bar);
            let along = dot(m, q_bar);
            t_bar = sum(t_bar, across(m, q_bar));
            let [a, b] = self.edges_at(k);
            let [along_a, along_b] = [a, b].map(|edge| dot(m, edge));
            let [a, b] = [a, b].map(|edge| across(m, edge));
            let h = tangent.area * tangent.area + tangent.product * tangent.product;
            let share = angle_bar / h;
            let area_bar =
                share * if tangent.area < S::ZERO { -tangent.product } else { tangent.product };
            let product_bar = -(share * tangent.area.abs());
            let m_bar = difference(
                scaled(area_bar, c),
                sum(scaled(dot(m, self.t), q_bar), scaled(along, self.t)),
            );
            bars.normals[k] =
                difference(m_bar, scaled(product_bar, sum(scaled(along_b, a), scaled(along_a, b))));
            c_bar = sum(c_bar, scaled(area_bar, m));
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            edge_bars[last] = sum(edge_bars[last], scaled(product_bar, b));
            edge_bars[next] = difference(edge_bars[next], scaled(product_bar, a));
        }
        let places = [(apex + 1) % 3, (apex + 2) % 3];
        let mut v_bars = [S::ZERO; 3];
        for (i, (corner, edge)) in places.into_iter().zip(ends(&self.facet)).enumerate() {
            edge_bars[corner] = sum(edge_bars[corner], scaled(self.dv[i], t_bar));
            let dv_bar = self.factor * dot(edge, t_bar);
            let dv_bar = if self.is_mirrored { dv_bar } else { -dv_bar };
            v_bars[corner] += dv_bar;
            v_bars[apex] -= dv_bar;
        }
        for k in 0..3 {
            let by_edges = difference(edge_bars[(k + 1) % 3], edge_bars[(k + 2) % 3]);
            let by_cross = cross(c_bar, self.facet.edges[k]);
            bars.positions[k] = scaled(factor, sum(by_edges, by_cross));
            bars.coordinates[k] = [S::ZERO, v_bars[k]];
        }
        bars
    }
}

/// The edges that face the corners after and before the one that faces the longest edge.
#[inline(always)]
fn ends<S: Scalar>(facet: &Facet<S>) -> [Vector3<S>; 2] {
    [1, 2].map(|step| facet.edges[(facet.apex + step) % 3])
}

/// The coordinates of the corners after and before `apex`, less its own, times the power of two that
/// brings the largest of them into [1, 2).
#[inline(always)]
fn differences<S: Scalar>(corners: [[S; 2]; 3], apex: usize) -> ([[S; 2]; 2], S) {
    let between = |scale: S| {
        let [here, next, last] =
            [0, 1, 2].map(|step| corners[(apex + step) % 3].map(|x| scale * x));
        [next, last].map(|corner| [corner[0] - here[0], corner[1] - here[1]])
    };
    let size =
        |[[a, b], [c, d]]: [[S; 2]; 2]| larger(larger(a.abs(), b.abs()), larger(c.abs(), d.abs()));
    let (mut differences, mut scale) = (between(S::ONE), S::ONE);
    if !size(differences).is_finite() {
        scale = S::from_f64(0.25);
        differences = between(scale);
    }
    let factor = power_of_two_to_1(size(differences));
    (differences.map(|corner| corner.map(|x| factor * x)), scale * factor)
}
