"""Wrong kinds of values from Python: one message that says what was given and what is wanted."""

from typing import Any

import pytest
from tests.unit.simulated import sb1_panel

import turnout


@pytest.mark.parametrize("given", ["13mm@sleeper6", 0.013, ["13mm@sleeper6"], {"size": 0.013}])
def test_what_is_no_foreign_object(given: Any) -> None:
    with pytest.raises(turnout.TurnoutError, match=r"foreign_object: .*takes a ForeignObject"):
        turnout.simulate(sb1_panel(), foreign_object=given)


@pytest.mark.parametrize("given", [3, None, 1.5, b"sb1"])
def test_what_is_no_panel_name(given: Any) -> None:
    with pytest.raises(turnout.FileError, match=r"load_panel\(\) takes the name .*'sb1'"):
        turnout.load_panel(given)


def test_a_panel_by_its_name_is_no_panel() -> None:
    with pytest.raises(turnout.ResponseError, match=r"takes a panel from load_panel\(\), not str"):
        turnout.simulate("sb1")  # type: ignore[arg-type]


def test_text_as_an_interval() -> None:
    with pytest.raises(turnout.ResponseError, match="interval = '1 ms': must be a number"):
        turnout.Save(interval="1 ms")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["scheme", "save"])
def test_what_is_no_scheme_or_save(name: str) -> None:
    with pytest.raises(turnout.ResponseError, match=rf"{name} = '1 ms' must be a {name.title()}"):
        turnout.simulate(sb1_panel(), **{name: "1 ms"})  # type: ignore[arg-type]
