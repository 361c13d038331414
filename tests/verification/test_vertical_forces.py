"""Bent rods, sloping faces and rollers: vertical forces that lateral ones make, in closed form.

A block of weight W on a plate is pushed through a rod of slope t: it slides at F = mu (W - t F) and
is lifted off at F = W / t. A foot on plate and roller has the force N_p = (k_p N - k_p k_r h) /
(k_p + k_r) on the plate, h the lift. Tolerance: 1e-3 for the inertia of a block moved slowly, 1e-6
where only the laws enter.
"""

import numpy as np
import pytest
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run, smooth_ramp

import turnout
from turnout.law.table import LawTableBuilder
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.solver.integration import History

WEIGHT, MU, SLOPE, ROD, PLATE, STICK = 440.0, 0.4, 0.25, 7.5e5, 2e7, 1e7
PANEL = turnout.load_panel("uic60-760-1-15")


def pushed(reach: float) -> History:
    """Push a block, free in y and z, through a rod of slope t by a marker."""
    laws = LawTableBuilder()
    linear_spring(laws, 0, ROD, input_index=0)
    contact = laws.add_contact(1, stiffness=PLATE, clearance=0.0, base_closed=True)
    laws.add_friction(2, normal=contact, friction_coefficient=MU, stick_stiffness=STICK)
    mechanism = hand_made(
        laws,
        mass=[1.0, 1.0],
        rows=[[1.0, SLOPE], [0.0, -1.0], [1.0, 0.0]],
        damping=np.diag([50.0, 4e3]),
        load=[0.0, -WEIGHT],
    )
    return run(mechanism, lambda t: reach * smooth_ramp(t, start=0.1, end=4.0), end=4.0)


def test_a_pushed_block_slides_at_the_friction_that_the_rod_leaves() -> None:
    history = pushed(1e-3)
    slides = (history.time > 2.0) & (history.time < 3.5)
    found, load = -history.law_force[slides, 0], history.law_force[slides, 1]
    assert np.median(found) == pytest.approx(MU * WEIGHT / (1 + MU * SLOPE), rel=1e-3)
    assert load == pytest.approx(WEIGHT - SLOPE * found, rel=1e-3)
    assert energy_residual(history) < 1e-6


def row_of(panel: LoadedPanel, name: str, x: str | None = None) -> np.ndarray:
    """Return the row of a drive, or of an object at a place."""
    objects = resolve_objects(panel, [ForeignObject(0.013, x)]) if x else ()
    mechanism = build_mechanism(panel, objects)
    law = mechanism.index.object["1"] if x else mechanism.index.drive[name]
    return np.asarray(mechanism.rows[mechanism.laws.row[law]])


def vertical(panel: LoadedPanel, coordinates: np.ndarray, x: float) -> float:
    """Return u_z of the instrumented rail's reference line at a node for some coordinates [m]."""
    body = build_mechanism(panel).rails[0]
    node = int(np.argmin(np.abs(body.x - x)))
    return float(body.recovery[6 * node + 2] @ coordinates[body.first : body.first + body.count])


def lifted(panel: LoadedPanel) -> np.ndarray:
    """Return coordinates in which the instrumented rail rises as it stands [m]."""
    body = build_mechanism(panel).rails[0]
    up = np.zeros(6 * body.x.size)
    up[2::6] = 1.0 + 0.3 * body.x
    up[4::6] = -0.3
    found = np.zeros(sum(rail.count for rail in build_mechanism(panel).rails))
    place = slice(body.first, body.first + body.count)
    found[place] = np.linalg.lstsq(body.recovery, up, rcond=None)[0]
    return found


@pytest.mark.parametrize("x", ["sleeper 6", "x = 3.7 m"])
def test_a_sloping_face_adds_its_share_of_the_rise_at_nodes_and_between(x: str) -> None:
    sloped = PANEL.with_overrides({"object_defaults.face_slope": SLOPE})
    rise = lifted(PANEL)
    at = 3.6 if x == "sleeper 6" else 3.7
    found = (row_of(sloped, "", x) - row_of(PANEL, "", x)) @ rise
    assert found == pytest.approx(-SLOPE * (1.0 + 0.3 * at), rel=2e-3)  # rails are clamped far off
    assert vertical(PANEL, rise, 3.6) == pytest.approx(1.0 + 0.3 * 3.6, rel=2e-3)


def test_a_bent_rod_takes_its_share_of_the_load_of_chairs() -> None:
    """The sum of vertical forces: what chairs, rods and fastenings carry is the weight."""
    slope = 0.086
    bent = PANEL.with_overrides({"drive.rod_slope": slope})
    plain, throw = (turnout.simulate(item, mode="quick") for item in (PANEL, bent))
    force = throw["drive_force"].isel(time=-1).sum().item()  # both drives move this rail
    loads = [item["chair_normal_force"].isel(time=-1).sum().item() for item in (plain, throw)]
    assert loads[0] - loads[1] == pytest.approx(
        slope * force, rel=5e-3
    )  # fastenings carry the rest
    assert float(abs(throw["energy_residual"]).max()) < 1e-6 * float(throw["work_markers"].max())


def test_a_roller_carries_the_foot_before_the_plate_does() -> None:
    """Friction of a chair that slides is that of its shares on plate and roller."""
    plate, spring, lift, rolling = 1e7, 2e5, 1e-4, 0.03
    values = {"chair.roller_lift": lift, "chair.roller_stiffness": spring}
    throw = turnout.simulate(PANEL.with_overrides(values), mode="quick")
    at = {"rail": "straight", "chair": "9"}
    load, friction = (
        throw[name].sel(at).sel(time=slice(6.0, 6.5)).to_numpy()
        for name in ("chair_normal_force", "chair_friction_force")
    )
    on_plate = plate * (load - 2 * spring * lift) / (plate + spring)  # two foot points, both down
    expected = MU * on_plate + rolling * (load - on_plate)
    assert on_plate.min() > 0.0
    assert np.abs(friction) == pytest.approx(expected, rel=1e-6)
    assert float(abs(throw["energy_residual"]).max()) < 1e-6 * float(throw["work_markers"].max())


def test_a_roller_below_the_plate_is_none_and_forces_rise_from_there() -> None:
    """From where the plate yields as far rollers take over, at first as good as nothing."""
    none = turnout.simulate(PANEL, mode="quick")["drive_force"]
    below, reached, flush, above = (
        float(abs(turnout.simulate(rolling, mode="quick")["drive_force"] - none).max())
        for rolling in (
            PANEL.with_overrides({"chair.roller_lift": lift}) for lift in (-1e-4, -2e-5, 0.0, 2e-5)
        )
    )
    assert below < 0.1  # N; rounding, which feet that stick and slip enlarge
    assert below < reached < 0.1 * flush
    assert flush < above < 3.0 * flush
