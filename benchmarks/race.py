"""Race turnout against other programs on SB1, and against the clock on whole panels.

    python -m benchmarks.race [FOLDER] [--again RACER ...]

writes two sections of docs/evidence/performance.md. What was measured is kept in FOLDER (default
build/race), so that an interrupted race goes on where it stopped and slow programs run once;
`--again` measures some racers afresh (`all` for everyone), which ratios ask for: they are of one
run. Needs the extra `benchmark`; a program that is not installed is left out, saying so.
"""

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.kept import keep
from benchmarks.log_axis import label_times
from benchmarks.machine import ONE_THREAD, figure, load, machine, seconds_text
from benchmarks.page import write_section
from benchmarks.racers import RACERS
from benchmarks.real_time import FILE as REAL_TIME
from benchmarks.real_time import section as real_time_section

ROOT = Path(__file__).parents[1]
NEEDS = {"exudyn": "exudyn", "exudyn-reduced": "exudyn", "opensees": "openseespy"}
Found = dict[str, object]
MODE_LINES = ("turnout-quick", "turnout-waveform")
PICTURE = "![Processor time of every program that agrees](../figures/race.png)\n"

TEXT = """One prismatic rail on 16 chairs, thrown and returned in 9 s: case A without an object,
case B with 13 mm at x = 3.9 m. Every program solves the same laws, friction with exact stick and
slip included, from rest to the end of the motion; reading, assembly and reduction are not counted
(they take turnout {setup}; a condensation that it finds in memory from the run before is not
either). Each is judged by the same checks against the same answers (Exudyn at 0.5 ms), those of the
benchmark: *rms* is the worst of the drives (at most 0.3 % of the peak) and the object (0.5 %);
*plateau* is the worst of the drives at 4.5 s and the object at 3.98 s in percent, at most 0.3.
*Friction* of single chairs is reported, not required. The ratio is to turnout's least that agrees,
of medians in this run, energy residual and every instant stored included. Rivals begin at rest,
which they are given; turnout finds it, so the last column is the ratio to its steps alone. Of each
rival its cheapest run that agrees is shown, and that with steps of 1 ms.

What the columns do not show:

- The banded program is ours, compiled, written for this race: full finite elements, exact sets, a
  factor kept for each of the last sixteen sets. Solving the lateral plane alone is what a
  researcher may do on SB1, where nothing moves up or down, and nowhere else.
- Exudyn holds the matrices in one object and the laws in user functions, which call the banded
  program's compiled laws; modified Newton, residual to 1e-6. On turnout's own superelement it
  differs from turnout in the solver alone: the fairest race.
- OpenSeesPy runs on its own beams and compiled materials, with the limit of friction kept at the
  normal force of rest; banded symmetric solver and Krylov-accelerated Newton were the quickest of
  several tried.
- Steps of 4 and 5 ms agree in case A and fail in case B, where the object's going rings; everyone
  is tried with the same steps, and turnout with several cut-offs and dampings.
"""


def measured(racer: str, case: str, step: float, folder: Path) -> Found | None:
    """Return the measurement of a racer, kept or made now; None if it is not installed."""
    path = folder / f"{racer}_{case}_{step:g}ms.json"
    if path.exists():
        kept: Found = json.loads(path.read_text(encoding="utf-8"))
        return kept
    needs = NEEDS.get(racer)
    if needs and importlib.util.find_spec(needs) is None:
        print(f"{RACERS[racer].title}: {needs} is not installed, left out", file=sys.stderr)
        return None
    print(f"{RACERS[racer].title}, case {case}, step {step or 'its own'} ms ...", file=sys.stderr)
    command = (racer, case, f"{step}", f"{RACERS[racer].repeats}")
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.racers", *command],
        check=True, stdout=subprocess.PIPE, text=True, env=os.environ | ONE_THREAD, cwd=ROOT,
    )  # fmt: skip
    found: Found = json.loads(run.stdout.strip().splitlines()[-1])
    keep(path, found)
    return found


def median(found: Found) -> float:
    """Return the median of the seconds of a measurement."""
    return float(statistics.median(found["seconds"]))  # type: ignore[call-overload]


def shown(lines: list[tuple[str, Found]]) -> list[tuple[str, Found]]:
    """Return turnout's runs, and of each rival the cheapest that agrees and the one of 1 ms."""
    kept = []
    for name in RACERS:
        own = [found for racer, found in lines if racer == name]
        if not name.startswith("turnout"):
            best = min((found for found in own if found["agrees"]), key=median, default=None)
            own = [found for found in own if found is best or found["step"] == 1.0]
        kept += [(name, found) for found in own]
    return kept


def table(case: str, lines: list[tuple[str, Found]]) -> str:
    """Return the table of a case, with ratios to turnout's least."""
    own = next(found for name, found in lines if name == "turnout-least")
    base, steps = median(own), median(own) - float(f"{own['start']}")
    text = [
        f"### SB1, case {case}",
        "",
        f"Turnout's least is {own['note']}: {figure(1e3 * base)} ms, of which",
        f"{figure(1e3 * steps)} ms are steps, the rest arrangement and equilibrium.",
        "",
        "| program | step [ms] | processor time | rms [%] | plateau [%] | friction [%] | agrees "
        "| ratio | to its steps |",
        "|---|---:|---:|---:|---:|---:|---|---:|---:|",
    ]
    for name, found in shown(lines):
        errors = " | ".join(figure(float(f"{found[k]}")) for k in ("rms", "plateau", "friction"))
        verdict = "yes" if found["agrees"] else "**no**"
        text.append(
            f"| {RACERS[name].title} | {found['step']:g} | {seconds_text(found['seconds'])} "  # type: ignore[arg-type]
            f"| {errors} | {verdict} | {figure(median(found) / base)} "
            f"| {figure(median(found) / steps)} |"
        )
    return "\n".join(text) + "\n"


def draw(raced: dict[str, list[tuple[str, Found]]]) -> Figure:
    """Draw everyone's cheapest run that agrees, one axis a case."""
    drawing = Figure(figsize=(8.5, 2.8), layout="constrained")
    halves, drawn = drawing.subplots(1, 2, sharex=True, sharey=True), list[float]()
    for ax, (case, lines) in zip(halves, raced.items(), strict=True):
        shown = {}
        for name in dict.fromkeys(name for name, _ in lines if name not in MODE_LINES):
            agreeing = [found for other, found in lines if other == name and found["agrees"]]
            if agreeing:
                shown[name] = min(median(found) for found in agreeing)
        titles = [RACERS[name].title for name in shown]
        seconds = list(shown.values())
        colours = ["#D55E00" if name.startswith("turnout") else "#0072B2" for name in shown]
        ax.scatter(seconds, titles, color=colours, zorder=3)
        for title, value in zip(titles, seconds, strict=True):
            ax.annotate(
                seconds_text([value]).split(" (")[0], (value, title), fontsize=8,
                textcoords="offset points", xytext=(7, -3),
            )  # fmt: skip
        ax.grid(alpha=0.3)
        ax.set_xscale("log")
        drawn += seconds
        ax.set_xlabel("processor time [s]")
        ax.set_title(f"SB1, case {case}: cheapest run that agrees", fontsize=10)
        ax.spines[["top", "right"]].set_visible(False)
    ax.invert_yaxis()
    label_times(ax, min(drawn) / 2, 10 * max(drawn))
    return drawing


def race(folder: Path) -> str:
    """Run missing racers; draw the figure and return the section."""
    before = load()
    parts, most, setup, raced = [], before, 0.0, {}
    for case in ("A", "B"):
        lines = []
        for name, racer in RACERS.items():
            for step in racer.steps:
                found = measured(name, case, step, folder)
                if found is not None:
                    lines.append((name, found))
                    most = max(most, float(f"{found['load']}"))
        setup = max(float(f"{found['setup']}") for n, found in lines if n == "turnout-least")
        parts.append(table(case, lines))
        raced[case] = lines
    draw(raced).savefig(ROOT / "docs" / "figures" / "race.png", dpi=130)
    head = (
        f"Written by `python -m benchmarks.race` on {machine()}, at a load of up to {most:.1f}. "
        "Processor seconds of one thread: median (least to largest).\n"
    )
    text = TEXT.format(setup=f"{figure(1e3 * setup)} ms")
    return "\n".join([head, PICTURE, text, *parts])


def main() -> None:
    """Race, and write the sections."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.race")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build" / "race")
    parser.add_argument("--again", nargs="+", default=[], choices=["all", "real-time", *RACERS])
    given = parser.parse_args()
    for name in RACERS if "all" in given.again else given.again:
        for path in given.folder.glob(f"{name}_?_*.json"):
            path.unlink()
    if {"all", "real-time"} & set(given.again):
        (given.folder / REAL_TIME).unlink(missing_ok=True)
    try:
        write_section("The race", race(given.folder))
        write_section("Against real time", real_time_section(given.folder))
    except KeyboardInterrupt:
        print(f"interrupted; {given.folder} holds what is done", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
