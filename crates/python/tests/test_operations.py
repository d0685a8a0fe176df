"""Operations that are described once: gradients, what is refused, and that none is forgotten."""

import copy
import pathlib
import pickle
import re

import numpy as np
import pytest

import bokashi
from cases import cases, layered
from conftest import check_gradients, scene

NAMES = list(cases(np.random.default_rng(0)))


def of_numpy(name, generator):
    """The function of an operation, whose pull-back has a gradient for each array, and the arrays."""
    function, arrays, *places = cases(generator)[name]

    def recorded(*arrays):
        value, pull_back = function(bokashi, *arrays)
        if name == "prefiltered":
            # Of harmonics and levels, one array.
            parts = [value.harmonics, *value.levels[1:]]
            ends = np.cumsum([0, *(int(np.prod(part.shape)) for part in parts)])

            def pull(bar):
                return pull_back(*(bar[a:b].reshape(x.shape) for a, b, x in zip(ends, ends[1:], parts)))

            return np.concatenate([part.reshape(-1) for part in parts]), pull
        return value, lambda bar: [pull_back(bar)[k] for k in (places[0] if places else range(len(arrays)))]

    return recorded, arrays


@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_true(name, generator):
    function, arrays = of_numpy(name, generator)
    check_gradients(function, arrays, generator)


@pytest.mark.parametrize("name", NAMES)
def test_single_precision_stays_single(name, generator):
    function, arrays = of_numpy(name, generator)
    single, of_single = function(*[array.astype(np.float32) for array in arrays])
    double, of_double = function(*arrays)
    upstream = generator.normal(size=np.shape(double))
    pairs = [(single, double), *zip(of_single(upstream.astype(np.float32)), of_double(upstream))]
    for found, expected in pairs:
        assert (found is None) == (expected is None)
        if found is None:
            continue
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * max(1, abs(expected).max()))


def test_surfaces_behind_a_surface_have_true_gradients(generator):
    mesh, clip = layered(generator)

    def second_of_all(clip):
        layers, pull_back = bokashi.depth_layers(clip, mesh, (9, 8))
        assert [len(layer) > 0 for layer in layers] == [True, True, True]
        return layers[1].barycentrics, lambda bar: pull_back(None, bar, None)

    def behind(clip):
        front, _ = bokashi.rasterize(clip, mesh, (9, 8))
        second, pull_back = bokashi.rasterize_behind(front)
        return second.barycentrics, pull_back

    check_gradients(second_of_all, [clip], generator)
    check_gradients(behind, [clip], generator)
    np.testing.assert_array_equal(second_of_all(clip)[0], behind(clip)[0])
    assert len(bokashi.depth_layers(clip, mesh, 8, most=2)[0]) == 2
    assert bokashi.depth_layers(clip * [1, 1, 1, -1], mesh, 8)[0] == []


def test_layers_are_what_they_say(generator):
    mesh, clip = layered(generator)
    layers, _ = bokashi.depth_layers(clip, mesh, (9, 8))
    colors = [generator.uniform(size=(len(layer), 3)) for layer in layers]
    opaque = [(layer, values, np.ones(len(layer))) for layer, values in zip(layers, colors)]
    image, _ = bokashi.composite_layers(opaque, antialias=False)
    alone, _ = bokashi.picture(colors[0], layers[0], antialias=False)
    np.testing.assert_array_equal(image, alone)
    through = [(layer, values, np.zeros(len(layer))) for layer, values in zip(layers, colors)]
    summed, _ = bokashi.composite_layers(through, antialias=False)
    np.testing.assert_allclose(
        summed, sum(layer.coverage.scatter(values) for layer, values in zip(layers, colors)), atol=1e-12
    )
    sharp = [bokashi.LensLayer(layer, values, bokashi.eye_depth(layer)[0]) for layer, values in zip(layers, colors)]
    np.testing.assert_allclose(bokashi.lens_picture(sharp, 0.0, 1.5)[0], alone, atol=1e-12)
    assert abs(bokashi.lens_picture(sharp, 3.0, 9.0)[0] - alone).max() > 0.01


def test_values_are_those_of_numpy(generator):
    a, b = generator.normal(size=(5, 3)), generator.normal(size=(5, 3))
    for ours, theirs in [
        (bokashi.dot(a, b), (a * b).sum(1)), (bokashi.cross(a, b), np.cross(a, b)), (bokashi.matmul(a, b.T), a @ b.T),
        (bokashi.norm(a), np.linalg.norm(a, axis=1)), (bokashi.sigmoid(a), 1 / (1 + np.exp(-a))),
        (bokashi.softplus(a), np.logaddexp(0, a)), (bokashi.mean_error(a, b), ((a - b) ** 2).mean()),
        (bokashi.mean_error(a, b, mask=a > 0), ((a - b) ** 2)[a > 0].mean()),
        (bokashi.squared_error(a, b), ((a - b) ** 2).sum()), (bokashi.gather_rows(a, np.array([4, 4])), a[[4, 4]]),
    ]:
        np.testing.assert_allclose(ours[0], theirs, rtol=1e-12)
    share = a**2 + 0.1
    loss, pull_back = bokashi.mean_error(a, b, penalty="relative", scale=0.1)
    np.testing.assert_allclose(loss, ((a - b) ** 2 / share).mean(), rtol=1e-12)
    np.testing.assert_allclose(pull_back(1.0)[0], 2 * (a - b) / share / a.size, rtol=1e-12)
    assert bokashi.softplus(np.array([-1e4, 1e4]))[0].tolist() == [0, 1e4]
    ((value, pull_back)) = bokashi.normalize(np.zeros((1, 3)))
    assert not value.any() and not pull_back(np.ones((1, 3)))[0].any()


def test_what_is_refused_says_the_rule_and_then_the_value(generator):
    mesh, clip = scene(generator)
    a, image = generator.normal(size=(5, 3)), generator.uniform(size=(12, 12, 1))
    topology = bokashi.Topology(mesh)
    fragments, _ = bokashi.rasterize(clip, mesh, 8)
    exact, _ = bokashi.rasterize(clip, mesh, 8, exact=True)
    values, ones = np.ones((len(fragments), 1)), np.ones(len(fragments))
    for wrong, error, message in [
        (lambda: bokashi.dot(a, a[:, :2]), bokashi.RenderError, "as many components"),
        (lambda: bokashi.norm(np.array(1.0)), bokashi.RenderError, "norm"),
        (lambda: bokashi.norm([1.0, 2.0]), TypeError, "float32 or float64, got list"),
        (lambda: bokashi.matmul(a, a), bokashi.RenderError, "matmul"),
        (lambda: bokashi.gather_rows(a, np.array([5])), bokashi.RenderError, "5"),
        (lambda: bokashi.gather_rows(a, np.array([-1])), ValueError, "from 0 on below 2\\^32, got -1"),
        (lambda: bokashi.gather_rows(a, np.array([0.5])), TypeError, "uint32, int32 or int64, got float64"),
        (lambda: bokashi.scatter_add_rows(a, np.array([0]), 1), bokashi.RenderError, "scatter_add_rows"),
        (lambda: bokashi.scatter_add_rows(a, np.zeros(5, int), 1 << 62), bokashi.RenderError, "scatter_add_rows"),
        (lambda: bokashi.SparseMatrix((2, 2), np.array([2]), np.array([0]), np.ones(1)), bokashi.RenderError, "2"),
        (lambda: bokashi.SparseMatrix((2, 2), np.array([1, 1]), np.array([0]), np.ones(1)), ValueError, "got 2 rows, 1 columns"),
        (lambda: bokashi.mean_error(image, image[:5]), bokashi.RenderError, "shape"),
        (lambda: bokashi.mean_error(image, image, penalty="huber"), ValueError, "huber needs a scale, got None"),
        (lambda: bokashi.mean_error(image, image, scale=1.0), ValueError, "squared has no scale, got 1"),
        (lambda: bokashi.mean_error(image, image, penalty="huber", scale=-1.0), bokashi.RenderError, "delta above 0"),
        (lambda: bokashi.mean_error(image, image, penalty="cubed"), ValueError, "got \"cubed\""),
        (lambda: bokashi.mean_error(image, image, image, mask=image > 0), ValueError, "weights or a mask, got both"),
        (lambda: bokashi.mean_error(image, image, mask=image), TypeError, "a numpy array of bool, got float64"),
        (lambda: bokashi.mean_error(image, image, -image), bokashi.RenderError, "weight"),
        (lambda: bokashi.ssim_error(a, a), bokashi.RenderError, "ssim"),
        (lambda: bokashi.ssim_error(image, image, peak=0.0), bokashi.RenderError, "peak"),
        (lambda: bokashi.multiscale_ssim_error(image, image, levels=9), bokashi.RenderError, "9"),
        (lambda: bokashi.depth_error(a, a, alignment="turn"), ValueError, "none, scale or scale-and-shift, got \"turn\""),
        (lambda: bokashi.total_variation(image, penalty="relative", scale=1.0), bokashi.RenderError, "no relative one"),
        (lambda: bokashi.edge_length_error(a, topology), bokashi.RenderError, "\\[7, 3\\]"),
        (lambda: bokashi.edge_length_error(clip[:, :3], topology, target=np.nan), bokashi.RenderError, "target"),
        (lambda: bokashi.laplacian_error(a, topology.uniform_laplacian()), bokashi.RenderError, "7"),
        (lambda: bokashi.Rigidity(topology, clip[:, :3], "angle"), ValueError, "cotangent or uniform, got \"angle\""),
        (lambda: bokashi.Rigidity(topology, a), bokashi.RenderError, "\\[7, 3\\]"),
        (lambda: bokashi.rasterize_behind(exact), bokashi.RenderError, "exact"),
        (lambda: bokashi.depth_layers(clip[:, :3], mesh, 8), bokashi.RenderError, "\\[7, 4\\]"),
        (lambda: bokashi.depth_layers(clip, mesh, 8, cull="left"), ValueError, "none, back or front"),
        (lambda: bokashi.composite_layers([]), bokashi.RenderError, "at least one layer, got none"),
        (lambda: bokashi.composite_layers([(fragments, values, ones[1:])]), bokashi.RenderError, "alphas of shape"),
        (lambda: bokashi.lens_picture([], 1.0, 1.0), bokashi.RenderError, "at least one layer, got none"),
        (lambda: bokashi.lens_picture([bokashi.LensLayer(fragments, values, ones)], -1.0, 1.0), bokashi.RenderError, "aperture"),
        (lambda: bokashi.lens_picture([bokashi.LensLayer(fragments, values, -ones)], 1.0, 1.0), bokashi.RenderError, "distances from 0 up"),
        (lambda: bokashi.lens_picture([bokashi.LensLayer(fragments, values, ones)], 1.0, 1.0, margin=9), bokashi.RenderError, "margin"),
        (lambda: bokashi.lens_picture([bokashi.LensLayer(fragments, values, ones)], 1.0, 1.0, blades=2), bokashi.RenderError, "blades"),
        (lambda: bokashi.Prefilter(5, 1), bokashi.RenderError, "power of two up to 256"),
        (lambda: bokashi.Prefilter(4, 9), bokashi.RenderError, "from 1 to 3 levels"),
        (lambda: bokashi.prefiltered(np.ones((6, 8, 8, 3)), bokashi.Prefilter(4, 1)), bokashi.RenderError, "\\[6, 4, 4, C\\]"),
        (lambda: bokashi.irradiance(np.ones((9, 3)), np.zeros((2, 3))), bokashi.RenderError, "got zero in row 0"),
        (lambda: bokashi.shade_in_environment(a, a, [a], bokashi.Environment(np.ones((9, 3)), []), model="lambert"), ValueError, "at least one level"),
    ]:
        with pytest.raises(error, match=message):
            wrong()


def test_what_is_empty_has_a_result_or_an_error(generator):
    none, rows = np.zeros((0, 3)), np.zeros(0, np.int64)
    nothing = bokashi.Mesh(np.zeros((0, 3), np.int64), 0)
    topology = bokashi.Topology(nothing)
    for (value, pull_back), shape in [
        (bokashi.norm(none), (0,)), (bokashi.normalize(none), (0, 3)), (bokashi.dot(none, none), (0,)),
        (bokashi.matmul(none, np.ones((3, 2))), (0, 2)), (bokashi.gather_rows(np.ones((2, 3)), rows), (0, 3)),
        (bokashi.scatter_add_rows(none, rows, 2), (2, 3)), (bokashi.squared_error(none, none), ()),
        (bokashi.laplacian_error(none, topology.uniform_laplacian()), ()), (bokashi.normal_error(none, topology), ()),
        (bokashi.rigid_error(none, bokashi.Rigidity(topology, none)), ()),
    ]:
        assert value.shape == shape and not value.any() and all(np.isfinite(bar).all() for bar in pull_back(value))
    assert bokashi.depth_layers(np.zeros((0, 4)), nothing, 4)[0] == []
    front, _ = bokashi.rasterize(np.zeros((0, 4)), nothing, 4)
    assert len(bokashi.rasterize_behind(front)[0]) == 0
    sky = np.array([0.2, 0.4])
    image, _ = bokashi.composite_layers([(front, np.zeros((0, 2)), np.zeros(0))], sky)
    np.testing.assert_array_equal(image, np.broadcast_to(sky, (4, 4, 2)))
    seen, _ = bokashi.lens_picture([bokashi.LensLayer(front, np.zeros((0, 2)), np.zeros(0))], 2.0, 1.0, background=sky)
    np.testing.assert_allclose(seen, image)
    with pytest.raises(bokashi.RenderError):
        bokashi.mean_error(none, none)


def test_arrays_of_any_order_are_read_as_they_are(generator):
    a = generator.normal(size=(5, 3))
    for other in (np.asfortranarray(a), np.repeat(a, 2, 0)[::2], a[::-1][::-1]):
        np.testing.assert_array_equal(bokashi.normalize(other)[0], bokashi.normalize(a)[0])
    mask = generator.uniform(size=(3, 5)) > 0.5
    np.testing.assert_array_equal(bokashi.mean_error(a, 2 * a, mask=mask.T)[0], bokashi.mean_error(a, 2 * a, mask=mask.T.copy())[0])
    rows = np.array([3, 9, 0, 9])[::2]
    np.testing.assert_array_equal(bokashi.gather_rows(a, rows)[0], a[[3, 0]])
    for number in (np.int32, np.int64, np.uint32):
        np.testing.assert_array_equal(bokashi.gather_rows(a, rows.astype(number))[0], a[[3, 0]])


def test_bits_do_not_depend_on_threads(generator):
    mesh, clip = layered(generator)
    results = []
    for threads in (1, 2, 4, None):
        bokashi.set_num_threads(threads)
        layers, _ = bokashi.depth_layers(clip, mesh, 150)
        given = [bokashi.LensLayer(x, np.sin(x.barycentrics), bokashi.eye_depth(x)[0]) for x in layers]
        image, of_lens = bokashi.lens_picture(given, 4.0, 1.3)
        loss, of_loss = bokashi.ssim_error(image, np.zeros_like(image))
        bars = of_lens(of_loss(np.ones(()))[0])
        results.append(b"".join(x.tobytes() for x in (image, loss, *(bar for bar in bars if bar is not None))))
    assert len(set(results)) == 1


def test_constants_can_be_copied_and_pickled():
    matrix = bokashi.SparseMatrix((2, 3), np.array([1, 0]), np.array([2, 1]), np.array([0.5, 2.0]))
    for other in (copy.deepcopy(matrix), pickle.loads(pickle.dumps(matrix))):
        assert other.shape == (2, 3) and all(map(np.array_equal, other.entries, matrix.entries))
    prefilter = pickle.loads(pickle.dumps(bokashi.Prefilter(4, 2)))
    assert (prefilter.extent, prefilter.levels) == (4, 2)


# What Rust has and Python has under another name, or not.
ENTRY_BY_NAME = "numpy has it entry by entry, and its gradient is a line"
MOVED = "numpy moves or sums numbers, and its gradient is numpy's call the other way round"
ENTRIES = {
    "project": "project", "projections": "pinhole orthographic", "motions": "rigid se3",
    "affine": "affine_inverse transform_points", "lenses": "distort fisheye", "project_instances": "project_instances",
    "face_normals": "face_normals", "vertex_normals": "vertex_normals", "transform_normals": "transform_normals",
    "tangents": "tangents", "perturbed_normals": "perturbed_normals", "shade": "shade", "irradiance": "irradiance",
    "environment": "prefiltered shade_in_environment", "reflect": "reflect", "tone": "exposure srgb_encode srgb_decode",
    "rasterize": "rasterize", "rasterize_behind": "rasterize_behind depth_layers", "differentials": "differentials",
    "sample_texture": "sample_texture mipmaps", "constant_textures": "sample_texture sample_cube_map", "sample_cube_map": "sample_cube_map",
    "interpolate": "interpolate interpolate_differentials", "composite": "picture",
    "composite_layers": "composite_layers", "over": "over", "antialias": "picture antialias_image", "depth": "depth",
    "eye_depth": "eye_depth eye_depth_slope", "depth_of_field": "depth_of_field", "lens_picture": "lens_picture",
    "gaussian_blur": "gaussian_blur", "downsample": "downsample", "pictures": "picture", "exact_coverage": "rasterize",
    "pipeline": "render", "mean_error": "mean_error", "ssim_error": "ssim_error multiscale_ssim_error",
    "silhouette_error": "silhouette_error", "depth_error": "depth_error", "halved": "halved",
    "total_variation": "total_variation", "vertices": "laplacian_error edge_length_error normal_error rigid_error",
    "weighted_error": "mean_error", "squared_error": "squared_error", "sigmoid": "sigmoid", "softplus": "softplus",
    "dot": "dot", "cross": "cross", "norm": "norm", "normalize": "normalize", "sparse_product": "sparse_product",
    "field_surface": "field_surface", "draw_points": "draw_points", "chamfer_distance": "chamfer_distance",
    "matmul": "matmul", "gather_rows": "gather_rows", "scatter_add_rows": "scatter_add_rows",
}
ABSENT = {
    "blurred_pictures": "gaussian_blur of a picture has the same value; what it saves are rows beside what is covered",
    "constant_fragments": "fragments are arrays: whose gradient nobody wants is not computed",
    "sum_over": "a Python program adds losses and gradients of parts itself",
    "compositions": "tests of several operations at once",
    **dict.fromkeys("add sub mul div pow select minimum maximum exp ln sqrt powi powf sin cos tanh relu abs clamp".split(), ENTRY_BY_NAME),
    **dict.fromkeys("sum mean permute reshape keepdim slice pad stack concat".split(), MOVED),
}


def test_every_entry_of_the_catalogue_has_a_function_or_a_reason():
    catalogue = pathlib.Path(__file__).parents[2] / "catalogue" / "src" / "lib.rs"
    if not catalogue.exists():
        pytest.skip("the tests are not in a clone")
    (listed,) = re.findall(r"\$walk! \{(.*?)\n        \}", catalogue.read_text(), re.S)
    entries = [name for part in re.findall(r"\w+:([^;]*);", listed) for name in part.split()]
    assert len(entries) > 80
    # Two entries are named affine: matrices, and a times x plus b of an array, which is arithmetic.
    assert [name for name in entries if name not in ENTRIES and name not in ABSENT] == []
    assert [name for name in (*ENTRIES, *ABSENT) if name not in entries] == []
    import importlib
    import inspect

    for module, of_one, of_more in [
        ("bokashi", "tuple[NDArray, PullBack]", "tuple[Any, PullBack]"), ("bokashi.torch", "Tensor", "Any"),
        ("bokashi.jax", "Array", "Any"),
    ]:
        try:
            found = importlib.import_module(module)
        except ImportError:
            continue
        names = {name for names in ENTRIES.values() for name in names.split()}
        assert [name for name in sorted(names) if not hasattr(found, name) or name not in found.__all__] == []
        functions = {name: getattr(found, name) for name in names}
        assert {(function.__module__, function.__name__) for function in functions.values()} == {(module, name) for name in names}
        returned = {name: inspect.signature(function).return_annotation for name, function in functions.items()}
        several = {"depth_layers", "field_surface", "mipmaps", "prefiltered", "rasterize", "rasterize_behind"}
        assert returned == {name: of_more if name in several else of_one for name in names}
