from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Coverage", "Learning", "Mesh", "PullBack", "RenderError", "Scene", "SceneError", "SceneFit", "Texture",
    "affine_inverse", "antialias_image", "depth", "depth_of_field", "differentials", "distort", "downsample",
    "encode_png", "exposure", "eye_depth", "face_normals", "fisheye", "gaussian_blur", "interpolate",
    "interpolate_differentials", "learning_page", "mesh_page", "mipmaps", "num_threads", "orthographic", "over",
    "perturbed_normals", "picture", "pinhole", "project", "project_instances", "rasterize", "reflect", "render",
    "rigid", "sample_cube_map", "sample_texture", "se3", "set_num_threads", "shade", "srgb_decode", "srgb_encode",
    "tangents", "transform_normals", "transform_points", "vertex_normals",
]

# The arrays of a call are of one type.
_T = TypeVar("_T", np.float32, np.float64)
_One: TypeAlias = tuple[tuple[NDArray[_T]], PullBack]
_Some: TypeAlias = tuple[tuple[NDArray[_T], ...], PullBack]

class RenderError(ValueError): ...
class SceneError(ValueError): ...

@final
class Mesh:
    def __new__(cls, faces: NDArray[np.uint32] | NDArray[np.int32] | NDArray[np.int64], vertex_count: int) -> Mesh: ...
    def __len__(self) -> int: ...
    @property
    def faces(self) -> NDArray[np.uint32]: ...
    @property
    def vertex_count(self) -> int: ...
    def part(self, start: int, end: int) -> Mesh: ...

@final
class Coverage:
    def __len__(self) -> int: ...
    @staticmethod
    def from_ids(
        mesh: Mesh,
        ids: NDArray[np.uint32],
        clip: NDArray[np.float32] | NDArray[np.float64] | None = None,
        cull: str = "none",
        orientations: NDArray[np.int8] | None = None,
    ) -> Coverage: ...
    def __copy__(self) -> Coverage: ...
    def __deepcopy__(self, _known: Any, /) -> Coverage: ...
    @property
    def orientations(self) -> NDArray[np.int8] | None: ...
    @property
    def centers(self) -> int: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def mesh(self) -> Mesh: ...
    @property
    def faces(self) -> NDArray[np.uint32]: ...
    @property
    def pixels(self) -> NDArray[np.uint32]: ...
    def triangle_ids(self) -> NDArray[np.uint32]: ...
    def dense(self, barycentrics: NDArray[_T], depths: NDArray[_T], first_face: int = 0) -> NDArray[_T]: ...
    def scatter(self, values: NDArray[_T]) -> NDArray[_T]: ...
    def gather(self, image: NDArray[_T]) -> NDArray[_T]: ...

@final
class PullBack:
    # A gradient is None where it was not wanted or nothing depends on the input.
    def __call__(
        self, *upstream: NDArray[Any] | float | None, wanted: Sequence[bool] | None = None
    ) -> tuple[NDArray[Any] | Any, ...]: ...

@final
class Texture:
    def __new__(
        cls, texels: NDArray[Any], *, mips: Sequence[NDArray[Any]] | None = None, coarsest: int | None = None
    ) -> Texture: ...
    def __len__(self) -> int: ...
    @property
    def levels(self) -> list[NDArray[Any]]: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    def holds(self, levels: Sequence[NDArray[Any]]) -> bool: ...

@final
class Scene:
    @staticmethod
    def open(path: str | Path) -> Scene: ...
    @property
    def views(self) -> list[str]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def meshes(self) -> dict[str, tuple[NDArray[np.float32], NDArray[np.uint32]]]: ...
    def render(self, view: int | str = ..., reduce: int = 1) -> NDArray[np.float32]: ...
    def begin(self, resume: str | Path | None = None) -> SceneFit: ...

@final
class SceneFit:
    # The loss before the step's update and its milliseconds come to the end of the lists; False at the end.
    def step(self, losses: list[float], milliseconds: list[float]) -> bool: ...
    @property
    def steps_done(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def ended(self) -> str | None: ...
    @property
    def parameters(self) -> dict[str, NDArray[np.float32]]: ...
    def learnt(self) -> Scene: ...
    def render(self, view: int | str = ..., reduce: int = 1) -> NDArray[np.float32]: ...
    def score(self, view: int | str = ...) -> dict[str, float | None]: ...
    def page(self, words: str, losses: Sequence[float]) -> str: ...
    def save(self, path: str | Path) -> None: ...
    def save_results(self, folder: str | Path) -> list[Path]: ...

@final
class Learning:
    # Parameters are names, starts, rates and mappings.
    def __new__(
        cls,
        parameters: Sequence[tuple[str, NDArray[Any], float, str]],
        steps: int,
        cosine: bool = False,
        floor: float = 0.0,
        loss_below: float | None = None,
        patience: int | None = None,
    ) -> Learning: ...
    # As that of SceneFit; at the end, in words, why.
    def step(
        self,
        function: Callable[[dict[str, NDArray[Any]]], tuple[float, dict[str, Any]]],
        losses: list[float],
        milliseconds: list[float],
    ) -> str | None: ...
    @property
    def steps(self) -> int: ...
    @property
    def steps_done(self) -> int: ...
    @property
    def parameters(self) -> dict[str, NDArray[Any]]: ...

def mesh_page(
    positions: NDArray[Any], mesh: Mesh, colors: NDArray[Any] | None = None, caption: str = ""
) -> str: ...
def learning_page(words: str, losses: Sequence[float], parameters: Sequence[tuple[str, NDArray[Any]]]) -> str: ...
def encode_png(image: NDArray[np.float32]) -> bytes: ...
def set_num_threads(count: int | None = None) -> None: ...
def num_threads() -> int: ...
def project(
    positions: NDArray[_T],
    camera: NDArray[_T],
    rotation: NDArray[_T] | None = None,
    translation: NDArray[_T] | None = None,
) -> _One[_T]: ...
def project_instances(positions: NDArray[_T], matrices: NDArray[_T], camera: NDArray[_T]) -> _One[_T]: ...
def pinhole(intrinsics: NDArray[_T], height: int, width: int, near: float, far: float) -> _One[_T]: ...
def orthographic(intrinsics: NDArray[_T], height: int, width: int, near: float, far: float) -> _One[_T]: ...
def distort(points: NDArray[_T], coefficients: NDArray[_T]) -> _One[_T]: ...
def fisheye(points: NDArray[_T], coefficients: NDArray[_T]) -> _One[_T]: ...
def rigid(rotation: NDArray[_T], translation: NDArray[_T]) -> _One[_T]: ...
def se3(increment: NDArray[_T], fixed: NDArray[np.float32] | NDArray[np.float64]) -> _One[_T]: ...
def affine_inverse(matrix: NDArray[_T]) -> _One[_T]: ...
def transform_points(points: NDArray[_T], matrix: NDArray[_T]) -> _One[_T]: ...
def transform_normals(normals: NDArray[_T], matrix: NDArray[_T]) -> _One[_T]: ...
def rasterize(
    clip: NDArray[_T],
    mesh: Mesh,
    height: int,
    width: int,
    cull: str = "none",
    exact: bool = False,
    creases: Sequence[tuple[NDArray[_T], Mesh | None]] = ...,
    with_depth: bool = False,
    with_differentials: bool = False,
    behind: Coverage | None = None,
    crease_tolerance: float = 2e-3,
) -> tuple[Coverage, tuple[NDArray[_T], ...], PullBack]: ...
def interpolate(
    attributes: NDArray[_T],
    barycentrics: NDArray[_T],
    clip: NDArray[_T],
    weight: NDArray[_T] | None,
    coverage: Coverage,
    mesh: Mesh | None = None,
) -> _One[_T]: ...
def interpolate_differentials(
    attributes: NDArray[_T],
    differentials: NDArray[_T],
    barycentrics: NDArray[_T],
    clip: NDArray[_T],
    weight: NDArray[_T] | None,
    coverage: Coverage,
    mesh: Mesh | None = None,
) -> _One[_T]: ...
def depth(
    barycentrics: NDArray[_T], clip: NDArray[_T], weight: NDArray[_T] | None, coverage: Coverage
) -> _One[_T]: ...
def eye_depth(
    barycentrics: NDArray[_T], clip: NDArray[_T], weight: NDArray[_T] | None, coverage: Coverage
) -> _One[_T]: ...
def differentials(
    barycentrics: NDArray[_T], clip: NDArray[_T], weight: NDArray[_T] | None, coverage: Coverage
) -> _One[_T]: ...
def picture(
    values: NDArray[_T],
    background: NDArray[_T] | None,
    barycentrics: NDArray[_T],
    clip: NDArray[_T],
    weight: NDArray[_T] | None,
    coverage: Coverage,
    antialias: bool = True,
    reference: NDArray[_T] | None = None,
) -> _One[_T]: ...
def antialias_image(
    image: NDArray[_T], barycentrics: NDArray[_T], clip: NDArray[_T], coverage: Coverage
) -> _One[_T]: ...
def render(
    positions: NDArray[_T],
    camera: NDArray[_T] | None,
    colors: NDArray[_T],
    background: NDArray[_T] | None,
    mesh: Mesh,
    height: int,
    width: int,
    color_mesh: Mesh | None = None,
    cull: str = "none",
    silhouettes: str = "exact",
    reference: NDArray[_T] | None = None,
    crease_tolerance: float = 2e-3,
) -> _One[_T]: ...
def mipmaps(texels: NDArray[_T], coarsest: int | None = None) -> _Some[_T]: ...
def sample_texture(
    coordinates: NDArray[_T],
    level: NDArray[_T] | None,
    differentials: NDArray[_T] | None,
    bias: NDArray[_T] | None,
    levels: Sequence[NDArray[_T]],
    filter: str = "trilinear",
    borders: tuple[str, str] = ...,
    coarsest: int | None = None,
    probes: int = 8,
    mipmaps: bool = False,
    still: Texture | None = None,
) -> _One[_T]: ...
def sample_cube_map(
    coordinates: NDArray[_T],
    level: NDArray[_T] | None,
    differentials: NDArray[_T] | None,
    bias: NDArray[_T] | None,
    levels: Sequence[NDArray[_T]],
    filter: str = "trilinear",
    borders: tuple[str, str] = ...,
    coarsest: int | None = None,
    probes: int = 8,
    mipmaps: bool = False,
    still: Texture | None = None,
) -> _One[_T]: ...
def face_normals(positions: NDArray[_T], mesh: Mesh) -> _One[_T]: ...
def vertex_normals(positions: NDArray[_T], mesh: Mesh, weighting: str = "angle") -> _One[_T]: ...
def tangents(
    positions: NDArray[_T],
    normals: NDArray[_T],
    coordinates: NDArray[_T],
    mesh: Mesh,
    coordinates_mesh: Mesh | None = None,
) -> _One[_T]: ...
def perturbed_normals(normals: NDArray[_T], tangents: NDArray[_T], values: NDArray[_T]) -> _One[_T]: ...
def reflect(directions: NDArray[_T], normals: NDArray[_T]) -> _One[_T]: ...
def shade(
    normals: NDArray[_T],
    views: NDArray[_T],
    positions: NDArray[_T] | None,
    material: Sequence[NDArray[_T]],
    model: str,
    lights: Sequence[tuple[str, NDArray[_T], NDArray[_T] | None]],
    conserves_energy: bool = False,
) -> _One[_T]: ...
def gaussian_blur(
    image: NDArray[_T],
    sigma: NDArray[_T],
    kernel: str = "sampled",
    border: str = "mirror",
    tolerance: float = 1e-6,
    radius: int | None = None,
) -> _One[_T]: ...
def depth_of_field(
    image: NDArray[_T],
    distances: NDArray[_T],
    aperture: NDArray[_T],
    focus: NDArray[_T],
    largest_sigma: float = 32.0,
    tolerance: float = 1e-3,
    blades: int | None = None,
    rotation: float = 0.0,
) -> _One[_T]: ...
def downsample(image: NDArray[_T], factor: int) -> _One[_T]: ...
def exposure(image: NDArray[_T], stops: NDArray[_T]) -> _One[_T]: ...
def over(front: NDArray[_T], behind: NDArray[_T]) -> _One[_T]: ...
def srgb_encode(x: NDArray[_T]) -> _One[_T]: ...
def srgb_decode(y: NDArray[_T]) -> _One[_T]: ...
