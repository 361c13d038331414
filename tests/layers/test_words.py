"""Docstring summaries are noun phrases or imperatives, module names and terms have one meaning."""

import re
from pathlib import Path

import pytest
from benchmarks.census import CLAUSES, clause_shares, summaries
from tests.layers.test_layers import SRC, TO_BE_REWRITTEN

ROOMS = sorted(path.name for path in SRC.iterdir() if any(path.glob("*.py")))
ROOT = SRC.parents[1]
FOLDERS = {room: SRC / room for room in ROOMS} | {"benchmarks": ROOT / "benchmarks"}
MOST = 2
"""Per cent of the summaries of a folder that may have a "what" or "where" clause."""
MOST_UNTIL_REWRITTEN = {"calibration": 31, "detection": 30, "machine": 22, "solver": 18}
"""The same of rooms whose texts are to be rewritten: only to be lowered."""

FACES = ("api", "cli", "figures", "web")
"""Packages that show results: a module of theirs has the name of what it shows."""

SAME_MEANING = {
    "export": "results as files",
    "features": "of a movement, as numbers; of what a detector judges by",
    "load": "a file as a record",
    "machines": "of a panel, defined and built",
    "records": "of a TOML document",
    "step": "of time",
    "throw": "of one machine, and its kernel",
    "validate": "a record against rules; a calibration against movements",
}
"""Modules that several packages have, and the one meaning of their name."""


def summaries_with_a_clause(folder: Path) -> str:
    """Return the summaries of a folder that have a clause, a line for each."""
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path in sorted(folder.rglob("*.py"))
        for line, text in summaries(path)
        if any(clause.search(text) for clause in CLAUSES.values())
    ]
    return "\n".join(found)


@pytest.mark.parametrize("name", FOLDERS)
def test_summaries_are_noun_phrases_or_imperatives(name: str) -> None:
    share = 100 * clause_shares(FOLDERS[name])["any"]
    most = MOST_UNTIL_REWRITTEN.get(name, MOST)
    text = f"{share:.1f} % of the summaries have a clause, at most {most} % may:"
    assert share <= most, f"{text}\n{summaries_with_a_clause(FOLDERS[name])}"


def test_only_rooms_to_be_rewritten_may_have_more_clauses() -> None:
    assert set(MOST_UNTIL_REWRITTEN) <= TO_BE_REWRITTEN <= set(ROOMS)


def test_clauses_are_counted_in_summaries_only(tmp_path: Path) -> None:
    texts = ('"""What it does."""', 'def f():\n    """Return it.\n\n    Where it is."""')
    (tmp_path / "one.py").write_text("\n\n".join(texts))
    assert clause_shares(tmp_path) == {"what": 0.5, "where": 0.0, "any": 0.5}


def test_a_module_name_has_one_meaning(pytestconfig: pytest.Config) -> None:
    root = pytestconfig.rootpath / "src" / "turnout"
    found: dict[str, list[str]] = {}
    for path in sorted(root.rglob("*.py")):
        folder = path.parent.relative_to(root).as_posix()
        if path.stem != "__init__" and not folder.startswith(FACES):
            found.setdefault(path.stem, []).append(folder)
    several = {name: folders for name, folders in found.items() if len(folders) > 1}
    assert not set(several) - set(SAME_MEANING), f"rename, or add to SAME_MEANING: {several}"


def test_the_glossary_holds_each_term_once(pytestconfig: pytest.Config) -> None:
    text = (pytestconfig.rootpath / "docs" / "use" / "glossary.md").read_text(encoding="utf-8")
    terms, _, translated = text.partition("## In Swedish and German")
    for part in (terms, translated):
        rows = re.findall(r"^\| ([^|]+?) \|", part, flags=re.MULTILINE)
        names = [name for name in rows if name not in ("name", "English") and "---" not in name]
        assert sorted(names) == sorted(set(names))
