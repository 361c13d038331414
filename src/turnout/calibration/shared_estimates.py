"""How large what all movements share is, such as gains, zeros and clock, at a fit."""

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.linearisation import Linearisation
from turnout.calibration.misfit import Frame

Floats = NDArray[np.float64]


def shared_estimates(local: Linearisation, frame: Frame) -> Floats:
    """Return the likeliest size of all that movements share, in standard deviations, shape (q,)."""
    if frame.shared is None:
        return np.zeros(0)
    rows = [
        alignment.whitened(alignment.measured - alignment.reduced(response))
        for alignment, response in zip(frame.alignments, local.simulated, strict=True)
    ]
    return frame.shared.estimates(np.concatenate(rows))


def shared_corrections(local: Linearisation, frame: Frame) -> list[Floats | None]:
    """Return for each movement what its sensors add to the measured forces, as estimated [N]."""
    if frame.shared is None:
        return [None] * len(frame.alignments)
    count = len(frame.shared.sensors)
    sizes = shared_estimates(local, frame)[:count]
    return [block[:, :count] @ sizes for block in frame.shared.plain]
