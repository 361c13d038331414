"""Growth of the time of a throw with the problem; writes a section and a figure.

    python -m benchmarks.scaling

Chairs and drives are varied on the prismatic rail of SB1, where their number can be chosen freely;
modes and simulated time on the default panel with 13 mm at sleeper 6. Timed are the steps alone:
the processor time of a run less that of a run of one output interval.
"""

import argparse
import re
import statistics
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.log_axis import plain_ticks
from benchmarks.machine import figure, load, machine, processor_seconds
from benchmarks.page import write_section
from benchmarks.schemes import MODES
from turnout.core.scheme import Scheme
from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, library_text, load_panel
from turnout.panel.markers import marker_offsets, marker_positions
from turnout.solver.integration import integrate

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
DEFAULT = "uic60-760-1-15"
CHAIRS = (4, 8, 16, 32, 64)
DRIVES = (1, 2, 3, 4, 6)
CUTOFFS = (75.0, 150.0, 300.0, 600.0)
SLOWER = (1.0, 2.0, 4.0, 8.0)
REPEATS = 7
FIRST_CHAIR, LAST_CHAIR = 0.3, 9.3


@dataclass(frozen=True, slots=True)
class Point:
    """One measurement along an axis.

    `value` is what is varied, `rows` the displacements that laws read, `modes` what keeps its
    inertia, `flips` how often a law changed its segment, `iterations` how often sets were checked,
    `start` and `steps` seconds before the steps and of them.
    """

    value: float
    rows: int
    modes: int
    flips: int
    iterations: int
    start: float
    steps: float


def replaced(text: str, pattern: str, by: str, *, times: int) -> str:
    """Replace a pattern that must be there so many times."""
    text, count = re.subn(pattern, by, text, flags=re.M | re.S)
    if count != times:
        message = f"{pattern!r} is {count} times in the panel, not {times}"
        raise ValueError(message)
    return text


def with_chairs(count: int) -> str:
    """Return SB1 with so many chairs and stops, evenly between its first and its last."""
    step = (LAST_CHAIR - FIRST_CHAIR) / (count - 1)
    pattern = r'step = "0\.6 m", count = 16'
    return replaced(library_text("sb1"), pattern, f'step = "{step!r} m", count = {count}', times=3)


def with_drives(count: int) -> str:
    """Return SB1 with so many drives, each with the stroke that closes the rail at its place."""
    places = FIRST_CHAIR + (6.9 - FIRST_CHAIR) * np.arange(count) / max(count - 1, 1)
    tables = "".join(
        f'[drive.{i + 1}]\nx = "{x!r} m"\nstroke = "{0.118 * (1 - x / 9.7) ** 2 + 0.001!r} m"\n'
        'stiffness = "780 kN/m"\n\n'
        for i, x in enumerate(places.tolist())
    )
    text = replaced(library_text("sb1"), r"^\[drive\.1\].*?(?=^\[sensor)", tables, times=1)
    return replaced(text, r"^extra_time = [^\n]*\n", "", times=1)


def panel_from(text: str) -> LoadedPanel:
    """Return a panel from the text of its file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "panel.toml"
        path.write_text(text, encoding="utf-8")
        return load_panel(path)


def slowed(factor: float) -> LoadedPanel:
    """Return the default panel with all of its motion slowed down."""
    times = {"schedule.end": 8.5, "movement.throw.start": 0.2, "movement.return.start": 4.4}
    times |= {f"movement.{name}.{key}": value for name in ("throw", "return")
              for key, value in (("duration", 3.2), ("ramp", 0.3))}  # fmt: skip
    changes: dict[str, object] = {key: factor * value for key, value in times.items()}
    changes["movement.return.extra_time"] = {"2": 0.2 * factor}
    return load_panel(DEFAULT).with_overrides(changes)


def measure(
    panel: LoadedPanel, value: float, *, scheme: Scheme, trapped: ForeignObject | None
) -> Point:
    """Measure the steps of one panel."""
    objects = resolve_objects(panel, [trapped] if trapped else [])
    mechanism = build_mechanism(panel, objects)
    offsets = marker_offsets(panel)[:, np.newaxis]

    def run(end: float) -> None:
        integrate(mechanism, scheme, inputs=lambda t: marker_positions(panel, t) + offsets, end=end)

    history = integrate(
        mechanism,
        scheme,
        inputs=lambda t: marker_positions(panel, t) + offsets,
        end=panel.schedule.end,
    )
    whole = processor_seconds(lambda: run(panel.schedule.end), count=REPEATS, warm=False)
    start = processor_seconds(lambda: run(scheme.output_interval), count=REPEATS, warm=False)
    first = statistics.median(start)
    return Point(
        value=value,
        rows=mechanism.rows.shape[0],
        modes=history.model.eigenvalues.size,
        flips=history.flips,
        iterations=history.iterations,
        start=first,
        steps=statistics.median(whole) - first,
    )


def axes() -> Iterator[tuple[str, str, list[Point]]]:
    """Measure along every axis; yield its name, the meaning of its values, and its points."""
    scheme = MODES["waveform"]
    trapped = ForeignObject(0.013, "sleeper 6")
    given = {"scheme": scheme, "trapped": None}
    yield (
        "chairs",
        "chairs on one rail (SB1)",
        [measure(panel_from(with_chairs(n)), n, **given) for n in CHAIRS],  # type: ignore[arg-type]
    )
    yield (
        "drives",
        "drives on one rail (SB1)",
        [measure(panel_from(with_drives(n)), n, **given) for n in DRIVES],  # type: ignore[arg-type]
    )
    panel = load_panel(DEFAULT)
    points = []
    for cutoff in CUTOFFS:
        fine = replace(scheme, cutoff_frequency=cutoff)
        point = measure(panel, cutoff, scheme=fine, trapped=trapped)
        points.append(replace(point, value=float(point.modes)))
    yield "modes", "kept modes (default panel)", points
    yield (
        "time",
        "simulated time [s], slowed (default panel)",
        [measure(slowed(k), 8.5 * k, scheme=scheme, trapped=trapped) for k in SLOWER],
    )


def exponent(values: list[float], seconds: list[float]) -> float:
    """Return the slope of a straight line through logarithms.

    Examples
    --------
    >>> round(exponent([1.0, 2.0, 4.0], [3.0, 12.0, 48.0]), 9)
    2.0
    """
    return float(np.polyfit(np.log(values), np.log(seconds), 1)[0])


def draw(measured: dict[str, tuple[str, list[Point]]]) -> Figure:
    """Draw the curves, each beside a line that is proportional to the varied value."""
    drawing = Figure(figsize=(8.0, 5.6), layout="constrained")
    for ax, (label, points) in zip(drawing.subplots(2, 2).flat, measured.values(), strict=True):
        values = np.array([point.value for point in points])
        steps = 1e3 * np.array([point.steps for point in points])
        slope = exponent(values.tolist(), steps.tolist())
        name = f"measured, exponent {slope:.2f} over all"
        ax.loglog(values, steps, "o-", color="#0072B2", linewidth=1, label=name)
        proportional = steps[-1] * values / values[-1]
        ax.loglog(values, proportional, ":", color="0.5", linewidth=1, label="proportional")
        ax.set_xlabel(label)
        ax.set_ylabel("steps [ms]")
        ax.set_xticks(values, [figure(v) for v in values])
        low, high = 0.5 * min(steps), 2.0 * max(steps)
        shown = plain_ticks(low, high)
        ax.set_yticks(shown, [figure(t) for t in shown])
        ax.minorticks_off()
        ax.set_ylim(low, high)
        ax.grid(alpha=0.3)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(frameon=False, loc="upper left")
    return drawing


def section(measured: dict[str, tuple[str, list[Point]]], *, most: float) -> str:
    """Return the section."""
    lines = [
        f"Written by `python -m benchmarks.scaling` on {machine()}, at a load of up to {most:.1f}.",
        f"Scheme: {MODES['waveform'].describe()}; medians of {REPEATS} runs, processor time. "
        "*Steps* is a run less *before steps*, which is condensation and equilibrium. Rows are"
        " the displacements that laws read, flips the changes of a law's segment. The exponent is"
        " of the steps, fitted through all points of an axis, and between the last two.",
        "",
        "![Time of the steps along four axes](../figures/scaling.png)",
        "",
        "| axis | value | rows | modes | checks of the set | flips | before steps [ms] "
        "| steps [ms] | exponent | at the end |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for label, points in measured.values():
        slope = exponent([p.value for p in points], [p.steps for p in points])
        last = exponent([p.value for p in points[-2:]], [p.steps for p in points[-2:]])
        for point in points:
            first = point is points[0]
            lines.append(
                f"| {label if first else ''} | {figure(point.value)} | {point.rows} "
                f"| {point.modes} | {point.iterations} | {point.flips} "
                f"| {figure(1e3 * point.start)} | {figure(1e3 * point.steps)} "
                f"| {f'{slope:.2f} | {last:.2f}' if first else ' | '} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, draw and write."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    most, measured = load(), {}
    for name, label, points in axes():
        measured[name] = (label, points)
        most = max(most, load())
    draw(measured).savefig(FIGURES / "scaling.png", dpi=130)
    write_section("Scaling", section(measured, most=most))


if __name__ == "__main__":
    main()
