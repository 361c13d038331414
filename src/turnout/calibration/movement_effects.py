"""What each movement has of its own, such as its friction: thrown with it until it rests."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.linearisation import Linearisation
from turnout.calibration.misfit import Frame, Misfit, about_clock, framed, slopes_of

Floats = NDArray[np.float64]
# How far an estimated effect may be from the simulated one, how often it is simulated again where
# it is further, by how much at most it then changes, and the largest effect [share].
SAME_EFFECT, EFFECT_PASSES, LONGEST_EFFECT_STEP, FURTHEST_EFFECT = 2e-3, 6, 0.04, 0.5


def update_movement_effects(
    misfit: Misfit, local: Linearisation, names: Sequence[str], *, passes: int
) -> tuple[Misfit, Linearisation, Frame]:
    """Simulate movements at their own values until these agree with the estimates.

    The response to a movement effect is linear over a part of a per cent only. Estimated from
    further away it would bias the common values, and its large residuals would count as noise.
    """
    frame = framed(local, misfit)
    for _ in range(passes):
        misfit = about_clock(misfit, frame)
        found = _clipped(misfit, [alignment.estimates for alignment in frame.alignments])
        effects = _where_further(misfit, found)
        if effects == misfit.effects:
            break
        misfit = replace(misfit, effects=effects)
        local = replace(local, simulated=tuple(misfit.responses([local.values])[0]))
        frame = framed(local, misfit)
    misfit, before = about_clock(misfit, frame), local.stepped
    local = misfit.local_near(local.values, names, local)
    return misfit, local, frame if local.stepped is before else framed(local, misfit)


def effects_after(
    misfit: Misfit, local: Linearisation, frame: Frame, names: Sequence[str], step: Floats
) -> dict[str, tuple[float, ...]]:
    """Return the movement effects expected after a step of the common values."""
    slopes = slopes_of(local, frame, names)
    expected = []
    for alignment, slope, response in zip(frame.alignments, slopes, local.simulated, strict=True):
        found = alignment.effects_from(
            alignment.measured - alignment.reduced(response) - slope @ step
        )
        expected.append({name: (value, 0.0) for name, value in found.items()})
    return _clipped(misfit, expected)


def _clipped(
    misfit: Misfit, estimates: Sequence[Mapping[str, tuple[float, float]]]
) -> dict[str, tuple[float, ...]]:
    """Return effects no further than the longest step from those of a misfit.

    A movement that a model cannot follow must not lead to friction below zero.
    """
    effects = {}
    for name in misfit.comparison.scatter:
        shares = []
        for number, found in enumerate(estimates):
            before = misfit.effect(name, number)
            after = found[name][0] if name in found else 0.0
            near = float(np.clip(after, before - LONGEST_EFFECT_STEP, before + LONGEST_EFFECT_STEP))
            shares.append(float(np.clip(near, -FURTHEST_EFFECT, FURTHEST_EFFECT)))
        effects[name] = tuple(shares)
    return effects


def _where_further(
    misfit: Misfit, found: Mapping[str, tuple[float, ...]]
) -> Mapping[str, tuple[float, ...]]:
    """Return the effects of a misfit, and estimates where they are further off than is allowed.

    A movement is simulated again only where one of its own has changed.
    """
    known = {
        name: tuple(misfit.effect(name, number) for number in range(len(shares)))
        for name, shares in found.items()
    }
    further = [
        any(abs(found[name][number] - known[name][number]) > SAME_EFFECT for name in found)
        for number in range(len(misfit.movements))
    ]
    if not any(further):
        return misfit.effects
    return {
        name: tuple(
            share if far else before
            for share, before, far in zip(found[name], known[name], further, strict=True)
        )
        for name in found
    }
