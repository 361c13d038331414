"""How good the detector is on switches it never saw: ``python -m benchmarks.studies.detector DIR``.

Throws, training and judging go on where they were stopped. A population of switches is thrown with
the seed of the study for training and with another for judging; each test throw gets a discrepancy,
noise, timing, gain and zero of its own. Alarms are counted by switch. Figures come in the order of
`figures_of`, each with the throws it needs; they are printed and kept in
DIR/figures-DIGEST-SEED.json, the detector and its verdicts beside them, under the digest of the
sources of the detector.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector_figures import (
    Judged,
    Uses,
    a90,
    a90_of_places,
    alone_of,
    cause_figures,
    false_alarm_limits,
    false_alarms,
    gap_figures,
    judge_alone,
    judge_with_history,
    measured_by_switch,
    object_figures,
    verdicts_on,
)
from benchmarks.studies.detector_further import (
    ice_ramps,
    known_place_a90,
    missed_shares,
    price_of,
    rates_alone,
    rates_known,
    ratios_alone,
    soft_shares,
    unknown_alone,
    verdict_times,
    year_rates,
)
from benchmarks.studies.detector_other import other_figures, relative_a90
from benchmarks.studies.detector_sets import JUDGED_SEED, SOFT_KINDS, Sizes, Throws, plans_of
from benchmarks.studies.detector_unknown import SEVERE, unknown_figures
from turnout.calibration.load_study import load_study
from turnout.core.files import write_atomic
from turnout.core.progress import Pace, Progress
from turnout.core.sources import digest_of_sources
from turnout.core.threads import one_blas_thread
from turnout.detection.alarm_threshold import RATES
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import Errors, alarms_of, learn_history
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE, LEAST_HISTORY, make_view
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.throw_layout import Layout, means_on
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import ALARM, UNKNOWN
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training import setting_of
from turnout.detection.detector.training_plan import HISTORY, OBJECT, SOUND
from turnout.detection.detector.training_sets import after_history
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import nominal_amplitude
from turnout.study.defects import trained_changes

DETECTOR = (
    "detection/detector",
    *(
        f"detection/{name}.py"
        for name in (
            "alarm_threshold",
            "likelihood",
            "density",
            "triangular",
            "features",
            "population",
            "conditioning",
            "conditions",
            "floor",
            "signal_discrepancy",
            "throws",
        )
    ),
)
"""Sources that a detector and its verdicts depend on, beside those of its throws."""


OF_THE_STUDY = Allowances(timing=0.0, gain=0.0, zero=0.0)
"""Errors of the throws that the goals of the detector come from."""


def main() -> None:
    """Throw, train, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws, the detector and the figures")
    parser.add_argument("--study", type=Path, help="population in place of the reference case")
    for name, value in (("sound", 4000), ("objects", 3000), ("switches", 200)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--seed", type=int, default=JUDGED_SEED, help="of the switches judged")
    parser.add_argument("--only", nargs="*", help="figures wanted; default all that are missing")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--errors-of-the-study",
        action="store_true",
        help="discrepancy and noise alone: onsets, gains and zeros of the sensors are known",
    )
    given = vars(parser.parse_args())
    folder, wanted = given.pop("folder"), given.pop("only")
    source, workers, seed = given.pop("study"), given.pop("workers"), given.pop("seed")
    study = reference_study() if source is None else load_study(source)
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION)
    allowances = OF_THE_STUDY if given.pop("errors_of_the_study") else Allowances()
    setting = setting_of(study.panel, amplitude=amplitude, allowances=allowances)
    plans = plans_of(study, Sizes(**given), seed=seed)
    throws = Throws(plans, folder, setting.layout, workers=workers)
    path, made = detector_file(throws, setting, folder)
    knowledge = Detector.load(path).knowledge
    made = f"{made}-{seed}"
    kept = folder / f"figures-{made}.json"
    said = json.loads(kept.read_text()) if kept.exists() else {}
    with one_blas_thread():
        for name, figure in figures_of(knowledge, throws, folder / f"judged-{made}").items():
            if name in said if wanted is None else name not in wanted:
                continue
            start = process_time()
            said[name] = figure()
            print(json.dumps({name: said[name]}, indent=1))
            print(f"{name}: {process_time() - start:.0f} s of processor time", flush=True)
            write_atomic(kept, json.dumps(said, indent=1).encode())
    if {"other", "alone", "known"} <= set(said):
        reference = {"0": said["alone"]["a90"], "20": said["known"]["a90"]}
        print("a90 of other switches, times that of the reference case, and 90 % limits:")
        print(relative_a90(said["other"], reference, setting.places))


def detector_file(throws: Throws, setting: Setting, folder: Path) -> tuple[Path, str]:
    """Return the detector, trained unless one of these sources is kept, and the digest of these.

    Verdicts and figures are kept under that digest, so that none outlives its detector.
    """
    made = digest_of_sources(DETECTOR)[:8]
    path = folder / f"switch-{made}.detector"
    if not path.exists():
        sets = throws.sets("train")
        counts = {name: len(item.level) for name, item in sets.items()}
        about = {"panel": throws.plans["train"][SOUND].study.panel.name, "throws": counts}
        found = knowledge_of_sets(sets, setting, pace=Pace(_progress))
        Detector(replace(found, about=about)).save(path)
    return path, made


def _progress(state: Progress) -> None:
    if state.done % 20 == 0:
        print(f"{state.stage}: {state.done} of {state.total}", flush=True)


def figures_of(knowledge: Knowledge, throws: Throws, kept: Path) -> dict[str, Callable[[], object]]:
    """Return the function that computes each figure, by name, with the throws that it needs."""

    def alone() -> dict[str, ThrowSet]:
        return alone_of(throws.sets("test"))

    def case(name: str) -> ThrowSet:
        return throws.sets("cases", name)[name]

    def sound() -> ThrowSet:
        return throws.sets("test", HISTORY)[HISTORY]

    others = [name for name in throws.plans["cases"] if name.startswith("other")]
    return {
        "rates alone": lambda: rates_alone(
            knowledge, sound(), ratios_alone(knowledge, sound(), draws=7)
        ),
        "known": lambda: known_figures(knowledge, throws.sets("test"), kept),
        "narrow": lambda: narrow_figures(knowledge, throws.sets("narrow"), kept),
        "other": lambda: other_figures(
            knowledge, [throws.forces("cases", name) for name in others]
        ),
        "robustness": lambda: robustness(knowledge, sound(), alone()[OBJECT]),
        "robustness known": lambda: robustness_known(
            knowledge, sound(), throws.sets("test", after_history(OBJECT))[after_history(OBJECT)]
        ),
        "ice": lambda: [vars_of(item) for item in ice_ramps(knowledge, case("ice"))],
        "alone": lambda: verdict_figures(knowledge, judge_alone(knowledge, alone(), draws=1)),
        "known place": lambda: known_place_a90(knowledge, sound(), alone()[OBJECT]),
        "unknown": lambda: unknown_alone(knowledge, alone() | throws.sets("test", HISTORY)),
        "time": lambda: {kind: verdict_times(knowledge, alone()[kind]) for kind in (SOUND, OBJECT)},
        "year": lambda: year_rates(knowledge, case("year"), kept / "year"),
        "soft": lambda: soft_shares(knowledge, case("soft"), SOFT_KINDS),
        "price": lambda: price_of(
            knowledge,
            throws.sets("train"),
            alone() | throws.sets("test", HISTORY),
            discrepancy=0.08,
        ),
    }


def known_figures(knowledge: Knowledge, test: dict[str, ThrowSet], kept: Path) -> dict[str, object]:
    """Return figures of verdicts after a history, and rates of alarms of many more uses."""
    judged, ratios, unknown = judge_with_history(knowledge, test, kept / "known")
    return verdict_figures(knowledge, judged) | {
        "rates": rates_known(knowledge, ratios),
        "unknown": unknown_figures(unknown),
    }


def narrow_figures(
    knowledge: Knowledge, narrow: dict[str, ThrowSet], kept: Path
) -> dict[str, object]:
    """Return a90 and false alarms in the narrow population [m].

    At the thresholds of the detector, which it has from its own population, and at those that
    1/1,000 of the sound throws judged here exceed, as in the study that the goals come from.
    """
    places = knowledge.setting.places
    alone = judge_alone(knowledge, alone_of(narrow), draws=NARROW_USES.verdicts)
    known, ratios, _ = judge_with_history(knowledge, narrow, kept / "narrow", uses=NARROW_USES)
    first = ratios_alone(knowledge, narrow[HISTORY], draws=3)
    sound = {"alone": first, "known": np.concatenate([item[SOUND] for item in ratios])}
    found: dict[str, object] = {
        "false alarms": rates_alone(knowledge, narrow[HISTORY], first),
        "false alarms known": rates_known(knowledge, ratios, uses=NARROW_USES),
    }
    for name, judged in (("alone", alone), ("known", known)):
        level = float(np.quantile(sound[name], 1.0 - RATES[0]))
        found |= {
            name: a90_of_places(judged, places),
            f"{name}, at 1/1,000 of these": a90_of_places(judged, places, threshold=level),
            f"{name}, threshold of these": level,
        }
    return found


NARROW_USES = Uses(verdicts=2, sound=20, causes=0, unknown=False)
"""How often each throw of the narrow population is used, with other errors each time."""


def vars_of(item: object) -> dict[str, float]:
    """Return the fields of a record with slots."""
    return {name: getattr(item, name) for name in item.__slots__}  # type: ignore[attr-defined]


def verdict_figures(knowledge: Knowledge, judged: Judged) -> dict[str, object]:
    """Return figures of verdicts.

    Without a history an adjusted switch is one of the population, and counts as no cause.
    """
    places, gaps = knowledge.setting.places, knowledge.setting.gaps
    kinds = [kind for kind in ("sound", "object", *trained_changes()) if judged.of(kind).size]
    alone = max(item.history for item in judged.verdict) < LEAST_HISTORY
    named = [kind for kind in kinds if not (alone and kind == "adjustment")]
    history = max(item.history for item in judged.verdict)
    calibrated = knowledge.calibration(part=CYCLE, history=history)
    assert calibrated is not None
    rare = calibrated.thresholds["0.0001"]
    return {
        "false alarms": {kind: false_alarms(judged, kind) for kind in kinds if kind != "object"},
        "a90": a90_of_places(judged, places),
        "a90 at 1/10,000": a90_of_places(judged, places, threshold=rare),
        "missed": missed_shares(judged),
        "gaps": {kind: gap_figures(judged, kind, gaps) for kind in ("sound", "object")},
        "objects": object_figures(judged, places),
        "causes": cause_figures(judged, named),
        "severe causes": cause_figures(judged, named, least=SEVERE),
    }


Floats = NDArray[np.float64]

CASES: dict[str, dict[str, float | str]] = {
    "as assumed": {},
    "onsets 10 ms": {"timing": 10e-3},
    "noise 60 N": {"noise": 60.0},
    "sensor gains 3 %": {"gain": 0.03},
    "sensor zeros 100 N": {"zero": 100.0},
    "discrepancy 8 %": {"discrepancy": 0.08},
    "discrepancy of each throw alone": {"fixed_share": 0.0},
    "discrepancy of each switch alone": {"fixed_share": 1.0},
    "discrepancy over 0.2 s": {"correlation_time": 0.2},
    "discrepancy over 1 s": {"correlation_time": 1.0},
    "smooth discrepancy": {"kernel": "matern 3/2"},
}
"""Changes of what test throws are drawn with."""

KERNELS: dict[str, Callable[[Floats], Floats]] = {
    "noise 20 N, correlated over 0.05 s": lambda lag: 20.0**2 * np.exp(-lag / 0.05),
    "noise 60 N, correlated over 0.05 s": lambda lag: 60.0**2 * np.exp(-lag / 0.05),
    "hum of 50 N at 16.7 Hz": lambda lag: 0.5 * 50.0**2 * np.cos(2.0 * np.pi * 16.7 * lag),
    "zeros that wander by 50 N in 2 s": lambda lag: 50.0**2 * np.exp(-lag / 2.0),
}
"""Covariance of what the samples of each drive hold besides, by the time between them [N^2]."""
FINE_RATE = 250.0
"""At which these are averaged over windows [Hz]."""


def besides(layout: Layout, kernel: Callable[[Floats], Floats]) -> Floats:
    """Return the covariance of features due to further errors of each drive's samples [N^2]."""
    time, means = means_on(layout, rate=FINE_RATE)
    one = means @ kernel(np.abs(time[:, np.newaxis] - time)) @ means.T
    return np.asarray(np.kron(np.eye(len(layout.drives)), one))


def robustness(
    knowledge: Knowledge, sound: ThrowSet, objects: ThrowSet, *, draws: int = 2
) -> dict[str, dict[str, float]]:
    """Return false alarms without a history at 1/1,000, and the share of objects seen.

    Parameters
    ----------
    knowledge : Knowledge
        As it is: it does not know that errors differ.
    sound, objects : ThrowSet
        Of switches that it never saw.
    draws : int
        Uses of each sound throw.
    """
    view = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    threshold = calibrated.thresholds["0.001"]
    held = objects.of(objects.force > TOUCH_FORCE)
    middle = np.abs(held.x - knowledge.setting.places["sleeper 6"]) < 0.3
    found = {}
    for name in (*CASES, *KERNELS):
        errors = errors_of_case(knowledge, name, 41, len(found))
        alarms = np.array(
            [alarms_of(view, measured_by_switch(sound, errors)) > threshold for _ in range(draws)]
        )
        seen = alarms_of(view, measured_by_switch(held, errors)) > threshold
        by_switch = [alarms[:, sound.switch == own].ravel() for own in np.unique(sound.switch)]
        found[name] = false_alarm_limits(by_switch) | {
            "seen": float(seen.mean()),
            "a90 at sleeper 6": a90(held.size[middle], seen[middle]),
        }
    return found


def errors_of_case(knowledge: Knowledge, name: str, *seed: int) -> Errors:
    """Return a source of the errors of one of `CASES` or `KERNELS`."""
    usual: Allowances = knowledge.setting.allowances
    drawn = knowledge.errors(replace(usual, **CASES.get(name, {})))  # type: ignore[arg-type]
    if name in KERNELS:
        more = besides(knowledge.layout, KERNELS[name])
        drawn = replace(drawn, changing=drawn.changing + more)
    return Errors(drawn, part=knowledge.layout.part, rng=np.random.default_rng(seed))


def robustness_known(
    knowledge: Knowledge,
    sound: ThrowSet,
    objects: ThrowSet,
    *,
    history: int = 20,
    switches: int = 10,
    draws: int = 10,
) -> dict[str, dict[str, float]]:
    """Return verdicts after a history whose throws have these errors too.

    Parameters
    ----------
    knowledge : Knowledge
        As it is: what it knows of the errors it has from the history.
    sound, objects : ThrowSet
        Of switches that it never saw, each thrown as often.
    history : int
        Throws known.
    switches : int
        The first of them are judged.
    draws : int
        Uses of each later sound throw.

    Returns
    -------
    dict
        For each case throws, alarms and unknown deviations of sound throws, share of touched
        objects that are called, median and largest scatter.
    """
    population = make_view(knowledge)
    first = int(np.bincount(sound.switch).max())
    found = {}
    for name in (*CASES, *KERNELS):
        said: dict[str, list[str]] = {"sound": [], "object": []}
        scatter = []
        for switch in range(switches):
            errors = errors_of_case(knowledge, name, 43, len(found), switch)
            own, fixed = sound.of(sound.switch == switch), errors.of_switches(1)
            known, later = (own.of((own.row % first < history) == early) for early in (True, False))
            rows = known.features + fixed + errors.of_throws(known.rates)
            expected = learn_history(knowledge, rows, view=population)
            scatter.append(expected.scatter)
            view = make_view(knowledge, known=expected)
            held = objects.of((objects.switch == switch) & (objects.force > TOUCH_FORCE))
            for kind, throws, uses in (("sound", later, draws), ("object", held, 1)):
                drawn = [throws.features + errors.of_throws(throws.rates) for _ in range(uses)]
                verdicts = verdicts_on(knowledge, view, fixed + np.concatenate(drawn), rate=1e-3)
                said[kind] += [item.status for item in verdicts]
        found[name] = {
            "throws": float(len(said["sound"])),
            "alarms": float(said["sound"].count(ALARM)),
            "unknown": float(said["sound"].count(UNKNOWN)),
            "objects": float(len(said["object"])),
            "seen": said["object"].count(ALARM) / len(said["object"]),
            "scatter": float(np.median(scatter)),
            "largest scatter": max(scatter),
        }
    return found


if __name__ == "__main__":
    main()
