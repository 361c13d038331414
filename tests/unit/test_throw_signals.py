"""Signs and sums of the channels, on the whole panel."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.simulated import OBJECT, sb1_dataset, sb2_dataset, sb2_panel, sb2_run

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.profile import running_edge_distance, running_edge_offset
from turnout.throw.gaps import gap_rows
from turnout.throw.recovery import recover_motion, row_motion
from turnout.throw.simulate import simulate

OPENING, CLOSING, END = 2.0, 6.0, 8.4


def at(dataset: Any, time: float) -> Any:
    return dataset.sel(time=time, method="nearest")


@pytest.mark.parametrize(
    ("channel", "where", "sign", "least"),
    [
        # drives pull open and push closed
        ("drive_force", {"drive": "2"}, 1.0, 1e3),
        # tension is positive: rail A pulls B when it closes, and pushes it when it opens
        ("link_force", {"link": "2"}, 1.0, 500.0),
        # friction opposes the motion; away from the ends every chair slides
        ("chair_friction_force", {"chair": slice("3", "12")}, -1.0, 0.0),
    ],
)
def test_forces_turn_with_the_motion(
    channel: str, where: dict[str, object], sign: float, least: float
) -> None:
    force = sign * sb2_dataset()[channel].sel(where)
    assert (at(force, OPENING) < -least).all()
    assert (at(force, CLOSING) > least).all()


def test_marker_power_is_force_times_marker_speed() -> None:
    dataset = sb2_dataset()
    force = dataset["drive_force"].values
    moved = np.diff(dataset["drive_displacement"].values, axis=1)
    work = np.sum(0.5 * (force[:, 1:] + force[:, :-1]) * moved)
    assert work == pytest.approx(float(dataset["work_markers"][-1]), rel=1e-9)


def test_chairs_carry_the_weight() -> None:
    """The benchmark's sum of static chair forces, 16.30 kN to 0.5 %."""
    weight = at(sb2_dataset(), 0.0)["chair_normal_force"].sum()
    assert float(weight) == pytest.approx(16300.0, rel=5e-3)


def test_unilateral_forces_are_never_negative_and_friction_stays_within_its_cone() -> None:
    """But for what the scheme overlooks: its gap tolerance times the stiffness."""
    dataset = sb2_dataset()
    friction, normal = dataset["chair_friction_force"], dataset["chair_normal_force"]
    assert (abs(friction) <= 0.4 * normal + 1e-3).all()
    overlooked = dataset.attrs["gap_tolerance"] * 2e8
    for name in ("object_force", "chair_normal_force", "stop_force"):
        assert (dataset[name] >= -1.01 * overlooked).all(), name
    assert dataset["stop_force"].max() > 10.0


def test_gap_is_the_distance_to_the_stock_rail() -> None:
    """Rail A stands open after the throw and closed before and after, rail B the other way."""
    gap = sb2_dataset()["gap"].sel(x=0.6)
    assert float(at(gap, 4.0).sel(rail="A")) > 0.1
    assert abs(float(at(gap, 4.0).sel(rail="B"))) < 2e-3
    assert float(at(gap, END).sel(rail="B")) > 0.1


def test_drive_gap_follows_the_rail_that_should_be_closed() -> None:
    run = sb2_run()
    motion = recover_motion(run.mechanism, run.history)
    drive = run.panel.drive["2"]
    x, z = np.array([drive.x]), np.array([drive.height])
    found = sb2_dataset()["drive_gap"].sel(drive="2")
    for rail, time in (("A", 0.1), ("B", 4.0), ("A", END)):
        number = int(np.argmin(np.abs(run.history.time - time)))
        start, parts = gap_rows(run.panel, motion, rail, x, z)
        expected = start[:, np.newaxis] - row_motion(motion, parts, at=np.array([number]))
        value = float(found.sel(time=run.history.time[number], method="nearest"))
        assert value == pytest.approx(expected[0, 0], abs=1e-12)


def test_a_trapped_object_holds_the_gap_at_its_size() -> None:
    end = at(sb2_dataset(), END)
    penetration = float(end["object_force"]) / 40e6
    gap = float(end["sensor_gap"].sel(sensor="TKK1"))
    assert gap == pytest.approx(0.013 - penetration, abs=1e-9)


def test_several_objects_are_summed_and_distinguished() -> None:
    other = ForeignObject("10 mm", "sleeper 9")
    panel = sb2_panel().with_overrides({"movement.return.duration": 2.0, "schedule.end": 7.0})
    both = simulate(panel, foreign_object=[OBJECT, other])
    forces = both["single_object_force"]
    assert forces.sizes["object"] == 2
    np.testing.assert_allclose(forces.sum("object"), both["object_force"], rtol=0, atol=1e-9)
    assert float(both["contact_time"]) == float(both["object_contact_time"].min())


def test_one_rail_has_no_links_and_its_own_gap() -> None:
    dataset = sb1_dataset()
    assert "link_force" not in dataset
    assert dataset.sizes["rail"] == 1
    np.testing.assert_allclose(dataset["drive_gap"].isel(time=0), [0.1117, 0.0109], atol=1e-3)


def test_running_edges_part_behind_the_planing() -> None:
    """The flangeway needs the true distance, which the section's offset stops short of."""
    edge = sb2_panel().rail["A"].running_edge
    assert edge is not None
    x = np.linspace(0.0, 18.0, 40)
    true, held = running_edge_distance(edge, x), running_edge_offset(edge, x)
    below = true < edge.maximum
    np.testing.assert_allclose(true[below], held[below], rtol=0, atol=1e-15)
    assert true[-1] == pytest.approx(20.1**2 / (2 * 760.7))


def test_channels_agree_with_an_independent_program(reference_dir: Path) -> None:
    """Benchmark SB2: signs turned as its README says, gaps to 0.15 mm, forces to 5 % of peak."""
    dataset = sb2_dataset()
    with np.load(reference_dir / "sb2" / "sleeper6_13mm.npz") as stored:
        theirs = dict(stored)
    named = ["drive_displacement", "sensor_gap", "chair_friction_force", "lateral_displacement"]
    ours = dataset[named].sel(time=theirs["time"], method="nearest")
    marker = -np.array([theirs["marker1"], theirs["marker2"]])
    np.testing.assert_allclose(ours["drive_displacement"], marker, rtol=0, atol=1e-6)
    sensors = theirs["gap"][:, 2:].T
    np.testing.assert_allclose(ours["sensor_gap"][:, -100:], sensors[:, -100:], atol=1.5e-4)
    friction = ours["chair_friction_force"].sel(rail="A").values.T
    middle = np.searchsorted(theirs["time"], [OPENING, CLOSING])
    peak = np.abs(theirs["chair_friction_A"]).max()
    close = np.abs(friction - theirs["chair_friction_A"])[middle][:, 2:12]
    assert close.max() < 0.05 * peak
    moved = -theirs["displacement_A"][middle][:, :12]
    places = theirs["chairs_x"][:12]
    ours_moved = ours["lateral_displacement"].sel(rail="A").sel(x=places, method="nearest")
    np.testing.assert_allclose(ours_moved.values.T[middle], moved, rtol=0.03, atol=5e-4)
