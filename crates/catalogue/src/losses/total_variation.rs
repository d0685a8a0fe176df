//! Regularizers of textures.

use bokashi_check::strategy::tensor;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject, subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{Penalty, total_variation};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::references::{large, laws};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("total_variation");
    let smooth = Smooth(Penalty::Charbonnier { scale: 0.1 });
    subject!(Plain: |x| {
        let texture = x[0].value();
        let [height, width, channels] = [0, 1, 2].map(|axis| texture.shape()[axis]);
        let mut rises = Vec::new();
        for i in 0..height {
            for j in 0..width {
                for c in 0..channels {
                    let texel = texture[[i, j, c]];
                    rises.push(i + 1 < height && texture[[i + 1, j, c]] > texel);
                    rises.push(j + 1 < width && texture[[i, j + 1, c]] > texel);
                }
            }
        }
        Outcome::from(total_variation(x[0], Penalty::Absolute)?).with_state(rises)
    });
    // Of equal neighbours, or nearly so, there are enough by chance.
    let texture = |shape: &'static [usize]| {
        tensor(shape, (0.0..3.0).boxed()).prop_map(|x| vec![Input::leaf(x)]).boxed()
    };
    let many = || large(&[&[70, 90, 3][..]]);
    entry.check(refusing(laws("total variation", smooth, texture(&[4, 3, 2]), many())));
    entry.check(laws("total variation of rows", smooth, texture(&[1, 5, 1]), many()));
    entry.check(laws("plain total variation", Plain, texture(&[3, 4, 1]), many()));
    benchmark!(entry, "total_variation", |s| [s.image], |x| {
        total_variation(x[0], Penalty::Absolute)?
    });
    entry
}

/// Total variation by a penalty without a kink.
#[derive(Debug, Clone, Copy)]
struct Smooth(Penalty);

impl Subject for Smooth {
    /// A texture.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(total_variation(inputs[0], self.0)?.into())
    }
}

fn refusing(check: Check) -> Check {
    let by =
        |penalty, shape: &[usize]| Case::new(Smooth(penalty), [Input::leaf(Tensor::zeros(shape))]);
    let check = [&[0, 3, 1][..], &[3, 3], &[2, 2, 0]].into_iter().fold(check, |check, shape| {
        let rule = "total_variation needs a texture [H, W, C] of at least one entry";
        check.refuses(format!("{rule}, got shape {shape:?}"), by(Penalty::Absolute, shape))
    });
    let check = [-1.0, 0.0, f64::NAN, f64::INFINITY].into_iter().fold(check, |check, bad| {
        let message = |name: &str| {
            let rule = format!("a finite {name} above 0 in the precision of the fit");
            format!("total_variation needs {rule}, got {bad}")
        };
        check
            .refuses(message("scale"), by(Penalty::Charbonnier { scale: bad }, &[2, 2, 1]))
            .refuses(message("delta"), by(Penalty::Huber { delta: bad }, &[2, 2, 1]))
    });
    check.refuses(
        "total_variation needs a penalty of differences alone, and no relative one, got 0.01",
        by(Penalty::Relative { epsilon: 0.01 }, &[2, 2, 1]),
    )
}
