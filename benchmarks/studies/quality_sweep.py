"""Sweep the severity of every fault of a recorded throw, for docs/evidence.

    python -m benchmarks.studies.quality_sweep

Faults are put into virtual recordings on panel SB2: objects of 0, 13 and 26 mm at sleeper 6, three
frictions, noise, drift and mains hum of the virtual campaign. Chance begins at seeds that no test
of the detection uses.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from tests.unit.recorded import changed, noisy, samples, typical

from benchmarks.page import EVIDENCE
from turnout.measurement.campaign.find_throws import find_throws
from turnout.measurement.quality.channel_faults import Limits
from turnout.measurement.quality.throw_faults import Expected, ThrowQuality, judge_recording

PAGE = EVIDENCE / "measurement-quality.md"
RECORDINGS = "Recordings of other programs"
"""Section of the page that `benchmarks.studies.recordings` writes."""
FIRST_SEED, TRIALS, SOUND = 13_000, 24, 144
SIZES, FRICTIONS = (0.0, 0.013, 0.026), (0.38, 0.4, 0.42)
RATE = 1000.0

Fault = Callable[[xr.Dataset, np.random.Generator], xr.Dataset]


@dataclass(frozen=True)
class Level:
    """One severity of a fault; `clear` if every throw should be seen."""

    text: str
    apply: Fault
    clear: bool = True


@dataclass(frozen=True)
class Sweep:
    """A fault, its measure, and its severities from mild to gross."""

    kind: str
    limit: str
    levels: tuple[Level, ...]


def judged(dataset: xr.Dataset, *, direction: str = "closing") -> ThrowQuality | None:
    """Judge the first throw as a build does; None if there is none."""
    throws = find_throws(dataset)
    if not throws:
        return None
    expected = Expected(direction=direction, load_cell=True, rate=RATE, profile=typical("closing"))
    return judge_recording(dataset, throws[0], expected=expected)


def is_seen(verdict: ThrowQuality | None, kind: str) -> bool:
    """Return whether a throw is excluded for this kind of fault; without a throw, yes."""
    if verdict is None:
        return True
    return any(fault.kind == kind and fault.excludes for fault in verdict.faults)


def recorded(trial: int) -> xr.Dataset:
    """Return a sound recording; sizes and frictions change from trial to trial."""
    size = SIZES[trial % len(SIZES)]
    friction = FRICTIONS[(trial + trial // len(SIZES)) % len(FRICTIONS)]
    return noisy(FIRST_SEED + trial, size, friction=friction)


def clipped(share: float) -> Fault:
    """Clip a force at a share of its peak."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        values = samples(dataset, "drive_force 2")
        return changed(dataset, "drive_force 2", np.minimum(values, share * values.max()))

    return apply


def held(count: int, *, missing: bool = False) -> Fault:
    """Hold one value, or drop samples, of a force."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        channel = f"drive_force {rng.integers(1, 3)}"
        values, at = samples(dataset, channel), int(rng.integers(2200, 5200))
        values[at : at + count] = np.nan if missing else values[at]
        return changed(dataset, channel, values)

    return apply


def weak(gain: float) -> Fault:
    """Scale a force."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        channel = f"drive_force {rng.integers(1, 3)}"
        return changed(dataset, channel, gain * samples(dataset, channel))

    return apply


def exchanged(*names: str) -> Fault:
    """Exchange channels of the two drives."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        return dataset.assign(
            {name: (dataset[name].dims, dataset[name].values[::-1]) for name in names}
        )

    return apply


def reversed_(channel: str) -> Fault:
    """Reverse the sign of a channel."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        return changed(dataset, channel, -samples(dataset, channel))

    return apply


def paced(factor: float) -> Fault:
    """Let a throw run at another pace, as if the rate were stated wrongly."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        time = dataset["time"].values
        kept = time[time * factor <= time[-1]]
        return dataset.interp(time=kept * factor).assign_coords(time=kept)

    return apply


def stated(rate: float) -> Fault:
    """State another rate than the one recorded at [Hz]."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        return dataset.assign_coords(time=dataset["time"] * RATE / rate)

    return apply


def humming(amplitude: float) -> Fault:
    """Add hum of a railway's supply, which means over 20 ms leave [N]."""

    def apply(dataset: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        time, phase = dataset["time"].values, rng.uniform(0.0, 2.0 * np.pi)
        hum = amplitude * np.sin(2.0 * np.pi * 50.0 / 3.0 * time + phase)
        return changed(dataset, "drive_force 1", samples(dataset, "drive_force 1") + hum)

    return apply


def from_(start: float) -> Fault:
    """Cut off the beginning [s]."""
    return lambda dataset, rng: dataset.sel(time=slice(start, None))


def until(end: float) -> Fault:
    """Cut off the end [s]."""
    return lambda dataset, rng: dataset.sel(time=slice(None, end))


def sweeps() -> tuple[Sweep, ...]:
    """Return every fault with its severities."""
    limits = Limits()
    hum = limits.channels["drive_force"].hum
    least = limits.channels["drive_force"].response
    return (
        Sweep(
            "clipping",
            "samples at the edge of the range",
            tuple(
                Level(f"at {100 * s:g} % of the peak", clipped(s), clear=s < 0.998)
                for s in (0.999, 0.998, 0.99, 0.95, 0.8)
            ),
        ),
        Sweep(
            "drop-out",
            "equal samples that noise would not give",
            tuple(Level(f"held for {n} ms", held(n), clear=n >= 20) for n in (3, 6, 10, 20, 50)),
        ),
        Sweep(
            "missing samples",
            f"{1e3 * limits.longest_hole:g} ms in a row",
            tuple(
                Level(f"{n} ms", held(n, missing=True), clear=n > 10) for n in (2, 5, 10, 20, 50)
            ),
        ),
        Sweep(
            "dead channel",
            f"response below {least:g} N",
            tuple(
                Level(f"{100 * g:g} % of the signal left", weak(g), clear=g < 0.005)
                for g in (0.1, 0.03, 0.01, 0.001, 0.0)
            ),
        ),
        Sweep(
            "swapped channels",
            f"{limits.swap_gain:g} times better fit when swapped",
            (
                Level("rods", exchanged("drive_force")),
                Level("clamps", exchanged("drive_current")),
                Level("rods and clamps", exchanged("drive_force", "drive_current")),
            ),
        ),
        Sweep(
            "reversed polarity",
            f"{limits.polarity_force:g} N the other way",
            tuple(
                Level(c, reversed_(c))
                for c in ("drive_force 1", "drive_force 2", "drive_current 1")
            ),
        ),
        Sweep(
            "sampling rate",
            f"pace off by {100 * limits.pace_share:g} %",
            (
                *(
                    Level(f"pace times {f:g}", paced(f), clear=abs(np.log(f)) > 0.15)
                    for f in (1.03, 1.06, 1.1, 1.2, 2.0, 0.9, 0.8, 0.5)
                ),
                Level("990 Hz stated", stated(990.0)),
            ),
        ),
        Sweep(
            "mains hum",
            f"amplitude above {hum:g} N",
            tuple(
                Level(f"{a:g} N", humming(a), clear=a > 1.3 * hum)
                for a in (20.0, 40.0, 60.0, 80.0, 120.0)
            ),
        ),
        Sweep(
            "truncated",
            f"{limits.least_rest:g} s of rest on either side",
            (
                Level("starts 0.3 s before the onset", from_(1.7), clear=False),
                Level("starts 0.1 s before the onset", from_(1.9)),
                Level("starts 0.2 s after the onset", from_(2.2)),
                Level("starts 1 s after the onset", from_(3.0)),
                Level("ends 0.3 s after the throw", until(5.71), clear=False),
                Level("ends 0.1 s after the throw", until(5.5)),
                Level("ends 0.2 s before its end", until(5.2)),
                Level("ends 1.5 s before its end", until(3.9)),
            ),
        ),
    )


def rate_seen(level: Level, kind: str, *, trials: int, first: int = 0) -> float:
    """Return the share of throws in which a fault is seen."""
    seen = 0
    for trial in range(first, first + trials):
        rng = np.random.default_rng(FIRST_SEED + 100_000 + trial)
        seen += is_seen(judged(level.apply(recorded(trial), rng)), kind)
    return seen / trials


def false_alarms(*, trials: int, first: int = 0) -> list[str]:
    """Return every reason for which a sound throw is excluded."""
    reasons: list[str] = []
    for trial in range(first, first + trials):
        verdict = judged(recorded(trial))
        reasons += ["no throw found"] if verdict is None else list(verdict.reasons)
    return reasons


HEAD = """# Quality of recorded throws

A throw is excluded, with its reason, when a channel is clipped, held, missing or dead, when
channels have changed places or sign, when it goes the other way than its sheet says, when samples
came at another rate than stated, when mains hum is strong that means over 20 ms leave, or when its
start or end was not recorded. Limits are fields of
`turnout.measurement.quality.channel_faults.Limits`; a fault below its limit is meant to pass.

Two things are taken from the rest of the campaign, so at least three sound movements in each
direction are needed for them: the pace of a throw, and which channel is whose. Both use the
first 1.5 s, in which no object has a say. Clipping and drop-outs are recognised by noise; a channel
without any cannot be judged. A silent load cell is only remarked upon: an object need not be
reached.

Spikes of one or two samples (above 500 N or 2 A, from 500 Hz on) and a zero that drifts by more
than 200 N, alike before and after the motion, exclude a throw too; both are looked past when its
start and end are found. Only remarked upon are a zero offset (a rod that carries 750 N more or
less with the rail open than in the rest of the campaign, a current above 0.15 A or a load cell
above 200 N at rest) and steps of a converter above 50 N or 0.05 A.

Not seen: a wrong gain; an offset of a rod that the whole campaign has, as rods may carry
kilonewtons at rest; two faults of one channel that hide each other; one direction turned in the
sheet as well as both rods reversed.

`python -m benchmarks.studies.quality_sweep` writes the tables below on virtual recordings of panel
SB2 (0, 13 and 26 mm at sleeper 6, friction 0.38 to 0.42, with the noise, drift and hum of the
virtual campaign) from seeds that no test of the detection uses.
"""


def page(found: Sequence[tuple[Sweep, list[float]]], alarms: list[str]) -> str:
    """Return the page."""
    text = f"""{HEAD}
## False alarms

{len(alarms)} in {SOUND} sound throws{": " + "; ".join(sorted(set(alarms))) if alarms else ""}.

## Misses by severity

{TRIALS} throws each. Lines in brackets lie at or within the limit, where a miss is meant or a
matter of chance.

| fault | decided by | severity | seen | missed |
|---|---|---|---|---|
"""
    for sweep, rates in found:
        for number, (level, rate) in enumerate(zip(sweep.levels, rates, strict=True)):
            name = sweep.kind if number == 0 else ""
            limit = sweep.limit if number == 0 else ""
            severity = level.text if level.clear else f"({level.text})"
            text += f"| {name} | {limit} | {severity} | {rate:.0%} | {1 - rate:.0%} |\n"
    return text


def main() -> None:
    """Sweep all and write the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = [
        (sweep, [rate_seen(level, sweep.kind, trials=TRIALS) for level in sweep.levels])
        for sweep in sweeps()
    ]
    _, *others = PAGE.read_text(encoding="utf-8").partition(f"\n## {RECORDINGS}\n")
    text = page(found, false_alarms(trials=SOUND, first=TRIALS))
    PAGE.write_text(text + "".join(others), encoding="utf-8")


if __name__ == "__main__":
    main()
