//! Light on surfaces: from any side, on any material, and from all sides.

use std::f64::consts::{FRAC_PI_2, PI};

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Environment, LEAST_ROUGHNESS, Light, Material, Prefilter, Surface, irradiance, reflect, shade,
    srgb_decode, srgb_encode,
};

use super::row::{Failure, Found, Outcome, told};
use super::scene::{difference, largest, motley, numbers, rounding};

/// Angles from the normal: along it, grazing, just behind, and from behind.
const ANGLES: [f64; 9] =
    [0.0, 1e-7, 1e-4, 0.7, 1.57, FRAC_PI_2 - 3e-8, FRAC_PI_2 + 4e-6, 2.0, PI - 5e-8];

fn towards(angle: f64, turn: f64) -> [f64; 3] {
    [angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos()]
}

fn rows<'t, T: Scalar>(tape: &'t Tape<T>, rows: &[[f64; 3]]) -> Var<'t, T> {
    let entry = |k: usize| T::from_f64(rows[k / 3][k % 3]);
    tape.leaf(&Tensor::from_flat_fn([rows.len(), 3], entry))
}

fn vector<T: Scalar>(tape: &Tape<T>, entries: [f64; 3]) -> Var<'_, T> {
    tape.leaf(&Tensor::from(entries.map(T::from_f64)))
}

fn number<T: Scalar>(tape: &Tape<T>, entry: f64) -> Var<'_, T> {
    tape.leaf_scalar(T::from_f64(entry))
}

/// The numbers of a material: roughness, metallic, and the exponent of highlights.
type Numbers = [f64; 3];

/// All materials, with gradients to all of their numbers.
fn materials<T: Scalar>(
    tape: &Tape<T>,
    [roughness, metallic, exponent]: Numbers,
) -> ([Material<'_, T>; 5], [Var<'_, T>; 4]) {
    let color = vector(tape, [0.9, 0.5, 0.1]);
    let [roughness, metallic, exponent] =
        [roughness, metallic, exponent].map(|entry| number(tape, entry));
    let metal = |conserves_energy| Material::MetallicRoughness {
        base_color: color,
        roughness,
        metallic,
        conserves_energy,
    };
    let specular = color;
    let all = [
        metal(false),
        metal(true),
        Material::Lambert { color },
        Material::Phong { color, specular, exponent },
        Material::BlinnPhong { color, specular, exponent },
    ];
    (all, [color, roughness, metallic, exponent])
}

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
        let (materials, parts) = materials(&tape, of);
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

pub(super) fn from_any_side<T: Scalar>() -> Outcome {
    let mut found = (0.0_f64, 0);
    for of in [[0.5, 0.5, 8.0], [LEAST_ROUGHNESS, 1.0, 1e4], [1.0, 0.0, 0.0], [0.1, 1.0, 1.0]] {
        let (most, negative) = shaded_from_all_sides::<T>(of)?;
        found = (found.0.maximum_or_nan(most), found.1 + negative);
    }
    // The narrowest lobe has the slope 1 / alpha^3 or so, times 1 / GRAZING.
    Ok(Found::within("finite values and gradients", found.0, 1e16)
        .and(found.1 == 0, "a radiance is negative"))
}

/// Radiance, and the gradients of roughness and metallic.
fn of_material<T: Scalar>(roughness: f64, metallic: f64) -> Result<[Vec<f64>; 2], Failure> {
    let tape = Tape::<T>::new();
    let surface = Surface {
        normals: rows(&tape, &[[0.0, 0.0, 1.0], [0.1, -0.2, 1.0]]),
        views: vector(&tape, [0.3, 0.1, 1.0]),
        positions: None,
    };
    let (materials, [_, roughness, metallic, _]) = materials(&tape, [roughness, metallic, 1.0]);
    let direction = vector(&tape, [-0.2, 0.1, 1.0]);
    let light = Light::Directional { direction, irradiance: vector(&tape, [1.0; 3]) };
    let out = shade(&surface, &materials[1], &[light])?;
    let gradients = out.sum().backward()?;
    let bars = [roughness, metallic].map(|leaf| gradients.get_or_zeros(leaf).item().to_f64());
    Ok([numbers(&out.value()), bars.to_vec()])
}

pub(super) fn beyond_the_range<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let bounds = [(LEAST_ROUGHNESS, [0.0, -1.0, -1e30]), (1.0, [1.001, 7.0, 1e30])];
    for (bound, beyond) in bounds {
        let [at, _] = of_material::<T>(bound, 0.5)?;
        for roughness in beyond {
            let [found, bars] = of_material::<T>(roughness, 0.5)?;
            wrong += usize::from(found != at || bars[0] != 0.0);
        }
    }
    for (bound, beyond) in [(0.0, -1e30), (1.0, 1e30)] {
        let [at, _] = of_material::<T>(0.5, bound)?;
        let [found, bars] = of_material::<T>(0.5, beyond)?;
        wrong += usize::from(found != at || bars[1] != 0.0);
    }
    Ok(Found::exactly("the nearest material, without a gradient", wrong))
}

pub(super) fn any_length<T: Scalar>() -> Outcome {
    let run = |scales: [f64; 3]| {
        let tape = Tape::<T>::new();
        let scaled = |k: usize, d: [f64; 3]| d.map(|x| scales[k] * x);
        let n = [[0.1, -0.2, 1.0], [0.5, 0.25, 0.75]].map(|d| scaled(0, d));
        let (normals, views) = (rows(&tape, &n), vector(&tape, scaled(1, [0.3, 0.4, 0.8])));
        let direction = vector(&tape, scaled(2, [-0.2, 0.1, 1.0]));
        let surface = Surface { normals, views, positions: None };
        let (materials, _) = materials(&tape, [0.4, 0.5, 3.0]);
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
    Ok(Found::exactly("the same radiance, gradients times 2^-k", wrong))
}

pub(super) fn white<T: Scalar>() -> Outcome {
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
    Ok(Found::within("all light", error, 64.0 * rounding::<T>()))
}

pub(super) fn without_rows_or_lights<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let (materials, _) = materials(&tape, [0.5; 3]);
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
    Ok(Found::exactly("nothing, or black", wrong))
}

pub(super) fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let good = [[0.0, 0.0, 1.0], [0.0, 0.25, 1.0]];
    let lambert = Material::Lambert { color: vector(&tape, [1.0; 3]) };
    let said = |normals: &[[f64; 3]], light| {
        let positions = Some(rows(&tape, &good));
        let views = vector(&tape, [0.0, 0.0, 1.0]);
        told(shade(
            &Surface { normals: rows(&tape, normals), views, positions },
            &lambert,
            &[light],
        ))
    };
    let sun = |direction, irradiance| Light::Directional {
        direction: vector(&tape, direction),
        irradiance: vector(&tape, irradiance),
    };
    let lamp = |position| Light::Point {
        position: vector(&tape, position),
        intensity: vector(&tape, [1.0; 3]),
    };
    let one = [1.0; 3];
    let results = vec![
        (
            said(&[good[0], [0.0; 3]], sun(one, one)),
            "directions other than zero, got zero in row 1",
        ),
        (
            said(&[[f64::INFINITY, 0.0, 1.0], good[1]], sun(one, one)),
            "finite normals, got inf in row 0",
        ),
        (said(&good, sun([0.0; 3], one)), "a light's direction other than zero, got 0"),
        (said(&good, sun(one, [1.0, -1.0, 1.0])), "an irradiance of 0 or more, got -1"),
        (said(&good, sun(one, [f64::NAN; 3])), "an irradiance that is finite, got NaN"),
        (
            said(&good, lamp(good[1])),
            "finite inverse squares of distances to a point light, got inf in row 1",
        ),
    ];
    let results = results.into_iter().map(|(result, rule)| (result, format!("shade needs {rule}")));
    Ok(Found::refused(results.collect()))
}

pub(super) fn mirrored<T: Scalar>() -> Outcome {
    let direction = [0.5, -1.0, 2.0];
    let mut error = 0.0_f64;
    let mut is_zero = true;
    for scale in [1e-30, 1.0, 1e30] {
        let tape = Tape::<T>::new();
        let normals = rows(&tape, &[[0.0, scale, 0.0], [0.0; 3], [scale, scale, 0.0]]);
        let out = reflect(rows(&tape, &[direction; 3]), normals)?;
        let expected = [[0.5, 1.0, 2.0], direction, [1.0, -0.5, 2.0]];
        error = error.maximum_or_nan(difference(&numbers(&out.value()), expected.as_flattened()));
        let bars = numbers(&out.square().sum().backward()?.get_or_zeros(normals));
        is_zero &= bars[3..6] == [0.0; 3] && bars.iter().all(|bar| bar.is_finite());
    }
    Ok(Found::within("the mirror image, or what was given", error, 4.0 * rounding::<T>())
        .and(is_zero, "a gradient is not finite, or not zero"))
}

pub(super) fn tone_curves<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let light = [0.0, -0.0, 1e-30, 0.003, 0.18, 1.0, 12.0, -0.4, -1e-20, 1e6];
    let x = tape.leaf(&Tensor::from(light.map(T::from_f64)));
    let there = srgb_encode(x)?;
    let back = numbers(&srgb_decode(there)?.value());
    let exact: Vec<_> = numbers(&x.value());
    let error = back.iter().zip(&exact).map(|(found, exact)| {
        let size = exact.abs();
        if size == 0.0 { found.abs() } else { (found - exact).abs() / size }
    });
    let bars = numbers(&there.sum().backward()?.get_or_zeros(x));
    Ok(Found::within("decoded, what was encoded", largest(error), 32.0 * rounding::<T>()).and(
        bars.iter().all(|bar| (0.0..=12.93).contains(bar)),
        "a slope is outside of 0 to 12.92",
    ))
}

pub(super) fn environments<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for (extent, levels) in [(1, 1), (2, 2), (8, 4)] {
        let tape = Tape::<T>::new();
        let prefilter = Prefilter::new(extent, levels)?;
        let texels = tape.leaf(&Tensor::full([6, extent, extent, 3], T::from_f64(0.75)));
        let environment = Environment::from_texels(texels, &prefilter)?;
        for level in environment.reflections.levels() {
            let found = numbers(&level.value());
            error = error.maximum_or_nan(difference(&found, &vec![0.75; found.len()]));
        }
        let views: Vec<_> = ANGLES.iter().map(|&angle| towards(angle, 0.3)).collect();
        let normals: Vec<_> = (0..views.len())
            .map(|k| [motley(3 * k), motley(3 * k + 1), 1.0 + motley(3 * k + 2)])
            .collect();
        let surface =
            Surface { normals: rows(&tape, &normals), views: rows(&tape, &views), positions: None };
        for material in materials(&tape, [0.4, 0.5, 3.0]).0 {
            let out = environment.shade(&surface, &material)?;
            let gradients = out.sum().backward()?;
            let bars = numbers(&gradients.get_or_zeros(texels));
            let ambient = Light::Ambient { radiance: vector(&tape, [0.75; 3]) };
            let expected = numbers(&shade(&surface, &material, &[ambient])?.value());
            // Harmonics of a texel are means over 16 places: a whole face is a large one.
            let own = difference(&numbers(&out.value()), &expected)
                / if extent < 8 { 1e4 } else { 100.0 };
            error = error.maximum_or_nan(own).maximum_or_nan(largest(bars) * 0.0);
        }
    }
    Ok(Found::within("the ambient light", error, 1e-5))
}

pub(super) fn refused_environments<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let made = |extent, levels| told(Prefilter::<T>::new(extent, levels));
    let prefilter = Prefilter::<T>::new(2, 1)?;
    let zeros = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let rule = "an extent that is a power of two up to 256, got";
    let results = vec![
        (made(0, 1), format!("{rule} 0")),
        (made(3, 1), format!("{rule} 3")),
        (made(4, 4), "from 1 to 3 levels for an extent of 4, got 4".into()),
        (
            told(prefilter.cube_map(zeros(&[6, 4, 4, 3]))),
            "texels of shape [6, 2, 2, C], with a channel, got shape [6, 4, 4, 3]".into(),
        ),
    ];
    let mut results: Vec<_> = results
        .into_iter()
        .map(|(result, rule)| (result, format!("prefilter needs {rule}")))
        .collect();
    let lost = told(irradiance(zeros(&[9, 3]), zeros(&[1, 3])));
    results.push((lost, "irradiance needs directions other than zero, got zero in row 0".into()));
    Ok(Found::refused(results))
}
