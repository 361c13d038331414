"""The section and the figure of accuracy against cost."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.errors import (
    CONTACT_LIMIT,
    RMS_LIMIT,
    Error,
    Run,
)
from benchmarks.log_axis import label_times
from benchmarks.machine import figure, machine
from benchmarks.schemes import MODES

PROMISED = ("drive_force", "drive_gap", "gap", "sensor_gap", "lateral_displacement")
"""Channels that quick mode is for; the rest is reported."""
GROUPS = {
    "drives and gaps": PROMISED,
    "object": ("object_force",),
    "friction of single chairs": ("chair_friction_force",),
}
PICTURED = ("sb1, object", "sb2, object", "default, object")
COLOURS = {100.0: "#0072B2", 300.0: "#D55E00"}
"""Of the lines: the cut-offs of quick and of waveform mode."""
OWN = "reference at twice the step"
WORTH_TELLING = 0.05
"""Of the reference's own error [% rms]."""


def draw(runs: Sequence[Run]) -> Figure:
    """Draw the worst rms of some channels over the processor time, a line a cut-off."""
    pictured = [case for case in PICTURED if any(run.case == case for run in runs)]
    drawing = Figure(figsize=(1.0 + 3.0 * len(pictured), 8.2), layout="constrained")
    grid = drawing.subplots(len(GROUPS), len(pictured), sharex="col", sharey="row", squeeze=False)
    for row, (title, names) in zip(grid, GROUPS.items(), strict=True):
        for ax, case in zip(row, pictured, strict=True):
            _curves(ax, [r for r in runs if r.case == case and r.channels], names)
            if ax is row[0]:
                ax.set_ylabel(f"{title}\nrms [% of peak]")
            if ax.get_subplotspec().is_first_row():
                ax.set_title(case, fontsize=10)
            if ax.get_subplotspec().is_last_row():
                ax.set_xlabel("processor time [ms]")
    handles, labels = grid[0][0].get_legend_handles_labels()
    drawing.legend(
        handles,
        labels,
        frameon=False,
        ncols=3,
        loc="outside upper center",
    )
    return drawing


def _curves(ax: Axes, runs: Sequence[Run], names: Sequence[str]) -> None:
    cost, worst = (lambda r: 1e3 * r.seconds), (lambda r: worst_rms(r, names))
    for cutoff, colour in COLOURS.items():
        line = [r for r in runs if r.cutoff_frequency == cutoff and " ms, " in r.name]
        line.sort(key=lambda r: r.step)
        ax.loglog(
            [cost(r) for r in line], [worst(r) for r in line],
            "o-", color=colour, markersize=3.5, linewidth=1, label=f"cut-off {cutoff:g} Hz",
        )  # fmt: skip
        if cutoff == max(COLOURS):
            for run in line:
                ax.annotate(
                    f"{1e3 * run.step:g}", (cost(run), worst(run)), fontsize=7,
                    textcoords="offset points", xytext=(3, 3),
                )  # fmt: skip
    for mode, marker in zip(MODES, ("s", "D"), strict=True):
        found = [r for r in runs if r.name == mode]
        ax.loglog(
            [cost(r) for r in found], [worst(r) for r in found], marker, markersize=10,
            markerfacecolor="none", markeredgecolor="#CC79A7", markeredgewidth=1.8,
            label=f"{mode} mode",
        )  # fmt: skip
    for own in (r for r in runs if r.name == OWN):
        ax.axhline(worst(own), color="#999999", linestyle=":", label="reference at twice its step")
    if names is PROMISED:
        ax.axhline(
            RMS_LIMIT, color="#009E73", linestyle="--", linewidth=1, label="promised of quick"
        )
    if runs:
        costs = [cost(run) for run in runs if run.name != OWN]
        label_times(ax, 0.8 * min(costs), 1.4 * max(costs))
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)


def worst_rms(run: Run, names: Sequence[str]) -> float:
    """Return the largest rms among some channels [% of peak]; NaN without any."""
    found = [run.channels[name].rms for name in names if name in run.channels]
    return max(found, default=float("nan"))


def section(runs: Sequence[Run]) -> str:
    """Return the section."""
    load = max(run.load for run in runs)
    lines = [
        f"Written by `python -m benchmarks.accuracy` on {machine()}, at a load of up to "
        f"{load:.1f}. Least processor time of up to three solutions, one thread.",
        "",
        "The reference is turnout's own with steps of 0.05 ms and all modes, kept every "
        "millisecond. Errors are at the instants that a run keeps itself: *rms* and *largest*"
        " difference in percent of the channel's peak in the reference (energies: of the scale of"
        " its energy balance), of several members (chairs, drives) the worst; *end* is the"
        " difference when all is at rest again. The scheme offers fixed steps, which it halves"
        " where the set does"
        " not settle, and no error-controlled ones. `gap_tolerance` and `force_tolerance` are"
        " far below the errors here, so that step and cut-off decide.",
        "",
        "![Error of drives, object and chairs against processor time](../figures/accuracy.png)",
        "",
        "Cases with a 13 mm object; small figures at the line of 300 Hz are steps [ms]. On SB1 the"
        " object vanishes at 4 s under 7 kN, which no switch does: that blow makes its errors.",
        "",
        _modes(runs),
        *(_verdicts(runs, mode) for mode in MODES),
        _own(runs),
        *(_channels(runs, mode) for mode in MODES),
    ]
    return "\n".join(lines)


def _modes(runs: Sequence[Run]) -> str:
    lines = ["| case | run | step [ms] | cut-off [Hz] | modes | halved steps | time [ms] |"]
    lines.append("|---|---|---:|---:|---:|---:|---:|")
    for run in runs:
        if run.name in MODES or run.name == OWN:
            cutoff = "none" if run.name == OWN else figure(run.cutoff_frequency)
            lines.append(
                f"| {run.case} | {run.name} | {1e3 * run.step:g} | {cutoff} | {run.modes} "
                f"| {run.halved} | {figure(1e3 * run.seconds)} |"
            )
    return "\n".join(lines) + "\n"


def _verdicts(runs: Sequence[Run], mode: str) -> str:
    """Return text on the channels that keep the promise in all or some cases, and on the touch."""
    found = [run for run in runs if run.name == mode]
    early = [run.case for run in found if not run.channels]
    names = list(dict.fromkeys(name for run in found for name in run.channels))
    kept, broken = [], []
    for name in names:
        outside = [r.case for r in found if name in r.channels and not r.channels[name].within]
        if outside:
            broken.append(f"`{name}` ({'; '.join(outside)})")
        else:
            kept.append(f"`{name}`")
    late = max((abs(run.contact_late) for run in found), default=0.0)
    touch = "within" if late <= CONTACT_LIMIT else "**outside**"
    text = (
        f"**{mode.capitalize()} mode.** Within {RMS_LIMIT:g} % rms and, where it is a force, 1 % or"
        f" 15 N at the end, in all cases: {', '.join(kept) or 'none'}. Outside in the cases named:"
        f" {', '.join(broken) or 'none'}. First contact is off by {figure(1e3 * late)} ms at most,"
        f" {touch} {1e3 * CONTACT_LIMIT:g} ms.\n"
    )
    return text + (f"\nEnded early: {', '.join(early)}.\n" if early else "")


def _own(runs: Sequence[Run]) -> str:
    """Return the remaining change of the reference itself."""
    worst = [
        (found.rms, f"`{name}` {found.rms:.2f} % ({run.case})")
        for run in runs
        if run.name == OWN
        for name, found in run.channels.items()
        if found.rms > WORTH_TELLING
    ]
    shown = ", ".join(text for _, text in sorted(worst, reverse=True)) or "none"
    return (
        f"**The reference** changes with twice its step by less than {WORTH_TELLING:g} % rms in all"
        f" channels but: {shown}. Which chairs lock what is left of a swing decides there.\n"
    )


def _channels(runs: Sequence[Run], mode: str) -> str:
    """Return the table of all channels of a mode: rms / largest / end."""
    found = [run for run in runs if run.name == mode and run.channels]
    names = list(dict.fromkeys(name for run in found for name in run.channels))
    lines = [
        f"### {mode.capitalize()}: rms / largest [% of peak] / end",
        "",
        (
            "End in N, mm or J; bold is outside of what quick mode promises of drives and gaps."
            f" Channels that are within, and below {RMS_LIMIT:g} % rms, in all cases are left out."
        ),
        "",
        "| channel | " + " | ".join(run.case for run in found) + " |",
        "|---|" + "---|" * len(found),
    ]
    for name in names:
        own = [run.channels[name] for run in found if name in run.channels]
        if all(item.within and item.rms < RMS_LIMIT for item in own):
            continue
        cells = [_cell(run.channels.get(name), name) for run in found]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    touches = [f"{1e3 * run.contact_late:.1f} ms" for run in found]
    lines.append("| first contact, late by | " + " | ".join(touches) + " |")
    return "\n".join(lines) + "\n"


def _cell(found: Error | None, name: str) -> str:
    if found is None:
        return ""
    lengths = name in PROMISED and np.isnan(found.end_allowed)
    end = 1e3 * found.end if lengths else found.end
    text = f"{found.rms:.2f} / {found.largest:.2f} / {figure(round(end, 3))}"
    return text if found.within else f"**{text}**"
