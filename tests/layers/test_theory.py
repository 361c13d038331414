"""The theory manual names files, tests and pages that exist, and every page names some."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EQUATIONS = ROOT / "docs" / "equations.py"
PAGES = sorted((ROOT / "docs" / "theory").glob("*.md"))
SUBJECTS = [page for page in PAGES if page.name != "index.md"]
NAMED = re.compile(r"`((?:src|tests|benchmarks|docs)/[\w./-]+)(?:::(\w+))?`")
LEAST_PAGES = 10
"""A folder that is not found would make all of these tests pass on nothing."""


def named(page: Path) -> list[tuple[str, str]]:
    """Return the paths that a page names, each with a function of it or an empty text."""
    return NAMED.findall(page.read_text(encoding="utf-8"))


def test_there_is_a_manual() -> None:
    assert len(SUBJECTS) >= LEAST_PAGES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_and_tests_that_a_page_names_exist(page: Path) -> None:
    lacking = []
    for path, function in named(page):
        file = ROOT / path
        if not file.exists() or (function and f"def {function}(" not in file.read_text("utf-8")):
            lacking.append(f"{path}::{function}" if function else path)
    assert lacking == []


@pytest.mark.parametrize("page", SUBJECTS, ids=lambda page: page.stem)
def test_a_page_says_where_its_subject_lives_and_what_verifies_it(page: Path) -> None:
    paths = [path for path, _ in named(page)]
    assert any(path.startswith("src/turnout/") for path in paths)
    assert any(path.startswith("tests/") and path.endswith(".py") for path in paths)
    text = page.read_text(encoding="utf-8")
    assert [title for title in ("## Not modelled", "## References") if title not in text] == []


@pytest.mark.parametrize("page", SUBJECTS, ids=lambda page: page.stem)
def test_the_table_of_subjects_leads_to_every_page(page: Path) -> None:
    table = (ROOT / "docs" / "theory" / "index.md").read_text(encoding="utf-8")
    assert f"]({page.name})" in table


@pytest.mark.parametrize(
    ("equation", "shown"),
    [
        (r"\dot u_C^2", "<msubsup><mover><mi>u</mi>"),
        (r"\lVert r\rVert^2", 'stretchy="false" form="postfix">‖</mo><mn>2</mn>'),
        (r"\boldsymbol t = v", '<mi class="boldsymbol">t</mi><mo>=</mo><mi>v</mi>'),
        (r"k\ln n", '<mi>k</mi><mspace width="0.1667em" /><mi>ln</mi><mspace'),
    ],
)
def test_an_equation_is_written_as_tex_shows_it(equation: str, shown: str) -> None:
    pytest.importorskip("sphinx")
    assert shown in runpy.run_path(str(EQUATIONS))["mathml"](equation, block=False)


def test_a_fraction_without_braces_is_refused() -> None:
    """Its digits would be read as one number, and the equation shown would be another one."""
    pytest.importorskip("sphinx")
    with pytest.raises(ValueError, match="in braces"):
        runpy.run_path(str(EQUATIONS))["mathml"](r"\tfrac12 x", block=True)
