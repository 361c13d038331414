"""Show the time of a step by kernel, compared with the arithmetic that it needs.

    python -m benchmarks.profile

writes a section of docs/evidence/performance-methods.md. Each kernel of a step is timed alone,
thousands of times on the state of a rail in motion; numbers and products are counted from the
sizes. What the kernels do not add up to is the loop around them and memory that is touched for
the first time.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.machine import load, machine
from benchmarks.page import METHODS, write_section
from benchmarks.schemes import MODES
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.kernels.compiled import compiled
from turnout.kernels.vector import add_weighted_rows
from turnout.mechanism.build import build_mechanism
from turnout.panel.load import load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver import energy, march, solve, state
from turnout.solver.arrange import arrange, prepare, set_up_run
from turnout.solver.columns import update_row
from turnout.solver.record import SavePlan
from turnout.solver.start import start_at_rest
from turnout.solver.state import COUNT_FLIPS, COUNT_ITERATIONS, Run, State

PANELS = ("sb2", "uic60-760-1-15")
SHARE = 0.55
"""Place of the state in the cycle: both rails on the way back."""
CALLS, REPEATS = 2000, 7
KERNELS = {
    "predict, right side": "march.predict(r, st, march.step_factors(r.options, r.options.step))",
    "columns times right side": (
        "st.counters[state.UNSOLVED] = -1; solve.solve_displacements(r, st)"
    ),
    "check of contacts and stops": "solve.update_segments(r, st, False)",
    "check of friction": "solve.update_branches(r, st, 0, False)",
    "correct, energy of modes": (
        "march.correct(r, st, march.step_factors(r.options, r.options.step))"
    ),
    "energy of laws": "energy.account_laws(r, st, r.work.inputs_start, 4.0)",
    "energy of friction": "energy.account_friction(r, st)",
    "store an instant": "march.store_instant(r, st, 1)",
}
FLIP = "one flip"


@dataclass(frozen=True, slots=True)
class Profile:
    """Times of the kernels of a step [s], and of the whole march of the cycle."""

    kernels: dict[str, float]
    least: float
    marched: float
    unstored: float
    steps: int
    iterations: int
    flips: int
    products: int


def marched(
    name: str, scheme: Scheme, share: float, *, stride: int = 1
) -> tuple[Run, State, float]:
    """March a panel a share of its cycle; return run and state with the seconds of the march."""
    panel = load_panel(name)
    mechanism = build_mechanism(panel, ())
    times = scheme.step * np.arange(round(panel.schedule.end / scheme.step) + 1)
    positions = marker_positions(panel, times) + marker_offsets(panel)[:, np.newaxis]
    with one_blas_thread():
        positions = positions.T.copy()
        run, state = prepare(
            set_up_run(arrange(mechanism, scheme), scheme, positions, SavePlan(times.size))
        )
        start_at_rest(run, state, mechanism)
        began = time.perf_counter()
        spaced = run._replace(options=run.options._replace(stride=stride))
        march.march(spaced, state, 0, int(share * (times.size - 1)), None)
        return run, state, time.perf_counter() - began


def repeated(body: str) -> Callable[..., None]:
    """Compile a loop around one call, so that the kernel alone is timed."""
    modules = (energy, march, solve, state)
    names = {module.__name__.rpartition(".")[2]: module for module in modules}
    text = f"def loop(r, st, n):\n    for _ in range(n):\n        {body}\n"
    exec(text, names)
    return compiled(names["loop"])


@compiled
def flips(r, st, n):  # type: ignore[no-untyped-def]  # noqa: D103
    row = r.table.friction_row[3]
    for _ in range(n):
        st.friction[3] = 0 if st.friction[3] else 1
        update_row(r, st, row, False)


@compiled
def products(r, st, n):  # type: ignore[no-untyped-def]  # noqa: D103
    for _ in range(n):
        add_weighted_rows(r.work.q_pred[:40], st.mode_columns[:40], st.columns[0])


def seconds(loop: Callable[..., None], run: Run, state: State) -> float:
    """Return the least seconds of one call."""
    loop(run, state, 1)
    best = np.inf
    for _ in range(REPEATS):
        began = time.perf_counter()
        loop(run, state, CALLS)
        best = min(best, (time.perf_counter() - began) / CALLS)
    return float(best)


def profile(name: str, scheme: Scheme) -> Profile:
    """Time the kernels of a panel in a mode."""
    # a run's memory serves the next one, as it does when throws follow each other
    taken = min(marched(name, scheme, 1.0)[2] for _ in range(REPEATS))
    unstored = min(marched(name, scheme, 1.0, stride=100)[2] for _ in range(REPEATS))
    counters = marched(name, scheme, 1.0)[1].counters
    run, state, _ = marched(name, scheme, SHARE)
    found = {what: seconds(repeated(body), run, state) for what, body in KERNELS.items()}
    found[FLIP] = seconds(flips, run, state)
    width = state.columns.shape[1]
    system = run.system
    blocks = range(system.mode_start.size - 1)
    modes, ends = np.diff(system.mode_start), np.diff(system.end_start)
    needed = sum(int(modes[b] * ends[b]) for b in blocks)
    return Profile(
        kernels=found,
        least=seconds(products, run, state) / (min(40, run.work.q_pred.size) * width),
        marched=taken,
        unstored=unstored,
        steps=run.positions.shape[0] - 1,
        iterations=int(counters[COUNT_ITERATIONS]),
        flips=int(counters[COUNT_FLIPS]),
        products=needed,
    )


TEXT = """Each kernel alone, least of {repeats} times {calls} calls, in nanoseconds, on rails in
motion. *Iterations* are solutions for a contact set; a step takes one or a few. *Arithmetic* is
what the products of a step take at the speed of this processor on a matrix in its nearest cache:
the columns of all modes by ends and modes."""

NEXT = """### What the next factor of two would take

- In waveform mode the columns of all modes are read from the second cache once a solution, as fast
  as it gives them: a third of all. Those of stock rails that have come to rest are not; nothing
  that is done to the loops will spare the others.
- Storing every step takes what the last two lines differ by: displacements, forces and energies of
  an instant, 5 kB of them in waveform mode. A run that keeps fewer instants (`--every "8 ms"`) or
  single channels saves most of it.
- In quick mode a sixth goes into flips, each of which reads and writes all columns of its rail, two
  of one iteration in one pass. A solution could follow them instead of being made again; there are
  three times as many flips as such solutions, so that little would be left of it.
- A step of SB1 is a dozen kernels of which none takes 100 ns. By themselves, over and over, they
  take two thirds of what they take one after another: much of the rest is finding arrays in
  records. Checks of indices, which were a tenth, are left out. With the solution in the kernel of
  steps too, compiling takes 9 s more.
"""


def section(found: dict[tuple[str, str], Profile]) -> str:
    """Return the table and its conclusions."""
    heads = [f"{panel}, {mode}" for panel, mode in found]
    lines = [
        f"Written by `python -m benchmarks.profile` on {machine()}, at a load of {load():.1f}.",
        "",
        TEXT.format(repeats=REPEATS, calls=CALLS),
        "",
        "| kernel [ns] | " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(heads),
    ]
    for what in (*KERNELS, FLIP):
        cells = [f"{1e9 * p.kernels[what]:.0f}" for p in found.values()]
        lines.append(f"| {what} | " + " | ".join(cells) + " |")
    for what, value in (
        ("**a whole step on average**", lambda p: f"{1e9 * p.marched / p.steps:.0f}"),
        ("arithmetic of a step", lambda p: f"{1e9 * p.least * p.products:.0f}"),
        ("steps", lambda p: f"{p.steps}"),
        ("iterations", lambda p: f"{p.iterations}"),
        ("flips", lambda p: f"{p.flips}"),
        ("march of the cycle [ms]", lambda p: f"{1e3 * p.marched:.1f}"),
        ("the same, every hundredth step stored", lambda p: f"{1e3 * p.unstored:.1f}"),
    ):
        lines.append(f"| {what} | " + " | ".join(value(p) for p in found.values()) + " |")
    return "\n".join([*lines, "", NEXT])


def main() -> None:
    """Profile every panel in both modes and write the section."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = {(name, mode): profile(name, MODES[mode]) for name in PANELS for mode in MODES}
    write_section("Where the time goes", section(found), page=METHODS)


if __name__ == "__main__":
    main()
