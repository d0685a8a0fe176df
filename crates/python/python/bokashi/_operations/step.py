"""What a description of an operation consists of, and how a function is made of it."""

from __future__ import annotations

from types import FunctionType

from .._given import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any


def _first(outputs: Sequence[Any], arrays: Sequence[Any]) -> Any:
    return outputs[0]


class Step:
    """What a function does with arrays.

    `run` is given `arrays`, and returns outputs and a pull-back. Each is an array, `None`, or what becomes an array of
    the type of the others. The last ones, named in `constants`, have no gradient: one that asks for it is refused,
    unless its name is empty. `shapes` says from the arrays what the outputs look like. It is `None` where nobody knows
    before. `result` makes of outputs and arrays what the caller gets.
    """

    __slots__ = ("arrays", "constants", "result", "run", "shapes")

    # No dataclass: what makes one takes longer to load than all of this.
    def __init__(
        self, run: Callable[..., tuple[Any, Any]], arrays: Sequence[Any],
        shapes: Callable[..., Sequence[tuple[int, ...]]] | None, constants: tuple[str, ...] = (),
        result: Callable[[Sequence[Any], Sequence[Any]], Any] = _first,
    ) -> None:
        self.run, self.arrays, self.shapes, self.constants, self.result = run, arrays, shapes, constants, result


class Single(Step):
    """A step whose result is one array."""

    __slots__ = ()


def dressed(
    function: Any, describe: Callable[..., Step], module: str, array: str, returns: str = "{}", doc: str | None = None
) -> Any:
    """A function with the name and the signature of its description, which `returns` an `array`, or something else."""
    function.__name__ = function.__qualname__ = describe.__name__
    function.__module__, function.__doc__ = module, doc or describe.__doc__
    # Whose signature it is: the description's, but for what is returned.
    given: Any = describe
    signed = FunctionType(given.__code__, given.__globals__, given.__name__, given.__defaults__, given.__closure__)
    signed.__kwdefaults__ = given.__kwdefaults__
    returned = returns.format(array if given.__annotations__["return"] == "Single" else "Any")
    signed.__annotations__ = {**given.__annotations__, "return": returned}
    function.__wrapped__ = signed
    return function


def plain(values: Any) -> Any:
    """Indices or a mask as an array of numpy."""
    import numpy as np

    return np.asarray(values)


# Shapes of outputs.


def scalar(*_: Any) -> Sequence[tuple[int, ...]]:
    """A number."""
    return [()]


def same(x: Any, *_: Any) -> Sequence[tuple[int, ...]]:
    """That of the first array."""
    return [x.shape]


def broadcast(a: Any, b: Any) -> Sequence[tuple[int, ...]]:
    """That of two arrays together."""
    import numpy as np

    return [np.broadcast_shapes(a.shape, b.shape)]
