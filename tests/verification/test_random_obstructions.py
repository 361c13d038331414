"""Random obstructions: every throw completes, with an energy residual below 1e-6 of its scale."""

from dataclasses import dataclass

import numpy as np
import pytest

from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.solver.outcome import CLOSES, LEAST_SCALE
from turnout.throw.simulate import solve

PANELS = ("sb1", "sb2", "uic60-760-1-15")
KINDS_THAT_REMEMBER = tuple(name for name, kind in OBJECT_KINDS.items() if kind.remembers)


@dataclass(frozen=True)
class Thrown:
    """What came of one throw: its objects and mode, energy residual over its scale, outcome."""

    text: str
    residual: float
    outcome: str
    dissipated: float


def random_object(random: np.random.Generator) -> ForeignObject:
    kind = str(random.choice(KINDS_THAT_REMEMBER))
    given = {
        name: float(np.exp(random.uniform(np.log(max(p.least, 1e-3)), np.log(p.most))))
        for name, p in OBJECT_KINDS[kind].parameters.items()
        if random.random() < 0.5
    }
    if "length" in given:
        given["length"] = min(given["length"], float(random.uniform(0.005, 1.5)))
    return ForeignObject(
        float(random.uniform(0.005, 0.04)), f"x = {random.uniform(0.8, 7.0):.3f} m", kind=kind,
        stiffness=float(np.exp(random.uniform(np.log(1e6), np.log(1e8)))), **given,
    )  # fmt: skip


def throws(count: int, *, seed: int = 27) -> list[Thrown]:
    """Throw so many; one in three has two objects, one in eight is waveform or quasi-static."""
    random = np.random.default_rng(seed)
    panels = [load_panel(name) for name in PANELS]
    found: list[Thrown] = []
    while len(found) < count:
        panel = panels[int(random.integers(len(panels)))]
        objects = [random_object(random) for _ in range(1 + int(random.random() < 0.3))]
        mode = str(random.choice(["quick", "waveform", "quasi-static"], p=[0.88, 0.06, 0.06]))
        try:
            resolve_objects(panel, objects)
        except PanelError:  # larger than the opening there
            continue
        history = solve(panel, foreign_object=objects, scheme=Scheme.of(mode)).history
        outcome = history.outcome
        scale = max(outcome.energy_scale, LEAST_SCALE)
        found.append(
            Thrown(
                f"{panel.name}, {mode}: {objects}",
                outcome.energy_residual / scale,
                outcome.message() if not outcome.complete else "complete",
                float(history.obstructions.dissipated.sum()),
            )
        )
    return found


@pytest.mark.parametrize("count", [25, pytest.param(500, marks=pytest.mark.long)])
def test_the_energy_of_random_obstructions_balances(count: int) -> None:
    made = throws(count)
    assert [item.text for item in made if item.outcome != "complete"] == []
    assert max(item.residual for item in made) < CLOSES
    assert sum(item.dissipated > 0 for item in made) > count / 3
