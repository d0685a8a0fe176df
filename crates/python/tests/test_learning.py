"""Fits of functions of one's own."""

import numpy as np
import pytest

import bokashi
from conftest import scene


def test_a_pipeline_of_operations_is_learnt(generator):
    mesh, clip = scene(generator)
    colors, sky = generator.uniform(0.2, 0.8, (7, 3)), np.array([0.1, 0.2, 0.3])
    reference, _ = bokashi.render(clip, mesh, colors, 24, background=sky)

    def loss(parameters):
        clip, colors = parameters["clip"], parameters["colors"]
        value, pull_back = bokashi.render(clip, mesh, colors, 24, background=sky, reference=reference)
        clip_bar, _, colors_bar, *_ = pull_back(np.ones(()))
        return float(value), {"clip": clip_bar, "colors": colors_bar}

    start = {
        "clip": bokashi.Parameter(clip + generator.normal(0, 0.02, clip.shape), rate=2e-3),
        "colors": bokashi.Parameter(np.full((7, 3), 0.5), rate=3e-2, mapping="sigmoid"),
    }
    heard = []
    learning = bokashi.fit(loss, start, steps=400, cosine=True, callback=lambda fit: heard.append(fit.parameters["clip"]))
    assert learning.losses[0] > 1 and learning.loss < 1e-3 * learning.losses[0]
    assert learning.step == learning.steps == len(heard) == 400 and learning.ended == "its steps are done"
    assert ((learning.parameters["colors"] > 0) & (learning.parameters["colors"] < 1)).all()
    shown = learning._repr_html_()
    assert "&lt;svg" in shown and "colors" in shown and "[7, 3]" in shown
    again = bokashi.fit(loss, start, steps=400, cosine=True)
    assert again.losses == learning.losses


def test_rules_stop_a_fit_and_errors_are_those_of_the_function():
    def square(parameters):
        x = parameters["x"]
        return float((x**2).sum()), {"x": 2 * x}

    x = np.ones(3, np.float32)
    fit = bokashi.fit(square, {"x": bokashi.Parameter(x, rate=0.1)}, steps=1000, loss_below=1e-2)
    assert fit.ended == "the loss fell below the limit" and fit.loss < 1 and fit.step < 1000
    assert fit.parameters["x"].dtype == np.float32
    still = bokashi.fit(lambda p: (1.0, {"x": np.zeros(3, np.float32)}), {"x": x}, patience=5)
    assert still.ended == "the loss found no new minimum"
    assert bokashi.fit(square, {"x": x}, callback=lambda fit: fit.step < 3).step == 3
    for wrong, error, message in [
        (lambda: bokashi.fit(lambda p: 1 / 0, {"x": x}), ZeroDivisionError, "division"),
        (lambda: bokashi.fit(lambda p: (0.0, {"y": x}), {"x": x}), ValueError, "names of parameters"),
        (lambda: bokashi.fit(lambda p: (0.0, {"x": x[:2]}), {"x": x}), ValueError, 'of "x" needs shape \\[3\\], got \\[2\\]'),
        (lambda: bokashi.fit(lambda p: (np.nan, {"x": x}), {"x": x}), ValueError, "finite"),
        (lambda: bokashi.fit(square, {}), ValueError, "at least one parameter"),
        (lambda: bokashi.fit(square, {"x": bokashi.Parameter(x, mapping="log")}), ValueError, "mapping needs to be"),
    ]:
        with pytest.raises(error, match=message):
            wrong()


def test_a_fit_that_is_asked_from_its_pipeline_answers_or_refuses():
    found = []

    def square(parameters):
        if found:
            assert found[0].step == len(found) and f"{len(found)} of 2" in repr(found[0])
            with pytest.raises(RuntimeError, match="between two steps"):
                found[0].parameters
            with pytest.raises(RuntimeError, match="one step at a time"):
                found[0].run()
        return float((parameters["x"] ** 2).sum()), {"x": 2 * parameters["x"]}

    fit = bokashi.fit(square, {"x": np.ones(2)}, steps=2, callback=found.append)
    assert fit is found[0] and fit.step == 2 and fit.parameters["x"].shape == (2,)


def test_threads_are_refused_while_a_step_is_under_way_and_the_fit_goes_on_after_errors():
    import threading

    refusals = []

    def square(parameters):
        def ask():
            for question in (lambda: fit.run(steps=1), lambda: fit.parameters):
                try:
                    question()
                except RuntimeError as error:
                    refusals.append(str(error))

        if fit.step == 1 and len(refusals) < 2:
            thread = threading.Thread(target=ask)
            thread.start()
            thread.join(30)
            assert not thread.is_alive()
            raise ZeroDivisionError
        return float((parameters["x"] ** 2).sum()), {"x": 2 * parameters["x"]}

    fit = bokashi.fit(lambda parameters: (1.0, {}), {"x": np.ones(2)}, steps=5, callback=lambda fit: False)
    fit.pipeline = square
    try:
        fit.run()
    except ZeroDivisionError:
        pass
    assert len(refusals) == 2 and "one step at a time" in refusals[0] and "between two steps" in refusals[1]
    assert fit.step == 1 and fit.parameters["x"].shape == (2,)
    fit.run()
    assert fit.step == len(fit.losses) == 5 and fit.ended == "its steps are done"
