"""The operations of `bokashi` on CPU tensors of torch, with gradients.

Surface first: `rasterize` gives the covered samples alone, `[N, ..]`; what is computed on them is ordinary torch;
`picture` makes the image. `render` and `Renderer` are a whole step in one call, which is fastest.

>>> import torch, bokashi.torch as bt
>>> mesh = bt.Mesh(torch.tensor([[0, 1, 2]]), 3)
>>> clip = torch.tensor([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]], requires_grad=True)
>>> fragments = bt.rasterize(clip, mesh, 8, exact=True)
>>> image = bt.picture(bt.interpolate(torch.eye(3), fragments), fragments)
>>> image.sum().backward()
>>> clip.grad.shape
torch.Size([3, 4])

Derivatives of forward mode (`torch.autograd.forward_ad`) are there, too; second derivatives are refused. Arguments are
those of `bokashi`; tensors take the place of arrays and of pairs of value and pull-back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, Union, overload

import numpy as np
import torch
from torch import Tensor
from torch.autograd.forward_ad import unpack_dual
from torch.autograd.function import once_differentiable

from . import (
    Connectivity, Coverage, Environment, Fragments, Grid, LensLayer, Prefilter, RenderError, Rigidity, SparseMatrix, Texture, Topology,
    _detail, _levels, _native, _operations, num_threads, set_num_threads,
)
from . import Mesh as _Mesh
from ._dual import Dual
from ._given import size_of, surface_of
from ._operations import Single, Step, dressed

__all__ = [
    "Connectivity", "Coverage", "Environment", "Fragments", "Grid", "LensLayer", "Mesh", "Prefilter", "RenderError",
    "Renderer", "Rigidity", "SparseMatrix", "Texture", "Topology", "affine_inverse", "antialias_image",
    "chamfer_distance", "composite_layers", "cross", "depth", "depth_error", "depth_layers", "depth_of_field",
    "differentials", "distort", "dot", "downsample", "draw_points", "edge_length_error", "exposure", "eye_depth",
    "eye_depth_slope", "face_normals", "field_surface", "fisheye", "gather_rows", "gaussian_blur", "halved",
    "interpolate", "interpolate_differentials", "irradiance", "laplacian_error", "lens_picture", "matmul", "mean_error",
    "mipmaps", "multiscale_ssim_error", "norm", "normal_error", "normalize", "num_threads", "orthographic", "over",
    "perturbed_normals", "picture", "pinhole", "prefiltered", "project", "project_instances", "rasterize",
    "rasterize_behind", "reflect", "render", "rigid", "rigid_error", "sample_cube_map", "sample_texture",
    "scatter_add_rows", "se3", "set_num_threads", "shade", "shade_in_environment", "sigmoid", "silhouette_error",
    "softplus", "sparse_product", "squared_error", "srgb_decode", "srgb_encode", "ssim_error", "tangents",
    "total_variation", "transform_normals", "transform_points", "vertex_normals",
]


# A tensor, or what becomes one of the type of the others.
Value = Union[Tensor, float, Sequence]
_P = ParamSpec("_P")


def _to_array(tensor: Tensor | None) -> Any:
    """The numbers of a tensor, not copied unless it is not contiguous."""
    if tensor is None:
        return None
    if not isinstance(tensor, Tensor):
        raise TypeError(f"bokashi.torch needs tensors, got {type(tensor).__name__}")
    if tensor.device.type != "cpu":
        raise RenderError(f"bokashi runs on a CPU and needs tensors that are there, got one on {tensor.device}")
    return tensor.detach().contiguous().numpy()


def _to_tensor(array: Any) -> Tensor | None:
    return None if array is None else torch.from_numpy(array)


class _Recorded(torch.autograd.Function):
    """A step: `run(*arrays)` returns its outputs and its pull-back."""

    @staticmethod
    def forward(ctx, run, *tensors):
        outputs, ctx.pull_back = run(*map(_to_array, tensors))
        ctx.set_materialize_grads(False)
        ctx.save_for_forward(*tensors)
        ctx.run, ctx.has_tangents = run, False
        return tuple(map(torch.from_numpy, outputs))

    @staticmethod
    def jvp(ctx, _, *tangents):
        ctx.has_tangents = True
        pairs = list(zip(map(_to_array, ctx.saved_tensors), map(_to_array, tangents)))
        outputs, _ = ctx.run(*(x if v is None else Dual(x, v) for x, v in pairs))
        dtype = next(x.dtype for x, _ in pairs if x is not None)
        return tuple(torch.from_numpy(y.tangent.astype(dtype, copy=False)) for y in outputs)

    @staticmethod
    @once_differentiable
    def backward(ctx, *upstream):
        # Tangents of gradients would be lost in silence.
        if ctx.has_tangents or any(unpack_dual(bar).tangent is not None for bar in upstream if bar is not None):
            raise RenderError("gradients have no tangents in torch: take bokashi.hvp")
        wanted = ctx.needs_input_grad[1:]
        gradients = ctx.pull_back(*map(_to_array, upstream), wanted=wanted)
        return None, *map(_to_tensor, gradients)


@torch.compiler.disable
def _record(run: Callable, *tensors: Tensor | None) -> tuple[Tensor, ...]:
    """The outputs of a step. Tensors are in the order of the native function's inputs."""
    return _Recorded.apply(run, *tensors)


def _only(run: Callable, *tensors: Tensor | None) -> Tensor:
    (value,) = _record(run, *tensors)
    return value


def _like(value: Value | None, tensor: Tensor) -> Tensor | None:
    """A number as a tensor of the type of another; tensors and `None` stay as they are."""
    return value if value is None or isinstance(value, torch.Tensor) else torch.as_tensor(value, dtype=tensor.dtype)


def _still(name: str, tensor: Tensor | None) -> Any:
    """The numbers of a tensor that gets no gradient. One that asks for it is refused, not left without in silence."""
    if isinstance(tensor, Tensor):
        if tensor.requires_grad and torch.is_grad_enabled():
            raise RenderError(f"{name} has no gradient here and needs to be detached, got a tensor that requires one")
        if unpack_dual(tensor).tangent is not None:
            raise RenderError(f"{name} has no tangent here and needs to be detached, got a tensor with one")
    return _to_array(tensor)


def Mesh(faces: Any, vertex_count: int) -> _Mesh:
    """The faces of a triangle mesh: vertex indices `[F, 3]`, a tensor or an array of int32 or int64."""
    return _Mesh(_to_array(faces) if isinstance(faces, torch.Tensor) else np.asarray(faces), vertex_count)


# Cameras and poses.


def project(
    positions: Tensor, camera: Value, rotation: Value | None = None, translation: Value | None = None
) -> Tensor:
    """As `bokashi.project`."""
    optional = [_like(value, positions) for value in (rotation, translation)]
    return _only(_native.project, positions, _like(camera, positions), *optional)


def project_instances(positions: Tensor, matrices: Value, camera: Value) -> Tensor:
    """As `bokashi.project_instances`."""
    return _only(_native.project_instances, positions, _like(matrices, positions), _like(camera, positions))


def pinhole(intrinsics: Tensor, size: int | Sequence[int], near: float, far: float) -> Tensor:
    """As `bokashi.pinhole`."""
    return _only(lambda x: _native.pinhole(x, *size_of(size), near, far), intrinsics)


def orthographic(intrinsics: Tensor, size: int | Sequence[int], near: float, far: float) -> Tensor:
    """As `bokashi.orthographic`."""
    return _only(lambda x: _native.orthographic(x, *size_of(size), near, far), intrinsics)


def distort(points: Tensor, coefficients: Value) -> Tensor:
    """As `bokashi.distort`."""
    return _only(_native.distort, points, _like(coefficients, points))


def fisheye(points: Tensor, coefficients: Value) -> Tensor:
    """As `bokashi.fisheye`."""
    return _only(_native.fisheye, points, _like(coefficients, points))


def rigid(rotation: Tensor, translation: Value) -> Tensor:
    """As `bokashi.rigid`."""
    return _only(_native.rigid, rotation, _like(translation, rotation))


def se3(increment: Tensor, fixed: Value) -> Tensor:
    """As `bokashi.se3`."""
    pose = _still("fixed", _like(fixed, increment))
    return _only(lambda x: _native.se3(x, pose), increment)


def affine_inverse(matrix: Tensor) -> Tensor:
    """As `bokashi.affine_inverse`."""
    return _only(_native.affine_inverse, matrix)


def transform_points(points: Tensor, matrix: Value) -> Tensor:
    """As `bokashi.transform_points`."""
    return _only(_native.transform_points, points, _like(matrix, points))


def transform_normals(normals: Tensor, matrix: Value) -> Tensor:
    """As `bokashi.transform_normals`."""
    return _only(_native.transform_normals, normals, _like(matrix, normals))


# Fragments.


def rasterize(
    clip: Tensor, mesh: _Mesh, size: int | Sequence[int], *, cull: str = "none", exact: bool = False,
    creases: Sequence[Tensor | tuple[Tensor, _Mesh | None]] = (), crease_tolerance: float = 2e-3,
) -> Fragments[Tensor]:
    """As `bokashi.rasterize`: fragments whose barycentrics and weights lead back to `clip`."""
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

    barycentrics, *weight = _record(run, clip, *[values.detach() for values, _ in pairs])
    return Fragments(barycentrics, weight[0] if weight else None, clip, found[0])


def interpolate(attributes: Tensor, fragments: Fragments[Tensor], mesh: _Mesh | None = None) -> Tensor:
    """As `bokashi.interpolate`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.interpolate(*x, coverage, mesh)

    return _only(run, attributes, *fragments.arrays)


def interpolate_differentials(
    attributes: Tensor, fragments: Fragments[Tensor], differentials: Tensor, mesh: _Mesh | None = None
) -> Tensor:
    """As `bokashi.interpolate_differentials`."""
    coverage = fragments.coverage

    def run(*x):
        return _native.interpolate_differentials(*x, coverage, mesh)

    return _only(run, attributes, differentials, *fragments.arrays)


def differentials(fragments: Fragments[Tensor]) -> Tensor:
    """As `bokashi.differentials`."""

    def run(*x):
        return _native.differentials(*x, fragments.coverage)

    return _only(run, *fragments.arrays)


def depth(fragments: Fragments[Tensor]) -> Tensor:
    """As `bokashi.depth`."""

    def run(*x):
        return _native.depth(*x, fragments.coverage)

    return _only(run, *fragments.arrays)


def eye_depth(fragments: Fragments[Tensor]) -> Tensor:
    """As `bokashi.eye_depth`."""

    def run(*x):
        return _native.eye_depth(*x, fragments.coverage)

    return _only(run, *fragments.arrays)


# Pictures.


def picture(
    values: Tensor, fragments: Fragments[Tensor], background: Value | None = None, *, antialias: bool = True,
    reference: Tensor | None = None,
) -> Tensor:
    """As `bokashi.picture`: an image, or with a `reference` a loss."""
    coverage = fragments.coverage
    target = _still("reference", reference)

    def run(*x):
        return _native.picture(*x, coverage, antialias, target)

    # The reference is the last input, without a gradient.
    tensors = values, _like(background, values), *fragments.arrays
    return _only(_with_spare(run, target), *tensors)


def antialias_image(image: Tensor, fragments: Fragments[Tensor]) -> Tensor:
    """As `bokashi.antialias_image`."""
    coverage = fragments.coverage

    def run(image, clip, barycentrics):
        outputs, pull_back = _native.antialias_image(image, barycentrics, clip, coverage)

        def pull(*upstream, wanted):
            image_bar, _, clip_bar, _ = pull_back(*upstream, wanted=(wanted[0], False, wanted[1], False))
            return image_bar, clip_bar, None

        return outputs, pull

    barycentrics, clip, _ = fragments.arrays
    return _only(run, image, clip, barycentrics.detach())


def _with_spare(run: Callable, *spare: Any) -> Callable:
    """A step with further inputs that have no gradient."""

    def run_with(*arrays):
        outputs, pull_back = run(*arrays)
        more = (False,) * len(spare)

        def pull(*upstream, wanted):
            return pull_back(*upstream, wanted=(*wanted, *more))[: len(wanted)]

        return outputs, pull

    return run_with


def render(
    positions: Tensor, mesh: _Mesh, colors: Tensor, size: int | Sequence[int], *, camera: Value | None = None,
    background: Value | None = None, color_mesh: _Mesh | None = None, cull: str = "none", silhouettes: str = "exact",
    reference: Tensor | None = None, crease_tolerance: float = 2e-3,
) -> Tensor:
    """As `bokashi.render`: a whole step, an image, or with a `reference` a loss."""
    height, width = size_of(size)
    target = _still("reference", reference)

    def run(*x):
        return _native.render(
            *x, mesh, height, width, color_mesh, cull, silhouettes, target, crease_tolerance
        )

    tensors = positions, _like(camera, positions), colors, _like(background, positions)
    return _only(_with_spare(run, target), *tensors)


class Renderer(torch.nn.Module):
    """`render` as a module: a mesh, an image size and how silhouettes look.

    >>> renderer = Renderer(Mesh(torch.tensor([[0, 1, 2]]), 3), 8)
    >>> clip = torch.tensor([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]], requires_grad=True)
    >>> renderer(clip, torch.ones(3, 1), reference=torch.zeros(8, 8, 1)).backward()
    >>> bool(clip.grad[2, 1] > 0)  # A taller triangle is further from black.
    True
    """

    def __init__(
        self, mesh: _Mesh, size: int | Sequence[int], *, color_mesh: _Mesh | None = None, cull: str = "none",
        silhouettes: str = "exact", crease_tolerance: float = 2e-3,
    ) -> None:
        super().__init__()
        self.mesh, self.size, self.color_mesh = mesh, size_of(size), color_mesh
        self.cull, self.silhouettes, self.crease_tolerance = cull, silhouettes, crease_tolerance

    def forward(
        self, positions: Tensor, colors: Tensor, camera: Value | None = None, background: Value | None = None,
        reference: Tensor | None = None,
    ) -> Tensor:
        """The image of positions and colours, or with a reference image the sum of the squared errors."""
        return render(
            positions, self.mesh, colors, self.size, camera=camera, background=background, color_mesh=self.color_mesh,
            cull=self.cull, silhouettes=self.silhouettes, reference=reference,
            crease_tolerance=self.crease_tolerance,
        )

    def extra_repr(self) -> str:
        return f"{self.mesh!r}, size={self.size}, cull={self.cull!r}, silhouettes={self.silhouettes!r}"


# Textures.


def mipmaps(texels: Tensor, coarsest: int | None = None) -> tuple[Tensor, ...]:
    """As `bokashi.mipmaps`."""
    return _record(lambda texels: _native.mipmaps(texels, coarsest), texels)


def _sample(
    function: Callable, texels: Tensor | Texture, coordinates: Tensor, level: Value | None,
    differentials: Tensor | None, bias: Value | None, filter: str, border: str | Sequence[str], coarsest: int | None,
    probes: int, mips: Sequence[Tensor] | None,
) -> Tensor:
    borders = (border, border) if isinstance(border, str) else tuple(border)
    level, bias = _like(level, coordinates), _like(bias, coordinates)
    makes_mipmaps = _detail(level, differentials, bias, mips) and mips is None

    still, own = _levels(texels, mips)

    def run(coordinates, level, differentials, bias, *levels):
        return function(
            coordinates, level, differentials, bias, list(levels), filter, borders, coarsest, probes, makes_mipmaps,
            still,
        )

    return _only(run, coordinates, level, differentials, bias, *own)


def sample_texture(
    texels: Tensor | Texture, coordinates: Tensor, *, level: Value | None = None, differentials: Tensor | None = None,
    bias: Value | None = None, filter: str = "trilinear", border: str | Sequence[str] = "wrap",
    coarsest: int | None = None, probes: int = 8, mips: Sequence[Tensor] | None = None,
) -> Tensor:
    """As `bokashi.sample_texture`."""
    return _sample(
        _native.sample_texture, texels, coordinates, level, differentials, bias, filter, border, coarsest, probes, mips
    )


def sample_cube_map(
    texels: Tensor | Texture, directions: Tensor, *, level: Value | None = None, differentials: Tensor | None = None,
    bias: Value | None = None, filter: str = "trilinear", coarsest: int | None = None, probes: int = 8,
    mips: Sequence[Tensor] | None = None,
) -> Tensor:
    """As `bokashi.sample_cube_map`."""
    return _sample(
        _native.sample_cube_map, texels, directions, level, differentials, bias, filter, "wrap", coarsest, probes, mips
    )


# Normals and light.


def face_normals(positions: Tensor, mesh: _Mesh) -> Tensor:
    """As `bokashi.face_normals`."""
    return _only(lambda x: _native.face_normals(x, mesh), positions)


def vertex_normals(positions: Tensor, mesh: _Mesh, weighting: str = "angle") -> Tensor:
    """As `bokashi.vertex_normals`."""
    return _only(lambda x: _native.vertex_normals(x, mesh, weighting), positions)


def tangents(
    positions: Tensor, normals: Tensor, coordinates: Tensor, mesh: _Mesh, coordinates_mesh: _Mesh | None = None
) -> Tensor:
    """As `bokashi.tangents`."""

    def run(positions, normals, coordinates):
        return _native.tangents(positions, normals, coordinates, mesh, coordinates_mesh)

    return _only(run, positions, normals, coordinates)


def perturbed_normals(normals: Tensor, tangents: Tensor, values: Tensor) -> Tensor:
    """As `bokashi.perturbed_normals`."""
    return _only(_native.perturbed_normals, normals, tangents, values)


def reflect(directions: Tensor, normals: Tensor) -> Tensor:
    """As `bokashi.reflect`."""
    return _only(_native.reflect, directions, normals)


def shade(
    normals: Tensor, views: Value, material: Sequence[Value], lights: Sequence[tuple[Any, ...]], *,
    positions: Value | None = None, model: str = "metallic-roughness", conserves_energy: bool = False,
) -> Tensor:
    """As `bokashi.shade`."""
    kinds, of_material, of_lights = surface_of(material, lights)

    def run(normals, views, positions, *arrays):
        own = [values for values in arrays[:3] if values is not None]
        shining = list(zip(kinds, arrays[3::2], arrays[4::2]))
        return _native.shade(normals, views, positions, own, model, shining, conserves_energy)

    return _only(run, normals, *[_like(values, normals) for values in (views, positions, *of_material, *of_lights)])


# Images.


def gaussian_blur(
    image: Tensor, sigma: Value, *, kernel: str = "sampled", border: str = "mirror", tolerance: float = 1e-6,
    radius: int | None = None,
) -> Tensor:
    """As `bokashi.gaussian_blur`."""

    def run(image, sigma):
        return _native.gaussian_blur(image, sigma, kernel, border, tolerance, radius)

    return _only(run, image, _like(sigma, image))


def depth_of_field(
    image: Tensor, distances: Tensor, aperture: Value, focus: Value, *, largest_sigma: float = 32.0,
    tolerance: float = 1e-3, blades: int | None = None, rotation: float = 0.0,
) -> Tensor:
    """As `bokashi.depth_of_field`."""

    def run(*x):
        return _native.depth_of_field(*x, largest_sigma, tolerance, blades, rotation)

    return _only(run, image, distances, _like(aperture, image), _like(focus, image))


def downsample(image: Tensor, factor: int) -> Tensor:
    """As `bokashi.downsample`."""
    return _only(lambda x: _native.downsample(x, factor), image)


def exposure(image: Tensor, stops: Value) -> Tensor:
    """As `bokashi.exposure`."""
    return _only(_native.exposure, image, _like(stops, image))


def over(front: Tensor, back: Tensor) -> Tensor:
    """As `bokashi.over`."""
    return _only(_native.over, front, back)


def srgb_encode(x: Tensor) -> Tensor:
    """As `bokashi.srgb_encode`."""
    return _only(_native.srgb_encode, x)


def srgb_decode(y: Tensor) -> Tensor:
    """As `bokashi.srgb_decode`."""
    return _only(_native.srgb_decode, y)


@overload
def _of_torch(describe: Callable[_P, Single]) -> Callable[_P, Tensor]: ...
@overload
def _of_torch(describe: Callable[_P, Step]) -> Callable[_P, Any]: ...
def _of_torch(describe: Callable[..., Step]) -> Callable[..., Any]:
    """The function of tensors that a description tells."""

    def function(*arguments: Any, **options: Any) -> Any:
        step = describe(*arguments, **options)
        first = next((x for x in step.arrays if isinstance(x, Tensor)), None)
        tensors = [x if first is None else _like(x, first) for x in step.arrays]
        count = len(tensors) - len(step.still)
        spare = [_still(name, tensor) for name, tensor in zip(step.still, tensors[count:])]

        def run(*arrays: Any) -> Any:
            return step.run(*arrays, *spare)

        return step.result(_record(_with_spare(run, *spare) if spare else step.run, *tensors[:count]))

    return dressed(function, describe, "bokashi.torch", "Tensor", f"As `bokashi.{describe.__name__}`.")


# Vectors and rows.

norm = _of_torch(_operations.norm)
normalize = _of_torch(_operations.normalize)
dot = _of_torch(_operations.dot)
cross = _of_torch(_operations.cross)
matmul = _of_torch(_operations.matmul)
gather_rows = _of_torch(_operations.gather_rows)
scatter_add_rows = _of_torch(_operations.scatter_add_rows)
sparse_product = _of_torch(_operations.sparse_product)
sigmoid = _of_torch(_operations.sigmoid)
softplus = _of_torch(_operations.softplus)

# Losses.

squared_error = _of_torch(_operations.squared_error)
mean_error = _of_torch(_operations.mean_error)
ssim_error = _of_torch(_operations.ssim_error)
multiscale_ssim_error = _of_torch(_operations.multiscale_ssim_error)
silhouette_error = _of_torch(_operations.silhouette_error)
depth_error = _of_torch(_operations.depth_error)
halved = _of_torch(_operations.halved)

# Regularizers.

total_variation = _of_torch(_operations.total_variation)
laplacian_error = _of_torch(_operations.laplacian_error)
edge_length_error = _of_torch(_operations.edge_length_error)
normal_error = _of_torch(_operations.normal_error)
rigid_error = _of_torch(_operations.rigid_error)

# Surfaces.

field_surface = _of_torch(_operations.field_surface)
draw_points = _of_torch(_operations.draw_points)
chamfer_distance = _of_torch(_operations.chamfer_distance)

# Layers.

eye_depth_slope = _of_torch(_operations.eye_depth_slope)
rasterize_behind = _of_torch(_operations.rasterize_behind)
depth_layers = _of_torch(_operations.depth_layers)
composite_layers = _of_torch(_operations.composite_layers)
lens_picture = _of_torch(_operations.lens_picture)

# Environments.

prefiltered = _of_torch(_operations.prefiltered)
irradiance = _of_torch(_operations.irradiance)
shade_in_environment = _of_torch(_operations.shade_in_environment)
