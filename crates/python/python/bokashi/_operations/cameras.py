"""Cameras, lenses and poses."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING, size_of
from .step import Single, same

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import ArrayLike


def _matrix(*_: Any) -> Sequence[tuple[int, ...]]:
    return [(4, 4)]


def project(
    positions: ArrayLike, camera: ArrayLike, rotation: ArrayLike | None = None, translation: ArrayLike | None = None
) -> Single:
    """Positions `[V, 3]` in clip space, `[V, 4]`: the camera matrix `[4, 4]` times the posed positions.

    The pose is a quaternion `[4]` (x, y, z, w) and a translation `[3]`. Gradients: of positions, camera, rotation and
    translation.
    """
    return Single(_native.project, [positions, camera, rotation, translation], lambda x, *_: [(x.shape[0], 4)])


def project_instances(positions: ArrayLike, matrices: ArrayLike, camera: ArrayLike) -> Single:
    """Positions `[V, 3]` placed by each of the `matrices` `[I, 4, 4]`, in clip space: `[I V, 4]`.

    One instance comes after another. Gradients: of positions, matrices and camera.
    """
    return Single(
        _native.project_instances, [positions, matrices, camera], lambda x, m, _: [(m.shape[0] * x.shape[0], 4)]
    )


def pinhole(intrinsics: ArrayLike, size: int | Sequence[int], near: float, far: float) -> Single:
    """The matrix `[4, 4]` from a camera's space (x right, y down, z forward) to clip space.

    `intrinsics` `[4]` are focal lengths and principal point (fx, fy, cx, cy) in pixels, as OpenCV has them. There the
    centre of the first pixel is (0, 0). `near` and `far` are distances along the view axis; `far` may be infinite.
    Gradients: of the intrinsics.
    """
    height, width = size_of(size)
    return Single(lambda x: _native.pinhole(x, height, width, near, far), [intrinsics], _matrix)


def orthographic(intrinsics: ArrayLike, size: int | Sequence[int], near: float, far: float) -> Single:
    """As `pinhole`, for parallel rays: `intrinsics` `[4]` are pixels per unit and the centre, (sx, sy, cx, cy)."""
    height, width = size_of(size)
    return Single(lambda x: _native.orthographic(x, height, width, near, far), [intrinsics], _matrix)


def distort(points: ArrayLike, coefficients: ArrayLike) -> Single:
    """Points `[V, 3]` in a camera's space as its lens bends them, `[V, 3]`: `pinhole` comes next.

    `coefficients` are OpenCV's, `[5]` (k1, k2, p1, p2, k3) or `[8]` (then k4, k5, k6). Gradients: of points and
    coefficients.
    """
    return Single(_native.distort, [points, coefficients], same)


def fisheye(points: ArrayLike, coefficients: ArrayLike) -> Single:
    """Points `[V, 3]` in a camera's space as a fisheye sees them, `[V, 3]`: `pinhole` comes next.

    `coefficients` `[4]` are those of OpenCV's module `fisheye`. The third number becomes the distance from the eye.
    Gradients: of points and coefficients.
    """
    return Single(_native.fisheye, [points, coefficients], same)


def rigid(rotation: ArrayLike, translation: ArrayLike) -> Single:
    """The matrix `[4, 4]` of a quaternion `[4]` (x, y, z, w) of any length, then a translation `[3]`.

    Gradients: of both.
    """
    return Single(_native.rigid, [rotation, translation], _matrix)


def se3(increment: ArrayLike, fixed: ArrayLike) -> Single:
    """The pose `fixed` `[4, 4]` moved by an increment `[6]`, a translation and a rotation vector in radians: `[4, 4]`.

    The increment multiplies from the left. A fit starts at 0, and may put what it found into `fixed` after each step.
    Gradients: of the increment, then of `fixed`, which gets none.
    """
    return Single(_native.se3, [increment, fixed], _matrix, ("fixed",))


def affine_inverse(matrix: ArrayLike) -> Single:
    """The inverse of an affine matrix `[4, 4]`, whose last row is (0, 0, 0, 1). Gradients: of the matrix."""
    return Single(_native.affine_inverse, [matrix], _matrix)


def transform_points(points: ArrayLike, matrix: ArrayLike) -> Single:
    """Points `[V, 3]` moved by an affine matrix `[4, 4]`: `[V, 3]`. Gradients: of both."""
    return Single(_native.transform_points, [points, matrix], same)


def transform_normals(normals: ArrayLike, matrix: ArrayLike) -> Single:
    """Normals `[N, 3]` of surfaces that a matrix `[4, 4]` or `[3, 3]` moves, of length 1: `[N, 3]`.

    Gradients: of both.
    """
    return Single(_native.transform_normals, [normals, matrix], same)
