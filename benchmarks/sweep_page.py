"""The section of `benchmarks.sweep`."""

from typing import Any

from benchmarks.machine import machine

# The wanted share of the ideal rate; scenarios within an hour on so many cores; and the wanted
# time of the published campaign [s].
SHARE, HOUR, CORES, CAMPAIGN = 0.9, 100_000, 2, 15.0


def section(kept: dict[str, Any]) -> str:
    """Return the section of the kept measurements."""
    small = kept["small"]
    curve = "\n".join(f"| {n} | {run:.0f} | {worker:.0f} |" for n, run, worker in thinned(small))
    store = "\n".join(f"| {name} | {size / 1e3:.1f} |" for name, size in kept["sizes"].items())
    look = "\n".join(f"| {name} | {seconds:.3f} |" for name, seconds in kept["reading"].items())
    return f"""Written by `python -m benchmarks.sweep` on {machine()}.
{rate_section(kept["full"], "quick")}
Beside solving a worker makes the panels of its scenarios and places their objects, recovers gaps
from the motion of the rails, takes labels and features from every instant, and compresses and
writes. A worker starts in about a second (imports, kernels from their files, the first rails),
which weighs the less the more throws there are.
{rate_section(kept["waveform"], "waveform")}
What is done beside solving hardly depends on the mode, so that it weighs less in this one.
{campaign_section(kept["campaign"])}
### Memory

{small["stored"]} small throws (`sb1`, cut short) in {small["workers"]} processes.

| batches written | run [MB] | largest worker [MB] |
|---|---|---|
{curve}

### Disk

| kept of a throw of the default panel | kB |
|---|---|
{store}

### Reading

The sweep of {small["stored"]} small throws.

| what | seconds |
|---|---|
{look}
"""


def rate_section(full: dict[str, Any], mode: str) -> str:
    """Return the part on rates of a mode: by the clock, and by processor time."""
    n, workers = full["thrown"], full["workers"]
    solved = full["solver"] / n, full["solver_processor"] / n
    work = full["busy"] / n, full["busy_processor"] / n
    whole = full["wall"] * workers / n, full["processor"] / n
    rows = [
        ("solved in, mean a throw", *(f"{1e3 * t:.1f} ms" for t in solved)),
        ("of that the mechanism built in", f"{1e3 * full['build'] / n:.2f} ms", ""),
        (
            "spent beside solving while workers are at work, mean a throw",
            *(f"{1e3 * (a - b):.1f} ms" for a, b in zip(work, solved, strict=True)),
        ),
        (
            "start of the workers, waiting, card and end, mean a throw",
            *(f"{1e3 * (a - b):.1f} ms" for a, b in zip(whole, work, strict=True)),
        ),
        (
            f"ideal rate: {workers} solvers that do nothing else",
            *(f"{workers / t:.1f} a second" for t in solved),
        ),
        ("rate of the whole run", *(f"{workers / t:.1f} a second" for t in whole)),
        (
            "share of the ideal while workers are at work, writing included",
            *(share(a / b) for a, b in zip(solved, work, strict=True)),
        ),
        (
            "share of the ideal, whole run",
            *(share(a / b) for a, b in zip(solved, whole, strict=True)),
        ),
        (
            f"{HOUR} throws on {CORES} cores",
            *(f"{HOUR * t / CORES / 60.0:.0f} min" for t in whole),
        ),
    ]
    table = "\n".join(f"| {what} | {clock} | {used} |" for what, clock, used in rows)
    return f"""
### Rate in the mode {mode}

{n} throws of the default panel in {workers} processes, each with its own friction, drive
stiffness, object size and place. A throw is solved in what `simulate` reports as its `solver_time`:
the mechanism built, its equilibrium found, the motion integrated. The whole run lasts
{full["wall"]:.1f} s, from the study in memory to the data card. Where the two columns differ,
throws waited for others on the machine, whose load was
{full["load_before"]:.1f} in the minute before and
{full["load"]:.1f} in the last one.

| what | by the clock | by processor time |
|---|---|---|
{table}
"""


def campaign_section(campaign: dict[str, Any]) -> str:
    """Return the part on the published campaign."""
    met = "meets" if campaign["wall"] < CAMPAIGN else "MISSES"
    return f"""
### The published campaign

`turnout sweep run paper-campaign --workers {campaign["workers"]}`: 13 places by 11 sizes, at each
place until a drive slips. The whole command, from the start of Python to the data card, takes
{campaign["wall"]:.1f} s by the clock and {campaign["processor"]:.1f} s of processor time ({met} the
aim of {CAMPAIGN:.0f} s), at a load of {campaign["load"]:.1f}: {campaign["thrown"]} throws, and
{campaign["skipped"]} left out after a slip.
"""


def share(value: float) -> str:
    """Return a share of the ideal rate and its verdict, met or missed."""
    verdict = "meets" if value >= SHARE else "MISSES"
    return f"{100 * value:.1f} % ({verdict} the aim of {100 * SHARE:.0f} %)"


def thinned(small: dict[str, Any]) -> list[list[float]]:
    """Return about ten points of the curve of memory, the last one among them."""
    # Before the first batch workers start, after the last one they have ended.
    last = max((point[0] for point in small["curve"]), default=0)
    curve: list[list[float]] = [point for point in small["curve"] if 0 < point[0] < last]
    every = max(1, len(curve) // 10)
    return [*curve[:-1:every], curve[-1]] if curve else []
