"""Causes that a model may not follow a measurement: parameters that a panel does not have.

Laws of drives are among them: bushings that are soft at first or before they slip, and lags.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.shared import CROSS_TALK
from turnout.calibration.stages import (
    MILLIMETRE,
    PLACE,
    THICKNESS,
    Fitted,
    Parameter,
    free_parameter,
    known_to,
    own_places,
    own_thicknesses,
)
from turnout.core.errors import PanelError
from turnout.measurement.chain.recorder import (
    BESSEL,
    BUTTERWORTH,
    RC,
    LowPass,
    Recorder,
)
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
FRICTION, MODULUS = "chair.friction_coefficient", "material.youngs_modulus"
# What names of friction of a group of chairs begin with.
GROUP = "friction.group."
# Less than this is as good as nothing [s], [m], [-]: two solvers differ by as much force.
LEAST_LAG, LEAST_PLAY, LEAST_KNEE = 5e-3, 5e-5, 0.02
# Soft travels that are tried [m].
SOFT_TRAVELS = (0.5e-3, 1e-3, 2e-3, 3.5e-3)
# Of a slip level from throw to throw where a clutch is worn [-].
LEVEL_SCATTER = 0.05
# Low-passes of a recorder that are tried, and the time below which there is none [s].
RECORDER_FILTERS = ((BUTTERWORTH, 2), (RC, 1), (BESSEL, 4), (BUTTERWORTH, 4))
LEAST_DELAY = 1e-5
# Interval between samples of a recorder of which only a filter or a mean is looked for: usual,
# longest, and below which it is not said [s].
USUAL_INTERVAL, LONGEST_INTERVAL, LEAST_LINES = 0.03, 0.1, 0.015
# Of an over-travel that differs [m].
LEAST_OVER_TRAVEL = 5e-5
# What names of cross-talk begin with: in the gauges of a drive, of another.
TALK = "cross_talk."
# Of cross-talk, how much is expected where there is any, and what is none [-].
TALK_SPREAD, LEAST_TALK = 0.02, 2e-3
LEAST_SECTIONS = 0.005  # a modulus that is off by less takes up what is another cause's [-]
# Groups of neighbouring chairs at most, and how far the friction of one is expected from the mean
# of all, as a share of that [-].
CHAIR_GROUPS, CHAIR_SPREAD = 5, 0.25
# Group of bushings that are soft over their first travel, and of play: of any drive, and of all.
FIRST_TRAVEL = "first travel"
# Causes of which several may be, such as one a drive.
SEVERAL = ("bushing shape", "clutch", "drive law", "objects")
Beside = Callable[[Mapping[str, float], Sequence[float]], dict[str, float]]
Law = Callable[[Mapping[str, float]], dict[str, object]]
Shape = Callable[[Response, Mapping[str, float]], Response]


# A table must reach as far as any bushing is stretched [m], and rise even within play [N].
REACH, PLAY_FORCE = 1.0, 1.0
# How much softer a bushing is at first, as a logarithm [-], and how far that is expected from this;
# the share of the slip level at which its stretch stays the same, and how far at most its stiffness
# rises for that, as a factor [-].
SOFTNESS, SOFTNESS_SPREAD, SECANT, STIFFEST = 1.4, 0.7, 0.6, 3.0
# A bushing as a table: where its spans end [m], how far the logarithm of the stiffness in one is
# expected from that beyond, and up to which share of the slip level a span may reach [-].
TABLE_ENDS, TABLE_SPREAD, LAST_SPAN = (0.5e-3, 1e-3, 2e-3, 4e-3), 0.7, 0.95


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


def bushing(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    first: Sequence[tuple[float, float]] = (),
    softness: float = 0.0,
    knee: float = 0.0,
    knee_softness: float = 0.0,
) -> dict[str, object]:
    r"""Return the elastic law of a drive as overrides: a table of extension and force.

    Alike in tension and compression: through the first points, then with :math:`k e^{-s}`, over the
    last share of the slip level with :math:`e^{-s'}` of that, and beyond it as the panel slips.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive in the panel, such as "2".
    values : mapping of str to float
        By key of the panel, in SI.
    first : sequence of (float, float)
        Points in tension, below the slip level [m], [N].
    softness, knee_softness : float
        :math:`s` and :math:`s'` [-].
    knee : float
        Share of the slip level over which the bushing is softer [-].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> made = bushing(load_panel("sb1"), "2", {}, first=[(0.001, PLAY_FORCE)])
    >>> [round(1e3 * x, 2) for x in made["drive.2.extension"]][3:5]
    [1.0, 8.41]
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    half = list(first)
    x, force = half[-1] if half else (0.0, 0.0)
    k = stiffness * float(np.exp(-softness))
    if knee > 0.0:
        soft = (1.0 - knee) * level
        if soft > force:
            x, force = x + (soft - force) / k, soft
            half.append((x, force))
        k *= float(np.exp(-knee_softness))
    x += (level - force) / k
    last = level + panel.drive[drive].saturated_stiffness * (REACH - x) + PLAY_FORCE
    half += [(x, level), (REACH, last)]
    both = [*((-x, -f) for x, f in reversed(half)), *half]
    return {
        f"drive.{drive}.extension": [x for x, _ in both],
        f"drive.{drive}.force": [f for _, f in both],
    }


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


def stiffness_beyond(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    travel: float,
    softness: float = SOFTNESS,
) -> float:
    r"""Return the stiffness beyond a soft travel that leaves the stretch as it is.

    .. math:: \frac{F}{k} = x + \frac{F - s k' x}{k'}, \quad s = e^{-\text{softness}}

    at a share of the slip level as force `F`; an infinite softness is play.
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    before = SECANT * level / stiffness
    left = before - (1.0 - float(np.exp(-softness))) * travel
    return stiffness * min(before / max(left, before / STIFFEST), STIFFEST)


def soft_bushing(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    travel: float,
    softness: float = SOFTNESS,
) -> dict[str, object]:
    """Return a bushing with a part of its stiffness over its first travel, as overrides.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive.
    values : mapping of str to float
        By key of the panel, in SI.
    travel : float
        To either side [m].
    softness : float
        Logarithm of how much softer it is there [-].
    """
    if travel < 1e-6:
        return {}
    stiffness, level = stiffness_and_level(panel, drive, values)
    first = min(float(np.exp(-softness)) * stiffness * travel, 0.9 * level)
    return bushing(panel, drive, values, first=[(travel, first)])


def bushing_table(
    panel: LoadedPanel, drive: str, values: Mapping[str, float], *, softness: Sequence[float]
) -> dict[str, object]:
    r"""Return a bushing with another stiffness in each of its first spans, as overrides.

    .. math:: k_i = k e^{-s_i} \text{ up to } x_i, \quad k \text{ beyond}

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive.
    values : mapping of str to float
        By key of the panel, in SI.
    softness : sequence of float
        :math:`s_i` of the spans that end at `TABLE_ENDS` [-].
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    half: list[tuple[float, float]] = []
    x = force = 0.0
    for end, soft in zip(TABLE_ENDS, softness, strict=True):
        k = stiffness * float(np.exp(-soft))
        if force + k * (end - x) >= LAST_SPAN * level:
            break
        x, force = end, force + k * (end - x)
        half.append((x, force))
    beyond = softness[len(half)] if len(half) < len(softness) else 0.0
    return bushing(panel, drive, values, first=half, softness=beyond)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cause:
    """One thing that may differ between model and measurement.

    Attributes
    ----------
    name : str
        What it is called, such as "recorder filter".
    text : callable
        From its sizes to a sentence.
    parameters : tuple of Parameter
        Its size, or several with priors that describe it together; none where each movement has
        its own.
    tries : tuple of float
        Sizes that are tried: of a smooth cause one of each parameter, each alone; else of its first
        parameter, the others at their start.
    group : str
        Of causes much alike in what they do to forces: a fit with each decides between them.
    doubted : callable
        Whether its sizes are those that another one of its group may make up for.
    refined : bool
        Whether the likeliest size is searched between those that are tried: where that needs no
        throws, so that causes alike in effect are compared at their best.
    smooth : bool
        Whether forces change in proportion to it: then one size is tried, and the likeliest
        follows with those of all values.
    least : float
        What is smaller is none: a fit that lacks another cause finds some of every one [as sizes].
    drives : tuple of str
        Drives whose law it changes; another cause that changes one of them too is not taken up.
    beside : callable, optional
        From values and sizes to the values that keep forces much as they are with the cause: where
        a trial, and a fit with it, begin.
    law, shape : callable or None
        As of `Misfit`.
    scatter : mapping of str to float
        Parameters that scatter from movement to movement, as shares.
    """

    name: str
    text: Callable[[Sequence[float]], str]
    parameters: tuple[Parameter, ...] = ()
    tries: tuple[float, ...] = ()
    group: str = ""
    doubted: Callable[[Sequence[float]], bool] = lambda _: False
    refined: bool = False
    smooth: bool = False
    least: float = 0.0
    drives: tuple[str, ...] = ()
    beside: Beside | None = None
    law: Law | None = None
    shape: Shape | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)

    @property
    def sized(self) -> tuple[Parameter, ...]:
        """Parameters that are its size: all of a smooth one, else the first."""
        return self.parameters if self.smooth else self.parameters[:1]

    def sizes_in(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return its sizes from the values of a fit by name; one of none as at its start."""
        return tuple(values.get(item.name, item.start) for item in self.parameters)

    def is_slight(self, sizes: Sequence[float]) -> bool:
        """Return whether all of its sizes are too small for it to be one."""
        pairs = zip(self.sized, sizes, strict=False)
        away = np.array([size - item.start for item, size in pairs])
        return bool(away.size) and bool(np.all(np.abs(away) < self.least))

    def is_slight_in(self, values: Mapping[str, float]) -> bool:
        """Return whether the values of a fit by name make it too small to be one."""
        return self.is_slight(self.sizes_in(values))

    def goes_with(self, taken: "Cause") -> bool:
        """Return whether it may be taken up beside one that was."""
        if self is taken or set(self.drives) & set(taken.drives):
            return False
        return self.name != taken.name or self.name in SEVERAL


def candidate_causes(
    panel: LoadedPanel,
    parameters: Sequence[Parameter | Fitted],
    movements: Sequence[MeasuredMovement] = (),
) -> tuple[Cause, ...]:
    """Return the causes that are tested, the cheap ones first; of objects, those of movements."""
    known = {item.name for item in parameters}
    tables = [_table(panel, name) for name in panel.drive]
    found = [
        *_recorders(),
        *_cross_talk(panel),
        *_bushings(panel),
        *tables,
        *_clutches(panel, known),
    ]
    found += [law for name in panel.drive for law in (_lag(name), *_drive_tables(panel, name))]
    if MODULUS not in known:
        found += _sections(panel)
    found += _over_travel(panel, known)
    if FRICTION in known and len(panel.chair) > 2:
        found += _friction_by_chair(panel)
    return (*found, *_objects(movements))


def _objects(movements: Sequence[MeasuredMovement]) -> list[Cause]:
    """Return sizes, and places, that differ from the run sheet each by an amount of its own."""
    kinds = (
        ("sizes", own_thicknesses(movements), THICKNESS),
        ("places", own_places(movements), PLACE),
    )
    return [
        Cause(
            name="objects",
            text=lambda _, what=what: f"their {what} differ from the run sheet",  # type: ignore[misc]
            parameters=tuple(own),
            tries=(0.5 * prior,) * len(own),
            smooth=True,
            least=prior,
        )
        for what, own, prior in kinds
        if len(own) > 1
    ]


def _linear(
    name: str,
    upper: float,
    unit: str,
    *,
    lower: float = 0.0,
    start: float = 0.0,
    prior: float = 0.0,
) -> Parameter:
    """Return a size of a cause, which no key of the panel has."""
    return Parameter(
        name=name,
        keys=(),
        start=start,
        lower=lower,
        upper=upper,
        unit=unit,
        transform="linear",
        prior=prior,
    )


def _recorders() -> list[Cause]:
    """Return filters, means and low rates of recorders, each with its delay as size."""
    average = _recorder_cause(
        "recorder.average", lambda size: Recorder(average=size), tries=(0.03, 0.1, 0.25), least=5e-3
    )
    filters = [
        _recorder_cause(
            f"recorder.{kind}" if number < 2 else f"recorder.{kind}.{order}",
            lambda size, kind=kind, order=order: Recorder(  # type: ignore[misc]
                low_pass=LowPass(kind=kind, order=order, corner=1.0 / (2.0 * np.pi * size))
            ),
            tries=(0.01, 0.035, 0.1),
            least=2e-3,
        )
        for number, (kind, order) in enumerate(RECORDER_FILTERS)
    ]
    sampling = _recorder_cause(
        "recorder.interval",
        lambda size: Recorder(rate=1.0 / size),
        tries=(0.03, 0.06, 0.15),
        least=LEAST_LINES,
    )
    return [average, *filters, sampling]


def _recorder_cause(
    key: str, made: Callable[[float], Recorder], *, tries: tuple[float, ...], least: float
) -> Cause:
    """Return a recorder of one kind, which samples at a rate that is not known either.

    Lines between samples smooth forces by the square of the interval, to first order.
    """
    sampled = bool(made(tries[0]).rate)
    lines = _linear(f"{key}.lines", LONGEST_INTERVAL**2, "s^2", prior=USUAL_INTERVAL**2)

    def recorder(size: float, square: float) -> Recorder:
        kept = made(max(size, LEAST_DELAY))
        return replace(kept, rate=square**-0.5) if square > 0.0 else kept

    def text(sizes: Sequence[float]) -> str:
        square = sum(size for size in sizes[1:] if size > LEAST_LINES**2)
        seen = recorder(sizes[0], square)
        shown = replace(seen, average=_rounded(seen.average), rate=_rounded(seen.rate))
        how = " and ".join(shown.map_lines())
        return f"the recorder has {shown.text}; state it in the channel map as {how}"

    def shape(response: Response, values: Mapping[str, float]) -> Response:
        if response.failure or values[key] <= LEAST_DELAY:
            return response
        # Of calibrations before, the rate was known.
        kept, time = recorder(values[key], values.get(lines.name, 0.0)), response.time
        forces = {name: kept.applied(time, row) for name, row in response.drive_force.items()}
        pressed = kept.applied(time, response.object_force)
        return replace(response, drive_force=forces, object_force=pressed)

    return Cause(
        name="recorder filter",
        text=text,
        parameters=(_linear(key, 0.5, "s"), *(() if sampled else (lines,))),
        tries=tries,
        least=least,
        group="recorder",
        # Lines take up what the shape of one filter or mean lacks for that of another.
        doubted=lambda sizes: sampled or sum(sizes[1:]) > LEAST_LINES**2,
        refined=True,
        shape=shape,
    )


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _cross_talk(panel: LoadedPanel) -> list[Cause]:
    """Return gauges of drives that take up a share of the force of each other drive."""
    pairs = list(permutations(panel.drive, 2))
    keys = [f"{TALK}{drive}.{other}" for drive, other in pairs]

    def shape(response: Response, values: Mapping[str, float]) -> Response:
        if response.failure:
            return response
        alone, forces = response.drive_force, dict(response.drive_force)
        for drive, other in permutations(alone, 2):
            forces[drive] = forces[drive] + values[f"{TALK}{drive}.{other}"] * alone[other]
        return replace(response, drive_force=forces)

    def text(sizes: Sequence[float]) -> str:
        parts = [
            f"{100 * size:.2g} % of the force of drive {other} in the gauges of drive {drive}"
            for (drive, other), size in zip(pairs, sizes, strict=True)
        ]
        return " and ".join(parts)

    found = Cause(
        name=CROSS_TALK,
        text=text,
        parameters=tuple(_linear(k, 0.5, "1", lower=-0.5, prior=TALK_SPREAD) for k in keys),
        tries=(0.01,) * len(pairs),
        smooth=True,
        least=LEAST_TALK,
        shape=shape,
    )
    return [found] if pairs else []


def _stiffer_beyond(
    panel: LoadedPanel,
    drives: Sequence[str],
    values: Mapping[str, float],
    *,
    travel: float,
    softness: float = SOFTNESS,
) -> dict[str, float]:
    """Return the stiffnesses among the values that leave the stretch of soft bushings as it is."""
    return {
        stiffness_key(drive): stiffness_beyond(
            panel, drive, values, travel=travel, softness=softness
        )
        for drive in drives
        if stiffness_key(drive) in values
    }


def _bushings(panel: LoadedPanel) -> list[Cause]:
    """Return bushings that are soft over their first travel: of each drive, and of all alike."""
    groups: list[tuple[str, tuple[str, ...]]] = [
        (f"drive.{name}.soft_travel", (name,)) for name in panel.drive
    ]
    if len(panel.drive) > 1:
        groups.append(("drive.soft_travel", tuple(panel.drive)))
    return [_soft_at_first(panel, key, drives) for key, drives in groups]


def _soft_at_first(panel: LoadedPanel, key: str, drives: tuple[str, ...]) -> Cause:
    which = f"drive {drives[0]}" if len(drives) == 1 else "all drives"
    softness = f"{key}.softness"

    def law(values: Mapping[str, float]) -> dict[str, object]:
        made: dict[str, object] = {}
        for drive in drives:
            made |= soft_bushing(
                panel, drive, values, travel=values[key], softness=values[softness]
            )
        return made

    return Cause(
        name="bushing shape",
        text=lambda sizes: (
            f"the bushing of {which} has {100 * np.exp(-sizes[1]):.0f} % of its stiffness "
            f"over its first {1e3 * sizes[0]:.2g} mm"
        ),
        parameters=(_linear(key, 0.01, "m"), _softness(softness)),
        tries=SOFT_TRAVELS,
        least=1e-4,
        group=FIRST_TRAVEL,
        drives=drives,
        beside=lambda values, sizes: _stiffer_beyond(panel, drives, values, travel=sizes[0]),
        law=law,
    )


def _softness(key: str, *, lower: float = -1.0) -> Parameter:
    return _linear(key, 4.0, "1", lower=lower, start=SOFTNESS, prior=SOFTNESS_SPREAD)


def _table(panel: LoadedPanel, drive: str) -> Cause:
    """Return a bushing whose first millimetres have stiffnesses of their own, as a table."""
    keys = tuple(f"drive.{drive}.softness.{number}" for number, _ in enumerate(TABLE_ENDS, 1))

    def text(sizes: Sequence[float]) -> str:
        shares = ", ".join(f"{100 * np.exp(-size):.0f}" for size in sizes)
        ends = ", ".join(f"{1e3 * end:g}" for end in TABLE_ENDS)
        return f"the bushing of drive {drive} has {shares} % of its stiffness up to {ends} mm"

    return Cause(
        name="bushing shape",
        text=text,
        # Forces are in proportion to the stiffness that each span has.
        parameters=tuple(
            replace(_linear(key, 3.0, "1", lower=-3.0, prior=TABLE_SPREAD), transform="share")
            for key in keys
        ),
        tries=(0.2,) * len(keys),
        smooth=True,
        least=0.1,
        drives=(drive,),
        law=lambda values: bushing_table(
            panel, drive, values, softness=[values[key] for key in keys]
        ),
    )


def _lag(drive: str) -> Cause:
    key = f"drive.{drive}.lag"
    return Cause(
        name="drive law",
        text=lambda sizes: (
            f"the force of drive {drive} follows contact with a lag of {1e3 * sizes[0]:.0f} ms"
        ),
        parameters=(_linear(key, 1.0, "s"),),
        tries=(0.05, 0.2),
        least=LEAST_LAG,
        shape=lambda response, values: lagged(response, drive, lag=values[key]),
    )


def _drive_tables(panel: LoadedPanel, drive: str) -> list[Cause]:
    """Return play before a drive pushes, and a bushing that softens before the drive slips."""
    play, knee = f"drive.{drive}.play", f"drive.{drive}.knee"

    return [
        Cause(
            name="drive law",
            text=lambda sizes: (
                f"drive {drive} has {1e3 * sizes[0]:.2g} mm of play between pull and push"
            ),
            parameters=(_linear(play, 0.03, "m"),),
            tries=(0.5e-3, 2e-3, 4e-3),
            least=LEAST_PLAY,
            group=FIRST_TRAVEL,
            drives=(drive,),
            # The bushing is stretched by half of the play less.
            beside=lambda values, sizes: _stiffer_beyond(
                panel, (drive,), values, travel=0.5 * sizes[0], softness=float("inf")
            ),
            law=lambda values: bushing(
                panel,
                drive,
                values,
                first=[(0.5 * values[play], PLAY_FORCE)] if values[play] > 0.0 else (),
            ),
        ),
        Cause(
            name="drive law",
            text=lambda sizes: (
                f"the bushing of drive {drive} softens to {100 * np.exp(-sizes[1]):.0f} % over the "
                f"last {100 * sizes[0]:.0f} % of force before it slips"
            ),
            parameters=(_linear(knee, 0.8, "1"), _softness(f"{knee}.softness", lower=0.0)),
            tries=(0.15, 0.4),
            least=LEAST_KNEE,
            drives=(drive,),
            law=lambda values: bushing(
                panel,
                drive,
                values,
                knee=values[knee],
                knee_softness=values[f"{knee}.softness"],
            ),
        ),
    ]


def _clutches(panel: LoadedPanel, known: set[str]) -> list[Cause]:
    return [
        Cause(
            name="clutch",
            text=lambda _, name=name: (  # type: ignore[misc]
                f"drive {name} slips at another force in each throw"
            ),
            scatter={level_key(name): LEVEL_SCATTER},
        )
        for name in panel.drive
        if level_key(name) in known
    ]


def _sections(panel: LoadedPanel) -> list[Cause]:
    try:
        modulus = free_parameter(panel, MODULUS)
    except PanelError:
        return []
    modulus = replace(modulus, lower=0.5 * modulus.start, upper=2.0 * modulus.start)
    return [
        Cause(
            name="sections",
            text=lambda sizes: (
                f"the rails are {100 * abs(sizes[0] / modulus.start - 1.0):.2g} % "
                f"{'stiffer' if sizes[0] > modulus.start else 'softer'} than in the panel"
            ),
            parameters=(modulus,),
            tries=(1.05 * modulus.start,),
            smooth=True,
            least=LEAST_SECTIONS * modulus.start,
        )
    ]


def _over_travel(panel: LoadedPanel, known: set[str]) -> list[Cause]:
    """Return drives that go further beyond the open position, or less far, than in the panel.

    The closing one is a parameter of every fit. This one is seen as clearly, but would cost each
    fit slopes of a parameter more for every drive.
    """
    over = {
        name: known_to(f"drive.{name}.over_travel_open", drive.over_travel_open, MILLIMETRE)
        for name, drive in panel.drive.items()
        if drive.over_travel_open != 0.0
    }
    if not over or known & {item.name for item in over.values()}:
        return []

    def text(sizes: Sequence[float]) -> str:
        parts = [
            f"drive {name} goes {1e3 * abs(size - item.start):.2g} mm "
            f"{'further' if size > item.start else 'less far'} beyond the open position"
            for (name, item), size in zip(over.items(), sizes, strict=True)
        ]
        return f"{' and '.join(parts)} than in the panel"

    return [
        Cause(
            name="over-travel",
            text=text,
            parameters=tuple(over.values()),
            # Less of it: more may press the other rail home until the drive slips.
            tries=tuple(item.start - 0.3 * MILLIMETRE for item in over.values()),
            smooth=True,
            least=LEAST_OVER_TRAVEL,
        )
    ]


def _friction_by_chair(panel: LoadedPanel) -> list[Cause]:
    """Return friction that differs between groups of neighbouring chairs, about their mean."""
    chairs = sorted(panel.chair, key=lambda name: panel.chair[name].x)
    count = min(CHAIR_GROUPS, len(chairs) // 2)
    groups = [[str(name) for name in part] for part in np.array_split(np.array(chairs), count)]
    keys = tuple(f"{GROUP}{number}" for number in range(1, count + 1))

    def shares(values: Mapping[str, float]) -> dict[str, float]:
        # Of the last group nothing: only differences count.
        own = {
            name: values.get(key, 0.0)
            for key, names in zip(keys, groups, strict=True)
            for name in names
        }
        mean = float(np.mean(list(own.values())))
        return {name: max(1.0 + share - mean, 0.0) for name, share in own.items()}

    def law(values: Mapping[str, float]) -> dict[str, object]:
        return {
            f"chair.{name}.friction_coefficient": float(values[FRICTION] * share)
            for name, share in shares(values).items()
        }

    def text(sizes: Sequence[float]) -> str:
        known = shares(dict(zip(keys, sizes, strict=False)))
        parts = [f"{round(100 * (known[names[0]] - 1.0)):+d}" for names in groups]
        return f"friction differs by {', '.join(parts)} % of its mean from toe to heel"

    found = Cause(
        name="friction by chair",
        text=text,
        parameters=tuple(_linear(k, 0.9, "1", lower=-0.9, prior=CHAIR_SPREAD) for k in keys[:-1]),
        tries=(0.1,) * (count - 1),
        smooth=True,
        least=0.05,
        law=law,
    )
    return [found] if count > 1 else []
