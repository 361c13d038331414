"""Throws of objects that break, or nearly do, beside others in which they break sooner or later.

Whether an object fails rests on a peak of its force, which steps resolve only so well: the first
failure mostly on a slow one, those of pieces on blows. A throw of mode quick is then made in mode
waveform too, any other with strengths that are lower and higher by as much as the peak may be off.
Where their verdicts differ, or another throw does not come to its end, the verdict depends on how
it breaks. Where gaps alone do, they are named.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from turnout.core.channels import DEPENDS
from turnout.core.scheme import Scheme
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_laws import named_obstructions
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.solver.integration import History
from turnout.throw.checks import checks, direction_of
from turnout.throw.save import Save
from turnout.throw.signals import has_broken
from turnout.throw.slip import periods
from turnout.throw.verdict import verdict

SLOW_ERROR, BLOW_ERROR = 0.005, 0.05
"""Largest errors of the peak of an object's force in mode waveform, without and with a blow [-]."""
COARSE_SLOW_ERROR, COARSE_BLOW_ERROR = 0.01, 0.25
"""The same with longer steps or a lower cut-off [-]."""
BLOW_DURATION = 0.05
"""After its first contact, until which a largest force on an object is that of a blow [s]."""
BLOW_SHARE, COARSE_BLOW_SHARE = 4, 22
"""Largest errors found of the peak of a blow, in mode waveform and quick [%]."""
SAME_END_GAP = 0.3e-3
"""End gaps that differ by less are alike [m]."""
WIDEST_RANGE = 2e-3
"""Of the gaps of one outcome that is stated [m]."""
COMPARED = Save(
    fields=(
        *("locked", "in_control", "drive_slipping", "sensor_gap", "drive_gap"),
        *("least_flangeway", "least_gauge"),
        *("object_left", "object_broken", "object_placed", "contact_time", "object_contact_time"),
    )
)
Thrown = tuple[Mechanism, History]
Throw = Callable[[tuple[PlacedObject, ...], Scheme], Thrown]


def is_coarse(scheme: Scheme) -> bool:
    """Return whether mode waveform resolves more of a blow."""
    fine = Scheme()
    coarser = scheme.step > fine.step or scheme.cutoff_frequency < fine.cutoff_frequency
    return coarser or not scheme.inertia


def peak_attributes(thrown: Thrown, scheme: Scheme) -> dict[str, str]:
    """Return by how much the peak of a blow may be off, `object_peak_note`, if one was struck."""
    mechanism, history = thrown
    if np.isnan(history.law_first[list(mechanism.index.object.values())]).all():
        return {}
    if not scheme.inertia:
        return {"object_peak_note": "without blows, which mode quasi-static leaves out"}
    quick = Scheme.of("quick")
    beyond = scheme.step > quick.step or scheme.cutoff_frequency < quick.cutoff_frequency
    share = COARSE_BLOW_SHARE if is_coarse(scheme) else BLOW_SHARE
    more = " or more" if beyond else ""
    return {"object_peak_note": f"the peak of a blow is off by up to {share} %{more}"}


def break_attributes(
    panel: LoadedPanel,
    objects: tuple[PlacedObject, ...],
    thrown: Thrown,
    scheme: Scheme,
    throw: Throw,
) -> dict[str, str]:
    """Return attributes on breaks: `break_check`, and `break_note` if breaking decides.

    Where it decides gaps alone it is `break_gaps` in place of `break_note`.

    Parameters
    ----------
    panel : LoadedPanel
        Panel that was thrown.
    objects : sequence of PlacedObject
        Of the throw.
    thrown : tuple of Mechanism and History
        The throw.
    scheme : Scheme
        Its numerical choices.
    throw : callable
        Makes such a throw with other objects and another scheme.
    """
    if not thrown[1].outcome.complete:
        return {}
    coarse = is_coarse(scheme)
    errors = _peak_errors(*thrown, objects, coarse=coarse)
    reaches = [COARSE_BLOW_ERROR] * len(objects) if coarse else errors
    broke = has_broken(*thrown)
    if not (broke or _is_near(*thrown, objects, reaches)):
        return {}
    first = end_of(panel, objects, thrown, scheme)
    found = [first]
    for varied, other, alike in _variants(objects, scheme, errors, broke=broke):
        end = end_of(panel, varied, throw(varied, other), other)
        if not alike or not end.kind or is_of_pieces(end, first):
            found.append(end)
    how = "in mode waveform and " if coarse else ""
    how += "with a little less and more strength"
    if any(end.kind != first.kind for end in found):
        note = f"{DEPENDS[:1].upper()}{DEPENDS[1:]}: {how} {outcomes(found)}"
        return {"break_check": f"differs {how}", "break_note": note}
    attributes = {"break_check": f"alike {how}"}
    if _open_names(found):
        attributes["break_gaps"] = f"{how[:1].upper()}{how[1:]}: {outcomes(found)}"
    return attributes


def _peak_errors(
    mechanism: Mechanism, history: History, objects: Sequence[PlacedObject], *, coarse: bool
) -> list[float]:
    """Return the error of the largest force on each object, by whether it is that of a blow [-]."""
    slow, blow = (COARSE_SLOW_ERROR if coarse else SLOW_ERROR), BLOW_ERROR
    found = []
    for item in objects:
        laws = list(mechanism.index.object_laws[item.name])
        peaks = history.time[np.argmax(history.forces(laws), axis=0)]
        struck = peaks < history.law_first[laws] + BLOW_DURATION
        found.append(blow if struck.any() else slow)
    return found


def _is_near(
    mechanism: Mechanism,
    history: History,
    objects: Sequence[PlacedObject],
    errors: Sequence[float],
) -> bool:
    """Return whether an object came within its error of its failure [-], or yielded as ice does."""
    obstructions = history.obstructions
    rows = named_obstructions(obstructions, mechanism.index.object)
    for item, error in zip(objects, errors, strict=True):
        parts = mechanism.index.object_parts.get(item.name, ())
        for name in parts if item.of_kind.breaks else ():
            deepest = float(obstructions.deepest[rows[name]])
            late = item.of_kind.breaks_late
            reach = 0.0 if late else float(item.of_kind.curve(item).breakpoints[1])
            if deepest > (1.0 - error) * reach:
                return True
    return False


def _variants(
    objects: tuple[PlacedObject, ...],
    scheme: Scheme,
    errors: Sequence[float],
    *,
    broke: bool,
) -> Iterator[tuple[tuple[PlacedObject, ...], Scheme, bool]]:
    """Yield objects and schemes to compare with, and whether the same objects must break in them.

    Pieces of stone fail on blows.
    """
    coarse = is_coarse(scheme)
    if coarse:
        yield objects, Scheme(), False
    shifts = [(errors, False)]
    if broke and not coarse and any(item.of_kind.breaks_again for item in objects):
        shifts += [([BLOW_ERROR] * len(objects), True)]
    for shift, alike in shifts:
        for sign in (-1.0, 1.0) if broke else (-1.0,):
            varied = tuple(
                replace(item, strength=(1.0 + sign * error) * item.of_kind.strength(item))
                for item, error in zip(objects, shift, strict=True)
            )
            yield varied, scheme, alike


@dataclass(frozen=True, slots=True)
class ThrowEnd:
    """Outcome of a throw.

    Attributes
    ----------
    kind : str
        Of the verdict on it; empty without an end.
    gaps : dict of str to float
        Of the sensors that are asked at the rests, of drives where a panel has none [m].
    broken : tuple of int
        How often each object broke.
    """

    kind: str
    gaps: dict[str, float]
    broken: tuple[int, ...]

    @property
    def broke(self) -> tuple[bool, ...]:
        """True for each object that broke."""
        return tuple(count > 0 for count in self.broken)


def is_of_pieces(end: ThrowEnd, first: ThrowEnd) -> bool:
    """Return whether pieces alone may make an end differ from the first one.

    Where each object breaks as often, another verdict comes of the force of its first failure.
    """
    return end.broke == first.broke and (end.kind == first.kind or end.broken != first.broken)


def end_of(
    panel: LoadedPanel, objects: Sequence[PlacedObject], thrown: Thrown, scheme: Scheme
) -> ThrowEnd:
    """Return the outcome of a throw with objects by a scheme."""
    from turnout.throw.dataset import describe_run, response_dataset  # the solver needs none

    if not thrown[1].outcome.complete:
        return ThrowEnd("", {}, ())
    dataset = response_dataset(panel, *thrown, save=COMPARED)
    dataset.attrs.update(
        describe_run(
            panel, *thrown, scheme=scheme, objects=objects, wall_time=np.nan, solver_time=np.nan
        )
    )
    found, last, gaps = checks(dataset), periods(dataset)[-1][0], dict[str, float]()
    for check in found:
        if check.kind not in ("control", "lock") or check.met is None:
            continue
        when = "" if check.movement == last else f" after {direction_of(check.movement)}"
        when += f" at {check.time:.2f} s" if check.rest else ""
        if check.kind == "control":
            gaps[f"{check.name}{when}"] = check.value
        elif not panel.sensor:
            drives = dataset["drive_gap"].sel(time=check.time)
            gaps |= {f"Drive {name}{when}": float(drives.sel(drive=name)) for name in panel.drive}
    broken = tuple(dataset["object_broken"].values.tolist())
    return ThrowEnd(verdict(dataset, found).kind, gaps, broken)


def _open_names(found: Sequence[ThrowEnd]) -> list[str]:
    """Return the gaps that differ."""
    ended = [end.gaps for end in found if end.kind]
    names = [name for name in ended[0] if all(name in gaps for gaps in ended)]
    return [name for name in names if np.ptp([gaps[name] for gaps in ended]) > SAME_END_GAP]


def outcomes(found: Sequence[ThrowEnd]) -> str:
    """Return the ends that differ: kind, breaks, and gaps that differ."""
    names, groups = _open_names(found), list[list[ThrowEnd]]()
    for end in sorted(found, key=lambda end: (not end.kind, sum(end.broken))):
        for group in groups:
            if all(_is_alike(end, each, names) for each in group):
                group.append(end)
                break
        else:
            groups.append([end])
    kinds = len({end.kind for end in found}) > 1
    return " or ".join(_outcome(ends, names, kinds=kinds) for ends in groups)


def _is_alike(end: ThrowEnd, other: ThrowEnd, names: Sequence[str]) -> bool:
    """Return whether two ends are one outcome."""
    if (end.kind, end.broke) != (other.kind, other.broke):
        return False
    apart = [abs(end.gaps[name] - other.gaps[name]) for name in names if end.kind]
    return all(distance <= WIDEST_RANGE for distance in apart)


def _outcome(ends: Sequence[ThrowEnd], gaps: Sequence[str], *, kinds: bool) -> str:
    """Return one of the ends that differ."""
    if not ends[0].kind:
        return "a run that does not come to its end"
    counts = [sum(end.broken) for end in ends]
    text = f"{_span(counts, '.0f')} break{'' if set(counts) == {1} else 's'}"
    parts = [f"{name} {_span([1e3 * end.gaps[name] for end in ends], '.1f')} mm" for name in gaps]
    text = text if any(counts) else "no break"
    text = f"{text} ({', '.join(parts)})" if parts else text
    return f'"{ends[0].kind}" with {text}' if kinds else text


def _span(values: Sequence[float], form: str) -> str:
    least, most = f"{min(values):{form}}", f"{max(values):{form}}"
    return least if least == most else f"{least} to {most}"
