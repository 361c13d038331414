"""Gain of measures at the switch or at the detector, and their ranking.

Measures are computed from the throws of the reference case, without further ones: fewer states
(less friction, more closing force), other conditions (history, discrepancy, sampling), the mean of
two throws. Sensors at the rail use gaps of a further sweep with objects.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.problems import choices
from turnout.detection.limit.bound import repeated_alarm_rate
from turnout.detection.limit.limit_map import limit_map, sound_throws
from turnout.detection.reference import THROWS_A_DAY, Conditions
from turnout.detection.throws import Throws

Floats = NDArray[np.float64]

FEWEST_STATES = 8
DAYS = 365
FORMS = (
    "second throw",
    "history 20",
    "discrepancy 3 %",
    "rate 1000 Hz",
    "friction 0.2",
    "closing force",
)
"""Measures that `turnout limit --advise` ranks."""
EQUIPMENT = tuple(
    f"{kind} at 3.6 m" for kind in ("position sensor", "contact sensor", "force sensor", "drive")
)
"""Measures with throws of their own, ranked too, where a90 is largest."""
ADDED = r"(position sensor|contact sensor|force sensor|drive) at (\d+(?:\.\d+)?) ?m"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measure:
    """Inputs of the bound if a measure is taken.

    Attributes
    ----------
    name : str
    note : str
        What the measure is taken to mean.
    throws : Throws
        States that remain.
    conditions : Conditions
    averaged : int
        Throws whose mean is judged.
    beside : ndarray, shape (n_states, n_places, n_sizes), or None
        What a sensor adds, as `limit_map` takes it.
    base : Throws or None
        What it is compared with; None for all throws.
    """

    name: str
    note: str
    throws: Throws
    conditions: Conditions
    averaged: int = 1
    beside: Floats | None = None
    base: Throws | None = None


def check_measures(texts: Sequence[str]) -> None:
    """Refuse texts that are no measure, before anything is thrown, all at once."""
    problems = [
        f'what-if "{text}": is none of {choices((*FORMS, *EQUIPMENT))}, with numbers of your own'
        for text in texts
        if not any(
            re.fullmatch(pattern, " ".join(text.split()))
            for pattern in (*(form for form, _ in _FORMS), ADDED)
        )
    ]
    if problems:
        raise StudyError(problems, source="limit")


def read_measure(
    text: str, throws: Throws, conditions: Conditions, *, inputs: Sequence[str]
) -> Measure:
    """Return what a text such as "friction 0.2" means.

    Parameters
    ----------
    text : str
        One of the forms of `FORMS`, with any number.
    throws : Throws
        Of the reference case.
    conditions : Conditions
        Without the measure.
    inputs : sequence of str
        Names of the columns of `throws.switch`.

    Raises
    ------
    StudyError
        For a text of no such form, or one that leaves too few states.
    """
    check_measures([text])
    words = " ".join(text.split())
    found = next(
        make(match, throws, conditions, tuple(inputs))
        for pattern, make in _FORMS
        if (match := re.fullmatch(pattern, words))
    )
    if len(found.throws.states) < FEWEST_STATES:
        message = (
            f'what-if "{words}": only {len(found.throws.states)} of {len(throws.states)} states '
            "are like that; take a milder one, or more states"
        )
        raise StudyError([message], source="limit")
    return found


def gains(
    throws: Throws, conditions: Conditions, measures: Sequence[Measure], *, closing: float
) -> xr.Dataset:
    """Return a90 of each measure at each place beside the present one, best measure first.

    Parameters
    ----------
    throws : Throws
        Of the reference case.
    conditions : Conditions
        Without a measure.
    measures : sequence of Measure
        From `read_measure`.
    closing : float
        When the last closing begins [s].

    Returns
    -------
    xarray.Dataset
        `a90` by measure, "now" first, and place; `gain`, the mean reduction over places, and
        `gain_worst`, that of the place with the largest a90 [m]; each with the ends of its 95 %
        interval over drawn states. Where a measure is computed from the same states, they are
        drawn together.
    """
    whole = limit_map(throws, conditions, closing=closing)
    rows, gain, worst = [], [], []
    for item in measures:
        own = limit_map(
            item.throws, item.conditions,
            closing=closing, averaged=item.averaged, beside=item.beside,
        )  # fmt: skip
        rows.append(_a90(own, "a90"))
        base = whole
        if item.base is not None:
            base = limit_map(item.base, conditions, closing=closing)
        before, after = _with_resampled(base, throws), _with_resampled(own, item.throws)
        gain.append(_with_interval(np.mean(before - after, axis=-1)))
        worst.append(_with_interval(before.max(axis=-1) - after.max(axis=-1)))
    order = np.argsort([values[0] for values in gain], kind="stable")[::-1]
    ranked = [measures[number] for number in order]
    a90 = np.array([_a90(whole, "a90"), *(rows[number] for number in order)])
    dataset = xr.Dataset(
        {
            "a90": (("measure", "place"), a90),
            "note": (("measure",), ["as it is", *(item.note for item in ranked)]),
        },
        {"measure": ["now", *(item.name for item in ranked)], "place": list(throws.places)},
    )
    dataset["a90"].attrs |= {
        "units": "m", "long_name": "smallest size from which nine of ten objects are detected",
    }  # fmt: skip
    for name, values, text in (
        ("gain", gain, "mean reduction of a90 over places"),
        ("gain_worst", worst, "reduction of the largest a90"),
    ):
        each = np.array([np.zeros(3), *(values[number] for number in order)])
        for column, (end, of) in enumerate(ENDS.items()):
            said = {"units": "m", "long_name": of + text}
            dataset[name + end] = (("measure",), each[:, column], said)
    return dataset


ENDS = {"": "", "_low": "lower end of the 95 % interval: ", "_high": "upper end: "}
"""Of a gain: what its name ends with, and how its description begins."""


def _a90(found: xr.Dataset, name: str) -> Floats:
    return np.asarray(found[name].sel(channel="both drives").to_numpy(), dtype=np.float64)


def _with_resampled(found: xr.Dataset, throws: Throws) -> Floats:
    """Return a90 and below it those of drawn states; beyond the sizes thrown, the largest [m]."""
    a90 = np.vstack([_a90(found, "a90"), _a90(found, "a90_resampled")])
    return np.where(np.isfinite(a90), a90, throws.sizes.max(axis=1))


def _with_interval(values: Floats) -> Floats:
    """Return the first of some values and the ends of the 95 % interval of the others."""
    return np.array([values[0], *np.quantile(values[1:], [0.025, 0.975])])


def some_states(throws: Throws, kept: NDArray[np.bool_]) -> Throws:
    """Return the throws of some of the states with objects; sound throws all stay."""
    return replace(
        throws,
        states=throws.states[kept],
        change=throws.change[kept],
        force_peak=throws.force_peak[kept],
        gap=throws.gap[kept],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeat:
    """False alarms if a second throw must confirm the first.

    Attributes
    ----------
    correlation : float
        Of the statistic of two throws of one switch, median over places and states [-].
    rate : float
        Two alarms in a row, a sound throw [-].
    once_a_year, twice_a_year : float
        False alarms a switch and year with one throw, and with two [-].
    """

    correlation: float
    rate: float
    once_a_year: float
    twice_a_year: float


def repeated_throw(throws: Throws, conditions: Conditions, *, closing: float) -> Repeat:
    """Return the false alarms of a second throw, whose fixed part is that of the first.

    Parameters
    ----------
    throws : Throws
        Of the reference case.
    conditions : Conditions
        Discrepancy, history, rate of false alarms of one throw.
    closing : float
        When the last closing begins [s].
    """
    one, two = (
        sound_throws(throws, conditions, closing=closing, averaged=count) for count in (1, 2)
    )
    nearest = one.nearest(throws.level[throws.states])
    shares = []
    for state, level in enumerate(nearest):
        total = one.covariances[level]
        own = 2.0 * (total - two.covariances[level])
        signatures = one.features(throws.change[state].reshape(-1, *throws.change.shape[-2:]))
        given = np.isfinite(signatures).all(axis=1) & (np.abs(signatures).max(axis=1) > 0.0)
        weights = np.linalg.solve(total, signatures[given].T)
        each = np.einsum("ij,ij->j", weights, own @ weights)
        shares.append(1.0 - each / np.einsum("ij,ij->j", weights, total @ weights))
    correlation = float(np.clip(np.median(np.concatenate(shares)), 0.0, 1.0))
    alarms = conditions.false_alarm_rate
    rate = float(repeated_alarm_rate(correlation, false_alarm_rate=alarms))
    a_year = THROWS_A_DAY * DAYS
    return Repeat(
        correlation=correlation, rate=rate,
        once_a_year=alarms * a_year, twice_a_year=rate * a_year,
    )  # fmt: skip


Make = Callable[["re.Match[str]", Throws, Conditions, tuple[str, ...]], Measure]


def _second(match: "re.Match[str]", throws: Throws, conditions: Conditions, _: object) -> Measure:
    note = "mean of two throws with the object in place; what is fixed for a switch stays"
    return Measure(name=match[0], note=note, throws=throws, conditions=conditions, averaged=2)


def _history(match: "re.Match[str]", throws: Throws, conditions: Conditions, _: object) -> Measure:
    known = replace(conditions, history=int(match[1]))
    note = f"{match[1]} sound throws of this switch are known"
    return Measure(name=match[0], note=note, throws=throws, conditions=known)


def _better(match: "re.Match[str]", throws: Throws, conditions: Conditions, _: object) -> Measure:
    better = replace(conditions, discrepancy=float(match[1]) / 100.0)
    note = "a model, or a calibration, that comes this near to the switch"
    return Measure(name=match[0], note=note, throws=throws, conditions=better)


def _rate(match: "re.Match[str]", throws: Throws, conditions: Conditions, _: object) -> Measure:
    faster = replace(conditions, rate=float(match[1]))
    note = "more samples in each window of 40 ms: less noise, the same discrepancy"
    return Measure(name=match[0], note=note, throws=throws, conditions=faster)


def _friction(match: "re.Match[str]", throws: Throws, conditions: Conditions, _: object) -> Measure:
    kept = throws.level[throws.states] <= float(match[1])
    note = f"states whose mean friction is at most {match[1]}: {int(kept.sum())} of {kept.size}"
    return Measure(
        name=match[0], note=note, throws=some_states(throws, kept), conditions=conditions
    )


def _closing(
    match: "re.Match[str]", throws: Throws, conditions: Conditions, inputs: tuple[str, ...]
) -> Measure:
    columns = [number for number, name in enumerate(inputs) if name.endswith("over_travel_closed")]
    if not columns:
        message = f'what-if "{match[0]}": the closing over-travel does not vary in this case'
        raise StudyError([message], source="limit")
    travel = throws.switch[:, columns]
    more_than_usual = np.asarray(travel >= np.median(travel, axis=0))
    kept = np.asarray(more_than_usual.all(axis=1))[throws.states]
    more = 1e3 * (travel[throws.states][kept].mean() - travel.mean())
    note = f"states with more over-travel at every drive, {more:.1f} mm on average"
    return Measure(
        name=match[0], note=note, throws=some_states(throws, kept), conditions=conditions
    )


_NUMBER = r"(\d+(?:\.\d+)?)"
_FORMS: tuple[tuple[str, Make], ...] = (
    (r"second throw", _second),
    (r"history (\d+)", _history),
    (rf"discrepancy {_NUMBER} ?%", _better),
    (rf"rate {_NUMBER} ?Hz", _rate),
    (rf"friction {_NUMBER}", _friction),
    (r"closing force", _closing),
)


def gain_rows(dataset: xr.Dataset) -> list[Mapping[str, float | str]]:
    """Return name, gains with intervals [m] and meaning of each measure, best first."""
    return [
        {
            "measure": str(one["measure"].item()),
            **{
                name + end: float(one[name + end])
                for name in ("gain", "gain_worst")
                for end in ENDS
            },
            "note": str(one["note"].item()),
        }
        for one in (dataset.isel(measure=number) for number in range(1, dataset.sizes["measure"]))
    ]
