"""Places by name: names are remembered in lower case, where they are is not."""

from types import SimpleNamespace

import pytest

from turnout.panel.place import Place, find_place


def families(x: float) -> dict[str, dict[str, SimpleNamespace]]:
    """Return places of two families that share a name but for its case."""
    at = {name: SimpleNamespace(x=x + number) for number, name in enumerate(("6", "TKK1", "Tip"))}
    return {"sensor": at, "drive": {"tip": SimpleNamespace(x=x + 2), "other": at["6"]}}


def test_a_name_in_any_case_is_found_where_it_is_in_each_panel() -> None:
    for x in (0.0, 10.0):  # the same names at other places
        given = families(x)
        assert find_place(given, "tkk1") == Place(x + 1, "sensor", "TKK1")
        assert find_place(given, "TIP") == Place(x + 2, "drive", "tip")  # drives come first
        assert find_place(given, "sensor tip") == Place(x + 2, "sensor", "Tip")
        given["sensor"]["Tip"].x = x + 3
        with pytest.raises(ValueError, match="write 'drive tip' or 'sensor Tip'"):
            find_place(given, "Tip")
        given["sensor"] |= {"new": SimpleNamespace(x=x + 4)}
        assert find_place(given, "NEW").x == x + 4
