"""A year of a switch, and ice that grows, as the public detector sees them: DIR, a detector's file.

    python -m benchmarks.studies.detector_over_time DIR --detector switch.detector

Each switch is learned from its first 20 throws, and every further one is judged as a user would
have it judged: statuses, causes and called gaps count, not ratios alone.

In the year friction rises for six weeks after each greasing, temperatures are those of the month,
clutches lose 8 % and over-travels 0.2 mm until December; every month's throws that are called sound
are learned at its end. They are judged by their features (`Detector.judge_features`,
`learn_features`), and the alarm alone of each several times more with other errors.

Ice grows by 0.2 mm a throw. Its throws are recordings whose onsets the detector finds again
(`Detector.predict`, `learn`), with a discrepancy of 5 % on the samples, half of it the same in all
throws of a switch, noise, gains and zeros of sensors; what is called sound is learned after every
fifth throw, so that it could be learned away. What was thrown or judged is kept in DIR; without a
detector the throws are made.
"""

import argparse
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.studies.detector_figures import drawn_errors, false_alarm_limits, of_each_switch
from benchmarks.studies.detector_page import alarms
from benchmarks.studies.detector_sets import (
    A_MONTH,
    ICE_PLACES,
    KNOWN,
    YEAR_SWITCHES,
    Arrays,
    Throws,
    ice_plan,
    year_plan,
)
from turnout.core.files import write_atomic
from turnout.detection.detector.calibrating import alarms_of
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.knowledge import Setting
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import CANNOT, OBJECTS, SOUND, Verdict
from turnout.detection.detector.training import layout_of_panel
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import reference_study

Floats = NDArray[np.float64]

SEED = 720_000
"""Of switches with ice that no choice in the detector was made on."""
MONTH_THROWS = 5000
"""Uses of the throws of a month, with other errors, at least."""
ICE_SWITCHES, AT_ONCE = 10, 5
"""Switches with ice, and throws after which what is sound is learned."""
MONTHS = 12
MOST = 2e-3
"""Share of alarms that is allowed in a month [-]."""


def main() -> None:
    """Throw, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws and verdicts")
    parser.add_argument("--detector", type=Path, help="file of `turnout detect train`")
    parser.add_argument("--switches", type=int, default=YEAR_SWITCHES, help="of the year")
    given = parser.parse_args()
    study = reference_study()
    ice_switches = ice_plan(study, switches=ICE_SWITCHES, seed=SEED)
    plans = {"cases": {"year": year_plan(study)}, "time": {"ice": ice_switches}}
    throws = Throws(plans, given.folder, layout_of_panel(study.panel))
    year, gaps = throws.sets("cases")["year"], throws.sets("time")["ice"]
    ice = throws.forces("time", "ice")
    assert np.array_equal(gaps.row, ice["row"]), "the same throws ended"
    ice["gaps"] = gaps.gaps
    if given.detector is None:
        return
    made = hashlib.sha256(given.detector.read_bytes()).hexdigest()[:8]
    detector = Detector.load(given.detector)
    said: dict[str, Any] = {"ice": ice_figures(detector, ice, given.folder / f"ice-{made}")}
    print("\n".join(ice_table(said["ice"])), flush=True)
    place = given.folder / f"year-{made}-{given.switches}"
    said["year"] = year_figures(detector, year, place, switches=given.switches)
    write_atomic(given.folder / f"over-time-{made}.json", json.dumps(said, indent=1).encode())
    print("\n".join(year_table(said["year"])))


# ---- recordings


class Recorder:
    """Records throws of one switch with errors as large as a detector assumes.

    Parameters
    ----------
    setting : Setting
        Of the detector: amplitudes and allowances.
    time : ndarray, shape (n_times,)
        Of the samples, equally spaced [s].
    rng : Generator
        Of chance.
    """

    def __init__(self, setting: Setting, time: Floats, rng: np.random.Generator) -> None:
        self._allowances, self._time, self._rng = setting.allowances, time, rng
        self._drives = setting.layout.drives
        self._onsets = {part.name: part.start for part in setting.layout.parts}
        own = self._allowances
        self._scale = own.discrepancy * np.asarray(setting.amplitude)[:, np.newaxis]
        self._fixed = np.sqrt(own.fixed_share) * self._scale * self._wandering()
        self._gain = 1.0 + own.gain * rng.standard_normal((len(self._drives), 1))

    def _wandering(self) -> Floats:
        """Return unit processes with the kernel exp(-|t| / time), shape (n_drives, n_times)."""
        step = float(self._time[1] - self._time[0])
        keep = float(np.exp(-step / self._allowances.conditions.correlation_time))
        drawn = self._rng.standard_normal((len(self._drives), self._time.size))
        drawn[:, 0] /= np.sqrt(1.0 - keep**2)
        return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], drawn, axis=1))

    def record(self, force: Floats, *, exact: bool) -> Recorded:
        """Return a recording of forces, shape (n_drives, n_times) [N].

        Onsets that are exact deviate as is assumed; others are found again by the detector.
        """
        own, rng = self._allowances, self._rng
        changing = np.sqrt(1.0 - own.fixed_share) * self._scale * self._wandering()
        noise = own.noise * rng.standard_normal(force.shape)
        zero = own.zero * rng.standard_normal((len(force), 1))
        late = (own.timing if exact else ONSET_ERROR) * rng.standard_normal(len(self._onsets))
        return Recorded(
            name="throw",
            time=self._time,
            force=self._gain * force + self._fixed + changing + noise + zero,
            drives=self._drives,
            onsets={
                name: start + float(shift)
                for (name, start), shift in zip(self._onsets.items(), late, strict=True)
            },
            exact=exact,
        )


ONSET_ERROR = 8e-3
"""Deviation of onsets that the detector finds again [s]."""


def said_of(verdict: Verdict) -> list[Any]:
    """Return status with its cause, log ratio, and whether a gap is called above its limit."""
    name = f"{verdict.status}: {verdict.cause}" if verdict.cause else verdict.status
    ratio = None if verdict.status in (CANNOT, OBJECTS) else verdict.log_ratio
    return [name, ratio, any(gap.called for gap in verdict.gaps)]


# ---- a year


def year_figures(
    detector: Detector, year: ThrowSet, folder: Path, *, switches: int
) -> list[dict[str, Any]]:
    """Return false alarms and statuses of each month, and of the first throws before any."""
    knowledge = detector.knowledge
    uses = int(np.ceil(MONTH_THROWS / (switches * A_MONTH)))

    def of_switch(number: int) -> dict[str, list[Any]]:
        errors = drawn_errors(knowledge, SEED, number)
        fixed, own = errors.of_switches(1), Detector(knowledge)

        def measured(throws: ThrowSet) -> Floats:
            return np.asarray(throws.features + fixed + errors.of_throws(throws.rates))

        def judged(throws: ThrowSet, again: int) -> list[list[Any]]:
            rows = measured(throws)
            verdicts = [own.judge_features(row) for row in rows]
            more = np.concatenate([measured(throws) for _ in range(again)])
            further.append(alarms_of(own.view(), more).tolist())
            sound = np.array([item.status == SOUND for item in verdicts])
            if sound.any():
                own.learn_features(rows[sound])
            return [said_of(item) for item in verdicts]

        further: list[list[float]] = []
        found = {"first": judged(year.of(year.switch == -1 - number), 1)}
        for month in range(MONTHS):
            throws = year.of(year.switch == MONTHS * number + month)
            found[str(month)] = judged(throws, uses - 1)
        return found | {"further": further}

    said = of_each_switch(np.arange(switches), folder, of_switch)
    return [
        _alarms(
            [item[name] for item in said],
            further=[item["further"][number] for item in said],
            uses=uses if number else 2,
            thresholds=thresholds(detector, KNOWN if number else 0),
        )
        for number, name in enumerate(("first", *map(str, range(MONTHS))))
    ]


def thresholds(detector: Detector, history: int) -> tuple[float, float]:
    """Return the thresholds of 1 false alarm in 1,000 and in 10,000 throws."""
    calibrated = detector.knowledge.calibration(part="cycle", history=history)
    assert calibrated is not None
    return float(calibrated.thresholds["0.001"]), float(calibrated.thresholds["0.0001"])


def _alarms(
    said: Sequence[Sequence[Sequence[Any]]],
    *,
    further: Sequence[Sequence[float]],
    uses: int,
    thresholds: tuple[float, float],
) -> dict[str, Any]:
    """Return false alarms of throws by switch, and how many verdicts have each status."""
    ratios = [
        np.array([item[1] for item in rows if item[1] is not None] + list(more))
        for rows, more in zip(said, further, strict=True)
    ]
    usual, rare = (
        false_alarm_limits([item > limit for item in ratios], uses=uses) for limit in thresholds
    )
    status = Counter(item[0] for rows in said for item in rows)
    return {
        "alarms": usual,
        "at 1/10,000": rare,
        "status": dict(status.most_common()),
        "gaps called": sum(item[2] for rows in said for item in rows),
    }


def year_table(months: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return false alarms and statuses of each month as a table."""
    lines = [
        "| | alarms, upper 95 % limit | at 1/10,000 | verdicts: sound | other cause | unknown "
        "| cannot judge | gaps called |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for number, item in enumerate(months):
        name = str(number) if number else "first 20, no history"
        status = item["status"]
        cause = sum(count for key, count in status.items() if key.startswith("other cause"))
        cells = [
            alarms(item["alarms"]),
            f"{item['at 1/10,000']['alarms']:.0f}",
            f"{status.get('sound', 0):,}",
            f"{cause:,}",
            f"{status.get('unknown deviation', 0):,}",
            f"{status.get(CANNOT, 0) + status.get(OBJECTS, 0):,}",
            f"{item['gaps called']:,}",
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    causes: Counter[str] = Counter()
    for item in months[1:]:
        causes.update({key: n for key, n in item["status"].items() if ": " in key})
    worst = max(item["alarms"]["upper"] for item in months[1:])
    kept = "kept" if worst <= MOST else "not kept"
    return [
        *lines,
        "",
        f"- worst month {1e3 * worst:.2f}/1,000 in its upper limit, {1e3 * MOST:g} allowed: {kept}",
        "- causes named in the year: "
        + ", ".join(f"{name.partition(': ')[2]} {count}" for name, count in causes.most_common()),
    ]


# ---- ice


def ice_figures(detector: Detector, ice: Arrays, folder: Path) -> list[dict[str, Any]]:
    """Return for each switch when ice was touched, called, and reported by lock or TKK [m]."""
    setting = detector.knowledge.setting
    limits = np.array(setting.limits)

    def of_switch(number: int) -> dict[str, Any]:
        rng = np.random.default_rng([SEED, number, 2])
        recorder = Recorder(setting, ice["time"], rng)
        rows = np.flatnonzero(ice["switch"] == number)
        made = [recorder.record(ice["force"][row], exact=False) for row in rows]
        size, touched = ice["size"][rows], ice["touch"][rows] > TOUCH_FORCE
        own = Detector(detector.knowledge)
        own.learn(made[:KNOWN])
        status: list[list[Any]] = []
        for first in range(KNOWN, len(rows), AT_ONCE):
            status += [said_of(item) for item in own.predict(made[first : first + AT_ONCE])]
            if any(status[at - KNOWN][0] == "object" for at in np.flatnonzero(touched)
                   if KNOWN <= at < KNOWN + len(status)):  # fmt: skip
                break
            own.learn(made[first : first + AT_ONCE])
        judged = slice(KNOWN, KNOWN + len(status))
        called = np.array([item[0] == "object" for item in status])
        other = np.array([item[0] != "sound" for item in status])
        open_gap = np.asarray((ice["gaps"][rows] >= limits).any(axis=1))
        return {
            "place": ICE_PLACES[number % len(ICE_PLACES)],
            "touched": _first(size, touched),
            "not sound": _first(size[judged], other & touched[judged]),
            "called": _first(size[judged], called & touched[judged]),
            "reported": _first(size, open_gap),
            "largest": float(size.max()),
            "before": int(np.count_nonzero(~touched[judged])),
            "early": int(np.count_nonzero(called & ~touched[judged])),
        }

    return of_each_switch(np.arange(ICE_SWITCHES), folder, of_switch)


def _first(size: Floats, which: NDArray[np.bool_]) -> float | None:
    """Return the first size for which a condition holds [m]; None if it never does."""
    return float(size[np.argmax(which)]) if which.any() else None


def ice_table(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return when ice is touched, called and reported, by place, as a table."""
    lines = [
        "| ice at | touched | first not sound | called an object | lock or TKK | before these |",
        "|---|---|---|---|---|---|",
    ]
    for place in ICE_PLACES:
        own = [item for item in found if item["place"] == place]
        cells = [
            _sizes([item[key] for item in own])
            for key in ("touched", "not sound", "called", "reported")
        ]
        sooner = sum(_before(item) for item in own)
        lines.append(f"| {place} | {' | '.join(cells)} | {sooner} of {len(own)} |")
    before, early = (sum(item[key] for item in found) for key in ("before", "early"))
    return [*lines, "", f"- false alarms before the ice is touched: {early} of {before}"]


def _sizes(values: Sequence[float | None]) -> str:
    """Return the sizes of some switches, smallest first [mm]; "never" last.

    Examples
    --------
    >>> _sizes([4e-3, None, 3.2e-3])
    '3.2, 4.0, never'
    """
    known = sorted(1e3 * value for value in values if value is not None)
    return ", ".join([f"{v:.1f}" for v in known] + ["never"] * (len(values) - len(known)))


def _before(item: Mapping[str, Any]) -> bool:
    """Return whether ice was called before lock or TKK reported it."""
    called, reported = item["called"], item["reported"]
    return called is not None and (reported is None or called < reported)


if __name__ == "__main__":
    main()
