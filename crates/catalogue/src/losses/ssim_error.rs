//! Structural similarity, on one scale and on several.

use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{multiscale_ssim_error, ssim_error};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::references::{large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("ssim_error");
    let ssim = Similarity { peak: 1.0, levels: None };
    let unit = || (0.0..1.0).boxed();
    let check = laws("ssim", ssim, pair(&[12, 13, 2], unit()), large(&[&[60, 90, 1][..]; 2]));
    entry.check(ssim_refuses(check));
    let flat = pair(&[11, 12, 1], (0.5..0.501).boxed());
    entry.check(laws("ssim of flat images", ssim, flat, large(&[&[50, 30, 2][..]; 2])));
    // Alike: where the mean of a level is near 0, a power of it bends too much for difference quotients.
    let alike = pair(&[21, 22, 1], unit()).prop_map(|mut inputs| {
        let [x, y] = [0, 1].map(|k| inputs[k].tensor.clone());
        let mixed = Tensor::from_flat_fn(x.shape(), |k| 0.6 * x.data()[k] + 0.4 * y.data()[k]);
        inputs[1].tensor = mixed;
        inputs
    });
    let multiscale = Similarity { peak: 1.0, levels: Some(Some(2)) };
    let check = laws("ms-ssim", multiscale, alike.boxed(), large(&[&[50, 70, 1][..]; 2]));
    entry.check(multiscale_refuses(check));
    benchmark!(entry, "ssim_error", |s| [s.image, s.aliased], |x| ssim_error(x[0], x[1], 1.0)?);
    entry
}

/// The similarity on one scale, or on as many as there are, or on a number of them.
#[derive(Debug, Clone, Copy)]
struct Similarity {
    peak: f64,
    levels: Option<Option<usize>>,
}

impl Subject for Similarity {
    /// Two images.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (x, y) = (inputs[0], inputs[1]);
        Ok(match self.levels {
            None => ssim_error(x, y, self.peak)?.into(),
            Some(levels) => multiscale_ssim_error(x, y, self.peak, levels)?.into(),
        })
    }
}

fn zeros(shapes: [&[usize]; 2]) -> Vec<Input> {
    shapes.map(|shape| Input::leaf(Tensor::zeros(shape))).to_vec()
}

fn ssim_refuses(check: Check) -> Check {
    let by = |peak, shapes| Case::new(Similarity { peak, levels: None }, zeros(shapes));
    let small: [&[usize]; 5] = [&[10, 11, 1], &[11, 10, 1], &[11, 11, 0], &[11, 11], &[]];
    let check = small.into_iter().fold(check, |check, shape| {
        let rule = "ssim_error needs images [H, W, C] of at least 11 x 11 pixels, C > 0";
        check.refuses(format!("{rule}, got shape {shape:?}"), by(1.0, [shape, shape]))
    });
    let check = check.refuses(
        "ssim_error needs two images of one shape, got shapes [11, 12, 1] and [12, 11, 1]",
        by(1.0, [&[11, 12, 1], &[12, 11, 1]]),
    );
    let peaks = [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-200, 1e200];
    peaks.into_iter().fold(check, |check, peak| {
        let rule = "ssim_error needs a peak above 0 whose square is a number, got";
        check.refuses(format!("{rule} {peak}"), by(peak, [&[11, 11, 1], &[11, 11, 1]]))
    })
}

fn multiscale_refuses(check: Check) -> Check {
    let by = |levels, shape: &[usize]| {
        Case::new(Similarity { peak: 1.0, levels: Some(levels) }, zeros([shape, shape]))
    };
    let least = "images [H, W, C] of at least";
    let rows = [
        ("from 1 to 5 levels, got 0".to_owned(), by(Some(0), &[200, 200, 1])),
        ("from 1 to 5 levels, got 6".to_owned(), by(Some(6), &[200, 200, 1])),
        (
            format!("{least} 161 x 161 pixels for 5 levels, got shape [160, 200, 1]"),
            by(Some(5), &[160, 200, 1]),
        ),
        (
            format!("{least} 11 x 11 pixels for 1 level, got shape [10, 11, 1]"),
            by(None, &[10, 11, 1]),
        ),
        (format!("{least} 11 x 11 pixels for 1 level, got shape [40, 40]"), by(None, &[40, 40])),
    ];
    rows.into_iter().fold(check, |check, (rule, case)| {
        check.refuses(format!("multiscale_ssim_error needs {rule}"), case)
    })
}
