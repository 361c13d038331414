"""Measure throws of quick sweeps against older checkouts, for docs/evidence/performance.md.

    python -m benchmarks.sweep_rate OLDER ... [--batches 4] [--only million] [--note TEXT]
    python -m benchmarks.sweep_rate --kinds [--panel NAME ...] [--batches 4]

The second form throws, by the present code, studies in which one kind of variable or another
varies, and gives the ratio of their time to that of `million.toml` on the same panel, in turns of
one run.

OLDER is the folder of another checkout, such as one made by `git worktree add --detach OLDER main`.
Each code runs in a process of one thread that stays; all throw the same scenarios, a batch each in
turn, there and back again, since the place in a turn may matter. Batches are made and compressed
but not written. Processor time counts, and of it the median over the turns: of the times, and of
the ratios of times that were taken one after another, in which other work on the machine hardly
shows. Bytes and the plan of a hundred million throws follow from the present code.
"""

import argparse
import importlib.resources
import json
import os
import statistics
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import tomlkit

from benchmarks.machine import ONE_THREAD, load, machine
from benchmarks.page import write_section
from turnout.panel.load import load_panel

ROOT = Path(__file__).parents[1]
STUDIES = {
    "stiffness, slip, friction field, object size and place": ROOT / "benchmarks" / "million.toml",
    "population of sound switches": "detection-reference",
}
WARM, BATCH, FEATURES = 256, 128, 1024
"""Throws that are not counted, throws in turn, and in a batch of features alone."""
PLANNED = 100_000_000
CORES = (2, 16, 128)

CHILD = """
import json, signal, sys, time
from dataclasses import replace
try:
    from turnout.calibration.load_study import load_study
    from turnout.study.sweep.batch import LARGEST_BATCH, batch_variables, throw_batch
    from turnout.study.sweep.batch_bytes import file_bytes
    from turnout.study.sweep.worker import initialize_worker
except ImportError:
    try:  # an older checkout
        from turnout.study.load_study import load_study
        from turnout.sweep.batch import LARGEST_BATCH, batch_variables, throw_batch
        from turnout.sweep.batch_file import file_bytes
        from turnout.sweep.worker import initialize_worker
    except ImportError:  # the parent says that this code is too old
        sys.exit(1)
signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a worker
initialize_worker()
study = load_study(sys.argv[1])
if len(sys.argv) > 2:
    from turnout.detection.panel_population import population_for
    from turnout.panel.load import load_panel

    panel, changes = json.loads(sys.argv[2])
    if panel != study.panel.name:
        study = population_for(study, load_panel(panel))
    study = replace(study, panel=study.panel.with_overrides(changes)) if changes else study
alone = replace(study, output=replace(study.output, channels=()))
for line in sys.stdin:
    first, count, features = json.loads(line)
    largest = count if features else LARGEST_BATCH
    began, solver, size = time.process_time(), 0.0, 0
    for begin in range(first, first + count, largest):
        throws = range(begin, min(begin + largest, first + count))
        kept = alone if features else study
        rows = throw_batch(kept, [throws])
        size += len(file_bytes(batch_variables(kept, rows)))
        solver += sum(row.solver.processor for row in rows)
    spent = time.process_time() - began
    found = {"all": spent / count, "solver": solver / count, "bytes": size / count}
    print(json.dumps(found), flush=True)
"""


class Thrower:
    """A process that throws scenarios of a study with the sources of a checkout."""

    def __init__(self, source: Path, study: str, *changes: str) -> None:
        self._source = source
        environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(source / "src")}
        self._process = subprocess.Popen(
            [sys.executable, "-c", CHILD, study, *changes],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def throw(self, first: int, count: int, *, features: bool = False) -> dict[str, float]:
        """Return seconds and bytes a throw of some scenarios."""
        given, answers = self._process.stdin, self._process.stdout
        if given is None or answers is None:
            raise RuntimeError
        answer = ""
        with suppress(BrokenPipeError):  # it has ended
            given.write(json.dumps([first, count, features]) + "\n")
            given.flush()
            answer = answers.readline()
        if not answer:
            self.end()
            sys.exit(
                f"{self._source}: cannot throw batches as this benchmark does; "
                "take a checkout of a later commit"
            )
        found: dict[str, float] = json.loads(answer)
        return found

    def end(self) -> None:
        """End the process."""
        self._process.communicate()


def measured(sources: Sequence[Path], study: str, *, batches: int) -> list[dict[str, float]]:
    """Throw a study with several codes in turn, the present one last.

    Returns
    -------
    list of dict
        For each code the medians of seconds and bytes a throw, and of the `ratio` of its time to
        that of the present one; of that one also the bytes of `features` alone.
    """
    throwers = [Thrower(source, study) for source in sources]
    for thrower in throwers:
        thrower.throw(0, WARM)
    turns = []
    for number in range(batches):
        first = WARM + number * BATCH
        there = [thrower.throw(first, BATCH) for thrower in throwers]
        back = [thrower.throw(first + batches * BATCH, BATCH) for thrower in reversed(throwers)]
        turn = [_mean(pair) for pair in zip(there, reversed(back), strict=True)]
        turns.append(turn)
        print(study, [f"{1e3 * item['all']:.2f} ms" for item in turn], flush=True)
    features = throwers[-1].throw(0, FEATURES, features=True)["bytes"]
    for thrower in throwers:
        thrower.end()
    found = []
    for number in range(len(sources)):
        own = [turn[number] for turn in turns]
        medians = {name: statistics.median(item[name] for item in own) for name in own[0]}
        ratio = statistics.median(turn[number]["all"] / turn[-1]["all"] for turn in turns)
        found.append(medians | {"ratio": ratio, "features": features})
    return found


PANELS = ("uic60-760-1-15", "sb2", "60e1-300-1-9")
KINDS = (
    *("friction", "stiffness", "million", "place", "section", "population", "machines"),
    "population and place",
)
"""Variables: friction of chairs alone; stiffness and slip level of drives; all of `million.toml`;
this with objects between the places of a panel, or with sections of the switch rails; the
population of sound switches; friction and objects with machines for drives; the population with
objects."""
_SECTION = {"distribution": "uniform", "minimum": 0.9, "maximum": 1.1}


def kind_of_study(kind: str, panel: str, folder: Path) -> tuple[str, str]:
    """Return the study of a kind for a panel, a name or a file, and its changes for `CHILD`.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    panel : str
        Name of a library panel.
    folder : Path
        Where a study is written that has no file.
    """
    loaded, changes = load_panel(panel), dict[str, object]()
    population = kind.startswith("population")
    library = importlib.resources.files("turnout.study") / "library" / "detection-reference.toml"
    million = (ROOT / "benchmarks" / "million.toml").read_text(encoding="utf-8")
    text = library.read_text(encoding="utf-8") if population else million
    study = tomllib.loads(text)
    drives = list(loaded.drive.values())
    place = {"key": "object.x", "distribution": "uniform", "minimum": f"{drives[0].x + 0.1} m"}
    place["maximum"] = f"{drives[0].x + 4.0} m"
    own = [item for item in study["variable"] if item["key"].split(".")[0] != "drive"]
    if population:
        if kind != "population":
            size = next(v for v in tomllib.loads(million)["variable"] if v["key"] == "object.size")
            study["variable"] += [place, size]
            study["sampling"]["count"] = 1_000_000
    else:
        study["panel"] = panel
        drive = [v for v in study["variable"] if v["key"].split(".")[1] in loaded.drive]
        at = [item for item in own if item["key"] != "object.at"]
        section = [{"key": f"rail.{name}_scale", **_SECTION} for name in SCALES]
        study["variable"] = {
            "friction": [item for item in own if item["key"].startswith("chair")],
            "stiffness": drive,
            "million": own + drive,
            "place": [*at, *drive, place],
            "section": own + drive + section,
            "machines": own,
        }[kind]
        if kind == "stiffness":
            study["field"] = []
        if kind == "machines":
            machines = ("jea73", "jea73-drive2")
            pairs = zip(loaded.drive, machines, strict=False)
            changes = {f"drive.{name}.machine": machine for name, machine in pairs}
    path = folder / f"{kind} {panel}.toml"
    path.write_text(tomlkit.dumps(study), encoding="utf-8")
    return str(path), json.dumps([panel, changes])


SCALES = ("section", "lateral_inertia")


def measured_kinds(panel: str, *, batches: int) -> dict[str, dict[str, float]]:
    """Throw all kinds of studies of a panel in turn; seconds a throw and `ratio` to the million."""
    with TemporaryDirectory() as folder:
        throwers = {
            kind: Thrower(ROOT, *kind_of_study(kind, panel, Path(folder))) for kind in KINDS
        }
        for thrower in throwers.values():
            thrower.throw(0, WARM)
        turns = []
        for number in range(batches):
            first = WARM + 2 * number * BATCH
            there = {kind: thrower.throw(first, BATCH) for kind, thrower in throwers.items()}
            back = {
                kind: thrower.throw(first + BATCH, BATCH)
                for kind, thrower in reversed(throwers.items())
            }
            turns.append({kind: _mean((there[kind], back[kind])) for kind in KINDS})
            times = {kind: f"{1e3 * item['all']:.2f} ms" for kind, item in turns[-1].items()}
            print(panel, times, flush=True)
        for thrower in throwers.values():
            thrower.end()
    found = {}
    for kind in KINDS:
        time = statistics.median(turn[kind]["all"] for turn in turns)
        ratios = [turn[kind]["all"] / turn["million"]["all"] for turn in turns]
        solver = statistics.median(turn[kind]["solver"] for turn in turns)
        found[kind] = {"all": time, "ratio": statistics.median(ratios), "solver": solver}
        found[kind] |= {"least": min(ratios), "largest": max(ratios)}
    return found


def section_of_kinds(found: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the section of all kinds of variables, by panel."""
    rows = [
        f"| {panel} | {kind} | {1e3 * item['all']:.1f} | {1e3 * item['solver']:.1f} | "
        f"{item['ratio']:.2f} ({item['least']:.2f} to {item['largest']:.2f}) |"
        for panel, kinds in found.items()
        for kind, item in kinds.items()
    ]
    return "\n".join(
        [
            f"Written by `python -m benchmarks.sweep_rate --kinds` on {machine()}, at a",
            f"load of {load():.1f}. Processor time of one thread a throw in mode quick, batches",
            "made and compressed; studies of one panel in turns; the ratio is their median",
            "(least to largest).",
            "Half of a throw of the million are its steps, which no variable changes much. Places",
            "between nodes add a row to rails that are condensed; sections and fastenings have",
            "modes, flexibilities and gaps of their own; machines are stepped beside their rails,",
            "for longer where the schedule waits for them.",
            "",
            "| panel | variables | a throw [ms] | thereof solver [ms] | ratio to the million |",
            "|---|---|---:|---:|---:|",
            *rows,
            "",
        ]
    )


def _mean(pair: tuple[dict[str, float], dict[str, float]]) -> dict[str, float]:
    one, other = pair
    return {name: 0.5 * (one[name] + other[name]) for name in one}


def section(found: dict[str, list[dict[str, float]]], names: Sequence[str], *, note: str) -> str:
    """Return the section of the measurements; `names` are those of the codes."""
    rows = [
        f"| {what} | {name} | {1e3 * item['all']:.1f} | {1e3 * item['solver']:.1f} | "
        f"{item['ratio']:.2f} | {2 * 3600 / item['all']:,.0f} |"
        for what, items in found.items()
        for name, item in zip(names, items, strict=True)
    ]
    new = next(iter(found.values()))[-1]
    plan = [
        f"| {cores} | {PLANNED * new['all'] / cores / 3600:,.0f} | "
        f"{PLANNED * new['features'] / 1e9:,.0f} | {PLANNED * new['bytes'] / 1e9:,.0f} |"
        for cores in CORES
    ]
    return "\n".join(
        [
            f"Written by `python -m benchmarks.sweep_rate OLDER ...` on {machine()}, at a",
            f"load of {load():.1f}. Processor time of one thread a throw, the same scenarios",
            "thrown by older codes and the present one, a batch each in turn; batches are made and",
            "compressed. Medians; the ratio is that of times taken one after another. What other",
            "work on the machine takes from the caches is in the times and hardly in the ratio.",
            *textwrap.wrap(note, 98),
            "",
            "| what varies | code | a throw [ms] | of that the solver [ms] | ratio to the present "
            "| an hour on 2 cores |",
            "|---|---|---:|---:|---:|---:|",
            *rows,
            "",
            "### A hundred million throws",
            "",
            f"From the first row: {1e3 * new['all']:.1f} ms, {new['features']:.0f} bytes a throw "
            'with `keep = "features"`,',
            f"{new['bytes'] / 1e3:.1f} kB with histories at 125 Hz. Times hold for this machine",
            "at that load and scale with cores; the start of a worker (about a second) is not in",
            "them.",
            "",
            "| cores | hours | disk for features [GB] | disk with histories [GB] |",
            "|---:|---:|---:|---:|",
            *plan,
            "",
            "Make it a hundred sweeps of a million, one a `seed`, since a sweep plans all of its",
            "batches at its start. [Workers of a cluster](../use/sweep-run.md) write their batches",
            "themselves; one that is lost costs its batch, at most 1,024 throws, which another one",
            "throws again (`tests/unit/test_study_sweep_cluster.py`).",
            "",
        ]
    )


def main() -> None:
    """Measure all checkouts in turn and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("older", type=Path, nargs="*")
    parser.add_argument("--kinds", action="store_true", help="compare kinds of variables")
    parser.add_argument("--panel", action="append", help="for --kinds, of the library")
    parser.add_argument("--batches", type=int, default=4)
    parser.add_argument("--only", default="", help="measure the study of this name alone")
    parser.add_argument("--note", default="", help="what else differs between the codes")
    chosen = parser.parse_args()
    if chosen.kinds:
        panels = chosen.panel or PANELS
        kinds = {name: measured_kinds(name, batches=chosen.batches) for name in panels}
        write_section("Rate by what varies", section_of_kinds(kinds))
        return
    sources = [*(older.absolute() for older in chosen.older), ROOT]
    found = {
        what: measured(sources, str(study), batches=chosen.batches)
        for what, study in STUDIES.items()
        if chosen.only in str(study)
    }
    names = [*(revision(source) for source in sources[:-1]), "present"]
    write_section("Rate of quick sweeps", section(found, names, note=chosen.note))


def revision(source: Path) -> str:
    """Return the short name of the commit of a checkout."""
    command = ["git", "-C", str(source), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    main()
