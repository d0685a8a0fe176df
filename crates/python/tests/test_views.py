"""What notebooks show."""

import html
import re

import numpy as np
import pytest

import bokashi
from conftest import scene


def test_a_mesh_is_shown_as_a_page_in_a_frame(generator, tmp_path):
    mesh, clip = scene(generator)
    positions, colors = clip[:, :3], generator.uniform(size=(7, 3))
    shown = bokashi.View(positions, mesh, colors, caption="three <faces>")
    frame = shown._repr_html_()
    assert re.fullmatch('<iframe title="[^"<>]*" srcdoc="[^"<>]*" onload="[^"<>]*" style="[^"<>]*"></iframe>', frame)
    page = html.unescape(re.search('srcdoc="([^"]*)"', frame)[1])
    assert page.startswith("<!doctype html>") and "bokashiViewer" in page and "three &lt;faces&gt;" in page
    assert "http" not in page.replace("http://www.w3.org", "") and "View(Mesh(3 faces" in repr(shown)
    shown.save(tmp_path / "view.html")
    assert frame in (tmp_path / "view.html").read_text(encoding="utf-8")
    for other in (None, colors[:, :1], colors.astype(np.float32), np.full((7, 3), np.nan)):
        assert "srcdoc" in bokashi.View(positions.astype(np.float32), mesh, other)._repr_html_()
    nothing = bokashi.View(np.zeros((0, 3)), bokashi.Mesh(np.zeros((0, 3), int), 0))
    assert "srcdoc" in nothing._repr_html_()


def test_what_is_no_mesh_is_refused(generator):
    mesh, clip = scene(generator)
    positions = clip[:, :3]
    broken = positions.copy()
    broken[4, 1] = np.inf
    for wrong, message in [
        (lambda: bokashi.View(clip, mesh), "positions of a view need shape \\[V, 3\\], got \\[7, 4\\]"),
        (lambda: bokashi.View(positions[:6], mesh), "a position for each of 7 vertices, got 6"),
        (lambda: bokashi.View(broken, mesh), "finite, got .* at vertex 4"),
        (lambda: bokashi.View(positions, mesh, np.ones((6, 3))), "7 vertices have 6"),
        (lambda: bokashi.View(positions, mesh, np.ones((7, 2))), "colors of a view need shape"),
    ]:
        with pytest.raises(bokashi.RenderError, match=message):
            wrong()


def test_a_fit_is_shown_however_its_losses_are():
    def losses(values):
        left = iter(values)
        return bokashi.fit(lambda p: (next(left), {"x": np.zeros(2)}), {"x": np.ones(2)}, steps=len(values) - 1)

    for values in ([1.0, 0.5, 0.1], [1.0, 0.0, -1.0], [2.0] * 5, list(np.geomspace(1, 1e-9, 1500)), [1.0, 1.0]):
        fit = losses(values)
        page = html.unescape(re.search('srcdoc="([^"]*)"', fit._repr_html_())[1])
        assert ("<svg" in page) == (len(fit.losses) > 1) and "NaN" not in page and "[2]" in page
        assert len(page) < 100_000


def test_numbers_of_a_fit_are_shown_with_three_digits():
    start = {"few": np.array([3e-5, 1.2e9, 0.5, 12.34, 0.0, -7e-9]), "many": np.geomspace(4e-6, 7e8, 9)}
    fit = bokashi.fit(lambda p: (1.0, {}), start, steps=1)
    page = html.unescape(re.search('srcdoc="([^"]*)"', fit._repr_html_())[1])
    assert "3.0e-5, 1.2e9, 0.500, 12.3, 0, -7.0e-9" in page and "4.0e-6 to 7.0e8" in page
