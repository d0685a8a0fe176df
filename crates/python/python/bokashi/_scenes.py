"""Scenes in files, their fits, and pictures that notebooks show."""

from __future__ import annotations

import os
import pathlib
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

Path = Union[str, os.PathLike[str]]


class Picture(np.ndarray):
    """An image `[H, W, 3]` of `float32` from 0 to 1, as pixels stand for it. Notebooks show it."""

    def __new__(cls, image: ArrayLike) -> Picture:
        return np.asarray(image, np.float32).view(cls)

    def png(self) -> bytes:
        """The picture as a PNG."""
        return _native.encode_png(np.ascontiguousarray(self.view(np.ndarray)))

    def save(self, path: Path) -> None:
        """Writes the picture as a PNG."""
        with open(path, "wb") as file:
            file.write(self.png())

    def _repr_png_(self) -> bytes | None:
        return self.png() if self.ndim == 3 and self.shape[2] == 3 and self.size else None


class View:
    """A mesh that a reader turns and zooms in a notebook, or in a page of its own.

    `positions` are `[V, 3]`, y up; `colors` `[V, 3]`, or `[V, 1]` for greys, from 0 to 1 as pixels stand for them.
    """

    def __init__(
        self, positions: NDArray[Any], mesh: _native.Mesh, colors: NDArray[Any] | None = None, caption: str = ""
    ) -> None:
        self.mesh, self.caption = mesh, caption
        self._page = _native.mesh_page(positions, mesh, colors, caption)

    def save(self, path: Path) -> None:
        """Writes a page that needs nothing beside it."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(f"<!doctype html><meta charset=utf-8>{self._page}")

    def _repr_html_(self) -> str:
        return self._page

    def __repr__(self) -> str:
        return f"View({self.mesh!r})"


class Scene:
    """A scene of a file `scene.toml`: meshes, cameras, images, and what is to be learnt.

    `docs/scene.md` has the keys of the file.
    """

    def __init__(self, native: _native.Scene) -> None:
        self._scene = native

    @staticmethod
    def open(path: Path) -> Scene:
        """The scene of the file at `path`; all its files lie in that file's folder."""
        return Scene(_native.Scene.open(os.fspath(path)))

    @property
    def views(self) -> list[str]:
        """The names of the views."""
        return self._scene.views

    @property
    def notes(self) -> list[str]:
        """What files hold that was left out or mended, in words."""
        return self._scene.notes

    @property
    def meshes(self) -> dict[str, tuple[NDArray[np.float32], NDArray[np.uint32]]]:
        """The meshes by name: positions `[V, 3]` and faces `[F, 3]`."""
        return self._scene.meshes

    def render(self, view: int | str = 0, *, reduce: int = 1) -> Picture:
        """A view as it is seen, by number or name, smaller `reduce` times along each axis."""
        return Picture(self._scene.render(view, reduce))

    def fit(
        self, callback: Callable[[Any], object] | None = None, *, progress: bool = False, resume: Path | None = None,
        steps: int | None = None,
    ) -> Fit:
        """Learns what the scene says, until its steps are done or one of its rules says stop.

        `callback(fit)` is called after each step; where it returns `False` the fit stops. `progress` shows a bar:
        tqdm's, where that is installed. Ctrl-C stops the fit between two steps and keeps it: `interrupted` is then
        true. `resume` is a file of `Fit.save`. No more than `steps` steps are done in this call; `Fit.run` goes on. The
        interpreter's lock is released while a step runs.
        """
        fit = Fit(self._scene.begin(None if resume is None else os.fspath(resume)))
        fit.run(callback, progress=progress, steps=steps)
        return fit

    def __repr__(self) -> str:
        return repr(self._scene)


class _Run:
    """A fit under way: `step` and `loss` of its last step, `losses` and `milliseconds` of all of this object's steps.

    `interrupted` says whether Ctrl-C stopped it.
    """

    _fit: _native.SceneFit | _native.Learning

    def __init__(self) -> None:
        self.losses: list[float] = []
        self.milliseconds: list[float] = []
        self.interrupted = False

    def _step(self) -> bool:
        """Does a step, and keeps its loss and milliseconds; or says that it is the end."""
        raise NotImplementedError

    def run(
        self, callback: Callable[[Any], object] | None = None, *, progress: bool = False, steps: int | None = None
    ) -> None:
        """Goes on until a rule says stop: all steps are done, or `steps` more. Ctrl-C stops it between two steps.

        `callback(fit)` is called after each step; where it returns `False` the fit stops.
        """
        self.interrupted = False
        bar = _bar(self, progress)
        try:
            while steps is None or steps > 0:
                if not self._step():
                    break
                steps = None if steps is None else steps - 1
                bar.update(self.loss)
                if callback is not None and callback(self) is False:
                    break
        except KeyboardInterrupt:
            self.interrupted = True
        finally:
            bar.close()

    @property
    def step(self) -> int:
        """How many steps are done."""
        return self._fit.steps_done

    @property
    def steps(self) -> int:
        """How many steps there are."""
        return self._fit.steps

    @property
    def loss(self) -> float:
        """The loss before the last step's update."""
        return self.losses[-1] if self.losses else float("nan")

    @property
    def parameters(self) -> dict[str, NDArray[Any]]:
        """What is learnt, by name."""
        return self._fit.parameters

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.step} of {self.steps} steps, loss {self.loss:.3e})"


class Fit(_Run):
    """A fit of a scene: see `Scene.fit`."""

    _fit: _native.SceneFit

    def __init__(self, fit: _native.SceneFit) -> None:
        super().__init__()
        self._fit = fit

    def _step(self) -> bool:
        return self._fit.step(self.losses, self.milliseconds)

    @property
    def ended(self) -> str | None:
        """The rule that ended the fit, in words, if one did before the last step."""
        return self._fit.ended

    def learnt(self) -> Scene:
        """The scene with what was learnt in the place of its own numbers."""
        return Scene(self._fit.learnt())

    def render(self, view: int | str = 0, *, reduce: int = 1) -> Picture:
        """A view as it is seen, by number or name, smaller `reduce` times along each axis."""
        return Picture(self._fit.render(view, reduce))

    def score(self, view: int | str = 0) -> dict[str, float | None]:
        """How well a view is matched: "psnr" in decibels, "ssim", "silhouette_iou"; `None` where there is no number.

        What is learnt of each view, as its camera, is fitted to the images of held-out views when the fit ends:
        "psnr_before" is how such a view was matched before that.
        """
        return self._fit.score(view)

    def save(self, path: Path) -> None:
        """Saves the fit to a file, from which `Scene.fit(resume=path)` goes on to the same bits."""
        self._fit.save(os.fspath(path))

    def _repr_html_(self) -> str:
        return self._fit.page(repr(self), self.losses)

    def save_results(self, folder: Path) -> list[pathlib.Path]:
        """Writes meshes, textures, cameras and pictures of what was learnt into a folder; returns their names."""
        return self._fit.save_results(os.fspath(folder))


@dataclass
class Parameter:
    """What a fit changes: where it starts, how fast it may move, and which numbers it may be.

    A number moves by about `rate` in a step of Adam. `mapping` is "identity", "softplus" or "exp" (positive numbers),
    or "sigmoid" (from 0 to 1); the rate counts before it.
    """

    start: NDArray[Any]
    rate: float = 1e-2
    mapping: str = "identity"


class Learning(_Run):
    """A fit of a function of one's own: see `bokashi.fit`."""

    _fit: _native.Learning

    def __init__(self, fit: _native.Learning, pipeline: Pipeline) -> None:
        super().__init__()
        self._fit, self.pipeline = fit, pipeline
        self.ended: str | None = None

    def _step(self) -> bool:
        self.ended = self._fit.step(self.pipeline, self.losses, self.milliseconds)
        return self.ended is None

    def _repr_html_(self) -> str:
        return _native.learning_page(repr(self), self.losses, list(self.parameters.items()))


# Of a dictionary of arrays it returns a loss and a dictionary of gradients.
Pipeline = Callable[[dict[str, NDArray[Any]]], tuple[float, dict[str, Any]]]


def fit(
    pipeline: Pipeline, parameters: Mapping[str, NDArray[Any] | Parameter], *, steps: int = 1000, cosine: bool = False,
    floor: float = 0.0, loss_below: float | None = None, patience: int | None = None,
    callback: Callable[[Any], object] | None = None, progress: bool = False,
) -> Learning:
    """Learns parameters by Adam: `pipeline(parameters)` returns a loss and a dictionary of gradients by name.

    Parameters are arrays, or `Parameter`s with a rate and a mapping. With `cosine` rates fall along half a
    cosine to the share `floor`. The fit stops after `steps`, where the loss is below `loss_below`, or where it found no
    new minimum for `patience` steps: `ended` says why. These rules are asked before each update, so the pipeline is
    called once more after the last step. `callback`, `progress` and Ctrl-C are as in `Scene.fit`.

    >>> import numpy as np
    >>> def distance(parameters):
    ...     gap = parameters["x"] - 3
    ...     return float((gap**2).sum()), {"x": 2 * gap}
    >>> learning = fit(distance, {"x": Parameter(np.zeros(2), rate=0.1)}, steps=300)
    >>> bool(np.allclose(learning.parameters["x"], 3, atol=1e-3))
    True
    """
    given = [
        (name, x.start, x.rate, x.mapping) if isinstance(x, Parameter) else (name, x, 1e-2, "identity")
        for name, x in parameters.items()
    ]
    learning = Learning(_native.Learning(given, steps, cosine, floor, loss_below, patience), pipeline)
    learning.run(callback, progress=progress)
    return learning


class _Plain:
    """A line on the standard error, a few times a second."""

    def __init__(self, fit: _Run) -> None:
        self.fit, self.shown = fit, 0.0

    def update(self, loss: float) -> None:
        now = time.monotonic()
        if now - self.shown > 0.2:
            self.shown = now
            print(f"\rstep {self.fit.step} of {self.fit.steps}, loss {loss:.3e}", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        print(f"\rstep {self.fit.step} of {self.fit.steps}, loss {self.fit.loss:.3e}", file=sys.stderr)


class _Tqdm:
    def __init__(self, fit: _Run, tqdm: Any) -> None:
        self.bar = tqdm(total=fit.steps, initial=fit.step, unit="step")

    def update(self, loss: float) -> None:
        self.bar.set_postfix(loss=f"{loss:.3e}", refresh=False)
        self.bar.update()

    def close(self) -> None:
        self.bar.close()


class _Silent:
    def update(self, loss: float) -> None:
        pass

    def close(self) -> None:
        pass


def _bar(fit: _Run, progress: bool) -> _Silent | _Plain | _Tqdm:
    if not progress:
        return _Silent()
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _Plain(fit)
    return _Tqdm(fit, tqdm)
