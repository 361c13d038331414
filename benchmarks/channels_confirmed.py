"""Test of the number of sound throws of `turnout limit --channels all`: a90 claimed and confirmed.

    python -m benchmarks.channels_confirmed FOLDER

FOLDER is that of `turnout limit uic60-760-1-15-jea73 --channels all`. The best test of one half of
the sound throws is judged with the covariance of the other half: no less than that can be detected.
What all throws claim is no less than the limit.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from turnout.detection.limit.bound import probability_of_detection
from turnout.detection.limit.limit_map import (
    LARGEST_SIZE,
    SIZE_STEP,
    limit_map,
    size_weights,
    smallest_seen,
    sound_throws,
)
from turnout.detection.reference import Conditions
from turnout.detection.signal_discrepancy import SignalErrors
from turnout.detection.throws import Throws, closing_time, stored_throws
from turnout.panel.load import load_panel

PANEL = "uic60-760-1-15-jea73"
SETS = (("force",), ("current",), ("power",), ("force", "current"), ("force", "current", "power"))


def main() -> None:
    """Print a90 in millimetres by channels and place."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    given = options.parse_args()
    panel = load_panel(PANEL)
    throws, closing = stored_throws(panel, given.folder, channels="all"), closing_time(panel)
    for quantities in SETS:
        own, name = with_quantities(throws, quantities), " and ".join(quantities)
        claimed = limit_map(own, Conditions(), closing=closing)["a90"].sel(channel="both drives")
        print(f"{name}, claimed  ", (1e3 * claimed.to_numpy()).round(1))
        print(f"{name}, confirmed", (1e3 * confirmed(own, Conditions(), closing)).round(1))


def with_quantities(throws: Throws, quantities: Sequence[str]) -> Throws:
    """Return throws with the signals of some quantities alone."""
    rows = [n for n, item in enumerate(throws.signals) if item.quantity in quantities]
    errors = SignalErrors(
        amplitude=throws.errors.amplitude[rows], force_peak=throws.errors.force_peak[rows],
        gain=throws.errors.gain[rows],
    )  # fmt: skip
    return replace(
        throws, sound=throws.sound[:, rows], change=throws.change[..., rows, :], errors=errors,
        signals=tuple(throws.signals[row] for row in rows),
    )  # fmt: skip


def confirmed(throws: Throws, conditions: Conditions, closing: float) -> np.ndarray:
    r"""Return a90 by the index :math:`w^T s / \sqrt{w^T C_B w}` of the test :math:`w = C_A^{-1} s`.

    A and B are halves of the sound throws; the mean of both ways round, NaN beyond what was thrown.
    """
    halves = [
        sound_throws(
            replace(
                throws, sound=throws.sound[part::2], switch=throws.switch[part::2],
                level=throws.level[part::2],
            ),
            conditions, closing=closing,
        )
        for part in (0, 1)
    ]  # fmt: skip
    near = halves[0].nearest(throws.level[throws.states])
    sizes = np.arange(0.0, LARGEST_SIZE + 0.5 * SIZE_STEP, SIZE_STEP)
    found = []
    for own, other in (halves, halves[::-1]):
        inverse = [np.linalg.inv(item) for item in own.covariances]
        pod = np.zeros((len(throws.places), sizes.size))
        for state, level in enumerate(near):
            signature = np.nan_to_num(own.features(throws.change[state]))
            test = signature @ inverse[level]
            gain = np.einsum("psf,prf->psr", signature, test)
            spread = np.einsum("psf,prf->psr", test @ other.covariances[level], test)
            for place, gap in enumerate(throws.gap[state]):
                # as in the map: signatures, not indices, are interpolated between thrown sizes
                weights = size_weights(sizes, throws.sizes[place], gap=gap)
                reached = np.einsum("ns,sr,nr->n", weights, gain[place], weights)
                scatter = np.einsum("ns,sr,nr->n", weights, spread[place], weights)
                index = reached / np.sqrt(np.maximum(scatter, 1e-30))
                pod[place] += probability_of_detection(
                    index, false_alarm_rate=conditions.false_alarm_rate
                )
        seen = smallest_seen(pod / len(near), sizes)
        found.append(np.where(seen <= throws.sizes.max(axis=1), seen, np.nan))
    return np.asarray(np.mean(found, axis=0))


if __name__ == "__main__":
    main()
