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
//! By the sine, and not by `1 - (n . h)^2`, highlights of smooth surfaces keep their digits. K is 1, or
//! with multiple scattering `1 + F0 (1 / E - 1)`, where E is the albedo of the lobe (`albedo`). `v . h` is
//! `|m| / 2`.
//!
//! Of light from everywhere the share `s = (F0 (E - E1) + E1) K` is reflected at the surface, and
//! `(1 - s) (1 - metallic) base` below it. That is an approximation of the integral over all directions.
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

use bokashi_core::Scalar;

use super::albedo;
use super::model::{Model, Reflected};
use crate::direction::{cross, dot, plus};

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
pub(super) struct MetallicRoughness<const COMPENSATED: bool>;

/// A number held within bounds, and 1 where it can move, else 0.
#[inline(always)]
pub(super) fn held<T: Scalar>(x: T, low: T, high: T) -> (T, T) {
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
        let distribution = a2 * T::from_f64(std::f64::consts::FRAC_1_PI) / (d * d);
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

impl<const COMPENSATED: bool> MetallicRoughness<COMPENSATED> {
    /// `1 / E - 1`, and how it changes with `n . v` and the roughness.
    #[inline(always)]
    fn excess<T: Scalar>(nv: T, roughness: T) -> (T, [T; 2]) {
        if !COMPENSATED {
            return (T::ZERO, [T::ZERO; 2]);
        }
        let (single, slopes) = albedo::single(nv, roughness);
        let inverse = T::ONE / single;
        let factor = -(inverse * inverse);
        (inverse - T::ONE, slopes.map(|slope| factor * slope))
    }
}

impl<const COMPENSATED: bool> Model<5> for MetallicRoughness<COMPENSATED> {
    const PARTS: &'static [(&'static str, usize)] =
        &[("base colours", 3), ("roughness", 1), ("metallic", 1)];

    #[inline(always)]
    fn reflect<T: Scalar>(self, n: [T; 3], v: [T; 3], l: [T; 3], material: [T; 5]) -> [T; 3] {
        let of = Substance::new(material);
        let terms = Terms::new(n, v, l, &of);
        let (excess, _) = Self::excess(terms.nv, of.roughness);
        let specular = terms.distribution * terms.g;
        let diffuse = terms.nl * T::from_f64(std::f64::consts::FRAC_1_PI);
        let body = of.body();
        std::array::from_fn(|c| {
            let f = terms.fresnel[c];
            diffuse * body[c] * (T::ONE - f) + specular * f * (T::ONE + of.f0[c] * excess)
        })
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(
        self,
        n: [T; 3],
        v: [T; 3],
        l: [T; 3],
        material: [T; 5],
        bar: [T; 3],
    ) -> Reflected<T, 5> {
        let (one, two, half) = (T::ONE, T::from_f64(2.0), T::from_f64(0.5));
        let inverse_pi = T::from_f64(std::f64::consts::FRAC_1_PI);
        let of = Substance::new(material);
        let t = Terms::new(n, v, l, &of);
        let (excess, excess_slopes) = Self::excess(t.nv, of.roughness);
        let specular = t.distribution * t.g;
        let diffuse = t.nl * inverse_pi;
        let body = of.body();

        let (mut value, mut f0_bar, mut body_bar) = ([T::ZERO; 3], [T::ZERO; 3], [T::ZERO; 3]);
        let (mut specular_bar, mut diffuse_bar) = (T::ZERO, T::ZERO);
        let (mut p_bar, mut excess_bar) = (T::ZERO, T::ZERO);
        for c in 0..3 {
            let (f, f0) = (t.fresnel[c], of.f0[c]);
            let factor = one + f0 * excess;
            let below = body[c] * (one - f);
            value[c] = diffuse * below + specular * f * factor;
            diffuse_bar += bar[c] * below;
            specular_bar += bar[c] * f * factor;
            body_bar[c] = bar[c] * diffuse * (one - f);
            let factor_bar = bar[c] * specular * f;
            let f_bar = bar[c] * (specular * factor - diffuse * body[c]);
            f0_bar[c] = factor_bar * excess + f_bar * (one - t.p);
            excess_bar += factor_bar * f0;
            p_bar += f_bar * (one - f0);
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
        let nv_bar = excess_bar * excess_slopes[0]
            - g_by_den * t.nl * (t.b + t.nl * rest * t.nv * inverse_a);
        a2_bar -= g_by_den
            * t.nl
            * half
            * (t.nl * (one - t.nv * t.nv) * inverse_a + t.nv * (one - t.nl * t.nl) * inverse_b);

        // x = 1 - sqrt(s) / 2, q = c . c / s.
        let inverse_s = one / t.s;
        let q_share = q_bar * inverse_s;
        let s_bar = t.s_moves * -(t.q * q_share + T::from_f64(0.25) * x_bar / t.s.sqrt());
        let c_bar = t.c.map(|c| two * q_share * c);
        let m_bar = plus(cross(c_bar, n), two * s_bar, t.m);
        let (nl_bar, nv_bar) = (t.nl_moves * nl_bar, t.nv_moves * nv_bar);
        let normal_bar = plus(plus(cross(t.m, c_bar), nl_bar, l), nv_bar, v);
        let roughness_bar = excess_bar * excess_slopes[1];
        Reflected {
            value,
            normal_bar,
            view_bar: plus(m_bar, nv_bar, n),
            light_bar: plus(m_bar, nl_bar, n),
            material_bar: of.pull_back(body_bar, f0_bar, a2_bar, roughness_bar),
        }
    }

    #[inline(always)]
    fn ambient<T: Scalar>(self, n: [T; 3], v: [T; 3], material: [T; 5]) -> [T; 3] {
        let [below, above] = self.shares(n, v, material);
        std::array::from_fn(|c| below[c] + above[c])
    }

    #[inline(always)]
    fn pull_back_ambient<T: Scalar>(
        self,
        n: [T; 3],
        v: [T; 3],
        material: [T; 5],
        bar: [T; 3],
    ) -> Reflected<T, 5> {
        let (value, normal_bar, view_bar, material_bar) =
            self.pull_back_shares(n, v, material, [bar, bar]);
        let value = std::array::from_fn(|c| value[0][c] + value[1][c]);
        Reflected { value, normal_bar, view_bar, light_bar: [T::ZERO; 3], material_bar }
    }
}

/// The two shares, and the gradients of normal, view and material.
type Shares<T> = ([[T; 3]; 2], [T; 3], [T; 3], [T; 5]);

impl<const COMPENSATED: bool> MetallicRoughness<COMPENSATED> {
    /// The shares of light from everywhere that are reflected below the surface and at it.
    #[inline(always)]
    fn shares<T: Scalar>(self, n: [T; 3], v: [T; 3], material: [T; 5]) -> [[T; 3]; 2] {
        let of = Substance::new(material);
        let (nv, _) = facing(n, v);
        let (single, _) = albedo::single(nv, of.roughness);
        let (edge, _) = albedo::edge(nv, of.roughness);
        let (excess, _) = Self::excess(nv, of.roughness);
        let body = of.body();
        let above: [T; 3] = std::array::from_fn(|c| {
            (of.f0[c] * (single - edge) + edge) * (T::ONE + of.f0[c] * excess)
        });
        [std::array::from_fn(|c| (T::ONE - above[c]) * body[c]), above]
    }

    /// The same, with the gradients that those of the shares lead to.
    #[inline(always)]
    fn pull_back_shares<T: Scalar>(
        self,
        n: [T; 3],
        v: [T; 3],
        material: [T; 5],
        bars: [[T; 3]; 2],
    ) -> Shares<T> {
        let one = T::ONE;
        let of = Substance::new(material);
        let (nv, nv_moves) = facing(n, v);
        let (single, single_slopes) = albedo::single(nv, of.roughness);
        let (edge, edge_slopes) = albedo::edge(nv, of.roughness);
        let (excess, excess_slopes) = Self::excess(nv, of.roughness);
        let body = of.body();
        let mut value = [[T::ZERO; 3]; 2];
        let (mut f0_bar, mut body_bar) = ([T::ZERO; 3], [T::ZERO; 3]);
        let (mut single_bar, mut edge_bar, mut excess_bar) = (T::ZERO, T::ZERO, T::ZERO);
        for c in 0..3 {
            let f0 = of.f0[c];
            let (once, factor) = (f0 * (single - edge) + edge, one + f0 * excess);
            let above = once * factor;
            value[0][c] = (one - above) * body[c];
            value[1][c] = above;
            body_bar[c] = bars[0][c] * (one - above);
            let above_bar = bars[1][c] - bars[0][c] * body[c];
            let (once_bar, factor_bar) = (above_bar * factor, above_bar * once);
            f0_bar[c] = once_bar * (single - edge) + factor_bar * excess;
            single_bar += once_bar * f0;
            edge_bar += once_bar * (one - f0);
            excess_bar += factor_bar * f0;
        }
        let along = |k: usize| {
            single_bar * single_slopes[k]
                + edge_bar * edge_slopes[k]
                + excess_bar * excess_slopes[k]
        };
        let nv_bar = nv_moves * along(0);
        let material_bar = of.pull_back(body_bar, f0_bar, T::ZERO, along(1));
        (value, v.map(|v| nv_bar * v), n.map(|n| nv_bar * n), material_bar)
    }
}
