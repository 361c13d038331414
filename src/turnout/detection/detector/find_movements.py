r"""Movements of recordings that no channel marks: found by their likeness to sound throws.

Forces that go on changing at rest (a zero that wanders, vibration, a passing train) show no onset.
So windows of the recording are compared with the detector's own sound throws of opening and of
closing, at all friction levels and all instants, an offset of each drive allowed. Likeness is the
correlation

.. math:: r(t) = \max_l \frac{y_t \cdot m_l}{|y_t|\,|m_l|}

of the windows :math:`y_t` from :math:`t` on and of a sound throw :math:`m_l` at friction level
:math:`l`, both less their mean of each drive. The onset is then the most likely one near the
highest correlation. A match that is poor, or as good at another instant, is refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from turnout.detection.detector.align_onsets import Aligner, EarlyForces
from turnout.detection.detector.judging import View
from turnout.detection.detector.recorded import (
    END_MISSING,
    START_MISSING,
    Match,
    Recorded,
    known_forces,
    part_of,
    value_fault,
)
from turnout.detection.detector.throw_layout import (
    CLOSING,
    LEAST_SAMPLES,
    OPENING,
    TOGETHER,
    Layout,
    Part,
)
from turnout.detection.detector.wrong_channels import wrong_forces

Floats = NDArray[np.float64]

STEP = 0.04
"""Between instants that are tried first [s]."""
LEAST_MATCH = 0.75
"""Correlation with sound throws below which a movement is not one of this switch [-]."""
AMPLITUDE = (0.35, 3.0)
"""Least and largest size of a movement in sizes of a sound one, by least squares [-]."""
UNLIKELY = 10.0
"""Times beyond these from which on forces are probably in another unit [-]."""
BLOCK = 1000
"""Instants that are tried together, which bounds memory."""
SAME = 0.3
"""Instants that lie nearer to each other than this are one match [s]."""
WORTH, REPEATED = 0.5, 0.3
"""Least share that a movement explains to count, and cost of two of a kind in a row [-]."""
FINE = np.arange(-0.44, 0.441, 0.02)
"""Onsets that are tried about a match: an object can move the highest correlation by 0.3 s [s]."""
APART = 0.1
"""From each other, for two onsets to be different ones [s]."""
CLEAR = 3.0
"""Logarithm of the likelihood by which the best onset must exceed a different one [-]."""
AGREE = 0.04
"""Onsets that the forces show by themselves hold where they lie so near to a match [s]."""


class MovementFinder:
    """Finds openings and closings in recordings of forces alone.

    Parameters
    ----------
    view : View
        Of the switch over the whole cycle.
    layout : Layout
        Of the detector.
    """

    def __init__(self, view: View, layout: Layout) -> None:
        self._layout = layout
        self._means = {
            part.name: np.array(
                [
                    centre.mean[: layout.size][layout.part == number].reshape(
                        len(layout.drives), -1
                    )
                    for centre in view.centres
                ]
            )
            for number, part in enumerate(layout.parts)
        }

    def movements(self, time: Floats, force: Floats) -> tuple[list[Match], tuple[float, float]]:
        """Return movements in the order of time, and likeness and size of the best closing.

        Parameters
        ----------
        time : ndarray, shape (n_times,)
            Rising [s].
        force : ndarray, shape (n_drives, n_times)
            Drives of the layout in its order, without holes [N].
        """
        held = [force[:, :1], force, force[:, -1:]]
        long = np.concatenate([[time[0] - START_MISSING], time, [time[-1] + END_MISSING]])
        wide = np.concatenate(held, axis=1)
        step = np.diff(long)
        area = np.cumsum(0.5 * (wide[:, 1:] + wide[:, :-1]) * step, axis=1)
        total = np.concatenate([np.zeros((len(wide), 1)), area], axis=1)
        curves = {}
        for part in self._layout.parts:
            starts = np.arange(long[0] - part.edges[0], long[-1] - part.edges[-1] + 1e-9, STEP)
            curves[part.name] = (starts, *self._likeness(part, starts, long, total))
        _, likeness, size = curves[CLOSING]
        most = int(likeness.argmax()) if likeness.size else -1
        best = (float(likeness[most]), float(size[most])) if likeness.size else (0.0, 1.0)
        candidates = [
            match for part in self._layout.parts for match in _peaks(part, *curves[part.name])
        ]
        chosen = _sequence(sorted(candidates, key=lambda item: item.onset))
        return [_with_rival(item, chosen, *curves[item.name]) for item in chosen], best

    def _likeness(
        self, part: Part, starts: Floats, time: Floats, total: Floats
    ) -> tuple[Floats, Floats]:
        """Return the correlation at each instant, and the size by least squares."""
        means = self._means[part.name]
        means = means - means.mean(axis=2, keepdims=True)
        flat = means.reshape(len(means), -1)
        lengths = np.linalg.norm(flat, axis=1)
        likeness, size = np.empty(len(starts)), np.empty(len(starts))
        for first in range(0, len(starts), BLOCK):
            some = slice(first, first + BLOCK)
            edges = starts[some, np.newaxis] + part.edges
            until = np.stack([np.interp(edges, time, row) for row in total], axis=1)
            windows = np.diff(until, axis=2) / part.window
            windows -= windows.mean(axis=2, keepdims=True)
            own = windows.reshape(len(windows), -1)
            product = own @ flat.T
            norm = np.maximum(np.linalg.norm(own, axis=1), 1e-9)
            likeness[some] = (product / (norm[:, np.newaxis] * lengths)).max(axis=1)
            # the level that is nearest: another may be as much alike, and larger or smaller
            level = (2.0 * product - lengths**2).argmax(axis=1)
            size[some] = product[np.arange(len(own)), level] / lengths[level] ** 2
        return likeness, size


def _peaks(part: Part, starts: Floats, likeness: Floats, size: Floats) -> list[Match]:
    """Return where sound throws of a movement fit better than just before and after."""
    wide = np.pad(likeness, 1, constant_values=-1.0)
    peak = (likeness >= wide[:-2]) & (likeness > wide[2:]) & (likeness >= LEAST_MATCH)
    peak &= (size > AMPLITUDE[0]) & (size < AMPLITUDE[1])
    duration = float(part.edges[-1]) - REST
    return [
        Match(
            name=part.name,
            onset=float(starts[at]),
            stop=float(starts[at]) + duration,
            likeness=float(likeness[at]),
        )
        for at in np.flatnonzero(peak)
    ]


def _sequence(candidates: Sequence[Match]) -> list[Match]:
    """Return the movements, one after the other, that explain a recording best.

    A switch opens and closes in turn. Each movement counts what its likeness exceeds `WORTH`; two
    of a kind in a row cost `REPEATED`, since the one between them was not found.
    """
    totals: list[float] = []
    before: list[int] = []
    for number, item in enumerate(candidates):
        best, via = 0.0, -1
        for other in range(number):
            if candidates[other].stop <= item.onset:
                total = totals[other] - REPEATED * (candidates[other].name == item.name)
                if total > best:
                    best, via = total, other
        totals.append(best + item.likeness - WORTH)
        before.append(via)
    found: list[Match] = []
    at = int(np.argmax(totals)) if totals else -1
    while at >= 0:
        found.append(candidates[at])
        at = before[at]
    return found[::-1]


def _with_rival(
    match: Match, chosen: Sequence[Match], starts: Floats, likeness: Floats, size: Floats
) -> Match:
    """Return a match with the best other instant that its neighbours leave for it."""
    duration = match.stop - match.onset
    away = np.abs(starts - match.onset)
    wide = np.pad(likeness, 1, constant_values=2.0)
    free = (likeness > wide[:-2]) & (likeness > wide[2:]) & (size > AMPLITUDE[0])
    free &= (away > SAME) & (away < duration)
    for other in chosen:
        if other is not match:
            free &= (starts + duration <= other.onset) | (starts >= other.stop)
    return replace(match, rival=float(likeness[free].max(initial=-1.0)))


REST = 0.8
"""After the movement in a layout, and what neighbours may share of it [s]."""


def located(
    recording: Recorded, layout: Layout, finder: MovementFinder, aligner: Callable[[str], Aligner]
) -> list[Recorded]:
    """Return the throws of a recording of forces alone, each with its onsets or why it has none.

    Parameters
    ----------
    recording : Recorded
        Without marked onsets.
    layout : Layout
        Of the detector.
    finder : MovementFinder
        Of the switch.
    aligner : callable
        Returns the aligner of the cycle or the closing.
    """
    time, force = known_forces(recording, layout)
    if time.size < LEAST_SAMPLES:
        empty = [
            name
            for name in layout.drives
            if not np.isfinite(recording.force[recording.drives.index(name)]).any()
        ]
        reason = "holds no instants at which all drives are recorded"
        if empty:
            reason = f"drive {', '.join(empty)}: holds no numbers"
        return _refused(recording, reason)
    found, best = finder.movements(time, force)
    wrong = wrong_forces(found, best[0], force, partial(finder.movements, time), layout.drives)
    if wrong:
        return _refused(recording, _first_fault(layout, force) or wrong)
    closings = [item for item in found if item.name == CLOSING]
    listed = recording.listed
    if not closings:
        likeness, size = best
        reason = (
            "no closing movement was found in it: the likeness to sound throws is "
            f"{max(likeness, 0.0):.2f} at best, {LEAST_MATCH:g} is needed"
        )
        if likeness >= LEAST_MATCH:
            low, high = AMPLITUDE
            reason = (
                "no closing movement was found in it: what looks most like one has "
                f"{size:.2g} times the size of a sound one, {low:g} to {high:g} is needed"
            )
            if not low / UNLIKELY < size < high * UNLIKELY:
                reason += "; forces are expected in N"
        return _refused(recording, _first_fault(layout, force) or reason)
    if listed and len(listed) != len(closings):
        reason = f"{len(closings)} closing movements were found in it, {len(listed)} are listed"
        return _refused(recording, reason)
    throws = [_throw(recording, found, item, layout, aligner) for item in closings]
    if listed:
        named = zip(throws, listed.items(), strict=True)
        return [replace(item, name=name, labels=dict(labels)) for item, (name, labels) in named]
    throws += _lonely(recording, found, layout)
    if len(throws) > 1:
        throws = [
            replace(item, name=f"{recording.name}#{number}")
            for number, item in enumerate(throws, 1)
        ]
    return throws


def _first_fault(layout: Layout, force: Floats) -> str:
    """Return what is wrong with the samples of the first faulty drive; empty without one."""
    for name, row in zip(layout.drives, force, strict=True):
        if fault := value_fault(row):
            return f"drive {name}: {fault}"
    return ""


def further_closing(recording: Recorded, layout: Layout, finder: MovementFinder) -> str:
    """Return why a row that may hold one throw only is not judged: a further closing in it.

    Parameters
    ----------
    recording : Recorded
        With its onset.
    layout : Layout
        Of the detector.
    finder : MovementFinder
        Of the switch.
    """
    closing = layout.parts[-1]
    stop = recording.onsets[CLOSING] + closing.edges[-1] - REST
    time, force = known_forces(recording, layout)
    later = time > stop
    if recording.time[-1] - stop < closing.edges[-1] or np.count_nonzero(later) < LEAST_SAMPLES:
        return ""
    found, _ = finder.movements(time[later], force[:, later])
    others = [item.onset for item in found if item.name == CLOSING]
    if not others:
        return ""
    return (
        f"holds a closing movement at {others[0]:.1f} s besides that at "
        f"{recording.onsets[CLOSING]:.1f} s; one row is one throw, and 'start [s]' the time of its "
        "first sample from the onset of closing on"
    )


def _refused(recording: Recorded, reason: str) -> list[Recorded]:
    names = list(recording.listed) or [recording.name]
    return [replace(recording, name=name, fault=reason, marked=True) for name in names]


def _throw(
    recording: Recorded,
    found: Sequence[Match],
    closing: Match,
    layout: Layout,
    aligner: Callable[[str], Aligner],
) -> Recorded:
    """Cut one closing out, with the opening before it."""
    at = found.index(closing)
    before = found[at - 1] if at else None
    if before is not None and (
        before.name != OPENING or closing.onset - before.onset > TOGETHER or before.doubt
    ):
        before = None
    first = (before or closing).onset - MARGIN
    following = found[at + 1].onset - 0.1 if at + 1 < len(found) else np.inf
    kept = (recording.time >= first) & (
        recording.time <= min(closing.stop + REST + MARGIN, following)
    )
    onsets = {CLOSING: closing.onset} | ({OPENING: before.onset} if before is not None else {})
    throw = replace(
        recording,
        time=recording.time[kept],
        force=recording.force[:, kept],
        onsets=onsets,
        fault=closing.doubt,
        marked=True,
        shown=(),
        listed={},
    )
    if throw.fault:
        return throw
    onsets, doubt = _most_likely(throw, layout, aligner)
    return replace(throw, onsets=_shown(onsets, recording.shown), fault=doubt)


def _shown(onsets: dict[str, float], shown: Sequence[Mapping[str, float]]) -> Mapping[str, float]:
    """Return the onsets that the forces show by themselves, where they agree."""
    for item in shown:
        if item.keys() == onsets.keys() and all(
            abs(item[name] - onset) < AGREE for name, onset in onsets.items()
        ):
            return item
    return onsets


MARGIN = 1.0
"""Of a recording, kept before and after a throw [s]."""


def _most_likely(
    throw: Recorded, layout: Layout, aligner: Callable[[str], Aligner]
) -> tuple[dict[str, float], str]:
    """Return the most likely onsets about those of a match, and why they are in doubt."""
    chosen = aligner(part_of(throw, layout))
    tried = {name: throw.onsets[name] + FINE for name in chosen.names(throw)}
    with np.errstate(invalid="ignore"):  # instants whose windows reach beyond the samples
        scores = EarlyForces(chosen, throw, tried).scores()
    scores = np.where(np.isfinite(scores), scores, -np.inf)
    at = np.unravel_index(int(scores.argmax()), scores.shape)
    found = {name: float(item[own]) for (name, item), own in zip(tried.items(), at, strict=True)}
    closing = scores[at[:-1]]
    others = closing[np.abs(FINE - FINE[at[-1]]) > APART]
    margin = float(closing[at[-1]] - others.max(initial=-np.inf))
    if margin > CLEAR:
        return found, ""
    doubt = (
        "when closing begins is not clear: another onset explains its early forces as well "
        f"(log likelihoods differ by {margin:.1f}, {CLEAR:g} is needed)"
    )
    return found, doubt


def _lonely(recording: Recorded, found: Sequence[Match], layout: Layout) -> list[Recorded]:
    """Return openings without the closing that belongs to them, each with why it is not judged."""
    closing = layout.parts[-1].edges[-1]
    lonely = []
    for number, item in enumerate(found):
        follower = found[number + 1] if number + 1 < len(found) else None
        room = recording.time[-1] - item.stop > closing if follower is None else True
        if item.name == OPENING and room and (follower is None or follower.name != CLOSING):
            lonely.append(item)
    return [
        replace(
            recording,
            fault=f"no closing movement was found after the opening at {item.onset:.1f} s",
            marked=True,
        )
        for item in lonely
    ]
