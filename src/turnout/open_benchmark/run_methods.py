"""Run the methods of the benchmark, each under each set of conditions; interrupted, it goes on."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from pickle import dumps  # its length is the size of a model; nothing is read that way
from typing import Any

import numpy as np

from turnout.core.files import write_atomic
from turnout.core.json_files import to_plain
from turnout.detection.detector.allowances import Allowances
from turnout.errors import StudyError
from turnout.open_benchmark.classical import ComponentsMethod, LimitsMethod, WarpingMethod
from turnout.open_benchmark.definition import MARKERS, TEST, TRAIN, WITH_MACHINES
from turnout.open_benchmark.learned import BoostingMethod, ForestMethod, RocketMethod
from turnout.open_benchmark.make_throws import data_digest
from turnout.open_benchmark.method import Method, fold_of_panels, judged_of, tune
from turnout.open_benchmark.ours import DetectorMethod
from turnout.open_benchmark.score import plain, score_verdicts
from turnout.open_benchmark.sides import TRACKS, Benchmark, open_benchmark, read_throws_file
from turnout.open_benchmark.verdicts import Verdicts, read_verdicts, write_verdicts

RESULTS = "results"
Report = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Under which methods are compared.

    Attributes
    ----------
    history : int
        Sound throws known of each switch.
    discrepancy : float
        Between model and switch [-].
    channels, track : str
        As `open_benchmark` takes them.
    """

    history: int = 20
    discrepancy: float = 0.05
    channels: str = "force"
    track: str = MARKERS

    @property
    def name(self) -> str:
        """Of files."""
        return f"{self.track}-{self.channels}-h{self.history}-d{100 * self.discrepancy:g}"

    def open(self, folder: Path) -> Benchmark:
        """Open the benchmark under these conditions."""
        return open_benchmark(folder, **asdict(self))


MAIN = (Conditions(), Conditions(history=0))
VARIED = (
    *(Conditions(discrepancy=0.03), Conditions(discrepancy=0.10)),
    *(Conditions(track=WITH_MACHINES, channels=name) for name in ("force", "current", "power")),
)
LONG_HISTORY = Conditions(history=200)


def conditions_for(known: int) -> tuple[Conditions, ...]:
    """Return all conditions that are compared, by the throws known of each switch."""
    return (*MAIN, *VARIED, *((LONG_HISTORY,) if known >= LONG_HISTORY.history else ()))


def methods_for(conditions: Conditions) -> list[Method]:
    """Return the methods that can judge under some conditions, the simplest first."""
    found: list[Method] = [
        LimitsMethod("threshold", "threshold, peak and duration", "peak and duration"),
        LimitsMethod("three-features", "three features, learned limits", "three features"),
        WarpingMethod(),
        ComponentsMethod(),
        ForestMethod(),
        RocketMethod(),
        BoostingMethod(),
    ]
    if conditions.channels == "force" and conditions.track == MARKERS:
        found.append(DetectorMethod(errors=Allowances(discrepancy=conditions.discrepancy)))
    return found


def run_methods(
    folder: Path,
    conditions: Sequence[Conditions],
    *,
    only: Sequence[str] = (),
    report: Report | None = None,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the score of each method by conditions and name; what is missing is run.

    Parameters
    ----------
    folder : Path
        Of a benchmark that was made.
    conditions : sequence of Conditions
        In turn.
    only : sequence of str
        Names of methods; default all.
    report : callable, optional
        Called with what is run, how many runs are done, and of how many.
    """
    names = [item.name for item in methods_for(Conditions())]
    unknown = [name for name in only if name not in names]
    if unknown:
        faults = [f'method "{name}": there are {", ".join(names)}' for name in unknown]
        raise StudyError(faults, source="benchmark")
    whole = read_throws_file(folder)
    data = {
        track: data_digest(whole.isel(throw=np.flatnonzero(whole["track"].to_numpy() == track)))
        for track in TRACKS
    }
    todo = [
        (own, method)
        for own in conditions
        for method in methods_for(own)
        if not only or method.name in only
    ]
    found: dict[str, dict[str, dict[str, Any]]] = {}
    bench: tuple[Conditions, Benchmark] | None = None
    for done, (own, method) in enumerate(todo):
        if report is not None:
            report(f"{own.name}, {method.title}", done, len(todo))
        place = folder / RESULTS / own.name
        kept = _kept(place / f"{method.name}.json", data[own.track])
        if kept is None:
            if bench is None or bench[0] != own:
                bench = (own, own.open(folder))
            kept = run_method(method, bench[1], place, data=data[own.track])
        found.setdefault(own.name, {})[method.name] = kept
    return found


def _kept(path: Path, data: str) -> dict[str, Any] | None:
    """Return the stored result, if it is of these throws."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if found.get("data") == data and "score" in found else None


def run_method(method: Method, bench: Benchmark, place: Path, *, data: str) -> dict[str, Any]:
    """Tune a method, judge the test throws, and keep verdicts and score in a folder."""
    train = judged_of(bench, TRAIN)
    panels = bench.train.labels["panel"][bench.train.judged]
    began = time.process_time()
    fitted = tune(method, train, fold_of_panels(panels))
    tuned = time.process_time() - began
    test = judged_of(bench, TEST)
    began = time.process_time()
    scores = fitted.model.score(test)
    took = time.process_time() - began
    verdicts = Verdicts(
        throw=test.side.throw,
        score=scores,
        alarm=scores > fitted.thresholds[0],
        rare_alarm=scores > fitted.thresholds[1],
        **fitted.model.extras(test),
    )
    place.mkdir(parents=True, exist_ok=True)
    write_verdicts(verdicts, place / f"{method.name}.csv", test.side.positions)
    result = {
        "method": method.name,
        "title": method.title,
        "data": data,
        "setting": dict(fitted.setting),
        "tried": [{"setting": dict(item), "detected": share} for item, share in fitted.tried],
        "tuning_time": tuned,
        "milliseconds": 1e3 * took / len(scores),
        "bytes": len(dumps(fitted.model)),
        "score": plain(score_verdicts(verdicts, bench)),
    }
    text = json.dumps(to_plain(result, nonfinite=lambda _: None), indent=1)
    write_atomic(place / f"{method.name}.json", text + "\n")
    return dict(json.loads(text))


def score_file(path: Path, bench: Benchmark) -> dict[str, Any]:
    """Return the score of anyone's verdict file."""
    side = bench.test.of(bench.test.judged)
    verdicts = read_verdicts(path, throws=side.throw, positions=side.positions)
    return dict(to_plain(plain(score_verdicts(verdicts, bench)), nonfinite=lambda _: None))
