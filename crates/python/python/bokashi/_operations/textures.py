"""Textures and cube maps."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING
from .._native import RenderError, Texture
from .step import Single, Step

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from numpy.typing import ArrayLike


def mipmaps(texels: ArrayLike, coarsest: int | None = None) -> Step:
    """The coarser levels of texels `[H, W, C]`, or of a cube map's `[6, S, S, C]`: a tuple, each half as large.

    The last is a single texel, or level `coarsest`. Gradients: of the texels.
    """

    def shapes(texels: Any) -> Sequence[tuple[int, ...]]:
        *faces, height, width, channels = texels.shape
        levels = max(height, width, 1).bit_length() - 1
        return [
            (*faces, max(height >> k, 1), max(width >> k, 1), channels)
            for k in range(1, 1 + (levels if coarsest is None else min(levels, coarsest)))
        ]

    def run(texels: Any) -> Any:
        return _native.mipmaps(texels, coarsest)

    return Step(run, [texels], shapes, result=lambda outputs, _: tuple(outputs))


def _detail(level: Any, differentials: Any, bias: Any, mips: Any) -> bool:
    """Whether a texture is sampled at levels of detail. What would be ignored is refused."""
    if mips and level is None and differentials is None:
        raise RenderError("mips are levels of detail: a sample of them needs a level or differentials, got neither")
    if level is not None and (differentials is not None or bias is not None):
        raise RenderError("a sample has a level, or differentials with a bias, got both")
    if bias is not None and differentials is None:
        raise RenderError("a bias is added to the level that differentials give, and there are none; take `level`")
    return level is not None or differentials is not None


def _levels(texels: Any, mips: Any) -> tuple[Texture | None, list[Any]]:
    """A constant texture, or the levels that were given."""
    if not isinstance(texels, Texture):
        return None, [texels, *(mips or ())]
    if mips:
        raise RenderError("a Texture has levels of its own, and a sample of it was given mips")
    return texels, []


def _sample(
    function: Callable[..., Any], texels: Any, coordinates: Any, level: Any, differentials: Any, bias: Any, filter: str,
    border: str | Sequence[str], coarsest: int | None, probes: int, mips: Sequence[Any] | None,
) -> Single:
    borders = (border, border) if isinstance(border, str) else tuple(border)
    # Without a level or differentials nobody asks for coarser levels.
    makes_mipmaps = _detail(level, differentials, bias, mips) and mips is None
    constant, own = _levels(texels, mips)

    def run(coordinates: Any, level: Any, differentials: Any, bias: Any, *levels: Any) -> Any:
        return function(
            coordinates, level, differentials, bias, list(levels), filter, borders, coarsest, probes, makes_mipmaps,
            constant,
        )

    def shapes(coordinates: Any, *more: Any) -> Sequence[tuple[int, ...]]:
        finest = more[3] if constant is None else constant
        return [(coordinates.shape[0], finest.shape[-1])]

    return Single(run, [coordinates, level, differentials, bias, *own], shapes)


def sample_texture(
    texels: ArrayLike | Texture, coordinates: ArrayLike, *, level: ArrayLike | None = None,
    differentials: ArrayLike | None = None, bias: ArrayLike | None = None, filter: str = "trilinear",
    border: str | Sequence[str] = "wrap", coarsest: int | None = None, probes: int = 8,
    mips: Sequence[ArrayLike] | None = None,
) -> Single:
    """Samples of texels `[H, W, C]` at coordinates (u, v), `[N, 2]`; (0, 0) is the upper left corner: `[N, C]`.

    The level of detail is `level` (`[N]` or a number), or follows from `differentials` `[N, 2, 2]` of the coordinates
    and a `bias`. Without either it is the finest. `filter` is "nearest", "bilinear", "trilinear" or "anisotropic",
    `border` "wrap", "mirror", "clamp" or "zero", or one for u and one for v. `mips` are coarser levels of one's own.
    Gradients: of coordinates, level, differentials, bias, texels and mips.

    Mipmaps of an array are made in each call. Those of a `Texture` were made with it; then gradients end with the bias.

    >>> import bokashi, numpy as np
    >>> texture = bokashi.Texture(np.arange(16.0).reshape(4, 4, 1))
    >>> middle = np.array([[0.5, 0.5]])
    >>> [float(bokashi.sample_texture(texture, middle, level=level)[0].item()) for level in (0, 2)]
    [7.5, 7.5]
    """
    return _sample(
        _native.sample_texture, texels, coordinates, level, differentials, bias, filter, border, coarsest, probes, mips
    )


def sample_cube_map(
    texels: ArrayLike | Texture, directions: ArrayLike, *, level: ArrayLike | None = None,
    differentials: ArrayLike | None = None, bias: ArrayLike | None = None, filter: str = "trilinear",
    coarsest: int | None = None, probes: int = 8, mips: Sequence[ArrayLike] | None = None,
) -> Single:
    """Samples of a cube map's texels `[6, S, S, C]` in directions `[N, 3]`: `[N, C]`. As `sample_texture`."""
    return _sample(
        _native.sample_cube_map, texels, directions, level, differentials, bias, filter, "wrap", coarsest, probes, mips
    )
