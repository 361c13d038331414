r"""Current of a point machine against the force on its rod, from movements where both are measured.

A DC motor that turns steadily takes

.. math:: g(i) = A + B \max(F, 0) + C \min(F, 0)

with the force F against the drive. For a permanent magnet or a separate field g(i) = i, exactly:
with k i = T_0 + c w + F/(N eta) and w = (V - V_b - R i)/k the current is linear in F. For a series
motor g(i) = i^2/(1 + i/i_s), the torque per K; its drag makes the line slightly curved. B belongs
to a load that is driven, 1/(N eta k), and C to one that drives the machine back, eta_b/(N k).

When the force changes, the current follows as i + a i' + a b i'' with a = J R/k^2, b = L/R.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MachineError

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP = 0.01
"""Movements are read so often [s]; the measuring chain averages over 0.1 s."""
LAGS = np.array(
    [(0.0, 0.0)]
    + [
        (a, b)
        for a in (*np.arange(0.01, 0.0601, 0.005), *np.arange(0.07, 0.151, 0.02))
        for b in (0.0, 0.005, 0.01, 0.015, 0.02, 0.03)
    ]
)
"""Lags a and b that are tried, shape (n, 2) [s]."""
FASTEST = 5e3
"""Samples where the force changes faster are left out [N/s]."""
BELOW_SLIP = 0.97
"""Samples above this share of the slip current are left out: the clutch may slip already [-]."""
LEAST_SPAN = 300.0
"""Range of forces without which no slope is identified [N]."""
LEAST_DRIVEN = 100.0
"""Force that drives the machine back, from which it gets a slope of its own [N]."""
LEAST_BACK = 20
"""Samples with such forces that this needs."""
LEAST_SHARE = 0.3
"""A slope whose deviation is a larger share of it is not identified [-]."""
BLOCK = 50
"""Samples in a block, where the blocks of too few movements stand for movements."""
NORMAL_REACH = 1.96
"""Half of a 95 % interval of a normal distribution, in standard deviations."""
ENOUGH = 3
"""So many movements give intervals from one to the next."""
LEAST_TREND = 5
"""Movements in which a clutch slipped, without which no trend is stated."""
BLOCKS, SHORTEST_BLOCK = 4, 10
"""A span is cut into at least so many blocks, unless they would be shorter than so many samples:
those of a moving average over 0.1 s repeat each other."""


@dataclass(frozen=True, slots=True)
class TorqueCurve:
    """Torque of a motor over its constant, g(i): i, or of a series motor i^2/(1 + i/i_s).

    Attributes
    ----------
    saturation : float or None
        i_s of a series motor, infinite without saturation; None for a constant field [A].
    """

    saturation: float | None

    def torque(self, current: Any) -> Any:
        """Return g at a current, a number or an array [A or A^2]."""
        if self.saturation is None:
            return current
        return current * abs(current) / (1.0 + abs(current) / self.saturation)

    def slope(self, current: float) -> float:
        """Return dg/di [1 or A]."""
        if self.saturation is None:
            return 1.0
        share = 1.0 + abs(current) / self.saturation
        return abs(current) * (1.0 + share) / share**2

    def current(self, torque: float) -> float:
        """Return the current at which g has a value; of a series motor 0 below none [A]."""
        if self.saturation is None:
            return torque
        half = 0.5 * max(torque, 0.0) / self.saturation
        return half + math.sqrt(half**2 + max(torque, 0.0))


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its standard deviation and 95 % interval, from `count` independent parts.

    The deviation holds what is common to all parts too, such as cross-talk.
    """

    value: float
    deviation: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, value: float, deviation: float, count: int, *, common: float = 0.0) -> "Estimate":
        """Return an estimate whose interval follows Student's t with `count` - 1 degrees.

        The deviation of what is common to all parts is known and widens it.
        """
        from scipy.special import stdtrit

        reach = math.hypot(
            float(stdtrit(max(count - 1, 1), 0.975)) * deviation, NORMAL_REACH * common
        )
        return cls(value, math.hypot(deviation, common), value - reach, value + reach, count)

    @classmethod
    def mean(cls, values: Sequence[float], *, common: float = 0.0) -> "Estimate":
        """Return the mean of two values or more, with the deviation by their scatter."""
        deviation = float(np.std(values, ddof=1) / math.sqrt(len(values)))
        return cls.of(float(np.mean(values)), deviation, len(values), common=common)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunningSpan:
    """One drive in one movement while its motor runs steadily, at every `STEP`.

    Attributes
    ----------
    name : str
        Of the movement.
    number : int
        Its place among the movements of the campaign.
    on, off : float
        When the motor ran [s].
    time : ndarray, shape (n,)
        [s].
    current : ndarray, shape (n,)
        Positive while it drives, freed of the clamp's zero [A].
    load : ndarray, shape (n,)
        Force on the rod against the drive, NaN where none was measured [N].
    others : ndarray, shape (n,)
        Sum of the forces on the other rods, of which its gauge may take up a share [N].
    usable : ndarray of bool, shape (n,)
        Where the motor turns the gear and the inrush is over.
    """

    name: str
    number: int
    on: float
    off: float
    time: Floats
    current: Floats
    load: Floats
    others: Floats
    usable: Flags

    @property
    def duration(self) -> float:
        """Time for which the motor ran [s]."""
        return self.off - self.on


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadLine:
    """Current as a function of the force of one drive in one direction.

    Attributes
    ----------
    idle : Estimate
        Current without force [A].
    slope : Estimate
        Rise of the current with a force that is driven; of a series motor from no force to
        `reference` [A/N].
    covariance : float
        Of the errors of slope and idle current [A^2/N].
    slope_driven_back : Estimate or None
        With a force that drives the machine back [A/N]; None where there was too little of it.
    lag, lag_coil : float
        Of the current behind the force: J R/k^2 and L/R, to the nearest that was tried [s].
    rms : float
        Of what the line leaves [A].
    reference : float
        Largest force that was used [N].
    movements : int
    """

    idle: Estimate
    slope: Estimate
    covariance: float
    slope_driven_back: Estimate | None
    lag: float
    lag_coil: float
    rms: float
    reference: float
    movements: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NotIdentified:
    """Why a quantity is not identified, and the range in which it lies where that is known."""

    reason: str
    low: float = math.nan
    high: float = math.nan


def fit_load_line(
    spans: Sequence[RunningSpan],
    *,
    saturation_current: float | None = None,
    slip_current: float = math.inf,
    cross_talk: float = 0.0,
) -> LoadLine | NotIdentified:
    """Fit the current of a drive to its force over several movements in one direction.

    Parameters
    ----------
    spans : sequence of RunningSpan
    saturation_current : float, optional
        Of a series motor [A]; left out for a permanent magnet or a separate field.
    slip_current : float
        Of the drive's clutch, where it is known [A].
    cross_talk : float
        Standard deviation of the share of the other rods' forces that each gauge takes up; one
        share in all movements, so their scatter does not show it [-].

    Returns
    -------
    LoadLine or NotIdentified
        Deviations are those of a jackknife: each movement is left out in turn, since the errors
        of one (drift of the clamp, temperature, friction) are common to all of its samples. One or
        two movements are cut into blocks of half a second; the interval then holds for them only.

    Notes
    -----
    The deviations do not contain errors of scale of the clamp or the force transducer, which all
    movements share.

    Examples
    --------
    >>> load = np.linspace(0.0, 2000.0, 200)
    >>> given = {"on": 0.0, "off": 2.0, "time": STEP * np.arange(200), "load": load}
    >>> given |= {"current": 0.8 + 2e-4 * load, "others": 0.0 * load, "usable": load >= 0.0}
    >>> spans = [RunningSpan(name=name, number=0, **given) for name in "abc"]
    >>> line = fit_load_line(spans)
    >>> round(line.idle.value, 6), round(1e3 * line.slope.value, 6)
    (0.8, 0.2)
    """
    curve = TorqueCurve(saturation_current)
    used = [(span, _steady(span, BELOW_SLIP * slip_current)) for span in spans]
    back = sum(int((s.load[rows] < -LEAST_DRIVEN).sum()) for s, rows in used) >= LEAST_BACK
    if not back:
        used = [(span, rows & (span.load > 0.0)) for span, rows in used]
    used = [(span, rows) for span, rows in used if rows.any()]
    if not used:
        return NotIdentified(reason="no movement in which the motor runs steadily")
    loads = np.concatenate([span.load[rows] for span, rows in used])
    least, most = (float(v) for v in np.quantile(loads, [0.01, 0.99]))
    span_of_forces = most - max(least, 0.0)
    if span_of_forces < LEAST_SPAN:
        reason = f"the force spans only {span_of_forces:.0f} N, {LEAST_SPAN:.0f} N are needed"
        return NotIdentified(reason=reason)
    if sum(int(rows.sum()) for _, rows in used) < ENOUGH * BLOCK:
        return NotIdentified(reason="the motor runs steadily for less than 1.5 s in all")

    def products(share: float) -> Floats:
        movements = [
            _products(curve.torque(s.current), s.load - share * s.others, rows, back=back)
            for s, rows in used
        ]
        if len(movements) < ENOUGH:
            return np.concatenate(movements)
        return np.stack([blocks.sum(axis=0) for blocks in movements])

    def solved(chosen: Floats) -> tuple[Floats, Floats, float]:
        lag, coefficients, rss = _best(chosen)
        idle = curve.current(coefficients[0])
        slope = (curve.current(coefficients[0] + coefficients[1] * most) - idle) / most
        return np.array([idle, slope, *coefficients[2:]]), lag, rss

    parts = products(0.0)
    whole, count = parts.sum(axis=0), len(parts)
    values, lag, rss = solved(whole)
    without = np.array([solved(whole - part)[0] for part in parts])
    apart = without - without.mean(axis=0)
    spread = np.sqrt((count - 1) / count * (apart**2).sum(axis=0))
    common = (solved(products(cross_talk).sum(axis=0))[0] if cross_talk else values) - values
    found = [
        Estimate.of(float(v), float(s), count, common=abs(float(c)))
        for v, s, c in zip(values, spread, common, strict=True)
    ]
    if not found[1].deviation <= LEAST_SHARE * abs(found[1].value):
        reason = f"the slope is {1e3 * found[1].value:.3f} A/kN with a deviation as large"
        return NotIdentified(reason=reason)
    return LoadLine(
        idle=found[0],
        slope=found[1],
        covariance=float((count - 1) / count * (apart[:, 0] @ apart[:, 1]) + common[0] * common[1]),
        slope_driven_back=found[2] if back and saturation_current is None else None,
        lag=float(lag[0]),
        lag_coil=float(lag[1]),
        rms=math.sqrt(max(rss, 0.0) / whole[0, 0, 0]),
        reference=most,
        movements=len(used),
    )


def _steady(span: RunningSpan, most: float) -> Flags:
    """Return the usable samples at which the force has not just changed fast."""
    if span.load.size < 3:
        return np.zeros(span.load.size, dtype=np.bool_)
    fast = np.abs(np.gradient(span.load, STEP)) > FASTEST
    reach = round(0.16 / STEP)
    near = np.convolve(fast, np.ones(2 * reach + 1), mode="same") > 0.5
    return np.asarray(
        span.usable & ~near & (span.current < most) & np.isfinite(span.current + span.load)
    )


def _products(y: Floats, load: Floats, rows: Flags, *, back: bool) -> Floats:
    """Return products of 1, forces and y of one movement, shape (n_blocks, n_lags, n, n).

    They hold the normal equations of each lag and, first of all, the number of samples.
    """
    columns = [np.maximum(load, 0.0), np.minimum(load, 0.0)] if back else [load]
    given = [np.ones_like(y), *columns, y]
    table = np.stack([np.broadcast_to(v, (len(LAGS), v.size)) for v in given], axis=1)
    table[:, 1:-1] = np.stack([_follow(column) for column in columns], axis=1)
    blocks = np.split(table[:, :, rows], range(BLOCK, int(rows.sum()), BLOCK), axis=2)
    return np.stack([block @ block.transpose(0, 2, 1) for block in blocks])


def _follow(values: Floats) -> Floats:
    """Return what follows values by each pair of `LAGS` from rest, shape (n_lags, n).

    The bilinear transform of 1/(1 + a s + a b s^2); without lag it would ring.
    """
    from scipy.signal import bilinear, lfilter  # slow to load

    first, rises = values[0], values - values[0]
    filters = (bilinear([1.0], [a * b, a, 1.0], 1.0 / STEP) for a, b in LAGS[1:])
    return np.stack([values, *(first + lfilter(*each, rises) for each in filters)])


def _best(products: Floats) -> tuple[Floats, Floats, float]:
    """Return the lags with the least squares, its coefficients and their sum of squares."""
    xx, xy, yy = products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1]
    coefficients = (np.linalg.pinv(xx, rcond=1e-12) @ xy[..., None])[..., 0]
    rss = yy - (coefficients * xy).sum(axis=1)
    at = int(rss.argmin())
    return LAGS[at], coefficients[at], float(rss[at])


# --- slip current of the clutch, and how it changes from movement to movement as the clutch wears


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipLevel:
    """Current of one movement while the clutch slips.

    Attributes
    ----------
    name : str
        Of the movement.
    number : int
        Its place among the movements of the campaign.
    current, deviation : float
        Mean of the slipping span and its standard deviation, from blocks of half a second or, in
        a short span, of a quarter of it [A].
    blocks : int
        So many blocks; 2 where the span is too short for them.
    held : float
        Force that the standing gear holds meanwhile, NaN where none was measured [N].
    """

    name: str
    number: int
    current: float
    deviation: float
    blocks: int
    held: float


def slip_level(name: str, *, number: int, current: Floats, held: Floats) -> SlipLevel:
    """Return the mean current of a slipping span, at every `STEP`, and of the force `held`.

    A span of less than 0.2 s counts as one value with the scatter of its samples.

    Raises
    ------
    MachineError
        With fewer than two samples.
    """
    if current.size < 2:
        text = f"{name}: {current.size} sample of slip current shows no scatter; needs at least two"
        raise MachineError([text], source="slip current")
    length = min(BLOCK, max(current.size // BLOCKS, SHORTEST_BLOCK))
    blocks = [current[k : k + length].mean() for k in range(0, current.size - length + 1, length)]
    deviation = float(np.std(current, ddof=1))
    if len(blocks) > 1:
        deviation = float(np.std(blocks, ddof=1) / math.sqrt(len(blocks)))
    return SlipLevel(
        name=name,
        number=number,
        current=float(current.mean()),
        deviation=deviation,
        blocks=max(len(blocks), 2),
        held=float(held.mean()),
    )


def slip_estimate(levels: Sequence[SlipLevel]) -> Estimate | None:
    """Return the mean slip current of some movements; None without any.

    One movement gives the interval of its own span only.
    """
    if not levels:
        return None
    if len(levels) == 1:
        alone = levels[0]
        return replace(Estimate.of(alone.current, alone.deviation, alone.blocks), count=1)
    return Estimate.mean([level.current for level in levels])


@dataclass(frozen=True, slots=True, kw_only=True)
class ClutchTrend:
    """Change of the slip current of a clutch from movement to movement.

    Attributes
    ----------
    per_throw : Estimate
        Change per movement of the campaign [A].
    share : Estimate or None
        The same over the current that the clutch's torque takes, slip current less idle
        current [1]; None without idle current.
    changes : bool
        Whether the 95 % interval excludes no change.
    """

    per_throw: Estimate
    share: Estimate | None
    changes: bool


def clutch_trend(levels: Sequence[SlipLevel], *, idle: float | None) -> ClutchTrend | None:
    """Return the trend of the slip current; None from fewer than five movements.

    Parameters
    ----------
    levels : sequence of SlipLevel
    idle : float or None
        Current without force [A].

    Examples
    --------
    >>> levels = [SlipLevel(name="", number=n, current=2.0 - 0.01 * n + 1e-4 * (-1)**n,
    ...                     deviation=1e-3, blocks=9, held=6e3) for n in range(6)]
    >>> trend = clutch_trend(levels, idle=0.8)
    >>> round(trend.per_throw.value, 3), trend.changes
    (-0.01, True)
    """
    if len(levels) < LEAST_TREND:
        return None
    number = np.array([level.number - levels[0].number for level in levels], dtype=np.float64)
    (slope, first), covariance = np.polyfit(number, [one.current for one in levels], 1, cov=True)
    deviation, count = math.sqrt(covariance[0, 0]), len(levels) - 1
    per_throw, share = Estimate.of(float(slope), deviation, count), None
    if idle is not None and first > idle:  # else the idle current is not one of this clutch
        share = Estimate.of(float(slope / (first - idle)), deviation / (first - idle), count)
    return ClutchTrend(
        per_throw=per_throw, share=share, changes=per_throw.low > 0.0 or per_throw.high < 0.0
    )
