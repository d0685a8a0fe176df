"""Values and pull-backs of the operations on numpy arrays."""

import copy
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import bokashi
from conftest import check_gradients, scene


def test_a_whole_step_has_true_gradients(generator):
    mesh, clip = scene(generator)
    colors, sky = generator.uniform(size=(7, 3)), generator.uniform(size=3)
    reference = generator.uniform(size=(12, 16, 3))

    def image(clip, colors, sky):
        value, pull_back = bokashi.render(clip, mesh, colors, (12, 16), background=sky)
        return value, lambda bar: [pull_back(bar)[k] for k in (0, 2, 3)]

    def loss(clip, colors, sky):
        value, pull_back = bokashi.render(clip, mesh, colors, (12, 16), background=sky, reference=reference)
        return value, lambda bar: [pull_back(bar)[k] for k in (0, 2, 3)]

    check_gradients(image, [clip, colors, sky], generator)
    check_gradients(loss, [clip, colors, sky], generator)
    seen, _ = bokashi.render(clip, mesh, colors, (12, 16), background=sky)
    assert bokashi.render(clip, mesh, colors, (12, 16), background=sky, reference=reference)[0] == pytest.approx(
        ((seen - reference) ** 2).sum()
    )


def test_operations_on_fragments_meet_at_their_pull_backs(generator):
    mesh, clip = scene(generator)
    colors = generator.uniform(size=(7, 3))
    for exact in (False, True):

        def image(clip, colors):
            fragments, of_clip = bokashi.rasterize(clip, mesh, (12, 16), exact=exact, creases=[colors] if exact else [])
            surface, of_surface = bokashi.interpolate(colors, fragments)
            value, of_picture = bokashi.picture(surface, fragments)

            def pull_back(bar):
                surface_bar, _, uv_bar, clip_bar, weight_bar = of_picture(bar)[:5]
                colors_bar, more, *_ = of_surface(surface_bar)
                uv_bar = more if uv_bar is None else uv_bar + more
                upstream = (uv_bar, weight_bar) if exact else (uv_bar,)
                through = of_clip(*upstream)[0]
                return [through if clip_bar is None else through + clip_bar, colors_bar]

            return value, pull_back

        check_gradients(image, [clip, colors], generator)
        whole, _ = bokashi.render(
            clip, mesh, colors, (12, 16), silhouettes="exact" if exact else "antialias"
        )
        np.testing.assert_allclose(image(clip, colors)[0], whole, atol=1e-12)


def test_every_other_operation_has_true_gradients(generator):
    mesh, clip = scene(generator)
    positions = clip[:, :3]
    camera = np.diag([1.2, 0.9, 0.5, 1.0]) + generator.uniform(-0.1, 0.1, (4, 4))
    rotation, translation = generator.normal(size=4), generator.normal(size=3)
    fragments, _ = bokashi.rasterize(clip, mesh, 8)
    uv = fragments.barycentrics
    texels = generator.uniform(size=(8, 8, 3))
    coordinates, directions = generator.uniform(0.1, 0.9, (5, 2)), generator.normal(size=(5, 3))
    footprints = generator.uniform(0.1, 0.3, (5, 2, 2))
    cube = generator.uniform(size=(6, 4, 4, 2))
    image = generator.uniform(0.2, 0.8, (9, 7, 2))

    def on(function, *pick):
        """A function of some of the arrays of fragments."""
        return lambda uv, *more: function(fragments.replace(barycentrics=uv), *more)

    check_gradients(bokashi.project, [positions, camera, rotation, translation], generator)
    check_gradients(on(bokashi.depth), [uv], generator)
    check_gradients(on(bokashi.differentials), [uv], generator)
    slopes, _ = bokashi.differentials(fragments)
    check_gradients(
        lambda values, slopes: bokashi.interpolate_differentials(values, fragments, slopes), [positions, slopes], generator
    )
    check_gradients(lambda x, t: swapped(bokashi.sample_texture(t, x), 0, 4), [coordinates, texels], generator)
    check_gradients(
        lambda x, d, t: swapped(bokashi.sample_texture(t, x, differentials=d), 0, 2, 4),
        [coordinates, footprints, texels],
        generator,
    )
    check_gradients(
        lambda x, level, t: swapped(bokashi.sample_cube_map(t, x, level=level), 0, 1, 4),
        [directions, np.full(5, 0.4), cube],
        generator,
    )
    check_gradients(lambda image, sigma: bokashi.gaussian_blur(image, sigma), [image, np.array(1.3)], generator)
    check_gradients(lambda image: bokashi.downsample(image, 2), [image[:8, :6].copy()], generator)
    check_gradients(lambda p: bokashi.face_normals(p, mesh), [positions], generator)
    check_gradients(lambda p: bokashi.vertex_normals(p, mesh), [positions], generator)
    check_gradients(bokashi.srgb_encode, [image], generator)
    check_gradients(bokashi.srgb_decode, [image], generator)
    check_gradients(bokashi.exposure, [image, np.array(0.3)], generator)
    check_gradients(bokashi.reflect, [directions, generator.normal(size=(5, 3))], generator)
    check_gradients(bokashi.over, [generator.uniform(size=(5, 4)), generator.uniform(size=(5, 4))], generator)
    check_gradients(lambda image, clip: swapped(
        bokashi.antialias_image(image, bokashi.rasterize(clip, mesh, (9, 7))[0]), 0, 2), [image, clip], generator)


def test_cameras_lenses_and_light_have_true_gradients(generator):
    mesh, clip = scene(generator)

    def normal(*shape):
        return generator.normal(size=shape)

    def uniform(low, high, *shape):
        return generator.uniform(low, high, shape)

    points, matrix = uniform(-0.3, 0.3, 7, 3) + [0, 0, 2], np.eye(4) + np.vstack([uniform(-0.2, 0.2, 3, 4), np.zeros(4)])
    rows = matrix[:3]

    def affine(function, *places):
        """A function of the upper rows of its matrices."""

        def of_rows(*arrays):
            whole = [np.vstack([a, [0, 0, 0, 1]]) if k in places else a for k, a in enumerate(arrays)]
            value, pull_back = function(*whole)
            return value, lambda bar: [g[:3] if k in places else g for k, g in enumerate(pull_back(bar))]

        return of_rows

    intrinsics, camera = np.array([30.0, 32.0, 15.5, 16.5]), np.eye(4) + uniform(-0.1, 0.1, 4, 4)
    fragments, _ = bokashi.rasterize(clip, mesh, 8)
    normals, colors = normal(5, 3) + [0, 0, 3], uniform(0.2, 0.8, 5, 3)
    for function, *arrays in [
        (lambda increment: bokashi.se3(increment, matrix), uniform(-0.5, 0.5, 6)),
        (lambda x: bokashi.pinhole(x, (32, 31), 0.1, 9.0), intrinsics),
        (lambda x: bokashi.orthographic(x, 32, 0.1, 9.0), intrinsics),
        (affine(bokashi.affine_inverse, 0), rows),
        (bokashi.rigid, normal(4), normal(3)),
        (bokashi.distort, points, uniform(-0.05, 0.05, 5)),
        (bokashi.fisheye, points, uniform(-0.02, 0.02, 4)),
        (affine(bokashi.transform_points, 1), points, rows),
        (affine(bokashi.transform_normals, 1), normals, rows),
        (lambda p, k: swapped(bokashi.project_instances(p, np.stack([matrix, np.eye(4)]), k), 0, 2), points, camera),
        (bokashi.perturbed_normals, normals, np.concatenate([normal(5, 3), np.ones((5, 1))], 1)[:, :4], colors),
        (lambda uv: bokashi.eye_depth(fragments.replace(barycentrics=uv)), fragments.barycentrics),
        (lambda p, n, uv: bokashi.tangents(p, n, uv, mesh), normal(7, 3), normal(7, 3), normal(7, 2)),
        (lambda i, d, a, f: bokashi.depth_of_field(i, d, a, f), uniform(0, 1, 9, 8, 2), uniform(1, 3, 9, 8), np.array(1.5), np.array(2.0)),
    ]:
        check_gradients(function, arrays, generator)
    assert bokashi.se3(np.zeros(6), matrix)[1](np.eye(4), wanted=(True, False))[1] is None
    lights = [
        ("directional", normal(3) + [0, 0, 3], uniform(0.5, 1, 3)), ("point", np.array([0.5, 1, 4.0]), uniform(1, 2, 3)),
        ("ambient", uniform(0.1, 0.3, 3)),
    ]
    views = np.array([0.1, -0.2, 3.0])
    for model, material in [
        ("lambert", [colors]), ("phong", [colors, uniform(0.1, 0.4, 3), np.array(7.0)]),
        ("blinn-phong", [colors, uniform(0.1, 0.4, 5, 3), uniform(5, 9, 5)]),
        ("metallic-roughness", [colors, uniform(0.3, 0.8, 5), np.array(0.4)]),
    ]:

        def shaded(normals, views, places, *arrays):
            given = iter(arrays)
            own = [next(given) for _ in material]
            of_lights = [(kind, *[next(given) for _ in values]) for kind, *values in lights]
            value, pull_back = bokashi.shade(normals, views, own, of_lights, positions=places, model=model)
            pulled = lambda bar: [g for k, g in enumerate(pull_back(bar)) if k < 3 + len(material) or k >= 6]
            return value, pulled

        arrays = [normals, views, normal(5, 3), *material, *[values for _, *of in lights for values in of]]
        check_gradients(shaded, arrays, generator)
    with pytest.raises(ValueError, match="a light of kind ambient needs one array"):
        bokashi.shade(normals, views, [colors], [("ambient", views, views)], model="lambert")
    with pytest.raises(ValueError, match="material phong needs 3 arrays, got 1"):
        bokashi.shade(normals, views, [colors], [], model="phong")


def swapped(recorded, *places):
    """A step whose pull-back returns some gradients alone."""
    value, pull_back = recorded
    return value, lambda bar: [pull_back(bar)[k] for k in places]


def test_mipmaps_lead_back_to_the_texels(generator):
    texels = generator.uniform(size=(8, 4, 2))
    levels, pull_back = bokashi.mipmaps(texels)
    assert [level.shape for level in levels] == [(4, 2, 2), (2, 1, 2), (1, 1, 2)]
    np.testing.assert_allclose(levels[-1][0, 0], texels.mean((0, 1)))
    (bar,) = pull_back(None, None, np.ones((1, 1, 2)))
    np.testing.assert_allclose(bar, 1 / 32)
    assert len(bokashi.mipmaps(texels, 1)[0]) == 1


def test_arrays_that_are_not_in_the_order_of_c_are_read_as_they_are(generator):
    mesh, clip = scene(generator)
    for other in (np.asfortranarray(clip), np.repeat(clip, 2, 0)[::2], clip[::-1][::-1]):
        fragments, _ = bokashi.rasterize(other, mesh, 16)
        assert len(fragments) == len(bokashi.rasterize(clip, mesh, 16)[0])
        np.testing.assert_array_equal(fragments.barycentrics, bokashi.rasterize(clip, mesh, 16)[0].barycentrics)
    faces = np.asfortranarray(mesh.faces.astype(np.int64))
    np.testing.assert_array_equal(bokashi.Mesh(faces, 7).faces, mesh.faces)


def test_coverage_comes_back_from_its_ids_and_rows_from_images(generator):
    mesh, clip = scene(generator)
    fragments, _ = bokashi.rasterize(clip, mesh, (12, 16))
    coverage = fragments.coverage
    ids = coverage.triangle_ids()
    again = bokashi.Coverage.from_ids(mesh, ids, clip)
    np.testing.assert_array_equal(again.faces, fragments.faces)
    np.testing.assert_array_equal(again.pixels, fragments.pixels)
    rows = generator.uniform(size=(len(fragments), 2))
    image = coverage.scatter(rows)
    np.testing.assert_array_equal(image.reshape(-1, 2)[fragments.pixels], rows)
    np.testing.assert_array_equal(coverage.gather(image), rows)
    assert not image.reshape(-1, 2)[ids.ravel() == 0].any()
    for own, columns in ((2, 4), (4, 2), (3, 5), (5, 3), (3, 3)):
        rows = generator.uniform(size=(len(fragments), own))
        if columns >= own:
            image = coverage.scatter(np.pad(rows, ((0, 0), (0, columns - own))))
            np.testing.assert_array_equal(coverage.scatter(rows, columns), image)
        else:
            np.testing.assert_array_equal(coverage.gather(coverage.scatter(rows), columns), rows[:, :columns])
            with pytest.raises(ValueError, match=f"scatter has no {columns} columns of rows of {own} entries"):
                coverage.scatter(rows, columns)
    with pytest.raises(ValueError, match="gather has no 0 columns of rows of 5 entries"):
        coverage.gather(generator.uniform(size=(12, 16, 5)), 0)
    # Pieces of exact coverage are on no image of centres.
    exact, _ = bokashi.rasterize(clip, mesh, (12, 16), exact=True)
    assert len(exact) > exact.coverage.centers > 0
    rows = generator.uniform(size=(len(exact), 2))
    image = exact.coverage.scatter(rows)
    np.testing.assert_array_equal(exact.coverage.scatter(rows, 4)[..., :2], image)
    np.testing.assert_array_equal(exact.coverage.gather(np.dstack([image, image]), 2), exact.coverage.gather(image))
    picture = generator.uniform(size=(12, 16, 3))
    own, _ = bokashi.antialias_image(picture, fragments)
    np.testing.assert_array_equal(bokashi.antialias_image(picture, fragments.replace(coverage=again))[0], own)


def test_bits_do_not_depend_on_threads_and_single_precision_stays_single(generator):
    mesh, clip = scene(generator, np.float32)
    colors = generator.uniform(size=(7, 3)).astype(np.float32)
    results = []
    for threads in (1, 2, 4, None):
        bokashi.set_num_threads(threads)
        image, pull_back = bokashi.render(clip, mesh, colors, 300)
        results.append([image, *(bar for bar in pull_back(np.ones_like(image)) if bar is not None)])
    for result in results[1:]:
        for one, other in zip(results[0], result):
            assert one.dtype == np.float32 and one.tobytes() == other.tobytes()


def test_a_pull_back_computes_what_is_wanted_as_often_as_asked(generator):
    mesh, clip = scene(generator)
    image, pull_back = bokashi.render(clip, mesh, generator.uniform(size=(7, 3)), 16)
    bar = generator.normal(size=image.shape)
    everything = pull_back(bar)
    colors_alone = pull_back(bar, wanted=(False, False, True, False, False))
    assert [gradient is None for gradient in colors_alone] == [True, True, False, True, True]
    np.testing.assert_array_equal(colors_alone[2], everything[2])
    with pytest.raises(ValueError, match="needs to know of each of 5 inputs whether it is wanted, got 1"):
        pull_back(bar, wanted=(True,))


def test_what_is_refused_says_the_rule_and_then_the_value(generator):
    mesh, clip = scene(generator)
    uv = np.full((3, 2), 0.5)
    for wrong, error, message in [
        (lambda: bokashi.rasterize(clip[:, :3], mesh, 8), bokashi.RenderError, "clip positions of shape \\[7, 4\\], got shape \\[7, 3\\]"),
        (lambda: bokashi.rasterize(clip, mesh, 0), bokashi.RenderError, "an image needs at least one pixel"),
        (lambda: bokashi.rasterize(clip, mesh, 8, cull="left"), ValueError, 'none, back or front, got "left"'),
        (lambda: bokashi.rasterize(clip.astype(int), mesh, 8), TypeError, "float32 or float64, got int64"),
        (lambda: bokashi.rasterize([1.0], mesh, 8), TypeError, "float32 or float64, got list"),
        (lambda: bokashi.render(clip, mesh, clip.astype(np.float32), 8), TypeError, "arrays of one type, got float32 beside float64"),
        (lambda: bokashi.Mesh(np.array([[0, 1, 7]]), 7), bokashi.RenderError, "vertex indices below 7, got 7 in face 0"),
        (lambda: bokashi.Mesh(np.array([[0, 1, -1]]), 7), ValueError, "got -1 in face 0"),
        (lambda: bokashi.Mesh(np.array([[0, 1]]), 7), ValueError, "shape \\[F, 3\\], got \\[1, 2\\]"),
        (lambda: bokashi.sample_texture(np.ones((4, 4, 1)), uv, bias=1.0), bokashi.RenderError, "there are none; take `level`"),
        (lambda: bokashi.sample_texture(np.ones((4, 4, 1)), uv, level=1.0, bias=1.0), bokashi.RenderError, "got both"),
        (lambda: bokashi.rasterize(clip, mesh, 8.0), TypeError, "float"),
    ]:
        with pytest.raises(error, match=message):
            wrong()
    for size in (8, np.int64(8), [8, 8], np.array([8, 8])):
        assert bokashi.render(clip, mesh, clip, size)[0].shape == (8, 8, 4)
    assert issubclass(bokashi.RenderError, ValueError)


def test_a_reference_of_another_shape_is_named(generator):
    mesh, clip = scene(generator)
    colors = generator.uniform(size=(7, 3))
    fragments, _ = bokashi.rasterize(clip, mesh, 8)
    surface, _ = bokashi.interpolate(colors, fragments)
    for shape in [(8, 8, 1), (8, 8), (1, 8, 8, 3), (3,), (8, 7, 3), (7, 8, 3)]:
        rule = f"a reference of shape \\[8, 8, 3\\], got shape \\[{', '.join(map(str, shape))}\\]"
        with pytest.raises(bokashi.RenderError, match=f"render needs {rule}"):
            bokashi.render(clip, mesh, colors, 8, reference=np.ones(shape))
        with pytest.raises(bokashi.RenderError, match=f"picture needs {rule}"):
            bokashi.picture(surface, fragments, reference=np.ones(shape))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_gradient_of_a_number_may_be_a_number(generator, dtype):
    mesh, clip = scene(generator, dtype)
    colors = generator.uniform(size=(7, 3)).astype(dtype)
    image, of_image = bokashi.render(clip, mesh, colors, 8)
    _, pull_back = bokashi.render(clip, mesh, colors, 8, reference=np.zeros_like(image))
    expected = pull_back(np.full((), 0.5, dtype))[0]
    for half in (0.5, np.float32(0.5), np.float64(0.5)):
        assert pull_back(half)[0].tobytes() == expected.tobytes()
    assert pull_back(1)[0].dtype == dtype
    with pytest.raises(bokashi.RenderError, match="shape"):
        of_image(1.0)
    for wrong in ("1.0", [1.0], {}):
        with pytest.raises(TypeError, match="numpy arrays of float32 or float64, got"):
            pull_back(wrong)


def copies(value):
    return copy.copy(value), copy.deepcopy(value), pickle.loads(pickle.dumps(value))


def test_meshes_coverage_and_fragments_can_be_copied_and_pickled(generator):
    mesh, clip = scene(generator)
    for other in copies(mesh):
        np.testing.assert_array_equal(other.faces, mesh.faces)
        assert other.vertex_count == 7
    # The second has several bands of pixels.
    for cull, size in [("none", (12, 16)), ("none", (300, 200)), ("back", (12, 16)), ("front", (12, 16))]:
        picture = generator.uniform(size=(*size, 3))
        fragments, _ = bokashi.rasterize(clip, mesh, size, cull=cull)
        expected, _ = bokashi.antialias_image(picture, fragments)
        for other in copies(fragments):
            assert len(other) == len(fragments) and other.weight is None
            np.testing.assert_array_equal(other.pixels, fragments.pixels)
            np.testing.assert_array_equal(other.barycentrics, fragments.barycentrics)
            # Silhouettes, too.
            np.testing.assert_array_equal(bokashi.antialias_image(picture, other)[0], expected)
            again = fragments.replace(coverage=other.coverage)
            np.testing.assert_array_equal(bokashi.antialias_image(picture, again)[0], expected)
    exact, _ = bokashi.rasterize(clip, mesh, (12, 16), exact=True)
    assert copy.deepcopy(exact).coverage is exact.coverage
    with pytest.raises(TypeError, match="exact pieces can't be pickled"):
        pickle.dumps(exact)
    with pytest.raises(AttributeError, match="stay as they are"):
        exact.clip = clip
    ids, known = fragments.coverage.triangle_ids(), fragments.coverage.orientations
    assert bokashi.Coverage.from_ids(mesh, ids).orientations is None
    for wrong, message in [(known[:2], "for each of the 3 faces, got shape"), (known + 2, "-1, 0 or 1, got")]:
        with pytest.raises(bokashi.RenderError, match=message):
            bokashi.Coverage.from_ids(mesh, ids, orientations=wrong)


def test_the_import_waits_for_numpy_and_typing():
    program = (
        "import sys, bokashi; slow = {'numpy', 'dataclasses', 'inspect', 'typing', 'collections', 're', 'enum'};"
        "print(slow & set(sys.modules));"
        "assert 'Scene' in dir(bokashi) and not hasattr(bokashi, 'nothing');"
        "bokashi.Picture; assert 'numpy' in sys.modules; from bokashi import *; fit, Slope"
    )
    found = subprocess.run([sys.executable, "-S", "-c", program], capture_output=True, text=True, env=environment())
    assert found.stdout == "set()\n", found.stderr


def environment():
    """That of this process, with its packages: none of them is loaded at the start."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def test_memory_does_not_grow(generator):
    resource = pytest.importorskip("resource")
    mesh, clip = scene(generator)
    colors = generator.uniform(size=(7, 3))

    def steps(count):
        for _ in range(count):
            image, pull_back = bokashi.render(clip, mesh, colors, 256)
            pull_back(image)
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    assert steps(40) - steps(10) < 20_000


def test_a_forked_process_works_on(generator):
    os = pytest.importorskip("os")
    if not hasattr(os, "fork"):
        pytest.skip("no fork here")
    mesh, clip = scene(generator)
    colors = generator.uniform(size=(7, 3))
    for threads in (None, 2):
        bokashi.set_num_threads(threads)
        image, _ = bokashi.render(clip, mesh, colors, 300)
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            again, _ = bokashi.render(clip, mesh, colors, 300)
            os.write(writer, b"same" if again.tobytes() == image.tobytes() else b"else")
            os._exit(0)
        os.close(writer)
        # A child that hangs would hang the test: it is given some seconds.
        import select

        ready, _, _ = select.select([reader], [], [], 30)
        if not ready:
            os.kill(child, 9)
        os.waitpid(child, 0)
        assert ready and os.read(reader, 4) == b"same"
    bokashi.set_num_threads(None)
