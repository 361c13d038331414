"""Measure what comes before the first throw: compiling kernels, loading them, importing.

    python -m benchmarks.first_start [--older FOLDER]

Processor seconds (user and system) of whole commands, each in a new process: with an empty cache
folder, where kernels are compiled, and with the full one. With `--older` the sources of another
checkout run beside these, in turn. Bytecode is written, as for every user.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.machine import load, machine

HERE = Path(__file__).parents[1]
PAGE = HERE / "docs" / "performance-start.md"
SIMULATE = ["simulate", "uic60-760-1-15", "--object", "13mm@sleeper6", "--quiet"]
MACHINES = ["--set", "drive.1.machine=jea73", "--set", "drive.2.machine=jea73-drive2"]
COMMANDS = {
    "first `simulate`, kernels compiled": SIMULATE,
    "first one with machines after it": [*SIMULATE, *MACHINES],
    "`simulate` without files, kernels at hand": SIMULATE,
    "`--version`": ["--version"],
}
WARM = {"`simulate` without files, kernels at hand": 5, "`--version`": 5}
"""Commands that are repeated, and how often."""


def processor_seconds(arguments: list[str], *, root: Path, cache: Path) -> float:
    """Return the processor seconds of a command of a checkout."""
    left_out = ("PYTHONDONTWRITEBYTECODE", "NUMBA_CACHE_DIR")
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    environment = kept | {"PYTHONPATH": str(root / "src"), "TURNOUT_CACHE_DIR": str(cache)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "turnout", *arguments]
    subprocess.run(command, check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(roots: dict[str, Path]) -> dict[str, dict[str, float]]:
    """Return processor seconds by command and checkout, medians of those that are repeated."""
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for what, arguments in COMMANDS.items():
            runs: dict[str, list[float]] = {name: [] for name in roots}
            for _ in range(WARM.get(what, 1)):
                for name, root in roots.items():
                    cache = Path(folder) / name
                    runs[name].append(processor_seconds(arguments, root=root, cache=cache))
            found[what] = {name: statistics.median(values) for name, values in runs.items()}
    return found


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, help="another checkout, measured beside this one")
    older = parser.parse_args().older
    roots = {"this": HERE} | ({"older": older.resolve()} if older else {})
    begun, found = load(), measured(roots)
    head = "| command | processor time |" + (" older | ratio |" if older else "")
    lines = [
        "# Before the first throw",
        "",
        f"Written by `python -m benchmarks.first_start{' --older FOLDER' if older else ''}` on",
        f"{machine()}, at a load of {begun:.0f} to {load():.0f}.",
        "Processor seconds, user and system, of whole commands in new processes; on an idle core",
        "they take about as long by the clock.",
        "",
        head,
        "|---|--:|" + ("--:|--:|" if older else ""),
    ]
    for what, values in found.items():
        own = f"| {what} | {values['this']:.2f} s |"
        if older:
            own += f" {values['older']:.2f} s | {values['older'] / values['this']:.2f} |"
        lines.append(own)
    known = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    _, mark, notes = known.partition("\n## ")
    text = "\n".join(lines) + "\n" + (mark + notes)
    PAGE.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
