"""Compare a throw with its dataset, with a friction curve, and with another checkout.

    python -m benchmarks.dataset_ratio [--older FOLDER] [--count 9] [--rounds 3]
    python -m benchmarks.dataset_ratio --older FOLDER --instructions

Printed are medians and least values of runs in a row, in milliseconds of the process, and ratios of
the least to those of a plain solution, with a 13 mm object on the default panel; a dataset is a
throw as `simulate` returns it, its solution included. The curve is that of sound chairs
(`chair.friction_state`); its dataset is compared with a plain one. With `--older` the sources of
another checkout run in turns with these, each in processes of its own, and the ratio to it is of
the same without a curve: the mean over the rounds of the ratio of the least times, with its 95 %
interval.
"""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from turnout.core.errors import PanelError
from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate, solve

HERE = Path(__file__).parents[1]
MODES = ("quick", "waveform")
Times = dict[str, list[float]]


def measured(count: int) -> Times:
    """Return the milliseconds of solutions and of datasets, each after one that does not count."""
    panel, foreign = load_panel("uic60-760-1-15"), ForeignObject(0.013, "sleeper 6")
    found, curved = defaultdict[str, list[float]](list), None
    with suppress(PanelError):  # an older checkout knows no curves
        curved = panel.with_overrides({"chair.friction_state": "sound"})
    for mode in MODES:
        scheme = Scheme.of(mode)
        parts: dict[str, Callable[[], object]] = {
            "solution": partial(solve, panel, foreign_object=foreign, scheme=scheme),
            "dataset": partial(simulate, panel, foreign_object=foreign, scheme=scheme),
        }
        if curved is not None:
            parts["curve solution"] = partial(solve, curved, foreign_object=foreign, scheme=scheme)
            parts["curve dataset"] = partial(
                simulate, curved, foreign_object=foreign, scheme=scheme
            )
        for name, part in parts.items():
            part()
            for _ in range(count):
                begun = time.process_time()
                part()
                found[f"{mode} {name}"].append(1e3 * (time.process_time() - begun))
    return found


def environment_for(checkout: Path) -> dict[str, str]:
    """Return the environment of a process that runs the sources of a checkout."""
    return {**os.environ, "PYTHONPATH": f"{checkout / 'src'}{os.pathsep}{HERE}"}


def measured_in(checkout: Path, count: int) -> Times:
    """Return what another process measures with the sources of a checkout."""
    command = [sys.executable, __file__, "--print-times", "--count", str(count)]
    environment = environment_for(checkout)
    done = subprocess.run(command, check=True, env=environment, stdout=subprocess.PIPE, text=True)
    found: Times = json.loads(done.stdout)
    return found


def run_counted(count: int) -> None:
    """Solve and simulate throws, and let callgrind write what each kind took."""
    from turnout.kernels import compiled, machine_code

    # The processor that Valgrind shows is another one, whose kernels would be compiled anew.
    for module in (machine_code, compiled):
        module.machine_digest = lambda: "counted"  # type: ignore[attr-defined]
    panel, foreign = load_panel("uic60-760-1-15"), ForeignObject(0.013, "sleeper 6")
    for mode in MODES:
        scheme = Scheme.of(mode)
        for name, part in (("solution", solve), ("dataset", simulate)):
            for repeats in (3, count):
                if count > 0:
                    control = ["callgrind_control", "--zero", str(os.getpid())]
                    subprocess.run(control, check=True, stdout=subprocess.DEVNULL)
                for _ in range(repeats):
                    part(panel, foreign_object=foreign, scheme=scheme)
            if count > 0:
                control = ["callgrind_control", f"--dump={mode} {name}", str(os.getpid())]
                subprocess.run(control, check=True, stdout=subprocess.DEVNULL)


def instructions_in(checkout: Path, folder: Path, count: int) -> dict[str, float]:
    """Return the millions of instructions of each kind of throw with the sources of a checkout."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    for name in features:
        features[name] &= not re.match("avx512|avx10|amx|evex", name)
    environment = environment_for(checkout) | {
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": features.flatten(),
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONHASHSEED": "0",
    }
    written = folder / "callgrind"
    valgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={written}"]
    quiet = {"env": environment, "check": True, "stdout": subprocess.DEVNULL}
    child = [sys.executable, __file__, "--run-counted"]
    subprocess.run([*child, "--count", "0"], **quiet)  # type: ignore[call-overload]
    subprocess.run(  # type: ignore[call-overload]
        [*valgrind, *child, "--count", str(count)], stderr=subprocess.DEVNULL, **quiet
    )
    found = {}
    for file in folder.glob("callgrind.*"):
        held = DUMPED.search(file.read_text())
        assert held is not None
        found[held[1]] = float(held[2]) / count / 1e6
    return found


DUMPED = re.compile(r"^desc: Trigger: dump (.*?)$.*?^summary: (\d+)$", re.MULTILINE | re.DOTALL)
"""Name and instructions in a file of callgrind."""


def print_instructions(checkouts: dict[str, Path], count: int) -> None:
    """Count and print."""
    found = {}
    for name, checkout in checkouts.items():
        with tempfile.TemporaryDirectory() as folder:
            found[name] = instructions_in(checkout, Path(folder), count)
    for what in sorted(found["this"], reverse=True):
        line = f"{what:<24}" + "".join(
            f"{name} {held[what]:8.2f} M  " for name, held in found.items()
        )
        if "older" in found:
            line += f"ratio {found['this'][what] / found['older'][what]:.4f}"
        print(line)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, help="another checkout")
    parser.add_argument("--count", type=int, default=9, help="runs of each in a process")
    parser.add_argument("--rounds", type=int, default=3, help="processes of each checkout")
    parser.add_argument("--instructions", action="store_true", help="count them, by Valgrind")
    parser.add_argument("--print-times", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--run-counted", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.run_counted:
        run_counted(given.count)
        return
    if given.print_times:
        print(json.dumps(measured(given.count)))
        return
    checkouts = {"this": HERE} | ({} if given.older is None else {"older": given.older.resolve()})
    if given.instructions:
        print_instructions(checkouts, given.count)
        return
    found: dict[str, Times] = {name: defaultdict(list) for name in checkouts}
    least: dict[str, Times] = {name: defaultdict(list) for name in checkouts}
    for number in range(given.rounds):
        for name in list(checkouts)[:: 1 if number % 2 else -1]:
            for what, times in measured_in(checkouts[name], given.count).items():
                found[name][what] += times
                least[name][what].append(min(times))
    for name, by_part in found.items():
        for what, times in by_part.items():
            mode, kind = what.split()[0], what.split()[-1]
            plain = f"{mode} {kind if 'curve' in what else 'solution'}"
            line = f"{name:<6}{what:<24}{statistics.median(times):7.2f} ms, least {min(times):6.2f}"
            line += f", {min(times) / min(by_part[plain]):.3f} of the plain {plain.split()[-1]}"
            if "older" in found and name == "this":
                pairs = zip(least["this"][what], least["older"][f"{mode} {kind}"], strict=True)
                ratios = [own / other for own, other in pairs]
                error = 1.96 * statistics.stdev(ratios) / len(ratios) ** 0.5
                line += f", {statistics.mean(ratios):.3f} +- {error:.3f} of the older plain {kind}"
            print(line)


if __name__ == "__main__":
    main()
