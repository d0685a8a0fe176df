"""Arrays with tangents, and products with Jacobians and Hessians."""

import numpy as np
import pytest

import bokashi
from bokashi import Dual
from cases import ball, layered
from conftest import check_gradients, scene


def quotients(function, arrays, direction, step=1e-6):
    """How the gradients of a loss change along a direction, from differences."""

    def gradients(sign):
        moved = [array + sign * step * move for array, move in zip(arrays, direction)]
        return function(*moved)[1](np.ones(()))[: len(arrays)]

    return [(a - b) / (2 * step) for a, b in zip(gradients(1), gradients(-1))]


def check_hessian(function, arrays, generator, tolerance=1e-6):
    direction = [generator.normal(size=np.shape(array)) for array in arrays]
    bars, products = bokashi.hvp(function, arrays, direction)
    for bar, expected in zip(bars, function(*arrays)[1](np.ones(()))):
        np.testing.assert_allclose(bar, expected, rtol=1e-12, atol=1e-12)
    for product, expected in zip(products, quotients(function, arrays, direction)):
        np.testing.assert_allclose(product, expected, atol=tolerance * max(1, abs(expected).max()))


@pytest.mark.parametrize("silhouettes", ["exact", "antialias"])
def test_a_whole_step_has_a_true_hessian(silhouettes, generator):
    mesh, clip = scene(generator)
    colors, sky = generator.uniform(size=(7, 3)), generator.uniform(size=3)
    reference = generator.uniform(size=(12, 16, 3))

    def loss(clip, colors, sky):
        value, pull_back = bokashi.render(
            clip, mesh, colors, (12, 16), background=sky, reference=reference, silhouettes=silhouettes
        )
        return value, lambda bar: [pull_back(bar)[k] for k in (0, 2, 3)]

    check_hessian(loss, [clip, colors, sky], generator)


def test_losses_and_regularizers_have_true_hessians(generator):
    mesh, clip = scene(generator)
    positions, topology = clip[:, :3].copy(), bokashi.Topology(mesh)
    rigidity = bokashi.Rigidity(topology, positions + 0.1 * generator.normal(size=(7, 3)))
    image, reference = generator.uniform(0.2, 0.8, (2, 12, 12, 1))
    depths, clouds = generator.uniform(1, 3, (6, 5)), [generator.normal(size=(count, 3)) for count in (5, 7)]
    others = depths + generator.normal(size=(6, 5)) * 0.2
    for function, *arrays in [
        (lambda x: bokashi.rigid_error(x, rigidity), positions), (lambda x: bokashi.normal_error(x, topology), positions),
        (lambda x: bokashi.edge_length_error(x, topology, target=0.2), positions),
        (lambda x: bokashi.laplacian_error(x, topology.uniform_laplacian()), positions),
        (bokashi.ssim_error, image, reference), (bokashi.silhouette_error, image, reference),
        (lambda a, b: bokashi.mean_error(a, b, penalty="charbonnier", scale=0.2), image, reference),
        (lambda x: bokashi.total_variation(x, penalty="charbonnier", scale=0.2), image), (bokashi.total_variation, image),
        (lambda a, b: bokashi.depth_error(a, b, alignment="scale"), depths, others),
        (lambda a, b: bokashi.depth_error(a, b, alignment="scale-and-shift"), depths, others),
        (bokashi.chamfer_distance, *clouds), (lambda a, b: bokashi.chamfer_distance(a, b, squared=False), *clouds),
    ]:
        check_hessian(function, arrays, generator)


def test_operations_and_arithmetic_are_differentiated_together(generator):
    mesh, clip = scene(generator)
    colors = generator.uniform(0.2, 0.8, (7, 3))

    def shaded(clip, colors):
        """Fragments whose colours are changed by numpy, and the gradient by hand."""
        fragments, of_clip = bokashi.rasterize(clip, mesh, 12, exact=True)
        surface, of_surface = bokashi.interpolate(colors, fragments)
        image, of_picture = bokashi.picture(np.exp(-surface) * surface, fragments, 0.1 * np.ones(3))
        loss, of_image = bokashi.mean_error(image, np.zeros((12, 12, 3)))

        def pull_back(bar):
            values_bar, _, uv_bar, clip_bar, weight_bar, _ = of_picture(of_image(bar)[0])
            colors_bar, more, other, *_ = of_surface(np.exp(-surface) * (1 - surface) * values_bar)
            uv_bar = more if uv_bar is None else uv_bar + more
            bars = [of_clip(uv_bar, weight_bar)[0], *(b for b in (clip_bar, other) if b is not None)]
            return sum(bars[1:], bars[0]), colors_bar

        return loss, pull_back

    check_gradients(shaded, [clip, colors], generator)
    check_hessian(shaded, [clip, colors], generator)


def test_the_arithmetic_of_numpy_keeps_tangents(generator):
    x, y = generator.uniform(0.5, 2, (2, 4, 3))
    u, v = generator.normal(size=(2, 4, 3))
    z, w = x[0], generator.normal(size=3)
    step = 1e-6
    for function in [
        lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y, lambda x, y: -x + 2.0 / y,
        lambda x, y: 3 - x, lambda x, y: x**3, lambda x, y: abs(-x) + np.absolute(y), lambda x, y: x @ y.T,
        lambda x, y: z @ x.T, lambda x, y: x @ z, lambda x, y: x[1:, 0] * y[0, 1], lambda x, y: x.reshape(2, 6),
        lambda x, y: np.concatenate([x, y, np.ones((1, 3))]), lambda x, y: np.stack([x, y], axis=1),
        lambda x, y: np.sum(x * y, axis=0), lambda x, y: x.sum() * y.mean(axis=1, keepdims=True),
        lambda x, y: np.transpose(x), lambda x, y: np.broadcast_to(x, (2, 4, 3)), lambda x, y: z + x,
        lambda x, y: np.sqrt(x) + np.exp(y) * np.log(x), lambda x, y: np.sin(x) * np.cos(y) + np.tanh(x) + np.square(y),
        lambda x, y: np.reshape(x, (3, 4)), lambda x, y: np.repeat(x, 2, axis=0), lambda x, y: np.negative(x * w),
    ]:
        found = function(Dual(x, u), Dual(y, v))
        np.testing.assert_allclose(found.value, function(x, y), rtol=1e-14)
        quotient = (function(x + step * u, y + step * v) - function(x - step * u, y - step * v)) / (2 * step)
        np.testing.assert_allclose(found.tangent, quotient, atol=1e-7)
        assert found.shape == found.tangent.shape
    dual = Dual(x, u)
    np.testing.assert_array_equal(dual > 1, x > 1)
    assert (len(dual), dual.ndim, dual.dtype, dual.T.shape) == (4, 2, np.float64, (3, 4))


def test_results_of_any_form_have_tangents_of_the_same_form(generator):
    mesh, clip = scene(generator)
    behind, behind_clip = layered(generator)
    grid, field, _ = ball(generator)
    prefilter, texels = bokashi.Prefilter(4, 2), generator.uniform(0.2, 1, (6, 4, 4, 3))

    def arrays_of(value):
        if isinstance(value, bokashi.Fragments):
            return [x for x in (value.barycentrics, value.weight, value.clip) if x is not None]
        return [array for part in value for array in arrays_of(part)] if isinstance(value, (tuple, list)) else [value]

    for function, point in [
        (lambda x: bokashi.rasterize(x, mesh, 8), clip), (lambda x: bokashi.rasterize(x, mesh, 8, exact=True), clip),
        (lambda x: bokashi.depth_layers(x, behind, (9, 8)), behind_clip),
        (lambda x: bokashi.prefiltered(x, prefilter), texels),
        (lambda x: ([(pair := bokashi.field_surface(x, grid))[0][0]], pair[1]), field),
    ]:
        direction, step = generator.normal(size=point.shape), 1e-7
        value, tangent = bokashi.jvp(function, [point], [direction])
        plain, ahead, back = (function(point + k * step * direction)[0] for k in (0, 1, -1))
        assert type(value) is type(tangent) is type(plain)
        found = [arrays_of(x) for x in (value, tangent, plain, ahead, back)]
        assert len(set(map(len, found))) == 1
        for v, t, at, a, b in zip(*found):
            np.testing.assert_allclose(v, at, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(t, (a - b) / (2 * step), rtol=1e-4, atol=1e-5 * abs(t).max())
            assert abs(t).max() > 0
    (positions, surface), (moved, same) = bokashi.jvp(lambda x: bokashi.field_surface(x, grid), [field], [field])
    assert surface is same and positions.shape == moved.shape == (surface.vertex_count, 3)
    value, tangent = bokashi.jvp(lambda x: ([x, None, 2, np.ones(3)], None), [clip], [clip])
    assert value[1] is tangent[1] is None and value[2] == 2 and tangent[2] == 0 and not tangent[3].any()
    with pytest.raises(TypeError, match="lists and tuples of them, got Coverage"):
        bokashi.jvp(lambda x: (bokashi.rasterize(x, mesh, 8)[0].coverage, None), [clip], [clip])
    with pytest.raises(TypeError, match="got dict"):
        bokashi.jvp(lambda x: ({"x": x}, None), [clip], [clip])


def test_arrays_with_tangents_are_compared_by_value():
    x = Dual([1.0, 2.0], [5.0, 6.0])
    for found, expected in [
        (x == 2, [False, True]), (x == Dual([1.0, 3.0], [0.0, 0.0]), [True, False]), (x != 1.0, [False, True]),
        (np.array([1.0, 1.0]) == x, [True, False]), (np.equal(2.0, x), [False, True]), (np.not_equal(x, x), [False, False]),
    ]:
        assert isinstance(found, np.ndarray) and found.tolist() == expected
    with pytest.raises(TypeError, match="unhashable"):
        hash(x)


def test_the_power_0_is_1_everywhere():
    for zero in (0, 0.0, np.uint8(0), np.array([0, 0, 1, 2]), np.array([0, 0, 1, 2], np.uint8)):
        power = Dual([0.0, 2.0, 0.0, 3.0], [1.0, 1.0, 1.0, 2.0]) ** zero
        expected = [[1, 1, 0, 9], [0, 0, 1, 12]] if np.ndim(zero) else [[1] * 4, [0] * 4]
        assert [power.value.tolist(), power.tangent.tolist()] == expected
    assert (Dual([np.inf], [1.0]) ** 0).tangent.tolist() == [0]


def test_a_denominator_that_a_gradient_takes_as_it_is_moves_in_products(generator):
    image, reference, move = generator.uniform(0.5, 1, (3, 4, 3, 1))

    def loss(x):
        return bokashi.mean_error(x, reference, penalty="relative", scale=0.1)

    _, slope = bokashi.jvp(loss, [image], [move])
    quotient = (loss(image + 1e-6 * move)[0] - loss(image - 1e-6 * move)[0]) / 2e-6
    np.testing.assert_allclose(slope, quotient, rtol=1e-7)
    assert abs(slope - (loss(image)[1](1.0)[0] * move).sum()) > 0.01 * abs(slope)
    check_hessian(loss, [image], generator)


def test_an_array_without_a_gradient_may_not_move_in_a_hessian(generator):
    mesh, clip = scene(generator)
    colors, reference, move = generator.uniform(size=(7, 3)), *generator.uniform(size=(2, 8, 8, 3))

    def loss(clip, reference):
        value, pull_back = bokashi.render(clip, mesh, colors, 8, reference=reference)
        return value, lambda bar: [pull_back(bar)[0], pull_back(bar)[4]]

    with pytest.raises(ValueError, match="input 1 moves, and needs a gradient or zeros from the pull-back, got None"):
        bokashi.hvp(loss, [clip, reference], [clip, move])
    (bar, none), (product, also_none) = bokashi.hvp(loss, [clip, reference], [clip, 0 * move])
    assert none is also_none is None
    (expected,), _ = bokashi.hvp(lambda clip: loss(clip, reference), [clip], [clip])
    np.testing.assert_array_equal(bar, expected)


def test_a_tangent_is_not_lost_in_silence(generator):
    mesh, clip = scene(generator)
    dual = Dual([1.0, 2.0], [1.0, 0.0])
    moving, still = Dual(clip, clip), bokashi.render(clip, mesh, clip, 8)[1]
    for wrong, error, message in [
        (lambda: np.asarray(dual), TypeError, "no plain array"),
        (lambda: float(dual[0]), TypeError, "float"),
        (lambda: np.arctan2(dual, dual), TypeError, "arctan2"),
        (lambda: np.median(dual), TypeError, "median"),
        (lambda: np.add(dual, 1, out=np.zeros(2)), TypeError, "add"),
        (lambda: np.sum(dual, initial=5.0), TypeError, "no out and no initial number, in sum"),
        (lambda: np.sum(dual, None, None, np.zeros(())), TypeError, "in sum"),
        (lambda: np.sum(dual, out=np.zeros(())), TypeError, "in sum"),
        (lambda: np.sum(np.ones(2), out=Dual(0.0, 0.0)), TypeError, "in sum"),
        (lambda: np.mean(dual, 0, None, np.zeros(())), TypeError, "in mean"),
        (lambda: np.concatenate([dual, dual], 0, np.zeros(4)), TypeError, "in concatenate"),
        (lambda: np.stack([dual, dual], 0, np.zeros((2, 2))), TypeError, "in stack"),
        (lambda: np.moveaxis(a=dual, source=0, destination=0), TypeError, "come first, and have"),
        (lambda: np.add.reduce(dual), TypeError, "add"),
        (lambda: dual**dual, TypeError, "power"),
        (lambda: Dual([1.0], [1.0, 2.0]), ValueError, "shape of its value, \\(1,\\), got \\(2,\\)"),
        (lambda: still(Dual(np.ones((8, 8, 4)), np.ones((8, 8, 4)))), TypeError, "got numbers with tangents beside float64"),
        (lambda: bokashi.se3(np.zeros(6), Dual(np.eye(4), np.eye(4))), TypeError, "a constant has no gradient"),
        (lambda: bokashi.Rigidity(bokashi.Topology(mesh), moving[:, :3]), TypeError, "a constant has no gradient"),
        (lambda: bokashi._native.Learning([("x", moving, 1.0, "identity")], 3), TypeError, "plain numbers, got tangents"),
        (lambda: bokashi.jvp(bokashi.norm, [clip], []), ValueError, "each of 1 arrays needs a tangent, got 0"),
        (lambda: bokashi.jvp(bokashi.norm, [clip], [clip[0]]), ValueError, "shape of its value"),
        (lambda: bokashi.hvp(bokashi.norm, [clip], [clip]), ValueError, "a single number, got shape \\(7,\\)"),
        (lambda: bokashi.hvp(lambda x: (bokashi.squared_error(x, x)[0], lambda bar: ()), [clip], [clip]), ValueError, "each of 1 arrays, got 0"),
    ]:
        with pytest.raises(error, match=message):
            wrong()


def test_numbers_with_tangents_are_doubles_and_others_join_them(generator):
    mesh, clip = scene(generator, np.float32)
    colors = generator.uniform(size=(7, 3))
    image, pull_back = bokashi.render(Dual(clip, np.ones((7, 4))), mesh, colors.astype(np.float32), 8)
    assert image.value.dtype == np.float64 and isinstance(pull_back(np.ones((8, 8, 3)))[2], Dual)
    again, _ = bokashi.render(clip.astype(np.float64), mesh, colors.astype(np.float32).astype(np.float64), 8)
    np.testing.assert_array_equal(image.value, again)
    # What does not depend on an array that moves does not move.
    value, moved = bokashi.jvp(lambda x: ((np.ones(2), x), None), [colors], [colors])
    assert value[0].tolist() == [1, 1] and moved[0].tolist() == [0, 0] and moved[1] is colors


def test_a_reference_that_moves_moves_the_loss(generator):
    mesh, clip = scene(generator)
    reference, move = generator.uniform(size=(2, 8, 8, 4))
    image, _ = bokashi.render(clip, mesh, clip, 8)
    _, slope = bokashi.jvp(lambda r: bokashi.render(clip, mesh, clip, 8, reference=r), [reference], [move])
    np.testing.assert_allclose(slope, (2 * (reference - image) * move).sum(), rtol=1e-10)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_textures_that_stay_have_no_tangent_and_their_coordinates_have(dtype, generator):
    for texels, places, sample in [
        (generator.uniform(size=(8, 8, 2)), generator.uniform(size=(5, 2)), bokashi.sample_texture),
        (generator.uniform(size=(6, 4, 4, 2)), generator.normal(size=(5, 3)), bokashi.sample_cube_map),
    ]:
        texels, moves = texels.astype(dtype), generator.normal(size=places.shape)
        still = bokashi.jvp(lambda x: sample(bokashi.Texture(texels), x, level=0.4), [places], [moves])
        copied = bokashi.jvp(lambda x: sample(texels.astype(np.float64), x, level=0.4), [places], [moves])
        np.testing.assert_allclose(still, copied, rtol=1e-5 if dtype == np.float32 else 1e-14)
        assert abs(still[1]).max() > 0.1
        with pytest.raises(TypeError, match="a constant texture has no tangent"):
            bokashi.Texture(Dual(texels, texels))


def test_bits_of_tangents_do_not_depend_on_threads(generator):
    mesh, clip = scene(generator)
    found = []
    for threads in (1, 2, 4, None):
        bokashi.set_num_threads(threads)
        found.append(bokashi.jvp(lambda clip: bokashi.render(clip, mesh, clip, 200), [clip], [clip[::-1]]))
    assert len({value.tobytes() + tangent.tobytes() for value, tangent in found}) == 1
