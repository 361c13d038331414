"""Detection with machines by force, current, power or all.

Tables of docs/evidence/detection-results.md.

``python -m benchmarks.studies.detector_machines DIR`` throws switches whose drives are machines, to
learn from and, with another seed, to be judged, trains a detector by each quantity with the same
throws, and judges the same switches by each. Throws, detectors and verdicts are kept in DIR, so
that a stopped run goes on.

By all means one likelihood of all signals: forces in their windows, currents and powers in windows
eight times as long, as in `turnout limit`, since few throws determine no more features. The
discrepancy of a force shows in current and power through the gain of the machine.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.studies.detector import DETECTOR
from benchmarks.studies.detector_figures import (
    Uses,
    a90_of_places,
    alone_of,
    false_alarm_limits,
    judge_alone,
    judge_with_history,
)
from benchmarks.studies.detector_further import (
    missed_shares,
    rates_alone,
    rates_known,
    ratios_alone,
)
from benchmarks.studies.detector_page import alarms
from benchmarks.studies.detector_sets import Arrays, Throws, judged_plans
from turnout.core.files import write_atomic
from turnout.core.sources import digest_of_sources
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import CURRENT, FORCE, POWER
from turnout.detection.detector.allowances import Allowances, gain_times
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.switch_history import ThrowErrors
from turnout.detection.detector.throw_layout import Layout, means_on, throw_features
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training import layout_of_panel, read_set, setting_of
from turnout.detection.detector.training_plan import HISTORY, LARGEST, OBJECT, SOUND, Plan
from turnout.detection.detector.training_sets import Counts, after_history, training_plans
from turnout.detection.drive_quantities import ALL, read_signals, signals_of
from turnout.detection.reference import FRICTION, NOMINAL_FRICTION, reference_study
from turnout.detection.signal_discrepancy import SignalErrors, discrepancy_of_signals
from turnout.detection.signal_errors import signal_errors
from turnout.detection.throws import nominal_amplitude
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.study import Study

Floats = NDArray[np.float64]

Said = Mapping[str, Mapping[str, Mapping[str, dict[str, Any]]]]
"""By quantity, throws known and name of the figure."""
MACHINES = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
QUANTITIES = (FORCE, CURRENT, POWER, ALL)
LEARNED = Counts(sound=3000, objects=2200, kinds=0, defects=160, switches=40)
JUDGED = Counts(sound=0, objects=0, defects=0, repeats=22, judged=2, objects_each=5)
SEED = 560_000
KNOWN = 20
AT_LOWER = f"{KNOWN}, threshold of none"
LABELS = {
    "0": "no history",
    str(KNOWN): f"{KNOWN} known",
    AT_LOWER: f"{KNOWN} known, threshold without a history",
}
WIDER = 8
"""Windows of forces that one of a current or power holds where all are judged together."""


def main() -> None:
    """Throw, train, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws, detectors and figures")
    parser.add_argument("--only", nargs="*", choices=QUANTITIES, default=list(QUANTITIES))
    parser.add_argument("--throws", action="store_true", help="make the throws, and end")
    parser.add_argument("--switches", type=int, default=200, help="that are judged")
    parser.add_argument("--alone", action="store_true", help="without a history only")
    given = parser.parse_args()
    panel = load_panel("uic60-760-1-15", overrides=MACHINES)
    study = reference_study(panel)
    throws = SignalThrows(study, given.folder, switches=given.switches)
    learned = throws.sets("train")
    judged = throws.sets("test")
    if given.throws:
        return
    made = digest_of_sources(DETECTOR)[:8] + "-alone" * given.alone
    kept = given.folder / f"figures-{made}-{given.switches}.json"
    said = json.loads(kept.read_text()) if kept.exists() else {}
    for quantity in given.only:
        with one_blas_thread():
            path = given.folder / f"{quantity}-{made}.detector"
            histories = () if given.alone else (KNOWN,)
            knowledge = _trained(study, quantity, learned, path, histories)
            place = given.folder / f"judged-{made}-{given.switches}" / quantity
            said[quantity] = figures(knowledge, of_quantity(judged, quantity), place)
        write_atomic(kept, json.dumps(said, indent=1).encode())
    print("\n".join(tables(said)))


def _trained(
    study: Study,
    quantity: str,
    learned: Mapping[str, ThrowSet],
    path: Path,
    histories: tuple[int, ...],
) -> Knowledge:
    """Return the detector of a quantity, with thresholds without and with histories."""
    setting = joined_setting(study) if quantity == ALL else one_setting(study, quantity)
    if quantity != ALL and path.exists():
        return Detector.load(path).knowledge
    found = knowledge_of_sets(
        of_quantity(learned, quantity), setting, draws=8, history_draws=2, histories=histories
    )
    for item in found.calibrated:
        print(quantity, item.part, item.history, item.thresholds, flush=True)
    if quantity != ALL:
        Detector(found).save(path)
    return found


def figures(
    knowledge: Knowledge, test: Mapping[str, ThrowSet], kept: Path
) -> dict[str, dict[str, Any]]:
    """Return a90 by place, false alarms and missed objects, without and with a history.

    With a history also at the threshold without one: the own threshold rests on few switches.
    """
    places = knowledge.setting.places
    alone = judge_alone(knowledge, alone_of(test), draws=1)
    found = {
        "0": {
            "a90": a90_of_places(alone, places),
            "rates": rates_alone(
                knowledge, test[HISTORY], ratios_alone(knowledge, test[HISTORY], draws=7)
            ),
            "missed": missed_shares(alone),
        }
    }
    if max(item.history for item in knowledge.calibrated) < KNOWN:
        return found
    uses = Uses(verdicts=1, sound=75, causes=0, unknown=False)
    known, ratios, _ = judge_with_history(knowledge, test, kept, history=KNOWN, uses=uses)
    rates = rates_known(knowledge, ratios, uses=uses)
    found[str(KNOWN)] = {
        "a90": a90_of_places(known, places),
        "rates": {rate: item["sound"] for rate, item in rates.items()},
        "missed": missed_shares(known),
    }
    alone = knowledge.calibration(part=CYCLE, history=0)
    assert alone is not None
    lower = float(alone.thresholds["0.001"])
    uses_above = [np.array(item[SOUND]) > lower for item in ratios]
    found[AT_LOWER] = {
        "a90": a90_of_places(known, places, threshold=lower),
        "rates": {"0.001": false_alarm_limits(uses_above, uses=uses.sound)},
    }
    return found


def tables(said: Said) -> list[str]:
    """Return the figures as tables of docs/evidence/detection-results.md."""
    first = next(iter(said.values()))["0"]["a90"]
    names = [name.replace("sleeper ", "").replace("drive ", "D") for name in first]
    lines = [f"| a90 [mm] | {' | '.join(names)} |", "|---|" + "--|" * len(names)]
    for quantity, found in said.items():
        for known in found:
            label = LABELS[known]
            cells = [
                f"{1e3 * item[0]:.1f}" if item[0] < LARGEST else "-"
                for item in found[known]["a90"].values()
            ]
            lines.append(f"| {quantity}, {label} | {' | '.join(cells)} |")
    lines += ["", "| throws known | false alarms |", "|---|---|"]
    for quantity, found in said.items():
        for known, item in found.items():
            lines.append(f"| {quantity}, {LABELS[known]} | {alarms(item['rates']['0.001'])} |")
    classes = list(next(iter(said.values()))["0"]["missed"])
    lines += ["", f"| missed | {' | '.join(classes)} |", "|---|" + "--|" * len(classes)]
    for quantity, found in said.items():
        for known in found:
            if "missed" not in found[known]:
                continue
            row = found[known]["missed"]
            cells = [f"{100 * item['detector']:.0f} %" for item in row.values()]
            lines.append(f"| {quantity}, {LABELS[known]} | {' | '.join(cells)} |")
    for name in ("lock", "sensors", "objects"):
        row = first_missed(said)
        cells = [
            f"{item[name]:.0f}" if name == "objects" else f"{100 * item[name]:.0f} %"
            for item in row.values()
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def first_missed(
    said: Said,
) -> dict[str, dict[str, float]]:
    """Return the shares that are missed of the first quantity; lock and sensors are the same."""
    return next(iter(said.values()))["0"]["missed"]


# ---- throws with all signals


class SignalThrows(Throws):
    """Throws of machines with the features of all signals, each in the windows of forces.

    Parameters
    ----------
    study : Study
        Population whose drives are machines.
    folder : Path
        That holds the throws.
    switches : int
        That are judged.
    learned : Counts
        Throws to learn from.
    """

    def __init__(
        self, study: Study, folder: Path, *, switches: int, learned: Counts = LEARNED
    ) -> None:
        counts = replace(JUDGED, switches=switches)
        test = judged_plans(study, counts, seed=SEED)
        wanted = (HISTORY, after_history(OBJECT))
        plans = {
            "train": training_plans(study, learned),
            "test": {name: test[name] for name in wanted},
        }
        super().__init__(plans, folder, layout_of_panel(study.panel))
        self._signals = signals_of(study.panel, ALL)

    def _features(self, plan: Plan, dataset: xr.Dataset) -> Arrays:
        found = read_set(plan, dataset, self._layout)
        complete = (dataset["outcome"].astype(str) == "complete").to_numpy()
        values = read_signals(dataset, self._signals)[complete]
        time = dataset["time"].to_numpy().astype(np.float64)
        onsets = np.tile([part.start for part in self._layout.parts], (len(values), 1))
        onsets[:, -1] = plan.start[found.row]
        layout = replace(self._layout, drives=tuple(map(str, range(len(self._signals)))))

        def shifted(shift: float) -> Floats:
            return throw_features(time, values, layout=layout, onsets=onsets + shift)

        rates = (shifted(-SHIFT) - shifted(SHIFT)) / (2.0 * SHIFT)
        own = replace(found, features=shifted(0.0), rates=rates)
        return {field: getattr(own, field) for field in ThrowSet.__slots__}


SHIFT = 4e-3
"""By which onsets are moved to see what timing does [s]."""


def of_quantity(sets: Mapping[str, ThrowSet], quantity: str) -> dict[str, ThrowSet]:
    """Return throws with the features of a quantity alone, or of all."""
    layout = layout_of_panel(load_panel("uic60-760-1-15"))
    take = _selection(quantity, layout)
    return {
        name: replace(item, features=item.features @ take, rates=item.rates @ take)
        for name, item in sets.items()
    }


def _selection(quantity: str, layout: Layout) -> Floats:
    """Return the matrix that selects a quantity of the features of all signals in equal windows."""
    size = layout.size
    if quantity != ALL:
        first = QUANTITIES.index(quantity) * size
        return np.eye(3 * size)[:, first : first + size]
    return _joined(size, _wider(layout), len(layout.drives))


def _joined(size: int, wide: Floats, drives: int) -> Floats:
    """Return forces as they are, currents and powers averaged over the wider windows."""
    currents = np.kron(np.eye(2 * drives), wide)
    return np.block([
        [np.eye(size), np.zeros((size, currents.shape[1]))],
        [np.zeros((2 * size, size)), currents],
    ])  # fmt: skip


def _wider(layout: Layout) -> Floats:
    """Return the averages of `WIDER` windows in a row of one drive, shape (windows, wider)."""
    columns, first = [], 0
    for part in layout.parts:
        for number in range(part.count // WIDER):
            column = np.zeros(layout.windows)
            column[first + number * WIDER : first + (number + 1) * WIDER] = 1.0 / WIDER
            columns.append(column)
        first += part.count
    return np.array(columns).T


# ---- what detectors are made for


def one_setting(study: Study, quantity: str) -> Setting:
    """Return the setting of `turnout detect train --channels QUANTITY`."""
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION, quantity=quantity)
    return setting_of(study.panel, amplitude=amplitude, allowances=Allowances(), quantity=quantity)


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedLayout(Layout):
    """Forces in their windows, then currents and powers in wider ones; a drive is a signal."""

    wide: Layout

    @property
    def size(self) -> int:
        """Features of a throw."""
        return len(self.time)

    def _both(self, name: str) -> Floats:
        narrow = Layout(parts=self.parts, drives=self.drives)
        return np.concatenate([getattr(narrow, name), getattr(self.wide, name)])

    @property
    def time(self) -> Floats:
        """Middle of the window of each feature [s]."""
        return self._both("time")

    @property
    def width(self) -> Floats:
        """Length of the window of each feature [s]."""
        return self._both("width")

    @property
    def part(self) -> NDArray[np.intp]:
        """Number of the part of each feature."""
        return self._both("part").astype(np.intp)

    @property
    def drive(self) -> NDArray[np.intp]:
        """Number of the signal of each feature."""
        narrow = Layout(parts=self.parts, drives=self.drives)
        return np.concatenate([narrow.drive, self.wide.drive + len(self.drives)])

    @property
    def before_onset(self) -> NDArray[np.bool_]:
        """Whether the window of each feature ends before its movement begins."""
        return self._both("before_onset").astype(bool)

    def only(self, name: str) -> tuple[Layout, NDArray[np.intp]]:
        """Return the layout of one movement, and which features these are."""
        number = [part.name for part in self.parts].index(name)
        kept = JoinedLayout(
            parts=(self.parts[number],), drives=self.drives, wide=self.wide.only(name)[0]
        )
        return kept, np.flatnonzero(self.part == number)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JoinedSetting(Setting):
    """Forces, currents and powers in one likelihood."""

    noise: Floats
    covariance: Floats

    def errors(self, mean: Floats, *, allowances: Allowances | None = None) -> ThrowErrors:
        """Return the covariances of throws beside the sound model."""
        given = allowances or self.allowances
        share, layout = given.fixed_share, self.layout
        same = layout.drive[:, np.newaxis] == layout.drive
        samples = np.maximum(layout.width * given.rate, 1.0)
        zero = np.where(self.noise == given.noise, given.zero, self.noise)
        gain = given.gain**2 * np.where(same, np.outer(mean, mean), 0.0)
        return ThrowErrors(
            fixed=share * self.covariance + gain,
            changing=(1.0 - share) * self.covariance
            + np.diag(self.noise**2 / samples)
            + np.where(same, np.outer(zero, zero), 0.0),
            timing=given.timing,
            gap=given.gap,
        )


def joined_setting(study: Study) -> JoinedSetting:
    """Return the setting of a detector by all signals."""
    panel = study.panel
    force = one_setting(study, FORCE)
    layout, allowances = force.layout, force.allowances
    wide = replace(
        layout,
        parts=tuple(
            replace(part, window=WIDER * part.window, count=part.count // WIDER)
            for part in layout.parts
        ),
        drives=tuple(map(str, range(2 * len(layout.drives)))),
    )
    amplitude = [force.amplitude] + [
        nominal_amplitude(study, friction=NOMINAL_FRICTION, quantity=quantity)
        for quantity in (CURRENT, POWER)
    ]
    joined = JoinedLayout(parts=layout.parts, drives=layout.drives, wide=wide)
    noise = np.array([allowances.noise, allowances.current_noise, allowances.power_noise])
    return JoinedSetting(
        layout=joined,
        places=force.places,
        amplitude=np.concatenate(amplitude),
        gaps=force.gaps,
        limits=force.limits,
        allowances=allowances,
        quantity=ALL,
        noise=noise[joined.drive // len(layout.drives)],
        covariance=_joined_covariance(panel, layout, allowances),
    )


def _joined_covariance(panel: LoadedPanel, layout: Layout, allowances: Allowances) -> Floats:
    """Return the covariance that the discrepancy causes in all features of a throw."""
    signals = signals_of(panel, ALL)
    nominal = panel.with_overrides({FRICTION: NOMINAL_FRICTION})
    errors: SignalErrors = signal_errors(nominal, signals, time=gain_times(layout))
    time, means = means_on(layout, rate=125.0)
    whole = discrepancy_of_signals(
        time, means, errors=errors, signals=signals, conditions=allowances.conditions
    )
    take = _selection(ALL, layout)
    return take.T @ whole @ take


if __name__ == "__main__":
    main()
