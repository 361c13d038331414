"""Participants of the race on SB1, and the measurement of one in a process of its own.

    python -m benchmarks.racers RACER CASE STEP_MS REPEATS

prints what was measured as JSON. Timed is the solution from rest to the end of the motion, with
what is kept of it; reading, assembly and reduction are timed apart.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

from tests.verification.agreement import sb1_checks
from tests.verification.reference import thinned

from benchmarks import banded, sb1
from benchmarks.machine import load, processor_seconds
from benchmarks.schemes import MODES
from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.markers import marker_positions
from turnout.solver.integration import integrate
from turnout.throw.simulate import simulate


@dataclass(frozen=True, slots=True)
class Racer:
    """One line of the table.

    `steps` are what it is tried with [ms] (0: what it chooses itself); the cheapest that agrees
    counts. Of `repeats` runs the median counts: the shorter a run, the more of them, since the
    first ones of a process are slower.
    """

    title: str
    steps: tuple[float, ...]
    repeats: int


STEPS = (1.0, 2.0, 3.0, 4.0, 5.0)
"""Steps that every rival is tried with [ms]."""

CANDIDATES = tuple(
    Scheme(step=step, cutoff_frequency=cutoff, spectral_radius=radius)
    for step in (5e-3, 4e-3, 3e-3, 2e-3, 1e-3)
    for cutoff in (30.0, 100.0, 300.0)
    for radius in (0.3, 0.5, 0.7, 0.9)
)
"""Of turnout's choices, those tried for the least that agrees, as rivals try their steps."""

RACERS = {
    "turnout-least": Racer("turnout, least", (0.0,), 99),
    "turnout-quick": Racer("turnout, quick", (0.0,), 99),
    "turnout-waveform": Racer("turnout, waveform", (0.0,), 45),
    "banded-lateral": Racer("banded, lateral plane", STEPS, 9),
    "banded": Racer("banded, all coordinates", STEPS, 9),
    "exudyn-reduced": Racer("Exudyn, turnout's superelement", STEPS, 3),
    "exudyn": Racer("Exudyn, finite elements", STEPS, 3),
    "opensees": Racer("OpenSeesPy", STEPS, 1),
}


def measure_turnout(name: str, case: str, repeats: int) -> dict[str, object]:
    """Measure turnout; of several candidates, the one that agrees and was ever the quickest."""
    mode = name.removeprefix("turnout-")
    if mode != "least":
        return measure_scheme(MODES[mode], case, repeats)
    tried = [(measure_scheme(scheme, case, 15), scheme) for scheme in CANDIDATES]
    agreeing = [(min(found["seconds"]), n) for n, (found, _) in enumerate(tried)
                if found["agrees"]]  # type: ignore[call-overload]  # fmt: skip
    if not agreeing:
        message = f"no choice of turnout's agrees on case {case}"
        raise SystemExit(message)
    return measure_scheme(tried[min(agreeing)[1]][1], case, repeats)


def measure_scheme(scheme: Scheme, case: str, repeats: int) -> dict[str, object]:
    """Measure turnout with a scheme; agreement is judged on its finished dataset."""
    panel, objects = sb1.panel_of(case)
    began = time.process_time()
    mechanism = build_mechanism(panel, objects)
    setup = time.process_time() - began

    def run(end: float = panel.schedule.end) -> None:
        integrate(mechanism, scheme, inputs=lambda t: marker_positions(panel, t), end=end)

    seconds = processor_seconds(run, count=repeats)
    start = processor_seconds(lambda: run(scheme.output_interval), count=repeats)
    trapped = ForeignObject(sb1.SIZE, sb1.PLACE) if case == "B" else None
    dataset = simulate(panel, foreign_object=trapped, scheme=scheme)
    return {
        "step": 1e3 * scheme.step,
        "seconds": seconds,
        "start": statistics.median(start),
        "setup": setup,
        "note": scheme.describe(),
        "work": {"steps": round(panel.schedule.end / scheme.step)},
        **judged(sb1_checks(dataset, thinned(f"sb1_{case}"))),
    }


def measure_other(name: str, case: str, step: float, repeats: int) -> dict[str, object]:
    """Measure another program with a step [s]."""
    began = time.process_time()
    run = prepared(name, case, step)
    setup = time.process_time() - began
    answers: list[sb1.Answer] = []
    seconds = processor_seconds(lambda: answers.append(run()), count=repeats, warm=repeats > 1)
    return {
        "step": 1e3 * step,
        "seconds": seconds,
        "setup": setup,
        "work": answers[-1].work,
        **judged(sb1.checks(case, answers[-1])),
    }


def prepared(name: str, case: str, step: float) -> Callable[[], sb1.Answer]:
    """Return a function that runs a program once, its matrices made before."""
    if name.startswith("banded"):
        system, rest = banded.prepare(case, lateral_only=name == "banded-lateral")
        return lambda: banded.run(system, rest, case=case, step=step)
    reduced = name == "exudyn-reduced"
    whole = sb1.reduced_system(case) if reduced else sb1.full_system(case)
    if name == "opensees":
        from benchmarks import with_opensees

        return lambda: with_opensees.run(whole, case=case, step=step)
    from benchmarks import with_exudyn

    at_rest = sb1.at_rest(whole)
    return lambda: with_exudyn.run(whole, at_rest, case=case, step=step, dense=reduced)


def judged(found: list[sb1.Check]) -> dict[str, object]:
    """Return the agreement of an answer with the reference."""
    rms, plateau, agrees = sb1.agreement(found)
    friction = next(check.value for check in found if check.what.startswith("chair"))
    return {"rms": rms, "plateau": plateau, "friction": friction, "agrees": agrees}


def main() -> None:
    """Measure one racer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("racer")
    parser.add_argument("case")
    parser.add_argument("step", type=float, metavar="step_ms")
    parser.add_argument("repeats", type=int)
    given = parser.parse_args()
    before = load()
    if given.racer.startswith("turnout"):
        found = measure_turnout(given.racer, given.case, given.repeats)
    else:
        found = measure_other(given.racer, given.case, given.step / 1e3, given.repeats)
    print(json.dumps(found | {"load": max(before, load())}))


if __name__ == "__main__":
    main()
