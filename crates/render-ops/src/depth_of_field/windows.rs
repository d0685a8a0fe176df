//! Each pixel by a window of its own.

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_two_pieces_mut;

use crate::border::Border;
use crate::taps::{Blur, Kernel, Radius, Taps};

/// Pixels in one piece of work.
const PIXELS_PER_PIECE: usize = 1 << 8;

/// The image `[H, W, C]` with each pixel blurred by its standard deviation in `sigmas`; and, unless it is
/// empty, the derivative of each entry of `out` with respect to the sigma of its pixel.
pub(super) fn blur<T: Scalar>(
    image: &[T],
    shape: &[usize],
    sigmas: &[T],
    radius: Radius,
    out: &mut [T],
    slopes: &mut [T],
) {
    let channels = shape[2];
    let piece = PIXELS_PER_PIECE * channels;
    let blur = |k: usize, out: &mut [T], slopes: &mut [T]| {
        let mut windows = Windows::<T>::new(shape, radius);
        let mut sums = vec![[T::Wide::ZERO; 2]; channels];
        for (k, pixel) in (k * PIXELS_PER_PIECE..).take(out.len() / channels).enumerate() {
            let center = &image[pixel * channels..][..channels];
            sums.fill([T::Wide::ZERO; 2]);
            windows.for_each_tap(pixel, sigmas[pixel], |j, w, slope| {
                let other = &image[j * channels..][..channels];
                for c in 0..channels {
                    let step = other[c].widen() - center[c].widen();
                    sums[c][0] += w.widen() * step;
                    sums[c][1] += slope.widen() * step;
                }
            });
            for c in 0..channels {
                out[k * channels + c] = T::narrow(center[c].widen() + sums[c][0]);
                if let Some(to) = slopes.get_mut(k * channels + c) {
                    *to = T::narrow(sums[c][1]);
                }
            }
        }
    };
    for_each_two_pieces_mut(out, slopes, [piece; 2], blur);
}

/// Adds to `image_bar` what the pixels' gradients `b_bar` say of the image.
pub(super) fn blur_adjoint<T: Scalar>(
    b_bar: &[T],
    shape: &[usize],
    sigmas: &[T],
    radius: Radius,
    image_bar: &mut [T],
) {
    // One thread: many windows add to a pixel, and the order must be the same.
    let channels = shape[2];
    let mut windows = Windows::<T>::new(shape, radius);
    for (pixel, &sigma) in sigmas.iter().enumerate() {
        let b_bar = &b_bar[pixel * channels..][..channels];
        for c in 0..channels {
            image_bar[pixel * channels + c] += b_bar[c];
        }
        windows.for_each_tap(pixel, sigma, |j, w, _| {
            for c in 0..channels {
                let share = w * b_bar[c];
                image_bar[j * channels + c] += share;
                image_bar[pixel * channels + c] -= share;
            }
        });
    }
}

/// The windows of pixels, one at a time.
struct Windows<T: Scalar> {
    height: usize,
    width: usize,
    blur: Blur,
    taps: [Taps<T>; 2],
}

impl<T: Scalar> Windows<T> {
    fn new(shape: &[usize], radius: Radius) -> Self {
        let blur = Blur { kernel: Kernel::Sampled, border: Border::Mirror, radius };
        let taps = [Taps::default(), Taps::default()];
        Self { height: shape[0], width: shape[1], blur, taps }
    }

    /// Calls `visit(j, w, dw/dsigma)` for each tap of the window with standard deviation `sigma`
    /// around `pixel`, j the pixel that it sees; for none where the window is a single pixel.
    fn for_each_tap(&mut self, pixel: usize, sigma: T, mut visit: impl FnMut(usize, T, T)) {
        if sigma == T::ZERO {
            return;
        }
        let filled = Taps::fill(&mut self.taps, sigma, &self.blur, [self.width, self.height]);
        filled.expect("a finite sigma above 0 has a window");
        let [along_rows, along_columns] = &self.taps;
        let reach = |taps: &Taps<T>| taps.radius() as isize;
        let (row, column) = ((pixel / self.width) as isize, (pixel % self.width) as isize);
        let source = |position, extent| {
            Border::Mirror.source(position, extent).expect("a mirror is endless")
        };
        for k in -reach(along_columns)..=reach(along_columns) {
            let y = source(row + k, self.height);
            let index = k.unsigned_abs();
            let (wy, dwy) = (along_columns.weights[index], along_columns.slopes[index]);
            for l in -reach(along_rows)..=reach(along_rows) {
                let j = y * self.width + source(column + l, self.width);
                if j != pixel {
                    let index = l.unsigned_abs();
                    let (wx, dwx) = (along_rows.weights[index], along_rows.slopes[index]);
                    visit(j, wy * wx, dwy * wx + wy * dwx);
                }
            }
        }
    }
}
