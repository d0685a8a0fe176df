"""Four tasks of differentiable rasterization, as programs of ours: quality reached, and milliseconds a step.

    python benchmarks/tasks.py [cube] [pose] [environment] [texture] [--steps N] [--small]

- **cube**: positions and colours of a cube's vertices from images of 16 x 16 pixels under random rotations. Once
  through torch and `bokashi.nvdiffrast`, once through `bokashi.fit` and numpy alone.
- **pose**: the rotation of a coloured cube from one image of 256 x 256 pixels: random guesses, then gradients.
- **environment**: the light around a mirror ball, a cube map, and the highlight of a lamp after Phong.
- **texture**: a sphere's texture from images far and near, with mipmaps.

They are tasks that the samples of nvdiffrast have, too; these programs were written from the tasks. Truths are made
up, so that errors are known. `--small` is for a first look. One thread each.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch

import bokashi
import bokashi.nvdiffrast as dr

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
# Two triangles for each side, counter-clockwise seen from outside.
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], np.int32
)


def rotation(quaternion):
    """The matrix `[4, 4]` of a quaternion (x, y, z, w) of any length."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return matrix


def view(distance, half_angle=0.4, near=1.0, far=50.0):
    """The matrix `[4, 4]` of a camera on the axis +z that looks at the origin."""
    scale = 1 / np.tan(half_angle)
    lens = np.array(
        [[scale, 0, 0, 0], [0, scale, 0, 0], [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
         [0, 0, -1, 0]]
    )
    away = np.eye(4)
    away[2, 3] = -distance
    return lens @ away


def to_clip(positions, matrix):
    """Positions `[V, 3]` times a matrix, `[1, V, 4]`."""
    matrix = torch.as_tensor(matrix, dtype=torch.float32)
    return (torch.nn.functional.pad(positions, (0, 1), value=1.0) @ matrix.T)[None].contiguous()


class Clock:
    """Milliseconds of steps: the median, since others may work on the machine."""

    def __init__(self):
        self.times = []

    def step(self, work):
        start = time.perf_counter()
        result = work()
        self.times.append(1e3 * (time.perf_counter() - start))
        return result

    def __str__(self):
        return f"{np.median(self.times):.2f} ms a step (least {min(self.times):.2f})"


def cube_start(generator):
    colors = generator.uniform(0, 1, (8, 3)).astype(np.float32)
    start = (CORNERS + generator.uniform(-0.5, 0.5, (8, 3))).astype(np.float32)
    return colors, start, generator.uniform(0, 1, (8, 3)).astype(np.float32)


def vertex_error(found):
    """The root of the mean squared distance to the true corners."""
    return float(np.sqrt(np.square(found - CORNERS).sum(1).mean()))


def rate_after(step, steps):
    """Along half a cosine to a hundredth, as `bokashi.fit` has it."""
    return 0.01 + 0.99 * (1 + np.cos(np.pi * step / steps)) / 2


def cube(steps, size=16, seed=0):
    generator = np.random.default_rng(seed)
    true_colors, start, start_colors = cube_start(generator)
    tri, truth = torch.from_numpy(FACES), torch.from_numpy(CORNERS)
    colors_true = torch.from_numpy(true_colors)
    positions = torch.from_numpy(start).requires_grad_()
    colors = torch.from_numpy(start_colors).requires_grad_()
    optimizer = torch.optim.Adam([positions, colors], lr=1e-2)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: rate_after(step, steps))
    context, clock, lens = dr.RasterizeCudaContext(), Clock(), view(6)

    def image(positions, colors, matrix):
        clip = to_clip(positions, matrix)
        rast, _ = dr.rasterize(context, clip, tri, [size, size], grad_db=False)
        seen, _ = dr.interpolate(colors[None], rast, tri)
        return dr.antialias(seen, rast, clip, tri)

    def step():
        matrix = lens @ rotation(generator.normal(size=4))
        with torch.no_grad():
            target = image(truth, colors_true, matrix)
        loss = (image(positions, colors, matrix) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()

    for _ in range(steps):
        clock.step(step)
    print(f"cube, {size} px, torch: vertex error {vertex_error(positions.detach().numpy()):.1e}, {clock}", flush=True)


def cube_numpy(steps, size=16, seed=0):
    """The same through `bokashi.fit`, with exact silhouettes or antialiased ones."""
    for silhouettes in ("antialias", "exact"):
        generator = np.random.default_rng(seed)
        true_colors, start, start_colors = cube_start(generator)
        mesh, one, lens = bokashi.Mesh(FACES, 8), np.ones((), np.float32), view(6)
        scale = 1 / (3 * size * size)

        def pipeline(parameters):
            camera = (lens @ rotation(generator.normal(size=4))).astype(np.float32)
            given = {"camera": camera, "silhouettes": silhouettes}
            target, _ = bokashi.render(CORNERS, mesh, true_colors, size, **given)
            loss, pull_back = bokashi.render(
                parameters["positions"], mesh, parameters["colors"], size, reference=target, **given
            )
            positions_bar, _, colors_bar, *_ = pull_back(scale * one, wanted=(True, False, True, False, False))
            return scale * float(loss), {"positions": positions_bar, "colors": colors_bar}

        learning = bokashi.fit(
            pipeline, {"positions": bokashi.Parameter(start), "colors": bokashi.Parameter(start_colors)}, steps=steps,
            cosine=True, floor=0.01,
        )
        error, milliseconds = vertex_error(learning.parameters["positions"]), np.median(learning.milliseconds)
        print(f"cube, {size} px, bokashi.fit, {silhouettes}: vertex error {error:.1e}, {milliseconds:.3f} ms a step")


def pose(steps, size=256, seed=0):
    generator = np.random.default_rng(seed)
    # A colour for each side: no rotation of the cube looks like another.
    sides = torch.from_numpy(generator.permutation(np.array(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]], np.float32
    )))
    of_faces = torch.arange(12, dtype=torch.int32)[:, None].expand(-1, 3) // 2
    of_faces, tri = of_faces.contiguous(), torch.from_numpy(FACES)
    corners, context, clock = torch.from_numpy(CORNERS), dr.RasterizeCudaContext(), Clock()
    camera = torch.from_numpy(view(6)).float()
    true = torch.from_numpy(generator.normal(size=4)).float()

    def matrix(quaternion):
        x, y, z, w = quaternion / quaternion.norm()
        zero, one = torch.zeros(()), torch.ones(())
        rows = [
            1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), zero,
            2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), zero,
            2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), zero, zero, zero, zero, one,
        ]
        return camera @ torch.stack(rows).reshape(4, 4)

    def image(quaternion):
        clip = (torch.nn.functional.pad(corners, (0, 1), value=1.0) @ matrix(quaternion).T)[None]
        rast, _ = dr.rasterize(context, clip, tri, [size, size], grad_db=False)
        seen, _ = dr.interpolate(sides[None], rast, of_faces)
        return dr.antialias(seen * (rast[..., 3:] > 0), rast, clip, tri)

    def degrees(quaternion):
        cosine = float((quaternion / quaternion.norm()) @ (true / true.norm()))
        return float(np.degrees(2 * np.arccos(min(abs(cosine), 1.0))))

    with torch.no_grad():
        target = image(true)
    best, best_loss = true, np.inf

    def guess(step):
        """Anywhere, or near the best of all."""
        nonlocal best, best_loss
        found = torch.from_numpy(generator.normal(size=4)).float()
        if step % 2:
            found = best / best.norm() + 0.3 * found
        with torch.no_grad():
            loss = float((image(found) - target).square().mean())
        if loss < best_loss:
            best, best_loss = found, loss

    guesses = steps // 3
    for step in range(guesses):
        clock.step(lambda: guess(step))
    quaternion = (best / best.norm()).clone().requires_grad_()
    optimizer = torch.optim.Adam([quaternion], lr=1e-2)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: rate_after(step, steps - guesses))

    def descend():
        loss = (image(quaternion) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()

    for _ in range(guesses, steps):
        clock.step(descend)
    found = quaternion.detach()
    after = degrees(best)
    print(f"pose, {size} px: off by {degrees(found):.4f} degrees ({after:.2f} after guesses), {clock}", flush=True)


def sphere(rings):
    """Positions `[V, 3]` of length 1, faces and texture coordinates of a sphere by latitude and longitude."""
    v, u = np.meshgrid(np.linspace(0, 1, rings + 1), np.linspace(0, 1, 2 * rings + 1), indexing="ij")
    polar, around = np.pi * v, 2 * np.pi * u
    points = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), -np.sin(polar) * np.sin(around)], -1)
    across = 2 * rings + 1
    first = (np.arange(rings)[:, None] * across + np.arange(2 * rings)[None]).reshape(-1, 1)
    faces = np.concatenate([first + [0, across, across + 1], first + [0, across + 1, 1]])
    # At the poles sides have no length.
    lengths = np.linalg.norm(points.reshape(-1, 3)[faces] - np.roll(points.reshape(-1, 3)[faces], 1, 1), axis=2)
    faces = faces[(lengths > 1e-9).all(1)]
    uv = np.stack([u, v], -1)
    return points.reshape(-1, 3).astype(np.float32), faces.astype(np.int32), uv.reshape(-1, 2).astype(np.float32)


def waves(points, generator, count=24):
    """Made-up colours `[.., 3]` from 0 to 1 of points `[.., 3]`: waves, half of them long."""
    colors = np.zeros((*points.shape[:-1], 3))
    for k in range(count):
        along = generator.normal(size=3) * (2 if k % 2 else 9)
        colors += np.sin(points @ along + generator.uniform(0, 6))[..., None] * generator.normal(size=3)
    return (1 / (1 + np.exp(-colors / np.sqrt(count) * 2))).astype(np.float32)


def cube_directions(side):
    """Directions `[6, S, S, 3]` to the texels of a cube map, as OpenGL has them, of length 1."""
    at = (np.arange(side) + 0.5) / side * 2 - 1
    s, t = np.meshgrid(at, at)
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    directions = np.stack([np.stack(face, -1) for face in faces])
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def decibels(error):
    return -10 * np.log10(max(float(error), 1e-20))


def environment(steps, size=1024, side=512, seed=0):
    """A bumpy mirror ball, light of a cube map, and a lamp's highlight: the map and the highlight are learnt."""
    generator = np.random.default_rng(seed)
    points, faces, _ = sphere(48)
    bumps = 1 + 0.1 * np.sin(5 * points).prod(1, keepdims=True)
    positions = (points * bumps).astype(np.float32)
    normals = torch.from_numpy(bokashi.vertex_normals(positions, bokashi.Mesh(faces, len(points)))[0])
    positions, tri = torch.from_numpy(positions), torch.from_numpy(faces)
    truth = torch.from_numpy(waves(cube_directions(side), generator))[None]
    true_phong = torch.tensor([0.7, 0.5, 0.3, 25.0])
    light = torch.full_like(truth, 0.5).requires_grad_()
    phong = torch.tensor([0.3, 0.3, 0.3, 10.0]).requires_grad_()
    optimizer = torch.optim.Adam([{"params": [light], "lr": 2e-2}, {"params": [phong], "lr": 5e-2}])
    context, clock = dr.RasterizeCudaContext(), Clock()
    lamp = torch.nn.functional.normalize(torch.tensor([1.0, 2.0, 2.0]), dim=0)

    def image(rast, clip, eye, light, phong):
        values = torch.cat([normals, positions], 1)[None]
        seen, _ = dr.interpolate(values, rast, tri)
        normal = torch.nn.functional.normalize(seen[..., :3], dim=-1)
        towards = torch.nn.functional.normalize(seen[..., 3:] - eye, dim=-1)
        mirrored = towards - 2 * (towards * normal).sum(-1, keepdim=True) * normal
        ball = dr.texture(light, mirrored.contiguous(), filter_mode="linear", boundary_mode="cube")
        glow = (mirrored * lamp).sum(-1, keepdim=True).clamp(min=1e-3)
        color = ball + phong[:3] * glow ** phong[3]
        return dr.antialias(torch.where(rast[..., 3:] > 0, color, 0.2), rast, clip, tri)

    def step():
        turned = rotation(generator.normal(size=4))
        matrix = view(4) @ turned
        eye = torch.from_numpy(turned[:3, :3].T @ [0, 0, 4]).float()
        clip = to_clip(positions, matrix)
        rast, _ = dr.rasterize(context, clip, tri, [size, size])
        with torch.no_grad():
            target = image(rast, clip, eye, truth, true_phong)
        loss = (image(rast, clip, eye, light, phong) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.item()

    losses = [clock.step(step) for _ in range(steps)]
    error = decibels((light.detach() - truth).square().mean())
    found = ", ".join(f"{x:.2f}" for x in phong.tolist())
    print(
        f"environment, {size} px, map {side}: PSNR of images {decibels(np.median(losses[-10:])):.1f} dB, of the map "
        f"{error:.1f} dB, highlight ({found}) of (0.70, 0.50, 0.30, 25.00), {clock}", flush=True,
    )


def texture(steps, size=512, rows=1024, seed=0):
    """A sphere's texture from images near and far, against images of four times the size, averaged."""
    for has_mipmaps in (True, False):
        generator = np.random.default_rng(seed)
        points, faces, uv = sphere(48)
        positions, tri, uv = torch.from_numpy(points), torch.from_numpy(faces), torch.from_numpy(uv)[None]
        polar, around = np.meshgrid(
            (np.arange(rows) + 0.5) / rows * np.pi, (np.arange(2 * rows) + 0.5) / rows * np.pi, indexing="ij"
        )
        places = np.stack(
            [np.sin(polar) * np.cos(around), np.cos(polar), -np.sin(polar) * np.sin(around)], -1
        )
        truth = torch.from_numpy(waves(4 * places, generator))[None]
        learnt = torch.full_like(truth, 0.4).requires_grad_()
        optimizer = torch.optim.Adam([learnt], lr=1e-2)
        context, clock = dr.RasterizeCudaContext(), Clock()

        def image(texels, clip, size, mipmaps):
            rast, rast_db = dr.rasterize(context, clip, tri, [size, size])
            if mipmaps:
                at, at_db = dr.interpolate(uv, rast, tri, rast_db=rast_db, diff_attrs="all")
                color = dr.texture(texels, at, at_db, max_mip_level=9)
            else:
                at, _ = dr.interpolate(uv, rast, tri)
                color = dr.texture(texels, at, filter_mode="linear")
            return color * (rast[..., 3:] > 0)

        def step():
            clip = to_clip(positions, view(generator.uniform(1.5, 20)) @ rotation(generator.normal(size=4)))
            with torch.no_grad():
                fine = image(truth, clip, 4 * size, True)
                target = torch.nn.functional.avg_pool2d(fine.permute(0, 3, 1, 2), 4).permute(0, 2, 3, 1)
            loss = (image(learnt, clip, size, has_mipmaps) - target).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

        for _ in range(steps):
            clock.step(step)
        error = decibels((learnt.detach() - truth).square().mean())
        word = "with" if has_mipmaps else "without"
        print(f"texture, {size} px, {rows} rows, {word} mipmaps: PSNR {error:.2f} dB, {clock}", flush=True)


def main():
    parser = argparse.ArgumentParser(description="Four tasks: quality, and milliseconds a step.")
    names = ["cube", "pose", "environment", "texture"]
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=", ".join(names))
    parser.add_argument("--steps", type=int)
    parser.add_argument("--small", action="store_true", help="small images and textures")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if unknown := set(given.tasks) - set(names):
        parser.error(f"a task is one of {names}, got {sorted(unknown)}")
    torch.set_num_threads(1)
    bokashi.set_num_threads(1)
    small, seed = given.small, given.seed
    for task in given.tasks or names:
        if task == "cube":
            cube(given.steps or 1000, seed=seed)
            cube_numpy(given.steps or 1000, seed=seed)
        elif task == "pose":
            pose(given.steps or 600, 64 if small else 256, seed=seed)
        elif task == "environment":
            environment(given.steps or 100, *((128, 64) if small else (1024, 512)), seed=seed)
        else:
            texture(given.steps or 50, *((64, 128) if small else (512, 1024)), seed=seed)


if __name__ == "__main__":
    main()
