from collections.abc import Sequence
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Coverage", "Mesh", "PullBack", "RenderError", "antialias_image", "depth", "differentials", "downsample", "exposure",
    "face_normals", "gaussian_blur", "interpolate", "interpolate_differentials", "mipmaps", "num_threads", "over",
    "picture", "project", "rasterize", "reflect", "render", "sample_cube_map", "sample_texture", "set_num_threads",
    "srgb_decode", "srgb_encode", "vertex_normals",
]

# The arrays of a call are of one type.
_T = TypeVar("_T", np.float32, np.float64)
_One: TypeAlias = tuple[tuple[NDArray[_T]], PullBack]
_Some: TypeAlias = tuple[tuple[NDArray[_T], ...], PullBack]

class RenderError(ValueError): ...

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
        mesh: Mesh, ids: NDArray[np.uint32], clip: NDArray[np.float32] | NDArray[np.float64] | None = None, cull: str = "none"
    ) -> Coverage: ...
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
        self, *upstream: NDArray[Any] | None, wanted: Sequence[bool] | None = None
    ) -> tuple[NDArray[Any] | Any, ...]: ...

def set_num_threads(count: int | None = None) -> None: ...
def num_threads() -> int: ...
def project(
    positions: NDArray[_T], camera: NDArray[_T], rotation: NDArray[_T] | None = None, translation: NDArray[_T] | None = None
) -> _One[_T]: ...
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
) -> _One[_T]: ...
def gaussian_blur(
    image: NDArray[_T],
    sigma: NDArray[_T],
    kernel: str = "sampled",
    border: str = "mirror",
    tolerance: float = 1e-6,
    radius: int | None = None,
) -> _One[_T]: ...
def downsample(image: NDArray[_T], factor: int) -> _One[_T]: ...
def face_normals(positions: NDArray[_T], mesh: Mesh) -> _One[_T]: ...
def vertex_normals(positions: NDArray[_T], mesh: Mesh, weighting: str = "angle") -> _One[_T]: ...
def srgb_encode(x: NDArray[_T]) -> _One[_T]: ...
def srgb_decode(y: NDArray[_T]) -> _One[_T]: ...
def exposure(image: NDArray[_T], stops: NDArray[_T]) -> _One[_T]: ...
def over(front: NDArray[_T], back: NDArray[_T]) -> _One[_T]: ...
def reflect(directions: NDArray[_T], normals: NDArray[_T]) -> _One[_T]: ...
