"""Operations on arrays of jax: gradients against difference quotients, values against numpy's, and where they run."""

import functools

import numpy as np
import pytest

jax = pytest.importorskip("jax")

import jax.numpy as jnp
from jax.test_util import check_grads

import bokashi
import bokashi.jax as bj
from cases import ball, cases, layered
from conftest import scene

SIZE = 12, 16


@pytest.fixture(autouse=True)
def doubles():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def check(function, *arrays):
    """Gradients of all inputs against difference quotients, outside of jit and inside."""
    arrays = tuple(map(jnp.asarray, arrays))
    for f in (function, jax.jit(function)):
        check_grads(f, arrays, order=1, modes=["rev"], atol=1e-5, rtol=1e-5, eps=1e-6)
    assert not bj._kept.known


def check_outside(function, *arrays):
    """The same where shapes are not known before."""
    check_grads(function, tuple(map(jnp.asarray, arrays)), order=1, modes=["rev"], atol=1e-5, rtol=1e-5, eps=1e-6)
    assert not bj._kept.known


@pytest.mark.parametrize("silhouettes", ["exact", "antialias"])
def test_a_whole_step_has_true_gradients(generator, silhouettes):
    mesh, clip = scene(generator)
    colors, sky = generator.uniform(size=(7, 3)), generator.uniform(size=3)
    reference = generator.uniform(size=(*SIZE, 3))
    camera = np.diag([1.1, 0.9, 0.5, 1.0]) + generator.uniform(-0.05, 0.05, (4, 4))

    def image(clip, colors, sky):
        return bj.render(clip, mesh, colors, SIZE, background=sky, silhouettes=silhouettes)

    def loss(positions, camera, colors):
        return bj.render(positions, mesh, colors, SIZE, camera=camera, silhouettes=silhouettes, reference=reference)

    check(image, clip, colors, sky)
    check(loss, clip[:, :3], camera, colors)


@pytest.mark.parametrize("exact", [False, True])
def test_operations_on_fragments_have_true_gradients(generator, exact):
    mesh, clip = scene(generator)
    colors, sky = generator.uniform(size=(7, 3)), generator.uniform(size=3)
    reference = generator.uniform(size=(*SIZE, 3))

    def drawn(clip, colors):
        return bj.rasterize(clip, mesh, SIZE, exact=exact, creases=[colors] if exact else [])

    def image(clip, colors, sky):
        fragments = drawn(clip, colors)
        return bj.picture(bj.interpolate(colors, fragments), fragments, sky)

    def loss(clip, colors, sky):
        fragments = drawn(clip, colors)
        return bj.picture(bj.interpolate(colors, fragments), fragments, sky, reference=reference)

    check_outside(image, clip, colors, sky)
    check_outside(loss, clip, colors, sky)
    if not exact:
        check_outside(lambda clip: bj.depth(drawn(clip, colors)), clip)
        check_outside(lambda clip: bj.eye_depth(drawn(clip, colors)), clip)
        check_outside(lambda clip: bj.differentials(drawn(clip, colors)), clip)
        dense = generator.uniform(size=(*SIZE, 2))
        check_outside(lambda image, clip: bj.antialias_image(image, drawn(clip, colors)), dense, clip)

        def moved(clip, colors):
            fragments = drawn(clip, colors)
            return bj.interpolate_differentials(colors, fragments, bj.differentials(fragments))

        check_outside(moved, clip, colors)

    # Given fragments have known shapes: so jit may have them, closed over or as an argument.
    fragments = drawn(jnp.asarray(clip), colors)
    of_values = functools.partial(bj.picture, fragments=fragments, background=jnp.asarray(sky), reference=reference)
    check(lambda values: of_values(values=values), generator.uniform(size=(len(fragments), 3)))
    check(lambda colors: bj.interpolate(colors, fragments), colors)
    check(lambda uv: bj.depth(fragments.replace(barycentrics=uv)), fragments.barycentrics)
    check(lambda uv: bj.eye_depth(fragments.replace(barycentrics=uv)), fragments.barycentrics)
    check(lambda uv: bj.differentials(fragments.replace(barycentrics=uv)), fragments.barycentrics)
    seen = jax.jit(lambda colors, fragments: bj.interpolate(colors, fragments))(colors, fragments)
    np.testing.assert_array_equal(seen, bj.interpolate(colors, fragments))


@pytest.mark.parametrize("name", list(cases(np.random.default_rng(0))))
def test_operations_that_are_described_once_have_true_gradients(name, generator):
    function, arrays, *_ = cases(generator)[name]

    def flat(*arrays):
        value = function(bj, *arrays)
        return (value.harmonics, *value.levels[1:]) if name == "prefiltered" else value

    check(flat, *arrays)


def test_surfaces_behind_a_surface_have_true_gradients(generator):
    mesh, clip = layered(generator)
    check_outside(lambda clip: [layer.barycentrics for layer in bj.depth_layers(clip, mesh, (7, 6))], clip)
    check_outside(lambda clip: bj.rasterize_behind(bj.rasterize(clip, mesh, (7, 6))).barycentrics, clip)
    fragments = bj.rasterize(jnp.asarray(clip), mesh, (7, 6))
    for f in (
        lambda clip: bj.depth_layers(clip, mesh, 8)[0].barycentrics,
        lambda clip: bj.rasterize_behind(bokashi.Fragments(clip[:1, :2], None, clip, fragments.coverage)).barycentrics,
    ):
        with pytest.raises(bokashi.RenderError, match="number of results is not known before: it needs to be outside of jit"):
            jax.jit(f)(jnp.asarray(clip))


def test_the_surface_of_a_field_has_true_gradients(generator):
    grid, field, offsets = ball(generator)
    check_outside(lambda field: bj.field_surface(field, grid)[0], field)
    check_outside(lambda field, offsets: bj.field_surface(field, grid, offsets)[0], field, offsets)
    with pytest.raises(bokashi.RenderError, match="needs to be outside of jit"):
        jax.jit(lambda field: bj.field_surface(field, grid)[0])(jnp.asarray(field))
    positions, mesh = bj.field_surface(jnp.asarray(field), grid)
    assert bokashi.surface_area(positions, mesh) > 0


def test_every_other_operation_has_true_gradients(generator):
    mesh, clip = scene(generator)
    positions = clip[:, :3]
    camera = np.diag([1.2, 0.9, 0.5, 1.0]) + generator.uniform(-0.1, 0.1, (4, 4))
    image = generator.uniform(0.2, 0.8, (9, 7, 2))
    directions = generator.normal(size=(5, 3))
    check(bj.project, positions, camera, generator.normal(size=4), generator.normal(size=3))
    check(bj.project, positions, camera)
    check(bj.gaussian_blur, image, np.array(1.3))
    check(lambda image: bj.downsample(image, 2), image[:8, :6])
    check(lambda positions: bj.face_normals(positions, mesh), positions)
    check(lambda positions: bj.vertex_normals(positions, mesh), positions)
    check(bj.srgb_encode, image)
    check(bj.srgb_decode, image)
    check(bj.exposure, image, np.array(0.3))
    check(bj.over, generator.uniform(size=(5, 4)), generator.uniform(size=(5, 4)))
    check(bj.reflect, directions, generator.normal(size=(5, 3)))


def test_cameras_lenses_and_light_have_true_gradients(generator):
    mesh, clip = scene(generator)

    def uniform(low, high, *shape):
        return generator.uniform(low, high, shape)

    points, rows = uniform(-0.3, 0.3, 7, 3) + [0, 0, 2], np.eye(4)[:3] + uniform(-0.2, 0.2, 3, 4)
    normals, values = generator.normal(size=(7, 3)), generator.normal(size=(7, 3))
    signed = np.concatenate([generator.normal(size=(7, 3)), np.ones((7, 1))], 1)
    camera = np.eye(4) + uniform(-0.1, 0.1, 4, 4)
    intrinsics = np.array([30.0, 32.0, 15.5, 16.5])

    def affine(rows):
        return jnp.concatenate([rows, jnp.array([[0.0, 0, 0, 1]])])

    def instances(points, rows, camera):
        return bj.project_instances(points, jnp.stack([affine(rows), jnp.eye(4)]), camera)

    check(lambda x: bj.se3(x, affine(rows)), uniform(-0.5, 0.5, 6))
    check(lambda x: bj.pinhole(x, (32, 31), 0.1, 9.0), intrinsics)
    check(lambda x: bj.orthographic(x, 32, 0.1, 9.0), intrinsics)
    check(lambda rows: bj.affine_inverse(affine(rows)), rows)
    check(bj.rigid, generator.normal(size=4), generator.normal(size=3))
    check(bj.distort, points, uniform(-0.05, 0.05, 5))
    check(bj.fisheye, points, uniform(-0.02, 0.02, 4))
    check(lambda points, rows: bj.transform_points(points, affine(rows)), points, rows)
    check(lambda normals, rows: bj.transform_normals(normals, affine(rows)), normals, rows)
    check(instances, points, rows, camera)
    # The sign of a tangent has no gradient.
    check(lambda n, t, x: bj.perturbed_normals(n, jnp.concatenate([t, signed[:, 3:]], 1), x), normals, signed[:, :3], values)
    check(lambda p, n, x: bj.tangents(p, n, x, mesh), points, normals, generator.normal(size=(7, 2)))
    check(
        lambda i, d, a, f: bj.depth_of_field(i, d, a, f),
        uniform(0, 1, 9, 8, 2), uniform(1, 3, 9, 8), np.array(1.5), np.array(2.0),
    )
    normals, views = normals + [0, 0, 3], [0.1, -0.2, 3.0]
    for model, material in [
        ("lambert", [uniform(0.2, 0.8, 7, 3)]),
        ("phong", [uniform(0.2, 0.8, 7, 3), uniform(0.1, 0.4, 3), np.array(7.0)]),
        ("metallic-roughness", [uniform(0.2, 0.8, 3), uniform(0.3, 0.8, 7), np.array(0.4)]),
    ]:

        def shaded(normals, places, sun, lamp, sky, *material):
            lights = [("directional", [0.5, 1, 4], sun), ("point", [0.5, 1, 4.0], lamp), ("ambient", sky)]
            return bj.shade(normals, views, material, lights, positions=places, model=model)

        check(shaded, normals, points, uniform(0.5, 1, 3), uniform(1, 2, 3), uniform(0.1, 0.3, 3), *material)


def test_textures_have_true_gradients(generator):
    texels, cube = generator.uniform(size=(8, 8, 3)), generator.uniform(size=(6, 4, 4, 2))
    coordinates, directions = generator.uniform(0.1, 0.9, (5, 2)), generator.normal(size=(5, 3))
    footprints, bias = generator.uniform(0.1, 0.3, (5, 2, 2)), generator.uniform(-0.1, 0.1, 5)
    level = np.full(5, 0.4)
    check(bj.sample_texture, texels, coordinates)
    check(lambda t, x, d, b: bj.sample_texture(t, x, differentials=d, bias=b), texels, coordinates, footprints, bias)
    check(lambda t, x, d: bj.sample_texture(t, x, differentials=d, filter="anisotropic"), texels, coordinates, footprints)
    check(lambda t, x, level: bj.sample_cube_map(t, x, level=level), cube, directions, level)
    check(
        lambda t, x, level, *mips: bj.sample_texture(t, x, level=level, mips=mips, border=("clamp", "mirror")),
        texels, coordinates, level, generator.uniform(size=(4, 4, 3)),
    )
    check(bj.mipmaps, texels)
    check(bj.mipmaps, cube)
    check(lambda t: bj.mipmaps(t, 1), generator.uniform(size=(7, 5, 2)))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_values_and_gradients_are_the_bits_of_numpy(generator, dtype):
    mesh, clip = scene(generator, dtype)
    colors, reference = generator.uniform(size=(7, 3)).astype(dtype), generator.uniform(size=(*SIZE, 3)).astype(dtype)
    loss, pull_back = bokashi.render(clip, mesh, colors, SIZE, reference=reference)
    expected = [loss, *pull_back(np.ones((), dtype), wanted=(True, False, True, False, False))]

    def step(clip, colors):
        return bj.render(clip, mesh, colors, SIZE, reference=reference)

    with_gradient = jax.value_and_grad(step, (0, 1))
    for f in (with_gradient, jax.jit(with_gradient)):
        value, (clip_bar, colors_bar) = f(jnp.asarray(clip), jnp.asarray(colors))
        for found, known in zip((value, clip_bar, colors_bar), (expected[0], expected[1], expected[3])):
            assert found.dtype == dtype and np.asarray(found).tobytes() == known.tobytes()

    fragments, of_clip = bokashi.rasterize(clip, mesh, SIZE, exact=True)
    surface, _ = bokashi.interpolate(colors, fragments)
    image, _ = bokashi.picture(surface, fragments)
    own = bj.rasterize(clip, mesh, SIZE, exact=True)
    assert np.asarray(bj.picture(bj.interpolate(colors, own), own)).tobytes() == image.tobytes()
    (clip_bar,) = of_clip(np.ones_like(fragments.barycentrics), None)
    found = jax.grad(lambda clip: bj.rasterize(clip, mesh, SIZE, exact=True).barycentrics.sum())(jnp.asarray(clip))
    assert np.asarray(found).tobytes() == clip_bar.tobytes()


class Counted:
    """A native function that counts its calls."""

    def __init__(self, function):
        self.function, self.calls, self.wanted = function, 0, []

    def __call__(self, *arguments):
        self.calls += 1
        outputs, pull_back = self.function(*arguments)

        def pull(*upstream, wanted):
            self.wanted.append(tuple(wanted))
            return pull_back(*upstream, wanted=wanted)

        return outputs, pull


def test_the_forward_pass_runs_once_and_only_wanted_gradients_are_computed(generator, monkeypatch):
    mesh, clip = scene(generator)
    colors = jnp.asarray(generator.uniform(size=(7, 3)))
    counted = Counted(bokashi._native.render)
    monkeypatch.setattr(bokashi._native, "render", counted)
    gradient = jax.grad(lambda colors: (bj.render(clip, mesh, colors, SIZE) ** 2).sum())
    compiled = jax.jit(gradient)
    for calls, f in enumerate((gradient, compiled, compiled), 1):
        jax.block_until_ready(f(colors))
        assert counted.calls == calls
    assert counted.wanted == [(False, False, True, False, False)] * 3
    jacobian = jax.jacrev(lambda colors: bj.render(clip, mesh, colors, 4))(colors)
    assert counted.calls == 4 and len(counted.wanted) == 3 + jacobian[..., 0, 0].size
    assert not bj._kept.known


@pytest.mark.parametrize("inside", [False, True])
def test_backward_passes_may_come_late_or_twice_or_never(generator, monkeypatch, inside):
    mesh, clip = scene(generator)
    colors = jnp.asarray(generator.uniform(size=(7, 3)))
    monkeypatch.setattr(bj._kept, "MOST", 3)

    def image(clip):
        return bj.render(clip, mesh, colors, SIZE)

    function = jax.jit(image) if inside else image
    moved = [jnp.asarray(clip * [1 + 0.01 * k, 1, 1, 1]) for k in range(6)]
    pulls = [jax.vjp(function, clip)[1] for clip in moved]
    bar = jnp.asarray(generator.normal(size=(*SIZE, 3)))
    jax.block_until_ready([pull(bar) for pull in pulls[3:4]])
    assert len(bj._kept.known) <= 3
    for clip, pull in zip(moved, pulls):
        _, pull_back = bokashi.render(np.asarray(clip), mesh, np.asarray(colors), SIZE)
        expected = pull_back(np.asarray(bar))[0]
        for _ in range(2):
            np.testing.assert_array_equal(pull(bar)[0], expected)
    del pull, pulls
    assert not bj._kept.known

    monkeypatch.setattr(bj._kept, "MOST_BYTES", 1)
    pulls = [jax.vjp(function, clip)[1] for clip in moved]
    jax.block_until_ready(pulls[0](bar))
    assert len(bj._kept.known) == 1
    jax.block_until_ready(pulls[-1](bar))
    del pulls
    assert not bj._kept.known


def test_batches_are_their_images(generator):
    mesh, clip = scene(generator)
    colors = jnp.asarray(generator.uniform(size=(7, 3)))
    clips = jnp.stack([jnp.asarray(clip * [1 + 0.05 * k, 1, 1, 1]) for k in range(4)])

    def loss(clip, colors):
        return (bj.render(clip, mesh, colors, SIZE) ** 2).sum()

    step = jax.value_and_grad(loss, (0, 1))
    alone = [step(clip, colors) for clip in clips]
    for f in (jax.vmap(step, (0, None)), jax.jit(jax.vmap(step, (0, None)))):
        values, (clips_bar, colors_bar) = f(clips, colors)
        for k, (value, (clip_bar, own_bar)) in enumerate(alone):
            np.testing.assert_allclose(values[k], value, rtol=1e-12)
            np.testing.assert_allclose(clips_bar[k], clip_bar, rtol=1e-12)
            np.testing.assert_allclose(colors_bar[k], own_bar, rtol=1e-12)
    of_all = jax.grad(lambda clips: jax.vmap(loss, (0, None))(clips, colors).sum())(clips)
    np.testing.assert_allclose(of_all, clips_bar, rtol=1e-12)
    assert not bj._kept.known


def test_a_large_image_does_not_wait_for_itself(generator):
    mesh, clip = scene(generator, np.float32)
    colors = jnp.asarray(generator.uniform(size=(7, 3)), jnp.float32)
    step = jax.jit(jax.value_and_grad(lambda clip: (bj.render(clip, mesh, colors, 800) ** 2).sum()))
    for _ in range(3):
        _, clip_bar = step(jnp.asarray(clip))
    assert bool(jnp.isfinite(clip_bar).all())


def test_what_is_refused_says_why(generator):
    mesh, clip = scene(generator)
    colors = jnp.asarray(generator.uniform(size=(7, 3)))
    clip = jnp.asarray(clip)

    def loss(clip):
        return bj.render(clip, mesh, colors, SIZE).sum()

    with pytest.raises(bokashi.RenderError, match="outside of jit and vmap, got a tracer"):
        jax.jit(lambda clip: bj.rasterize(clip, mesh, SIZE).barycentrics)(clip)
    with pytest.raises(bokashi.RenderError, match="clip positions of shape"):
        bj.rasterize(clip[:, :3], mesh, SIZE)
    # Where the shape of a result cannot be told, the operation says why, inside of jit too.
    for f in (lambda f: f, jax.jit):
        with pytest.raises(bokashi.RenderError, match="texels|a texture"):
            f(lambda x: bj.mipmaps(x))(colors[0])
        with pytest.raises(bokashi.RenderError, match="shape"):
            f(lambda x: bj.downsample(x, 2))(colors)
        with pytest.raises(bokashi.RenderError, match="factor"):
            f(lambda x: bj.downsample(x, 0))(colors[:, :, None])
        with pytest.raises(bokashi.RenderError, match="shape"):
            f(lambda x: bj.render(clip, mesh, x, SIZE))(colors[0])
        assert f(bj.exposure)(jnp.ones(()), jnp.zeros(3)).shape == (3,)
    with pytest.raises(TypeError, match="float32 or float64, got int"):
        bj.srgb_encode(jnp.arange(3))
    with pytest.raises(Exception, match="clip positions of shape"):
        jax.block_until_ready(jax.jit(loss)(clip[:, :3]))
    for twice in (lambda: jax.hessian(loss)(clip), lambda: jax.jvp(loss, (clip,), (clip,))):
        with pytest.raises((TypeError, ValueError), match="custom_vjp|callbacks do not support JVP"):
            twice()
    with pytest.raises(ValueError, match="do not support JVP"):
        jax.grad(lambda clip: jax.grad(loss)(clip).sum())(clip)
    # In the direction of the upstream gradient, too.
    _, pull = jax.vjp(loss, clip)
    with pytest.raises(ValueError, match="do not support JVP"):
        jax.grad(lambda bar: pull(bar)[0].sum())(jnp.ones(()))
    bj._kept.known.clear()


def test_a_texture_that_stays_takes_the_place_of_texels(generator):
    texels = generator.uniform(size=(8, 12, 2)).astype(np.float32)
    uv = jnp.asarray(generator.uniform(size=(20, 2)).astype(np.float32))
    still = bj.Texture(texels)

    def loss(given):
        return jax.jit(jax.value_and_grad(lambda uv: (bj.sample_texture(given, uv, level=0.4) ** 2).sum()))

    (expected, slopes), (found, own) = loss(jnp.asarray(texels))(uv), loss(still)(uv)
    assert expected == found and (slopes == own).all()
    assert bj.sample_texture(texels, uv, mips=[], level=0.4).dtype == jnp.float32
