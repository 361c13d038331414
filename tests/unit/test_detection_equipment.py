"""What a sensor at the rail or a further drive adds to the bound."""

import numpy as np
import pytest
from tests.unit.detection_throws import toy_throws

from turnout.core.errors import StudyError
from turnout.detection.limit.added_equipment import (
    Readings,
    check_equipment,
    equipment_of,
    sensor_measure,
    with_drive,
)
from turnout.detection.limit.limit_map import limit_map
from turnout.detection.limit.what_if import check_measures, gain_rows, gains
from turnout.detection.reference import Conditions
from turnout.panel.load import load_panel

CLOSING, STATES = 0.8, 24


def readings(gain: float) -> Readings:
    """Gaps that grow by a share of the size of the object; without one friction leaves some."""
    throws = toy_throws()
    size = np.broadcast_to(throws.sizes[..., None], (STATES, 2, 3, 2))
    sound = 4e-3 + 0.1e-3 * np.random.default_rng(3).standard_normal((STATES, 2))
    sound = sound + 4e-3 * throws.level[:STATES, None]
    return Readings(
        gap=sound[:, None, None, :] + gain * size, sound_gap=sound,
        force=np.zeros((STATES, 2, 3, 1)), sound_force=np.zeros((STATES, 1)),
        x=np.array([0.3, 0.6]), stop_x=np.array([0.4]),
        level=throws.level[:STATES], switch=throws.switch[:STATES],
    )  # fmt: skip


def test_a_position_sensor_adds_what_it_reads_and_none_that_does_not_move() -> None:
    throws, conditions = toy_throws(), Conditions()
    sees, blind = (
        sensor_measure("position sensor at 0.5 m", throws, readings(gain), conditions)
        for gain in (1.0, 0.0)
    )
    assert sees.beside is not None
    spread = np.hypot(0.3e-3, 0.1e-3)
    assert np.median(sees.beside[:, 0, 2]) == pytest.approx(9e-3 / spread, rel=0.1)
    rows = {
        item.beside is sees.beside: gain_rows(gains(throws, conditions, [item], closing=CLOSING))
        for item in (sees, blind)
    }
    assert float(rows[True][0]["gain"]) > 0.3e-3
    assert float(rows[False][0]["gain"]) == pytest.approx(0.0, abs=0.05e-3)


def test_a_contact_adds_less_than_a_position() -> None:
    given = [
        sensor_measure(f"{kind} sensor at 0.5 m", toy_throws(), readings(0.5), Conditions())
        for kind in ("position", "contact")
    ]
    pod = [
        limit_map(item.throws, item.conditions, closing=CLOSING, beside=item.beside)["pod"]
        for item in given
    ]
    assert float(pod[0].mean()) > float(pod[1].mean())


def test_a_further_drive_lies_between_its_neighbours() -> None:
    panel = with_drive(load_panel("uic60-760-1-15"), 3.6)
    assert list(panel.drive) == ["1", "2", "3"]
    assert panel.drive["3"].x == pytest.approx(3.6)
    assert panel.drive["3"].over_travel_closed == pytest.approx(3.9e-3)


def test_texts_without_meaning_and_places_beyond_the_blade_are_refused() -> None:
    assert equipment_of("force sensor at 3.6m") == ("force sensor", 3.6)
    check_measures(["contact sensor at 2 m"])
    with pytest.raises(StudyError, match="is none of"):
        check_measures(["position sensor at sleeper 6"])
    with pytest.raises(StudyError, match="lies outside 0.3 to 6.9 m"):
        check_equipment(["drive at 9 m"], load_panel("uic60-760-1-15"))
