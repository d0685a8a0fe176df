"""Microseconds of a step from Python: the cube at 32 and 256 pixels, one thread, both sides drawn, float32.

    python benchmarks/overhead.py

Minimum of many runs, forward and backward. Steps differ in how much of an image they make: see the names.
"""

import sys
import time

import numpy as np

import bokashi

FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], np.int32
)


def cube():
    points = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    (ca, sa), (cb, sb) = [(np.cos(t), np.sin(t)) for t in (0.6, 0.5)]
    view = np.eye(4)
    view[:3, :3] = np.array([[1, 0, 0], [0, ca, sa], [0, -sa, ca]]) @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    view[2, 3] = -3.5
    project = np.array([[2.5, 0, 0, 0], [0, 2.5, 0, 0], [0, 0, -51 / 49, -100 / 49], [0, 0, -1, 0]])
    clip = np.concatenate([points, np.ones((8, 1))], 1) @ (project @ view).T
    return clip.astype(np.float32), (points + 0.5).astype(np.float32)


def least(step, seconds=1.0):
    """The least microseconds of a step."""
    best, end = np.inf, time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        step()
        best = min(best, time.perf_counter() - start)
    return 1e6 * best


def numpy_steps(size):
    clip, colors = cube()
    mesh = bokashi.Mesh(FACES, 8)
    reference, _ = bokashi.render(clip, mesh, colors, size, silhouettes="antialias")
    one = np.ones((), np.float32)

    def whole():
        loss, pull_back = bokashi.render(clip, mesh, colors, size, silhouettes="antialias", reference=reference)
        pull_back(one, wanted=(True, False, True, False, False))

    def exact():
        loss, pull_back = bokashi.render(clip, mesh, colors, size, reference=reference)
        pull_back(one, wanted=(True, False, True, False, False))

    def apart():
        fragments, of_clip = bokashi.rasterize(clip, mesh, size)
        surface, of_surface = bokashi.interpolate(colors, fragments)
        loss, of_loss = bokashi.picture(surface, fragments, reference=reference)
        surface_bar, _, _, clip_bar, *_ = of_loss(one, wanted=(True, False, False, True, False, False))
        _, uv_bar, *_ = of_surface(surface_bar, wanted=(True, True, False, False))
        of_clip(uv_bar)

    def forward():
        bokashi.rasterize(clip, mesh, size)

    yield "numpy: render with a loss, forward and pull-back", whole
    yield "numpy: the same with exact coverage", exact
    yield "numpy: rasterize, interpolate, picture with a loss, one by one", apart
    yield "numpy: rasterize alone", forward


def torch_steps(size):
    import torch

    import bokashi.nvdiffrast as dr
    import bokashi.torch as bt

    torch.set_num_threads(1)
    clip, colors = map(torch.from_numpy, cube())
    mesh, tri = bt.Mesh(FACES, 8), torch.from_numpy(FACES)
    with torch.no_grad():
        reference = bt.render(clip, mesh, colors, size, silhouettes="antialias")
    clip, colors = clip.requires_grad_(), colors.requires_grad_()
    context = dr.RasterizeCudaContext()

    def whole():
        bt.render(clip, mesh, colors, size, silhouettes="antialias", reference=reference).backward()

    def surface(own_loss):
        fragments = bt.rasterize(clip, mesh, size)
        values = bt.interpolate(colors, fragments)
        if own_loss:
            return bt.picture(values, fragments, reference=reference).backward()
        (bt.picture(values, fragments) - reference).square().sum().backward()

    def dense():
        rast, _ = dr.rasterize(context, clip[None], tri, [size, size])
        color, _ = dr.interpolate(colors[None], rast, tri)
        (dr.antialias(color, rast, clip[None], tri) - reference).square().sum().backward()

    flipped = reference.flip(0)[None]

    def loss_alone():
        image = flipped.detach().clone().requires_grad_()
        (image - flipped).square().sum().backward()

    rast, _ = dr.rasterize(context, clip[None], tri, [size, size])
    color, _ = dr.interpolate(colors[None], rast, tri)
    yield "torch: render with a loss", whole
    yield "torch: surface first, our loss", lambda: surface(True)
    yield "torch: surface first, torch's loss", lambda: surface(False)
    yield "torch: nvdiffrast's way, dense", dense
    yield "torch alone: its squared error and backward", loss_alone
    yield "torch: dr.rasterize, forward", lambda: dr.rasterize(context, clip[None], tri, [size, size])
    yield "torch: dr.interpolate, forward", lambda: dr.interpolate(colors[None], rast, tri)
    yield "torch: dr.antialias, forward", lambda: dr.antialias(color, rast, clip[None], tri)


def main():
    bokashi.set_num_threads(1)
    kinds = [numpy_steps] if "numpy" in sys.argv[1:] else [numpy_steps, torch_steps]
    for kind in kinds:
        columns = [list(kind(size)) for size in (32, 256)]
        for (name, small), (_, large) in zip(*columns):
            print(f"| {name} | {least(small):.1f} | {least(large):.0f} |", flush=True)


if __name__ == "__main__":
    main()
