"""Recording of one simulated movement by perfect transducers.

The truth may be a finer reference solution: the same switch with another mesh, step and damping.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.channels import label
from turnout.core.errors import ResponseError
from turnout.core.scheme import Scheme
from turnout.panel.load import LoadedPanel
from turnout.throw.slip import Span, movements

# What a finer truth changes; a fit that finds its parameters again does not profit from sharing
# the errors of mesh, modes and steps with what it is fitted to.
MESH, MODES, STEPS = 0.5, 2.0, 0.25
SPECTRAL_RADIUS = 0.8


def finer_panel(panel: LoadedPanel) -> LoadedPanel:
    """Return a panel with elements half as long and superelement modes up to twice the frequency.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> finer_panel(load_panel("sb1")).discretisation.element_length
    0.05
    """
    mesh = panel.discretisation
    return panel.with_overrides(
        {
            "discretisation.element_length": MESH * mesh.element_length,
            "discretisation.superelement_cutoff": MODES * mesh.superelement_cutoff,
        }
    )


def finer_scheme(scheme: Scheme | None = None) -> Scheme:
    """Return a scheme with steps of a quarter, modes to twice the frequency and other damping.

    Parameters
    ----------
    scheme : Scheme, optional
        Scheme that it is finer than; default the default one.

    Examples
    --------
    >>> finer_scheme().describe()
    'generalised-alpha, spectral radius 0.8, step 0.25 ms, cut-off 600 Hz'
    """
    base = scheme or Scheme()
    return replace(
        base,
        step=STEPS * base.step,
        cutoff_frequency=MODES * base.cutoff_frequency,
        spectral_radius=SPECTRAL_RADIUS,
        output_interval=0.0,
    )


Floats = NDArray[np.float64]
REST_AFTER_STOP = 1.0
"""Simulated after the last motor has stopped [s]."""
OF_MACHINES = ("drive_voltage", "drive_power", "drive_apparent_power")
"""Channels of machines that a monitoring system stores beside currents."""
DIRECTIONS = {"closed": "closing", "open": "opening"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentLaw:
    """Motor current as a function of the force that a drive works against. All of it is assumed.

    Attributes
    ----------
    idle, slope : float
        Current without load [A] and its rise with the force [A/N].
    inrush, inrush_time : float
        Peak [A] and time in which it falls to a third [s]; over 0.1 s it averages 3 to 4 A.
    time_out : float
        When a slipping drive is switched off [s].
    """

    idle: float = 0.8
    slope: float = 0.2e-3
    inrush: float = 7.5
    inrush_time: float = 0.05
    time_out: float = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Start and length of a recording.

    Attributes
    ----------
    lead : float
        Rest before the onset of motion [s].
    length : float
        From first to last sample [s].
    rate : float
        Samples a second [1/s].
    """

    lead: float = 2.0
    length: float = 12.0
    rate: float = 1000.0

    @property
    def time(self) -> Floats:
        """Time of each sample from the first [s].

        Examples
        --------
        >>> Window(length=0.002).time
        array([0.   , 0.001])
        """
        return np.arange(round(self.length * self.rate)) / self.rate


def extend_schedule(panel: LoadedPanel) -> LoadedPanel:
    """Return a panel whose schedule lasts until the time-outs of its machines have passed.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> extend_schedule(load_panel("sb1")).schedule.end
    9.0
    >>> long = extend_schedule(load_panel("sb1", overrides={"drive.1.machine": "sb3"}))
    >>> round(long.schedule.end, 2)
    14.26
    """
    circuits = [panel.machine[d.machine].circuit for d in panel.drive.values() if d.machine]
    if not circuits or not panel.movement:
        return panel
    longest = max(circuit.contactor_delay + (circuit.time_out or 0.0) for circuit in circuits)
    last = max(
        movement.start + max(movement.extra_time.values(), default=0.0)
        for movement in panel.movement.values()
    )
    end = last + longest + REST_AFTER_STOP
    return panel if end <= panel.schedule.end else panel.with_overrides({"schedule.end": end})


def movement_named(run: xr.Dataset, direction: str) -> Span:
    """Return the last movement of a run in a direction.

    Raises
    ------
    ResponseError
        When the schedule has none.
    """
    found = [span for span in movements(run) if DIRECTIONS[span.to] == direction]
    if not found:
        message = f"the schedule of panel {run.attrs.get('panel')} has no {direction} movement"
        raise ResponseError(message)
    return found[-1]


def record_throw(
    run: xr.Dataset,
    *,
    direction: str,
    window: Window | None = None,
    law: CurrentLaw | None = None,
    build_up_lag: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Return one movement of a run as perfect transducers would record it.

    Before the movement the switch rests with its motors off; after it the forces are held, as
    friction holds them.

    Parameters
    ----------
    run : xarray.Dataset
        From `simulate`.
    direction : str
        "closing" or "opening".
    window : Window, optional
        Start, length and rate of the recording.
    law : CurrentLaw, optional
        Of the motor current of drives that are markers; it is assumed. Machines have their own,
        counted positive while it drives.
    build_up_lag : mapping of drive to float, optional
        Time constant with which a drive's force follows after contact with an object [s].

    Returns
    -------
    xarray.Dataset
        `drive_force`, `drive_current` (drive, time), `object_force` (time). Attributes: `onset` [s]
        on the time of the recording, and `slipped`, the drives that slip at the end, by a blank.
    """
    chosen, current_law = window or Window(), law or CurrentLaw()
    span = movement_named(run, direction)
    instants = _instants(run, span, chosen)
    time = run["time"].values
    forces = _sampled(run["drive_force"], instants, time)
    contact = float(run["contact_time"]) if "contact_time" in run else np.nan
    names = [str(name) for name in run["drive"].values]
    for name, lag in (build_up_lag or {}).items():
        row = names.index(name)
        forces[row] = _lagged(
            forces[row], instants=instants, contact=contact, lag=lag, step=1.0 / chosen.rate
        )
    ends, slipped = _stops(run, span, law=current_law)
    elapsed = chosen.time - chosen.lead
    currents = np.array(
        [
            assumed_current(
                row if direction == "closing" else -row,
                elapsed,
                end=end,
                limit=limit,
                law=current_law,
            )
            for row, end, limit in zip(forces, ends, run["saturation_force"].values, strict=True)
        ]
    )
    if "drive_current" in run:  # of the drives that are machines
        made = _sampled(run["drive_current"], instants, time)
        # what is held before the movement is no current of a motor that still brakes
        made[:, instants < span.start] *= 0.0
        driving = np.where(made.sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        currents = np.where(np.isnan(made), currents, driving * made)
    squeezed = _sampled(run["object_force"], instants, time)[0]
    dataset = xr.Dataset(
        {
            "drive_force": (("drive", "time"), forces),
            "drive_current": (("drive", "time"), currents),
            "object_force": ("time", squeezed),
        },
        {"time": chosen.time, "drive": names},
        {
            "onset": chosen.lead,
            "slipped": " ".join(n for n, slips in zip(names, slipped, strict=True) if slips),
        },
    )
    return label(dataset)


def record_powers(
    run: xr.Dataset, recorded: xr.Dataset, *, direction: str, window: Window | None = None
) -> xr.Dataset:
    """Return currents, voltages and powers of one movement, as a monitoring system sees them.

    Parameters
    ----------
    run : xarray.Dataset
        From `simulate`.
    recorded : xarray.Dataset
        Of the same movement, from `record_throw`.
    direction, window
        As given there.

    Returns
    -------
    xarray.Dataset
        `drive_current`, and of machines `drive_voltage`, `drive_power` and `drive_apparent_power`
        (drive, time); 0 before the movement, NaN for drives that are markers.
    """
    chosen = window or Window()
    span = movement_named(run, direction)
    instants, time = _instants(run, span, chosen), run["time"].values
    found = recorded[["drive_current"]]
    supplies = json.loads(run.attrs.get("machine_supplies", "{}"))
    if supplies:  # a lost phase is on another time; it is refused before the throw
        kinds = {name: {"frequency": item["frequency"]} for name, item in supplies.items()}
        found = found.assign_attrs(machine_supplies=json.dumps(kinds))
    for name in OF_MACHINES:
        if name in run:
            values = _sampled(run[name], instants, time)
            values[:, instants < span.start] *= 0.0
            found = found.assign({name: (("drive", "time"), values)})
    return found


def assumed_current(
    load: Floats, elapsed: Floats, *, end: float, limit: float, law: CurrentLaw
) -> Floats:
    r"""Return the motor current of a drive, by a law that is assumed.

    .. math:: I = I_0 + c \max(0, \min(F, F_s)) + (I_i - I_0) e^{-t / t_i}

    while the motor runs. With the default figures a drive that slips at 6 kN takes 2 A, as the
    clutches of the published measurements were set.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Force that the drive works against [N].
    elapsed : ndarray, shape (n,)
        Time since the motor was switched on [s].
    end : float
        When it is switched off [s].
    limit : float
        Force at which the drive slips [N].
    law : CurrentLaw
        Idle and inrush current [A], slope [A/N] and times [s].

    Returns
    -------
    ndarray, shape (n,)
        [A]

    Examples
    --------
    >>> load, elapsed = np.array([0.0, 9000.0, 9000.0]), np.array([-1.0, 1.0, 3.0])
    >>> assumed_current(load, elapsed, end=2.0, limit=6000.0, law=CurrentLaw()).round(6)
    array([0., 2., 0.])
    """
    running = (elapsed >= 0.0) & (elapsed < end)
    rush = np.exp(-np.maximum(elapsed, 0.0) / law.inrush_time)
    steady = law.idle + law.slope * np.clip(load, 0.0, limit)
    return np.asarray(np.where(running, steady + (law.inrush - law.idle) * rush, 0.0))


def _instants(run: xr.Dataset, span: Span, window: Window) -> Floats:
    """Return the time of the run for each sample: that of this movement and the rests around it."""
    spans = movements(run)
    number = spans.index(span)
    first = spans[number - 1].end if number else 0.0
    if number:  # the later half of the rest before, when what the last movement shook has settled
        first = 0.5 * (first + span.start)
    last = spans[number + 1].start if number + 1 < len(spans) else float(run["time"][-1])
    return np.clip(window.time - window.lead + span.start, first, last)


def _sampled(channel: xr.DataArray, instants: Floats, time: Floats) -> Floats:
    values = np.atleast_2d(channel.values)
    return np.array([np.interp(instants, time, row) for row in values])


def _stops(run: xr.Dataset, span: Span, *, law: CurrentLaw) -> tuple[list[float], list[bool]]:
    """Return the stop of each motor after the onset, and True if its drive slips at the end."""
    part = run.sel(time=slice(span.start, None))
    ends, slipped = [], []
    for name in run["drive"].values:
        drive = part.sel(drive=name)
        inside = drive.sel(time=slice(None, span.end + 1e-9))
        slips = bool(inside["drive_slipping"].values[-1])
        place = inside["drive_displacement"].values
        moving = np.flatnonzero(np.abs(place - place[-1]) > 1e-9)
        arrived = float(inside["time"].values[moving[-1]]) if moving.size else span.end
        ends.append(law.time_out if slips else arrived - span.start)
        slipped.append(slips)
    return ends, slipped


def _lagged(force: Floats, *, instants: Floats, contact: float, lag: float, step: float) -> Floats:
    """Let a force follow with a first-order lag from the contact with an object on."""
    if not np.isfinite(contact) or instants[-1] <= contact:
        return force
    start = int(np.searchsorted(instants, contact))
    followed = force.copy()
    share = 1.0 - np.exp(-step / lag)
    for number in range(max(1, start), force.size):
        followed[number] = followed[number - 1] + share * (force[number] - followed[number - 1])
    return followed
