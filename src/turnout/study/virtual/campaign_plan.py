"""Plan of a virtual campaign: places, sizes, repeats, and differences between throws."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from turnout.core.errors import FileError, PanelError
from turnout.core.problems import choices, nearest
from turnout.core.scheme import Scheme
from turnout.core.units import LENGTH, parse_quantity
from turnout.measurement.campaign.run_sheet import LOAD_CELL_FROM, normal_place
from turnout.measurement.chain.monitoring import Monitoring, check_monitoring
from turnout.measurement.chain.recorder import PERFECT, Recorder
from turnout.measurement.formats.file_format import WRITERS
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.study.defects import DEFECTS
from turnout.study.virtual.disturbance import Disturbance
from turnout.study.virtual.record_throw import CurrentLaw, Window
from turnout.throw.drives import machine_supplies
from turnout.throw.object_fit import estimated_opening, object_fits

# The sizes of the published campaign; without an object there are repeats [m].
SIZES = (0.005, 0.010, 0.013, 0.016, 0.018, 0.021, 0.023, 0.026, 0.029, 0.031)
OBJECT_FREE = "none"
# So small an object has room anywhere [m].
POINT = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Defects:
    """Defects of a drive; without them every drive is as the panel says.

    Attributes
    ----------
    drive : str
        Name of the drive with the defects.
    slip_excess, slip_scatter : float
        A worn clutch: how much the drive slips above its level, and how much that scatters from
        throw to throw, as shares of the level.
    build_up_lag : float
        Softer build-up: time constant with which its force follows after contact [s].
    """

    drive: str = "2"
    slip_excess: float = 0.0
    slip_scatter: float = 0.0
    build_up_lag: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignPlan:
    """A virtual campaign before it is thrown.

    Attributes
    ----------
    places : tuple of str
        Of the object.
    sizes : tuple of float
        Tried in this order until a drive slips [m].
    at_least : float
        Sizes up to here are tried even if a drive slips: a load cell must fit at every place [m].
    object_free : int
        Repeats without an object, in each direction of the schedule.
    friction_scatter : float
        Standard deviation of the friction of all chairs from throw to throw, as a share.
    supply_scatter : float
        Standard deviation of the voltage of three-phase supplies from throw to throw, as a share:
        4 V of 391 V, an assumption.
    formats : tuple of str
        Suffixes of the recordings, in turn from place to place.
    mistyped : int
        Mistakes in the run sheet.
    seed : int
        Of all that is left to chance.
    scheme : Scheme
        With which the truth is integrated.
    monitoring : Monitoring, optional
        A system in service that stores currents and powers beside the recordings.
    recorder : Recorder
        Response of the recorder to forces.
    recorder_stated : bool
        Whether the channel map states it.
    """

    places: tuple[str, ...]
    sizes: tuple[float, ...] = SIZES
    at_least: float = LOAD_CELL_FROM
    object_free: int = 5
    friction_scatter: float = 0.02
    supply_scatter: float = 0.01
    formats: tuple[str, ...] = (".csv", ".mat")
    mistyped: int = 0
    seed: int = 0
    defects: Defects = field(default_factory=Defects)
    disturbance: Disturbance = field(default_factory=Disturbance)
    window: Window = field(default_factory=Window)
    law: CurrentLaw = field(default_factory=CurrentLaw)
    scheme: Scheme = field(default_factory=Scheme)
    monitoring: Monitoring | None = None
    recorder: Recorder = PERFECT
    recorder_stated: bool = True

    def __post_init__(self) -> None:
        """Refuse all impossible values at once."""
        problems = []
        if not all(0 < size < 1 for size in self.sizes) or not self.sizes:
            problems.append("sizes: need at least one, each more than 0 and less than 1 m")
        for name in ("object_free", "mistyped", "friction_scatter", "supply_scatter", "seed"):
            if getattr(self, name) < 0:
                problems.append(f"{name} = {getattr(self, name)}: must be at least 0")
        for suffix in self.formats:
            if suffix not in WRITERS:
                problems.append(f"format '{suffix}': can be {choices(WRITERS)}")
        if not self.formats:
            problems.append(f"formats: need at least one of {choices(WRITERS)}")
        if not self.places and not self.object_free:
            problems.append("nothing to throw: neither places nor repeats without an object")
        if problems:
            raise FileError("virtual campaign: " + "; ".join(problems))


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One throw of a plan: its entries of the run sheet, and its file without the suffix."""

    name: str
    direction: str
    size: float
    place: str
    repeat: int = 1


def default_places(panel: LoadedPanel) -> tuple[str, ...]:
    """Return every sleeper and every drive of a panel, from the toe to the heel.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> len(default_places(load_panel("sb2")))
    13
    """
    named = [(item.x, f"sleeper {name}") for name, item in panel.sleeper.items()]
    named += [(item.x, f"drive {name}") for name, item in panel.drive.items()]
    return tuple(place for _, place in sorted(named, key=lambda pair: pair[0]))


def places_with_room(panel: LoadedPanel, *, size: float) -> tuple[str, ...]:
    """Return the sleepers and drives with room for an object of a size [m] between the rails.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> len(default_places(load_panel("sb1"))), len(places_with_room(load_panel("sb1"), size=0.01))
    (18, 14)
    """
    return tuple(place for place in default_places(panel) if has_room(panel, size, place))


def has_room(panel: LoadedPanel, size: float, place: str) -> bool:
    """Return True if an object of a size [m] fits between the rails at a place."""
    try:
        return object_fits(panel, size, place)
    except PanelError:
        return False


def virtual_plan(
    panel: LoadedPanel,
    *,
    places: Sequence[str] = (),
    sizes: Sequence[str] = (),
    formats: Sequence[str] = ("csv", "mat"),
    defects: Sequence[str] = (),
    object_free: int = 5,
    mistyped: int = 0,
    seed: int = 0,
    scheme: Scheme | None = None,
    monitoring: Monitoring | None = None,
    recorder: Recorder = PERFECT,
    recorder_stated: bool = True,
) -> CampaignPlan:
    """Return a plan from typed options.

    Parameters
    ----------
    panel : LoadedPanel
        Gives the places where none are named.
    places, sizes : sequence of str
        Such as "sleeper 6" and "13 mm"; the published ones where there are none.
    formats : sequence of str
        "csv", "mat", "h5".
    defects : sequence of str
        Names in `turnout.study.defects.DEFECTS`, with values of a campaign, for drive 2.
    object_free, mistyped, seed : int
        As in `CampaignPlan`.
    scheme : Scheme, optional
        With which the truth is integrated.
    monitoring : Monitoring, optional
        Stores currents and powers beside the recordings.
    recorder, recorder_stated : Recorder, bool
        As in `CampaignPlan`.

    Raises
    ------
    FileError
        With all problems.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> virtual_plan(load_panel("sb2"), sizes=["13 mm"], defects=["clutch"]).defects.slip_excess
    0.15
    """
    problems, metres, named = [], [], []
    for text in sizes:
        try:
            metres.append(parse_quantity(text, LENGTH))
        except ValueError as error:
            problems.append(f"--size {text}: {error}")
    for text in places:
        try:
            named.append(normal_place(text))
        except ValueError as error:
            problems.append(f"--place {text}: {error}")
    if problems:
        raise FileError("\n".join(problems))
    own = Defects()
    for name in defects:
        own = replace(own, **DEFECTS[name].campaign)  # type: ignore[arg-type]
    return CampaignPlan(
        places=tuple(named) or places_with_room(panel, size=min(metres, default=min(SIZES))),
        sizes=tuple(sorted(metres)) or SIZES,
        formats=tuple(f".{name.lower().removeprefix('.')}" for name in formats),
        object_free=object_free,
        mistyped=mistyped,
        seed=seed,
        defects=own,
        scheme=scheme or Scheme(),
        monitoring=monitoring,
        recorder=recorder,
        recorder_stated=recorder_stated,
    )


def check_plan(plan: CampaignPlan, panel: LoadedPanel) -> None:
    """Refuse a plan that does not fit a panel: drives, places, places without room for any size.

    Raises
    ------
    FileError, PanelError
        With all problems.
    """
    if plan.monitoring is not None:
        fed = machine_supplies(panel)
        check_monitoring(plan.monitoring, list(panel.drive), fed, rate=plan.window.rate)
    defects = plan.defects
    wanted = defects.slip_excess or defects.slip_scatter or defects.build_up_lag
    if wanted and defects.drive not in panel.drive:
        near = nearest(defects.drive, panel.drive)
        message = f"defect of drive '{defects.drive}': the panel has no such drive{near}"
        raise FileError(message)
    problems: list[str] = []
    for place in plan.places:
        problems += _room_problems(panel, min(plan.sizes), place)
    if problems:
        raise PanelError(list(dict.fromkeys(problems)), source="virtual campaign")


def _room_problems(panel: LoadedPanel, size: float, place: str) -> list[str]:
    """Say that a place is unknown, or that an object of a size [m] has no room there."""
    try:
        x = resolve_objects(panel, [ForeignObject(POINT, place)])[-1].x
    except PanelError as error:
        return list(error.problems)
    if has_room(panel, size, place):
        return []
    opening = estimated_opening(panel, x)
    most = (
        f", about {1e3 * opening:.0f} mm at most" if opening is not None and opening < size else ""
    )
    return [
        f"{1e3 * size:g} mm at {place}: no room, the rails never stand that far apart there{most}; "
        "take a smaller object or another place"
    ]


def series_of(plan: CampaignPlan, directions: tuple[str, ...]) -> list[list[Case]]:
    """Return the throws of a plan in series that do not depend on each other.

    Parameters
    ----------
    plan : CampaignPlan
        Plan of the throws.
    directions : tuple of str
        Those that the schedule has.

    Returns
    -------
    list of list of Case
        Repeats without an object, then a series of growing sizes for each place.

    Examples
    --------
    >>> plan = CampaignPlan(places=("sleeper 6",), sizes=(0.013,), object_free=1)
    >>> [case.name for series in series_of(plan, ("closing",)) for case in series]
    ['none_closing_1', 'sleeper-6_13mm_1']
    """
    free = [
        Case(
            name=f"none_{direction}_{number}",
            direction=direction,
            size=0.0,
            place=OBJECT_FREE,
            repeat=number,
        )
        for direction in directions
        for number in range(1, plan.object_free + 1)
    ]
    series = [free] if free else []
    for place in plan.places:
        label = "".join(c if c.isalnum() or c == "." else "-" for c in place)
        series.append(
            [
                Case(
                    name=f"{label}_{size * 1e3:g}mm_1", direction="closing", size=size, place=place
                )
                for size in plan.sizes
            ]
        )
    return series


def throw_generator(plan: CampaignPlan, case: Case) -> np.random.Generator:
    """Return the chance of one throw: the same whatever order the throws are made in."""
    return np.random.default_rng([plan.seed, zlib.crc32(case.name.encode())])


def overrides_for(
    plan: CampaignPlan, panel: LoadedPanel, rng: np.random.Generator
) -> Mapping[str, float]:
    """Draw the values of one throw: friction of chairs, slip of a worn clutch, supply voltage.

    Parameters
    ----------
    plan : CampaignPlan
        How much each scatters.
    panel : LoadedPanel
        Whose values are scaled.
    rng : numpy.random.Generator
        Of this throw.

    Returns
    -------
    mapping of str to float
        Overrides of the panel, in SI.
    """
    factor = max(0.0, 1.0 + plan.friction_scatter * rng.standard_normal())
    chairs = {name: chair.friction_coefficient for name, chair in panel.chair.items()}
    changed = {
        f"chair.{name}.friction_coefficient": min(2.0, value * factor)
        for name, value in chairs.items()
    }
    if len(set(chairs.values())) == 1:
        changed = {"chair.friction_coefficient": next(iter(changed.values()))}
    if not plan.friction_scatter:
        changed = {}
    defects = plan.defects
    if defects.slip_excess or defects.slip_scatter:
        level = panel.drive[defects.drive].saturation_force
        share = defects.slip_excess + defects.slip_scatter * rng.standard_normal()
        changed[f"drive.{defects.drive}.saturation_force"] = level * max(0.1, 1.0 + share)
    volts = {
        f"machine.{panel.drive[name].machine}.supply.voltage": fed["voltage"] or 0.0
        for name, fed in machine_supplies(panel).items()
        if fed["frequency"]
    }
    if volts and plan.supply_scatter:
        factor = max(0.5, 1.0 + plan.supply_scatter * rng.standard_normal())
        changed |= {key: factor * value for key, value in volts.items()}
    return changed
