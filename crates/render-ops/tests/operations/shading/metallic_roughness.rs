//! Laws of metals, dielectrics and their mixtures: the formulas of glTF 2.0, appendix B, and values by hand.

use super::*;
use bokashi_render_ops::{Light, Surface, shade};
use std::f64::consts::PI;

#[test]
fn a_mixture_is_the_mix_of_the_light_of_metal_and_dielectric() {
    let up = [0.0, 0.0, 1.0];
    let of = |metallic, conserves_energy| Model::MetallicRoughness {
        roughness: 1.0,
        metallic,
        conserves_energy,
    };
    // By hand: with alpha = 1, n = v = l, D = 1 / pi and G = 1 / 4. A dielectric reflects 0.96 of its base
    // and 0.04 of the lobe, a metal its base of the lobe.
    let found = reflected(of(0.5, false), [0.9; 3], &[(up, up)], up)[0];
    let (glass, metal) = (0.96 * 0.9 / PI + 0.04 / (4.0 * PI), 0.9 / (4.0 * PI));
    approx::assert_relative_eq!(found, 0.5 * (glass + metal), epsilon = 1e-14);
    approx::assert_abs_diff_eq!(found, 0.1749, epsilon = 5e-5);
    // From every side, by what the two reflect.
    let color = [0.9, 0.4, 0.05];
    for conserves_energy in [false, true] {
        for k in 0..40 {
            let x = f64::from(k);
            let v = spherical(0.05 + 0.02 * x, 1.3 * x);
            let l = spherical(0.95 - 0.015 * x, 0.4 * x * x);
            let metallic = x / 40.0;
            let of = |metallic| {
                let roughness = 0.1 + 0.02 * x;
                Model::MetallicRoughness { roughness, metallic, conserves_energy }
            };
            let seen = |metallic| {
                let lit = reflected(of(metallic), color, &[(up, v)], l);
                let tape = Tape::new();
                let surface = Surface {
                    normals: rows(&tape, &[up]),
                    views: vector(&tape, v),
                    positions: None,
                };
                let light = Light::Ambient { radiance: vector(&tape, ONE) };
                let out = shade(&surface, &material(&tape, of(metallic), color), &[light]);
                [lit, out.unwrap().value().data().to_vec()].concat()
            };
            let (found, glass, metal) = (seen(metallic), seen(0.0), seen(1.0));
            for c in 0..6 {
                let expected = (1.0 - metallic) * glass[c] + metallic * metal[c];
                approx::assert_relative_eq!(found[c], expected, max_relative = 1e-12);
            }
        }
    }
}

/// The usual BRDF times the cosine of the light, by the formulas of glTF 2.0, appendix B, word for word.
/// The cosine between n and v is `nv`.
fn gltf_2_0(
    [base, roughness, metallic]: [f64; 3],
    n: [f64; 3],
    (v, nv): ([f64; 3], f64),
    l: [f64; 3],
) -> f64 {
    let alpha = roughness * roughness;
    let h = unit([0, 1, 2].map(|k| l[k] + v[k]));
    let (nl, nh, vh) = (dot(n, l), dot(n, h), dot(v, h));
    let distribution = alpha.powi(2) / (PI * (nh * nh * (alpha * alpha - 1.0) + 1.0).powi(2));
    let side = |cosine: f64, other: f64| {
        other * (alpha * alpha + (1.0 - alpha * alpha) * cosine * cosine).sqrt()
    };
    let visibility = 0.5 / (side(nv, nl) + side(nl, nv));
    let specular = visibility * distribution;
    let schlick = |f0: f64| f0 + (1.0 - f0) * (1.0 - vh).powi(5);
    let mix = |a: f64, b: f64, t: f64| a * (1.0 - t) + b * t;
    let metal = specular * schlick(base);
    let dielectric = mix(base / PI, specular, schlick(0.04));
    mix(dielectric, metal, metallic) * nl
}

#[test]
fn metals_and_dielectrics_are_as_in_appendix_b_of_gltf_2_0() {
    let n = [0.0, 0.0, 1.0];
    for k in 0..200 {
        let x = f64::from(k);
        let share = |step: f64| (x * step).fract();
        let (v, l) = (
            spherical(0.03 + 0.96 * share(0.618), 7.0 * share(0.414)),
            spherical(0.03 + 0.96 * share(0.732), 7.0 * share(0.236)),
        );
        let (roughness, metallic) = (0.05 + 0.95 * share(0.303), share(0.571));
        let base = [share(0.449), share(0.162), 1.0];
        let model = Model::MetallicRoughness { roughness, metallic, conserves_energy: false };
        let found = reflected(model, base, &[(n, v)], l);
        for c in 0..3 {
            let expected = gltf_2_0([base[c], roughness, metallic], n, (v, dot(n, v)), l);
            approx::assert_relative_eq!(found[c], expected, max_relative = 1e-9);
        }
    }
}

#[test]
fn eye_and_light_may_be_nearly_opposite() {
    // |l + v| is twice the cosine.
    let n = [0.0, 0.0, 1.0];
    for cosine in [0.2, 3e-3, 5e-4] {
        let (v, l) = (spherical(cosine, 0.0), spherical(cosine, std::f64::consts::PI));
        let model =
            Model::MetallicRoughness { roughness: 0.4, metallic: 0.6, conserves_energy: false };
        let found = reflected(model, [0.5; 3], &[(n, v)], l)[0];
        let expected = gltf_2_0([0.5, 0.4, 0.6], n, (v, cosine), l);
        approx::assert_relative_eq!(found, expected, max_relative = 1e-9);
    }
}

#[test]
fn what_is_reflected_more_than_once_raises_the_highlight_of_each_by_its_reflectance() {
    let n = [0.0, 0.0, 1.0];
    let (v, l) = (spherical(0.6, 0.4), spherical(0.7, 2.5));
    for roughness in [0.3, 0.8, 1.0] {
        let of = |metallic, color: [f64; 3], conserves_energy| {
            let model = Model::MetallicRoughness { roughness, metallic, conserves_energy };
            reflected(model, color, &[(n, v)], l)
        };
        // A black dielectric has its highlight alone.
        let ratio = of(0.0, [0.0; 3], true)[0] / of(0.0, [0.0; 3], false)[0];
        let excess = (ratio - 1.0) / 0.04;
        // To what the fit of the albedo is off.
        let (found, expected) = (1.0 / (1.0 + excess), albedo(metal(roughness, false), 0.6));
        assert!((found - expected).abs() < 0.01, "{roughness}: {found} and not {expected}");
        let color = [0.2, 0.5, 0.9];
        let (all, once) = (of(1.0, color, true), of(1.0, color, false));
        for c in 0..3 {
            let expected = 1.0 + color[c] * excess;
            approx::assert_relative_eq!(all[c] / once[c], expected, max_relative = 1e-12);
        }
    }
}

#[test]
fn an_eye_is_seen_from_the_side_below_a_cosine_of_1e_4_and_not_before() {
    let n = [0.0, 0.0, 1.0];
    for (cosine, nv) in [(1e-2, 1e-2), (1e-3, 1e-3), (1.01e-4, 1.01e-4), (9e-5, 1e-4), (-0.3, 1e-4)]
    {
        for roughness in [0.2, 0.5, 1.0] {
            let (v, l) = (spherical(cosine, 0.4), spherical(0.6, 2.5));
            let model =
                Model::MetallicRoughness { roughness, metallic: 0.6, conserves_energy: false };
            let found = reflected(model, [0.9, 0.5, 0.2], &[(n, v)], l)[1];
            let expected = gltf_2_0([0.5, roughness, 0.6], n, (v, nv), l);
            approx::assert_relative_eq!(found, expected, max_relative = 1e-9);
        }
    }
}
