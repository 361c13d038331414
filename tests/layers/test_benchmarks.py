"""Every benchmark can be loaded, so that a rename does not leave one behind."""

import re
from importlib import import_module
from pathlib import Path

import pytest
from benchmarks.sweep_rate import Thrower

# These are programs of others, which only the extra `benchmark` brings.
OTHERS = ("exudyn", "openseespy")
NAMES = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_loads(name: str) -> None:
    try:
        loaded = import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] not in OTHERS:
            raise
        pytest.skip(f"pip install 'turnout[benchmark]' brings {error.name}")
    assert loaded.__doc__


@pytest.mark.parametrize("name", NAMES)
def test_help_measures_nothing(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        loaded = import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        pytest.skip(f"pip install 'turnout[benchmark]' brings {error.name}")
    if not hasattr(loaded, "main"):
        return  # part of others
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        loaded.main()
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: ")


def test_a_checkout_that_is_too_old_for_sweep_rates_is_named(tmp_path: Path) -> None:
    """Its process ends before it is asked; the benchmark says so in one line."""
    package = tmp_path / "src" / "turnout"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    thrower = Thrower(tmp_path, "any")
    with pytest.raises(SystemExit, match=f"{re.escape(str(tmp_path))}: .* later commit"):
        thrower.throw(0, 1)
