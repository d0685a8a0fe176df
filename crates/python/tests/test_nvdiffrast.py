"""The stand-in for nvdiffrast: recorded outputs, its documentation's formulas, and gradients."""

import gc
import json
import warnings
import weakref
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import bokashi
import bokashi.nvdiffrast as dr

CONTEXT = dr.RasterizeCudaContext()


def recorded():
    data = (Path(__file__).parent / "nvdiffrast_recorded" / "recorded.safetensors").read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    types = {"F32": np.float32, "I32": np.int32}
    arrays = {}
    for name, entry in header.items():
        if name != "__metadata__":
            start, end = (8 + length + at for at in entry["data_offsets"])
            arrays[name] = np.frombuffer(data[start:end], types[entry["dtype"]]).reshape(entry["shape"]).copy()
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def assert_close(found, expected, tolerance=1e-6):
    found, expected = found.detach().double(), expected.double()
    assert found.shape == expected.shape
    assert float((found - expected).abs().max()) <= tolerance * max(1.0, float(expected.abs().max()))


def leaf(array):
    return array.clone().requires_grad_()


def recorded_scene():
    pos = torch.tensor([[[-0.7, 0.8, 0, 1], [0.8, 0.7, 0.1, 1], [0.7, -0.8, 0.2, 1], [-0.8, -0.7, 0, 1]]])
    tri = torch.tensor([[0, 1, 2], [0, 2, 3]], dtype=torch.int32)
    attr = torch.tensor([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]])
    y, x = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
    tex = torch.stack([x / 7, y / 7, (x + y) / 14], -1)[None]
    coordinates = torch.tensor([[[0.1, 0.1], [0.85, 0.2], [0.9, 0.85], [0.2, 0.9]]])
    return leaf(pos), tri, leaf(attr), leaf(tex), coordinates


def test_recorded_outputs_and_gradients_are_met():
    known = recorded()
    pos, tri, attr, tex, coordinates = recorded_scene()
    rast, rast_db = dr.rasterize(CONTEXT, pos, tri, resolution=[16, 16])
    assert torch.equal(rast[..., 3], known["rast"][..., 3])
    assert_close(rast, known["rast"])
    assert_close(rast_db, known["rast_db"])
    ((rast * known["co_rast"]).sum() + (rast_db * known["co_rast_db"]).sum()).backward()
    assert_close(pos.grad, known["d_pos_from_rast"])

    rast, rast_db = leaf(known["rast"]), leaf(known["rast_db"])
    out, out_da = dr.interpolate(attr, rast, tri, rast_db=rast_db, diff_attrs="all")
    assert_close(out, known["interp_out"])
    assert_close(out_da, known["interp_out_da"])
    ((out * known["co_interp_out"]).sum() + (out_da * known["co_interp_out_da"]).sum()).backward()
    assert_close(attr.grad, known["d_attr_from_interp"])
    assert_close(rast.grad, known["d_rast_from_interp"])
    assert_close(rast_db.grad, known["d_rast_db_from_interp"])

    own_uv, own_da = dr.interpolate(coordinates, known["rast"], tri, rast_db=known["rast_db"], diff_attrs="all")
    assert_close(own_uv, known["uv"])
    assert_close(own_da, known["uv_da"])
    uv, uv_da = leaf(known["uv"]), leaf(known["uv_da"])
    out = dr.texture(tex, uv, filter_mode="linear", boundary_mode="clamp")
    assert_close(out, known["tex_bilinear"])
    out.backward(known["co_tex"])
    assert_close(tex.grad, known["d_tex_from_bilinear"])
    assert_close(uv.grad, known["d_uv_from_bilinear"])
    for mip in (None, dr.texture_construct_mip(tex)):
        tex.grad, uv.grad, uv_da.grad = None, None, None
        out = dr.texture(tex, uv, uv_da, mip=mip, filter_mode="linear-mipmap-linear", boundary_mode="clamp")
        assert_close(out, known["tex_trilinear"])
        out.backward(known["co_tex"])
        assert_close(tex.grad, known["d_tex_from_trilinear"])
        assert_close(uv.grad, known["d_uv_from_trilinear"])
        assert_close(uv_da.grad, known["d_uvDA_from_trilinear"])

    pos.grad, color = None, torch.full((1, 16, 16, 3), 0.7, requires_grad=True)
    out = dr.antialias(color, known["rast"], pos, tri)
    assert_close(out, known["antialias_out"])
    out.backward(known["co_antialias"])
    assert_close(color.grad, known["d_color_from_antialias"])
    assert_close(pos.grad, known["d_pos_from_antialias"])


def faces_in_perspective(generator, images, vertices=6, faces=5):
    """Random positions [N, V, 4] and faces, in doubles."""
    ndc = generator.uniform(-1, 1, (images, vertices, 3))
    w = generator.uniform(0.6, 1.6, (images, vertices, 1))
    pos = torch.from_numpy(np.concatenate([ndc * w, w], 2))
    tri = np.stack([generator.permutation(vertices)[:3] for _ in range(faces)]).astype(np.int32)
    return leaf(pos), torch.from_numpy(tri)


def check(function, *inputs):
    assert torch.autograd.gradcheck(function, inputs, eps=1e-7, atol=1e-5, rtol=1e-4, nondet_tol=0.0)


@pytest.mark.parametrize("seed", range(6))
def test_gradients_are_true(seed):
    generator = np.random.default_rng(seed)
    images = 1 + seed % 3
    pos, tri = faces_in_perspective(generator, images)
    size = [6, 7]

    def drawn(pos):
        rast, rast_db = dr.rasterize(CONTEXT, pos, tri, size)
        return rast[..., :2], rast_db

    check(drawn, pos)
    rast, rast_db = [array.detach() for array in dr.rasterize(CONTEXT, pos, tri, size)]
    attr = leaf(torch.from_numpy(generator.normal(size=(1 if seed % 2 else images, 6, 3))))

    def at_pixels(attr, rast, rast_db):
        return dr.interpolate(attr, rast, tri, rast_db, diff_attrs=[0, 2])

    # The ids are no place to take differences at.
    def with_ids(attr, uv, rast_db):
        return at_pixels(attr, torch.cat([uv, rast[..., 2:]], -1), rast_db)

    check(with_ids, attr, leaf(rast[..., :2].clone()), leaf(rast_db))
    color = leaf(torch.from_numpy(generator.normal(size=(images, *size, 2))))
    check(lambda color, pos: dr.antialias(color, rast, pos, tri), color, pos)


@pytest.mark.parametrize("boundary", ["wrap", "clamp", "zero", "cube"])
@pytest.mark.parametrize("mode", ["linear", "linear-mipmap-nearest", "linear-mipmap-linear"])
def test_gradients_of_textures_are_true(boundary, mode):
    generator = np.random.default_rng(len(boundary) + len(mode))

    def numbers(low, high, *shape):
        return leaf(torch.from_numpy(generator.uniform(low, high, shape)))

    is_cube = boundary == "cube"
    tex = numbers(0, 1, 2, 6, 4, 4, 2) if is_cube else numbers(0, 1, 1, 8, 8, 2)
    uv = numbers(-1, 1, 2, 2, 3, 3) if is_cube else numbers(-0.3, 1.3, 2, 2, 3, 2)
    uv_da = numbers(0.05, 0.3, 2, 2, 3, 6 if is_cube else 4)
    bias = numbers(-0.2, 0.2, 2, 2, 3)
    if mode == "linear":
        return check(lambda t, x: dr.texture(t, x, filter_mode=mode, boundary_mode=boundary), tex, uv)

    def sampled(t, x, d, b):
        return dr.texture(t, x, d, mip_level_bias=b, filter_mode=mode, boundary_mode=boundary, max_mip_level=2)

    check(sampled, tex, uv, uv_da, bias)
    levels = [numbers(0, 1, *[n // 2 if k in ((2, 3) if is_cube else (1, 2)) else n for k, n in enumerate(tex.shape)])]
    check(
        lambda t, x, b, *m: dr.texture(t, x, mip_level_bias=b, mip=list(m), filter_mode=mode, boundary_mode=boundary),
        tex, uv, numbers(0.1, 0.9, 2, 2, 3), *levels,
    )


def test_ranges_peels_and_lost_objects():
    generator = np.random.default_rng(5)
    pos, tri = faces_in_perspective(generator, 1, vertices=9, faces=8)
    ranges = torch.tensor([[0, 3], [3, 5], [2, 4]], dtype=torch.int32)
    attr = leaf(torch.from_numpy(generator.normal(size=(9, 3))))

    def image(pos, attr, lose=False):
        rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [8, 8], ranges=ranges)
        if lose:
            rast = rast.clone()
        out, _ = dr.interpolate(attr, rast, tri, rast_db, diff_attrs="all")
        return dr.antialias(out, rast, pos, tri)

    whole = image(pos[0], attr)
    assert whole.shape == (3, 8, 8, 3)
    for k, (start, count) in enumerate(ranges.tolist()):
        part = tri[start : start + count].contiguous()
        rast, _ = dr.rasterize(CONTEXT, pos, part, [8, 8])
        of_part, _ = dr.interpolate(attr, rast, part)
        # Silhouettes are those of the whole mesh.
        own = rast.clone()
        own[..., 3] += start * (own[..., 3] > 0)
        assert torch.equal(dr.antialias(of_part, own, pos, tri)[0], whole[k])
        ids, _ = dr.rasterize(CONTEXT, pos[0], tri, [8, 8], ranges=ranges)
        assert torch.equal(ids[k, ..., 3], rast[0, ..., 3] + start * (rast[0, ..., 3] > 0))
    check(lambda pos, attr: dr.interpolate(attr, dr.rasterize(CONTEXT, pos[0], tri, [6, 6], ranges=ranges)[0], tri)[0], pos, attr)

    seen = []
    with dr.DepthPeeler(CONTEXT, pos, tri, [8, 8]) as peeler:
        for _ in range(3):
            rast, rast_db = peeler.rasterize_next_layer()
            seen.append(rast)
    first, _ = dr.rasterize(CONTEXT, pos, tri, [8, 8])
    assert torch.equal(seen[0], first)
    for near, far in zip(seen, seen[1:]):
        both = (near[..., 3] > 0) & (far[..., 3] > 0)
        assert bool((near[..., 2] <= far[..., 2])[both].all()) and int(both.sum()) > 0
        assert not bool((far[..., 3] > 0)[near[..., 3] == 0].any())

    for lose in (lambda t: t.clone(), lambda t: t.detach(), lambda t: torch.cat([t]), lambda t: t.view(t.shape), lambda t: t[:1]):
        rast, _ = dr.rasterize(CONTEXT, pos, tri, [8, 8])
        out, _ = dr.interpolate(attr[None], lose(rast), tri)
        assert torch.equal(out, dr.interpolate(attr[None], rast, tri)[0])
        assert torch.equal(dr.antialias(out, lose(rast), pos, tri), dr.antialias(out, rast, pos, tri))


def test_images_may_show_nothing():
    generator = np.random.default_rng(4)
    pos, tri = faces_in_perspective(generator, 1)
    attr = torch.from_numpy(generator.normal(size=(1, 6, 3)))
    away = torch.tensor([9.0, 0, 0, 0], dtype=torch.float64)

    def step(pos, tri):
        pos, own = leaf(pos.detach()), leaf(attr)
        rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [8, 8])
        out, out_da = dr.interpolate(own, rast, tri, rast_db, diff_attrs="all")
        image = dr.antialias(out, rast, pos, tri)
        (image.square().sum() + out_da.square().sum()).backward()
        return image, out_da, pos.grad, own.grad

    image, out_da, pos_bar, attr_bar = step(pos, tri)
    both = step(torch.cat([pos + away, pos]), tri)
    assert torch.equal(both[0][1:], image) and torch.equal(both[1][1:], out_da)
    assert not both[0][0].any() and not both[2][0].any()
    assert torch.equal(both[2][1:], pos_bar) and torch.equal(both[3], attr_bar)
    for nothing in (step(pos + away, tri), step(pos, tri[:0])):
        assert nothing[0].shape == (1, 8, 8, 3) and nothing[1].shape == (1, 8, 8, 6)
        assert not any(bool(array.any()) for array in nothing)
    tex, uv = leaf(torch.ones(1, 4, 4, 3)), leaf(torch.ones(2, 0, 5, 2))
    empty = dr.texture(tex, uv)
    empty.sum().backward()
    assert empty.shape == (2, 0, 5, 3) and not tex.grad.any() and uv.grad.shape == uv.shape


def test_a_compiled_function_calls_it_as_it_is():
    generator = np.random.default_rng(6)
    pos, tri = faces_in_perspective(generator, 1)
    tex = torch.from_numpy(generator.uniform(size=(1, 4, 4, 3)))

    def loss(pos):
        rast, rast_db = dr.rasterize(CONTEXT, pos * 1.0, tri, [8, 8])
        uv, uv_da = dr.interpolate(pos[..., :2].sigmoid(), rast, tri, rast_db, diff_attrs="all")
        color = dr.texture(tex, uv, uv_da)
        return (dr.antialias(color, rast, pos * 1.0, tri) ** 2).sum()

    (expected,) = torch.autograd.grad(loss(pos), pos)
    compiled = torch.compile(loss, backend="eager")
    with warnings.catch_warnings(record=True) as told:
        for _ in range(2):
            (found,) = torch.autograd.grad(compiled(pos), pos)
            assert torch.equal(found, expected)
    # torch tells of its own non-leaf tensors, and of nothing of ours.
    assert not [warning for warning in told if "bokashi" in str(warning.message)]


def test_it_works_in_inference_mode():
    generator = np.random.default_rng(1)
    pos, tri = faces_in_perspective(generator, 2)
    attr = torch.from_numpy(generator.normal(size=(2, 6, 3)))

    def images(pos, tri):
        with dr.DepthPeeler(CONTEXT, pos, tri, [8, 8]) as peeler:
            layers = [peeler.rasterize_next_layer()[0] for _ in range(2)]
        return [dr.antialias(dr.interpolate(attr, rast, tri)[0], rast, pos, tri) for rast in layers]

    expected = images(pos, tri)
    with torch.inference_mode():
        assert all(map(torch.equal, images(pos.clone(), tri.clone()), expected))


def test_an_attribute_may_be_chosen_twice():
    generator = np.random.default_rng(2)
    pos, tri = faces_in_perspective(generator, 1)
    attr = leaf(torch.from_numpy(generator.normal(size=(1, 6, 2))))
    rast, rast_db = [array.detach() for array in dr.rasterize(CONTEXT, pos, tri, [6, 7])]
    check(lambda attr: dr.interpolate(attr, rast, tri, rast_db, diff_attrs=[1, 1])[1], attr)
    assert dr.interpolate(attr, rast, tri, rast_db, diff_attrs=[])[1].shape == (1, 6, 7, 0)


def test_silhouettes_are_those_of_the_given_faces():
    pos = torch.tensor([[[-0.8, -0.8, 0, 1], [0.8, -0.8, 0, 1], [0.8, 0.8, 0, 1], [-0.8, 0.8, 0, 1.0]]])
    tri = torch.tensor([[0, 1, 2], [0, 2, 3]], dtype=torch.int32)
    # The same faces that share no edge.
    apart = torch.cat([pos, pos], 1), torch.tensor([[0, 1, 2], [4, 6, 7]], dtype=torch.int32)
    rast, _ = dr.rasterize(CONTEXT, pos, tri, [16, 16])
    color = torch.rand(1, 16, 16, 3, generator=torch.Generator().manual_seed(1))
    whole = dr.antialias(color, rast, pos, tri)
    assert torch.equal(dr.antialias(color, rast, pos, tri.clone()), whole)
    assert not torch.equal(dr.antialias(color, rast, *apart), whole)


def test_levels_are_those_of_the_longer_axis_of_the_footprint():
    generator = np.random.default_rng(3)
    levels = [torch.full((1, 64 >> k, 64 >> k, 1), float(k), dtype=torch.float64) for k in range(7)]
    da = torch.from_numpy(generator.normal(size=(1, 10, 20, 4)) * 0.08)
    uv = torch.from_numpy(generator.uniform(size=(1, 10, 20, 2)))
    found = dr.texture(levels[0], uv, da, mip=levels[1:], filter_mode="linear-mipmap-linear")
    # d/dX and d/dY of texel coordinates; the larger singular value.
    jacobian = 64 * da.reshape(10, 20, 2, 2)
    expected = torch.log2(torch.linalg.svdvals(jacobian)[..., 0]).clamp(0, 6)
    assert_close(found[0, ..., 0], expected, 1e-9)


def test_what_is_refused_says_why():
    pos, tri = faces_in_perspective(np.random.default_rng(1), 1)
    rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [4, 4])
    attr = torch.zeros(1, 6, 3, dtype=torch.float64)
    uv, tex = torch.zeros(3, 4, 4, 2, dtype=torch.float64), torch.zeros(1, 8, 8, 3, dtype=torch.float64)
    cube, to_cube = tex[:, None].expand(-1, 6, -1, -1, -1), torch.ones(1, 4, 4, 3, dtype=torch.float64)
    ranges = torch.tensor([[0, 2], [-1, 1]], dtype=torch.int32)

    def with_id(number):
        other = rast.clone()
        other[0, 2, 2, 3] = number
        return other

    for wrong, message in [
        (lambda: dr.rasterize(CONTEXT, pos[0], tri, [4, 4]), "pos needs shape \\[N, V, 4\\]"),
        (lambda: dr.rasterize(CONTEXT, pos, tri.long(), [4, 4]), "dtype int32"),
        (lambda: dr.interpolate(attr, rast, tri, diff_attrs="all"), "needs rast_db for diff_attrs"),
        (lambda: dr.interpolate(attr, rast, tri[:2].contiguous()), "faces"),
        (lambda: dr.texture(attr[None], attr, filter_mode="cubic"), "filter_mode needs to be"),
        (lambda: dr.texture(attr[None], attr, filter_mode="linear-mipmap-linear"), "needs uv_da or mip_level_bias"),
        (lambda: dr.rasterize(CONTEXT, pos[:0], tri, [4, 4]), "at least one image"),
        (lambda: dr.rasterize(CONTEXT, pos[0], tri, [4, 4], ranges=ranges), "from 0 on, got \\[\\[0, 2\\], \\[-1, 1\\]\\]"),
        (lambda: dr.rasterize(CONTEXT, pos[0], tri, [4, 4], ranges=ranges[0]), "ranges needs shape \\[N, 2\\], got \\[2\\]"),
        (lambda: dr.rasterize(CONTEXT, pos[0], tri, [4, 4], ranges=ranges.float()), "whole numbers, got torch.float32"),
        (lambda: dr.texture(tex, uv[:0]), "at least one image"),
        (lambda: dr.rasterize(CONTEXT, pos.to("meta"), tri, [4, 4]), "runs on a CPU"),
        (lambda: dr.interpolate(attr.expand(2, -1, -1), rast, tri), "attr needs shape \\[1, V, A\\], got \\[2, 6, 3\\]"),
        (lambda: dr.interpolate(attr, rast, tri, rast_db[:, :2], diff_attrs="all"), "rast_db needs shape \\[1, 4, 4, 4\\]"),
        (lambda: dr.interpolate(attr, rast, tri, rast_db, diff_attrs=[3]), "attributes below 3, got \\[3\\]"),
        (lambda: dr.interpolate(attr, rast[..., :3], tri), "rast needs shape \\[N, H, W, 4\\], got \\[1, 4, 4, 3\\]"),
        (lambda: dr.interpolate(attr, with_id(-1), tri), "ids from 0 on, got -1"),
        (lambda: dr.interpolate(attr, with_id(float("nan")), tri), "ids from 0 on, got nan"),
        (lambda: dr.interpolate(attr, with_id(9), tri), "at most the number of faces, 5, got 9"),
        (lambda: dr.antialias(tex, rast, pos, tri), "color needs shape \\[1, 4, 4, C\\], got \\[1, 8, 8, 3\\]"),
        (lambda: dr.antialias(to_cube, rast, pos.expand(2, -1, -1), tri), "pos needs shape \\[1, V, 4\\]"),
        (lambda: dr.texture(tex.expand(2, -1, -1, -1), uv), "tex needs shape \\[1 or 3, H, W, C\\]"),
        (lambda: dr.texture(tex, uv, uv.repeat(1, 1, 1, 2)[:1]), "uv_da needs shape \\[3, 4, 4, 4\\], got \\[1, 4, 4, 4\\]"),
        (lambda: dr.texture(tex, uv, mip_level_bias=uv), "mip_level_bias needs shape \\[3, 4, 4\\]"),
        (lambda: dr.texture(cube, to_cube), "uv needs shape \\[N, H, W, 2\\]"),
        (lambda: dr.texture(tex, to_cube, boundary_mode="cube"), "tex needs shape \\[1, 6, S, S, C\\]"),
        (lambda: dr.texture(tex, uv * float("nan")), "finite coordinates"),
    ]:
        with pytest.raises(ValueError, match=message):
            wrong()
    (twice,) = torch.autograd.grad(dr.interpolate(leaf(attr), rast, tri)[0].sum(), [rast], allow_unused=True)
    assert twice is not None
    out = dr.rasterize(CONTEXT, pos, tri, [4, 4])[0][..., :2]
    (bar,) = torch.autograd.grad(out.square().sum(), pos, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        bar.sum().backward()


def batch(images=3):
    pos, tri, attr, tex, coordinates = recorded_scene()
    return pos.detach().repeat(images, 1, 1), tri, attr.detach(), tex.detach(), coordinates


def test_errors_name_the_image_of_a_batch():
    pos, tri, attr, tex, coordinates = batch()
    broken = pos.clone()
    broken[2, 3, 0] = float("nan")
    rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [8, 8])
    uv, _ = dr.interpolate(coordinates, rast, tri)
    high, negative, lost_uv = rast.clone(), rast.clone(), uv.clone()
    high[1, 4, 4, 3], negative[2, 3, 5, 3], lost_uv[1, 2, 3, 0] = 3, -1, float("inf")
    ranges = torch.tensor([[0, 1], [1, 2]], dtype=torch.int32)
    cube = torch.ones(1, 6, 4, 4, 1)
    for wrong, message in [
        (lambda: dr.rasterize(CONTEXT, broken, tri, [8, 8]), r"image 2: .* finite, got \(nan, -0.69.*, 0.0, 1.0\) at vertex 3"),
        (lambda: dr.rasterize(CONTEXT, broken[2:], tri, [8, 8]), r"^clip positions need to be finite"),
        (lambda: dr.interpolate(attr, high, tri), "image 1: a triangle id needs to be at most the number of faces, 2, got 3"),
        (lambda: dr.interpolate(attr, negative, tri), "image 2: rast needs triangle ids from 0 on, got -1 in row 3, column 5"),
        (lambda: dr.antialias(torch.ones(3, 8, 8, 1), high, pos, tri), "image 1: a triangle id"),
        (lambda: dr.texture(tex, lost_uv), "image 1: sample_texture needs finite coordinates, got inf in row 19"),
        (lambda: dr.texture(leaf(tex), lost_uv), "image 1: sample_texture"),
        (lambda: dr.rasterize(CONTEXT, pos[0], tri, [8, 8], ranges=ranges), "image 1: a part of a mesh needs a range of its 2 faces, got 1..3"),
        (lambda: dr.rasterize(CONTEXT, pos, torch.tensor([[0, 1, -1]], dtype=torch.int32), [8, 8]), "got -1 in face 0"),
        (lambda: dr.texture(cube, torch.full((2, 8, 8, 3), float("nan")), boundary_mode="cube"), "image 0: sample_cube_map"),
    ]:
        with pytest.raises(dr.RenderError, match=message) if "-1 in face" not in message else pytest.raises(ValueError, match=message):
            wrong()


def test_textures_without_a_gradient_keep_their_mipmaps_as_long_as_their_numbers_stay(monkeypatch):
    pos, tri, _, tex, coordinates = batch(2)
    rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [8, 8])
    uv, uv_da = dr.interpolate(coordinates, rast, tri, rast_db=rast_db, diff_attrs="all")
    made = []
    monkeypatch.setattr(dr, "Texture", lambda *args, **kwargs: made.append(kwargs) or bokashi.Texture(*args, **kwargs))

    def sampled(tex, **options):
        return dr.texture(tex, uv, uv_da, **options)

    tex = tex[:, :, :, :].clone()
    for options in ({}, {"max_mip_level": 1}, {"filter_mode": "linear"}, {"filter_mode": "linear-mipmap-nearest"}):
        expected = sampled(leaf(tex), **options).detach()
        for _ in range(3):
            assert torch.equal(sampled(tex, **options), expected)
    # All levels, level 1, and the texels alone: each once, for both images.
    assert [kwargs["coarsest"] for kwargs in made] == [None, 1, 0]
    for change in (lambda: tex.mul_(0.5), lambda: tex.data.mul_(0.5), lambda: tex.numpy().__imul__(0.5)):
        change()
        assert torch.equal(sampled(tex), sampled(leaf(tex)).detach())
    mip = dr.texture_construct_mip(tex)
    assert torch.equal(sampled(tex, mip=mip), sampled(tex))
    for options in ({}, {"mip": mip}):
        of_uv, expected = leaf(uv), leaf(uv)
        dr.texture(tex, of_uv, uv_da, **options).square().sum().backward()
        dr.texture(leaf(tex), expected, uv_da, **options).square().sum().backward()
        assert of_uv.grad.abs().sum() > 0 and torch.equal(of_uv.grad, expected.grad)
    each = torch.cat([tex, 1 - tex])
    assert torch.equal(sampled(each)[1], sampled(1 - tex)[1])
    assert torch.equal(sampled(each), sampled(leaf(each)).detach())
    with pytest.raises(dr.RenderError, match="mip needs a filter_mode with mipmaps"):
        dr.texture(tex, uv, mip=mip)
    with pytest.raises(dr.RenderError, match="mip needs a filter_mode with mipmaps"):
        sampled(tex, mip=mip, filter_mode="linear")


def test_a_texture_belongs_to_the_tensor_that_it_is_a_view_of(monkeypatch):
    pos, tri, _, tex, coordinates = batch(2)
    rast, rast_db = dr.rasterize(CONTEXT, pos, tri, [8, 8])
    uv, uv_da = dr.interpolate(coordinates, rast, tri, rast_db=rast_db, diff_attrs="all")
    made, compared = [], []

    class Counted:
        def __init__(self, *args, **kwargs):
            self.own = bokashi.Texture(*args, **kwargs)
            made.append(self)

        def holds(self, levels):
            compared.append(self)
            return self.own.holds(levels)

    monkeypatch.setattr(dr, "Texture", Counted)
    native = dr._native.sample_texture

    def sample_texture(*args, constant=None, **kwargs):
        return native(*args, constant=constant and constant.own, **kwargs)

    monkeypatch.setattr(dr._native, "sample_texture", sample_texture)
    own = tex[0].clone()
    for _ in range(3):
        assert torch.equal(dr.texture(own[None], uv, uv_da), dr.texture(leaf(own[None]), uv, uv_da).detach())
    # One for both images, compared once in each call but the first.
    assert len(made) == 1 and len(compared) == 2
    # Other views of it are others, and do not take its place.
    halves = own[:4][None], own[4:8][None], own.flip(0)[None], own.transpose(0, 1)[None]
    for half in halves:
        assert torch.equal(dr.texture(half, uv, uv_da), dr.texture(leaf(half), uv, uv_da).detach())
    count = len(made)
    dr.texture(own[None], uv, uv_da)
    dr.texture(halves[1], uv, uv_da)
    assert len(made) == count
    # What is written to it is seen in each of its views.
    own.numpy()[:] *= 0.5
    assert torch.equal(dr.texture(own[None], uv, uv_da), dr.texture(leaf(own[None]), uv, uv_da).detach())
    # So many views are kept, and no more.
    many = torch.rand(40, 4, 4, 3, dtype=tex.dtype)
    for k in range(40):
        dr.texture(many[k : k + 1], uv, uv_da)
    assert len(dr._textures.known[id(many)][2]["views"]) == 8
    # The entry goes with its tensor.
    for tensor in (own, many):
        assert id(tensor) in dr._textures.known
    names, texture = [id(own), id(many)], weakref.ref(made[-1])
    made.clear()
    compared.clear()
    del own, many, tensor, half, halves
    gc.collect()
    assert not {*names} & {*dr._textures.known} and texture() is None
