"""The architecture as a test: who may import whom, what is slow to load, how long pieces may be."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest
from benchmarks.census import circles, count, import_graph, imported_names, parsed

SRC = Path(__file__).parents[2] / "src" / "turnout"
MODULES = sorted(SRC.rglob("*.py"))
TOPS = (SRC, SRC.parents[1])
"""Folders from which pages for contributors name files."""

# Read downwards: data flows this way, and each package may import what its row names.
ALLOWED: dict[str, set[str]] = {
    "core": set(),
    "kernels": {"core"},
    "beam": {"core"},
    "law": {"core", "kernels"},
    "machine": {"core", "kernels", "law"},
    "panel": {"core", "law", "machine"},  # of machines the records, of laws the kinds of objects
    "mechanism": {"core", "beam", "law", "machine", "panel"},
    "solver": {"core", "kernels", "law", "machine", "mechanism"},
    "throw": {"core", "kernels", "machine", "panel", "mechanism", "solver"},
    "measurement": {"core"},
    "metric": {"core", "kernels", "panel", "mechanism", "solver", "throw"},
    "study": {"core", "law", "panel", "mechanism", "solver", "throw", "measurement", "metric"},
    "calibration": {
        *("core", "machine", "panel", "solver", "throw", "measurement", "metric", "study"),
    },
    "detection": {
        "core",
        "law",
        "panel",
        "mechanism",
        "throw",
        "measurement",
        "study",
        "calibration",
    },
    "figures": {
        *("core", "beam", "panel", "mechanism", "throw", "metric", "study", "calibration"),
        "detection",
    },
    "api": {
        *("core", "panel", "throw", "measurement", "metric", "study", "calibration", "figures"),
    },
    "web": {"core", "law", "panel", "throw", "measurement", "metric", "detection", "figures"},
    "cli": {
        *("core", "machine", "panel", "mechanism", "throw", "measurement", "metric", "study"),
        *("calibration", "detection", "figures", "web"),
    },
    "__main__": {"cli"},
}

# Slow to load, or a matter of one layer only: who may import it, at any depth of a file.
FACES = {
    *("core", "throw", "measurement", "metric", "study", "calibration", "detection"),
    *("figures", "api", "web", "cli"),
}
HEAVY: dict[str, set[str]] = {
    "xarray": FACES,
    "pandas": FACES,
    "pydantic": {"core", "panel", "machine", "measurement", "study", "calibration", "web"},
    "matplotlib": {"figures", "api"},  # api names its types only
    "plotly": {"figures"},
    "dask": {"study"},
    "numba": {"kernels"},
}

MOST_LINES_IN_A_FILE = 800
LEAST_LINES_OF_CODE = 60
STANDS_ALONE = "Stands alone"
"""How the head of a file begins the sentence that gives the reason for its size."""
TO_BE_REWRITTEN = {"calibration", "detection", "kernels", "machine", "solver"}
"""Rooms whose small files are merged, and texts reworded, when their insides are rewritten."""
MOST_LINES_IN_A_FUNCTION = 59


@cache
def tree(path: Path) -> ast.Module:
    return parsed(path)


@cache
def imports(path: Path) -> list[tuple[ast.stmt, str]]:
    return list(imported_names(path))


def package_of(path: Path) -> str:
    """Return the part of turnout that a file belongs to."""
    return path.relative_to(SRC).parts[0].removesuffix(".py")


def place(path: Path, node: ast.stmt) -> str:
    """Return file and line, to be clicked on in a report."""
    return f"{path.relative_to(SRC.parents[1])}:{node.lineno}"


def fault_of_import(package: str, name: str) -> str | None:
    """Return what is wrong with `package` importing `name`, or None."""
    top, *rest = name.split(".")
    if not top:
        return "imports relatively; name the module from turnout on"
    if top == "turnout":
        if not rest:
            return "imports the facade; name the module that defines what it needs"
        if rest[0] not in ALLOWED[package] | {package}:
            return f"imports {name}, which lies outside what {package} may know"
    elif package not in HEAVY.get(top, {package}):
        return f"imports {top}, which is kept for {', '.join(sorted(HEAVY[top]))}"
    return None


def test_the_table_has_no_circles() -> None:
    above: set[str] = set()
    for package, allowed in ALLOWED.items():
        assert allowed <= above, f"{package} may import what stands below it: {allowed - above}"
        above.add(package)


def test_every_package_is_in_the_table() -> None:
    assert MODULES, f"no modules under {SRC}"
    unknown = {package_of(path) for path in MODULES} - set(ALLOWED) - {"__init__"}
    assert not unknown, f"give {sorted(unknown)} a row in ALLOWED, or a home in a package there"
    text = (SRC.parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE)
    assert [*rows, "__main__"] == list(ALLOWED), "CONTRIBUTING.md has a row per package, in order"


def test_files_where_changes_begin_exist() -> None:
    text = (SRC.parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.partition("| to change |")[2].partition("\n\n")[0]
    named = set(re.findall(r"`([a-z_/]+\.\w+)`", table))
    assert len(named) > 40
    assert not [name for name in named if not any((top / name).exists() for top in TOPS)]


def test_imports_follow_the_table() -> None:
    faults = []
    for path in MODULES:
        package = package_of(path)
        if package not in ALLOWED:  # the facade; anything else fails the test before this one
            continue
        for node, name in imports(path):
            fault = fault_of_import(package, name)
            if fault is not None:
                faults.append(f"{place(path, node)} {fault}")
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("package", "name", "words"),
    [
        ("beam", "turnout.panel.model", "outside what beam may know"),
        ("beam", "turnout", "the facade"),
        ("beam", ".element", "relatively"),
        ("beam", "numba", "kept for kernels"),
        ("cli", "matplotlib.pyplot", "kept for api, figures"),
    ],
)
def test_a_forbidden_import_is_seen(package: str, name: str, words: str) -> None:
    assert words in (fault_of_import(package, name) or "")


OTHER_NAMES = {"matio": "mat-io", "skfem": "scikit-fem"}
"""Packages by the name of their modules where it is another one."""
NOT_IMPORTED = {"h5netcdf"}
"""Packages that others load: xarray reads and writes netCDF by it."""


def package_names(requirements: Iterable[str]) -> set[str]:
    """Return the packages that requirements name, as indexes write them."""
    found = [re.match(r"[\w.-]+", text) for text in requirements]
    return {name[0].lower().replace("_", "-") for name in found if name}


def test_imports_are_declared() -> None:
    project = tomllib.loads((SRC.parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    core = package_names(project["dependencies"])
    extras = package_names(
        requirement
        for extra, requirements in project["optional-dependencies"].items()
        if extra not in ("benchmark", "dev", "docs")
        for requirement in requirements
    )
    faults, used = [], set()
    for path in MODULES:
        for node, name in imports(path):
            top = name.split(".")[0]
            if top in sys.stdlib_module_names or top == "turnout":
                continue
            package = OTHER_NAMES.get(top, *package_names([top]))
            used.add(package)
            if package not in (core if node.col_offset == 0 else core | extras):
                faults.append(f"{place(path, node)} imports {top}: add {package} to pyproject.toml")
    assert not faults, "\n".join(dict.fromkeys(faults))
    assert core - used == NOT_IMPORTED, "declared in vain"


def test_files_import_each_other_in_no_circle() -> None:
    found = [
        " - ".join(str(path.relative_to(SRC)) for path in circle)
        for circle in circles(import_graph(SRC))
    ]
    assert not found, "move what both need down, or merge:\n" + "\n".join(found)


def test_a_circle_is_seen_in_functions_and_type_hints(tmp_path: Path) -> None:
    one, two, three = (tmp_path / "pack" / f"{name}.py" for name in ("one", "two", "three"))
    one.parent.mkdir()
    one.write_text("def build():\n    from pack import two\n")
    two.write_text("if TYPE_CHECKING:\n    from .one import build\n")
    three.write_text("import pack.one\n")
    assert circles(import_graph(one.parent)) == [[one, two]]


def importers() -> dict[Path, set[Path]]:
    """Return by file the other files that import it or a name of it."""
    graph = import_graph(SRC)
    return {path: {other for other in graph if path in graph[other]} for path in graph}


def stands_alone_for_no_reason(path: Path, readers: set[Path]) -> str:
    """Say what makes a file a crumb or a heap; empty where its head gives the reason."""
    if STANDS_ALONE in (ast.get_docstring(tree(path)) or ""):
        return ""
    if len(path.read_text(encoding="utf-8").splitlines()) > MOST_LINES_IN_A_FILE:
        return f"has over {MOST_LINES_IN_A_FILE} lines: split it, or say '{STANDS_ALONE} ...'"
    package = package_of(path)
    inside = len(readers) == 1 and package_of(next(iter(readers))) == package
    if inside and package not in TO_BE_REWRITTEN and count(path)[1] < LEAST_LINES_OF_CODE:
        return f"has one reader, {next(iter(readers)).name}: merge, or say '{STANDS_ALONE} ...'"
    return ""


def test_files_that_stand_alone_say_why() -> None:
    found = importers()
    assert sum(len(readers) for readers in found.values()) > len(MODULES)
    faults = [
        f"{path.relative_to(SRC)} {fault}"
        for path, readers in found.items()
        if (fault := stands_alone_for_no_reason(path, readers))
    ]
    assert not faults, "\n".join(faults)


MOST_FILES_OF_CALIBRATION, MOST_LEVELS_OF_CALIBRATION = 30, 8
"""Of calibration, validation and matching, that one can read; estimates of machines are beside."""
CALIBRATION = [
    path
    for path in MODULES
    if package_of(path) == "calibration" and "machine_estimates" not in path.parts
]


def test_calibration_stays_flat() -> None:
    graph = import_graph(SRC)

    @cache
    def level(path: Path) -> int:
        return 1 + max((level(other) for other in graph[path] if other in CALIBRATION), default=0)

    assert len(CALIBRATION) <= MOST_FILES_OF_CALIBRATION
    assert max(map(level, CALIBRATION)) <= MOST_LEVELS_OF_CALIBRATION


def numbers_without_reason(text: str) -> list[str]:
    """Return constants with a number that no comment or docstring beside their block explains."""
    body, lines = ast.parse(text).body, text.splitlines()
    explained = {
        before.end_lineno
        for before, after in zip(body, body[1:], strict=False)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    }
    end, found = 0, []
    for node in body:
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        names = ast.unparse(targets[0]) if targets[0] is not None else ""
        if not names.strip("()").isupper():
            continue
        numbers = [n.value for n in ast.walk(node) if isinstance(n, ast.Constant)]
        above = "".join(lines[node.lineno - 2 : node.lineno - 1]).startswith("#")
        beside = above or "  # " in "".join(lines[node.lineno - 1 : node.end_lineno])
        if beside or node.end_lineno in explained or end == node.lineno - 1:
            end = node.end_lineno or 0
        elif any(isinstance(number, int | float) and number for number in numbers):
            found.append(names)
    return found


def test_numbers_of_calibration_have_a_reason() -> None:
    faults = {
        str(path.relative_to(SRC)): names
        for path in CALIBRATION
        if (names := numbers_without_reason(path.read_text(encoding="utf-8")))
    }
    assert not faults


def test_a_number_without_a_reason_is_seen() -> None:
    text = "# Enough.\nMOST = 3\nLEAST = 1\n\nFAR = 2.0\nNEAR = 1.0\n" + '"""Reached."""\n'
    assert numbers_without_reason(text) == ["FAR"]
    # A comment on another line's value is none, nor is a colour.
    text = 'far = f(2)  # Far.\nFAR: float = 2.0\n\nRED = ("#f00", 3)\n\nLOW: int = 3  # Low.\n'
    assert numbers_without_reason(text) == ["FAR", "RED"]


def test_functions_stay_short() -> None:
    long = []
    for path in MODULES:
        for node in ast.walk(tree(path)):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
            if lines > MOST_LINES_IN_A_FUNCTION:
                long.append(f"{place(path, node)} {node.name}: {lines}")
    assert not long, f"bodies over {MOST_LINES_IN_A_FUNCTION} lines: {long}"


DEEP = re.compile(r"(?:from|import) turnout\.(?!figures\b(?!\.))[a-z_.]*")
"""Imports of private modules; `turnout` and `turnout.figures` are public."""


def shown_to_users() -> list[Path]:
    """Return README, the documentation with its notebooks, and the scripts of the gallery."""
    docs = SRC.parents[1] / "docs"
    found = [path for ending in ("md", "ipynb", "py") for path in docs.rglob(f"*.{ending}")]
    return [SRC.parents[1] / "README.md", *(path for path in found if "_build" not in path.parts)]


def test_what_users_read_imports_the_public_interface_only() -> None:
    faults = [
        f"{path.name}: {found}"
        for path in shown_to_users()
        for found in DEEP.findall(path.read_text(encoding="utf-8"))
    ]
    assert len(shown_to_users()) > 40
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("line", "deep"),
    [
        ("import turnout", False),
        ("from turnout import figures", False),
        ("from turnout.figures import Line", False),
        ("from turnout.figures.draw import draw_sheet", True),
        ("import turnout.study.study", True),
    ],
)
def test_a_deep_import_is_seen(line: str, deep: bool) -> None:
    assert bool(DEEP.search(line)) == deep
