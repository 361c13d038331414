"""Digests of all results of a fixed set of runs, to show that a change of structure changes no bit.

    python -m benchmarks.studies.bits write before.json
    python -m benchmarks.studies.bits compare before.json

The set: every library panel in every mode, with and without an object, a sweep with drawn states,
a virtual campaign and its build, and a calibration. All of it runs through the command line, so
that the same script serves any layout of the packages. A digest is of names, shapes, types and
bytes of the variables of a file; attributes, which name version and times, do not count. Bits hold
in one environment: the same machine, the same versions.
"""

import argparse
import csv
import hashlib
import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

MODES = ("waveform", "quick", "quasi-static")
OBJECTS = {
    "sb1": "13 mm @ x = 3.9 m",
    "sb2": "13mm@sleeper6",
    "uic60-760-1-15": "13mm@sleeper6",
    "uic60-760-1-15-symmetric": "13mm@sleeper6",
}
STUDY = """\
schema_version = 1
name = "bits"
panel = "sb1"
seed = 11

[scheme]
mode = "quick"

[[variable]]
key = "object.x"
values = ["2.1 m", "3.95 m"]

[[variable]]
key = "object.size"
values = ["0 mm", "13 mm"]

[[variable]]
key = "drive.2.stiffness"
distribution = "uniform"
minimum = "700 kN/m"
maximum = "900 kN/m"

[[variable]]
key = "chair.friction_coefficient"
distribution = "uniform"
minimum = 0.2
maximum = 0.5

[sampling]
method = "random"
count = 3
"""


def turnout(*words: str) -> None:
    """Run the program, and stop if it fails."""
    command = [sys.executable, "-m", "turnout", *words]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(words)}: exit {done.returncode}\n{done.stderr}")


def digest_of_netcdf(path: Path) -> str:
    """Return a digest of the names, shapes, types and bytes of all variables of a file."""
    total = hashlib.sha256()
    with h5py.File(path) as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if hasattr(item, "dtype") else None)
        for name in sorted(names):
            values = np.asarray(file[name])
            total.update(f"{name} {values.shape} {values.dtype}".encode())
            objects = values.dtype.hasobject
            total.update(repr(values.tolist()).encode() if objects else values.tobytes())
    return total.hexdigest()[:16]


def digest_of_table(path: Path) -> str:
    """Return a digest of the rows of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        return hashlib.sha256(repr(list(csv.reader(file))).encode()).hexdigest()[:16]


def numbers_of(tree: Any) -> Any:
    """Return the numbers of a document by their keys; texts may name files and times."""
    if isinstance(tree, dict):
        kept = {key: numbers_of(value) for key, value in sorted(tree.items())}
        return {key: value for key, value in kept.items() if value not in (None, {}, [])}
    if isinstance(tree, list):
        return [numbers_of(value) for value in tree]
    return tree if isinstance(tree, int | float) else None


def simulations(folder: Path) -> Iterator[tuple[str, str]]:
    """Throw each library panel in each mode, with and without an object."""
    out = folder / "run.nc"
    for panel, thing in OBJECTS.items():
        for mode in MODES:
            for words in ((), ("--object", thing)):
                turnout("simulate", panel, "--mode", mode, *words, "--out", str(out))
                yield f"simulate {panel} {mode} {' '.join(words)}".strip(), digest_of_netcdf(out)
                out.unlink()


def sweep(folder: Path) -> Iterator[tuple[str, str]]:
    """Run a sweep with a grid and drawn states, and write it as a table."""
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    target = folder / "sweep"
    turnout("sweep", "run", str(folder / "study.toml"), "-o", str(target), "--workers", "1")
    turnout("sweep", "export", str(target), "--csv", str(folder / "sweep.csv"))
    yield "sweep table", digest_of_table(folder / "sweep.csv")
    batches = sorted(target.glob("batches/*.nc"))
    yield "sweep batches", " ".join(digest_of_netcdf(batch) for batch in batches)


def campaign(folder: Path) -> Iterator[tuple[str, str]]:
    """Make a virtual campaign, build it, and calibrate to it."""
    made = folder / "campaign"
    turnout(
        *("campaign", "virtual", "--out", str(made), "--panel", "sb2", "--seed", "5"),
        *("--place", "sleeper 6", "--place", "drive 1", "--place", "drive 2"),
        *("--size", "13 mm", "--repeats", "2", "--format", "csv", "--workers", "1"),
    )
    for path in sorted(made.glob("*.csv")):
        if path.name != "runs.csv":
            yield f"campaign {path.name}", digest_of_table(path)
    built = folder / "campaign.nc"
    turnout("campaign", "build", str(made), "--out", str(built))
    yield "campaign build", digest_of_netcdf(built)
    out = folder / "calibration.toml"
    turnout(
        *("calibrate", str(made), "--panel", "sb2", "--out", str(out)),
        *("--most", "4", "--workers", "1"),
    )
    numbers = numbers_of(tomllib.loads(out.read_text(encoding="utf-8")))
    yield "calibration", hashlib.sha256(repr(numbers).encode()).hexdigest()[:16]


def digests() -> dict[str, str]:
    """Return the digest of every result of the set."""
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        for part in (simulations, sweep, campaign):
            for what, digest in part(Path(name)):
                print(f"{digest[:35]}  {what}", flush=True)
                found[what] = digest
    return found


def main() -> None:
    """Write the digests, or compare with those written before."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("write", "compare"))
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args()
    found = digests()
    if arguments.command == "write":
        arguments.file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return
    before = json.loads(arguments.file.read_text(encoding="utf-8"))
    changed = [what for what in before if found.get(what) != before[what]]
    changed += [what for what in found if what not in before]
    print(f"{len(found)} digests, {len(changed)} changed: {', '.join(changed) or 'none'}")
    sys.exit(bool(changed))


if __name__ == "__main__":
    main()
