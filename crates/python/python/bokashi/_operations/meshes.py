"""Regularizers of meshes, surfaces of fields, and points on them."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING
from .._native import Grid, Mesh, Rigidity, SparseMatrix, Topology
from .step import Single, Step, scalar

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import ArrayLike


def laplacian_error(positions: ArrayLike, laplacian: SparseMatrix) -> Single:
    """The mean over vertices of `|(L v)_i|^2`, `[]`: small where a surface is smooth.

    The matrix is one of a `Topology`. Gradients: of positions `[V, C]`.

    >>> import bokashi, numpy as np
    >>> topology = bokashi.Topology(bokashi.Mesh(np.array([[0, 1, 2]]), 3))
    >>> float(bokashi.laplacian_error(np.ones((3, 3)), topology.uniform_laplacian())[0])
    0.0
    """
    return Single(lambda x: _native.laplacian_error(x, laplacian), [positions], scalar)


def edge_length_error(positions: ArrayLike, topology: Topology, *, target: float = 0.0) -> Single:
    """The mean squared difference of the lengths of edges from `target`, `[]`. Gradients: of positions `[V, 3]`."""
    return Single(lambda x: _native.edge_length_error(x, topology, target), [positions], scalar)


def normal_error(positions: ArrayLike, topology: Topology) -> Single:
    """The mean of 1 - cos of the angles between the normals of faces that share an edge, `[]`.

    Gradients: of positions `[V, 3]`.
    """
    return Single(lambda x: _native.normal_error(x, topology), [positions], scalar)


def rigid_error(positions: ArrayLike, rigidity: Rigidity) -> Single:
    """How far a mesh is from one that only turned and moved, vertex by vertex (as rigid as possible), `[]`.

    A `Rigidity` has the mesh at rest. Gradients: of positions `[V, 3]`.
    """
    return Single(lambda x: _native.rigid_error(x, rigidity), [positions], scalar)


def field_surface(field: ArrayLike, grid: Grid, offsets: ArrayLike | None = None) -> Step:
    """The surface on which a field is 0: positions `[V, 3]`, and their `Mesh`, whose faces have their fronts outside.

    `field` has a number for each point of a `Grid`, `[nx, ny, nz]` or `[P]`, below 0 inside. `offsets`
    `[nx, ny, nz, 3]` or `[P, 3]` move the points of the grid; below a sixth of its spacing they fold nothing. The
    surface is closed where it does not reach the grid's border, and a manifold everywhere. Gradients: of field and
    offsets.

    >>> import bokashi, numpy as np
    >>> grid = bokashi.Grid.around([-1, -1, -1], [1, 1, 1], 16)
    >>> (positions, mesh), pull_back = bokashi.field_surface(np.linalg.norm(grid.positions, axis=-1) - 0.7, grid)
    >>> bokashi.Connectivity(mesh).euler_characteristic
    2
    >>> field_bar, _ = pull_back(positions)  # Where the field grows, the ball shrinks.
    >>> field_bar.shape == grid.shape, bool((field_bar <= 0).all())
    (True, True)
    """
    found: list[Mesh] = []

    def run(field: Any, offsets: Any) -> Any:
        mesh, outputs, pull_back = _native.field_surface(field, offsets, grid)
        found[:] = [mesh]
        return outputs, pull_back

    return Step(run, [field, offsets], None, result=lambda outputs, _: (outputs[0], found[0]))


def draw_points(positions: ArrayLike, mesh: Mesh, count: int, *, seed: int = 0) -> Single:
    """`count` points on a mesh with vertices `positions` `[V, 3]`, drawn uniformly by area: `[count, 3]`.

    The k-th lies in the k-th of `count` equal shares of the area, in the order of the faces. The same seed gives the
    same points, on every machine. Each moves with its face: gradients of positions.

    >>> import bokashi, numpy as np
    >>> points, _ = bokashi.draw_points(np.eye(3), bokashi.Mesh(np.array([[0, 1, 2]]), 3), 100)
    >>> points.shape, bool(np.allclose(points.sum(axis=1), 1))
    ((100, 3), True)
    """
    return Single(lambda x: _native.draw_points(x, mesh, count, seed), [positions], lambda x: [(count, 3)])


def chamfer_distance(a: ArrayLike, b: ArrayLike, *, squared: bool = True) -> Single:
    """The Chamfer distance of clouds `[N, 3]` and `[M, 3]`, `[]`.

    It is the sum of the mean distances to the nearest point, both ways. They are squared, or not. Gradients: of both.

    >>> import bokashi, numpy as np
    >>> float(bokashi.chamfer_distance(np.zeros((1, 3)), np.array([[0.0, 0, 3], [0, 0, 4]]))[0])
    21.5
    """
    return Single(lambda a, b: _native.chamfer_distance(a, b, squared), [a, b], scalar)
