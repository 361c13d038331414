"""The estimated opening against the independent beam shape and the benchmark's gap."""

from pathlib import Path

import numpy as np
import pytest

from turnout.panel.layout import largest_opening
from turnout.panel.load import load_panel


def test_opening_is_within_3_mm_of_the_shape_of_the_tapered_rail(reference_dir: Path) -> None:
    data = np.load(reference_dir / "sb2" / "none.npz")
    panel = load_panel("sb2")
    opening = [largest_opening(panel, "A", x) for x in data["stops_x"]]
    # The prismatic beam between the drives stands in for the tapered one.
    np.testing.assert_allclose(opening, data["open_shape"], rtol=0, atol=0.003)


def test_opening_at_the_drives_is_stroke_and_over_travel() -> None:
    panel = load_panel("uic60-760-1-15")
    assert largest_opening(panel, "straight", 0.3) == pytest.approx(0.116, abs=1e-12)
    assert largest_opening(panel, "straight", 6.9) == pytest.approx(0.082, abs=1e-12)


def test_opening_of_the_linked_rail_is_its_own_gap() -> None:
    panel = load_panel("sb2")
    assert largest_opening(panel, "B", 0.3) == pytest.approx(0.115, abs=1e-7)
    assert largest_opening(panel, "B", 12.6) == pytest.approx(0.0118656, abs=2e-6)


def test_opening_of_a_rail_that_is_stress_free_open() -> None:
    gap = 0.118 * (1 - 3.9 / 9.7) ** 2 + 0.001
    assert largest_opening(load_panel("sb1"), "switch", 3.9) == pytest.approx(gap, abs=1e-12)


def test_opening_without_stock_rail_and_without_motion() -> None:
    panel = load_panel("sb2", overrides={"rail.A.stock_rail_gap": None})
    assert largest_opening(panel, "A", 3.6) is None
    still = load_panel("sb2").model_copy(update={"movement": {}})
    assert largest_opening(still, "A", 3.6) == 0.0


def test_opening_does_not_depend_on_the_stress_free_state_at_the_drives() -> None:
    panel = load_panel(
        "sb2", overrides={"rail.B.stress_free": "closed", "rail.B.stock_rail_gap": 0}
    )
    assert largest_opening(panel, "B", 0.3) == pytest.approx(0.115, abs=1e-12)


def test_a_rail_that_nothing_holds_behind_the_drives_keeps_their_opening() -> None:
    panel = load_panel("sb2", overrides={"drive.2.stroke": 0.115})
    free = panel.model_copy(
        update={
            "fastening": {},
            "rail": {
                name: rail.model_copy(update={"heel": "free"}) for name, rail in panel.rail.items()
            },
        }
    )
    assert largest_opening(free, "A", 17.0) == pytest.approx(0.115, abs=1e-12)
    assert largest_opening(panel, "A", 17.0) == 0.0
