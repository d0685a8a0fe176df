"""Levels of textures, and constant textures."""

import copy
import pickle

import numpy as np
import pytest

import bokashi


def inputs(generator, dtype=np.float64):
    texels = generator.uniform(size=(12, 20, 3)).astype(dtype)
    cube = generator.uniform(size=(6, 8, 8, 2)).astype(dtype)
    uv = generator.uniform(-0.5, 1.5, (30, 2)).astype(dtype)
    towards = generator.normal(size=(30, 3)).astype(dtype)
    return texels, cube, uv, towards


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_texture_that_stays_is_sampled_to_the_same_bits(generator, dtype):
    texels, cube, uv, towards = inputs(generator, dtype)
    slopes = generator.normal(0, 0.1, (30, 2, 2)).astype(dtype)
    texture, cube_map = bokashi.Texture(texels), bokashi.Texture(cube)
    assert len(texture) == 5 and texture.shape == (12, 20, 3) and len(cube_map) == 4
    for options in ({}, {"level": 1.3}, {"differentials": slopes, "bias": 0.2, "filter": "anisotropic"}):
        expected, expected_pull = bokashi.sample_texture(texels, uv, **options)
        found, pull_back = bokashi.sample_texture(texture, uv, **options)
        assert found.tobytes() == expected.tobytes()
        bar = generator.normal(size=found.shape).astype(dtype)
        bars = pull_back(bar)
        assert len(bars) == 4
        for own, other in zip(bars, expected_pull(bar)):
            assert (own is None) == (other is None) and (own is None or own.tobytes() == other.tobytes())
    expected, _ = bokashi.sample_cube_map(cube, towards, level=0.7)
    found, _ = bokashi.sample_cube_map(cube_map, towards, level=0.7)
    assert found.tobytes() == expected.tobytes()
    own, _ = bokashi.mipmaps(texels)
    for level, other in zip(texture.levels[1:], own):
        assert level.tobytes() == other.tobytes()


def test_textures_are_copied_and_can_be_pickled(generator):
    texels, *_ = inputs(generator)
    before, middle = texels.copy(), np.full((1, 2), 0.5)
    texture, finest = bokashi.Texture(texels), bokashi.Texture(texels, coarsest=0)
    assert texture.holds([texels]) and finest.holds([texels]) and texture.holds(texture.levels)
    assert not finest.holds(texture.levels) and not texture.holds([texels.astype(np.float32)])
    expected, _ = bokashi.sample_texture(texture, middle, level=2.0)
    texels[3, 4, 1] = np.nextafter(texels[3, 4, 1], 2)
    assert not texture.holds([texels]) and texture.holds([before]) and not texture.holds([before[:-1]])
    for other in (copy.copy(texture), copy.deepcopy(texture), pickle.loads(pickle.dumps(texture))):
        assert len(other) == len(texture)
        assert bokashi.sample_texture(other, middle, level=2.0)[0].tobytes() == expected.tobytes()
    assert len(pickle.loads(pickle.dumps(finest))) == 1
    zeros = np.zeros((2, 2, 1))
    assert not bokashi.Texture(zeros).holds([-zeros])
    nothing = np.full((2, 2, 1), np.nan)
    assert bokashi.Texture(nothing).holds([nothing])


def test_levels_end_at_the_coarsest_and_its_gradients_are_those_of_all(generator):
    texels, cube, uv, _ = inputs(generator)
    slopes = generator.normal(0, 0.2, (30, 2, 2))
    for coarsest in (0, 1, 2, 3, 9):
        assert len(bokashi.mipmaps(texels, coarsest)[0]) == min(coarsest, 4)
        assert len(bokashi.mipmaps(cube, coarsest)[0]) == min(coarsest, 3)
        few, of_few = bokashi.sample_texture(texels, uv, differentials=slopes, coarsest=coarsest)
        mips, _ = bokashi.mipmaps(texels)
        all_of_them, _ = bokashi.sample_texture(texels, uv, differentials=slopes, coarsest=coarsest, mips=mips)
        assert few.tobytes() == all_of_them.tobytes()
        assert len(bokashi.Texture(texels, coarsest=coarsest)) == 1 + min(coarsest, 4)
        bokashi.check(
            lambda texels: (
                lambda value, pull: (value, lambda bar: (pull(bar)[4],))
            )(*bokashi.sample_texture(texels, uv, level=0.3, coarsest=coarsest)), texels,
        )


def test_what_would_be_ignored_is_refused(generator):
    texels, cube, uv, towards = inputs(generator)
    mips, _ = bokashi.mipmaps(texels)
    texture, cube_map = bokashi.Texture(texels), bokashi.Texture(cube)
    for wrong, error, message in [
        (lambda: bokashi.sample_texture(texels, uv, mips=mips), bokashi.RenderError, "needs a level or differentials, got neither"),
        (lambda: bokashi.sample_texture(texture, uv, mips=mips, level=1.0), bokashi.RenderError, "levels of its own"),
        (lambda: bokashi.Texture(texels, mips=mips, coarsest=2), bokashi.RenderError, "got both"),
        (lambda: bokashi.Texture(texels, mips=mips[1:]), bokashi.RenderError, "a level 1 of shape \\[6, 10, 3\\]"),
        (lambda: bokashi.Texture(texels[0]), bokashi.RenderError, "texels of shape \\[H, W, C\\]"),
        (lambda: bokashi.Texture(texels[:0]), bokashi.RenderError, "at least one entry"),
        (lambda: bokashi.Texture(texels, mips=[level.astype(np.float32) for level in mips]), TypeError, "arrays of one type"),
        (lambda: bokashi.Texture([[[1.0]]]), TypeError, "got list"),
        (lambda: bokashi.sample_texture(texture, uv.astype(np.float32)), TypeError, "of another beside float32"),
        (lambda: bokashi.sample_texture(cube_map, uv), bokashi.RenderError, "got a cube map"),
        (lambda: bokashi.sample_cube_map(texture, towards), bokashi.RenderError, "got one of texels \\[H, W, C\\]"),
    ]:
        with pytest.raises(error, match=message):
            wrong()
    # An empty list of mips is none.
    assert bokashi.sample_texture(texels, uv, mips=[])[0].shape == (30, 3)
