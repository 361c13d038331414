"""Expected time and disk space of a sweep, from a few throws of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from turnout.study.study import Study
from turnout.study.sweep.batch import batch_variables, plan_batches
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.row import COMPLETE, throw_scenarios

TRIALS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """Estimates of a sweep from trial throws.

    Attributes
    ----------
    trials : int
        Throws that were timed.
    throw_time : float
        Of one of them in the mean, with all that a scenario costs besides the solver [s].
    size : float
        Compressed size of a stored throw [bytes].
    head : float
        Of a file with several of them, besides [bytes].
    faults : tuple of str
        Why trials did not come to an end; empty where all did.
    """

    trials: int
    throw_time: float
    size: float
    head: float
    faults: tuple[str, ...]

    def duration(self, throws: int, *, workers: int) -> float:
        """Return the time that so many throws take with so many workers [s].

        Examples
        --------
        >>> found = Forecast(trials=3, throw_time=0.03, size=1e3, head=0.0, faults=())
        >>> found.duration(1000, workers=2)
        15.0
        """
        return throws * self.throw_time / workers

    def disk(self, study: Study) -> float:
        """Return the disk space of a whole study, with the heads of its files [bytes]."""
        return study.count * self.size + len(plan_batches(study)) * self.head


def trial_scenarios(study: Study, count: int) -> list[int]:
    """Return numbers of scenarios spread over a study.

    Examples
    --------
    >>> from turnout.calibration.load_study import load_study
    >>> trial_scenarios(load_study("sleeper-6"), 3)
    [0, 5, 10]
    """
    spread = np.linspace(0, study.count - 1, min(count, study.count))
    return [int(index) for index in np.unique(spread.round())]


def forecast(
    study: Study, *, trials: int = TRIALS, report: Callable[[int, int], None] | None = None
) -> Forecast:
    """Throw a few scenarios of a study and measure the cost of each.

    The first is thrown twice: what is built once for all throws, and compiled, is not counted.

    Parameters
    ----------
    study : Study
        Study to be thrown.
    trials : int
        Throws, spread over the study.
    report : callable, optional
        Called with throws done and throws in all.
    """
    chosen = trial_scenarios(study, trials)
    throw_scenarios(study, [study.scenario(chosen[0])])
    rows, spent = [], 0.0
    for number, index in enumerate(chosen):
        if report is not None:
            report(number + 1, len(chosen) + 1)
        began = time.perf_counter()
        (row,) = throw_scenarios(study, [study.scenario(index)])
        spent += time.perf_counter() - began
        rows.append(row)
    # The head of a file is there once, so the size follows from the second and later throws.
    whole, one = (len(file_bytes(batch_variables(study, part))) for part in (rows, rows[:1]))
    size = (whole - one) / (len(rows) - 1) if len(rows) > 1 else float(whole)
    head = max(one - size, 0.0)
    faults = [f"{row.scenario.name}: {row.reason}" for row in rows if row.outcome != COMPLETE]
    return Forecast(
        trials=len(chosen),
        throw_time=spent / len(chosen),
        size=size,
        head=head,
        faults=tuple(faults),
    )
