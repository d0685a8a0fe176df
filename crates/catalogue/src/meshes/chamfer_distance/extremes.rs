//! Clouds that coincide, clouds of one point, and clouds of every size.

use bokashi_core::{Scalar, Tape};
use bokashi_mesh::{PointDistance, chamfer_distance};

use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{loss_and_gradients, motley, rounding, tensor};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    215 "Chamfer: one cloud twice, one point", "0, no gradient", coincident;
    216 "Chamfer: 1e-12 to 1e12", "proportional", sizes;
};

fn coincident<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for distance in [PointDistance::Euclidean, PointDistance::Squared] {
        for count in [1, 2, 40] {
            // All in one place, and no two.
            for entry in [|_| 0.3, motley as fn(usize) -> f64] {
                let tape = Tape::<T>::new();
                let [x, y] = [(); 2].map(|()| tape.leaf(&tensor(&[count, 3], entry)));
                let (loss, gradients) =
                    loss_and_gradients(chamfer_distance(x, y, distance)?, &[x, y])?;
                wrong += usize::from(loss != 0.0);
                wrong += gradients.iter().filter(|&&bar| bar != 0.0).count();
            }
        }
    }
    Ok(Verdict::exactly("0", wrong))
}

fn sizes<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for (distance, power) in [(PointDistance::Euclidean, 1), (PointDistance::Squared, 2)] {
        let at = |size: f64| {
            let tape = Tape::<T>::new();
            let [x, y] = [0, 1000].map(|first| {
                tape.leaf(&tensor(&[50, 3], |k| size * T::from_f64(motley(first + k)).to_f64()))
            });
            loss_and_gradients(chamfer_distance(x, y, distance)?, &[x, y])
        };
        let (usual, bars) = at(1.0)?;
        for exponent in [-40, 40] {
            let size = f64::powi(2.0, exponent);
            let (scaled, scaled_bars) = at(size)?;
            error = error.max((scaled / size.powi(power) / usual - 1.0).abs());
            for (bar, scaled) in bars.iter().zip(scaled_bars) {
                error = error.max((scaled / size.powi(power - 1) - bar).abs());
            }
        }
    }
    Ok(Verdict::within("powers of the size", error, 2.0 * rounding::<T>()))
}
