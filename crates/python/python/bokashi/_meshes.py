"""Meshes that change, and numbers of surfaces: what has no gradient.

Arrays are whatever numpy makes arrays of: tensors of torch that are detached and arrays of jax, too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._native import Mesh, SparseMatrix


class DerivedMesh(NamedTuple):
    """A mesh made of another one.

    `positions` `[W, 3]` are the product of `weights` `[W, V]` and the old positions. So `sparse_product(x, weights)`
    carries over what stands at the old vertices: colours, or positions that are learnt, with gradients.
    """

    positions: NDArray[Any]
    mesh: Mesh
    weights: SparseMatrix


class NearestPoints(NamedTuple):
    """For each query the index of a point, `[N]`, `uint32`, and how far it is away, `[N]`, `float64`."""

    indices: NDArray[np.uint32]
    distances: NDArray[np.float64]


class NearestOnSurface(NamedTuple):
    """For each query a point on a surface, `[N, 3]`, its distance and its face, `[N]`; floats are of `float64`.

    `sparse_product(x, weights)` is what stands at these points, `[N, C]`, of what stands at the vertices, `[V, C]`.
    """

    points: NDArray[np.float64]
    distances: NDArray[np.float64]
    faces: NDArray[np.uint32]
    weights: SparseMatrix


class FScore(NamedTuple):
    """The shares of found points near a true one, and of true ones near a found one; their harmonic mean."""

    precision: float
    recall: float
    score: float


def _numbers(values: ArrayLike) -> NDArray[Any]:
    """An array of floating point numbers."""
    array = np.asarray(values)
    # Whole numbers are what numpy makes of a list like [[0, 0, 1]].
    return array.astype(np.float64) if array.dtype.kind in "iu" else array


def remesh(
    positions: ArrayLike, mesh: Mesh, length: ArrayLike, *, iterations: int = 5, moves_vertices: bool = True,
    keeps_apart: bool = True, most_faces: int = 1 << 20,
) -> DerivedMesh:
    """The surface of a mesh with vertices `positions` `[V, 3]` made of other faces, whose edges are some `length` long.

    `length` is one for all, or one for each vertex, `[V]`, in units of the positions. Edges are split, collapsed and
    flipped `iterations` times, and unless `moves_vertices` is false vertices move along the surface. `keeps_apart`
    leaves out changes that let faces cross. Edges are split only while there are fewer than `most_faces` faces. New
    vertices lie on the old surface. 20,000 faces take about a tenth of a second. The result is a `DerivedMesh`.

    >>> import bokashi, numpy as np
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> fine = bokashi.remesh(square, bokashi.Mesh(np.array([[0, 1, 2], [0, 2, 3]]), 4), 0.1)
    >>> len(fine.mesh) > 100, round(bokashi.surface_area(fine.positions, fine.mesh), 6)
    (True, 1.0)
    >>> brightness, _ = bokashi.sparse_product(square[:, 0], fine.weights)
    >>> bool(np.allclose(brightness, fine.positions[:, 0]))
    True
    """
    return DerivedMesh(*_native.remesh(
        _numbers(positions), mesh, _numbers(length), iterations, moves_vertices, keeps_apart, most_faces
    ))


def subdivide(positions: ArrayLike, mesh: Mesh, scheme: str = "midpoint") -> DerivedMesh:
    """Each face of a mesh with vertices `positions` `[V, 3]` divided into four: a `DerivedMesh`.

    `scheme` is "midpoint", which keeps the surface, or "loop", which makes it smooth. The old vertices come first, then
    one for each edge. Face f becomes the faces 4 f to 4 f + 3.

    >>> import bokashi, numpy as np
    >>> fine = bokashi.subdivide(np.eye(3), bokashi.Mesh(np.array([[0, 1, 2]]), 3))
    >>> fine.positions.shape, len(fine.mesh)
    ((6, 3), 4)
    """
    return DerivedMesh(*_native.subdivide(_numbers(positions), mesh, scheme))


def smooth(
    positions: ArrayLike, mesh: Mesh, iterations: int, *, shrink: float = 0.5, swell: float | None = 0.53
) -> NDArray[Any]:
    """Positions `[V, 3]` of which each has moved the share `shrink` of the way to its neighbours' mean, then back.

    `swell` is the share of the way back, which keeps what is round from shrinking; with `None` there is none. Shares
    are from 0 to 1. Boundaries are smoothed along themselves.
    """
    return _native.smooth(_numbers(positions), mesh, iterations, shrink, swell)


def surface_area(positions: ArrayLike, mesh: Mesh) -> float:
    """The area of the faces of a mesh with vertices `positions` `[V, 3]`, in square units of these."""
    return _native.surface_area(_numbers(positions), mesh)


def signed_volume(positions: ArrayLike, mesh: Mesh) -> float:
    """The volume inside a mesh with vertices `positions` `[V, 3]`, in cubic units of these.

    It is positive where faces are counterclockwise seen from outside. Of a surface that is not closed it is the volume
    between the faces and the middle of all positions.
    """
    return _native.signed_volume(_numbers(positions), mesh)


def self_intersections(positions: ArrayLike, mesh: Mesh) -> NDArray[np.uint32]:
    """The pairs of faces that cross for certain, `[P, 2]`, the lower first, sorted. What touches does not cross."""
    return _native.self_intersections(_numbers(positions), mesh)


def nearest_points(queries: ArrayLike, points: ArrayLike) -> NearestPoints:
    """For each of `queries` `[N, 3]` the nearest of `points` `[M, 3]`; of several at one distance the first.

    >>> import bokashi
    >>> found = bokashi.nearest_points([[0.0, 0, 0]], [[3.0, 0, 0], [0, 2, 0]])
    >>> found.indices.tolist(), found.distances.tolist()
    ([1], [2.0])
    """
    return NearestPoints(*_native.nearest_points(_numbers(queries), _numbers(points)))


def nearest_on_surface(queries: ArrayLike, positions: ArrayLike, mesh: Mesh) -> NearestOnSurface:
    """For each of `queries` `[N, 3]` the nearest point on a mesh with vertices `positions` `[V, 3]`.

    Of faces at one distance it is on the first. Faces without an area count as the edges or points that they are.

    >>> import bokashi, numpy as np
    >>> mesh, corners = bokashi.Mesh(np.array([[0, 1, 2]]), 3), [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    >>> found = bokashi.nearest_on_surface([[0.25, 0.25, 2]], corners, mesh)
    >>> found.points.tolist(), found.distances.tolist()
    ([[0.25, 0.25, 0.0]], [2.0])
    """
    return NearestOnSurface(*_native.nearest_on_surface(_numbers(queries), _numbers(positions), mesh))


def f_score(found: ArrayLike, truth: ArrayLike, threshold: float) -> FScore:
    """How many of the points `found` `[N, 3]` and of the `truth` `[M, 3]` have one of the others within `threshold`."""
    return FScore(*_native.f_score(_numbers(found), _numbers(truth), threshold))


def normal_consistency(
    positions: ArrayLike, mesh: Mesh, other_positions: ArrayLike, other_mesh: Mesh, count: int, *, seed: int = 0
) -> float:
    """How alike the normals of two surfaces are, from 0 to 1.

    At `count` points drawn on one it is the mean of `|n . m|`, with m the normal at the nearest point of the other. The
    result is the mean of this and of the same the other way around. Which way the surfaces face does not matter.
    """
    return _native.normal_consistency(
        _numbers(positions), mesh, _numbers(other_positions), other_mesh, count, seed
    )
