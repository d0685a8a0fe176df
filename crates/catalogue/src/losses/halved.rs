//! Half an image, and errors on a pyramid of such.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Input, subject};
use bokashi_fit::{Penalty, halved, mean_error, pyramid_error};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("halved");
    subject!(Halved: |x| halved(x[0])?);
    subject!(Pyramid: |x| {
        pyramid_error(x[0], x[1], 3, |x, y| mean_error(x, y, Penalty::Squared))?
    });
    let image = tensor([5, 4, 2], number()).prop_map(|x| vec![Input::leaf(x)]).boxed();
    entry.check(laws("halved", Halved, image, large(&[&[70, 91, 6]])).refuses(
        "halved needs an image of shape [H, W, C], got shape [3, 3]",
        Case::new(Halved, vec![leaf([3, 3], 1.0)]),
    ));
    entry.check(laws(
        "pyramid",
        Pyramid,
        pair(&[5, 7, 1], number()),
        large(&[&[70, 61, 8][..]; 2]),
    ));
    benchmark!(entry, "halved", |s| [s.image], |x| halved(x[0])?);
    entry
}
