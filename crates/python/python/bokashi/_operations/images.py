"""Images, and what they differ by."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING
from .step import Single, broadcast, plain, same, scalar

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike


def gaussian_blur(
    image: ArrayLike, sigma: ArrayLike, *, kernel: str = "sampled", border: str = "mirror", tolerance: float = 1e-6,
    radius: int | None = None,
) -> Single:
    """An image `[H, W, C]` blurred with standard deviation `sigma` in pixels, a number or `[]`.

    `kernel` is "sampled", "discrete", "unnormalized" or "disc"; `border` "mirror", "clamp" or "zero". The window misses
    at most the share `tolerance` of the weight, or reaches `radius` pixels. Gradients: of image and sigma.
    """

    def run(image: Any, sigma: Any) -> Any:
        return _native.gaussian_blur(image, sigma, kernel, border, tolerance, radius)

    return Single(run, [image, sigma], same)


def depth_of_field(
    image: ArrayLike, distances: ArrayLike, aperture: ArrayLike, focus: ArrayLike, *, largest_sigma: float = 32.0,
    tolerance: float = 1e-3, blades: int | None = None, rotation: float = 0.0,
) -> Single:
    """An image `[H, W, C]` as a lens sees it, with the distance of each pixel, `[H, W]`.

    `aperture` is the standard deviation in pixels of the blur at infinity, `focus` the distance that is sharp; both are
    numbers or `[]`. Blurs are Gaussian, up to `largest_sigma`. With `blades` they have the shape of the opening: 0 for
    a disc, 3 to 16 for a polygon. It is turned by `rotation` in radians. Gradients: of image, distances, aperture and
    focus.
    """

    def run(image: Any, distances: Any, aperture: Any, focus: Any) -> Any:
        return _native.depth_of_field(
            image, distances, aperture, focus, largest_sigma, tolerance, blades, rotation
        )

    return Single(run, [image, distances, aperture, focus], same)


def downsample(image: ArrayLike, factor: int) -> Single:
    """The means of blocks of `factor` by `factor` pixels. Gradients: of the image."""

    def shapes(image: Any) -> Any:
        height, width, channels = image.shape
        return [(height // factor, width // factor, channels)]

    return Single(lambda x: _native.downsample(x, factor), [image], shapes)


def exposure(image: ArrayLike, stops: ArrayLike) -> Single:
    """An image times 2 to the power of `stops`, a number or `[]`. Gradients: of image and stops."""
    return Single(_native.exposure, [image, stops], broadcast)


def over(front: ArrayLike, back: ArrayLike) -> Single:
    """Premultiplied colours with alpha, `[.., 4]`, before others. Gradients: of both."""
    return Single(_native.over, [front, back], same)


def srgb_encode(x: ArrayLike) -> Single:
    """sRGB numbers of linear ones. Gradients: of the input."""
    return Single(_native.srgb_encode, [x], same)


def srgb_decode(y: ArrayLike) -> Single:
    """Linear numbers of sRGB ones. Gradients: of the input."""
    return Single(_native.srgb_decode, [y], same)


# Losses.


def squared_error(image: ArrayLike, reference: ArrayLike) -> Single:
    """The sum of the squared differences of two arrays of one shape, `[]`. Gradients: of both.

    With a `reference`, `picture` and `render` have it at the cost of what is covered.
    """
    return Single(_native.squared_error, [image, reference], scalar)


def mean_error(
    image: ArrayLike, reference: ArrayLike, weights: ArrayLike | None = None, *, penalty: str = "squared",
    scale: float | None = None, mask: ArrayLike | None = None,
) -> Single:
    """The mean of what differences d of two arrays cost, `[]`.

    `penalty` is "squared", "absolute", "huber", "charbonnier" (sqrt(d^2 + scale^2) - scale) or "relative", for
    radiance. "huber" has squares up to the difference `scale`, then a line. "relative" is d^2 / (image^2 + scale): the
    gradient takes that denominator as it is, while `jvp` and `hvp` move it. The mean is weighted by `weights`, or taken
    where a `mask` of bools is true. Both have the shape of the image or of its first axes. Gradients: of image,
    reference and weights.

    >>> import bokashi, numpy as np
    >>> float(bokashi.mean_error(np.array([1.0, 5.0]), np.zeros(2), penalty="absolute")[0])
    3.0
    """
    where = None if mask is None else plain(mask)

    def run(image: Any, reference: Any, weights: Any) -> Any:
        return _native.mean_error(image, reference, weights, penalty, scale, where)

    return Single(run, [image, reference, weights], scalar)


def ssim_error(image: ArrayLike, reference: ArrayLike, *, peak: float = 1.0) -> Single:
    """1 minus the structural similarity of two images `[H, W, C]` whose numbers go up to `peak`. Gradients: of both."""
    return Single(lambda a, b: _native.ssim_error(a, b, peak), [image, reference], scalar)


def multiscale_ssim_error(
    image: ArrayLike, reference: ArrayLike, *, peak: float = 1.0, levels: int | None = None
) -> Single:
    """1 minus the structural similarity of two images `[H, W, C]` over halved images, 5 levels or as many as there are.

    Gradients: of both.
    """
    return Single(lambda a, b: _native.multiscale_ssim_error(a, b, peak, levels), [image, reference], scalar)


def silhouette_error(mask: ArrayLike, reference: ArrayLike) -> Single:
    """1 minus intersection over union of two soft masks of one shape, from 0 to 1. Gradients: of both."""
    return Single(_native.silhouette_error, [mask, reference], scalar)


def depth_error(
    depths: ArrayLike, reference: ArrayLike, *, mask: ArrayLike | None = None, alignment: str = "none"
) -> Single:
    """The mean absolute difference of two arrays of depths, `[]`.

    It is taken where both are above 0 and finite, and a `mask` is true. `alignment` is what may differ: "none",
    "scale", or "scale-and-shift", as in what networks say of one image. Gradients: of both.
    """
    where = None if mask is None else plain(mask)
    return Single(lambda a, b: _native.depth_error(a, b, where, alignment), [depths, reference], scalar)


def halved(image: ArrayLike) -> Single:
    """An image `[H, W, C]` of half the size, rounded up: means of 2 x 2 pixels.

    At an odd end they are those of the pixels that there are. A loss at several scales is the loss of images that are
    halved again and again. Gradients: of the image.
    """
    return Single(_native.halved, [image], lambda x: [(-(-x.shape[0] // 2), -(-x.shape[1] // 2), x.shape[2])])


def total_variation(image: ArrayLike, *, penalty: str = "squared", scale: float | None = None) -> Single:
    """What differences of neighbours in an image `[H, W, C]` cost, over the number of entries, `[]`.

    `penalty` and `scale` are those of `mean_error`. Gradients: of the image.
    """
    return Single(lambda x: _native.total_variation(x, penalty, scale), [image], scalar)
