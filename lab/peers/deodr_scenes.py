"""DEODR 0.2.3 on the scenes of `bokashi-lab bench`: milliseconds of a render and of the backward pass
of the squared error, as JSON for `bokashi-lab bench --peers`.

Its 2-D stage alone, in f64, on one thread, back faces culled: vertices are projected beforehand, and
the gradient ends at the pixel positions. Positions are shifted by 0.3 pixels at 256 px.
"""

import json
import time

import numpy as np
from deodr import differentiable_renderer_cython as core
from deodr.differentiable_renderer import Scene2D
from deodr.triangulated_mesh import TriMeshAdjacencies

CUBE_FACES = [
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
]


def cube():
    corners = np.stack(np.meshgrid(*3 * [[-0.5, 0.5]], indexing="ij"), -1).reshape(-1, 3)
    return corners, np.array(CUBE_FACES), corners + 0.5


def sphere(around, along):
    """A sphere of radius 0.8: two poles and `along - 1` rings of `around` vertices."""
    angle = np.pi * np.arange(1, along)[:, None] / along
    turn = 2 * np.pi * np.arange(around)[None] / around
    rings = [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle) + 0 * turn]
    rings = np.stack(rings, -1).reshape(-1, 3)
    points = 0.8 * np.concatenate([[[0, 0, 1]], rings, [[0, 0, -1]]])
    k = np.arange(around)
    n = (k + 1) % around
    faces = [np.stack([0 * k, 1 + k, 1 + n], 1)]
    for ring in range(along - 2):
        a, b = 1 + ring * around, 1 + (ring + 1) * around
        quads = [np.stack([a + k, b + k, b + n], 1), np.stack([a + k, b + n, a + n], 1)]
        faces.append(np.stack(quads, 1).reshape(-1, 3))
    a = 1 + (along - 2) * around
    faces.append(np.stack([a + k, 0 * k + len(points) - 1, a + n], 1))
    return points, np.concatenate(faces), points / 1.6 + 0.5


def camera():
    """The view of the paper's experiment 5.2: from 3.5 away, turned by 0.6 and 0.5 radians."""
    (ca, sa), (cb, sb) = [(np.cos(t), np.sin(t)) for t in (0.6, 0.5)]
    about_x = np.array([[1, 0, 0], [0, ca, sa], [0, -sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    view = np.eye(4)
    view[:3, :3] = about_x @ about_y
    view[2, 3] = -3.5
    project = np.array([[2.5, 0, 0, 0], [0, 2.5, 0, 0], [0, 0, -51 / 49, -100 / 49], [0, 0, -1, 0]])
    return project @ view


def figure(name, mesh, side):
    points, faces, colors = mesh
    clip = np.c_[points, np.ones(len(points))] @ camera().T
    ndc = clip[:, :2] / clip[:, 3:]
    pixels = np.stack([(ndc[:, 0] + 1) * side / 2 - 0.5, (1 - ndc[:, 1]) * side / 2 - 0.5], 1)
    faces = faces.astype(np.uint32)
    silhouettes = TriMeshAdjacencies(faces, clockwise=False).edge_on_silhouette(pixels)

    def scene(pixels, colors):
        return Scene2D(
            faces=faces, faces_uv=faces, ij=pixels, depths=clip[:, 3].copy(),
            textured=np.zeros(len(faces), bool), uv=np.zeros((len(points), 2)),
            shade=np.zeros(len(points)), colors=colors, shaded=np.zeros(len(faces), bool),
            edgeflags=silhouettes, height=side, width=side, nb_colors=3,
            texture=np.zeros((2, 2, 3)), background_image=np.zeros((side, side, 3)),
            background_color=None, clockwise=False, backface_culling=True, perspective_correct=False,
        )

    target, depth = np.zeros((side, side, 3)), np.zeros((side, side))
    core.renderSceneCpp(scene(pixels, colors), 1.0, target, depth)
    shift = np.random.default_rng(0).normal(0, 0.3 * side / 256, pixels.shape)
    learnt = scene(pixels + shift, np.clip(colors + 0.05, 0, 1))
    samples = []
    start = time.perf_counter()
    while len(samples) < 200 and (len(samples) < 30 or time.perf_counter() - start < 1):
        begun = time.perf_counter()
        learnt.clear_gradients()
        image, _ = learnt.render(1.0)
        learnt.render_backward(2 * (image - target))
        samples.append(1e6 * (time.perf_counter() - begun))
    return {
        "study": "scenes", "name": "DEODR", "scene": name,
        "minimum_microseconds": min(samples),
        "median_microseconds": float(np.median(samples)),
    }


SCENES = [
    ("cube@32", cube(), 32),
    ("cube@256", cube(), 256),
    ("cube@1024", cube(), 1024),
    ("sphere1k@256", sphere(32, 17), 256),
    ("sphere20k@512", sphere(144, 70), 512),
    ("sphere80k@1024", sphere(288, 140), 1024),
]
print(json.dumps([figure(*scene) for scene in SCENES], indent=1))
