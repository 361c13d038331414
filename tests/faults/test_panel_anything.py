"""Whatever stands in a panel file, the answer is a panel or a list of problems, never a crash."""

import copy
import datetime
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from turnout.core.errors import PanelError
from turnout.core.toml import TomlFile
from turnout.panel.load import library_text, panel_from_file

DATA = tomllib.loads(library_text("sb2") + '[object.stone]\nsize = "5 mm"\nat = "drive 1"\n')
WEIRD: list[Any] = [
    10**400, -(10**400), 1e308, -0.0, float("nan"), float("-inf"), True, "", " ", ".", "1e400 m",
    "0 m", "-1 m", "1 kN", "closed", "x = 1e999 m", "table", [], [[]], [{}], [True], ["1 m"] * 3,
    ["A", "B"], {}, {"": {}}, {"unit": "m", "values": []}, {"unit": "m", "values": [10**400]},
    {"start": "0 m", "step": "0 m", "count": 3}, {"x": "0 m"}, {"A": {"A": {}}},
    datetime.date(2020, 1, 1), datetime.time(1, 2), "\N{SUPERSCRIPT TWO} m", "1 m\u0000", "1_000 m",
]  # fmt: skip


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every table, list and value."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else ()
    for key, item in items:
        yield from places(item, (*path, key))


PLACES = list(places(DATA))


def changed(edits: list[tuple[tuple[Any, ...], Any]]) -> dict[str, Any]:
    data = copy.deepcopy(DATA)
    for path, value in edits:
        table: Any = data
        for part in path[:-1]:
            table = table.get(part) if isinstance(table, dict) else None
        if isinstance(table, dict):
            table[path[-1]] = copy.deepcopy(value)  # no value may come to hold itself
    return data


def outcome(data: dict[str, Any]) -> str:
    try:
        panel_from_file(TomlFile(data, {}, "any.toml"))
    except PanelError as error:
        return str(error)
    return "fine"


@pytest.mark.parametrize("weird", WEIRD, ids=lambda item: repr(item)[:30])
def test_one_weird_value_anywhere(weird: Any) -> None:
    assert outcome(DATA) == "fine"
    # Every twelfth place, others for each value: a twelfth of the time.
    some = PLACES[len(repr(weird)) % 12 :: 12]
    answers = [outcome(changed([(path, weird)])) for path in some]
    refused = sum(answer.startswith("any.toml: ") for answer in answers)
    assert refused + answers.count("fine") == len(some)
    assert refused > len(some) / 2


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PLACES), st.sampled_from(WEIRD)), min_size=2, max_size=8))
def test_several_weird_values(edits: list[tuple[tuple[Any, ...], Any]]) -> None:
    answer = outcome(changed(edits))
    assert answer == "fine" or answer.startswith("any.toml: ")


@pytest.mark.parametrize("path", PLACES, ids=lambda path: ".".join(path))
def test_anything_may_be_missing(path: tuple[Any, ...]) -> None:
    data = changed([])
    table: Any = data
    for part in path[:-1]:
        table = table[part]
    del table[path[-1]]
    answer = outcome(data)
    assert answer == "fine" or answer.startswith("any.toml: ")
