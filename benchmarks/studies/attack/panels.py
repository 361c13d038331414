"""Panels that no one should throw: extreme, senseless and damaged ones, given to the program.

Panels of the library and small ones written from nothing are changed as text: values by many powers
of ten, of the wrong sign, zero or no number; lines swapped, sections left out or doubled; bits
flipped and parts cut out. The program reads each in a process of its own with limits of time and
memory. It must end with a complete run, in which no channel lacks a number and the energy balance
closes, with one message and exit code 2, or with the partial response and exit code 3.
"""

import random
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tests.verification.robustness_checks import BOOKS, MAY_LACK, OF_STOCK_RAIL
from tests.verification.robustness_panels import small_panel

from benchmarks.studies.attack.forked import Ended, run_limited
from benchmarks.studies.attack.requests import NUMBERS, ODD, UNITS
from turnout.cli.main import main
from turnout.cli.simulate import preload
from turnout.core.scheme import Scheme
from turnout.panel.load import library_text, load_panel
from turnout.panel.model import PANEL_KEYS
from turnout.panel.unusual import USUAL
from turnout.solver.outcome import LEAST_SCALE
from turnout.throw.simulate import compile_kernels, simulate
from turnout.throw.store import open_response, response_bytes

MOST_SECONDS, MOST_MEMORY, LONGEST_MESSAGE = 60.0, 2_000_000_000, 60_000
"""Of the processor [s]; of what a process may write to [bytes]; of a message [characters]."""
COMPLETE, BAD_INPUT, INCOMPLETE = 0, 2, 3
OUTCOMES = {COMPLETE: "answered", BAD_INPUT: "refused", INCOMPLETE: "stopped"}
NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])")
PLACES = ("sleeper 6", "drive 1", "drive 2", "x = 3.6 m", "x = 0.01 m", "x = -2 m", "x = 11 m", "")

Record = dict[str, Any]


class Chosen:
    """Choices for a small panel."""

    def __init__(self, source: random.Random) -> None:
        self._source = source

    def integer(self, low: int, high: int) -> int:
        """Return an integer, both bounds included."""
        return self._source.randint(low, high)

    def number(self, low: float, high: float) -> float:
        """Return a number between the bounds."""
        return self._source.uniform(low, high)


@contextmanager
def attacking(seed: int) -> Iterator[Callable[[int], Record]]:
    """Provide a function that throws a panel by its number, with the program loaded before."""
    compile_kernels()
    simulate(load_panel("sb1"), scheme=Scheme.of("quick"))
    preload(plots=False)
    response_bytes(xr.Dataset({"number": ("place", [0.0])}))
    with tempfile.TemporaryDirectory(prefix="attack on panels ") as folder:

        def attempt(index: int) -> Record:
            source = random.Random(f"{seed}-{index}")
            kind = source.choice(list(_KINDS))
            content, more = _KINDS[kind](source)
            with tempfile.TemporaryDirectory(dir=folder) as place:
                found = _judged(Path(place), content, more, source)
            return {"index": index, "kind": kind, **found}

        yield attempt


def _judged(folder: Path, content: bytes, more: list[str], source: random.Random) -> Record:
    panel, out = folder / "panel.toml", folder / "throw.nc"
    panel.write_bytes(content)
    words = ["simulate", str(panel), "--out", str(out), *more]
    if source.random() < 0.85:
        words += ["--mode", source.choice(("quick", "quick", "quick", "waveform", "quasi-static"))]
    else:
        words = ["panel", source.choice(("check", "show")), str(panel)]
        words += more[2:] if more[:1] == ["--object"] else more
    ended = run_limited(partial(_program, words), seconds=MOST_SECONDS, memory=MOST_MEMORY)
    fault = _fault(ended, out if words[0] == "simulate" else None)
    left = sorted(path.name for path in folder.iterdir() if path not in (panel, out))
    if left and not fault:
        fault = f"left {left}"
    record: Record = {
        "outcome": "fault" if fault else OUTCOMES[ended.code],
        "seconds": round(ended.seconds, 3),
        "memory": round(ended.memory),
    }
    return record | ({"text": f"{words[:2]} {words[3:]}: {fault}"[:6000]} if fault else {})


def _program(words: list[str]) -> None:
    sys.argv = ["turnout", *words]
    main()


def _fault(ended: Ended, out: Path | None) -> str:
    """Return the fault in how the program ended; empty for none."""
    if ended.late:
        return f"takes longer than {MOST_SECONDS:g} s"
    said = ended.out + ended.err
    if "Traceback" in said or ended.code not in OUTCOMES:
        return f"code {ended.code}: {said[-2500:]}"
    if "Warning:" in said:
        return f"a warning of a library: {said[-2500:]}"
    reported = [line for line in ended.err.splitlines() if line.startswith("turnout: ")]
    if len(ended.err) > LONGEST_MESSAGE:
        return f"a message of {len(ended.err)} characters"
    if ended.code == BAD_INPUT:
        if len(reported) != 1:
            return f"refused with {len(reported)} messages: {said[-1000:]}"
        return "refused, and wrote a file" if out is not None and out.exists() else ""
    if out is None:
        return ""
    if not out.exists():
        return f"ended with {ended.code} and wrote nothing: {said[-1000:]}"
    return _fault_of_run(out, complete=ended.code == COMPLETE)


def _fault_of_run(path: Path, *, complete: bool) -> str:
    """Return the fault of the dataset of a run; empty for none."""
    run = open_response(path)
    if bool(run.attrs["complete"]) != complete:
        return f"complete = {run.attrs['complete']} does not go with the exit code"
    if not complete:
        return ""
    for name, variable in run.data_vars.items():
        values = variable.to_numpy()
        if values.dtype.kind != "f" or name in MAY_LACK:
            continue
        if np.isinf(values).any():
            return f"complete, and {name} is infinite"
        if np.isnan(values).any() and name not in OF_STOCK_RAIL:
            return f"complete, and {name} has NaN"
    scale = max(float(run.attrs["energy_scale"]), LEAST_SCALE)
    share = float(abs(run["energy_residual"]).max()) / scale
    return f"complete, and the balance is open by {share:.1e}" if share > BOOKS else ""


def _text(source: random.Random) -> str:
    """Return the text of a sound panel; mostly of short runs."""
    name = source.choice(("small", "small", "sb1", "sb1", "sb2", "uic60-760-1-15"))
    return small_panel(Chosen(source)) if name == "small" else library_text(name)


def _object(source: random.Random) -> list[str]:
    if source.random() < 0.5:
        return []
    size = source.choice(("5 mm", "13 mm", "0.1 mm", f"{10 ** source.uniform(-9, 3):.3g} mm"))
    return ["--object", f"{size} @ {source.choice(PLACES)}"]


def _extreme(source: random.Random) -> tuple[bytes, list[str]]:
    """Change some numbers of the text by powers of ten, or their sign."""
    share = source.choice((0.003, 0.01, 0.05))

    def changed(found: re.Match[str]) -> str:
        if source.random() > share:
            return found[0]
        way = source.randrange(6)
        if way == 0:
            return "0"
        if way == 1:
            return found[0].lstrip("-") if found[0].startswith("-") else f"-{found[0]}"
        reach = 2 if way < 4 else 12
        return f"{float(found[0]) * 10 ** source.uniform(-reach, reach):.4g}"

    return NUMBER.sub(changed, _text(source)).encode(), _object(source)


def _settings(source: random.Random) -> tuple[bytes, list[str]]:
    """Set keys far beyond their usual range."""
    more = _object(source)
    for _ in range(source.choice((1, 2, 4))):
        key = source.choice(list(USUAL))
        least, most = USUAL[key]
        edge = source.choice((least, most, most, 1.0))
        value = edge * 10 ** source.uniform(-3, source.choice((1, 3, 9)))
        found = PANEL_KEYS.find(key)
        unit = found.unit if found else ""
        value = source.choice((value, value, value, value, -value, 0.0))
        more += ["--set", f"{key}={value:.4g} {unit}".rstrip()]
    text = library_text(source.choice(("sb1", "sb1", "sb2", "uic60-760-1-15")))
    return text.encode(), more


def _senseless(source: random.Random) -> tuple[bytes, list[str]]:
    """Swap values, leave out and double sections, put anything in the place of a value."""
    lines = _text(source).splitlines()
    for _ in range(source.choice((1, 2, 6))):
        keys = [at for at, line in enumerate(lines) if "=" in line]
        heads = [at for at, line in enumerate(lines) if line.startswith("[")]
        if not keys or not heads:
            break
        one, other, head = source.choice(keys), source.choice(keys), source.choice(heads)
        key, value = lines[one].split("=", 1)
        end = next((at for at in heads if at > head), len(lines))
        way = source.randrange(6)
        if way == 0:
            lines[one] = f"{key}={lines[other].split('=', 1)[1]}"
        elif way == 1:
            del lines[head:end]
        elif way == 2:
            lines += [lines[head].replace("]", f"{source.choice('ab19')}]"), *lines[head + 1 : end]]
        elif way == 3:
            shown = source.choice((*NUMBERS, *ODD, "closed", "open", "+y", "no slip"))
            text = f'"{shown} {source.choice((*UNITS, ""))}"'.encode("utf-8", "replace").decode()
            lines[one] = f"{key}= {text}"
        elif way == 4:
            lines[one] = f"{key}= [{value.split('#')[0]}, {value.split('#')[0]}]"
        else:
            del lines[one]
    return "\n".join(lines).encode("utf-8", "replace"), _object(source)


def _damaged(source: random.Random) -> tuple[bytes, list[str]]:
    """Flip bits, cut parts out, nest and lengthen."""
    content = bytearray(_text(source).encode())
    way = source.randrange(5)
    if way < 2:
        for _ in range(source.choice((1, 3, 30))):
            content[source.randrange(len(content))] ^= 1 << source.randrange(8)
    elif way == 2:
        at = source.randrange(len(content))
        del content[at : at + source.choice((1, 10, 1000, len(content)))]
    elif way == 3:
        at = source.randrange(len(content))
        content[at:at] = source.choice((bytes(9), b"\xff\xfe", b"\r\n" * 9, source.randbytes(30)))
    else:
        depth = source.choice((10, 3000, 100_000))
        content += source.choice((b"\nz = " + b"[" * depth, b"\n" + b"a." * depth + b"b = 1"))
    return bytes(content), []


def _sound(source: random.Random) -> tuple[bytes, list[str]]:
    """Write a small panel of its own, stiff or soft by decades, with any object."""
    return small_panel(Chosen(source)).encode(), _object(source)


_KINDS: dict[str, Callable[[random.Random], tuple[bytes, list[str]]]] = {
    "extreme": _extreme,
    "settings": _settings,
    "senseless": _senseless,
    "damaged": _damaged,
    "small, any stiffness": _sound,
}
