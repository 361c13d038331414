"""Text tables of any separator, decimal mark, heading and clock: the right samples and times."""

import random
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.unit.recording_kinds import BEGIN, COUNT, CURRENT, FORCE

from turnout.measurement.formats.file_format import read_recording

# Unit of times: how many are a second, and digits that are written.
UNITS = {"s": (1.0, 6), "ms": (1e3, 3), "us": (1e6, 0), "min": (1 / 60, 9), "h": (1 / 3600, 11)}
STAMPS = ("%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%dT%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S,%f", "%H:%M:%S,%f")
UNIX = 1_795_853_640
CLOCKS = (*UNITS, "stamp", "unix", "unix ms", "days", "rate", "interval", "index")
FACTS = (
    (),
    ("Site: W12",),
    ("Operator: X", "Date: 28.11.2026"),
    ("",),
    ("Mains frequency: 50 Hz",),
)
HEADINGS: dict[str, Callable[[str], str]] = {
    "round": " ({})".format,
    "square": " [{}]".format,
    "quotient": " / {}".format,
    "row": "".format,
}


def written(chance: random.Random, clock: str, step: float, start: float) -> str:
    """Return samples at even times as a table, whatever its layout; units are always stated."""
    decimal, separator = chance.choice([".;", ".,", ".\t", ".|", ",;", ",\t", ",|"])
    heading, quote = chance.choice(list(HEADINGS)), chance.choice(["", "", '"'])
    # A comma before the digits of the second would part columns as well.
    stamp = chance.choice([text for text in STAMPS if separator not in text])

    def number(value: float, digits: int = 3) -> str:
        return f"{value:.{digits}f}".replace(".", decimal)

    def time(place: int) -> list[str]:
        passed = place * step
        if clock in UNITS:
            factor, digits = UNITS[clock]
            return [number((start + passed) * factor, digits)]
        texts = {
            "stamp": (BEGIN + timedelta(seconds=passed)).strftime(stamp),
            "unix": number(UNIX + passed, 6),
            "unix ms": number(1e3 * (UNIX + passed), 3),
            "days": number((BEGIN - datetime(1899, 12, 30)).days + (29640 + passed) / 86400, 10),
            "index": f"{place + 1}",
        }
        return [texts[clock]] if clock in texts else []

    stated = {
        "rate": (f"Sample rate: {number(1 / step, 6)} Hz", f"Fs = {number(1e-3 / step, 9)} kHz"),
        "interval": (f"Abtastintervall: {number(1e3 * step, 6)} ms", f"dt = {number(step, 9)}"),
    }
    stated["index"] = stated["rate"]
    facts = [*chance.choice(FACTS), *([chance.choice(stated[clock])] if clock in stated else [])]
    named = [("Sample" if clock == "index" else "Time", clock if clock in UNITS else "")]
    columns = [*(named if time(0) else []), ("Force", "kN"), ("Current", "A")]
    rows = [[f"{name}{HEADINGS[heading](unit) if unit else ''}" for name, unit in columns]]
    rows += [[unit for _, unit in columns]] if heading == "row" else []
    rows += [[*time(n), number(FORCE[n]), number(CURRENT[n])] for n in range(COUNT)]
    lines = [separator.join(f"{quote}{cell}{quote}" for cell in row) for row in rows]
    return "\n".join([*facts, *lines, ""])


@pytest.mark.parametrize("clock", CLOCKS)
def test_samples_at_their_times_whatever_the_layout(tmp_path: Path, clock: str) -> None:
    chance, path = random.Random(clock), tmp_path / "throw.csv"
    for _ in range(40):
        step, start = chance.choice([0.04, 0.02, 0.05, 0.001, 1 / 30]), chance.choice([0.0, -1.0])
        text = written(chance, clock, step, start)
        path.write_text(text, encoding="utf-8", newline=chance.choice(["\n", "\r\n"]))
        recording = read_recording(path)
        assert list(recording.channels) == ["Force", "Current"], text[:400]
        samples = {"kN": FORCE, "A": CURRENT}
        for channel in recording.channels.values():
            assert channel.rate == pytest.approx(1 / step, rel=1e-3), text[:400]
            assert channel.start == pytest.approx(start * (clock in UNITS), abs=2e-3), text[:400]
            np.testing.assert_allclose(channel.values, samples[channel.unit], rtol=1e-9)
