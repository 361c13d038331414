r"""Plan a day of tests on the track: which objects where, in which order, and what it will show.

The forces of a throw are linear in a few parameters of the switch near its present state:

.. math:: y_j = m_j + J_j \theta + \delta + e_j, \qquad
    \theta \sim N(0, P), \quad \delta \sim N(0, D), \quad e_j \sim N(0, R)

with the sensitivities :math:`J_j` of throw :math:`j`, the part :math:`\delta` of the discrepancy
that is fixed for the switch, and errors that differ from throw to throw. How well a test determines
:math:`\theta` follows without its outcome (Fisher information; Chaloner and Verdinelli 1995,
Statistical Science 10, 273-304). The detection index of an object grows along a straight line with
its size; throws of several sizes at a place determine that line, and so a90 there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from turnout.core.errors import StudyError
from turnout.core.progress import Pace
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.detection.conditioning import conditioned
from turnout.detection.features import (
    discrepancy_covariance,
    features_of,
    noise_covariance,
    window_means,
)
from turnout.detection.limit.bound import detection_index
from turnout.detection.reference import FRICTION, Conditions, reference_study, slip_level_key
from turnout.detection.throws import closing_time, places_of
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.study.throw_table import compile_throws, thrown

Floats = NDArray[np.float64]
Report = Callable[[int, int], None]

GRID_SIZES = tuple(round(5e-3 + 2.6e-3 * number, 4) for number in range(11))
"""Sizes of a full grid, 5 to 31 mm as in the paper [m]."""
SIZES = (1e-3, 2e-3, 3.5e-3, *GRID_SIZES)
"""Among which a plan chooses [m]."""
SOUND_EACH = 6
"""One throw in so many is sound: they give the history and show drift."""
NO_OBJECT = "none"
GROUPED = 4
"""Windows whose mean is one feature here: a plan compares thousands of lists of throws."""
LEAST_INDEX = 1.0
"""Detection index from which an object counts as touched in the plan [-]."""
SLOPE_DOUBT, SWITCH_DOUBT = 0.5, 2.0
"""Prior deviation of the slope of the index over size, as a share, and of its intercept [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A value of the switch that the day shall determine.

    Attributes
    ----------
    name : str
        Key of the panel.
    step : float
        For the sensitivity: added to the value, or a factor less 1 where `share`.
    deviation : float
        Before the day, in the unit of `step`.
    share : bool
        Whether step and deviation are shares of the value.
    """

    name: str
    step: float
    deviation: float
    share: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """Throws among which a plan chooses.

    Attributes
    ----------
    place : tuple of str
        "none" for the sound throw, which is the first.
    size : ndarray, shape (n_candidates,)
        [m]
    features : ndarray, shape (n_candidates, n_features)
        Mean forces over windows [N].
    sensitivity : ndarray, shape (n_candidates, n_features, n_parameters)
        Change of the features for one prior deviation of each parameter [N].
    slips : ndarray of bool, shape (n_candidates,)
        Whether a drive slips.
    fixed, own : ndarray, shape (n_features, n_features)
        Covariance of errors that are fixed for the switch, and of those of a throw [N^2].
    parameters : tuple of Parameter
    false_alarm_rate : float
    """

    place: tuple[str, ...]
    size: Floats
    features: Floats
    sensitivity: Floats
    slips: NDArray[np.bool_]
    fixed: Floats
    own: Floats
    parameters: tuple[Parameter, ...]
    false_alarm_rate: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Knowledge:
    """Values that a list of throws determines.

    Attributes
    ----------
    deviations : ndarray, shape (n_parameters,)
        Of the parameters afterwards, as shares of those before [-].
    a90 : mapping of str to tuple of float
        By place: the size that the bound detects in 90 %, and its upper 95 % limit [m].
    throws : int
    """

    deviations: Floats
    a90: Mapping[str, tuple[float, float]]
    throws: int

    @property
    def criterion(self) -> float:
        """Sum of the logarithms of all remaining uncertainties; smaller is better."""
        doubts = [max(high - value, 1e-5) for value, high in self.a90.values()]
        return float(np.log(self.deviations).sum() + np.log(np.array(doubts) / 1e-3).sum())


def parameters_of(panel: LoadedPanel) -> tuple[Parameter, ...]:
    """Return friction, and stiffness, slip level and closing over-travel of each drive.

    Deviations are those of the reference case. The slip level of a drive that is a machine is that
    of its clutch, which drives of one machine share.
    """
    found = {FRICTION: Parameter(name=FRICTION, step=0.02, deviation=0.115, share=False)}
    for name, drive in panel.drive.items():
        key = f"drive.{name}"
        own = (
            Parameter(name=f"{key}.stiffness", step=0.05, deviation=0.05, share=True),
            Parameter(name=slip_level_key(name, drive), step=0.03, deviation=0.03, share=True),
            Parameter(name=f"{key}.over_travel_closed", step=3e-4, deviation=5.8e-4, share=False),
        )
        found |= {item.name: item for item in own}
    return tuple(found.values())


def candidates(
    panel: LoadedPanel | None = None,
    *,
    conditions: Conditions | None = None,
    sizes: Sequence[float] = SIZES,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> Candidates:
    """Simulate the throws among which a plan chooses, with their sensitivities.

    Parameters
    ----------
    panel : LoadedPanel, optional
        None for the panel of the reference case.
    conditions : Conditions, optional
        Discrepancy, noise, rate of false alarms.
    sizes : sequence of float
        At each place [m].
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    conditions = conditions if conditions is not None else Conditions()
    study = reference_study(panel, count=1)
    nominal = study.panel
    parameters = parameters_of(nominal)
    tests = [(NO_OBJECT, 0.0)]
    tests += [(place, float(size)) for place in places_of(nominal) for size in sizes]
    tests = [item for item in tests if _fits(nominal, *item)]
    panels = {"nominal": nominal} | {item.name: _changed(nominal, item) for item in parameters}
    anywhere = next(iter(places_of(nominal)))
    rows = [(place if size else anywhere, size) for place, size in tests]
    studies = {
        name: compile_throws(
            changed, ("object.at", "object.size"), scheme=study.scheme,
            channels=("drive_force", "drive_slipping"), rate=conditions.rate,
        ).study(rows, name=name)
        for name, changed in panels.items()
    }  # fmt: skip
    made = thrown(studies, workers=workers, pace=pace)
    planned = slice(None, nominal.schedule.end + 1e-9)  # machines may run on with an object
    made = {name: item.sel(time=planned) for name, item in made.items()}
    ended = np.all([item["outcome"].astype(str) == "complete" for item in made.values()], axis=0)
    if not ended[0]:
        message = f"the throw without an object did not end: {made['nominal']['reason'].item(0)}"
        raise StudyError([message], source="plan-test")
    tests = [test for test, kept in zip(tests, ended, strict=True) if kept]
    forces = [item["drive_force"].to_numpy()[ended].astype(np.float64) for item in made.values()]
    force, slipping = np.array(forces), made["nominal"]["drive_slipping"].to_numpy()[ended]
    slips = np.any(slipping > 0, axis=(1, 2))
    time = made["nominal"]["time"].to_numpy()
    means = _grouped(window_means(time, closing=closing_time(nominal)))
    features = features_of(force, means)
    scale = np.array([item.deviation / item.step for item in parameters])
    change = np.moveaxis(features[1:] - features[0], 0, -1) * scale
    amplitude = np.abs(force[0, 0]).max(axis=-1)
    total = discrepancy_covariance(time, means, amplitude=amplitude, conditions=conditions)
    noise = noise_covariance(
        means,
        noise=np.full(len(amplitude), conditions.noise),
        conditions=conditions,
        sampled=conditions.rate,
    )
    return Candidates(
        place=tuple(place for place, _ in tests),
        size=np.array([size for _, size in tests]),
        features=features[0],
        sensitivity=change,
        slips=np.asarray(slips),
        fixed=conditions.fixed_share * total,
        own=(1.0 - conditions.fixed_share) * total + noise,
        parameters=parameters,
        false_alarm_rate=conditions.false_alarm_rate,
    )


def _fits(panel: LoadedPanel, place: str, size: float) -> bool:
    from turnout.core.errors import PanelError

    try:
        resolve_objects(panel, _objects(place, size))
    except PanelError:
        return False
    return True


def _objects(place: str, size: float) -> tuple[ForeignObject, ...]:
    return () if place == NO_OBJECT else (ForeignObject(size=size, at=place),)


def _changed(panel: LoadedPanel, item: Parameter) -> LoadedPanel:
    """Return a panel with one parameter a step away from its mean over the members."""
    value = float(np.mean(list(panel.values_at(item.name).values())))
    moved = value * (1.0 + item.step) if item.share else value + item.step
    return panel.with_overrides({item.name: moved})


def _grouped(means: Floats) -> Floats:
    """Return means over some successive windows together."""
    count = len(means) // GROUPED
    return np.asarray(means[: count * GROUPED].reshape(count, GROUPED, -1).mean(axis=1))


def known_after(of: Candidates, chosen: Sequence[int]) -> Knowledge:
    """Return what some throws determine.

    Parameters
    ----------
    of : Candidates
        From `candidates`.
    chosen : sequence of int
        Rows of it, a row as often as it is thrown.
    """
    with one_blas_thread():
        found = _prior(of)
        for row, times in zip(*np.unique(np.asarray(chosen, dtype=np.intp), return_counts=True),
                              strict=True):  # fmt: skip
            found = _updated(of, found, int(row), int(times))
        return _knowledge(of, found, list(chosen))


def plan(of: Candidates, throws: int, *, report: Report | None = None) -> list[int]:
    """Choose throws one by one, each the one that determines most; return their rows.

    One in `SOUND_EACH` is sound, whatever it determines.

    Parameters
    ----------
    of : Candidates
        From `candidates`.
    throws : int
        Of the day.
    report : callable, optional
        Called with throws chosen and of how many.
    """
    if throws < 1:
        message = f"throws = {throws}: must be 1 or more"
        raise StudyError([message], source="plan-test")
    chosen: list[int] = []
    with one_blas_thread():
        found = _prior(of)
        for done in range(1, throws + 1):
            gain = [
                _parameter_gain(of, found, row) + _size_gain(of, found, chosen, row)
                for row in range(len(of.place))
            ]
            best = 0 if done % SOUND_EACH == 1 else int(np.argmax(gain))
            chosen.append(best)
            found = _updated(of, found, best, 1)
            if report is not None:
                report(done, throws)
    return chosen


def _prior(of: Candidates) -> Floats:
    """Return the covariance of parameters, in prior deviations, and the fixed discrepancy."""
    count = len(of.parameters)
    found = np.zeros((count + len(of.fixed), count + len(of.fixed)))
    found[:count, :count] = np.eye(count)
    found[count:, count:] = of.fixed
    return found


def _updated(of: Candidates, known: Floats, row: int, times: int) -> Floats:
    way = np.hstack([of.sensitivity[row], np.eye(len(of.fixed))])
    return conditioned(known, way=way, error=of.own / times)


def _parameter_gain(of: Candidates, known: Floats, row: int) -> float:
    """Return by how much the logarithms of the deviations of all parameters fall."""
    count = len(of.parameters)
    way = np.hstack([of.sensitivity[row], np.eye(len(of.fixed))])
    crossed = way @ known[:, :count]
    total = way @ known @ way.T + of.own
    left = np.diag(known)[:count] - np.einsum("ij,ij->j", crossed, np.linalg.solve(total, crossed))
    return float(-0.5 * np.log(np.maximum(left, 1e-12) / np.diag(known)[:count]).sum())


def _size_gain(of: Candidates, known: Floats, chosen: Sequence[int], row: int) -> float:
    """Return by how much the logarithm of the uncertainty of a90 at that place falls."""
    place = of.place[row]
    if place == NO_OBJECT:
        return 0.0
    own = [item for item in chosen if of.place[item] == place]
    before, after = (_a90(of, known, place, rows) for rows in (own, [*own, row]))
    if not np.isfinite(before[0]):
        return 0.0
    doubts = [max(high - size, 1e-5) for size, high in (before, after)]
    return float(np.log(doubts[0] / doubts[1]))


def index_line(of: Candidates, place: str) -> tuple[float, float, NDArray[np.intp]]:
    """Return intercept and slope of the detection index over size, and the rows that are on it."""
    rows = np.array([row for row, name in enumerate(of.place) if name == place], dtype=np.intp)
    index = detection_index(of.features[rows] - of.features[0], of.fixed + of.own)
    on = rows[(index > LEAST_INDEX) & ~of.slips[rows]]
    if on.size < 2:
        on = rows[index > LEAST_INDEX][:2]
    if on.size < 2:
        return np.nan, np.nan, on
    heights = detection_index(of.features[on] - of.features[0], of.fixed + of.own)
    slope, intercept = np.polyfit(of.size[on], heights, 1)
    return float(intercept), float(slope), on


def _a90(of: Candidates, known: Floats, place: str, rows: Sequence[int]) -> tuple[float, float]:
    """Return a90 of the bound at a place, and its upper 95 % limit after some throws.

    All throws of the day determine what is fixed for the switch, and so the intercept at every
    place; those at the place whose response lies on the line determine its slope. One at which a
    drive slips is censored far above the threshold: it does not contribute to the slope.
    """
    intercept, slope, on = index_line(of, place)
    if not slope > 0.0:
        return float("nan"), float("nan")
    needed = ndtri(1.0 - of.false_alarm_rate) + ndtri(0.9)
    size = (needed - intercept) / slope
    middle = float(of.size[on].mean())
    doubt_of_switch = SWITCH_DOUBT**2 * max(_remaining(of, known, int(on[0])), LEAST_DOUBT)
    precision = np.diag([1.0 / doubt_of_switch, 1.0 / (SLOPE_DOUBT * slope) ** 2])
    for row in rows:
        if row in on:
            way = np.array([1.0, of.size[row] - middle])
            precision = precision + np.outer(way, way)
    way = np.array([1.0, size - middle])
    doubt = np.sqrt(way @ np.linalg.solve(precision, way)) / slope
    return max(float(size), 0.0), max(float(size + 1.6449 * doubt), 0.0)


def _remaining(of: Candidates, known: Floats, row: int) -> float:
    """Return what is left of the variance, fixed for the switch, of the index of a throw [-]."""
    weights = np.linalg.solve(of.fixed + of.own, of.features[row] - of.features[0])
    way = weights @ np.hstack([of.sensitivity[row], np.eye(len(of.fixed))])
    before = way @ _prior(of) @ way
    return float(way @ known @ way / before) if before > 0.0 else 1.0


LEAST_DOUBT = 0.01
"""Share of the variance of the intercept that no number of throws removes: objects differ [-]."""


def _knowledge(of: Candidates, known: Floats, chosen: Sequence[int]) -> Knowledge:
    places = [name for name in dict.fromkeys(of.place) if name != NO_OBJECT]
    found = {
        place: _a90(of, known, place, [row for row in chosen if of.place[row] == place])
        for place in places
    }
    return Knowledge(
        deviations=np.sqrt(np.diag(known)[: len(of.parameters)]),
        a90={place: value for place, value in found.items() if np.isfinite(value[0])},
        throws=len(chosen),
    )


def ordered(of: Candidates, chosen: Sequence[int]) -> list[int]:
    """Return throws in the order of the day.

    Half of the sound throws come first, so that a history is known; then place by place from the
    toe with rising sizes; objects at which a drive slips come last, since slip may move an
    adjustment. The other sound throws follow places at even distances, the last one at the end:
    they show drift.
    """
    sound = [row for row in chosen if of.place[row] == NO_OBJECT]
    calm = [row for row in chosen if of.place[row] != NO_OBJECT and not of.slips[row]]
    rough = [row for row in chosen if of.place[row] != NO_OBJECT and of.slips[row]]
    first = (len(sound) + 1) // 2
    found, spare = sound[:first], sound[first:]
    stays = [
        sorted((row for row in group if of.place[row] == place), key=lambda row: of.size[row])
        for group in (calm, rough)
        for place in dict.fromkeys(of.place)
        if any(of.place[row] == place for row in group)
    ]
    for number, stay in enumerate(stays):
        before, after = (len(spare) * count // len(stays) for count in (number, number + 1))
        found += [*stay, *spare[before:after]]
    return found if stays else found + spare


def full_grid(of: Candidates) -> list[int]:
    """Return the rows of every size at every sleeper once, as in the paper's campaign."""
    return [
        row
        for row, place in enumerate(of.place)
        if place.startswith("sleeper") and np.isclose(of.size[row], GRID_SIZES).any()
    ]
