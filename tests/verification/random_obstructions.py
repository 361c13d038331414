"""Throws of library panels with obstructions of any kind, size and place; energy residuals.

``python -m tests.verification.random_obstructions 500`` prints the largest residual of 500.
"""

import sys
from dataclasses import dataclass

import numpy as np

from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.panel.object_kind import KINDS
from turnout.solver.outcome import CLOSES, LEAST_SCALE
from turnout.throw.simulate import solve

PANELS = ("sb1", "sb2", "uic60-760-1-15")
KINDS_THAT_REMEMBER = tuple(kind for kind in KINDS if kind != "spring")


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
        for name, p in KINDS[kind].items()
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


def main() -> None:
    """Print the largest residual, and every throw that did not get to its end."""
    made = throws(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
    for item in made:
        if item.outcome != "complete":
            print(f"{item.text}\n    {item.outcome}")
    worst = max(item.residual for item in made)
    touched = sum(item.dissipated > 0 for item in made)
    complete = sum(item.outcome == "complete" for item in made)
    print(
        f"{len(made)} throws, {complete} complete, {touched} with dented or broken objects; "
        f"largest energy residual {worst:.1e} of its scale, {CLOSES:.0e} allowed"
    )


if __name__ == "__main__":
    main()
