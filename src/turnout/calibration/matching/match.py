r"""Match a panel to facts, wave by wave; every panel tried is kept in a folder and never again.

Each throw of a panel is made once, costly facts only where all others hold.

Quadratic emulators of facts over the ranges say where to try next,

.. math:: y(z) = b_0 + b^T z + z^T B z + e, \qquad b \sim N(0, t_1^2), B \sim N(0, t_2^2),
          e \sim N(0, s^2)

with every parameter scaled to -1 ... 1; the three spreads maximise the marginal likelihood
(Rasmussen and Williams 2006, section 2.3, doi 10.7551/mitpress/3206.001.0001). What the emulator
leaves open is the root mean square of its leave-one-out residuals, which also covers that facts are
not quadratic.
Implausibility is as in history matching (Craig et al. 1997; Vernon et al. 2010, doi
10.1214/10-BA524), with the distance to an interval in place of that to a value.
"""

import gc
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.stats import qmc

from turnout.calibration.matching.facts import Facts, Sum, Term
from turnout.calibration.matching.measures import MEASURES, Thrown
from turnout.core.errors import FileError, PanelError, StudyError, TurnoutError
from turnout.core.kept_results import append_line, claim_for, read_lines
from turnout.core.progress import Pace, Report
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.panel.foreign_object import ForeignObject, parse_object
from turnout.panel.load import LoadedPanel, as_written
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

WALKERS, STEPS = 600, 120
"""Walkers of a wave, and steps of each after the region is reached."""
REGION_SHARE = 0.2
"""Share of the walkers that each narrower region starts from."""
CANDIDATES = 20_000
"""Points of the first region, which covers the ranges."""
MOST_REGIONS = 40
"""Regions at most: each holds a fifth of the one before, so 40 reach any share."""
MOST_FOR_SPREADS = 350
"""So many points are used to find the three spreads."""
LEAST_SPREAD, MOST_SPREAD = np.log(1e-3), np.log(100.0)
"""Bounds of the logarithms of the spreads, in standard deviations of the values."""
FEWEST = 30
"""Points below which no emulator is made."""


def monomials(points: Floats) -> Floats:
    """Return 1, each scaled parameter, and each product of two, at points of the unit cube.

    Examples
    --------
    >>> monomials(np.array([[1.0, 0.5]]))
    array([[1., 1., 0., 1., 0., 0.]])
    """
    z = 2.0 * points - 1.0
    rows, columns = np.triu_indices(z.shape[1])
    return np.column_stack([np.ones(len(z)), z, z[:, rows] * z[:, columns]])


def fit_emulator(
    points: Floats, values: Floats, *, rng: np.random.Generator
) -> tuple[Floats, float]:
    """Fit an emulator to values at points of the unit cube.

    Parameters
    ----------
    points : ndarray, shape (n, n_parameters)
        Shares of the ranges.
    values : ndarray, shape (n,)
        Of a fact; all finite.
    rng : numpy.random.Generator
        Chooses the points for the spreads.

    Returns
    -------
    coefficients : ndarray, shape (n_terms,)
        Of `monomials` [unit of the fact].
    error : float
        Root mean square of the leave-one-out residuals [unit of the fact].
    """
    spread = float(values.std())
    features = monomials(points)
    if spread == 0.0:
        flat = np.zeros(features.shape[1])
        flat[0] = values[0]
        return flat, 0.0
    y = (values - values.mean()) / spread
    count = points.shape[1]
    groups = (features[:, : 1 + count], features[:, 1 + count :])
    grams = tuple(group @ group.T for group in groups)
    some = rng.permutation(len(y))[:MOST_FOR_SPREADS]
    parts = tuple(gram[np.ix_(some, some)] for gram in grams)
    found = minimize(
        _misfit,
        np.log([0.3, 0.1, 0.2]),
        args=(parts, y[some]),
        method="Nelder-Mead",
        options={"maxfev": 80, "xatol": 0.05, "fatol": 0.1},
    )
    first, second, noise = _variances(found.x)
    factor = cho_factor(first * grams[0] + second * grams[1] + noise * np.eye(len(y)), lower=True)
    weights = cho_solve(factor, y)
    inverse = cho_solve(factor, np.eye(len(y)))
    left_out = weights / np.diag(inverse)
    coefficients = np.concatenate([first * groups[0].T @ weights, second * groups[1].T @ weights])
    coefficients *= spread
    coefficients[0] += values.mean()
    return coefficients, spread * float(np.sqrt(np.mean(left_out**2)))


def _variances(logs: Floats) -> Floats:
    """Return the squares of the three spreads; the noise is never so small that rounding counts."""
    return np.asarray(np.exp(2.0 * np.clip(logs, LEAST_SPREAD, MOST_SPREAD)))


def _misfit(logs: Floats, grams: tuple[Floats, ...], y: Floats) -> float:
    """Return the negative logarithm of the marginal likelihood, without its constant."""
    first, second, noise = _variances(logs)
    matrix = first * grams[0] + second * grams[1] + noise * np.eye(len(y))
    lower, _ = factor = cho_factor(matrix, lower=True)
    return float(0.5 * y @ cho_solve(factor, y) + np.log(np.diag(lower)).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emulation:
    """Emulators of several facts, evaluated together.

    Attributes
    ----------
    coefficients : ndarray, shape (n_terms, n_facts)
        Column by column.
    error, least, most : ndarray, shape (n_facts,)
        Of the emulators, and bounds of the facts.
    """

    coefficients: Floats
    error: Floats
    least: Floats
    most: Floats

    @classmethod
    def of(cls, emulators: Sequence[tuple[Floats, float]], facts: Sequence[Sum]) -> "Emulation":
        """Put emulators of `fit_emulator` and bounds side by side."""
        return cls(
            coefficients=np.column_stack([coefficients for coefficients, _ in emulators]),
            error=np.array([error for _, error in emulators]),
            least=np.array([fact.least for fact in facts]),
            most=np.array([fact.most for fact in facts]),
        )

    @property
    def deepest(self) -> float:
        """Implausibility half-way from the bounds to the middle of the narrowest fact.

        Below it there may be no point, however plausible: then walkers end up at one place.
        """
        return float(-DEPTH * ((self.most - self.least) / self._scale).min())

    @property
    def _scale(self) -> Floats:
        """Errors of the emulators, and what rounding leaves where they have none."""
        floor = 1e-9 * (1.0 + np.abs(self.coefficients).sum(axis=0))
        return np.asarray(np.maximum(self.error, floor))

    def implausibility(self, points: Floats) -> Floats:
        """Return the largest distance to a bound, in errors of its emulator, shape (n,).

        Negative where all predictions lie within their bounds: then by how many errors.
        """
        predicted = monomials(points) @ self.coefficients
        beyond = np.maximum(self.least - predicted, predicted - self.most)
        return np.asarray((beyond / self._scale).max(axis=1))


def latin_hypercube(count: int, dimensions: int, *, rng: np.random.Generator) -> Floats:
    """Return points spread evenly over the unit cube, shape (count, dimensions)."""
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(count))


def plausible_points(
    emulation: Emulation,
    count: int,
    *,
    start: Floats,
    limit: float,
    rng: np.random.Generator,
) -> tuple[Floats, float]:
    """Return points evenly drawn from where the implausibility is below a limit.

    Regions of falling implausibility are sampled one within the other, each by random walks that
    start from the most plausible fifth of the last (subset simulation, Au and Beck 2001, doi
    10.1016/S0266-8920(01)00019-4). The share of the unit cube follows as a product of shares.

    Parameters
    ----------
    emulation : Emulation
        Of all facts.
    count : int
        Points wanted.
    start : ndarray, shape (n, n_parameters)
        Points that are known to be plausible, from which walks start too; may be none.
    limit : float
        Of the implausibility, in errors of the emulators.
    rng : numpy.random.Generator
        Of the walks.

    Returns
    -------
    points : ndarray, shape (count, n_parameters)
        Within the unit cube.
    share : float
        Of the unit cube that is below the limit, estimated [-].
    """
    dimensions = start.shape[1]
    walkers = np.concatenate([latin_hypercube(CANDIDATES, dimensions, rng=rng), start])
    values = emulation.implausibility(walkers)
    share, level = 1.0, np.inf
    for _ in range(MOST_REGIONS):
        inside = values <= limit
        if inside.mean() >= REGION_SHARE:
            share *= float(inside.mean())
            walkers, values, level = walkers[inside], values[inside], limit
            break
        level = max(float(np.quantile(values, REGION_SHARE)), limit)
        kept = values <= level
        share *= float(kept.mean())
        walkers, values = walkers[kept], values[kept]
        chosen = rng.integers(len(walkers), size=WALKERS)
        walkers, values = _walk(
            emulation, walkers[chosen], values[chosen], level, STEPS // 3, rng=rng
        )
    chosen = rng.integers(len(walkers), size=WALKERS)
    walkers, values = walkers[chosen], values[chosen]
    walkers, values = _walk(emulation, walkers, values, max(level, limit), STEPS, rng=rng)
    return walkers[rng.permutation(len(walkers))[:count]], share


def _walk(
    emulation: Emulation,
    walkers: Floats,
    values: Floats,
    level: float,
    steps: int,
    *,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Walk at random within a region; steps follow the spread of the walkers."""
    count, dimensions = walkers.shape
    spread = np.cov(walkers.T) + 1e-8 * np.eye(dimensions)
    root = np.linalg.cholesky(spread)
    length = 2.38 / np.sqrt(dimensions)
    for _ in range(steps):
        size = length * np.exp(rng.normal(size=(count, 1)))
        trial = walkers + size * (rng.normal(size=(count, dimensions)) @ root.T)
        trial = np.abs((trial + 1.0) % 2.0 - 1.0)  # reflected at the ends of the ranges
        found = emulation.implausibility(trial)
        moved = found <= level
        walkers = np.where(moved[:, np.newaxis], trial, walkers)
        values = np.where(moved, found, values)
    return walkers, values


def farthest_points(points: Floats, count: int) -> list[int]:
    """Return the numbers of points that lie far from each other, the most central one first.

    Each next point is the one farthest from all chosen before (Gonzalez 1985, doi
    10.1016/0304-3975(85)90224-5).

    Examples
    --------
    >>> farthest_points(np.array([[0.5], [0.0], [1.0], [0.6], [0.4]]), 3)
    [0, 1, 2]
    """
    middle = np.median(points, axis=0)
    chosen = [int(np.argmin(np.linalg.norm(points - middle, axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


SAVE = Save(
    fields=(
        *("drive_force", "drive_displacement", "drive_gap", "end_gap", "sensor_gap"),
        *("object_force", "chair_normal_force", "force_margin", "drive_slipping"),
        *("in_control", "locked"),
        *("least_flangeway", "least_flangeway_x", "least_flangeway_rail"),
        *("least_gauge", "drive_current"),
    )
)
"""Outputs of a throw that measures need."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedPanel:
    """One panel that was tried.

    Attributes
    ----------
    point, values : tuple of float
        Shares of the ranges, and the facts in SI, NaN where a throw failed or none was made.
    accepted : bool
        Whether all facts hold.
    fault : str
        Why there are no values: the panel is refused, or a throw ended early; else empty.
    throws : int
        That were made.
    wave, number : int
        From 0, and its place among the panels of the wave.
    share : float
        Of the ranges that its wave was drawn from, as the emulators say [-].
    seconds : float
        Processor time [s].
    """

    point: tuple[float, ...]
    values: tuple[float, ...]
    accepted: bool
    fault: str
    throws: int
    wave: int = 0
    number: int = 0
    share: float = 1.0
    seconds: float = 0.0


@dataclass(slots=True)
class Thrower:
    """Throws of one panel by object and changed values, each made once.

    Attributes
    ----------
    panel : LoadedPanel
        Whose throws.
    by_machines : LoadedPanel, optional
        The same with drives that are machines, for measures of currents.
    """

    panel: LoadedPanel
    by_machines: LoadedPanel | None = None
    made: int = 0
    _values: dict[Term, float] = field(default_factory=dict)
    _thrown: dict[object, Thrown] = field(default_factory=dict)

    def sum(self, wanted: Sum) -> float:
        """Return the value of a sum."""
        return sum(term.factor * self._value(term) for term in wanted.terms)

    def _value(self, term: Term) -> float:
        if term not in self._values:
            self._values[term] = MEASURES[term.measure].compute(self._of(term), term.of)
        return self._values[term]

    def _of(self, term: Term) -> Thrown:
        """Return the throw that a measure is taken of."""
        item, changes, by_machines = term.throw
        if term.throw not in self._thrown:
            panel = (self.by_machines if by_machines else None) or self.panel
            panel = panel.with_overrides(dict(changes), si=False) if changes else panel
            dataset = self._throw(panel, parse_object(item) if item else None)
            self._thrown[term.throw] = Thrown(panel, dataset, partial(self._throw, panel))
        return self._thrown[term.throw]

    def _throw(self, panel: LoadedPanel, item: ForeignObject | None) -> "xr.Dataset":
        self.made += 1
        return simulate(panel, foreign_object=item, mode="quick", save=SAVE)


def panel_at(facts: Facts, point: Floats) -> LoadedPanel:
    """Return the panel at a point of the unit cube.

    Its values count as those of a file, so that throws may change them as they may a file's.

    Raises
    ------
    PanelError
        When its values contradict each other.
    """
    return as_written(facts.panel.with_overrides(facts.overrides(point)))


def thrower_at(facts: Facts, point: Floats) -> Thrower:
    """Return the throws of the panel at a point of the unit cube, and of its machines.

    Raises
    ------
    PanelError
        When its values contradict each other.
    """
    panel, values = panel_at(facts, point), facts.overrides(point, of_machines=True)
    return Thrower(panel, with_machines(facts, panel, values) if facts.machines else None)


def with_machines(
    facts: Facts, panel: LoadedPanel, values: Mapping[str, object] | None = None
) -> LoadedPanel:
    """Return a panel with the machines of the facts, and with values of these by key [SI] if any.

    Raises
    ------
    PanelError
        When the values of the machines do not go with the panel.
    """
    machines = panel.with_overrides(dict(facts.machines), si=False)
    return as_written(machines.with_overrides(values) if values else machines)


def is_valid(facts: Facts, point: Floats) -> bool:
    """Return whether the values at a point of the unit cube go together."""
    try:
        panel_at(facts, point)
    except PanelError:
        return False
    return True


def try_panel(facts: Facts, point: Floats, *, failures: int | None = None) -> TriedPanel:
    """Return the values of the facts for the panel at a point of the unit cube.

    Facts are tried in the order of the file, those that need fewer throws first, late ones last and
    only where all others hold.

    Parameters
    ----------
    facts : Facts
        What must hold.
    point : ndarray, shape (n_parameters,)
        Shares of the ranges, 0 to 1.
    failures : int, optional
        Facts after whose failure the rest is not tried; default all that are not late are.
    """
    values, fault = np.full(len(facts.facts), np.nan), ""
    thrower: Thrower | None = None
    try:
        thrower = thrower_at(facts, point)
        for number, value in fact_values(facts, thrower, failures=failures):
            values[number] = value
    except TurnoutError as error:
        fault = str(error).splitlines()[0]
        if thrower is None and isinstance(error, PanelError):
            fault = error.problems[0]
    return TriedPanel(
        point=tuple(map(float, point)),
        values=tuple(map(float, values)),
        accepted=all(map(holds, facts.facts, values)),
        fault=fault,
        throws=thrower.made if thrower else 0,
    )


def fact_values(
    facts: Facts, thrower: Thrower, *, failures: int | None = None
) -> Iterator[tuple[int, float]]:
    """Yield the numbers of facts and their values [SI], in the order of `try_panel`."""
    failed = 0
    for late in (False, True):
        chosen = in_order(facts, late=late)
        allowed = 1 if late else failures or len(chosen)
        for number in chosen:
            value = thrower.sum(facts.facts[number])
            failed += not holds(facts.facts[number], value)
            yield number, value
            if failed >= allowed:
                break
        if failed:
            break


def in_order(facts: Facts, *, late: bool) -> list[int]:
    """Return the numbers of facts in the order in which they are tried: cheap ones first."""
    chosen = [number for number, fact in enumerate(facts.facts) if fact.late is late]
    return sorted(chosen, key=lambda number: _cost(facts.facts[number]))


def _cost(fact: Sum) -> tuple[int, bool]:
    """Return the cost of a fact in throws, and whether it takes more than the plain one."""
    throws = {term.throw for term in fact.terms}
    further = {term: MEASURES[term.measure].cost - 1 for term in fact.terms}
    return len(throws) + sum(further.values()), throws != {("", (), False)}


def holds(fact: Sum, value: float) -> bool:
    """Return whether a value is within the bounds of a fact; NaN is not."""
    return bool(fact.least <= value <= fact.most)


FIRST_WAVE, WAVE = 160, 40
"""Panels of the first wave, which cover the ranges, and of each later one."""
CUT_OFFS = (3.0, 3.0, 2.0, 0.5, -0.5)
"""Implausibility up to which points are tried, in the waves after the first; the last holds on."""
MOST_TRAINING = 400
"""Panels at most that emulators are made of, as their work grows with the cube of these."""
SPARE = 4
"""Times the points of a wave that are drawn at most, to have enough whose values go together."""
FAR = 3.0
"""Values further from a bound than so many times the usual distance are taken as that far."""
DEPTH = 0.25
"""Share of the width of the narrowest fact that a cut-off lies within its bounds at most."""
FAILURES = 2
"""After the first wave, facts that fail until the rest is not tried."""
HEAD, TRIED = "match.json", "tried.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matching:
    """All panels that were tried.

    Attributes
    ----------
    facts : Facts
        What was asked.
    tried : tuple of TriedPanel
        In order.
    """

    facts: Facts
    tried: tuple[TriedPanel, ...]

    @property
    def points(self) -> Floats:
        """Points of the accepted panels, shape (n_accepted, n_parameters)."""
        found = [item.point for item in self.tried if item.accepted]
        return np.array(found).reshape(-1, len(self.facts.parameters))


def match_panel(
    facts: Facts,
    folder: Path,
    *,
    count: int = 200,
    most: int = 2000,
    workers: int | Workers = 1,
    report: Report | None = None,
) -> Matching:
    """Collect panels that meet all facts.

    Parameters
    ----------
    facts : Facts
        What is not known, and what must hold.
    folder : Path
        Keeps every panel that was tried; the same call goes on where it was interrupted.
    count : int
        Accepted panels wanted; the wave in which the last is found is finished.
    most : int
        Panels tried at most.
    workers : int or Workers
        Processes; with one, all is done in this one. Or those of `panel_workers`.
    report : callable, optional
        Called after every panel.

    Raises
    ------
    FileError
        When the folder holds a matching of other facts, or cannot be written.
    """
    names = [item.name for item in facts.parameters] + [item.name for item in facts.facts]
    identity = {"name": facts.name, "digest": facts.digest, "columns": names}
    claim_for(folder, HEAD, identity, what="matching")
    tried = _read(folder, facts)
    pace, wave = Pace(report), 0
    with panel_workers(facts, workers) as processes:
        while True:
            before = [item for item in tried if item.wave < wave]
            accepted = sum(item.accepted for item in before)
            if accepted >= count or len(before) >= most:
                return Matching(facts=facts, tried=tuple(tried))
            wanted = min(WAVE if wave else FIRST_WAVE, most - len(before))
            there = {item.number for item in tried if item.wave == wave}
            stage = f"wave {wave + 1}, {accepted} of {count} panels accepted before"
            pace.begin(stage, wanted, there=len(there))
            if len(there) < wanted:
                missing = [number for number in range(wanted) if number not in there]
                for made in _missing_panels(facts, before, wave, missing, processes):
                    append_line(folder / TRIED, made)
                    tried.append(made)
                    pace.count(stage, failed=bool(made.fault), cost=made.seconds)
                tried.sort(key=lambda item: (item.wave, item.number))
            wave += 1


def _missing_panels(
    facts: Facts, before: list[TriedPanel], wave: int, missing: Sequence[int], processes: Workers
) -> Iterator[TriedPanel]:
    """Try panels of a wave by their numbers, and yield them as they are done."""
    with one_blas_thread():  # small matrices: threads would take ten times as long
        points, share = _points(facts, before, wave)
    if not len(points):
        message = "the emulators leave no panel whose values go together; widen the ranges"
        raise StudyError([message], source=facts.name)
    jobs = [
        partial(_try, points[number], wave, number, share)
        for number in missing
        if number < len(points)
    ]
    for _, made in processes.run(jobs):
        yield made


def _points(facts: Facts, before: list[TriedPanel], wave: int) -> tuple[Floats, float]:
    """Return the points of a wave, and the share of the ranges that they are drawn from."""
    rng = np.random.default_rng([facts.seed, wave])
    if not wave:
        return latin_hypercube(FIRST_WAVE, len(facts.parameters), rng=rng), 1.0
    emulation = emulation_of(facts, before, wave)
    known = [item.point for item in before if item.accepted]
    points, share = plausible_points(
        emulation,
        SPARE * WAVE,
        start=np.array(known).reshape(-1, len(facts.parameters)),
        limit=max(CUT_OFFS[min(wave, len(CUT_OFFS)) - 1], emulation.deepest),
        rng=rng,
    )
    valid: list[Floats] = []
    for point in points:
        if len(valid) < WAVE and is_valid(facts, point):
            valid.append(point)
    return np.array(valid).reshape(-1, len(facts.parameters)), share


def emulation_of(facts: Facts, before: Sequence[TriedPanel], wave: int) -> Emulation:
    """Fit emulators to panels that were tried, to those nearest to meeting the facts if many.

    Parameters
    ----------
    facts : Facts
        What must hold.
    before : sequence of TriedPanel
        Panels of earlier waves.
    wave : int
        For which it is.

    Returns
    -------
    Emulation
        Of the facts that are not late, in their order.

    Raises
    ------
    StudyError
        When too few panels gave facts.
    """
    rng = np.random.default_rng([facts.seed, wave, 1])
    early = [number for number, fact in enumerate(facts.facts) if not fact.late]
    usable = [item for item in before if not item.fault]
    if len(usable) < FEWEST:
        faults = {item.fault for item in before if item.fault}
        message = (
            f"only {len(usable)} of {len(before)} panels gave facts; "
            f"{next(iter(faults), 'no throw failed')}; narrow the ranges"
        )
        raise StudyError([message], source=facts.name)
    points = np.array([item.point for item in usable])
    values = np.array([item.values for item in usable])
    order = np.argsort(_misses(facts, values, early), kind="stable")
    found = []
    for number in early:
        near = order[np.isfinite(values[order, number])][:MOST_TRAINING]
        near_bounds = _clipped(facts.facts[number], values[near, number])
        found.append(fit_emulator(points[near], near_bounds, rng=rng))
    return Emulation.of(found, [facts.facts[number] for number in early])


def _clipped(fact: Sum, values: Floats) -> Floats:
    """Return values of which none is far outside the bounds, where a fact may bend.

    A drive that slips moves on at nearly constant force: its slip travel grows ten times as fast as
    before. Only where it begins matters.
    """
    beyond = np.maximum(fact.least - values, values - fact.most)
    reach = FAR * float(np.median(np.abs(beyond)))
    return np.clip(values, fact.least - reach, fact.most + reach)


def _misses(facts: Facts, values: Floats, early: list[int]) -> Floats:
    """Return by how much panels miss the facts that were tried, in their deviations, summed."""
    total = np.zeros(len(values))
    for number in early:
        fact, column = facts.facts[number], values[:, number]
        beyond = np.maximum(fact.least - column, column - fact.most)
        total += np.nan_to_num(np.maximum(beyond, 0.0) / (np.nanstd(column) or 1.0))
    return total


_facts: list[Facts] = []
"""Of the panels that this process tries; sent once."""


def begin_panels(facts: Facts) -> None:
    """Keep the facts that panels of this process are held against."""
    _facts[:] = [facts]
    gc.enable()


@contextmanager
def panel_workers(facts: Facts, workers: int | Workers) -> Iterator[Workers]:
    """Give the processes that try panels; one works in this process."""
    begin_panels(facts)
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(workers if workers > 1 else 0, facts, prepare=begin_panels) as found:
        yield found


def panel_facts() -> Facts:
    """Return the facts that panels of this process are held against."""
    return _facts[0]


def _try(point: Floats, wave: int, number: int, share: float) -> TriedPanel:
    began = time.process_time()
    found = try_panel(panel_facts(), point, failures=FAILURES if wave else None)
    seconds = time.process_time() - began
    return replace(found, wave=wave, number=number, share=share, seconds=seconds)


def _read(folder: Path, facts: Facts) -> list[TriedPanel]:
    """Read the panels that were tried; those of older files are in the order of their numbers."""
    path, found = folder / TRIED, list[TriedPanel]()
    counted = Counter[int]()
    for line, record in enumerate(read_lines(path), 1):
        try:
            record.setdefault("number", counted[record["wave"]])
            counted[record["wave"]] += 1
            record["point"] = tuple(map(float, record["point"]))
            record["values"] = tuple(map(float, record["values"]))
            item = TriedPanel(**record)
        except (ValueError, TypeError, KeyError) as error:
            message = f"{path}, line {line}: is damaged ({error}); remove the line or the folder"
            raise FileError(message) from None
        if len(item.values) != len(facts.facts) or len(item.point) != len(facts.parameters):
            message = f"{path}, line {line}: belongs to other facts; name another folder"
            raise FileError(message)
        found.append(item)
    return sorted(found, key=lambda item: (item.wave, item.number))
