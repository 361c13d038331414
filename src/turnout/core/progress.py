"""Progress of many throws, whoever makes them."""

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a run of many throws.

    Attributes
    ----------
    done, failed, total : int
        Throws that are kept, those of them that failed, and all.
    rate : float
        Throws a second in this run, 0 before the first.
    left : float
        Time left [s]; infinite while it is not known.
    stage : str
        Kind of the latest throws.
    """

    done: int
    failed: int
    total: int
    rate: float = 0.0
    left: float = float("inf")
    stage: str = ""


Report = Callable[[Progress], None]

RECENT = 64
"""Counts of a kind that are kept; the later half of them is usual."""


class Pace:
    """Counts throws of several kinds, and expects those left to take as long as others of theirs.

    One of a kind of which there is none yet is expected to take as long as one of those that are
    known, each kind by the number of its throws, or as many times longer as planned: one batch of a
    rare kind that takes long does not stand for the rest. The first ones of each process, for which
    it reduces rails, take several times as long as others: `count` takes the usual time beside,
    and a kind is expected to take the mean of the later half of these. The time until the first
    began does not count.

    Parameters
    ----------
    report : callable, optional
        Called with the progress of all.
    """

    def __init__(self, report: Report | None = None) -> None:
        self._report = report
        self._rest, self._later, self._all = Counter[str](), Counter[str](), Counter[str]()
        self._costs: dict[str, deque[float]] = {}
        self._like: dict[str, float] = {}
        self._there, self._made, self._failed = 0, 0, 0
        self._work, self._longest, self._at_once = 0.0, 0.0, 1
        self._stage = ""
        self._began = self._counted = time.monotonic()

    def plan(self, kind: str, throws: int, *, like: float = 1.0) -> None:
        """Expect at least so many throws after those that were begun.

        Parameters
        ----------
        kind : str
            Of what is counted.
        throws : int
            How many.
        like : float
            How many throws of other kinds one takes as long as, until one is known [-].
        """
        self._later[kind] = max(self._later[kind], throws)
        self._like[kind] = like

    def begin(self, kind: str, throws: int, *, there: int = 0, at_once: int = 1) -> None:
        """Expect throws that are made now, of which some are there already.

        `at_once` is how many processes make them: what these are at is not counted yet.
        """
        self._at_once = max(self._at_once, at_once)
        self._later[kind] = max(0, self._later[kind] - throws)
        self._rest[kind] += throws - there
        self._all[kind] += throws - there
        self._there += there

    def count(
        self,
        kind: str,
        throws: int = 1,
        *,
        failed: int = 0,
        cost: float | None = None,
        usual: float | None = None,
    ) -> None:
        """Count throws that are done, and report.

        Parameters
        ----------
        kind : str
            One that was begun.
        throws, failed : int
            All of them, and those that failed.
        cost : float, optional
            Time that all of them took where they were made [s]; by default each takes as long.
        usual : float, optional
            Time that so many others of their kind may take; default `cost` [s].
        """
        self._counted = time.monotonic()
        if cost is None:
            cost = float(throws)
        elif not self._made:
            self._began = max(self._began, self._counted - cost)
        self._rest[kind] -= throws
        self._made += throws
        self._failed += failed
        self._work += cost
        self._longest = max(self._longest, cost)
        usual = cost if usual is None else usual
        self._costs.setdefault(kind, deque(maxlen=RECENT)).append(usual / max(throws, 1))
        self._stage = kind
        self.emit()

    def emit(self) -> None:
        """Report the progress."""
        if self._report is not None:
            self._report(self.progress())

    def progress(self) -> Progress:
        """Return the progress so far."""
        now = time.monotonic()
        passed = max(now - self._began, 1e-9)
        rest = +(self._rest + self._later)
        left = 0.0 if not rest else float("inf")
        if rest and self._work:
            costs = {kind: _usual(found) for kind, found in self._costs.items()}
            known = {kind: max(self._all[kind], 1) for kind in costs}
            usual = sum(known[kind] * cost for kind, cost in costs.items())
            usual /= sum(count * self._like.get(kind, 1.0) for kind, count in known.items())
            work = sum(
                count * costs.get(kind, usual * self._like.get(kind, 1.0))
                for kind, count in rest.items()
            )
            spent = self._counted - self._began
            under_way = (self._at_once - 1) * self._longest
            whole = (
                spent * work / min(self._work + under_way, max(self._at_once * spent, self._work))
            )
            left = max(whole - (now - self._counted), 0.0)
        done = self._there + self._made
        total = done + rest.total()
        return Progress(done, self._failed, total, self._made / passed, left, self._stage)


def _usual(costs: deque[float]) -> float:
    """Return the mean of the later half of costs."""
    later = list(costs)[len(costs) // 2 :]
    return sum(later) / len(later)
