"""How well causes that a detector does not know differ from sound throws: each is left out in turn.

A cause is left out by leaving out its signatures; the score is the share of sound throws that fit
their best remaining explanation worse. Without a history an adjustment is no deviation, since
over-travels of the population differ by as much. A cause counts as severe where it changes a drive
force by a tenth of its amplitude.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.metrics import auroc
from turnout.detection.detector.calibrating import AT_ONCE
from turnout.detection.detector.judging import View, evidence_of, unexplained
from turnout.detection.detector.knowledge import Calibrated, Knowledge
from turnout.detection.detector.throw_verdict import share_worse
from turnout.detection.detector.training_plan import OBJECT, SOUND

Floats = NDArray[np.float64]
Scores = dict[str, list[float]]

SEVERE = 0.1
"""Change of a drive force that a cause must make to be counted as severe, of its amplitude [-]."""


def left_out_scores(
    knowledge: Knowledge,
    view: View,
    calibrated: Calibrated,
    throws: Mapping[str, tuple[Floats, Floats]],
) -> Scores:
    """Return how badly throws fit when a cause is left out, as - log10 of `share_worse`.

    Parameters
    ----------
    knowledge : Knowledge
        With the causes.
    view : View
        Of the switch.
    calibrated : Calibrated
        For its history.
    throws : mapping of str to (ndarray, ndarray)
        By kind: measured features [N], and how much the cause changed of each (`changes_of`) [-].

    Returns
    -------
    dict
        For each cause "CAUSE", "CAUSE changes" and "CAUSE sound".
    """
    found: Scores = {}
    for name in (OBJECT, *knowledge.causes):
        if name not in throws:
            continue
        own = range(view.objects) if name == OBJECT else [view.kinds.index(name)]
        for kind, key in ((name, name), (SOUND, f"{name} sound")):
            found[key] = _scores(view, calibrated, throws[kind][0], own)
        found[f"{name} changes"] = throws[name][1].tolist()
    return found


def _scores(
    view: View, calibrated: Calibrated, features: Floats, without: Sequence[int]
) -> list[float]:
    found: list[float] = []
    for first in range(0, len(features), AT_ONCE):
        evidence = evidence_of(view, features[first : first + AT_ONCE])
        left = unexplained(view, evidence, without=without)
        share = share_worse(*left, calibrated=calibrated)
        found += (-np.log10(np.maximum(share, 1e-300))).tolist()
    return found


def unknown_figures(records: Sequence[Scores]) -> dict[str, dict[str, float]]:
    """Return the area under the curve of each cause that was left out, of all and of severe ones.

    Parameters
    ----------
    records : sequence of dict
        From `left_out_scores`, of all switches.
    """
    names = {
        name.removesuffix(" changes") for item in records for name in item if " changes" in name
    }
    found = {}
    for name in sorted(names):
        own, changes, sound = (
            np.array([value for item in records for value in item.get(key, [])])
            for key in (name, f"{name} changes", f"{name} sound")
        )
        severe = own[changes >= SEVERE]
        found[name] = {
            "all": auroc(own, sound),
            "severe": auroc(severe, sound) if severe.size else float("nan"),
            "severe throws": float(severe.size),
        }
    return found
