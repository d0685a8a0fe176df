"""Arrays with tangents, and products with Jacobians and Hessians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from numbers import Number
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._given import Fragments
from ._native import Mesh


class Dual:
    """An array with a tangent: what it is, and how it moves along one direction. Both are of float64 and of one shape.

    Operations of bokashi take it in place of an array and return such arrays, their pull-backs too. So do the
    arithmetic of Python and the functions of numpy in `Dual.SLOPES` and `Dual.LINEAR`, but for `out` and `initial`.
    Comparisons go by value, so it has no hash. Others refuse it: a tangent is not lost in silence.

    >>> x = Dual([1.0, 2.0], [1.0, 0.0])
    >>> (x * x + 3).value, (x * x + 3).tangent
    (array([4., 7.]), array([2., 0.]))
    """

    #: The slopes of numpy's functions, from input and output.
    SLOPES: dict[Any, Callable[[Any, Any], Any]] = {
        np.negative: lambda x, y: -1.0,
        np.square: lambda x, y: 2 * x,
        np.sqrt: lambda x, y: 0.5 / y,
        np.exp: lambda x, y: y,
        np.log: lambda x, y: 1 / x,
        np.sin: lambda x, y: np.cos(x),
        np.cos: lambda x, y: -np.sin(x),
        np.tanh: lambda x, y: 1 - y * y,
        np.absolute: lambda x, y: np.sign(x),
    }

    #: Functions of numpy that move numbers, or add them: they do the same to tangents.
    LINEAR = frozenset({
        np.broadcast_to, np.concatenate, np.expand_dims, np.flip, np.hstack, np.mean, np.moveaxis, np.ravel, np.repeat,
        np.reshape, np.roll, np.squeeze, np.stack, np.sum, np.tile, np.transpose, np.vstack,
    })

    # Where `out` or `initial` would be an argument without a name, if not the fourth.
    _MOST = {np.concatenate: 2, np.stack: 2}

    __slots__ = ("tangent", "value")

    def __init__(self, value: ArrayLike, tangent: ArrayLike) -> None:
        self.value: NDArray[np.float64] = np.asarray(value, np.float64)
        self.tangent: NDArray[np.float64] = np.asarray(tangent, np.float64)
        if self.value.shape != self.tangent.shape:
            raise ValueError(
                f"a tangent needs the shape of its value, {self.value.shape}, got {self.tangent.shape}"
            )

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.tangent!r})"

    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    @property
    def ndim(self) -> int:
        return self.value.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.value.dtype

    @property
    def T(self) -> Dual:
        return self._moved(np.transpose)

    def __len__(self) -> int:
        return len(self.value)

    def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[Any]:
        raise TypeError("an array with a tangent is no plain array: take its value, or Dual's own arithmetic")

    def _moved(self, move: Callable[..., Any], *arguments: Any, **options: Any) -> Dual:
        """What moves numbers, or adds some, does the same to tangents."""
        return Dual(move(self.value, *arguments, **options), move(self.tangent, *arguments, **options))

    def __getitem__(self, key: Any) -> Dual:
        return self._moved(lambda x: x[key])

    def reshape(self, *shape: Any) -> Dual:
        return self._moved(np.ndarray.reshape, *shape)

    def sum(self, axis: Any = None, keepdims: bool = False) -> Dual:
        return self._moved(np.sum, axis=axis, keepdims=keepdims)

    def mean(self, axis: Any = None, keepdims: bool = False) -> Dual:
        return self._moved(np.mean, axis=axis, keepdims=keepdims)

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        if function not in self.LINEAR:
            return NotImplemented
        if not arguments or {"out", "initial"} & set(options) or len(arguments) > self._MOST.get(function, 3):
            rule = "arrays with tangents come first, and have no out and no initial number"
            raise TypeError(f"{rule}, in {function.__name__}")
        arrays, *more = arguments
        if isinstance(arrays, Dual):
            return arrays._moved(function, *more, **options)
        pairs = [(x.value, x.tangent) if isinstance(x, Dual) else (x, np.zeros(np.shape(x))) for x in arrays]
        values, tangents = zip(*pairs)
        return Dual(function(values, *more, **options), function(tangents, *more, **options))

    def __array_ufunc__(self, function: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            return NotImplemented
        if function in self.SLOPES:
            (x,) = inputs
            value = function(x.value)
            return Dual(value, self.SLOPES[function](x.value, value) * x.tangent)
        pairs = [(x.value, x.tangent) if isinstance(x, Dual) else (np.asarray(x), np.float64(0)) for x in inputs]
        return _arithmetic(function, *pairs) if len(pairs) == 2 else NotImplemented

    def __add__(self, other: Any) -> Dual:
        return np.add(self, other)

    def __radd__(self, other: Any) -> Dual:
        return np.add(other, self)

    def __sub__(self, other: Any) -> Dual:
        return np.subtract(self, other)

    def __rsub__(self, other: Any) -> Dual:
        return np.subtract(other, self)

    def __mul__(self, other: Any) -> Dual:
        return np.multiply(self, other)

    def __rmul__(self, other: Any) -> Dual:
        return np.multiply(other, self)

    def __truediv__(self, other: Any) -> Dual:
        return np.true_divide(self, other)

    def __rtruediv__(self, other: Any) -> Dual:
        return np.true_divide(other, self)

    def __matmul__(self, other: Any) -> Dual:
        return np.matmul(self, other)

    def __rmatmul__(self, other: Any) -> Dual:
        return np.matmul(other, self)

    def __pow__(self, exponent: Any) -> Dual:
        return np.power(self, exponent)

    def __neg__(self) -> Dual:
        return -1.0 * self

    def __abs__(self) -> Dual:
        return self * np.sign(self.value)

    def __eq__(self, other: Any) -> Any:
        return np.equal(self, other)

    def __ne__(self, other: Any) -> Any:
        return np.not_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __lt__(self, other: Any) -> Any:
        return np.less(self, other)

    def __le__(self, other: Any) -> Any:
        return np.less_equal(self, other)

    def __gt__(self, other: Any) -> Any:
        return np.greater(self, other)

    def __ge__(self, other: Any) -> Any:
        return np.greater_equal(self, other)


_COMPARISONS = {np.equal, np.not_equal, np.less, np.less_equal, np.greater, np.greater_equal}


def _arithmetic(function: Any, of_x: tuple[Any, Any], of_y: tuple[Any, Any]) -> Any:
    """A function of two arrays, each with its tangent."""
    (x, u), (y, v) = of_x, of_y
    value = function(x, y)
    if function in _COMPARISONS:
        return value
    if function is np.add:
        tangent = u + v
    elif function is np.subtract:
        tangent = u - v
    elif function is np.multiply:
        tangent = u * y + x * v
    elif function is np.true_divide:
        tangent = (u - value * v) / y
    elif function is np.matmul:
        tangent = (u @ y if np.ndim(u) else 0) + (x @ v if np.ndim(v) else 0)
    elif function is np.power and not np.any(v):
        # The power 0 is 1 everywhere, at 0 too.
        tangent = np.where(y == 0, 0.0, y * np.power(x, np.where(y == 0, 0.0, y - 1.0))) * u
    else:
        return NotImplemented
    return Dual(value, np.broadcast_to(tangent, np.shape(value)))


def _duals(point: Sequence[Any], direction: Sequence[Any]) -> list[Dual]:
    if len(point) != len(direction):
        raise ValueError(f"each of {len(point)} arrays needs a tangent, got {len(direction)}")
    return [Dual(value, tangent) for value, tangent in zip(point, direction)]


def _each(value: Any, take: Callable[[Any], Any]) -> Any:
    """A result of whatever form, with `take` of each of its arrays.

    Raises `TypeError` for a part of another type: a tangent in it would be lost in silence.
    """
    if isinstance(value, (Dual, np.ndarray, np.generic, Number)):
        return take(value)
    if value is None or isinstance(value, Mesh):
        return value
    if isinstance(value, Fragments):
        return value.replace(**{name: _each(getattr(value, name), take) for name in ("barycentrics", "weight", "clip")})
    if isinstance(value, (tuple, list)):
        # A named tuple is not made of a list.
        made = getattr(type(value), "_make", type(value))
        return made([_each(part, take) for part in value])
    raise TypeError(f"results are arrays, fragments, meshes, and lists and tuples of them, got {type(value).__name__}")


def _tangents_of(value: Any) -> Any:
    """The tangents of a result; 0 of what does not depend on the inputs."""
    return _each(value, lambda x: x.tangent if isinstance(x, Dual) else np.zeros(np.shape(x)))


def _values_of(value: Any) -> Any:
    return _each(value, lambda x: x.value if isinstance(x, Dual) else x)


def jvp(
    function: Callable[..., tuple[Any, Any]], point: Sequence[ArrayLike], direction: Sequence[ArrayLike]
) -> tuple[Any, Any]:
    """`f(x)` and `J v`, the derivative of `f` at `point` along `direction`: no differences, one run.

    `function(*arrays) -> (value, pull_back)` is an operation of bokashi, or is made of them and of the arithmetic of
    `Dual`. Its value may be fragments, meshes, and lists and tuples. The derivative has the same form: 0 stands for
    what does not move, meshes and `None` for themselves. A direction has an array for each of the point, of its shape.
    Numbers are of float64.

    Where branches meet, it is the derivative of the one that is taken: so with exact coverage keep vertices off the
    very borders of pixels. What a gradient takes as it is moves here: the denominator of `mean_error` with the penalty
    "relative".

    >>> import bokashi
    >>> length, moved = jvp(bokashi.norm, [[[3.0, 4.0]]], [[[1.0, 0.0]]])
    >>> float(length[0]), float(moved[0])
    (5.0, 0.6)
    """
    value, _ = function(*_duals(point, direction))
    return _values_of(value), _tangents_of(value)


def hvp(
    function: Callable[..., tuple[Any, Callable[..., Sequence[Any]]]], point: Sequence[ArrayLike],
    direction: Sequence[ArrayLike],
) -> tuple[list[Any], list[Any]]:
    """The gradient of a loss at `point`, and `H v`, the Hessian times `direction`: an array for each of the point.

    `function(*arrays) -> (value, pull_back)` is as in `jvp`, its value a single number. Gradients of the arrays come
    first and in their order. `None`, where no gradient is kept, stays `None`. An array without a gradient may not move:
    a part of the product would be missing. The silhouettes of a picture move with its vertices, and that is in the
    gradient. Which faces and pixels meet stays as it is.

    >>> import bokashi
    >>> (bar,), (moved,) = hvp(lambda x: bokashi.squared_error(x, np.zeros(2)), [[1.0, 3.0]], [[1.0, 0.0]])
    >>> bar, moved
    (array([2., 6.]), array([2., 0.]))
    """
    inputs = _duals(point, direction)
    value, pull_back = function(*inputs)
    if np.shape(value.value if isinstance(value, Dual) else value) != ():
        raise ValueError(f"a Hessian is that of a single number, got shape {value.shape}")
    bars = pull_back(Dual(1.0, 0.0))
    if len(bars) < len(inputs):
        raise ValueError(f"a pull-back needs a gradient for each of {len(inputs)} arrays, got {len(bars)}")
    own = list(bars[: len(inputs)])
    for k, (x, bar) in enumerate(zip(inputs, own)):
        if bar is None and x.tangent.any():
            raise ValueError(f"input {k} moves, and needs a gradient or zeros from the pull-back, got None")
    return _values_of(own), _tangents_of(own)
