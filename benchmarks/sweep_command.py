"""Compare `turnout sweep run` with that of another checkout, however old.

    python -m benchmarks.sweep_command OLDER [--times 3]

Both run the study of `benchmarks.sweep_rate` on their own default panel, with few and with more
scenarios in turn: the difference is what a throw takes, without the start of Python and workers.
Processor seconds (user and system) of the commands and their two workers; kernels are compiled
before. Older code needs the libraries of this environment.
"""

import argparse
import statistics
import tempfile
from pathlib import Path

from benchmarks.first_start import used
from benchmarks.machine import load, machine

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "benchmarks" / "million.toml"
FEW, MORE = 128, 896
"""Scenarios of the shorter and of the longer command."""


def spent(source: Path, folder: Path, count: int) -> float:
    """Return the processor seconds of the command for some scenarios."""
    study = folder / f"{count}.toml"
    text = STUDY.read_text("utf-8")
    study.write_text(text.replace("count = 1000000", f"count = {count}"), "utf-8")
    with tempfile.TemporaryDirectory(dir=folder) as out:
        options = ["--out", f"{out}/sweep", "--workers", "2", "--quiet"]
        arguments = ["-m", "turnout", "sweep", "run", str(study), *options]
        seconds, _ = used(arguments, root=source, cache=folder / "cache")
    return seconds


def throw_time(source: Path, folder: Path) -> float:
    """Return the processor time of a throw [s]."""
    few, more = (spent(source, folder, count) for count in (FEW, MORE))
    return (more - few) / (MORE - FEW)


def compared(older: Path, *, times: int) -> tuple[float, float]:
    """Return the medians of the processor time of a throw, of older code and of this one [s]."""
    found: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        places = (older, Path(one)), (ROOT, Path(other))
        for source, folder in places:
            spent(source, folder, 2)
        for _ in range(times):
            before, now = (throw_time(source, folder) for source, folder in places)
            print(f"older {1e3 * before:.1f} ms, present {1e3 * now:.1f} ms", flush=True)
            found.append((before, now))
    before, now = (statistics.median(values) for values in zip(*found, strict=True))
    return before, now


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("older", type=Path)
    parser.add_argument("--times", type=int, default=3)
    chosen = parser.parse_args()
    before, now = compared(chosen.older.absolute(), times=chosen.times)
    print(f"{machine()}, load {load():.1f}")
    print(f"a throw: older {1e3 * before:.1f} ms, present {1e3 * now:.1f} ms")
    print(f"ratio {before / now:.2f}")


if __name__ == "__main__":
    main()
