"""Every benchmark and study can be loaded, so that a rename does not leave one behind."""

import ast
import re
import runpy
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from benchmarks.sweep_rate import Thrower

# These are programs of others, which only the extra `benchmark` brings.
OTHERS = ("exudyn", "openseespy")
ROOT = Path(__file__).parents[2]
PATHS = sorted((ROOT / "benchmarks").rglob("*.py"))
PROGRAMS = [path for path in PATHS if "__main__" in path.read_text(encoding="utf-8")]
STUDIES = "benchmarks.studies"


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def loaded(load: Callable[[], Any]) -> Any:
    """Load a benchmark; skip where a program of others is not installed."""
    try:
        return load()
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] not in OTHERS:
            raise
        pytest.skip(f"pip install 'turnout[benchmark]' brings {error.name}")


@pytest.mark.parametrize("path", PATHS, ids=name_of)
def test_a_benchmark_loads(path: Path) -> None:
    assert loaded(lambda: import_module(name_of(path))).__doc__


@pytest.mark.parametrize("path", PROGRAMS, ids=name_of)
def test_help_measures_nothing(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = path.read_text(encoding="utf-8")
    assert "ArgumentParser(" in text or "command_line(" in text, "would run instead"
    monkeypatch.setattr("sys.argv", [path.stem, "--help"])
    with pytest.raises(SystemExit) as ended:
        loaded(lambda: runpy.run_path(str(path), run_name="__main__"))
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: ")


def test_only_tests_run_studies() -> None:
    """A study may take a reference of tests/verification, and no reference takes a study."""
    faults = [
        f"{path.relative_to(ROOT)} imports {node.module}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        if not path.name.startswith("test_")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(STUDIES)
    ]
    assert PATHS
    assert faults == []


def test_a_checkout_that_is_too_old_for_sweep_rates_is_named(tmp_path: Path) -> None:
    """Its process ends before it is asked; the benchmark says so in one line."""
    package = tmp_path / "src" / "turnout"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    thrower = Thrower(tmp_path, "any")
    with pytest.raises(SystemExit, match=f"{re.escape(str(tmp_path))}: .* later commit"):
        thrower.throw(0, 1)
