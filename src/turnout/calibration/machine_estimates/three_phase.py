r"""Three-phase machines identified from voltage, current and power of their throws.

The slope of the current with the power is that within throws, its slope with the voltage that over
throws: with block means k of throws j

.. math::

    I_{jk} - \bar I_j &= f_{jk} - \bar f_j + e_{jk} \\
    \bar I_j &= \bar f_j + \delta\,P'_j + b_j

f is the circuit of `turnout.calibration.machine_estimates.three_phase_circuit`, or the straight
line that stands beside it; P' is the part of the mean powers that does not go with the voltage. The
term delta takes what copper temperature and frequency move in current and power alike from throw
to throw, so that it is not taken for a slope with the load (Y. Mundlak, Econometrica 46, 1978). The
current of every other sample stands with voltage and power of those between, whose noise it does
not share and of which that noise is taken out by what they have in common: it would flatten both
slopes.

Currents within throws are known far better than those over throws, so that they choose the circuit,
and what a motor has otherwise goes into its slope with the voltage. That slope and the current at
the rated voltage are therefore those over throws: what the circuit leaves there is regressed on the
voltage and added, so that the circuit gives them their bend alone, and that within a range.
"""

import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.machine_estimates.current_fit import NORMAL_REACH, Estimate, NotIdentified
from turnout.calibration.machine_estimates.three_phase_circuit import SupplyCircuit
from turnout.calibration.machine_estimates.three_phase_throws import (
    CHANNELS,
    LEAST_THROWS,
    ONE_PHASE,
    WITHOUT_POWER,
    ThrowMeans,
    contradictions,
    recorded,
    throw_means,
)
from turnout.core.errors import MeasurementError

Floats = NDArray[np.float64]

LEAST_SHARE = 0.03
"""A quantity whose deviation is a larger share of it is not identified: only its range is [-]."""
LEAKAGE_SHARE, LEAKAGE_SPREAD = 0.2, 0.4
"""Leakage reactance over U/(sqrt(3) I) where no inrush shows it, and its relative deviation [-]."""
INRUSH_SPREAD = 0.2
"""Relative deviation of the running leakage from that of an inrush, in which teeth saturate [-]."""
LEAST_RESOLVED = 0.5
"""Share of the throws whose inrush is resolved from which it is used: a few are those whose first
samples began before the contactor closed [-]."""
STARTS = tuple((r, n) for r in (0.15, 0.45, 0.75) for n in (1.5, 4.0, 8.0))
"""Resistance as a share of the largest that the power allows, and saturation, of the starts [-]."""
MOST_SATURATION = 20.0
MOST_COPPER = 0.8
"""Share of the power that line and stator take at most; 0.5 to 0.7 are measured [-]."""
STEEPEST = 9.0
"""Highest power of the flux in the current of a main branch, beside a straight term [-]."""
DEPARTS = 3.0
"""Standard deviations from which a bend that the circuit leaves is stated."""
WORSE = 1.15
"""Scatter about the circuit over that about the straight line from which it does not follow [-]."""
LETTERS = {"voltage": "U", "current": "I", "power": "P"}
LEAST_CHANNELS = 2
"""Of voltage, current and power, those without which a drive is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Departure:
    """A bend in the measured current that the circuit does not have.

    Attributes
    ----------
    what : str
        Quantity along which it bends.
    size : Estimate
        Current left over one standard deviation from the mean [A].
    """

    what: str
    size: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreePhaseFit:
    """Estimates of one three-phase machine from voltage, current and power, at the recorder.

    Attributes
    ----------
    drive : str
    throws : int
        0 where fewer than two of U, I and P were recorded.
    missing : tuple of str
        Of U, I and P, those that were not recorded.
    voltage, power : float
        Point of reference: means over throws, NaN where not recorded [V, W]. Without voltage the
        power about which it swings within throws.
    rated_voltage : float
        [V].
    current : Estimate or NotIdentified
        At the rated voltage and the power of reference; without power at the mean load [A].
    per_volt : Estimate or NotIdentified
        Rise of the current with the voltage at the same power, over throws; without power at
        whatever it was [A/V].
    per_watt : Estimate or NotIdentified
        Rise of the current with the power at the same voltage, within throws [A/W].
    resistance : Estimate or NotIdentified
        Sum of line and stator, of a phase, at the copper's mean temperature [ohm].
    saturation : Estimate or NotIdentified
        d ln i/d ln psi of the main branch of the Gamma circuit at the point of reference [-].
    loss : Estimate or NotIdentified
        Iron plus mechanical loss, from throws with the rod off [W].
    leakage : Estimate or None
        Reactance that was allowed for, with its deviation: no result [ohm].
    rotor : NotIdentified
        How large the rotor resistance can be, as an inrush has it over a slip of at most 1.
    left : tuple of float
        Scatter of throw means that the circuit and the straight line leave [A]; NaN without.
    departures : tuple of Departure
        Where the circuit does not follow.
    starts : tuple of int
        Starts that ended at the best fit, and all starts.
    """

    drive: str
    throws: int = 0
    missing: tuple[str, ...]
    voltage: float = math.nan
    power: float = math.nan
    rated_voltage: float
    current: Estimate | NotIdentified
    per_volt: Estimate | NotIdentified
    per_watt: Estimate | NotIdentified
    resistance: Estimate | NotIdentified
    saturation: Estimate | NotIdentified
    loss: Estimate | NotIdentified
    leakage: Estimate | None = None
    rotor: NotIdentified
    left: tuple[float, float] = (math.nan, math.nan)
    departures: tuple[Departure, ...] = ()
    starts: tuple[int, int] = (0, 0)

    @property
    def verdict(self) -> str:
        """Fit of the circuit beside that of the straight line in U and P, in words."""
        if not self.throws:
            there = " and ".join(letter for letter in "UIP" if letter not in self.missing)
            return f"{f'only {there}' if there else 'none of U, I and P'} recorded; nothing to fit"
        if not math.isfinite(self.left[1]):
            return "no current was recorded: nothing to follow"
        if self.missing:
            return f"no circuit without {' and '.join(self.missing)}; {self._line_text}"
        texts = [
            f"throw means scatter by {1e3 * self.left[0]:.1f} mA about the circuit; "
            f"{self._line_text}"
        ]
        if self.left[0] > WORSE * self.left[1]:
            texts.append("the circuit does not follow: the straight line leaves less")
        texts += [
            f"the circuit does not follow the {one.what}: {1e3 * one.size.value:+.1f} mA left at "
            "one deviation from the mean"
            for one in self.departures
        ]
        if self.starts[0] < self.starts[1]:
            texts.append(f"{self.starts[0]} of {self.starts[1]} starts ended there")
        return "; ".join(texts)

    @property
    def _line_text(self) -> str:
        seen = " and ".join(letter for letter in "UP" if letter not in self.missing)
        return f"{1e3 * self.left[1]:.1f} mA about the straight line in {seen}"


NOT_SEPARATED = (
    "line and stator resistance: only their sum is seen, at the copper's mean temperature",
    "iron loss, drag, friction and load: all are power behind that resistance",
    "rotor resistance from slip: a running current does not depend on either, and durations show "
    "the slip of a percent or two to no better than a third of it",
    "leakage reactance while running: it is taken from the inrush, or assumed",
)


def fit_three_phase(
    campaign: xr.Dataset,
    *,
    rated_voltage: float,
    to_neutral: bool = False,
    free: Sequence[str] = (),
) -> tuple[ThreePhaseFit, ...]:
    """Fit every drive of a campaign as a three-phase machine.

    A drive with fewer than two of the channels is not looked at: its fit has 0 throws.

    Parameters
    ----------
    campaign : xarray.Dataset
        At least two of `drive_voltage`, `drive_current` and `drive_power` (movement, drive, time).
    rated_voltage : float
        Between lines, rms [V].
    to_neutral : bool
        True if the recorded voltages are those of a phase.
    free : sequence of str
        Movements with the rod off.

    Returns
    -------
    tuple of ThreePhaseFit
        By drive.

    Raises
    ------
    MeasurementError
        Without a drive that has two of the three channels, without enough throws, where the
        channels contradict each other, or with a movement in `free` that is not there.
    """
    names = [str(name) for name in campaign["movement"].values] if "movement" in campaign else []
    problems = [
        f"free movement '{name}': is not in the campaign" for name in free if name not in names
    ]
    drives = map(str, campaign["drive"].values) if names and "drive" in campaign else ()
    rows = {drive: recorded(campaign, drive) for drive in drives}
    if all(len(there) < LEAST_CHANNELS for there in rows.values()):
        text = f"needs movements with at least two of {', '.join(CHANNELS.values())} of a drive"
        has = [f"drive {drive} has {_letters(there) or 'none'}" for drive, there in rows.items()]
        problems.append(f"{text}{': ' * bool(has)}{', '.join(has)}")
    if problems:
        raise MeasurementError(problems, source="three-phase fit")
    known: dict[str, list[ThrowMeans]] = {}
    for drive, there in rows.items():
        if len(there) >= LEAST_CHANNELS:
            known[drive] = list(throw_means(campaign, there, to_neutral=to_neutral))
            problems += contradictions(known[drive], drive, rated_voltage, to_neutral=to_neutral)
    fits = []
    for drive, there in [] if problems else rows.items():
        try:
            fits.append(
                fit_throws(drive, known[drive], rated_voltage=rated_voltage, free=free)
                if drive in known
                else _untold(drive, there, rated_voltage)
            )
        except MeasurementError as error:
            problems += error.problems
    if problems:
        raise MeasurementError(problems, source="three-phase fit")
    return tuple(fits)


def _letters(there: Container[str]) -> str:
    return " and ".join(letter for what, letter in LETTERS.items() if what in there)


def _untold(drive: str, there: Container[str], rated_voltage: float) -> ThreePhaseFit:
    """Return an empty fit of a drive, with the names of its missing recordings."""
    missing = tuple(letter for what, letter in LETTERS.items() if what not in there)
    without = NotIdentified(reason=f"{' and '.join(missing)} not recorded")
    return ThreePhaseFit(
        drive=drive,
        missing=missing,
        rated_voltage=rated_voltage,
        current=without,
        per_volt=without,
        per_watt=without,
        resistance=without,
        saturation=without,
        loss=without,
        rotor=without if missing else NO_INRUSH,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Halves of the blocks of all throws, and their throws.

    Current of one half stands with voltage and power of the other, freed of noise within throws:
    what is noise in the one is none in the other.
    """

    voltage: Floats
    power: Floats
    current: Floats
    throw: NDArray[np.int64]
    count: int

    def mean(self, values: Floats) -> Floats:
        """Return the means over each throw, shape (count,)."""
        size = np.bincount(self.throw, minlength=self.count)
        return np.asarray(np.bincount(self.throw, values, minlength=self.count) / size)

    def within(self, values: Floats) -> Floats:
        """Return the deviations from the throw's mean."""
        return np.asarray(values - self.mean(values)[self.throw])


def _blocks(throws: Sequence[ThrowMeans]) -> _Blocks:
    sizes = [next(iter(t.blocks.values())).size for t in throws]
    throw = np.repeat(np.arange(len(throws)), sizes)

    def joined(what: str, *, turned: bool) -> Floats:
        if what not in throws[0].blocks:
            return np.zeros(throw.size)
        halves = (t.blocks[what] for t in throws)
        return np.concatenate([(h[::-1] if turned else h).ravel() for h in halves])

    current = joined("current", turned=False)
    blocks = _Blocks(np.zeros(throw.size), np.zeros(throw.size), current, throw, len(throws))

    def freed(what: str) -> Floats:
        values = joined(what, turned=True)
        own = blocks.within(values)
        whole = float(own @ own)
        kept = float(own @ blocks.within(joined(what, turned=False))) / whole if whole > 0 else 0.0
        return np.asarray(values - (1.0 - min(max(kept, 0.0), 1.0)) * own)

    return replace(blocks, voltage=freed("voltage"), power=freed("power"))


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """Parameters, their covariance, and the residuals of the throws' means."""

    values: Floats
    covariance: Floats
    left: Floats

    def parameter(self, at: int) -> Estimate:
        """Return the estimate of a parameter."""
        return self.estimate(np.eye(self.values.size)[at], float(self.values[at]))

    def estimate(self, gradient: Floats, value: float) -> Estimate:
        """Return the estimate of a function of the parameters by its gradient."""
        variance = float(gradient @ self.covariance @ gradient)
        return Estimate.of(value, math.sqrt(max(variance, 0.0)), self.left.size)


def _fitted(
    model: Callable[[Floats], Floats],
    blocks: _Blocks,
    starts: Sequence[Floats],
    bounds: tuple[Floats, Floats],
) -> tuple[_Fitted, int]:
    """Return the best fit of several starts, and how many of them ended at it.

    The model is the current of the blocks by the parameters, of which the last is delta, the slope
    that is left over throws. The covariance is that of the scores of whole throws, whose blocks are
    not independent, and half of what changes from equal weights of both parts to their own: the two
    parts of a model that is not quite the motor's disagree.
    """
    from scipy.optimize import least_squares

    power, target = blocks.mean(blocks.power), blocks.mean(blocks.current)
    apart, across = (v - v.mean() for v in (power, blocks.mean(blocks.voltage)))
    spread = float(across @ across)
    if spread > 0.0:  # a higher voltage takes more power in the copper: no part of delta
        apart = apart - float(apart @ across) / spread * across
    own = blocks.within(blocks.current)

    def residuals(x: Floats, weights: tuple[float, float]) -> Floats:
        found = model(x)
        found = np.where(np.isfinite(found), found, 10.0 * target.max())
        inside = (own - blocks.within(found)) / weights[0]
        return np.concatenate([inside, (target - blocks.mean(found) - x[-1] * apart) / weights[1]])

    def solved(start: Floats, weights: tuple[float, float]) -> Any:
        scale = np.abs(start) + 1e-6
        return least_squares(residuals, start, bounds=bounds, x_scale=scale, args=(weights,))

    weights = (0.02, 0.02)
    ends = [solved(start, weights) for start in starts]
    best = min(ends, key=lambda end: end.cost)
    same = sum(bool(end.cost <= best.cost * 1.001 + 1e-9) for end in ends)
    alike = best.x
    size = blocks.throw.size
    for _ in range(3):
        rest = residuals(best.x, (1.0, 1.0))
        weights = (_rms(rest[:size]), _rms(rest[size:]))
        best = solved(best.x, weights)
    jac, rest = best.jac, best.fun
    clusters = np.concatenate([blocks.throw, np.arange(blocks.count)])
    scores = np.zeros((blocks.count, jac.shape[1]))
    np.add.at(scores, clusters, jac * rest[:, None])
    meat = scores.T @ scores * blocks.count / max(blocks.count - jac.shape[1], 1)
    bread = np.linalg.pinv(jac.T @ jac, rcond=1e-13)
    left = rest[size:] * weights[1]
    change = 0.5 * (best.x - alike)
    return _Fitted(best.x, bread @ meat @ bread + np.outer(change, change), left), same


def _rms(values: Floats) -> float:
    return max(float(np.sqrt(np.mean(values**2))), 1e-6)


def fit_throws(
    drive: str, throws: Sequence[ThrowMeans], *, rated_voltage: float, free: Sequence[str] = ()
) -> ThreePhaseFit:
    """Fit one machine to its throws, which do not contradict each other.

    Parameters
    ----------
    drive : str
    throws : sequence of ThrowMeans
        At least `LEAST_THROWS`, all with the same channels.
    rated_voltage : float
        Between lines, rms [V].
    free : sequence of str
        Throws with the rod off.

    Raises
    ------
    MeasurementError
        Where the copper would take more than a machine's power leaves it.
    """
    fit, blocks = _untold(drive, throws[0].blocks, rated_voltage), _blocks(throws)
    loaded = np.array([t.name not in free for t in throws])
    u, p = (float(blocks.mean(row)[loaded].mean()) for row in (blocks.voltage, blocks.power))
    fit = replace(
        fit,
        throws=len(throws),
        voltage=math.nan if "U" in fit.missing else u,
        power=math.nan if "P" in fit.missing else p,
    )
    if "I" in fit.missing:
        return fit
    line = _straight_line(blocks, (u, p))
    fit = replace(fit, left=(math.nan, _rms(line.left)))
    if "U" in fit.missing:  # where the line is as steep as a current that bends
        own = blocks.within(blocks.power)
        swings = float(np.average(blocks.power - 0.5 * own, weights=own**2 + 1e-9))
        return replace(fit, power=swings, per_watt=_stated(line, 2))
    if "P" in fit.missing:
        at_rated = np.array([1.0, rated_voltage - u, 0.0, 0.0])
        current = line.estimate(at_rated, float(at_rated @ line.values))
        return replace(fit, current=current, per_volt=_stated(line, 1))
    return _with_circuit(fit, line, blocks, throws, free)


def _with_circuit(
    fit: ThreePhaseFit,
    line: _Fitted,
    blocks: _Blocks,
    throws: Sequence[ThrowMeans],
    free: Sequence[str],
) -> ThreePhaseFit:
    """Return what voltage, current and power tell."""
    point, most = (fit.voltage, fit.power), _largest_resistance(fit.power, line)
    fitted, same, leakage, rotor = _circuit(blocks, throws, point, line)
    resistance = fitted.parameter(1)
    copper = resistance.low / most
    if copper > MOST_COPPER:
        text = (
            f"drive {fit.drive}: by its slopes line and stator take {100 * copper:.0f} % of the "
            f"power or more, {100 * MOST_COPPER:.0f} % at most are possible: "
            f"{ONE_PHASE}{WITHOUT_POWER}"
        )
        raise MeasurementError([text], source="three-phase fit")
    current, per_volt = _over_throws(fitted, blocks, point, fit.rated_voltage)
    return replace(
        fit,
        current=current,
        per_volt=per_volt,
        per_watt=_per_watt(fitted, line, point),
        resistance=_stated(fitted, 1, most=most),
        saturation=_stated(fitted, 2, most=MOST_SATURATION),
        loss=_loss(throws, free, resistance),
        leakage=leakage,
        rotor=rotor,
        left=(_rms(fitted.left), fit.left[1]),
        departures=tuple(_departures(blocks, fitted.left)),
        starts=(same, len(STARTS)),
    )


def _straight_line(blocks: _Blocks, point: tuple[float, float]) -> _Fitted:
    """Return the line I = I_0 + b (U - U_0) + c (P - P_0); a column that is missing has 0."""
    voltage, power = blocks.voltage - point[0], blocks.power - point[1]

    def model(x: Floats) -> Floats:
        return np.asarray(x[0] + x[1] * voltage + x[2] * power)

    free = np.full(4, np.inf)
    start = np.array([float(blocks.current.mean()), 0.02, -1e-4, 0.0])
    return _fitted(model, blocks, [start], (-free, free))[0]


def _circuit_of(x: Floats, point: tuple[float, float]) -> SupplyCircuit:
    """Return the circuit through voltage and power by current, R, n and X_l there."""
    return SupplyCircuit(*point, *x[:4])


def _circuit(
    blocks: _Blocks, throws: Sequence[ThrowMeans], point: tuple[float, float], line: _Fitted
) -> tuple[_Fitted, int, Estimate, NotIdentified]:
    """Return the circuit I_0, R, n, X_l, delta; how many starts ended at it; X_l; the rotor's R.

    The leakage is assumed first and, where most throws resolve their inrush, taken from them by the
    circuit so found. The running currents do not choose it: a main branch that bends otherwise than
    by a power would be taken for leakage. What R and n change over a deviation of it is added.
    """
    current, most = float(line.values[0]), _largest_resistance(point[1], line)
    assumed = LEAKAGE_SHARE * point[0] / (math.sqrt(3.0) * current)
    leakage, rotor = Estimate.of(assumed, LEAKAGE_SPREAD * assumed, 1), NO_INRUSH
    bounds = (
        np.array([0.5 * current, 0.0, 0.5, -np.inf]),
        np.array([1.5 * current, most, MOST_SATURATION, np.inf]),
    )

    def fit(starts: Sequence[Floats], reactance: float) -> tuple[_Fitted, int]:
        def model(x: Floats) -> Floats:
            circuit = _circuit_of(np.insert(x, 3, reactance), point)
            return circuit.current_at(blocks.voltage, blocks.power)

        return _fitted(model, blocks, starts, bounds)

    starts = [np.array([current, share * most, n, 0.0]) for share, n in STARTS]
    fitted, same = fit(starts, leakage.value)
    inrush = np.array([t.inrush for t in throws if t.inrush is not None])
    resolved = len(inrush) >= max(LEAST_THROWS, LEAST_RESOLVED * len(throws))
    for _ in range(2 if resolved else 0):
        circuit = _circuit_of(np.insert(fitted.values, 3, leakage.value), point)
        resistance = fitted.parameter(1)
        leakage, rotor = _rotor_branch(circuit, inrush, resistance.high - resistance.value)
        fitted, _ = fit([fitted.values], leakage.value)
    moved, _ = fit([fitted.values], leakage.value + leakage.deviation)
    change = np.insert(moved.values - fitted.values, 3, leakage.deviation)
    inner = np.insert(np.insert(fitted.covariance, 3, 0.0, axis=0), 3, 0.0, axis=1)
    whole = replace(
        fitted,
        values=np.insert(fitted.values, 3, leakage.value),
        covariance=inner + np.outer(change, change),
    )
    return whole, same, leakage, rotor


def _rotor_branch(
    circuit: SupplyCircuit, inrush: Floats, margin: float
) -> tuple[Estimate, NotIdentified]:
    """Return leakage reactance [ohm] and the bound of the rotor resistance by inrushes.

    Inrushes have voltage, current and power, shape (n, 3); the bound is larger by what the stator's
    resistance may be off, the `margin` [ohm]. A sample that began before the contactor
    closed, or lasted while the motor ran up, shows too much of both: the least tenth of the throws
    has the samples that lie within the inrush.
    """
    branches = circuit.rotor_impedances(*inrush.T)
    least, most = (float(np.quantile(branch.imag, 0.1)) for branch in branches)
    value = 0.5 * (least + most)
    deviation = math.hypot(0.3 * (most - least), INRUSH_SPREAD * value)
    largest = margin + max(float(np.quantile(branch.real, 0.1)) for branch in branches)
    reason = f"at most {largest:.1f} ohm, its quotient by the slip in the inrush"
    if largest <= 0.0:
        reason = "the inrush takes less power than line and stator alone: of one phase only?"
    return Estimate.of(value, deviation, len(inrush)), NotIdentified(reason=reason)


def _largest_resistance(power: float, line: _Fitted) -> float:
    """Return the resistance that would take all of the power [ohm]."""
    return power / (3.0 * float(line.values[0]) ** 2)


def _stated(fitted: _Fitted, at: int, *, most: float = math.inf) -> Estimate | NotIdentified:
    """Return a parameter, unless its deviation is too large or it lies at its bound."""
    found = fitted.parameter(at)
    if found.value > 0.99 * most:
        return NotIdentified(reason=f"lies at its bound of {most:.3g}")
    stated = _or_not(found)
    if isinstance(stated, NotIdentified) and math.isfinite(most):
        return replace(stated, low=max(stated.low, 0.0), high=min(stated.high, most))
    return stated


def _or_not(found: Estimate) -> Estimate | NotIdentified:
    if 0.0 < found.deviation <= LEAST_SHARE * abs(found.value):
        return found
    return NotIdentified(
        reason="more throws, or throws with other loads and voltages, are needed",
        low=found.low,
        high=found.high,
    )


NO_INRUSH = NotIdentified(reason="no inrush lasts two samples in half of the throws")
NO_POINT = NotIdentified(reason="the circuit has no such point")
ONE_VOLTAGE = NotIdentified(reason="all throws have the same voltage; others are needed")


def _over_throws(
    fitted: _Fitted, blocks: _Blocks, point: tuple[float, float], rated_voltage: float
) -> tuple[Estimate | NotIdentified, Estimate | NotIdentified]:
    """Return the current at the rated voltage, and the slope with the voltage.

    A straight term beside a power m of the flux bends the main branch by m/n times as much as the
    power n of the circuit, for the same slope: what it adds on the way to the rated voltage is from
    once to `STEEPEST`/n times that of the circuit, any place between as likely.
    """
    across = blocks.mean(blocks.voltage)
    across, way, count = across - across.mean(), rated_voltage - point[0], blocks.count
    square = float(across @ across)
    circuit = _circuit_of(fitted.values, point)
    volts = point[0] + np.array([-1.0, 0.0, 1.0, way])
    low, middle, high, there = circuit.current_at(volts, np.full(4, point[1]))
    alike, rated = square <= 0.0, abs(way) <= 1e-9 * rated_voltage
    if alike and not rated:
        return ONE_VOLTAGE, ONE_VOLTAGE
    if not np.isfinite([low, middle, high, there]).all():
        return NO_POINT, NO_POINT
    more = float(fitted.left @ across) / (square or 1.0)
    rest = fitted.left - fitted.left.mean() - more * across
    freedom = count / max(count - fitted.values.size, 1)
    of_slope = math.sqrt(freedom * float((rest * across) @ (rest * across))) / (square or 1.0)
    of_level = _rms(rest) * math.sqrt(freedom / count)
    slope = 0.5 * float(high - low)
    bend = float(there - middle) - slope * way
    wider = max(STEEPEST / float(fitted.values[2]) - 1.0, 0.0) * bend
    current = Estimate.of(
        float(there) + 0.5 * wider + more * way + float(fitted.left.mean()),
        math.hypot(of_slope * way, of_level),
        count,
        common=abs(wider) / math.sqrt(12.0),
    )
    known = ONE_VOLTAGE if alike else _or_not(Estimate.of(slope + more, of_slope, count))
    return _or_not(current), known


def _per_watt(
    fitted: _Fitted, line: _Fitted, point: tuple[float, float]
) -> Estimate | NotIdentified:
    """Return the slope of the circuit's current with the power.

    Where all throws have one voltage R and saturation are not known, but what they give together
    is, as well as the straight line has it and but for what both differ by.
    """
    from scipy.optimize import approx_fprime

    def value_of(x: Floats) -> float:
        power = point[1] + np.array([-5.0, 5.0])
        low, high = _circuit_of(x, point).current_at(np.full(2, point[0]), power)
        return 0.1 * float(high - low)

    x = fitted.values
    value, gradient = value_of(x), approx_fprime(x, value_of, 1e-5 * np.abs(x) + 1e-9)
    if not np.isfinite([value, *gradient]).all():
        return NO_POINT
    found = _or_not(fitted.estimate(gradient, value))
    if isinstance(found, Estimate):
        return found
    straight = line.parameter(2)
    apart = abs(value - straight.value)
    return _or_not(Estimate.of(value, straight.deviation, straight.count, common=apart))


def _loss(
    throws: Sequence[ThrowMeans], free: Sequence[str], resistance: Estimate
) -> Estimate | NotIdentified:
    """Return the power with the rod off less the copper's, P - 3 R I^2; R however well it is known.

    Without such throws the least that is left of any is above it.
    """
    powers = np.array([t.mean("power") for t in throws])
    squares = np.array([t.mean("current") for t in throws]) ** 2
    chosen = np.array([t.name in free for t in throws])
    inside = powers - 3.0 * resistance.value * squares
    if chosen.sum() < 2:
        most = float(inside.min()) + 3.0 * float(squares.mean()) * (
            resistance.value - resistance.low
        )
        ran = "ran free once, two throws are needed" if chosen.any() else "never ran free"
        return NotIdentified(
            reason=f"the rod {ran}: at most {most:.0f} W, which the least power leaves"
        )
    copper = 3.0 * float(squares[chosen].mean()) * resistance.deviation
    found = Estimate.mean(inside[chosen].tolist(), common=copper)
    if found.high - found.value > NORMAL_REACH * LEAST_SHARE * abs(found.value):
        mostly = 2.0 * copper**2 > found.deviation**2
        return NotIdentified(
            reason=f"{found.value:.0f} W with a deviation of {found.deviation:.0f} W of "
            f"{found.count} throws" + ", most of it of the copper's part" * mostly
        )
    return found


def _departures(blocks: _Blocks, left: Floats) -> Iterator[Departure]:
    """Yield the bends in the circuit's residuals of the throws' means."""
    u, p = (blocks.mean(values) for values in (blocks.voltage, blocks.power))
    u, p = ((v - v.mean()) / max(float(v.std()), 1e-12) for v in (u, p))
    columns = np.stack([np.ones(u.size), u, p, u * u - 1.0, p * p - 1.0, u * p], axis=1)
    solution = np.linalg.lstsq(columns, left, rcond=None)[0]
    rest = left - columns @ solution
    variance = float(rest @ rest) / max(u.size - columns.shape[1], 1)
    inverse = np.linalg.pinv(columns.T @ columns)
    for at, what in ((3, "voltage"), (4, "power"), (5, "voltage and power together")):
        deviation = math.sqrt(variance * float(inverse[at, at]))
        if abs(solution[at]) > DEPARTS * deviation:
            size = Estimate.of(float(solution[at]), deviation, u.size - columns.shape[1] + 1)
            yield Departure(what=what, size=size)
