//! Metals and dielectrics with microfacets.
//!
//! # Forward
//! With unit vectors n (normal), v (to the eye) and l (to the light), `m = l + v` and `h = m / |m|`:
//!
//! `f (n . l) = (1 - metallic) dielectric + metallic metal`,
//! `dielectric = (n . l) base (1 - F(0.04)) / pi + F(0.04) K(0.04) S`, `metal = F(base) K(base) S`,
//! `F(F0) = F0 + (1 - F0) (1 - v . h)^5`, `S = D G`, `a = roughness^2`,
//! `D = a^2 / (pi d^2)`, `d = q + a^2 (1 - q)`, `q = |n x m|^2 / m . m`, the squared sine between n and h,
//! `G = (n . l) / (2 ((n . l) A + (n . v) B))`, `A^2 = a^2 + (1 - a^2) (n . v)^2`, B alike of l.
//!
//! By the sine, and not by `1 - (n . h)^2`, highlights of smooth surfaces keep their digits; `v . h` is
//! `|m| / 2`. `K = 1`.
//!
//! Light is mixed, and not F0: a surface that is half metal keeps half of what a dielectric reflects below it,
//! `1 - F(0.04)`. In the term of S a mixed F0 comes to the same, where `K = 1`; below, it takes too much.
//!
//! That is the usual BRDF, and obeys reciprocity. It loses light that is scattered between microfacets,
//! up to 0.7 of it. A smooth dielectric seen from the side gains light: it reflects up to half of what
//! it gets more than once. Where energy is to be conserved, `K(F0) = 1 + F0 (1 / E - 1)`, and the diffuse term
//! has `1 - s(0.04)` instead of `1 - F(0.04)`, with `s(F0) = (F0 (E - E1) + E1) K(F0)` the share of light from
//! everywhere that is reflected at the surface (`albedo` has E and E1). A white surface then reflects all
//! light, from any side, whatever its share of metal. Light and eye cannot be exchanged.
//!
//! Of light from everywhere `(1 - metallic) s(0.04) + metallic s(base)` is reflected at the surface, and
//! `(1 - metallic) (1 - s(0.04)) base` below it, in either case.
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
//! models*, 2019, eq. (16) (K); glTF 2.0, appendix B.2 (the mix of metal and dielectric; its simplified code
//! mixes F0, and is not the same).

use std::f64::consts::FRAC_1_PI;

use bokashi_core::Scalar;

use super::albedo;
use super::model::{Bars, Layers, Model, ShadingPoint};
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
    /// The shares of dielectric and metal.
    dielectric: T,
    metallic: T,
    metallic_moves: T,
    /// `a^2`.
    a2: T,
}

impl<T: Scalar> Substance<T> {
    #[inline(always)]
    fn new([r, g, b, roughness, metallic]: [T; 5]) -> Self {
        let least = T::from_f64(LEAST_ROUGHNESS);
        let (roughness, roughness_moves) = held(roughness, least, T::ONE);
        let (metallic, metallic_moves) = held(metallic, T::ZERO, T::ONE);
        let a = roughness * roughness;
        let (base, dielectric) = ([r, g, b], T::ONE - metallic);
        Self { base, roughness, roughness_moves, dielectric, metallic, metallic_moves, a2: a * a }
    }

    /// The gradient of the material's numbers from those of the terms.
    #[inline(always)]
    fn pull_back(&self, base_bar: [T; 3], metallic_bar: T, a2_bar: T, roughness_bar: T) -> [T; 5] {
        let cube = self.roughness * self.roughness * self.roughness;
        let roughness_bar = roughness_bar + T::from_f64(4.0) * cube * a2_bar;
        let [r, g, b] = base_bar;
        let roughness_bar = self.roughness_moves * roughness_bar;
        [r, g, b, roughness_bar, self.metallic_moves * metallic_bar]
    }
}

/// F of a reflectance along the normal, where `(1 - v . h)^5` is `p`.
#[inline(always)]
fn fresnel<T: Scalar>(f0: T, p: T) -> T {
    f0 + (T::ONE - f0) * p
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
}

impl<T: Scalar> Terms<T> {
    #[inline(always)]
    fn new(n: [T; 3], v: [T; 3], l: [T; 3], substance: &Substance<T>) -> Self {
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
        let a2 = substance.a2;
        let rest = one - a2;
        let d = q + a2 * (one - q);
        let distribution = a2 * T::from_f64(FRAC_1_PI) / (d * d);
        let a = (a2 + rest * nv * nv).sqrt();
        let b = (a2 + rest * nl * nl).sqrt();
        let v = half / (nl * a + nv * b);
        let x = one - half * s.sqrt();
        let p = x * x * (x * x) * x;
        let g = nl * v;
        Self { nl, nl_moves, nv, nv_moves, m, s, s_moves, c, q, d, distribution, a, b, v, g, x, p }
    }
}

/// The cosine between normal and view, held from below, and 1 where it can move.
#[inline(always)]
fn facing<T: Scalar>(n: [T; 3], v: [T; 3]) -> (T, T) {
    let cosine = dot(n, v);
    let grazing = T::from_f64(GRAZING);
    if cosine > grazing { (cosine, T::ONE) } else { (grazing, T::ZERO) }
}

/// What lobes reflect of light from everywhere: E, E1, and what is reflected more than once.
struct Shares<T> {
    single: T,
    edge: T,
    /// `1 / E - 1`, or 0.
    excess: T,
    single_slopes: [T; 2],
    edge_slopes: [T; 2],
}

/// The gradients of E, E1 and the excess.
type SharesBars<T> = [T; 3];

impl<T: Scalar> Shares<T> {
    #[inline(always)]
    fn new(nv: T, roughness: T, compensated: bool) -> Self {
        let (single, single_slopes) = albedo::single(nv, roughness);
        let (edge, edge_slopes) = albedo::edge(nv, roughness);
        // 1 / E - 1, without what cancels.
        let excess = if compensated { albedo::lost(nv, roughness) / single } else { T::ZERO };
        Self { single, edge, excess, single_slopes, edge_slopes }
    }

    /// K.
    #[inline(always)]
    fn factor(&self, f0: T) -> T {
        T::ONE + f0 * self.excess
    }

    /// What is reflected once.
    #[inline(always)]
    fn once(&self, f0: T) -> T {
        f0 * (self.single - self.edge) + self.edge
    }

    /// s.
    #[inline(always)]
    fn above(&self, f0: T) -> T {
        self.once(f0) * self.factor(f0)
    }

    /// The gradient of F0 from those of s and K; adds to the gradients of what they are made of.
    #[inline(always)]
    fn pull_back(&self, f0: T, above_bar: T, factor_bar: T, bars: &mut SharesBars<T>) -> T {
        let once_bar = above_bar * self.factor(f0);
        let factor_bar = factor_bar + above_bar * self.once(f0);
        bars[0] += once_bar * f0;
        bars[1] += once_bar * (T::ONE - f0);
        bars[2] += factor_bar * f0;
        once_bar * (self.single - self.edge) + factor_bar * self.excess
    }

    /// The gradients of `n . v` and of the roughness.
    #[inline(always)]
    fn pull_back_shares(
        &self,
        compensated: bool,
        [single_bar, edge_bar, excess_bar]: SharesBars<T>,
    ) -> [T; 2] {
        let of_excess =
            if compensated { excess_bar / (self.single * self.single) } else { T::ZERO };
        let single_bar = single_bar - of_excess;
        [0, 1].map(|k| single_bar * self.single_slopes[k] + edge_bar * self.edge_slopes[k])
    }
}

impl<const CONSERVING: bool> Model<5> for MetallicRoughness<CONSERVING> {
    const PARTS: &'static [(&'static str, usize)] =
        &[("base colours", 3), ("roughness", 1), ("metallic", 1)];

    #[inline(always)]
    fn reflect<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 5>,
        l: Vector3<T>,
    ) -> [T; 3] {
        let substance = Substance::new(material);
        let t = Terms::new(n, v, l, &substance);
        let glass = T::from_f64(DIELECTRIC);
        let specular = t.distribution * t.g;
        let diffuse = substance.dielectric * t.nl * T::from_f64(FRAC_1_PI);
        let f = fresnel(glass, t.p);
        if CONSERVING {
            let shares = Shares::new(t.nv, substance.roughness, true);
            let below = diffuse * (T::ONE - shares.above(glass));
            let above = specular * substance.dielectric * f * shares.factor(glass);
            let metal = specular * substance.metallic;
            return substance.base.map(|base| {
                base * below + above + metal * fresnel(base, t.p) * shares.factor(base)
            });
        }
        let below = diffuse * (T::ONE - f);
        let above = specular * substance.dielectric * f;
        let metal = specular * substance.metallic;
        substance.base.map(|base| base * below + above + metal * fresnel(base, t.p))
    }

    /// In one piece: the formulas of the header backwards, each of which needs names of those above it.
    #[inline(always)]
    fn pull_back<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 5>,
        l: Vector3<T>,
        bar: [T; 3],
    ) -> ([T; 3], Bars<T, 5>) {
        let (one, two, half) = (T::ONE, T::from_f64(2.0), T::from_f64(0.5));
        let inverse_pi = T::from_f64(FRAC_1_PI);
        let glass = T::from_f64(DIELECTRIC);
        let substance = Substance::new(material);
        let t = Terms::new(n, v, l, &substance);
        let specular = t.distribution * t.g;
        let diffuse = t.nl * inverse_pi;
        let metal = specular * substance.metallic;

        // What the diffuse term of a dielectric loses, and K.
        let f = fresnel(glass, t.p);
        let shares = CONSERVING.then(|| Shares::new(t.nv, substance.roughness, true));
        let (lost, factor) = match &shares {
            Some(shares) => (shares.above(glass), shares.factor(glass)),
            None => (f, one),
        };
        let below = diffuse * (one - lost);
        let above = specular * f * factor;
        let (sum, of_base) = (bar[0] + bar[1] + bar[2], dot(bar, substance.base));
        let (mut value, mut base_bar) = ([T::ZERO; 3], [T::ZERO; 3]);
        // The gradients of a metal's share of `specular`, and of p; and how a metal's share is more than that of a
        // dielectric, F(base) K(base) - F(0.04) K(0.04), without what cancels.
        let (mut metal_bar, mut p_bar, mut more) = (T::ZERO, T::ZERO, T::ZERO);
        let of_factor = shares.as_ref().map_or(T::ZERO, |shares| f * shares.excess);
        let mut shares_bars = [T::ZERO; 3];
        for c in 0..3 {
            let base = substance.base[c];
            let reflected = fresnel(base, t.p);
            let factor = shares.as_ref().map_or(one, |shares| shares.factor(base));
            value[c] = substance.dielectric * (base * below + above) + metal * reflected * factor;
            metal_bar += bar[c] * reflected * factor;
            more += bar[c] * (base - glass) * ((one - t.p) * factor + of_factor);
            let f_bar = bar[c] * metal * factor;
            p_bar += f_bar * (one - base);
            base_bar[c] = bar[c] * substance.dielectric * below + f_bar * (one - t.p);
            if let Some(shares) = &shares {
                let factor_bar = bar[c] * metal * reflected;
                base_bar[c] += shares.pull_back(base, T::ZERO, factor_bar, &mut shares_bars);
            }
        }
        let metallic_bar = specular * more - below * of_base;
        let diffuse_bar = substance.dielectric * (one - lost) * of_base;
        let specular_bar = substance.dielectric * f * factor * sum + substance.metallic * metal_bar;
        let mut f_bar = substance.dielectric * specular * factor * sum;
        let lost_bar = -(substance.dielectric * diffuse * of_base);
        let [by_nv, roughness_bar] = match &shares {
            Some(shares) => {
                let factor_bar = substance.dielectric * specular * f * sum;
                shares.pull_back(glass, lost_bar, factor_bar, &mut shares_bars);
                shares.pull_back_shares(true, shares_bars)
            }
            None => {
                f_bar += lost_bar;
                [T::ZERO; 2]
            }
        };
        p_bar += f_bar * (one - glass);

        // p = x^5, and D = a^2 / (pi d^2) with d = (1 - a^2) q + a^2.
        let square = t.x * t.x;
        let x_bar = T::from_f64(5.0) * square * square * p_bar;
        let rest = one - substance.a2;
        let (distribution_bar, g_bar) = (specular_bar * t.g, specular_bar * t.distribution);
        let d_bar = -(two * distribution_bar * t.distribution / t.d);
        let q_bar = d_bar * rest;
        let mut a2_bar = distribution_bar * inverse_pi / (t.d * t.d) + d_bar * (one - t.q);

        // v = 1 / (2 den), so 1 / (2 den^2) = 2 v^2.
        let g_by_den = g_bar * two * t.v * t.v;
        let (inverse_a, inverse_b) = (one / t.a, one / t.b);
        let nl_bar = diffuse_bar * inverse_pi + g_by_den * t.nv * substance.a2 * inverse_b;
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
            material: substance.pull_back(base_bar, metallic_bar, a2_bar, roughness_bar),
        };
        (value, bars)
    }

    #[inline(always)]
    fn everywhere<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 5>,
    ) -> Layers<T> {
        let substance = Substance::new(material);
        Self::layers(&substance, &Shares::new(facing(n, v).0, substance.roughness, CONSERVING))
    }

    #[inline(always)]
    fn pull_back_everywhere<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 5>,
        bars: Layers<T>,
    ) -> (Layers<T>, Bars<T, 5>) {
        let substance = Substance::new(material);
        let (nv, nv_moves) = facing(n, v);
        let shares = Shares::new(nv, substance.roughness, CONSERVING);
        let glass = T::from_f64(DIELECTRIC);
        let lost = shares.above(glass);
        let (of_base, sum) =
            (dot(bars.below, substance.base), bars.above[0] + bars.above[1] + bars.above[2]);
        // With s for what is reflected at the surface, metallic moves `above` by s(base) - s(0.04) and `below` by
        // (s(0.04) - 1) base. Both are near 1 for white surfaces, so their sum is worked out for gradients that are
        // alike, and what these differ by counts alone: with s(1) = 1, or s(1) = E,
        // s(base) - s(0.04) + (s(0.04) - 1) base = -(1 - base) ((E - E1) x base + 0.04 ((E - E1) K(0.04) + E1 x)),
        // x = 1 / E - 1, or -base (1 - E) - 0.04 (E - E1) (1 - base).
        let one = T::ONE;
        let spread = shares.single - shares.edge;
        let of_factor = shares.once(glass) * shares.excess;
        let rest = spread * shares.factor(glass) + shares.edge * shares.excess;
        let loss = if CONSERVING { T::ZERO } else { albedo::lost(nv, substance.roughness) };
        let mut metallic_bar = T::ZERO;
        let mut shares_bars = [T::ZERO; 3];
        let mut base_bar = [T::ZERO; 3];
        for c in 0..3 {
            let (base, bar) = (substance.base[c], bars.above[c]);
            let more = (base - glass) * (spread * shares.factor(base) + of_factor);
            let both = if CONSERVING {
                -((one - base) * (spread * shares.excess * base + glass * rest))
            } else {
                -(base * loss + glass * spread * (one - base))
            };
            metallic_bar += (bar - bars.below[c]) * more + bars.below[c] * both;
            base_bar[c] = bars.below[c] * substance.dielectric * (T::ONE - lost)
                + shares.pull_back(base, substance.metallic * bar, T::ZERO, &mut shares_bars);
        }
        shares.pull_back(glass, substance.dielectric * (sum - of_base), T::ZERO, &mut shares_bars);
        let [nv_bar, roughness_bar] = shares.pull_back_shares(CONSERVING, shares_bars);
        let nv_bar = nv_moves * nv_bar;
        let bars = Bars {
            normal: scaled(nv_bar, v),
            view: scaled(nv_bar, n),
            light: [T::ZERO; 3],
            material: substance.pull_back(base_bar, metallic_bar, T::ZERO, roughness_bar),
        };
        (Self::layers(&substance, &shares), bars)
    }
}

impl<const CONSERVING: bool> MetallicRoughness<CONSERVING> {
    /// What is reflected below the surface, and at it.
    #[inline(always)]
    fn layers<T: Scalar>(substance: &Substance<T>, shares: &Shares<T>) -> Layers<T> {
        let lost = shares.above(T::from_f64(DIELECTRIC));
        let below = substance.dielectric * (T::ONE - lost);
        Layers {
            below: scaled(below, substance.base),
            above: substance
                .base
                .map(|base| substance.dielectric * lost + substance.metallic * shares.above(base)),
        }
    }
}
