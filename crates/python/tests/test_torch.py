"""The operations on torch tensors: gradients, and what torch expects of them."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import bokashi
import bokashi.torch as bt
from cases import ball, cases, layered
from conftest import scene


def tensor(array):
    return torch.from_numpy(np.array(array)).requires_grad_()


def check(function, *tensors):
    assert torch.autograd.gradcheck(
        function, tensors, eps=1e-6, atol=1e-5, rtol=1e-4, nondet_tol=0.0, check_forward_ad=True
    )


def test_every_function_passes_gradcheck(generator):
    mesh, clip = scene(generator)
    mesh_of_torch = bt.Mesh(torch.from_numpy(mesh.faces.astype(np.int64)), 7)
    np.testing.assert_array_equal(mesh_of_torch.faces, mesh.faces)
    clip, colors, sky = tensor(clip), tensor(generator.uniform(size=(7, 3))), tensor(generator.uniform(size=3))
    positions = clip.detach()[:, :3].clone().requires_grad_()
    reference = torch.from_numpy(generator.uniform(size=(8, 9, 3)))
    camera = tensor(np.diag([1.2, 0.9, 0.5, 1.0]) + generator.uniform(-0.1, 0.1, (4, 4)))

    def uniform(low, high, *shape):
        return tensor(generator.uniform(low, high, shape))

    def apart(exact):
        def image(clip, colors, sky):
            fragments = bt.rasterize(clip, mesh, (8, 9), exact=exact, creases=[colors] if exact else [])
            return bt.picture(bt.interpolate(colors, fragments), fragments, sky)

        return image

    check(apart(False), clip, colors, sky)
    check(apart(True), clip, colors, sky)
    check(lambda *x: bt.picture(bt.interpolate(x[1], f := bt.rasterize(x[0], mesh, (8, 9))), f, x[2], reference=reference), clip, colors, sky)
    check(lambda p, k, c, s: bt.render(p, mesh, c, (8, 9), camera=k, background=s), positions, camera, colors, sky)
    check(lambda p, c: bt.render(p, mesh, c, (8, 9), reference=reference), clip, colors)
    check(lambda p, k, r, t: bt.project(p, k, r, t), positions, camera, uniform(-1, 1, 4), uniform(-1, 1, 3))
    check(lambda c: bt.depth(bt.rasterize(c, mesh, 8)), clip)
    check(lambda c: bt.eye_depth(bt.rasterize(c, mesh, 8)), clip)
    check(lambda c, a: bt.interpolate_differentials(a, f := bt.rasterize(c, mesh, 6), bt.differentials(f)), clip, colors)
    check(lambda i, c: bt.antialias_image(i, bt.rasterize(c, mesh, (8, 9))), uniform(0, 1, 8, 9, 2), clip)
    texels, cube = uniform(0, 1, 8, 8, 2), uniform(0, 1, 6, 4, 4, 2)
    check(lambda t, x, d: bt.sample_texture(t, x, differentials=d), texels, uniform(0.1, 0.9, 4, 2), uniform(0.1, 0.2, 4, 2, 2))
    check(lambda t, x, *m: bt.sample_texture(t, x, level=0.4, mips=m), texels, uniform(0.1, 0.9, 4, 2), uniform(0, 1, 4, 4, 2))
    check(lambda t, x: bt.sample_cube_map(t, x, level=0.3), cube, uniform(-1, 1, 4, 3))
    check(lambda t: bt.mipmaps(t), texels)
    image = uniform(0.2, 0.8, 8, 8, 2)
    check(bt.gaussian_blur, image, tensor(1.3))
    check(lambda i: bt.downsample(i, 2), image)
    check(lambda p: (bt.face_normals(p, mesh), bt.vertex_normals(p, mesh)), positions)
    check(bt.srgb_encode, image)
    check(bt.srgb_decode, image)
    check(bt.exposure, image, tensor(0.3))
    check(bt.over, uniform(0, 1, 5, 4), uniform(0, 1, 5, 4))
    check(bt.reflect, uniform(-1, 1, 5, 3), uniform(-1, 1, 5, 3))
    points, rows = tensor(generator.uniform(-0.3, 0.3, (5, 3)) + [0, 0, 2]), tensor(np.eye(4)[:3] + generator.uniform(-0.2, 0.2, (3, 4)))
    affine = lambda rows: torch.cat([rows, torch.tensor([[0.0, 0, 0, 1]], dtype=torch.float64)])
    check(lambda x: bt.se3(x, affine(rows.detach())), uniform(-0.5, 0.5, 6))
    check(lambda rows: bt.affine_inverse(affine(rows)), rows)
    check(lambda x: (bt.pinhole(x, 32, 0.1, 9.0), bt.orthographic(x, 32, 0.1, 9.0)), tensor([30.0, 32.0, 15.5, 16.5]))
    check(bt.rigid, uniform(-1, 1, 4), uniform(-1, 1, 3))
    check(bt.distort, points, uniform(-0.05, 0.05, 5))
    check(bt.fisheye, points, uniform(-0.02, 0.02, 4))
    check(lambda p, rows: bt.transform_points(p, affine(rows)), points, rows)
    check(lambda p, rows: bt.transform_normals(p, affine(rows)), points, rows)
    check(lambda p, rows, k: bt.project_instances(p, affine(rows)[None], k), points, rows, camera)
    check(lambda p, n, x: bt.tangents(p, n, x, mesh), positions, uniform(-1, 1, 7, 3), uniform(-1, 1, 7, 2))
    check(bt.depth_of_field, image, uniform(1, 3, 8, 8), tensor(1.5), tensor(2.0))
    normals, color = tensor(generator.normal(size=(5, 3)) + [0, 0, 3]), uniform(0.2, 0.8, 5, 3)
    check(
        lambda n, c, s, e, d, i, r: bt.shade(n, [0.1, 0.2, 3.0], [c, s, e], [("directional", d, i), ("ambient", r)], model="phong"),
        normals, color, uniform(0.1, 0.4, 3), tensor(7.0), uniform(0.5, 1, 3), uniform(0.5, 1, 3), uniform(0.1, 0.3, 3),
    )


@pytest.mark.parametrize("name", list(cases(np.random.default_rng(0))))
def test_operations_that_are_described_once_pass_gradcheck(name, generator):
    function, arrays, *_ = cases(generator)[name]

    def flat(*tensors):
        value = function(bt, *tensors)
        return (value.harmonics, *value.levels[1:]) if name == "prefiltered" else value

    check(flat, *map(tensor, arrays))


def test_surfaces_behind_a_surface_pass_gradcheck(generator):
    mesh, clip = layered(generator)
    clip = tensor(clip)
    check(lambda clip: [layer.barycentrics for layer in bt.depth_layers(clip, mesh, (7, 6))], clip)
    check(lambda clip: bt.rasterize_behind(bt.rasterize(clip, mesh, (7, 6))).barycentrics, clip)
    assert bt.depth_layers(clip * torch.tensor([1, 1, 1, -1]), mesh, 8) == []


def test_the_surface_of_a_field_passes_gradcheck(generator):
    grid, field, offsets = ball(generator)
    check(lambda field: bt.field_surface(field, grid)[0], tensor(field))
    check(lambda field, offsets: bt.field_surface(field, grid, offsets)[0], tensor(field), tensor(offsets))
    positions, mesh = bt.field_surface(torch.from_numpy(field).float(), grid)
    assert positions.dtype == torch.float32 and positions.shape == (mesh.vertex_count, 3)


def test_what_has_no_gradient_takes_tensors_that_are_detached(generator):
    grid, field, _ = ball(generator)
    positions, mesh = bt.field_surface(tensor(field).float(), grid)
    fine = bokashi.subdivide(positions.detach(), mesh, "loop")
    product = bt.sparse_product(positions, fine.weights)
    np.testing.assert_allclose(product.detach(), fine.positions, rtol=1e-6, atol=1e-6)
    product.sum().backward()
    with pytest.raises(RuntimeError, match="requires grad"):
        bokashi.surface_area(positions, mesh)


def test_indices_and_masks_are_tensors_too(generator):
    x = tensor(generator.normal(size=(4, 3)))
    assert torch.equal(bt.gather_rows(x, torch.tensor([2, 0])), x[[2, 0]])
    assert torch.equal(bt.mean_error(x, torch.zeros_like(x), mask=x > 0), x[x > 0].square().mean())
    with pytest.raises(bokashi.RenderError, match="runs on a CPU"):
        bt.norm(x.detach().to("meta"))
    with pytest.raises(TypeError, match="needs tensors, got list"):
        bt.norm([1.0, 2.0])


def test_tangents_of_gradients_are_refused_and_not_lost(generator):
    from torch.autograd import forward_ad

    mesh, clip = scene(generator)
    clip, colors = tensor(clip), tensor(generator.uniform(size=(7, 3)))
    with forward_ad.dual_level():
        moving = forward_ad.make_dual(clip, torch.ones_like(clip))
        image = bt.render(moving, mesh, colors, 8)
        assert forward_ad.unpack_dual(image).tangent.shape == (8, 8, 3)
        with pytest.raises(bokashi.RenderError, match="gradients have no tangents in torch"):
            torch.autograd.grad(image.sum(), colors)
        still = bt.render(clip, mesh, colors, 8)
        factor = forward_ad.make_dual(torch.ones_like(still), torch.ones_like(still))
        with pytest.raises(bokashi.RenderError, match="gradients have no tangents in torch"):
            torch.autograd.grad((still * factor).sum(), colors)


def test_tangents_of_single_precision_are_single(generator):
    from torch.autograd import forward_ad

    mesh, clip = scene(generator, np.float32)
    clip, move = torch.from_numpy(clip), torch.from_numpy(generator.normal(size=(7, 4)).astype(np.float32))
    with forward_ad.dual_level():

        def moved(dtype):
            fragments = bt.rasterize(forward_ad.make_dual(clip.to(dtype), move.to(dtype)), mesh, 16, exact=True)
            return [forward_ad.unpack_dual(x).tangent for x in (fragments.barycentrics, fragments.weight)]

        for single, double in zip(moved(torch.float32), moved(torch.float64)):
            assert single.dtype == torch.float32 and double.dtype == torch.float64 and double.abs().max() > 0.1
            torch.testing.assert_close(single.double(), double, rtol=1e-3, atol=1e-4 * double.abs().max().item())


def test_a_module_learns_with_an_optimizer_of_torch(generator):
    mesh, clip = scene(generator, np.float32)
    colors = torch.from_numpy(generator.uniform(size=(7, 3)).astype(np.float32))
    renderer = bt.Renderer(mesh, 24)
    reference = renderer(torch.from_numpy(clip), colors)
    learnt = torch.nn.Parameter(torch.full((7, 3), 0.5))
    optimizer = torch.optim.Adam([learnt], lr=0.05)
    losses = []
    for _ in range(150):
        optimizer.zero_grad()
        loss = renderer(torch.from_numpy(clip), learnt, reference=reference)
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 1e-3 * losses[0] and "Mesh(3 faces, 7 vertices)" in repr(renderer)


def test_second_derivatives_are_refused_and_other_devices_too(generator):
    mesh, clip = scene(generator)
    clip = tensor(clip)
    image = bt.render(clip, mesh, clip, 8)
    (bar,) = torch.autograd.grad(image.square().sum(), clip, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        bar.sum().backward()
    with pytest.raises(bokashi.RenderError, match="runs on a CPU"):
        bt.render(clip.detach().to("meta"), mesh, clip, 8)


def test_what_gets_no_gradient_is_not_asked_for_one(generator):
    mesh, clip = scene(generator)
    clip, target, pose = tensor(clip), tensor(np.zeros((8, 8, 3))), tensor(np.eye(4))
    colors = torch.ones(7, 3, dtype=torch.float64)
    fragments = bt.rasterize(clip, mesh, 8)
    for wrong in (
        lambda: bt.render(clip, mesh, colors, 8, reference=target),
        lambda: bt.picture(bt.interpolate(colors, fragments), fragments, reference=target),
        lambda: bt.se3(tensor(np.zeros(6)), pose),
        lambda: bt.composite_layers([(fragments, colors.new_ones(len(fragments), 3), colors.new_ones(len(fragments)))], reference=target),
    ):
        with pytest.raises(bokashi.RenderError, match="has no gradient here and needs to be detached"):
            wrong()
    with torch.no_grad():
        assert bt.render(clip, mesh, colors, 8, reference=target) > 0


def test_what_gets_no_tangent_is_not_asked_for_one(generator):
    from torch.autograd import forward_ad

    mesh, clip = scene(generator)
    clip, colors = torch.from_numpy(clip), torch.ones(7, 3, dtype=torch.float64)
    fragments = bt.rasterize(clip, mesh, 8)
    layer = fragments, colors.new_ones(len(fragments), 3), colors.new_ones(len(fragments))
    with torch.no_grad(), forward_ad.dual_level():
        target, pose = (forward_ad.make_dual(x, torch.ones_like(x)) for x in (colors.new_zeros(8, 8, 3), torch.eye(4).double()))
        for function, still in [
            (lambda x: bt.render(clip, mesh, colors, 8, reference=x), target),
            (lambda x: bt.picture(bt.interpolate(colors, fragments), fragments, reference=x), target),
            (lambda x: bt.se3(colors.new_zeros(6), x), pose),
            (lambda x: bt.composite_layers([layer], reference=x), target),
        ]:
            with pytest.raises(bokashi.RenderError, match="has no tangent here and needs to be detached"):
                function(still)
            assert forward_ad.unpack_dual(function(still.detach())).tangent is None


def test_materials_and_lights_are_counted(generator):
    normals = tensor(generator.normal(size=(5, 3)))
    ambient = [("ambient", [1.0, 1, 1])]
    for material, lights, message in [
        (torch.ones(5, 3), ambient, "a list of at most 3 arrays, got Tensor"),
        ([0.1, 0.2, 0.3, 0.4], ambient, "a list of at most 3 arrays, got 4 arrays"),
        ([[0.5] * 3], [("ambient", 1.0, 2.0, 3.0)], "one or two arrays, got 3 for 'ambient'"),
        ([[0.5] * 3], [("ambient",)], "one or two arrays, got 0 for 'ambient'"),
    ]:
        with pytest.raises(bokashi.RenderError, match=message):
            bt.shade(normals, [0.0, 0, 1], material, lights, model="lambert")


def test_a_module_can_be_copied_and_saved(generator, tmp_path):
    import copy

    mesh, clip = scene(generator)
    clip, colors = torch.from_numpy(clip), torch.ones(7, 3, dtype=torch.float64)
    renderer = bt.Renderer(mesh, 8)
    torch.save(renderer, tmp_path / "renderer.pt")
    for other in (copy.deepcopy(renderer), torch.load(tmp_path / "renderer.pt", weights_only=False)):
        assert torch.equal(other(clip, colors), renderer(clip, colors))


def test_only_what_is_wanted_is_computed_and_gradients_may_be_missing(generator):
    mesh, clip = scene(generator)
    clip, colors = torch.from_numpy(clip), tensor(generator.uniform(size=(7, 3)))
    bt.render(clip, mesh, colors, 8).sum().backward()
    assert clip.grad is None and colors.grad.abs().sum() > 0
    levels = bt.mipmaps(tensor(generator.uniform(size=(4, 4, 1))))
    levels[1].sum().backward()
    with torch.no_grad():
        assert not bt.render(clip, mesh, colors, 8).requires_grad


def test_a_compiled_function_calls_it_as_it_is(generator):
    mesh, clip = scene(generator, np.float32)
    clip, colors = torch.from_numpy(clip), torch.rand(7, 3)

    def loss(clip, colors):
        return (bt.render(clip * 1.0, mesh, colors.sigmoid(), 16, silhouettes="antialias") ** 2).sum()

    compiled = torch.compile(loss, backend="eager")
    (value, bar), (expected, expected_bar) = (
        (y := f(clip, x := colors.clone().requires_grad_()), torch.autograd.grad(y, x)[0]) for f in (compiled, loss)
    )
    assert torch.equal(value, expected) and torch.equal(bar, expected_bar) and bar.abs().sum() > 0


def test_fragments_in_a_compiled_function_are_what_they_are(generator):
    mesh, clip = scene(generator, np.float32)
    clip, colors = torch.from_numpy(clip), torch.rand(7, 3)

    def image(clip, colors):
        fragments = bt.rasterize(clip, mesh, 16, exact=True, creases=[colors])
        return bt.picture(bt.interpolate(colors, fragments) ** 2, fragments, [0.1, 0.2, 0.3])

    compiled = torch.compile(image, backend="eager")
    assert torch.equal(compiled(clip, colors), image(clip, colors))


def test_tensors_that_are_not_contiguous_are_read_as_they_are(generator):
    mesh, clip = scene(generator)
    clip = torch.from_numpy(clip)
    colors = torch.from_numpy(generator.uniform(size=(3, 7))).T
    assert torch.equal(bt.render(clip, mesh, colors, 8), bt.render(clip, mesh, colors.contiguous(), 8))


def test_a_texture_that_stays_takes_the_place_of_texels(generator):
    texels = torch.from_numpy(generator.uniform(size=(8, 12, 2)))
    cube = torch.from_numpy(generator.uniform(size=(6, 4, 4, 1)))
    uv = torch.from_numpy(generator.uniform(size=(20, 2))).requires_grad_()
    towards = torch.from_numpy(generator.normal(size=(20, 3))).requires_grad_()
    for function, own, places in ((bt.sample_texture, texels, uv), (bt.sample_cube_map, cube, towards)):
        still = bt.Texture(own.numpy())
        for options in ({}, {"level": 0.4}):
            expected, found = (function(given, places, **options) for given in (own, still))
            assert torch.equal(found, expected)
            one, other = (torch.autograd.grad(out.square().sum(), places)[0] for out in (expected, found))
            assert torch.equal(one, other)
    with pytest.raises(bt.RenderError, match="levels of its own"):
        bt.sample_texture(still, uv, level=0.4, mips=[texels])
    with pytest.raises(bt.RenderError, match="needs a level or differentials"):
        bt.sample_texture(texels, uv, mips=bt.mipmaps(texels))
