"""Vectors and rows."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING
from .._native import SparseMatrix
from .step import Single, broadcast, plain, same

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike


def norm(x: ArrayLike) -> Single:
    """The lengths of vectors along the last axis, which is removed; that of 0 has the gradient 0. Gradients: of x."""
    return Single(_native.norm, [x], lambda x: [x.shape[:-1]])


def normalize(x: ArrayLike) -> Single:
    """Vectors along the last axis divided by their lengths; zeros stay, and have the gradient 0. Gradients: of x."""
    return Single(_native.normalize, [x], same)


def dot(a: ArrayLike, b: ArrayLike) -> Single:
    """The inner products of vectors along the last axes, `[N, C]` and `[N, C]` or `[C]`: `[N]`. Gradients: of both."""
    return Single(_native.dot, [a, b], lambda a, b: [broadcast(a, b)[0][:-1]])


def cross(a: ArrayLike, b: ArrayLike) -> Single:
    """The cross products of vectors along the last axes, `[N, 3]` and `[N, 3]` or `[3]`. Gradients: of both."""
    return Single(_native.cross, [a, b], broadcast)


def matmul(a: ArrayLike, b: ArrayLike) -> Single:
    """The matrix product of `[M, K]` and `[K, N]`. Gradients: of both."""
    return Single(_native.matmul, [a, b], lambda a, b: [(a.shape[0], b.shape[1])])


def gather_rows(x: ArrayLike, rows: ArrayLike) -> Single:
    """The rows of `x` `[N, ..]` that `rows` `[R]` names, whole numbers: `[R, ..]`. Gradients: of x."""
    named = plain(rows)
    return Single(lambda x: _native.gather_rows(x, named), [x], lambda x: [(*named.shape, *x.shape[1:])])


def scatter_add_rows(x: ArrayLike, rows: ArrayLike, count: int) -> Single:
    """The sums `[count, ..]` of the rows of `x` `[R, ..]`, each added to the row that `rows` `[R]` names.

    They are added in their order, so the bits do not depend on threads. Gradients: of x.

    >>> import bokashi, numpy as np
    >>> bokashi.scatter_add_rows(np.ones((3, 1)), np.array([0, 2, 2]), 3)[0].ravel()
    array([1., 0., 2.])
    """
    named = plain(rows)
    return Single(lambda x: _native.scatter_add_rows(x, named, count), [x], lambda x: [(count, *x.shape[1:])])


def sparse_product(x: ArrayLike, matrix: SparseMatrix) -> Single:
    """A `SparseMatrix` `[M, N]` times `x` `[N]` or `[N, C]`. Gradients: of x.

    >>> import bokashi, numpy as np
    >>> half = bokashi.SparseMatrix((1, 2), np.array([0, 0]), np.array([0, 1]), np.array([0.5, 0.5]))
    >>> bokashi.sparse_product(np.array([1.0, 3.0]), half)[0]
    array([2.])
    """
    return Single(
        lambda x: _native.sparse_product(x, matrix), [x], lambda x: [(matrix.shape[0], *x.shape[1:])]
    )


def sigmoid(x: ArrayLike) -> Single:
    """The logistic function 1 / (1 + e^-x), which overflows nowhere. Gradients: of x."""
    return Single(_native.sigmoid, [x], same)


def softplus(x: ArrayLike) -> Single:
    """ln(1 + e^x): positive, and x for large x; it overflows nowhere. Gradients: of x."""
    return Single(_native.softplus, [x], same)
