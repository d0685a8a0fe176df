//! Errors with weights and with masks.

use bokashi_check::strategy::{around, number, tensor};
use bokashi_check::{Case, Input, subject};
use bokashi_fit::{Penalty, masked_error, weighted_error};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};
use crate::references::{MANY, ROWS, SMALL, kinked, large, laws, pair, two_of_three};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("weighted_error");
    subject!(Weighted: |x| weighted_error(x[0], x[1], x[2], Penalty::Squared)?);
    subject!(WeightedHuber: |x| {
        let penalty = Penalty::Huber { delta: 0.5 };
        let error = weighted_error(x[0], x[1], x[2], penalty)?;
        kinked(error, x[0] - x[1], &[-0.5, 0.5])
    });
    subject!(Masked: |x| {
        let mask = two_of_three(&x[0].shape()[..2]);
        masked_error(x[0], x[1], &mask, Penalty::Squared)?
    });
    let weighted = || {
        let weights = tensor([3, 2], (0.1..2.0).boxed());
        let inputs = (pair(SMALL, around(&[0.5], -2.0..2.0)), weights);
        inputs.prop_map(|(mut inputs, weights)| {
            inputs.push(Input::leaf(weights));
            inputs
        })
    };
    let by = |weights: Input| Case::new(Weighted, [leaf([2, 3], 1.0), leaf([2, 3], 0.5), weights]);
    let check = laws("weighted error", Weighted, weighted().boxed(), large(&[MANY, MANY, ROWS]))
        .refuses(
            "mean_squared_error needs weights of the shape of the image, or of its first axes, \
             got shapes [2, 3] and [3]",
            by(leaf([3], 1.0)),
        )
        .refuses("mean_squared_error needs weights of a finite sum, got inf", by(leaf([2], 1e308)));
    entry.check([-1.0, f64::NAN, f64::INFINITY].into_iter().fold(check, |check, bad| {
        let message = format!("mean_squared_error needs finite weights from 0 up, got {bad}");
        check.refuses(message, by(with_one([2], 1, bad)))
    }));
    let many = large(&[MANY, MANY, ROWS]);
    entry.check(laws("weighted Huber error", WeightedHuber, weighted().boxed(), many));
    entry.check(laws("masked error", Masked, pair(SMALL, number()), large(&[MANY; 2])));
    benchmark!(entry, "mean_squared_error, weighted", |s| [s.image, s.aliased, s.image], |x| {
        weighted_error(x[0], x[1], x[2], Penalty::Squared)?
    });
    entry
}
