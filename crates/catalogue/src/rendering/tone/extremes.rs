//! Radiances from below 0 to far above 1.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{srgb_decode, srgb_encode};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{largest, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    168 "tone curves: below 0, above 1", "decoded, what was encoded", tone_curves;
};

fn tone_curves<T: Scalar>() -> Outcome {
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
    Ok(Verdict::within("decoded, what was encoded", largest(error), 32.0 * rounding::<T>()).and(
        bars.iter().all(|bar| (0.0..=12.93).contains(bar)),
        "a slope is outside of 0 to 12.92",
    ))
}
