"""Surfaces one behind another, and what a lens sees of them."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING, Fragments, size_of
from .._native import Mesh, RenderError
from .step import Single, Step

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import ArrayLike

    from .tuples import LensLayer


def rasterize_behind(front: Fragments[Any], *, cull: str = "none") -> Step:
    """The `Fragments` of what is seen behind others, at pixel centres; without any, nothing is behind.

    `cull` needs to be that of `front`. The pull-back leads from their barycentrics to the clip positions.
    """
    found: list[_native.Coverage] = []

    def run(clip: Any) -> Any:
        coverage, outputs, pull_back = _native.rasterize(
            clip, front.coverage.mesh, *front.coverage.size, cull, behind=front.coverage
        )
        found[:] = [coverage]
        return outputs, pull_back

    return Step(run, [front.clip], None, result=lambda outputs, x: Fragments(outputs[0], None, x[0], found[0]))


def depth_layers(
    clip: ArrayLike, mesh: Mesh, size: int | Sequence[int], *, cull: str = "none", most: int | None = None
) -> Step:
    """A list of `Fragments`: all surfaces that pixel centres see one behind another, the nearest first, `most` at most.

    Three layers cost some three to four times what one costs. The pull-back leads from the barycentrics of each to
    `clip` `[V, 4]`.
    """
    height, width = size_of(size)
    found: list[_native.Coverage] = []

    def run(clip: Any) -> Any:
        coverages, outputs, pull_back = _native.depth_layers(clip, mesh, height, width, cull, most)
        found[:] = coverages
        return outputs, pull_back

    def result(outputs: Sequence[Any], arrays: Sequence[Any]) -> list[Fragments[Any]]:
        return [Fragments(uv, None, arrays[0], coverage) for uv, coverage in zip(outputs, found)]

    return Step(run, [clip], None, result=result)


def composite_layers(
    layers: Sequence[tuple[Fragments[Any], ArrayLike, ArrayLike]], background: ArrayLike | None = None, *,
    antialias: bool = True, reference: ArrayLike | None = None,
) -> Single:
    """The image `[H, W, C]` of layers one over another, the nearest first, before a background.

    A layer has fragments of `depth_layers`, colours times their alpha `[N, C]`, and alphas `[N]` from 0 to 1. The first
    one's silhouettes are antialiased. With a `reference` image: the sum of the squared errors, `[]`. Gradients: of the
    background, of the first layer's clip positions, then of colours and alphas of each layer, then of the reference,
    which gets none.
    """
    if not layers:
        raise RenderError("composite_layers needs at least one layer, got none")
    coverages = [fragments.coverage for fragments, *_ in layers]

    def run(background: Any, clip: Any, *more: Any) -> Any:
        *arrays, reference = more
        pairs = list(zip(arrays[::2], arrays[1::2]))
        return _native.composite_layers(background, clip, pairs, coverages, antialias, reference)

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        return [()] if x[-1] is not None else [(*coverages[0].size, x[2].shape[1])]

    of_layers = [array for _, *arrays in layers for array in arrays]
    return Single(run, [background, layers[0][0].clip, *of_layers, reference], shapes, ("reference",))


def lens_picture(
    layers: Sequence[LensLayer], aperture: ArrayLike, focus: ArrayLike, *, background: ArrayLike | None = None,
    far: float = float("inf"), margin: int = 0, largest_radius: float = 64.0, blades: int = 0, rotation: float = 0.0,
) -> Single:
    """The image that a lens sees of surfaces one behind another, before a background at the distance `far`.

    The first layer is what is visible, of any sampling; those behind are of `depth_layers`, beginning with its first:
    that one says what hides what. Two hidden ones are enough. `aperture` is the radius in pixels of the circle of
    confusion at infinity, `focus` the distance that is sharp: numbers or `[]`. Circles have `largest_radius` at most.
    `margin` pixels are cut off at each side; as many as the largest circle has, and what lies beyond the picture is
    blurred into it. With `blades` the opening is a polygon of 3 to 16 sides, turned by `rotation` in radians.

    Gradients: of background, aperture, focus, the first layer's weights, then of values, alpha, distance and slope of
    each layer.
    """
    if not layers:
        raise RenderError("lens_picture needs at least one layer, got none")
    coverages = [layer[0].coverage for layer in layers]
    behind = [layer for layer in layers[1:] if layer[0].weight is not None]
    if behind:
        raise RenderError("layers behind need fragments at pixel centres, got exact coverage")

    def run(background: Any, aperture: Any, focus: Any, weight: Any, *arrays: Any) -> Any:
        of_layers = list(zip(*(arrays[k::4] for k in range(4))))
        return _native.lens_picture(
            background, aperture, focus, weight, of_layers, coverages, far, margin, largest_radius, blades, rotation
        )

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        height, width = coverages[0].size
        return [(height - 2 * margin, width - 2 * margin, x[4].shape[1])]

    from .tuples import LensLayer

    whole = [LensLayer(*layer) for layer in layers]
    arrays = [array for layer in whole for array in (layer.values, layer.alpha, layer.distance, layer.slope)]
    return Single(run, [background, aperture, focus, whole[0].fragments.weight, *arrays], shapes)
