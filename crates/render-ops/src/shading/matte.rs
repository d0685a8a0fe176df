//! Matte surfaces, without highlights and with those of Phong and of Blinn.
//!
//! # Forward
//! With unit vectors n (normal), v (to the eye), l (to the light), and `h = (l + v) / |l + v|`:
//!
//! - Lambert: `f (n . l) = (n . l) color / pi`.
//! - Phong: `f (n . l) = (n . l) (color / pi + specular (e + 2) / (2 pi) max(r . v, 0)^e)`, where r is l,
//!   mirrored by n: `r . v = 2 (n . l) (n . v) - l . v`.
//! - Blinn-Phong: the same with `(e + 8) / (8 pi) max(n . h, 0)^e`.
//!
//! The factors of e hold the light that highlights reflect: seen along the normal, Phong's reflects the
//! share `specular` exactly, Blinn's about it. All three obey reciprocity. Light from everywhere is
//! reflected as by the matte surface alone.
//!
//! # Backward
//! By the chain rule; `d(x^e) = x^e (e / x dx + ln x de)`.
//!
//! # Where it is not smooth
//! At `n . l = 0`; at `r . v = 0` or `n . h = 0`, where the exponent is 1 or less.
//!
//! # Source
//! Phong, *Illumination for computer generated pictures*, CACM 18(6), 1975; Blinn, *Models of light
//! reflection for computer synthesized pictures*, SIGGRAPH 1977; Lafortune and Willems, *Using the
//! modified Phong reflectance model for physically based rendering*, 1994 (`(e + 2) / (2 pi)`);
//! Akenine-Moller, Haines and Hoffman, *Real-Time Rendering*, 3rd edition, 2008, section 7.6
//! (`(e + 8) / (8 pi)`).

use std::f64::consts::FRAC_1_PI;

use bokashi_core::Scalar;

use super::model::{Bars, Layers, Model, ShadingPoint};
use crate::vector::{Vector3, dot, plus, scaled};

/// Materials are a colour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lambert;

/// Materials are a colour, a specular colour and an exponent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Phong;

/// Materials are those of [`Phong`].
#[derive(Debug, Clone, Copy)]
pub(super) struct BlinnPhong;

/// The least `|l + v|`: below it is rounding, and only an eye behind the surface sees such a light.
const LEAST_LENGTH: f64 = 1e-6;

/// `max(n . l, 0)`, and 1 where it can move.
#[inline(always)]
fn incident<T: Scalar>(n: [T; 3], l: [T; 3]) -> (T, T) {
    let cosine = dot(n, l);
    if cosine > T::ZERO { (cosine, T::ONE) } else { (T::ZERO, T::ZERO) }
}

/// A colour below a surface that mirrors nothing, seen in light from everywhere; and where gradients of
/// that lead.
#[inline(always)]
fn ambient<T: Scalar, const M: usize>(color: [T; 3], bars: Layers<T>) -> (Layers<T>, Bars<T, M>) {
    let zeros = [T::ZERO; 3];
    let mut material = [T::ZERO; M];
    material[..3].copy_from_slice(&bars.below);
    let bars = Bars { normal: zeros, view: zeros, light: zeros, material };
    (Layers { below: color, above: zeros }, bars)
}

impl Model<3> for Lambert {
    const PARTS: &'static [(&'static str, usize)] = &[("colours", 3)];

    #[inline(always)]
    fn reflect<T: Scalar>(
        self,
        ShadingPoint { n, material, .. }: ShadingPoint<T, 3>,
        l: Vector3<T>,
    ) -> [T; 3] {
        scaled(incident(n, l).0 * T::from_f64(FRAC_1_PI), material)
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(
        self,
        ShadingPoint { n, material: color, .. }: ShadingPoint<T, 3>,
        l: Vector3<T>,
        bar: [T; 3],
    ) -> ([T; 3], Bars<T, 3>) {
        let (cosine, moves) = incident(n, l);
        let share = cosine * T::from_f64(FRAC_1_PI);
        let cosine_bar = moves * T::from_f64(FRAC_1_PI) * dot(color, bar);
        let bars = Bars {
            normal: scaled(cosine_bar, l),
            view: [T::ZERO; 3],
            light: scaled(cosine_bar, n),
            material: scaled(share, bar),
        };
        (scaled(share, color), bars)
    }

    #[inline(always)]
    fn everywhere<T: Scalar>(self, point: ShadingPoint<T, 3>) -> Layers<T> {
        Layers { below: point.material, above: [T::ZERO; 3] }
    }

    #[inline(always)]
    fn pull_back_everywhere<T: Scalar>(
        self,
        point: ShadingPoint<T, 3>,
        bars: Layers<T>,
    ) -> (Layers<T>, Bars<T, 3>) {
        ambient(point.material, bars)
    }
}

/// Where a highlight is seen: a cosine and its derivatives.
trait Highlight: Copy + Send + Sync + 'static {
    /// The factor of the highlight over that of the exponent: `(e + shift) times`.
    const SHIFT: f64;
    const TIMES: f64;

    /// The cosine whose power it is.
    fn cosine<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3]) -> T;

    /// Its gradients with respect to n, v and l.
    fn slopes<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3], cosine: T) -> [[T; 3]; 3];
}

impl Highlight for Phong {
    const SHIFT: f64 = 2.0;
    const TIMES: f64 = 0.5 * FRAC_1_PI;

    #[inline(always)]
    fn cosine<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3]) -> T {
        T::from_f64(2.0) * dot(n, l) * dot(n, v) - dot(l, v)
    }

    #[inline(always)]
    fn slopes<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3], _: T) -> [[T; 3]; 3] {
        let two = T::from_f64(2.0);
        let (nl, nv) = (two * dot(n, l), two * dot(n, v));
        [
            plus(scaled(nv, l), nl, v),
            plus(scaled(nl, n), -T::ONE, l),
            plus(scaled(nv, n), -T::ONE, v),
        ]
    }
}

impl BlinnPhong {
    /// `l + v`, its length, and 1 where that can move.
    #[inline(always)]
    fn middle<T: Scalar>(v: [T; 3], l: [T; 3]) -> ([T; 3], T, T) {
        let middle = plus(l, T::ONE, v);
        let square = dot(middle, middle);
        let least = T::from_f64(LEAST_LENGTH);
        if square > least * least {
            (middle, square.sqrt(), T::ONE)
        } else {
            (middle, least, T::ZERO)
        }
    }
}

impl Highlight for BlinnPhong {
    const SHIFT: f64 = 8.0;
    const TIMES: f64 = 0.125 * FRAC_1_PI;

    #[inline(always)]
    fn cosine<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3]) -> T {
        let (middle, length, _) = Self::middle(v, l);
        dot(n, middle) / length
    }

    #[inline(always)]
    fn slopes<T: Scalar>(n: [T; 3], v: [T; 3], l: [T; 3], cosine: T) -> [[T; 3]; 3] {
        let (middle, length, moves) = Self::middle(v, l);
        let h = middle.map(|entry| entry / length);
        // A change of l or v moves h by its part across h, over |l + v|.
        let of_middle = plus(n, -moves * cosine, h).map(|entry| entry / length);
        [h, of_middle, of_middle]
    }
}

/// `x^e` and `ln x`, both 0 where x is 0 or less, except for `x^0 = 1`.
#[inline(always)]
fn power<T: Scalar>(x: T, e: T) -> (T, T) {
    if x > T::ZERO {
        let logarithm = x.ln();
        ((e * logarithm).exp(), logarithm)
    } else {
        (if e == T::ZERO { T::ONE } else { T::ZERO }, T::ZERO)
    }
}

#[inline(always)]
fn split<T: Copy>([r, g, b, sr, sg, sb, e]: [T; 7]) -> ([T; 3], [T; 3], T) {
    ([r, g, b], [sr, sg, sb], e)
}

/// An exponent of 0 or more, and 1 where it can move.
#[inline(always)]
fn exponent<T: Scalar>(e: T) -> (T, T) {
    if e < T::ZERO { (T::ZERO, T::ZERO) } else { (e, T::ONE) }
}

impl<H: Highlight> Model<7> for H {
    const PARTS: &'static [(&'static str, usize)] =
        &[("colours", 3), ("specular colours", 3), ("exponents", 1)];

    #[inline(always)]
    fn reflect<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 7>,
        l: Vector3<T>,
    ) -> [T; 3] {
        let (color, specular, e) = split(material);
        let (e, _) = exponent(e);
        let (nl, _) = incident(n, l);
        let (lobe, _) = power(H::cosine(n, v, l), e);
        let factor = (e + T::from_f64(H::SHIFT)) * T::from_f64(H::TIMES);
        plus(scaled(nl * T::from_f64(FRAC_1_PI), color), nl * factor * lobe, specular)
    }

    #[inline(always)]
    fn pull_back<T: Scalar>(
        self,
        ShadingPoint { n, v, material }: ShadingPoint<T, 7>,
        l: Vector3<T>,
        bar: [T; 3],
    ) -> ([T; 3], Bars<T, 7>) {
        let (color, specular, e) = split(material);
        let (e, e_moves) = exponent(e);
        let (nl, nl_moves) = incident(n, l);
        let cosine = H::cosine(n, v, l);
        let (lobe, logarithm) = power(cosine, e);
        let times = T::from_f64(H::TIMES);
        let factor = (e + T::from_f64(H::SHIFT)) * times;
        let (matte, glossy) = (nl * T::from_f64(FRAC_1_PI), nl * factor * lobe);
        let specular_bar = dot(specular, bar);
        let nl_bar =
            nl_moves * (T::from_f64(FRAC_1_PI) * dot(color, bar) + factor * lobe * specular_bar);
        let lobe_bar = nl * factor * specular_bar;
        // d x^e = e x^(e - 1) dx + x^e ln x de
        let is_lit = cosine > T::ZERO;
        let cosine_bar = if is_lit { lobe_bar * (e * lobe / cosine) } else { T::ZERO };
        let e_bar = e_moves * (nl * times * lobe * specular_bar + lobe_bar * lobe * logarithm);
        let [by_n, by_v, by_l] = H::slopes(n, v, l, cosine);
        let [r, g, b] = scaled(matte, bar);
        let [sr, sg, sb] = scaled(glossy, bar);
        let bars = Bars {
            normal: plus(scaled(nl_bar, l), cosine_bar, by_n),
            view: scaled(cosine_bar, by_v),
            light: plus(scaled(nl_bar, n), cosine_bar, by_l),
            material: [r, g, b, sr, sg, sb, e_bar],
        };
        (plus(scaled(matte, color), glossy, specular), bars)
    }

    #[inline(always)]
    fn everywhere<T: Scalar>(self, point: ShadingPoint<T, 7>) -> Layers<T> {
        Layers { below: split(point.material).0, above: [T::ZERO; 3] }
    }

    #[inline(always)]
    fn pull_back_everywhere<T: Scalar>(
        self,
        point: ShadingPoint<T, 7>,
        bars: Layers<T>,
    ) -> (Layers<T>, Bars<T, 7>) {
        ambient(split(point.material).0, bars)
    }
}
