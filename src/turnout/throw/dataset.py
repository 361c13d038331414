"""A run as a dataset in the terms of the schema."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.provenance import provenance
from turnout.core.scheme import Scheme
from turnout.mechanism.drive_machines import blind_currents
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import prior_movement
from turnout.panel.model import Panel
from turnout.panel.place import place_name
from turnout.solver.integration import History
from turnout.throw.coordinates import dataset_coordinates, dimensions_of, output_stations
from turnout.throw.dataset_template import labelled_dataset
from turnout.throw.drives import (
    as_thrown,
    duties,
    duty_records,
    machine_energies,
    machine_labels,
    machine_signals,
    machine_slips,
    machine_supplies,
    moved_throws,
)
from turnout.throw.gaps import gaps_key, place_block, shape_block, split_gaps
from turnout.throw.gauge import gauge_channel
from turnout.throw.lock_and_control import (
    contact_labels,
    control_states,
    distance_ends,
    distance_labels,
    force_margins,
)
from turnout.throw.output_rows import RowBlock, merge_blocks
from turnout.throw.recovery import (
    Motion,
    histories_of,
    recover_motion,
    row_block_of,
)
from turnout.throw.route import DirectedMovement, sensor_rails
from turnout.throw.save import Save
from turnout.throw.signals import (
    ENERGIES,
    FASTENINGS,
    Channel,
    chair_block,
    drive_channels,
    energy_channels,
    energy_scale,
    fastening_signals,
    force_block,
    object_channels,
    object_memory,
    stop_block,
)

if TYPE_CHECKING:
    import xarray as xr


Floats = NDArray[np.float64]
Attributes = dict[str, str | int | float | bool]

MOST_DESCRIBED = 8
"""Panels with their objects whose attributes are kept in memory, the latest used."""

_AS_WRITTEN = {
    "link_force": ("link", "time"),
    "chair_normal_force": ("rail", "chair", "time"),
    "chair_friction_force": ("rail", "chair", "time"),
    "stop_force": ("rail", "stop", "time"),
    "gap": ("rail", "x", "time"),
    "lateral_displacement": ("rail", "x", "time"),
}
"""Dimensions of the channels that are rows over time, as they are."""


def response_dataset(
    panel: Panel, mechanism: Mechanism, history: History, *, save: Save | None = None
) -> "xr.Dataset":
    """Turn a run into a dataset, complete or up to its early end.

    Parameters
    ----------
    panel : Panel
        Simulated panel.
    mechanism : Mechanism
        Its mechanics, with the foreign objects.
    history : History
        Results of the integration.
    save : Save, optional
        Channels to keep; default everything at chairs and drives.

    Returns
    -------
    xarray.Dataset
        Labelled and checked; ``attrs`` are left to `describe_run`.
    """
    save = save or Save()
    channels = response_channels(panel, mechanism, history, save=save)
    coords = coordinates_of(channels, panel, mechanism, time=history.time, save=save)
    return labelled_dataset(channels, coords)


def response_channels(
    panel: Panel, mechanism: Mechanism, history: History, *, save: Save
) -> dict[str, Channel]:
    """Return the channels of `response_dataset` as bare arrays, for datasets of many runs.

    Parameters
    ----------
    panel, mechanism, history
        As for `response_dataset`.
    save : Save
        Channels to keep; others are computed only if they cost nothing.

    Returns
    -------
    dict of str to (dims, ndarray)
        By the names of the schema, in SI.
    """
    moved, panel = moved_throws(panel, history), as_thrown(panel, history)
    motion = recover_motion(mechanism, history)
    arrays = channel_rows(panel, mechanism, motion, save)
    channels = drive_channels(panel, arrays["drive_force"], history.inputs)
    machine_slips(history, np.asarray(channels["drive_slipping"][1]))
    channels |= machine_signals(panel, history) | machine_labels(panel, history)
    if "object" in arrays:
        channels |= object_channels(mechanism.index, arrays["object"])
    channels |= {name: (dims, arrays[name]) for name, dims in _AS_WRITTEN.items() if name in arrays}
    if panel.fastening and save.keeps(*FASTENINGS):
        channels |= fastening_signals(panel, motion)
    if "places" in arrays:
        channels |= _gaps(panel, arrays["places"], history.time)
    if save.keeps(*LEAST_DISTANCES):
        of_run = distance_labels([distance_ends(panel, motion, moved)], panel)
        channels |= {name: (dims, values[0, ...]) for name, (dims, values) in of_run.items()}
    if panel.gauge is not None and save.keeps("gauge"):
        channels["gauge"] = gauge_channel(panel, motion, output_stations(panel, mechanism, save))
    objects = list(mechanism.index.object.values())
    first, placed = history.law_first[objects], history.law_placed[objects]
    channels |= contact_labels(mechanism.index, first, placed)
    channels |= object_memory(mechanism, history)
    if save.keeps(*ENERGIES):
        channels |= energy_channels(history.stored, history.ledger)
        channels |= machine_energies(history, channels)
    channels |= _states(panel, history.time, channels, save, moved)
    return save.kept(channels)


def coordinates_of(
    channels: Mapping[str, Channel],
    panel: Panel,
    mechanism: Mechanism,
    *,
    time: Floats,
    save: Save,
) -> dict[str, Channel]:
    """Return the coordinates of some channels as bare arrays, and time in any case.

    Parameters
    ----------
    channels : mapping of str to (dims, ndarray)
        From `response_channels`.
    panel, mechanism
        As there.
    time : ndarray, shape (n_times,)
        [s]
    save : Save
        With the places of `gap` and `lateral_displacement`.
    """
    used = dimensions_of(channels)
    found = {"time": (("time",), time), **dataset_coordinates(panel, mechanism.index, used=used)}
    if "x" in used:
        found["x"] = (("x",), output_stations(panel, mechanism, save))
    return found


def _gaps(panel: Panel, places: Floats, time: Floats) -> dict[str, Channel]:
    """Return gaps at drives and sensors from those at all places."""
    gap, at_sensors = split_gaps(panel, places, time)
    last = gap[:, -1] if time.size else np.full(gap.shape[0], np.nan)
    found: dict[str, Channel] = {
        "drive_gap": (("drive", "time"), gap),
        "end_gap": (("drive",), last.copy()),
    }
    if panel.sensor:
        found["sensor_gap"] = (("sensor", "time"), at_sensors)
    return found


def _states(
    panel: Panel,
    time: Floats,
    channels: dict[str, Channel],
    save: Save,
    moved: Sequence[DirectedMovement],
) -> dict[str, Channel]:
    """Return the channels derived from forces and gaps, as far as these were made."""

    def values(name: str) -> Floats:
        return np.asarray(channels[name][1], dtype=float)

    found: dict[str, Channel] = {}
    if save.keeps("force_margin"):
        margins = force_margins(panel, time=time, drive_force=values("drive_force"))
        found["force_margin"] = (("drive", "direction"), margins)
    if "drive_gap" in channels and save.keeps("locked", "in_control"):
        found |= control_states(
            panel,
            time=time,
            slipping=np.asarray(channels["drive_slipping"][1], dtype=np.bool_),
            drive_force=values("drive_force"),
            drive_gap=values("drive_gap"),
            sensor_gap=values("sensor_gap") if "sensor_gap" in channels else None,
            moved=moved,
        )
    return found


def describe_run(
    panel: LoadedPanel,
    mechanism: Mechanism,
    history: History,
    *,
    scheme: Scheme,
    objects: Sequence[PlacedObject],
    wall_time: float,
    solver_time: float,
) -> Attributes:
    """Return the origin of the numbers as attributes of a dataset; records as JSON text."""
    outcome, made = history.outcome, duties(history)
    waits = [item.length for item in history.machines.pauses] if history.machines else []
    end = float(history.time[-1]) if history.time.size else 0.0
    return {
        **_inputs(panel, objects),
        "movements": movement_records(moved_throws(panel, history)),
        **({"machine_throws": duty_records(panel, made, end)} if made else {}),
        **({"schedule_waits": json.dumps(waits)} if any(waits) else {}),
        **_rules(panel, scheme),
        "outcome": outcome.code.name.lower().replace("_", " "),
        "outcome_message": outcome.message(),
        "complete": outcome.complete,
        "residual": outcome.residual,
        "steps": outcome.step,
        "iterations": history.iterations,
        "flips": history.flips,
        "halved_steps": history.halved,
        "wall_time": wall_time,
        "solver_time": solver_time,
        "modes": history.model.load.size,
        "highest_mode_frequency": float(history.model.frequencies.max()),
        "superelements": _superelements(mechanism),
        "energy_scale": outcome.energy_scale
        if history.machines or scheme.stride  # else the run had other instants than its history
        else energy_scale(history.stored, history.ledger),
    }


def _inputs(panel: LoadedPanel, objects: Sequence[PlacedObject]) -> Attributes:
    """Return the simulated panel and objects, and the program that simulated them."""
    return {
        "title": f"Throw of {panel.name}",
        "kind": "simulation",
        **provenance(),
        "schema_version": SCHEMA_VERSION,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "overrides": json.dumps(dict(panel.overrides), default=_plain),
        "foreign_objects": json.dumps([object_record(panel, item) for item in objects]),
    }


def _rules(panel: LoadedPanel, scheme: Scheme) -> Attributes:
    """Return supplies of the machines and rules of judgement of a panel, and the scheme."""
    return {
        **({"machine_supplies": json.dumps(fed)} if (fed := machine_supplies(panel)) else {}),
        **({"blind_currents": json.dumps(blind)} if (blind := blind_currents(panel)) else {}),
        "lock_rule": panel.lock.rule,
        "lock_gap_limit": panel.lock.gap_limit,
        "lock_gap_limits": json.dumps(panel.gap_limits()),
        "flangeway_limit": panel.flangeway.limit if panel.flangeway else float("nan"),
        **gauge_rules(panel),
        "instrumented_rail": panel.instrumented_rail,
        **({"loaded_by": panel.schedule.loaded_by} if prior_movement(panel) else {}),
        "sensor_rails": json.dumps(sensor_rails(panel)),
        "scheme": scheme.describe(),
        "mode": scheme.mode,
        "step": scheme.step,
        "cutoff_frequency": scheme.cutoff_frequency,
        "spectral_radius": scheme.spectral_radius,
        "gap_tolerance": scheme.gap_tolerance,
        "force_tolerance": scheme.force_tolerance,
        "output_interval": scheme.output_interval,
    }


def gauge_rules(panel: Panel) -> Attributes:
    """Return the nominal gauge, the least one allowed [m], NaN without a limit, and the classes.

    With `gauge_line_speed` [m/s] where its class gives the limit; `gauge_classes` are pairs of
    speed [m/s] and narrowing [m] as JSON.
    """
    data = panel.gauge
    if data is None:
        return {}
    limit = panel.gauge_limit
    least = float("nan") if limit is None else limit
    found: Attributes = {"gauge_nominal": data.nominal, "gauge_limit": least}
    if data.line_speed is not None:
        found["gauge_line_speed"] = data.line_speed
    classes = data.limits if isinstance(data.limits, list) else []
    return found | {"gauge_classes": json.dumps([[c.up_to, c.narrowing] for c in classes])}


def object_record(panel: Panel, item: PlacedObject) -> dict[str, object]:
    """Return an object with its place as plain data; times in s, None for never."""
    times = {"appears": item.appears, "disappears": item.disappears}
    return {
        "name": item.name,
        "size": item.size,
        "x": item.x,
        "place": place_name(panel, item.x),
        "rail": item.rail,
        "height": item.height,
        "stiffness": item.stiffness,
        **_kind_record(item),
        **{key: value if np.isfinite(value) else None for key, value in times.items()},
    }


def _kind_record(item: PlacedObject) -> dict[str, object]:
    """Return kind and parameters of an object that is no spring."""
    if not item.of_kind.remembers:
        return {}
    return {"kind": item.kind} | {name: getattr(item, name) for name in item.of_kind.parameters}


@lru_cache(maxsize=MOST_DESCRIBED)
def movement_records(moved: tuple[DirectedMovement, ...]) -> str:
    """Return movements as JSON text, as a dataset names them in its attributes."""
    return json.dumps(
        [
            {"name": throw.name, "to": throw.to, "start": throw.start, "end": throw.end}
            for throw in moved
        ]
    )


def _superelements(mechanism: Mechanism) -> str:
    """Return the reduction of the rails as JSON text."""
    return json.dumps(
        [
            {
                "rail": body.name,
                "frequency_kept": body.frequency_kept if np.isfinite(body.frequency_kept) else None,
                "frequency_omitted": body.frequency_omitted
                if np.isfinite(body.frequency_omitted)
                else None,
                "dofs": body.n_full,
                "dofs_kept": body.count,
                "dofs_interface": body.n_interface,
            }
            for body in mechanism.rails
        ]
    )


def _plain(value: object) -> object:
    """Turn a number of an override into one that JSON knows."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


OBJECTS = ("object_force", "single_object_force")
SHAPES = ("gap", "lateral_displacement")
FEW_ROWS = ("drive_force", "object", "link_force", "places")
DRIVE_GAPS = ("drive_gap", "end_gap", "locked")
SENSOR_GAPS = ("sensor_gap", "in_control")
LEAST_DISTANCES = (
    *("least_flangeway", "least_flangeway_x", "least_flangeway_rail"),
    *("least_gauge", "least_gauge_x", "least_gauge_rail", "least_gauge_place"),
)


def channel_rows(
    panel: Panel, mechanism: Mechanism, motion: Motion, save: Save
) -> dict[str, Floats]:
    """Return the rows over time that channels are made of, written together.

    Parameters
    ----------
    panel, mechanism, motion
        Panel that was thrown, its mechanism and its motion.
    save : Save
        Channels that are kept.

    Returns
    -------
    dict of str to ndarray
        By the name of a channel, the last axis time; "object" are the forces of all laws of
        objects, "places" the open distances at all `turnout.throw.gaps.gap_places`.
    """
    index, history = mechanism.index, motion.history
    x = output_stations(panel, mechanism, save) if save.keeps(*SHAPES) else None
    wanted = (
        *(save.keeps(*OBJECTS), save.keeps("link_force")),
        bool(panel.chair) and save.keeps("chair_normal_force", "chair_friction_force"),
        bool(panel.stop or panel.stud) and save.keeps("stop_force"),
        save.keeps(*DRIVE_GAPS, *SENSOR_GAPS),
    )

    def block() -> RowBlock:
        objects, links, chairs, stops, gaps = wanted
        found = [force_block(panel, mechanism, objects=objects, links=links)]
        found += [place_block(panel, motion)] if gaps else []
        found += [chair_block(panel, mechanism)] if chairs else []
        found += [stop_block(panel, mechanism)] if stops else []
        return merge_blocks(found + ([] if x is None else [shape_block(panel, motion, x)]))

    laws = (
        *(index.drive, index.object, index.link, index.stop),
        *(index.chair, index.chair_friction, index.roller, index.roller_friction),
    )
    values = (
        *(*wanted, gaps_key(panel), tuple(panel.chair), tuple(panel.link)),
        *(tuple(found.items()) for found in laws),
        None if x is None else x.tobytes(),
    )
    made = row_block_of(motion, values, block).over_time(histories_of(history))
    # those of few rows do not keep the memory of all
    return {name: rows.copy() if name in FEW_ROWS else rows for name, rows in made.items()}
