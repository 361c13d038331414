"""Causes that a model may not follow a measurement: parameters that a panel does not have."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.drive_law.candidates import REACH, Law, Shape, level_key, stiffness_key
from turnout.calibration.evaluate import Response
from turnout.calibration.parameter import Parameter, free_parameter
from turnout.calibration.trailing_mean import trailing_mean
from turnout.errors import PanelError
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
FRICTION, MODULUS = "chair.friction_coefficient", "material.youngs_modulus"
# Share of its stiffness that a bushing has at first [-].
SOFT_SHARE = 0.25
LEVEL_SCATTER = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cause:
    """One thing that may differ between model and measurement.

    Attributes
    ----------
    name : str
        What it is called, such as "recorder filter".
    text : callable
        From its size to a sentence.
    parameter : Parameter or None
        Its size; None where each movement has its own.
    tries : tuple of float
        Sizes that are tried, in the unit of the parameter.
    smooth : bool
        Whether forces change in proportion to it: then one size is tried, and the likeliest
        follows with those of all values.
    law, shape : callable or None
        As of `Misfit`.
    scatter : mapping of str to float
        Parameters that scatter from movement to movement, as shares.
    """

    name: str
    text: Callable[[float], str]
    parameter: Parameter | None = None
    tries: tuple[float, ...] = ()
    smooth: bool = False
    law: Law | None = None
    shape: Shape | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)


def candidate_causes(panel: LoadedPanel, parameters: Sequence[Parameter]) -> tuple[Cause, ...]:
    """Return the causes that are tested, the cheap ones first."""
    known = {item.name for item in parameters}
    found = [_recorder(), *_bushings(panel), *_clutches(panel, known)]
    if MODULUS not in known:
        found += _sections(panel)
    if FRICTION in known and len(panel.chair) > 2:
        found += _friction_by_chair(panel)
    return tuple(found)


def _linear(name: str, upper: float, unit: str, *, lower: float = 0.0) -> Parameter:
    return Parameter(
        name=name, keys=(), start=max(0.0, lower), lower=lower, upper=upper, unit=unit,
        transform="linear",
    )  # fmt: skip


def _recorder() -> Cause:
    return Cause(
        name="recorder filter",
        text=lambda size: (
            f"the recorder averages over {size:.3g} s; state it in the channel map as "
            f'recorded_average = "{size:.3g} s"'
        ),
        parameter=_linear("recorder.average", 0.5, "s"),
        tries=(0.03, 0.1, 0.25),
        shape=lambda response, values: _recorded(response, values["recorder.average"]),
    )


def _recorded(response: Response, average: float) -> Response:
    """Return a response as a recorder keeps it that averages over the time before each sample."""

    def past(values: Floats) -> Floats:
        return trailing_mean(response.time, values, average)

    if response.failure:
        return response
    forces = {name: past(row) for name, row in response.drive_force.items()}
    return replace(response, drive_force=forces, object_force=past(response.object_force))


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
                made |= soft_bushing(panel, drive, values, travel=values[key])
            return made

        found.append(
            Cause(
                name="bushing shape",
                text=lambda size, which=which: (  # type: ignore[misc]
                    f"the bushing of {which} is soft over its first {1e3 * size:.2g} mm"
                ),
                parameter=_linear(key, 0.01, "m"),
                tries=(0.5e-3, 1.5e-3, 3e-3),
                law=law,
            )
        )
    return found


def soft_bushing(
    panel: LoadedPanel, drive: str, values: Mapping[str, float], *, travel: float
) -> dict[str, object]:
    """Return a bushing with a quarter of its stiffness over its first travel, as overrides.

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
    """
    if travel < 1e-6:
        return {}
    record = panel.drive[drive]
    stiffness = values.get(stiffness_key(drive), record.stiffness)
    level = values.get(level_key(drive), record.saturation_force)
    first = min(SOFT_SHARE * stiffness * travel, 0.9 * level)
    knee = travel + (level - first) / stiffness
    last = level + record.saturated_stiffness * (REACH - knee) + 1.0
    half = ((travel, first), (knee, level), (REACH, last))
    extension = [*(-x for x, _ in reversed(half)), *(x for x, _ in half)]
    force = [*(-f for _, f in reversed(half)), *(f for _, f in half)]
    return {f"drive.{drive}.extension": extension, f"drive.{drive}.force": force}


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
            text=lambda size: (
                f"the rails are {100 * abs(size / modulus.start - 1.0):.2g} % "
                f"{'stiffer' if size > modulus.start else 'softer'} than in the panel"
            ),
            parameter=modulus,
            tries=(1.05 * modulus.start,),
            smooth=True,
        )
    ]


def _friction_by_chair(panel: LoadedPanel) -> list[Cause]:
    """Return friction that rises towards the heel, and friction that is higher at both ends."""
    places = np.array([chair.x for chair in panel.chair.values()])
    xi = 2.0 * (places - places.min()) / max(float(np.ptp(places)), 1e-9) - 1.0
    shapes = {
        "friction.gradient": (xi, "from the toe to the heel", 2.0),
        "friction.bow": (1.5 * xi**2 - 0.5, "from the middle to the ends", 1.5),
    }
    found = []
    for key, (shape, way, span) in shapes.items():
        shape = shape - shape.mean()

        def law(
            values: Mapping[str, float], key: str = key, shape: Floats = shape
        ) -> dict[str, object]:
            shares = np.maximum(1.0 + values[key] * shape, 0.0)
            # Causes along the switch add up.
            for other, (rest, *_) in shapes.items():
                if other != key and other in values:
                    shares = np.maximum(shares + values[other] * (rest - rest.mean()), 0.0)
            return {
                f"chair.{name}.friction_coefficient": float(values[FRICTION] * share)
                for name, share in zip(panel.chair, shares, strict=True)
            }

        found.append(
            Cause(
                name="friction by chair",
                text=lambda size, way=way, span=span: (  # type: ignore[misc]
                    f"friction {'rises' if size > 0 else 'falls'} by "
                    f"{100 * span * abs(size):.2g} % of its mean {way}"
                ),
                parameter=_linear(key, 0.9, "1", lower=-0.9),
                tries=(0.1,),
                smooth=True,
                law=law,
            )
        )
    return found
