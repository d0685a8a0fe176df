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
    Connectivity, Coverage, Environment, Fragments, Grid, LensLayer, Prefilter, RenderError, Rigidity, SparseMatrix,
    Texture, Topology, _operations, num_threads, set_num_threads,
)
from . import Mesh as _Mesh
from ._dual import Dual
from ._given import size_of
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
    if not tensor.is_cpu:
        raise RenderError(f"bokashi runs on a CPU and needs tensors that are there, got one on {tensor.device}")
    return (tensor.detach() if tensor.requires_grad else tensor).contiguous().numpy()


def _to_tensor(array: Any) -> Tensor | None:
    return None if array is None else torch.from_numpy(array)


def _once(backward: Callable[..., Any]) -> Callable[..., Any]:
    """As torch's `once_differentiable`, without its cost where no graph of gradients is made, as in nearly all calls."""
    checked = once_differentiable(backward)

    def pull(ctx, *upstream):
        return checked(ctx, *upstream) if torch.is_grad_enabled() else backward(ctx, *upstream)

    return pull


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
    @_once
    def backward(ctx, *upstream):
        # Tangents of gradients would be lost in silence.
        if ctx.has_tangents or any(unpack_dual(bar).tangent is not None for bar in upstream if bar is not None):
            raise RenderError("gradients have no tangents in torch: take bokashi.hvp")
        wanted = ctx.needs_input_grad[1:]
        gradients = ctx.pull_back(*map(_to_array, upstream), wanted=wanted)
        return None, *map(_to_tensor, gradients)


def _like(value: Value, tensor: Tensor) -> Tensor:
    """A number as a tensor of the type of another."""
    return torch.as_tensor(value, dtype=tensor.dtype)


def _constant(name: str, tensor: Tensor | None) -> Any:
    """The numbers of a tensor that gets no gradient. One with a name is refused where it asks for it."""
    if name and isinstance(tensor, Tensor):
        if tensor.requires_grad and torch.is_grad_enabled():
            raise RenderError(f"{name} has no gradient here and needs to be detached, got a tensor that requires one")
        if unpack_dual(tensor).tangent is not None:
            raise RenderError(f"{name} has no tangent here and needs to be detached, got a tensor with one")
    return _to_array(tensor)


def Mesh(faces: Any, vertex_count: int) -> _Mesh:
    """The faces of a triangle mesh: vertex indices `[F, 3]`, a tensor or an array of int32 or int64."""
    return _Mesh(_to_array(faces) if isinstance(faces, torch.Tensor) else np.asarray(faces), vertex_count)


def _with_spare(run: Callable, spare: Sequence[Any]) -> Callable:
    """A step that is given further arrays, which have no gradient."""

    def run_with(*arrays):
        outputs, pull_back = run(*arrays, *spare)
        more = (False,) * len(spare)

        def pull(*upstream, wanted):
            return pull_back(*upstream, wanted=(*wanted, *more))[: len(wanted)]

        return outputs, pull

    return run_with


@overload
def _of_torch(describe: Callable[_P, Single]) -> Callable[_P, Tensor]: ...
@overload
def _of_torch(describe: Callable[_P, Step]) -> Callable[_P, Any]: ...
def _of_torch(describe: Callable[..., Step]) -> Callable[..., Any]:
    """The function of tensors that a description tells."""

    def function(*arguments: Any, **options: Any) -> Any:
        step = describe(*arguments, **options)
        run, tensors = step.run, step.arrays
        for first in tensors:
            if isinstance(first, Tensor):
                tensors = [x if x is None or isinstance(x, Tensor) else _like(x, first) for x in tensors]
                break
        given = tensors
        if step.constants:
            given = tensors[: -len(step.constants)]
            run = _with_spare(run, [_constant(name, x) for name, x in zip(step.constants, tensors[len(given) :])])
        return step.result(_Recorded.apply(run, *given), tensors)

    opaque = torch.compiler.disable(function)
    return dressed(opaque, describe, "bokashi.torch", "Tensor", doc=f"As `bokashi.{describe.__name__}`.")


# Cameras and poses.

project = _of_torch(_operations.project)
project_instances = _of_torch(_operations.project_instances)
pinhole = _of_torch(_operations.pinhole)
orthographic = _of_torch(_operations.orthographic)
distort = _of_torch(_operations.distort)
fisheye = _of_torch(_operations.fisheye)
rigid = _of_torch(_operations.rigid)
se3 = _of_torch(_operations.se3)
affine_inverse = _of_torch(_operations.affine_inverse)
transform_points = _of_torch(_operations.transform_points)
transform_normals = _of_torch(_operations.transform_normals)

# Fragments.

rasterize = _of_torch(_operations.rasterize)
interpolate = _of_torch(_operations.interpolate)
interpolate_differentials = _of_torch(_operations.interpolate_differentials)
differentials = _of_torch(_operations.differentials)
depth = _of_torch(_operations.depth)
eye_depth = _of_torch(_operations.eye_depth)
eye_depth_slope = _of_torch(_operations.eye_depth_slope)

# Pictures.

picture = _of_torch(_operations.picture)
antialias_image = _of_torch(_operations.antialias_image)
render = _of_torch(_operations.render)

# Layers.

rasterize_behind = _of_torch(_operations.rasterize_behind)
depth_layers = _of_torch(_operations.depth_layers)
composite_layers = _of_torch(_operations.composite_layers)
lens_picture = _of_torch(_operations.lens_picture)

# Textures.

mipmaps = _of_torch(_operations.mipmaps)
sample_texture = _of_torch(_operations.sample_texture)
sample_cube_map = _of_torch(_operations.sample_cube_map)

# Normals and light.

face_normals = _of_torch(_operations.face_normals)
vertex_normals = _of_torch(_operations.vertex_normals)
tangents = _of_torch(_operations.tangents)
perturbed_normals = _of_torch(_operations.perturbed_normals)
reflect = _of_torch(_operations.reflect)
shade = _of_torch(_operations.shade)
prefiltered = _of_torch(_operations.prefiltered)
irradiance = _of_torch(_operations.irradiance)
shade_in_environment = _of_torch(_operations.shade_in_environment)

# Images.

gaussian_blur = _of_torch(_operations.gaussian_blur)
depth_of_field = _of_torch(_operations.depth_of_field)
downsample = _of_torch(_operations.downsample)
exposure = _of_torch(_operations.exposure)
over = _of_torch(_operations.over)
srgb_encode = _of_torch(_operations.srgb_encode)
srgb_decode = _of_torch(_operations.srgb_decode)

# Losses.

squared_error = _of_torch(_operations.squared_error)
mean_error = _of_torch(_operations.mean_error)
ssim_error = _of_torch(_operations.ssim_error)
multiscale_ssim_error = _of_torch(_operations.multiscale_ssim_error)
silhouette_error = _of_torch(_operations.silhouette_error)
depth_error = _of_torch(_operations.depth_error)
halved = _of_torch(_operations.halved)
total_variation = _of_torch(_operations.total_variation)

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

# Meshes.

laplacian_error = _of_torch(_operations.laplacian_error)
edge_length_error = _of_torch(_operations.edge_length_error)
normal_error = _of_torch(_operations.normal_error)
rigid_error = _of_torch(_operations.rigid_error)
field_surface = _of_torch(_operations.field_surface)
draw_points = _of_torch(_operations.draw_points)
chamfer_distance = _of_torch(_operations.chamfer_distance)


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
