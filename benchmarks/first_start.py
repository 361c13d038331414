"""Measure the work before the first throw: compiling kernels, loading them, importing.

    python -m benchmarks.first_start [--older FOLDER]

Processor seconds (user and system) of whole commands, each in a new process: with an empty cache
folder, where kernels are compiled, and with the full one; and the most memory that one took. With
`--older` the sources of another checkout run beside these, in turn. Bytecode is written, as for
every user.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.machine import load, machine
from benchmarks.page import write_section

HERE = Path(__file__).parents[1]
SIMULATE = ["simulate", "uic60-760-1-15", "--object", "13mm@sleeper6", "--quiet"]
MACHINES = ["--set", "drive.1.machine=jea73", "--set", "drive.2.machine=jea73-drive2"]
FIRST_STEP = f"""
import os, sys
from turnout.cli import watch
from turnout.cli.main import main
bar = getattr(watch, "ProgressBar", None) or watch.Watch  # of an older checkout
bar.report = lambda *_: os._exit(0)
sys.argv = ["turnout", *{SIMULATE!r}]
main()
"""
"""`turnout simulate` until it first reports its progress."""

COMMANDS = {
    "first `simulate`, kernels compiled": ["-m", "turnout", *SIMULATE],
    "first one with machines after it": ["-m", "turnout", *SIMULATE, *MACHINES],
    "`simulate` without files, kernels at hand": ["-m", "turnout", *SIMULATE],
    "the same to a file": ["-m", "turnout", *SIMULATE, "--out", "throw.nc"],
    "the same to a file and a figure": [
        *("-m", "turnout", *SIMULATE, "--out", "throw.nc", "--plot", "throw.png")
    ],
    "the same until it first reports progress": ["-c", FIRST_STEP],
    "`--version`": ["-m", "turnout", "--version"],
}
REPEATED = 5
"""Number of runs of commands that find compiled kernels."""


def used(arguments: list[str], *, root: Path, cache: Path) -> tuple[float, float]:
    """Return processor seconds of a program of a checkout, and its peak memory [MB]."""
    left_out = ("PYTHONDONTWRITEBYTECODE", "NUMBA_CACHE_DIR")
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    environment = kept | {"PYTHONPATH": str(root / "src"), "TURNOUT_CACHE_DIR": str(cache)}
    cache.mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, *arguments], cwd=cache, env=environment, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, arguments)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000


Used = tuple[float, float]


def measured(roots: dict[str, Path]) -> dict[str, dict[str, Used]]:
    """Return processor seconds and memory by command and checkout, medians of repeated ones."""
    found: dict[str, dict[str, Used]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for what, arguments in COMMANDS.items():
            runs: dict[str, list[Used]] = {name: [] for name in roots}
            for _ in range(1 if what.startswith("first") else REPEATED):
                for name, root in roots.items():
                    cache = Path(folder) / name
                    runs[name].append(used(arguments, root=root, cache=cache))
            found[what] = {
                name: (statistics.median(seconds), statistics.median(memory))
                for name, (seconds, memory) in (
                    (name, zip(*values, strict=True)) for name, values in runs.items()
                )
            }
    return found


def main() -> None:
    """Measure and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, help="another checkout, measured beside this one")
    older = parser.parse_args().older
    if older is not None and not (older / "src" / "turnout").is_dir():
        parser.error(f"--older {older}: no checkout of turnout is there (src/turnout is missing)")
    roots = {"this": HERE} | ({"older": older.resolve()} if older else {})
    begun, found = load(), measured(roots)
    head = "| command | processor time | memory |"
    head += " older | its memory | ratio |" if older else ""
    lines = [
        f"Written by `python -m benchmarks.first_start{' --older FOLDER' if older else ''}` on",
        f"{machine()}, at a load of {begun:.0f} to {load():.0f}.",
        "Processor seconds, user and system, of whole commands in new processes; on an idle core",
        "they take about as long by the clock. Memory is the most that was in use.",
        "",
        head,
        "|---|--:|--:|" + ("--:|--:|--:|" if older else ""),
    ]
    for what, values in found.items():
        seconds, memory = values["this"]
        own = f"| {what} | {seconds:.2f} s | {memory:.0f} MB |"
        if older:
            before, much = values["older"]
            own += f" {before:.2f} s | {much:.0f} MB | {before / seconds:.2f} |"
        lines.append(own)
    write_section("Before the first throw", "\n".join(lines))


if __name__ == "__main__":
    main()
