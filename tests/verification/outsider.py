"""A campaign as somebody writes it who has never run turnout: another program, plain CSV.

The switch is SB1, thrown by the banded finite elements of `benchmarks.banded`, which share the
beams' matrices with turnout but none of its reduction, laws or steps: one rail with all its nodes,
average acceleration, sets found by iteration. Only the lateral part is thrown, as the section bends
in its planes apart and the normal forces stay what they are at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from benchmarks import banded
from benchmarks.sb1 import Answer, LinearSystem
from numpy.typing import NDArray

from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel

Floats = NDArray[np.float64]
STEP = 1e-3
# A closing and an opening movement in one run, with the rest before and after each [s].
CLOSING, OPENING = (0.0, 4.9), (4.2, 9.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What the other program was given, and a calibration has to find, in SI."""

    friction: float = 0.27
    stiffness: tuple[float, float] = (640e3, 1050e3)
    level: tuple[float, float] = (7.2e3, 5.1e3)

    @property
    def values(self) -> dict[str, float]:
        """The values by the keys of the panel."""
        found = {"chair.friction_coefficient": self.friction}
        for number, (stiffness, level) in enumerate(zip(self.stiffness, self.level, strict=True)):
            found[f"drive.{number + 1}.stiffness"] = stiffness
            found[f"drive.{number + 1}.saturation_force"] = level
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Habits:
    """How the other program's author writes recordings.

    Attributes
    ----------
    rate : float
        Samples a second [1/s].
    noise : float
        Of each sample [N].
    unit : str
        "N" or "kN".
    separator, comma : str, bool
        Between columns, and whether decimals have a comma.
    whole : bool
        Whether a recording holds closing and opening, else a file each.
    lead : float
        Rest before the onset in a file of one movement, at most 1 s [s].
    """

    rate: float = 1000.0
    noise: float = 0.0
    unit: str = "N"
    separator: str = ","
    comma: bool = False
    whole: bool = False
    lead: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One run: place of the object by the panel's names, and its size [m], 0 for none."""

    place: str = "none"
    size: float = 0.0
    opening: bool = False


CASES = (
    Case(opening=True),
    Case(opening=True),
    Case(place="drive 1", size=0.013),
    Case(place="drive 2", size=0.010),
    Case(place="sleeper 7", size=0.013),
    Case(place="sleeper 4", size=0.025),
)


@cache
def _lateral() -> tuple[LinearSystem, Floats]:
    return banded.prepare("A", lateral_only=True)


def thrown(truth: Truth, case: Case) -> Answer:
    """Throw SB1 with other values and another object than the benchmark's."""
    system, rest = _lateral()
    stations = system.stations
    changes = {
        "friction_coefficient": truth.friction,
        "drive_stiffness": np.array(truth.stiffness),
        "drive_limit": np.array(truth.level),
    }
    if case.size > 0:
        panel = load_panel("sb1")
        (item,) = resolve_objects(panel, [ForeignObject(case.size, case.place)])
        x = np.array([chair.x for chair in panel.chair.values()])
        station = int(np.argmin(np.abs(x - item.x)))
        assert abs(x[station] - item.x) < 1e-9, "objects stand at chairs"
        there = np.full(x.size, -1)
        there[station] = 1
        changes |= {
            "object": there,
            "object_size": item.size,
            "object_stiffness": item.stiffness,
        }
    system = replace(system, stations=replace(stations, **changes))
    answer = banded.run(system, rest.copy(), case="B" if case.size > 0 else "A", step=STEP)
    assert answer.work["unconverged"] == 0
    return answer


def write_campaign(
    folder: Path,
    truth: Truth,
    *,
    cases: Sequence[Case] = CASES,
    habits: Habits | None = None,
    scatter: float = 0.0,
    seed: int = 0,
) -> Path:
    """Write a folder of recordings with its run sheet and channel map.

    Parameters
    ----------
    folder : Path
        There already.
    truth : Truth
        What the program is given.
    cases : sequence of Case
        Runs.
    habits : Habits, optional
        How recordings are written.
    scatter : float
        Of friction from run to run, as a share of it.
    seed : int
        Of noise and scatter.
    """
    habits = habits or Habits()
    rng = np.random.default_rng(seed)
    lines = ["file,movement,direction,size [mm],place,repeat"]
    counts: dict[tuple[str, float, str], int] = {}
    shares = rng.standard_normal(len(cases))
    # Their mean is the truth, so that few runs do not shift it.
    frictions = truth.friction * (1.0 + scatter * (shares - shares.mean()))
    for number, (case, friction) in enumerate(zip(cases, frictions, strict=True)):
        own = replace(truth, friction=float(friction))
        answer = thrown(own, case)
        parts = [("closing", CLOSING)] + [("opening", OPENING)] * case.opening
        if habits.whole:
            name = f"run{number:02d}.csv"
            (folder / name).write_text(_text(answer, (0.0, 9.0), habits, rng), encoding="utf-8")
        for order, (direction, (start, stop)) in enumerate(parts, 1):
            size, place = (case.size, case.place) if direction == "closing" else (0.0, "none")
            counts[place, size, direction] = counts.get((place, size, direction), 0) + 1
            if not habits.whole:
                name = f"run{number:02d}-{direction}.csv"
                onset = 1.0 if direction == "closing" else 5.0
                span = (max(start, onset - habits.lead), stop)
                (folder / name).write_text(_text(answer, span, habits, rng), encoding="utf-8")
            repeat = counts[place, size, direction]
            lines.append(
                f"{name},{order if habits.whole else 1},{direction},{1e3 * size:g},{place},{repeat}"
            )
    (folder / "runs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "channels.toml").write_text(_channels(habits.unit), encoding="utf-8")
    return folder


def _text(
    answer: Answer, span: tuple[float, float], habits: Habits, rng: np.random.Generator
) -> str:
    """Return a recording as text: time and forces."""
    start, stop = span
    time = np.arange(round((stop - start) * habits.rate) + 1) / habits.rate
    factor = 1e-3 if habits.unit == "kN" else 1.0
    columns = [time]
    for values in (*answer.drive, answer.object):
        row = np.interp(time + start, answer.time, values)
        columns.append(factor * (row + habits.noise * rng.standard_normal(row.size)))
    names = ["Time (s)", *(f"{name} ({habits.unit})" for name in ("Rod 1", "Rod 2", "Load cell"))]
    rows = [habits.separator.join(names)]
    for sample in zip(*columns, strict=True):
        text = habits.separator.join(f"{value:.7g}" for value in sample)
        rows.append(text.replace(".", ",") if habits.comma else text)
    return "\n".join(rows) + "\n"


def _channels(unit: str) -> str:
    """Return a channel map for columns that a program scaled itself."""
    columns = {"drive_force.1": "Rod 1", "drive_force.2": "Rod 2", "object_force": "Load cell"}
    return "".join(
        f'[{name}]\ncolumn = "{column}"\nkind = "scaled"\nunit = "{unit}"\n'
        + ("optional = true\n" if name == "object_force" else "")
        for name, column in columns.items()
    )
