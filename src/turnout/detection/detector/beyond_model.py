r"""Starts and speeds beyond the model of a detector, at which objects are not judged.

A switch that was not pressed home, or is slower than its panel's schedule, differs from every throw
that was learned from. An object beside that is not seen, and what is seen may be taken for one.

- The start is beyond the model where the forces before the first onset, :math:`f`, are further from
  sound throws at every friction level :math:`c` than one start in :math:`10^6` of the model,
  :math:`\min_c (f - m_c)^T C_c^{-1} (f - m_c) > \chi^2_{1 - 10^{-6}}`. The covariance :math:`C_c`
  holds the population, or what a history leaves of it, and the assumed errors.
- The speed is that by which sound throws, stretched in time about the onset of each movement,
  explain the throw best: :math:`\hat\varepsilon = \arg\max_\varepsilon p_0(y; m_\varepsilon)`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from turnout.detection.density import log_density
from turnout.detection.detector.align_onsets import inverse_root, peak
from turnout.detection.detector.judging import SPEED, View
from turnout.detection.detector.throw_layout import Layout, stretched
from turnout.detection.detector.throw_verdict import (
    CAUSE,
    FAULT_ADVICE,
    NOT_SUPERVISED,
    OBJECTS,
    SOUND,
    START_ADVICE,
    Verdict,
    advice_on,
)
from turnout.detection.likelihood import Evidence, log_sum
from turnout.study.defects import DEFECTS

Floats = NDArray[np.float64]

SLOWER = np.linspace(-0.2, 0.2, 81)
"""Shares by which movements are tried to take longer [-]."""
LEAST_SLOWER = 0.02
"""Share of speed beyond which objects are not judged; with its error, from 1 % found on [-]."""
SPEED_ERROR = 0.01
"""Error of that share as it is found, 95 % of throws with and without an object [-]."""
SURE = float(np.log(1e3))
"""Log likelihood ratio to the known speed from which on another one counts [-]."""
RARE_START = 1e-6
"""Share of starts of the model that are further off [-]."""
UNLOADED_SHARE = 0.25
"""Share of the usual force below which a drive starts unloaded [-]."""


class KnownBounds:
    """Starts and speeds that throws of a view are known for.

    Parameters
    ----------
    view : View
        That throws are judged with.
    layout : Layout
        Of all features.
    starts : bool
        Whether forces are judged: machines at rest draw no current.
    """

    def __init__(self, view: View, layout: Layout, *, starts: bool) -> None:
        self._view, self._drives = view, layout.drives
        self._scale = np.array([[centre.log_scale] for centre in view.centres])
        self._stretch = np.array(
            [_stretch(centre.root, centre.mean, view, layout) for centre in view.centres]
        )
        self._square = np.square(self._stretch).sum(axis=2)
        part = layout.part[view.features]
        before = layout.before_onset[view.features] & (part == part.min())
        self._rest = np.flatnonzero(before) if starts else np.zeros(0, dtype=np.intp)
        self._drive = layout.drive[view.features][self._rest]
        self._roots = np.array([inverse_root(item, self._rest)[0] for item in view.centres])
        self._starts = np.array([centre.mean[self._rest] for centre in view.centres])
        self._farthest = 2.0 * float(gammainccinv(0.5 * max(self._rest.size, 1), RARE_START))

    def checked(
        self, verdicts: Sequence[Verdict], features: Floats, evidence: Evidence
    ) -> list[Verdict]:
        """Return verdicts, without a finding about objects where start or speed is not known.

        Parameters
        ----------
        verdicts : sequence of Verdict
            Of throws.
        features : ndarray, shape (n_throws, all features)
            Of these [N].
        evidence : Evidence
            Of these.
        """
        found = []
        for number, verdict in enumerate(verdicts):
            start, speed = "", ""
            if verdict.status != CAUSE:
                start = self.start(features[number, self._view.features])
            if not start and verdict.status != SOUND:
                speed = _speed(verdict, *self.speed(evidence.of_throw(number)))
            if start:
                verdict = _without_objects(verdict, start, START_ADVICE)
            elif speed:
                advice = advice_on(verdict.cause, FAULT_ADVICE[SPEED])
                said = _without_objects(verdict, speed, f"{advice}; {NOT_SUPERVISED}")
                kept = {name: odds for name, odds in verdict.odds.items() if _is_timing(name)}
                verdict = replace(said, odds=kept)
            found.append(verdict)
        return found

    def speed(self, evidence: Evidence) -> tuple[float, float]:
        """Return by which share one throw takes longer, and the log ratio to none [-]."""
        along = (self._stretch @ evidence.white.astype(np.float32))[..., 0]
        square = evidence.own + self._square - 2.0 * along
        logs = log_sum(self._scale + log_density(square, size=self._stretch.shape[2]))
        return peak(SLOWER, logs)[0], float(logs.max() - evidence.sound[0])

    def start(self, own: Floats) -> str:
        """Return how the start of a throw is beyond the model, by its features [N]; else empty."""
        force = own[self._rest]
        off = np.einsum("kij,kj->ki", self._roots, force - self._starts)
        if not force.size or np.square(off).sum(axis=1).min() < self._farthest:
            return ""
        usual, spread = self._view.usual[:, self._rest]
        kilo, light = [], True
        for number, name in enumerate(self._drives):
            rows = self._drive == number
            here, middle, width = (float(item[rows].mean()) for item in (force, usual, spread))
            low, high = middle - 1.96 * width, middle + 1.96 * width
            usual_range = f"usual {1e-3 * low:z.2f} to {1e-3 * high:z.2f} kN"
            kilo.append(f"drive {name} at {1e-3 * here:z.2f} kN ({usual_range})")
            light = light and abs(here) < UNLOADED_SHARE * abs(middle)
        how = "unloaded, unlike" if light else "unlike"
        return f"the throw starts {how} all that the detector learned from: {', '.join(kilo)}"


def _stretch(root: Floats, mean: Floats, view: View, layout: Layout) -> NDArray[np.float32]:
    """Return the change of sound throws of a level by speed, whitened, shape (n_speeds, n)."""
    whole = np.zeros((len(SLOWER), layout.size))
    whole[:, view.features] = mean
    moved = stretched(whole, layout, 1.0 / (1.0 + SLOWER) - 1.0)
    return ((moved[:, view.features] - mean) @ root.T).astype(np.float32)


def _speed(verdict: Verdict, share: float, gain: float) -> str:
    """Return how fast a throw is beyond the model; empty where another cause explains it better."""
    others = max(odds for name, odds in verdict.odds.items() if not _is_timing(name))
    sure = abs(share) >= LEAST_SLOWER - SPEED_ERROR and gain >= SURE
    off = sure and (verdict.cause == SPEED or np.exp(min(gain, 700.0)) > others)
    slowed = _slowed(verdict.cause)
    if not off and not slowed:
        return ""
    if slowed == 1:  # the share found is that of all drives together
        return "a drive is slower than the detector knows"
    more = "or more " if abs(share) >= SLOWER[-1] else ""
    size = f"{100.0 * abs(share):.1f} % {more}" if sure else ""
    way = "faster" if sure and share < 0.0 else "slower"
    return f"the switch is {size}{way} than the detector knows"


def _slowed(cause: str) -> int:
    """Return how many drives a cause slows, 0 or those of `Defect.slows`."""
    return DEFECTS[cause].slows if cause in DEFECTS else 0


def _is_timing(cause: str) -> bool:
    """Return True if a drive or all take longer by a cause than in any throw with an object."""
    return cause == SPEED or _slowed(cause) > 0


def _without_objects(verdict: Verdict, reason: str, advice: str) -> Verdict:
    """Return a verdict that says why neither objects nor gaps can be judged."""
    return Verdict(
        name=verdict.name,
        status=OBJECTS,
        reason=reason,
        part=verdict.part,
        history=verdict.history,
        fit=verdict.fit,
        peaks=verdict.peaks,
        advice=advice,
    )
