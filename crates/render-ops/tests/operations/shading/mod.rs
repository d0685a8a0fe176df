//! Laws of light on surfaces: energy, reciprocity, values by hand, extremes, and gradients against
//! differences.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{LEAST_ROUGHNESS, Light, Material, RenderError, Surface, shade};
use glam::DVec3;
use std::f64::consts::PI;

mod metallic_roughness;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    DVec3::from(a).dot(b.into())
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    DVec3::from(a).cross(b.into()).into()
}

fn unit(vector: [f64; 3]) -> [f64; 3] {
    DVec3::from(vector).normalize().into()
}

const ONE: [f64; 3] = [1.0; 3];

/// What a test needs of a surface of one material, in one light.
#[derive(Debug, Clone, Copy)]
enum Model {
    MetallicRoughness { roughness: f64, metallic: f64, conserves_energy: bool },
    Lambert,
    Phong { specular: f64, exponent: f64 },
    BlinnPhong { specular: f64, exponent: f64 },
}

fn material<'t>(tape: &'t Tape<f64>, model: Model, color: [f64; 3]) -> Material<'t, f64> {
    let vector = |entries: [f64; 3]| tape.leaf(&Tensor::new([3], entries.to_vec()).unwrap());
    let color = vector(color);
    let number = |x: f64| tape.leaf_scalar(x);
    match model {
        Model::MetallicRoughness { roughness, metallic, conserves_energy } => {
            Material::MetallicRoughness {
                base_color: color,
                roughness: number(roughness),
                metallic: number(metallic),
                conserves_energy,
            }
        }
        Model::Lambert => Material::Lambert { color },
        Model::Phong { specular, exponent } => {
            Material::Phong { color, specular: vector([specular; 3]), exponent: number(exponent) }
        }
        Model::BlinnPhong { specular, exponent } => Material::BlinnPhong {
            color,
            specular: vector([specular; 3]),
            exponent: number(exponent),
        },
    }
}

fn rows<'t>(tape: &'t Tape<f64>, rows: &[[f64; 3]]) -> Var<'t, f64> {
    let entries = rows.as_flattened().to_vec();
    tape.leaf(&Tensor::new([rows.len(), 3], entries).unwrap())
}

fn vector<'t>(tape: &'t Tape<f64>, entries: [f64; 3]) -> Var<'t, f64> {
    tape.leaf(&Tensor::new([3], entries.to_vec()).unwrap())
}

/// What reaches the eye in direction `v` of light of irradiance 1 from `l`, row by row.
fn reflected(model: Model, color: [f64; 3], of: &[([f64; 3], [f64; 3])], l: [f64; 3]) -> Vec<f64> {
    let tape = Tape::new();
    let (normals, views): (Vec<_>, Vec<_>) = of.iter().copied().unzip();
    let surface =
        Surface { normals: rows(&tape, &normals), views: rows(&tape, &views), positions: None };
    let light = Light::Directional { direction: vector(&tape, l), irradiance: vector(&tape, ONE) };
    let out = shade(&surface, &material(&tape, model, color), &[light]).unwrap();
    out.value().data().to_vec()
}

fn spherical(cosine: f64, angle: f64) -> [f64; 3] {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    [sine * angle.cos(), sine * angle.sin(), cosine]
}

/// The share of light from everywhere that is seen at such a cosine. Each row has another direction of
/// the light, turned with the surface so that all rows have the same light.
fn albedo(model: Model, cosine: f64) -> f64 {
    albedo_of(model, ONE, cosine)
}

fn albedo_of(model: Model, color: [f64; 3], cosine: f64) -> f64 {
    let view = spherical(cosine, 0.0);
    let mirrored = [-view[0], 0.0, view[2]];
    let across = [view[2], 0.0, view[0]];
    let (polar, around) = (1000, 64);
    let (mut turned, mut weights) = (Vec::new(), Vec::new());
    for i in 0..polar {
        // theta = pi t^3: narrow lobes need small steps.
        let t = (i as f64 + 0.5) / polar as f64;
        let theta = std::f64::consts::PI * t.powi(3);
        let step = 3.0 * std::f64::consts::PI * t * t / polar as f64;
        for j in 0..around {
            let phi = std::f64::consts::TAU * (j as f64 + 0.5) / around as f64;
            let along: [f64; 3] = std::array::from_fn(|k| {
                theta.cos() * mirrored[k] + theta.sin() * phi.cos() * across[k]
            });
            let light = [along[0], theta.sin() * phi.sin(), along[2]];
            if light[2] > 0.0 {
                let side = unit(cross(
                    light,
                    if light[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] },
                ));
                let other = cross(light, side);
                let turn = |d: [f64; 3]| [dot(d, side), dot(d, other), dot(d, light)];
                turned.push((turn([0.0, 0.0, 1.0]), turn(view)));
                weights.push(theta.sin() * step * std::f64::consts::TAU / around as f64);
            }
        }
    }
    let found = reflected(model, color, &turned, [0.0, 0.0, 1.0]);
    found.chunks_exact(3).zip(&weights).map(|(row, weight)| row[0] * weight).sum()
}

const fn metal(roughness: f64, conserves_energy: bool) -> Model {
    Model::MetallicRoughness { roughness, metallic: 1.0, conserves_energy }
}

const ROUGHNESSES: [f64; 6] = [0.1, 0.2, 0.35, 0.5, 0.75, 1.0];
const COSINES: [f64; 5] = [0.1, 0.3, 0.6, 0.9, 0.99];

#[test]
fn a_white_furnace_loses_light_unless_it_conserves_energy() {
    for roughness in ROUGHNESSES {
        for cosine in COSINES {
            let once = albedo(metal(roughness, false), cosine);
            assert!(once > 0.25 && once < 1.0005, "{roughness} {cosine}: {once}");
            let all = albedo(metal(roughness, true), cosine);
            assert!((all - 1.0).abs() < 0.01, "{roughness} {cosine}: {all}");
        }
    }
    // By hand: with alpha = 1 and the eye above, D is 1 / pi, and E = 1 - ln 2.
    approx::assert_relative_eq!(albedo(metal(1.0, false), 1.0), 1.0 - 2.0_f64.ln(), epsilon = 1e-4);
}

#[test]
fn a_white_surface_that_conserves_energy_reflects_all_light() {
    for roughness in ROUGHNESSES {
        for cosine in COSINES {
            for metallic in [0.0, 0.3, 0.7, 1.0] {
                let model =
                    Model::MetallicRoughness { roughness, metallic, conserves_energy: true };
                let share = albedo(model, cosine);
                assert!((share - 1.0).abs() < 0.01, "{model:?} {cosine}: {share}");
            }
        }
    }
    // Without, it gains some from the side, which is documented, and nothing from above.
    let usual = |cosine: f64| {
        let model =
            Model::MetallicRoughness { roughness: 0.1, metallic: 0.0, conserves_energy: false };
        albedo(model, cosine)
    };
    assert!(usual(0.1) > 1.5 && usual(0.1) < 1.6 && usual(0.9) < 1.0);
}

#[test]
fn highlights_of_phong_reflect_their_share_along_the_normal() {
    for exponent in [1.0, 8.0, 60.0] {
        let phong = albedo(Model::Phong { specular: 1.0, exponent }, 1.0) - 1.0;
        approx::assert_relative_eq!(phong, 1.0, epsilon = 1e-4);
        let blinn = albedo(Model::BlinnPhong { specular: 1.0, exponent }, 1.0) - 1.0;
        assert!((blinn - 1.0).abs() < 0.1, "{exponent}: {blinn}");
    }
    approx::assert_relative_eq!(albedo(Model::Lambert, 0.4), 1.0, epsilon = 1e-5);
}

/// All models, with some material.
const MODELS: [Model; 6] = [
    Model::MetallicRoughness { roughness: 0.4, metallic: 0.3, conserves_energy: false },
    metal(0.05, false),
    metal(1.0, false),
    Model::Lambert,
    Model::Phong { specular: 0.5, exponent: 12.5 },
    Model::BlinnPhong { specular: 0.5, exponent: 12.5 },
];

#[test]
fn light_and_eye_can_be_exchanged() {
    let n = [0.0, 0.0, 1.0];
    for model in MODELS {
        for k in 0..40 {
            let x = k as f64;
            let a = spherical(0.05 + 0.02 * x, 1.3 * x);
            let b = spherical(0.95 - 0.015 * x, 0.4 * x * x);
            let forth = reflected(model, [0.8, 0.5, 0.1], &[(n, a)], b);
            let back = reflected(model, [0.8, 0.5, 0.1], &[(n, b)], a);
            for c in 0..3 {
                approx::assert_relative_eq!(
                    forth[c] / b[2],
                    back[c] / a[2],
                    max_relative = 1e-9,
                    epsilon = 1e-12
                );
            }
        }
    }
}

#[test]
fn values_by_hand() {
    let up = [0.0, 0.0, 1.0];
    // Eye and light above, alpha = 1/4: D = 1 / (pi a^2) = 16 / pi, G = 1 / 4, F = F0.
    let model =
        |metallic| Model::MetallicRoughness { roughness: 0.5, metallic, conserves_energy: false };
    let color = [0.5, 0.25, 1.0];
    let metal = reflected(model(1.0), color, &[(up, up)], up);
    let glass = reflected(model(0.0), color, &[(up, up)], up);
    for c in 0..3 {
        approx::assert_relative_eq!(metal[c], 4.0 / PI * color[c], epsilon = 1e-14);
        let expected = 0.96 * color[c] / PI + 0.16 / PI;
        approx::assert_relative_eq!(glass[c], expected, epsilon = 1e-14);
    }
    // Eye and light at 60 degrees on either side, so h is the normal: D is the same; A = B with
    // A^2 = 1/16 + 15/16 / 4, so G = 1/2 / (2 A); F of v . h = 1/2.
    let (v, l) = (spherical(0.5, 0.0), spherical(0.5, PI));
    let found = reflected(model(1.0), color, &[(up, v)], l);
    let a = (1.0_f64 / 16.0 + 15.0 / 64.0).sqrt();
    for c in 0..3 {
        let fresnel = color[c] + (1.0 - color[c]) / 32.0;
        approx::assert_relative_eq!(found[c], 16.0 / PI / (4.0 * a) * fresnel, epsilon = 1e-13);
    }
    // Lengths do not matter, also those whose squares no number holds.
    let long = |d: [f64; 3], by: f64| d.map(|x| by * x);
    let same = reflected(model(1.0), color, &[(long(up, 3e-200), long(v, 5e300))], long(l, 7.0));
    for c in 0..3 {
        approx::assert_relative_eq!(same[c], found[c], max_relative = 1e-13);
    }
    // Highlights around the mirrored light and the half vector, at 60 degrees from each other and 30.
    let v = spherical(1.0, 0.0);
    let l = spherical(0.5, 0.0);
    let phong = reflected(Model::Phong { specular: 1.0, exponent: 3.0 }, [0.0; 3], &[(up, v)], l);
    approx::assert_relative_eq!(phong[0], 0.5 * 5.0 / (2.0 * PI) / 8.0, epsilon = 1e-14);
    let model = Model::BlinnPhong { specular: 1.0, exponent: 4.0 };
    let blinn = reflected(model, [0.0; 3], &[(up, v)], l);
    approx::assert_relative_eq!(blinn[0], 0.5 * 12.0 / (8.0 * PI) * 9.0 / 16.0, epsilon = 1e-14);
}

#[test]
fn an_exponent_below_0_is_0_and_has_no_gradient() {
    let tape = Tape::new();
    let surface = Surface {
        normals: rows(&tape, &[[0.0, 0.0, 1.0]]),
        views: vector(&tape, [0.3, 0.1, 1.0]),
        positions: None,
    };
    let direction = vector(&tape, [-0.2, 0.4, 1.0]);
    let light = Light::Directional { direction, irradiance: vector(&tape, ONE) };
    let (color, specular) = (vector(&tape, [0.9, 0.4, 0.2]), vector(&tape, [0.3; 3]));
    let seen = |exponent: f64| {
        let exponent = tape.leaf_scalar(exponent);
        let all = [
            Material::Phong { color, specular, exponent },
            Material::BlinnPhong { color, specular, exponent },
        ];
        all.map(|material| {
            let out = shade(&surface, &material, &[light]).unwrap();
            (out.value(), out.sum().backward().unwrap().get_or_zeros(exponent).item())
        })
    };
    let at = seen(0.0);
    assert!(at.iter().all(|(_, slope)| *slope != 0.0));
    for below in [-1e-3, -1.0, -7.5] {
        for ((found, slope), (value, _)) in seen(below).iter().zip(&at) {
            assert_eq!((found, *slope), (value, 0.0));
        }
    }
}

#[test]
fn lights_add_up_and_fall_with_the_square_of_the_distance() {
    let tape = Tape::new();
    let surface = Surface {
        normals: rows(&tape, &[[0.0, 0.0, 2.0], [0.1, 0.3, 1.0]]),
        views: vector(&tape, [0.3, 0.4, 1.0]),
        positions: Some(rows(&tape, &[[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]])),
    };
    let material = material(&tape, MODELS[0], [0.8, 0.5, 0.1]);
    let near = Light::Point {
        position: vector(&tape, [2.0, 2.0, 5.0]),
        intensity: vector(&tape, [1.0, 2.0, 3.0]),
    };
    let far = Light::Point {
        position: vector(&tape, [4.0, 2.0, 9.0]),
        intensity: vector(&tape, [9.0, 18.0, 27.0]),
    };
    let distant = Light::Directional {
        direction: vector(&tape, [1.0, 0.0, 2.0]),
        irradiance: vector(&tape, [0.2, 0.4, 0.6]),
    };
    let everywhere = Light::Ambient { radiance: vector(&tape, [0.5, 0.25, 1.0]) };
    let of = |lights: &[_]| shade(&surface, &material, lights).unwrap().value();
    let [one, two, three, four] = [near, far, distant, everywhere].map(|light| of(&[light]));
    let all = of(&[near, far, distant, everywhere]);
    for k in 0..6 {
        approx::assert_relative_eq!(one.data()[k], two.data()[k], max_relative = 1e-13);
        // The distance's square is 5.
        approx::assert_relative_eq!(one.data()[k], three.data()[k], max_relative = 1e-13);
        let sum = one.data()[k] + two.data()[k] + three.data()[k] + four.data()[k];
        approx::assert_relative_eq!(all.data()[k], sum, max_relative = 1e-13);
    }
    assert!(of(&[]).data().iter().all(|&entry| entry == 0.0));
}

#[test]
fn light_from_everywhere_is_nearly_the_integral_over_all_directions() {
    let tape = Tape::new();
    let color = [0.5; 3];
    for roughness in ROUGHNESSES {
        for cosine in COSINES {
            for metallic in [1.0, 0.4, 0.0] {
                let model =
                    Model::MetallicRoughness { roughness, metallic, conserves_energy: true };
                let surface = Surface {
                    normals: rows(&tape, &[[0.0, 0.0, 1.0]]),
                    views: vector(&tape, spherical(cosine, 0.7)),
                    positions: None,
                };
                let light = Light::Ambient { radiance: vector(&tape, ONE) };
                let found = shade(&surface, &material(&tape, model, color), &[light]).unwrap();
                let (found, expected) = (found.value().data()[0], albedo_of(model, color, cosine));
                assert!((found - expected).abs() < 0.01, "{model:?} {cosine}: {found} {expected}");
            }
        }
    }
}

#[test]
fn any_angle_and_any_roughness_have_finite_values_and_gradients() {
    let angles = [
        0.0,
        1e-7,
        1e-4,
        0.5,
        1.57,
        std::f64::consts::FRAC_PI_2,
        std::f64::consts::FRAC_PI_2 + 4e-6,
        2.0,
        std::f64::consts::PI - 5e-8,
        std::f64::consts::PI,
    ];
    let (mut normals, mut views) = (Vec::new(), Vec::new());
    for a in angles {
        for turn in [0.0, 1.0, std::f64::consts::PI - 3e-9, std::f64::consts::PI] {
            normals.push([0.0, 0.0, 1.0]);
            views.push([a.sin() * turn.cos(), a.sin() * turn.sin(), a.cos()]);
        }
    }
    for roughness in [-1.0, 0.0, 1e-3, 1.0 / 32.0, 0.5, 1.0, 2.0] {
        for metallic in [-0.5, 0.0, 0.5, 1.0, 1.5] {
            for l in angles.map(|a| [a.sin(), 0.0, a.cos()]) {
                for exponent in [-1.0, 0.0, 0.5, 1.0, 1e4] {
                    let tape = Tape::<f32>::new();
                    let cast = |rows: &[[f64; 3]]| {
                        let entries = rows.as_flattened().iter().map(|&x| x as f32).collect();
                        tape.leaf(&Tensor::new([rows.len(), 3], entries).unwrap())
                    };
                    let vector = |x: f32| tape.leaf(&Tensor::full([3], x));
                    let normals = cast(&normals);
                    let surface = Surface { normals, views: cast(&views), positions: None };
                    let number = |x: f64| tape.leaf_scalar(x as f32);
                    let direction = l.map(|x| x as f32).to_vec();
                    let direction = tape.leaf(&Tensor::new([3], direction).unwrap());
                    let lights = [
                        Light::Directional { direction, irradiance: vector(1.0) },
                        Light::Ambient { radiance: vector(1.0) },
                    ];
                    let (color, specular, exponent) = (vector(0.7), vector(0.2), number(exponent));
                    let materials = [
                        Material::MetallicRoughness {
                            base_color: color,
                            roughness: number(roughness),
                            metallic: number(metallic),
                            conserves_energy: true,
                        },
                        Material::Lambert { color },
                        Material::Phong { color, specular, exponent },
                        Material::BlinnPhong { color, specular, exponent },
                    ];
                    for material in materials {
                        let out = shade(&surface, &material, &lights).unwrap();
                        let gradients = out.sum().backward().unwrap();
                        let leaves = [normals, surface.views, direction, color, exponent];
                        let all = leaves.map(|leaf| gradients.get_or_zeros(leaf));
                        for found in all.iter().chain([&out.value()]) {
                            assert!(
                                found.data().iter().all(|x| x.is_finite()),
                                "{material:?} {l:?}"
                            );
                        }
                        assert!(out.value().data().iter().all(|&x| x >= 0.0));
                    }
                    if roughness != 0.5 || metallic != 0.5 {
                        // The other materials do not depend on them.
                        break;
                    }
                }
            }
        }
    }
}

#[test]
fn what_is_clamped_has_no_gradient_and_the_value_of_the_bound() {
    let value = |roughness: f64, metallic: f64| {
        let tape = Tape::new();
        let surface = Surface {
            normals: rows(&tape, &[[0.0, 0.0, 1.0]]),
            views: vector(&tape, [0.3, 0.1, 1.0]),
            positions: None,
        };
        let (roughness, metallic) = (tape.leaf_scalar(roughness), tape.leaf_scalar(metallic));
        let material = Material::MetallicRoughness {
            base_color: vector(&tape, [0.9, 0.4, 0.2]),
            roughness,
            metallic,
            conserves_energy: true,
        };
        let direction = vector(&tape, [-0.2, 0.1, 1.0]);
        let light = Light::Directional { direction, irradiance: vector(&tape, ONE) };
        let out = shade(&surface, &material, &[light]).unwrap();
        let gradients = out.sum().backward().unwrap();
        let bars = [roughness, metallic].map(|leaf| gradients.get_or_zeros(leaf).item());
        (out.value(), bars)
    };
    let bounds = [(LEAST_ROUGHNESS, [-1.0, 0.0, 0.01]), (1.0, [1.01, 2.0, 1e30])];
    for (bound, beyond) in bounds {
        let (at, [slope, _]) = value(bound, 0.5);
        assert!(slope != 0.0);
        for roughness in beyond {
            let (found, [slope, _]) = value(roughness, 0.5);
            assert_eq!((found, slope), (at.clone(), 0.0));
        }
    }
    for (bound, beyond) in [(0.0, -0.3), (1.0, 1.5)] {
        let (at, [_, slope]) = value(0.5, bound);
        assert!(slope != 0.0);
        let (found, [_, slope]) = value(0.5, beyond);
        assert_eq!((found, slope), (at, 0.0));
    }
}

#[test]
fn rows_and_numbers_of_all_rows_agree_over_many_pieces() {
    // More rows than a piece has, and not a whole block.
    let count = 2 * 2048 + 37;
    let tape = Tape::<f64>::new();
    let motley = |k: usize| (k as f64 * 0.7371).sin();
    let positions = tape.leaf(&Tensor::from_flat_fn([count, 3], |k| motley(k + 5)));
    let normals = tape.leaf(&Tensor::from_flat_fn([count, 3], motley));
    let upstream = Tensor::from_flat_fn([count, 3], |k| motley(3 * k + 1));
    let view = vector(&tape, [0.3, -0.5, 0.8]);
    let color = vector(&tape, [0.9, 0.4, 0.2]);
    let (roughness, metallic) = (tape.leaf_scalar(0.4), tape.leaf_scalar(0.7));
    let lights = [
        Light::Directional { direction: vector(&tape, [1.0, 2.0, 3.0]), irradiance: color },
        Light::Point { position: vector(&tape, [4.0, -3.0, 2.0]), intensity: color },
        Light::Ambient { radiance: color },
    ];
    let spread = |x: Var<'_, f64>| {
        let value = x.value();
        let width = value.size();
        let axes = if width == 1 { vec![count] } else { vec![count, width] };
        Tensor::from_flat_fn(&axes[..], |k| value.data()[k % width])
    };
    let [views, colors, roughnesses, metallics] =
        [view, color, roughness, metallic].map(|x| tape.leaf(&spread(x)));
    let run = |views, base_color, roughness, metallic| {
        let surface = Surface { normals, views, positions: Some(positions) };
        let conserves_energy = true;
        let material =
            Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy };
        let out = shade(&surface, &material, &lights).unwrap();
        (out.value(), tape.vjp(&[(out, &upstream)]).unwrap())
    };
    let (alike, of_alike) = run(view, color, roughness, metallic);
    let (each, of_each) = run(views, colors, roughnesses, metallics);
    assert_eq!(alike, each);
    assert_eq!(of_alike.get(normals), of_each.get(normals));
    assert_eq!(of_alike.get(positions), of_each.get(positions));
    let sums = |x: Var<'_, f64>, width: usize| -> Vec<f64> {
        let bars = of_each.get_or_zeros(x);
        (0..width).map(|c| bars.data().iter().skip(c).step_by(width).sum()).collect()
    };
    for (one, many, width) in
        [(view, views, 3), (roughness, roughnesses, 1), (metallic, metallics, 1)]
    {
        let found = of_alike.get_or_zeros(one);
        for (found, expected) in found.data().iter().zip(sums(many, width)) {
            approx::assert_relative_eq!(*found, expected, max_relative = 1e-9);
        }
    }
    // The colour is the lights' strength as well, whose gradients are added.
    let lights_alone = of_each.get_or_zeros(color);
    let (found, of_rows) = (of_alike.get_or_zeros(color), sums(colors, 3));
    for c in 0..3 {
        let expected = lights_alone.data()[c] + of_rows[c];
        approx::assert_relative_eq!(found.data()[c], expected, max_relative = 1e-9);
    }
}

#[test]
fn a_variable_in_several_places_gets_the_sum_of_their_gradients() {
    let tape = Tape::<f64>::new();
    let shared = tape.leaf(&Tensor::from_flat_fn([70, 3], |k| 1.5 + (k as f64).sin()));
    let [normals, views, positions] = [0; 3].map(|_| tape.leaf(&shared.value()));
    let light = Light::Point {
        position: vector(&tape, [5.0, 6.0, 7.0]),
        intensity: vector(&tape, [1.0, 2.0, 3.0]),
    };
    let run = |normals, views, positions| {
        let surface = Surface { normals, views, positions: Some(positions) };
        let material = material(&tape, MODELS[0], [0.3, 0.4, 0.5]);
        shade(&surface, &material, &[light]).unwrap().sum().backward().unwrap()
    };
    let together = run(shared, shared, shared);
    let apart = run(normals, views, positions);
    for k in 0..210 {
        let parts = [normals, views, positions].map(|x| apart.get_or_zeros(x).data()[k]);
        let expected: f64 = parts.iter().sum();
        let found = together.get_or_zeros(shared).data()[k];
        approx::assert_relative_eq!(found, expected, max_relative = 1e-12, epsilon = 1e-14);
    }
}

#[test]
fn no_rows_are_no_rows_and_lights_get_zeros() {
    let tape = Tape::new();
    let surface = Surface { normals: rows(&tape, &[]), views: rows(&tape, &[]), positions: None };
    let irradiance = vector(&tape, ONE);
    let light = Light::Directional { direction: vector(&tape, ONE), irradiance };
    let out = shade(&surface, &material(&tape, MODELS[0], ONE), &[light]).unwrap();
    assert_eq!(*out.shape(), [0, 3]);
    assert_eq!(out.sum().backward().unwrap().get_or_zeros(irradiance).data(), [0.0; 3]);
}

#[test]
fn what_nothing_can_be_made_of_is_refused() {
    let tape = Tape::<f64>::new();
    let good = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    let surface = Surface {
        normals: rows(&tape, &good),
        views: rows(&tape, &good),
        positions: Some(rows(&tape, &good)),
    };
    let lambert = material(&tape, Model::Lambert, ONE);
    let lamp = |position: [f64; 3]| Light::Point {
        position: vector(&tape, position),
        intensity: vector(&tape, ONE),
    };
    let said = |surface: &Surface<'_, f64>, light| {
        let before = tape.len();
        let error: RenderError = shade(surface, &lambert, &[light]).unwrap_err();
        assert_eq!(tape.len(), before);
        error.to_string()
    };
    assert_eq!(
        said(&Surface { positions: None, ..surface }, lamp(ONE)),
        "shade needs positions of the surface in the light of a point, got 2 inputs"
    );
    assert_eq!(
        said(&surface, lamp([1e-200, 1.0, 1.0])),
        "shade needs finite inverse squares of distances to a point light, got inf in row 1"
    );
}
