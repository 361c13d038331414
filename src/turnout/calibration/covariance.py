"""Uncertainty of a fit: covariance, intervals, correlated and unidentified parameters in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, stdtrit

from turnout.calibration.candidate_causes import CHAIR_SPREAD, FRICTION, GROUP, MODULUS
from turnout.calibration.fit import SCATTER_WEIGHT, Fit
from turnout.calibration.linearisation import is_slip_level, touches
from turnout.calibration.misfit import common_gain, solver_columns
from turnout.calibration.stages import (
    Parameter,
    is_of_object,
    prior_information,
)
from turnout.core.value_text import value_text

Floats = NDArray[np.float64]
# A standard deviation above this share of what the bounds alone allow: not identified.
UNIDENTIFIED = 0.7
# Correlation beyond which two parameters are called strongly correlated [-].
CORRELATED = 0.95
# A value that is known better than this has no need of another one to be identified [coordinate].
VAGUE = 0.02
# Correlation with a parameter that has a prior, from which on it is said [-].
NOTED = 0.6
# Share of its stated deviation that a value keeps at least where what was stated matters [-].
HARDLY_KNOWN = 0.3
# Units of values that a scale of all forces changes.
FORCES = ("N", "N/m")
# How likely the rails are of another weight or stiffness than the panel's before anything is
# measured, and by how much they then are, as standard deviation of the scale of all forces [-].
OTHER_SCALE, SCALE_SPREAD = 0.02, 0.05
# A value drifts where its slope over the movements is so many of its deviations, of so many more
# movements than a line has constants at least [-].
DRIFTS, LEAST_DRIFTING = 4.0, 4
NORMAL_95 = float(ndtri(0.975))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Covariance of a fit and what follows.

    Attributes
    ----------
    coordinate_covariance : ndarray, shape (p, p)
        In the coordinates of all parameters of the fit, with what their bounds allow as prior.
    covariance : ndarray, shape (f, f)
        Of the values of the parameters with state "fitted", in their order.
    deviations : tuple of float
        Standard deviation of each value; NaN where it is at a bound.
    intervals : tuple of (float, float)
        95 %.
    states : tuple of str
        "fitted", "at its bound" or "not identified".
    findings : tuple of str
        Sentences on parameters that are not identified or strongly correlated.
    """

    coordinate_covariance: Floats
    covariance: Floats
    deviations: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    states: tuple[str, ...]
    findings: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rival:
    """A choice of causes about as likely as one that was taken up.

    Attributes
    ----------
    causes : tuple of str
        Their names.
    text : str
        Its causes in words.
    odds : float
        Its probability over that of the one taken up [-].
    probability : float
        Among the choices that were fitted with it [-].
    moves : mapping of str to float
        By parameter how far its fit is from the fit of the one taken up [coordinate].
    """

    causes: tuple[str, ...]
    text: str
    odds: float
    probability: float
    moves: Mapping[str, float]

    @property
    def line(self) -> str:
        """The rival as a line for the screen."""
        odds = f"odds 1 to {1.0 / self.odds:.2g} beside what was fitted"
        return f"or {self.text} ({odds}; intervals hold its values)"


def moves_by(found: Fit, column: Floats) -> Floats:
    """Return the move of all coordinates by an error, from its change of the residuals.

    Parameters
    ----------
    found : Fit
        At its end.
    column : ndarray, shape (n,)
        Whitened movement by movement alone.
    """
    J = found.jacobian
    normal = J.T @ J + np.diag(prior_information(found.parameters))
    return np.asarray(np.linalg.solve(normal, -J.T @ found.frame.joined(column)))


def spread_of(
    found: Fit, *, of_panel: Sequence[Floats] = (), rivals: Sequence[Rival] = ()
) -> Spread:
    """Return the covariance of a fit from its sensitivities.

    Parameters
    ----------
    found : Fit
        At its end.
    of_panel : sequence of ndarray, shape (n,)
        Change of the residuals, whitened movement by movement alone, with one deviation of each
        number of the panel whose uncertainty is stated.
    rivals : sequence of Rival
        Choices of causes about as likely as those of the fit: what values would be with each counts
        with its probability.

    Returns
    -------
    Spread
    """
    parameters = found.parameters
    prior = prior_information(parameters)
    bound = np.array([item.at_bound(found.values[item.name]) for item in parameters])
    slopes = np.where(bound[None, :], 0.0, found.jacobian)
    whole = np.linalg.inv(slopes.T @ slopes + np.diag(prior))
    estimate = whole @ slopes.T
    for column in (*solver_columns(found.misfit, found.frame), *of_panel):
        move = estimate @ found.frame.joined(column)
        whole = whole + np.outer(move, move)
    for rival in rivals:
        move = np.array([rival.moves.get(item.name, 0.0) for item in parameters])
        whole = whole + rival.probability * np.outer(move, move)
    scale_move = _of_scale(found)
    whole = whole + np.diag(_of_chairs(found) ** 2) + np.outer(scale_move, scale_move)
    sizes = np.sqrt(np.diag(whole))
    states = [
        "at its bound"
        if at
        else "not identified"
        # One with a prior is known that well at least.
        if not item.prior and size > UNIDENTIFIED / np.sqrt(know)
        else "fitted"
        for item, at, size, know in zip(parameters, bound, sizes, prior, strict=True)
    ]
    kept = [number for number, state in enumerate(states) if state == "fitted"]
    scale = np.array([item.slope(found.values[item.name]) for item in parameters])
    covariance = whole[np.ix_(kept, kept)] * np.outer(scale[kept], scale[kept])
    deviations = tuple(
        float("nan") if at else float(size * slope)
        for at, size, slope in zip(bound, sizes, scale, strict=True)
    )
    # The scatter of a parameter is itself known from few movements only.
    freedom = max(len(found.frame.alignments) - 1, 0) + SCATTER_WEIGHT
    wide = {
        name: float(stdtrit(freedom, 0.975))
        for name, share in found.misfit.comparison.scatter.items()
        if share > 0
    }
    intervals = tuple(
        (
            item.value(item.coordinate(found.values[item.name]) - reach),
            item.value(item.coordinate(found.values[item.name]) + reach),
        )
        for item, size in zip(parameters, sizes, strict=True)
        for reach in [wide.get(item.name, NORMAL_95) * float(size)]
    )
    return Spread(
        coordinate_covariance=whole,
        covariance=covariance,
        deviations=deviations,
        intervals=intervals,
        states=tuple(states),
        findings=(*_scale_finding(found), *_correlations(parameters, whole, kept)),
    )


def _of_chairs(found: Fit) -> Floats:
    """Return the standard deviation of each coordinate by friction that differs by chair."""
    chairs = {FRICTION: chair_uncertainty(found)}
    own = [chairs.get(item.name, 0.0) for item in found.parameters]
    return np.asarray(own * _shares(found))


def _of_scale(found: Fit) -> Floats:
    """Return the move of all coordinates by one deviation of the scale of forces: in common."""
    acts = np.array([float(item.unit in FORCES) for item in found.parameters])
    return np.asarray(_scale_uncertainty(found) * acts * _shares(found))


def _shares(found: Fit) -> Floats:
    """Return the change of each coordinate by one whole of its value."""
    values = [(item, found.values[item.name]) for item in found.parameters]
    return np.array([abs(value) / item.slope(value) for item, value in values], dtype=np.float64)


def chair_uncertainty(found: Fit) -> float:
    r"""Return how well forces know the friction of all chairs where it differs between them [-].

    They see a chair by how far the rail slides on it, which falls from the toe to about nothing at
    the heel. With `N` chairs of a spread `s` and weights that fall in proportion, the mean that
    forces see and the mean of all chairs differ by

    .. math:: s \sqrt{\sum_i (w_i - 1/N)^2} = s / \sqrt{3 N}

    as standard deviation; nothing where friction is not fitted by chair.
    """
    if not any(item.name.startswith(GROUP) for item in found.parameters):
        return 0.0
    return float(CHAIR_SPREAD / np.sqrt(3.0 * len(found.misfit.evaluator.panel.chair)))


def _scale_uncertainty(found: Fit) -> float:
    """Return the uncertainty of the scale of all forces, where gains are free [-].

    The scale is then that of the model, from weight and stiffness of its rails. A gain that all
    channels have alike is not separable from an error of these.
    """
    alike = common_gain(found.local, found.frame, found.misfit.comparison)
    if alike is None:
        return 0.0
    return float(np.hypot(found.misfit.comparison.uncertainty.scale, _doubt(found, alike)))


def _doubt(found: Fit, alike: tuple[float, float]) -> float:
    """Return what gains that are off together say of the scale of the model [-].

    Where the rails are not those of the panel, the gains alone are the scale: it is as uncertain as
    their mean, which counts in full.
    """
    if any(item.name == MODULUS for item in found.parameters):
        return float(np.hypot(*alike))
    return scale_doubt(*alike)


def scale_doubt(mean: float, deviation: float) -> float:
    r"""Return how uncertain the model's scale is where all gains are off together [-].

    Either the rails are those of the panel, and the common gain :math:`m` is chance, of the
    deviation :math:`d` that was stated of it, or, in a share :math:`p` of all switches, they are
    not, and their scale is off by :math:`s` of a deviation :math:`\tau` too. By Bayes' rule

    .. math:: w = \frac{p N(m; 0, d^2 + \tau^2)}{(1 - p) N(m; 0, d^2) + p N(m; 0, d^2 + \tau^2)},
        \quad s \sim (1 - w)\, \delta_0
        + w N\left(\frac{m \tau^2}{d^2 + \tau^2}, \frac{d^2 \tau^2}{d^2 + \tau^2}\right)

    and the deviation is that of a normal error whose 95 % interval reaches as far as that of `s`:
    nothing while :math:`w` is below 5 %.

    Parameters
    ----------
    mean, deviation : float
        Of the gain that all channels have alike, as estimated and as stated [-].

    Examples
    --------
    >>> [round(scale_doubt(off * 0.006, 0.006), 4) for off in (1.0, 2.0, 2.5, 3.0, 4.0)]
    [0.0, 0.0, 0.0005, 0.0107, 0.0169]
    """
    wide = float(np.hypot(deviation, SCALE_SPREAD))
    chance, other = (
        share * float(np.exp(-0.5 * (mean / size) ** 2)) / size
        for share, size in ((1.0 - OTHER_SCALE, deviation), (OTHER_SCALE, wide))
    )
    beyond = (1.0 - 0.95) * (chance + other) / other
    if not beyond < 1.0:
        return 0.0
    middle = abs(mean) * (SCALE_SPREAD / wide) ** 2
    size = deviation * SCALE_SPREAD / wide

    def left(reach: float) -> float:
        return float(ndtr((middle - reach) / size) + ndtr((-middle - reach) / size)) - beyond

    return float(brentq(left, 0.0, middle + 10.0 * size)) / NORMAL_95


def _scale_finding(found: Fit) -> list[str]:
    """Say where the scale of the model is doubted."""
    alike = common_gain(found.local, found.frame, found.misfit.comparison)
    if alike is None or _doubt(found, alike) == 0.0:
        return []
    mean, deviation = alike
    why = f"{abs(mean) / deviation:.1f} standard deviations of what was stated of them"
    if scale_doubt(mean, deviation) == 0.0:
        why = "and the rails are not those of the panel"
    return [
        f"all sensors read {100 * mean:+.2g} % together, {why}: weight or stiffness of the rails "
        "may be off by as much instead, so intervals of forces and stiffnesses are wider; "
        "calibrate one channel (shunt or known load) and state its gain_uncertainty to know which"
    ]


def _correlations(parameters: Sequence[Parameter], whole: Floats, kept: Sequence[int]) -> list[str]:
    found = []
    sizes = np.sqrt(np.diag(whole))
    kept = [number for number in kept if not is_of_object(parameters[number])]
    for place, one in enumerate(kept):
        for other in kept[place + 1 :]:
            correlation = float(whole[one, other] / (sizes[one] * sizes[other]))
            if abs(correlation) < CORRELATED or not any(
                _is_vague(parameters[number], float(sizes[number])) for number in (one, other)
            ):
                if bool(parameters[one].prior) != bool(parameters[other].prior):
                    stated = one if parameters[one].prior else other
                    # What the movements say far better than it was stated needs no measurement.
                    if sizes[stated] > HARDLY_KNOWN * parameters[stated].prior_width:
                        found += _with_prior(parameters[one], parameters[other], correlation)
                continue
            word = "ratio" if correlation > 0 else "product"
            found.append(
                f"{parameters[one].name} and {parameters[other].name} are strongly correlated "
                f"({correlation:+.2f}); only their {word} is identified"
            )
    return found


def _is_vague(parameter: Parameter, size: float) -> bool:
    """Return whether a value is so uncertain that a correlation with another one matters."""
    if parameter.prior:
        return size > HARDLY_KNOWN * parameter.prior_width
    return size > VAGUE


def _with_prior(one: Parameter, other: Parameter, correlation: float) -> list[str]:
    """Say that a value depends on what was stated of another one, where it does."""
    stated, value = (one, other) if one.prior else (other, one)
    if abs(correlation) < NOTED:
        return []
    return [
        f"{value.name} depends on {stated.name} (correlation {correlation:+.2f}), which is taken "
        f"to be known to {value_text(stated.prior, unit=stated.unit, digits=3)}; measure it"
    ]


def without_objects(found: Fit, spread: Spread) -> tuple[Fit, Spread]:
    """Return a fit and its spread without the unknowns of objects, whose doubt is in the others.

    They stay where they were found. What they leave uncertain of the other values is counted among
    the errors that movements do not narrow.
    """
    kept = [n for n, item in enumerate(found.parameters) if not is_of_object(item)]
    if len(kept) == len(found.parameters):
        return found, spread
    parameters = tuple(found.parameters[n] for n in kept)
    slopes = found.jacobian[:, kept]
    whole = spread.coordinate_covariance[np.ix_(kept, kept)]
    fitted = [n for n, state in enumerate(spread.states) if state == "fitted"]
    rows = [place for place, n in enumerate(fitted) if n in kept]
    return replace(found, parameters=parameters, jacobian=slopes), replace(
        spread,
        coordinate_covariance=whole,
        covariance=spread.covariance[np.ix_(rows, rows)],
        deviations=tuple(spread.deviations[n] for n in kept),
        intervals=tuple(spread.intervals[n] for n in kept),
        states=tuple(spread.states[n] for n in kept),
    )


def drift_finding(found: Fit, order: Sequence[str]) -> list[str]:
    r"""Say where friction, or another value that scatters, rises or falls over a campaign.

    With the share :math:`e_m` that a movement is off the common value, in the order of the run
    sheet, :math:`e_m = a + b m` by least squares; said where b is four of its deviations, which the
    scatter about the line gives.

    Parameters
    ----------
    found : Fit
        At its end.
    order : sequence of str
        Names of all movements as they were measured, one after the other.
    """
    lines = []
    names = [item.movement.name for item in found.frame.alignments]
    places = np.array([order.index(name) for name in names], dtype=np.float64)
    for name in found.misfit.comparison.scatter:
        own = [item.estimates.get(name, (np.nan, 0.0))[0] for item in found.frame.alignments]
        shares = np.array(own, dtype=np.float64)
        known = np.isfinite(shares)
        freedom = int(known.sum()) - 2
        if freedom < LEAST_DRIFTING or not np.ptp(places[known]):
            continue
        m, e = places[known] - places[known].mean(), shares[known] - shares[known].mean()
        slope = float(m @ e / (m @ m))
        deviation = float(np.sqrt(np.sum((e - slope * m) ** 2) / freedom / (m @ m)))
        if abs(slope) <= DRIFTS * deviation:
            continue
        lines.append(
            f"{name} {'rises' if slope > 0 else 'falls'} by {100 * abs(slope):.2g} ± "
            f"{100 * deviation:.1g} % from movement to movement in the order of the run sheet, "
            f"{100 * abs(slope) * (len(order) - 1):.2g} % from the first to the last: it drifts, "
            "with temperature or wear; what is given is its mean"
        )
    return lines


# How much further a slip level is tried [coordinate], and by how much the cost must then rise for
# the level to be identified from above (95 %, one parameter).
FURTHER, IDENTIFIED = 0.05, 3.84


def drop_unidentified_slip_levels(found: Fit) -> tuple[Fit, list[str]]:
    """Drop slip levels that are bounded from below only, with a warning.

    A level below the largest force is raised by a fit until it just no longer matters. There the
    cost is steep on one side and flat on the other, and its slope would claim a sharp value.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    Fit, list of str
        Without the slopes of such levels; a warning for each of them.
    """
    slopes, warnings = found.jacobian.copy(), []
    for column, item in enumerate(found.parameters):
        if is_slip_level(item) and not _is_identified(found, item, column):
            slopes[:, column] = 0.0
            value = found.values[item.name]
            warnings.append(
                f"{item.name}: not identifiable from these movements, only at least {value:.0f} N; "
                "measure a larger object beside the drive, at which it slips"
            )
    return (replace(found, jacobian=slopes) if warnings else found), warnings


def _is_identified(found: Fit, item: Parameter, column: int) -> bool:
    """Return whether a higher level makes the cost rise, whatever the other parameters do."""
    value = found.values[item.name]
    higher = item.value(item.coordinate(value) + FURTHER)
    numbers = [n for n, row in enumerate(found.local.simulated) if touches(item, value, row)]
    if not numbers or higher <= value:
        return bool(numbers)
    others = np.delete(found.jacobian, column, axis=1)
    ahead = _least_cost(_residuals(found, item, higher, numbers), others)
    return ahead - _least_cost(found.residuals, others) > IDENTIFIED


def _residuals(found: Fit, item: Parameter, value: float, numbers: Sequence[int]) -> Floats:
    """Return the residuals with another value of a parameter, thrown where it acts."""
    misfit = found.misfit
    part = misfit.of(numbers)
    made = part.responses([{**found.values, item.name: value}])[0]
    responses = list(found.local.simulated)
    for number, response in zip(numbers, made, strict=True):
        responses[number] = response
    return misfit.residuals_of(responses, found.frame)


def _least_cost(residuals: Floats, slopes: Floats) -> float:
    """Return the least cost of any values of the parameters, to first order."""
    step = np.linalg.lstsq(slopes, residuals, rcond=None)[0]
    rest = residuals - slopes @ step
    return float(rest @ rest)
