"""The operations of `bokashi` on arrays of jax, with gradients.

>>> import jax, jax.numpy as jnp, bokashi.jax as bj
>>> mesh = bj.Mesh([[0, 1, 2]], 3)
>>> clip = jnp.array([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]])
>>> @jax.jit
... def loss(clip, colors, reference):
...     return bj.render(clip, mesh, colors, 8, reference=reference)
>>> value, clip_bar = jax.value_and_grad(loss)(clip, jnp.eye(3), jnp.zeros((8, 8, 3)))
>>> clip_bar.shape
(3, 4)

Arguments are those of `bokashi`; arrays of jax take the place of arrays and of pairs of value and pull-back.

Outside of `jit` every operation works. Inside, jax needs to know the shape of a result before it is computed. Where
the number of results is not known before, a function works outside alone: `rasterize`, `rasterize_behind`,
`depth_layers` and `field_surface`. Their fragments may be used inside, as arguments or closed over. All others work
inside too, also under `vmap`, one image after another. An argument with other fragments is compiled anew. `render` is a
whole step, and works anywhere.

A forward pass runs once, and leaves its tape to the backward pass. Where many wait, the oldest are dropped; their
forward passes run again if they are needed after all. Second derivatives and `jvp` are refused.
"""

from __future__ import annotations

import functools
import itertools
import secrets
import weakref
from collections.abc import Callable
from typing import Any, ParamSpec, overload

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero

from . import (
    Connectivity, Coverage, Environment, Fragments, Grid, LensLayer, Prefilter, RenderError, Rigidity, SparseMatrix,
    Texture, Topology, _operations, num_threads, set_num_threads,
)
from . import Mesh as _Mesh
from ._operations import Single, Step, dressed

__all__ = [
    "Connectivity", "Coverage", "Environment", "Fragments", "Grid", "LensLayer", "Mesh", "Prefilter", "RenderError",
    "Rigidity", "SparseMatrix", "Texture", "Topology", "affine_inverse", "antialias_image", "chamfer_distance",
    "composite_layers", "cross", "depth", "depth_error", "depth_layers", "depth_of_field", "differentials", "distort",
    "dot", "downsample", "draw_points", "edge_length_error", "exposure", "eye_depth", "eye_depth_slope", "face_normals",
    "field_surface", "fisheye", "gather_rows", "gaussian_blur", "halved", "interpolate", "interpolate_differentials",
    "irradiance", "laplacian_error", "lens_picture", "matmul", "mean_error", "mipmaps", "multiscale_ssim_error", "norm",
    "normal_error", "normalize", "num_threads", "orthographic", "over", "perturbed_normals", "picture", "pinhole",
    "prefiltered", "project", "project_instances", "rasterize", "rasterize_behind", "reflect", "render", "rigid",
    "rigid_error", "sample_cube_map", "sample_texture", "scatter_add_rows", "se3", "set_num_threads", "shade",
    "shade_in_environment", "sigmoid", "silhouette_error", "softplus", "sparse_product", "squared_error", "srgb_decode",
    "srgb_encode", "ssim_error", "tangents", "total_variation", "transform_normals", "transform_points",
    "vertex_normals",
]

_P = ParamSpec("_P")

jax.tree_util.register_dataclass(Fragments, ["barycentrics", "weight", "clip"], ["coverage"])


class _Kept:
    """Pull-backs by number, from a forward pass to its backward pass; the oldest go where there are too many."""

    # A vmap over a batch runs all forward passes first. Each keeps a tape, of several times the bytes of its arrays.
    MOST = 64
    MOST_BYTES = 2**27

    def __init__(self) -> None:
        self.known: dict[int, tuple[int, Callable]] = {}
        # Numbers of another process, in arrays that were saved, are not taken for our own.
        self.numbers = itertools.count(secrets.randbits(32))

    def put(self, pull_back: Callable, size: int) -> np.ndarray:
        """Keeps a pull-back whose arrays have `size` bytes, and says its number."""
        number = next(self.numbers) % 2**32
        # No lock: each line is safe by itself, and a finalizer may call `take` between any two.
        self.known[number] = size, pull_back
        *oldest, _ = kept = list(self.known.items())
        count, total = len(kept), sum(size for _, (size, _) in kept)
        for name, (size, _) in oldest:
            if count <= self.MOST and total <= self.MOST_BYTES:
                break
            count, total = count - 1, total - size
            self.take(name)
        return np.asarray(number, np.uint32)

    def take(self, number: int) -> Callable | None:
        """The pull-back of a number, once."""
        return self.known.pop(number, (0, None))[1]

    def look(self, number: int) -> Callable | None:
        """The pull-back of a number, to be used again."""
        return self.known.get(number, (0, None))[1]


_kept = _Kept()


@jax.tree_util.register_static
class _Wanted(tuple):
    """Which inputs need a gradient: known while jax traces."""


def _to_numpy(arrays):
    return jax.tree.map(np.asarray, arrays)


def _call(function: Callable, expected: Any, arrays: Any) -> Any:
    """A function of numpy arrays: at once where jax has numbers, else a callback with results like `expected`."""
    if not any(isinstance(array, jax.core.Tracer) for array in jax.tree.leaves(arrays)):
        return jax.tree.map(jnp.asarray, function(*_to_numpy(arrays)))
    if expected is None:
        raise RenderError(
            "the number of results is not known before: it needs to be outside of jit and vmap, got a tracer"
        )
    return jax.pure_callback(lambda *x: function(*_to_numpy(x)), expected, *arrays, vmap_method="sequential")


def _expected(run: Callable, shapes: Callable | None, arrays: Any) -> tuple | None:
    """What the outputs will look like, where that is known."""
    if shapes is None:
        return None
    dtype = next(array.dtype for array in arrays if array is not None)
    try:
        return tuple(jax.ShapeDtypeStruct(tuple(shape), dtype) for shape in shapes(*arrays))
    except (ArithmeticError, IndexError, ValueError):
        # An array has too many axes, or too few, or a number is 0: the operation says which.
        run(*(array if array is None else np.zeros(array.shape, array.dtype) for array in arrays))
        raise


@functools.partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _recorded(run: Callable, shapes: Callable | None, *arrays: Array | None) -> Any:
    """The outputs of a step: `run(*arrays)` returns them and its pull-back, `shapes(*arrays)` returns their shapes."""
    return _call(lambda *x: tuple(run(*x)[0]), _expected(run, shapes, arrays), arrays)


def _forward(run, shapes, *primals):
    wanted = _Wanted(primal is not None and primal.perturbed for primal in primals)
    arrays = tuple(primal if primal is None else primal.value for primal in primals)

    def forward(*x):
        outputs, pull_back = run(*x)
        size = sum(array.nbytes for array in (*x, *outputs) if array is not None)
        return tuple(outputs), _kept.put(pull_back, size)

    expected = _expected(run, shapes, arrays)
    outputs, number = _call(forward, expected and (expected, jax.ShapeDtypeStruct((), np.uint32)), arrays)
    if not isinstance(number, jax.core.Tracer):
        weakref.finalize(number, _kept.take, int(number)).atexit = False
    # With the arrays the forward pass can run again.
    return outputs, (number, arrays, wanted)


def _backward(run, shapes, residuals, upstream):
    del shapes
    number, arrays, wanted = residuals
    upstream = tuple(None if isinstance(bar, SymbolicZero) else bar for bar in upstream)
    # Outside of jit the tape lives as long as the number; inside nobody knows how long that is.
    find = _kept.take if isinstance(number, jax.core.Tracer) else _kept.look

    def backward(number, arrays, upstream):
        pull_back = find(int(number)) or run(*arrays)[1]
        bars = pull_back(*upstream, wanted=wanted)
        return tuple(
            (np.zeros_like(array) if bar is None else bar) if is_wanted else None
            for array, bar, is_wanted in zip(arrays, bars, wanted)
        )

    expected = tuple(
        jax.ShapeDtypeStruct(array.shape, array.dtype) if is_wanted else None
        for array, is_wanted in zip(arrays, wanted)
    )
    return _call(backward, expected, (number, arrays, upstream))


_recorded.defvjp(_forward, _backward, symbolic_zeros=True)


def _array(value, like=None):
    """A number or a list as an array, of the type of another; arrays stay as they are."""
    if value is None or isinstance(value, jax.Array):
        return value
    return jnp.asarray(value, None if like is None or hasattr(value, "dtype") else like.dtype)


def _constant(value, like):
    """An array without a gradient."""
    return value if value is None else jax.lax.stop_gradient(_array(value, like))


def Mesh(faces: Any, vertex_count: int) -> _Mesh:
    """The faces of a triangle mesh: vertex indices `[F, 3]`, an array or a list."""
    return _Mesh(np.asarray(faces), vertex_count)


@overload
def _of_jax(describe: Callable[_P, Single]) -> Callable[_P, Array]: ...
@overload
def _of_jax(describe: Callable[_P, Step]) -> Callable[_P, Any]: ...
def _of_jax(describe: Callable[..., Step]) -> Callable[..., Any]:
    """The function of arrays of jax that a description tells."""

    def function(*arguments: Any, **options: Any) -> Any:
        step = describe(*arguments, **options)
        typed = next((x for x in step.arrays if hasattr(x, "dtype")), None)
        first = _array(next(x for x in step.arrays if x is not None) if typed is None else typed)
        arrays = [_array(x, first) for x in step.arrays]
        for k in range(len(arrays) - len(step.constants), len(arrays)):
            arrays[k] = _constant(arrays[k], first)
        return step.result(_recorded(step.run, step.shapes, *arrays), arrays)

    return dressed(function, describe, "bokashi.jax", "Array", doc=f"As `bokashi.{describe.__name__}`.")


# Cameras and poses.

project = _of_jax(_operations.project)
project_instances = _of_jax(_operations.project_instances)
pinhole = _of_jax(_operations.pinhole)
orthographic = _of_jax(_operations.orthographic)
distort = _of_jax(_operations.distort)
fisheye = _of_jax(_operations.fisheye)
rigid = _of_jax(_operations.rigid)
se3 = _of_jax(_operations.se3)
affine_inverse = _of_jax(_operations.affine_inverse)
transform_points = _of_jax(_operations.transform_points)
transform_normals = _of_jax(_operations.transform_normals)

# Fragments.

rasterize = _of_jax(_operations.rasterize)
interpolate = _of_jax(_operations.interpolate)
interpolate_differentials = _of_jax(_operations.interpolate_differentials)
differentials = _of_jax(_operations.differentials)
depth = _of_jax(_operations.depth)
eye_depth = _of_jax(_operations.eye_depth)
eye_depth_slope = _of_jax(_operations.eye_depth_slope)

# Pictures.

picture = _of_jax(_operations.picture)
antialias_image = _of_jax(_operations.antialias_image)
render = _of_jax(_operations.render)

# Layers.

rasterize_behind = _of_jax(_operations.rasterize_behind)
depth_layers = _of_jax(_operations.depth_layers)
composite_layers = _of_jax(_operations.composite_layers)
lens_picture = _of_jax(_operations.lens_picture)

# Textures.

mipmaps = _of_jax(_operations.mipmaps)
sample_texture = _of_jax(_operations.sample_texture)
sample_cube_map = _of_jax(_operations.sample_cube_map)

# Normals and light.

face_normals = _of_jax(_operations.face_normals)
vertex_normals = _of_jax(_operations.vertex_normals)
tangents = _of_jax(_operations.tangents)
perturbed_normals = _of_jax(_operations.perturbed_normals)
reflect = _of_jax(_operations.reflect)
shade = _of_jax(_operations.shade)
prefiltered = _of_jax(_operations.prefiltered)
irradiance = _of_jax(_operations.irradiance)
shade_in_environment = _of_jax(_operations.shade_in_environment)

# Images.

gaussian_blur = _of_jax(_operations.gaussian_blur)
depth_of_field = _of_jax(_operations.depth_of_field)
downsample = _of_jax(_operations.downsample)
exposure = _of_jax(_operations.exposure)
over = _of_jax(_operations.over)
srgb_encode = _of_jax(_operations.srgb_encode)
srgb_decode = _of_jax(_operations.srgb_decode)

# Losses.

squared_error = _of_jax(_operations.squared_error)
mean_error = _of_jax(_operations.mean_error)
ssim_error = _of_jax(_operations.ssim_error)
multiscale_ssim_error = _of_jax(_operations.multiscale_ssim_error)
silhouette_error = _of_jax(_operations.silhouette_error)
depth_error = _of_jax(_operations.depth_error)
halved = _of_jax(_operations.halved)
total_variation = _of_jax(_operations.total_variation)

# Vectors and rows.

norm = _of_jax(_operations.norm)
normalize = _of_jax(_operations.normalize)
dot = _of_jax(_operations.dot)
cross = _of_jax(_operations.cross)
matmul = _of_jax(_operations.matmul)
gather_rows = _of_jax(_operations.gather_rows)
scatter_add_rows = _of_jax(_operations.scatter_add_rows)
sparse_product = _of_jax(_operations.sparse_product)
sigmoid = _of_jax(_operations.sigmoid)
softplus = _of_jax(_operations.softplus)

# Meshes.

laplacian_error = _of_jax(_operations.laplacian_error)
edge_length_error = _of_jax(_operations.edge_length_error)
normal_error = _of_jax(_operations.normal_error)
rigid_error = _of_jax(_operations.rigid_error)
field_surface = _of_jax(_operations.field_surface)
draw_points = _of_jax(_operations.draw_points)
chamfer_distance = _of_jax(_operations.chamfer_distance)
