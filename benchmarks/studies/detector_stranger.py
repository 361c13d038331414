"""Switches of another program, judged by the commands as a stranger would: DIR, a detector's file.

    python -m benchmarks.studies.detector_stranger DIR --detector switch.detector

`independent_switch` throws 20 switches whose sections, planing, meshes, stress-free states, shapes
and friction are none of the population that a detector learns from. Each gets 20 sound throws, 12
sound ones more and 12 with objects; in every third switch one to three chairs under one rail are
dry from half-way on. Opening and closing stand in one recording of forces alone, after rests of
unknown length, with a discrepancy of 5 % that goes on at rest, noise, and the sampling rate and
unit of the switch, in a campaign folder. `turnout detect run`, `learn`, `watch` and `report` judge
them. What was thrown or judged is kept in DIR.

Half of the variance of the discrepancy follows the movements of a switch, and so is the same in all
of its throws. With `--adrift` it follows the clock of each recording, whose rests differ: then
nothing of it stays, and throws of a switch vary by twice the variance that a detector assumes.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.verification.independent_switch import Thrown, switch_of, throw

from benchmarks.studies.detector_figures import a90, false_alarm_limits
from benchmarks.studies.detector_other import NOISE, SHARE, wandering
from turnout.core.files import write_atomic
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel

Floats = NDArray[np.float64]
Rng = np.random.Generator

PANEL = "uic60-760-1-15"
SEED = 81
SWITCHES, KNOWN, SOUND, OBJECTS = 20, 20, 12, 12
DRY_EVERY = 3
PEAKS = (2800.0, 5600.0)
"""Of the forces of a nominal throw, which the discrepancy is a share of [N]."""
RATES = (50.0, 100.0, 125.0, 200.0)
A90 = {
    "drive 1": 1.4, "sleeper 1": 1.6, "sleeper 2": 4.1, "sleeper 3": 6.9, "sleeper 4": 10.6,
    "sleeper 5": 12.4, "sleeper 6": 14.3, "sleeper 7": 12.0, "sleeper 8": 8.9, "sleeper 9": 6.4,
    "sleeper 10": 3.5, "sleeper 11": 3.4, "drive 2": 3.2,
}  # fmt: skip
A90_KNOWN = {
    "drive 1": 1.4, "sleeper 1": 1.6, "sleeper 2": 3.3, "sleeper 3": 6.3, "sleeper 4": 7.9,
    "sleeper 5": 11.7, "sleeper 6": 11.8, "sleeper 7": 9.8, "sleeper 8": 8.1, "sleeper 9": 5.9,
    "sleeper 10": 3.7, "sleeper 11": 3.2, "drive 2": 2.8,
}  # fmt: skip
"""a90 of the reference case (docs/evidence/detection-results.md), without and with a history [mm]:
objects are of sizes about these, and a90 here is compared with them."""


def main() -> None:
    """Throw, write, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps recordings and verdicts")
    parser.add_argument("--detector", type=Path, help="file of `turnout detect train`")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--adrift", action="store_true", help="nothing stays in all throws")
    given = parser.parse_args()
    for number in range(SWITCHES):
        place = given.folder / f"switch-{number:02d}"
        _write_switch(place, number, given.seed, adrift=given.adrift)
    if given.detector is not None:
        print(json.dumps(judged(given.folder, given.detector), indent=1))


# ---- what is thrown


def panel_of(number: int, rng: Rng) -> LoadedPanel:
    """Return a switch that differs from the default panel in values that a switch keeps."""
    base = load_panel(PANEL)
    free = float(rng.uniform(0.245, 0.295))
    gaps = np.array(base.rail["straight"].fit_gap.value)
    skew = 1.0 + 0.1 * rng.standard_normal() * np.linspace(-1.0, 1.0, gaps.size)
    fit = 1e3 * gaps * float(rng.uniform(0.8, 1.2)) * skew
    changes: dict[str, Any] = {
        "rail.section_scale": float(rng.uniform(0.87, 1.13)),
        "rail.lateral_inertia_scale": float(rng.uniform(0.87, 1.13)),
        "planed_section.tongue.clearance": f"{rng.uniform(0.5, 2.0):.3f} mm",
        "discretisation.element_length": ("0.1 m", "0.2 m")[number % 2],
        "rail.straight.stress_free": free,
        "rail.curved.stress_free": 1.0 - free + float(rng.uniform(-0.004, 0.004)),
        "rail.fit_gap.value": {"unit": "mm", "values": np.maximum(fit, 0.0).round(4).tolist()},
        "movement.return.extra_time": {"2": f"{rng.uniform(0.1, 0.3):.3f} s"},
        "schedule.end": "8.8 s",
    }
    for name, drive in base.drive.items():
        over = 1e3 * float(drive.over_travel_closed) + float(rng.uniform(-1.0, 1.0))
        changes |= {
            f"drive.{name}.stiffness": float(
                drive.stiffness * np.exp(0.05 * rng.standard_normal())
            ),
            f"drive.{name}.saturation_force": float(
                drive.saturation_force * np.exp(0.03 * rng.standard_normal())
            ),
            f"drive.{name}.over_travel_closed": f"{over:.4f} mm",
        }
    return load_panel(PANEL, overrides=changes)


class Friction:
    """Coefficients of the chairs of a switch, throw after throw.

    Each chair has a share of its own that stays and one that changes; the level is drawn again for
    each throw in half of the switches, and wanders in the others.
    """

    def __init__(self, count: int, rng: Rng, *, wanders: bool) -> None:
        self._rng, self._wanders = rng, wanders
        self._own = 0.15 * rng.standard_normal((count, 2))
        self._level = float(rng.uniform(0.15, 0.45))

    def next(self) -> Floats:
        """Return coefficients of the next throw, shape (n_chairs, 2)."""
        if self._wanders:
            step = 0.05 * float(self._rng.standard_normal())
            self._level = float(np.clip(self._level + step, 0.12, 0.48))
        else:
            self._level = float(self._rng.uniform(0.1, 0.5))
        each = self._own + 0.1 * self._rng.standard_normal(self._own.shape)
        return np.asarray(self._level * np.exp(each - np.mean(each)))


def thrown_switch(number: int, seed: int) -> tuple[list[Thrown], list[dict[str, Any]], LoadedPanel]:
    """Return all throws of a switch with the truth of each."""
    rng = np.random.default_rng([seed, number])
    panel = panel_of(number, rng)
    switch = switch_of(panel)
    friction = Friction(len(panel.chair), rng, wanders=number % 2 == 0)
    chairs = rng.integers(0, len(panel.chair) - 3) + np.arange(rng.integers(1, 4))
    rail = int(rng.integers(0, 2))
    throws, labels = [], []
    for turn in range(KNOWN + SOUND + OBJECTS):
        own = friction.next()
        dry = number % DRY_EVERY == 1 and turn >= KNOWN + SOUND // 2
        if dry:
            own[chairs, rail] = np.maximum(own[chairs, rail], rng.uniform(0.6, 0.8, chairs.size))
        place, size = "none", 0.0
        if turn >= KNOWN + SOUND:
            place = list(A90)[(turn + 5 * number) % len(A90)]
            size = round(1e-3 * A90[place] * float(rng.uniform(0.4, 1.7)), 5)
        trapped = ForeignObject(size, place) if size else None
        made = throw(switch, friction=own, trapped=trapped, later=0.3 * float(rng.random()))
        throws.append(made)
        labels.append(
            {"place": place, "size": size, "touch": made.touch, "dry": dry, "lost": made.unsettled}
        )
    return throws, labels, panel


# ---- what is written


def _write_switch(folder: Path, number: int, seed: int, *, adrift: bool) -> None:
    """Write the two campaigns of a switch, and its truth last."""
    truth = folder / "truth.json"
    if truth.exists():
        return
    throws, labels, _ = thrown_switch(number, seed)
    rng = np.random.default_rng([seed, number, 1])
    rate, unit = RATES[number % len(RATES)], ("N", "kN")[number // 2 % 2]
    fixed = wandering(round(20.0 * rate), 1.0 / rate, rng, len(PEAKS))
    parts = {"known": range(KNOWN), "later": range(KNOWN, len(throws))}
    for part, turns in parts.items():
        (folder / part).mkdir(parents=True, exist_ok=True)
        for turn in turns:
            name = f"throw-{turn:02d}.csv"
            thrown = throws[turn]
            text = _recording(thrown, rate=rate, unit=unit, fixed=fixed, adrift=adrift, rng=rng)
            write_atomic(folder / part / name, text.encode())
        _write_sheet(folder / part, labels, turns)
        write_atomic(folder / part / "channels.toml", _channels(unit).encode())
    write_atomic(truth, json.dumps(labels).encode())
    print(f"{folder.name}: {sum(item['lost'] for item in labels)} steps unsettled", flush=True)


def _write_sheet(folder: Path, labels: Sequence[Mapping[str, Any]], turns: range) -> None:
    """Write the run sheet of a campaign; throws that are otherwise equal are numbered."""
    lines = ["file,movement,direction,size [mm],place,repeat"]
    for repeat, turn in enumerate(turns, 1):
        name, size = f"throw-{turn:02d}.csv", 1e3 * labels[turn]["size"]
        lines.append(f"{name},1,opening,0,none,{repeat}")
        lines.append(f"{name},2,closing,{size:g},{labels[turn]['place']},{repeat}")
    write_atomic(folder / "runs.csv", ("\n".join(lines) + "\n").encode())


def _recording(
    thrown: Thrown, *, rate: float, unit: str, fixed: Floats, adrift: bool, rng: Rng
) -> str:
    """Return a recording as text: rest, opening, rest, closing, rest, with errors of measuring."""
    lead, more = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.0, 2.0))
    at = np.arange(0.0, thrown.time[-1] + lead + more, 1.0 / rate)
    own = np.where(at - lead < 4.2, at - lead, np.maximum(at - lead - more, 4.2))
    force = np.array([np.interp(own, thrown.time, row) for row in thrown.force])
    scale = np.sqrt(0.5) * SHARE * np.array(PEAKS)[:, np.newaxis]
    clock = at if adrift else own
    stays = [np.interp(clock, np.arange(row.size) / rate, row) for row in fixed]
    force += scale * (np.array(stays) + wandering(at.size, 1.0 / rate, rng, len(PEAKS)))
    force += NOISE * rng.standard_normal(force.shape)
    factor = 1e-3 if unit == "kN" else 1.0
    rows = [f"Time (s),Rod 1 ({unit}),Rod 2 ({unit})"]
    rows += [f"{t:.4f},{a:.6g},{b:.6g}" for t, (a, b) in zip(at, factor * force.T, strict=True)]
    return "\n".join(rows) + "\n"


def _channels(unit: str) -> str:
    columns = {"drive_force.1": "Rod 1", "drive_force.2": "Rod 2"}
    return "".join(
        f'[{name}]\ncolumn = "{column}"\nkind = "scaled"\nunit = "{unit}"\n'
        for name, column in columns.items()
    )


# ---- what is judged


def turnout(*words: object) -> str:
    """Run a command and return its output."""
    command = [sys.executable, "-m", "turnout", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        message = f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}"
        raise RuntimeError(message)
    return done.stdout


def judged(folder: Path, detector: Path) -> dict[str, Any]:
    """Return verdicts of `turnout detect` on all switches, without and with their known throws."""
    made = hashlib.sha256(detector.read_bytes()).hexdigest()[:8]
    rows: dict[str, list[dict[str, Any]]] = {"first": [], "0": [], str(KNOWN): []}
    for number in range(SWITCHES):
        place = folder / f"switch-{number:02d}"
        kept = place / f"said-{made}.json"
        if not kept.exists():
            write_atomic(kept, json.dumps(_said_of(place, detector, number)).encode())
            print(f"{place.name} is judged", file=sys.stderr, flush=True)
        for name, said in json.loads(kept.read_text()).items():
            rows[name] += said
    return {known: figures(rows[known], int(known)) for known in ("0", str(KNOWN))} | {
        "first throws, no history": _alarms(rows["first"])
    }


def _said_of(place: Path, detector: Path, number: int) -> dict[str, list[dict[str, Any]]]:
    """Return verdicts on the throws of a switch, without and with its first ones known."""
    labels = json.loads((place / "truth.json").read_text())
    own = place / "own.detector"
    first = _verdicts("detect", "learn", detector, place / "known", "-o", own, "--json")
    found = {"first": _matched(first, labels[:KNOWN], number)}
    for known, file in (("0", detector), (str(KNOWN), own)):
        said = _verdicts("detect", "run", file, place / "later", "--json")
        found[known] = _matched(said, labels[KNOWN:], number)
    own.unlink()
    return found


def _verdicts(*words: object) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(turnout(*words))["verdicts"]
    return found


def _matched(
    said: Sequence[Mapping[str, Any]], labels: Sequence[Mapping[str, Any]], switch: int
) -> list[dict[str, Any]]:
    assert len(said) == len(labels), f"{len(said)} verdicts on {len(labels)} throws"
    return [
        {**label, "switch": switch, "status": item["status"], "reason": item["reason"]}
        for item, label in zip(said, labels, strict=True)
    ]


def _alarms(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return false alarms of throws without an object, by switch, and throws not judged."""
    numbers = sorted({row["switch"] for row in rows})
    own = [
        np.array([row["status"] == "object" for row in rows if row["switch"] == number])
        for number in numbers
    ]
    status: dict[str, int] = {}
    for row in rows:
        status[row["status"]] = status.get(row["status"], 0) + 1
    reasons = [row["reason"] for row in rows if row["reason"]]
    return {**false_alarm_limits(own), "said": status, "reasons": reasons[:5]}


def figures(rows: Sequence[Mapping[str, Any]], known: int) -> dict[str, Any]:
    """Return false alarms, and a90 as a multiple of that of the reference case with 90 % limits."""
    unit = A90_KNOWN if known else A90
    held = [row for row in rows if row["size"] > 0.0]
    share = np.array([1e3 * row["size"] / unit[row["place"]] for row in held])
    seen = np.array([row["status"] == "object" for row in held])
    rng = np.random.default_rng(1)
    drawn = rng.integers(0, len(held), (200, len(held)))
    # a90 returns sizes in metres
    several = [1e3 * a90(1e-3 * share[i], seen[i]) for i in drawn]
    status: dict[str, int] = {}
    for row in held:
        status[row["status"]] = status.get(row["status"], 0) + 1
    return {
        "sound": _alarms([row for row in rows if not row["size"] and not row["dry"]]),
        "dry": _alarms([row for row in rows if not row["size"] and row["dry"]]),
        "objects": {"thrown": len(held), "called": int(seen.sum()), "said": status},
        "a90 of the reference": 1e3 * a90(1e-3 * share, seen),
        "90 % limits": np.quantile(several, [0.05, 0.95]).tolist(),
    }


if __name__ == "__main__":
    main()
