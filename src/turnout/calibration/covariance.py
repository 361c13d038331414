"""Uncertainty of a fit: covariance, intervals, and strongly correlated parameters in words."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, stdtrit

from turnout.calibration.candidate_causes import CHAIR_SPREAD, FRICTION, GROUP, MODULUS
from turnout.calibration.cause_trials import Rival
from turnout.calibration.comparison import Alignment, Key
from turnout.calibration.evaluate import Response
from turnout.calibration.fit import SCATTER_WEIGHT, Fit
from turnout.calibration.measured_movements import is_of_object
from turnout.calibration.misfit import shared_estimates
from turnout.calibration.shared import GAIN
from turnout.calibration.stages import Parameter, prior_information
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
# The change by half the step and elements half as long, and by four times the frequency of modes,
# over the error left [-].
OF_STEP, OF_MODES = 2.0**2 - 1.0, 4.0**1.2 - 1.0
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


def force_channels(found: Fit) -> list[Key]:
    """Return channel and drive of all that is compared, each once."""
    return list(
        dict.fromkeys(
            (s.channel, s.drive) for alignment in found.frame.alignments for s, _ in alignment.parts
        )
    )


def plain_gain_column(found: Fit, key: Key) -> Floats:
    """Return the change of the residuals, whitened movement by movement alone, with a gain.

    Parameters
    ----------
    found : Fit
        At its end.
    key : tuple of str
        Channel and drive.

    Returns
    -------
    ndarray, shape (n,)
        For all of its force too much.
    """
    rows = []
    for alignment in found.frame.alignments:
        row = np.zeros(alignment.measured.size)
        for signal, _, place in alignment.pieces:
            if (signal.channel, signal.drive) == key:
                row[place] = alignment.measured[place]
        rows.append(alignment.whitened(row))
    return np.concatenate(rows)


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
    for column in (*solver_columns(found), *of_panel):
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


def solver_columns(found: Fit) -> list[Floats]:
    r"""Return what step, mesh and modes leave, as changes of the residuals of a fit.

    By Richardson's rule, with the change :math:`\Delta` that a refinement makes of forces,

    .. math:: F_h - F_0 = \frac{\Delta}{2^2 - 1}, \quad F_f - F_\infty = \frac{\Delta}{4^{1.2} - 1}

    for half the step of a scheme of second order together with elements half as long, whose error
    is of that order too, and for modes to four times the frequency: on the panels of the library
    each doubling leaves 0.41 to 0.46 of the change that it makes, which is an order of 1.2. Each is
    one error of all movements, shown by those whose fine throws succeeded; none without any.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    list of ndarray, shape (n,)
        Whitened movement by movement alone.
    """
    shape, step, modes = found.misfit.shape, list[Floats](), list[Floats]()

    def seen(response: Response, alignment: Alignment) -> Floats:
        return alignment.predicted(shape(response, found.values) if shape else response)

    def change(later: Response, before: Response, alignment: Alignment) -> Floats:
        return alignment.whitened(seen(later, alignment) - seen(before, alignment))

    for alignment, one in zip(found.frame.alignments, found.misfit.refinement, strict=False):
        nothing = np.zeros(alignment.measured.size)
        known = not (one.failure or one.halved.failure)
        step.append(change(one.halved, one.plain, alignment) / OF_STEP if known else nothing)
        modes.append(change(one.fine, one.halved, alignment) / OF_MODES if known else nothing)
    return [np.concatenate(rows) for rows in (step, modes) if rows]


def scale_column(found: Fit) -> Floats:
    """Return the change of the residuals with one deviation of the scale of the model's forces.

    Whitened movement by movement alone.
    """
    columns = [plain_gain_column(found, key) for key in force_channels(found)]
    return np.asarray(found.misfit.comparison.uncertainty.scale * np.sum(columns, axis=0))


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
    alike = common_gain(found)
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


def common_gain(found: Fit) -> tuple[float, float] | None:
    r"""Return the gain that all channels have alike, and how far off it was stated to be [-].

    .. math:: \bar g = \sum_c g_c / s_c^2 \Big/ \sum_c 1 / s_c^2, \quad
        s = \Big(\sum_c 1 / s_c^2\Big)^{-1/2}

    with the estimated gains and the deviations that were stated of them. None where one is known.
    """
    shared = found.frame.shared
    sizes = shared_estimates(found.local, found.frame)
    gains = [
        (size, item.stated)
        for size, item in zip(sizes, shared.sensors if shared else (), strict=False)
        if item.kind == GAIN
    ]
    # One that is known exactly is the scale.
    if not gains or min(found.misfit.comparison.gains.values()) == 0.0:
        return None
    weight = sum(stated**-2 for _, stated in gains)
    mean = sum(size / stated for size, stated in gains) / weight
    return float(mean), float(weight**-0.5)


def _scale_finding(found: Fit) -> list[str]:
    """Say where the scale of the model is doubted."""
    alike = common_gain(found)
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
