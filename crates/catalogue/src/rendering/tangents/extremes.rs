//! Texture coordinates that give no direction, and any size of what does.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Mesh, tangents};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{motley, numbers, rounding};
use crate::surfaces::sheet;

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    147 "tangents: without a direction", "(0, 0, 0, 1), no gradient", no_tangent;
    148 "tangents: times 2^k, u sheared", "the same bits, no gradient of u", tangents_any_size;
};

/// Tangents of the sheet, and gradients of positions, normals and coordinates for motley upstream.
fn run_tangents<T: Scalar>(inputs: [&[f64]; 3]) -> Result<[Vec<f64>; 4], Failure> {
    let tape = Tape::<T>::new();
    let mesh = Mesh::new(sheet::<T>().1, 49)?;
    let leaf =
        |of: &[f64]| tape.leaf(&Tensor::from_flat_fn([49, of.len() / 49], |k| T::from_f64(of[k])));
    let [positions, normals, coordinates] = inputs.map(leaf);
    let out = tangents(positions, normals, coordinates, &mesh, &mesh)?;
    let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(motley(3 * k + 1)));
    let gradients = tape.vjp(&[(out, &upstream)])?;
    let [p, n, c] = [positions, normals, coordinates].map(|leaf| gradients.get_or_zeros(leaf));
    Ok([numbers(&out.value()), numbers(&p), numbers(&n), numbers(&c)])
}

/// Normals and texture coordinates of the sheet, as `T` holds them.
fn texture<T: Scalar>(positions: &[f64]) -> [Vec<f64>; 2] {
    let single = |x: f64| T::from_f64(x).to_f64();
    let normals = (0..147).map(|k| single(if k % 3 == 2 { 1.0 } else { 0.4 * motley(k) }));
    let coordinate = |k: usize| {
        let [x, y] = [positions[k / 2 * 3], positions[k / 2 * 3 + 1]];
        if k.is_multiple_of(2) { x + 0.2 * y } else { 0.9 - 0.8 * y + 0.1 * x }
    };
    [normals.collect(), (0..98).map(|k| single(coordinate(k))).collect()]
}

fn no_tangent<T: Scalar>() -> Outcome {
    let (positions, _) = sheet::<T>();
    let [normals, coordinates] = texture::<T>(&positions);
    let line: Vec<f64> = (0..98).map(|k| f64::from(1 + k % 2) * (k / 2 % 7) as f64).collect();
    let all_in_one = vec![0.3; 98];
    let (flat, gone) = (vec![0.5; 147], vec![0.0; 147]);
    let along_x: Vec<f64> =
        positions.iter().enumerate().map(|(k, x)| if k % 3 == 0 { *x } else { 0.0 }).collect();
    let mut wrong = 0;
    for inputs in [
        [&positions[..], &normals, &all_in_one],
        [&positions, &normals, &line],
        [&positions, &gone, &coordinates],
        [&flat, &normals, &coordinates],
        [&along_x, &normals, &coordinates],
    ] {
        let [found, bars @ ..] = run_tangents::<T>(inputs)?;
        let right = |(k, entry): (usize, &f64)| *entry == f64::from(u8::from(k % 4 == 3));
        wrong += found.iter().enumerate().filter(|&entry| !right(entry)).count();
        wrong += bars.iter().flatten().filter(|&&bar| bar != 0.0).count();
    }
    Ok(Verdict::exactly("(0, 0, 0, 1), zero gradients", wrong))
}

fn tangents_any_size<T: Scalar>() -> Outcome {
    let (positions, _) = sheet::<T>();
    let [normals, coordinates] = texture::<T>(&positions);
    let [expected, expected_bars @ ..] = run_tangents::<T>([&positions, &normals, &coordinates])?;
    let most = if rounding::<T>() < 1e-10 { 800 } else { 60 };
    let mut wrong = 0;
    for powers in [[most, -most, most], [-most, 3, -most], [0, most, 1]] {
        let scales = powers.map(|power| f64::powi(2.0, power));
        let scaled = |of: &[f64], input: usize| -> Vec<f64> {
            of.iter().map(|x| scales[input] * x).collect()
        };
        let [p, n, c] = [scaled(&positions, 0), scaled(&normals, 1), scaled(&coordinates, 2)];
        let [found, bars @ ..] = run_tangents::<T>([&p, &n, &c])?;
        wrong += usize::from(found != expected);
        for input in 0..3 {
            wrong += usize::from(scaled(&bars[input], input) != expected_bars[input]);
        }
        wrong += bars[2].iter().step_by(2).filter(|&&bar| bar != 0.0).count();
    }
    // Where v stays u grows, whatever is added to u along v.
    let shear = |(k, c): (usize, &f64)| if k % 2 == 0 { c + 0.5 * coordinates[k + 1] } else { *c };
    let sheared: Vec<f64> = coordinates.iter().enumerate().map(shear).collect();
    let [found, ..] = run_tangents::<T>([&positions, &normals, &sheared])?;
    wrong += usize::from(found != expected);
    Ok(Verdict::exactly("the same tangents, gradients times 2^-k", wrong))
}
