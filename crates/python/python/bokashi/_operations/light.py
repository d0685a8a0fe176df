"""Normals, and light on surfaces."""

from __future__ import annotations

from .. import _native
from .._given import TYPE_CHECKING, surface_of
from .._native import Mesh, Prefilter
from .step import Single, Step, same

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from numpy.typing import ArrayLike

    from .tuples import Environment


def face_normals(positions: ArrayLike, mesh: Mesh) -> Single:
    """The normal of each face, `[F, 3]`, of length 1. Gradients: of positions `[V, 3]`."""
    return Single(lambda x: _native.face_normals(x, mesh), [positions], lambda _: [(len(mesh), 3)])


def vertex_normals(positions: ArrayLike, mesh: Mesh, weighting: str = "angle") -> Single:
    """The normal at each vertex, `[V, 3]`: the mean of its faces', by "angle" or "area". Gradients: of positions."""
    return Single(lambda x: _native.vertex_normals(x, mesh, weighting), [positions], same)


def tangents(
    positions: ArrayLike, normals: ArrayLike, coordinates: ArrayLike, mesh: Mesh, coordinates_mesh: Mesh | None = None
) -> Single:
    """The tangents of texture coordinates `[A, 2]`: unit vectors along which u grows, and bitangents' signs, `[A, 4]`.

    `positions` and `normals` are `[V, 3]`. `coordinates_mesh` is the coordinates' own index buffer, where that is not
    the positions'. Gradients: of positions, normals and coordinates.
    """

    def run(positions: Any, normals: Any, coordinates: Any) -> Any:
        return _native.tangents(positions, normals, coordinates, mesh, coordinates_mesh)

    return Single(run, [positions, normals, coordinates], lambda *x: [(x[2].shape[0], 4)])


def perturbed_normals(normals: ArrayLike, tangents: ArrayLike, values: ArrayLike) -> Single:
    """Normals `[N, 3]` turned by the values `[N, 3]` of a normal map, from -1 to 1, along tangents `[N, 4]`: `[N, 3]`.

    Gradients: of all three.
    """
    return Single(_native.perturbed_normals, [normals, tangents, values], same)


def reflect(directions: ArrayLike, normals: ArrayLike) -> Single:
    """Directions `[N, 3]` mirrored at surfaces with normals `[N, 3]`. Gradients: of both."""
    return Single(_native.reflect, [directions, normals], same)


def shade(
    normals: ArrayLike, views: ArrayLike, material: Sequence[ArrayLike], lights: Sequence[tuple[Any, ...]], *,
    positions: ArrayLike | None = None, model: str = "metallic-roughness", conserves_energy: bool = False,
) -> Single:
    """The radiance `[N, 3]` of surfaces with `normals` `[N, 3]`, seen from `views` `[N, 3]` or `[3]`, in `lights`.

    `views` lead from a surface to the eye. `material` is a list of arrays, each with a row for each fragment or one for
    all. Which they are, `model` says: base colour, roughness and metallic for "metallic-roughness", a colour for
    "lambert", colour, specular and exponent for "phong" and "blinn-phong". `lights` are tuples: ("directional",
    direction, irradiance), where the direction leads to the light; ("point", position, intensity), which needs
    `positions` `[N, 3]`; ("ambient", radiance).

    Gradients: of normals, views, positions, three of the material, and two of each light; `None` for those not there.
    """
    kinds, of_material, of_lights = surface_of(material, lights)

    def run(normals: Any, views: Any, positions: Any, *arrays: Any) -> Any:
        own = [values for values in arrays[:3] if values is not None]
        shining = list(zip(kinds, arrays[3::2], arrays[4::2]))
        return _native.shade(normals, views, positions, own, model, shining, conserves_energy)

    return Single(run, [normals, views, positions, *of_material, *of_lights], same)


def prefiltered(texels: ArrayLike, prefilter: Prefilter) -> Step:
    """The `Environment` of a cube map's radiance `[6, S, S, 3]`: make it once a step, and the `Prefilter` once.

    The pull-back leads from the harmonics and the levels after the first, which is the texels themselves, to the
    texels.
    """

    def shapes(texels: Any) -> Sequence[tuple[int, ...]]:
        extents = [prefilter.extent >> k for k in range(1, prefilter.levels)]
        return [(9, texels.shape[3]), *((6, extent, extent, texels.shape[3]) for extent in extents)]

    def result(outputs: Sequence[Any], arrays: Sequence[Any]) -> Environment:
        from .tuples import Environment

        return Environment(outputs[0], [*arrays, *outputs[1:]])

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
    return Single(run, [normals, views, *of_material, harmonics, *levels], same)
