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
from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, Union, overload

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero

from . import (
    Connectivity, Coverage, Environment, Fragments, Grid, LensLayer, Prefilter, RenderError, Rigidity, SparseMatrix, Texture, Topology,
    _detail, _levels, _native, _operations, num_threads, set_num_threads,
)
from . import Mesh as _Mesh
from ._given import size_of, surface_of
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

# An array, or what becomes one of the type of the others.
Value = Union[jax.typing.ArrayLike, Sequence]
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
    except (IndexError, ValueError):
        # An array has too many axes, or too few: the operation says which.
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


def _only(run: Callable, shape: Callable, *arrays: Array | None) -> Array:
    """The output of a step that has one."""
    (value,) = _recorded(run, lambda *x: (shape(*x),), *arrays)
    return value


def _array(value, like=None):
    """A number or a list as an array, of the type of another; arrays stay as they are."""
    if value is None or isinstance(value, jax.Array):
        return value
    return jnp.asarray(value, None if like is None or hasattr(value, "dtype") else like.dtype)


def _same(x, *_):
    return x.shape


def _matrix(*_):
    return 4, 4


def _still(value, like):
    """An array without a gradient."""
    return value if value is None else jax.lax.stop_gradient(_array(value, like))


def Mesh(faces: Any, vertex_count: int) -> _Mesh:
    """The faces of a triangle mesh: vertex indices `[F, 3]`, an array or a list."""
    return _Mesh(np.asarray(faces), vertex_count)


# Cameras and poses.


def project(
    positions: Array, camera: Value, rotation: Value | None = None, translation: Value | None = None
) -> Array:
    """As `bokashi.project`."""
    positions = _array(positions)
    more = [_array(value, positions) for value in (camera, rotation, translation)]
    return _only(_native.project, lambda x, *_: (x.shape[0], 4), positions, *more)


def project_instances(positions: Array, matrices: Value, camera: Value) -> Array:
    """As `bokashi.project_instances`."""
    positions = _array(positions)

    def shape(positions, matrices, _):
        return matrices.shape[0] * positions.shape[0], 4

    return _only(
        _native.project_instances, shape, positions, _array(matrices, positions), _array(camera, positions)
    )


def pinhole(intrinsics: Array, size: int | Sequence[int], near: float, far: float) -> Array:
    """As `bokashi.pinhole`."""
    return _only(lambda x: _native.pinhole(x, *size_of(size), near, far), _matrix, _array(intrinsics))


def orthographic(intrinsics: Array, size: int | Sequence[int], near: float, far: float) -> Array:
    """As `bokashi.orthographic`."""
    return _only(lambda x: _native.orthographic(x, *size_of(size), near, far), _matrix, _array(intrinsics))


def distort(points: Array, coefficients: Value) -> Array:
    """As `bokashi.distort`."""
    points = _array(points)
    return _only(_native.distort, _same, points, _array(coefficients, points))


def fisheye(points: Array, coefficients: Value) -> Array:
    """As `bokashi.fisheye`."""
    points = _array(points)
    return _only(_native.fisheye, _same, points, _array(coefficients, points))


def rigid(rotation: Array, translation: Value) -> Array:
    """As `bokashi.rigid`."""
    rotation = _array(rotation)
    return _only(_native.rigid, _matrix, rotation, _array(translation, rotation))


def se3(increment: Array, fixed: Value) -> Array:
    """As `bokashi.se3`."""
    increment = _array(increment)

    def run(increment, fixed):
        outputs, pull_back = _native.se3(increment, fixed)
        return outputs, lambda bar, wanted: (*pull_back(bar, wanted=wanted[:1]), None)

    return _only(run, _matrix, increment, _still(fixed, increment))


def affine_inverse(matrix: Array) -> Array:
    """As `bokashi.affine_inverse`."""
    return _only(_native.affine_inverse, _matrix, _array(matrix))


def transform_points(points: Array, matrix: Value) -> Array:
    """As `bokashi.transform_points`."""
    points = _array(points)
    return _only(_native.transform_points, _same, points, _array(matrix, points))


def transform_normals(normals: Array, matrix: Value) -> Array:
    """As `bokashi.transform_normals`."""
    normals = _array(normals)
    return _only(_native.transform_normals, _same, normals, _array(matrix, normals))


# Fragments.


def rasterize(
    clip: Array, mesh: _Mesh, size: int | Sequence[int], *, cull: str = "none", exact: bool = False,
    creases: Sequence[Array | tuple[Array, _Mesh | None]] = (), crease_tolerance: float = 2e-3,
) -> Fragments[Array]:
    """As `bokashi.rasterize`: fragments whose barycentrics and weights lead back to `clip`. Outside of `jit` alone."""
    clip = _array(clip)
    height, width = size_of(size)
    pairs = [crease if isinstance(crease, tuple) else (crease, None) for crease in creases]
    meshes = [mesh for _, mesh in pairs]
    found: list[Coverage] = []

    def run(clip, *attributes):
        coverage, outputs, pull_back = _native.rasterize(
            clip, mesh, height, width, cull, exact, list(zip(attributes, meshes)), crease_tolerance=crease_tolerance
        )
        found.append(coverage)
        return outputs, pull_back

    attributes = [jax.lax.stop_gradient(_array(values, clip)) for values, _ in pairs]
    barycentrics, *weight = _recorded(run, None, clip, *attributes)
    return Fragments(barycentrics, weight[0] if weight else None, clip, found[0])


def interpolate(attributes: Array, fragments: Fragments[Array], mesh: _Mesh | None = None) -> Array:
    """As `bokashi.interpolate`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.interpolate(*x, coverage, mesh)

    attributes = _array(attributes, fragments.clip)
    return _only(run, lambda x, *_: (len(coverage), x.shape[1]), attributes, *fragments.arrays)


def interpolate_differentials(
    attributes: Array, fragments: Fragments[Array], differentials: Array, mesh: _Mesh | None = None
) -> Array:
    """As `bokashi.interpolate_differentials`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.interpolate_differentials(*x, coverage, mesh)

    attributes, differentials = (_array(value, fragments.clip) for value in (attributes, differentials))
    return _only(run, lambda x, *_: (len(coverage), x.shape[1], 2), attributes, differentials, *fragments.arrays)


def differentials(fragments: Fragments[Array]) -> Array:
    """As `bokashi.differentials`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.differentials(*x, coverage)

    return _only(run, lambda *_: (len(coverage), 2, 2), *fragments.arrays)


def depth(fragments: Fragments[Array]) -> Array:
    """As `bokashi.depth`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.depth(*x, coverage)

    return _only(run, lambda *_: (len(coverage),), *fragments.arrays)


def eye_depth(fragments: Fragments[Array]) -> Array:
    """As `bokashi.eye_depth`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.eye_depth(*x, coverage)

    return _only(run, lambda *_: (len(coverage),), *fragments.arrays)


# Pictures.


def picture(
    values: Array, fragments: Fragments[Array], background: Value | None = None, *, antialias: bool = True,
    reference: Array | None = None,
) -> Array:
    """As `bokashi.picture`: an image, or with a `reference` a loss."""
    coverage = fragments.coverage
    values = _array(values, fragments.clip)

    def run(*x):
        *most, reference = x
        return _native.picture(*most, coverage, antialias, reference)

    def shape(values, *others):
        return _image_shape(coverage.size, values.shape[1], others[-1])

    arrays = values, _array(background, values), *fragments.arrays, _still(reference, values)
    return _only(run, shape, *arrays)


def antialias_image(image: Array, fragments: Fragments[Array]) -> Array:
    """As `bokashi.antialias_image`."""
    coverage = fragments.coverage

    def run(image, barycentrics, clip, _):
        return _native.antialias_image(image, barycentrics, clip, coverage)

    barycentrics, clip, _ = fragments.arrays
    return _only(run, _same, _array(image, clip), jax.lax.stop_gradient(barycentrics), clip, None)


def _image_shape(size: tuple[int, int], channels: int, reference: Any) -> tuple:
    """That of an image, or with a reference of a loss."""
    return (*size, channels) if reference is None else ()


def render(
    positions: Array, mesh: _Mesh, colors: Array, size: int | Sequence[int], *, camera: Value | None = None,
    background: Value | None = None, color_mesh: _Mesh | None = None, cull: str = "none", silhouettes: str = "exact",
    reference: Array | None = None, crease_tolerance: float = 2e-3,
) -> Array:
    """As `bokashi.render`: a whole step, an image, or with a `reference` a loss."""
    height, width = size_of(size)
    positions = _array(positions)

    def run(*x):
        *most, reference = x
        return _native.render(
            *most, mesh, height, width, color_mesh, cull, silhouettes, reference, crease_tolerance
        )

    def shape(*x):
        return _image_shape((height, width), x[2].shape[1], x[-1])

    arrays = [_array(value, positions) for value in (camera, colors, background)]
    return _only(run, shape, positions, *arrays, _still(reference, positions))


# Textures.


def mipmaps(texels: Array, coarsest: int | None = None) -> tuple[Array, ...]:
    """As `bokashi.mipmaps`."""

    def shapes(texels):
        *faces, height, width, channels = texels.shape
        levels = max(height, width, 1).bit_length() - 1
        return [
            (*faces, max(height >> k, 1), max(width >> k, 1), channels)
            for k in range(1, 1 + (levels if coarsest is None else min(levels, coarsest)))
        ]

    return _recorded(lambda texels: _native.mipmaps(texels, coarsest), shapes, _array(texels))


def _sample(function, texels, coordinates, level, differentials, bias, filter, border, coarsest, probes, mips):
    borders = (border, border) if isinstance(border, str) else tuple(border)
    still, levels = _levels(texels, mips)
    finest = _array(levels[0]) if levels else None
    levels = [_array(values, finest) for values in levels]
    coordinates = _array(coordinates, finest)
    level, differentials, bias = (_array(value, coordinates) for value in (level, differentials, bias))
    makes_mipmaps = _detail(level, differentials, bias, mips) and mips is None

    def run(coordinates, level, differentials, bias, *levels):
        return function(
            coordinates, level, differentials, bias, list(levels), filter, borders, coarsest, probes, makes_mipmaps,
            still,
        )

    def shape(*x):
        return x[0].shape[0], still.shape[-1] if still else x[4].shape[-1]

    return _only(run, shape, coordinates, level, differentials, bias, *levels)


def sample_texture(
    texels: Array | Texture, coordinates: Array, *, level: Value | None = None, differentials: Array | None = None,
    bias: Value | None = None, filter: str = "trilinear", border: str | Sequence[str] = "wrap",
    coarsest: int | None = None, probes: int = 8, mips: Sequence[Array] | None = None,
) -> Array:
    """As `bokashi.sample_texture`."""
    return _sample(
        _native.sample_texture, texels, coordinates, level, differentials, bias, filter, border, coarsest, probes, mips
    )


def sample_cube_map(
    texels: Array | Texture, directions: Array, *, level: Value | None = None, differentials: Array | None = None,
    bias: Value | None = None, filter: str = "trilinear", coarsest: int | None = None, probes: int = 8,
    mips: Sequence[Array] | None = None,
) -> Array:
    """As `bokashi.sample_cube_map`."""
    return _sample(
        _native.sample_cube_map, texels, directions, level, differentials, bias, filter, "wrap", coarsest, probes, mips
    )


# Normals and light.


def face_normals(positions: Array, mesh: _Mesh) -> Array:
    """As `bokashi.face_normals`."""
    return _only(lambda x: _native.face_normals(x, mesh), lambda _: (len(mesh), 3), _array(positions))


def vertex_normals(positions: Array, mesh: _Mesh, weighting: str = "angle") -> Array:
    """As `bokashi.vertex_normals`."""
    return _only(lambda x: _native.vertex_normals(x, mesh, weighting), _same, _array(positions))


def tangents(
    positions: Array, normals: Array, coordinates: Array, mesh: _Mesh, coordinates_mesh: _Mesh | None = None
) -> Array:
    """As `bokashi.tangents`."""
    positions = _array(positions)

    def run(positions, normals, coordinates):
        return _native.tangents(positions, normals, coordinates, mesh, coordinates_mesh)

    def shape(positions, normals, coordinates):
        return coordinates.shape[0], 4

    return _only(run, shape, positions, _array(normals, positions), _array(coordinates, positions))


def perturbed_normals(normals: Array, tangents: Array, values: Array) -> Array:
    """As `bokashi.perturbed_normals`."""
    normals = _array(normals)
    return _only(_native.perturbed_normals, _same, normals, _array(tangents, normals), _array(values, normals))


def reflect(directions: Array, normals: Array) -> Array:
    """As `bokashi.reflect`."""
    directions = _array(directions)
    return _only(_native.reflect, _same, directions, _array(normals, directions))


def shade(
    normals: Array, views: Value, material: Sequence[Value], lights: Sequence[tuple[Any, ...]], *,
    positions: Value | None = None, model: str = "metallic-roughness", conserves_energy: bool = False,
) -> Array:
    """As `bokashi.shade`."""
    kinds, of_material, of_lights = surface_of(material, lights)
    normals = _array(normals)

    def run(normals, views, positions, *arrays):
        own = [values for values in arrays[:3] if values is not None]
        shining = list(zip(kinds, arrays[3::2], arrays[4::2]))
        return _native.shade(normals, views, positions, own, model, shining, conserves_energy)

    arrays = [_array(values, normals) for values in (views, positions, *of_material, *of_lights)]
    return _only(run, _same, normals, *arrays)


# Images.


def gaussian_blur(
    image: Array, sigma: Value, *, kernel: str = "sampled", border: str = "mirror", tolerance: float = 1e-6,
    radius: int | None = None,
) -> Array:
    """As `bokashi.gaussian_blur`."""
    image = _array(image)

    def run(image, sigma):
        return _native.gaussian_blur(image, sigma, kernel, border, tolerance, radius)

    return _only(run, _same, image, _array(sigma, image))


def depth_of_field(
    image: Array, distances: Array, aperture: Value, focus: Value, *, largest_sigma: float = 32.0,
    tolerance: float = 1e-3, blades: int | None = None, rotation: float = 0.0,
) -> Array:
    """As `bokashi.depth_of_field`."""
    image = _array(image)

    def run(*x):
        return _native.depth_of_field(*x, largest_sigma, tolerance, blades, rotation)

    return _only(run, _same, image, *[_array(value, image) for value in (distances, aperture, focus)])


def downsample(image: Array, factor: int) -> Array:
    """As `bokashi.downsample`."""

    def shape(image):
        height, width, channels = image.shape
        return height // factor, width // factor, channels

    return _only(lambda x: _native.downsample(x, factor), shape, _array(image))


def exposure(image: Array, stops: Value) -> Array:
    """As `bokashi.exposure`."""
    image = _array(image)

    def shape(image, stops):
        return np.broadcast_shapes(image.shape, stops.shape)

    return _only(_native.exposure, shape, image, _array(stops, image))


def over(front: Array, back: Array) -> Array:
    """As `bokashi.over`."""
    front = _array(front)
    return _only(_native.over, _same, front, _array(back, front))


def srgb_encode(x: Array) -> Array:
    """As `bokashi.srgb_encode`."""
    return _only(_native.srgb_encode, _same, _array(x))


def srgb_decode(y: Array) -> Array:
    """As `bokashi.srgb_decode`."""
    return _only(_native.srgb_decode, _same, _array(y))


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
        for k in range(len(arrays) - len(step.still), len(arrays)):
            arrays[k] = _still(arrays[k], first)
        return step.result(_recorded(step.run, step.shapes, *arrays))

    return dressed(function, describe, "bokashi.jax", "Array", f"As `bokashi.{describe.__name__}`.")


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

# Losses.

squared_error = _of_jax(_operations.squared_error)
mean_error = _of_jax(_operations.mean_error)
ssim_error = _of_jax(_operations.ssim_error)
multiscale_ssim_error = _of_jax(_operations.multiscale_ssim_error)
silhouette_error = _of_jax(_operations.silhouette_error)
depth_error = _of_jax(_operations.depth_error)
halved = _of_jax(_operations.halved)

# Regularizers.

total_variation = _of_jax(_operations.total_variation)
laplacian_error = _of_jax(_operations.laplacian_error)
edge_length_error = _of_jax(_operations.edge_length_error)
normal_error = _of_jax(_operations.normal_error)
rigid_error = _of_jax(_operations.rigid_error)

# Surfaces.

field_surface = _of_jax(_operations.field_surface)
draw_points = _of_jax(_operations.draw_points)
chamfer_distance = _of_jax(_operations.chamfer_distance)

# Layers.

eye_depth_slope = _of_jax(_operations.eye_depth_slope)
rasterize_behind = _of_jax(_operations.rasterize_behind)
depth_layers = _of_jax(_operations.depth_layers)
composite_layers = _of_jax(_operations.composite_layers)
lens_picture = _of_jax(_operations.lens_picture)

# Environments.

prefiltered = _of_jax(_operations.prefiltered)
irradiance = _of_jax(_operations.irradiance)
shade_in_environment = _of_jax(_operations.shade_in_environment)
