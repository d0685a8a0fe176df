//! Structural similarity, on one scale and on several.

use bokashi_check::{Case, subject};
use bokashi_core::Tensor;
use bokashi_fit::{multiscale_ssim_error, ssim_error};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("ssim_error");
    subject!(Ssim: |x| ssim_error(x[0], x[1], 1.0)?);
    subject!(Multiscale: |x| multiscale_ssim_error(x[0], x[1], 1.0, Some(2))?);
    let unit = || (0.0..1.0).boxed();
    let small = vec![leaf([10, 12, 1], 1.0), leaf([10, 12, 1], 1.0)];
    entry.check(
        laws("ssim", Ssim, pair(&[12, 13, 2], unit()), large(&[&[60, 90, 1][..]; 2]))
            .refuses("images smaller than a window", Case::new(Ssim, small)),
    );
    let flat = pair(&[11, 12, 1], (0.5..0.501).boxed());
    entry.check(laws("ssim of flat images", Ssim, flat, large(&[&[50, 30, 2][..]; 2])));
    // Alike: where the mean of a level is near 0, a power of it bends too much for difference quotients.
    let alike = pair(&[21, 22, 1], unit()).prop_map(|mut inputs| {
        let [x, y] = [0, 1].map(|k| inputs[k].tensor.clone());
        let mixed = Tensor::from_flat_fn(x.shape(), |k| 0.6 * x.data()[k] + 0.4 * y.data()[k]);
        inputs[1].tensor = mixed;
        inputs
    });
    entry.check(laws("ms-ssim", Multiscale, alike.boxed(), large(&[&[50, 70, 1][..]; 2])));
    entry
}
