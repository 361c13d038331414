"""Small inputs stay small: texts made to take long, to nest or to grow end in one message soon."""

import time
from collections.abc import Callable
from typing import TypeVar

import pytest

from turnout.core.errors import FileError, PanelError
from turnout.core.problems import Problem, show_value
from turnout.core.toml import MOST_NESTED, parse_toml
from turnout.core.units import (
    LENGTH,
    LONGEST_QUANTITY,
    MOST_VALUES,
    STIFFNESS,
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    parse_numbers,
    parse_quantities,
    parse_quantity,
    unit_factor,
)
from turnout.panel.load import load_panel
from turnout.panel.model import PANEL_KEYS

# Generous: each takes well below a second; before, minutes or for ever.
SECONDS = 5.0
MANY = 300_000
T = TypeVar("T")


def in_time(action: Callable[[], T]) -> T:
    """Return what an action returns, if it does so in time of the processor."""
    began = time.process_time()
    result = action()
    assert time.process_time() - began < SECONDS
    return result


@pytest.mark.parametrize(
    "text",
    [
        "1 m*9^9^9^9",
        "1 m^9^9^9^9",
        "1 m**9**9**9",
        "1 m^(9^9)",
        "1 m*9",
        "1 9^9 m",
        "1 m^99",
        "1 m²³⁴⁵",
        "1 m^2.5",
        "1 (m)",
        "1 m//m",
        "1 m*",
        "1 " + "m*" * 29 + "m^^",
        "1 m" + " " * 90 + "m^9^9",
    ],
)
def test_units_have_no_powers_of_numbers(text: str) -> None:
    with pytest.raises(ValueError, match="is not a unit"):
        in_time(lambda: parse_quantity(text, LENGTH))


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("1 kN·mm⁻¹", STIFFNESS, 1e6),
        ("1 kN/mm", STIFFNESS, 1e6),
        ("1 kN per mm", STIFFNESS, 1e6),
        ("1 kN * mm^-1", STIFFNESS, 1e6),
        ("1 kN mm**-1", STIFFNESS, 1e6),
        ("1 lbf/inch", STIFFNESS, 175.12683524647636),
        ("1 N.m/m²", STIFFNESS, 1.0),
        ("1 µm", LENGTH, 1e-6),
        ("1 m²/m", LENGTH, 1.0),
    ],
)
def test_spellings_of_units(text: str, dimension: Dimension, expected: float) -> None:
    assert parse_quantity(text, dimension) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "dimension"),
    [("20 degF", TEMPERATURE), ("5 degC", TEMPERATURE_DIFFERENCE), ("5 degF", TEMPERATURE)],
)
def test_a_unit_that_counts_from_another_zero_is_no_factor(text: str, dimension: Dimension) -> None:
    with pytest.raises(ValueError, match="counts from another zero"):
        parse_quantity(text, dimension)


def test_long_quantities_are_refused_unread() -> None:
    for text in ("1" + " " * MANY + "m x", "1" * MANY + " m", "1 " + "m " * MANY, "x" * MANY):
        with pytest.raises(
            ValueError, match=f"characters; a quantity has at most {LONGEST_QUANTITY}"
        ):
            in_time(lambda text=text: parse_quantity(text, LENGTH))
    for unit in ("m" + " " * MANY, "m*" * MANY, "9^" * MANY):
        with pytest.raises(ValueError, match="is not a unit"):
            in_time(lambda unit=unit: unit_factor(unit, LENGTH))


def test_long_lists_are_refused() -> None:
    with pytest.raises(ValueError, match=f"at most {MOST_VALUES} are read"):
        in_time(lambda: parse_quantities(["1"] * MANY, LENGTH))
    with pytest.raises(ValueError, match=f"at most {MOST_VALUES} are read"):
        in_time(lambda: parse_numbers([1] * MANY))


TEXTS: dict[str, str] = {
    "blanks in a comment": "a = 1 # source:" + " " * MANY + "x\n",
    "blanks after a comment": "a = 1 # source: x" + " " * MANY + "\n",
    "blanks after a value": "a = 1" + " " * MANY + "\n",
    "blanks around a key": " " * MANY + "a" + " " * MANY + "= 1\n",
    "escaped quotes": 'a = """\\""" ' + '\\"' * MANY + '"""\n',
    "pairs of quotes": 'a = """' + 'x""' * (MANY // 3) + '"""\n',
    "apostrophes": "a = '''" + "x''" * (MANY // 3) + "'''\n",
    "many comments": "a = 1 # source: x\n" + "# source: y\n" * (MANY // 12),
    "items with a comment": "a = [\n" + "1, # source: x\n" * 8_000 + "]\n",
    "many tables": "".join(f"[a{number}]\nb = 1\n" for number in range(8_000)),
}


@pytest.mark.parametrize("name", TEXTS)
def test_toml_is_read_in_time_that_grows_with_its_length_only(name: str) -> None:
    read = in_time(lambda: parse_toml(TEXTS[name], source="text"))
    assert next(iter(read.data)).startswith("a")


WRONG: dict[str, str] = {
    "open quotes": "a = " + '"\\"' * (MANY // 3),
    "open apostrophes": "'" * (MANY + 1),
    "quotes": '"' * (MANY + 1),
    "an open string": 'a = "' + "\\" * MANY,
    "digits": "a = " + "1" * MANY,
    "signs": "a = " + "+" * MANY,
    "date": "a = " + "1979-05-27T" * 50_000,
    "lists": "a = " + "[" * 5000,
    "closed lists": "a = " + "[" * 5000 + "]" * 5000,
    "inline tables": "a = " + "{a = " * 5000 + "1" + "}" * 5000,
    "names of a table": "[" + ".".join("a" * 100_000) + "]\n",
    "names of a key": ".".join("a" * 100_000) + " = 1\n",
    "names in an inline table": "a = {" + ".".join("a" * 100_000) + " = 1}\n",
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_toml_is_refused_in_time_and_briefly(name: str) -> None:
    def refused() -> str:
        with pytest.raises(FileError, match="not valid TOML") as caught:
            parse_toml(WRONG[name], source="text")
        return str(caught.value)

    message = in_time(refused)
    assert len(str(message)) < 500


def test_nesting_has_a_limit_that_the_message_names() -> None:
    fits = "a = " + "[" * MOST_NESTED + "]" * MOST_NESTED
    assert parse_toml(fits, source="text").data
    with pytest.raises(FileError, match=f"nested more than {MOST_NESTED} deep at line 2"):
        parse_toml(f"b = '[[[['\na = [{fits[4:]}]", source="text")


def test_a_setting_of_a_command_line_is_not_nested_either() -> None:
    key, value = in_time(lambda: PANEL_KEYS.setting("a=" + "[" * 100_000))  # type: ignore[misc]
    assert key == "a"
    assert isinstance(value, str)


def test_origins_count_lines_as_toml_does() -> None:
    text = 'a = "x\u2028# paper: in a text"\nb = [\n  "\\"", # source: quoted\n]\n'
    origins = parse_toml(text, source="text").origins
    assert list(origins) == [("b", "0")]


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "1" * 5000, "-" + "1_0" * 50])
def test_huge_numbers_are_one_message(number: str) -> None:
    with pytest.raises(FileError, match="a number has more than 100 characters at line 2"):
        parse_toml(f"b = 1\na = {number}", source="text")


def test_huge_whole_numbers_from_python_are_one_message() -> None:
    for number in (10**400, 1 << 20_000):
        with pytest.raises(PanelError, match="finite number"):
            load_panel("sb1").with_overrides({"gravity": number})
        assert show_value(number) == "a number of more than 60 digits"


def test_many_overrides_are_refused_in_time() -> None:
    many = {f"drive.{number}.stroke": 1.0 for number in range(5000)}
    with pytest.raises(PanelError, match="5000 values are set at once, at most 1000"):
        in_time(lambda: load_panel("sb1").with_overrides(many))
    wrong = {f"drive.{number}.stroke": 1.0 for number in range(10, 1000)}
    with pytest.raises(PanelError, match="and 790 more"):
        in_time(lambda: load_panel("sb1").with_overrides(wrong))


def test_a_long_key_is_reported_in_part() -> None:
    with pytest.raises(PanelError) as caught:
        in_time(lambda: load_panel("sb1").with_overrides({"a." * MANY: 1.0}))
    assert len(str(caught.value)) < 3000


def test_values_are_shown_without_reading_all_of_them() -> None:
    assert in_time(lambda: show_value([[1] * MANY] * MANY)) is not None
    assert len(show_value({"a" * MANY: "b" * MANY})) <= 60
    assert len(str(Problem(("a" * MANY,), ": is wrong"))) < 100


@pytest.mark.parametrize(
    "place", ["x =" + " " * MANY + "\n1", "sleeper" + " " * MANY + "1\n1", "sleeper" * MANY]
)
def test_places_are_read_in_time(place: str) -> None:
    def refused() -> None:
        with pytest.raises(PanelError) as caught:
            load_panel("sb1").with_overrides({"object.a": {"size": 0.01, "at": place}})
        assert len(str(caught.value)) < 2000

    in_time(refused)
