"""Laws that a drive may follow instead of the bilinear one, as data of the panel or of a fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.parameter import Parameter
from turnout.core.errors import PanelError
from turnout.core.problems import choices, nearest
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
Law = Callable[[Mapping[str, float]], dict[str, object]]
Shape = Callable[[Response, Mapping[str, float]], Response]

PLAIN, WORN, SOFT, BACKLASH, KNEE = (
    "bilinear",
    "scattering slip level",
    "lagging build-up",
    "backlash",
    "rounded knee",
)
BOTH = f"{WORN} and {SOFT}"
# Standard deviation of a worn clutch from throw to throw before it is measured, as a share [-].
WORN_SCATTER = 0.05
# A table must reach as far as any bushing is stretched [m], and rise even within backlash [N].
REACH, PLAY_FORCE = 1.0, 1.0
# The stiffness of a rounded knee, as a share of the one before it [-].
KNEE_STIFFNESS = 0.25
# Less than this is as good as nothing [s], [m], [-]: two solvers differ by as much force.
LEAST_LAG, LEAST_PLAY, LEAST_KNEE = 5e-3, 5e-5, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveLaw:
    """A law of one drive, ready to be fitted.

    Attributes
    ----------
    name, text : str
        What it is called, and what it means for maintenance of the drive.
    extra : tuple of Parameter
        Beyond stiffness and slip level.
    least : mapping of str to float
        Of an extra: what is smaller changes forces by no more than two solvers differ, or is
        nothing that anyone would repair.
    scatter : mapping of str to float
        Parameters that scatter from throw to throw, and how much is expected, as a share.
    law : callable or None
        From values by name to overrides of the panel.
    shape : callable or None
        From a response and values to the response with this law.
    """

    name: str
    text: str
    extra: tuple[Parameter, ...] = ()
    least: Mapping[str, float] = field(default_factory=dict)
    scatter: Mapping[str, float]
    law: Law | None = None
    shape: Shape | None = None


def stiffness_key(drive: str) -> str:
    """Return the panel's key of a drive's stiffness."""
    return f"drive.{drive}.stiffness"


def level_key(drive: str) -> str:
    """Return the panel's key of a drive's slip level."""
    return f"drive.{drive}.saturation_force"


def stiffness_and_level(
    panel: LoadedPanel, drive: str, values: Mapping[str, float]
) -> tuple[float, float]:
    """Return stiffness [N/m] and slip level [N] of a drive; the panel gives what has no value."""
    record = panel.drive[drive]
    stiffness = values.get(stiffness_key(drive), record.stiffness)
    return stiffness, values.get(level_key(drive), record.saturation_force)


def drive_laws(panel: LoadedPanel, drive: str) -> tuple[DriveLaw, ...]:
    """Return the laws that a drive may follow, the plain one first.

    Parameters
    ----------
    panel : LoadedPanel
        Has the drive.
    drive : str
        Name of the drive in the panel, such as "2".

    Raises
    ------
    PanelError
        When there is no such drive.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [law.name for law in drive_laws(load_panel("sb1"), "2")][:3]
    ['bilinear', 'scattering slip level', 'lagging build-up']
    """
    if drive not in panel.drive:
        near = nearest(drive, panel.drive)
        problem = f"drive '{drive}': not in panel {panel.name}{near}; it has {choices(panel.drive)}"
        raise PanelError([problem], source="drive laws")
    worn = {level_key(drive): WORN_SCATTER}
    lag = Parameter(
        name="lag", keys=(), start=0.1, lower=0.0, upper=1.0, unit="s", transform="linear"
    )
    play = Parameter(
        name="backlash", keys=(), start=1e-3, lower=0.0, upper=0.03, unit="m", transform="linear"
    )
    knee = Parameter(
        name="knee", keys=(), start=0.3, lower=0.0, upper=0.8, unit="1", transform="linear"
    )
    soft: Shape = lambda response, values: lagged(response, drive, lag=values["lag"])  # noqa: E731
    tables = {
        BACKLASH: lambda values: table(panel, drive, values, backlash=values["backlash"]),
        KNEE: lambda values: table(panel, drive, values, knee=values["knee"]),
    }
    return (
        DriveLaw(name=PLAIN, text="a spring that slips at one level", scatter={}),
        DriveLaw(name=WORN, text="the clutch slips at another level each throw", scatter=worn),
        DriveLaw(
            name=SOFT,
            text="the force follows contact with a delay",
            extra=(lag,),
            least={"lag": LEAST_LAG},
            scatter={},
            shape=soft,
        ),
        DriveLaw(
            name=BACKLASH,
            text="the drive has play before it pushes",
            extra=(play,),
            least={"backlash": LEAST_PLAY},
            scatter={},
            law=tables[BACKLASH],
            shape=_as_it_is,
        ),
        DriveLaw(
            name=KNEE,
            text="the drive softens before it slips",
            extra=(knee,),
            least={"knee": LEAST_KNEE},
            scatter={},
            law=tables[KNEE],
            shape=_as_it_is,
        ),
        DriveLaw(
            name=BOTH,
            text="the clutch is worn and the force follows with a delay",
            extra=(lag,),
            least={"lag": LEAST_LAG},
            scatter=worn,
            shape=soft,
        ),
    )


def is_slight(law: DriveLaw, values: Mapping[str, float]) -> bool:
    """Return whether all that a law adds to the plain one is too little to matter.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> soft = drive_laws(load_panel("sb1"), "2")[2]
    >>> is_slight(soft, {"lag": 0.001}), is_slight(soft, {"lag": 0.1})
    (True, False)
    """
    return bool(law.least) and all(values[name] < size for name, size in law.least.items())


def _as_it_is(response: Response, _values: Mapping[str, float]) -> Response:
    """Return a response unchanged: the law is in the panel."""
    return response


def table(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    backlash: float = 0.0,
    knee: float = 0.0,
    knee_stiffness: float = KNEE_STIFFNESS,
) -> dict[str, object]:
    """Return the elastic law of a drive as overrides: a table of extension and force.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive in the panel, such as "2".
    values : mapping of str to float
        By key of the panel, in SI.
    backlash : float
        Travel without force between push and pull [m].
    knee : float
        Share of the slip level over which the bushing is softer [-].
    knee_stiffness : float
        Its stiffness there, as a share of the one before [-].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> made = table(load_panel("sb1"), "2", {}, backlash=0.002)
    >>> [round(1e3 * x, 2) for x in made["drive.2.extension"]][3:5]
    [1.0, 8.41]
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    soft = (1.0 - knee) * level
    half = [(0.5 * backlash, 0.0)] if backlash > 0 else []
    start = 0.5 * backlash + soft / stiffness
    half.append((start, soft))
    end = start
    if knee > 0:
        end = start + (level - soft) / (knee_stiffness * stiffness)
        half.append((end, level))
    half.append(
        (REACH, level + panel.drive[drive].saturated_stiffness * (REACH - end) + PLAY_FORCE)
    )
    if backlash > 0:
        half[0] = (half[0][0], PLAY_FORCE)
    return symmetric_law(drive, half)


def symmetric_law(drive: str, half: Sequence[tuple[float, float]]) -> dict[str, object]:
    """Return overrides for a law through points [m], [N] in tension, alike in compression."""
    extension = [*(-x for x, _ in reversed(half)), *(x for x, _ in half)]
    force = [*(-f for _, f in reversed(half)), *(f for _, f in half)]
    return {f"drive.{drive}.extension": extension, f"drive.{drive}.force": force}


def lagged(response: Response, drive: str, *, lag: float) -> Response:
    r"""Return a response in which a drive's force follows with a lag once an object is touched.

    .. math:: \dot F_m = (F - F_m) / \tau

    Parameters
    ----------
    response : Response
        As simulated, on even times.
    drive : str
        Whose force lags.
    lag : float
        Time constant [s].

    Returns
    -------
    Response
        The same one where nothing is touched, or without a lag.
    """
    if lag <= 0 or response.failure or not np.isfinite(response.contact_time):
        return response
    from scipy.signal import lfilter  # loads slowly, and few fits try a lag

    start = int(np.searchsorted(response.time, response.contact_time))
    if start >= response.time.size - 1:
        return response
    force = response.drive_force[drive].copy()
    step = float(response.time[1] - response.time[0])
    kept = float(np.exp(-step / lag))
    begin = force[max(start - 1, 0)]
    force[start:], _ = lfilter([1.0 - kept], [1.0, -kept], force[start:], zi=[kept * begin])
    return replace(response, drive_force={**response.drive_force, drive: force})
