"""Lines of each feature and its readers: python -m benchmarks.features [--write].

`features.toml` says which files, names and sections a feature has; a file of several is split
evenly. Lines are of code in Python, else neither empty nor a comment; they are rounded to tens.
A feature needs another if a file of it imports one of the other's; commands, the Python interface
and what is shared by all of a room are left out, as they show features and have none of their own.
"""

import argparse
import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from pathlib import Path

from benchmarks import census, page

ROOT = Path(__file__).parents[1]
FOLDERS = {"src": ROOT / "src/turnout", "tests": ROOT / "tests", "docs": ROOT / "docs"}
LEFT_OUT = {"vendor", "_build", "__pycache__", "project"}
SUFFIXES = {".py", ".toml", ".js", ".css", ".html", ".md"}

Unit = tuple[Path, str]
"""A file and the pattern of names or the heading in it; an empty one is all that is left of it."""
Owners = dict[Unit, list[str]]
Table = dict[str, dict[str, dict[str, str]]]


@cache
def code_lines(path: Path) -> frozenset[int]:
    """Return the numbers of the lines of a file that count."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        documented = census.docstring_lines(ast.parse(text))
        return frozenset(
            line
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type not in census.NOT_CODE
            for line in range(token.start[0], token.end[0] + 1)
            if line not in documented
        )
    mark = {".toml": "#", ".js": "//"}.get(path.suffix)
    return frozenset(
        number
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not (mark and line.strip().startswith(mark))
    )


@cache
def part_lines(unit: Unit) -> frozenset[int]:
    """Return the lines that count of the names or the section of a unit."""
    path, part = unit
    if path.suffix == ".py":
        spans = [
            range(node.lineno, (node.end_lineno or node.lineno) + 1)
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and re.fullmatch(part, node.name)
        ]
        found = {line for span in spans for line in span}
    else:
        lines = path.read_text(encoding="utf-8").splitlines()
        start = next(n for n, line in enumerate(lines) if line.lstrip("#").strip() == part)
        deep = len(lines[start]) - len(lines[start].lstrip("#"))
        ends = (n for n in range(start + 1, len(lines)) if re.match(f"#{{1,{deep}}} ", lines[n]))
        found = {*range(start + 1, next(ends, len(lines)) + 1)}
    return code_lines(path) & found


def units(cell: str, kind: str) -> Iterator[tuple[Unit, bool]]:
    """Yield the units that a cell of the table of features names, and if by a pattern of files."""
    for item in filter(None, re.split(r", (?=[\w*/-]+(?:\.|/\*))", cell)):
        pattern, _, part = item.partition("::" if "::" in item else "#")
        paths = sorted(path for path in FOLDERS[kind].glob(pattern) if path.is_file())
        if not paths or (part and not part_lines((paths[0], part))):
            print(f"features.toml: {kind} has no {item}", file=sys.stderr)
        yield from (((path, part), "*" in pattern) for path in paths)


def owners(table: Table, kind: str) -> Owners:
    """Return by unit the features that have it; those that name a file go before patterns."""
    found: dict[bool, Owners] = {True: {}, False: {}}
    for row in table.values():
        for name, cells in row.items():
            for unit, wide in units(cells.get(kind, ""), kind):
                found[wide].setdefault(unit, []).append(name)
    return found[True] | found[False]


def shared_folder(kind: str, path: Path) -> str:
    """Return the name in the table for a file that no feature has."""
    own = f"`{kind}`" if len(path.parts) == 1 else f"`{kind}/{path.parts[0]}`"
    return own.replace("`src/", "`src/turnout/")


def lines_by_feature(found: Owners, kind: str) -> dict[str, Fraction]:
    """Return the lines of each feature, and those that none has by folder."""
    total: dict[str, Fraction] = {}
    inside: dict[Path, set[int]] = {}

    def add(names: list[str], lines: int) -> None:
        for name in names:
            total[name] = total.get(name, Fraction()) + Fraction(lines, len(names))

    for (path, part), names in found.items():
        if part:
            add(names, len(part_lines((path, part))))
            inside.setdefault(path, set()).update(part_lines((path, part)))
    for path in sorted(FOLDERS[kind].rglob("*")):
        relative = path.relative_to(FOLDERS[kind])
        if path.suffix in SUFFIXES and not LEFT_OUT & {*relative.parts}:
            names = found.get((path, "")) or [f"shared: {shared_folder(kind, relative)}"]
            add(names, len(code_lines(path) - inside.get(path, set())))
    return total


def needs(found: Owners) -> dict[str, list[str]]:
    """Return by feature the others, and the shared parts of rooms, that import a file of it."""
    root = FOLDERS["src"]
    parts = {path: [part for p, part in found if p == path and part] for path, _ in found}
    readers: dict[str, Counter[str]] = {}
    for path in root.rglob("*.py"):
        room = census.room_of(root, path)
        own = found.get((path, ""), [f"rest of {room}"])
        for _, name in census.imported_names(path):
            head, _, last = name.removeprefix("turnout.").rpartition(".")
            target = root / f"{head.replace('.', '/')}.py"
            unit = next((p for p in parts.get(target, []) if re.fullmatch(p, last)), "")
            for needed in found.get((target, unit), []):
                shown = own[0] not in {"rest of cli", "rest of api", "rest of __init__"}
                if shown and needed not in own:
                    readers.setdefault(needed, Counter()).update(own)
    return {name: [other for other, _ in by.most_common()] for name, by in readers.items()}


def rounded(lines: Fraction | int) -> str:
    """Return a number of lines to tens, a small one as it is."""
    return str(round(lines)) if lines < 10 else f"{10 * round(lines / 10):,}"


def readers_text(names: list[str], most: int = 3) -> str:
    """Return the first readers of a feature by their short names, and how many more there are.

    Examples
    --------
    >>> readers_text(["`limit`: map, blind zones", "studio: judged throws"])
    '`limit`; studio: judged throws'
    """
    short = [n if n.startswith("studio: ") else re.split(": |, ", n)[0] for n in names]
    more = len(short) - most
    return "; ".join(short[:most]) + (f"; {more} more" if more > 0 else "") or "nothing"


def printed(table: Table) -> Iterator[str]:
    """Yield the table of features in Markdown."""
    found = {kind: owners(table, kind) for kind in FOLDERS}
    lines = {kind: lines_by_feature(found[kind], kind) for kind in FOLDERS}
    readers = needs(found["src"])
    yield "| feature | src | tests | docs | needed by |\n|---|---:|---:|---:|---|"
    for room, rows in table.items():
        yield f"| **{room}** | | | | |"
        for name in rows:
            cells = " | ".join(rounded(lines[kind].get(name, 0)) for kind in FOLDERS)
            yield f"| {name} | {cells} | {readers_text(readers.get(name, []))} |"
    yield "| **Shared** | | | | |"
    yield from shared_rows(lines)


def shared_rows(lines: dict[str, dict[str, Fraction]]) -> Iterator[str]:
    """Yield the rows of files that no feature has, and the row of all."""
    for name in sorted({name for total in lines.values() for name in total if ": " in name}):
        if name.startswith("shared: "):
            cells = " | ".join(rounded(total.get(name, 0)) for total in lines.values())
            yield f"| {name.removeprefix('shared: ')} | {cells} | |"
    yield f"| **all** | {' | '.join(rounded(sum(total.values())) for total in lines.values())} | |"


def main() -> None:
    """Print the table, or put it into the page of features."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/project/features.md")
    write = parser.parse_args().write
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    lines = "\n".join(printed(table))
    path = page.DOCS / "project/features.md"
    if write:
        text = page.put(path.read_text(encoding="utf-8"), "features", lines)
        path.write_text(text, encoding="utf-8")
    print(lines)


if __name__ == "__main__":
    main()
