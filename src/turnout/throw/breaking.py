"""Throws of objects that break, or nearly do, beside others in which they break sooner or later.

Whether an object fails rests on a peak of its force, which steps resolve only so well: the first
failure mostly on a slow one, those of pieces on blows. A throw of mode quick is then made in mode
waveform too, any other with strengths that are lower and higher by as much as the peak may be off.
Where lock, control, slip or what is trapped differ, the verdict depends on how it breaks.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from turnout.core.channels import DEPENDS
from turnout.core.scheme import Scheme
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_laws import named_obstructions
from turnout.panel.foreign_object import PlacedObject
from turnout.solver.integration import History
from turnout.throw.save import Save

if TYPE_CHECKING:
    import xarray as xr

SLOW_ERROR, BLOW_ERROR = 0.005, 0.05
"""Largest errors of the peak of an object's force in mode waveform, without and with a blow [-]."""
COARSE_SLOW_ERROR, COARSE_BLOW_ERROR = 0.01, 0.25
"""The same with longer steps or a lower cut-off [-]."""
SAME_END_GAP = 0.3e-3
"""End gaps that differ by less are alike [m]."""
COMPARED = Save(
    fields=(
        *("locked", "in_control", "drive_slipping", "sensor_gap"),
        *("object_left", "object_broken", "contact_time", "object_contact_time"),
    )
)
Throw = Callable[[tuple[PlacedObject, ...], Scheme], "tuple[xr.Dataset, bool]"]


def is_coarse(scheme: Scheme) -> bool:
    """Return whether mode waveform resolves more of a blow."""
    fine = Scheme()
    coarser = scheme.step > fine.step or scheme.cutoff_frequency < fine.cutoff_frequency
    return coarser or not scheme.inertia


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
    coarse = is_coarse(scheme)
    near = _is_near(mechanism, history, objects, COARSE_BLOW_ERROR if coarse else SLOW_ERROR)
    first = _end_of(base()) if history.outcome.complete else None
    if first is None or not (near or any(first.broken)):
        return {}
    found = [first]
    for varied, other, alike in _variants(objects, scheme, broke=any(first.broken)):
        dataset, complete = throw(varied, other)
        end = _end_of(dataset) if complete else first
        if not alike or np.array_equal(np.sign(end.broken), np.sign(first.broken)):
            found.append(end)
    how = "in mode waveform and " if coarse else ""
    how += "with a little less and more strength"
    if all(end.state == first.state for end in found):
        return {"break_check": f"alike {how}"}
    return {"break_check": f"differs {how}", "break_note": _note(found, how)}


def _is_near(
    mechanism: Mechanism, history: History, objects: Sequence[PlacedObject], error: float
) -> bool:
    """Return whether an object came within an error of its failure [-], or yielded as ice does."""
    obstructions = history.obstructions
    rows = named_obstructions(obstructions, mechanism.index.object)
    for item in objects:
        parts = mechanism.index.object_parts.get(item.name, ())
        for name in parts if item.of_kind.breaks else ():
            deepest = float(obstructions.deepest[rows[name]])
            late = item.of_kind.breaks_late
            reach = 0.0 if late else float(item.of_kind.curve(item).breakpoints[1])
            if deepest > (1.0 - error) * reach:
                return True
    return False


def _variants(
    objects: tuple[PlacedObject, ...], scheme: Scheme, *, broke: bool
) -> Iterator[tuple[tuple[PlacedObject, ...], Scheme, bool]]:
    """Yield objects and schemes to compare with, and whether the same objects must break in them.

    Pieces of stone fail on blows.
    """
    coarse = is_coarse(scheme)
    if coarse:
        yield objects, Scheme(), False
    error = COARSE_SLOW_ERROR if coarse else SLOW_ERROR
    factors = [(1.0 - error, False)] + [(1.0 + error, False)] * broke
    if broke and not coarse and any(item.of_kind.breaks_again for item in objects):
        factors += [(1.0 - BLOW_ERROR, True), (1.0 + BLOW_ERROR, True)]
    for factor, alike in factors:
        varied = tuple(
            replace(item, strength=factor * item.of_kind.strength(item)) for item in objects
        )
        yield varied, scheme, alike


@dataclass(frozen=True, slots=True)
class _End:
    """End of a throw: states of the verdict, gaps of the sensors [m], breaks of each object."""

    state: tuple[bool, ...]
    gaps: dict[str, float]
    broken: tuple[int, ...]


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
    return _End(tuple(state), gaps, tuple(dataset["object_broken"].values.tolist()))


def _note(found: list[_End], how: str) -> str:
    """Return how the throws differ, in a sentence without its full stop."""
    counts = [sum(end.broken) for end in found]
    least, most = min(counts), max(counts)
    span = f"{least} to {most}" if most > least else f"{most}"
    parts = [f"{span} break{'' if span == '1' else 's'}"]
    for name in found[0].gaps:
        gaps = [end.gaps[name] for end in found]
        if max(gaps) - min(gaps) > SAME_END_GAP:
            parts.append(f"{name} {1e3 * min(gaps):.1f} to {1e3 * max(gaps):.1f} mm")
    return f"{DEPENDS[:1].upper()}{DEPENDS[1:]}: {how} {', '.join(parts)}"
