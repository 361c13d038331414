"""Machines that have not arrived when a schedule goes on or ends: waited for, or not judged."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.sweeps import here

from turnout.calibration.load_study import load_study
from turnout.figures.style import title_of
from turnout.metric.finding import findings
from turnout.metric.panel_check import concerns
from turnout.metric.summary import summary
from turnout.metric.sweep_map import STATES, end_state
from turnout.metric.test_piece import check_piece
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.solver.integration import WITHOUT_START
from turnout.solver.outcome import Code, NotConverged
from turnout.study.sweep.read import last_values, open_batches
from turnout.study.sweep.run import throw_study
from turnout.throw.checks import checks, lamps
from turnout.throw.sequence import simulate_sequence
from turnout.throw.simulate import simulate
from turnout.throw.slip import movements
from turnout.throw.verdict import throw_table, verdict

NAME = "60e1-300-1-9"
STALLED = {"machine.jea73.supply.voltage": 5.0, "machine.jea73.circuit.time_out": None}


def panel_with(machine: str = "jea73", **changes: object) -> LoadedPanel:
    return load_panel(NAME, overrides={"drive.1.machine": machine, **changes})


@cache
def thrown(machine: str = "jea73") -> xr.Dataset:
    """Return a throw that takes longer than the schedule, to be read only."""
    return simulate(panel_with(machine), mode="quick")


@cache
def stalled() -> xr.Dataset:
    """Return a throw whose machine never moves and is never switched off, to be read only."""
    return simulate(panel_with(**STALLED), mode="quick")


@pytest.mark.parametrize("code", WITHOUT_START)
@pytest.mark.parametrize("machine", [None, "jea73"])
def test_a_throw_without_a_start_is_refused_by_one_message(
    monkeypatch: pytest.MonkeyPatch, machine: str | None, code: Code
) -> None:
    monkeypatch.setattr("turnout.solver.integration.find_start", lambda *_: code)
    panel = load_panel(NAME) if machine is None else panel_with(machine)
    with pytest.raises(NotConverged, match="start"):
        simulate(panel, mode="quick")


def cut_at(run: xr.Dataset, end: float) -> xr.Dataset:
    """Return a throw as if its run had ended in the last movement."""
    made = json.loads(run.attrs["machine_throws"])
    made[-1] |= {"off": None, "rest": None, "outcome": "moving"}
    spans = json.loads(run.attrs["movements"])
    spans[-1]["end"] = end + 1.0
    attributes = {"machine_throws": json.dumps(made), "movements": json.dumps(spans)}
    return run.sel(time=slice(None, end)).assign_attrs(attributes)


def said(run: xr.Dataset) -> str:
    """Return all that is said of a run."""
    lines = [verdict(run).text, verdict(run).meaning, title_of(run)]
    lines += [f"{heading} {text}" for heading, text in summary(run)]
    lines += [
        f"{item.question} {item.answer} {item.detail} {item.meaning}" for item in findings(run)
    ]
    return "\n".join(lines)


@pytest.mark.parametrize("machine", ["jea73", "s700k", "zdj9"])
def test_the_schedule_waits_until_machines_have_arrived(machine: str) -> None:
    run = thrown(machine)
    opening, closing = movements(run)
    made = json.loads(run.attrs["machine_throws"])
    assert [item["outcome"] for item in made] == ["limit", "limit"]
    assert opening.end < closing.start < closing.end <= float(run["time"][-1]) > 8.5
    assert verdict(run).kind == "sound"
    assert bool(run["locked"][-1])
    waited = sum(json.loads(run.attrs["schedule_waits"]))
    assert float(run["time"][-1]) == pytest.approx(8.5 + waited)
    assert f"the schedule waited {waited:.2f} s for machines" in dict(summary(run))["run"]


def test_the_rest_before_a_movement_and_at_the_end_is_that_of_the_schedule() -> None:
    """The markers of the schedule rest 1 s and 0.9 s; machines are checked every 20 ms."""
    run = thrown()
    opening, closing = movements(run)
    assert 1.0 <= closing.start - opening.end + 1e-9 <= 1.021
    assert 0.9 <= float(run["time"][-1]) - closing.end + 1e-9 <= 0.921
    before = run.sel(time=slice(opening.end, closing.start))
    assert bool(before["locked"][:-1].all())
    assert np.ptp(before["drive_displacement"].values) == 0.0


def test_nothing_is_judged_by_a_movement_that_is_not_over() -> None:
    run = cut_at(thrown(), 8.5)
    assert not bool(run["locked"][-1])
    assert verdict(run).kind == "not judged"
    assert verdict(run).text == "Not judged: Drive 1 still moves at 8.5 s."
    locked = dict(summary(run))["locked"]
    assert locked.startswith(
        "NOT JUDGED after closing by the rule 'slip or gap': Drive 1 still mov"
    )
    first, second = findings(run)[:2]
    assert (first.level, first.answer, first.detail) == (
        "look", "Not judged", "Drive 1 still moves at 8.5 s",
    )  # fmt: skip
    assert (second.level, second.answer) == ("look", "Not judged")
    asked = [check.text for check in checks(run) if check.kind == "control"]
    assert asked[-1] == "Drive 1 still moves at 8.5 s"
    after = run.assign_coords(time=run["time"] + 2.0 * (run["time"] == run["time"][-1]))
    for item in (run, after):  # also past the end of the movement as it was planned
        lock, control = lamps(item)[:2]
        assert not lock.on[-1]
        assert (lock.checks[-1].met, control.checks[-1].met) == (None, None)
    assert "sound" not in said(run).lower()
    assert "the switch locks" not in said(run)


def test_a_machine_that_is_never_switched_off_is_given_up() -> None:
    run = stalled()
    begun = movements(run)[1].start
    assert begun == pytest.approx(0.26 + 30.0 + 1.0 + 1.0, abs=0.05)  # limit, gear, rest
    found = verdict(run)
    assert found.kind == "not judged"
    assert f"Drive 1 has not arrived when the next movement begins at {begun:.4g} s" in found.text
    assert "the switch locks" not in said(run)


def test_an_object_is_not_undetected_while_the_machine_moves() -> None:
    """Cut before the clutch slips on it, in contact: nothing reports it, nothing is locked."""
    run = simulate(panel_with(), mode="quick", foreign_object=ForeignObject(0.04, "drive 1"))
    slips = run["time"].values[run["drive_slipping"].values.any(axis=0)]
    touched = float(run["contact_time"])
    assert touched < slips[0]
    assert verdict(run).kind == "detected by slip"
    cut = cut_at(run, 0.5 * (touched + slips[0]))
    assert verdict(cut).kind == "not judged"
    assert "Drive 1" in verdict(cut).text
    assert findings(cut)[0].answer == "Not judged"


def test_a_marker_waits_too() -> None:
    """Drive 2 keeps to the schedule; its return begins when Drive 1 has arrived."""
    slow = {"drive.1.machine": "jea73", "machine.jea73.supply.voltage": 150.0}
    run = simulate(load_panel("uic60-760-1-15", overrides=slow), mode="quick")
    opening, closing = movements(run)
    assert opening.end > 4.4
    marker = run["drive_displacement"].sel(drive="2")
    rests = marker.sel(time=slice(3.41, closing.start)).values
    assert np.ptp(rests) == 0.0
    free = simulate(load_panel("uic60-760-1-15"), mode="quick")["drive_displacement"]
    since = np.arange(0.1, 3.4, 0.1)
    expected = free.sel(drive="2").interp(time=4.4 + since).values
    np.testing.assert_allclose(marker.interp(time=closing.start + since), expected, atol=1e-9)
    assert verdict(run).kind == "sound"


def test_a_stopped_machine_is_not_said_to_slip() -> None:
    run = simulate(panel_with(**{"machine.jea73.circuit.time_out": 3.0}), mode="quick")
    text = verdict(run).text
    assert "Drive 1 is switched off by its time-out before its end position, opening" in text
    assert "slips" not in text
    locked = next(item.detail for item in findings(run) if item.question == "Locked?")
    assert "the lock is refused after the movement to open" in locked
    assert "force;" not in f"{locked};"
    (opening, *_) = concerns(run)
    assert opening.text.startswith(
        "machine does not arrive: drive 1, jea73, opening: is switched off by its time-out before "
        "its end position, 3.0 s after its contactor"
    )


def test_panel_check_warns_of_machines_that_do_not_arrive() -> None:
    assert not [item for item in concerns(thrown()) if item.what == "machine does not arrive"]
    late = [item for item in concerns(stalled()) if item.what == "machine does not arrive"]
    assert "Drive 1 has not arrived" in late[0].number


def test_a_test_piece_is_not_seen_by_a_machine_that_still_moves() -> None:
    endless = panel_with(**{"machine.jea73.circuit.time_out": None})
    found = check_piece(endless, "1", size=0.04)
    assert not found.seen
    assert "Drive 1 still moves" in found.fault


def test_throws_of_a_sequence_wait_each_for_its_machines() -> None:
    def weaker(number: int) -> dict[str, object]:
        return {"machine.jea73.supply.voltage": 220.0 - 50.0 * number}

    made = simulate_sequence(panel_with(), throws=2, change=weaker)
    alone = [
        simulate(panel_with(**{"machine.jea73.supply.voltage": volts}), mode="quick")
        for volts in (220.0, 170.0)
    ]
    assert made.sizes["time"] == alone[1].sizes["time"] > alone[0].sizes["time"]
    for number, expected in enumerate(alone):
        one = made.isel(throw=number)
        assert movements(one) == movements(expected)
        force = one["drive_force"].values
        np.testing.assert_array_equal(force[:, : expected.sizes["time"]], expected["drive_force"])
        assert np.all(force[:, expected.sizes["time"] :] == force[:, -1:])
    assert [row["verdict"] for row in throw_table(made)] == ["sound", "sound"]


def swept(folder: Path, changes: str) -> xr.Dataset:
    """Return a sweep over the voltage of the machine, with some values of its panel."""
    text = f"""
schema_version = 1
name = "late"
panel = "{NAME}"
[set]
"drive.1.machine" = "jea73"
{changes}
[[variable]]
key = "machine.jea73.supply.voltage"
values = ["220 V", "170 V"]
[scheme]
mode = "quick"
[output]
channels = ["drive_force"]
rate = "25 Hz"
"""
    (folder / "study.toml").write_text(text, encoding="utf-8")
    throw_study(load_study(folder / "study.toml"), folder / "out", pool=here)
    return open_batches(folder / "out").load()


def test_throws_of_a_sweep_wait_each_for_its_machines(tmp_path: Path) -> None:
    found = swept(tmp_path, "")
    assert found["end_locked"].values.tolist() == [1, 1]
    last = found["time"].values[np.isfinite(found["drive_force"].values[:, 0]).sum(axis=1) - 1]
    assert last[0] == pytest.approx(float(thrown()["time"][-1]), abs=0.04)
    assert last[1] > last[0] + 1.0
    assert np.isfinite(last_values(found["drive_force"])).all()


def test_a_sweep_knows_no_lock_where_a_movement_is_not_over(tmp_path: Path) -> None:
    """The contactor of the return closes after 0.06 s, when the schedule has ended."""
    late = {"start": "8.46 s", "duration": "0.04 s", "ramp": "0.01 s"}
    changes = [f'"movement.return.{key}" = "{value}"' for key, value in late.items()]
    found = swept(tmp_path, "\n".join(changes))
    assert found["end_locked"].values.tolist() == [-1, -1]
    assert [STATES[state] for state in end_state(found).values] == ["not judged"] * 2
