"""Differentiable rendering on a CPU, from numpy.

Each operation returns its value and a function that pulls gradients back:

>>> import numpy as np, bokashi
>>> mesh = bokashi.Mesh(np.array([[0, 1, 2]]), 3)
>>> clip = np.array([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]])
>>> fragments, of_clip = bokashi.rasterize(clip, mesh, 8)
>>> colors = np.eye(3)
>>> surface, of_surface = bokashi.interpolate(colors, fragments)
>>> surface.shape
(8, 3)
>>> colors_bar, barycentrics_bar, _, _ = of_surface(np.ones_like(surface))
>>> (clip_bar,) = of_clip(barycentrics_bar)
>>> clip_bar.shape
(3, 4)

Arrays are of `float32` or `float64`, one type in a call, and results have that type. A pull-back takes a gradient, or
`None`, for each output, and returns one, or `None`, for each array that the operation was given, in their order. With
`wanted=(True, False, ..)` only those are computed. Results are the same bits on every run, for any number of threads.

Row 0 of an image is its top row. Clip space is OpenGL's: visible where `w > 0` and `-w <= x, y, z <= w`. Shapes: V
vertices, F faces, N fragments (the covered samples of an image), K pieces of exact coverage, C channels.
"""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, overload

from . import _native, _operations
from ._given import Fragments, size_of, surface_of
from ._native import (
    Connectivity, Coverage, Grid, Mesh, Prefilter, PullBack, RenderError, Rigidity, SceneError, SparseMatrix, Texture,
    Topology, num_threads, set_num_threads,
)
from ._operations import Environment, LensLayer, Single, Step, dressed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from ._check import Slope, check
    from ._dual import Dual, hvp, jvp
    from ._meshes import (
        DerivedMesh, FScore, NearestOnSurface, NearestPoints, f_score, nearest_on_surface, nearest_points,
        normal_consistency, remesh, self_intersections, signed_volume, smooth, subdivide, surface_area,
    )
    from ._scenes import Fit, Learning, Parameter, Picture, Scene, View, fit

__all__ = [
    "Connectivity", "Coverage", "DerivedMesh", "Dual", "Environment", "FScore", "Fit", "Fragments", "Grid", "Learning",
    "LensLayer", "Mesh", "NearestOnSurface", "NearestPoints", "Parameter", "Picture", "Prefilter", "PullBack",
    "RenderError", "Rigidity", "Scene", "SceneError", "Slope", "SparseMatrix", "Texture", "Topology", "View",
    "affine_inverse", "antialias_image", "chamfer_distance", "check", "composite_layers", "cross", "depth",
    "depth_error", "depth_layers", "depth_of_field", "differentials", "distort", "dot", "downsample", "draw_points",
    "edge_length_error", "exposure", "eye_depth", "eye_depth_slope", "f_score", "face_normals", "field_surface",
    "fisheye", "fit", "gather_rows", "gaussian_blur", "halved", "hvp", "interpolate", "interpolate_differentials",
    "irradiance", "jvp", "laplacian_error", "lens_picture", "matmul", "mean_error", "mipmaps", "multiscale_ssim_error",
    "nearest_on_surface", "nearest_points", "norm", "normal_consistency", "normal_error", "normalize", "num_threads",
    "orthographic", "over", "perturbed_normals", "picture", "pinhole", "prefiltered", "project", "project_instances",
    "rasterize", "rasterize_behind", "reflect", "remesh", "render", "rigid", "rigid_error", "sample_cube_map",
    "sample_texture", "scatter_add_rows", "se3", "self_intersections", "set_num_threads", "shade",
    "shade_in_environment", "sigmoid", "signed_volume", "silhouette_error", "smooth", "softplus", "sparse_product",
    "squared_error", "srgb_decode", "srgb_encode", "ssim_error", "subdivide", "surface_area", "tangents",
    "total_variation", "transform_normals", "transform_points", "vertex_normals",
]


def _coverage(mesh: Mesh, ids: NDArray[np.uint32], orientations: NDArray[np.int8] | None) -> Coverage:
    return Coverage.from_ids(mesh, ids, orientations=orientations)


def _parts(coverage: Coverage) -> tuple[Any, ...]:
    if len(coverage) > coverage.centers:
        raise TypeError("coverage with exact pieces can't be pickled: keep the clip positions, and rasterize again")
    return _coverage, (coverage.mesh, coverage.triangle_ids(), coverage.orientations)


def _texture(texels: NDArray[Any], *mips: NDArray[Any]) -> Texture:
    return Texture(texels, mips=mips) if mips else Texture(texels, coarsest=0)


# What is made of these can be pickled and copied: fragments, modules of torch.
copyreg.pickle(Mesh, lambda mesh: (Mesh, (mesh.faces, mesh.vertex_count)))
copyreg.pickle(Coverage, _parts)
copyreg.pickle(Texture, lambda texture: (_texture, tuple(texture.levels)))
copyreg.pickle(SparseMatrix, lambda matrix: (SparseMatrix, (matrix.shape, *matrix.entries)))
copyreg.pickle(Grid, lambda grid: (Grid, (grid.shape, grid.origin, grid.spacing)))
copyreg.pickle(Prefilter, lambda prefilter: (Prefilter, (prefilter.extent, prefilter.levels)))

# The arrays of a call are of one type.
_T = TypeVar("_T", "np.float32", "np.float64")
_P = ParamSpec("_P")

_MESHES = """
    DerivedMesh FScore NearestOnSurface NearestPoints f_score nearest_on_surface nearest_points normal_consistency remesh
    self_intersections signed_volume smooth subdivide surface_area
"""

_LATER = (
    {"Slope": "_check", "check": "_check"}
    | dict.fromkeys(("Dual", "hvp", "jvp"), "_dual")
    | dict.fromkeys(_MESHES.split(), "_meshes")
    | dict.fromkeys(("Fit", "Learning", "Parameter", "Picture", "Scene", "View", "fit"), "_scenes")
)


def __getattr__(name: str) -> Any:
    """What needs numpy from its first line on, loaded where it is asked for: the import of numpy takes longest."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # The module is an attribute of this one once it is loaded.
    __import__(f"{__name__}.{_LATER[name]}")
    value = globals()[name] = getattr(globals()[_LATER[name]], name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})


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
    """A texture that stays, or the levels that were given."""
    if not isinstance(texels, Texture):
        return None, [texels, *(mips or ())]
    if mips:
        raise RenderError("a Texture has levels of its own, and a sample of it was given mips")
    return texels, []


def _like(value: ArrayLike | Dual, array: NDArray[_T]) -> NDArray[_T]:
    """A number or a list as an array of the type of another array; arrays stay as they are."""
    if isinstance(value, type(array)):
        return value
    import numpy as np

    array_of: Any = value if isinstance(value, np.ndarray) or hasattr(value, "tangent") else np.asarray(value, array.dtype)
    return array_of


def _only(recorded: tuple[tuple[NDArray[_T]], PullBack]) -> tuple[NDArray[_T], PullBack]:
    (value,), pull_back = recorded
    return value, pull_back


# Cameras and poses.


def project(
    positions: NDArray[_T], camera: ArrayLike, rotation: ArrayLike | None = None, translation: ArrayLike | None = None
) -> tuple[NDArray[_T], PullBack]:
    """Positions `[V, 3]` in clip space, `[V, 4]`: the camera matrix `[4, 4]` times the posed positions.

    The pose is a quaternion `[4]` (x, y, z, w) and a translation `[3]`. Gradients: of positions, camera, rotation and
    translation.
    """
    optional = [value if value is None else _like(value, positions) for value in (rotation, translation)]
    return _only(_native.project(positions, _like(camera, positions), *optional))


def project_instances(
    positions: NDArray[_T], matrices: ArrayLike, camera: ArrayLike
) -> tuple[NDArray[_T], PullBack]:
    """Positions `[V, 3]` placed by each of the `matrices` `[I, 4, 4]`, in clip space: `[I V, 4]`.

    One instance comes after another. Gradients: of positions, matrices and camera.
    """
    return _only(_native.project_instances(positions, _like(matrices, positions), _like(camera, positions)))


def pinhole(
    intrinsics: NDArray[_T], size: int | Sequence[int], near: float, far: float
) -> tuple[NDArray[_T], PullBack]:
    """The matrix `[4, 4]` from a camera's space (x right, y down, z forward) to clip space.

    `intrinsics` `[4]` are focal lengths and principal point (fx, fy, cx, cy) in pixels, as OpenCV has them: the centre
    of the first pixel is (0, 0). `near` and `far` are distances along the view axis; `far` may be infinite. Gradients:
    of the intrinsics.
    """
    return _only(_native.pinhole(intrinsics, *size_of(size), near, far))


def orthographic(
    intrinsics: NDArray[_T], size: int | Sequence[int], near: float, far: float
) -> tuple[NDArray[_T], PullBack]:
    """As `pinhole`, for parallel rays: `intrinsics` `[4]` are pixels per unit and the centre, (sx, sy, cx, cy)."""
    return _only(_native.orthographic(intrinsics, *size_of(size), near, far))


def distort(points: NDArray[_T], coefficients: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """Points `[V, 3]` in a camera's space as its lens bends them, `[V, 3]`: `pinhole` comes next.

    `coefficients` are OpenCV's, `[5]` (k1, k2, p1, p2, k3) or `[8]` (then k4, k5, k6). Gradients: of points and
    coefficients.
    """
    return _only(_native.distort(points, _like(coefficients, points)))


def fisheye(points: NDArray[_T], coefficients: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """Points `[V, 3]` in a camera's space as a fisheye sees them, `[V, 3]`: `pinhole` comes next.

    `coefficients` `[4]` are those of OpenCV's module `fisheye`. The third number becomes the distance from the eye.
    Gradients: of points and coefficients.
    """
    return _only(_native.fisheye(points, _like(coefficients, points)))


def rigid(rotation: NDArray[_T], translation: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """The matrix `[4, 4]` of a quaternion `[4]` (x, y, z, w) of any length, then a translation `[3]`.

    Gradients: of both.
    """
    return _only(_native.rigid(rotation, _like(translation, rotation)))


def se3(increment: NDArray[_T], fixed: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """The pose `fixed` `[4, 4]` moved by an increment `[6]`, a translation and a rotation vector in radians: `[4, 4]`.

    The increment multiplies from the left. A fit starts at 0, and may put what it found into `fixed` after each step.
    Gradients: of the increment; `fixed` has none.
    """
    return _only(_native.se3(increment, _like(fixed, increment)))


def affine_inverse(matrix: NDArray[_T]) -> tuple[NDArray[_T], PullBack]:
    """The inverse of an affine matrix `[4, 4]`, whose last row is (0, 0, 0, 1). Gradients: of the matrix."""
    return _only(_native.affine_inverse(matrix))


def transform_points(points: NDArray[_T], matrix: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """Points `[V, 3]` moved by an affine matrix `[4, 4]`: `[V, 3]`. Gradients: of both."""
    return _only(_native.transform_points(points, _like(matrix, points)))


def transform_normals(normals: NDArray[_T], matrix: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """Normals `[N, 3]` of surfaces that a matrix `[4, 4]` or `[3, 3]` moves, of length 1: `[N, 3]`.

    Gradients: of both.
    """
    return _only(_native.transform_normals(normals, _like(matrix, normals)))


# Fragments.


def rasterize(
    clip: NDArray[_T], mesh: Mesh, size: int | Sequence[int], *, cull: str = "none", exact: bool = False,
    creases: Sequence[NDArray[_T] | tuple[NDArray[_T], Mesh | None]] = (), crease_tolerance: float = 2e-3,
) -> tuple[Fragments[NDArray[_T]], PullBack]:
    """The fragments of a mesh with vertices `clip` `[V, 4]`, in an image of `size` (height, width) or a square.

    `cull` is "none", "back" or "front". With `exact` pixels that a discontinuity crosses are resolved into pieces, each
    with its share: silhouettes then have their true gradient. `creases` are the attributes that will be shown, arrays
    `[V, C]` or pairs of an array and its own `Mesh`. Edges that bend one of them by more than `crease_tolerance` within
    a pixel are then resolved too.

    Returns `Fragments` and the pull-back of their barycentrics, and with `exact` of their weights, to `clip` (then to
    the creases' attributes, which get none).
    """
    height, width = size_of(size)
    pairs = [crease if isinstance(crease, tuple) else (crease, None) for crease in creases]
    coverage, found, pull_back = _native.rasterize(
        clip, mesh, height, width, cull, exact, pairs, crease_tolerance=crease_tolerance
    )
    return Fragments(found[0], found[1] if exact else None, clip, coverage), pull_back


def interpolate(
    attributes: NDArray[_T], fragments: Fragments[NDArray[_T]], mesh: Mesh | None = None
) -> tuple[NDArray[_T], PullBack]:
    """Attributes at vertices, `[V, C]`, at each fragment: `[N, C]`.

    `mesh` is the attributes' own index buffer, where that is not the positions'. Gradients: of attributes,
    barycentrics, clip positions and weights.
    """
    return _only(_native.interpolate(attributes, *fragments.arrays, fragments.coverage, mesh))


def interpolate_differentials(
    attributes: NDArray[_T], fragments: Fragments[NDArray[_T]], differentials: NDArray[_T], mesh: Mesh | None = None
) -> tuple[NDArray[_T], PullBack]:
    """How interpolated attributes change from pixel to pixel, `[N, C, 2]`.

    Gradients: of attributes, differentials, barycentrics, clip positions and weights.
    """
    recorded = _native.interpolate_differentials(
        attributes, differentials, *fragments.arrays, fragments.coverage, mesh
    )
    return _only(recorded)


def differentials(fragments: Fragments[NDArray[_T]]) -> tuple[NDArray[_T], PullBack]:
    """How the barycentrics change from pixel to pixel, `[N, 2, 2]`: d/dx and d/dy of u and of v, y down.

    Gradients: of barycentrics, clip positions and weights.
    """
    return _only(_native.differentials(*fragments.arrays, fragments.coverage))


def depth(fragments: Fragments[NDArray[_T]]) -> tuple[NDArray[_T], PullBack]:
    """z / w of each fragment, `[N]`, from -1 (near) to 1 (far).

    Gradients: of barycentrics, clip positions and weights.
    """
    return _only(_native.depth(*fragments.arrays, fragments.coverage))


def eye_depth(fragments: Fragments[NDArray[_T]]) -> tuple[NDArray[_T], PullBack]:
    """w of each fragment, `[N]`: for perspective cameras the distance along the view axis, for parallel rays 1.

    Gradients: of barycentrics, clip positions and weights.
    """
    return _only(_native.eye_depth(*fragments.arrays, fragments.coverage))


# Pictures.


def picture(
    values: NDArray[_T], fragments: Fragments[NDArray[_T]], background: ArrayLike | None = None, *,
    antialias: bool = True, reference: NDArray[_T] | None = None,
) -> tuple[NDArray[_T], PullBack]:
    """The image `[H, W, C]` of fragments that look like `values` `[N, C]`, before a background `[C]` or `[H, W, C]`.

    Silhouettes are antialiased, unless coverage is exact. With a `reference` image: the sum of the squared errors,
    `[]`, at the cost of what is covered. Gradients: of values, background, barycentrics, clip positions, weights.
    """
    behind = background if background is None else _like(background, values)
    recorded = _native.picture(values, behind, *fragments.arrays, fragments.coverage, antialias, reference)
    return _only(recorded)


def antialias_image(image: NDArray[_T], fragments: Fragments[NDArray[_T]]) -> tuple[NDArray[_T], PullBack]:
    """A dense image `[H, W, C]` with the silhouettes of the fragments' faces antialiased.

    Gradients: of the image, barycentrics (none) and clip positions.
    """
    barycentrics, clip, _ = fragments.arrays
    return _only(_native.antialias_image(image, barycentrics, clip, fragments.coverage))


def render(
    positions: NDArray[_T], mesh: Mesh, colors: NDArray[_T], size: int | Sequence[int], *,
    camera: ArrayLike | None = None, background: ArrayLike | None = None, color_mesh: Mesh | None = None,
    cull: str = "none", silhouettes: str = "exact", reference: NDArray[_T] | None = None,
    crease_tolerance: float = 2e-3,
) -> tuple[NDArray[_T], PullBack]:
    """A whole step: the image `[H, W, C]` of a mesh with colours at its vertices, `[V, C]`.

    `positions` are `[V, 3]` before a camera matrix `[4, 4]`, or without one `[V, 4]` in clip space. `silhouettes` are
    "exact", "antialias" or "aliased". Exact ones resolve the edges that bend a colour by more than `crease_tolerance`
    within a pixel, too. With a `reference` image: the sum of the squared errors, `[]`. Gradients: of positions, camera,
    colors and background, then of the reference, which gets none.

    >>> import numpy as np
    >>> mesh = Mesh(np.array([[0, 1, 2]]), 3)
    >>> clip = np.array([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]])
    >>> image, _ = render(clip, mesh, np.ones((3, 1)), 8)
    >>> float(image.sum().round(9))  # The area of the triangle in pixels: exactly.
    8.8
    >>> loss, pull_back = render(clip, mesh, np.ones((3, 1)), 8, reference=image)
    >>> clip_bar, *_ = pull_back(np.ones(()))
    >>> float(loss), float(abs(clip_bar).max())
    (0.0, 0.0)
    """
    height, width = size_of(size)
    matrix, behind = [value if value is None else _like(value, positions) for value in (camera, background)]
    recorded = _native.render(
        positions, matrix, colors, behind, mesh, height, width, color_mesh, cull, silhouettes, reference,
        crease_tolerance,
    )
    return _only(recorded)


# Textures.


def mipmaps(texels: NDArray[_T], coarsest: int | None = None) -> tuple[tuple[NDArray[_T], ...], PullBack]:
    """The coarser levels of texels `[H, W, C]`, or of a cube map's `[6, S, S, C]`: a tuple, each half as large.

    The last is a single texel, or level `coarsest`. Gradients: of the texels.
    """
    return _native.mipmaps(texels, coarsest)


def _sample(
    function: Callable[..., tuple[tuple[NDArray[_T]], PullBack]], texels: NDArray[_T] | Texture,
    coordinates: NDArray[_T], level: ArrayLike | None, differentials: NDArray[_T] | None, bias: ArrayLike | None,
    filter: str, border: str | Sequence[str], coarsest: int | None, probes: int, mips: Sequence[NDArray[_T]] | None,
) -> tuple[NDArray[_T], PullBack]:
    level, bias = [value if value is None else _like(value, coordinates) for value in (level, bias)]
    borders = (border, border) if isinstance(border, str) else tuple(border)
    # Without a level or differentials nobody asks for coarser levels.
    makes_mipmaps = _detail(level, differentials, bias, mips) and mips is None
    still, levels = _levels(texels, mips)
    return _only(
        function(
            coordinates, level, differentials, bias, levels, filter, borders, coarsest, probes, makes_mipmaps, still
        )
    )


def sample_texture(
    texels: NDArray[_T] | Texture, coordinates: NDArray[_T], *, level: ArrayLike | None = None,
    differentials: NDArray[_T] | None = None, bias: ArrayLike | None = None, filter: str = "trilinear",
    border: str | Sequence[str] = "wrap", coarsest: int | None = None, probes: int = 8,
    mips: Sequence[NDArray[_T]] | None = None,
) -> tuple[NDArray[_T], PullBack]:
    """Samples of texels `[H, W, C]` at coordinates (u, v), `[N, 2]`; (0, 0) is the upper left corner: `[N, C]`.

    The level of detail is `level` (`[N]` or a number), or follows from `differentials` `[N, 2, 2]` of the coordinates
    and a `bias`; without either it is the finest. `filter` is "nearest", "bilinear", "trilinear" or "anisotropic",
    `border` "wrap", "mirror", "clamp" or "zero", or one for u and one for v. `mips` are coarser levels of one's own.
    Gradients: of coordinates, level, differentials, bias, texels and mips.

    Mipmaps of an array are made in each call. Those of a `Texture` were made with it; then gradients end with the bias.

    >>> import numpy as np
    >>> texture = Texture(np.arange(16.0).reshape(4, 4, 1))
    >>> middle = np.array([[0.5, 0.5]])
    >>> [float(sample_texture(texture, middle, level=level)[0].item()) for level in (0, 2)]
    [7.5, 7.5]
    """
    return _sample(
        _native.sample_texture, texels, coordinates, level, differentials, bias, filter, border, coarsest, probes, mips
    )


def sample_cube_map(
    texels: NDArray[_T] | Texture, directions: NDArray[_T], *, level: ArrayLike | None = None,
    differentials: NDArray[_T] | None = None, bias: ArrayLike | None = None, filter: str = "trilinear",
    coarsest: int | None = None, probes: int = 8, mips: Sequence[NDArray[_T]] | None = None,
) -> tuple[NDArray[_T], PullBack]:
    """Samples of a cube map's texels `[6, S, S, C]` in directions `[N, 3]`: `[N, C]`. As `sample_texture`."""
    return _sample(
        _native.sample_cube_map, texels, directions, level, differentials, bias, filter, "wrap", coarsest, probes, mips
    )


# Normals and light.


def face_normals(positions: NDArray[_T], mesh: Mesh) -> tuple[NDArray[_T], PullBack]:
    """The normal of each face, `[F, 3]`, of length 1. Gradients: of positions `[V, 3]`."""
    return _only(_native.face_normals(positions, mesh))


def vertex_normals(
    positions: NDArray[_T], mesh: Mesh, weighting: str = "angle"
) -> tuple[NDArray[_T], PullBack]:
    """The normal at each vertex, `[V, 3]`: the mean of its faces', by "angle" or "area". Gradients: of positions."""
    return _only(_native.vertex_normals(positions, mesh, weighting))


def tangents(
    positions: NDArray[_T], normals: NDArray[_T], coordinates: NDArray[_T], mesh: Mesh,
    coordinates_mesh: Mesh | None = None,
) -> tuple[NDArray[_T], PullBack]:
    """The tangents of texture coordinates `[A, 2]`: unit vectors along which u grows, and bitangents' signs, `[A, 4]`.

    `positions` and `normals` are `[V, 3]`. `coordinates_mesh` is the coordinates' own index buffer, where that is not
    the positions'. Gradients: of positions, normals and coordinates.
    """
    return _only(_native.tangents(positions, normals, coordinates, mesh, coordinates_mesh))


def perturbed_normals(
    normals: NDArray[_T], tangents: NDArray[_T], values: NDArray[_T]
) -> tuple[NDArray[_T], PullBack]:
    """Normals `[N, 3]` turned by the values `[N, 3]` of a normal map, from -1 to 1, along tangents `[N, 4]`: `[N, 3]`.

    Gradients: of all three.
    """
    return _only(_native.perturbed_normals(normals, tangents, values))


def reflect(directions: NDArray[_T], normals: NDArray[_T]) -> tuple[NDArray[_T], PullBack]:
    """Directions `[N, 3]` mirrored at surfaces with normals `[N, 3]`. Gradients: of both."""
    return _only(_native.reflect(directions, normals))


def shade(
    normals: NDArray[_T], views: ArrayLike, material: Sequence[ArrayLike], lights: Sequence[tuple[Any, ...]], *,
    positions: NDArray[_T] | None = None, model: str = "metallic-roughness", conserves_energy: bool = False,
) -> tuple[NDArray[_T], PullBack]:
    """The radiance `[N, 3]` of surfaces with `normals` `[N, 3]`, seen from `views` `[N, 3]` or `[3]`, in `lights`.

    `views` lead from a surface to the eye. `material` is a list of arrays, each with a row for each fragment or one for
    all. Which they are, `model` says: base colour, roughness and metallic for "metallic-roughness", a colour for
    "lambert", colour, specular and exponent for "phong" and "blinn-phong". `lights` are tuples: ("directional",
    direction, irradiance), where the direction leads to the light; ("point", position, intensity), which needs
    `positions` `[N, 3]`; ("ambient", radiance).

    Gradients: of normals, views, positions, three of the material, and two of each light; `None` for those not there.
    """
    kinds, of_material, of_lights = surface_of(material, lights)
    own = [_like(values, normals) for values in of_material if values is not None]
    more = [values if values is None else _like(values, normals) for values in of_lights]
    places = positions if positions is None else _like(positions, normals)
    shining: list[Any] = list(zip(kinds, more[::2], more[1::2]))
    return _only(_native.shade(normals, _like(views, normals), places, own, model, shining, conserves_energy))


# Images.


def gaussian_blur(
    image: NDArray[_T], sigma: ArrayLike, *, kernel: str = "sampled", border: str = "mirror", tolerance: float = 1e-6,
    radius: int | None = None,
) -> tuple[NDArray[_T], PullBack]:
    """An image `[H, W, C]` blurred with standard deviation `sigma` in pixels, a number or `[]`.

    `kernel` is "sampled", "discrete", "unnormalized" or "disc"; `border` "mirror", "clamp" or "zero". The window misses
    at most the share `tolerance` of the weight, or reaches `radius` pixels. Gradients: of image and sigma.
    """
    return _only(_native.gaussian_blur(image, _like(sigma, image), kernel, border, tolerance, radius))


def depth_of_field(
    image: NDArray[_T], distances: NDArray[_T], aperture: ArrayLike, focus: ArrayLike, *, largest_sigma: float = 32.0,
    tolerance: float = 1e-3, blades: int | None = None, rotation: float = 0.0,
) -> tuple[NDArray[_T], PullBack]:
    """An image `[H, W, C]` as a lens sees it, with the distance of each pixel, `[H, W]`.

    `aperture` is the standard deviation in pixels of the blur at infinity, `focus` the distance that is sharp; both are
    numbers or `[]`. Blurs are Gaussian, up to `largest_sigma`. With `blades` they have the shape of the opening: 0 for
    a disc, 3 to 16 for a polygon that is turned by `rotation` in radians. Gradients: of image, distances, aperture and
    focus.
    """
    aperture, focus = _like(aperture, image), _like(focus, image)
    return _only(
        _native.depth_of_field(image, distances, aperture, focus, largest_sigma, tolerance, blades, rotation)
    )


def downsample(image: NDArray[_T], factor: int) -> tuple[NDArray[_T], PullBack]:
    """The means of blocks of `factor` by `factor` pixels. Gradients: of the image."""
    return _only(_native.downsample(image, factor))


def exposure(image: NDArray[_T], stops: ArrayLike) -> tuple[NDArray[_T], PullBack]:
    """An image times 2 to the power of `stops`, a number or `[]`. Gradients: of image and stops."""
    return _only(_native.exposure(image, _like(stops, image)))


def over(front: NDArray[_T], back: NDArray[_T]) -> tuple[NDArray[_T], PullBack]:
    """Premultiplied colours with alpha, `[.., 4]`, before others. Gradients: of both."""
    return _only(_native.over(front, back))


def srgb_encode(x: NDArray[_T]) -> tuple[NDArray[_T], PullBack]:
    """sRGB numbers of linear ones. Gradients: of the input."""
    return _only(_native.srgb_encode(x))


def srgb_decode(y: NDArray[_T]) -> tuple[NDArray[_T], PullBack]:
    """Linear numbers of sRGB ones. Gradients: of the input."""
    return _only(_native.srgb_decode(y))


@overload
def _of_numpy(describe: Callable[_P, Single]) -> Callable[_P, tuple[NDArray[Any], PullBack]]: ...
@overload
def _of_numpy(describe: Callable[_P, Step]) -> Callable[_P, tuple[Any, PullBack]]: ...
def _of_numpy(describe: Callable[..., Step]) -> Callable[..., tuple[Any, PullBack]]:
    """The function of numpy arrays that a description tells."""

    def function(*arguments: Any, **options: Any) -> tuple[Any, PullBack]:
        step = describe(*arguments, **options)
        first = next((x for x in step.arrays if hasattr(x, "dtype")), None)
        # Without an array nobody knows a type: the native module says so.
        arrays = [x if x is None or first is None else _like(x, first) for x in step.arrays]
        outputs, pull_back = step.run(*arrays)
        return step.result(outputs), pull_back

    return dressed(function, describe, "bokashi", "tuple[NDArray, PullBack]")


# Vectors and rows.

norm = _of_numpy(_operations.norm)
normalize = _of_numpy(_operations.normalize)
dot = _of_numpy(_operations.dot)
cross = _of_numpy(_operations.cross)
matmul = _of_numpy(_operations.matmul)
gather_rows = _of_numpy(_operations.gather_rows)
scatter_add_rows = _of_numpy(_operations.scatter_add_rows)
sparse_product = _of_numpy(_operations.sparse_product)
sigmoid = _of_numpy(_operations.sigmoid)
softplus = _of_numpy(_operations.softplus)

# Losses.

squared_error = _of_numpy(_operations.squared_error)
mean_error = _of_numpy(_operations.mean_error)
ssim_error = _of_numpy(_operations.ssim_error)
multiscale_ssim_error = _of_numpy(_operations.multiscale_ssim_error)
silhouette_error = _of_numpy(_operations.silhouette_error)
depth_error = _of_numpy(_operations.depth_error)
halved = _of_numpy(_operations.halved)

# Regularizers.

total_variation = _of_numpy(_operations.total_variation)
laplacian_error = _of_numpy(_operations.laplacian_error)
edge_length_error = _of_numpy(_operations.edge_length_error)
normal_error = _of_numpy(_operations.normal_error)
rigid_error = _of_numpy(_operations.rigid_error)

# Surfaces.

field_surface = _of_numpy(_operations.field_surface)
draw_points = _of_numpy(_operations.draw_points)
chamfer_distance = _of_numpy(_operations.chamfer_distance)

# Layers.

eye_depth_slope = _of_numpy(_operations.eye_depth_slope)
rasterize_behind = _of_numpy(_operations.rasterize_behind)
depth_layers = _of_numpy(_operations.depth_layers)
composite_layers = _of_numpy(_operations.composite_layers)
lens_picture = _of_numpy(_operations.lens_picture)

# Environments.

prefiltered = _of_numpy(_operations.prefiltered)
irradiance = _of_numpy(_operations.irradiance)
shade_in_environment = _of_numpy(_operations.shade_in_environment)
