"""Lock bars of machines, and the lost motion of a clamp lock between the rails.

References in closed form: a bar of way s takes the shaft N s, with the current of the steady point
under the torque ``F / (N eta)``; the rod stands meanwhile. A slide of a clamp lock runs through
w + p: the rail that opens begins when p of it are done, the one that closes is home p before the
end. Tolerance: 0.5 % of currents, 1 % of times, 1e-12 of ways.
"""

import numpy as np
import pytest

from turnout.core.errors import MachineError, PanelError
from turnout.machine.machine_file import load_machines
from turnout.machine.rows import CORNER
from turnout.machine.steady import steady_point
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_positions
from turnout.throw.machine import throw_one_mass
from turnout.throw.simulate import simulate

STROKE = 0.014


def thrown(**lock: object):
    given = {f"lock.{key}": value for key, value in lock.items()}
    return throw_one_mass("jea73", overrides={**given, "throw.duration": "6 s"})


@pytest.mark.parametrize("force", [0.0, 1000.0, 2000.0])
def test_the_bar_takes_current_and_time_of_the_steady_point(force: float) -> None:
    machine = load_machines("jea73").machine["jea73"]
    torque = force / (5440.0 * machine.gear.efficiency)
    steady = steady_point(machine, torque=torque)
    plain, locked = thrown(), thrown(stroke=STROKE, force=force)
    assert locked.energy_residual < 1e-9
    assert locked.outcome == "limit"
    time, current = locked["time"], locked["current"]
    off = next(at for at, what in locked.events if what.startswith("off"))
    ends = (time > 0.45) & (time < 0.55), (time > off - 0.15) & (time < off - 0.05)
    for part in ends:
        assert current[part].mean() == pytest.approx(steady.current, rel=0.005)
        assert np.ptp(locked["rod_position"][part]) == 0.0
    more = locked.energised_time - plain.energised_time
    # the limit contact acts at the end of the bar, not the overrun before the end of the way
    way = 2 * STROKE + CORNER + machine.circuit.overrun
    assert more == pytest.approx(5440.0 * way / steady.speed, rel=0.01)
    middle = (time > 2.0) & (time < 3.0)
    later = np.interp(time[middle] - 0.5 * more, plain["time"], plain["current"])
    assert current[middle] == pytest.approx(later, rel=0.02)


def test_without_a_force_a_table_changes_no_bit() -> None:
    plain = throw_one_mass("zd6")
    barred = throw_one_mass("zd6", overrides={"lock.force": 0.0})
    assert np.array_equal(plain["current"], barred["current"])
    heavy = throw_one_mass("zd6", overrides={"lock.force": "500 N"})
    assert heavy.energised_time > plain.energised_time


def test_a_panel_throws_with_lock_bars() -> None:
    panel = load_panel("uic60-760-1-15-jea73")
    bars = {"machine.lock.stroke": "14 mm", "machine.lock.force": "1 kN"}
    plain, barred = (simulate(item, mode="quick") for item in (panel, panel.with_overrides(bars)))
    assert all(bool(item["locked"][-1]) for item in (plain, barred))
    ends = [item["drive_force"].values[:, -1] for item in (plain, barred)]
    assert ends[1] == pytest.approx(ends[0], rel=0.05)
    closed = plain["drive_displacement"].values[:, -1]
    assert barred["drive_displacement"].values[:, -1] == pytest.approx(closed, abs=5e-4)
    scale = float(plain["energy_friction"].max())
    assert float(abs(barred["energy_residual"]).max()) < 1e-6 * scale
    # each bar unlocks before the way and locks after it, in both movements, one rod like the other
    for drive, name in enumerate(panel.machine):
        machine = panel.machine[name]
        way = 2 * STROKE + CORNER + machine.circuit.overrun
        torque = 1000.0 / (machine.stroke.ratio * machine.gear.efficiency)
        more = machine.stroke.ratio * way / steady_point(machine, torque=torque).speed
        times = [item["throw_time"].values[drive] for item in (plain, barred)]
        assert times[1] - times[0] == pytest.approx([more, more], rel=0.05)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"force": "1 kN"}, "lock.stroke is needed with a screw"),
        ({"stroke": "10 mm", "force": "7 kN"}, r"never unlocks; at most 6000 N"),
        ({"stroke": "-1 mm"}, "lock.stroke"),
        ({"stroke": "1 mm", "force": "-2 N"}, "lock.force"),
    ],
)
def test_impossible_bars_are_refused(given: dict, said: str) -> None:
    with pytest.raises(MachineError, match=said) as caught:
        thrown(**given)
    assert len(caught.value.problems) == 1


def test_a_table_has_its_own_dwells() -> None:
    with pytest.raises(MachineError, match=r"of screws; a table stands where its length_share"):
        throw_one_mass("zd6", overrides={"lock.stroke": "5 mm"})


CLAMP = load_panel("60e1-300-1-9-clamp-lock")


def test_the_slide_of_a_clamp_lock_moves_the_open_rail_first() -> None:
    lost = 0.06
    panel = CLAMP.with_overrides({"drive.lost_motion": lost})
    time = np.linspace(0.0, panel.schedule.end, 4001)
    plain, found = marker_positions(CLAMP, time), marker_positions(panel, time)
    np.testing.assert_array_equal(found[:, [0, -1]], plain[:, [0, -1]])
    for name, movement in panel.movement.items():
        for row, drive in enumerate(panel.drive.values()):
            over = movement.start + movement.duration
            during = (time >= movement.start) & (time <= over)
            begin = plain[row, time < movement.start][-1]
            way = abs(plain[row, time > over][0] - begin)
            slide = np.abs(plain[row, during] - begin) / way * (way + lost)
            opens = (movement.to == "open") == (panel.rail[drive.rail].closes == "+y")
            expected = np.clip(slide - lost if opens else slide, 0.0, way)
            moved = np.abs(found[row, during] - begin)
            np.testing.assert_allclose(moved, expected, atol=1e-12, err_msg=name)


def test_a_clamp_lock_with_lost_motion_still_locks() -> None:
    panel = CLAMP.with_overrides({"drive.lost_motion": "60 mm"})
    plain, found = (simulate(item, mode="quick") for item in (CLAMP, panel))
    assert bool(plain["locked"][-1])
    assert bool(found["locked"][-1])
    first = [
        float(np.ptp(item["drive_displacement"].values[:, :200], axis=1).min())
        for item in (plain, found)
    ]
    assert first[1] < first[0]
    assert float(abs(found["energy_residual"]).max()) < 1e-6 * float(found["energy_friction"].max())


def test_lost_motion_is_of_markers() -> None:
    given = {"drive.1.machine": "jea73", "drive.1.lost_motion": "60 mm"}
    with pytest.raises(PanelError, match=r"lost_motion = 0.06 m: is of markers; give machine"):
        load_panel("uic60-760-1-15").with_overrides(given)
