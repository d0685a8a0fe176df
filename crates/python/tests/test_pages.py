"""The programs of the pages about Python run."""

from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.mark.parametrize("page", ["python.md", "from-nvdiffrast.md", "from-pytorch3d-and-mitsuba.md"])
def test_the_programs_of_a_page_run(page):
    if not (DOCS / page).exists():
        pytest.skip("the pages are not in a source distribution")
    programs = [block.split("```")[0] for block in (DOCS / page).read_text().split("```python\n")[1:]]
    assert programs
    names = {}
    absent = []
    for program in programs:
        try:
            exec(compile(program, page, "exec"), names)
        except ModuleNotFoundError as error:
            # Later programs build on earlier ones; those of other libraries do not.
            absent.append(error.name)
        except NameError:
            assert absent
    if absent:
        pytest.skip(f"some need {', '.join(absent)}")
