"""Evidence for each cause of a misfit, tried with values adjusted to first order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from turnout.calibration.candidate_causes import Cause, level_key
from turnout.calibration.comparison import predicted
from turnout.calibration.evaluate import Response, with_change
from turnout.calibration.fit import Fit
from turnout.calibration.misfit import Frame, Misfit, about_clock, framed, jacobian
from turnout.calibration.shared import effective_samples, model_error
from turnout.calibration.stages import Parameter, prior_residuals, prior_slopes

Floats = NDArray[np.float64]
# How often the levels of the movements are estimated again in a trial.
LEVEL_PASSES = 2
# Steps of a search for the likeliest size of a cause, each without a throw.
REFINING_STEPS = 8
# A drive slips within this share of its level, over so many bins; a level of a movement is no
# further off [-].
SLIPS, LEAST_SLIPPING, FURTHEST_LEVEL = 0.005, 3, 0.25
# A drive that reaches the first share of its level, and is measured below the second share of
# that, has slipped at less [-].
NEARLY, LOWER = 0.85, 0.98


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TestedCause:
    """Evidence for one cause.

    Attributes
    ----------
    cause : Cause
        That was tried.
    sizes : tuple of float
        Its likeliest, in the units of its parameters; none where each movement has its own.
    gain : float
        By how much it lowers the Bayesian information criterion [-].
    fitted : bool
        Whether it was fitted together with all values.
    beside : mapping of str to float
        Values with which it was tried, where they are not those of the fit.
    """

    cause: Cause
    sizes: tuple[float, ...]
    gain: float
    fitted: bool = False
    beside: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def text(self) -> str:
        """The cause at its sizes, as a sentence."""
        return self.cause.text(self.sizes)

    @property
    def values(self) -> dict[str, float]:
        """Values with which a fit with it begins, where they are not those of the fit before."""
        own = zip((item.name for item in self.cause.parameters), self.sizes, strict=True)
        return {**self.beside, **dict(own)}

    def as_fitted(self, found: Fit) -> "TestedCause":
        """Return the cause at the sizes that were fitted."""
        return replace(self, sizes=self.cause.sizes_in(found.values), fitted=True)

    @property
    def line(self) -> str:
        """Return the cause as a line for the screen."""
        state = "fitted with the values" if self.fitted else "possible"
        return f"{self.name}: {self.text} ({state}, BIC {self.gain:.0f} lower)"


def with_cause(misfit: Misfit, cause: Cause) -> Misfit:
    """Return a misfit with a cause beside those that it has."""
    law, shape = misfit.law, misfit.shape
    if cause.law is not None:
        one, other = misfit.law, cause.law
        law = other if one is None else (lambda values: {**one(values), **other(values)})
    if cause.shape is not None:
        before, after = misfit.shape, cause.shape
        shape = (
            after
            if before is None
            else (lambda response, values: after(before(response, values), values))
        )
    return replace(
        misfit,
        parameters=(*misfit.parameters, *cause.parameters),
        base={**misfit.base, **{item.name: item.start for item in cause.parameters}},
        law=law,
        shape=shape,
        always=(*misfit.always, *(item.name for item in cause.parameters if not item.keys)),
        comparison=replace(
            misfit.comparison, scatter={**misfit.comparison.scatter, **cause.scatter}
        ),
    )


def cause_trials(
    found: Fit, causes: Sequence[Cause], *, most: int, decisive: float
) -> list[list[TestedCause]]:
    """Try causes at their sizes, with all values adjusted to first order; the likeliest first.

    Only the change that a cause makes is thrown, quickly: what quick throws are off by is off
    alike with the cause and without, and is taken from both. Causes that change forces in
    proportion are chosen together, one after the other, since one may show only where another is
    known; each other cause is tried alone.

    Parameters
    ----------
    found : Fit
        What misses something.
    causes : sequence of Cause
        To be tried.
    most : int
        Causes of a choice at most.
    decisive : float
        Difference of the criterion from which on a cause is chosen [-].

    Returns
    -------
    list of list of TestedCause
        Choices of one or several causes, the likeliest choice first; then what is left.
    """
    known = about_clock(found.misfit, found.frame)
    before = _judging(known)
    frame = framed(found.local, before, passes=1)
    names = [item.name for item in found.parameters]
    J = jacobian(found.local, frame, names)
    r = before.residuals_of(found.local.simulated, frame)
    samples = effective_samples(frame.alignments, before.comparison)
    plain = _adjusted(r, J, frame)
    origin = replace(found.misfit, quick=True).responses([found.values])[0]
    linear, single = [], []
    for cause in causes:
        misfit = _judging(with_cause(known, cause))
        if cause.smooth:
            rows = _changed(found, misfit, _steps_of(cause, found.values), origin)
            if not any(item.failure for row in rows for item in row):
                columns = [before.residuals_of(row, frame) - r for row in rows]
                linear.append((cause, np.column_stack(columns) * _shares_of(cause)))
            continue
        trial, best = _tried(found, cause, misfit, origin)
        gain = plain - best - max(len(cause.sized), 1) * float(np.log(samples))
        single.append([replace(trial, gain=gain)])
    chosen = _chosen_together(r, J, linear, samples=samples, most=most, decisive=decisive)
    return sorted([*chosen, *single], key=lambda choice: -sum(item.gain for item in choice))


def one_of_alike(choices: Sequence[Sequence[TestedCause]]) -> list[Sequence[TestedCause]]:
    """Return the likeliest choice of causes much alike, in their order, and all others."""
    groups = [(choice[0].cause.group, choice[0].cause.drives) for choice in choices]
    return [
        choice
        for number, choice in enumerate(choices)
        if not choice[0].cause.group or groups[number] not in groups[:number]
    ]


def _tried(
    found: Fit, cause: Cause, misfit: Misfit, origin: Sequence[Response]
) -> tuple[TestedCause, float]:
    """Return a cause at its likeliest size, and minus twice the log-likelihood with it."""
    if not cause.parameters:
        drive = next(iter(cause.scatter)).split(".")[1]
        return TestedCause(cause=cause, sizes=(), gain=0.0), _with_own_levels(found, misfit, drive)
    others = tuple(item.start for item in cause.parameters[1:])
    trials = []
    for sizes in ((size, *others) for size in cause.tries):
        # How much of a cause other values took up is not known: none of it, or all.
        near = [{}, cause.beside(found.values, sizes)] if cause.beside else [{}]
        trials += [TestedCause(cause=cause, sizes=sizes, gain=0.0, beside=b) for b in near]
    points = [{**found.values, **trial.values} for trial in trials]
    thrown = cause.law is not None
    rows = _changed(found, misfit, points, origin) if thrown else misfit.responses(points)
    results = [(_judged(found, misfit, row), number) for number, row in enumerate(rows)]
    best, number = min(results, default=(float("inf"), 0))
    if cause.refined and np.isfinite(best):
        size, best = _refined(found, misfit, cause, number, best)
        return replace(trials[number], sizes=(size, *others)), best
    return trials[number], best


def _judged(found: Fit, misfit: Misfit, row: Sequence[Response]) -> float:
    """Return minus twice the log-likelihood of responses; infinite where one failed."""
    if any(item.failure for item in row):
        return float("inf")
    there = framed(replace(found.local, simulated=tuple(row)), misfit, passes=1)
    slopes = jacobian(found.local, there, [item.name for item in found.parameters])
    return _adjusted(misfit.residuals_of(row, there), slopes, there)


def _refined(
    found: Fit, misfit: Misfit, cause: Cause, number: int, best: float
) -> tuple[float, float]:
    """Return the likeliest size about one that was tried, and what `_judged` says of it."""
    parameter = cause.parameters[0]
    tries = (0.5 * cause.tries[0], *cause.tries, min(2.0 * cause.tries[-1], parameter.upper))

    def cost(size: float) -> float:
        point = {**found.values, parameter.name: float(np.exp(size))}
        return _judged(found, misfit, misfit.responses([point])[0])

    near = minimize_scalar(
        cost,
        bounds=(np.log(tries[number]), np.log(tries[number + 2])),
        method="bounded",
        options={"maxiter": REFINING_STEPS, "xatol": 0.02},
    )
    if near.fun < best:
        return float(np.exp(near.x)), float(near.fun)
    return cause.tries[number], best


def _steps_of(cause: Cause, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return values with each parameter of a cause at the size that is tried, alone."""
    start = {item.name: item.start for item in cause.parameters}
    pairs = zip(cause.parameters, cause.tries, strict=True)
    return [{**values, **start, item.name: size} for item, size in pairs]


def _shares_of(cause: Cause) -> list[float]:
    """Return one `_scale` of each parameter of a cause as a share of the step that is tried."""
    pairs = zip(cause.parameters, cause.tries, strict=True)
    return [
        _scale(item, size) / (item.coordinate(size) - item.coordinate(item.start))
        for item, size in pairs
    ]


def _scale(parameter: Parameter, size: float) -> float:
    """Return the deviation of a parameter's prior, or the size that is tried [coordinate]."""
    step = abs(parameter.coordinate(size) - parameter.coordinate(parameter.start))
    return parameter.prior_width if parameter.prior else step


def _chosen_together(
    r: Floats,
    J: Floats,
    linear: Sequence[tuple[Cause, Floats]],
    *,
    samples: float,
    most: int,
    decisive: float,
) -> list[list[TestedCause]]:
    r"""Choose causes one after the other, those chosen and all values adjusted with each.

    With the columns `A` of parameters that have priors, in their deviations, and `A'` what of them
    no value can imitate, they are integrated out,

    .. math:: D = \min_{\theta, a} \|r + J \theta + A a\|^2 + \|a\|^2 + \ln\det(I + A'^T A'),

    a parameter without a prior costs :math:`\ln n`.
    """
    if not linear:
        return []
    Q = np.linalg.qr(J)[0]
    rest = r - Q @ (Q.T @ r)
    blocks = [A - Q @ (Q.T @ A) for _, A in linear]

    def deviance(numbers: Sequence[int]) -> tuple[float, Floats]:
        own = np.array([float(item.prior > 0) for n in numbers for item in linear[n][0].parameters])
        if not numbers:
            return float(rest @ rest), own
        A = np.hstack([blocks[n] for n in numbers])
        normal = A.T @ A + np.diag(own)
        a = np.linalg.lstsq(normal, -A.T @ rest, rcond=None)[0]
        left = rest + A @ a
        known = own > 0
        total = float(left @ left + (own * a) @ a) + float(np.sum(~known)) * np.log(samples)
        total += float(np.linalg.slogdet(normal[np.ix_(known, known)])[1])
        return total, np.asarray(a, dtype=np.float64)

    taken: list[int] = []
    gains: list[float] = []
    least = deviance([])[0]
    left = list(range(len(linear)))
    while left and len(taken) < most:
        scores = {n: least - deviance([*taken, n])[0] for n in left}
        best = max(scores, key=lambda n: scores[n])
        if scores[best] <= decisive:
            break
        taken.append(best)
        gains.append(scores[best])
        least -= scores[best]
        left.remove(best)
    sizes = iter(deviance(taken)[1].tolist())
    choice = [_reached(linear[n][0], sizes, gain) for n, gain in zip(taken, gains, strict=True)]
    others = []
    for n in sorted(left):
        value, a = deviance([*taken, n])
        own = iter(a.tolist()[a.size - len(linear[n][0].parameters) :])
        others.append([_reached(linear[n][0], own, least - value)])
    return [choice, *others] if choice else others


def _reached(cause: Cause, sizes: Iterator[float], gain: float) -> TestedCause:
    """Return a cause at sizes from those in its scales, within the bounds."""
    reached = tuple(
        item.value(item.coordinate(item.start) + next(sizes) * _scale(item, size))
        for item, size in zip(cause.parameters, cause.tries, strict=True)
    )
    return TestedCause(cause=cause, sizes=reached, gain=gain)


def _changed(
    found: Fit, misfit: Misfit, points: Sequence[Mapping[str, float]], origin: Sequence[Response]
) -> list[list[Response]]:
    """Return the responses of a fit with the change that quick throws at each point show."""
    rows = replace(misfit, quick=True).responses(points)
    return [list(map(with_change, found.local.simulated, row, origin)) for row in rows]


def _judging(misfit: Misfit) -> Misfit:
    """Return a misfit in which all that the model misses is noise of each movement."""
    comparison = misfit.comparison
    noise = {
        key: replace(item, missed=model_error(comparison, key))
        for key, item in comparison.noise.items()
    }
    return replace(
        misfit,
        comparison=replace(comparison, noise=noise, discrepancy={}, outlier_limit=float("inf")),
    )


def _adjusted(residuals: Floats, J: Floats, frame: Frame) -> float:
    """Return minus twice the log-likelihood with all values adjusted to first order."""
    rest = residuals + J @ np.linalg.lstsq(J, -residuals, rcond=None)[0]
    return float(rest @ rest) + _log_determinant(frame)


def deviance(found: Fit) -> float:
    """Return minus twice the log-likelihood of a fit with its own noise, and of its priors."""
    away = prior_residuals(found.parameters, found.point)
    factors = [factor for item in found.frame.alignments for factor in item.factors]
    noise = sum(2.0 * float(np.log(np.diag(factor)).sum()) for factor in factors)
    return found.cost + float(away @ away) + noise + _log_determinant(found.frame)


def of_sizes(causes: Sequence[Cause], found: Fit, *, more: int = 0) -> tuple[float, float]:
    r"""Return the deviance of a fit that sizes of causes explain, and that which they cost.

    With the sizes `a` and the information `S` on them that all other values leave, the deviance
    without them would be higher by :math:`a^T S a`, and they cost

    .. math:: \ln\det(\Sigma S) + k \ln n

    with the prior variances of those that have one, and the effective samples `n` for each of the
    `k` others, for each cause that every movement has a size of its own of, and for `more` unknowns
    without a prior.
    """
    places = {item.name: number for number, item in enumerate(found.parameters)}
    sized = [item for cause in causes for item in cause.sized]
    own = [places[item.name] for item in sized]
    rest = [number for number in range(len(places)) if number not in own]
    J = np.vstack([found.jacobian, np.diag(prior_slopes(found.parameters))])
    H = J.T @ J
    S = (
        H[np.ix_(own, own)]
        - H[np.ix_(own, rest)]
        @ np.linalg.lstsq(H[np.ix_(rest, rest)], H[np.ix_(rest, own)], rcond=None)[0]
    )
    a = np.array(
        [item.coordinate(found.values[item.name]) - item.coordinate(item.start) for item in sized]
    )
    known = [n for n, item in enumerate(sized) if item.prior > 0.0]
    widths = np.array([sized[n].prior_width for n in known])
    cost = float(np.linalg.slogdet(S[np.ix_(known, known)] * np.outer(widths, widths))[1])
    free = more + len(sized) - len(known) + sum(not cause.parameters for cause in causes)
    if free:
        samples = effective_samples(found.frame.alignments, found.misfit.comparison)
        cost += free * float(np.log(samples))
    return float(a @ S @ a), cost


def _log_determinant(frame: Frame) -> float:
    """Return the part of the log-likelihood that nuisances and shared directions have."""
    total = -sum(2.0 * float(np.log1p(-item.shrink).sum()) for item in frame.alignments)
    return total + (frame.shared.log_determinant if frame.shared else 0.0)


def _with_own_levels(found: Fit, misfit: Misfit, drive: str) -> float:
    """Return what `_adjusted` does with the slip level of each movement where it slips."""
    effects, least = own_levels(found, drive), float("inf")
    name = level_key(drive)
    names = [item.name for item in found.parameters]
    for _ in range(LEVEL_PASSES):
        misfit = replace(misfit, effects=effects)
        row = misfit.responses([found.values])[0]
        if any(item.failure for item in row):
            break
        frame = framed(replace(found.local, simulated=tuple(row)), misfit, passes=1)
        J = jacobian(found.local, frame, names)
        least = min(least, _adjusted(misfit.residuals_of(row, frame), J, frame))
        estimates = [a.estimates.get(name, (0.0, 0.0))[0] for a in frame.alignments]
        effects = {**effects, name: tuple(np.clip(estimates, -FURTHEST_LEVEL, FURTHEST_LEVEL))}
    return least


def own_levels(found: Fit, drive: str) -> dict[str, tuple[float, ...]]:
    """Return the effects of a fit with a slip level for each movement that slips.

    Where the simulated drive slips, measured over simulated force is how far the level is off.
    Where it does not quite, a smaller measured peak is a level that the movement has reached. Any
    other movement says nothing of it and keeps its own.
    """
    name = level_key(drive)
    shares = []
    for number, (alignment, response) in enumerate(
        zip(found.frame.alignments, found.local.simulated, strict=True)
    ):
        before = found.misfit.effect(name, number)
        level = found.values[name] * (1.0 + before)
        share = before
        for signal, bins in alignment.parts:
            if (signal.channel, signal.drive) != ("drive_force", drive):
                continue
            shift = alignment.shift
            model = np.abs(predicted(response, alignment.movement, signal, bins, shift=shift))
            seen = np.abs(signal.values[bins])
            slips = model > (1.0 - SLIPS) * level
            if slips.sum() >= LEAST_SLIPPING:
                share = (1.0 + before) * float(np.median(seen[slips] / model[slips])) - 1.0
            elif NEARLY * level < model.max() and seen.max() < LOWER * model.max():
                share = (1.0 + before) * float(seen.max() / level) - 1.0
        shares.append(float(np.clip(share, -FURTHEST_LEVEL, FURTHEST_LEVEL)))
    return {**found.misfit.effects, name: tuple(shares)}
