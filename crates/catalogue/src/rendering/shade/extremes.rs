//! Light on surfaces from any side, on any material.

use std::f64::consts::PI;

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{LEAST_ROUGHNESS, Light, Material, Surface, shade};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::materials::{ANGLES, Numbers, all_materials, towards};
use crate::measures::{difference, largest, number, numbers, rounding, rows, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    161 "shading: grazing, from behind", "finite values and gradients", from_any_side;
    162 "shading: roughness, metallic beyond", "the nearest, no gradient", beyond_the_range;
    163 "shading: directions times 2^k", "the same bits, gradients / 2^k", any_length;
    164 "shading: white, energy conserved", "all light", white;
    165 "shading: no rows, no lights", "nothing, or black", without_rows_or_lights;
};

/// The largest of all values and gradients, NaN where one is, and how many values are below 0.
fn shaded_from_all_sides<T: Scalar>(of: Numbers) -> Result<(f64, usize), Failure> {
    let (mut most, mut negative) = (0.0_f64, 0);
    let views: Vec<_> = ANGLES
        .iter()
        .flat_map(|&angle| [0.0, 1.0, PI - 5e-8].map(|turn| towards(angle, turn)))
        .collect();
    let up = vec![[0.0, 0.0, 1.0]; views.len()];
    for l in ANGLES.map(|angle| towards(angle, 0.0)) {
        let tape = Tape::<T>::new();
        let (normals, views) = (rows(&tape, &up), rows(&tape, &views));
        let surface = Surface { normals, views, positions: None };
        let (direction, strength) = (vector(&tape, l), vector(&tape, [1.0, 0.5, 0.0]));
        let (materials, parts) = all_materials(&tape, of);
        let lights = [
            Light::Directional { direction, irradiance: strength },
            Light::Ambient { radiance: strength },
        ];
        for material in materials {
            let out = shade(&surface, &material, &lights)?;
            let gradients = out.sum().backward()?;
            let values = numbers(&out.value());
            negative += values.iter().filter(|&&value| value < 0.0).count();
            let leaves = [normals, views, direction, strength].into_iter().chain(parts);
            let bars = leaves.flat_map(|leaf| numbers(&gradients.get_or_zeros(leaf)));
            most = most.maximum_or_nan(largest(values.iter().copied().chain(bars)));
        }
    }
    Ok((most, negative))
}

fn from_any_side<T: Scalar>() -> Outcome {
    let mut found = (0.0_f64, 0);
    for of in [[0.5, 0.5, 8.0], [LEAST_ROUGHNESS, 1.0, 1e4], [1.0, 0.0, 0.0], [0.1, 1.0, 1.0]] {
        let (most, negative) = shaded_from_all_sides::<T>(of)?;
        found = (found.0.maximum_or_nan(most), found.1 + negative);
    }
    // The narrowest lobe has the slope 1 / alpha^3 or so, times 1 / GRAZING.
    Ok(Verdict::within("finite values and gradients", found.0, 1e16)
        .and(found.1 == 0, "a radiance is negative"))
}

/// Radiance, and the gradients of roughness and metallic.
fn light_and_slopes<T: Scalar>(roughness: f64, metallic: f64) -> Result<[Vec<f64>; 2], Failure> {
    let tape = Tape::<T>::new();
    let surface = Surface {
        normals: rows(&tape, &[[0.0, 0.0, 1.0], [0.1, -0.2, 1.0]]),
        views: vector(&tape, [0.3, 0.1, 1.0]),
        positions: None,
    };
    let (materials, [_, roughness, metallic, _]) = all_materials(&tape, [roughness, metallic, 1.0]);
    let direction = vector(&tape, [-0.2, 0.1, 1.0]);
    let light = Light::Directional { direction, irradiance: vector(&tape, [1.0; 3]) };
    let out = shade(&surface, &materials[1], &[light])?;
    let gradients = out.sum().backward()?;
    let bars = [roughness, metallic].map(|leaf| gradients.get_or_zeros(leaf).item().to_f64());
    Ok([numbers(&out.value()), bars.to_vec()])
}

fn beyond_the_range<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let bounds = [(LEAST_ROUGHNESS, [0.0, -1.0, -1e30]), (1.0, [1.001, 7.0, 1e30])];
    for (bound, beyond) in bounds {
        let [at, _] = light_and_slopes::<T>(bound, 0.5)?;
        for roughness in beyond {
            let [found, bars] = light_and_slopes::<T>(roughness, 0.5)?;
            wrong += usize::from(found != at || bars[0] != 0.0);
        }
    }
    for (bound, beyond) in [(0.0, -1e30), (1.0, 1e30)] {
        let [at, _] = light_and_slopes::<T>(0.5, bound)?;
        let [found, bars] = light_and_slopes::<T>(0.5, beyond)?;
        wrong += usize::from(found != at || bars[1] != 0.0);
    }
    Ok(Verdict::exactly("the nearest material, without a gradient", wrong))
}

fn any_length<T: Scalar>() -> Outcome {
    let run = |scales: [f64; 3]| {
        let tape = Tape::<T>::new();
        let scaled = |k: usize, d: [f64; 3]| d.map(|x| scales[k] * x);
        let n = [[0.1, -0.2, 1.0], [0.5, 0.25, 0.75]].map(|d| scaled(0, d));
        let (normals, views) = (rows(&tape, &n), vector(&tape, scaled(1, [0.3, 0.4, 0.8])));
        let direction = vector(&tape, scaled(2, [-0.2, 0.1, 1.0]));
        let surface = Surface { normals, views, positions: None };
        let (materials, _) = all_materials(&tape, [0.4, 0.5, 3.0]);
        let light = Light::Directional { direction, irradiance: vector(&tape, [1.0; 3]) };
        let out = shade(&surface, &materials[0], &[light])?;
        let gradients = out.sum().backward()?;
        let mut found = numbers(&out.value());
        for (k, leaf) in [normals, views, direction].into_iter().enumerate() {
            let bars = numbers(&gradients.get_or_zeros(leaf));
            found.extend(bars.iter().map(|bar| scales[k] * bar));
        }
        Ok::<_, Failure>(found)
    };
    let plain = run([1.0; 3])?;
    let most = if rounding::<T>() < 1e-10 { 800 } else { 60 };
    let mut wrong = 0;
    for powers in [[most, -most, 3], [-most, most, -most], [-1, 0, most]] {
        wrong += usize::from(run(powers.map(|power| f64::powi(2.0, power)))? != plain);
    }
    Ok(Verdict::exactly("the same radiance, gradients times 2^-k", wrong))
}

fn white<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for roughness in [0.0, 0.2, 0.5, 1.0] {
        for metallic in [0.0, 1.0] {
            let tape = Tape::<T>::new();
            let views: Vec<_> = ANGLES.iter().map(|&angle| towards(angle, 0.3)).collect();
            let normals = rows(&tape, &vec![[0.0, 0.0, 1.0]; views.len()]);
            let surface = Surface { normals, views: rows(&tape, &views), positions: None };
            let white = vector(&tape, [1.0; 3]);
            let material = Material::MetallicRoughness {
                base_color: white,
                roughness: number(&tape, roughness),
                metallic: number(&tape, metallic),
                conserves_energy: true,
            };
            let ambient = Light::Ambient { radiance: white };
            let found = numbers(&shade(&surface, &material, &[ambient])?.value());
            error = error.maximum_or_nan(difference(&found, &vec![1.0; found.len()]));
        }
    }
    // s of a white metal is E (1 + (1 / E - 1)), and what a white body gets is the rest of 1.
    Ok(Verdict::within("all light", error, 64.0 * rounding::<T>()))
}

fn without_rows_or_lights<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let (materials, _) = all_materials(&tape, [0.5; 3]);
    let irradiance = vector(&tape, [1.0; 3]);
    let sun = Light::Directional { direction: vector(&tape, [0.0, 0.0, 1.0]), irradiance };
    let mut wrong = 0;
    for material in materials {
        let surface = |of: &[[f64; 3]]| {
            let normals = rows(&tape, of);
            Surface { normals, views: vector(&tape, [0.0, 0.0, 1.0]), positions: None }
        };
        let nothing = shade(&surface(&[]), &material, &[sun])?;
        let bars = nothing.sum().backward()?.get_or_zeros(irradiance);
        wrong += usize::from(*nothing.shape() != [0, 3] || bars != Tensor::zeros([3]));
        let dark = shade(&surface(&[[0.0, 0.0, 1.0]; 2]), &material, &[])?;
        wrong += usize::from(dark.value() != Tensor::zeros([2, 3]));
    }
    Ok(Verdict::exactly("nothing, or black", wrong))
}
