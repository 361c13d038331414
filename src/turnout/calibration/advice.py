"""Systematic errors that the parameters of a fit would absorb, and the next movement to measure."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import predicted
from turnout.calibration.covariance import (
    Spread,
    moves_by,
    without_objects,
)
from turnout.calibration.fit import Fit
from turnout.calibration.linearisation import Linearisation
from turnout.calibration.measured_movements import (
    BIN,
    OBJECT_FORCE,
    MeasuredMovement,
    Signal,
    movement_length,
)
from turnout.calibration.misfit import (
    Frame,
    Misfit,
    force_channels,
    framed,
    plain_gain_column,
    plain_jacobian,
)
from turnout.calibration.sensors import FoundSensor
from turnout.calibration.shared import GAIN, shared_of
from turnout.calibration.stages import (
    Parameter,
    free_parameter,
    is_of_object,
    prior_information,
    prior_slopes,
)
from turnout.core.errors import PanelError, SolverError
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
# The weight of the rails, whose error acts like one of all forces.
WEIGHT = "gravity"
# Relative error of the weight and of each sensitivity that is examined [-].
SHARE = 0.01
# Residuals that move by less than this many standard deviations are not noticed, even if looked
# for; the misfit shows what raises the sum of squares by as many of its deviations.
SEEN = 3.0
# A gain above this share of the error is one that it is taken for [-].
TAKEN_UP = 0.3
# Changes of a parameter below this share of the error are not listed [-].
WORTH = 0.1
# Smaller changes of a value are not printed [-].
LEAST_PRINTED = 1e-5
# Of the objects that could be measured next: that of the published test, and twice it [m].
SIZES = (0.013, 0.026)
# An uncertainty of a panel that is stated, and moves of values by it that are said [-].
SHARE_TEXT = re.compile(r"(?P<key>[^=\s]+)\s*=\s*(?P<share>\d+(\.\d+)?)\s*%")
SAID = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A movement that could be measured next.

    Attributes
    ----------
    text : str
        What to throw.
    gain : float
        Information that it would add: half the logarithm of how much the volume of what is
        possible shrinks [-].
    parameter : str
        Whose standard deviation it would reduce most.
    remaining : float
        Share of that standard deviation that would remain [-].
    """

    text: str
    gain: float
    parameter: str
    remaining: float


def systematic_errors(found: Fit) -> list[str]:
    """Say how errors of weight and sensitivity would change the parameters.

    Examined are the weight of the rails and the sensitivity of each force channel. An error that
    parameters can imitate is not seen in the residuals, and goes into the parameters; one that free
    gains can imitate is not seen either, and is printed as gains.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    list of str
        A sentence each.
    """
    heavier = panel_column(found, WEIGHT, SHARE)
    columns = {f"{100 * SHARE:g} % more weight of the rails": heavier}
    for key in force_channels(found.frame):
        name = f"the gauges of drive {key[1]}" if key[1] else "the load cell"
        columns[f"{100 * SHARE:g} % more sensitivity of {name}"] = SHARE * plain_gain_column(
            found.frame, key
        )
    return [_systematic_error(found, what, column) for what, column in columns.items()]


def _systematic_error(found: Fit, what: str, column: Floats) -> str:
    """Return a sentence on one error: its effect on the parameters, and how well it is seen.

    Gains, zeros, clock and discrepancy are unknowns here as in the fit, so what they take up is
    not said to be seen.

    Parameters
    ----------
    found : Fit
        At its end.
    what : str
        The error, in words.
    column : ndarray, shape (n,)
        What it does to the residuals that are whitened movement by movement alone.
    """
    names = [item.name for item in found.parameters]
    joined = found.frame.joined(column)
    priors = np.diag(prior_slopes(found.parameters))
    rows = np.vstack([found.jacobian, priors])
    change = np.linalg.lstsq(rows, -np.concatenate([joined, 0.0 * priors[0]]), rcond=None)[0]
    left = float(np.linalg.norm(joined + found.jacobian @ change))
    shares = _as_shares(found, change)
    parts = [
        f"{name} by {100 * share:+.2g} %"
        for name, share in shares.items()
        if abs(share) > WORTH * SHARE
    ]
    most = max([LEAST_PRINTED, *(abs(share) for share in shares.values())])
    moved = f"would change {', '.join(parts) or f'no value by more than {100 * most:.1g} %'}"
    times = f"({left:.{1 if left < SEEN else 0}f} standard deviations)"
    taken = _taken_up(found, column + plain_jacobian(found.local, found.frame, names) @ change)
    if left < SEEN and taken:
        return f"{what} {moved}: the fit takes it for {taken}, and the misfit stays low {times}"
    if left < SEEN:
        seen = f"and these movements would not show it {times}"
    elif left**2 < SEEN * np.sqrt(2.0 * joined.size):
        seen = f"and only a fit with it as an unknown would show it {times}"
    else:
        seen = f"but the misfit would show it {times}"
    return f"{what} {moved}, {seen}{f'; the fit takes it for {taken}' if taken else ''}"


def _as_shares(found: Fit, change: Floats) -> dict[str, float]:
    """Return a change of the coordinates as shares of the values that are not zero."""
    return {
        item.name: float(move * item.slope(found.values[item.name]) / found.values[item.name])
        for item, move in zip(found.parameters, change, strict=True)
        if found.values[item.name] and not is_of_object(item)
    }


def _taken_up(found: Fit, rest: Floats) -> str:
    """Name the sensors that an error is taken for, from its rest after the parameters."""
    shared = found.frame.shared
    if shared is None:
        return ""
    sizes = shared.estimates(rest)
    taken = [
        FoundSensor(column=item, value=float(size) * item.stated, deviation=0.0).short_text
        for item, size in zip(shared.sensors, sizes, strict=False)
        if item.kind == GAIN and abs(size) * item.stated > TAKEN_UP * SHARE
    ]
    return ", ".join(taken)


def panel_column(found: Fit, key: str, share: float) -> Floats:
    """Return the change of the residuals with an error of the panel, whitened movement by movement.

    Parameters
    ----------
    found : Fit
        At its end.
    key : str
        Of the panel, with a positive number, not fitted.
    share : float
        How much more it is in truth, as a share of the panel's value [-].

    Returns
    -------
    ndarray, shape (n,)
        Half the difference of throws with so much more and so much less.

    Raises
    ------
    SolverError
        When a throw with it cannot be simulated.
    """
    misfit = found.misfit
    item = free_parameter(misfit.evaluator.panel, key)
    wider = replace(
        misfit,
        parameters=(*misfit.parameters, item),
        base={**misfit.base, **found.values, key: item.start},
    )
    sides = [{key: item.start * (1.0 + side * share)} for side in (-1.0, 1.0)]
    rows = []
    pairs = zip(found.frame.alignments, *wider.responses(sides), strict=True)
    for alignment, less, more in pairs:
        if less.failure or more.failure:
            message = (
                f"{key} ± {100 * share:g} %: {alignment.movement.text} cannot be simulated: "
                f"{less.failure or more.failure}; state less"
            )
            raise SolverError(message)
        change = alignment.predicted(more) - alignment.predicted(less)
        rows.append(alignment.whitened(0.5 * change))
    return np.concatenate(rows)


def stated_shares(texts: Sequence[str]) -> dict[str, float]:
    """Return uncertainties of a panel's keys from texts such as "gravity=2 %", as shares [-].

    Raises
    ------
    PanelError
        For texts of another form; with all problems.

    Examples
    --------
    >>> stated_shares(["material.density=3 %"])
    {'material.density': 0.03}
    """
    found, problems = dict[str, float](), []
    for text in texts:
        match = SHARE_TEXT.fullmatch(text.strip())
        share = 0.01 * float(match["share"]) if match else 0.0
        if match is None or not 0.0 < share < 1.0:
            problems.append(f"{text}: must be KEY=SHARE with a share from 0 to 100 %, as 'x=5 %'")
            continue
        found[match["key"]] = share
    if problems:
        raise PanelError(problems, source="panel uncertainty")
    return found


def check_shares(
    shares: Mapping[str, float], panel: LoadedPanel, parameters: Sequence[Parameter]
) -> None:
    """Refuse uncertainties of fitted values, and of keys that are no positive number of a panel."""
    fitted = {key for item in parameters if item.vary for key in item.keys}
    problems = [f"{key}: is fitted itself; leave it out" for key in shares if key in fitted]
    for key in shares:
        try:
            free_parameter(panel, key)
        except PanelError as error:
            problems += error.problems
    if problems:
        raise PanelError(problems, source="panel uncertainty")


def given_but(shares: Mapping[str, float]) -> dict[str, str]:
    """Return the entry of a record on uncertainties of the panel that intervals hold, if any."""
    told = ", ".join(f"{key} ± {100 * share:g} %" for key, share in shares.items())
    return {"given": f"the panel as stated, but for {told}"} if told else {}


def panel_doubt_lines(
    found: Fit, columns: Mapping[str, Floats], shares: Mapping[str, float]
) -> list[str]:
    """Say by how much stated uncertainties of a panel make the values uncertain."""
    lines = []
    for key, column in columns.items():
        moves = _as_shares(found, moves_by(found, column))
        sizes = {name: abs(move) for name, move in moves.items()}
        parts = [f"{name} by {100 * size:.2g} %" for name, size in sizes.items() if size > SAID]
        said = ", ".join(parts) or f"no value by more than {100 * SAID:g} %"
        lines.append(f"{key} known to ± {100 * shares[key]:g} %: moves {said}")
    return lines


def next_movements(found: Fit, spread: Spread) -> list[Candidate]:
    """Rank movements that could be measured next by the information that they would add.

    Candidates are a movement without an object, and objects of 13 and 26 mm at each drive, at the
    sensors, and midway; objects that do not fit are left out. Gains, zeros, clock and discrepancy
    are the same in a further movement, which says of them only what the others leave
    open; cross-talk, solver and a doubted scale stay as they are.

    Parameters
    ----------
    found : Fit
        At its end.
    spread : Spread
        What is known.

    Returns
    -------
    list of Candidate
        The best first.
    """
    movements = _candidates(found)
    ranked = []
    names = [item.name for item in found.parameters]
    before = spread.coordinate_covariance
    for movement in movements:
        try:
            local, frame = _thrown(found, movement, names)
        except SolverError:
            continue
        after = covariance_with(found, spread, local, frame)
        shares = np.sqrt(np.diag(after) / np.diag(before))
        ranked.append(
            Candidate(
                text=movement.name,
                gain=0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]),
                parameter=names[int(np.argmin(shares))],
                remaining=float(shares.min()),
            )
        )
    return sorted(ranked, key=lambda item: -item.gain)


def covariance_with(found: Fit, spread: Spread, local: Linearisation, frame: Frame) -> Floats:
    r"""Return the covariance of the coordinates with further movements beside those of a fit.

    With the sensitivities :math:`J` of all movements together, made independent of what they
    share, and the information :math:`P` of priors,

    .. math:: (J^T J + P)^{-1} + \mathrm{cov} - (J_0^T J_0 + P)^{-1}

    where :math:`J_0` is of those that were measured, so that what no movement narrows is kept.

    Parameters
    ----------
    found : Fit
        At its end.
    spread : Spread
        Of the fit.
    local, frame : Linearisation, Frame
        Of the further movements, at the values of the fit.

    Returns
    -------
    ndarray, shape (p, p)
    """
    names = [item.name for item in found.parameters]
    free = np.array([not item.at_bound(found.values[item.name]) for item in found.parameters])
    prior = np.diag(prior_information(found.parameters))
    shared = shared_of([*found.frame.alignments, *frame.alignments], found.misfit.comparison)
    rows = np.vstack(
        [plain_jacobian(found.local, found.frame, names), plain_jacobian(local, frame, names)]
    )
    whole = (rows if shared is None else shared.whitened(rows)) * free
    measured = found.jacobian * free
    kept = spread.coordinate_covariance - np.linalg.inv(measured.T @ measured + prior)
    return np.asarray(np.linalg.inv(whole.T @ whole + prior) + kept)


def _candidates(found: Fit) -> list[MeasuredMovement]:
    panel = found.misfit.evaluator.panel
    places = [f"drive {name}" for name in panel.drive]
    places += [f"sensor {name}" for name in panel.sensor]
    xs = sorted(drive.x for drive in panel.drive.values())
    if len(xs) > 1:
        places.append(f"x = {0.5 * (xs[0] + xs[-1]):g} m")
    throws: list[tuple[str, float]] = [("none", 0.0)]
    throws += [(place, size) for place in places for size in SIZES]
    movements = []
    for place, size in throws:
        try:
            x = resolve_objects(panel, [ForeignObject(size, place)])[-1].x if size else np.nan
            length = movement_length(panel, "closing", trapped=size > 0)
        except PanelError:
            continue
        what = f"{size * 1e3:g} mm at {place}" if size else "no object"
        movements.append(
            MeasuredMovement(
                name=f"closing, {what}",
                direction="closing",
                place=place,
                size=size,
                x=x,
                signals=(),
                length=length,
                clocked=any(item.clocked for item in found.misfit.movements),
            )
        )
    return movements


def _thrown(
    found: Fit, movement: MeasuredMovement, names: Sequence[str]
) -> tuple[Linearisation, Frame]:
    """Return the responses to a movement that was not measured, as if they had been."""
    misfit: Misfit = replace(found.misfit, movements=(movement,), effects={}, refinement=())
    local = misfit.local(found.values, names)
    time: Floats = np.asarray(
        BIN * (np.arange(round(movement.length / BIN)) + 0.5), dtype=np.float64
    )
    bins = np.arange(time.size)
    signals = []
    for channel, drive in misfit.comparison.noise:
        if channel == OBJECT_FORCE and movement.size == 0:
            continue
        bare = Signal(channel=channel, drive=drive, time=time, values=0.0 * time)
        values = predicted(local.simulated[0], movement, bare, bins)
        signals.append(replace(bare, values=values))
    whole = replace(misfit, movements=(replace(movement, signals=tuple(signals)),))
    return local, framed(local, whole)


def advice_lines(found: Fit, spread: Spread) -> list[str]:
    """Return lines on errors that parameters would absorb, and on the next movement to measure.

    Parameters
    ----------
    found : Fit
        At its end.
    spread : Spread
        Of it.
    """
    ranked = next_movements(*without_objects(found, spread))
    return [*systematic_errors(found), *next_lines(ranked)]


def next_lines(candidates: Sequence[Candidate], *, most: int = 3) -> list[str]:
    """List the movements that would add most information.

    Examples
    --------
    >>> next_lines([Candidate(text="closing, no object", gain=1.0, parameter="k", remaining=0.5)])
    ['next: closing, no object: leaves 50 % of the standard deviation of k, adds 1.4 bits']
    """
    return [
        f"next: {item.text}: leaves {100 * item.remaining:.0f} % of the standard deviation of "
        f"{item.parameter}, adds {item.gain / np.log(2.0):.1f} bits"
        for item in candidates[:most]
    ]
