"""The user's face: quick to import, and complete."""

import subprocess
import sys

import pytest

import turnout

HEAVY = ("numba", "numpy", "xarray", "pandas", "pydantic", "matplotlib", "pint", "scipy")


def loaded_by(code: str) -> list[str]:
    script = f"{code}\nimport sys\nprint(*[name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    return run.stdout.split()


@pytest.mark.parametrize("code", ["import turnout", "import turnout.cli.main"])
def test_nothing_heavy_is_loaded(code: str) -> None:
    assert loaded_by(code) == []


def test_the_check_would_see_something_heavy() -> None:
    assert "pydantic" in loaded_by("import turnout; turnout.load_panel")


@pytest.mark.parametrize("name", turnout.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(turnout, name) is not None
    assert name in dir(turnout)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        turnout.simulat  # noqa: B018
