"""Values that each movement has of its own, such as its friction, beside the common ones."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.local import Local
from turnout.calibration.misfit import Frame, Misfit, framed, slopes_of

Floats = NDArray[np.float64]
# How far a movement's own value may be from where it is thrown, how often it is thrown anew where
# it is further, and by how much at most it then changes [share].
SAME_EFFECT, EFFECT_PASSES, LONGEST_EFFECT_STEP, FURTHEST_EFFECT = 2e-3, 6, 0.04, 0.5


def update_movement_effects(
    misfit: Misfit, local: Local, names: Sequence[str], *, turns: int
) -> tuple[Misfit, Local, Frame]:
    """Throw movements at their own values, until these are where the measurement has them.

    What a movement's own value changes is linear over a part of a per cent only. Told from further
    away it would bend the common values and, as what is left over is large, count as noise.
    """
    frame = framed(local, misfit)
    for _ in range(turns):
        own = _clipped(misfit, [view.estimates for view in frame.views])
        if _furthest(misfit, own) <= SAME_EFFECT:
            break
        misfit = replace(misfit, own=own)
        local = replace(local, here=tuple(misfit.responses([local.values])[0]))
        frame = framed(local, misfit)
    known = local.moved
    local = misfit.local_near(local.values, names, local)
    return misfit, local, frame if local.moved is known else framed(local, misfit)


def effects_after(
    misfit: Misfit, local: Local, frame: Frame, names: Sequence[str], step: Floats
) -> dict[str, tuple[float, ...]]:
    """Return the movements' own values as they are expected after a step of the common ones."""
    slopes = slopes_of(local, frame, names)
    expected = []
    for view, slope, response in zip(frame.views, slopes, local.here, strict=True):
        found = view.own_after(view.measured - view.of(response) - slope @ step)
        expected.append({name: (value, 0.0) for name, value in found.items()})
    return _clipped(misfit, expected)


def _clipped(
    misfit: Misfit, estimates: Sequence[Mapping[str, tuple[float, float]]]
) -> dict[str, tuple[float, ...]]:
    """Return own values that are no further than the longest step from those of a misfit.

    A movement that a model cannot follow must not ask for friction below zero.
    """
    own = {}
    for name in misfit.comparison.scatter:
        shares = []
        for number, found in enumerate(estimates):
            before = misfit.share(name, number)
            after = found[name][0] if name in found else 0.0
            near = float(np.clip(after, before - LONGEST_EFFECT_STEP, before + LONGEST_EFFECT_STEP))
            shares.append(float(np.clip(near, -FURTHEST_EFFECT, FURTHEST_EFFECT)))
        own[name] = tuple(shares)
    return own


def _furthest(misfit: Misfit, own: Mapping[str, tuple[float, ...]]) -> float:
    shifts = [
        abs(share - misfit.share(name, number))
        for name, shares in own.items()
        for number, share in enumerate(shares)
    ]
    return max(shifts, default=0.0)
