"""Sizes, imports and names of a package: python -m benchmarks.census [FOLDER].

A room is a folder or module directly below FOLDER, its floor the longest chain of rooms under it.
An arrow is one room that another one imports, at any depth of a file, under TYPE_CHECKING too.
Lines of code are lines with a token that is no comment and no docstring; names are functions,
classes and constants of modules, public ones functions and classes without an underscore.
"""

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TypeVar

NOT_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
CLAUSES = {name: re.compile(rf"\b{name}\b", re.IGNORECASE) for name in ("what", "where")}
"""Clauses that a summary should not need, by name."""
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
COLUMNS = ("files", "lines", "code", "docstrings", "names")

Node = TypeVar("Node", bound=Hashable)
Graph = Mapping[Node, Iterable[Node]]


def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def docstring_lines(tree: ast.AST) -> set[int]:
    """Return the lines that docstrings take."""
    found: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for item in body:  # attributes of modules and records have docstrings too
            if isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant):
                found.update(range(item.lineno, (item.end_lineno or item.lineno) + 1))
    return found


def count(path: Path) -> tuple[int, int, int, int]:
    """Return all lines of a file, those of code, those of docstrings, and its names."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    documented = docstring_lines(tree)
    code = {
        line
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in NOT_CODE
        for line in range(token.start[0], token.end[0] + 1)
    }
    names = sum(
        isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign | ast.AnnAssign)
        for node in tree.body
    )
    return text.count("\n"), len(code - documented), len(documented), names


def imported_names(path: Path) -> Iterator[tuple[ast.stmt, str]]:
    """Yield the statement and the full dotted name of each import, relative ones with their dots.

    Examples
    --------
    >>> [name for _, name in imported_names(Path(__file__))][:3]
    ['argparse', 'ast', 'io']
    """
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            dot = "" if base.endswith(".") else "."
            yield from ((node, f"{base}{dot}{alias.name}") for alias in node.names)


@cache
def import_graph(root: Path) -> dict[Path, set[Path]]:
    """Return by file of a package the other files of it that it imports."""
    paths = sorted(root.rglob("*.py"))
    parts = {path: path.relative_to(root.parent).with_suffix("").parts for path in paths}
    by_name = {".".join(name).removesuffix(".__init__"): path for path, name in parts.items()}
    found: dict[Path, set[Path]] = {}
    for path in paths:
        own = found[path] = set()
        for _, given in imported_names(path):
            name = given.lstrip(".")
            if level := len(given) - len(name):
                name = ".".join((*parts[path][:-level], name))
            target = by_name.get(name) or by_name.get(name.rpartition(".")[0])
            if target not in (None, path):
                own.add(target)
    return found


def room_of(root: Path, path: Path) -> str:
    """Return the folder or module below a root to which a file belongs."""
    return path.relative_to(root).parts[0].removesuffix(".py")


def room_graph(root: Path) -> dict[str, set[str]]:
    """Return by room the other rooms that it imports; the root's own `__init__` is left out."""
    found: dict[str, set[str]] = {}
    for path, imported in import_graph(root).items():
        own = room_of(root, path)
        found.setdefault(own, set()).update({room_of(root, other) for other in imported} - {own})
    found.pop("__init__", None)
    return {room: others & found.keys() for room, others in found.items()}


def reached(graph: Graph[Node]) -> dict[Node, set[Node]]:
    """Return by node all nodes on the ways from it.

    Examples
    --------
    >>> reached({1: [2], 2: [1], 3: [1]})
    {1: {1, 2}, 2: {1, 2}, 3: {1, 2}}
    """
    found: dict[Node, set[Node]] = {}
    for start in graph:
        own, left = found.setdefault(start, set()), list(graph[start])
        while left:
            node = left.pop()
            if node not in own:
                own.add(node)
                left += graph[node]
    return found


def circles(graph: Graph[Node]) -> list[list[Node]]:
    """Return the sets of nodes that each reach all others of their set.

    Examples
    --------
    >>> circles({1: [2], 2: [3], 3: [2], 4: [1]})
    [[2, 3]]
    """
    below = reached(graph)
    found = {
        frozenset(other for other in below[node] if node in below[other])
        for node in graph
        if node in below[node]
    }
    return sorted([node for node in graph if node in circle] for circle in found)


def floors(graph: Graph[Node]) -> dict[Node, int]:
    """Return the floor of each node, lowest first; nodes of one circle share theirs.

    Examples
    --------
    >>> floors({"b": ["a"], "a": [], "c": ["a", "b"]})
    {'a': 0, 'b': 1, 'c': 2}
    """
    below, found = reached(graph), dict[Node, int]()
    for floor in range(len(graph)):
        left = [node for node in graph if node not in found]
        ready = [node for node in left if all(node in below[o] for o in below[node] & {*left})]
        found |= dict.fromkeys(ready, floor)
    return found


def public_names(root: Path) -> dict[str, list[Path]]:
    """Return by name of a public function or class of a module the files that define it."""
    found: dict[str, list[Path]] = {}
    for path in sorted(root.rglob("*.py")):
        own = [n.name for n in parsed(path).body if isinstance(n, ast.FunctionDef | ast.ClassDef)]
        for name in dict.fromkeys(own):  # an overloaded function has one owner
            if not name.startswith("_"):
                found.setdefault(name, []).append(path)
    return found


def numeric_constants(path: Path) -> int:
    """Count the names of a module that are set to a plain number."""

    def plain(value: ast.expr | None) -> bool:
        if isinstance(value, ast.UnaryOp):
            return plain(value.operand)
        if isinstance(value, ast.BinOp):
            return plain(value.left) and plain(value.right)
        return isinstance(value, ast.Constant) and type(value.value) in (int, float)

    values: list[ast.expr | None] = []
    for node in parsed(path).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
            values += node.value.elts if isinstance(node.value, ast.Tuple) else []
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            values.append(node.value)
    return sum(map(plain, values))


def summaries(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and summary of each docstring of a file: its first paragraph, on one line."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, DOCUMENTED) and (text := ast.get_docstring(node)):
            yield getattr(node, "lineno", 1), " ".join(text.split("\n\n")[0].split())


def clause_shares(root: Path) -> dict[str, float]:
    """Return the shares of summaries with each clause of `CLAUSES`, and with any."""
    texts = [text for path in root.rglob("*.py") for _, text in summaries(path)]
    found = {name: [bool(p.search(text)) for text in texts] for name, p in CLAUSES.items()}
    found["any"] = [any(each) for each in zip(*found.values(), strict=True)]
    return {name: sum(each) / max(len(texts), 1) for name, each in found.items()}


def words(pages: Iterable[Path]) -> int:
    """Count the words of some pages of text."""
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages)


def sizes(root: Path) -> dict[str, Counter[str]]:
    """Return files, lines, code, docstrings and names by room."""
    found: dict[str, Counter[str]] = {}
    for path in sorted(root.rglob("*.py")):
        row = found.setdefault(room_of(root, path), Counter())
        row.update(dict(zip(COLUMNS, (1, *count(path)), strict=True)))
    return found


def printed_rooms(root: Path) -> Iterator[str]:
    """Yield a table of the rooms of a package with their imports, and the circles between them.

    Circles are printed one per line.
    """
    graph, rows = room_graph(root), sizes(root)
    above, files = floors(graph), import_graph(root)
    table = {room: (str(above[room]), rows[room], sorted(graph[room])) for room in above}
    rest = {room: ("", row, list[str]()) for room, row in rows.items() if room not in above}
    total = sum(rows.values(), Counter[str]())
    yield f"{'room':<15}{'floor':>6}" + "".join(f"{name:>11}" for name in COLUMNS) + "  imports"
    for room, (floor, row, others) in (table | rest | {"all": ("", total, [])}).items():
        cells = "".join(f"{row[name]:>11,}" for name in COLUMNS)
        yield f"{room:<15}{floor:>6}{cells}  {' '.join(others)}".rstrip()
    between = {
        "rooms": [list(map(str, circle)) for circle in circles(graph)],
        "files": [[str(f.relative_to(root)) for f in circle] for circle in circles(files)],
    }
    arrows = sum(map(len, graph.values()))
    yield f"{len(graph)} rooms on {len(set(above.values()))} floors, {arrows} arrows"
    for of, found in between.items():
        yield f"{len(found)} circles between {of}"
        yield from (f"  {' - '.join(circle)}" for circle in found)


def printed_names(root: Path, pages: list[Path]) -> Iterator[str]:
    """Yield the counts of names, constants, clauses and words, and names with several owners."""
    owners = public_names(root)
    several = {name: paths for name, paths in owners.items() if len(paths) > 1}
    yield f"{len(owners):,} public names, {len(several)} with two or more owners"
    for name, paths in sorted(several.items()):
        yield f"  {name}: {', '.join(str(path.relative_to(root)) for path in paths)}"
    constants = sum(map(numeric_constants, root.rglob("*.py")))
    yield f"{constants:,} numeric constants of modules"
    for name, share in clause_shares(root).items():
        yield f"{100 * share:.1f} % of the summaries of docstrings with {name} clause"
    yield f"{words(pages):,} words of documentation"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("src/turnout"))
    parser.add_argument("--docs", type=Path, default=Path("docs"), help="folder of pages (*.md)")
    given = parser.parse_args()
    pages = [page for page in given.docs.rglob("*.md") if "_build" not in page.parts]
    print(*printed_rooms(given.folder), *printed_names(given.folder, pages), sep="\n")


if __name__ == "__main__":
    main()
