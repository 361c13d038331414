"""Judgement of the recording of a throw: usable or not, every fault with its reason."""

from dataclasses import dataclass, field

import xarray as xr

from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.quality.channel_faults import Fault, Limits, channel_faults
from turnout.measurement.quality.throw_faults import (
    Expected,
    SeenThrow,
    direction_faults,
    drift_faults,
    offset_faults,
    rate_faults,
    swap_faults,
    truncation_faults,
)

LOAD_CELL = "object_force"


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrowQuality:
    """The faults of a throw: those that exclude it, and those that are worth a remark."""

    faults: tuple[Fault, ...] = field(default=())

    @property
    def usable(self) -> bool:
        """True if no fault excludes the throw."""
        return not any(fault.excludes for fault in self.faults)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Faults that exclude the throw, a sentence each."""
        return tuple(str(fault) for fault in self.faults if fault.excludes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Faults that do not exclude the throw, a sentence each."""
        return tuple(str(fault) for fault in self.faults if not fault.excludes)


def judge_recording(
    dataset: xr.Dataset,
    throw: FoundThrow,
    *,
    expected: Expected | None = None,
    limits: Limits | None = None,
) -> ThrowQuality:
    """Look for every known fault of a throw.

    Parameters
    ----------
    dataset : xarray.Dataset
        The recording that the throw was found in: `drive_force` [N], and where measured
        `drive_current` [A] and `object_force` [N], unfiltered.
    throw : FoundThrow
        From `find_throws` on this dataset.
    expected : Expected, optional
        Knowledge of the campaign; without it fewer faults can be seen.
    limits : Limits, optional
        From what size on something is a fault.

    Returns
    -------
    ThrowQuality
        All faults, in a fixed order.

    Examples
    --------
    >>> import numpy as np
    >>> from turnout.measurement.campaign.find_throws import find_throws
    >>> time = np.arange(0.0, 4.5, 1e-3)
    >>> current = 1.2 * ((time >= 1.0) & (time < 5.0)) + 1e-3 * np.sin(700.0 * time)
    >>> data = xr.Dataset(
    ...     {"drive_force": (("drive", "time"), [1000.0 * np.clip(time - 1.0, 0.0, 3.0)]),
    ...      "drive_current": (("drive", "time"), [current])},
    ...     {"time": time, "drive": ["1"]},
    ... )
    >>> (throw,) = find_throws(data)
    >>> judge_recording(data, throw).reasons
    ('truncated: the recording ends before the motion does',)
    """
    chosen, known = limits or Limits(), expected or Expected()
    kept = dataset.isel(time=slice(throw.first, throw.stop))
    if LOAD_CELL in kept and not known.load_cell:
        kept = kept.drop_vars(LOAD_CELL)
    seen = SeenThrow(kept, throw, chosen, known)
    faults = (
        *truncation_faults(seen),
        *channel_faults(kept, throw, limits=chosen),
        *rate_faults(seen),
        *direction_faults(seen),
        *drift_faults(seen),
        *offset_faults(seen),
        *swap_faults(seen),
    )
    return ThrowQuality(faults=faults)
