"""How well each cause explains what a model misses: tried with values adjusted to first order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import Cause
from turnout.calibration.drive_law.candidates import level_key
from turnout.calibration.drive_law.fit_law import criteria
from turnout.calibration.evaluate import Response
from turnout.calibration.fit import Fit
from turnout.calibration.misfit import Frame, Misfit, framed, jacobian
from turnout.calibration.predict import predicted
from turnout.calibration.shared import effective_samples, model_error

Floats = NDArray[np.float64]
# How often the levels of the movements are estimated again in a trial.
LEVEL_PASSES = 2
# A drive slips within this share of its level, over so many bins; a level of a movement is no
# further off [-].
SLIPS, LEAST_SLIPPING, FURTHEST_LEVEL = 0.005, 3, 0.25
# A drive that reaches the first share of its level, and is measured below the second share of
# that, has slipped at less [-].
NEARLY, LOWER = 0.85, 0.98


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedCause:
    """How well a cause explains what the model misses.

    Attributes
    ----------
    name, text : str
        Of the cause, at its likeliest size.
    sizes : tuple of float
        In the units of its parameters; none where each movement has its own.
    gain : float
        By how much it lowers the Bayesian information criterion [-].
    fitted : bool
        Whether it was fitted together with all values.
    """

    name: str
    text: str
    sizes: tuple[float, ...]
    gain: float
    fitted: bool = False

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


def cause_trials(found: Fit, causes: Sequence[Cause]) -> list[tuple[TestedCause, Cause]]:
    """Try causes at their sizes, with all values adjusted to first order; the likeliest first.

    Only the change that a cause makes is thrown, quickly: what quick throws are off by is off
    alike with the cause and without, and is taken from both.
    """
    before = _judging(found.misfit)
    frame = framed(found.local, before)
    J = jacobian(found.local, frame, [item.name for item in found.parameters])
    samples = effective_samples(frame.alignments, before.comparison)
    plain = _adjusted(before.residuals_of(found.local.simulated, frame), J, frame)
    origin = replace(found.misfit, quick=True).responses([found.values])[0]
    trials = []
    for cause in causes:
        sizes, best = _tried(found, cause, before, frame, J, origin)
        gain = criteria(plain, parameters=0, samples=samples)[1]
        # A prior pays for its parameter itself.
        gain -= criteria(best, parameters=int(len(cause.parameters) <= 1), samples=samples)[1]
        trials.append(
            (TestedCause(name=cause.name, text=cause.text(sizes), sizes=sizes, gain=gain), cause)
        )
    return sorted(trials, key=lambda pair: -pair[0].gain)


def _tried(
    found: Fit,
    cause: Cause,
    before: Misfit,
    frame: Frame,
    J: Floats,
    origin: Sequence[Response],
) -> tuple[tuple[float, ...], float]:
    """Return the likeliest sizes of a cause, and minus twice the log-likelihood with it."""
    misfit = _judging(with_cause(found.misfit, cause))
    if not cause.parameters:
        drive = next(iter(cause.scatter)).split(".")[1]
        return (), _with_own_levels(found, misfit, drive)
    names = [item.name for item in cause.parameters]
    origin_of = {item.name: item.start for item in cause.parameters}
    moved = names if cause.smooth else names * len(cause.tries)
    points = [
        {**found.values, **origin_of, name: size}
        for name, size in zip(moved, cause.tries, strict=True)
    ]
    rows = _changed(found, misfit, points, origin, thrown=bool(cause.law or cause.smooth))
    usable = [n for n, row in enumerate(rows) if not any(item.failure for item in row)]
    if not usable or (cause.smooth and len(usable) < len(rows)):
        return tuple(item.start for item in cause.parameters), float("inf")
    if cause.smooth:
        return _along(found, cause, before, frame, J, rows)
    results = []
    for number in usable:
        local = replace(found.local, simulated=tuple(rows[number]))
        there = framed(local, misfit)
        r = misfit.residuals_of(rows[number], there)
        slopes = jacobian(found.local, there, [item.name for item in found.parameters])
        results.append((_adjusted(r, slopes, there), (cause.tries[number],)))
    best, sizes = min(results)
    return sizes, best


def _changed(
    found: Fit,
    misfit: Misfit,
    points: Sequence[Mapping[str, float]],
    origin: Sequence[Response],
    *,
    thrown: bool,
) -> list[list[Response]]:
    """Return the responses of a fit with the change that each point makes."""
    if not thrown:
        return misfit.responses(points)
    rows = replace(misfit, quick=True).responses(points)
    return [
        [
            with_change(base, after, before)
            for base, after, before in zip(found.local.simulated, row, origin, strict=True)
        ]
        for row in rows
    ]


def with_change(base: Response, after: Response, before: Response) -> Response:
    """Return a response with the difference of two others, which are on the same times."""
    if after.failure or before.failure:
        return after if after.failure else before
    return replace(
        base,
        drive_force={
            name: row + (after.drive_force[name] - before.drive_force[name])
            for name, row in base.drive_force.items()
        },
        object_force=base.object_force + (after.object_force - before.object_force),
    )


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


def _along(
    found: Fit,
    cause: Cause,
    misfit: Misfit,
    frame: Frame,
    J: Floats,
    rows: Sequence[Sequence[Response]],
) -> tuple[tuple[float, ...], float]:
    r"""Return the likeliest sizes where a cause is adjusted to first order too, and what is left.

    With the columns `A` of parameters that have priors, in their deviations, and `A'` what of them
    no value can imitate, they are integrated out,

    .. math:: D = \min_{	heta, a} \|r + J 	heta + A a\|^2 + \|a\|^2 + \ln\det(I + A'^T A')
    """
    r = misfit.residuals_of(found.local.simulated, frame)
    parameters = cause.parameters
    start = np.array([found.values.get(item.name, item.start) for item in parameters])
    widths = np.array([item.prior or np.inf for item in parameters])
    steps = np.array(cause.tries) - start
    scale = np.where(np.isfinite(widths), widths, np.abs(steps))
    A = np.column_stack([misfit.residuals_of(row, frame) - r for row in rows]) * (scale / steps)
    own = np.isfinite(widths).astype(np.float64)
    whole = np.vstack(
        [
            np.column_stack([J, A]),
            np.column_stack([np.zeros((len(parameters), J.shape[1])), np.diag(own)]),
        ]
    )
    right = np.concatenate([-r, np.zeros(len(parameters))])
    likeliest = np.linalg.lstsq(whole, right, rcond=None)[0][J.shape[1] :]
    reached = np.clip(
        start + likeliest * scale,
        [item.lower for item in parameters],
        [item.upper for item in parameters],
    )
    a = (reached - start) / scale
    plain = r + A @ a
    rest = plain + J @ np.linalg.lstsq(J, -plain, rcond=None)[0]
    apart = A - J @ np.linalg.lstsq(J, A, rcond=None)[0]
    deviance = float(rest @ rest) + float((own * a) @ a) + _log_determinant(frame)
    if own.all():
        deviance += float(np.linalg.slogdet(np.eye(a.size) + apart.T @ apart)[1])
    return tuple(reached.tolist()), deviance


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
        frame = framed(replace(found.local, simulated=tuple(row)), misfit)
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
