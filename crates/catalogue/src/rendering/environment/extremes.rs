//! Light that is the same from all sides.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Environment, Light, Prefilter, Surface, shade};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::materials::{ANGLES, all_materials, towards};
use crate::measures::{difference, largest, motley, numbers, rows, vector};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    169 "environments: constant, 1 texel", "the ambient light", environments;
};

fn environments<T: Scalar>() -> Outcome {
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
        for material in all_materials(&tape, [0.4, 0.5, 3.0]).0 {
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
    Ok(Verdict::within("the ambient light", error, 1e-5))
}
