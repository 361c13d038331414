"""Drives that are machines in a panel: records, overrides, messages, mixed panels, outcomes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from turnout.core.channels import OF_MACHINES
from turnout.core.errors import PanelError, SolverError
from turnout.figures.throw import plot_throw
from turnout.mechanism.drive_machines import command_times, fitted_machine, slip_force
from turnout.metric.summary import summary
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.stored import panel_data, panel_from_data
from turnout.study.virtual.record_throw import Window, extend_schedule, record_throw
from turnout.throw.simulate import simulate

NAME = "uic60-760-1-15"
BOTH = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}


def panel(**changes: object) -> LoadedPanel:
    return load_panel(NAME, overrides=BOTH | changes)


@pytest.fixture(scope="module")
def thrown() -> xr.Dataset:
    return simulate(panel(), mode="quick")


def test_library_machine_becomes_part_of_the_panel() -> None:
    one = panel()
    assert one.machine["jea73"].motor.voltage == 220.0
    assert one.origins["machine.jea73.motor.resistance"].kind == "assumption"
    changed = one.with_overrides({"machine.jea73.motor.voltage": "200 V"})
    assert changed.machine["jea73"].motor.voltage == 200.0
    assert changed.machine["jea73-drive2"].motor.voltage == 220.0
    assert changed.hash != one.hash
    assert one.with_settings(["machine.supply.line_resistance=20 ohm"]).machine[
        "jea73-drive2"
    ].supply.line_resistance == pytest.approx(20.0)
    assert panel_from_data(panel_data(changed)).hash == changed.hash


def test_a_panel_of_markers_keeps_its_hash() -> None:
    """A field that says nothing must not make kept results unusable."""
    markers = load_panel(NAME)
    assert markers.machine == {}
    assert panel().with_overrides(BOTH).hash == panel().hash != markers.hash


def test_own_machine_of_a_panel_file(tmp_path: Path) -> None:
    from turnout.panel.load import library_text

    text = library_text("sb1").replace("[drive.1]", '[drive.1]\nmachine = "jea73"')
    path = tmp_path / "own.toml"
    path.write_text(f'{text}\n[machine.jea73.motor]\nvoltage = "210 V"\n', encoding="utf-8")
    own = load_panel(path)
    assert own.machine["jea73"].motor.voltage == 210.0
    assert own.machine["jea73"].motor.resistance == 13.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drive.1.machine": "jea74"}, "nearest is 'jea73'"),
        ({"machine.jea73.clutch.torque": 50.0}, "the clutch would never slip"),
        ({"machine.jea73.motor.inertia": 0.0}, "must be more than 0"),
        ({"machine.jea73.supply.shared_resistance": 1.0}, "all drives share one supply"),
        (
            {"drive.1.extension": [-0.01, 0.0, 0.01], "drive.1.force": [-6e3, 0.0, 6e3]},
            "a rod moved by a machine is linear",
        ),
    ],
)
def test_bad_input(changes: dict[str, object], message: str) -> None:
    with pytest.raises(PanelError, match=message) as raised:
        panel(**changes)
    assert len(raised.value.problems) == 1


def test_commands_and_limits_follow_from_drive_and_schedule() -> None:
    one = panel(**{"drive.1.over_travel_closed": "4 mm"})
    assert command_times(one, "1").tolist() == [[0.2, -1.0], [4.4, 1.0]]
    assert command_times(one, "2")[:, 0] == pytest.approx([0.2, 4.6])  # starts later on the return
    machine, drive = fitted_machine(one, "1"), one.drive["1"]
    assert machine.circuit.limit_closing == pytest.approx(0.004 - 0.94e-3)
    assert machine.circuit.limit_opening == pytest.approx(
        -drive.stroke - drive.over_travel_open + 0.94e-3
    )
    assert machine.rod.stiffness == drive.stiffness
    assert slip_force(one, "1") == pytest.approx(6000.0, rel=1e-4)
    given = panel(**{"machine.jea73.circuit.limit_closing": "1 mm"})
    assert fitted_machine(given, "1").circuit.limit_closing == pytest.approx(1e-3)


def test_throw_of_the_default_panel(thrown: xr.Dataset) -> None:
    assert set(OF_MACHINES) <= set(thrown)
    assert thrown["throw_time"].values == pytest.approx(
        np.array([[3.19, 3.21], [3.50, 3.44]]), abs=0.03
    )
    ends = thrown["drive_displacement"].isel(time=-1).values
    assert ends == pytest.approx([4.0e-3, 3.8e-3], abs=2e-4)  # the over-travels
    assert not bool(thrown["drive_slipping"].any())
    assert bool(thrown["locked"][-1])
    assert {item["outcome"] for item in json.loads(thrown.attrs["machine_throws"])} == {"limit"}
    movements = json.loads(thrown.attrs["movements"])
    assert movements[-1]["end"] == pytest.approx(8.152, abs=0.01)  # cut-off at 8.098 s
    text = dict(summary(thrown))
    assert text["machine"].startswith("drive 1, jea73, opening: limit contact after 3.19")
    assert "A at most" in text["machine"]


def test_figure_shows_currents(thrown: xr.Dataset) -> None:
    labels = [ax.get_ylabel() for ax in plot_throw(thrown).axes]
    assert "Motor current,\n0.1 s mean [A]" in labels
    assert "Power drawn,\n0.1 s mean [W]" in labels


def test_summary_says_what_each_machine_took(thrown: xr.Dataset) -> None:
    lines = [text for _, text in summary(thrown) if "limit contact after" in text]
    assert len(lines) == 4
    closing = next(text for text in lines if text.startswith("drive 2, jea73-drive2, closing"))
    power = thrown["drive_power"].sel(drive="2")
    off = next(d["off"] for d in json.loads(thrown.attrs["machine_throws"])[::-1])
    mean = float(power.sel(time=slice(off - 0.1, off)).mean())
    assert "limit contact after 3.4" in closing
    assert closing.endswith(f"{mean:.0f} W")


def test_one_machine_and_one_marker() -> None:
    run = simulate(load_panel(NAME, overrides={"drive.1.machine": "jea73"}), mode="quick")
    markers = simulate(load_panel(NAME), mode="quick")
    assert np.isnan(run["drive_current"].sel(drive="2")).all()
    assert bool((run["drive_state"].sel(drive="2") == -1).all())
    assert float(run["drive_current"].sel(drive="1").max()) > 10.0
    np.testing.assert_array_equal(
        run["drive_displacement"].sel(drive="2"), markers["drive_displacement"].sel(drive="2")
    )
    assert bool(run["locked"][-1])
    assert run.attrs["complete"]


def test_a_voltage_that_moves_nothing_is_an_outcome() -> None:
    weak = panel(
        **{"machine.jea73.supply.voltage": 5.0, "machine.jea73-drive2.supply.voltage": 5.0}
    )
    run = simulate(weak, mode="quick")
    assert run.attrs["complete"]
    first = json.loads(run.attrs["machine_throws"])[0]
    assert (first["to"], first["outcome"]) == ("open", "stalled")
    assert not bool(run["locked"].sel(time=slice(0.3, 4.0)).any())


def test_a_crank_covers_the_travel_of_its_drive() -> None:
    run = simulate(panel(**{"drive.1.machine": "irs"}), mode="quick")
    place = run["drive_displacement"].sel(drive="1")
    assert float(place.min()) == pytest.approx(-0.117, abs=5e-4)
    assert run.attrs["complete"]


def test_lost_motion_of_the_rod() -> None:
    run = simulate(panel(**{"machine.jea73.rod.play": "2 mm"}), mode="quick")
    assert run.attrs["complete"]
    assert float(abs(run["energy_residual"]).max()) < 1e-6 * run.attrs["energy_scale"]


def test_quasi_static_is_refused() -> None:
    with pytest.raises(SolverError, match="has no time for the machines of drives 1, 2"):
        simulate(panel(), mode="quasi-static")


def test_stored_instants_between_the_steps() -> None:
    from turnout.core.scheme import Scheme

    scheme = Scheme.of("quick")
    run = simulate(panel(), scheme=replace(scheme, output_interval=1e-3))
    assert run.sizes["time"] == 8501
    assert float(run["drive_current"].max()) > 10.0


def test_virtual_recording_takes_the_simulated_current() -> None:
    long = extend_schedule(panel())
    assert long.schedule.end == pytest.approx(4.6 + 8.06 + 1.0)
    run = simulate(long, mode="quick", foreign_object=ForeignObject(0.013, "drive 1"))
    seen = record_throw(run, direction="closing", window=Window())
    time = seen["time"].values
    current = seen["drive_current"].sel(drive="1").values
    assert current[(time > 7.0) & (time < 9.5)] == pytest.approx(2.0, abs=1e-3)
    assert time[current > 0.5][-1] == pytest.approx(2.0 + 8.06, abs=0.02)
    assert seen.attrs["slipped"] == "1"
    opening = record_throw(run, direction="opening", window=Window())
    assert float(opening["drive_current"].mean()) > 0.0


def test_the_limit_contact_waits_for_the_rail(thrown: xr.Dataset) -> None:
    """`circuit.lock_gap`: the rod goes on beyond the contact until the rail is near enough."""
    gap = thrown["drive_gap"].sel(drive="2")
    free = json.loads(thrown.attrs["machine_throws"])
    contact = next(d["off"] for d in free if d["drive"] == "2" and d["to"] == "closed")
    at_contact = float(gap.interp(time=contact))
    assert at_contact > 1e-3
    near = {"machine.jea73-drive2.circuit.lock_gap": 0.7 * at_contact}
    wide = {"machine.jea73-drive2.circuit.lock_gap": 2.0 * at_contact}
    waits, same = (simulate(panel(**more), mode="quick") for more in (near, wide))
    np.testing.assert_array_equal(same["drive_force"], thrown["drive_force"])
    made = [d for d in json.loads(waits.attrs["machine_throws"]) if d["to"] == "closed"]
    later = next(d for d in made if d["drive"] == "2")
    assert later["outcome"] == "limit"
    assert later["off"] > contact + 0.02
    left = float(waits["drive_gap"].sel(drive="2").interp(time=later["off"]))
    # seen at the start of a step, acted on at its end: two steps of 4 ms at 27 mm/s
    assert 0.0 <= 0.7 * at_contact - left < 2.2e-4
    opened = [d for d in json.loads(waits.attrs["machine_throws"]) if d["to"] == "open"]
    assert [d["outcome"] for d in opened] == ["limit", "limit"]
