"""Defects of a switch, one row each: what it changes in a sound throw, where it counts, its words.

Virtual campaigns, the detector with its training and figures, and the open benchmark read the table
`DEFECTS`; a new defect is a row of it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from turnout.study.scenario import Value
from turnout.study.study import Study

Row = dict[str, Value]
Rng = np.random.Generator

OTHER_RAIL = " other rail"
"""Ends the name of the chair under the rail that is not instrumented."""
DRY_FRICTION = (0.6, 0.8)
"""Friction coefficient of chairs that ran dry [-]."""
ADJUSTMENT = 1.2e-3
"""Largest change of a closing over-travel by hand [m]."""
CLUTCH_SHARE, ROD_SHARE = (0.5, 0.9), (0.1, 0.7)
"""Slip level of a worn clutch and stiffness of a loose rod, shares of the sound value [-]."""
FROZEN_FORCE, FROZEN_CHAIRS = (50.0, 1600.0), (3, 25)
"""Force at which the ice on a chair breaks [N], and how many chairs in a row are frozen."""
SLOWER = (0.15, 0.6)
"""By how much the movement of a marker takes longer: weak supply, brushes, dry gear [s]."""
WEAKER = (0.85, 0.97)
"""Share of its rated voltage that the motor of a slow machine gets [-]."""
DRY_GEAR = (0.2, 1.0)
"""Severity of a gear that runs dry: the most severe loses `EFFICIENCY_LOST` of its efficiency and
doubles the dry friction of the motor [-]."""
EFFICIENCY_LOST = 0.3
GEAR_SHARE = 0.5
"""Share of the faults within machines that are of gear and bearings; the others are of the motor,
its brushes or its own cable [-]."""

DEFECT = ", defect"
"""Ends the name of a factor that is 1 in a sound switch."""
DEFECT_FIELDS = ("stiffness", "saturation_force")
"""Values of a drive that have such a factor."""
ADJUSTED_AFTER = 1e-3
"""Change of a closing over-travel by hand in a switch with a history [m]."""
CHAIR_FRICTION = ".friction_coefficient"


class Switches(Protocol):
    """Population of switches that rows of sound throws are drawn from."""

    study: Study
    chairs: tuple[str, ...]

    def friction(self, row: Mapping[str, Value]) -> float:
        """Return the friction coefficient that factors of chairs multiply [-]."""


ALL_DRIVES = 2
"""Of `Defect.slows`."""
Change = Callable[[Row, Rng, Switches], Row]


@dataclass(frozen=True, slots=True, kw_only=True)
class Defect:
    """One defect of a switch.

    Attributes
    ----------
    advice : str
        Remedy for a throw that shows it.
    change : callable or None
        Makes a throw of it from a sound one; None of one that only virtual campaigns have.
    later : callable or None
        The same for a switch with a history; default `change`.
    trained : bool
        Whether a detector learns it.
    times : int
        Throws to learn from, for one of most others.
    needs_history : bool
        Whether it is a part of the population, so that without a history it has no name.
    irregular : float
        Weight of what is left irregular in what speaks for it [-].
    least_support : float or None
        Support below which it is not named; default that of all [-].
    slows : int
        How many drives it slows: 0, 1, or `ALL_DRIVES`.
    trend : int
        Its rank among the lines of a trend over throws; 0: it has none.
    benchmark : bool
        Whether the open benchmark has throws of it.
    weakens : bool
        Whether it may leave a drive too weak to hold its rail at rest.
    campaign : mapping of str to float
        Of a virtual campaign: fields of `turnout.study.virtual.campaign_plan.Defects`.
    """

    advice: str
    change: Change | None = None
    later: Change | None = None
    trained: bool = True
    times: int = 1
    needs_history: bool = False
    irregular: float = 0.0
    least_support: float | None = None
    slows: int = 0
    trend: int = 0
    benchmark: bool = False
    weakens: bool = False
    campaign: Mapping[str, float] = field(default_factory=dict)


def over_travel(drive: str) -> str:
    """Return the key of the closing over-travel of a drive."""
    return f"drive.{drive}.over_travel_closed"


def defect(drive: str, field: str) -> str:
    """Return the name of the factor by which a defect changes a value of a drive."""
    return f"drive.{drive}.{field}{DEFECT}"


def supply_voltage(machine: str) -> str:
    """Return the key of the voltage that a machine is fed with."""
    return f"machine.{machine}.supply.voltage"


def chair_factor(chair: str) -> str:
    """Return the name of the factor on a chair's friction."""
    return f"chair.{chair}{CHAIR_FRICTION}"


def with_dry_chairs(row: Row, rng: Rng, population: Switches, *, rail: str | None = None) -> Row:
    """Let one to three neighbouring chairs run dry, under one rail or, as seldom, under both."""
    chairs = [name for name in population.chairs if not name.endswith(OTHER_RAIL)]
    count = int(rng.integers(1, 4))
    first = int(rng.integers(0, len(chairs) - count + 1))
    which = rail or str(rng.choice(["one", "other", "both"], p=[0.4, 0.4, 0.2]))
    friction = population.friction(row)
    changed = dict(row)
    for name in chairs[first : first + count]:
        target = float(rng.uniform(*DRY_FRICTION))
        for chair, wanted in ((name, which != "other"), (name + OTHER_RAIL, which != "one")):
            if wanted and chair_factor(chair) in row:
                changed[chair_factor(chair)] = max(
                    target / friction, float(row[chair_factor(chair)])
                )
    return changed


def with_adjustment(row: Row, rng: Rng, population: Switches, *, change: float = 0.0) -> Row:
    """Change the closing over-travel of one drive, now and then of both [m]."""
    drives = list(population.study.panel.drive)
    both = change == 0.0 and rng.random() < BOTH_ADJUSTED
    chosen = drives if both else [str(rng.choice(drives))]
    changed = dict(row)
    for drive in chosen:
        key = over_travel(drive)
        shift = change * rng.choice([-1.0, 1.0]) if change else rng.uniform(-ADJUSTMENT, ADJUSTMENT)
        changed[key] = max(0.0, float(row[key]) + float(shift))
    return changed


BOTH_ADJUSTED = 0.2
"""Share of the adjustments that change both drives [-]."""


def with_factor(
    row: Row, rng: Rng, population: Switches, *, field: str, share: Sequence[float]
) -> Row:
    """Multiply a value of one drive by a random share, uniform in its logarithm."""
    drive = str(rng.choice(list(population.study.panel.drive)))
    key = defect(drive, field)
    drawn = float(np.exp(rng.uniform(np.log(share[0]), np.log(share[1]))))
    return {**row, key: float(row[key]) * drawn}


def with_worn_clutch(row: Row, rng: Rng, population: Switches) -> Row:
    """Lower the slip level of one drive."""
    return with_factor(row, rng, population, field="saturation_force", share=CLUTCH_SHARE)


def with_loose_rod(row: Row, rng: Rng, population: Switches) -> Row:
    """Soften the rod of one drive."""
    return with_factor(row, rng, population, field="stiffness", share=ROD_SHARE)


def with_frozen_blade(row: Row, rng: Rng, population: Switches) -> Row:
    """Freeze both rails to some neighbouring chairs, each with its own force."""
    chairs = [name for name in population.chairs if not name.endswith(OTHER_RAIL)]
    least, most = (min(count, len(chairs)) for count in FROZEN_CHAIRS)
    count = int(rng.integers(least, most + 1))
    first = int(rng.integers(0, len(chairs) - count + 1))
    frozen = chairs[first : first + count]
    changed = dict(row)
    largest = float(np.exp(rng.uniform(*np.log(FROZEN_FORCE))))
    for name in population.chairs:
        force = largest * rng.uniform(0.5, 1.0) if name.removesuffix(OTHER_RAIL) in frozen else 0.0
        changed[f"chair.{name}.frozen_force"] = float(force)
    return changed


def with_in_drive(row: Row, rng: Rng, population: Switches) -> Row:
    """Let one drive be slow in both directions by what is wrong within it.

    The rod of a marker shows that by its timing alone. A machine has a dry gear, which takes more
    torque over the whole stroke, or a motor that gets less voltage by its brushes or own cable.
    """
    panel = population.study.panel
    drive = str(rng.choice(list(panel.drive)))
    longer, voltage = float(rng.uniform(*SLOWER)), float(rng.uniform(*WEAKER))
    severity = float(rng.uniform(*DRY_GEAR)) if rng.random() < GEAR_SHARE else 0.0
    dry = severity > 0.0 and panel.drive[drive].machine is not None
    changed = slowed(row, population, [] if dry else [drive], longer=longer, voltage=voltage)
    for name in dict.fromkeys(record.machine for record in panel.drive.values() if record.machine):
        lost = severity if dry and name == panel.drive[drive].machine else 0.0
        machine = panel.machine[name]
        changed[f"machine.{name}.gear.efficiency"] = machine.gear.efficiency * (
            1.0 - EFFICIENCY_LOST * lost
        )
        changed[f"machine.{name}.motor.loss_torque"] = machine.motor.loss_torque * (1.0 + lost)
    return changed


def with_slow_drive(row: Row, rng: Rng, population: Switches) -> Row:
    """Let one drive, or as often all of them, be slow: a fault within a drive, or a weak supply."""
    panel = population.study.panel
    drives = list(panel.drive)
    slow = drives if rng.random() < ALL_SLOW else [str(rng.choice(drives))]
    longer = float(rng.uniform(*SLOWER))
    voltage = float(rng.uniform(*WEAKER)) if panel.machine else 1.0
    return slowed(row, population, slow, longer=longer, voltage=voltage)


ALL_SLOW = 0.5
"""Share of the slow throws in which all drives are slow [-]."""


def with_weak_supply(row: Row, rng: Rng, population: Switches) -> Row:
    """Let all drives be slow in both directions: they share a supply, and its voltage is low."""
    drives = list(population.study.panel.drive)
    longer, voltage = float(rng.uniform(*SLOWER)), float(rng.uniform(*WEAKER))
    return slowed(row, population, drives, longer=longer, voltage=voltage)


def slowed(
    row: Row, population: Switches, slow: Sequence[str], *, longer: float, voltage: float
) -> Row:
    """Return a row in which some drives are slower, with the durations of all written out.

    Parameters
    ----------
    row : dict
        A sound throw.
    population : Population
        It is of.
    slow : sequence of str
        Names of the drives.
    longer : float
        By how much a marker takes longer in each direction [s].
    voltage : float
        Share of its voltage that a machine gets [-].
    """
    panel = population.study.panel
    changed = dict(row)
    for name, movement in panel.movement.items():
        for drive, record in panel.drive.items():
            if record.machine is None:
                key = f"movement.{name}.extra_time.{drive}"
                usual = float(changed.get(key, movement.extra_time.get(drive, 0.0)))
                changed[key] = usual + (longer if drive in slow else 0.0)
    for machine in {panel.drive[drive].machine for drive in slow} - {None}:
        key = supply_voltage(str(machine))
        changed[key] = float(row[key]) * voltage
    return changed


def _adjusted_after(row: Row, rng: Rng, population: Switches) -> Row:
    return with_adjustment(row, rng, population, change=ADJUSTED_AFTER)


def _dry_after(row: Row, rng: Rng, population: Switches) -> Row:
    return with_dry_chairs(row, rng, population, rail=str(rng.choice(["one", "other"])))


DEFECTS: dict[str, Defect] = {
    "dry chairs": Defect(
        change=with_dry_chairs,
        later=_dry_after,
        advice="grease the slide chairs",
        times=6,
        irregular=0.5,
        least_support=math.log(5.0),
        trend=2,
        benchmark=True,
    ),
    "adjustment": Defect(
        change=with_adjustment,
        later=_adjusted_after,
        advice="confirm the adjustment and take a new history: turnout detect learn",
        times=2,
        needs_history=True,
        trend=3,
        benchmark=True,
    ),
    "clutch": Defect(
        change=with_worn_clutch,
        advice="check the clutch of the drive that slips early",
        trend=1,
        benchmark=True,
        weakens=True,
        campaign={"slip_excess": 0.15, "slip_scatter": 0.05},
    ),
    "loose rod": Defect(
        change=with_loose_rod,
        advice="check rod, bushing and bolts of the drive",
        trend=4,
        benchmark=True,
    ),
    # adds a law to every chair, which makes all throws slower: not in the benchmark
    "frozen blade": Defect(
        change=with_frozen_blade,
        advice="clear ice from the slide chairs, check the heating",
    ),
    "in-drive": Defect(
        change=with_in_drive,
        advice="check gear, bearings, brushes and cable of the drive that is slow",
        slows=1,
        trend=5,
    ),
    "supply": Defect(
        change=with_weak_supply,
        advice="check the supply of the drives: voltage, cable, contacts",
        slows=ALL_DRIVES,
        trend=6,
    ),
    # either of the two above, to test with; what a detector of format 3 calls both
    "slow drive": Defect(
        change=with_slow_drive,
        advice="check supply, gear, brushes and cable of the drive",
        trained=False,
        slows=ALL_DRIVES,
        benchmark=True,
    ),
    "soft build-up": Defect(
        advice="check bushings and play between drive and rail",
        trained=False,
        campaign={"build_up_lag": 0.25},
    ),
}
"""Throws of dry chairs are many, since they may be anywhere under either rail and break away at
other instants in every state: of severe ones 26, 36, 41 and 48 % are named from 200, 400, 800 and
2,400 samples, at one sound throw in 100. Their support counts irregularity too, since samples of
them explain a part of what they change and leave the rest in the very ways in which sound throws
vary; so the least of it is what sound throws exceed."""


def trained_changes() -> dict[str, Change]:
    """Return what makes throws of the defects that a detector learns, by name."""
    return {name: d.change for name, d in DEFECTS.items() if d.trained and d.change is not None}


def later_changes() -> dict[str, Change]:
    """Return the same of those that differ in a switch with a history, in the order of names."""
    found = {name: d.later for name, d in DEFECTS.items() if d.later is not None}
    return dict(sorted(found.items()))
