//! Depths, up to scale and shift.

use bokashi_check::{Case, Outcome, subject};
use bokashi_core::{Scalar, Tensor, Var};
use bokashi_fit::{DepthAlignment, depth_error};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{kinked, large, laws, pair, two_of_three};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("depth_error");
    subject!(Plain: |x| {
        let mask = two_of_three(&x[0].shape());
        let error = depth_error(x[0], x[1], Some(&mask), DepthAlignment::None)?;
        kinked(error, x[0] - x[1], &[0.0])
    });
    /// On which side of its reference each aligned depth is.
    fn aligned_sides<T: Scalar>(d: Var<'_, T>, r: Var<'_, T>, has_shift: bool) -> Vec<bool> {
        let [d, r] = [d, r].map(|x| x.value().cast::<f64>());
        let mean = |x: &Tensor<f64>| {
            if has_shift { x.data().iter().sum::<f64>() / x.size() as f64 } else { 0.0 }
        };
        let (of_d, of_r) = (mean(&d), mean(&r));
        let pairs: Vec<_> =
            d.data().iter().zip(r.data()).map(|(d, r)| (d - of_d, r - of_r)).collect();
        let product: f64 = pairs.iter().map(|(d, r)| d * r).sum();
        let square: f64 = pairs.iter().map(|(d, _)| d * d).sum();
        pairs.iter().map(|(d, r)| product / square * d > *r).collect()
    }
    subject!(Scale: |x| {
        let error = depth_error(x[0], x[1], None, DepthAlignment::Scale)?;
        Outcome::from(error).with_state(aligned_sides(x[0], x[1], false))
    });
    subject!(ScaleAndShift: |x| {
        let error = depth_error(x[0], x[1], None, DepthAlignment::ScaleAndShift)?;
        Outcome::from(error).with_state(aligned_sides(x[0], x[1], true))
    });
    let depths = || pair(&[3, 4], (0.5..3.0).boxed());
    let many = || large(&[&[150, 121][..]; 2]);
    let apart = [leaf([2, 3], 1.0), leaf([3, 2], 1.0)];
    entry.check(laws("depth", Plain, depths(), many()).refuses(
        "depth_error needs depths and a reference of one shape, got shapes [2, 3] and [3, 2]",
        Case::new(Plain, apart),
    ));
    entry.check(laws("depth up to scale", Scale, depths(), many()));
    entry.check(laws("depth up to scale and shift", ScaleAndShift, depths(), many()));
    benchmark!(entry, "depth_error", |s| [s.distances[0], s.distances[1]], |x| {
        depth_error(x[0], x[1], None, DepthAlignment::ScaleAndShift)?
    });
    entry
}
