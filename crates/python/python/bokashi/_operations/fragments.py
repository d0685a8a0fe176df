"""Fragments, pictures of them, and a whole step."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING, Fragments, size_of
from .._native import Mesh
from .step import Single, Step, same

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from numpy.typing import ArrayLike


def rasterize(
    clip: ArrayLike, mesh: Mesh, size: int | Sequence[int], *, cull: str = "none", exact: bool = False,
    creases: Sequence[ArrayLike | tuple[ArrayLike, Mesh | None]] = (), crease_tolerance: float = 2e-3,
) -> Step:
    """The fragments of a mesh with vertices `clip` `[V, 4]`, in an image of `size` (height, width) or a square.

    `cull` is "none", "back" or "front". With `exact` pixels that a discontinuity crosses are resolved into pieces, each
    with its share: silhouettes then have their true gradient. `creases` are the attributes that will be shown, arrays
    `[V, C]` or pairs of an array and its own `Mesh`. Edges that bend one of them by more than `crease_tolerance` within
    a pixel are then resolved too.

    Returns `Fragments` and the pull-back of their barycentrics, and with `exact` of their weights, to `clip` (then to
    the creases' attributes, which get none).
    """
    height, width = size_of(size)
    shown = [crease[0] if isinstance(crease, tuple) else crease for crease in creases]
    meshes = [crease[1] if isinstance(crease, tuple) else None for crease in creases]
    found: list[_native.Coverage] = []

    def run(clip: Any, *attributes: Any) -> Any:
        coverage, outputs, pull_back = _native.rasterize(
            clip, mesh, height, width, cull, exact, list(zip(attributes, meshes)), crease_tolerance=crease_tolerance
        )
        found[:] = [coverage]
        return outputs, pull_back

    def result(outputs: Sequence[Any], arrays: Sequence[Any]) -> Fragments[Any]:
        return Fragments(outputs[0], outputs[1] if exact else None, arrays[0], found[0])

    # Where creases are depends on attributes that may be learnt: nothing is lost by the gradient that they lack.
    return Step(run, [clip, *shown], None, ("",) * len(shown), result)


def interpolate(attributes: ArrayLike, fragments: Fragments[Any], mesh: Mesh | None = None) -> Single:
    """Attributes at vertices, `[V, C]`, at each fragment: `[N, C]`.

    `mesh` is the attributes' own index buffer, where that is not the positions'. Gradients: of attributes,
    barycentrics, clip positions and weights.
    """
    coverage = fragments.coverage

    def run(attributes: Any, barycentrics: Any, clip: Any, weight: Any) -> Any:
        return _native.interpolate(attributes, barycentrics, clip, weight, coverage, mesh)

    return Single(run, [attributes, *fragments.arrays], lambda x, *_: [(len(coverage), x.shape[1])])


def interpolate_differentials(
    attributes: ArrayLike, fragments: Fragments[Any], differentials: ArrayLike, mesh: Mesh | None = None
) -> Single:
    """How interpolated attributes change from pixel to pixel, `[N, C, 2]`.

    Gradients: of attributes, differentials, barycentrics, clip positions and weights.
    """
    coverage = fragments.coverage

    def run(attributes: Any, differentials: Any, barycentrics: Any, clip: Any, weight: Any) -> Any:
        return _native.interpolate_differentials(
            attributes, differentials, barycentrics, clip, weight, coverage, mesh
        )

    arrays = [attributes, differentials, *fragments.arrays]
    return Single(run, arrays, lambda x, *_: [(len(coverage), x.shape[1], 2)])


def _at_fragments(function: Callable[..., Any], fragments: Fragments[Any], *extents: int) -> Single:
    """A function of fragments alone, with an array of these extents for each."""
    coverage = fragments.coverage
    return Single(lambda *x: function(*x, coverage), fragments.arrays, lambda *_: [(len(coverage), *extents)])


def differentials(fragments: Fragments[Any]) -> Single:
    """How the barycentrics change from pixel to pixel, `[N, 2, 2]`: d/dx and d/dy of u and of v, y down.

    Gradients: of barycentrics, clip positions and weights.
    """
    return _at_fragments(_native.differentials, fragments, 2, 2)


def depth(fragments: Fragments[Any]) -> Single:
    """z / w of each fragment, `[N]`, from -1 (near) to 1 (far).

    Gradients: of barycentrics, clip positions and weights.
    """
    return _at_fragments(_native.depth, fragments)


def eye_depth(fragments: Fragments[Any]) -> Single:
    """w of each fragment, `[N]`: for perspective cameras the distance along the view axis, for parallel rays 1.

    Gradients: of barycentrics, clip positions and weights.
    """
    return _at_fragments(_native.eye_depth, fragments)


def eye_depth_slope(fragments: Fragments[Any]) -> Single:
    """How `eye_depth` changes from pixel to pixel, to the right and down, `[N, 2]`.

    Gradients: of barycentrics, clip positions and weights.
    """
    return _at_fragments(_native.eye_depth_slope, fragments, 2)


def picture(
    values: ArrayLike, fragments: Fragments[Any], background: ArrayLike | None = None, *, antialias: bool = True,
    reference: ArrayLike | None = None,
) -> Single:
    """The image `[H, W, C]` of fragments that look like `values` `[N, C]`, before a background `[C]` or `[H, W, C]`.

    Silhouettes are antialiased, unless coverage is exact. With a `reference` image: the sum of the squared errors,
    `[]`, at the cost of what is covered. Gradients: of values, background, barycentrics, clip positions, weights.
    """
    coverage = fragments.coverage

    def run(values: Any, background: Any, barycentrics: Any, clip: Any, weight: Any, reference: Any) -> Any:
        return _native.picture(values, background, barycentrics, clip, weight, coverage, antialias, reference)

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        return [()] if x[-1] is not None else [(*coverage.size, x[0].shape[1])]

    return Single(run, [values, background, *fragments.arrays, reference], shapes, ("reference",))


def antialias_image(image: ArrayLike, fragments: Fragments[Any]) -> Single:
    """A dense image `[H, W, C]` with the silhouettes of the fragments' faces antialiased.

    Gradients: of the image, barycentrics (none) and clip positions.
    """
    coverage = fragments.coverage

    def run(image: Any, barycentrics: Any, clip: Any, _: None) -> Any:
        return _native.antialias_image(image, barycentrics, clip, coverage)

    barycentrics, clip, _ = fragments.arrays
    return Single(run, [image, barycentrics, clip, None], same)


def render(
    positions: ArrayLike, mesh: Mesh, colors: ArrayLike, size: int | Sequence[int], *,
    camera: ArrayLike | None = None, background: ArrayLike | None = None, color_mesh: Mesh | None = None,
    cull: str = "none", silhouettes: str = "exact", reference: ArrayLike | None = None,
    crease_tolerance: float = 2e-3,
) -> Single:
    """A whole step: the image `[H, W, C]` of a mesh with colours at its vertices, `[V, C]`.

    `positions` are `[V, 3]` before a camera matrix `[4, 4]`, or without one `[V, 4]` in clip space. `silhouettes` are
    "exact", "antialias" or "aliased". Exact ones resolve the edges that bend a colour by more than `crease_tolerance`
    within a pixel, too. With a `reference` image: the sum of the squared errors, `[]`. Gradients: of positions, camera,
    colors and background, then of the reference, which gets none.

    >>> import bokashi, numpy as np
    >>> mesh = bokashi.Mesh(np.array([[0, 1, 2]]), 3)
    >>> clip = np.array([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]])
    >>> image, _ = bokashi.render(clip, mesh, np.ones((3, 1)), 8)
    >>> float(image.sum().round(9))  # The area of the triangle in pixels: exactly.
    8.8
    >>> loss, pull_back = bokashi.render(clip, mesh, np.ones((3, 1)), 8, reference=image)
    >>> clip_bar, *_ = pull_back(np.ones(()))
    >>> float(loss), float(abs(clip_bar).max())
    (0.0, 0.0)
    """
    height, width = size_of(size)

    def run(positions: Any, camera: Any, colors: Any, background: Any, reference: Any) -> Any:
        return _native.render(
            positions, camera, colors, background, mesh, height, width, color_mesh, cull, silhouettes, reference,
            crease_tolerance,
        )

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        return [()] if x[-1] is not None else [(height, width, x[2].shape[1])]

    return Single(run, [positions, camera, colors, background, reference], shapes, ("reference",))
