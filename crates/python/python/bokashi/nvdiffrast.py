"""A stand-in for `nvdiffrast.torch` that runs on any CPU: `import bokashi.nvdiffrast as dr`.

Functions, shapes and conventions are those of its documentation. Row 0 of an image is its bottom row, `rast` holds (u,
v, z/w, triangle id + 1), and derivatives are per pixel. A program runs with its import and the device's name changed.

>>> import torch, bokashi.nvdiffrast as dr
>>> context = dr.RasterizeCudaContext()
>>> pos = torch.tensor([[[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.6, 0, 1]]], requires_grad=True)
>>> tri = torch.tensor([[0, 1, 2]], dtype=torch.int32)
>>> rast, _ = dr.rasterize(context, pos, tri, resolution=[8, 8])
>>> color, _ = dr.interpolate(torch.eye(3)[None], rast, tri)
>>> image = dr.antialias(color, rast, pos, tri)
>>> image.square().sum().backward()
>>> image.shape, pos.grad.shape
(torch.Size([1, 8, 8, 3]), torch.Size([1, 3, 4]))

What differs is written down in `docs/from-nvdiffrast.md`: results are the same bits on every run, wrong input is an
error, antialiasing never leaves the range of the pixels that it mixes, and faces of equal depth are ordered by their
index.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from . import Coverage, Mesh, RenderError, Texture, _native
from .torch import _once, _to_array, _to_tensor

__all__ = [
    "DepthPeeler", "RasterizeCudaContext", "RasterizeGLContext", "antialias", "antialias_construct_topology_hash",
    "get_log_level", "interpolate", "rasterize", "set_log_level", "texture", "texture_construct_mip",
]


class RasterizeCudaContext:
    """A name alone: there is no device."""

    def __init__(self, device: Any = None) -> None:
        del device


class RasterizeGLContext:
    """A name alone: there is no device."""

    def __init__(self, output_db: bool = True, mode: str = "automatic", device: Any = None) -> None:
        del mode, device
        self.output_db = output_db

    def set_context(self) -> None:
        """Does nothing."""

    def release_context(self) -> None:
        """Does nothing."""


def get_log_level() -> int:
    """The level that was set."""
    return _log_level[0]


def set_log_level(level: int) -> None:
    """Keeps the level: nothing is logged."""
    _log_level[0] = level


_log_level = [1]


def _version(tensor: Tensor) -> int | None:
    """How often a tensor was changed, or nothing where torch does not count that."""
    return None if tensor.is_inference() else tensor._version


class _Cache:
    """Values that belong to tensors: not on them, so that they can be saved, and gone with them.

    Several threads may ask at once: at worst a value is made twice.
    """

    def __init__(self) -> None:
        self.known: dict[int, tuple[Any, int, dict]] = {}

    def get(self, tensor: Tensor, key: Any, make: Callable[[], Any]) -> Any:
        """The value of a tensor as it is now, made where it is not known."""
        version = _version(tensor)
        if version is None:
            return make()
        known = self.known.get(id(tensor))
        if known is None or known[0]() is not tensor or known[1] != version:
            name = id(tensor)
            reference = weakref.ref(tensor, lambda _: self.known.pop(name, None))
            known = self.known[name] = (reference, version, {})
        values = known[2]
        if key not in values:
            values[key] = make()
        return values[key]


_meshes, _coverages, _textures = _Cache(), _Cache(), _Cache()


def _mesh(tri: Tensor, vertex_count: int) -> Mesh:
    """The mesh of an index buffer, checked once."""
    if tri.dtype != torch.int32 or tri.dim() != 2 or tri.shape[1] != 3:
        raise RenderError(f"tri needs shape [T, 3] and dtype int32, got {list(tri.shape)} and {tri.dtype}")
    return _meshes.get(tri, vertex_count, lambda: Mesh(_to_array(tri), vertex_count))


def _of_image(k: int, images: int, error: ValueError) -> ValueError:
    """What is wrong with image `k` of a batch, in words that name it."""
    return type(error)(f"image {k}: {error}") if images > 1 else error


def _require(name: str, tensor: Tensor, *shape: int | str | tuple[int, ...]) -> None:
    """Refuses a tensor of another shape. An axis is a number, one of several, or any under a name."""
    given = tensor.shape
    is_met = len(given) == len(shape)
    for axis, extent in zip(shape, given):
        # In the order of how often it is true: this is called in every step.
        if axis != extent and not isinstance(axis, str) and not (isinstance(axis, tuple) and extent in axis):
            is_met = False
    if not is_met:
        words = [" or ".join(map(str, sorted(set(axis)))) if isinstance(axis, tuple) else str(axis) for axis in shape]
        raise RenderError(f"{name} needs shape [{', '.join(words)}], got {list(given)}")


def _ids(rast: Tensor) -> np.ndarray:
    """The triangle ids of images, `[N, H, W]`."""
    _require("rast", rast, "N", "H", "W", 4)
    ids = _to_array(rast)[..., 3]
    is_id = (ids >= 0) & (ids < 2**32)
    if not is_id.all():
        k, row, column = np.argwhere(~is_id)[0].tolist()
        rule = f"rast needs triangle ids from 0 on, got {ids[k, row, column]:g} in row {row}, column {column}"
        raise _of_image(k, len(ids), RenderError(rule))
    return ids.astype(np.uint32)


def _read(mesh: Mesh, ids: np.ndarray, clips: Sequence[np.ndarray | None]) -> list[Coverage]:
    """The coverage of images of triangle ids. With clip positions it knows silhouettes."""
    found = []
    for k, (image, clip) in enumerate(zip(ids, clips)):
        try:
            found.append(Coverage.from_ids(mesh, np.ascontiguousarray(image), clip))
        except ValueError as error:
            raise _of_image(k, len(ids), error) from None
    return found


def _upside_down(positions: np.ndarray) -> np.ndarray:
    """Clip positions with y negated: our top row is then their bottom row."""
    return positions * _UPSIDE_DOWN.astype(positions.dtype, copy=False)


_UPSIDE_DOWN = np.array([1, -1, 1, 1], np.float32)


def _part(mesh: Mesh, k: int, ranges: list[tuple[int, int]]) -> Mesh:
    """The faces of image `k`, from a first one on."""
    start, count = ranges[k]
    try:
        return mesh.part(start, start + count)
    except ValueError as error:
        raise _of_image(k, len(ranges), error) from None


class _Images:
    """What was drawn: a mesh, its clip positions upside down and its first face for each image."""

    def __init__(self, pos: Tensor, tri: Tensor, ranges: Tensor | None = None) -> None:
        positions = _to_array(pos)
        self.pos, self.version = weakref.ref(pos), _version(pos)
        if positions.ndim == 3 and ranges is None and positions.shape[2] == 4:
            self.mesh = _mesh(tri, positions.shape[1])
            self.clips = list(_upside_down(positions))
            self.parts = [(self.mesh, 0)] * len(self.clips)
        elif positions.ndim == 2 and ranges is not None and positions.shape[1] == 4:
            _require("ranges", ranges, "N", 2)
            if ranges.is_floating_point():
                raise RenderError(f"ranges need whole numbers, got {ranges.dtype}")
            self.mesh = _mesh(tri, positions.shape[0])
            starts = [(int(start), int(count)) for start, count in ranges.tolist()]
            if any(start < 0 or count < 0 for start, count in starts):
                raise RenderError(f"ranges need starts and counts from 0 on, got {ranges.tolist()}")
            self.parts = [(_part(self.mesh, k, starts), start) for k, (start, _) in enumerate(starts)]
            self.clips = [_upside_down(positions)] * len(starts)
        else:
            given = list(positions.shape)
            raise RenderError(f"pos needs shape [N, V, 4], or with ranges [V, 4], got {given}")
        if not self.clips:
            raise RenderError("a batch needs at least one image, got none")
        if positions.dtype == np.float32 and len(self.mesh) > 2**24:
            raise RenderError(f"float32 has ids for at most {2**24} faces, got {len(self.mesh)}")
        self.is_shared = positions.ndim == 2

    def add_up(self, bars: list) -> Tensor | None:
        """The gradient of the positions from those of the images' clip positions."""
        if all(bar is None for bar in bars):
            return None
        bars = [np.zeros_like(clip) if bar is None else bar for bar, clip in zip(bars, self.clips)]
        total = np.sum(bars, 0) if self.is_shared else bars[0][None] if len(bars) == 1 else np.stack(bars)
        return torch.from_numpy(_upside_down(total))

    def are_at(self, pos: Tensor) -> bool:
        """Whether the positions are those that were drawn."""
        if self.pos() is pos and self.version is not None and self.version == _version(pos):
            return True
        given = _to_array(pos)
        if given.ndim != (2 if self.is_shared else 3) or len(self.clips) == 0:
            return False
        return np.array_equal(_upside_down(given), self.clips[0] if self.is_shared else np.stack(self.clips))


def _of_positions(clip: np.ndarray, error: ValueError) -> ValueError:
    """What is wrong with positions, as they were given: not upside down."""
    is_finite = np.isfinite(clip).all(1)
    if is_finite.all():
        return error
    vertex = int(is_finite.argmin())
    x, y, z, w = _upside_down(clip[vertex]).tolist()
    return RenderError(f"clip positions need to be finite, got ({x}, {y}, {z}, {w}) at vertex {vertex}")


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx, pos, images, size, grad_db, fronts, found):
        height, width = size
        ctx.images, ctx.pulls, ctx.grad_db = images, [], grad_db
        rasts, derivatives = [], []
        for k, ((mesh, first), clip) in enumerate(zip(images.parts, images.clips)):
            try:
                coverage, (uv, depth, slopes), pull_back = _native.rasterize(
                    clip, mesh, height, width, with_depth=True, with_differentials=True, behind=fronts and fronts[k]
                )
            except ValueError as error:
                raise _of_image(k, len(images.clips), _of_positions(clip, error)) from None
            found.append(coverage)
            ctx.pulls.append((coverage, pull_back))
            rasts.append(coverage.dense(uv, depth, first))
            derivatives.append(coverage.scatter(slopes.reshape(len(slopes), 4)))
        ctx.set_materialize_grads(False)
        return _stack(rasts), _stack(derivatives)

    @staticmethod
    @_once
    def backward(ctx, rast_bar, db_bar):
        bars, rasts, derivatives = [], _to_array(rast_bar), _to_array(db_bar) if ctx.grad_db else None
        for k, (coverage, pull_back) in enumerate(ctx.pulls):
            uv_bar = slopes_bar = None
            if rasts is not None:
                # z/w and the id have no gradient.
                uv_bar = coverage.gather(rasts[k], 2)
            if derivatives is not None:
                slopes_bar = coverage.gather(derivatives[k]).reshape(len(coverage), 2, 2)
            bars.append(pull_back(uv_bar, None, slopes_bar)[0])
        return ctx.images.add_up(bars), None, None, None, None, None


def _stack(images: list[np.ndarray]) -> Tensor:
    """Images in one tensor; that of a single image is not copied."""
    if not images:
        raise RenderError("a batch needs at least one image, got none")
    return torch.from_numpy(images[0][None] if len(images) == 1 else np.stack(images))


def _rasterize(
    pos: Tensor, tri: Tensor, resolution: Sequence[int], ranges: Tensor | None, grad_db: bool,
    fronts: list[Coverage] | None = None,
) -> tuple[Tensor, Tensor, list[Coverage]]:
    """What `rasterize` returns, and the coverage of each image."""
    images = _Images(pos, tri, ranges)
    found: list[Coverage] = []
    rast, rast_db = _Rasterize.apply(pos, images, tuple(resolution), grad_db, fronts, found)
    _coverages.get(rast, "drawn", lambda: (images, found))
    return rast, rast_db, found


@torch.compiler.disable
def rasterize(
    glctx: Any, pos: Tensor, tri: Tensor, resolution: Sequence[int], ranges: Tensor | None = None, grad_db: bool = True
) -> tuple[Tensor, Tensor]:
    """`rast` `[N, H, W, 4]`, (u, v, z/w, triangle id + 1), and `rast_db` `[N, H, W, 4]`, (du/dX, du/dY, dv/dX, dv/dY).

    `pos` is `[N, V, 4]`, or `[V, 4]` with `ranges` `[N, 2]` of first triangle and count. Gradients go to `pos` from u
    and v, and with `grad_db` from the derivatives.
    """
    del glctx
    rast, rast_db, _ = _rasterize(pos, tri, resolution, ranges, grad_db)
    return rast, rast_db


class DepthPeeler:
    """Layer after layer of what a pixel hides: `with DepthPeeler(..) as peeler: peeler.rasterize_next_layer()`."""

    def __init__(
        self, glctx: Any, pos: Tensor, tri: Tensor, resolution: Sequence[int], ranges: Tensor | None = None,
        grad_db: bool = True,
    ) -> None:
        del glctx
        self.call = pos, tri, resolution, ranges, grad_db
        self.fronts: list[Coverage] | None = None

    def __enter__(self) -> DepthPeeler:
        return self

    def __exit__(self, *args: object) -> None:
        self.fronts = None

    @torch.compiler.disable
    def rasterize_next_layer(self) -> tuple[Tensor, Tensor]:
        """`rast` and `rast_db` of the next layer, as `rasterize` has them."""
        rast, rast_db, self.fronts = _rasterize(*self.call, self.fronts)
        return rast, rast_db


def _drawn(rast: Tensor) -> Any:
    """Meshes and coverages of what `rasterize` returned, where that is the tensor itself."""
    return _coverages.get(rast, "drawn", lambda: None)


def _coverage_of(rast: Tensor, mesh: Mesh) -> list[tuple[Coverage, Mesh]]:
    """The coverage of each image, with its part of a mesh: that of `rasterize`, or of another tensor's ids."""
    drawn = _drawn(rast)
    if drawn is not None:
        images, found = drawn
        parts = [
            mesh if len(part) == len(mesh) else mesh.part(first, first + len(part)) for part, first in images.parts
        ]
        return list(zip(found, parts))

    def read():
        ids = _ids(rast)
        return [(coverage, mesh) for coverage in _read(mesh, ids, [None] * len(ids))]

    return _coverages.get(rast, ("ids", mesh), read)


class _Interpolate(torch.autograd.Function):
    @staticmethod
    def forward(ctx, attr, rast, rast_db, coverages, which):
        ctx.which, ctx.pulls, ctx.coverages = which, [], [coverage for coverage, _ in coverages]
        attributes, fragments = _to_array(attr), _to_array(rast)
        slopes = _to_array(rast_db)
        ctx.shapes = attributes.shape, fragments.shape
        outs, derivatives = [], []
        for k, (coverage, mesh) in enumerate(coverages):
            own = attributes if attributes.ndim == 2 else attributes[min(k, len(attributes) - 1)]
            uv = coverage.gather(fragments[k], 2)
            clip = np.zeros((coverage.mesh.vertex_count, 4), uv.dtype)
            (values,), pull = _native.interpolate(own, uv, clip, None, coverage, mesh)
            outs.append(coverage.scatter(values))
            pull_slopes = None
            if which is not None:
                chosen = np.ascontiguousarray(own[:, which])
                db = coverage.gather(slopes[k]).reshape(len(coverage), 2, 2)
                (moved,), pull_slopes = _native.interpolate_differentials(chosen, db, uv, clip, None, coverage, mesh)
                derivatives.append(coverage.scatter(moved.reshape(len(moved), 2 * len(which))))
            ctx.pulls.append((pull, pull_slopes))
        ctx.set_materialize_grads(False)
        if which is None:
            return _stack(outs), torch.empty([*fragments.shape[:3], 0], dtype=attr.dtype)
        return _stack(outs), _stack(derivatives)

    @staticmethod
    @_once
    def backward(ctx, out_bar, da_bar):
        if out_bar is None and da_bar is None:
            return (None,) * 5
        attr_shape, _ = ctx.shapes
        wants_attr, wants_rast, wants_db = ctx.needs_input_grad[:3]
        outs, derivatives = _to_array(out_bar), _to_array(da_bar)
        attr_bar = np.zeros(attr_shape, (derivatives if outs is None else outs).dtype) if wants_attr else None
        rast_bars, db_bars = [], []
        for k, (coverage, (pull, pull_slopes)) in enumerate(zip(ctx.coverages, ctx.pulls)):
            own = None
            if attr_bar is not None:
                own = attr_bar if attr_bar.ndim == 2 else attr_bar[min(k, len(attr_bar) - 1)]
            if outs is not None:
                values_bar = coverage.gather(outs[k])
                more, uv_bar, *_ = pull(values_bar, wanted=(wants_attr, wants_rast, False, False))
                if own is not None and more is not None:
                    own += more
                if wants_rast:
                    rast_bars.append(coverage.scatter(uv_bar, 4))
            if derivatives is not None and pull_slopes is not None:
                moved_bar = coverage.gather(derivatives[k]).reshape(len(coverage), len(ctx.which), 2)
                more, db_bar, *_ = pull_slopes(moved_bar, wanted=(wants_attr, wants_db, False, False, False))
                if own is not None and more is not None:
                    # One by one: an attribute may be chosen twice.
                    for column, attribute in enumerate(ctx.which):
                        own[:, attribute] += more[:, column]
                if wants_db:
                    db_bars.append(coverage.scatter(db_bar.reshape(len(db_bar), 4)))
        return (
            _to_tensor(attr_bar), _stack(rast_bars) if rast_bars else None, _stack(db_bars) if db_bars else None,
            None, None,
        )


@torch.compiler.disable
def interpolate(
    attr: Tensor, rast: Tensor, tri: Tensor, rast_db: Tensor | None = None,
    diff_attrs: Sequence[int] | str | None = None,
) -> tuple[Tensor, Tensor]:
    """Attributes `[N, V, A]`, `[1, V, A]` or `[V, A]` at pixels, `[N, H, W, A]`, zeros where nothing is seen.

    `diff_attrs` is a list of attributes, or "all", whose derivatives with respect to the image are wanted. They are the
    second result, `[N, H, W, 2 K]`, and need `rast_db`.
    """
    if attr.dim() != 2:
        _require("attr", attr, (1, rast.shape[0]), "V", "A")
    which = None
    # No attributes are as none.
    if diff_attrs is not None and len(diff_attrs):
        if rast_db is None:
            raise RenderError("interpolate needs rast_db for diff_attrs, got None")
        _require("rast_db", rast_db, *rast.shape)
        channels = attr.shape[-1]
        if isinstance(diff_attrs, str) and diff_attrs != "all":
            raise RenderError(f'diff_attrs need to be a list of attributes or "all", got "{diff_attrs}"')
        which = list(range(channels)) if isinstance(diff_attrs, str) else [int(k) for k in diff_attrs]
        if not all(0 <= k < channels for k in which):
            raise RenderError(f"diff_attrs need to be attributes below {channels}, got {which}")
    mesh = _mesh(tri, attr.shape[-2])
    coverages = _coverage_of(rast, mesh)
    return _Interpolate.apply(attr, rast, rast_db if which is not None else None, coverages, which)


# Views of a tensor whose textures are kept: each keeps a copy of its numbers.
_MOST_VIEWS = 8


def _constants(tex: Tensor, levels: list[np.ndarray], makes_mipmaps: bool, sampler: dict[str, Any]) -> list[Texture]:
    """The images of a texture that needs no gradient, with their mipmaps, made once as long as their numbers stay.

    `tex[None]` is a new tensor in each call. So they belong to the tensor that `tex` is a view of, and go with it.
    Numbers are compared in each call: torch does not count what is written to `tex.data`.
    """
    coarsest = sampler.get("coarsest") if makes_mipmaps else 0
    views = _textures.get(tex if tex._base is None else tex._base, "views", dict)
    view = tuple(tex.shape), tex.stride(), tex.storage_offset()
    # The last one that was asked for is the last to go.
    known = views[view] = views.pop(view, {})
    for oldest in list(views)[:-_MOST_VIEWS]:
        views.pop(oldest, None)
    constants = []
    for k in range(max(map(len, levels))):
        own = [array[min(k, len(array) - 1)] for array in levels]
        key = k, coarsest, len(own)
        constant = known.get(key)
        if constant is None or not constant.holds(own):
            constant = known[key] = Texture(own[0], mips=own[1:] or None, coarsest=None if own[1:] else coarsest)
        constants.append(constant)
    return constants


class _Texture(torch.autograd.Function):
    @staticmethod
    def forward(ctx, uv, level, uv_da, sampler, makes_mipmaps, *levels):
        coordinates, slopes, bias = _to_array(uv), _to_array(uv_da), _to_array(level)
        texels = [_to_array(level) for level in levels]
        is_cube = texels[0].ndim == 5
        call = _native.sample_cube_map if is_cube else _native.sample_texture
        images, height, width, axes = coordinates.shape
        ctx.pulls, ctx.shapes = [], [array.shape for array in texels]
        ctx.stays = stays = not any(level.requires_grad for level in levels)
        constants = _constants(levels[0], texels, makes_mipmaps, sampler) if stays else []
        outs = []
        for k in range(images):
            own = [array[min(k, len(array) - 1)] for array in texels]
            constant = constants[min(k, len(constants) - 1)] if stays else None
            places = coordinates[k].reshape(height * width, axes)
            at_level = bias[k].reshape(-1) if bias is not None else None
            footprints = slopes[k].reshape(height * width, axes, 2) if slopes is not None else None
            if is_cube:
                # Where nothing is seen there is no direction: any will do, without a gradient.
                nowhere = ~places.any(1)
                if nowhere.any():
                    places = places.copy()
                    places[nowhere, 0] = 1
            of_level = (None, footprints, at_level) if footprints is not None else (at_level, None, None)
            try:
                (values,), pull = call(
                    places, *of_level, [] if constant else own, **sampler, mipmaps=makes_mipmaps, constant=constant
                )
            except ValueError as error:
                raise _of_image(k, images, error) from None
            outs.append(values.reshape(height, width, values.shape[1]))
            ctx.pulls.append((pull, nowhere if is_cube else None))
        ctx.has, ctx.axes = (slopes is not None, bias is not None), axes
        ctx.set_materialize_grads(False)
        return _stack(outs)

    @staticmethod
    @_once
    def backward(ctx, out_bar):
        if out_bar is None:
            return (None,) * (5 + len(ctx.shapes))
        wants_uv, wants_level, wants_da, _, _, *wants_texels = ctx.needs_input_grad
        has_da, _ = ctx.has
        uv_bars, level_bars, da_bars = [], [], []
        out_bars = _to_array(out_bar)
        texel_bars = [
            np.zeros(shape, out_bars.dtype) if wants else None for shape, wants in zip(ctx.shapes, wants_texels)
        ]
        images, height, width, channels = out_bar.shape
        for k, (pull, nowhere) in enumerate(ctx.pulls):
            bar = out_bars[k].reshape(height * width, channels)
            wanted = (
                wants_uv, wants_level and not has_da, wants_da, wants_level and has_da,
                *(() if ctx.stays else wants_texels),
            )
            uv_bar, level_bar, da_bar, bias_bar, *more = pull(bar, wanted=wanted)
            axes = ctx.axes
            for bars, own, of_pixel in (
                (uv_bars, uv_bar, (axes,)), (level_bars, bias_bar if has_da else level_bar, ()),
                (da_bars, da_bar, (2 * axes,)),
            ):
                if own is not None:
                    if nowhere is not None:
                        own[nowhere] = 0
                    bars.append(own.reshape(height, width, *of_pixel))
            for texel_bar, own in zip(texel_bars, more):
                if texel_bar is not None and own is not None:
                    texel_bar[min(k, len(texel_bar) - 1)] += own
        return (
            *(_stack(bars) if bars else None for bars in (uv_bars, level_bars, da_bars)), None, None,
            *map(_to_tensor, texel_bars),
        )


class _Mipmaps:
    """Coarser levels of a texture that were made once."""

    def __init__(self, levels: list[Tensor]) -> None:
        self.levels = levels


@torch.compiler.disable
def texture_construct_mip(tex: Tensor, max_mip_level: int | None = None, cube_mode: bool = False) -> _Mipmaps:
    """The coarser levels of a texture `[N, H, W, C]`, or with `cube_mode` `[N, 6, H, W, C]`, for `texture`'s `mip`."""
    del cube_mode
    from .torch import mipmaps

    of_images = [mipmaps(image, max_mip_level) for image in tex]
    return _Mipmaps([torch.stack(levels) for levels in zip(*of_images)])


_FILTERS = {
    "nearest": "nearest", "linear": "bilinear", "linear-mipmap-nearest": "bilinear", "linear-mipmap-linear": "trilinear"
}


@torch.compiler.disable
def texture(
    tex: Tensor, uv: Tensor, uv_da: Tensor | None = None, mip_level_bias: Tensor | None = None,
    mip: _Mipmaps | Sequence[Tensor] | None = None, filter_mode: str = "auto", boundary_mode: str = "wrap",
    max_mip_level: int | None = None,
) -> Tensor:
    """Samples of `tex` `[N, H, W, C]` at `uv` `[N, H, W, 2]`: `[N, H, W, C]`.

    For cube maps `tex` is `[N, 6, S, S, C]` and `uv` `[N, H, W, 3]`. `filter_mode` is "auto", "nearest", "linear",
    "linear-mipmap-nearest" or "linear-mipmap-linear", `boundary_mode` "wrap", "clamp", "zero" or "cube". `mip` are
    levels of `texture_construct_mip`, or a list of one's own.
    """
    has_detail = uv_da is not None or mip_level_bias is not None
    if filter_mode == "auto":
        filter_mode = "linear-mipmap-linear" if has_detail else "linear"
    if filter_mode not in _FILTERS:
        raise RenderError(f"filter_mode needs to be auto, {', '.join(_FILTERS)}, got {filter_mode!r}")
    if boundary_mode not in ("wrap", "clamp", "zero", "cube"):
        raise RenderError(f"boundary_mode needs to be wrap, clamp, zero or cube, got {boundary_mode!r}")
    is_cube = boundary_mode == "cube"
    uses_levels = "mipmap" in filter_mode
    if mip is not None and not uses_levels:
        raise RenderError(f"mip needs a filter_mode with mipmaps, and uv_da or mip_level_bias, got {filter_mode}")
    if uses_levels and not has_detail:
        raise RenderError(f"{filter_mode} needs uv_da or mip_level_bias, got neither")
    _require("uv", uv, "N", "H", "W", 3 if is_cube else 2)
    images, height, width, axes = uv.shape
    levels = [tex]
    if uses_levels and mip is not None:
        levels += list(mip.levels if isinstance(mip, _Mipmaps) else mip)
    for level in levels:
        _require("tex", level, (1, images), *((6, "S", "S", "C") if is_cube else ("H", "W", "C")))
    if uses_levels and uv_da is not None:
        _require("uv_da", uv_da, images, height, width, 2 * axes)
    if uses_levels and mip_level_bias is not None:
        _require("mip_level_bias", mip_level_bias, images, height, width)
    sampler: dict[str, Any] = {"filter": _FILTERS[filter_mode]}
    sampler["borders"] = ("wrap", "wrap") if is_cube else (boundary_mode, boundary_mode)
    if max_mip_level is not None:
        sampler["coarsest"] = max_mip_level
    detail = (mip_level_bias, uv_da) if uses_levels else (None, None)
    return _Texture.apply(uv, *detail, sampler, uses_levels and mip is None, *levels)


@torch.compiler.disable
def antialias_construct_topology_hash(tri: Tensor) -> Any:
    """The neighbours of faces: they are found once per index buffer in any case."""
    return tri


class _Antialias(torch.autograd.Function):
    @staticmethod
    def forward(ctx, color, pos, images, coverages, boost):
        ctx.images, ctx.pulls, ctx.boost = images, [], boost
        pixels = _to_array(color)
        outs = []
        for image, coverage, clip in zip(pixels, coverages, images.clips):
            uv = np.zeros((len(coverage), 2), clip.dtype)
            (out,), pull = _native.antialias_image(image, uv, clip, coverage)
            outs.append(out)
            ctx.pulls.append(pull)
        ctx.set_materialize_grads(False)
        return _stack(outs)

    @staticmethod
    @_once
    def backward(ctx, out_bar):
        if out_bar is None:
            return (None,) * 5
        wants_color, wants_pos = ctx.needs_input_grad[:2]
        color_bars, clip_bars, bars = [], [], _to_array(out_bar)
        for bar, pull in zip(bars, ctx.pulls):
            color_bar, _, clip_bar, _ = pull(bar, wanted=(wants_color, False, wants_pos, False))
            color_bars.append(color_bar)
            clip_bars.append(clip_bar)
        pos_bar = ctx.images.add_up(clip_bars) if wants_pos else None
        if pos_bar is not None and ctx.boost != 1:
            pos_bar *= ctx.boost
        return _stack(color_bars) if wants_color else None, pos_bar, None, None, None


@torch.compiler.disable
def antialias(
    color: Tensor, rast: Tensor, pos: Tensor, tri: Tensor, topology_hash: Any = None, pos_gradient_boost: float = 1.0
) -> Tensor:
    """`color` `[N, H, W, C]` with the silhouettes of `tri` antialiased; the boost multiplies gradients of `pos`."""
    del topology_hash
    _require("color", color, *rast.shape[:3], "C")
    _require("pos", pos, *(("V", 4) if pos.dim() == 2 else (rast.shape[0], "V", 4)))
    drawn = _drawn(rast)
    if drawn is not None:
        images, coverages = drawn
        # Silhouettes are those of `tri`, not of a range of it.
        if not images.is_shared and images.are_at(pos) and _mesh(tri, pos.shape[-2]) is images.mesh:
            return _Antialias.apply(color, pos, images, coverages, pos_gradient_boost)
    ids = _ids(rast)
    if pos.dim() == 2:
        images = _Images(pos[None].expand(len(ids), -1, -1), tri)
        images.is_shared = True
    else:
        images = _Images(pos, tri)
    coverages = _read(images.parts[0][0], ids, images.clips)
    return _Antialias.apply(color, pos, images, coverages, pos_gradient_boost)

