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

from . import _native, _operations
from ._given import TYPE_CHECKING, Fragments
from ._native import (
    Connectivity, Coverage, Grid, Mesh, Prefilter, PullBack, RenderError, Rigidity, SceneError, SparseMatrix, Texture,
    Topology, num_threads, set_num_threads,
)
from ._operations import Single, Step, dressed

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any, ParamSpec, overload

    import numpy as np
    from numpy.typing import NDArray

    from ._check import Slope, check
    from ._dual import Dual, hvp, jvp
    from ._meshes import (
        DerivedMesh, FScore, NearestOnSurface, NearestPoints, f_score, nearest_on_surface, nearest_points,
        normal_consistency, remesh, self_intersections, signed_volume, smooth, subdivide, surface_area,
    )
    from ._operations.tuples import Environment, LensLayer
    from ._scenes import Fit, Learning, Parameter, Picture, Scene, View, fit

    _P = ParamSpec("_P")

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

_MESHES = """
    DerivedMesh FScore NearestOnSurface NearestPoints f_score nearest_on_surface nearest_points normal_consistency
    remesh self_intersections signed_volume smooth subdivide surface_area
"""

_LATER = (
    {"Slope": "_check", "check": "_check"}
    | dict.fromkeys(("Environment", "LensLayer"), "_operations.tuples")
    | dict.fromkeys(("Dual", "hvp", "jvp"), "_dual")
    | dict.fromkeys(_MESHES.split(), "_meshes")
    | dict.fromkeys(("Fit", "Learning", "Parameter", "Picture", "Scene", "View", "fit"), "_scenes")
)


def __getattr__(name: str) -> Any:
    """What needs numpy or `typing` from its first line on, loaded where it is asked for: they take longest."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = __import__(f"{__name__}.{_LATER[name]}", fromlist=[name])
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})


def _like(value: Any, array: Any) -> Any:
    """A number or a list as an array of the type of another array; arrays stay as they are."""
    import numpy as np

    return value if isinstance(value, np.ndarray) or hasattr(value, "tangent") else np.asarray(value, array.dtype)


if TYPE_CHECKING:
    @overload
    def _of_numpy(describe: Callable[_P, Single]) -> Callable[_P, tuple[NDArray[Any], PullBack]]: ...
    @overload
    def _of_numpy(describe: Callable[_P, Step]) -> Callable[_P, tuple[Any, PullBack]]: ...


def _of_numpy(describe: Callable[..., Step]) -> Callable[..., tuple[Any, PullBack]]:
    """The function of numpy arrays that a description tells."""

    def function(*arguments: Any, **options: Any) -> tuple[Any, PullBack]:
        step = describe(*arguments, **options)
        arrays = step.arrays
        for first in arrays:
            if hasattr(first, "dtype"):
                # Most are arrays: a microsecond is spared by not asking more of them.
                kind = type(first)
                arrays = [x if x is None or isinstance(x, kind) else _like(x, first) for x in arrays]
                break
        # Without an array nobody knows a type: the native module says so.
        outputs, pull_back = step.run(*arrays)
        return step.result(outputs, arrays), pull_back

    return dressed(function, describe, "bokashi", "NDArray", "tuple[{}, PullBack]")


# Cameras and poses.

project = _of_numpy(_operations.project)
project_instances = _of_numpy(_operations.project_instances)
pinhole = _of_numpy(_operations.pinhole)
orthographic = _of_numpy(_operations.orthographic)
distort = _of_numpy(_operations.distort)
fisheye = _of_numpy(_operations.fisheye)
rigid = _of_numpy(_operations.rigid)
se3 = _of_numpy(_operations.se3)
affine_inverse = _of_numpy(_operations.affine_inverse)
transform_points = _of_numpy(_operations.transform_points)
transform_normals = _of_numpy(_operations.transform_normals)

# Fragments.

rasterize = _of_numpy(_operations.rasterize)
interpolate = _of_numpy(_operations.interpolate)
interpolate_differentials = _of_numpy(_operations.interpolate_differentials)
differentials = _of_numpy(_operations.differentials)
depth = _of_numpy(_operations.depth)
eye_depth = _of_numpy(_operations.eye_depth)
eye_depth_slope = _of_numpy(_operations.eye_depth_slope)

# Pictures.

picture = _of_numpy(_operations.picture)
antialias_image = _of_numpy(_operations.antialias_image)
render = _of_numpy(_operations.render)

# Layers.

rasterize_behind = _of_numpy(_operations.rasterize_behind)
depth_layers = _of_numpy(_operations.depth_layers)
composite_layers = _of_numpy(_operations.composite_layers)
lens_picture = _of_numpy(_operations.lens_picture)

# Textures.

mipmaps = _of_numpy(_operations.mipmaps)
sample_texture = _of_numpy(_operations.sample_texture)
sample_cube_map = _of_numpy(_operations.sample_cube_map)

# Normals and light.

face_normals = _of_numpy(_operations.face_normals)
vertex_normals = _of_numpy(_operations.vertex_normals)
tangents = _of_numpy(_operations.tangents)
perturbed_normals = _of_numpy(_operations.perturbed_normals)
reflect = _of_numpy(_operations.reflect)
shade = _of_numpy(_operations.shade)
prefiltered = _of_numpy(_operations.prefiltered)
irradiance = _of_numpy(_operations.irradiance)
shade_in_environment = _of_numpy(_operations.shade_in_environment)

# Images.

gaussian_blur = _of_numpy(_operations.gaussian_blur)
depth_of_field = _of_numpy(_operations.depth_of_field)
downsample = _of_numpy(_operations.downsample)
exposure = _of_numpy(_operations.exposure)
over = _of_numpy(_operations.over)
srgb_encode = _of_numpy(_operations.srgb_encode)
srgb_decode = _of_numpy(_operations.srgb_decode)

# Losses.

squared_error = _of_numpy(_operations.squared_error)
mean_error = _of_numpy(_operations.mean_error)
ssim_error = _of_numpy(_operations.ssim_error)
multiscale_ssim_error = _of_numpy(_operations.multiscale_ssim_error)
silhouette_error = _of_numpy(_operations.silhouette_error)
depth_error = _of_numpy(_operations.depth_error)
halved = _of_numpy(_operations.halved)
total_variation = _of_numpy(_operations.total_variation)

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

# Meshes.

laplacian_error = _of_numpy(_operations.laplacian_error)
edge_length_error = _of_numpy(_operations.edge_length_error)
normal_error = _of_numpy(_operations.normal_error)
rigid_error = _of_numpy(_operations.rigid_error)
field_surface = _of_numpy(_operations.field_surface)
draw_points = _of_numpy(_operations.draw_points)
chamfer_distance = _of_numpy(_operations.chamfer_distance)
