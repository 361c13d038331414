"""Lock rules: the quantity that each criterion measures at a drive, its limit, and its words.

Stands alone: the one place of a lock rule; panel files, throws, checks and facts read this table. A
rule is a row of `LOCK_RULES`. It refuses lock where one of its criteria does; of a rail that should
be open and has no other beside it no gap is judged, and its drives hold it by not slipping.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveStates:
    """States of the drives of a throw, or of many with the same instants.

    Attributes
    ----------
    slipping : ndarray of bool, shape (..., n_drives, n_times)
        Whether a drive is at its saturation force, or was switched off before its end position.
    force, gap : ndarray, shape (..., n_drives, n_times)
        Force on the rail [N]; raw gap of the rail that should be closed [m].
    slip_limit, gap_limit : ndarray, shape (..., n_drives)
        [N], [m]
    """

    slipping: Flags
    force: Floats
    gap: Floats
    slip_limit: Floats
    gap_limit: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class LockCriterion:
    """One reason for refusing lock.

    Attributes
    ----------
    name, quantity, unit : str
        Of the reason, of what is measured at a drive, and its SI unit.
    value, limit : callable
        From `DriveStates` the measured quantity, shape (..., n_drives, n_times), and its limits,
        shape (..., n_drives).
    refuses : callable
        From `DriveStates` flags of the drives that refuse, shape (..., n_drives, n_times).
    of_open_rail : bool
        Whether a rail that should be open is judged by it.
    needs_stock_rail : bool
        Whether it measures against a stock rail.
    holds, refused : str
        Text of a criterion that holds, with "{limit}" for the limits, and of one that refuses.
    """

    name: str
    quantity: str
    unit: str
    value: Callable[[DriveStates], Floats]
    limit: Callable[[DriveStates], Floats]
    refuses: Callable[[DriveStates], Flags]
    of_open_rail: bool
    needs_stock_rail: bool
    holds: str
    refused: str


SLIP = LockCriterion(
    name="slip",
    quantity="force",
    unit="N",
    value=lambda drives: np.abs(drives.force),
    limit=lambda drives: drives.slip_limit,
    refuses=lambda drives: drives.slipping,
    of_open_rail=True,
    needs_stock_rail=False,
    holds="no drive is at its saturation force",
    refused="where a drive is saturated",
)
GAP = LockCriterion(
    name="gap",
    quantity="gap",
    unit="m",
    value=lambda drives: drives.gap,
    limit=lambda drives: drives.gap_limit,
    refuses=lambda drives: drives.gap >= drives.gap_limit[..., np.newaxis],  # unknown: never wide
    of_open_rail=False,
    needs_stock_rail=True,
    holds="the gap at every drive is below {limit}",
    refused="where a gap at a drive is at its limit or above",
)

DEFAULT_RULE = "slip or gap"
LOCK_RULES: Mapping[str, tuple[LockCriterion, ...]] = MappingProxyType(
    {DEFAULT_RULE: (SLIP, GAP), "no slip": (SLIP,), "raw gap": (GAP,)}
)
"""Criteria of each rule, in the order in which they are named."""


def rules_text() -> str:
    """Return when each rule refuses lock.

    Examples
    --------
    >>> rules_text().partition("; ")[0]
    "'slip or gap' where a drive is saturated or where a gap at a drive is at its limit or above"
    """
    return "; ".join(
        f"'{name}' {' or '.join(criterion.refused for criterion in rule)}"
        for name, rule in LOCK_RULES.items()
    )


def criteria_of(rule: str, *, closes: bool = True) -> tuple[LockCriterion, ...]:
    """Return the criteria by which a rail is judged that should be closed, or open.

    Examples
    --------
    >>> [item.name for item in criteria_of("raw gap")]
    ['gap']
    >>> [item.name for item in criteria_of("raw gap", closes=False)]
    ['slip']
    """
    if closes:
        return LOCK_RULES[rule]
    return tuple(item for item in LOCK_RULES[rule] if item.of_open_rail) or (SLIP,)


def lock_holds(rule: str, drives: DriveStates, closes: Flags) -> Flags:
    """Return whether a rule is met by all drives, shape (..., n_times).

    Parameters
    ----------
    rule : str
        A key of `LOCK_RULES`.
    drives : DriveStates
        States of the drives over time.
    closes : ndarray of bool, shape (n_times,)
        Whether there is a rail that should be closed.
    """

    def held(closes: bool) -> Flags:
        criteria = criteria_of(rule, closes=closes)
        refused = [item.refuses(drives).any(axis=-2) for item in criteria]
        return np.asarray(~np.logical_or.reduce(refused))

    if closes.all():
        return held(closes=True)
    return np.where(closes, held(closes=True), held(closes=False))
