"""Surfaces of fields, meshes that change, distances between surfaces."""

import copy
import pickle

import numpy as np
import pytest

import bokashi
from cases import ball
from conftest import check_gradients

NOTHING = bokashi.Mesh(np.zeros((0, 3), np.int64), 0)
NONE = np.zeros((0, 3))
TETRAHEDRON = bokashi.Mesh(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), 4)
CORNERS = np.concatenate([np.zeros((1, 3)), np.eye(3)])


def sphere(cells=16):
    grid = bokashi.Grid.around([-1, -1, -1], [1, 1, 1], cells)
    surface, _ = bokashi.field_surface(np.linalg.norm(grid.positions, axis=-1) - 0.8, grid)
    return surface


def test_the_surface_of_a_field_has_true_gradients(generator):
    grid, field, offsets = ball(generator)

    def surface(field, offsets=None):
        (positions, mesh), pull_back = bokashi.field_surface(field, grid, offsets)
        assert positions.shape == (mesh.vertex_count, 3)
        return positions, pull_back

    check_gradients(surface, [field], generator)
    check_gradients(surface, [field, offsets], generator)
    flat, pull_back = surface(field.ravel(), offsets.reshape(-1, 3))
    positions, of_shape = surface(field, offsets)
    np.testing.assert_array_equal(flat, positions)
    for one, other in zip(pull_back(positions), of_shape(positions)):
        np.testing.assert_array_equal(one.ravel(), other.ravel())
    single, pull_back = surface(field.astype(np.float32))
    assert single.dtype == np.float32 and pull_back(single)[0].dtype == np.float32


def test_a_grid_says_where_its_points_are():
    grid = bokashi.Grid((2, 3, 4), (1.0, 0.0, -1.0), 0.5)
    assert (grid.shape, grid.origin, grid.spacing) == ((2, 3, 4), (1.0, 0.0, -1.0), 0.5)
    expected = np.stack(np.meshgrid([1, 1.5], [0, 0.5, 1], [-1, -0.5, 0, 0.5], indexing="ij"), -1)
    np.testing.assert_array_equal(grid.positions, expected)
    for other in (copy.deepcopy(grid), pickle.loads(pickle.dumps(grid))):
        np.testing.assert_array_equal(other.positions, grid.positions)
    around = bokashi.Grid.around([-1, 0, 0], [1, 1, 1], 4)
    assert around.shape == (7, 5, 5) and around.spacing == 0.5
    assert repr(grid) == "Grid((2, 3, 4), (1, 0, -1), 0.5)"


def test_a_mesh_of_another_one_carries_what_stands_at_vertices(generator):
    positions, mesh = sphere()
    colors = generator.uniform(size=(len(positions), 3))
    lengths = generator.uniform(0.1, 0.4, len(positions))
    for made in [
        bokashi.remesh(positions, mesh, 0.2), bokashi.remesh(positions, mesh, lengths, moves_vertices=False),
        bokashi.subdivide(positions, mesh), bokashi.subdivide(positions, mesh, "loop"),
    ]:
        again, _ = bokashi.sparse_product(positions, made.weights)
        np.testing.assert_allclose(again, made.positions, atol=1e-12)
        assert made.weights.shape == (made.mesh.vertex_count, len(positions))
        assert bokashi.Connectivity(made.mesh).euler_characteristic == 2
        carried, _ = bokashi.sparse_product(colors, made.weights)
        assert carried.min() >= 0 and carried.max() <= 1
        volume = bokashi.signed_volume(made.positions, made.mesh)
        assert abs(volume / bokashi.signed_volume(positions, mesh) - 1) < 0.06
        assert bokashi.self_intersections(made.positions, made.mesh).shape == (0, 2)
    single = positions.astype(np.float32)
    for made in (bokashi.remesh(single, mesh, 0.2), bokashi.subdivide(single, mesh)):
        assert made.positions.dtype == np.float32
    edges = bokashi.Topology(bokashi.remesh(positions, mesh, 0.2).mesh).edges
    made = bokashi.remesh(positions, mesh, 0.2)
    sizes = np.linalg.norm(np.diff(made.positions[edges], axis=1), axis=-1)
    assert 0.15 < sizes.mean() < 0.25
    same = bokashi.remesh(positions, mesh, 0.2, iterations=0)
    np.testing.assert_array_equal(same.positions, positions)
    # Where vertices don't move, those that are kept stay. At nearly the lengths of now these are many.
    old = set(map(bytes, positions))
    shares = []
    for options in ({}, {"keeps_apart": False}, {"moves_vertices": False}):
        rows = bokashi.remesh(positions, mesh, 0.08, **options).positions
        shares.append(sum(bytes(row) in old for row in rows) / len(rows))
    assert shares[0] == shares[1] == 0 and shares[2] > 0.3, shares
    few = bokashi.remesh(positions, mesh, 0.05, most_faces=len(mesh))
    assert len(few.mesh) <= len(mesh)


def test_numbers_of_a_surface_are_those_worked_out_by_hand():
    assert bokashi.signed_volume(CORNERS, TETRAHEDRON) == pytest.approx(1 / 6)
    assert bokashi.signed_volume(-CORNERS, TETRAHEDRON) == pytest.approx(-1 / 6)
    assert bokashi.surface_area(CORNERS.astype(np.float32), TETRAHEDRON) == pytest.approx(1.5 + 3**0.5 / 2)
    through = np.concatenate([CORNERS, [[0.2, 0.2, -0.5], [0.2, 0.2, 0.5], [0.2, 3, 0]]])
    mesh = bokashi.Mesh(np.concatenate([TETRAHEDRON.faces, [[4, 5, 6]]]), 7)
    assert bokashi.self_intersections(through, mesh).tolist() == [[0, 4], [3, 4]]


def test_smoothing_takes_noise_away(generator):
    positions, mesh = sphere()
    noisy = positions + generator.normal(size=positions.shape) * 0.02

    def roughness(x):
        return np.linalg.norm(x, axis=1).std()

    smoothed = bokashi.smooth(noisy, mesh, 10)
    assert roughness(smoothed) < 0.5 * roughness(noisy)
    shrunk = bokashi.smooth(noisy, mesh, 10, swell=None)
    volumes = [bokashi.signed_volume(x, mesh) for x in (shrunk, smoothed, positions)]
    assert volumes[0] < 0.95 * volumes[2] and abs(volumes[1] / volumes[2] - 1) < 0.02
    assert bokashi.smooth(noisy.astype(np.float32), mesh, 1).dtype == np.float32
    np.testing.assert_array_equal(bokashi.smooth(noisy, mesh, 0), noisy)


def test_connectivity_counts():
    closed = bokashi.Connectivity(TETRAHEDRON)
    assert (closed.vertices, closed.edges, closed.faces, closed.parts) == (4, 6, 4, 1)
    assert (closed.euler_characteristic, closed.boundary_loops) == (2, 0)
    assert closed.is_closed and closed.is_manifold and closed.is_oriented
    tie = bokashi.Connectivity(bokashi.Mesh(np.array([[0, 1, 2], [5, 5, 5], [0, 3, 4]]), 6))
    assert (tie.parts, tie.boundary_edges, tie.boundary_loops, tie.pinched_vertices) == (2, 6, 2, 1)
    assert tie.part_of_face.tolist() == [0, -1, 1] and not tie.is_closed and not tie.is_manifold
    crowded = bokashi.Connectivity(bokashi.Mesh(np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]), 5))
    assert crowded.crowded_edges == 1
    turned = bokashi.Connectivity(bokashi.Mesh(np.array([[0, 1, 2], [0, 1, 3]]), 4))
    assert not turned.is_oriented


def test_distances_are_those_of_all_pairs(generator):
    a, b = generator.normal(size=(40, 3)), generator.normal(size=(60, 3))
    pairs = np.linalg.norm(a[:, None] - b[None], axis=-1)
    found = bokashi.nearest_points(a, b)
    np.testing.assert_array_equal(found.indices, pairs.argmin(1))
    np.testing.assert_allclose(found.distances, pairs.min(1))
    squared, plain = (bokashi.chamfer_distance(a, b, squared=squared)[0] for squared in (True, False))
    np.testing.assert_allclose(squared, (pairs.min(1) ** 2).mean() + (pairs.min(0) ** 2).mean())
    np.testing.assert_allclose(plain, pairs.min(1).mean() + pairs.min(0).mean())
    score = bokashi.f_score(a, b, 0.5)
    precision, recall = (pairs.min(1) <= 0.5).mean(), (pairs.min(0) <= 0.5).mean()
    np.testing.assert_allclose(score, (precision, recall, 2 * precision * recall / (precision + recall)))


def distances_to_faces(points, corners):
    """Of each point `[N, 3]` to each face `[F, 3, 3]`, `[N, F]`: to its plane above it, else to an edge."""
    nearest = np.full((len(points), len(corners)), np.inf)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        along = ((points[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)
        foot = a + np.clip(along, 0, 1)[..., None] * (b - a)
        nearest = np.minimum(nearest, np.linalg.norm(points[:, None] - foot, axis=-1))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_above = np.ones(nearest.shape, bool)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        is_above &= (np.cross(b - a, points[:, None] - a) * normals).sum(-1) >= 0
    heights = abs(((points[:, None] - corners[:, 0]) * normals).sum(-1)) / np.linalg.norm(normals, axis=1)
    return np.where(is_above, heights, nearest)


def test_points_of_a_surface_lie_on_it(generator):
    positions, mesh = sphere()
    points, _ = bokashi.draw_points(positions, mesh, 500, seed=5)
    np.testing.assert_array_equal(points, bokashi.draw_points(positions, mesh, 500, seed=5)[0])
    assert abs(points - bokashi.draw_points(positions, mesh, 500, seed=6)[0]).max() > 0
    found = bokashi.nearest_on_surface(points, positions, mesh)
    assert found.distances.max() < 1e-12 and found.faces.max() < len(mesh)
    np.testing.assert_allclose(bokashi.sparse_product(positions, found.weights)[0], points, atol=1e-12)
    queries = np.concatenate([2 * points[:50], 0.3 * points[:50], generator.normal(size=(50, 3))])
    away = bokashi.nearest_on_surface(queries, positions, mesh)
    np.testing.assert_allclose(np.linalg.norm(queries - away.points, axis=1), away.distances)
    corners = positions[mesh.faces]
    np.testing.assert_allclose(away.distances, distances_to_faces(queries, corners).min(1), atol=1e-12)
    own = distances_to_faces(away.points, corners)[np.arange(len(queries)), away.faces]
    np.testing.assert_allclose(own, 0, atol=1e-7)
    assert bokashi.normal_consistency(positions, mesh, positions, mesh, 200) > 0.99
    assert bokashi.normal_consistency(positions, mesh, positions[:, ::-1] * [1, 1, 0.1], mesh, 200) < 0.95


def test_what_is_refused_says_the_rule_and_then_the_value():
    grid = bokashi.Grid((3, 3, 3), (0, 0, 0), 1.0)
    field, bad = np.ones(27), np.array([[np.nan, 0, 0]] * 4)
    flat = bokashi.Mesh(np.array([[0, 0, 1]]), 4)
    refused = bokashi.RenderError
    for wrong, error, message in [
        (lambda: bokashi.Grid((1, 2, 2), (0, 0, 0), 1.0), refused, "at least 2 points"),
        (lambda: bokashi.Grid((1 << 20, 1 << 20, 1 << 40), (0, 0, 0), 1.0), refused, "fewer than 2\\^31"),
        (lambda: bokashi.Grid((2, 2, 2), (0, 0, np.inf), 1.0), refused, "finite points"),
        (lambda: bokashi.Grid((2, 2, 2), (0, 0, 0), 0.0), refused, "positive spacing"),
        (lambda: bokashi.Grid((2, 2, -1), (0, 0, 0), 1.0), OverflowError, "negative"),
        (lambda: bokashi.Grid.around([0, 0, 0], [0, 0, 0], 4), refused, "a grid needs"),
        (lambda: bokashi.Grid.around([0, 0, 0], [1, 1, 1], 0), refused, "a grid needs"),
        (lambda: bokashi.field_surface(field[1:], grid), refused, "\\[3, 3, 3\\] or \\[27\\], got shape \\[26\\]"),
        (lambda: bokashi.field_surface(field * np.nan, grid), refused, "a field needs to be finite, got NaN"),
        (lambda: bokashi.field_surface(field, grid, np.ones((3, 3, 3))), refused, "offsets of shape \\[27, 3\\]"),
        (lambda: bokashi.field_surface(field, grid, np.ones((27, 3), np.float32)), TypeError, "one type"),
        (lambda: bokashi.chamfer_distance(NONE, CORNERS), refused, "chamfer_distance"),
        (lambda: bokashi.chamfer_distance(bad, CORNERS), refused, "NaN"),
        (lambda: bokashi.draw_points(CORNERS, flat, 3), refused, "needs a face with an area, got none among 1"),
        (lambda: bokashi.draw_points(CORNERS[:3], TETRAHEDRON, 3), refused, "draw_points"),
        (lambda: bokashi.draw_points(bad, TETRAHEDRON, 3), refused, "NaN"),
        (lambda: bokashi.draw_points(CORNERS, TETRAHEDRON, 1 << 62), refused, "fewer than 2\\^31 points"),
        (lambda: bokashi.draw_points(CORNERS, TETRAHEDRON, -1), OverflowError, "negative"),
        (lambda: bokashi.remesh(CORNERS, TETRAHEDRON, 0.0), refused, "lengths above 0, got 0"),
        (lambda: bokashi.remesh(CORNERS, TETRAHEDRON, np.nan), refused, "lengths above 0, got NaN"),
        (lambda: bokashi.remesh(CORNERS, TETRAHEDRON, [1.0, 2.0]), refused, "each of the 4 vertices, got 2"),
        (lambda: bokashi.remesh(CORNERS, TETRAHEDRON, np.ones((4, 1))), ValueError, "got shape \\[4, 1\\]"),
        (lambda: bokashi.remesh(bad, TETRAHEDRON, 1.0), refused, "finite numbers in row 0 of the positions, got NaN"),
        (lambda: bokashi.remesh(CORNERS > 0, TETRAHEDRON, 1.0), TypeError, "float32 or float64, got bool"),
        (lambda: bokashi.subdivide(CORNERS, TETRAHEDRON, "butterfly"), ValueError, "midpoint or loop, got \"butterfly\""),
        (lambda: bokashi.subdivide(CORNERS[:2], TETRAHEDRON), refused, "\\[2, 3\\]"),
        (lambda: bokashi.smooth(CORNERS, TETRAHEDRON, 1, shrink=1.5), refused, "from 0 to 1, got 1.5"),
        (lambda: bokashi.smooth(CORNERS.astype(np.float32), TETRAHEDRON, 900, shrink=0.0, swell=1.0), refused, "finite"),
        (lambda: bokashi.surface_area(bad, TETRAHEDRON), refused, "NaN"),
        (lambda: bokashi.signed_volume(CORNERS.T, TETRAHEDRON), refused, "\\[3, 4\\]"),
        (lambda: bokashi.surface_area(bokashi.Dual(CORNERS, CORNERS), TETRAHEDRON), TypeError, "tangent"),
        (lambda: bokashi.self_intersections(bad, TETRAHEDRON), refused, "NaN"),
        (lambda: bokashi.nearest_points(CORNERS, NONE), refused, "nearest_points"),
        (lambda: bokashi.nearest_points(CORNERS[:, :2], CORNERS), refused, "\\[4, 2\\]"),
        (lambda: bokashi.nearest_on_surface(CORNERS, NONE, NOTHING), refused, "a mesh with faces, got none"),
        (lambda: bokashi.f_score(CORNERS, CORNERS, -1.0), refused, "a threshold from 0 up, got -1"),
        (lambda: bokashi.normal_consistency(CORNERS, TETRAHEDRON, CORNERS, flat, 9), refused, "area"),
        (lambda: bokashi.normal_consistency(CORNERS, TETRAHEDRON, CORNERS, TETRAHEDRON, 0), refused, "points from 1 up"),
    ]:
        with pytest.raises(error, match=message):
            wrong()


def test_what_is_empty_has_a_result():
    grid = bokashi.Grid((2, 2, 2), (0, 0, 0), 1.0)
    (positions, mesh), pull_back = bokashi.field_surface(np.ones((2, 2, 2)), grid)
    assert positions.shape == (0, 3) and len(mesh) == 0
    assert all(bar is None or not bar.any() for bar in pull_back(positions))
    assert bokashi.draw_points(CORNERS, TETRAHEDRON, 0)[0].shape == (0, 3)
    for made in (bokashi.remesh(NONE, NOTHING, 1.0), bokashi.subdivide(NONE, NOTHING)):
        assert made.positions.shape == (0, 3) and len(made.mesh) == 0 and made.weights.shape == (0, 0)
    assert bokashi.smooth(NONE, NOTHING, 3).shape == (0, 3)
    assert bokashi.surface_area(NONE, NOTHING) == bokashi.signed_volume(NONE, NOTHING) == 0
    assert bokashi.self_intersections(NONE, NOTHING).shape == (0, 2)
    assert bokashi.Connectivity(NOTHING).part_of_face.shape == (0,)
    found = bokashi.nearest_on_surface(NONE, CORNERS, TETRAHEDRON)
    assert found.points.shape == (0, 3) and found.weights.shape == (0, 4)
    assert bokashi.nearest_points(NONE, CORNERS).indices.shape == (0,)


def test_bits_do_not_depend_on_threads(generator):
    results = []
    for threads in (1, 2, 4, None):
        bokashi.set_num_threads(threads)
        positions, mesh = sphere(40)
        points, _ = bokashi.draw_points(positions, mesh, 3000)
        made = bokashi.remesh(positions, mesh, 0.1)
        found = bokashi.nearest_on_surface(points, made.positions, made.mesh)
        arrays = [positions, mesh.faces, made.positions, made.mesh.faces, found.points, found.distances]
        results.append(b"".join(array.tobytes() for array in arrays))
    bokashi.set_num_threads(None)
    assert len(set(results)) == 1
