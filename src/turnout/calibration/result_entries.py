"""Entries of a calibration record, and its forces, measured and fitted, in a file beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.calibration.comparison import peaks_of
from turnout.calibration.covariance import Spread, drift_finding, without_objects
from turnout.calibration.fit import Fit
from turnout.calibration.measured_movements import (
    MeasuredMovement,
    channel_name,
)
from turnout.calibration.misfit import remaining
from turnout.calibration.requirements import excluded_movements
from turnout.calibration.result import Calibration
from turnout.calibration.sensors import (
    LEAVES_PRIOR,
    found_sensors,
    prior_reasons,
    sensor_reasons,
)
from turnout.calibration.shared import CLEARLY, missing_more, model_error
from turnout.calibration.stages import (
    CalibrationPlan,
    Fitted,
    Parameter,
    is_of_object,
    object_lines,
)
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.core.provenance import content_hash, provenance
from turnout.core.value_text import value_text
from turnout.throw.store import open_response, save_response

NO_CAUSE = "no cause that was tried explains it"
# A model error this much above the noise gives a warning [-].
LARGE_MISFIT = 1.5


# What a record says of the scheme where a fit came to its fine throws.
REFINED = "; at its end with half the step and mesh, and modes to four times the frequency"


def record_of(
    final: Fit,
    spread: Spread,
    *,
    fitted_causes: Sequence[str],
    causes: Sequence[str],
    plan: CalibrationPlan,
    dataset: xr.Dataset,
    movements: Sequence[MeasuredMovement],
    ended: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> Calibration:
    """Return the record of a fit with the spread of all its unknowns, without stages.

    Parameters
    ----------
    final : Fit
        Of the last stage.
    spread : Spread
        Of the fit.
    fitted_causes : sequence of str
        Names of the causes that it was fitted with.
    causes : sequence of str
        What the panel alone does not follow, in words.
    plan : CalibrationPlan
        Its parameters are in the record, fitted or not.
    dataset : xarray.Dataset
        The campaign.
    movements : sequence of MeasuredMovement
        All that were measured.
    ended : sequence of str
        What ended it after the first fit.
    warnings : sequence of str
        Of what came before.
    """
    sensors, objects = found_sensors(final), _fitted_objects(final, spread)
    evaluator, refined = final.misfit.evaluator, bool(final.misfit.refinement)
    said = [
        *excluded_movements(dataset),
        *warnings,
        *warnings_from(final, spread),
        *(item.warning for item in sensors if item.leaves),
    ]
    order = [str(name) for name in dataset["movement"].values]
    return Calibration(
        parameters=_fitted_parameters(plan, final, spread),
        covariance=without_objects(final, spread)[1].covariance,
        panel=evaluator.panel.name,
        panel_hash=evaluator.panel.hash,
        data=str(dataset.attrs.get("title", "campaign")),
        data_hash=_data_hash(movements),
        movements=tuple(item.name for item in final.misfit.movements),
        stages=(),
        warnings=tuple(dict.fromkeys(said)),
        findings=(*spread.findings, *drift_finding(final, order)),
        distrust=(*ended_reasons(ended), *_distrust(final, spread, fitted_causes)),
        noise=_noise_entries(final),
        scatter=final.misfit.comparison.scatter,
        about={
            **provenance(),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "scheme": evaluator.scheme.describe() + (REFINED if refined else ""),
            "refined": "yes" if refined else "",
            "synthetic": str(dataset.attrs.get("synthetic", "")),
            "channel_map_hash": str(dataset.attrs.get("channel_map_hash", "")),
        },
        causes=(*causes, *object_lines(objects, leaves=LEAVES_PRIOR)),
        fitted_causes=tuple(fitted_causes),
        sensors=tuple(item.text for item in sensors if item.is_shown),
        chain={item.key: (item.value, item.deviation) for item in sensors},
        effects=movement_rows(final),
        objects=objects,
    )


def _distrust(final: Fit, spread: Spread, causes: Sequence[str]) -> tuple[str, ...]:
    """Return the reasons not to trust values."""
    return (
        *distrust_reasons(final, spread, causes),
        *sensor_reasons(final),
        *prior_reasons(final, causes),
    )


def _data_hash(movements: Sequence[MeasuredMovement]) -> str:
    """Return the content hash of what was measured and compared."""
    return content_hash(
        [
            [
                item.name,
                item.direction,
                item.place,
                item.size,
                *(
                    [signal.channel, signal.drive, np.nan_to_num(signal.values).tolist()]
                    for signal in item.signals
                ),
            ]
            for item in movements
        ]
    )


def warnings_from(final: Fit, spread: Spread) -> list[str]:
    """Return warnings: what is not identifiable or not refined, and a large model error."""
    found = []
    for item, state in zip(final.parameters, spread.states, strict=True):
        if state == "not identified":
            found.append(
                f"{item.name}: not identifiable from these movements; fix it, or measure one that "
                "depends on it"
            )
    for item in final.parameters:
        away = abs(final.values[item.name] - item.start)
        if item.keys and item.prior and away > LEAVES_PRIOR * item.prior:
            value, start, prior = (
                value_text(number, unit=item.unit, digits=3)
                for number in (final.values[item.name], item.start, item.prior)
            )
            found.append(
                f"{item.name} = {value}: further from the panel's {start} than was expected "
                f"(± {prior}); measure it, or look for another cause"
            )
    for key, noise in final.misfit.comparison.noise.items():
        measured = float(np.hypot(noise.white, noise.slow))
        missed = model_error(final.misfit.comparison, key)
        if missed > LARGE_MISFIT * measured:
            found.append(
                f"{channel_name(*key)}: model error {missed:.3g} N with a noise of "
                f"{measured:.2g} N; uncertainty widened"
            )
    found += [
        f"{movement.text}: what a finer step and mesh change cannot be simulated "
        f"({refined.failure}); its forces are compared as the coarser ones give them"
        for movement, refined in zip(final.misfit.movements, final.misfit.refinement, strict=False)
        if refined.failure
    ]
    return found


def distrust_reasons(final: Fit, spread: Spread, causes: Sequence[str] = ()) -> list[str]:
    """Say why a calibration is not trustworthy; nothing where it is.

    Reasons are an end before convergence, values at their bounds, and a large model error. Beside
    fitted causes that is any which another solver would not have too: the right ones leave nothing,
    and wrong ones imitate most of what is missed with values that are off by more than the rest.
    """
    found = []
    if not final.converged:
        found.append(
            f"the last stage {final.message}; values may be off by several of their deviations: "
            "calibrate again from the values reached (--set), with more movements (--most), or "
            "with a value fewer (--fix)"
        )
    for item, state in zip(final.parameters, spread.states, strict=True):
        if state == "at its bound":
            value = value_text(final.values[item.name], unit=item.unit)
            found.append(
                f"{item.name} = {value} is at its bound: the best fit lies beyond; widen the "
                "bound, or look for another cause"
            )
    movements = final.misfit.movements
    peaks, share = peaks_of(movements), 1.0 if causes else CLEARLY
    names = list(dict.fromkeys(causes))
    explain = "explains" if len(names) == 1 else "explain"
    tried = f"{' and '.join(names)} {explain} it only in part" if names else NO_CAUSE
    # Intervals allow for an error that acts like noise, not for one that a value can imitate.
    found += [
        f"{channel_name(*key)}: model error {missed:.3g} N, {100 * missed / peaks[key]:.2g} % of "
        f"the peak, and {tried}; what it is may have changed the values "
        "by more than their intervals say: check that this is the panel that was measured, that "
        "rods and places are named right (channel map, run sheet), and the sensitivity of the "
        "channel"
        for key, missed in missing_more(final.misfit.comparison, movements, share=share).items()
    ]
    return found


def _fitted_parameters(plan: CalibrationPlan, final: Fit, spread: Spread) -> tuple[Fitted, ...]:
    """Return every parameter of the plan as it came out of the last stage, and sizes of causes."""
    planned = {item.name for item in plan.parameters}
    causes = [item for item in final.parameters if item.name not in planned]
    return tuple(
        _fitted(item, final, spread)
        for item in (*plan.parameters, *causes)
        if not is_of_object(item)
    )


def _fitted_objects(final: Fit, spread: Spread) -> tuple[Fitted, ...]:
    """Return what came out of thickness and place of the objects."""
    return tuple(_fitted(item, final, spread) for item in final.parameters if is_of_object(item))


def _fitted(item: Parameter, final: Fit, spread: Spread) -> Fitted:
    """Return a parameter as it came out, or as it was held."""
    value = final.values[item.name]
    columns = zip(spread.deviations, spread.intervals, spread.states, strict=True)
    known = dict(zip((p.name for p in final.parameters), columns, strict=True))
    held = (float("nan"), (value, value), "fixed")
    deviation, interval, state = known.get(item.name, held)
    return Fitted(
        name=item.name,
        keys=item.keys,
        unit=item.unit,
        value=value,
        deviation=deviation,
        lower=item.lower,
        upper=item.upper,
        interval=interval,
        start=item.start,
        state=state,
    )


def _noise_entries(final: Fit) -> dict[str, dict[str, float]]:
    """Return the noise at the end of a fit, by channel name [N], [s]."""
    return {
        channel_name(channel, drive): asdict(noise)
        for (channel, drive), noise in final.misfit.comparison.noise.items()
    }


KIND = "fitted forces"
Row = Mapping[str, float]


def movement_rows(found: Fit) -> dict[str, Row]:
    """Return onset, scattering parameters, zeros, gains and misfit of each movement.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    dict of str to mapping of str to float
        By movement: "onset" [s] later than marked; scattering parameters as shares off the common
        value; by channel "zero" [N], "gain" [-] and "residual", the root mean square of what is
        left [N], as "zero drive_force.1".
    """
    rows: dict[str, Row] = {}
    for alignment, parts in remaining(found.local, found.frame):
        row = {name: mean for name, (mean, _) in alignment.estimates.items()}
        for (signal, _, rest), (zero, gain) in zip(parts, alignment.channels, strict=True):
            key = f"{signal.channel}.{signal.drive}".rstrip(".")
            row |= {f"zero {key}": zero, f"gain {key}": gain}
            row[f"residual {key}"] = float(np.sqrt(np.mean(rest**2)))
        rows[alignment.movement.name] = row
    return rows


def fitted_signals(found: Fit) -> xr.Dataset:
    """Return measured and fitted forces of each movement, and what is left between them.

    Returns
    -------
    xarray.Dataset
        `measured`, `fitted`, `residual` (movement, channel, time) [N], NaN where nothing was
        compared; the residual is without what onset, friction, zero and gain of the movement, and
        the sensors, explain.
    """
    left = remaining(found.local, found.frame)
    every = [part for _, parts in left for part in parts]
    channels = list(dict.fromkeys(_label(signal.drive) for signal, _, _ in every))
    time = max((signal.time[bins] for signal, bins, _ in every), key=lambda row: row.size)
    shape = (len(left), len(channels), time.size)
    measured, residual = np.full(shape, np.nan), np.full(shape, np.nan)
    for number, (_, parts) in enumerate(left):
        for signal, bins, rest in parts:
            at = np.searchsorted(time, signal.time[bins] - 1e-6)
            place = channels.index(_label(signal.drive))
            inside = at < time.size
            measured[number, place, at[inside]] = signal.values[bins][inside]
            residual[number, place, at[inside]] = rest[inside]
    movements = [alignment.movement for alignment, _ in left]
    dims = ("movement", "channel", "time")
    return xr.Dataset(
        {
            "measured": (dims, measured, {"units": "N"}),
            "fitted": (dims, measured - residual, {"units": "N"}),
            "residual": (dims, residual, {"units": "N"}),
        },
        {"movement": [item.name for item in movements], "channel": channels, "time": time},
        {"texts": [item.text for item in movements]},
    )


def _label(drive: str) -> str:
    return f"Drive {drive}" if drive else "Object"


def signals_path(record: Path) -> Path:
    """Return where the forces of a calibration lie.

    Examples
    --------
    >>> signals_path(Path("autumn/calibration.toml")).as_posix()
    'autumn/calibration-fit.nc'
    """
    return record.with_name(f"{record.stem}-fit.nc")


def save_signals(final: Fit, calibration: Calibration, record: Path) -> xr.Dataset:
    """Write measured and fitted forces of each movement beside the record of a calibration.

    Parameters
    ----------
    final : Fit
        Of the last stage.
    calibration : Calibration
        Its record.
    record : Path
        Where that lies (.toml).

    Returns
    -------
    xarray.Dataset
        As from `fitted_signals`, with what links it to the record.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    signals = fitted_signals(final).assign_attrs(
        kind=KIND, schema_version=SCHEMA_VERSION, **_link(calibration)
    )
    save_response(signals, signals_path(record))
    return signals


def load_signals(calibration: Calibration, record: Path) -> xr.Dataset | None:
    """Return the forces that a calibration was fitted to, where they lie beside its record.

    A file of another calibration, or one that cannot be read, is passed over.
    """
    try:
        found = open_response(signals_path(record))
    except FileError:
        return None
    wanted = {"kind": KIND, **_link(calibration)}
    return found if all(found.attrs.get(key) == text for key, text in wanted.items()) else None


def _link(calibration: Calibration) -> dict[str, str]:
    """Return what a file has in common with the record that it belongs to."""
    return {
        "data_hash": calibration.data_hash,
        "panel_hash": calibration.panel_hash,
        "written": str(calibration.about.get("written", "")),
    }


def ended_reasons(ended: Sequence[str]) -> list[str]:
    """Return why a calibration that was ended after its first fit is not trusted."""
    return [
        f"was ended by {what} after the first fit, so values and intervals are those of then; "
        "calibrate again to go on with the throws that were kept"
        for what in ended
    ]
