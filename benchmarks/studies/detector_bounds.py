"""Gain that is left to any detector: by a known place, and by known dry chairs.

    python -m benchmarks.studies.detector_bounds DIR --seed 650000 --switches 40

DIR is that of `benchmarks.studies.detector`, whose throws and detector are read, or made where they
are not there.

The same ratio is judged three times on the same throws with drawn errors: at its own threshold, at
the one that 1 in 1,000 of the judged sound throws exceeds, and with the place known at such a
threshold of that place. The second and the third raise as many false alarms, so their difference is
what not knowing the place costs; that of the first and the second is the safety of the threshold.
Intervals are over switches drawn with replacement.

Severe dry chairs are found by a detector that never learned them, and by one that has their
signatures: no detector that lacks them can be expected to do better than that.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.metrics import auroc
from benchmarks.studies.detector import detector_file
from benchmarks.studies.detector_figures import (
    alone_of,
    changes_of,
    drawn_errors,
    weighted_a90,
)
from benchmarks.studies.detector_page import KNOWN_PLACE, heads, row
from benchmarks.studies.detector_sets import JUDGED_SEED, Sizes, Throws, plans_of
from benchmarks.studies.detector_unknown import SEVERE
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import AT_ONCE, learn_history
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import (
    CYCLE,
    View,
    evidence_of,
    make_view,
    ratios_of,
    support_of,
    unexplained,
)
from turnout.detection.detector.knowledge import Calibrated, Knowledge
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import share_worse
from turnout.detection.detector.training import setting_of
from turnout.detection.detector.training_plan import HISTORY, LARGEST, OBJECT, SOUND
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import nominal_amplitude

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

RATE = 1e-3
USES = {SOUND: 7, OBJECT: 4, "dry chairs": 4}
"""Of each throw, with other errors each time."""
RESAMPLES = 400
SEED = 51


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """Of throws of a kind with drawn errors.

    Attributes
    ----------
    switch : ndarray of int, shape (n,)
        Of each.
    x, size, change : ndarray, shape (n,)
        Of the object [m], [m], and the largest change of a force in shares of its amplitude [-].
    alarm, dry, support, left : ndarray, shape (n,)
        Log ratio of the alarm; of dry chairs; what speaks for them; how badly the throw fits when
        they are left out, as - log10 of the share of sound throws that fit worse [-].
    place : ndarray, shape (n_places, n)
        Log ratio of an object at each place against a sound switch [-].
    """

    switch: Ints
    x: Floats
    size: Floats
    change: Floats
    alarm: Floats
    dry: Floats
    support: Floats
    left: Floats
    place: Floats


def main() -> None:
    """Judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="that of benchmarks.studies.detector")
    parser.add_argument("--seed", type=int, default=JUDGED_SEED, help="of the switches judged")
    for name, value in (("sound", 4000), ("objects", 3000), ("switches", 200)):
        parser.add_argument(f"--{name}", type=int, default=value)
    given = parser.parse_args()
    study = reference_study()
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION)
    setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
    sizes = Sizes(sound=given.sound, objects=given.objects, switches=given.switches)
    throws = Throws(plans_of(study, sizes, seed=given.seed), given.folder, setting.layout)
    path, _ = detector_file(throws, setting, given.folder)
    knowledge = Detector.load(path).knowledge
    with one_blas_thread():
        for label, said in (
            ("no history", said_alone(knowledge, throws.sets("test"))),
            ("20 throws known", said_known(knowledge, throws.sets("test"))),
        ):
            history = 0 if label == "no history" else KNOWN
            calibrated = knowledge.calibration(part=CYCLE, history=history)
            assert calibrated is not None
            print(f"\n{label}:\n")
            print("\n".join(place_table(knowledge, said, calibrated)))
            print(json.dumps(dry_chairs(said)))


KNOWN = 20


def said_of(
    view: View, calibrated: Calibrated, features: Floats, throws: ThrowSet, change: Floats
) -> Said:
    """Judge throws with drawn errors."""
    dry = view.kinds.index("dry chairs")
    parts: list[list[Floats]] = []
    for first in range(0, len(features), AT_ONCE):
        evidence = evidence_of(view, features[first : first + AT_ONCE])
        ratios = ratios_of(view, evidence)
        _, irregular = unexplained(view, evidence)
        left = share_worse(*unexplained(view, evidence, without=[dry]), calibrated=calibrated)
        parts.append([
            ratios.alarm,
            ratios.cause[dry - view.objects],
            support_of(view, ratios, irregular)[dry - view.objects],
            -np.log10(np.maximum(left, 1e-300)),
            evidence.kind[: view.objects] - evidence.sound,
        ])  # fmt: skip
    alarm, own, support, left, place = (
        np.concatenate(item, axis=-1) for item in zip(*parts, strict=True)
    )
    return Said(
        switch=throws.switch,
        x=throws.x,
        size=throws.size,
        change=change,
        alarm=alarm,
        dry=own,
        support=support,
        left=left,
        place=place,
    )


def joined(parts: list[Said]) -> Said:
    """Return all throws of some records."""
    return Said(**{
        name: np.concatenate([getattr(item, name) for item in parts], axis=-1)
        for name in Said.__slots__
    })  # fmt: skip


def _judged(sets: Mapping[str, ThrowSet]) -> dict[str, ThrowSet]:
    """Return the throws by kind; objects that are not touched are left out."""
    found = {name: item for name, item in alone_of(sets).items() if name in USES}
    return found | {OBJECT: found[OBJECT].of(found[OBJECT].force > TOUCH_FORCE)}


def said_alone(knowledge: Knowledge, sets: Mapping[str, ThrowSet]) -> dict[str, Said]:
    """Return verdicts on throws without a history, all sound throws of the switches included."""
    view, errors = make_view(knowledge), drawn_errors(knowledge, SEED)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    found = {}
    for kind, throws in (_judged(sets) | {SOUND: sets[HISTORY]}).items():
        change = changes_of(throws, sets[HISTORY], knowledge)
        several = []
        for _ in range(USES[kind]):
            fixed = errors.of_switches(int(throws.switch.max()) + 1)[throws.switch]
            features = throws.features + fixed + errors.of_throws(throws.rates)
            several.append(said_of(view, calibrated, features, throws, change))
        found[kind] = joined(several)
    return found


def said_known(knowledge: Knowledge, sets: Mapping[str, ThrowSet]) -> dict[str, Said]:
    """Return verdicts on throws after a history of 20."""
    population, sound = make_view(knowledge), sets[HISTORY]
    calibrated = knowledge.calibration(part=CYCLE, history=KNOWN)
    assert calibrated is not None
    first = int(np.bincount(sound.switch).max())
    several: dict[str, list[Said]] = {kind: [] for kind in USES}
    for switch in np.unique(sound.switch):
        errors = drawn_errors(knowledge, SEED, int(switch))
        own, fixed = sound.of(sound.switch == switch), errors.of_switches(1)
        known = own.of(own.row % first < KNOWN)
        learned = known.features + fixed + errors.of_throws(known.rates)
        view = make_view(knowledge, known=learn_history(knowledge, learned, view=population))
        for kind, throws in _judged(sets).items():
            mine = throws.of(throws.switch == switch)
            if not len(mine.row):
                continue
            change = changes_of(mine, own, knowledge)
            for _ in range(USES[kind] * (MORE_SOUND if kind == SOUND else 1)):
                features = mine.features + fixed + errors.of_throws(mine.rates)
                several[kind].append(said_of(view, calibrated, features, mine, change))
    return {kind: joined(items) for kind, items in several.items()}


MORE_SOUND = 8
"""Times as many uses of the few sound throws that follow a history."""


def place_table(
    knowledge: Knowledge, said: Mapping[str, Said], calibrated: Calibrated
) -> list[str]:
    """Return a90 by place three times, and the cost of place and threshold."""
    sound, objects = said[SOUND], said[OBJECT]
    places = knowledge.setting.places
    x = np.array(list(places.values()))
    near = np.abs(objects.x[:, np.newaxis] - x).argmin(axis=1)
    own = float(calibrated.thresholds[f"{RATE:g}"])
    equal = float(np.quantile(sound.alarm, 1.0 - RATE))
    of_place = np.quantile(sound.place, 1.0 - RATE, axis=1)
    seen = {
        f"own threshold, {own:.1f}": objects.alarm > own,
        f"at 1/1,000, {equal:.1f}": objects.alarm > equal,
        "place known, at 1/1,000": objects.place[near, np.arange(len(near))] > of_place[near],
    }
    numbers, group = np.unique(objects.switch, return_inverse=True)
    rng = np.random.default_rng(SEED)
    share = [1.0 / numbers.size] * numbers.size
    drawn = np.vstack([
        np.ones(numbers.size), rng.multinomial(numbers.size, share, RESAMPLES)
    ])[:, group]  # fmt: skip
    sizes = {
        name: np.array([
            weighted_a90(objects.size[near == at], hit[near == at], drawn[:, near == at])
            for at in range(len(x))
        ]).clip(max=LARGEST)
        for name, hit in seen.items()
    }  # fmt: skip
    lines = heads(list(places)) + [row(name, item[:, 0].tolist()) for name, item in sizes.items()]
    first, second, third = sizes.values()
    alone = knowledge.calibration(part=CYCLE, history=0) is calibrated
    bound = 1e-3 * np.array(KNOWN_PLACE["alone" if alone else "known"])[:, np.newaxis]
    false = 1e3 * float((sound.alarm > own).mean())
    lines += [
        f"- false alarms at the own threshold: {false:.2f}/1,000 of {sound.alarm.size:,} uses",
        _over("not knowing the place costs, at equal false alarms", second - third),
        _over("the own threshold costs over one at 1/1,000", first - second),
        _over("own threshold over the bound of known places", first - bound),
        _over("place known over that bound, of other states", third - bound),
    ]
    return lines


def _over(label: str, differences: Floats) -> str:
    """Return median and worst of the places with 95 % intervals over switches [mm]."""
    middle = 1e3 * np.median(differences, axis=0)
    worst = 1e3 * differences.max(axis=0)
    shown = [
        f"{values[0]:.2f} ({np.quantile(values[1:], 0.025):.2f} to "
        f"{np.quantile(values[1:], 0.975):.2f})"
        for values in (middle, worst)
    ]
    return f"- {label}: median {shown[0]}, worst {shown[1]} mm"


def dry_chairs(said: Mapping[str, Said]) -> dict[str, float]:
    """Return the area under the curve of severe dry chairs, left out and with signatures."""
    dry, sound = said["dry chairs"], said[SOUND]
    severe = dry.change >= SEVERE
    found = {
        name: auroc(getattr(dry, field)[severe], getattr(sound, field))
        for name, field in (
            ("left out", "left"),
            ("with signatures, ratio", "dry"),
            ("with signatures, support", "support"),
        )
    }
    rng = np.random.default_rng(SEED)
    switches = np.unique(dry.switch[severe])
    rows = [np.flatnonzero(severe & (dry.switch == switch)) for switch in switches]
    several = []
    for _ in range(RESAMPLES // 4):
        drawn = np.concatenate([rows[at] for at in rng.integers(0, len(rows), len(rows))])
        several.append(auroc(dry.left[drawn], sound.left))
    low, high = np.quantile(several, [0.025, 0.975])
    changes = {"median change of severe ones": median(dry.change[severe].tolist())}
    limits = {"left out, from": float(low), "left out, to": float(high)}
    return {name: round(value, 3) for name, value in (found | limits | changes).items()} | {
        "severe throws": float(severe.sum() / USES["dry chairs"])
    }


if __name__ == "__main__":
    main()
