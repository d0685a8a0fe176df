"""Objects from photographs that an independent ray tracer took: made, fitted by `bokashi`, and scored.

    pip install mitsuba==3.9.1 trimesh scikit-image scipy pillow
    npm pack bunny && tar xzf bunny-*.tgz        # the Stanford bunny, in the public domain
    python objects.py make FOLDER                # some 40 seconds each
    python objects.py noise FOLDER NOISY --degrees 1
    python objects.py fit FOLDER RUNS            # `bokashi new` and `bokashi fit`, nothing edited
    python objects.py fit NOISY RUNS --rough-cameras
    python objects.py score FOLDER RUNS
    python objects.py seen FOLDER RUNS           # errors by how many photographs see a place

The photographs are path traced under an even sky, 320 x 320 pixels, with opacity, from 24 sides; every eighth is
held out. Objects are turned at random, so that no axis of a grid is one of theirs. Each seed makes other photographs.
"""

import argparse
import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np

ANGLE = 40.0
SKY = 0.8
SAMPLES = 64


def union(a, b, width):
    """Both shapes, with a rounded edge between them."""
    share = np.clip(0.5 + 0.5 * (b - a) / width, 0, 1)
    return b * (1 - share) + a * share - width * share * (1 - share)


def ellipsoid(p, center, radii):
    return (np.linalg.norm((p - np.array(center)) / np.array(radii), axis=-1) - 1) * min(radii)


def ring(p, center, axis, radius, thickness):
    q = p - np.array(center)
    across = np.linalg.norm(np.delete(q, axis, axis=-1), axis=-1)
    return np.hypot(across - radius, q[..., axis]) - thickness


def head(p):
    shape = ellipsoid(p, (0, 0, 0), (0.62, 0.8, 0.7))
    shape = union(shape, ellipsoid(p, (0, -0.08, 0.72), (0.12, 0.2, 0.16)), 0.08)
    for side in (-1, 1):
        ear = ellipsoid(p, (side * 0.655, 0.05, -0.05), (0.06, 0.24, 0.17))
        ear = np.maximum(ear, -ellipsoid(p, (side * 0.725, 0.05, -0.02), (0.06, 0.15, 0.1)))
        shape = union(shape, ear, 0.03)
    neck = np.maximum(np.hypot(p[..., 0], p[..., 2] + 0.1) - 0.3, np.abs(p[..., 1] + 0.85) - 0.3)
    return union(shape, neck, 0.1)


def torus(p):
    return ring(p, (0, 0, 0), 1, 0.65, 0.25)


def cup(p):
    across = np.hypot(p[..., 0], p[..., 2])
    outside = np.maximum(across - 0.5, np.abs(p[..., 1]) - 0.6)
    inside = np.maximum(across - 0.42, -(p[..., 1] + 0.5))
    handle = np.maximum(ring(p, (0.55, 0, 0), 2, 0.3, 0.055), -(across - 0.44))
    return union(np.maximum(outside, -inside), handle, 0.03)


def leaf(p):
    x, y, z = np.moveaxis(p, -1, 0)
    width = 0.45 * np.clip(1 - x**2, 0, None) ** 0.7
    bent = np.abs(y - (0.25 * x * x - 0.35 * z * z + 0.1 * x)) - 0.025
    return 0.7 * np.maximum(bent, np.maximum(np.abs(z) - width, np.abs(x) - 0.98))


def pierced(p):
    box = np.linalg.norm(np.maximum(np.abs(p) - np.array((0.6, 0.4, 0.5)), 0), axis=-1) - 0.1
    return np.maximum(box, 0.27 - np.hypot(p[..., 0] - 0.1, 1.2 * p[..., 1]))


def surface_of(shape, points=200, radius=1.25):
    from skimage.measure import marching_cubes

    axis = np.linspace(-radius, radius, points)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    vertices, faces, *_ = marching_cubes(shape(grid), 0, spacing=(axis[1] - axis[0],) * 3)
    return vertices - radius, faces


def bunny():
    text = Path("package/index.js").read_text()
    arrays = {name: json.loads(rows) for name, rows in re.findall(r"exports\.(\w+)=(\[.*?\]\]);?", text, re.S)}
    vertices = np.array(arrays["positions"], float)
    vertices -= 0.5 * (vertices.min(0) + vertices.max(0))
    return vertices / np.linalg.norm(vertices, axis=1).max(), np.array(arrays["cells"])


def waves(v):
    x, y, z = v.T
    return np.stack([0.5 + 0.4 * np.sin(6 * x + 2), 0.5 + 0.4 * np.sin(7 * y), 0.5 + 0.4 * np.sin(5 * z + 1)], 1)


def checkers(v):
    is_odd = np.floor(6 * v + 0.13).astype(int).sum(1) % 2 == 1
    return np.where(is_odd[:, None], waves(v), 0.25 * waves(v) + 0.6)


OBJECTS = {
    "head": (lambda: surface_of(head), waves),
    "torus": (lambda: surface_of(torus), waves),
    "bunny": (bunny, waves),
    "cup": (lambda: surface_of(cup), waves),
    "leaf": (lambda: surface_of(leaf), waves),
    "pierced": (lambda: surface_of(pierced), checkers),
}


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pose_from(eye):
    """Camera to world, OpenGL's convention, of a camera at `eye` that looks at the origin."""
    back = eye / np.linalg.norm(eye)
    up = np.array([0, 1, 0]) if abs(back[1]) < 0.95 else np.array([1, 0, 0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], 1)
    pose[:3, 3] = eye
    return pose


def make(args):
    import mitsuba as mi
    from PIL import Image

    mi.set_variant("scalar_rgb")
    for name in args.names or OBJECTS:
        rng = np.random.default_rng([args.seed, sorted(OBJECTS).index(name)])
        build, color = OBJECTS[name]
        vertices, faces = build()
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
            faces = faces[:, ::-1]
        colors = np.clip(color(vertices), 0.02, 0.98)
        vertices = vertices @ rotation(rng.normal(size=3), rng.uniform(0, np.pi)).T
        out = args.folder / name
        (out / "images").mkdir(parents=True, exist_ok=True)
        mesh = mi.Mesh("object", len(vertices), len(faces), has_vertex_normals=False, has_vertex_texcoords=False)
        mesh.add_attribute("vertex_color", 3, colors.ravel().tolist())
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = vertices.ravel().astype(np.float32)
        parameters["faces"] = faces.ravel().astype(np.uint32)
        parameters.update()
        mesh.write_ply(str(out / "truth.ply"))
        matte = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
        scene = mi.load_dict({
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4, "hide_emitters": True},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": SKY}},
            "object": {"type": "ply", "filename": str(out / "truth.ply"), "face_normals": True,
                       "bsdf": {"type": "twosided", "side": matte}},
        })
        frames = []
        for k in range(args.views):
            height, angle = 1 - 2 * (k + 0.5) / args.views, k * np.pi * (3 - 5**0.5) + 0.1 * rng.normal()
            across = (1 - height**2) ** 0.5
            along = np.array([across * np.cos(angle), height, across * np.sin(angle)])
            pose = pose_from(along * (3.6 + 0.3 * rng.random()))
            sensor = mi.load_dict({
                "type": "perspective", "fov": ANGLE, "fov_axis": "x",
                "to_world": mi.ScalarTransform4f(pose @ np.diag([-1, 1, -1, 1])),
                "film": {"type": "hdrfilm", "width": args.size, "height": args.size, "pixel_format": "rgba",
                         "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": SAMPLES, "seed": int(rng.integers(1 << 30))},
            })
            image = np.array(mi.render(scene, sensor=sensor))
            opacity = np.clip(image[..., 3:], 0, 1)
            light = np.clip(image[..., :3] / np.maximum(opacity, 1e-6), 0, 1)
            srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
            pixels = (255 * np.concatenate([srgb, opacity], -1) + 0.5).astype(np.uint8)
            file = f"images/{k:03}.png"
            Image.fromarray(pixels).save(out / file)
            frames.append({"file_path": file, "transform_matrix": pose.tolist()})
        cameras = {"camera_angle_x": np.radians(ANGLE), "frames": frames}
        (out / "transforms.json").write_text(json.dumps(cameras, indent=1))
        print(name, flush=True)


def noise(args):
    """Turns each camera about the object's middle by a normal angle, and moves it by 0.5 % of its distance."""
    for name in args.names or OBJECTS:
        rng = np.random.default_rng([args.seed, sorted(OBJECTS).index(name)])
        out = args.runs / name
        shutil.copytree(args.folder / name, out, dirs_exist_ok=True)
        cameras = json.loads((out / "transforms.json").read_text())
        for frame in cameras["frames"]:
            pose = np.array(frame["transform_matrix"])
            turn = rotation(rng.normal(size=3), np.radians(args.degrees) * rng.normal())
            pose[:3, :3] = turn @ pose[:3, :3]
            pose[:3, 3] = turn @ pose[:3, 3] * (1 + 0.005 * rng.normal())
            frame["transform_matrix"] = pose.tolist()
        (out / "transforms.json").write_text(json.dumps(cameras, indent=1))


def fit(args):
    for name in args.names or OBJECTS:
        photographs, scene = args.runs / f"{name}-photographs", args.runs / name
        shutil.copytree(args.folder / name / "images", photographs / "images", dirs_exist_ok=True)
        shutil.copy(args.folder / name / "transforms.json", photographs)
        start = time.time()
        rough = ["--rough-cameras"] if args.rough_cameras else []
        subprocess.run([args.bokashi, "new", scene, "--images", photographs, *rough], check=True)
        to = ["--out", scene / "out", "--json", scene / "scores.json"]
        subprocess.run([args.bokashi, "fit", scene / "scene.toml", *to], check=True)
        (scene / "seconds").write_text(str(time.time() - start))


def score(args):
    import trimesh
    from scipy.spatial import cKDTree

    print("| object | s | PSNR | IoU | Chamfer | Hausdorff | Euler | faces |\n|---|---|---|---|---|---|---|---|")
    for name in args.names or OBJECTS:
        out = args.runs / name / "out"
        truth = trimesh.load(args.folder / name / "truth.ply", process=True)
        found = trimesh.load(out / "object.ply", process=False, force="mesh")
        # Where a texture has a seam, a file has a vertex for each side.
        found.merge_vertices(merge_tex=True, merge_norm=True)
        half = 0.5 * np.linalg.norm(truth.extents)

        def drawn(mesh, count, seed):
            return trimesh.sample.sample_surface(mesh, count, seed=seed)[0]

        # Few points against many: two million lie so near each other that the nearest is the surface.
        far = [
            cKDTree(drawn(to, 2_000_000, 1)).query(drawn(of, 20_000, 0))[0] / half
            for of, to in ((truth, found), (found, truth))
        ]
        views = json.loads((args.runs / name / "scores.json").read_text())["views"]
        held_out = [view for view in views if view["held_out"]]
        psnr, iou = (np.mean([view[key] for view in held_out]) for key in ("psnr", "silhouette_iou"))
        seconds = float((args.runs / name / "seconds").read_text())
        chamfer, hausdorff = 0.5 * sum(x.mean() for x in far), max(x.max() for x in far)
        euler = f"{found.euler_number} ({truth.euler_number})"
        print(f"| {name} | {seconds:.0f} | {psnr:.1f} | {iou:.4f} | {chamfer:.4f} | {hausdorff:.3f} | {euler} | {len(found.faces)} |")


def seen(args):
    """Distances of the truth's vertices from what was found, by how many photographs that are learnt from see them."""
    import trimesh
    from scipy import ndimage
    from scipy.spatial import cKDTree

    print("| object | views | share of vertices | mean distance | part of the mean |\n|---|---|---|---|---|")
    for name in args.names or OBJECTS:
        truth = trimesh.load(args.folder / name / "truth.ply", process=False)
        found = trimesh.load(args.runs / name / "out" / "object.ply", process=False, force="mesh")
        places, normals = truth.vertices, truth.vertex_normals
        cameras = json.loads((args.folder / name / "transforms.json").read_text())
        # Depths on twice the pixels, each as near as the nearest vertex around.
        size = 2 * args.size
        focal = 0.5 * size / np.tan(0.5 * cameras["camera_angle_x"])
        count = np.zeros(len(places), int)
        for k, frame in enumerate(cameras["frames"]):
            if k % 8 == 0:
                continue
            pose = np.array(frame["transform_matrix"])
            towards = pose[:3, 3] - places
            x, y, depth = (-towards @ pose[:3, :3] * [1, -1, -1]).T
            column, row = ((focal * q / depth + 0.5 * size).astype(int).clip(0, size - 1) for q in (x, y))
            nearest = np.full((size, size), np.inf)
            np.minimum.at(nearest, (row, column), depth)
            nearest = ndimage.minimum_filter(nearest, 5)[row, column]
            cosine = (towards * normals).sum(1) / np.linalg.norm(towards, axis=1)
            # Depths change by some 0.01 over two of these pixels, times the tangent.
            count += (cosine > 0.1) & (depth < nearest + 0.01 / np.maximum(cosine, 0.1))
        half = 0.5 * np.linalg.norm(truth.extents)
        far = cKDTree(trimesh.sample.sample_surface(found, 2_000_000, seed=1)[0]).query(places)[0] / half
        for low, high in ((0, 1), (2, 2), (3, 4), (5, len(cameras["frames"]))):
            own = (count >= low) & (count <= high)
            mean = far[own].mean() if own.any() else 0
            print(f"| {name} | {low} to {high} | {own.mean():.3f} | {mean:.4f} | {(far * own).mean():.4f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for command in (make, noise, fit, score, seen):
        own = commands.add_parser(command.__name__)
        own.add_argument("folder", type=Path)
        if command is not make:
            own.add_argument("runs", type=Path)
        own.add_argument("names", nargs="*")
        own.add_argument("--seed", type=int, default=1)
        own.add_argument("--views", type=int, default=24)
        own.add_argument("--size", type=int, default=320)
        own.add_argument("--degrees", type=float, default=1.0)
        own.add_argument("--bokashi", default="bokashi")
        own.add_argument("--rough-cameras", action="store_true")
        own.set_defaults(command=command)
    args = parser.parse_args()
    args.command(args)


if __name__ == "__main__":
    main()
