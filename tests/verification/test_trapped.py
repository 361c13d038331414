"""The tables of trapped objects are what the program does; one row per behaviour is thrown."""

import pytest
from benchmarks.studies.trapped import PAGE, RESULTS, parameter_table, recorder_table, row


def test_the_table_of_parameters_is_up_to_date() -> None:
    assert parameter_table() in PAGE.read_text(encoding="utf-8")


def test_the_table_of_the_recorder_is_up_to_date() -> None:
    assert recorder_table() in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("kind", "size", "place"),
    [
        ("spring", 10, "sleeper 6"),
        ("stone", 15, "drive 1"),
        ("ice", 15, "drive 1"),
        ("snow", 20, "sleeper 6"),
        ("wood", 10, "drive 1"),
    ],
)
def test_a_row_of_the_tables_is_what_is_thrown(kind: str, size: int, place: str) -> None:
    part = RESULTS.read_text(encoding="utf-8").split(f"<!-- {place} -->")[1]
    assert row(kind, size, place) in part
