//! Regularizers of textures.

use bokashi_check::strategy::tensor;
use bokashi_check::{Case, Input, Outcome, subject};
use bokashi_fit::{Penalty, total_variation};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{large, laws};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("total_variation");
    subject!(Smooth: |x| total_variation(x[0], Penalty::Charbonnier { scale: 0.1 })?);
    subject!(Plain: |x| {
        let texture = x[0].value();
        let [height, width, channels] = [0, 1, 2].map(|axis| texture.shape()[axis]);
        let mut rises = Vec::new();
        for i in 0..height {
            for j in 0..width {
                for c in 0..channels {
                    let own = texture[[i, j, c]];
                    rises.push(i + 1 < height && texture[[i + 1, j, c]] > own);
                    rises.push(j + 1 < width && texture[[i, j + 1, c]] > own);
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
    entry.check(
        laws("total variation", Smooth, texture(&[4, 3, 2]), many())
            .refuses("a matrix", Case::new(Smooth, vec![leaf([3, 3], 1.0)])),
    );
    entry.check(laws("total variation of rows", Smooth, texture(&[1, 5, 1]), many()));
    entry.check(laws("plain total variation", Plain, texture(&[3, 4, 1]), many()));
    entry
}
