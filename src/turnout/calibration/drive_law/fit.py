"""Fits of one law: the chain of a calibration, from a start that the law itself suggests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.drive_law.candidates import DriveLaw, level_key
from turnout.calibration.fit import TIGHTENING, Fit, fit
from turnout.calibration.misfit import Misfit
from turnout.calibration.observed import largest_force
from turnout.calibration.parameter import Parameter

Floats = NDArray[np.float64]
# Values of what a law has beyond the plain one with which a fit may start, as shares of the first
# guess: what is small is found by no slope from far above.
TRIES = (0.1, 0.3, 1.0, 3.0)


class _End(TypedDict):
    refined: bool
    enough: float


# How every law is fitted to its end: what half a step of the solver moves is within the noise that
# laws are judged by, and so is half a unit of the cost.
END: _End = {"refined": False, "enough": 0.5}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawFit:
    """One law at its best.

    Attributes
    ----------
    law : DriveLaw
        Which one.
    names : tuple of str
        Parameters that were fitted.
    found : Fit
        Where it ended.
    """

    law: DriveLaw
    names: tuple[str, ...]
    found: Fit


def fitted_plain(law: DriveLaw, misfit: Misfit, vary: Sequence[Parameter]) -> LawFit:
    """Fit the plain law as a calibration does: quickly and loosely, then to the end.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    near = fit(replace(misfit, quick=True), vary, misfit.base, rough=True, loose_shares=TIGHTENING)
    found = fit(replace(misfit, base=near.values), vary, near.values, near=near, **END)
    return LawFit(law=law, names=tuple(item.name for item in vary), found=found)


def fitted_variant(
    law: DriveLaw, misfit: Misfit, vary: Sequence[Parameter], *, plain: Fit, drive: str
) -> LawFit:
    """Fit another law from where the plain one ended, to the same end.

    Parameters
    ----------
    law : DriveLaw
        Not the plain one.
    misfit : Misfit
        With this law; its noise as the plain one's was before its fit.
    vary : sequence of Parameter
        To change, those of the law among them.
    plain : Fit
        Of the plain law, at its end.
    drive : str
        Whose law it is.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    at_plain = replace(misfit, own=plain.misfit.own, base={**misfit.base, **plain.values})
    values = _suggested(law, at_plain, plain)
    own = dict(plain.misfit.own)
    if level_key(drive) in law.scatter:
        own[level_key(drive)] = _own_levels(law, replace(at_plain, base=values), plain, drive)
    start = replace(plain, misfit=replace(at_plain, own=own, base=values), values=values)
    found = fit(replace(misfit, base=values), vary, values, near=start, **END)
    return LawFit(law=law, names=tuple(item.name for item in vary), found=found)


def fitted_from(before: LawFit, misfit: Misfit, other: Fit) -> LawFit:
    """Fit a law again from where a fit of another law ended.

    Parameters
    ----------
    before : LawFit
        Of the law, from another start.
    misfit : Misfit
        With the law; its noise as it was before the first fit.
    other : Fit
        Of the other law, at its end.

    Raises
    ------
    SolverError
        When a movement cannot be simulated.
    """
    vary = [item for item in misfit.parameters if item.name in before.names]
    values = {item.name: other.values[item.name] for item in misfit.parameters}
    own = {name: row for name, row in other.misfit.own.items() if name in misfit.comparison.scatter}
    # Slopes of another law are none of this one.
    near = replace(
        other,
        misfit=replace(misfit, own=own),
        values=values,
        local=replace(other.local, moved={}),
    )
    found = fit(replace(misfit, base=values), vary, values, near=near, **END)
    return replace(before, found=found)


def _suggested(law: DriveLaw, misfit: Misfit, plain: Fit) -> dict[str, float]:
    """Return the values of the plain fit, with that start of the law's own which is nearest."""
    values = {**misfit.base}
    for item in law.extra:
        tried = [min(max(share * item.start, item.lower), item.upper) for share in TRIES]
        points = [{**values, item.name: value} for value in tried]
        costs = [
            float(np.sum(misfit.residuals_of(row, plain.frame) ** 2))
            for row in misfit.responses(points)
        ]
        values[item.name] = tried[int(np.argmin(costs))]
    return values


def _own_levels(law: DriveLaw, misfit: Misfit, plain: Fit, drive: str) -> tuple[float, ...]:
    """Return for each movement where its slip level may be, as a share beside the common one.

    Where a drive slips below the common level, a throw at the common one may not slip at all, and
    no slope tells that it should. So the largest force that was measured is tried as level.
    """
    name = level_key(drive)
    common = misfit.base[name]
    shares = tuple(largest_force(item, drive) / common - 1.0 for item in misfit.movements)
    tried = replace(misfit, own={**misfit.own, name: shares})
    rows = [
        (misfit, misfit.responses([misfit.base])[0]),
        (tried, tried.responses([misfit.base])[0]),
    ]
    chosen = []
    for number, view in enumerate(plain.frame.views):
        own = {key: misfit.share(key, number) for key in view.own}
        costs = [
            float(np.sum(view.whitened(view.measured - view.of(row[number], own)) ** 2))
            for _, row in rows
        ]
        costs[1] += (shares[number] / law.scatter[name]) ** 2
        chosen.append(shares[number] if costs[1] < costs[0] else 0.0)
    return tuple(chosen)
