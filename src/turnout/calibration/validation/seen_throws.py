"""Throws of measured movements at any values of a calibration, as its measuring chain sees them.

Measured and simulated movements stand on common channels and times; gains, zeros and clock are
those that the calibration found. Onsets that no motor current marked are found anew: forces begin
to grow with the cube of time, so that they give the onset to some tens of milliseconds only, and
rather too early in all movements alike. The part of a movement before it touches an object gives it
better.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import fitted_causes, overrides_with, shaped
from turnout.calibration.comparison import Comparison, Key, predicted
from turnout.calibration.evaluate import Evaluator, Response, throws_done
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal, later
from turnout.calibration.misfit import Misfit
from turnout.calibration.result import Calibration
from turnout.calibration.shared import CLOCK, CROSS_TALK, GAIN, ZERO, chain_key

Floats = NDArray[np.float64]
OBJECT, DRIVE = "object", "drive "


@dataclass(frozen=True, slots=True, eq=False)
class SharedBins:
    """Channels and bins of time that all movements share.

    Attributes
    ----------
    channels : tuple of str
        "drive 1", "drive 2", ..., "object".
    time : ndarray, shape (n,)
        Centres of the bins from the onset [s].
    bins : ndarray of int, shape (n,)
        Which bins of the signals these are.
    """

    channels: tuple[str, ...]
    time: Floats
    bins: NDArray[np.intp]

    @classmethod
    def of(cls, movements: Sequence[MeasuredMovement]) -> "SharedBins":
        """Return the grid from the onset to the end of the longest movement."""
        names = dict.fromkeys(channel_of(s) for item in movements for s in item.signals)
        time = movements[0].signals[0].time
        last = max(item.length for item in movements)
        bins = np.flatnonzero((time >= 0.0) & (time + 0.5 * BIN <= last))
        ordered = sorted(names, key=lambda name: (name == OBJECT, name))
        return cls(tuple(ordered), time[bins], bins)

    def measured(self, movements: Sequence[MeasuredMovement]) -> Floats:
        """Return means over bins, shape (n_channels, n_movements, n); NaN where there are none."""
        found = self._empty(movements)
        for number, item in enumerate(movements):
            inside = self._inside(item)
            for signal in item.signals:
                row = np.where(inside, signal.values[self.bins], np.nan)
                found[self.channels.index(channel_of(signal)), number] = row
        return found

    def predicted(
        self,
        movements: Sequence[MeasuredMovement],
        responses: Sequence[Response],
        *,
        shifts: Floats,
    ) -> Floats:
        """Return the same of simulations, also where nothing was measured.

        `shifts` is how much later than marked each movement began, shape (n_movements,) [s].
        """
        found = self._empty(movements)
        rows = zip(movements, responses, shifts.tolist(), strict=True)
        for number, (item, response, shift) in enumerate(rows):
            inside, any_signal = self._inside(item), item.signals[0]
            known = {channel_of(signal): signal.recorder for signal in item.signals}
            for row, name in enumerate(self.channels):
                drive = "" if name == OBJECT else name.removeprefix(DRIVE)
                wanted = Signal(
                    channel="drive_force" if drive else "object_force",
                    drive=drive,
                    time=any_signal.time,
                    values=any_signal.values,
                    recorder=known.get(name, any_signal.recorder),
                )
                values = predicted(response, item, wanted, self.bins, shift=shift)
                found[row, number] = np.where(inside, values, np.nan)
        return found

    def _empty(self, movements: Sequence[MeasuredMovement]) -> Floats:
        return np.full((len(self.channels), len(movements), self.time.size), np.nan)

    def _inside(self, item: MeasuredMovement) -> NDArray[np.bool_]:
        return np.asarray(self.time + 0.5 * BIN <= item.length)


def channel_of(signal: Signal) -> str:
    """Return the channel of a signal as validations name it."""
    return f"{DRIVE}{signal.drive}" if signal.drive else OBJECT


OTHER_CHAIN = (
    "gains, zeros and clock of the calibration are of another channel map, and not applied"
)


def found_chain(dataset: xr.Dataset, calibration: Calibration) -> Mapping[str, tuple[float, float]]:
    """Return what is known of the chain of a campaign: nothing where it is another one.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`.
    calibration : Calibration
        With value and deviation of each gain, zero and of the clock.
    """
    own = str(dataset.attrs.get("channel_map_hash", ""))
    return calibration.chain if own == calibration.about.get("channel_map_hash", "") else {}


def through_chain(
    forces: Floats, later: Floats, grid: SharedBins, chain: Mapping[str, tuple[float, float]]
) -> Floats:
    r"""Return forces as the chain of a campaign shows them.

    .. math:: F_{seen} = (1 + g) F + \sum_o x_o F_o - c \, t \dot F + z

    with gain `g` and zero `z` of each channel, cross-talk `x` from each other one, and the share
    `c` by which seconds are too short.

    Parameters
    ----------
    forces, later : ndarray, shape (n_channels, n_movements, n_times)
        Simulated [N], and their change with a later onset, :math:`-\dot F` [N/s].
    grid : SharedBins
        With channels and times from the onset.
    chain : mapping of str to (float, float)
        From `found_chain`.
    """
    gain, clock, zero = _of_chain(grid, chain, 0)
    mixed = forces + np.tensordot(gain, forces, axes=1)
    return np.asarray(mixed + clock * grid.time * later + zero)


def chain_directions(
    forces: Floats, later: Floats, grid: SharedBins, chain: Mapping[str, tuple[float, float]]
) -> Floats:
    """Find the change of forces with one deviation of each unknown of the chain [N].

    As `through_chain`: gain or cross-talk from each channel, clock and zeros, shape
    (n_channels + 2, n_channels, n_movements, n_times). Each channel has values of its own, so that
    sums over channels of these mean nothing.
    """
    gain, clock, zero = _of_chain(grid, chain, 1)
    of_sources = gain.T[:, :, np.newaxis, np.newaxis] * forces[:, np.newaxis]
    zeros = np.broadcast_to(zero, forces.shape)
    return np.stack([*of_sources, clock * grid.time * later, zeros])


def _of_chain(
    grid: SharedBins, chain: Mapping[str, tuple[float, float]], which: int
) -> tuple[Floats, float, Floats]:
    """Return gains on the diagonal of a matrix of cross-talk, clock and zeros; 0 for none.

    Of channels by their sources, shape (n_channels, n_channels), and of channels, shape
    (n_channels, 1, 1). `which` is 0 for values and 1 for deviations.
    """

    def value(kind: str, *key: str, source: Key = ("", "")) -> float:
        return chain.get(chain_key(kind, *key, source=source), (0.0, 0.0))[which]

    keys = [
        ("object_force", "") if name == OBJECT else ("drive_force", name.removeprefix(DRIVE))
        for name in grid.channels
    ]
    gains = [
        [
            value(GAIN, *key) if key == other else value(CROSS_TALK, *key, source=other)
            for other in keys
        ]
        for key in keys
    ]
    zeros = [value(ZERO, *key) for key in keys]
    return np.array(gains), value(CLOCK), np.reshape(zeros, (-1, 1, 1))


# As far as a marked onset may be off, and how finely this is searched at first [s].
REACH, COARSE, FINE = 0.4, 0.01, 0.001
# Expected of a marked onset: beyond it, forces must say so more clearly [s].
UNCERTAINTY = 0.05
# Before the onset, and before the contact [s]; a part shorter than `LEAST` is not used.
BEFORE, CLEARANCE, LEAST = 0.3, 0.1, 0.3
# Onsets that currents mark are good to 5 ms each; three times that in all movements is a lead [s].
CLEAR_LEAD = 0.015
# Share of the largest force that a model may miss without saying something of the onset [-].
MISSED = 0.01


def with_rest(response: Response) -> Response:
    """Return a response that stands still for a while before it begins.

    A closed switch may press its rods with some kilonewtons. Simulations begin a little before the
    first onset; without this, all forces would be zero before, and a shift would be found that
    avoids the step.
    """
    if response.failure:
        return response
    cell = float(response.time[1] - response.time[0])
    count = round((BEFORE + REACH) / cell)
    time = np.concatenate([response.time[0] + cell * np.arange(-count, 0), response.time])

    def held(row: Floats) -> Floats:
        return np.concatenate([np.full(count, row[0]), row])

    return replace(
        response,
        time=time,
        drive_force={name: held(row) for name, row in response.drive_force.items()},
        marker={name: held(row) for name, row in response.marker.items()},
        object_force=held(response.object_force),
    )


def onset_shifts(movements: Sequence[MeasuredMovement], responses: Sequence[Response]) -> Floats:
    """Return how much later than marked each movement began.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; onsets without motor current are searched.
    responses : sequence of Response
        Of the model, one each, from `with_rest`.

    Returns
    -------
    ndarray, shape (n_movements,)
        [s]; where motor currents marked the onsets, the lead of the motors over the rods, zero for
        none; of a movement that touches its object at once, the median of the others in its
        direction.
    """
    found = np.array(
        [_shift(item, response) for item, response in zip(movements, responses, strict=True)]
    )
    clocked = np.array([item.clocked for item in movements], dtype=np.bool_)
    found[clocked] = _lead(found[clocked])
    directions = np.array([item.direction for item in movements])
    for number in np.flatnonzero(np.isnan(found)):
        alike = found[(directions == directions[number]) & np.isfinite(found)]
        found[number] = float(np.median(alike)) if alike.size else 0.0
    return found


def _lead(shifts: Floats) -> float:
    """Return how long motors run before the rods move, where all movements say so [s].

    Examples
    --------
    >>> _lead(np.array([0.149, 0.151, np.nan])), _lead(np.array([0.004, -0.003]))
    (0.15, 0.0)
    """
    known = shifts[np.isfinite(shifts)]
    lead = float(np.median(known)) if known.size > 1 else 0.0
    return lead if abs(lead) > CLEAR_LEAD else 0.0


def _shift(item: MeasuredMovement, response: Response) -> float:
    """Return the shift that makes the free part of one movement fit best; NaN where there is none.

    The free part ends where the model touches the object, on a clock that may be off itself.
    """
    end = item.length
    if item.size > 0 and np.isfinite(response.contact_time):
        end = min(end, response.contact_time - response.onsets[item.direction] - CLEARANCE)
    if response.failure or end < LEAST:
        return float("nan")

    def cost(shift: float) -> float:
        total = (shift / UNCERTAINTY) ** 2
        for signal in item.signals:
            if signal.channel != "drive_force":
                continue
            late = min(end + shift, item.length)
            inside = (signal.time >= -BEFORE) & (signal.time <= late)
            bins = np.flatnonzero(inside & np.isfinite(signal.values))
            if not bins.size:
                continue
            scale = MISSED * max(float(np.nanmax(np.abs(signal.values))), 1.0)
            away = predicted(response, item, signal, bins, shift=shift) - signal.values[bins]
            total += bins.size * float(np.mean((away / scale) ** 2))
        return total

    coarse = np.arange(-REACH, REACH + 0.5 * COARSE, COARSE)
    near = coarse[int(np.argmin([cost(shift) for shift in coarse]))]
    fine = near + np.arange(-COARSE, COARSE + 0.5 * FINE, FINE)
    return float(fine[int(np.argmin([cost(shift) for shift in fine]))])


Report = Callable[[str, int, int], None]
# Stages: predictions and their slopes; wrong values where the verdict would notice them.
PREDICTING, CHECKING = "predicting", "checking what would be noticed"


def thrown_as_fitted(
    movements: Sequence[MeasuredMovement], calibration: Calibration, evaluator: Evaluator
) -> Misfit:
    """Return movements as a calibration throws them: with its causes, and objects as found.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        Of a campaign.
    calibration : Calibration
        Values, causes and objects; where it was fitted with fine throws, what these change is part
        of each response.
    evaluator : Evaluator
        Open; throws the panel as it was before the calibration.
    """
    parameters = calibration.parameters
    causes = fitted_causes(evaluator.panel, parameters)
    found = Misfit(
        evaluator=evaluator,
        parameters=(),
        base={**calibration.values, **{item.name: item.value for item in calibration.objects}},
        movements=tuple(movements),
        comparison=Comparison(noise={}),
        law=partial(overrides_with, causes, parameters),
        shape=partial(shaped, causes),
    )
    return found.refined({}, halved=False) if calibration.about.get("refined") else found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """Throws of movements, seen as they were measured.

    Attributes
    ----------
    thrown : Misfit
        From `thrown_as_fitted`.
    grid : SharedBins
        On which forces are compared.
    chain : mapping of str to (float, float)
        Gains, zeros and clock as they were found: a sound prediction would differ by them.
    shifts : ndarray, shape (n_movements,)
        How much later than marked each movement began [s].
    """

    thrown: Misfit
    grid: SharedBins
    chain: Mapping[str, tuple[float, float]]
    shifts: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def movements(self) -> tuple[MeasuredMovement, ...]:
        """Those that are thrown."""
        return self.thrown.movements

    def of(self, numbers: NDArray[np.intp]) -> "Seen":
        """Return the same for some of the movements."""
        return replace(self, thrown=self.thrown.of(numbers.tolist()), shifts=self.shifts[numbers])

    def responses(self, settings: Sequence[Mapping[str, float]]) -> list[list[Response]]:
        """Return the response to each movement at each of several values by name, in SI."""
        return [[with_rest(item) for item in row] for row in self.thrown.responses(settings)]

    def forces(self, responses: Sequence[Response]) -> Floats:
        """Return forces through the chain, shape (n_channels, n_movements, n_times) [N]."""
        row = self.grid.predicted(self.movements, responses, shifts=self.shifts)
        return through_chain(row, later(row), self.grid, self.chain)


def announce(
    report: Report | None,
    stage: str,
    times: int,
    *,
    movements: Sequence[MeasuredMovement],
    evaluator: Evaluator,
) -> None:
    """Report each throw from now on, as one of those that throw all objects so many times.

    Parameters
    ----------
    report : callable or None
        Called after each throw with the stage, and the throws done and in all of that stage.
    stage : str
        What the throws are for.
    times : int
        How often movements are thrown; repeats are thrown once.
    movements : sequence of MeasuredMovement
        Those that are.
    evaluator : Evaluator
        That throws them.
    """
    if report is not None:
        total = times * len({(item.place, item.size) for item in movements})
        begun = throws_done(evaluator)
        evaluator.on_throw = lambda: report(stage, throws_done(evaluator) - begun, total)
