r"""Predict every movement of a campaign, with the band in which the measurement should lie.

Measured and simulated movements stand on common channels and times; gains, zeros and clock are
those that the calibration found. Onsets that no motor current marked are found again: forces begin
to grow with the cube of time, so that they give the onset to some tens of milliseconds only, and
rather too early in all movements alike. The part of a movement before it touches an object gives it
better.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.comparison import (
    Comparison,
    Key,
    Noise,
    Uncertainty,
    align,
    measured_noise,
    peaks_of,
    prediction,
)
from turnout.calibration.covariance import NORMAL_95
from turnout.calibration.evaluate import Evaluator, Response, throws_done
from turnout.calibration.linearisation import stepped_value
from turnout.calibration.measured_movements import (
    BIN,
    MeasuredMovement,
    Signal,
    later,
    observe,
)
from turnout.calibration.misfit import Misfit
from turnout.calibration.requirements import exclude_oversized_objects, excluded_movements
from turnout.calibration.result import (
    Calibration,
    fitted_causes,
    overrides_with,
    shaped,
)
from turnout.calibration.sensors import LATE
from turnout.calibration.shared import CLOCK, CROSS_TALK, GAIN, ZERO, chain_key
from turnout.calibration.stages import FRICTION_SCATTER, Fitted, Parameter
from turnout.calibration.validation.acceptance import (
    PossibleError,
    Rules,
    judge,
    judged_movements,
    noticed_errors,
    rows_of,
)
from turnout.calibration.validation.prediction_bands import (
    ThrowScatter,
    coverage_limits,
    leave_out_places,
    scatter_of,
    variance_of,
)
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import MeasurementError
from turnout.core.provenance import provenance
from turnout.core.threads import one_blas_thread
from turnout.metric.agreement import (
    band_coverage,
    channel_scale,
    nrmse,
    repeat_groups,
    repeat_spread,
    rms_difference,
)
from turnout.metric.channel_features import channel_features, contact_time
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
Chain = Mapping[str, tuple[float, float]]
Report = Callable[[str, int, int], None]
DIMS = ("channel", "movement", "time")
OBJECT = "object"
KNOWN = Uncertainty()


@dataclass(frozen=True, slots=True, eq=False)
class SharedBins:
    """Channels and bins of time that all movements share.

    Attributes
    ----------
    keys : tuple of (str, str)
        Channel and drive: of each drive, then that of the object.
    time : ndarray, shape (n,)
        Centres of the bins from the onset [s].
    bins : ndarray of int, shape (n,)
        Which bins of the signals these are.
    """

    keys: tuple[Key, ...]
    time: Floats
    bins: NDArray[np.intp]

    @classmethod
    def of(cls, movements: Sequence[MeasuredMovement]) -> "SharedBins":
        """Return the grid from the onset to the end of the longest movement."""
        keys = {(s.channel, s.drive) for item in movements for s in item.signals}
        time = movements[0].signals[0].time
        last = max(item.length for item in movements)
        bins = np.flatnonzero((time >= 0.0) & (time + 0.5 * BIN <= last))
        return cls(tuple(sorted(keys)), time[bins], bins)

    @property
    def channels(self) -> list[str]:
        """Names of the channels: "drive 1", "drive 2", ..., "object"."""
        return [f"drive {drive}" if drive else OBJECT for _, drive in self.keys]

    def measured(self, movements: Sequence[MeasuredMovement]) -> Floats:
        """Return means over bins, shape (n_channels, n_movements, n); NaN for none."""
        rows = [[signal.values[self.bins] for signal in self._signals(m)] for m in movements]
        return self._inside(movements, rows)

    def predicted(
        self,
        movements: Sequence[MeasuredMovement],
        responses: Sequence[Response],
        *,
        shifts: Floats,
        rate: float = 0.0,
    ) -> Floats:
        """Return the same of simulations, also where nothing was measured.

        `shifts` is how much later than marked each movement began, shape (n_movements,) [s], and
        `rate` the share by which seconds of the recorder are too short [-].
        """
        rows = [
            prediction(response, item, [(signal, self.bins) for signal in self._signals(item)])
            .row(shift, rate)
            .reshape(len(self.keys), -1)
            for item, response, shift in zip(movements, responses, shifts.tolist(), strict=True)
        ]
        return self._inside(movements, rows)

    def _signals(self, item: MeasuredMovement) -> list[Signal]:
        """Return the signal of each channel; of one that was not measured, without values."""
        known, any_signal = {(s.channel, s.drive): s for s in item.signals}, item.signals[0]
        time, recorder = any_signal.time, any_signal.recorder
        nothing = np.full(time.size, np.nan)
        return [
            known.get(key)
            or Signal(channel=key[0], drive=key[1], time=time, values=nothing, recorder=recorder)
            for key in self.keys
        ]

    def _inside(self, movements: Sequence[MeasuredMovement], rows: Sequence[object]) -> Floats:
        """Return rows by movement as an array by channel, NaN after the end of each movement."""
        found = np.array(rows, dtype=np.float64).transpose(1, 0, 2)
        ends = np.array([item.length for item in movements])
        return np.where(self.time + 0.5 * BIN <= ends[:, None], found, np.nan)


OTHER_CHAIN = (
    "gains, zeros and clock of the calibration are of another channel map, and not applied"
)


def found_chain(dataset: xr.Dataset, calibration: Calibration) -> Chain:
    """Return what is known of the chain of a campaign: nothing of another one.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`.
    calibration : Calibration
        With value and deviation of each gain, zero and of the clock.
    """
    own = str(dataset.attrs.get("channel_map_hash", ""))
    return calibration.chain if own == calibration.about.get("channel_map_hash", "") else {}


def of_chain(keys: Sequence[Key], chain: Chain, which: int) -> tuple[Floats, Floats, float]:
    """Return gains on the diagonal of a matrix of cross-talk, zeros [N] and clock; 0 for none.

    Of channels by their sources, shape (n_channels, n_channels), and of channels, shape
    (n_channels, 1, 1). `which` is 0 for values and 1 for deviations.
    """

    def value(kind: str, key: Key = ("", ""), source: Key = ("", "")) -> float:
        return chain.get(chain_key(kind, *key, source=source), (0.0, 0.0))[which]

    gains = [
        [value(GAIN, key) if key == other else value(CROSS_TALK, key, other) for other in keys]
        for key in keys
    ]
    zeros = np.reshape([value(ZERO, key) for key in keys], (-1, 1, 1))
    return np.array(gains), zeros, value(CLOCK)


def through_chain(
    responses: Sequence[Response],
    movements: Sequence[MeasuredMovement],
    grid: SharedBins,
    chain: Chain,
    *,
    shifts: Floats,
) -> Floats:
    r"""Return forces as the chain of a campaign shows them, by channel, movement and time [N].

    .. math:: F_{seen}(t) = (1 + g) F(t / (1 + c)) + \sum_o x_o F_o(t / (1 + c)) + z

    with gain `g` and zero `z` of each channel, cross-talk `x` from each other one, and the share
    `c` by which seconds are too short.

    Parameters
    ----------
    responses, movements : sequence of Response, of MeasuredMovement
        Simulated, and what was thrown.
    grid : SharedBins
        With channels and times from the onset.
    chain : mapping of str to (float, float)
        From `found_chain`.
    shifts : ndarray, shape (n_movements,)
        How much later than marked each movement began [s].
    """
    gain, zero, clock = of_chain(grid.keys, chain, 0)
    forces = grid.predicted(movements, responses, shifts=shifts, rate=clock)
    return np.asarray(forces + np.tensordot(gain, forces, axes=1) + zero)


def chain_directions(forces: Floats, grid: SharedBins, chain: Chain) -> Floats:
    """Find the change of forces with one deviation of each unknown of the chain [N].

    Gain or cross-talk from each channel, clock and zeros, shape
    (n_channels + 2, n_channels, n_movements, n_times). Each channel has values of its own, so that
    sums over channels of these mean nothing.
    """
    gain, zero, clock = of_chain(grid.keys, chain, 1)
    of_sources = gain.T[:, :, None, None] * forces[:, None]
    return np.stack([*of_sources, clock * grid.time * later(forces), zero + 0.0 * forces])


# Left out before the contact [s]; a part that is then shorter than `LEAST` is not used.
CLEARANCE, LEAST = 0.1, 0.3
# A lead in all movements that is no chance [s].
CLEAR_LEAD = LATE * KNOWN.clocked_onset
# Share of the largest force that a model may miss without saying something of the onset [-].
MISSED = 0.01


def onset_shifts(movements: Sequence[MeasuredMovement], responses: Sequence[Response]) -> Floats:
    """Return how much later than marked each movement began.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; onsets without motor current are searched.
    responses : sequence of Response
        Of the model, one each.

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
    """Return the shift that makes the free part of one movement fit best; NaN for no such part.

    The free part ends where the model touches the object, on a clock that may be off itself.
    """
    noise = {key: Noise(white=MISSED * max(peak, 1.0)) for key, peak in peaks_of([item]).items()}
    # As if currents said no more of the onset than forces.
    known = Uncertainty(onset=KNOWN.onset, clocked_onset=KNOWN.onset, zero=0.0, gain=0.0)
    touched, shift = item.length, 0.0
    if item.size > 0 and np.isfinite(response.contact_time):
        touched = response.contact_time - response.onsets[item.direction] - CLEARANCE
    if response.failure or min(touched, item.length) < LEAST:
        return float("nan")
    for _ in range(2):
        window = (-np.inf, min(touched + shift, item.length))
        how = Comparison(noise=noise, channels=("drive_force",), window=window, uncertainty=known)
        shift = align(item, response, comparison=how, sensitivities={}).shift
    return shift


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """Movements as the calibrated model throws them, seen as they were measured.

    Attributes
    ----------
    thrown : Misfit
        Throws them.
    grid : SharedBins
        On which forces are compared.
    chain : mapping of str to (float, float)
        Gains, zeros and clock as they were found: a sound prediction would differ by them.
    shifts : ndarray, shape (n_movements,)
        How much later than marked each movement began [s].
    forces : ndarray, shape (n_channels, n_movements, n_times)
        At the calibrated values [N].
    slopes : ndarray, shape (p, n_channels, n_movements, n_times)
        Of these with each fitted value [N over its unit].
    failures : tuple of str
        Why a throw for one of these slopes failed; empty for none.
    failed : tuple of str
        Movements that cannot be simulated at the calibrated values, and why.
    """

    thrown: Misfit
    grid: SharedBins
    chain: Chain
    shifts: Floats
    forces: Floats
    slopes: Floats
    failures: tuple[str, ...]
    failed: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        movements: Sequence[MeasuredMovement],
        calibration: Calibration,
        evaluator: Evaluator,
        *,
        chain: Chain,
        report: Report | None,
    ) -> "Model":
        """Throw all movements at the calibrated values, and one step aside for each parameter."""
        fitted, values = calibration.fitted, calibration.values
        asides = {item.name: stepped_value(_parameter(item), item.value) for item in fitted}
        times = 1 + len(fitted) + bool(calibration.about.get("refined"))
        announce(report, "predicting", times, movements=movements, evaluator=evaluator)
        thrown = thrown_as_fitted(movements, calibration, evaluator)
        plain, *aside = thrown.responses([values, *({**values, n: v} for n, v in asides.items())])
        failed = [
            f"{item.text}: cannot be simulated: {response.failure}"
            for item, response in zip(movements, plain, strict=True)
            if response.failure
        ]
        if len(failed) == len(movements):
            raise MeasurementError(failed[:3], source="validation")
        grid, shifts = SharedBins.of(movements), onset_shifts(movements, plain)
        seen = [
            through_chain(row, movements, grid, chain, shifts=shifts) for row in (plain, *aside)
        ]
        steps = [asides[item.name] - item.value for item in fitted]
        slopes = [(row - seen[0]) / step for row, step in zip(seen[1:], steps, strict=True)]
        return cls(
            thrown=thrown,
            grid=grid,
            chain=chain,
            shifts=shifts,
            forces=seen[0],
            slopes=np.array(slopes).reshape(len(fitted), *seen[0].shape),
            failures=tuple(_failure(movements, seen[0], row) for row in aside),
            failed=tuple(failed),
        )

    def made(
        self, settings: Sequence[Mapping[str, float]], numbers: NDArray[np.intp]
    ) -> list[Floats | str]:
        """Return forces of some movements at values by name, or why a throw failed."""
        part, shifts = self.thrown.of(numbers.tolist()), self.shifts[numbers]
        return [
            _failure(part.movements, self.forces[:, numbers], row)
            or through_chain(row, part.movements, self.grid, self.chain, shifts=shifts)
            for row in part.responses(settings)
        ]


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


def _parameter(item: Fitted) -> Parameter:
    return Parameter(
        name=item.name,
        keys=item.keys,
        start=item.value,
        lower=item.lower,
        upper=item.upper,
        unit=item.unit,
        transform="log" if item.lower > 0 else "linear",
    )


def _failure(movements: Sequence[MeasuredMovement], forces: Floats, row: Sequence[Response]) -> str:
    """Return why the first of some throws failed whose movement is predicted; else nothing."""
    known = np.asarray(np.isfinite(forces).any(axis=(0, 2)))
    for item, is_known, response in zip(movements, known, row, strict=True):
        if response.failure and is_known:
            return f"{item.text}: {' '.join(response.failure.split())}"
    return ""


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


# Parameters that a throw can have of its own, by the end of their key, and how much is expected.
SCATTERING = {"friction_coefficient": FRICTION_SCATTER, "saturation_force": 0.01}
# Largest errors of a value, as a share, and of a length [m] that the verdict is tried for.
LARGEST_SHARE, LARGEST_LENGTH = 0.5, 1e-2
SHEET = ("direction", "size", "place", "repeat", "slipped")


@one_blas_thread()
def validate(
    dataset: xr.Dataset,
    panel: LoadedPanel,
    calibration: Calibration,
    *,
    evaluator: Evaluator,
    report: Report | None = None,
) -> xr.Dataset:
    r"""Predict every movement of a campaign and set it beside what was measured.

    The variance of a measured instant about its prediction is that of the parameters, of what
    differs from throw to throw (friction, slip levels, the marked onset), and of what is left of
    the difference between repeats, noise among it:

    .. math:: v(t) = J(t) C J(t)^T + \sum_s \sigma_s^2 J_s(t)^2 + r^2

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`, with dimensions movement and time.
    panel : LoadedPanel
        As it was before the calibration.
    calibration : Calibration
        Values and covariance; what it was fitted to is marked as used.
    evaluator : Evaluator
        Open; throws the same panel.
    report : callable, optional
        As of `announce`.

    Returns
    -------
    xarray.Dataset
        `measured`, `predicted`, `low`, `high` (channel, movement, time) [N]; `rms`, `nrmse`,
        `cover`, and features as `slope_measured`, `slope_predicted` and so on (channel, movement);
        `repeat_spread`, `scale` (channel); `used`, `left_out` (whether it is predicted from other
        places alone), `cover_limit`, `cover_samples` (channel): least coverage of its band, and the
        independent instants that this rests on; `onset_shift`, how much later than marked a
        movement without motor currents began (movement) [s]. The attribute `noticed` says how
        large errors a model that is not refused would have to have to be, as JSON.

    Raises
    ------
    MeasurementError
        When the campaign does not fit the panel, or no throw can be simulated.
    """
    movements, oversized = exclude_oversized_objects(observe(dataset, panel), panel)
    chain = found_chain(dataset, calibration)
    model = Model.of(movements, calibration, evaluator, chain=chain, report=report)
    sheet = dataset.sel(movement=[item.name for item in movements])
    measured = _array(model.grid, model.grid.measured(movements), sheet)
    groups = repeat_groups(sheet)
    names, scatter = _scatter(model, measured.values, calibration, groups)
    used = np.isin(sheet["movement"].values, _used(calibration))
    forces, variance = model.forces, variance_of(model.slopes, calibration.covariance)
    left_out, plain = np.zeros(used.size, dtype=np.bool_), variance
    if used.all() and len(model.slopes):
        forces, variance, left_out = leave_out_places(
            measured.values,
            model.forces,
            model.slopes,
            places=[item.place for item in movements],
            covariance=calibration.covariance,
            scatter=scatter,
        )
    of_chain = chain_directions(model.forces, model.grid, chain)
    half = NORMAL_95 * np.sqrt(scatter.variance + variance + (of_chain**2).sum(axis=0))
    forecast, reach = measured.copy(data=forces), measured.copy(data=half)
    found = xr.Dataset(
        {
            "measured": measured,
            "predicted": forecast,
            "low": forecast - reach,
            "high": forecast + reach,
            "rms": rms_difference(measured, forecast),
            "nrmse": nrmse(measured, forecast),
            "cover": band_coverage(measured, forecast - reach, forecast + reach),
            "scale": channel_scale(measured),
            "repeat_spread": _spread(measured, groups, scatter),
            "used": ("movement", used),
            "left_out": ("movement", left_out),
            "onset_shift": ("movement", model.shifts, {"units": "s"}),
            **_features(measured, forecast),
        },
        attrs={
            **_origin(dataset, panel, calibration),
            "scatter": json.dumps({**names, "repeats": sum(map(len, groups))}),
            "left_out": json.dumps([*excluded_movements(dataset), *oversized, *model.failed]),
            "chain": "" if chain or not calibration.chain else OTHER_CHAIN,
        },
    )
    # Where a place is predicted without itself, less is known of it.
    wider = np.sqrt(np.divide(variance, plain, out=np.ones_like(plain), where=plain > 0.0))
    squares, vectors = np.linalg.eigh(calibration.covariance)
    roots = (vectors * np.sqrt(np.maximum(squares, 0.0))).T
    common = np.concatenate((of_chain, np.tensordot(roots, model.slopes, axes=1) * wider))
    judged = judged_movements(found)
    seen = np.where(np.isfinite(measured.values), half, np.nan)[:, judged]
    own = replace(scatter, own=scatter.own[:, :, judged])
    limit, samples = coverage_limits(seen, common[:, :, judged], own)
    found = found.assign(cover_limit=("channel", limit), cover_samples=("channel", samples))
    noticed = _noticed(found, model, calibration, report)
    return found.assign_attrs(noticed=json.dumps(noticed))


def _scatter(
    model: Model, measured: Floats, calibration: Calibration, groups: list[list[int]]
) -> tuple[dict[str, float], ThrowScatter]:
    """Return by name how much throws differ, and what this makes of forces."""
    names, slopes, expected = list[str](), list[Floats](), list[float]()
    for item, slope in zip(calibration.fitted, model.slopes, strict=True):
        for ending, share in SCATTERING.items():
            if any(key.endswith(ending) for key in item.keys):
                names.append(item.name)
                slopes.append(slope * item.value)
                expected.append(calibration.scatter.get(item.name, share))
    names.append("onset [s]")
    known = {key: noise.total for key, noise in measured_noise(model.thrown.movements).items()}
    found = scatter_of(
        measured,
        np.array([*slopes, later(model.forces)]),
        [*expected, KNOWN.clocked_onset],
        groups=groups,
        noise=np.array([known[key] for key in model.grid.keys]),
    )
    return dict(zip(names, found.sizes.tolist(), strict=True)), found


def _noticed(
    found: xr.Dataset, model: Model, calibration: Calibration, report: Report | None
) -> list[str]:
    """Say which errors the verdict would notice; nothing of a model that it refuses."""
    if judge(found).reasons:
        return []
    chosen = judged_movements(found)
    part, forces = found.isel(movement=chosen), model.forces[:, chosen]
    # The size of a cause is no value of the panel that anyone could have got wrong.
    fitted = {item.name: item for item in calibration.fitted if item.keys}
    whole = {name: 1.0 if item.unit == "m" else item.value for name, item in fitted.items()}
    errors = [
        PossibleError(
            name=item.name,
            change=whole[item.name] * slope[:, chosen],
            largest=LARGEST_LENGTH if item.unit == "m" else LARGEST_SHARE,
            unit="m" if item.unit == "m" else "",
            unchecked=failure,
        )
        for item, slope, failure in zip(
            calibration.fitted, model.slopes, model.failures, strict=True
        )
        if item.keys
    ]
    predicted = rows_of(part["predicted"])
    clocked = all(item.clocked for item in model.thrown.movements)
    if clocked:
        # A lead beyond this is taken off.
        change = later(predicted)
        errors.append(PossibleError(name="onset", change=change, largest=CLEAR_LEAD, unit="s"))

    def throw(wrong: list[tuple[str, float]]) -> list[Floats | str]:
        settings = [{name: fitted[name].value + off * whole[name]} for name, off in wrong]
        movements = [model.thrown.movements[n] for n in chosen]
        evaluator = model.thrown.evaluator
        stage = "checking what would be noticed"
        announce(report, stage, len(settings), movements=movements, evaluator=evaluator)
        made = model.made(settings, chosen)
        return [row if isinstance(row, str) else predicted + row - forces for row in made]

    lines = noticed_errors(Rules.of(part), predicted, errors, model.grid.channels, throw=throw)
    if not clocked:
        lines.append("onset: not judged, it is fitted to each movement that no motor current marks")
    return lines


def _origin(dataset: xr.Dataset, panel: LoadedPanel, calibration: Calibration) -> dict[str, object]:
    """Return what was validated, and by what."""
    return {
        "title": str(dataset.attrs.get("title", "campaign")),
        "synthetic": str(dataset.attrs.get("synthetic", "")),
        "kind": "validation",
        **provenance(),
        "schema_version": SCHEMA_VERSION,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "calibration_panel_hash": calibration.panel_hash,
    }


def _used(calibration: Calibration) -> list[str]:
    """Return every movement that any stage was fitted to."""
    return [*calibration.movements, *(n for stage in calibration.stages for n in stage.movements)]


def _spread(measured: xr.DataArray, groups: list[list[int]], scatter: ThrowScatter) -> xr.DataArray:
    """Return the spread of repeats; where none were made, what scatter found elsewhere implies.

    Load cells are seldom mounted twice for one size and place, so that friction's share of their
    spread has to be carried over from the rods.
    """
    spread = repeat_spread(measured, groups)
    variance = measured.copy(data=scatter.variance).where(measured.notnull())
    implied = variance.mean(("movement", "time")) ** 0.5
    return spread.fillna(implied).assign_attrs(units="N", long_name="spread of repeats")


def _array(grid: SharedBins, values: Floats, sheet: xr.Dataset) -> xr.DataArray:
    kept = {key: ("movement", sheet[key].values) for key in SHEET if key in sheet.coords}
    coordinates = {
        "channel": grid.channels,
        "movement": sheet["movement"].values,
        "time": grid.time,
        **kept,
    }
    return xr.DataArray(values, coordinates, DIMS, attrs={"units": "N"})


def _features(measured: xr.DataArray, forecast: xr.DataArray) -> dict[str, xr.DataArray]:
    """Return features of both, where there is a measurement."""
    found: dict[str, xr.DataArray] = {}
    pairs = (("measured", measured), ("predicted", forecast.where(measured.notnull())))
    for label, forces in pairs:
        contact = xr.full_like(forces.isel(channel=0, time=0, drop=True), np.nan)
        if OBJECT in forces["channel"]:
            contact = contact_time(forces.sel(channel=OBJECT, drop=True))
        end = float(forces["time"][-1])
        for name, values in channel_features(forces, contact=contact, end=end).data_vars.items():
            found[f"{name}_{label}"] = values
    return found
