"""Causes that a model may not follow a measurement: parameters that a panel does not have."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.bushing_laws import (
    SOFTNESS,
    SOFTNESS_SPREAD,
    TABLE_ENDS,
    TABLE_SPREAD,
    bushing_table,
    soft_bushing,
    stiffness_beyond,
)
from turnout.calibration.cause import Cause
from turnout.calibration.drive_law.candidates import (
    KNEE_STIFFNESS,
    LEAST_KNEE,
    LEAST_LAG,
    LEAST_PLAY,
    lagged,
    level_key,
    stiffness_key,
    table,
)
from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.objects import PLACE, THICKNESS, own_places, own_thicknesses
from turnout.calibration.parameter import Fitted, Parameter, free_parameter
from turnout.calibration.stages import MILLIMETRE, known_to
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
# Soft travels that are tried [m].
SOFT_TRAVELS = (0.5e-3, 1e-3, 2e-3, 3.5e-3)
LEVEL_SCATTER = 0.05
# Low-passes of a recorder that are tried, and the time below which there is none [s].
RECORDER_FILTERS = ((BUTTERWORTH, 2), (RC, 1), (BESSEL, 4), (BUTTERWORTH, 4))
LEAST_DELAY = 1e-5
# Of an over-travel that differs [m].
LEAST_OVER_TRAVEL = 5e-5
LEAST_SECTIONS = 0.005  # a modulus that is off by less takes up what is another cause's [-]
# Groups of neighbouring chairs at most, and how far the friction of one is expected from the mean
# of all, as a share of that [-].
CHAIR_GROUPS, CHAIR_SPREAD = 5, 0.25


def candidate_causes(
    panel: LoadedPanel,
    parameters: Sequence[Parameter | Fitted],
    movements: Sequence[MeasuredMovement] = (),
) -> tuple[Cause, ...]:
    """Return the causes that are tested, the cheap ones first; of objects, those of movements."""
    known = {item.name for item in parameters}
    found = [*_recorders(), *_bushings(panel), *_tables(panel), *_clutches(panel, known)]
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


def _linear(name: str, upper: float, unit: str, *, lower: float = 0.0) -> Parameter:
    return Parameter(
        name=name, keys=(), start=0.0, lower=lower, upper=upper, unit=unit, transform="linear"
    )


def _recorders() -> list[Cause]:
    """Return what a recorder may do to forces, each with its delay as size."""
    average = _recorder_cause(
        "recorder.average",
        lambda size: Recorder(average=size),
        lambda made: (
            f"averages over {made.average:.3g} s; state it in the channel map as "
            f'recorded_average = "{made.average:.3g} s"'
        ),
        tries=(0.03, 0.1, 0.25),
        least=5e-3,
    )
    filters = [
        _recorder_cause(
            f"recorder.{kind}" if number < 2 else f"recorder.{kind}.{order}",
            lambda size, kind=kind, order=order: Recorder(  # type: ignore[misc]
                low_pass=LowPass(kind=kind, order=order, corner=1.0 / (2.0 * np.pi * size))
            ),
            lambda made: (
                f"filters with {made.text}; state it in the channel map as "
                f"recorded_filter = {made.low_pass.text if made.low_pass else ''}"
            ),
            tries=(0.01, 0.035, 0.1),
            least=2e-3,
        )
        for number, (kind, order) in enumerate(RECORDER_FILTERS)
    ]
    sampling = _recorder_cause(
        "recorder.interval",
        lambda size: Recorder(rate=1.0 / size),
        lambda made: (
            f"takes {made.rate:.3g} samples a second, and the file holds lines between them; state "
            f'it in the channel map as recorded_rate = "{made.rate:.3g} Hz"'
        ),
        tries=(0.03, 0.06, 0.15),
        least=0.015,
    )
    return [average, *filters, sampling]


def _recorder_cause(
    key: str,
    made: Callable[[float], Recorder],
    text: Callable[[Recorder], str],
    *,
    tries: tuple[float, ...],
    least: float,
) -> Cause:
    def shape(response: Response, values: Mapping[str, float]) -> Response:
        if response.failure or values[key] <= LEAST_DELAY:
            return response
        kept = made(values[key])
        return replace(
            response,
            drive_force={
                name: kept.applied(response.time, row) for name, row in response.drive_force.items()
            },
            object_force=kept.applied(response.time, response.object_force),
        )

    return Cause(
        name="recorder filter",
        text=lambda sizes: f"the recorder {text(made(max(sizes[0], LEAST_DELAY)))}",
        parameters=(_linear(key, 0.5, "s"),),
        tries=tries,
        least=least,
        group="recorder",
        refined=True,
        shape=shape,
    )


def _bushings(panel: LoadedPanel) -> list[Cause]:
    groups: dict[str, tuple[str, ...]] = {
        f"drive.{name}.soft_travel": (name,) for name in panel.drive
    }
    if len(panel.drive) > 1:
        groups["drive.soft_travel"] = tuple(panel.drive)
    found = []
    for key, drives in groups.items():
        which = f"drive {drives[0]}" if len(drives) == 1 else "all drives"

        def law(
            values: Mapping[str, float], key: str = key, drives: tuple[str, ...] = drives
        ) -> dict[str, object]:
            made: dict[str, object] = {}
            for drive in drives:
                made |= soft_bushing(
                    panel, drive, values, travel=values[key], softness=values[f"{key}.softness"]
                )
            return made

        def beside(
            values: Mapping[str, float], sizes: Sequence[float], drives: tuple[str, ...] = drives
        ) -> dict[str, float]:
            return {
                stiffness_key(drive): stiffness_beyond(panel, drive, values, travel=sizes[0])
                for drive in drives
                if stiffness_key(drive) in values
            }

        found.append(
            Cause(
                name="bushing shape",
                text=lambda sizes, which=which: (  # type: ignore[misc]
                    f"the bushing of {which} has {100 * np.exp(-sizes[1]):.0f} % of its stiffness "
                    f"over its first {1e3 * sizes[0]:.2g} mm"
                ),
                parameters=(_linear(key, 0.01, "m"), _softness(f"{key}.softness")),
                tries=SOFT_TRAVELS,
                least=1e-4,
                group=_first_travel(drives),
                drives=drives,
                beside=beside,
                law=law,
            )
        )
    return found


def _first_travel(drives: Sequence[str]) -> str:
    """Return the group of what a drive does over its first travel: soft, or play."""
    return f"first travel of {drives[0]}" if len(drives) == 1 else ""


def _softness(key: str) -> Parameter:
    return Parameter(
        name=key,
        keys=(),
        start=SOFTNESS,
        lower=-1.0,
        upper=4.0,
        unit="1",
        transform="linear",
        prior=SOFTNESS_SPREAD,
    )


def _tables(panel: LoadedPanel) -> list[Cause]:
    """Return bushings whose first millimetres have stiffnesses of their own, as tables."""
    found = []
    for drive in panel.drive:
        keys = tuple(f"drive.{drive}.softness.{number}" for number, _ in enumerate(TABLE_ENDS, 1))

        def law(
            values: Mapping[str, float], drive: str = drive, keys: tuple[str, ...] = keys
        ) -> dict[str, object]:
            return bushing_table(panel, drive, values, softness=[values[key] for key in keys])

        def text(sizes: Sequence[float], drive: str = drive) -> str:
            shares = ", ".join(f"{100 * np.exp(-size):.0f}" for size in sizes)
            ends = ", ".join(f"{1e3 * end:g}" for end in TABLE_ENDS)
            return f"the bushing of drive {drive} has {shares} % of its stiffness up to {ends} mm"

        parameters = [_linear(key, 3.0, "1", lower=-3.0) for key in keys]
        found.append(
            Cause(
                name="bushing shape",
                text=text,
                parameters=tuple(replace(item, prior=TABLE_SPREAD) for item in parameters),
                tries=(0.2,) * len(keys),
                smooth=True,
                least=0.1,
                drives=(drive,),
                law=law,
            )
        )
    return found


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

    def beside(values: Mapping[str, float], sizes: Sequence[float]) -> dict[str, float]:
        if stiffness_key(drive) not in values:
            return {}
        # The bushing is stretched by half of the play less.
        beyond = stiffness_beyond(
            panel, drive, values, travel=0.5 * sizes[0], softness=float("inf")
        )
        return {stiffness_key(drive): beyond}

    softened = replace(
        _softness(f"{knee}.softness"), start=-float(np.log(KNEE_STIFFNESS)), lower=0.0
    )
    return [
        Cause(
            name="drive law",
            text=lambda sizes: (
                f"drive {drive} has {1e3 * sizes[0]:.2g} mm of play between pull and push"
            ),
            parameters=(_linear(play, 0.03, "m"),),
            tries=(0.5e-3, 2e-3, 4e-3),
            least=LEAST_PLAY,
            group=_first_travel((drive,)),
            drives=(drive,),
            beside=beside,
            law=lambda values: table(panel, drive, values, backlash=values[play]),
        ),
        Cause(
            name="drive law",
            text=lambda sizes: (
                f"the bushing of drive {drive} softens to {100 * np.exp(-sizes[1]):.0f} % over the "
                f"last {100 * sizes[0]:.0f} % of force before it slips"
            ),
            parameters=(_linear(knee, 0.8, "1"), softened),
            tries=(0.15, 0.4),
            least=LEAST_KNEE,
            drives=(drive,),
            law=lambda values: table(
                panel,
                drive,
                values,
                knee=values[knee],
                knee_stiffness=float(np.exp(-values[f"{knee}.softness"])),
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
        own = {name: values[key] for key, names in zip(keys, groups, strict=True) for name in names}
        mean = float(np.mean(list(own.values())))
        return {name: max(1.0 + share - mean, 0.0) for name, share in own.items()}

    def law(values: Mapping[str, float]) -> dict[str, object]:
        return {
            f"chair.{name}.friction_coefficient": float(values[FRICTION] * share)
            for name, share in shares(values).items()
        }

    def text(sizes: Sequence[float]) -> str:
        known = shares(dict(zip(keys, sizes, strict=True)))
        parts = [f"{round(100 * (known[names[0]] - 1.0)):+d}" for names in groups]
        return f"friction differs by {', '.join(parts)} % of its mean from toe to heel"

    spread = [replace(_linear(key, 0.9, "1", lower=-0.9), prior=CHAIR_SPREAD) for key in keys]
    found = [
        Cause(
            name="friction by chair",
            text=text,
            parameters=tuple(spread),
            tries=(0.1,) * count,
            smooth=True,
            least=0.05,
            about_mean=True,
            law=law,
        )
    ]
    return found if count > 1 else []
