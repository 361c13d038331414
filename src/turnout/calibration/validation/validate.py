"""Predict every movement of a campaign, with the band in which the measurement should lie."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.comparison import measured_noise
from turnout.calibration.evaluate import Evaluator, Response
from turnout.calibration.linearisation import stepped_value
from turnout.calibration.measured_movements import MeasuredMovement, later, observe
from turnout.calibration.requirements import exclude_oversized_objects, excluded_movements
from turnout.calibration.result import Calibration
from turnout.calibration.stages import Fitted, Parameter
from turnout.calibration.validation.acceptance import first_order_power, judged_movements
from turnout.calibration.validation.prediction_bands import (
    BandParts,
    Direction,
    LeftOut,
    ThrowScatter,
    coverage_limits,
    leave_out_places,
    scatter_of,
)
from turnout.calibration.validation.seen_throws import (
    CHECKING,
    DRIVE,
    OBJECT,
    OTHER_CHAIN,
    PREDICTING,
    Report,
    Seen,
    SharedBins,
    announce,
    chain_directions,
    found_chain,
    onset_shifts,
    thrown_as_fitted,
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
SIDES = ("up", "down")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """Prediction of all movements at the calibrated values.

    Attributes
    ----------
    forces, later : ndarray, shape (n_channels, n_movements, n_times)
        Through the chain as it was found [N], and their change with a later onset [N/s].
    slopes : mapping of str to ndarray, shape as forces
        By parameter [N over its unit].
    asides : mapping of str to sequence of Response
        By parameter the throws of all movements that slopes are from.
    contacts : ndarray, shape (n_movements,)
        First touches of objects from the onset [s].
    seen : Seen
        Throws all movements.
    """

    forces: Floats
    later: Floats
    slopes: Mapping[str, Floats]
    asides: Mapping[str, Sequence[Response]]
    contacts: Floats
    seen: Seen

    @property
    def of_chain(self) -> Floats:
        """What one deviation of gains, clock and zeros makes of forces, as `chain_directions`."""
        return chain_directions(self.forces, self.later, self.seen.grid, self.seen.chain)


def with_bends(
    found: xr.Dataset, calibration: Calibration, model: Model, *, report: Report | None = None
) -> xr.Dataset:
    """Throw each value to either side where first order says that the verdict notices it.

    Parameters
    ----------
    found : xarray.Dataset
        As of `validate`, without `bend`.
    calibration : Calibration
        With the values.
    model : Model
        Forces, their slopes, and what throws all movements.
    report : callable, optional
        As of `announce`.

    Returns
    -------
    xarray.Dataset
        With `bend` (side, parameter, channel, movement, time), what forces change beyond first
        order, over the square of a change; 0 where nothing is noticed, and where a throw failed.
        The attribute `unchecked` says of these parameters why, as JSON.
    """
    bends = xr.concat([xr.zeros_like(found["change"])] * len(SIDES), "side")
    bends = bends.assign_coords(side=list(SIDES))
    chosen = judged_movements(found["used"].values, found["left_out"].values)
    part, plain = model.seen.of(chosen), model.forces[:, chosen]
    movements = part.movements
    unchecked = {
        name: reason
        for name in found["parameter"].values.tolist()
        if (reason := _failure(movements, [model.asides[name][n] for n in chosen], plain))
    }
    fitted = {item.name: item for item in calibration.fitted}
    steps = [
        (name, side, amount, amount * (1.0 if fitted[name].unit == "m" else fitted[name].value))
        for name, amounts in first_order_power(found).items()
        for side, amount in zip(SIDES, amounts, strict=True)
        if name not in unchecked
    ]
    settings = [
        {**calibration.values, name: fitted[name].value + step} for name, _, _, step in steps
    ]
    evaluator = part.thrown.evaluator
    announce(report, CHECKING, len(settings), movements=movements, evaluator=evaluator)
    thrown = part.responses(settings)
    for (name, side, amount, step), row in zip(steps, thrown, strict=True):
        reason = _failure(movements, row, plain)
        if reason:
            unchecked.setdefault(name, reason)
            continue
        linear = plain + step * model.slopes[name][:, chosen]
        place = {"parameter": name, "side": side, "movement": found["movement"].values[chosen]}
        bends.loc[place] = (part.forces(row) - linear) / amount**2
    return found.assign(bend=bends).assign_attrs(unchecked=json.dumps(unchecked))


def _failure(
    movements: Iterable[MeasuredMovement], responses: Sequence[Response], forces: Floats
) -> str:
    """Return why the first of some throws failed whose movement is predicted; else nothing."""
    predicted = np.asarray(np.isfinite(forces).any(axis=(0, 2)), dtype=np.bool_)
    for item, response, known in zip(movements, responses, predicted, strict=True):
        if response.failure and known:
            return f"{item.text}: {' '.join(response.failure.split())}"
    return ""


# 95 % of a normal distribution lie within so many standard deviations.
QUANTILE = 1.959964
# Parameters that a throw can have of its own, by the end of their key, and how much is expected.
FRICTION, LEVEL = ("friction_coefficient", 0.02), ("saturation_force", 0.01)
# Standard uncertainty of an onset, from motor currents or from the free part [s].
ONSET = 0.005
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
        As of `Seen`: called with the stage, and the throws done and in all of that stage.

    Returns
    -------
    xarray.Dataset
        `measured`, `predicted`, `low`, `high` (channel, movement, time) [N]; `rms`, `nrmse`,
        `cover`, and features as `slope_measured`, `slope_predicted` and so on (channel, movement);
        `repeat_spread`, `scale` (channel); `used`, `left_out` (whether it is predicted from other
        places alone), `cover_limit`, `cover_samples` (channel): least coverage of its band, and the
        independent instants that this rests on; `change` (parameter, channel, movement, time) [N
        for all of a value, N/m for a length], and `bend` (side, ...), by how much more upwards and
        downwards with the square of a change, thrown where a model that is not refused would notice
        it (0 where a throw fails, with the reason as JSON in the attribute `unchecked`);
        `touched`, when the model touches the object, and `onset_shift`, how much later than
        marked a movement without motor currents began (movement) [s].

    Raises
    ------
    MeasurementError
        When the campaign does not fit the panel, or no throw can be simulated.
    """
    movements, oversized = exclude_oversized_objects(observe(dataset, panel), panel)
    grid = SharedBins.of(movements)
    chain = found_chain(dataset, calibration)
    model = _model(movements, grid, calibration, evaluator, chain, report)
    sheet = dataset.sel(movement=[item.name for item in movements])
    groups = repeat_groups(sheet)
    measured = _array(grid, grid.measured(movements), sheet)
    directions = _directions(model, calibration)
    noise = _noise(movements, grid)
    scatter = scatter_of(measured.values, directions, groups=groups, noise=noise)
    used = np.isin(sheet["movement"].values, _used(calibration))
    left = _left_out(model, measured.values, calibration, movements, (scatter, directions), used)
    forecast = measured.copy(data=left.forces)
    reach = QUANTILE * np.sqrt(scatter.variance + left.variance + (model.of_chain**2).sum(axis=0))
    low, high = forecast - reach, forecast + reach
    parts = _band_parts(
        (model, calibration),
        (scatter, directions),
        left,
        reach=np.where(np.isfinite(measured.values), reach, np.nan),
        judged=judged_movements(used, left.predicted),
    )
    found = xr.Dataset(
        {
            "measured": measured,
            "predicted": forecast,
            "low": low,
            "high": high,
            "rms": rms_difference(measured, forecast),
            "nrmse": nrmse(measured, forecast),
            "cover": band_coverage(measured, low, high),
            "scale": channel_scale(measured),
            "repeat_spread": _spread(measured, groups, scatter),
            "used": ("movement", used),
            "left_out": ("movement", left.predicted),
            "onset_shift": ("movement", model.seen.shifts, {"units": "s"}),
            **_least_covers(parts),
            "touched": ("movement", model.contacts, {"units": "s"}),
            "change": _changes(model, measured, calibration),
            **_features(measured, forecast),
        },
        attrs={
            **_origin(dataset, panel, calibration),
            "scatter": json.dumps({**scatter.sizes, "repeats": scatter.repeated}),
            "left_out": json.dumps([*excluded_movements(dataset), *oversized]),
            "onsets": "marked" if all(item.clocked for item in movements) else "fitted",
            "chain": "" if chain or not calibration.chain else OTHER_CHAIN,
        },
    )
    return with_bends(found, calibration, model, report=report)


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


def _least_covers(parts: BandParts) -> dict[str, tuple[str, Floats]]:
    limit, samples = coverage_limits(parts)
    return {"cover_limit": ("channel", limit), "cover_samples": ("channel", samples)}


def _changes(model: Model, measured: xr.DataArray, calibration: Calibration) -> xr.DataArray:
    """Return how much forces change with each parameter: for all of it [N], a length [N/m]."""
    # The size of a cause is no value of the panel that anyone could have got wrong.
    fitted = [item for item in calibration.fitted if item.keys]
    rows = [model.slopes[i.name] * (1.0 if i.unit == "m" else i.value) for i in fitted]
    stacked = np.stack(rows) if rows else np.zeros((0, *measured.shape))
    known = stacked.astype(np.float32)
    coordinates = {
        **measured.coords,
        "parameter": [item.name for item in fitted],
        "unit": ("parameter", np.array([item.unit for item in fitted], dtype=np.str_)),
    }
    return xr.DataArray(known, coordinates, ("parameter", *measured.dims))


def _band_parts(
    found: tuple[Model, Calibration],
    scattered: tuple[ThrowScatter, Sequence[Direction]],
    left: LeftOut,
    *,
    reach: Floats,
    judged: NDArray[np.intp],
) -> BandParts:
    """Return what the bands of the movements that are judged are made of."""
    model, calibration = found
    scatter, directions = scattered
    common = model.of_chain
    if model.slopes:
        stacked = np.stack(list(model.slopes.values()))
        values, vectors = np.linalg.eigh(calibration.covariance)
        roots = vectors * np.sqrt(np.maximum(values, 0.0))
        plain = _of_parameters(model, calibration)
        # Where a place is predicted without itself, less is known of it.
        wider = np.sqrt(np.divide(left.variance, plain, out=np.ones_like(plain), where=plain > 0.0))
        common = np.concatenate((common, np.tensordot(roots.T, stacked, axes=1) * wider))
    own = np.stack([scatter.sizes[item.name] * item.slope for item in directions])
    return BandParts(
        reach=reach[:, judged],
        common=common[:, :, judged],
        own=own[:, :, judged],
        freedom=np.array([scatter.freedom[item.name] for item in directions]),
        rest=scatter.rest,
        decay=scatter.decay,
    )


def _used(calibration: Calibration) -> list[str]:
    """Return every movement that any stage was fitted to."""
    names = [*calibration.movements, *(n for stage in calibration.stages for n in stage.movements)]
    return list(dict.fromkeys(names))


def _model(
    movements: Sequence[MeasuredMovement],
    grid: SharedBins,
    calibration: Calibration,
    evaluator: Evaluator,
    chain: Mapping[str, tuple[float, float]],
    report: Report | None,
) -> Model:
    """Simulate all movements at the calibrated values and one step away for each parameter.

    Through the chain as it was found: a sound prediction would differ by the gains of the gauges.
    """
    steps: dict[str, float] = {}
    settings: list[dict[str, float]] = [calibration.values]
    for item in calibration.fitted:
        aside = stepped_value(_parameter(item), item.value)
        steps[item.name] = aside - item.value
        settings.append({**calibration.values, item.name: aside})
    refined = bool(calibration.about.get("refined"))
    times = len(settings) + refined
    announce(report, PREDICTING, times, movements=movements, evaluator=evaluator)
    model = thrown_as_fitted(movements, calibration, evaluator)
    seen = Seen(thrown=model, grid=grid, chain=chain)
    thrown = seen.responses(settings)
    responses = thrown[0]
    failed = [
        f"{item.text}: cannot be simulated: {response.failure}"
        for item, response in zip(movements, responses, strict=True)
        if response.failure
    ]
    if len(failed) == len(movements):
        raise MeasurementError(failed[:3], source="validation")
    shifts = onset_shifts(movements, responses)
    seen = replace(seen, shifts=shifts)
    sets = [seen.forces(row) for row in thrown]
    slopes = {
        name: (aside - sets[0]) / step
        for (name, step), aside in zip(steps.items(), sets[1:], strict=True)
    }
    contacts = np.array(
        [
            response.contact_time - response.onsets[item.direction] + shift
            if item.size > 0 and not response.failure
            else np.nan
            for item, response, shift in zip(movements, responses, shifts, strict=True)
        ]
    )
    return Model(
        forces=sets[0],
        slopes=slopes,
        asides=dict(zip(steps, thrown[1:], strict=True)),
        later=later(sets[0]),
        contacts=contacts,
        seen=seen,
    )


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


def _directions(model: Model, calibration: Calibration) -> list[Direction]:
    found = []
    for item in calibration.fitted:
        for ending, share in (FRICTION, LEVEL):
            if any(key.endswith(ending) for key in item.keys):
                known = calibration.scatter.get(item.name, share)
                slope = model.slopes[item.name] * item.value
                found.append(Direction(name=item.name, slope=slope, expected=known))
    found.append(Direction(name="onset [s]", slope=model.later, expected=ONSET))
    return found


def _of_parameters(model: Model, calibration: Calibration) -> Floats:
    """Return the variance from the uncertainty of the fitted parameters [N^2]."""
    if not model.slopes:
        return np.zeros_like(model.forces)
    stacked = np.stack(list(model.slopes.values()))
    found = np.einsum("i...,ij,j...->...", stacked, calibration.covariance, stacked)
    return np.asarray(found, dtype=np.float64)


def _left_out(
    model: Model,
    measured: Floats,
    calibration: Calibration,
    movements: Sequence[MeasuredMovement],
    scattered: tuple[ThrowScatter, Sequence[Direction]],
    used: NDArray[np.bool_],
) -> LeftOut:
    """Predict as the fit does, or each place from the others where it has seen all movements."""
    scatter, directions = scattered
    if used.all() and model.slopes:
        return leave_out_places(
            measured,
            model.forces,
            model.slopes,
            places=[item.place for item in movements],
            variance=np.broadcast_to(scatter.rest[:, None, None] ** 2, measured.shape),
            covariance=calibration.covariance,
            alike=[scatter.sizes[item.name] * item.slope for item in directions],
        )
    return LeftOut(
        forces=model.forces,
        variance=_of_parameters(model, calibration),
        predicted=np.zeros(used.size, dtype=np.bool_),
    )


def _noise(movements: Sequence[MeasuredMovement], grid: SharedBins) -> Floats:
    known = {
        f"{DRIVE}{drive}" if drive else OBJECT: noise.total
        for (_, drive), noise in measured_noise(movements).items()
    }
    return np.array([known[name] for name in grid.channels])


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
        "channel": list(grid.channels),
        "movement": sheet["movement"].values,
        "time": grid.time,
        **kept,
    }
    return xr.DataArray(values, coordinates, ("channel", "movement", "time"), attrs={"units": "N"})


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
