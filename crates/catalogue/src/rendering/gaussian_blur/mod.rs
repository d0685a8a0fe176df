//! Images blurred by a sigma, by windows, by tridiagonal systems and by discs.

mod extremes;

use bokashi_check::strategy::{image, sigma};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Blur, Border, Kernel, Radius, RenderError, gaussian_blur};
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("gaussian_blur").with_extremes(extremes::EXTREMES);
    gaussian_blur_of_an_image_by_a_sigma(&mut entry);
    gaussian_blur_by_tridiagonal_systems(&mut entry);
    gaussian_blur_by_a_window_that_sees_the_whole_image(&mut entry);
    gaussian_blur_by_a_disc(&mut entry);
    gaussian_blur_by_a_disc_at_half_the_size(&mut entry);
    benchmark!(entry, "gaussian_blur", |s| [s.image, Tensor::scalar(2.0)], |x| {
        gaussian_blur(x[0], x[1], &Blur::default())?
    });
    benchmark!(entry, "gaussian_blur, a disc", |s| [s.image, Tensor::scalar(2.0)], |x| {
        gaussian_blur(x[0], x[1], &Blur { kernel: Kernel::Disc, ..Blur::default() })?
    });
    entry
}

#[derive(Debug)]
struct GaussianBlur {
    blur: Blur,
}

impl Subject for GaussianBlur {
    /// An image and a sigma.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let state = match (self.blur.kernel, self.blur.radius) {
            (Kernel::Disc, _) => touched_pixels(inputs[1], &self.blur)?,
            // Where the window is fixed, taps that are cut off as negligible are no kink.
            (_, Radius::Fixed(_)) => 0,
            (_, Radius::Tolerance(_)) => reach(inputs[1], &self.blur)?,
        };
        let image = gaussian_blur(inputs[0], inputs[1], &self.blur)?;
        Ok(Outcome::from(image).with_state(state))
    }
}

/// The number of taps of a window: the pixels that an impulse reaches. On a tape of its own, so
/// that a refusal leaves the other as it was.
fn reach<T: Scalar>(sigma: Var<'_, T>, blur: &Blur) -> Result<usize, RenderError> {
    let tape = Tape::new();
    let impulse = Tensor::from_flat_fn([1, 201, 1], |k| T::from_f64(f64::from(u8::from(k == 100))));
    let blur = Blur { border: Border::Zero, ..*blur };
    let out = gaussian_blur(tape.constant(&impulse), tape.constant(&sigma.value()), &blur)?;
    Ok(out.value().data().iter().filter(|&&entry| entry != T::ZERO).count())
}

/// The number of pixels that a disc touches: the rim passes a corner or a side where it changes.
fn touched_pixels<T: Scalar>(sigma: Var<'_, T>, blur: &Blur) -> Result<usize, RenderError> {
    let tape = Tape::new();
    // A disc reaches 2 sigma, and a little farther where it is blurred at half the size. An error is left to the
    // image's own blur.
    let value = sigma.value().data()[0].to_f64();
    let reach = if value < 100.0 { 2.0 * value } else { 0.0 };
    let reach = reach as usize + 8;
    let side = 2 * reach + 1;
    let center = reach * side + reach;
    let impulse = |k: usize| T::from_f64(f64::from(u8::from(k == center)));
    let impulse = Tensor::from_flat_fn([side, side, 1], impulse);
    let blur = Blur { border: Border::Zero, ..*blur };
    let out = gaussian_blur(tape.constant(&impulse), tape.constant(&sigma.value()), &blur)?;
    Ok(out.value().data().iter().filter(|&&entry| entry != T::ZERO).count())
}

fn gaussian_blur_of_an_image_by_a_sigma(entry: &mut Entry) {
    // Radii that are smaller and larger than the image, and one by tolerance.
    for radius in [Radius::Fixed(2), Radius::Fixed(12), Radius::Tolerance(1e-4)] {
        for kernel in [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete] {
            let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
            let cases = (borders, image(), sigma()).prop_map(move |(border, image, sigma)| {
                // The unnormalized kernel's gain at smaller ones is 1 / sigma^2.
                let sigma = if kernel == Kernel::Unnormalized { sigma.max(0.3) } else { sigma };
                let inputs = [image, Tensor::scalar(sigma)].map(Input::leaf);
                Case::new(GaussianBlur { blur: Blur { kernel, border, radius } }, inputs)
            });
            let blur = Blur { kernel, border: Border::Mirror, radius };
            let name = format!("gaussian_blur, {kernel:?}, {radius:?}");
            let check = Check::from_cases(name, cases).large(1, Just(large_blur(blur)));
            entry.check(refusing(check, blur));
        }
    }
}

/// Sigmas, shapes, radii and tolerances that no blur of a kernel can be made by.
fn refusing(check: Check, blur: Blur) -> Check {
    let of = |blur: Blur, image: &[usize], sigma: Input| {
        Case::new(GaussianBlur { blur }, [Input::leaf(Tensor::full(image, 0.5)), sigma])
    };
    let by = |sigma| of(blur, &[3, 3, 1], leaf([], sigma));
    let (rule, limits): (_, &[f64]) = match blur.kernel {
        Kernel::Unnormalized => {
            let rule = "a finite and positive sigma for the unnormalized kernel";
            (rule, &[0.0, -0.0, -1.0, f64::NAN, f64::INFINITY])
        }
        _ => {
            let rule = "a finite sigma of at least 0";
            (rule, &[-1.0, -1e-300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY])
        }
    };
    let check = limits.iter().fold(check, |check, &sigma| {
        check.refuses(format!("gaussian_blur needs {rule}, got sigma {sigma}"), by(sigma))
    });
    let check = match blur.kernel {
        Kernel::Unnormalized => {
            let rule = "a sigma at which the unnormalized kernel does not overflow";
            check.refuses(format!("gaussian_blur needs {rule}, got sigma {}", 1e-200), by(1e-200))
        }
        Kernel::Disc => {
            let message =
                "gaussian_blur needs a sigma of at most 1024 for a disc, got sigma 1024.5";
            check.refuses(message, by(1024.5))
        }
        _ => check,
    };
    let check = match blur {
        Blur { kernel: Kernel::Disc, radius: Radius::Fixed(_), .. } => {
            let rule = "a disc that lies within the fixed radius, and within 512 pixels";
            check.refuses(format!("gaussian_blur needs {rule}, got sigma 5"), by(5.0))
        }
        _ => check,
    };
    // At sigma 0 too, where the blur is the identity.
    let sigma = if blur.kernel == Kernel::Unnormalized { 2.0 } else { 0.0 };
    let shapes = [&[3, 3][..], &[3, 3, 0], &[0, 3, 1], &[3, 3, 1, 1]];
    let check = shapes.into_iter().fold(check, |check, shape| {
        let rule = "gaussian_blur needs an image of shape [H, W, C] with at least one entry";
        check.refuses(format!("{rule}, got shape {shape:?}"), of(blur, shape, leaf([], sigma)))
    });
    let check = check.refuses(
        "gaussian_blur needs a single number for sigma, got shape [2]",
        of(blur, &[3, 3, 1], leaf([2], 1.0)),
    );
    let with = |radius| of(Blur { radius, ..blur }, &[3, 3, 1], leaf([], sigma));
    let check = [0.0, -1.0, 1.0, 2.0, f64::NAN].into_iter().fold(check, |check, tolerance| {
        let message = format!("gaussian_blur needs a tolerance between 0 and 1, got {tolerance}");
        check.refuses(message, with(Radius::Tolerance(tolerance)))
    });
    check.refuses(
        "gaussian_blur needs a window radius of at most 16384 pixels, got 16385",
        with(Radius::Fixed(16_385)),
    )
}

fn gaussian_blur_by_tridiagonal_systems(entry: &mut Entry) {
    // Tolerances and the number of poles that each takes, conjugates left out.
    let tolerances = || select(&[(1e-2, 2), (1e-3, 2), (1e-4, 3), (1e-5, 3), (1e-6, 4)][..]);
    let borders = || select(&[Border::Zero, Border::Mirror][..]);
    // Taps of a window along an axis; with twice as many along both the systems take as long.
    let least = |poles: usize| 34 + 5 * poles;
    // `reach` is how far a window would have to reach, as a share of these taps.
    let by =
        move |border, (tolerance, poles): (f64, usize), [height, width]: [usize; 2], reach: f64| {
            let blur =
                Blur { kernel: Kernel::Discrete, border, radius: Radius::Tolerance(tolerance) };
            let image = Input::leaf(Tensor::from_flat_fn([height, width, 1], motley));
            let sigma = reach * least(poles) as f64 / (-2.0 * tolerance.ln()).sqrt();
            Case::new(GaussianBlur { blur }, [image, leaf([], sigma)])
        };
    let cases = (borders(), tolerances(), [1..=5_usize, 1..=5_usize], 1.03..2.0_f64).prop_map(
        move |(border, tolerance, more, reach)| {
            by(border, tolerance, more.map(|more| least(tolerance.1) + more), reach)
        },
    );
    let large = by(Border::Mirror, (1e-6, 4), [154, 134], 1.5);
    let check = Check::from_cases("gaussian_blur by tridiagonal systems", cases);
    entry.check(check.large(1, Just(large)));
    // Across such a line the lines have one position, which is both of their ends.
    let lines = (borders(), tolerances(), any::<bool>(), 0..=3_usize, 2.1..3.0_f64).prop_map(
        move |(border, tolerance, is_column, more, reach)| {
            let length = 2 * least(tolerance.1) + more;
            by(border, tolerance, if is_column { [length, 1] } else { [1, length] }, reach)
        },
    );
    entry.check(Check::from_cases("gaussian_blur of a line by tridiagonal systems", lines));
}

fn gaussian_blur_by_a_disc(entry: &mut Entry) {
    // Discs that reach no corner of their pixel, discs of some pixels, and discs wider than the image.
    let sigmas = prop_oneof![2 => 0.02..0.42_f64, 4 => 0.44..2.0_f64, 1 => 2.0..3.9_f64];
    for radius in [Radius::Fixed(8), Radius::Tolerance(1e-4)] {
        let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
        let cases = (borders, image(), sigmas.clone()).prop_map(move |(border, image, sigma)| {
            let inputs = [image, Tensor::scalar(sigma)].map(Input::leaf);
            let blur = Blur { kernel: Kernel::Disc, border, radius };
            Case::new(GaussianBlur { blur }, inputs)
        });
        let blur = Blur { kernel: Kernel::Disc, border: Border::Mirror, radius };
        let name = format!("gaussian_blur, Disc, {radius:?}");
        let check = Check::from_cases(name, cases).large(1, Just(large_blur(blur)));
        entry.check(refusing(check, blur));
    }
}

fn gaussian_blur_by_a_disc_at_half_the_size(entry: &mut Entry) {
    let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
    let by = |border, size: [usize; 2], sigma: f64| {
        let blur = Blur { kernel: Kernel::Disc, border, radius: Radius::Tolerance(0.15) };
        let [height, width] = size;
        let image = Input::leaf(Tensor::from_flat_fn([height, width, 2], motley));
        Case::new(GaussianBlur { blur }, [image, leaf([], sigma)])
    };
    // Halved once, and twice from a sigma of 8.1 on.
    let sigmas = prop_oneof![3 => 4.1..7.9_f64, 1 => 8.2..10.0_f64];
    let cases = (borders, [1..=20_usize, 1..=20_usize], sigmas)
        .prop_map(move |(border, size, sigma)| by(border, size, sigma));
    entry.check(
        Check::from_cases("gaussian_blur by a disc at half the size", cases)
            .cases(12)
            .large(1, Just(by(Border::Mirror, [150, 131], 6.0))),
    );
}

fn gaussian_blur_by_a_window_that_sees_the_whole_image(entry: &mut Entry) {
    let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
    // Beyond the widest window that is summed tap by tap.
    let cases = (borders, image(), 4e3..3e4_f64).prop_map(|(border, image, sigma)| {
        let blur = Blur { border, ..Blur::default() };
        Case::new(GaussianBlur { blur }, [Input::leaf(image), leaf([], sigma)])
    });
    entry.check(Check::from_cases("gaussian_blur by a window that sees the whole image", cases));
}

/// An image that is blurred in several pieces.
fn large_blur(blur: Blur) -> Case {
    let image = Input::leaf(Tensor::from_flat_fn([150, 130, 3], motley));
    Case::new(GaussianBlur { blur }, [image, leaf([], 1.7)])
}
