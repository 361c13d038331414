"""The verdict that a sweep stores of each throw is that of the same throw simulated alone."""

import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import study_file

from turnout.calibration.load_study import load_study
from turnout.study.sweep.row import throw_scenarios
from turnout.throw.simulate import simulate
from turnout.throw.slip import Span, slip_onsets
from turnout.throw.verdict import KINDS, verdict

HEAD = """
schema_version = 1
name = "verdicts"
description = "Throws of one panel."
panel = "{panel}"

[scheme]
mode = "quick"

[set]
{settings}

[[together]]
keys = [{keys}]
rows = {rows}
"""
OBJECT = ("object.size", "object.at", "object.kind", "object.rail")
MACHINES = {"drive.1.machine": "jea73", "drive.2.machine": "jea73"}
LATE = {"drive.1.machine": "jea73", "movement.return.start": "8.46 s"}
LATE |= {"movement.return.duration": "0.04 s", "movement.return.ramp": "0.01 s"}
DEFAULT = "uic60-760-1-15"
Rows = list[list[str | float]]

GROUPS: dict[str, tuple[str, dict[str, str], tuple[str, ...], Rows, set[str]]] = {
    "both rails": (
        DEFAULT, {}, OBJECT,
        [
            ["10 mm", "sleeper 6", "spring", "straight"],
            ["10 mm", "sleeper 6", "spring", "curved"],
            ["18 mm", "sleeper 6", "spring", "straight"],
            ["18 mm", "sleeper 6", "spring", "curved"],
            ["13 mm", "drive 1", "spring", "curved"],
            ["5 mm", "drive 2", "spring", "straight"],
            ["0 mm", "sleeper 6", "spring", "straight"],
            ["2 mm", "sleeper 6", "spring", "curved"],
            ["113.5 mm", "sleeper 6", "spring", "straight"],
        ],
        {"sound", "undetected object", "detected by TKK", "not judged"},
    ),
    "broken": (
        DEFAULT, {}, OBJECT,
        [
            ["15 mm", "drive 1", "stone", "straight"],
            ["20 mm", "sleeper 6", "ice", "straight"],
            ["25 mm", "sleeper 8", "metal", "straight"],
            ["20 mm", "sleeper 6", "wood", "curved"],
        ],
        {"sound", "detected by slip"},
    ),
    "slipping": (
        "sb1", {},
        ("drive.1.saturation_force", "object.size", "object.at"),
        [
            ["6 kN", "0 mm", "drive 1"],
            ["2 kN", "0 mm", "drive 1"],
            ["2 kN", "10 mm", "drive 1"],
            ["20 kN", "13 mm", "drive 1"],
        ],
        {"not locked"},
    ),
    "friction": (
        DEFAULT, {},
        ("chair.friction_coefficient", "object.size", "object.at"),
        [
            [0.8, "3 mm", "sleeper 6"],
            [0.3, "3 mm", "sleeper 6"],
            [0.8, "0 mm", "sleeper 6"],
        ],
        {"sound"},
    ),
    "flangeway": (
        DEFAULT, {}, ("drive.2.stroke", "object.size", "object.at"),
        [["20 mm", "0 mm", "sleeper 6"], ["20 mm", "13 mm", "sleeper 6"]],
        {"not sound"},
    ),
    "gauge": (
        DEFAULT, {}, ("gauge.limit", "object.size", "object.at"),
        [["5 mm", "0 mm", "sleeper 6"], ["7 mm", "0 mm", "sleeper 6"], ["5 mm", "3 mm", "drive 1"]],
        {"sound", "not sound"},
    ),
    "raw gap": (
        DEFAULT, {"lock.rule": "raw gap"}, ("object.size", "object.at"),
        [["8 mm", "drive 1"], ["6 mm", "drive 2"], ["3 mm", "drive 1"]],
        {"undetected object"},
    ),
    "two rails, sensors of one": (
        "sb2", {"flangeway.limit": "40 mm"}, OBJECT,
        [
            ["13 mm", "sleeper 6", "spring", "A"],
            ["5 mm", "sleeper 6", "spring", "B"],
            ["0 mm", "sleeper 6", "spring", "A"],
        ],
        {"sound", "undetected object"},
    ),
    "machines": (
        DEFAULT, MACHINES,
        ("machine.jea73.supply.voltage", "object.size", "object.at"),
        [
            ["220 V", "13 mm", "sleeper 6"],
            ["55 V", "0 mm", "sleeper 6"],
            ["55 V", "13 mm", "sleeper 6"],
        ],
        {"undetected object"},
    ),
    "taken out at rest": (
        DEFAULT, {}, (*OBJECT, "object.disappears"),
        [
            ["18 mm", "sleeper 6", "spring", "curved", "4 s"],
            ["18 mm", "sleeper 6", "spring", "straight", "8.2 s"],
            ["13 mm", "drive 1", "spring", "curved", "4.2 s"],
            ["13 mm", "drive 1", "spring", "straight", "8.2 s"],
            ["5 mm", "drive 2", "spring", "straight", "8.2 s"],
            ["18 mm", "sleeper 6", "spring", "straight", "6 s"],
            ["18 mm", "sleeper 6", "spring", "straight", "8.5 s"],
            ["18 mm", "sleeper 6", "spring", "curved", "20 s"],
        ],
        {"sound", "detected by TKK", "detected by slip"},
    ),
    "unfinished": (
        "60e1-300-1-9", LATE, ("object.size", "object.at"),
        [["0 mm", "drive 1"], ["6 mm", "drive 1"]],
        {"not judged"},
    ),
}  # fmt: skip


def compared(folder: Path, group: str) -> list[tuple[str, str]]:
    """Return the stored verdict and that on the throw alone of each scenario of a group."""
    panel, settings, keys, rows, _ = GROUPS[group]
    text = HEAD.format(
        panel=panel,
        settings="\n".join(f'"{key}" = "{value}"' for key, value in settings.items()),
        keys=", ".join(f'"{key}"' for key in keys),
        rows=str(rows).replace("'", '"'),
    )
    study = load_study(study_file(folder, text=text.replace("{", "{{").replace("}", "}}")))
    scenarios = [study.scenario(number) for number in range(study.count)]
    found: list[tuple[str, str]] = []
    for row, scenario in zip(throw_scenarios(study, scenarios), scenarios, strict=True):
        changed = study.panel.with_overrides(dict(scenario.overrides))
        alone = simulate(
            changed, foreign_object=scenario.foreign_objects, scheme=study.scheme, throw=False
        )
        made = verdict(alone)
        assert row.stored is not None
        stored = row.stored.variables["verdict"][1][row.number]
        found.append((KINDS[int(stored)], made.own or made.kind))
    return found


@pytest.mark.parametrize("group", GROUPS)
def test_a_sweep_stores_the_verdict_on_the_throw_alone(tmp_path: Path, group: str) -> None:
    found = compared(tmp_path, group)
    assert [stored for stored, _ in found] == [alone for _, alone in found]
    assert {stored for stored, _ in found} >= GROUPS[group][-1]


def test_slips_of_many_throws_begin_in_the_movements_of_their_onsets() -> None:
    """A drive that still slips when the next movement begins does not begin again."""
    time = np.arange(6.0)
    flags = np.array([[[0, 1, 1, 1, 0, 1]], [[1, 0, 0, 1, 1, 0]]], dtype=bool)
    moved = Span("throw", "open", 0.0, 1.0), Span("return", "closed", 2.5, 4.0)
    onsets = slip_onsets(time, flags, [(moved[0], 2.5), (moved[1], math.inf)])
    assert onsets[0].tolist() == [[1.0, 5.0]]
