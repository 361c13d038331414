"""Recordings beside a throw in the studio: what railways record is drawn too."""

import numpy as np
from tests.unit.simulated import sb2_dataset

from turnout.core.toml import parse_toml
from turnout.figures.over_time_sheet import throw_sheet
from turnout.measurement.chain.apply import parse_channel_map
from turnout.measurement.recording import RecordedChannel, Recording
from turnout.web.measured import recorded_movements, shifted

MAP = """
[drive_power.1]
column = "P1"
kind = "scaled"
[drive_current."1+2"]
column = "I"
kind = "scaled"
"""


def test_powers_and_a_current_of_two_machines_are_drawn() -> None:
    time = np.arange(0.0, 7.0, 0.04)
    power = np.where((time > 1.0) & (time < 6.0), 350.0, 0.0)
    recording = Recording(
        {
            "P1": RecordedChannel("P1", "W", power, rate=25.0),
            "I": RecordedChannel("I", "A", power / 150.0, rate=25.0),
        },
        "throw.csv",
    )
    (found,), _ = recorded_movements(recording, parse_channel_map(parse_toml(MAP, source="map")))
    rows = {row.label: row.lines for row in throw_sheet(shifted(found, sb2_dataset())).rows}
    (current,), (drawn,) = (
        rows["Motor current,\n0.1 s mean [A]"],
        rows["Power drawn,\n0.1 s mean [W]"],
    )
    assert (current.label, drawn.label) == ("Drive 1+2", "Drive 1")
    assert np.nanmax(drawn.y) == 350.0
