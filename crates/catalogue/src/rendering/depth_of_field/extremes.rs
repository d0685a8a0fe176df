//! What a lens makes of depths at its focus, at the eye, at infinity.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Blur, DepthImage, Focused, Iris, Lens, LensOptions, Radius, RenderError, depth_of_field,
    gaussian_blur,
};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    46 "depth of field in focus", "the identity", in_focus;
    47 "depth -> 0", "capped, counted", depth_to_zero;
    48 "aperture 0", "the operation is absent", aperture_zero;
};

const SHAPE: [usize; 3] = [5, 7, 2];
const POLYGON: Iris = Iris::Polygon { blades: 3, rotation: 0.2 };

/// An image, its depths, and a lens focused at 2 with an aperture of 1.5 pixels.
struct LensView<'t, T: Scalar> {
    image: Var<'t, T>,
    depth: Var<'t, T>,
    aperture: Var<'t, T>,
    focus: Var<'t, T>,
}

impl<'t, T: Scalar> LensView<'t, T> {
    fn focused(&self, options: &LensOptions) -> Result<Focused<'t, T>, RenderError> {
        let lens = Lens { aperture: self.aperture, focus: self.focus };
        depth_of_field(self.image, DepthImage::from_distances(self.depth), lens, options)
    }

    fn new(tape: &'t Tape<T>, depth: impl Fn(usize) -> f64) -> Self {
        Self {
            image: tape.leaf(&Tensor::from_flat_fn(SHAPE, |k| T::from_f64(motley(k)))),
            depth: tape.leaf(&Tensor::from_flat_fn([5, 7], |k| T::from_f64(depth(k)))),
            aperture: tape.leaf_scalar(T::from_f64(1.5)),
            focus: tape.leaf_scalar(T::from_f64(2.0)),
        }
    }

    /// The largest gradients with respect to depth, aperture and focus, for a motley upstream.
    fn largest_bar(&self, out: Var<'t, T>) -> Result<f64, Failure> {
        let upstream = Tensor::from_flat_fn(SHAPE, |k| T::from_f64(motley(5 * k + 2)));
        let gradients = out.tape().vjp(&[(out, &upstream)])?;
        let leaves = [self.depth, self.aperture, self.focus];
        Ok(largest(leaves.map(|leaf| largest(numbers(&gradients.get_or_zeros(leaf))))))
    }
}

fn in_focus<T: Scalar>() -> Outcome {
    let (mut error, mut capped) = (0.0_f64, 0);
    for iris in [None, Some(Iris::Disc), Some(POLYGON)] {
        let tape = Tape::<T>::new();
        let view = LensView::new(&tape, |_| 2.0);
        let found = view.focused(&LensOptions { iris, ..LensOptions::default() })?;
        let off = difference(&numbers(&found.image.value()), &numbers(&view.image.value()));
        error = error.maximum_or_nan(off).maximum_or_nan(view.largest_bar(found.image)?);
        capped += found.capped;
    }
    Ok(Verdict::within("the image to the bit, no gradient to the depth", error, 0.0)
        .and(capped == 0, "pixels are counted as capped"))
}

/// How far the windows of `gathered` reach.
const RADIUS: isize = 9;

/// Each pixel of `image`, of shape `SHAPE`, as the sum over all taps of its own window, of standard
/// deviation `sigma(pixel)`, mirrored at the border.
fn gathered(image: &[f64], sigma: impl Fn(usize) -> f64) -> Vec<f64> {
    let [height, width, channels] = SHAPE.map(|extent| extent as isize);
    let mirrored = |at: isize, extent: isize| {
        let phase = at.rem_euclid(2 * extent);
        phase.min(2 * extent - 1 - phase)
    };
    let entry = |k: usize| {
        let (pixel, channel) = (k as isize / channels, k as isize % channels);
        let sigma = sigma(pixel as usize);
        if sigma == 0.0 {
            return image[k];
        }
        let weight = |k: isize| f64::exp(-0.5 * (k as f64 / sigma).powi(2));
        let (mut sum, mut total) = (0.0, 0.0);
        for down in -RADIUS..=RADIUS {
            for across in -RADIUS..=RADIUS {
                let row = mirrored(pixel / width + down, height);
                let column = mirrored(pixel % width + across, width);
                let share = weight(down) * weight(across);
                sum += share * image[((row * width + column) * channels + channel) as usize];
                total += share;
            }
        }
        sum / total
    };
    (0..image.len()).map(entry).collect()
}

fn depth_to_zero<T: Scalar>() -> Outcome {
    let options = LensOptions { largest_sigma: 4.0, ..LensOptions::default() };
    // At the eye, at denormal distances, near, and with some pixels at infinity: sigma there is 1.5.
    let depths = [0.0, -0.0, 1e-40, 1e-6, 3.0, f64::INFINITY, 2.0];
    let tape = Tape::<T>::new();
    let some = LensView::new(&tape, |k| depths[k % 7]);
    let exact = LensOptions { radius: Radius::Fixed(RADIUS as usize), ..options };
    let mixed = some.focused(&exact)?;
    let through = some.focused(&LensOptions { iris: Some(POLYGON), ..options })?;
    let mut finite = through.capped == mixed.capped;
    for image in [mixed.image, through.image] {
        finite &= image.value().is_finite() && some.largest_bar(image)?.is_finite();
    }
    // |1 - 2 / z| times the aperture, and no more than the cap.
    let sigmas = [4.0, 4.0, 4.0, 4.0, 0.5, 1.5, 0.0];
    let image = numbers(&some.image.value());
    let mut error =
        difference(&numbers(&mixed.image.value()), &gathered(&image, |k| sigmas[k % 7]));
    let mut share = 0.0_f64;
    for (depth, sigma, capped) in [(0.0, 4.0, 35), (1e-40, 4.0, 35), (f64::INFINITY, 1.5, 0)] {
        // By windows, and by a ladder of blurs within its tolerance.
        for (options, off) in [(&exact, &mut error), (&options, &mut share)] {
            let tape = Tape::<T>::new();
            let view = LensView::new(&tape, |_| depth);
            let found = view.focused(options)?;
            let sigma = tape.leaf_scalar(T::from_f64(sigma));
            let blur = Blur { radius: options.radius, ..Blur::default() };
            let blurred = numbers(&gaussian_blur(view.image, sigma, &blur)?.value());
            *off = off
                .maximum_or_nan(difference(&numbers(&found.image.value()), &blurred))
                .maximum_or_nan(found.capped.abs_diff(capped) as f64);
        }
    }
    Ok(Verdict::within(
        "capped as a blur by the cap, and counted; mixed, each the sum over its taps",
        error,
        16.0 * rounding::<T>(),
    )
    .and(share <= 1e-3, format!("the ladder is off by {share:.1e}"))
    .and(mixed.capped == 20, format!("{} of 20 pixels are counted", mixed.capped))
    .and(finite, "a number is not finite, or an iris counts others"))
}

fn aperture_zero<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut view = LensView::new(&tape, |k| 0.3 * k as f64);
    view.aperture = tape.leaf_scalar(T::ZERO);
    let before = tape.len();
    let found = view.focused(&LensOptions::default())?;
    let error = difference(&numbers(&found.image.value()), &numbers(&view.image.value()));
    let left_out = format!("{:?}", tape.take_report()).contains("aperture is 0");
    Ok(Verdict::within("the image itself, nothing recorded, and the report says so", error, 0.0)
        .and(tape.len() == before, "something was recorded")
        .and(left_out, "the report does not say so"))
}
