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
