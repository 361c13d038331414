"""Every script of the gallery, run from an empty folder; each asserts a number of its figure."""

import ast
import json
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
MAKE = runpy.run_path(str(DOCS / "gallery" / "make.py"))
SCRIPTS = MAKE["scripts"]()


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_a_script_draws_its_figure_and_checks_its_number(script: Path, tmp_path: Path) -> None:
    picture = MAKE["drawn"](script, tmp_path)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_a_script_has_something_that_can_fail(script: Path) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    checks = [node for node in ast.walk(tree) if isinstance(node, ast.Assert)]
    assert any(isinstance(part, ast.Compare) for check in checks for part in ast.walk(check.test))


def test_the_page_shows_every_script_and_its_picture() -> None:
    page = (DOCS / "use" / "gallery.md").read_text(encoding="utf-8")
    for script in SCRIPTS:
        assert f"](../figures/gallery/{script.stem}.png)" in page
        assert f"gallery/{script.name}\n" in page
        assert (DOCS / "figures" / "gallery" / f"{script.stem}.png").is_file()
    assert page.count("literalinclude") == len(SCRIPTS) >= 10


@pytest.mark.parametrize(
    "notebook", sorted((DOCS / "use").glob("*.ipynb")), ids=lambda path: path.stem
)
def test_a_notebook_is_kept_without_what_it_prints(notebook: Path) -> None:
    """The documentation runs it; stored answers would hide that it no longer gives them."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 4
    assert [cell["outputs"] for cell in code] == [[]] * len(code)
    assert any("assert " in "".join(cell["source"]) for cell in code)
