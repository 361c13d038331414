"""The verdict on a throw, on a run whose states are set by hand."""

import json

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb2_dataset
from tests.unit.test_response_simulate import interrupted

from turnout.metric.verdict import KINDS, verdict


def run_with(
    *,
    trapped: bool = True,
    slips: str = "",
    locked: bool = True,
    control: bool = True,
    gap: float = 0.002,
) -> xr.Dataset:
    """Return a throw of sb2 with its states at the end replaced, judged by "slip or gap"."""
    dataset = sb2_dataset().copy(deep=True)
    if slips:
        late = dataset["time"].values >= 7.5
        dataset["drive_slipping"].loc[{"drive": slips}] = late
    dataset["locked"].values[-1] = locked
    dataset["in_control"].values[:, -1] = control
    dataset["drive_gap"].values[:, -1] = np.array([gap, 0.001])
    dataset.attrs["lock_rule"] = "slip or gap"
    if not trapped:
        dataset.attrs["foreign_objects"] = "[]"
    return dataset


@pytest.mark.parametrize(
    ("states", "kind", "words"),
    [
        ({}, "undetected object", "13 mm at sleeper 6 stays in the switch, which locks"),
        ({}, "undetected object", "2.00 of 5 mm open at Drive 1"),
        ({"slips": "2", "locked": False}, "detected by slip", "Drive 2 slips at 6.00 kN, closing"),
        ({"slips": "2"}, "detected by slip", "Drive 2 slips"),
        (
            {"locked": False, "gap": 0.0052},
            "detected by lock",
            "the lock is refused: 5.20 mm at Drive 1, limit 5 mm",
        ),
        ({"control": False}, "detected by TKK", "out of control: TKK1 12.97 mm, limit 13 mm"),
        ({"slips": "2", "control": False}, "detected by slip", "out of control: TKK1"),
        ({"trapped": False}, "sound", "no object, and the switch locks (2.00 of 5 mm open"),
        ({"trapped": False, "locked": False, "gap": 0.0052}, "not locked", "movement to closed"),
        ({"trapped": False, "control": False}, "not locked", "out of control: TKK1"),
        ({"trapped": False, "slips": "2"}, "not locked", "Drive 2 slips at 6.00 kN, closing"),
    ],
)
def test_every_kind_is_told_with_its_numbers(
    states: dict[str, bool | float | str], kind: str, words: str
) -> None:
    found = verdict(run_with(**states))  # type: ignore[arg-type]
    assert (found.kind, found.missed) == (kind, kind == "undetected object")
    assert words in found.text
    assert found.kind in KINDS


def test_an_open_position_without_lock_is_not_sound() -> None:
    dataset = run_with(trapped=False)
    spans = json.loads(dataset.attrs["movements"])
    time = dataset["time"].values
    dataset["locked"].values[(time >= spans[0]["end"]) & (time < spans[1]["start"])] = False
    assert "refused after the movement to open" in verdict(dataset).text


def test_an_object_that_was_taken_out_or_never_fitted_is_not_trapped() -> None:
    dataset = run_with()
    (item,) = json.loads(dataset.attrs["foreign_objects"])
    dataset.attrs["foreign_objects"] = json.dumps([{**item, "disappears": 1.0}])
    assert verdict(dataset).kind == "sound"
    assert verdict(run_with().assign(object_placed=False)).kind == "sound"


def test_a_single_rail_without_sensors_is_judged() -> None:
    assert verdict(sb1_dataset()).kind == "not locked"


@pytest.mark.parametrize(
    ("dataset", "words"),
    [
        (sb2_dataset().assign_attrs(kind="measurement"), "the largest forces are"),
        (sb2_dataset()[["drive_force"]], "no lock and no control (TKK) and no slip"),
        (sb2_dataset().expand_dims("movement"), "a campaign of many movements"),
        (interrupted(), "the run is not complete (interrupted at"),
    ],
    ids=["measurement", "forces alone", "campaign", "interrupted"],
)
def test_what_cannot_be_judged_says_why(dataset: xr.Dataset, words: str) -> None:
    found = verdict(dataset)
    assert found.kind == "not judged"
    assert words in found.text
