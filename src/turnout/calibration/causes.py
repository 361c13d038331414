"""Why a model does not follow: likely causes, each tested by a fit with one more parameter.

A cause is a parameter that the panel does not have, or that a calibration usually takes as known: a
recorder that averages, a bushing that is soft at first, rails of another stiffness, friction that
rises along the switch, a slip level of its own in each throw. Each is tried at a few sizes, with
the other values adjusted to first order, and judged by the Bayesian information criterion. One that
is decisively better is fitted together with all values, so that they are freed of its effect.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.drive_law.candidates import REACH, Law, Shape, level_key, stiffness_key
from turnout.calibration.drive_law.fit_law import END, criteria
from turnout.calibration.evaluate import Response
from turnout.calibration.fit import Fit, fit
from turnout.calibration.measured_movements import OBJECT_FORCE, largest_force
from turnout.calibration.misfit import Frame, Misfit, framed, jacobian
from turnout.calibration.noise import peaks_of
from turnout.calibration.parameter import Parameter, free_parameter
from turnout.calibration.recorder import trailing_mean
from turnout.calibration.sensors import found_gains
from turnout.calibration.shared import effective_samples, model_error
from turnout.errors import PanelError, SolverError
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
FRICTION, MODULUS = "chair.friction_coefficient", "material.youngs_modulus"
# Where a model misses less than this share of a channel's peak, no cause is looked for [-].
WORTH = {OBJECT_FORCE: 0.02}
WORTH_DRIVE = 1.5e-3
# Difference of the criterion from which on a cause is taken up, and how many at most.
DECISIVE, MOST_CAUSES = 10.0, 3
# Share of its stiffness that a bushing has at first [-].
SOFT_SHARE = 0.25
LEVEL_SCATTER = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cause:
    """One thing that may differ between model and measurement.

    Attributes
    ----------
    name : str
        What it is called, such as "recorder filter".
    text : callable
        From its size to a sentence.
    parameter : Parameter or None
        Its size; None where each movement has its own.
    tries : tuple of float
        Sizes that are tried, in the unit of the parameter.
    smooth : bool
        Whether forces change in proportion to it: then one size is tried, and the likeliest
        follows with those of all values.
    law, shape : callable or None
        As of `Misfit`.
    scatter : mapping of str to float
        Parameters that scatter from movement to movement, as shares.
    """

    name: str
    text: Callable[[float], str]
    parameter: Parameter | None = None
    tries: tuple[float, ...] = ()
    smooth: bool = False
    law: Law | None = None
    shape: Shape | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedCause:
    """How well a cause explains what the model misses.

    Attributes
    ----------
    name, text : str
        Of the cause, at its likeliest size.
    size : float
        In the unit of its parameter; NaN where each movement has its own.
    gain : float
        By how much it lowers the Bayesian information criterion [-].
    fitted : bool
        Whether it was fitted together with all values.
    """

    name: str
    text: str
    size: float
    gain: float
    fitted: bool = False

    @property
    def line(self) -> str:
        """Return the cause as a line for the screen."""
        state = "fitted with the values" if self.fitted else "possible"
        return f"{self.name}: {self.text} ({state}, BIC {self.gain:.0f} lower)"


def candidate_causes(panel: LoadedPanel, parameters: Sequence[Parameter]) -> tuple[Cause, ...]:
    """Return the causes that are tested, the cheap ones first."""
    known = {item.name for item in parameters}
    found = [_recorder(), *_bushings(panel), *_clutches(panel, known)]
    if MODULUS not in known:
        found += _sections(panel)
    if FRICTION in known and len(panel.chair) > 2:
        found += _friction_by_chair(panel)
    return tuple(found)


def _linear(name: str, upper: float, unit: str, *, lower: float = 0.0) -> Parameter:
    return Parameter(
        name=name, keys=(), start=max(0.0, lower), lower=lower, upper=upper, unit=unit,
        transform="linear",
    )  # fmt: skip


def _recorder() -> Cause:
    return Cause(
        name="recorder filter",
        text=lambda size: (
            f"the recorder averages over {size:.3g} s; state it in the channel map as "
            f'recorded_average = "{size:.3g} s"'
        ),
        parameter=_linear("recorder.average", 0.5, "s"),
        tries=(0.03, 0.1, 0.25),
        shape=lambda response, values: _recorded(response, values["recorder.average"]),
    )


def _recorded(response: Response, average: float) -> Response:
    """Return a response as a recorder keeps it that averages over the time before each sample."""

    def past(values: Floats) -> Floats:
        return trailing_mean(response.time, values, average)

    if response.failure:
        return response
    forces = {name: past(row) for name, row in response.drive_force.items()}
    return replace(response, drive_force=forces, object_force=past(response.object_force))


def _bushings(panel: LoadedPanel) -> list[Cause]:
    groups: dict[str, tuple[str, ...]] = {
        f"drive.{name}.soft_travel": (name,) for name in panel.drive
    }
    if len(panel.drive) > 1:
        groups["drive.soft_travel"] = tuple(panel.drive)
    found = []
    for key, drives in groups.items():
        which = f"drive {drives[0]}" if len(drives) == 1 else "all drives"

        def law(
            values: Mapping[str, float], key: str = key, drives: tuple[str, ...] = drives
        ) -> dict[str, object]:
            made: dict[str, object] = {}
            for drive in drives:
                made |= soft_bushing(panel, drive, values, travel=values[key])
            return made

        found.append(
            Cause(
                name="bushing shape",
                text=lambda size, which=which: (  # type: ignore[misc]
                    f"the bushing of {which} is soft over its first {1e3 * size:.2g} mm"
                ),
                parameter=_linear(key, 0.01, "m"),
                tries=(0.5e-3, 1.5e-3, 3e-3),
                law=law,
            )
        )
    return found


def soft_bushing(
    panel: LoadedPanel, drive: str, values: Mapping[str, float], *, travel: float
) -> dict[str, object]:
    """Return a bushing with a quarter of its stiffness over its first travel, as overrides.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive.
    values : mapping of str to float
        By key of the panel, in SI.
    travel : float
        To either side [m].
    """
    if travel < 1e-6:
        return {}
    record = panel.drive[drive]
    stiffness = values.get(stiffness_key(drive), record.stiffness)
    level = values.get(level_key(drive), record.saturation_force)
    first = min(SOFT_SHARE * stiffness * travel, 0.9 * level)
    knee = travel + (level - first) / stiffness
    last = level + record.saturated_stiffness * (REACH - knee) + 1.0
    half = ((travel, first), (knee, level), (REACH, last))
    extension = [*(-x for x, _ in reversed(half)), *(x for x, _ in half)]
    force = [*(-f for _, f in reversed(half)), *(f for _, f in half)]
    return {f"drive.{drive}.extension": extension, f"drive.{drive}.force": force}


def _clutches(panel: LoadedPanel, known: set[str]) -> list[Cause]:
    return [
        Cause(
            name="clutch",
            text=lambda _, name=name: (  # type: ignore[misc]
                f"drive {name} slips at another force in each throw"
            ),
            scatter={level_key(name): LEVEL_SCATTER},
        )
        for name in panel.drive
        if level_key(name) in known
    ]


def _sections(panel: LoadedPanel) -> list[Cause]:
    try:
        modulus = free_parameter(panel, MODULUS)
    except PanelError:
        return []
    modulus = replace(modulus, lower=0.5 * modulus.start, upper=2.0 * modulus.start)
    return [
        Cause(
            name="sections",
            text=lambda size: (
                f"the rails are {100 * abs(size / modulus.start - 1.0):.2g} % "
                f"{'stiffer' if size > modulus.start else 'softer'} than in the panel"
            ),
            parameter=modulus,
            tries=(1.05 * modulus.start,),
            smooth=True,
        )
    ]


def _friction_by_chair(panel: LoadedPanel) -> list[Cause]:
    """Return friction that rises towards the heel, and friction that is higher at both ends."""
    places = np.array([chair.x for chair in panel.chair.values()])
    xi = 2.0 * (places - places.min()) / max(float(np.ptp(places)), 1e-9) - 1.0
    shapes = {
        "friction.gradient": (xi, "from the toe to the heel", 2.0),
        "friction.bow": (1.5 * xi**2 - 0.5, "from the middle to the ends", 1.5),
    }
    found = []
    for key, (shape, way, span) in shapes.items():
        shape = shape - shape.mean()

        def law(
            values: Mapping[str, float], key: str = key, shape: Floats = shape
        ) -> dict[str, object]:
            shares = np.maximum(1.0 + values[key] * shape, 0.0)
            # Causes along the switch add up.
            for other, (rest, *_) in shapes.items():
                if other != key and other in values:
                    shares = np.maximum(shares + values[other] * (rest - rest.mean()), 0.0)
            return {
                f"chair.{name}.friction_coefficient": float(values[FRICTION] * share)
                for name, share in zip(panel.chair, shares, strict=True)
            }

        found.append(
            Cause(
                name="friction by chair",
                text=lambda size, way=way, span=span: (  # type: ignore[misc]
                    f"friction {'rises' if size > 0 else 'falls'} by "
                    f"{100 * span * abs(size):.2g} % of its mean {way}"
                ),
                parameter=_linear(key, 0.9, "1", lower=-0.9),
                tries=(0.1,),
                smooth=True,
                law=law,
            )
        )
    return found


def is_worth_a_search(found: Fit) -> bool:
    """Return whether a model misses more of a channel than another solver would, or by its gain."""
    if any(item.leaves for item in found_gains(found)):
        return True
    comparison = found.misfit.comparison
    return any(
        model_error(comparison, key)
        > max(WORTH.get(key[0], WORTH_DRIVE) * peak, 1.5 * comparison.noise[key].white)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


def with_causes(
    found: Fit, first: Misfit, panel: LoadedPanel, *, on_step: Callable[[float], None] | None = None
) -> tuple[Fit, tuple[TestedCause, ...]]:
    """Test the causes of what a fit misses, and fit the decisive ones together with all values.

    Parameters
    ----------
    found : Fit
        Where the fit without them ended.
    first : Misfit
        As it began: with the noise of the measurement.
    panel : LoadedPanel
        That is thrown.
    on_step : callable, optional
        As of `fit`.

    Returns
    -------
    Fit, tuple of TestedCause
        The fit with all causes that were taken up; these and the others that explain something, the
        likeliest first.
    """
    taken: list[TestedCause] = []
    tested: list[TestedCause] = []
    left = candidate_causes(panel, found.parameters)
    while is_worth_a_search(found) and len(taken) < MOST_CAUSES:
        trials = [(_tested(found, cause), cause) for cause in left]
        trials.sort(key=lambda pair: -pair[0].gain)
        tested = [trial for trial, _ in trials if trial.gain > DECISIVE]
        if not tested:
            break
        best, cause = trials[0]
        try:
            again = _fitted_with(found, first, cause, best, on_step=on_step)
        except SolverError:
            break
        if _missed(again) >= _missed(found):
            break
        found, first = (
            again,
            replace(
                first,
                parameters=again.misfit.parameters,
                law=again.misfit.law,
                shape=again.misfit.shape,
                always=again.misfit.always,
                comparison=replace(
                    first.comparison, scatter={**first.comparison.scatter, **cause.scatter}
                ),
            ),
        )
        size = found.values[cause.parameter.name] if cause.parameter else float("nan")
        taken.append(replace(best, size=size, text=cause.text(size), fitted=True))
        left = tuple(item for item in left if item.name != cause.name or _is_other(item, cause))
    names = {item.text for item in taken}
    return found, (
        *taken,
        *(
            item
            for item in tested
            if item.text not in names and item.name not in {t.name for t in taken}
        ),
    )


def _is_other(item: Cause, taken: Cause) -> bool:
    """Return whether a cause of the same name may still be added to one that was taken up."""
    return item is not taken and taken.name in ("friction by chair", "clutch")


def _missed(found: Fit) -> float:
    """Return what a fit misses of all channels, as shares of their peaks [-]."""
    comparison = found.misfit.comparison
    return sum(
        model_error(comparison, key) / max(peak, 1.0)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


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
    parameter = cause.parameter
    if parameter is None:
        return replace(
            misfit,
            comparison=replace(
                misfit.comparison, scatter={**misfit.comparison.scatter, **cause.scatter}
            ),
        )
    always = misfit.always if parameter.keys else (*misfit.always, parameter.name)
    return replace(
        misfit,
        parameters=(*misfit.parameters, parameter),
        base={**misfit.base, parameter.name: parameter.start},
        law=law,
        shape=shape,
        always=always,
    )


def _tested(found: Fit, cause: Cause) -> TestedCause:
    """Try a cause at its sizes, with all values adjusted to first order."""
    misfit = _judging(with_cause(found.misfit, cause))
    before = _judging(found.misfit)
    frame = framed(found.local, before)
    samples = effective_samples(frame.alignments, before.comparison)
    plain = _adjusted(found, before, frame)
    results = []
    if cause.parameter is None:
        drive = next(iter(cause.scatter)).split(".")[1]
        results.append((_with_own_levels(found, misfit, drive), float("nan")))
    else:
        points = [{**found.values, cause.parameter.name: size} for size in cause.tries]
        for size, row in zip(cause.tries, misfit.responses(points), strict=True):
            if any(item.failure for item in row):
                continue
            if cause.smooth:
                results.append(_along(found, before, frame, row, cause.parameter, size))
                continue
            local = replace(found.local, simulated=tuple(row))
            results.append((_adjusted(found, misfit, framed(local, misfit), row), size))
    best, size = min(results, default=(plain, float("nan")))
    gain = criteria(plain, parameters=0, samples=samples)[1]
    gain -= criteria(best, parameters=1, samples=samples)[1]
    return TestedCause(name=cause.name, text=cause.text(size), size=size, gain=gain)


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


def _adjusted(
    found: Fit, misfit: Misfit, frame: Frame, responses: Sequence[Response] | None = None
) -> float:
    """Return minus twice the log-likelihood with all values adjusted to first order."""
    rows = found.local.simulated if responses is None else responses
    residuals = misfit.residuals_of(rows, frame)
    J = jacobian(found.local, frame, [item.name for item in found.parameters])
    step = np.linalg.lstsq(J, -residuals, rcond=None)[0]
    rest = residuals + J @ step
    return float(rest @ rest) + _log_determinant(frame)


def _along(
    found: Fit,
    misfit: Misfit,
    frame: Frame,
    responses: Sequence[Response],
    parameter: Parameter,
    size: float,
) -> tuple[float, float]:
    """Return what `_adjusted` does where a cause is adjusted to first order too, and its size."""
    residuals = misfit.residuals_of(found.local.simulated, frame)
    column = misfit.residuals_of(responses, frame) - residuals
    J = jacobian(found.local, frame, [item.name for item in found.parameters])
    whole = np.column_stack([J, column])
    step = np.linalg.lstsq(whole, -residuals, rcond=None)[0]
    start = found.values.get(parameter.name, parameter.start)
    likeliest = start + float(step[-1]) * (size - start)
    reached = min(max(likeliest, parameter.lower), parameter.upper)
    share = (reached - start) / (size - start)
    plain = residuals + share * column
    rest = plain + J @ np.linalg.lstsq(J, -plain, rcond=None)[0]
    return float(rest @ rest) + _log_determinant(frame), reached


def _log_determinant(frame: Frame) -> float:
    """Return the part of the log-likelihood that nuisances and shared directions have."""
    total = -sum(2.0 * float(np.log1p(-item.shrink).sum()) for item in frame.alignments)
    return total + (frame.shared.log_determinant if frame.shared else 0.0)


def _with_own_levels(found: Fit, misfit: Misfit, drive: str) -> float:
    """Return what `_adjusted` does with the slip level of each movement where it slips."""
    misfit = replace(misfit, effects=own_levels(found, drive))
    row = misfit.responses([found.values])[0]
    if any(item.failure for item in row):
        return float("inf")
    frame = framed(replace(found.local, simulated=tuple(row)), misfit)
    return _adjusted(found, misfit, frame, row)


def own_levels(found: Fit, drive: str) -> dict[str, tuple[float, ...]]:
    """Return the effects of a fit with the largest force of each movement that slips as its level.

    A movement in which the drive stays below its slip level by more than the scatter says nothing
    of it and keeps the common one.
    """
    name = level_key(drive)
    common = found.values[name]
    shares = []
    for movement, response in zip(found.misfit.movements, found.local.simulated, strict=True):
        largest = largest_force(movement, drive) / common - 1.0
        simulated = float(np.abs(response.drive_force[drive]).max()) / common - 1.0
        slips = max(simulated, largest) > -0.5 * LEVEL_SCATTER
        shares.append(float(np.clip(largest, -0.2, 0.2)) if slips else 0.0)
    return {**found.misfit.effects, name: tuple(shares)}


def _fitted_with(
    found: Fit,
    first: Misfit,
    cause: Cause,
    best: TestedCause,
    *,
    on_step: Callable[[float], None] | None,
) -> Fit:
    """Fit all values together with a cause, from where both are."""
    values = dict(found.values)
    vary = list(found.parameters)
    effects = dict(found.misfit.effects)
    if cause.parameter is None:
        effects = own_levels(found, next(iter(cause.scatter)).split(".")[1])
    else:
        values[cause.parameter.name] = best.size
        vary.append(cause.parameter)
    misfit = replace(with_cause(first, cause), base=values)
    start = replace(
        found,
        values=values,
        misfit=replace(misfit, effects=effects),
        local=replace(found.local, stepped={}),
    )
    return fit(misfit, vary, values, near=start, on_step=on_step, **END)
