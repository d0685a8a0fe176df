"""The notebook's cells run."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).resolve().parents[1] / "notebooks" / "tour.ipynb"


@pytest.mark.skipif(not NOTEBOOK.exists(), reason="the notebook is not part of an sdist")
def test_the_cells_of_the_notebook_run_and_find_what_they_say():
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    programs = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    names, said = {}, io.StringIO()
    with contextlib.redirect_stdout(said):
        for number, program in enumerate(programs):
            exec(compile(program, f"cell {number} of {NOTEBOOK.name}", "exec"), names)
    assert len(programs) > 4 and said.getvalue().count("off by") == 5
    assert names["error"] < 1e-3 and names["degrees"] < 1e-2
    assert np.sqrt(np.mean((names["seen"] - names["target"]) ** 2)) < 1e-2
    assert "&lt;svg" in names["cube"]._repr_html_()
