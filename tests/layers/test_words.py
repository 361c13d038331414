"""Texts use the field's terms: words that readers stumbled over stay out.

Read are string literals, docstrings and comments of the packages in `PACKAGES`, the studio's page,
and documentation. A package enters `PACKAGES` once its texts have been reworded; pages that have
not been are in `PAGES_REMAINING`. The names of functions, classes and
modules are read too.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

FOLDERS = ("src/turnout", "tests", "benchmarks", "bin")

WORDS = {
    r"told|tells?|telling": "says, shows, identifies, detects",
    r"anew": "again",
    r"whoever|whosoever": "who",
    r"books?": "energy balance, energy residual",
    r"the card": "data card",
    r"leads? astray|astray": "is misleading",
    r"lets? pass|asks? nobody|nobody": "is accepted, runs locally, no one",
    r"what decides|decides? over": "sensitivity",
    r"for want of": "without",
    r"held up": "blocked",
    r"goes on from there|the same command goes on": "run the same command to continue",
    r"by itself": "alone, on its own",
    r"mistaken for": "strongly correlated",
    r"as yet|thereby|hence|in its stead": "plain English",
    r"to be trusted": "trustworthy",
    r"asked for": "requested",
    r"comes? home": "closes",
    r"how sure": "uncertainty",
    r"warned? of": "warn about",
    r"made ready|goes without": "prepare",
    r"look(?:ed)? at": "see, check",
    r"speaks? against": "reason",
    r"never had room": "does not fit",
}
PATTERN = re.compile(rf"\b(?:{'|'.join(WORDS)})\b", re.IGNORECASE)

EXCEPTIONS: dict[str, str] = {}


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of literals, docstrings and comments of a Python file."""
    source = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a page, without code and addresses of links."""
    code = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        code ^= line.lstrip().startswith("```")
        yield number, "" if code else re.sub(r"`[^`]*`|\]\([^)]*\)", "", line)


def found_words(texts: Iterator[tuple[int, str]]) -> list[str]:
    """Return line and word of every listed word."""
    return [
        f"{number}: {match[0]}"
        for number, text in texts
        if text not in EXCEPTIONS
        for match in PATTERN.finditer(text)
    ]


def _files(root: Path) -> Iterator[tuple[Path, Iterator[tuple[int, str]]]]:
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*.py")):
            if path != Path(__file__):
                yield path, _texts(path)
    for path in sorted((root / "src" / "turnout" / "web" / "page").glob("*.[jh][st]*")):
        yield path, _lines(path)
    for path in [root / "README.md", *sorted((root / "docs").rglob("*.md"))]:
        if not path.relative_to(root).as_posix().startswith("docs/_build"):
            yield path, _lines(path)


def test_texts_use_standard_terms(pytestconfig: pytest.Config) -> None:
    root = pytestconfig.rootpath
    problems = [
        f"{path.relative_to(root)}:{text}"
        for path, texts in _files(root)
        for text in found_words(texts)
    ]
    assert not problems, "use the terms of WORDS:\n" + "\n".join(problems)


FACES = ("api", "cli", "figures", "web")
"""Packages that show results: a module of theirs has the name of what it shows."""

SAME_MEANING = {
    "export": "results as files",
    "features": "of a movement, as numbers; of what a detector judges by",
    "labels": "of a throw; of the throws of a sweep",
    "load": "a file as a record",
    "machines": "of a panel, defined and built",
    "records": "of a TOML document",
    "step": "of time",
    "throw": "of one machine, and its kernel",
    "validate": "a record against rules; a calibration against movements",
}
"""Modules that several packages have, and the one meaning of their name."""

DICTION = ("told", "anew", "settled", "forget", "kilo", "milli", "nobody", "whoever", "squeezed")
"""Words that are no part of a name."""


def _defined(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of the functions, classes and parameters of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg


def test_names_use_standard_terms(pytestconfig: pytest.Config) -> None:
    root = pytestconfig.rootpath
    problems = [
        f"{path.relative_to(root)}:{line}: {name}"
        for folder in FOLDERS
        for path in sorted((root / folder).rglob("*.py"))
        for line, name in _defined(path)
        if set(name.lower().split("_")) & set(DICTION)
    ]
    assert not problems, "\n".join(problems)


def test_a_module_name_has_one_meaning(pytestconfig: pytest.Config) -> None:
    root = pytestconfig.rootpath / "src" / "turnout"
    found: dict[str, list[str]] = {}
    for path in sorted(root.rglob("*.py")):
        folder = path.parent.relative_to(root).as_posix()
        if path.stem != "__init__" and not folder.startswith(FACES):
            found.setdefault(path.stem, []).append(folder)
    several = {name: folders for name, folders in found.items() if len(folders) > 1}
    assert not set(several) - set(SAME_MEANING), f"rename, or add to SAME_MEANING: {several}"


@pytest.mark.parametrize("text", ["Told by the data", "books close to 2e-11", "what decides"])
def test_the_list_finds_what_it_should(text: str) -> None:
    assert found_words(iter([(1, text)]))


def test_the_glossary_holds_each_term_once(pytestconfig: pytest.Config) -> None:
    text = (pytestconfig.rootpath / "docs" / "use" / "glossary.md").read_text(encoding="utf-8")
    terms, _, translated = text.partition("## In Swedish and German")
    for part in (terms, translated):
        rows = re.findall(r"^\| ([^|]+?) \|", part, flags=re.MULTILINE)
        names = [name for name in rows if name not in ("name", "English") and "---" not in name]
        assert sorted(names) == sorted(set(names))
