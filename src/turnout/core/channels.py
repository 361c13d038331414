"""Table of channels (name, dimensions, unit and sign), and the check of a dataset against it."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from turnout.core.errors import ResponseError

if TYPE_CHECKING:
    import xarray as xr


SCHEMA_VERSION = 1
CONVENTIONS = "CF-1.11"
"""Of climate and forecast data, cfconventions.org: names of attributes, forms of units."""
AXES = {"time": "T"}
"""Coordinates that CF knows as an axis; time counts from an event, so it has no calendar. A length
along the track is none of them, as CF means a map's axis by X."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A variable of datasets: name, dimensions, unit, sign.

    Attributes
    ----------
    name : str
        Name of the variable.
    dims : tuple of str
        Its dimensions, in this order.
    units : str
        SI unit, "1" for what has none.
    long_name : str
        Title for an axis.
    positive : str
        Meaning of a positive value, such as "closing"; empty if no sign has to be chosen.
    kind : str
        "number", "count", "logical" or "text".
    """

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str
    positive: str = ""
    kind: str = "number"


def _table(*rows: Channel) -> Mapping[str, Channel]:
    return {row.name: row for row in rows}


COORDINATES: Mapping[str, Channel] = _table(
    Channel("time", ("time",), "s", "time since the start of the schedule", "forward"),
    Channel("x", ("x",), "m", "position from the toe", "towards the heel"),
    Channel("drive", ("drive",), "1", "drive", kind="text"),
    Channel("rail", ("rail",), "1", "switch rail", kind="text"),
    Channel("chair", ("chair",), "1", "slide chair", kind="text"),
    Channel("stop", ("stop",), "1", "stop or stud", kind="text"),
    Channel("link", ("link",), "1", "link", kind="text"),
    Channel("sensor", ("sensor",), "1", "switch rail control contact", kind="text"),
    Channel("object", ("object",), "1", "foreign object", kind="text"),
    Channel("fastening", ("fastening",), "1", "fastening", kind="text"),
    Channel("axis", ("axis",), "1", "axis of the panel", kind="text"),
    Channel("direction", ("direction",), "1", "direction of a movement", kind="text"),
    Channel("column", ("column",), "1", "column of a recording", kind="text"),
    Channel("column_unit", ("column",), "1", "unit of a column as recorded", kind="text"),
    Channel("drive_x", ("drive",), "m", "position of the drive", "towards the heel"),
    Channel("chair_x", ("chair",), "m", "position of the chair", "towards the heel"),
    Channel("stop_x", ("stop",), "m", "position of the stop", "towards the heel"),
    Channel("link_x", ("link",), "m", "position of the link", "towards the heel"),
    Channel("fastening_x", ("fastening",), "m", "position of the fastening", "towards the heel"),
    Channel("sensor_x", ("sensor",), "m", "position of the sensor", "towards the heel"),
    Channel("sensor_limit", ("sensor",), "m", "gap from which a sensor is out of control"),
    Channel("saturation_force", ("drive",), "N", "force at which the drive slips"),
    Channel(
        "drive_stiffness",
        ("drive",),
        "N/m",
        "stiffness of a bushing, NaN for a table",
    ),
)

CHANNELS: Mapping[str, Channel] = _table(
    Channel("drive_force", ("drive", "time"), "N", "drive force on the rail", "closing"),
    Channel("drive_displacement", ("drive", "time"), "m", "marker displacement", "closing"),
    Channel(
        "drive_gap", ("drive", "time"), "m", "gap at the drive, of the rail to be closed", "open"
    ),
    Channel("drive_current", ("drive", "time"), "A", "motor current"),
    Channel(
        "drive_slipping", ("drive", "time"), "1", "drive at its saturation force", kind="logical"
    ),
    Channel("drive_voltage", ("drive", "time"), "V", "voltage at the motor circuit"),
    Channel("drive_power", ("drive", "time"), "W", "power from the supply"),
    Channel("drive_apparent_power", ("drive", "time"), "V A", "apparent power from the supply"),
    Channel("motor_speed", ("drive", "time"), "rad/s", "speed of the motor", "closing"),
    Channel("clutch_slip", ("drive", "time"), "rad", "slip of the clutch", "closing"),
    Channel("clutch_heat", ("drive", "time"), "J", "heat of the slipping clutch", "taken out"),
    Channel(
        "drive_state",
        ("drive", "time"),
        "1",
        "state of the machine: 0 off, 1 on, 2 on and slipping, 3 off and locked, -1 no machine",
        kind="count",
    ),
    Channel("gauge", ("x", "time"), "m", "track gauge beside the rail to be closed", "wide"),
    Channel("object_force", ("time",), "N", "force on the foreign object", "compression"),
    Channel(
        "single_object_force",
        ("object", "time"),
        "N",
        "force on each of several foreign objects",
        "compression",
    ),
    Channel(
        "drive_force_unfiltered", ("drive", "time"), "N", "drive force before filtering", "closing"
    ),
    Channel("drive_current_unfiltered", ("drive", "time"), "A", "motor current before filtering"),
    Channel("drive_voltage_unfiltered", ("drive", "time"), "V", "voltage before filtering"),
    Channel("drive_power_unfiltered", ("drive", "time"), "W", "power before filtering"),
    Channel(
        "object_force_unfiltered",
        ("time",),
        "N",
        "force on the foreign object before filtering",
        "compression",
    ),
    Channel("recorded", ("column", "time"), "see column_unit", "columns as they were recorded"),
    Channel("gap", ("rail", "x", "time"), "m", "gap at contact height", "open"),
    Channel(
        "lateral_displacement",
        ("rail", "x", "time"),
        "m",
        "lateral displacement at contact height",
        "closing",
    ),
    Channel("sensor_gap", ("sensor", "time"), "m", "gap at the sensor's height", "open"),
    Channel(
        "chair_normal_force", ("rail", "chair", "time"), "N", "chair normal force", "compression"
    ),
    Channel(
        "chair_friction_force",
        ("rail", "chair", "time"),
        "N",
        "chair friction on the rail",
        "closing",
    ),
    Channel("stop_force", ("rail", "stop", "time"), "N", "force at the stop", "compression"),
    Channel("link_force", ("link", "time"), "N", "force in the link", "tension"),
    Channel(
        "fastening_force",
        ("rail", "fastening", "axis", "time"),
        "N",
        "force of a fastening's springs on the rail",
        "along the axis",
    ),
    Channel(
        "fastening_moment",
        ("rail", "fastening", "axis", "time"),
        "N m",
        "moment of a fastening's springs on the rail",
        "about the axis",
    ),
    Channel("in_control", ("sensor", "time"), "1", "sensor gap below its limit", kind="logical"),
    Channel("locked", ("time",), "1", "lock rule met, no movement under way", kind="logical"),
    Channel("work_markers", ("time",), "J", "work of the drives' markers", "put in"),
    Channel("energy_kinetic", ("time",), "J", "change of kinetic energy", "stored"),
    Channel(
        "energy_strain", ("time",), "J", "change of strain in beams and linear springs", "stored"
    ),
    Channel(
        "energy_contact",
        ("time",),
        "J",
        "change of potential in contacts, bushings, links and sticking feet",
        "stored",
    ),
    Channel(
        "energy_gravity", ("time",), "J", "change of the potential energy of the weight", "stored"
    ),
    Channel("energy_friction", ("time",), "J", "dissipated by sliding", "taken out"),
    Channel("energy_damping", ("time",), "J", "dissipated by dampers", "taken out"),
    Channel(
        "energy_object_switched",
        ("time",),
        "J",
        "added where an object is placed or removed",
        "put in",
    ),
    Channel(
        "energy_object_dissipated",
        ("time",),
        "J",
        "dissipated by objects that dent or break",
        "taken out",
    ),
    Channel("energy_supply", ("time",), "J", "from the supply of the machines", "put in"),
    Channel("energy_copper", ("time",), "J", "lost in the motors' copper and iron", "taken out"),
    Channel("energy_line", ("time",), "J", "lost in lines, supply and snubbers", "taken out"),
    Channel("energy_brush", ("time",), "J", "lost at the brushes", "taken out"),
    Channel(
        "energy_motor_friction", ("time",), "J", "friction and drag of the motors", "taken out"
    ),
    Channel("energy_gear", ("time",), "J", "lost in the gears", "taken out"),
    Channel("energy_machine", ("time",), "J", "change in coils, inertias and clutches", "stored"),
    Channel("work_rods", ("time",), "J", "work of the machines on their rods", "put in"),
    Channel("energy_numerical", ("time",), "J", "lost by the time stepping", "taken out"),
    Channel("energy_residual", ("time",), "J", "residual of the energy balance"),
    Channel("object_placed", (), "1", "whether every object fits into the gap", kind="logical"),
    Channel("object_touched", (), "1", "whether a rail reached a foreign object", kind="logical"),
    Channel("contact_time", (), "s", "first contact with a foreign object", "forward"),
    Channel("object_contact_time", ("object",), "s", "first contact with each object", "forward"),
    Channel("object_left", ("object",), "m", "size of each object that is left"),
    Channel("object_broken", ("object",), "1", "how often each object broke", kind="count"),
    Channel("end_gap", ("drive",), "m", "gap at the drive at the end", "open"),
    Channel(
        "force_margin",
        ("drive", "direction"),
        "N",
        "saturation force less the largest drive force in the direction of a movement",
        "not slipping",
    ),
    Channel(
        "throw_time", ("drive", "direction"), "s", "from the contactor to the cut-off", "forward"
    ),
    Channel("mean_current", ("drive", "direction"), "A", "mean of the motor current after inrush"),
    Channel("end_current", ("drive", "direction"), "A", "motor current before the cut-off"),
    Channel("least_flangeway", (), "m", "least flangeway at the end of a movement", "open"),
    Channel("least_flangeway_x", (), "m", "place of the least flangeway", "towards the heel"),
    Channel("least_flangeway_rail", (), "1", "rail of the least flangeway", kind="text"),
    Channel("least_gauge", (), "m", "least track gauge at the end of a movement", "wide"),
    Channel("least_gauge_x", (), "m", "place of the least gauge", "towards the heel"),
    Channel("least_gauge_rail", (), "1", "closed rail of the least gauge", kind="text"),
    Channel("least_gauge_place", (), "1", "name of the place of the least gauge", kind="text"),
)

# A campaign has these in place of one direction, and "movement" before the dimensions of channels.
CAMPAIGN_COORDINATES: Mapping[str, Channel] = _table(
    Channel("movement", ("movement",), "1", "movement", kind="text"),
    Channel("direction", ("movement",), "1", "direction of the movement", kind="text"),
    Channel("size", ("movement",), "m", "size of the foreign object"),
    Channel("place", ("movement",), "1", "place of the foreign object", kind="text"),
    Channel("repeat", ("movement",), "1", "number among repeats", kind="count"),
    Channel("slipped", ("movement",), "1", "whether a drive slipped at the end", kind="logical"),
    Channel("remark", ("movement",), "1", "remark of the run sheet", kind="text"),
    Channel("file", ("movement",), "1", "file of the recording", kind="text"),
    Channel("start_time", ("movement",), "1", "date and time of the recording", kind="text"),
    Channel("onset", ("movement",), "s", "onset of motion on the time of the recording"),
)

# A sequence of throws has "throw" before the dimensions of channels, and these.
SEQUENCE: Mapping[str, Channel] = _table(
    Channel("object_size", ("throw", "object"), "m", "size of each object before the throw"),
    Channel("throw_temperature", ("throw",), "K", "temperature of ice and snow"),
    Channel("throw_movements", ("throw",), "1", "movements of the throw, as JSON", kind="text"),
    Channel("throw_machine_throws", ("throw",), "1", "its machines, as JSON", kind="text"),
)
SEQUENCE_COORDINATES: Mapping[str, Channel] = _table(
    Channel("throw", ("throw",), "1", "number of the throw", kind="count"),
)

# Left out where nothing of the kind exists or was measured; a simulation has all the others.
MEASURED = frozenset(
    {
        "drive_current",
        "drive_force_unfiltered",
        *("drive_current_unfiltered", "drive_voltage_unfiltered", "drive_power_unfiltered"),
        "object_force_unfiltered",
        "recorded",
    }
)
# Made where drives are machines.
OF_MACHINES = frozenset(
    {
        *("drive_voltage", "drive_power", "motor_speed", "clutch_slip", "clutch_heat"),
        *("drive_state", "throw_time", "mean_current", "end_current"),
        *("energy_supply", "energy_copper", "energy_line"),
        *("energy_brush", "energy_motor_friction", "energy_gear", "energy_machine", "work_rods"),
    }
)
# Made where machines have a three-phase motor.
OF_THREE_PHASE = frozenset({"drive_apparent_power"})
# Made on request only.
ON_REQUEST = frozenset({"fastening_force", "fastening_moment", "gauge"})
# Made where the panel has data of its gauge.
OF_GAUGE = frozenset({"least_gauge", "least_gauge_x", "least_gauge_rail", "least_gauge_place"})
OPTIONAL = MEASURED | OF_MACHINES | OF_THREE_PHASE | ON_REQUEST | OF_GAUGE
OPTIONAL |= {"single_object_force", "object_contact_time", "object_left", "object_broken"}

DEPENDS = "depends on how it breaks"
"""Kind of verdict on a throw that ends otherwise where objects break a little sooner or later."""
BREAK_NOTE = (
    "An object broke: where its strength is nearly met, the verdict may depend on step and mode"
)
"""Attribute `break_note` of sequences in which an object broke, with `break_throw`; of a single
throw, which is compared with others, it says what differs, and `break_check` what was compared."""
KINDS_NOTE = (
    "Objects may break: throws of a sweep are not compared, and where a strength is nearly met the "
    "verdict may depend on step and mode; `object_broken`, if stored, counts breaks"
)
"""Attribute `break_note` of sweeps with objects of such kinds that do not store `object_broken`."""


def label(dataset: "xr.Dataset") -> "xr.Dataset":
    """Give every variable of a dataset its unit, name and sign.

    Parameters
    ----------
    dataset : xarray.Dataset
        With variables of the table only; it is not changed.

    Returns
    -------
    xarray.Dataset
        The same data with ``units``, ``long_name`` and, where there is a sign, ``positive``; the
        dataset says in ``Conventions`` that it keeps to CF.

    Examples
    --------
    >>> import xarray as xr
    >>> import numpy as np
    >>> bare = xr.Dataset({"object_force": ("time", np.zeros(2))}, {"time": [0.0, 1.0]})
    >>> label(bare)["object_force"].attrs["units"]
    'N'
    """
    return add_labels(dataset.copy())


def add_labels(dataset: "xr.Dataset") -> "xr.Dataset":
    """Label a dataset in place, unlike `label`, and return it."""
    outer = outer_dimension(dataset)
    for name, variable in dataset.variables.items():
        channel = known_channel(str(name), outer=outer)
        if channel is None:
            raise KeyError(name)
        attributes = {"units": channel.units, "long_name": channel.long_name}
        attributes |= {"positive": channel.positive} if channel.positive else {}
        variable.attrs |= attributes | ({"axis": AXES[str(name)]} if name in AXES else {})
    dataset.attrs["Conventions"] = CONVENTIONS
    return dataset


def outer_dimension(dataset: "xr.Dataset") -> str:
    """Return "movement" for a campaign, "throw" for a sequence of throws, else an empty text."""
    return next((name for name in ("movement", "throw") if name in dataset.dims), "")


def known_channel(name: str, *, outer: str = "") -> Channel | None:
    """Return the row of the table for a variable.

    Parameters
    ----------
    name : str
        Of the variable.
    outer : str
        Dimension in front of those of the channels: "movement" in a campaign, "throw" in a
        sequence, else empty.

    Examples
    --------
    >>> known_channel("drive_force", outer="movement").dims
    ('movement', 'drive', 'time')
    """
    channel = CHANNELS.get(name)
    if not outer:
        return channel or COORDINATES.get(name)
    if channel is not None:
        return replace(channel, dims=(outer, *channel.dims))
    if outer == "throw":
        return SEQUENCE.get(name) or SEQUENCE_COORDINATES.get(name) or COORDINATES.get(name)
    return CAMPAIGN_COORDINATES.get(name) or COORDINATES.get(name)


_KINDS = {"number": "f", "count": "i", "logical": "b", "text": "U"}


def schema_problems(dataset: "xr.Dataset") -> list[str]:
    """List all departures of a dataset from the table.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured; channels may be missing, none may be unknown.

    Returns
    -------
    list of str
        One sentence each; empty when the dataset is in order.
    """
    problems = []
    outer, coordinates = outer_dimension(dataset), set(dataset.coords)
    for name, variable in dataset.variables.items():
        channel = known_channel(str(name), outer=outer)
        inside = name in CHANNELS or name in SEQUENCE
        if channel is None or (name in coordinates) == inside:
            near = nearest_channel(str(name))
            problems.append(f"{name}: no such channel{near}")
            continue
        if name in COORDINATES and variable.dims[:1] == ("throw",):  # it changed on the way
            channel = replace(channel, dims=("throw", *channel.dims))
        problems += _departures(channel, variable)
    if "time" in dataset.coords:
        time = dataset["time"].values
        if not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
            problems.append("time: must be finite and rise")
    return problems


def check_schema(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return a dataset that keeps to the table, or raise with everything that is wrong.

    Raises
    ------
    ResponseError
        With all problems.
    """
    problems = schema_problems(dataset)
    if problems:
        message = "dataset: " + "; ".join(problems)
        raise ResponseError(message)
    return dataset


def unknown_channels(names: Iterable[str]) -> list[str]:
    """Describe the names that are no channels, each with the nearest one that is."""
    return [
        f"{name}: no such channel{nearest_channel(name)}" for name in names if name not in CHANNELS
    ]


def nearest_channel(name: str) -> str:
    """Suggest a channel for a name that is none, as the end of a sentence.

    Examples
    --------
    >>> nearest_channel("drive_forse")
    '; nearest is drive_force'
    """
    close = difflib.get_close_matches(name, list(CHANNELS), n=1)
    return f"; nearest is {close[0]}" if close else ""


def _departures(channel: Channel, variable: "xr.Variable") -> list[str]:
    problems = []
    if variable.dims != channel.dims:
        problems.append(f"{channel.name}: dimensions {variable.dims}, must be {channel.dims}")
    if variable.dtype.kind != _KINDS[channel.kind]:
        problems.append(f"{channel.name}: {variable.dtype} is not a {channel.kind}")
    if channel.kind == "number" and variable.dtype != np.float64:
        problems.append(f"{channel.name}: {variable.dtype}, must be float64")
    for key, expected in (("units", channel.units), ("long_name", channel.long_name)):
        if variable.attrs.get(key) != expected:
            problems.append(
                f"{channel.name}: {key} {variable.attrs.get(key)!r}, must be {expected!r}"
            )
    return problems
