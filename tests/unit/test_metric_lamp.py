"""Lamps say what the dataset says, and when that may be asked."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_dataset

from turnout.metric.key_figure import key_figures
from turnout.metric.lamp import lamps


def small(**attributes: object) -> xr.Dataset:
    spans = [
        {"name": "out", "to": "open", "start": 1.0, "end": 2.0},
        {"name": "back", "to": "closed", "start": 3.0, "end": 4.0},
    ]
    return xr.Dataset(
        {
            "locked": ("time", [True, False, True, False, True]),
            "in_control": (("sensor", "time"), [[True, False, False, False, True]]),
            "drive_slipping": (("drive", "time"), [[False, False, False, True, True]]),
        },
        {
            "time": [0.5, 1.5, 2.5, 3.5, 4.0],
            "sensor": ["TKK1"],
            "sensor_limit": ("sensor", [0.013]),
            "drive": ["1"],
            "saturation_force": ("drive", [6000.0]),
        },
        {"movements": json.dumps(spans), "lock_rule": "no slip", **attributes},
    )


def test_each_lamp_has_its_rule() -> None:
    assert [(lamp.kind, lamp.name, lamp.rule) for lamp in lamps(small())] == [
        ("lock", "switch", "no drive is at its saturation force, and no movement is under way"),
        ("control", "TKK1", "its gap is below 13 mm"),
        ("slip", "drive 1", "its force has reached 6 kN"),
    ]


def test_the_rule_of_gaps_names_its_limit() -> None:
    rule = lamps(small(lock_rule="raw gap", lock_gap_limit=0.005))[0].rule
    assert rule == "the gap at every drive is below 5 mm, and no movement is under way"
    limits = '{"1": 0.005, "2": 0.004}'
    own = small(lock_rule="slip or gap", lock_gap_limit=0.005, lock_gap_limits=limits)
    assert lamps(own)[0].rule == (
        "no drive is at its saturation force, the gap at every drive is below 5 mm at drive 1 and "
        "4 mm at drive 2, and no movement is under way"
    )


def test_a_moving_or_open_switch_is_not_judged() -> None:
    lock, control, slip = lamps(small())
    assert lock.judged.tolist() == [True, False, True, False, True]
    assert control.judged.tolist() == [True, False, False, False, True]
    assert slip.judged.all()


def test_lamps_of_a_run_are_its_channels() -> None:
    run = sb2_dataset()
    by_name = {lamp.name: lamp.on for lamp in lamps(run)}
    np.testing.assert_array_equal(by_name["switch"], run["locked"].values)
    np.testing.assert_array_equal(by_name["TKK1"], run["in_control"].sel(sensor="TKK1").values)


def test_key_figures_are_those_of_the_run() -> None:
    run = sb2_dataset()
    found = {item.key: item for item in key_figures(run)}
    assert found["end_force:2"].value == float(run["drive_force"].sel(drive="2")[-1])
    assert found["object_peak"].value == float(run["object_force"].max())
    assert found["sensor_gap:TKK1"].unit == "m"
    assert found["contact_time"].value == pytest.approx(float(run["contact_time"]), rel=0)
    alone = run.assign_attrs(foreign_objects="[]")
    assert "object_peak" not in {item.key for item in key_figures(alone)}
