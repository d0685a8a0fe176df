"""One hash of the values and gradients of the tests' cases, and of whole steps in both precisions.

    python benchmarks/bits.py [--each]

It is the same for any Python, any numpy and any wheel of one commit on processors of one kind. `--each` prints one for
each case, too: where two differ, they say in what.
"""

import hashlib
import pathlib
import sys

import numpy as np

import bokashi

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "tests"))
from cases import cases, scene  # noqa: E402


def outputs_of(value):
    """The arrays in what an operation returns: those whose gradients its pull-back takes."""
    if isinstance(value, bokashi.Environment):
        # The first level is the texels themselves.
        return [value.harmonics, *value.levels[1:]]
    return [np.asarray(part) for part in (value if isinstance(value, (tuple, list)) else [value])]


def steps():
    """By name: values and pull-backs."""
    for name, (function, arrays, *_) in cases(np.random.default_rng(7)).items():
        yield name, *function(bokashi, *arrays)
    for dtype in (np.float32, np.float64):
        mesh, clip = scene(np.random.default_rng(3), dtype)
        colors = np.random.default_rng(4).uniform(size=(7, 3)).astype(dtype)
        for silhouettes in ("exact", "antialias"):
            image, pull_back = bokashi.render(clip, mesh, colors, 150, silhouettes=silhouettes)
            yield f"render, {silhouettes}, {dtype.__name__}", image, pull_back
            yield f"gaussian_blur, {silhouettes}, {dtype.__name__}", *bokashi.gaussian_blur(image, 3.3)
            yield f"srgb_encode, {silhouettes}, {dtype.__name__}", *bokashi.srgb_encode(image)


def main():
    whole = hashlib.sha256()
    for name, value, pull_back in steps():
        outputs = outputs_of(value)
        own = hashlib.sha256()
        gradients = pull_back(*map(np.ones_like, outputs))
        for array in (*outputs, *(bar for bar in gradients if bar is not None)):
            own.update(str((array.dtype, array.shape)).encode() + array.tobytes())
        whole.update(own.digest())
        if "--each" in sys.argv[1:]:
            print(own.hexdigest()[:16], name)
    print(whole.hexdigest()[:16], f"Python {sys.version.split()[0]}, numpy {np.__version__}")


if __name__ == "__main__":
    main()
