"""What operations are given: fragments, sizes, materials and lights."""

from __future__ import annotations

from _operator import index

from ._native import Coverage, RenderError

# That of `typing` is not imported: to load `typing` takes twice as long as to load all that `import bokashi` loads.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any, Generic, TypeVar

    import numpy as np
    from numpy.typing import NDArray

    _Array = TypeVar("_Array")
else:
    _Array = object

    class Generic:
        """Stands in for `typing.Generic` when the program runs: subscripts are ignored."""

        __slots__ = ()

        def __class_getitem__(cls, kind):
            return cls


class Fragments(Generic[_Array]):
    """The covered samples of an image.

    `barycentrics` `[N, 2]` are the perspective-correct weights of vertices 0 and 1 of each fragment's face. `weight`
    `[K]` is the share of its pixel that each piece of exact coverage has, `None` without. `clip` `[V, 4]` are the
    positions that were rasterized. Fragments at pixel centres come first, then pieces.
    """

    __slots__ = ("__weakref__", "barycentrics", "clip", "coverage", "weight")

    barycentrics: _Array
    weight: _Array | None
    clip: _Array
    coverage: Coverage

    # No dataclass: what makes one takes longer to load than all of this.
    def __init__(self, barycentrics: _Array, weight: _Array | None, clip: _Array, coverage: Coverage) -> None:
        keep = object.__setattr__
        keep(self, "barycentrics", barycentrics)
        keep(self, "weight", weight)
        keep(self, "clip", clip)
        keep(self, "coverage", coverage)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"fragments stay as they are, and `replace` makes others: {name} was to be set")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"fragments stay as they are, and {name} was to be deleted")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.barycentrics, self.weight, self.clip, self.coverage)

    def __repr__(self) -> str:
        return f"Fragments({len(self)} in {self.coverage!r})"

    def __len__(self) -> int:
        return len(self.coverage)

    @property
    def faces(self) -> NDArray[np.uint32]:
        """The face of each fragment, `[N]`."""
        return self.coverage.faces

    @property
    def pixels(self) -> NDArray[np.uint32]:
        """The pixel of each fragment, `[N]`: row times width plus column."""
        return self.coverage.pixels

    @property
    def arrays(self) -> tuple[_Array, _Array, _Array | None]:
        """Barycentrics, clip positions and weights: what operations on fragments have gradients for."""
        return self.barycentrics, self.clip, self.weight

    def replace(self, **fields: Any) -> Fragments[_Array]:
        """The same fragments with other arrays of the same shapes."""
        own = {name: getattr(self, name) for name in ("barycentrics", "weight", "clip", "coverage")}
        return Fragments(**{**own, **fields})


def size_of(size: int | Sequence[int]) -> tuple[int, int]:
    """Height and width of a size, or of a square."""
    # No arrays are asked for: numpy may not be there yet.
    pair: Any = size if hasattr(size, "__len__") else (size, size)
    height, width = pair
    return index(height), index(width)


def surface_of(
    material: Sequence[Any], lights: Sequence[tuple[Any, ...]]
) -> tuple[list[str], list[Any], list[Any]]:
    """The kinds of lights, three arrays of a material, and two of each light: `None` for those not there."""
    if hasattr(material, "shape") or len(material) > 3:
        given = type(material).__name__ if hasattr(material, "shape") else f"{len(material)} arrays"
        raise RenderError(f"a material needs to be a list of at most 3 arrays, got {given}")
    for kind, *arrays in lights:
        if not 1 <= len(arrays) <= 2:
            raise RenderError(f"a light needs one or two arrays, got {len(arrays)} for {kind!r}")
    of_lights = [values for _, *arrays in lights for values in (*arrays, None)[:2]]
    return [kind for kind, *_ in lights], [*material, None, None, None][:3], of_lights
