"""The detector: trained once for a type of switch, taught by each switch's own sound throws."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError, TurnoutError
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import FORCE
from turnout.detection.detector.align_onsets import Aligner
from turnout.detection.detector.beyond_model import KnownBounds
from turnout.detection.detector.calibrating import throw_levels
from turnout.detection.detector.find_movements import MovementFinder, further_closing, located
from turnout.detection.detector.interval_widths import AT_ONCE
from turnout.detection.detector.judging import CYCLE, View, evidence_of, make_view
from turnout.detection.detector.knowledge import Knowledge, load, store
from turnout.detection.detector.recorded import (
    ZEROED,
    ForcesAtRest,
    Recorded,
    features_of_recorded,
    part_of,
    recording_fault,
)
from turnout.detection.detector.switch_history import Expectation, before_history, observe_all
from turnout.detection.detector.throw_layout import CLOSING, Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import (
    CANNOT,
    NOT_VERIFIED,
    OBJECTS,
    SOUND,
    Verdict,
    cannot_judge,
    verdict_on,
)
from turnout.detection.detector.wrong_channels import wrong_features

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class Detector:
    """Shows from drive forces whether something is trapped, where, how large, or what else it is.

    Attributes
    ----------
    knowledge : Knowledge
        Of the type of switch.
    known : Expectation
        Of this switch, from its own sound throws.
    false_alarm_rate : float
        Of sound throws that are called an object, 1e-3 or 1e-4 [-].

    Examples
    --------
    >>> detector = Detector.load("switch.detector")  # doctest: +SKIP
    >>> detector.predict(throws)[0].status  # doctest: +SKIP
    'sound'
    """

    knowledge: Knowledge
    known: Expectation = field(init=False)
    false_alarm_rate: float = 1e-3
    _views: dict[str, View] = field(init=False, default_factory=dict)
    _aligners: dict[str, Aligner] = field(init=False, default_factory=dict)
    _rests: dict[str, ForcesAtRest] = field(init=False, default_factory=dict)
    _bounds: dict[str, KnownBounds] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Begin without a history."""
        self.known = before_history(self.knowledge.model, self.knowledge.errors())

    @property
    def quantity(self) -> str:
        """Quantity of the drives that is judged: "force", "current" or "power"."""
        return self.knowledge.setting.quantity

    # ---- from throws to verdicts

    def predict(self, throws: "Recorded | Iterable[Recorded] | xr.Dataset") -> list[Verdict]:
        """Judge throws.

        Parameters
        ----------
        throws : Recorded, iterable of Recorded, or xarray.Dataset
            From `read_throws`; or a throw or a campaign in schema terms.
        """
        if isinstance(throws, str | PathLike):
            message = f"throws are needed, not a path: read_throws({str(throws)!r}) returns them"
            raise TypeError(message)
        if isinstance(throws, Recorded):
            throws = [throws]
        elif hasattr(throws, "data_vars"):
            from turnout.detection.detector.throws_of_dataset import throws_of_dataset

            throws = throws_of_dataset(cast("xr.Dataset", throws), quantity=self.quantity)
        return self._judge_all([throw for item in throws for throw in self.located(item)])

    def located(self, recording: Recorded) -> list[Recorded]:
        """Return the throws of a recording; where no channel marks them, they are found."""
        layout = self.knowledge.layout
        looked = not recording.marked or (recording.single and CLOSING in recording.onsets)
        looked = looked and self.quantity == FORCE
        if (
            not looked
            or recording.fault
            or not recording.time.size
            or not np.all(np.diff(recording.time) > 0.0)
            or any(name not in recording.drives for name in layout.drives)
        ):
            return [replace(recording, marked=True)]
        with one_blas_thread():
            finder = MovementFinder(self.view(), layout)
            if recording.marked:
                fault = further_closing(recording, layout, finder)
                return [replace(recording, fault=fault, single=False)]
            return located(recording, layout, finder, self._aligner)

    def judge(self, throw: Recorded) -> Verdict:
        """Judge one throw; one that cannot be judged says why."""
        if not throw.marked or throw.single:
            throws = self.located(throw)
            several = f"holds {len(throws)} throws; `predict` judges each"
            throw = throws[0] if len(throws) == 1 else replace(throw, fault=several)
        return self._judge_all([throw])[0]

    def _judge_all(self, throws: Sequence[Recorded]) -> list[Verdict]:
        """Judge located throws, many together: that takes half the time of one after another."""
        found: dict[int, Verdict] = {}
        rows: dict[str, list[tuple[int, Floats]]] = {}
        with one_blas_thread():
            for number, throw in enumerate(throws):
                part, features, reason = self._usable(throw)
                if reason:
                    found[number] = cannot_judge(throw.name, reason)
                else:
                    rows.setdefault(part, []).append((number, features))
            for part, own in rows.items():
                for first in range(0, len(own), AT_ONCE):
                    numbers, measured = zip(*own[first : first + AT_ONCE], strict=True)
                    names = [throws[number].name for number in numbers]
                    said = self._judge_rows(np.array(measured), part=part, names=names)
                    found |= dict(zip(numbers, said, strict=True))
        return [found[number] for number in range(len(throws))]

    def _usable(self, throw: Recorded) -> tuple[str, Floats, str]:
        """Return what of a throw can be judged, its features, and why not; empty if it can be."""
        reason = recording_fault(throw, self.knowledge.layout, self.quantity)
        if self.quantity != FORCE and not throw.exact:
            reason = f"{NOT_VERIFIED}; {throw.fault}" if throw.fault else NOT_VERIFIED
        if reason:
            return "", np.zeros(0), reason
        part, features = self.features(throw)
        return part, features, self._unusable(part, features) or self._unjudged(part)

    def _unjudged(self, part: str) -> str:
        """Return why a detector with some thresholds has none for a part; empty otherwise."""
        known = {item.part for item in self.knowledge.calibrated}
        if not known or part in known:
            return ""
        return (
            f"only its {part} can be judged, and this detector has no threshold for that; train "
            "it again: turnout detect train"
        )

    def _unusable(self, part: str, features: Floats) -> str:
        """Return why a throw cannot be judged by its features; empty where it can."""
        if self._zeroed(part, features):
            return ZEROED
        view, layout = self.view(part), self.knowledge.layout
        own = features[view.features]
        lost = np.count_nonzero(~np.isfinite(own))
        if lost or self.quantity != FORCE:
            return f"{lost} windows hold no samples" if lost else ""
        return wrong_features(own, view.usual[0], layout.drive[view.features], layout.drives)

    def _zeroed(self, part: str, features: Floats) -> bool:
        """Return True if forces were zeroed at rest; machines at rest draw no current."""
        if self.quantity != FORCE:
            return False
        if part not in self._rests:
            self._rests[part] = ForcesAtRest(self.view(part), self.knowledge.layout)
        return self._rests[part].zeroed(features)

    def judge_features(self, features: Floats, *, part: str = CYCLE) -> Verdict:
        """Judge one throw by its features, shape (n_features,) [N]."""
        lost = np.count_nonzero(~np.isfinite(features[self.view(part).features]))
        if lost:
            return cannot_judge("", f"{lost} windows hold no samples")
        return self._judge_rows(np.atleast_2d(features), part=part, names=[""])[0]

    def _judge_rows(self, features: Floats, *, part: str, names: Sequence[str]) -> list[Verdict]:
        """Judge throws without gaps together, shape (n_throws, n_features)."""
        calibrated = self.knowledge.calibration(part=part, history=self.known.throws)
        rate = f"{float(self.false_alarm_rate):g}"
        if calibrated is None or rate not in calibrated.thresholds:
            message = (
                f"this detector has no threshold for {part} at {self.false_alarm_rate} false "
                "alarms a throw"
            )
            if calibrated is not None and calibrated.thresholds:
                message += f"; it has for {', '.join(calibrated.thresholds)}"
            else:
                message += "; train it again: turnout detect train"
            raise TurnoutError(message)
        view, layout = self.view(part), self.knowledge.layout
        peaks = _peaks(np.abs(features[:, view.features]), layout)
        evidence = evidence_of(view, features)
        found = []
        for number, name in enumerate(names):
            verdict = verdict_on(
                name,
                view,
                evidence,
                number,
                knowledge=self.knowledge,
                calibrated=calibrated,
                rate=self.false_alarm_rate,
            )
            own = dict(zip(layout.drives, peaks[number].tolist(), strict=True))
            found.append(replace(verdict, peaks=own))
        if part not in self._bounds:
            self._bounds[part] = KnownBounds(view, layout, starts=self.quantity == FORCE)
        return self._bounds[part].checked(found, features, evidence)

    def features(self, throw: Recorded) -> tuple[str, Floats]:
        """Return what of a throw can be judged, and its features, shape (n_features,) [N]."""
        layout = self.knowledge.layout
        part = part_of(throw, layout)
        if throw.exact:
            onsets, sums = dict(throw.onsets), None
        else:
            onsets, sums = self._aligner(part).aligned(throw)
        if part == CLOSING:
            onsets = {CLOSING: onsets[CLOSING]}
        return part, features_of_recorded(throw, layout, onsets, sums)

    def view(self, part: str = CYCLE) -> View:
        """Return what throws are judged with, made when it is first needed."""
        if part not in self._views:
            with one_blas_thread():
                self._views[part] = make_view(self.knowledge, part=part, known=self.known)
        return self._views[part]

    def _aligner(self, part: str) -> Aligner:
        if part not in self._aligners:
            with one_blas_thread():
                self._aligners[part] = Aligner(self.view(part), self.knowledge.layout)
        return self._aligners[part]

    def _clear_prepared(self) -> None:
        """Clear what was prepared for another history."""
        for made in (self._views, self._aligners, self._rests, self._bounds):
            made.clear()

    # ---- what it learns of a switch

    def learn(self, throws: Iterable[Recorded], *, check: bool = True) -> list[Verdict]:
        """Learn what is usual for a switch from throws without an object.

        Parameters
        ----------
        throws : iterable of Recorded
            In the order of time.
        check : bool
            Whether a throw that is not called sound is left out.

        Returns
        -------
        list of Verdict
            On each throw, before any of them was learned.
        """
        found: list[Verdict] = []
        rows: dict[str, list[Floats]] = {}
        for throw in [one for item in throws for one in self.located(item)]:
            with one_blas_thread():
                part, own, reason = self._usable(throw)
                if reason:
                    found.append(cannot_judge(throw.name, reason))
                    continue
                (verdict,) = self._judge_rows(own[np.newaxis], part=part, names=[throw.name])
            found.append(verdict)
            if verdict.status == SOUND or not check:
                rows.setdefault(part, []).append(own)
        for part, measured in rows.items():
            self.learn_features(np.array(measured), part=part)
        return found

    def learn_features(self, features: Floats, *, part: str = CYCLE) -> None:
        """Learn sound throws by their features, shape (n_throws, n_features) [N]."""
        model, errors = self.knowledge.model, self.knowledge.errors()
        levels = throw_levels(self.view(part), features, levels=model.level)
        with one_blas_thread():
            self.known = observe_all(model, errors, self.known, features, levels=levels)
        self._clear_prepared()

    def clear_history(self) -> None:
        """Begin a new history, as after an adjustment."""
        self.__post_init__()
        self._clear_prepared()

    # ---- training and judging itself

    @classmethod
    def fit(cls, sets: Mapping[str, ThrowSet], setting: Any, **options: Any) -> Self:
        """Train a detector on simulated throws; see `train_detector`."""
        from turnout.detection.detector.train_detector import knowledge_of_sets

        return cls(knowledge_of_sets(sets, setting, **options))

    def score(self, throws: Sequence[Recorded], trapped: Sequence[bool]) -> dict[str, float]:
        """Return shares of false alarms, of objects detected, and of throws not judged.

        Parameters
        ----------
        throws : sequence of Recorded
            Each judged alone.
        trapped : sequence of bool
            Whether there was an object.
        """
        verdicts = [self.judge(throw) for throw in throws]
        judged = [
            (verdict.alarm, truth)
            for verdict, truth in zip(verdicts, trapped, strict=True)
            if verdict.status not in (CANNOT, OBJECTS)
        ]
        sound = [alarm for alarm, truth in judged if not truth]
        objects = [alarm for alarm, truth in judged if truth]
        return {
            "false_alarms": float(np.mean(sound)) if sound else float("nan"),
            "detected": float(np.mean(objects)) if objects else float("nan"),
            "not_judged": 1.0 - len(judged) / len(verdicts) if verdicts else float("nan"),
        }

    # ---- one file

    def save(self, path: Path | str) -> None:
        """Write the detector with the history of its switch to one file."""
        extra = {
            "mean": self.known.mean,
            "covariance": self.known.covariance.astype(np.float32),
            "throws": np.array(self.known.throws),
            "scatter": np.array([self.known.scatter, self.known.information]),
        }
        store(self.knowledge, Path(path), extra=extra if self.known.throws else None)

    @classmethod
    def load(cls, path: Path | str, *, false_alarm_rate: float = 1e-3) -> Self:
        """Read a detector file.

        Raises
        ------
        FileError
            When it is none, damaged, or of another format.
        """
        knowledge, extra = load(path)
        found = cls(knowledge, false_alarm_rate)
        if extra:
            size = len(found.known.mean)
            mean, covariance = extra.get("mean"), extra.get("covariance")
            if mean is None or covariance is None or mean.shape != (size,):
                message = f"{path}: its history does not fit; train it again, or copy it again"
                raise FileError(message)
            found.known = Expectation(
                mean=mean.astype(np.float64),
                covariance=covariance.astype(np.float64),
                throws=int(extra["throws"]),
                **dict(zip(("scatter", "information"), extra.get("scatter", ()), strict=False)),
            )
        return found


def _peaks(size: Floats, layout: Layout) -> Floats:
    """Return the largest value of each drive in each throw, shape (n_throws, n_drives)."""
    # features go drive by drive, in a part of them too
    return np.asarray(size.reshape(len(size), len(layout.drives), -1).max(axis=2))
