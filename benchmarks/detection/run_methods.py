"""Run the methods of the benchmark, each under each set of conditions; interrupted, it goes on.

A piece is a method under a set of conditions. Its result is kept in a file, and while it is tuned
so are the scores of each setting on each fold.
"""

import io
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from pickle import dumps  # its length is the size of a model; nothing is read that way
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.classical import ComponentsMethod, LimitsMethod, WarpingMethod
from benchmarks.detection.data import (
    TRACKS,
    Benchmark,
    Side,
    judged_labels,
    open_benchmark,
)
from benchmarks.detection.definition import MARKERS, TEST, TRAIN, WITH_MACHINES
from benchmarks.detection.learned import BoostingMethod, ForestMethod, RocketMethod
from benchmarks.detection.make_throws import data_digest, read_throws_file
from benchmarks.detection.method import (
    FOLDS,
    Floats,
    Keep,
    Method,
    fold_of_panels,
    judged_of,
    tune,
)
from benchmarks.detection.score import score_verdicts
from benchmarks.detection.turnout_detector import DetectorMethod, MachineDetectorMethod
from benchmarks.detection.verdicts import Verdicts, read_verdicts, write_verdicts
from turnout.core.errors import StudyError
from turnout.core.files import write_atomic
from turnout.core.json_files import to_plain
from turnout.core.provenance import content_hash
from turnout.core.sources import digest_of_sources
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.detection.detector.allowances import Allowances

RESULTS = "results"
Report = Callable[[str, int, int], None]
ASSUMED = 0.05
"""Usual discrepancy, which a detector assumes that does not know the true one [-]."""
COMMON = ("data.py", "method.py")
"""Sources that verdicts of all methods depend on."""
USES = {
    "learned.py": ("classical.py", "minirocket.py"),
    "turnout_detector.py": (
        *("detection/detector", "detection/likelihood.py", "detection/population.py"),
    ),
}
"""Further sources, by that of the method."""
SCORES = ("metrics.py", "score.py", "detection/pod")
"""Sources that scores depend on."""


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

    def judged(self, folder: Path) -> Side:
        """Return the labels of the judged test throws, without their histories."""
        return judged_labels(folder, **asdict(self))


MAIN = (Conditions(), Conditions(history=0))
MACHINES = tuple(
    Conditions(track=WITH_MACHINES, channels=name) for name in ("force", "current", "power")
)
DISCREPANCIES = (Conditions(discrepancy=0.10), Conditions(discrepancy=0.03))


def conditions_for(known: int) -> tuple[Conditions, ...]:
    """Return all conditions that are compared, by the throws known of each switch.

    Those that may change the order come first.

    Examples
    --------
    >>> [item.name for item in conditions_for(200)][5]
    'markers-force-h200-d5'
    """
    longest = (Conditions(history=known),) if known > MAIN[0].history else ()
    return (*MAIN, MACHINES[0], *DISCREPANCIES, *longest, *MACHINES[1:])


def methods_for(conditions: Conditions) -> list[Method]:
    """Return the methods that are compared under some conditions, the simplest first.

    Where the discrepancy is not the usual one, the detector of this program is there twice: the
    second one assumes the usual one. It says more than its ratio of machines and under the main
    conditions, and tries all its settings there alone: of markers they hardly differ.
    """
    of_machines = conditions.track == WITH_MACHINES
    kind = MachineDetectorMethod if of_machines else DetectorMethod
    whole = of_machines or conditions in MAIN
    settings = kind.settings if whole else kind.settings[-1:]

    def detector(assumed: float, name: str, title: str) -> DetectorMethod:
        return kind(
            errors=Allowances(discrepancy=assumed), quantity=conditions.channels,
            name=name, title=title, details=whole, settings=settings,
        )  # fmt: skip

    found: list[Method] = [
        LimitsMethod("threshold", "threshold, peak and duration", "peak and duration"),
        LimitsMethod("three-features", "three features, learned limits", "three features"),
        WarpingMethod(),
        ComponentsMethod(),
        ForestMethod(),
        RocketMethod(),
        BoostingMethod(),
    ]
    if conditions.discrepancy != ASSUMED:
        title = f"turnout detector, {ASSUMED:.0%} assumed"
        found.append(detector(ASSUMED, ASSUMING, title))
    return [*found, detector(conditions.discrepancy, OURS, "turnout detector")]


OURS, ASSUMING = "turnout", "turnout-assumed"


def run_methods(
    folder: Path,
    conditions: Sequence[Conditions],
    *,
    only: Sequence[str] = (),
    workers: int = 1,
    report: Report | None = None,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the score of each method by conditions and name; run missing ones.

    Parameters
    ----------
    folder : Path
        Of a benchmark that was made.
    conditions : sequence of Conditions
        In turn.
    only : sequence of str
        Names of methods; default all.
    workers : int
        Processes, each of which takes a piece at a time.
    report : callable, optional
        Called with what was run, how many pieces are done, and of how many.
    """
    names = [item.name for item in methods_for(Conditions(discrepancy=0.0))]
    unknown = [name for name in only if name not in names]
    if unknown:
        faults = [f'method "{name}": there are {", ".join(names)}' for name in unknown]
        raise StudyError(faults, source="benchmark")
    data = _data_of(folder)
    pieces = [
        (own, method)
        for own in conditions
        for method in methods_for(own)
        if not only or method.name in only
    ]
    found: dict[Piece, dict[str, Any] | None]
    found = {(own, method.name): _kept(folder, own, method, data[own.track])
             for own, method in pieces}  # fmt: skip
    missing = [(own, method.name) for own, method in pieces if found[own, method.name] is None]
    missing.sort(key=lambda piece: (conditions.index(piece[0]), -names.index(piece[1])))
    done = len(pieces) - len(missing)
    for (own, name), result in _results(folder, missing, data, workers=workers):
        found[own, name], done = result, done + 1
        if report is not None:
            report(f"{own.name}, {result['title']}", done, len(pieces))
    results: dict[str, dict[str, dict[str, Any]]] = {}
    for own, method in pieces:
        piece = found[own, method.name]
        if piece is not None:
            results.setdefault(own.name, {})[method.name] = piece
    return results


Piece = tuple[Conditions, str]


def _results(
    folder: Path, missing: Sequence[Piece], data: dict[str, str], *, workers: int
) -> Iterator[tuple[Piece, dict[str, Any]]]:
    """Yield the results of pieces as they come."""
    fault: BaseException | None = None
    count = min(workers, len(missing))
    jobs = [partial(_tried_piece, folder, own, name, data[own.track]) for own, name in missing]
    with Workers(count if count > 1 else 0) as processes:
        for number, found in processes.run(jobs):
            if isinstance(found, Exception):
                fault = fault or found
            else:
                yield missing[number], found
    # the others first: what a method lacks is not to cost hours of them
    if fault is not None:
        raise fault


def _tried_piece(
    folder: Path, conditions: Conditions, name: str, data: str
) -> dict[str, Any] | Exception:
    """Return the results of a piece, or why there are none."""
    try:
        return _run_piece(folder, conditions, name, data)
    except Exception as error:  # noqa: BLE001 - raised once the others are done
        return error


def _run_piece(folder: Path, conditions: Conditions, name: str, data: str) -> dict[str, Any]:
    method = next(item for item in methods_for(conditions) if item.name == name)
    # more threads would wait for those of the other pieces, and sum in another order
    with one_blas_thread():
        place = folder / RESULTS / conditions.name
        return run_method(method, _opened(folder, conditions), place, data=data)


_LAST: dict[tuple[Path, Conditions], Benchmark] = {}


def _opened(folder: Path, conditions: Conditions) -> Benchmark:
    """Open a benchmark; the one opened last is kept, and freed before another is opened."""
    key = folder, conditions
    if key not in _LAST:
        _LAST.clear()
        _LAST[key] = conditions.open(folder)
    return _LAST[key]


def _data_of(folder: Path) -> dict[str, str]:
    """Return the digest of the throws of each track."""
    whole = read_throws_file(folder)
    return {
        track: data_digest(whole.isel(throw=np.flatnonzero(whole["track"].to_numpy() == track)))
        for track in TRACKS
    }


def _key(method: Method, data: str) -> str:
    """Return a digest of all that verdicts follow from."""
    settings = [dict(item) for item in method.settings]
    given = [str(getattr(method, name, "")) for name in ("errors", "details")]
    return str(content_hash([data, method.name, settings, given, digest_of(sources_of(method))]))


def sources_of(method: Method) -> tuple[str, ...]:
    """Return the sources that verdicts of a method depend on."""
    own = type(method).__module__.rpartition(".")[2] + ".py"
    return (*COMMON, own, *USES.get(own, ()))


def digest_of(sources: Sequence[str]) -> str:
    """Return a digest of modules of this folder and, their names with a slash, of turnout."""
    own = [Path(__file__).with_name(name).read_text("utf-8") for name in sources if "/" not in name]
    return content_hash([own, digest_of_sources(tuple(name for name in sources if "/" in name))])


def _kept(folder: Path, conditions: Conditions, method: Method, data: str) -> dict[str, Any] | None:
    """Return the stored result, if it is of these throws and of this program."""
    place = folder / RESULTS / conditions.name
    path = place / f"{method.name}.json"
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if found.get("key") != _key(method, data) or "score" not in found:
        return None
    if found.get("scored") != digest_of(SCORES):
        found["score"] = score_file(place / f"{method.name}.csv", folder, conditions)
        found["scored"] = digest_of(SCORES)
        write_atomic(path, json.dumps(found, indent=1) + "\n")
    return found


def run_method(method: Method, bench: Benchmark, place: Path, *, data: str) -> dict[str, Any]:
    """Tune a method, judge the test throws, and keep verdicts and score in a folder."""
    train = judged_of(bench, TRAIN)
    place.mkdir(parents=True, exist_ok=True)
    tuning, key = place / "tuning", _key(method, data)
    began = time.process_time()
    keep, spent = _keeper(tuning, f"{method.name}-{key[:16]}")
    fitted = tune(method, train, folds_of(train.side), keep)
    tuned = time.process_time() - began + spent()
    test = judged_of(bench, TEST)
    began = time.process_time()
    scores, said = fitted.model.judge(test)
    took = time.process_time() - began
    verdicts = Verdicts(
        throw=test.side.throw,
        score=scores,
        alarm=scores > fitted.thresholds[0],
        rare_alarm=scores > fitted.thresholds[1],
        **said,
    )
    write_verdicts(verdicts, place / f"{method.name}.csv", test.side.positions)
    result = {
        "method": method.name,
        "title": method.title,
        "key": key,
        "scored": digest_of(SCORES),
        "setting": dict(fitted.setting),
        "tried": [{"setting": dict(item), "detected": share} for item, share in fitted.tried],
        "tuning_time": tuned,
        "milliseconds": 1e3 * took / len(scores),
        "bytes": len(dumps(fitted.model)),
        "score": asdict(score_verdicts(verdicts, test.side, history=bench.history)),
    }
    text = json.dumps(to_plain(result, nonfinite=lambda _: None), indent=1)
    write_atomic(place / f"{method.name}.json", text + "\n")
    for path in tuning.glob(f"{method.name}-*.npz"):
        path.unlink()
    return dict(json.loads(text))


def folds_of(side: Side) -> NDArray[np.intp]:
    """Return the fold of each training throw: all switches of a panel in one, each kind in all.

    Folds that are drawn from all panels may leave two switches of a kind of machine to learn from.
    """
    panel, machine = side.labels["panel"], side.labels["machine"]
    found = fold_of_panels(panel)
    first = {int(number): str(name) for number, name in zip(panel, machine, strict=True)}
    kind = np.array([first[int(number)] for number in panel])
    names, start = np.unique(kind), 0
    for name in names if len(names) > 1 else []:
        own = np.unique(panel[kind == name])
        place = (start + np.random.default_rng(0).permutation(len(own))) % FOLDS
        found[kind == name] = place[np.searchsorted(own, panel[kind == name])]
        start += len(own)
    return found


def _keeper(tuning: Path, name: str) -> tuple[Keep, Callable[[], float]]:
    """Return a function that keeps scores in files, and one for the time of stored scores [s]."""
    before: list[float] = []

    def keep(fold: int, setting: int, scores: Callable[[], Floats]) -> Floats:
        path = tuning / f"{name}-{fold}-{setting}.npz"
        try:
            with np.load(path, allow_pickle=False) as content:
                before.append(float(content["time"]))
                return np.asarray(content["scores"], dtype=np.float64)
        except (OSError, ValueError, KeyError):
            began = time.process_time()
            found = scores()
            tuning.mkdir(exist_ok=True)
            packed = io.BytesIO()
            np.savez(packed, scores=found, time=time.process_time() - began)
            write_atomic(path, packed.getvalue())
            return found

    return keep, lambda: float(np.sum(before))


def numbers_digest(folder: Path, results: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Return a digest of all verdicts and scores; times are no part of it."""
    content = {
        f"{conditions}/{name}": [
            content_hash((folder / RESULTS / conditions / f"{name}.csv").read_text("utf-8")),
            result["setting"],
            result["score"],
        ]
        for conditions, own in results.items()
        for name, result in own.items()
    }
    return str(content_hash(content))


def score_file(path: Path, folder: Path, conditions: Conditions) -> dict[str, Any]:
    """Return the score of anyone's verdict file."""
    side = conditions.judged(folder)
    verdicts = read_verdicts(path, throws=side.throw, positions=side.positions)
    score = score_verdicts(verdicts, side, history=conditions.history)
    return dict(to_plain(asdict(score), nonfinite=lambda _: None))
