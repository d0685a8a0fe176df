//! Directions of any length, through edges and corners.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{CubeMap, Detail, Sampler, sample_cube_map};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{is_finite, largest, leaf, motley, rounding, rows, values_and_gradients};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    175 "cube maps: any length, corners", "the same bits, constants kept", cube_maps;
};

fn cube_maps<T: Scalar>() -> Outcome {
    let run = |extent: usize, constant: Option<f64>, scale: f64| {
        let tape = Tape::<T>::new();
        let entry = |k: usize| T::from_f64(constant.unwrap_or_else(|| motley(k)));
        let texels = tape.leaf(&Tensor::from_flat_fn([6, extent, extent, 2], entry));
        // Along the axes, through edges and corners, and beside them.
        let mut all = Vec::new();
        for k in 0..27 {
            let [x, y, z] = [k / 9, k / 3 % 3, k % 3].map(|at| at as f64 - 1.0);
            if [x, y, z] != [0.0; 3] {
                all.push([x, y, z].map(|x| scale * x));
                all.push([x + 0.0625, y, z - 0.0625].map(|x| scale * x));
                all.push([x, y * 0.5, z].map(|x| scale * x));
            }
        }
        let directions = rows(&tape, &all);
        let map = CubeMap::with_mipmaps(texels)?;
        let detail = Detail::Level(leaf(&tape, &[], &[0.25]));
        let out = sample_cube_map(&map, directions, detail, Sampler::new())?;
        let mut found = values_and_gradients(out, &[texels, directions])?;
        found[2].iter_mut().for_each(|bar| *bar *= scale);
        Ok::<_, Failure>(found)
    };
    let (mut error, mut wrong) = (0.0_f64, 0);
    let most = if rounding::<T>() < 1e-10 { 900 } else { 100 };
    for extent in [1, 2, 5] {
        let plain = run(extent, None, 1.0)?;
        wrong += usize::from(!is_finite(&plain));
        for power in [-most, -3, 40, most] {
            wrong += usize::from(run(extent, None, f64::powi(2.0, power))? != plain);
        }
        let flat = run(extent, Some(0.7), 1.0)?;
        let value = T::from_f64(0.7).to_f64();
        error = error.maximum_or_nan(largest(flat[0].iter().map(|entry| entry - value)));
        error = error.maximum_or_nan(largest(flat[2].iter().copied()));
    }
    Ok(Verdict::within("constants kept", error, 16.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} results depend on a direction's length")))
}
