"""How one measured movement is compared with a simulated one: alignment, noise, doubts.

What differs from movement to movement, and is not asked for, has a prior and is integrated out: the
true onset, the zero of each channel, and parameters that scatter, such as friction. Whitened
residuals therefore hold only what the parameters of a fit can tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.calibration.evaluate import Response
from turnout.calibration.noise import Noise
from turnout.calibration.observed import Movement, Signal
from turnout.calibration.predict import compared, prediction

Floats = NDArray[np.float64]
ONSET_STEP = 2e-3
MOST_SHIFT = 0.4
ONSET_TURNS = 12
Key = tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """What is not known of each movement, as standard deviations.

    Attributes
    ----------
    clocked_onset, onset : float
        Of the marked onset, where currents told it and where only forces did [s].
    zero : float
        Of the zero of a force channel [N].
    gain : float
        Of the sensitivity of a channel, cross-talk included, from movement to movement [-].
    common_gain, cross_talk : float
        Of the sensitivity, and of what each channel takes up of each other one, where all
        movements share it: no residual need show it, so it widens the intervals [-].
    solver : float
        Of each value, as a share of it, from mesh and step: what a finer twin moved it by [-].
    """

    clocked_onset: float = 0.005
    onset: float = 0.05
    zero: float = 20.0
    gain: float = 1e-3
    common_gain: float = 1e-3
    cross_talk: float = 5e-4
    solver: float = 1.2e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """How movements are compared.

    Attributes
    ----------
    noise : mapping of (channel, drive) to Noise
        Of each channel.
    channels : tuple of str
        Of the schema.
    window : tuple
        From the onset [s]; None for the end of the movement and its rest.
    scatter : mapping of str to float
        Relative standard deviation of parameters from movement to movement.
    doubt : Doubt
        Of onset and zero.
    outlying : float
        Residuals beyond this many standard deviations count less [-]; infinite far from the fit,
        where they say where to go.
    """

    noise: Mapping[Key, Noise]
    channels: tuple[str, ...] = ("drive_force", "object_force")
    window: tuple[float, float | None] = (0.0, None)
    scatter: Mapping[str, float] = field(default_factory=dict)
    doubt: Doubt = field(default_factory=Doubt)
    outlying: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensitivity:
    """How a movement answers to a parameter that scatters.

    Attributes
    ----------
    here, aside : Response
        At the movement's own value, and one step aside.
    step, own : float
        The step, and how far the own value is from the common one, as shares of the common one.
    """

    here: Response
    aside: Response
    step: float
    own: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """How one movement is compared: bins, onset, and the whitening of its residuals.

    Attributes
    ----------
    movement : Movement
        Measured.
    parts : list of (Signal, ndarray of int)
        What is compared.
    measured : ndarray, shape (n,)
        All parts in a row.
    shift : float
        How much later than marked the movement began, as estimated [s].
    columns : ndarray, shape (n, 1 + s)
        Change of the prediction with the onset [1/s] and with the share of each scattering
        parameter.
    own : mapping of str to float
        By scattering parameter: where throws are made, as a share of the common value.
    factors : tuple of ndarray
        Cholesky factor of the noise of each part.
    basis, shrink : ndarray, shape (n, q) and (q,)
        Directions in which the movement is in doubt, whitened, and how far they are shrunk.
    doubts : ndarray, shape (1 + s, n)
        From a row with its noise made independent to the estimates.
    estimates : mapping of str to float
        Of what is in doubt: "onset" [s], scattering parameters as shares.
    """

    movement: Movement
    parts: list[tuple[Signal, NDArray[np.intp]]]
    measured: Floats
    shift: float
    columns: Floats
    own: Mapping[str, float]
    factors: tuple[Floats, ...]
    basis: Floats
    shrink: Floats
    doubts: Floats
    estimates: Mapping[str, tuple[float, float]]

    def of(self, response: Response, own: Mapping[str, float] | None = None) -> Floats:
        """Return the prediction of a response, brought back to doubts about zero.

        Parameters
        ----------
        response : Response
            To the movement.
        own : mapping of str to float, optional
            Where it was thrown; default as the view was made.
        """
        places = [self.shift, *(own if own is not None else self.own).values()]
        return np.asarray(self.plain(response) - self.columns @ np.array(places))

    def own_after(self, row: Floats) -> dict[str, float]:
        """Return the estimates of scattering parameters from a row of measured less `of`."""
        found = self.doubts @ self.noise_whitened(row)
        return {name: float(found[n]) for n, name in enumerate(self.own, 1)}

    def plain(self, response: Response) -> Floats:
        """Return the prediction of a response at the estimated onset."""
        return prediction(response, self.movement, self.parts).row(self.shift)

    def noise_whitened(self, row: Floats) -> Floats:
        """Return a row with its noise made independent; doubts are left in."""
        return _unnoised(row, self.factors)

    def whitened(self, row: Floats) -> Floats:
        """Return a row, or each of several columns, made independent, doubts shrunk."""
        clean = self.noise_whitened(row)
        return np.asarray(clean - (self.basis * self.shrink) @ (self.basis.T @ clean))

    def left_over(self, response: Response) -> list[Floats]:
        """Return the residuals of each part, less what the doubts of this movement explain."""
        row = self.measured - self.of(response)
        clean = self.noise_whitened(row)
        explained = 1.0 - (1.0 - self.shrink) ** 2
        clean = clean - self.basis @ (explained * (self.basis.T @ clean))
        found, first = [], 0
        for factor in self.factors:
            found.append(factor @ clean[first : first + factor.shape[0]])
            first += factor.shape[0]
        return found


def _unnoised(row: Floats, factors: Sequence[Floats]) -> Floats:
    """Return a row, or each of several columns, with its noise made independent."""
    found, first = [], 0
    for factor in factors:
        piece = row[first : first + factor.shape[0]]
        found.append(solve_triangular(factor, piece, lower=True, check_finite=False))
        first += factor.shape[0]
    return np.concatenate(found)


def view_of(
    movement: Movement,
    response: Response,
    *,
    comparison: Comparison,
    sensitivities: Mapping[str, Sensitivity],
) -> View:
    """Make the view of a movement about a response.

    Parameters
    ----------
    movement : Movement
        Measured.
    response : Response
        Simulated at the point that the view is made about.
    comparison : Comparison
        How movements are compared.
    sensitivities : mapping of str to Sensitivity
        For each parameter that scatters.
    """
    parts = compared(movement, comparison.channels, comparison.window)
    factors = tuple(
        comparison.noise[signal.channel, signal.drive].factor(signal.time[bins])
        for signal, bins in parts
    )
    view = _aligned(movement, response, parts, factors, comparison, sensitivities)
    if comparison.outlying == float("inf"):
        return view
    # What is far off once all is aligned, such as an impact, counts less.
    trusted = [
        factor * np.maximum(1.0, np.abs(row) / (comparison.outlying * deviations(factor)))[:, None]
        for factor, row in zip(factors, view.left_over(response), strict=True)
    ]
    return _aligned(movement, response, parts, tuple(trusted), comparison, sensitivities)


def deviations(factor: Floats) -> Floats:
    """Return the standard deviation of each bin from the factor of its covariance."""
    return np.asarray(np.sqrt((factor**2).sum(axis=1)), dtype=np.float64)


def _aligned(
    movement: Movement,
    response: Response,
    parts: list[tuple[Signal, NDArray[np.intp]]],
    factors: tuple[Floats, ...],
    comparison: Comparison,
    sensitivities: Mapping[str, Sensitivity],
) -> View:
    """Estimate what is in doubt of a movement, the onset by turns, and whiten by that."""
    measured = np.concatenate([signal.values[bins] for signal, bins in parts])
    spread = comparison.doubt.clocked_onset if movement.clocked else comparison.doubt.onset
    names = ["onset", *sensitivities]
    scales = [spread, *(comparison.scatter[name] for name in sensitivities)]
    zeros = _channel_columns(parts, measured, comparison.doubt)
    ahead = prediction(response, movement, parts)
    pairs = [
        (prediction(s.aside, movement, parts), prediction(s.here, movement, parts), s.step)
        for s in sensitivities.values()
    ]
    shift = 0.0
    for _ in range(ONSET_TURNS):
        turned = (ahead.row(shift + ONSET_STEP) - ahead.row(shift - ONSET_STEP)) / (
            2.0 * ONSET_STEP
        )
        columns = [turned] + [
            (aside.row(shift) - here.row(shift)) / step for aside, here, step in pairs
        ]
        doubts = np.column_stack([*(c * s for c, s in zip(columns, scales, strict=True)), *zeros])
        clean = _unnoised(doubts, factors)
        places = np.array([shift, *(s.own for s in sensitivities.values())])
        plain = np.column_stack(columns)
        rest = measured - ahead.row(shift) + plain @ places
        inverse = np.linalg.inv(np.eye(clean.shape[1]) + clean.T @ clean)
        solve = inverse @ clean.T
        found = solve @ _unnoised(rest, factors)
        before, shift = shift, float(np.clip(found[0] * spread, -MOST_SHIFT, MOST_SHIFT))
        if abs(shift - before) < 1e-4:
            break
    basis, sizes, _ = np.linalg.svd(clean, full_matrices=False)
    return View(
        movement=movement,
        parts=parts,
        measured=measured,
        shift=before,
        columns=plain,
        own={name: s.own for name, s in sensitivities.items()},
        factors=factors,
        basis=basis,
        shrink=1.0 - 1.0 / np.sqrt(1.0 + sizes**2),
        doubts=np.array(scales)[:, None] * solve[: len(scales)],
        estimates={
            name: (float(found[n] * scale), float(np.sqrt(inverse[n, n]) * scale))
            for n, (name, scale) in enumerate(zip(names, scales, strict=True))
        },
    )


def _channel_columns(
    parts: Sequence[tuple[Signal, NDArray[np.intp]]], measured: Floats, doubt: Doubt
) -> list[Floats]:
    """Return a column for the zero and one for the gain of each part."""
    columns, first = [], 0
    for _, bins in parts:
        place = slice(first, first + bins.size)
        for values in (np.full(bins.size, doubt.zero), doubt.gain * measured[place]):
            column = np.zeros(measured.size)
            column[place] = values
            columns.append(column)
        first += bins.size
    return columns
