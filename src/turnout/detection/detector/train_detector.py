"""Train a detector: throw a population, learn, and calibrate on what was held back."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.files import make_folder
from turnout.core.progress import Pace
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.detection.conditions import FORCE
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import (
    Fold,
    calibrate_alone,
    calibrate_history,
    thresholds_after,
    with_calibration,
)
from turnout.detection.detector.judging import CYCLE
from turnout.detection.detector.knowledge import Calibrated, Knowledge, Setting
from turnout.detection.detector.throw_layout import CLOSING
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import competes, read_set, setting_of, teach
from turnout.detection.detector.training_plan import BLOCK, HISTORY, OBJECT, SOUND, Plan
from turnout.detection.detector.training_sets import (
    Counts,
    after_history,
    learned_kinds,
    throw_plans,
    training_plans,
)
from turnout.detection.drive_quantities import signals_of
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import checked_throws, nominal_amplitude, of_kind
from turnout.panel.load import LoadedPanel
from turnout.study.study import Study
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import running

FOLDS = 8
"""Parts of the switches; thresholds of each come from a detector that learned from the others. Of
few parts each lacks much of what the detector itself knows, and thresholds are too high: from the
same 1,800 sound throws 3.35 with 4 parts and 2.98 with 12, where 2.2 keeps the rate."""
RUNS = 16
"""Of states in a row that the switches of a fold come in, at least."""
LEAST_LEFT = 30
"""Throws of a cause that a fold leaves to learn from; else it leaves all of them."""
DRAWS = 8
"""Uses of each sound throw that thresholds are taken from: with 8 as with 16 they are left open by
chance, 3.16 to 3.28 and 2.96 to 3.17 for one rate in two runs each."""
HISTORY_DRAWS = 2
"""Histories that are drawn for each switch."""
HISTORIES = (5, 20)
"""Sound throws known of a switch that thresholds are taken for, beside none."""
JUDGED, LEARNED = 0.05, 70.0
"""Time to judge a throw, and to learn a switch with a history, by that of a simulated throw [-]."""


def sets_of_kinds() -> tuple[str, ...]:
    """Return the names of the sets of throws with objects of the learned kinds."""
    return tuple(of_kind(OBJECT, kind) for kind in learned_kinds())


LEAST_COUNT = 420
"""Sound throws to ask for: of what is not held back, `LEAST_SOUND` must end."""


def train_detector(
    folder: Path,
    *,
    panel: LoadedPanel | None = None,
    study: Study | None = None,
    counts: Counts | None = None,
    allowances: Allowances | None = None,
    quantity: str = FORCE,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> Knowledge:
    """Train a detector for a panel; interrupted, the same call goes on.

    Parameters
    ----------
    folder : Path
        Keeps the throws.
    panel : LoadedPanel, optional
        In place of the panel of the reference case.
    study : Study, optional
        Population of sound switches and throws, in place of the reference case.
    counts : Counts, optional
        Throws of each kind.
    allowances : Allowances, optional
        Assumed beside the population.
    quantity : str
        What of the drives is judged: "force", and of machines "current" or "power".
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts throws, and histories that thresholds are taken from.
    """
    population = study or reference_study(panel)
    chosen = counts or Counts()
    if chosen.sound < LEAST_COUNT:
        message = (
            f"sound = {chosen.sound}: a part of the sound throws is held back for thresholds; "
            f"give {LEAST_COUNT} at least"
        )
        raise StudyError([message])
    # Both refuse panels that a detector cannot judge, before any throw is made.
    signals_of(population.panel, quantity)
    setting = setting_of(
        population.panel,
        amplitude=nominal_amplitude(population, friction=NOMINAL_FRICTION, quantity=quantity),
        allowances=allowances or Allowances(),
        quantity=quantity,
    )
    make_folder(folder)  # refused where it is none, before throws are planned
    plans = {
        name: plan
        for name, plan in training_plans(population, chosen).items()
        if competes(name, setting)
    }
    with running(workers) as processes:
        return _trained(
            population, plans, setting, folder, processes=processes, pace=pace or Pace()
        )


def _trained(
    population: Study,
    plans: Mapping[str, Plan],
    setting: Setting,
    folder: Path,
    *,
    processes: Workers,
    pace: Pace,
) -> Knowledge:
    """Throw plans, and learn from them."""
    judged = DRAWS * sum(len(plans[name].switch) for name in (SOUND, HISTORY) if name in plans)
    for part in parts_of(setting):
        pace.plan(thresholds_after(0, part), FOLDS, like=JUDGED * judged / FOLDS)
    if HISTORY in plans:
        count = len(np.unique(plans[HISTORY].switch)) * HISTORY_DRAWS
        for history in HISTORIES:
            pace.plan(thresholds_after(history), count, like=LEARNED)
    folders = throw_plans(plans, folder, workers=processes, pace=pace)
    jobs = [partial(_read_set, name, plan, folders[name], setting) for name, plan in plans.items()]
    read = dict(processes.run(jobs, wait=pace.emit))
    sets = {name: read[number] for number, name in enumerate(plans)}
    about = {
        "panel": population.panel.name,
        "panel_hash": population.panel.hash,
        "study": population.name,
        "quantity": setting.quantity,
        "throws": {name: len(item.level) for name, item in sets.items()},
    }
    found = knowledge_of_sets(sets, setting, workers=processes, pace=pace)
    return replace(found, about=about)


def _read_set(name: str, plan: Plan, folder: Path, setting: Setting) -> ThrowSet:
    """Read the throws of a plan, refused where most of them cannot be made."""
    about = {"panel": plan.study.panel.name, "of": f'set "{name}"', "source": "detect train"}
    made = checked_throws(open_batches(folder), **about)
    return read_set(plan, made, setting.layout, setting.quantity)


def knowledge_of_sets(
    sets: Mapping[str, ThrowSet],
    setting: Setting,
    *,
    draws: int = DRAWS,
    history_draws: int = HISTORY_DRAWS,
    histories: tuple[int, ...] = HISTORIES,
    workers: Workers | None = None,
    pace: Pace | None = None,
) -> Knowledge:
    """Learn from all throws; take thresholds from a detector that did not see some of them.

    Parameters
    ----------
    sets : mapping of str to ThrowSet
        "sound", "object", defects, and "history" for repeated throws.
    setting : Setting
        What for.
    draws : int
        Uses of each throw that thresholds are taken from.
    history_draws : int
        Histories that are drawn for each switch.
    histories : tuple of int
        Sound throws known, that thresholds are taken for beside none.
    workers : Workers, optional
        Processes, which take a part of the switches each.
    pace : Pace, optional
        Counts the histories that thresholds are taken from.
    """
    with one_blas_thread():
        # thresholds do not depend on the kind of an object
        weighed = {name: item for name, item in sets.items() if name not in sets_of_kinds()}
        calibrated = _calibrations(
            folds_of(weighed, setting, workers=workers),
            {name: item for name, item in sets.items() if name.startswith(HISTORY)},
            draws=draws,
            history_draws=history_draws,
            histories=histories,
            workers=workers,
            pace=pace,
        )
        return with_calibration(teach(sets, setting), calibrated)


def folds_of(
    sets: Mapping[str, ThrowSet],
    setting: Setting,
    *,
    count: int = FOLDS,
    workers: Workers | None = None,
) -> list[Fold]:
    """Return detectors of a part of the switches each, with the throws of the others.

    Switches that share their sections lie in a row and are held back together. Causes are thrown
    in the first states only; where a fold would leave too few of one, it leaves all: the threshold
    of sound throws hardly depends on the signatures of their own states.

    A switch with a history is held back from the fold that has its number, and learned by the
    others. Were none of them learned, folds would know the sections of a third fewer switches than
    the detector itself, and thresholds after a history would be those of a worse one. Its throws
    count for the thresholds without a history too: 0.5 of 1/1,000 is one state in 2,000.

    Parameters
    ----------
    sets : mapping of str to ThrowSet
        "sound", "object", defects, and "history" for repeated throws.
    setting : Setting
        What for.
    count : int
        Of folds.
    workers : Workers, optional
        Processes, which take a fold each.
    """
    jobs = [partial(_fold_of, sets, setting, number, count) for number in range(count)]
    found = dict((workers or Workers(0)).run(jobs))
    return [found[number] for number in range(count)]


def _fold_of(sets: Mapping[str, ThrowSet], setting: Setting, number: int, count: int) -> Fold:
    """Return one of some folds."""
    run = min(BLOCK, max(1, (int(sets[SOUND].row.max()) + 1) // RUNS))
    seen, held = {}, {}
    for name, item in sets.items():
        if name == HISTORY:
            seen[name] = item.of(item.switch % count != number)
        if name.startswith(HISTORY):
            continue
        state = item.row if name == SOUND else item.partner
        out = state // run % count == number
        few = name != SOUND and np.count_nonzero(~out) < min(LEAST_LEFT, len(out))
        seen[name] = item if few else item.of(~out)
        held[name] = item.of(np.zeros_like(out) if few else out)
    touched = held[OBJECT].of(held[OBJECT].force > 0.0)
    sound, group = held[SOUND], groups_of(held[SOUND], run)
    if HISTORY in sets:
        own = sets[HISTORY].of(sets[HISTORY].switch % count == number)
        own = replace(own, switch=int(sets[SOUND].row.max()) + 1 + own.switch)
        sound, group = sound.with_more(own), np.concatenate([group, own.switch])
    knowledge = teach(seen, setting)
    return Fold(knowledge=knowledge, sound=sound, objects=touched, group=group)


def groups_of(sound: ThrowSet, run: int) -> NDArray[np.intp]:
    """Return which group of alike switches each sound throw is of, shape (n_throws,).

    The run of states where some of what varies is the same in all of it, as sections are; the state
    where nothing is.

    Parameters
    ----------
    sound : ThrowSet
        One throw of each switch.
    run : int
        States in a row that may share sections.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> own = np.random.default_rng(0).random(4)
    >>> inputs = np.column_stack([own, [2.0, 2.0, 3.0, 3.0]])
    >>> groups_of(SimpleNamespace(row=np.arange(4), inputs=inputs), 2).tolist()
    [0, 0, 1, 1]
    >>> groups_of(SimpleNamespace(row=np.arange(4), inputs=inputs[:, :1]), 2).tolist()
    [0, 1, 2, 3]
    """
    runs = sound.row // run
    varied = sound.inputs[:, np.ptp(sound.inputs, axis=0) > 0.0]
    within = [np.ptp(varied[runs == number], axis=0) for number in np.unique(runs)]
    shared = bool((np.max(within, axis=0) == 0.0).any()) if varied.size else False
    return np.asarray(runs if shared else sound.row)


def parts_of(setting: Setting) -> list[str]:
    """Return the parts of a throw that may be recorded, each with thresholds of its own."""
    return [CYCLE, CLOSING] if len(setting.layout.parts) > 1 else [CYCLE]


def _calibrations(
    folds: Sequence[Fold],
    repeated: Mapping[str, ThrowSet],
    *,
    draws: int,
    history_draws: int,
    histories: tuple[int, ...],
    workers: Workers | None,
    pace: Pace | None,
) -> list[Calibrated]:
    """Return what throws that a detector did not see say of it, without and with a history."""
    parts = parts_of(folds[0].knowledge.setting)
    alone = {
        part: calibrate_alone(folds, part=part, draws=draws, workers=workers, pace=pace)
        for part in parts
    }
    calibrated = list(alone.values())
    for number in histories if HISTORY in repeated else ():
        calibrated += calibrate_history(
            folds,
            repeated[HISTORY],
            history=number,
            alone=alone,
            objects=repeated.get(after_history(OBJECT)),
            draws=history_draws,
            workers=workers,
            pace=pace,
        )
    return calibrated
