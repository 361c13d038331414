"""Throws of objects that break, or nearly do, beside others in which they break sooner or later.

Where an object fails on the peak of a blow, its verdict rests on how well the steps resolve it. A
throw of mode quick is then made in mode waveform too, any other with strengths that are lower and
higher by as much as the peak may be off. Where lock, control, slip or what is trapped differ, the
verdict depends on how it breaks.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from turnout.core.channels import DEPENDS
from turnout.core.scheme import Scheme
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_laws import compression_of, named_obstructions, strength_of
from turnout.panel.foreign_object import PlacedObject
from turnout.solver.integration import History
from turnout.throw.save import Save

if TYPE_CHECKING:
    import xarray as xr

PEAK_ERROR, COARSE_PEAK_ERROR = 0.05, 0.25
"""Largest error of the peak force of a blow: in mode waveform, and in one of longer steps or a
lower cut-off [-]."""
CLOSE = 0.3e-3
"""End gaps that differ by less are alike [m]."""
COMPARED = Save(
    fields=(
        *("locked", "in_control", "drive_slipping", "sensor_gap"),
        *("object_left", "object_broken", "contact_time", "object_contact_time"),
    )
)
BREAKING = ("stone", "ice")
"""Kinds of objects that break."""
Throw = Callable[[tuple[PlacedObject, ...], Scheme], "tuple[xr.Dataset, bool]"]


def is_coarse(scheme: Scheme) -> bool:
    """Return whether mode waveform resolves more of a blow."""
    fine = Scheme()
    coarser = scheme.step > fine.step or scheme.cutoff_frequency < fine.cutoff_frequency
    return coarser or not scheme.inertia


def peak_error(scheme: Scheme) -> float:
    """Return the largest error of the peak force of a blow in a scheme [-]."""
    return COARSE_PEAK_ERROR if is_coarse(scheme) else PEAK_ERROR


def break_attributes(
    objects: tuple[PlacedObject, ...],
    solved: tuple[Mechanism, History],
    base: "Callable[[], xr.Dataset]",
    scheme: Scheme,
    throw: Throw,
) -> dict[str, str]:
    """Return what a dataset says of breaks: `break_check`, and `break_note` if breaking decides.

    Parameters
    ----------
    objects : sequence of PlacedObject
        Of the throw.
    solved : tuple of Mechanism and History
        The throw.
    base : callable
        Makes its dataset with the channels of `COMPARED`.
    scheme : Scheme
        Its numerical choices.
    throw : callable
        Makes such a dataset for other objects and another scheme, and says whether it is complete.
    """
    mechanism, history = solved
    broke, near = _closeness(mechanism, history, objects, peak_error(scheme))
    if not history.outcome.complete or not (broke or near):
        return {}
    found = [_end_of(base())]
    for varied, other in _variants(objects, scheme, broke=broke):
        dataset, complete = throw(varied, other)
        if complete:
            found.append(_end_of(dataset))
    how = "in mode waveform" if is_coarse(scheme) else f"with {100 * PEAK_ERROR:g} % of strength"
    if all(end.state == found[0].state for end in found):
        return {"break_check": f"alike {how}"}
    return {"break_check": f"differs {how}", "break_note": _note(found, how)}


def _closeness(
    mechanism: Mechanism, history: History, objects: Sequence[PlacedObject], error: float
) -> tuple[bool, bool]:
    """Return whether an object broke, and whether one nearly did."""
    obstructions = history.obstructions
    rows = named_obstructions(obstructions, mechanism.index.object)
    broke = near = False
    for item in objects:
        for name in mechanism.index.object_parts.get(item.name, ()):
            row = rows.get(name, -1)
            if row < 0 or item.kind not in BREAKING:
                continue
            broke |= bool(obstructions.broken[row] > 0)
            reach = compression_of(item).breakpoints[1:2] * (1.0 - error)
            deepest = obstructions.deepest[row]
            near |= bool(deepest > 0.0 and (item.kind == "ice" or np.all(deepest > reach)))
    return broke, near


def _variants(
    objects: tuple[PlacedObject, ...], scheme: Scheme, *, broke: bool
) -> Iterator[tuple[tuple[PlacedObject, ...], Scheme]]:
    """Yield objects and schemes of the throws to compare with."""
    if is_coarse(scheme):
        yield objects, Scheme()
        return
    for factor in (1.0 - PEAK_ERROR, 1.0 + PEAK_ERROR) if broke else (1.0 - PEAK_ERROR,):
        yield (
            tuple(replace(item, strength=factor * strength_of(item)) for item in objects),
            scheme,
        )


@dataclass(frozen=True, slots=True)
class _End:
    """What a verdict rests on, end gaps of the sensors by name [m], and how often objects broke."""

    state: tuple[bool, ...]
    gaps: dict[str, float]
    broken: int


def _end_of(dataset: "xr.Dataset") -> _End:
    """Return how a throw ended."""
    contact = dataset.get("object_contact_time", dataset["contact_time"]).values
    touched = ~np.isnan(contact)
    trapped = bool(np.any(touched & ~(dataset["object_left"].values <= 0.0)))
    state = [trapped, bool(dataset["drive_slipping"].any()), bool(dataset["locked"].values[-1])]
    gaps: dict[str, float] = {}
    if "sensor_gap" in dataset:
        state += dataset["in_control"].transpose(..., "time").values[..., -1].tolist()
        last = dataset["sensor_gap"].transpose(..., "time").values[..., -1]
        gaps = dict(zip(dataset["sensor"].values.tolist(), last.tolist(), strict=True))
    return _End(tuple(state), gaps, int(dataset["object_broken"].sum()))


def _note(found: list[_End], how: str) -> str:
    """Return how the throws differ, in a sentence without its full stop."""
    least, most = min(end.broken for end in found), max(end.broken for end in found)
    breaks = f"{least} to {most} breaks" if most > least else f"{most} breaks"
    parts = [breaks.replace("1 breaks", "1 break") if most == 1 and least == most else breaks]
    for name in found[0].gaps:
        gaps = [end.gaps[name] for end in found]
        if max(gaps) - min(gaps) > CLOSE:
            parts.append(f"{name} {1e3 * min(gaps):.1f} to {1e3 * max(gaps):.1f} mm")
    return f"{DEPENDS[:1].upper()}{DEPENDS[1:]}: {how} {', '.join(parts)}"
