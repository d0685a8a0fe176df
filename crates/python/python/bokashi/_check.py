"""Gradients of functions of one's own, checked against differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Slope:
    """The derivative along a direction of an input: from the pull-back, from differences, and their error bar."""

    input: int
    pulled: float
    quotient: float
    error: float

    @property
    def is_right(self) -> bool:
        return bool(abs(self.pulled - self.quotient) <= self.error)


def check(
    function: Callable[..., tuple[Any, Callable[..., Sequence[Any]]]], *arrays: ArrayLike, directions: int = 3,
    step: float = 1e-5, seed: int = 0,
) -> list[Slope]:
    """Compares the pull-back of `function(*arrays) -> (value, pull_back)` with difference quotients.

    Arrays are of `float64`, and gradients come in their order; further ones are left out. For each array and some
    random directions the quotients of two steps are compared. How far they are apart is their error bar, beside
    rounding: so nobody chooses a tolerance. A gradient of `None` stands for zero.

    Raises `AssertionError` that names the first input whose gradient is wrong; returns all that was compared.

    >>> import numpy as np
    >>> def square(x):
    ...     return x * x, lambda bar: (2 * x * bar,)
    >>> [slope.is_right for slope in check(square, np.array([0.5, -2.0]), directions=2)]
    [True, True]
    """
    generator = np.random.default_rng(seed)
    given = [np.asarray(array, np.float64) for array in arrays]
    value, pull_back = function(*given)
    upstream = generator.normal(size=np.shape(value))
    gradients = pull_back(upstream)
    if len(gradients) < len(given):
        raise AssertionError(f"a pull-back needs a gradient for each of {len(given)} arrays, got {len(gradients)}")
    slopes = []
    for k, array in enumerate(given):
        gradient = gradients[k]
        if gradient is not None and np.shape(gradient) != array.shape:
            raise AssertionError(f"the gradient of input {k} needs shape {array.shape}, got {np.shape(gradient)}")
        for _ in range(directions):
            slope = _slope(function, given, k, gradient, upstream, step, generator)
            if not slope.is_right:
                raise AssertionError(
                    f"input {k}: the pull-back has slope {slope.pulled:.9g}, "
                    f"differences have {slope.quotient:.9g} +- {slope.error:.1g}"
                )
            slopes.append(slope)
    return slopes


def _slope(
    function: Callable[..., tuple[Any, Any]], arrays: list[NDArray[np.float64]], k: int, gradient: Any,
    upstream: NDArray[np.float64], step: float, generator: np.random.Generator,
) -> Slope:
    direction = generator.normal(size=arrays[k].shape)

    def at(distance: float) -> NDArray[np.float64]:
        moved = list(arrays)
        moved[k] = arrays[k] + distance * direction
        return function(*moved)[0] * upstream

    def quotient(step: float) -> float:
        terms = at(step) - at(-step)
        return float(terms.sum()) / (2 * step)

    coarse, fine = quotient(step), quotient(step / 2)
    # Central differences are off by a multiple of the squared step: extrapolated, and its size known.
    best = fine + (fine - coarse) / 3
    size = float(np.abs(at(0.0)).sum()) + float(np.abs(direction).sum())
    error = abs(fine - coarse) + 100 * float(np.finfo(float).eps) * size / step
    pulled = 0.0 if gradient is None else float((gradient * direction).sum())
    return Slope(k, pulled, best, error)
