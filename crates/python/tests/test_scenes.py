"""Scenes in files, their fits, and pictures."""

import html
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import bokashi

HAND = Path(__file__).parents[3] / "examples" / "scenes" / "hand" / "scene.toml"

pytestmark = pytest.mark.skipif(not HAND.exists(), reason="the scene is not part of an sdist")


def test_a_scene_is_seen_and_learnt_to_the_same_bits(tmp_path):
    scene = bokashi.Scene.open(HAND)
    assert len(scene.views) == 3 and "hand.obj" in repr(scene.meshes.keys()) or scene.meshes
    picture = scene.render(scene.views[0])
    assert picture.ndim == 3 and picture.dtype == np.float32 and picture._repr_png_()[:4] == b"\x89PNG"
    heard = []
    fit = scene.fit(lambda fit: heard.append((fit.step, fit.loss)), steps=4)
    assert [step for step, _ in heard] == [1, 2, 3, 4] and [loss for _, loss in heard] == fit.losses
    assert fit.step == 4 and not fit.interrupted and fit.ended is None
    assert all(isinstance(value, np.ndarray) for value in fit.parameters.values()) and fit.parameters
    assert fit.score(0)["psnr"] > 5 and "&lt;svg" in fit._repr_html_()
    path = tmp_path / "fit.safetensors"
    fit.save(path)
    fit.run(steps=3)
    again = scene.fit(resume=path, steps=3)
    assert again.losses == fit.losses[4:]
    for name, value in fit.parameters.items():
        assert value.tobytes() == again.parameters[name].tobytes()
    names = again.save_results(tmp_path / "out")
    assert names and all((tmp_path / "out").iterdir())
    np.testing.assert_allclose(again.learnt().render(0), again.render(0), atol=1e-3)


def test_a_fit_of_a_scene_shows_scores_and_pictures_of_four_views_those_held_out_first(tmp_path):
    text = HAND.read_text().split("[[lights]]")
    head, *views = text[0].split("[[views]]\n")
    views += views[:2]
    named = [f'[[views]]\nname = "view {k}"\n{"held_out = true" if k in (2, 4) else ""}\n{view}' for k, view in enumerate(views)]
    path = shutil.copytree(HAND.parent, tmp_path / "hand") / "scene.toml"
    path.write_text("[[lights]]".join([head + "\n".join(named), *text[1:]]))
    fit = bokashi.Scene.open(path).fit(steps=2)
    page = html.unescape(re.search('srcdoc="([^"]*)"', fit._repr_html_())[1])
    (table,) = (table for table in page.split("<table>")[1:] if "PSNR" in table)
    rows = [re.split("<t[dh][^>]*>", row)[1:] for row in table.split("</table>")[0].split("<tr>")[2:]]
    assert [row[0] for row in rows] == ["view 2, held out", "view 4, held out", "view 0", "view 1"]
    for row, view in zip(rows, (2, 4, 0, 1)):
        score = fit.score(view)
        assert abs(float(row[1]) - score["psnr"]) < 0.06 and abs(float(row[2]) - score["ssim"]) < 0.0006
    assert page.count("data:image/png") == 8 and "view 3" not in page and "4 of 5 views." in page
    shown = [page.index(f"result of view {view}") for view in (2, 4, 0, 1)]
    assert shown == sorted(shown)


def test_a_callback_stops_a_fit_and_an_interruption_keeps_it():
    scene = bokashi.Scene.open(HAND)
    assert scene.fit(lambda fit: fit.step < 2).step == 2

    def interrupt(fit):
        if fit.step == 3:
            raise KeyboardInterrupt

    fit = scene.fit(interrupt)
    assert fit.interrupted and fit.step == 3 and len(fit.losses) == 3
    with pytest.raises(ZeroDivisionError):
        scene.fit(lambda fit: 1 / 0)


def test_an_interruption_just_after_a_step_keeps_its_loss():
    import sys

    def interrupted(run):
        """A fit that Ctrl-C stops the moment that its third step returns."""
        returned = []

        def hook(frame, event, function):
            if event == "c_return" and getattr(function, "__name__", "") == "step":
                returned.append(function)
                if len(returned) == 3:
                    sys.setprofile(None)
                    raise KeyboardInterrupt

        sys.setprofile(hook)
        try:
            return run()
        finally:
            sys.setprofile(None)

    def square(parameters):
        return float((parameters["x"] ** 2).sum()), {"x": 2 * parameters["x"]}

    scene = bokashi.Scene.open(HAND)
    for run in (lambda: scene.fit(steps=9), lambda: bokashi.fit(square, {"x": np.ones(3)}, steps=9)):
        fit = interrupted(run)
        assert fit.interrupted and fit.step == len(fit.losses) == len(fit.milliseconds) == 3
        fit.run(steps=2)
        assert not fit.interrupted and fit.step == len(fit.losses) == len(fit.milliseconds) == 5


def test_progress_is_written_to_the_standard_error(capsys):
    bokashi.Scene.open(HAND).fit(progress=True, steps=2)
    captured = capsys.readouterr()
    assert captured.out == "" and "2" in captured.err


def test_what_is_wrong_with_a_scene_is_said_with_its_place(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("[[views]]\nimage = 3\n")
    with pytest.raises(bokashi.SceneError, match="scene.toml"):
        bokashi.Scene.open(path)
    scene = bokashi.Scene.open(HAND)
    with pytest.raises(IndexError, match="below 3, got 3"):
        scene.render(3)
    with pytest.raises(KeyError, match="nobody"):
        scene.render("nobody")


def test_pictures_of_other_shapes_have_no_png():
    assert bokashi.Picture(np.zeros((2, 2)))._repr_png_() is None
    half = bokashi.Picture(np.full((2, 3, 3), 0.5))
    assert half.png()[:4] == b"\x89PNG"


def test_a_wrong_gradient_is_found():
    def cubes(x, y):
        return x**3 * y, lambda bar: (3 * x**2 * y * bar, x**3 * bar)

    def wrong(x, y):
        return x**3 * y, lambda bar: (3 * x**2 * y * bar, 1.0001 * x**3 * bar)

    x, y = np.array([0.3, -1.2]), np.array([2.0, 0.7])
    slopes = bokashi.check(cubes, x, y)
    assert len(slopes) == 6 and all(slope.error < 1e-6 for slope in slopes)
    with pytest.raises(AssertionError, match="input 1: the pull-back has slope"):
        bokashi.check(wrong, x, y)
    with pytest.raises(AssertionError, match="needs shape \\(2,\\), got \\(1,\\)"):
        bokashi.check(lambda x: (x, lambda bar: (bar[:1],)), x)
