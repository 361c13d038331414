"""Whether sensors, objects and states of a panel stay within what was stated of them.

What is not right in a model, such as a switch of another length, leaves a rest that unknowns with
priors take up: the model then misses nothing, but only with gains, objects and states that no one
would have stated. One kind of them may be off: then it is named, and the others are judged. Without
a cause a gain is itself the finding, and `sensor_reasons` judges it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtr

from turnout.calibration.candidate_causes import MODULUS
from turnout.calibration.covariance import common_gain
from turnout.calibration.fit import Fit
from turnout.calibration.objects import is_of_object, is_thickness
from turnout.calibration.parameter import Parameter, coordinates, prior_residuals
from turnout.calibration.sensors import LEAVES_PRIOR, found_sensors
from turnout.calibration.shared import CLOCK, GAIN
from turnout.core.value_text import value_text

# What chance does more rarely than this is no chance [-]. A right cause is refused that often.
LEAST_CHANCE = 0.01
# Chances below this are not stated in figures [-], and how many of many deviations are listed.
LEAST_SAID, MOST_SHOWN = 1e-4, 3
THICKNESS, PLACE, STATE = "thickness", "place", "state"
# Kinds of which one may be off, with the name of the cause that it then is: a wrong run sheet or
# sampling rate. Of the places at most this share, as all together are a wrong panel [-].
MAY_LEAVE, MOST_PLACES = {THICKNESS: "objects", PLACE: "objects", CLOCK: "timing"}, 0.5
VERBS = {False: ("was", "is"), True: ("were", "are")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """One unknown that had a prior.

    Attributes
    ----------
    text : str
        As stated and as found.
    away : float
        How far it came out from the mean of its prior, in deviations of that [-].
    kind : str
        `THICKNESS`, `PLACE`, `STATE` of the panel, or that of a sensor.
    """

    text: str
    away: float
    kind: str = GAIN


def stated_unknowns(found: Fit) -> list[Stated]:
    """Return sensors and states of the panel with how far they are from what was stated of them.

    Where other rails were fitted, their weight is doubted too, which all gains show alike: they
    then count about the gain that all channels have in common, whose size the intervals hold.

    Parameters
    ----------
    found : Fit
        At its end.
    """
    alike = 0.0
    if any(item.name == MODULUS for item in found.parameters):
        alike = (common_gain(found) or (0.0, 0.0))[0]
    away = prior_residuals(found.parameters, coordinates(found.parameters, found.values))
    return [
        *(
            Stated(
                text=item.text,
                away=(item.value - alike * (item.column.kind == GAIN)) / item.stated,
                kind=item.column.kind,
            )
            for item in found_sensors(found)
        ),
        *(
            Stated(
                text=f"{item.name} {value_text(found.values[item.name], unit=item.unit, digits=3)} "
                f"(stated {value_text(item.start, unit=item.unit, digits=3)} ± "
                f"{value_text(item.prior, unit=item.unit, digits=3)})",
                away=float(size),
                kind=_kind(item),
            )
            for item, size in zip(found.parameters, away, strict=True)
            # The sizes of a cause are no states of the panel.
            if (item.keys or is_of_object(item)) and item.prior
        ),
    ]


def _kind(item: Parameter) -> str:
    if not is_of_object(item):
        return STATE
    return THICKNESS if is_thickness(item.name) else PLACE


def kind_that_leaves(unknowns: Sequence[Stated]) -> str:
    """Return the one kind of unknown that is off where no other need be; empty where none is.

    Parameters
    ----------
    unknowns : sequence of Stated
        From `stated_unknowns`.

    Examples
    --------
    >>> kind_that_leaves([Stated(text="", away=5.0, kind=THICKNESS), Stated(text="", away=0.3)])
    'thickness'
    """
    furthest = {
        kind: max((abs(item.away) for item in unknowns if item.kind == kind), default=0.0)
        for kind in MAY_LEAVE
    }
    kind = max(furthest, key=lambda name: furthest[name])
    own = [abs(item.away) > LEAVES_PRIOR for item in unknowns if item.kind == kind]
    if furthest[kind] <= LEAVES_PRIOR or (kind == PLACE and sum(own) > MOST_PLACES * len(own)):
        return ""
    return kind


def chances_of(away: Sequence[float]) -> tuple[float, float]:
    r"""Return how often chance takes unknowns as far from their priors, in each of two ways [-].

    That the furthest of `n` is as far, and that the sum of squares is as large,

    .. math:: 2 - 2 (1 - 2 Q(\max |z|))^n, \quad 2 P\bigl(\chi^2_n > \textstyle\sum z^2\bigr),

    twice what each alone would be, as either of the two refuses a cause (Bonferroni), 1 at most.

    Estimates lie nearer to the means of their priors than the unknowns do, so chance is overrated.

    Parameters
    ----------
    away : sequence of float
        In deviations of each prior [-].

    Examples
    --------
    >>> [round(min(chances_of([far] + 9 * [0.5])), 4) for far in (2.0, 3.0, 3.8)]
    [0.7446, 0.0533, 0.0029]
    >>> round(min(chances_of(10 * [1.6])), 4)
    0.0086
    """
    sizes = np.abs(np.asarray(away, dtype=np.float64))
    if not sizes.size:
        return 1.0, 1.0
    beyond = 2.0 * ndtr(-sizes.max())
    furthest = -np.expm1(sizes.size * np.log1p(-beyond)) if beyond < 1.0 else 1.0
    together = chdtrc(sizes.size, sizes @ sizes)
    return min(1.0, 2.0 * float(furthest)), min(1.0, 2.0 * float(together))


def prior_reasons(found: Fit, causes: Sequence[str]) -> list[str]:
    """Say what leaves its prior beside fitted causes, by more than chance would.

    Parameters
    ----------
    found : Fit
        At its end, with the causes.
    causes : sequence of str
        Names of those that were fitted, the likeliest first.

    Returns
    -------
    list of str
        One sentence, or none.
    """
    unknowns = stated_unknowns(found)
    kind = kind_that_leaves(unknowns)
    causes = [*causes, *([MAY_LEAVE[kind]] if kind else [])]
    # Without a cause a gain is the finding.
    judged = [
        item
        for item in unknowns
        if item.kind != kind and (causes or item.kind in (THICKNESS, PLACE, STATE))
    ]
    unknowns = sorted(judged, key=lambda item: -abs(item.away))
    furthest, together = chances_of([item.away for item in unknowns])
    chance = min(furthest, together)
    if chance >= LEAST_CHANCE:
        return []
    shown = [item for item in unknowns if abs(item.away) >= LEAVES_PRIOR]
    if together < furthest:
        shown = unknowns[: max(len(shown), MOST_SHOWN)]
    left = "; ".join(
        f"{item.text}, {abs(item.away):.1f} standard deviations away"
        for item in shown or unknowns[:1]
    )
    named = list(dict.fromkeys(causes))
    names, (was, is_now) = " and ".join(named), VERBS[len(named) > 1]
    although = f" although {names} {was} fitted" if named else ""
    hence = f"so {names} {is_now} not the cause or not all of it" if named else "so it is none"
    all_of_them = f"all {len(unknowns)} together, of which " if together < furthest else ""
    often = "less than 0.01" if chance < LEAST_SAID else f"{100 * chance:.1g}"
    return [
        f"stated values are not kept{although}: {all_of_them}{left}; chance does this in {often} % "
        f"of campaigns, {hence}: check that lengths, places and sections of the panel are those of "
        "the switch"
    ]
