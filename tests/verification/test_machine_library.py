"""Library machines inside their data sheets, and JEA 73 as its parameter set says.

Sources: JEA 73: the paper (DC motor, 6 kN at most, clutch set to slip at 2 A) and the parameter
study `jea73.md` of the benchmark SB3 (all else). ZD6: at most 2.0 A at 0.88 N m (2450 N), slip at
2.3 to 2.9 A (360docs.net/doc/a89997606.html), 3.8 s at most. IRS: 5.3 A rated, 8.5 A at most,
1700 rpm +-15 %, 440 W, 4.4 kN, 143 mm (pdfslide.net/document/point-machine.html), 4.0 s at most
(scribd.com/doc/8242982), slip at 6 to 7 A.

ZDJ9: 380 V, 2.5 kN over 220 mm in at most 5.8 s with at most 2.0 A behind 54 ohm a line; S700K:
380 V, 3 kN over 220 mm in at most 6.6 s; M70: slips at about 150 % of the running current, 115 mm,
cut off after about 10 s (RailCorp TMG E1583). The table of docs/evidence/machines.md is
written by `python -m benchmarks.studies.machine_page`.
"""

import tomllib
from dataclasses import dataclass

import numpy as np
import pytest

from turnout.calibration.load_study import load_panel_or_case
from turnout.core.keys import origin_at
from turnout.machine.machine_file import load_machines, machine_names, machine_text
from turnout.machine.steady import slip_point, supply_slopes
from turnout.mechanism.drive_machines import slip_force
from turnout.throw.machine import throw_one_mass
from turnout.throw.simulate import simulate
from turnout.throw.slip import machine_throws


@dataclass(frozen=True)
class Sheet:
    """What a machine does under its rated force."""

    force: float
    running_current: float
    shaft_speed: float
    power: float
    time: float
    slip_current: float
    peak: float


RATED = {
    **{"jea73": 3000.0, "jea73-drive2": 3000.0, "zd6": 2450.0, "irs": 4413.0},
    **{"s700k": 3000.0, "zdj9": 2500.0, "m70": 2000.0, "three-phase": 1500.0},
}
LIMITS = {
    "jea73": {"slip_current": (1.98, 2.02), "time": (3.0, 3.6)},
    "jea73-drive2": {"slip_current": (1.75, 1.78), "time": (3.2, 3.8)},
    "zd6": {
        "running_current": (1.5, 2.0),
        "slip_current": (2.3, 2.9),
        "time": (2.5, 3.8),
    },
    "irs": {
        "running_current": (4.0, 6.0),
        "shaft_speed": (0.85 * 178.0, 1.15 * 178.0),
        "slip_current": (6.0, 7.0),
        "time": (3.0, 4.0),
    },
    "s700k": {"running_current": (1.0, 2.0), "time": (4.5, 6.6)},
    "zdj9": {"running_current": (1.0, 2.0), "time": (4.5, 5.8)},
    "three-phase": {"running_current": (2.26, 2.52), "power": (310, 455), "time": (4.9, 5.3)},
    "m70": {"slip_current": (1.4 * 3.05, 1.6 * 3.05), "running_current": (2.9, 3.2)},
}


def sheet_of(name: str) -> Sheet:
    """Throw a machine against its rated force all the way, then against a wall."""
    force = RATED[name]
    rated = throw_one_mass(
        name,
        overrides={
            "rail.friction_force": force,
            "rail.friction_at_start": 0.0,
            "rail.bed_stiffness": 0.0,
            "rail.mass": 1.0,
            "rail.damping": 100.0,
            "throw.duration": 8.0,
        },
    )
    x = rated["rod_position"]
    at = np.searchsorted(x, 0.5 * (x.min() + x.max()))
    wall = throw_one_mass(name, overrides={"rail.object_size": 0.03, "throw.duration": 15.0})
    last = np.flatnonzero(wall["energised"])[-10]
    return Sheet(
        force=float(rated["rod_force"][at]),
        running_current=float(rated["lead_current"][at]),
        shaft_speed=float(rated["speed"][at]),
        power=float(rated["power"][at]),
        time=rated.energised_time,
        slip_current=float(wall["lead_current"][last]),
        peak=float(rated["lead_current"].max()),
    )


@pytest.mark.parametrize("name", LIMITS)
def test_inside_the_data_sheet(name: str) -> None:
    sheet = sheet_of(name)
    assert sheet.force == pytest.approx(RATED[name], rel=0.01)
    for key, (low, high) in LIMITS[name].items():
        assert low <= getattr(sheet, key) <= high, key


def test_strokes_supplies_and_cut_offs_of_the_sheets() -> None:
    """220 mm of S700K and ZDJ9 at 380 V, 54 ohm a line of ZDJ9; M70: 115 mm, off after 10 s."""
    assert load_machines("m70").machine["m70"].stroke.length == pytest.approx(0.115, rel=1e-12)
    for name in ("s700k", "zdj9"):
        circuit = load_machines(name).machine[name].circuit
        assert circuit.limit_closing is not None
        assert circuit.limit_opening is not None
        assert circuit.limit_closing - circuit.limit_opening == pytest.approx(0.22, rel=1e-12)
        assert load_machines(name).machine[name].motor.voltage == 380.0
    assert load_machines("zdj9").machine["zdj9"].supply.line_resistance == 54.0
    sheet = sheet_of("m70")
    assert sheet.slip_current / sheet.running_current == pytest.approx(1.5, abs=0.1)
    wall = throw_one_mass("m70", overrides={"rail.object_size": 0.03, "throw.duration": 12.0})
    assert wall.outcome == "time-out"
    assert wall.energised_time == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    ("name", "time", "peak", "peak_time", "slip", "held", "end"),
    [
        ("jea73", 3.2, 10.33, 0.019, 2.000, 6099, 2993),
        ("jea73-drive2", 3.4, 10.30, 0.019, 1.763, 6937, 2996),
    ],
)
def test_jea73_as_published_with_its_parameters(
    name: str, time: float, peak: float, peak_time: float, slip: float, held: float, end: float
) -> None:
    """Supply time, inrush, slip current, held force and end force of jea73.md."""
    sound = throw_one_mass(name)
    assert sound.energised_time == pytest.approx(time, rel=2e-3)
    current = sound["current"]
    assert current.max() == pytest.approx(peak, rel=2e-3)
    assert sound.time[current.argmax()] - 0.16 == pytest.approx(peak_time, abs=1.5e-3)
    assert sound["rod_force"][-1] == pytest.approx(end, rel=6e-3)
    wall = throw_one_mass(name, overrides={"rail.object_size": 0.013, "throw.duration": 8.8})
    at = np.searchsorted(wall.time, 8.1)
    assert wall["current"][at] == pytest.approx(slip, rel=1e-3)
    # the overshoot that the standing gear keeps hangs on the reduced rail
    assert wall["rod_force"][-1] == pytest.approx(held, rel=6e-3)


@pytest.mark.parametrize("name", machine_names())
def test_every_number_has_an_origin(name: str) -> None:
    loaded = load_machines(name)
    values = loaded.model_dump(exclude={"schema_version", "name", "description"})
    written = _keys("", tomllib.loads(machine_text(name)))
    given = [key for key in written if key.split(".")[0] in values]
    missing = [key for key in given if origin_at(loaded.origins, key) is None]
    assert not missing
    assert len(given) > 30


def _keys(prefix: str, value: object) -> list[str]:
    if not isinstance(value, dict):
        return [prefix]
    return [
        key for name, item in value.items() for key in _keys(f"{prefix}.{name}".strip("."), item)
    ]


def test_slopes_of_the_generic_machine_are_those_on_record() -> None:
    """SwitchMonitor, six machines: 23 to 28 mA per volt, -47 to -97 mA per 100 W."""
    machine = load_machines("three-phase").machine["three-phase"]
    for force in (1000.0, 1500.0, 2000.0):
        point, per_volt, per_watt = supply_slopes(machine, force=force)
        assert 0.023 < per_volt < 0.028
        assert -97e-5 < per_watt < -47e-5
        assert 2.26 < point.current < 2.52
        assert 310.0 < point.power < 455.0


@pytest.mark.parametrize("name", ["s700k", "zdj9", "three-phase"])
def test_currents_of_three_phase_machines_fall_with_the_load(name: str) -> None:
    assert supply_slopes(load_machines(name).machine[name], force=1500.0)[2] < 0.0


@pytest.mark.parametrize("number", [0, 17, 42])
def test_plausible_machines_meet_the_facts_of_the_paper(number: int) -> None:
    """2 A at the slip of Drive 1, 6 and 6.85 kN, 3.2 s of supply and at Drive 2 0.2 s more."""
    panel = load_panel_or_case(f"plausible-machines:{number}")
    assert slip_point(panel.machine["jea73"]).current == pytest.approx(2.0, rel=2e-3)
    held = [slip_force(panel, name) for name in panel.drive]
    assert held == pytest.approx([6000.0, 6850.0], rel=1e-4)
    thrown = simulate(panel, mode="quick")
    assert bool(thrown["locked"][-1])
    late = panel.movement["return"].extra_time["2"]
    closing = [item for item in machine_throws(thrown) if item["to"] == "closed"]
    times = [item["off"] - item["on"] for item in closing]
    assert times == pytest.approx([3.2, 3.4 - late], rel=2e-3)
