//! Metals and dielectrics with microfacets.
//!
//! # Forward
//! With unit vectors n (normal), v (to the eye) and l (to the light), `m = l + v` and `h = m / |m|`:
//!
//! `f (n . l) = (n . l) (1 - metallic) base (1 - F) / pi + F K S`, `S = D G`,
//! `F = F0 + (1 - F0) (1 - v . h)^5`, `F0 = 0.04 + metallic (base - 0.04)`, `a = roughness^2`,
//! `D = a^2 / (pi d^2)`, `d = q + a^2 (1 - q)`, `q = |n x m|^2 / m . m`, the squared sine between n and h,
//! `G = (n . l) / (2 ((n . l) A + (n . v) B))`, `A^2 = a^2 + (1 - a^2) (n . v)^2`, B alike of l.
//!
//! By the sine, and not by `1 - (n . h)^2`, highlights of smooth surfaces keep their digits; `v . h` is
//! `|m| / 2`. `K = 1`.
//!
//! That is the usual BRDF, and obeys reciprocity. It loses light that is scattered between microfacets,
//! up to 0.7 of it. A smooth dielectric seen from the side gains light: it reflects up to half of what
//! it gets more than once. Where energy is to be conserved, `K = 1 + F0 (1 / E - 1)`, and the diffuse term
//! has `1 - s` instead of `1 - F`, with `s = (F0 (E - E1) + E1) K` the share of light from everywhere that
//! is reflected at the surface (`albedo` has E and E1). A white metal or dielectric then reflects all
//! light, from any side; between the two, `1 - metallic` takes some. Light and eye cannot be exchanged.
//!
//! Of light from everywhere s is reflected at the surface, and `(1 - s) (1 - metallic) base` below it, in
//! either case.
//!
//! # Backward
//! By the chain rule through the formulas above; `dG = (n . v) a^2 / (2 B den^2)` by `n . l`, with
//! `den = (n . l) A + (n . v) B`, where `B - (n . l) B' = a^2 / B` cancels nothing.
//!
//! # Where it is not smooth
//! At `n . l = 0`, where light begins to reach the surface. At `n . v` = [`GRAZING`]: below, also where the
//! eye is behind the surface, it is shaded as at that angle. Where roughness and metallic are clamped.
//!
//! # Source
//! Walter et al., *Microfacet models for refraction through rough surfaces*, EGSR 2007 (D); Heitz,
//! *Understanding the masking-shadowing function*, JCGT 3(2), 2014, eq. (99) (G); Schlick, *An
//! inexpensive BRDF model*, 1994 (F); Turquin, *Practical multiple scattering compensation for microfacet
//! models*, 2019, eq. (16) (K); glTF 2.0, appendix B (materials).

use std::f64::consts::FRAC_1_PI;

use bokashi_core::Scalar;

use super::albedo;
use super::model::{Bars, Layers, Model, Seen};
use crate::vector::{Vector3, cross, dot, plus, scaled};

/// The least roughness that is told from a smaller one: of a narrower lobe the rounding errors of f32
/// normals would be seen, since they move a half vector by 1e-7 and the lobe's width is the square, 1e-3.
pub const LEAST_ROUGHNESS: f64 = 1.0 / 32.0;

/// The least cosine between normal and view: gradients of the shadowing go as its inverse.
const GRAZING: f64 = 1e-4;

/// The reflectance of dielectrics at normal incidence: that of glass, as in glTF.
const DIELECTRIC: f64 = 0.04;

/// The least `|l + v|^2`; below it is rounding. Only an eye behind the surface sees such a light.
const LEAST_SQUARE: f64 = 1e-13;

/// Materials are base colour, roughness and metallic.
#[derive(Debug, Clone, Copy)]
pub(super) struct MetallicRoughness<const CONSERVING: bool>;

/// A number held within bounds, and 1 where it can move, else 0.
#[inline(always)]
fn held<T: Scalar>(x: T, low: T, high: T) -> (T, T) {
    let free = if x < low || x > high { T::ZERO } else { T::ONE };
    (x.maximum_or_nan(low).minimum_or_nan(high), free)
}

/// A material, in the terms of the formulas.
struct Substance<T> {
    base: [T; 3],
    roughness: T,
    roughness_moves: T,
    metallic: T,
    metallic_moves: T,
    /// `a^2`.
    a2: T,
    f0: [T; 3],
}

impl<T: Scalar> Substance<T> {
    #[inline(always)]
    fn new([r, g, b, roughness, metallic]: [T; 5]) -> Self {
        let least = T::from_f64(LEAST_ROUGHNESS);
        let (roughness, roughness_moves) = held(roughness, least, T::ONE);
        let (metallic, metallic_moves) = held(metallic, T::ZERO, T::ONE);
        let a = roughness * roughness;
        let dielectric = T::from_f64(DIELECTRIC);
        let base = [r, g, b];
        let f0 = base.map(|base| dielectric + metallic * (base - dielectric));
        Self { base, roughness, roughness_moves, metallic, metallic_moves, a2: a * a, f0 }
    }

    /// The gradient of the material's numbers from those of the terms.
    #[inline(always)]
    fn pull_back(&self, body_bar: [T; 3], f0_bar: [T; 3], a2_bar: T, roughness_bar: T) -> [T; 5] {
        let dielectric = T::from_f64(DIELECTRIC);
        let left = T::ONE - self.metallic;
        let mut base_bar = [T::ZERO; 3];
        let mut metallic_bar = T::ZERO;
        for c in 0..3 {
            base_bar[c] = self.metallic * f0_bar[c] + left * body_bar[c];
            metallic_bar += f0_bar[c] * (self.base[c] - dielectric) - body_bar[c] * self.base[c];
        }
        let cube = self.roughness * self.roughness * self.roughness;
        let roughness_bar = roughness_bar + T::from_f64(4.0) * cube * a2_bar;
        let [r, g, b] = base_bar;
        let roughness_bar = self.roughness_moves * roughness_bar;
        [r, g, b, roughness_bar, self.metallic_moves * metallic_bar]
    }

    /// The share of light that is reflected below the surface, where none is reflected at it.
    #[inline(always)]
    fn body(&self) -> [T; 3] {
        let left = T::ONE - self.metallic;
        self.base.map(|base| left * base)
    }
}

/// What one light's reflection is made of.
struct Terms<T> {
    nl: T,
    nl_moves: T,
    nv: T,
    nv_moves: T,
    m: [T; 3],
    s: T,
    s_moves: T,
    /// `n x m`.
    c: [T; 3],
    q: T,
    d: T,
    distribution: T,
    a: T,
    b: T,
    /// `1 / (2 den)`.
    v: T,
    g: T,
    /// `1 - v . h` and its fifth power.
    x: T,
    p: T,
    fresnel: [T; 3],
}

impl<T: Scalar> Terms<T> {
    #[inline(always)]
    fn new(n: [T; 3], v: [T; 3], l: [T; 3], of: &Substance<T>) -> Self {
        let (one, half) = (T::ONE, T::from_f64(0.5));
        let cosine = dot(n, l);
        let nl_moves = if cosine > T::ZERO { T::ONE } else { T::ZERO };
        let nl = nl_moves * cosine;
        let (nv, nv_moves) = facing(n, v);
        let m = plus(l, one, v);
        let square = dot(m, m);
        let (s, s_moves) = if square > T::from_f64(LEAST_SQUARE) {
            (square, T::ONE)
        } else {
            (T::from_f64(LEAST_SQUARE), T::ZERO)
        };
        let c = cross(n, m);
        let q = dot(c, c) / s;
        let a2 = of.a2;
        let rest = one - a2;
        let d = q + a2 * (one - q);
        let distribution = a2 * T::from_f64(FRAC_1_PI) / (d * d);
        let a = (a2 + rest * nv * nv).sqrt();
        let b = (a2 + rest * nl * nl).sqrt();
        let v = half / (nl * a + nv * b);
        let x = one - half * s.sqrt();
        let p = x * x * (x * x) * x;
        let fresnel = of.f0.map(|f0| f0 + (one - f0) * p);
        let g = nl * v;
        Self {
            nl,
            nl_moves,
            nv,
            nv_moves,
            m,
            s,
            s_moves,
            c,
            q,
            d,
            distribution,
            a,
            b,
            v,
            g,
            x,
            p,
            fresnel,
        }
    }
}

/// The cosine between normal and view, held from below, and 1 where it can move.
#[inline(always)]
fn facing<T: Scalar>(n: [T; 3], v: [T; 3]) -> (T, T) {
    let cosine = dot(n, v);
    let grazing = T::from_f64(GRAZING);
    if cosine > grazing { (cosine, T::ONE) } else { (grazing, T::ZERO) }
}

/// What a lobe reflects of light from everywhere, per colour, and how it came about.
struct Shares<T> {
    /// s.
    above: [T; 3],
    /// K.
    factor: [T; 3],
    single: T,
    edge: T,
    excess: T,
    single_slopes: [T; 2],
    edge_slopes: [T; 2],
}

impl<T: Scalar> Shares<T> {
    #[inline(always)]
    fn new(f0: [T; 3], nv: T, roughness: T, compensated: bool) -> Self {
        let (single, single_slopes) = albedo::single(nv, roughness);
        let (edge, edge_slopes) = albedo::edge(nv, roughness);
        let excess = if compensated { T::ONE / single - T::ONE } else { T::ZERO };
        let factor = f0.map(|f0| T::ONE + f0 * excess);
        let above = std::array::from_fn(|c| (f0[c] * (single - edge) + edge) * factor[c]);
        Self { above, factor, single, edge, excess, single_slopes, edge_slopes }
    }

    /// The gradients of F0, of `n . v` and of the roughness, from those of s and of K.
    #[inline(always)]
    fn pull_back(
        &self,
        f0: [T; 3],
        compensated: bool,
        above_bar: [T; 3],
        factor_bar: [T; 3],
    ) -> ([T; 3], [T; 2]) {
        let mut f0_bar = [T::ZERO; 3];
        let (mut single_bar, mut edge_bar, mut excess_bar) = (T::ZERO, T::ZERO, T::ZERO);
        for c in 0..3 {
            let once = f0[c] * (self.single - self.edge) + self.edge;
            let once_bar = above_bar[c] * self.factor[c];
            let factor_bar = factor_bar[c] + above_bar[c] * once;
            f0_bar[c] = once_bar * (self.single - self.edge) + factor_bar * self.excess;
            single_bar += once_bar * f0[c];
            edge_bar += once_bar * (T::ONE - f0[c]);
            excess_bar += factor_bar * f0[c];
        }
        if compensated {
            single_bar += -(excess_bar / (self.single * self.single));
        }
        let along = |k: usize| single_bar * self.single_slopes[k] + edge_bar * self.edge_slopes[k];
        (f0_bar, [along(0), along(1)])
    }
}

impl<const CONSERVING: bool> Model<5> for MetallicRoughness<CONSERVING> {
    const PARTS: &'static [(&'static str, usize)] =
        &[("base colours", 3), ("roughness", 1), ("metallic", 1)];

    #[inline(always)]
    fn reflect<T: Scalar>(self, Seen { n, v, material }: Seen<T, 5>, l: Vector3<T>) -> [T; 3] {
        let of = Substance::new(material);
        let t = Terms::new(n, v, l, &of);
        let specular = t.distribution * t.g;
        let diffuse = t.nl * T::from_f64(FRAC_1_PI);
        let body = of.body();
        if CONSERVING {
            let shares = Shares::new(of.f0, t.nv, of.roughness, true);
            return std::array::from_fn(|c| {
                let below = body[c] * (T::ONE - shares.above[c]);
                diffuse * below + specular * t.fresnel[c] * shares.factor[c]
            });
        }
        std::array::from_fn(|c| {
            diffuse * (body[c] * (T::ONE - t.fresnel[c])) + specular * t.fresnel[c]
        })
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(
        self,
        Seen { n, v, material }: Seen<T, 5>,
        l: Vector3<T>,
        bar: [T; 3],
    ) -> ([T; 3], Bars<T, 5>) {
        let (one, two, half) = (T::ONE, T::from_f64(2.0), T::from_f64(0.5));
        let inverse_pi = T::from_f64(FRAC_1_PI);
        let of = Substance::new(material);
        let t = Terms::new(n, v, l, &of);
        let specular = t.distribution * t.g;
        let diffuse = t.nl * inverse_pi;
        let body = of.body();

        // What the diffuse term loses, K, and their gradients.
        let shares = CONSERVING.then(|| Shares::new(of.f0, t.nv, of.roughness, true));
        let lost = shares.as_ref().map_or(t.fresnel, |shares| shares.above);
        let factor = shares.as_ref().map_or([one; 3], |shares| shares.factor);
        let (mut lost_bar, mut factor_bar) = ([T::ZERO; 3], [T::ZERO; 3]);
        let (mut value, mut f_bar, mut body_bar) = ([T::ZERO; 3], [T::ZERO; 3], [T::ZERO; 3]);
        let (mut specular_bar, mut diffuse_bar) = (T::ZERO, T::ZERO);
        for c in 0..3 {
            let f = t.fresnel[c];
            let below = body[c] * (one - lost[c]);
            value[c] = diffuse * below + specular * f * factor[c];
            diffuse_bar += bar[c] * below;
            specular_bar += bar[c] * f * factor[c];
            body_bar[c] = bar[c] * diffuse * (one - lost[c]);
            lost_bar[c] = -(bar[c] * diffuse * body[c]);
            f_bar[c] = bar[c] * specular * factor[c];
            factor_bar[c] = bar[c] * specular * f;
        }
        let (mut f0_bar, [by_nv, roughness_bar]) = match &shares {
            Some(shares) => shares.pull_back(of.f0, true, lost_bar, factor_bar),
            None => {
                f_bar = plus(f_bar, one, lost_bar);
                ([T::ZERO; 3], [T::ZERO; 2])
            }
        };
        let mut p_bar = T::ZERO;
        for c in 0..3 {
            f0_bar[c] += f_bar[c] * (one - t.p);
            p_bar += f_bar[c] * (one - of.f0[c]);
        }

        let square = t.x * t.x;
        let x_bar = T::from_f64(5.0) * square * square * p_bar;
        let rest = one - of.a2;
        let (distribution_bar, g_bar) = (specular_bar * t.g, specular_bar * t.distribution);
        let d_bar = -(two * distribution_bar * t.distribution / t.d);
        let q_bar = d_bar * rest;
        let mut a2_bar = distribution_bar * inverse_pi / (t.d * t.d) + d_bar * (one - t.q);

        // v = 1 / (2 den), so 1 / (2 den^2) = 2 v^2.
        let g_by_den = g_bar * two * t.v * t.v;
        let (inverse_a, inverse_b) = (one / t.a, one / t.b);
        let nl_bar = diffuse_bar * inverse_pi + g_by_den * t.nv * of.a2 * inverse_b;
        let nv_bar = by_nv - g_by_den * t.nl * (t.b + t.nl * rest * t.nv * inverse_a);
        a2_bar -= g_by_den
            * t.nl
            * half
            * (t.nl * (one - t.nv * t.nv) * inverse_a + t.nv * (one - t.nl * t.nl) * inverse_b);

        // x = 1 - sqrt(s) / 2, q = c . c / s.
        let q_share = q_bar / t.s;
        let s_bar = t.s_moves * -(t.q * q_share + T::from_f64(0.25) * x_bar / t.s.sqrt());
        let c_bar = t.c.map(|c| two * q_share * c);
        let m_bar = plus(cross(c_bar, n), two * s_bar, t.m);
        let (nl_bar, nv_bar) = (t.nl_moves * nl_bar, t.nv_moves * nv_bar);
        let normal_bar = plus(plus(cross(t.m, c_bar), nl_bar, l), nv_bar, v);
        let bars = Bars {
            normal: normal_bar,
            view: plus(m_bar, nv_bar, n),
            light: plus(m_bar, nl_bar, n),
            material: of.pull_back(body_bar, f0_bar, a2_bar, roughness_bar),
        };
        (value, bars)
    }

    #[inline(always)]
    fn everywhere<T: Scalar>(self, Seen { n, v, material }: Seen<T, 5>) -> Layers<T> {
        let of = Substance::new(material);
        let shares = Shares::new(of.f0, facing(n, v).0, of.roughness, CONSERVING);
        Self::layers(&of, &shares)
    }

    #[inline(always)]
    fn pull_back_everywhere<T: Scalar>(
        self,
        Seen { n, v, material }: Seen<T, 5>,
        bars: Layers<T>,
    ) -> (Layers<T>, Bars<T, 5>) {
        let of = Substance::new(material);
        let (nv, nv_moves) = facing(n, v);
        let shares = Shares::new(of.f0, nv, of.roughness, CONSERVING);
        let (body, above) = (of.body(), shares.above);
        let body_bar = std::array::from_fn(|c| bars.below[c] * (T::ONE - above[c]));
        let above_bar = std::array::from_fn(|c| bars.above[c] - bars.below[c] * body[c]);
        let (f0_bar, [nv_bar, roughness_bar]) =
            shares.pull_back(of.f0, CONSERVING, above_bar, [T::ZERO; 3]);
        let nv_bar = nv_moves * nv_bar;
        let bars = Bars {
            normal: scaled(nv_bar, v),
            view: scaled(nv_bar, n),
            light: [T::ZERO; 3],
            material: of.pull_back(body_bar, f0_bar, T::ZERO, roughness_bar),
        };
        (Self::layers(&of, &shares), bars)
    }
}

impl<const CONSERVING: bool> MetallicRoughness<CONSERVING> {
    /// What is left for the surface's body to reflect, and s.
    #[inline(always)]
    fn layers<T: Scalar>(of: &Substance<T>, shares: &Shares<T>) -> Layers<T> {
        let (body, above) = (of.body(), shares.above);
        Layers { below: std::array::from_fn(|c| (T::ONE - above[c]) * body[c]), above }
    }
}
