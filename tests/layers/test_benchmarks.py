"""Every benchmark can be loaded, so that a rename does not leave one behind."""

from importlib import import_module
from pathlib import Path

import pytest

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
