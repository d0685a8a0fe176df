"""Operations that are described once, with arrays to try them on: of numpy, torch and jax."""

import numpy as np

import bokashi
from conftest import scene


def layered(generator):
    """Four faces over each other that are seen in three layers: a mesh, and clip positions."""
    square = np.array([[-0.9, -0.8], [0.8, -0.9], [-0.7, 0.9]])
    corners = [square * s + generator.uniform(-0.05, 0.05, (3, 2)) for s in (1.0, 0.9, 0.8)]
    ndc = np.concatenate([np.hstack([xy, np.full((3, 1), z)]) for xy, z in zip(corners, (-0.3, 0.1, 0.5))])
    w = np.repeat([[1.2], [1.9], [2.8]], 3, 0) + generator.uniform(0, 0.2, (9, 1))
    return bokashi.Mesh(np.arange(9).reshape(3, 3), 9), np.concatenate([ndc * w, w], 1)


def ball(generator):
    """A grid, a field of which no number is near 0, and offsets of the grid's points."""
    grid = bokashi.Grid.around([-1, -1, -1], [1, 1, 1], 4)
    field = np.linalg.norm(grid.positions * [1.0, 1.2, 0.9], axis=-1) - 0.8 + generator.uniform(-0.05, 0.05, grid.shape)
    field = np.where(abs(field) < 0.02, 0.02, field)
    return grid, field, generator.uniform(-0.05, 0.05, (*grid.shape, 3))


def cases(generator):
    """By name: a function of a module and arrays, the arrays in the order of gradients, and the places of these."""

    def normal(*shape):
        return generator.normal(size=shape)

    def uniform(low, high, *shape):
        return generator.uniform(low, high, shape)

    mesh, clip = scene(generator)
    positions, rest = clip[:, :3].copy(), clip[:, :3] + normal(7, 3) * 0.05
    topology = bokashi.Topology(mesh)
    rigidity = bokashi.Rigidity(topology, rest)
    matrix = bokashi.SparseMatrix((3, 5), np.array([0, 2, 2]), np.array([1, 0, 4]), np.array([0.5, 2.0, -1.0]))
    image, reference = uniform(0.2, 0.8, 13, 12, 2), uniform(0.2, 0.8, 13, 12, 2)
    weights, mask = uniform(0.1, 1, 13, 12), uniform(0, 1, 13, 12) > 0.4
    depths = uniform(1, 3, 6, 5)
    behind, behind_clip = layered(generator)
    layers, _ = bokashi.depth_layers(behind_clip, behind, (9, 8))
    first, second = layers[0], layers[1]
    counts = len(first), len(second)
    colors = [uniform(0, 1, count, 3) for count in counts]
    alphas = [uniform(0.2, 0.9, count) for count in counts]
    front, _ = bokashi.rasterize(behind_clip, behind, (9, 8), exact=True)
    prefilter = bokashi.Prefilter(4, 2)
    texels = uniform(0.2, 1, 6, 4, 4, 3)
    light, _ = bokashi.prefiltered(texels, prefilter)
    normals, views = normal(5, 3) + [0, 0, 3], np.array([0.1, -0.2, 3.0])

    def composite(b, sky, clip, c0, a0, c1, a1, **options):
        return b.composite_layers([(first.replace(clip=clip), c0, a0), (second, c1, a1)], sky, **options)

    def lens(b, sky, aperture, focus, c0, a0, z0, s0, c1, z1):
        drawn = [b.LensLayer(first.replace(weight=None), c0, z0, a0, s0), b.LensLayer(second, c1, z1)]
        return b.lens_picture(drawn, aperture, focus, background=sky, far=5.0, margin=1, largest_radius=6.0)

    def exact_lens(b, weight, c0, z0, c1, z1):
        drawn = [b.LensLayer(front.replace(weight=weight), c0, z0), b.LensLayer(first, c1, z1)]
        return b.lens_picture(drawn, 1.5, 1.4, blades=6, rotation=0.2)

    distances = [bokashi.eye_depth(layer)[0] for layer in (first, second, front)]
    slope = bokashi.eye_depth_slope(first)[0]

    def shaded(model):
        return lambda b, n, v, *more: b.shade_in_environment(
            n, v, more[:-2], b.Environment(more[-2], more[-1:]), model=model
        )

    def metal(b, normals, views, color, roughness, metallic, harmonics, *levels):
        light = b.Environment(harmonics, levels)
        return b.shade_in_environment(normals, views, [color, roughness, metallic], light)

    vectors, rows = normal(5, 3), np.array([3, 0, 3, 1])
    return {
        "norm": (lambda b, x: b.norm(x), [vectors]),
        "normalize": (lambda b, x: b.normalize(x), [vectors]),
        "dot": (lambda b, x, y: b.dot(x, y), [vectors, normal(3)]),
        "cross": (lambda b, x, y: b.cross(x, y), [vectors, normal(5, 3)]),
        "matmul": (lambda b, x, y: b.matmul(x, y), [vectors, normal(3, 2)]),
        "gather_rows": (lambda b, x: b.gather_rows(x, rows), [vectors]),
        "scatter_add_rows": (lambda b, x: b.scatter_add_rows(x, rows, 6), [normal(4, 2)]),
        "sparse_product": (lambda b, x: b.sparse_product(x, matrix), [vectors]),
        "sigmoid": (lambda b, x: b.sigmoid(x), [vectors]),
        "softplus": (lambda b, x: b.softplus(x), [vectors]),
        "squared_error": (lambda b, x, y: b.squared_error(x, y), [image, reference]),
        "mean_error": (lambda b, x, y: b.mean_error(x, y), [image, reference]),
        "mean_error, weighted": (
            lambda b, x, y, w: b.mean_error(x, y, w, penalty="charbonnier", scale=0.1), [image, reference, weights]
        ),
        "mean_error, masked": (
            lambda b, x, y: b.mean_error(x, y, penalty="huber", scale=0.1, mask=mask), [image, reference]
        ),
        # The gradient of the image takes the denominator as it is, so it is no derivative: the reference's is one.
        "mean_error, relative": (
            lambda b, y: b.mean_error(image.tolist(), y, penalty="relative", scale=0.1), [reference], [1]
        ),
        "mean_error, absolute": (lambda b, x, y: b.mean_error(x, y, penalty="absolute"), [image, reference]),
        "ssim_error": (lambda b, x, y: b.ssim_error(x, y), [image, reference]),
        "multiscale_ssim_error": (lambda b, x, y: b.multiscale_ssim_error(x, y, levels=1), [image, reference]),
        "silhouette_error": (lambda b, x, y: b.silhouette_error(x, y), [image, reference]),
        "depth_error": (
            lambda b, x, y: b.depth_error(x, y, alignment="scale-and-shift"), [depths, depths + normal(6, 5) * 0.2]
        ),
        "halved": (lambda b, x: b.halved(x), [image]),
        "total_variation": (lambda b, x: b.total_variation(x, penalty="charbonnier", scale=0.1), [image]),
        "laplacian_error": (lambda b, x: b.laplacian_error(x, topology.cotangent_laplacian(rest)), [positions]),
        "edge_length_error": (lambda b, x: b.edge_length_error(x, topology, target=0.3), [positions]),
        "normal_error": (lambda b, x: b.normal_error(x, topology), [positions]),
        "rigid_error": (lambda b, x: b.rigid_error(x, rigidity), [positions]),
        "draw_points": (lambda b, x: b.draw_points(x, mesh, 9, seed=3), [positions]),
        "chamfer_distance": (lambda b, x, y: b.chamfer_distance(x, y), [vectors, normal(7, 3)]),
        "chamfer_distance, not squared": (
            lambda b, x, y: b.chamfer_distance(x, y, squared=False), [vectors, normal(7, 3)]
        ),
        "eye_depth_slope": (
            lambda b, uv, clip: b.eye_depth_slope(first.replace(barycentrics=uv, clip=clip)),
            [first.barycentrics, behind_clip],
        ),
        "composite_layers": (composite, [uniform(0, 1, 3), behind_clip, colors[0], alphas[0], colors[1], alphas[1]]),
        "composite_layers, a loss": (
            lambda b, *x: composite(b, *x, reference=np.ones((9, 8, 3)).tolist()),
            [uniform(0, 1, 9, 8, 3), behind_clip, colors[0], alphas[0], colors[1], alphas[1]],
        ),
        "lens_picture": (
            lens,
            [
                uniform(0, 1, 3), np.array(2.1), np.array(1.45), colors[0], alphas[0], distances[0], slope, colors[1],
                distances[1],
            ],
            [0, 1, 2, 4, 5, 6, 7, 8, 10],
        ),
        "lens_picture, exact": (
            exact_lens, [0.9 * front.weight, uniform(0, 1, len(front), 3), distances[2], colors[0], distances[0]], [3, 4, 6, 8, 10]
        ),
        "irradiance": (lambda b, h, n: b.irradiance(h, n), [light.harmonics, normals]),
        "shade_in_environment": (
            metal,
            [normals, views, uniform(0.2, 0.8, 5, 3), uniform(0.3, 0.8, 5), np.array(0.4), light.harmonics, *light.levels],
        ),
        "shade_in_environment, matte": (
            shaded("lambert"), [normals, views, uniform(0.2, 0.8, 5, 3), light.harmonics, texels], [0, 1, 2, 5, 6]
        ),
        "prefiltered": (lambda b, x: b.prefiltered(x, prefilter), [texels]),
    }
