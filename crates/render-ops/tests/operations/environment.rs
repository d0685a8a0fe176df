//! Laws of light from all sides: constants are kept, and integrals are integrals.

use approx::{assert_abs_diff_eq, assert_relative_eq};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Environment, Light, Material, Prefilter, Surface, irradiance, shade};
use glam::DVec3;

const SIZE: usize = 16;

type Vector3 = [f64; 3];

fn dot(a: Vector3, b: Vector3) -> f64 {
    DVec3::from(a).dot(b.into())
}

/// The unit vector to the middle of a texel, and its solid angle, by the faces' axes in OpenGL's table.
fn texel(k: usize, size: usize) -> (Vector3, f64) {
    let (face, row, column) = (k / size / size, k / size % size, k % size);
    let ratio = |at: f64| 2.0 * at / size as f64 - 1.0;
    let [s, t] = [column, row].map(|k| ratio(k as f64 + 0.5));
    let middle =
        [[1.0, -t, -s], [-1.0, -t, s], [s, 1.0, t], [s, -1.0, -t], [s, -t, 1.0], [-s, -t, -1.0]]
            [face];
    // Of the rectangle from a face's middle to (s, t); a texel is four of them, with signs.
    let corner = |column: usize, row: usize| {
        let [s, t] = [column, row].map(|k| ratio(k as f64));
        (s * t).atan2((s * s + t * t + 1.0).sqrt())
    };
    let solid_angle =
        corner(column + 1, row + 1) - corner(column, row + 1) - corner(column + 1, row)
            + corner(column, row);
    (DVec3::from(middle).normalize().into(), solid_angle)
}

/// A cube map of one channel.
fn map<T: Scalar>(size: usize, radiance: impl Fn(Vector3) -> f64) -> Tensor<T> {
    Tensor::from_flat_fn([6, size, size, 1], |k| T::from_f64(radiance(texel(k, size).0)))
}

fn rows<'t>(tape: &'t Tape<f64>, rows: &[[f64; 3]]) -> Var<'t, f64> {
    tape.leaf(&Tensor::new([rows.len(), 3], rows.as_flattened().to_vec()).unwrap())
}

const NORMALS: [[f64; 3]; 4] =
    [[0.0, 0.0, 2.0], [0.3, -0.8, 0.1], [-5.0, 1.0, 0.5], [1.0, 1.0, 1.0]];

#[test]
fn an_environment_that_is_the_same_everywhere_is_an_ambient_light() {
    let tape = Tape::<f64>::new();
    let radiance = [0.5, 1.0, 2.0];
    let texels = Tensor::from_flat_fn([6, SIZE, SIZE, 3], |k| radiance[k % 3]);
    let prefilter = Prefilter::new(SIZE, 3).unwrap();
    let environment = Environment::from_texels(tape.leaf(&texels), &prefilter).unwrap();
    for level in environment.reflections.levels() {
        for (k, found) in level.value().data().iter().enumerate() {
            assert_relative_eq!(*found, radiance[k % 3], max_relative = 1e-13);
        }
    }
    let colour = tape.leaf(&Tensor::from([0.9, 0.5, 0.2]));
    let number = |x: f64| tape.leaf_scalar(x);
    let ambient = Light::Ambient { radiance: tape.leaf(&Tensor::from(radiance)) };
    for views in [
        rows(&tape, &NORMALS.map(|[x, y, z]| [y, z, x])),
        tape.leaf(&Tensor::from([0.3, 0.4, 0.9])),
    ] {
        let surface = Surface { normals: rows(&tape, &NORMALS), views, positions: None };
        for conserves_energy in [false, true] {
            let all = [
                Material::MetallicRoughness {
                    base_color: colour,
                    roughness: number(0.4),
                    metallic: number(0.7),
                    conserves_energy,
                },
                Material::Lambert { color: colour },
                Material::Phong { color: colour, specular: colour, exponent: number(9.0) },
            ];
            for material in all {
                let found = environment.shade(&surface, &material).unwrap().value();
                let expected = shade(&surface, &material, &[ambient]).unwrap().value();
                for (found, expected) in found.data().iter().zip(expected.data()) {
                    // Harmonics are taken at places of texels.
                    assert_relative_eq!(found, expected, max_relative = 1e-5);
                }
            }
        }
    }
}

#[test]
fn irradiance_of_the_first_bands_is_the_integral() {
    // Radiance of the bands up to 2, and of band 3, which a cosine does not see.
    let radiance = |[x, y, z]: Vector3| {
        2.0 + 0.3 * x - 0.7 * y + 0.5 * z + 0.4 * x * y - 0.2 * z * x + 0.6 * z * z - 0.35 * y * z
            + 0.25 * x * x
            + 0.9 * x * y * z
    };
    let (size, tape) = (64, Tape::<f64>::new());
    let texels = map::<f64>(size, radiance);
    let prefilter = Prefilter::new(size, 1).unwrap();
    let harmonics = prefilter.harmonics(tape.leaf(&texels)).unwrap();
    let found = irradiance(harmonics, rows(&tape, &NORMALS)).unwrap().value();
    for (found, normal) in found.data().iter().zip(NORMALS) {
        let n = DVec3::from(normal).normalize().into();
        let cosines = (0..texels.size()).map(|k| {
            let (l, angle) = texel(k, size);
            angle * dot(n, l).max(0.0) * texels.data()[k]
        });
        assert_relative_eq!(*found, cosines.sum::<f64>(), max_relative = 1e-3);
    }
    // By hand: light of radiance 1 + z has the irradiance pi + 2 pi / 3 n_z.
    let harmonics = prefilter.harmonics(tape.leaf(&map(size, |l| 1.0 + l[2]))).unwrap();
    let found = irradiance(harmonics, rows(&tape, &NORMALS[..1])).unwrap().item();
    assert_relative_eq!(found, 5.0 * std::f64::consts::PI / 3.0, max_relative = 1e-4);
}

/// GGX's `D(h) (r . l)`, but for a factor, of a surface whose normal and view are `r`.
fn lobe(r: Vector3, l: Vector3, alpha: f64) -> f64 {
    let h = DVec3::from([0, 1, 2].map(|k| r[k] + l[k])).try_normalize().map_or(r, Into::into);
    let d = dot(r, h).powi(2) * (alpha * alpha - 1.0) + 1.0;
    dot(r, l).max(0.0) / (d * d)
}

#[test]
fn mirror_images_are_means_over_the_lobe() {
    // A bright spot of a few texels, the sky above, and a pattern: each has a contrast of 1.
    let radiance = |[x, y, z]: Vector3| {
        let share = |is: bool| f64::from(u8::from(is));
        let spot = share(0.48 * x + 0.6 * y + 0.64 * z > 0.97);
        [spot, share(y > 0.0), 0.5 + 0.5 * (9.0 * x + 4.0 * z).sin()]
    };
    let (size, levels) = (32, 4);
    let tape = Tape::<f64>::new();
    let texels: Vec<_> = (0..6 * size * size).map(|k| radiance(texel(k, size).0)).collect();
    let texels = Tensor::new([6, size, size, 3], texels.concat()).unwrap();
    let prefilter = Prefilter::new(size, levels).unwrap();
    let found = prefilter.cube_map(tape.leaf(&texels)).unwrap();
    assert_eq!(found.levels()[0].value(), texels);
    // Each texel as 16, so that narrow lobes are integrals as well.
    let fine = 4 * size;
    let places: Vec<_> = (0..6 * fine * fine)
        .map(|k| {
            let (face, row, column) = (k / fine / fine, k / fine % fine / 4, k % fine / 4);
            (texel(k, fine), (face * size + row) * size + column)
        })
        .collect();
    for (k, level) in (1..).zip(&found.levels()[1..]) {
        let alpha = (f64::from(k) / (levels - 1) as f64).powi(2);
        let side = size >> k;
        let mut most = [0.0_f64; 3];
        for index in (0..6 * side * side).step_by(7) {
            let (r, _) = texel(index, side);
            let (mut sums, mut total) = ([0.0; 3], 0.0);
            for &((l, angle), texel) in places.iter().filter(|((l, _), _)| dot(r, *l) > 0.0) {
                let weight = angle * lobe(r, l, alpha);
                total += weight;
                for c in 0..3 {
                    sums[c] += weight * texels.data()[3 * texel + c];
                }
            }
            for c in 0..3 {
                let error = level.value().data()[3 * index + c] - sums[c] / total;
                most[c] = most[c].max(error.abs());
            }
        }
        assert!(most.iter().all(|&most| most < 0.004), "level {k} is off by {most:?}");
    }
}

#[test]
fn mirror_images_of_a_smooth_sky_are_its_integrals() {
    // A lobe keeps each harmonic, but for a factor: the mean of the Legendre polynomial.
    let (size, levels) = (64, 4);
    let tape = Tape::<f64>::new();
    let sky = map(size, |[x, _, z]| 1.0 + x + z * z);
    let found = Prefilter::new(size, levels).unwrap().cube_map(tape.leaf(&sky)).unwrap();
    let factors = |alpha: f64| {
        let (mut one, mut two, mut total) = (0.0, 0.0, 0.0);
        let up = [0.0, 0.0, 1.0];
        for k in 0..20_000 {
            // Close together where the light comes from ahead.
            let sine = (f64::from(k) + 0.5) / 20_000.0;
            let cosine = (1.0 - sine * sine).sqrt();
            let weight = sine / cosine * lobe(up, [sine, 0.0, cosine], alpha);
            total += weight;
            one += weight * cosine;
            two += weight * (1.5 * cosine * cosine - 0.5);
        }
        [one / total, two / total]
    };
    // By hand: with alpha = 1 a lobe is a cosine.
    for (found, expected) in factors(1.0).into_iter().zip([2.0 / 3.0, 0.25]) {
        assert_relative_eq!(found, expected, max_relative = 1e-3);
    }
    for (k, level) in (1..).zip(&found.levels()[1..]) {
        let [one, two] = factors((f64::from(k) / (levels - 1) as f64).powi(2));
        let side = size >> k;
        for (index, found) in level.value().data().iter().enumerate() {
            let ([x, _, z], _) = texel(index, side);
            let expected = 4.0 / 3.0 + one * x + two * (z * z - 1.0 / 3.0);
            // The sky's contrast is 9/4.
            let error = (found - expected).abs() / 2.25;
            assert!(error < 0.0025, "level {k} is off by {error} at {index}");
        }
    }
}

#[test]
fn gradients_of_texels_are_the_adjoint_of_what_surfaces_see() {
    let tape = Tape::<f64>::new();
    let prefilter = Prefilter::new(8, 3).unwrap();
    let of = |k: usize| Tensor::from_flat_fn([6, 8, 8, 2], |i| ((3 * i + k) as f64).sin());
    let [x, y] = [of(0), of(5)].map(|texels| tape.leaf(&texels));
    let seen = |texels| {
        let map = prefilter.cube_map(texels).unwrap();
        [map.levels()[1], map.levels()[2], prefilter.harmonics(texels).unwrap()]
    };
    for (of_x, of_y) in seen(x).into_iter().zip(seen(y)) {
        // <A x, A y> = <x, A^T A y>
        let bars = tape.vjp(&[(of_x, &of_y.value())]).unwrap().get_or_zeros(x);
        let product = |a: &Tensor<f64>, b: &Tensor<f64>| {
            a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum::<f64>()
        };
        let (found, expected) = (product(&bars, &x.value()), product(&of_x.value(), &of_y.value()));
        assert_abs_diff_eq!(found, expected, epsilon = 1e-10 * expected.abs().max(1.0));
    }
}

#[test]
fn what_nothing_can_be_made_of_is_refused() {
    let tape = Tape::<f64>::new();
    let made = |extent, levels| Prefilter::<f64>::new(extent, levels).unwrap_err().to_string();
    let rule = "prefilter needs an extent that is a power of two up to 256, got";
    assert_eq!(made(0, 1), format!("{rule} 0"));
    assert_eq!(made(24, 1), format!("{rule} 24"));
    assert_eq!(made(512, 1), format!("{rule} 512"));
    assert_eq!(made(16, 0), "prefilter needs from 1 to 5 levels for an extent of 16, got 0");
    assert_eq!(made(16, 6), "prefilter needs from 1 to 5 levels for an extent of 16, got 6");
    let prefilter = Prefilter::new(4, 2).unwrap();
    let texels = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let rule = "prefilter needs texels of shape [6, 4, 4, C], with a channel, got shape";
    for shape in [&[6, 8, 8, 3][..], &[6, 4, 4, 0], &[4, 4, 3]] {
        let found = Environment::from_texels(texels(shape), &prefilter).unwrap_err().to_string();
        assert_eq!(found, format!("{rule} {}", texels(shape).shape()));
        assert_eq!(prefilter.cube_map(texels(shape)).unwrap_err().to_string(), found);
    }
}

#[test]
fn no_rows_and_no_channels_are_none() {
    let tape = Tape::<f64>::new();
    let coefficients = tape.leaf(&Tensor::full([9, 3], 0.5));
    let out = irradiance(coefficients, rows(&tape, &[])).unwrap();
    assert_eq!(*out.shape(), [0, 3]);
    assert_eq!(out.sum().backward().unwrap().get_or_zeros(coefficients), Tensor::zeros([9, 3]));
    let none = irradiance(tape.leaf(&Tensor::zeros([9, 0])), rows(&tape, &NORMALS)).unwrap();
    assert_eq!(*none.shape(), [4, 0]);
    assert!(none.sum().backward().is_ok());
}
