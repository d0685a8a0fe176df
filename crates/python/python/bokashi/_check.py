"""Gradients of functions of one's own, checked against differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Slope:
    """The derivative of an input's direction: from the pull-back, from differences, and the error bar of these."""

    input: int
    pulled: float
    quotient: float
    error: float

    @property
    def is_right(self) -> bool:
        return bool(abs(self.pulled - self.quotient) <= self.error)


def check(function, *arrays, directions: int = 3, step: float = 1e-5, seed: int = 0) -> list[Slope]:
    """Compares the pull-back of `function(*arrays) -> (value, pull_back)` with difference quotients.

    Arrays are of `float64`. For each array and some random directions the quotients of two steps are compared: how far they
    are apart is their error bar, beside rounding. So nobody chooses a tolerance. Arrays are left out whose gradient is
    `None`, where differences agree that it is zero.

    Raises `AssertionError` that names the first input whose gradient is wrong; returns all that was compared.

    >>> import numpy as np
    >>> def square(x):
    ...     return x * x, lambda bar: (2 * x * bar,)
    >>> [slope.is_right for slope in check(square, np.array([0.5, -2.0]), directions=2)]
    [True, True]
    """
    generator = np.random.default_rng(seed)
    arrays = [np.asarray(array, np.float64) for array in arrays]
    value, pull_back = function(*arrays)
    upstream = generator.normal(size=np.shape(value))
    gradients = pull_back(upstream)
    if len(gradients) < len(arrays):
        raise AssertionError(f"a pull-back needs a gradient for each of {len(arrays)} arrays, got {len(gradients)}")
    slopes = []
    for k, array in enumerate(arrays):
        gradient = gradients[k]
        if gradient is not None and np.shape(gradient) != array.shape:
            raise AssertionError(f"the gradient of input {k} needs shape {array.shape}, got {np.shape(gradient)}")
        for _ in range(directions):
            slope = _slope(function, arrays, k, gradient, upstream, step, generator)
            if not slope.is_right:
                raise AssertionError(
                    f"input {k}: the pull-back has slope {slope.pulled:.9g}, "
                    f"differences have {slope.quotient:.9g} +- {slope.error:.1g}"
                )
            slopes.append(slope)
    return slopes


def _slope(function, arrays, k, gradient, upstream, step, generator) -> Slope:
    direction = generator.normal(size=arrays[k].shape)

    def at(distance):
        moved = list(arrays)
        moved[k] = arrays[k] + distance * direction
        return function(*moved)[0] * upstream

    def quotient(step):
        terms = at(step) - at(-step)
        return float(terms.sum()) / (2 * step)

    coarse, fine = quotient(step), quotient(step / 2)
    # Central differences are off by a multiple of the squared step: extrapolated, and its size known.
    best = fine + (fine - coarse) / 3
    size = float(np.abs(at(0.0)).sum()) + float(np.abs(direction).sum())
    error = abs(fine - coarse) + 100 * np.finfo(float).eps * size / step
    pulled = 0.0 if gradient is None else float((gradient * direction).sum())
    return Slope(k, pulled, best, error)
