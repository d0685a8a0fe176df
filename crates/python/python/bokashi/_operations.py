"""Operations that are described once, for numpy, torch and jax.

A description says which arrays the native module is given, in the order of gradients, what it runs, and what the results
look like. `bokashi`, `bokashi.torch` and `bokashi.jax` each make a function of it, by `dressed`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple

from . import _native
from ._given import Fragments, size_of, surface_of
from ._native import Grid, Mesh, Prefilter, RenderError, Rigidity, SparseMatrix, Topology

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def _first(outputs: Sequence[Any]) -> Any:
    return outputs[0]


class Step:
    """What a function does with arrays.

    `run` is given those of `arrays`, each an array, what becomes one of the type of the others, or `None`, and returns
    outputs and a pull-back. The last ones, named in `still`, have no gradient. `shapes` says from the arrays what the
    outputs look like; it is `None` where nobody knows before. `result` makes of outputs what the caller gets.
    """

    __slots__ = ("arrays", "result", "run", "shapes", "still")

    # No dataclass: what makes one takes longer to load than all of this.
    def __init__(
        self, run: Callable[..., tuple[Any, Any]], arrays: Sequence[Any],
        shapes: Callable[..., Sequence[tuple[int, ...]]] | None, still: tuple[str, ...] = (),
        result: Callable[[Sequence[Any]], Any] = _first,
    ) -> None:
        self.run, self.arrays, self.shapes, self.still, self.result = run, arrays, shapes, still, result


class Single(Step):
    """A step whose result is one array."""

    __slots__ = ()


def _plain(values: Any) -> Any:
    """Indices or a mask as an array of numpy."""
    import numpy as np

    return np.asarray(values)


def _broadcast(a: Any, b: Any) -> tuple[int, ...]:
    """The shape of two arrays together."""
    import numpy as np

    return np.broadcast_shapes(a.shape, b.shape)


def dressed(function: Any, describe: Callable[..., Step], module: str, returns: str, doc: str | None = None) -> Any:
    """A function with the name and the signature of its description."""
    function.__name__ = function.__qualname__ = describe.__name__
    function.__module__, function.__doc__ = module, doc or describe.__doc__
    # Whose signature it is: the description's, but for what is returned.
    given: Any = describe
    signed = FunctionType(given.__code__, given.__globals__, given.__name__, given.__defaults__, given.__closure__)
    signed.__kwdefaults__ = given.__kwdefaults__
    signed.__annotations__ = {**given.__annotations__, "return": returns}
    function.__wrapped__ = signed
    return function


def _scalar(*_: Any) -> Sequence[tuple[int, ...]]:
    return [()]


def _same(x: Any, *_: Any) -> Sequence[tuple[int, ...]]:
    return [x.shape]


# Vectors and rows.


def norm(x: ArrayLike) -> Single:
    """The lengths of vectors along the last axis, which is removed; that of 0 has the gradient 0. Gradients: of x."""
    return Single(_native.norm, [x], lambda x: [x.shape[:-1]])


def normalize(x: ArrayLike) -> Single:
    """Vectors along the last axis divided by their lengths; zeros stay, and have the gradient 0. Gradients: of x."""
    return Single(_native.normalize, [x], _same)


def dot(a: ArrayLike, b: ArrayLike) -> Single:
    """The inner products of vectors along the last axes, `[N, C]` and `[N, C]` or `[C]`: `[N]`. Gradients: of both."""
    return Single(_native.dot, [a, b], lambda a, b: [_broadcast(a, b)[:-1]])


def cross(a: ArrayLike, b: ArrayLike) -> Single:
    """The cross products of vectors along the last axes, `[N, 3]` and `[N, 3]` or `[3]`. Gradients: of both."""
    return Single(_native.cross, [a, b], lambda a, b: [_broadcast(a, b)])


def matmul(a: ArrayLike, b: ArrayLike) -> Single:
    """The matrix product of `[M, K]` and `[K, N]`. Gradients: of both."""
    return Single(_native.matmul, [a, b], lambda a, b: [(a.shape[0], b.shape[1])])


def gather_rows(x: ArrayLike, rows: ArrayLike) -> Single:
    """The rows of `x` `[N, ..]` that `rows` `[R]` names, whole numbers: `[R, ..]`. Gradients: of x."""
    named = _plain(rows)
    return Single(lambda x: _native.gather_rows(x, named), [x], lambda x: [(*named.shape, *x.shape[1:])])


def scatter_add_rows(x: ArrayLike, rows: ArrayLike, count: int) -> Single:
    """The sums `[count, ..]` of the rows of `x` `[R, ..]`, each added to the row that `rows` `[R]` names.

    They are added in their order, so the bits do not depend on threads. Gradients: of x.

    >>> import bokashi, numpy as np
    >>> bokashi.scatter_add_rows(np.ones((3, 1)), np.array([0, 2, 2]), 3)[0].ravel()
    array([1., 0., 2.])
    """
    named = _plain(rows)
    return Single(lambda x: _native.scatter_add_rows(x, named, count), [x], lambda x: [(count, *x.shape[1:])])


def sparse_product(x: ArrayLike, matrix: SparseMatrix) -> Single:
    """A `SparseMatrix` `[M, N]` times `x` `[N]` or `[N, C]`. Gradients: of x.

    >>> import bokashi, numpy as np
    >>> half = bokashi.SparseMatrix((1, 2), np.array([0, 0]), np.array([0, 1]), np.array([0.5, 0.5]))
    >>> bokashi.sparse_product(np.array([1.0, 3.0]), half)[0]
    array([2.])
    """
    return Single(
        lambda x: _native.sparse_product(x, matrix), [x], lambda x: [(matrix.shape[0], *x.shape[1:])]
    )


def sigmoid(x: ArrayLike) -> Single:
    """The logistic function 1 / (1 + e^-x), which overflows nowhere. Gradients: of x."""
    return Single(_native.sigmoid, [x], _same)


def softplus(x: ArrayLike) -> Single:
    """ln(1 + e^x): positive, and x for large x; it overflows nowhere. Gradients: of x."""
    return Single(_native.softplus, [x], _same)


# Losses.


def squared_error(image: ArrayLike, reference: ArrayLike) -> Single:
    """The sum of the squared differences of two arrays of one shape, `[]`. Gradients: of both.

    With a `reference`, `picture` and `render` have it at the cost of what is covered.
    """
    return Single(_native.squared_error, [image, reference], _scalar)


def mean_error(
    image: ArrayLike, reference: ArrayLike, weights: ArrayLike | None = None, *, penalty: str = "squared",
    scale: float | None = None, mask: ArrayLike | None = None,
) -> Single:
    """The mean of what differences d of two arrays cost, `[]`.

    `penalty` is "squared", "absolute", "huber" (squares up to the difference `scale`, then a line), "charbonnier"
    (sqrt(d^2 + scale^2) - scale) or "relative" (d^2 / (image^2 + scale), for radiance). The gradient takes that
    denominator as it is, while `jvp` and `hvp` move it. The mean is weighted by `weights`, or taken where a `mask` of bools is true: of the shape of the
    image or of its first axes. Gradients: of image, reference and weights.

    >>> import bokashi, numpy as np
    >>> float(bokashi.mean_error(np.array([1.0, 5.0]), np.zeros(2), penalty="absolute")[0])
    3.0
    """
    where = None if mask is None else _plain(mask)

    def run(image: Any, reference: Any, weights: Any) -> Any:
        return _native.mean_error(image, reference, weights, penalty, scale, where)

    return Single(run, [image, reference, weights], _scalar)


def ssim_error(image: ArrayLike, reference: ArrayLike, *, peak: float = 1.0) -> Single:
    """1 minus the structural similarity of two images `[H, W, C]` whose numbers go up to `peak`. Gradients: of both."""
    return Single(lambda a, b: _native.ssim_error(a, b, peak), [image, reference], _scalar)


def multiscale_ssim_error(
    image: ArrayLike, reference: ArrayLike, *, peak: float = 1.0, levels: int | None = None
) -> Single:
    """1 minus the structural similarity of two images `[H, W, C]` over halved images, 5 levels or as many as there are.

    Gradients: of both.
    """
    return Single(lambda a, b: _native.multiscale_ssim_error(a, b, peak, levels), [image, reference], _scalar)


def silhouette_error(mask: ArrayLike, reference: ArrayLike) -> Single:
    """1 minus intersection over union of two soft masks of one shape, from 0 to 1. Gradients: of both."""
    return Single(_native.silhouette_error, [mask, reference], _scalar)


def depth_error(
    depths: ArrayLike, reference: ArrayLike, *, mask: ArrayLike | None = None, alignment: str = "none"
) -> Single:
    """The mean absolute difference of two arrays of depths, `[]`: where both are above 0 and finite, and a `mask` is true.

    `alignment` is what may differ: "none", "scale", or "scale-and-shift", as in what networks say of one image.
    Gradients: of both.
    """
    where = None if mask is None else _plain(mask)
    return Single(lambda a, b: _native.depth_error(a, b, where, alignment), [depths, reference], _scalar)


def halved(image: ArrayLike) -> Single:
    """An image `[H, W, C]` of half the size, rounded up: means of 2 x 2 pixels, at an odd end of those that there are.

    A loss at several scales is the loss of images that are halved again and again. Gradients: of the image.
    """
    return Single(_native.halved, [image], lambda x: [(-(-x.shape[0] // 2), -(-x.shape[1] // 2), x.shape[2])])


# Regularizers.


def total_variation(image: ArrayLike, *, penalty: str = "squared", scale: float | None = None) -> Single:
    """What differences of neighbours in an image `[H, W, C]` cost, as in `mean_error`, over the number of entries, `[]`.

    Gradients: of the image.
    """
    return Single(lambda x: _native.total_variation(x, penalty, scale), [image], _scalar)


def laplacian_error(positions: ArrayLike, laplacian: SparseMatrix) -> Single:
    """The mean over vertices of `|(L v)_i|^2`, `[]`: small where a surface is smooth.

    The matrix is one of a `Topology`. Gradients: of positions `[V, C]`.

    >>> import bokashi, numpy as np
    >>> topology = bokashi.Topology(bokashi.Mesh(np.array([[0, 1, 2]]), 3))
    >>> float(bokashi.laplacian_error(np.ones((3, 3)), topology.uniform_laplacian())[0])
    0.0
    """
    return Single(lambda x: _native.laplacian_error(x, laplacian), [positions], _scalar)


def edge_length_error(positions: ArrayLike, topology: Topology, *, target: float = 0.0) -> Single:
    """The mean squared difference of the lengths of edges from `target`, `[]`. Gradients: of positions `[V, 3]`."""
    return Single(lambda x: _native.edge_length_error(x, topology, target), [positions], _scalar)


def normal_error(positions: ArrayLike, topology: Topology) -> Single:
    """The mean of 1 - cos of the angles between the normals of faces that share an edge, `[]`.

    Gradients: of positions `[V, 3]`.
    """
    return Single(lambda x: _native.normal_error(x, topology), [positions], _scalar)


def rigid_error(positions: ArrayLike, rigidity: Rigidity) -> Single:
    """How far a mesh is from one that only turned and moved, vertex by vertex (as rigid as possible), `[]`.

    A `Rigidity` has the mesh at rest. Gradients: of positions `[V, 3]`.
    """
    return Single(lambda x: _native.rigid_error(x, rigidity), [positions], _scalar)


# Surfaces.


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

    return Step(run, [field, offsets], None, result=lambda outputs: (outputs[0], found[0]))


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
    """The Chamfer distance of clouds `[N, 3]` and `[M, 3]`, `[]`: mean distances to the nearest point, both ways, added.

    Distances are squared, or not. Gradients: of both.

    >>> import bokashi, numpy as np
    >>> float(bokashi.chamfer_distance(np.zeros((1, 3)), np.array([[0.0, 0, 3], [0, 0, 4]]))[0])
    21.5
    """
    return Single(lambda a, b: _native.chamfer_distance(a, b, squared), [a, b], _scalar)


# Layers.


def eye_depth_slope(fragments: Fragments[Any]) -> Single:
    """How `eye_depth` changes from pixel to pixel, to the right and down, `[N, 2]`.

    Gradients: of barycentrics, clip positions and weights.
    """
    coverage = fragments.coverage

    def run(barycentrics: Any, clip: Any, weight: Any) -> Any:
        return _native.eye_depth_slope(barycentrics, clip, weight, coverage)

    return Single(run, fragments.arrays, lambda *_: [(len(coverage), 2)])


def rasterize_behind(front: Fragments[Any], *, cull: str = "none") -> Step:
    """The `Fragments` of what is seen behind others, at pixel centres; without any, nothing is behind.

    `cull` needs to be that of `front`. The pull-back leads from their barycentrics to the clip positions.
    """
    found: list[_native.Coverage] = []

    def run(clip: Any) -> Any:
        coverage, outputs, pull_back = _native.rasterize(
            clip, front.coverage.mesh, *front.coverage.size, cull, behind=front.coverage
        )
        found.append(coverage)
        return outputs, pull_back

    return Step(run, [front.clip], None, result=lambda outputs: Fragments(outputs[0], None, front.clip, found[0]))


def depth_layers(
    clip: ArrayLike, mesh: Mesh, size: int | Sequence[int], *, cull: str = "none", most: int | None = None
) -> Step:
    """A list of `Fragments`: all surfaces that pixel centres see one behind another, the nearest first, `most` at most.

    Three layers cost some three to four times what one costs. The pull-back leads from the barycentrics of each to
    `clip` `[V, 4]`.
    """
    height, width = size_of(size)
    found: list[_native.Coverage] = []

    def run(clip: Any) -> Any:
        coverages, outputs, pull_back = _native.depth_layers(clip, mesh, height, width, cull, most)
        found[:] = coverages
        return outputs, pull_back

    def result(outputs: Sequence[Any]) -> list[Fragments[Any]]:
        return [Fragments(uv, None, clip, coverage) for uv, coverage in zip(outputs, found)]

    return Step(run, [clip], None, result=result)


def composite_layers(
    layers: Sequence[tuple[Fragments[Any], ArrayLike, ArrayLike]], background: ArrayLike | None = None, *,
    antialias: bool = True, reference: ArrayLike | None = None,
) -> Single:
    """The image `[H, W, C]` of layers one over another, the nearest first, before a background.

    A layer has fragments of `depth_layers`, colours times their alpha `[N, C]`, and alphas `[N]` from 0 to 1. The first
    one's silhouettes are antialiased. With a `reference` image: the sum of the squared errors, `[]`. Gradients: of the
    background, of the first layer's clip positions, then of colours and alphas of each layer, then of the reference,
    which gets none.
    """
    if not layers:
        raise RenderError("composite_layers needs at least one layer, got none")
    coverages = [fragments.coverage for fragments, *_ in layers]

    def run(background: Any, clip: Any, *more: Any) -> Any:
        *arrays, reference = more
        pairs = list(zip(arrays[::2], arrays[1::2]))
        return _native.composite_layers(background, clip, pairs, coverages, antialias, reference)

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        return [()] if x[-1] is not None else [(*coverages[0].size, x[2].shape[1])]

    of_layers = [array for _, *arrays in layers for array in arrays]
    return Single(run, [background, layers[0][0].clip, *of_layers, reference], shapes, ("reference",))


class LensLayer(NamedTuple):
    """What a lens sees of one layer in depth: fragments, colours times alpha `[N, C]`, and distances `[N]`.

    `distance` is that of `eye_depth`. `alpha` `[N]` is how much of what lies behind is hidden; without it all.
    `slope` `[N, 2]` is that of `eye_depth_slope`; without it each fragment is blurred as if it faced the lens.
    """

    fragments: Fragments[Any]
    values: Any
    distance: Any
    alpha: Any = None
    slope: Any = None


def lens_picture(
    layers: Sequence[LensLayer], aperture: ArrayLike, focus: ArrayLike, *, background: ArrayLike | None = None,
    far: float = float("inf"), margin: int = 0, largest_radius: float = 64.0, blades: int = 0, rotation: float = 0.0,
) -> Single:
    """The image that a lens sees of surfaces one behind another, before a background at the distance `far`.

    The first layer is what is visible, of any sampling; those behind are of `depth_layers`, beginning with its first:
    that one says what hides what. Two hidden ones are enough. `aperture` is the radius in pixels of the circle of
    confusion at infinity, `focus` the distance that is sharp: numbers or `[]`. Circles have `largest_radius` at most.
    `margin` pixels are cut off at each side; as many as the largest circle has, and what lies beyond the picture is
    blurred into it. With `blades` the opening is a polygon of 3 to 16 sides, turned by `rotation` in radians.

    Gradients: of background, aperture, focus, the first layer's weights, then of values, alpha, distance and slope of
    each layer.
    """
    if not layers:
        raise RenderError("lens_picture needs at least one layer, got none")
    coverages = [layer[0].coverage for layer in layers]
    behind = [layer for layer in layers[1:] if layer[0].weight is not None]
    if behind:
        raise RenderError("layers behind need fragments at pixel centres, got exact coverage")

    def run(background: Any, aperture: Any, focus: Any, weight: Any, *arrays: Any) -> Any:
        of_layers = list(zip(*(arrays[k::4] for k in range(4))))
        return _native.lens_picture(
            background, aperture, focus, weight, of_layers, coverages, far, margin, largest_radius, blades, rotation
        )

    def shapes(*x: Any) -> Sequence[tuple[int, ...]]:
        height, width = coverages[0].size
        return [(height - 2 * margin, width - 2 * margin, x[4].shape[1])]

    whole = [LensLayer(*layer) for layer in layers]
    arrays = [array for layer in whole for array in (layer.values, layer.alpha, layer.distance, layer.slope)]
    return Single(run, [background, aperture, focus, whole[0].fragments.weight, *arrays], shapes)


# Environments.


class Environment(NamedTuple):
    """Light from all sides: spherical harmonics `[9, 3]`, and mirror images `[6, S, S, 3]` from sharp to rough."""

    harmonics: Any
    levels: Sequence[Any]


def prefiltered(texels: ArrayLike, prefilter: Prefilter) -> Step:
    """The `Environment` of a cube map's radiance `[6, S, S, 3]`: make it once a step, and the `Prefilter` once.

    The pull-back leads from the harmonics and the levels after the first, which is the texels themselves, to the texels.
    """

    def shapes(texels: Any) -> Sequence[tuple[int, ...]]:
        extents = [prefilter.extent >> k for k in range(1, prefilter.levels)]
        return [(9, texels.shape[3]), *((6, extent, extent, texels.shape[3]) for extent in extents)]

    def result(outputs: Sequence[Any]) -> Environment:
        return Environment(outputs[0], [texels, *outputs[1:]])

    return Step(lambda x: _native.prefiltered(x, prefilter), [texels], shapes, result=result)


def irradiance(harmonics: ArrayLike, normals: ArrayLike) -> Single:
    """The irradiance `[N, C]` of surfaces with `normals` `[N, 3]`, in light with the harmonics `[9, C]`.

    They are in the order (0, 0), (1, -1), (1, 0), (1, 1), (2, -2), .. (2, 2). Gradients: of both.
    """
    return Single(_native.irradiance, [harmonics, normals], lambda h, n: [(n.shape[0], h.shape[1])])


def shade_in_environment(
    normals: ArrayLike, views: ArrayLike, material: Sequence[ArrayLike], environment: Environment, *,
    model: str = "metallic-roughness", conserves_energy: bool = False,
) -> Single:
    """The radiance `[N, 3]` of surfaces in the light of an `Environment`; materials are those of `shade`.

    Materials without a roughness reflect as a matte surface does. Gradients: of normals, views, three of the material,
    harmonics, and the levels of the environment, its texels first.
    """
    _, of_material, _ = surface_of(material, [])

    def run(normals: Any, views: Any, *more: Any) -> Any:
        own = [values for values in more[:3] if values is not None]
        harmonics, *levels = more[3:]
        return _native.shade_in_environment(normals, views, own, harmonics, levels, model, conserves_energy)

    harmonics, levels = environment
    return Single(run, [normals, views, *of_material, harmonics, *levels], _same)
