"""Signs that throws are of another switch than the one that a detector is made for.

Drives of most switches are called 1 and 2, so that a detector judges throws of any of them. Those
of another type are called an unknown deviation, or a cause that explains them although it is none.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from turnout.detection.conditions import FORCE
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_verdict import CANNOT, CAUSE, OBJECTS, SOUND, UNKNOWN

LEAST_THROWS = 5
"""Below which their verdicts say nothing of the detector."""
HASH_SHOWN = 12
"""Digits of a hash that a message shows."""


def panel_named(attributes: Mapping[Any, Any]) -> tuple[str, str]:
    """Return name and hash of the panel that a dataset names, empty where it names none.

    With values that were set for one run there is no hash: they belong to the state of a switch.

    Parameters
    ----------
    attributes : mapping
        Of the dataset.

    Examples
    --------
    >>> panel_named({"panel": "sb1", "panel_hash": "12ab", "overrides": "{}"})
    ('sb1', '12ab')
    >>> panel_named({"sheet_panel": "sb1"}), panel_named({})
    (('sb1', ''), ('', ''))
    """
    name = attributes.get("panel") or attributes.get("sheet_panel") or ""
    as_it_is = str(attributes.get("overrides", "{}")) == "{}"
    return str(name), str(attributes.get("panel_hash", "")) if as_it_is else ""


def panel_remark(throws: Sequence[Recorded], about: Mapping[str, Any]) -> str:
    """Return that throws are of another panel than a detector, and the remedy; empty otherwise.

    Parameters
    ----------
    throws : sequence of Recorded
        Of one file or folder.
    about : mapping of str to object
        What the detector says of its training: `Knowledge.about`.
    """
    panel, digest = str(about.get("panel", "")), str(about.get("panel_hash", ""))
    for name, other in dict.fromkeys(throw.panel for throw in throws):
        same = other == digest if other and digest else name == panel
        if not panel or not name or same:
            continue
        theirs, own = f"panel {name}", f"panel {panel}"
        if name == panel:
            theirs += f" with hash {other[:HASH_SHOWN]}"
            own += f" with hash {digest[:HASH_SHOWN]}"
        return (
            f"throws are of {theirs}, the detector is of {own}: verdicts can be wrong; take the "
            f"detector of that panel, or train one: turnout detect train {name}"
        )
    return ""


def misfit_remark(statuses: Sequence[str], about: Mapping[str, Any]) -> str:
    """Return that a detector of forces may not fit the throws that it judged; else empty.

    Most of some throws are an unknown deviation or cannot be judged. Other causes count with these
    where no throw is sound: a cause explains throws of another type of switch at times.

    Parameters
    ----------
    statuses : sequence of str
        Of the verdicts.
    about : mapping of str to object
        What the detector says of its training: `Knowledge.about`.

    Examples
    --------
    >>> misfit_remark(["unknown deviation"] * 3 + ["sound"] * 2, {"panel": "sb1"})[:45]
    '3 of 5 throws are unknown or cannot be judged'
    >>> misfit_remark(["other cause"] * 4 + ["sound"], {})
    ''
    """
    if about.get("quantity", FORCE) != FORCE:  # currents and powers of recordings are not judged
        return ""
    odd, what = [UNKNOWN, CANNOT, OBJECTS], "unknown or cannot be judged"
    if SOUND not in statuses:
        odd, what = [*odd, CAUSE], "neither sound nor an object"
    count = sum(item in odd for item in statuses)
    if len(statuses) < LEAST_THROWS or 2 * count <= len(statuses):
        return ""
    panel = f" of panel {about['panel']}" if about.get("panel") else ""
    return (
        f"{count} of {len(statuses)} throws are {what}: the detector{panel} "
        "may be of another type of switch, or forces are scaled, zeroed or turned round; check "
        "its panel, units and sensors"
    )
