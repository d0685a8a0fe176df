import numpy as np
import pytest

import bokashi


@pytest.fixture
def generator():
    return np.random.default_rng(7)


def scene(generator, dtype=np.float64):
    """Three faces in perspective, one behind another, that share an edge."""
    faces = np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6]])
    ndc = np.array(
        [[-0.7, -0.6, 0.1], [0.6, -0.7, 0.3], [-0.4, 0.7, -0.2], [0.8, 0.6, 0.4], [-0.9, 0.2, 0.6], [0.3, -0.8, 0.5], [0.5, 0.9, 0.7]]
    )
    ndc[:, :2] += generator.uniform(-0.05, 0.05, (7, 2))
    w = generator.uniform(0.8, 1.6, (7, 1))
    clip = np.concatenate([ndc * w, w], 1).astype(dtype)
    return bokashi.Mesh(faces, 7), clip


def check_gradients(function, arrays, generator):
    """The pull-back against difference quotients; then tangents of one run against the pull-back."""
    bokashi.check(function, *arrays, seed=int(generator.integers(1 << 30)))
    check_tangents(function, arrays, generator)


def check_tangents(function, arrays, generator):
    """`<u, J v> = <J^T u, v>`."""
    value, pull_back = function(*arrays)
    moves = [generator.normal(size=np.shape(array)) for array in arrays]
    again, moved = bokashi.jvp(function, arrays, moves)
    np.testing.assert_allclose(again, value, rtol=1e-12, atol=1e-12)
    upstream = generator.normal(size=np.shape(value))
    pulled = [bar for bar in pull_back(upstream)][: len(arrays)]
    terms = [upstream * moved, *(move * (0.0 if bar is None else bar) for bar, move in zip(pulled, moves))]
    size = sum(float(abs(term).sum()) for term in terms)
    assert abs(terms[0].sum() - sum(float(term.sum()) for term in terms[1:])) <= 1e-9 * size
