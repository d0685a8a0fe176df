"""PyTorch's bilinear `grid_sample` on a million coordinates in a texture of 1024 x 1024 x 3, f32, as JSON
for `bokashi-lab bench --peers`: forward, and with the gradients of texels and coordinates.

The coordinates are those of the study `surfaces` of `bokashi-lab bench`. Its error is against f64.
"""

import json
import time

import numpy as np
import torch

SIDE = 1024
THREADS = 2
torch.set_num_threads(THREADS)
torch.manual_seed(0)


def inputs(dtype):
    x, y = np.meshgrid(*2 * [np.arange(SIDE) / SIDE])
    places = np.stack([(0.8 + y) * (x - 0.3), 2 * y * (1 + y) + 0.3 * x], -1).astype(np.float32)
    # From -1 to 1; it has no borders that wrap.
    grid = torch.tensor(2 * (places - np.floor(places)) - 1, dtype=torch.float64).to(dtype)[None]
    texels = np.random.default_rng(0).random((1, 3, SIDE, SIDE), dtype=np.float32)
    texels = torch.tensor(texels).to(dtype)
    return texels.requires_grad_(), grid.requires_grad_()


def sample(texels, grid):
    return torch.nn.functional.grid_sample(
        texels, grid, mode="bilinear", padding_mode="border", align_corners=False)


def both(texels, grid, upstream):
    texels.grad = grid.grad = None
    image = sample(texels, grid)
    image.backward(upstream)
    return image


def figure(passes, samples, error):
    return {
        "study": "surfaces", "name": f"PyTorch {torch.__version__}, grid_sample, bilinear",
        "scene": passes, "threads": THREADS, "minimum_microseconds": min(samples),
        "median_microseconds": float(np.median(samples)), "error": error,
    }


def timed(run):
    """After one that is not timed, as our samples are taken."""
    run()
    begun = time.perf_counter()
    run()
    return 1e6 * (time.perf_counter() - begun)


def relative(found, exact):
    found, exact = found.detach().double(), exact.detach()
    return float((found - exact).abs().max() / exact.abs().max())


single, double = inputs(torch.float32), inputs(torch.float64)
upstream = torch.rand((1, 3, SIDE, SIDE))
image, exact = both(*single, upstream), both(*double, upstream.double())
of_gradients = max(relative(found.grad, truth.grad) for found, truth in zip(single, double))
runs = [lambda: sample(*single), lambda: both(*single, upstream)]
forward, whole = zip(*[[timed(run) for run in runs] for _ in range(60)])
print(json.dumps([
    figure("forward", forward, relative(image, exact)),
    figure("forward and backward", whole, of_gradients),
], indent=1))
