"""All that a panel should be warned of: from its throw, and from its vibrations while it slides."""

import xarray as xr

from turnout.metric.concern import Concern, concerns
from turnout.panel.model import Panel
from turnout.panel.unusual import unusual_values
from turnout.response.stability import FrictionStability, friction_stability

# A panel should not flutter at this many times its friction either.
FRICTION_RESERVE = 1.25
REMEDY = "more chair.damping or less chair.friction_coefficient"


def panel_concerns(panel: Panel, dataset: xr.Dataset) -> list[Concern]:
    """Return what is to be looked at in a panel.

    Parameters
    ----------
    panel : Panel
        The panel.
    dataset : xarray.Dataset
        A throw of it without an object.

    Returns
    -------
    list of Concern
        Unusual values, those of the throw (`turnout.metric.concern.concerns`), then flutter.
    """
    return [*unusual_concerns(panel), *concerns(dataset), *flutter_concerns(panel)]


def unusual_concerns(panel: Panel) -> list[Concern]:
    """Return the values that no switch has, which need no throw to be seen.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> (concern,) = unusual_concerns(load_panel("sb1").with_overrides({"gravity": 1000.0}))
    >>> concern.text
    'unusual value: gravity = 1000 m/s^2: usual is 0 to 30 m/s^2; check value and unit'
    """
    return [
        Concern("unusual value", item.given, item.usual, "check value and unit")
        for item in unusual_values(panel)
    ]


def concern_lines(panel: Panel, found: list[Concern]) -> list[str]:
    """Return what to tell of a checked panel: a line a warning, or what was found in order.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> concern_lines(load_panel("uic60-760-1-15"), [])
    ['no warnings: force margins, flangeway, chairs and flutter are in order']
    """
    if found:
        return [f"warning: {concern.text}" for concern in found]
    if panel.flangeway is not None:
        return ["no warnings: force margins, flangeway, chairs and flutter are in order"]
    return [
        "no warnings: force margins, chairs and flutter are in order; "
        "the flangeway was not judged, the file has no flangeway.limit"
    ]


def flutter_concerns(panel: Panel) -> list[Concern]:
    """Return whether the rails can flutter in motion, at their friction or at a quarter more.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> flutter_concerns(load_panel("sb1"))
    []
    """
    if not panel.movement:
        return []
    for factor in (1.0, FRICTION_RESERVE):
        found = friction_stability(panel, friction_factor=factor)
        if not found.stable:
            return [_concern(found)]
    return []


def _concern(found: FrictionStability) -> Concern:
    worst = found.worst
    at = "the panel's friction" if found.friction_factor == 1 else (
        f"{found.friction_factor:g} times the panel's friction"
    )  # fmt: skip
    if worst.growth_rate >= 0:
        what = "the section can flutter" if worst.frequency > 0 else "a rail can run away"
        where = f"at {at}, {100 * worst.share:.0f} % of movement '{worst.movement}'"
        number = (
            f"{worst.frequency:.1f} Hz, damping {100 * worst.damping_ratio:.2f} % of critical, "
            f"grows with {worst.growth_rate:.2g} 1/s"
        )
        return Concern(what, where, number, REMEDY)
    lost = [case for case in found.cases if not case.settled]
    where = f"at {at}, {100 * lost[0].share:.0f} % of movement '{lost[0].movement}'"
    number = f"no steady sliding was found in {len(lost)} of {len(found.cases)} places"
    return Concern("flutter is not known", where, number, REMEDY)
