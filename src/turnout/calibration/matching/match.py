"""Match a panel to facts, wave by wave; every panel tried is kept in a folder and never again."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.fact_emulator import FEWEST, Emulation, Emulator, fit_emulator
from turnout.calibration.matching.facts import Facts, Sum
from turnout.calibration.matching.meet_facts import evaluate, is_valid
from turnout.calibration.matching.propose import latin_hypercube, plausible_points
from turnout.core.errors import FileError, StudyError
from turnout.core.files import make_folder, write_atomic
from turnout.core.json_files import to_plain
from turnout.core.threads import one_blas_thread

Floats = NDArray[np.float64]

FIRST_WAVE, WAVE = 160, 40
"""Panels of the first wave, which cover the ranges, and of each later one."""
CUT_OFFS = (3.0, 3.0, 2.0, 0.5, -0.5)
"""Implausibility up to which points are tried, in the waves after the first; the last holds on."""
MOST_TRAINING = 400
SPARE = 4
"""Times the points of a wave that are drawn at most, to have enough whose values go together."""
FAR = 3.0
"""Values further from a bound than so many times the usual distance are taken as that far."""
FAILURES = 2
"""After the first wave, facts that fail until the rest is not tried."""
HEAD, TRIED = "match.json", "tried.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """One panel that was tried.

    Attributes
    ----------
    wave : int
        From 0.
    share : float
        Of the ranges that its wave was drawn from, as the emulators say [-].
    point, values : tuple of float
        Shares of the ranges, and the facts in SI, NaN where there is none.
    accepted : bool
        Whether all facts hold.
    fault : str
        Why there are no values; else empty.
    throws : int
        That were made.
    seconds : float
        Processor time [s].
    """

    wave: int
    share: float
    point: tuple[float, ...]
    values: tuple[float, ...]
    accepted: bool
    fault: str
    throws: int
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchProgress:
    """How far a matching is: panels tried, at most, accepted of how many, and the wave."""

    tried: int
    most: int
    accepted: int
    wanted: int
    wave: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matching:
    """All panels that were tried.

    Attributes
    ----------
    facts : Facts
        What was asked.
    tried : tuple of Tried
        In order.
    """

    facts: Facts
    tried: tuple[Tried, ...]

    @property
    def points(self) -> Floats:
        """Points of the accepted panels, shape (n_accepted, n_parameters)."""
        found = [item.point for item in self.tried if item.accepted]
        return np.array(found).reshape(-1, len(self.facts.parameters))


def match_panel(
    facts: Facts,
    folder: Path,
    *,
    count: int = 200,
    most: int = 2000,
    report: Callable[[MatchProgress], None] | None = None,
) -> Matching:
    """Collect panels that meet all facts.

    Parameters
    ----------
    facts : Facts
        What is not known, and what must hold.
    folder : Path
        Keeps every panel that was tried; the same call goes on where it was interrupted.
    count : int
        Accepted panels wanted; the wave in which the last is found is finished.
    most : int
        Panels tried at most.
    report : callable, optional
        Called after every panel.

    Raises
    ------
    FileError
        When the folder holds a matching of other facts, or cannot be written.
    """
    _claim(folder, facts)
    tried = _read(folder, facts)
    wave = 0
    while True:
        before = [item for item in tried if item.wave < wave]
        if sum(item.accepted for item in before) >= count or len(before) >= most:
            return Matching(facts=facts, tried=tuple(tried))
        wanted = min(WAVE if wave else FIRST_WAVE, most - len(before))
        known = sum(item.wave == wave for item in tried)
        if known < wanted:
            with one_blas_thread():  # small matrices: threads would take ten times as long
                points, share = _points(facts, before, wave)
            if not len(points):
                message = "the emulators leave no panel whose values go together; widen the ranges"
                raise StudyError([message], source=facts.name)
            for point in points[known:wanted]:
                tried.append(_try(facts, point, wave, share))
                _append(folder, tried[-1])
                if report is not None:
                    report(_progress(tried, most=most, wanted=count))
        wave += 1


def _progress(tried: list[Tried], *, most: int, wanted: int) -> MatchProgress:
    accepted = sum(item.accepted for item in tried)
    return MatchProgress(
        tried=len(tried), most=most, accepted=accepted, wanted=wanted, wave=tried[-1].wave
    )


def _points(facts: Facts, before: list[Tried], wave: int) -> tuple[Floats, float]:
    """Return the points of a wave, and the share of the ranges that they are drawn from."""
    rng = np.random.default_rng([facts.seed, wave])
    if not wave:
        return latin_hypercube(FIRST_WAVE, len(facts.parameters), rng=rng), 1.0
    found = emulators_of(facts, before, wave)
    chosen = [facts.facts[number] for number in found]
    emulation = Emulation.of(list(found.values()), chosen)
    known = [item.point for item in before if item.accepted]
    points, share = plausible_points(
        emulation,
        SPARE * WAVE,
        start=np.array(known).reshape(-1, len(facts.parameters)),
        limit=CUT_OFFS[min(wave, len(CUT_OFFS)) - 1],
        rng=rng,
    )
    valid: list[Floats] = []
    for point in points:
        if len(valid) < WAVE and is_valid(facts, point):
            valid.append(point)
    return np.array(valid).reshape(-1, len(facts.parameters)), share


def emulators_of(facts: Facts, before: Sequence[Tried], wave: int) -> dict[int, Emulator]:
    """Fit emulators to panels that were tried, to those nearest to meeting the facts if many.

    Parameters
    ----------
    facts : Facts
        What must hold.
    before : sequence of Tried
        Panels of earlier waves.
    wave : int
        For which it is.

    Returns
    -------
    dict of int to Emulator
        By the number of the fact; late facts have none.

    Raises
    ------
    StudyError
        When too few panels gave facts.
    """
    rng = np.random.default_rng([facts.seed, wave, 1])
    early = [number for number, fact in enumerate(facts.facts) if not fact.late]
    usable = [item for item in before if not item.fault]
    if len(usable) < FEWEST:
        faults = {item.fault for item in before if item.fault}
        message = (
            f"only {len(usable)} of {len(before)} panels gave facts; "
            f"{next(iter(faults), 'no throw failed')}; narrow the ranges"
        )
        raise StudyError([message], source=facts.name)
    points = np.array([item.point for item in usable])
    values = np.array([item.values for item in usable])
    order = np.argsort(_misses(facts, values, early), kind="stable")
    found = {}
    for number in early:
        near = order[np.isfinite(values[order, number])][:MOST_TRAINING]
        near_bounds = _clipped(facts.facts[number], values[near, number])
        found[number] = fit_emulator(points[near], near_bounds, rng=rng)
    return found


def _clipped(fact: Sum, values: Floats) -> Floats:
    """Return values of which none is far outside the bounds, where a fact may bend.

    A drive that slips moves on at nearly constant force: its slip travel grows ten times as fast as
    before. Only where it begins matters.
    """
    beyond = np.maximum(fact.least - values, values - fact.most)
    reach = FAR * float(np.median(np.abs(beyond)))
    return np.clip(values, fact.least - reach, fact.most + reach)


def _misses(facts: Facts, values: Floats, early: list[int]) -> Floats:
    """Return by how much panels miss the facts that were tried, in their deviations, summed."""
    total = np.zeros(len(values))
    for number in early:
        fact, column = facts.facts[number], values[:, number]
        beyond = np.maximum(fact.least - column, column - fact.most)
        total += np.nan_to_num(np.maximum(beyond, 0.0) / (np.nanstd(column) or 1.0))
    return total


def _try(facts: Facts, point: Floats, wave: int, share: float) -> Tried:
    began = time.process_time()
    found = evaluate(facts, point, failures=FAILURES if wave else None)
    return Tried(
        wave=wave,
        share=share,
        point=tuple(map(float, point)),
        values=tuple(map(float, found.values)),
        accepted=found.accepted,
        fault=found.fault,
        throws=found.throws,
        seconds=time.process_time() - began,
    )


def _claim(folder: Path, facts: Facts) -> None:
    """Make the folder, or refuse one that belongs to other facts."""
    head = folder / HEAD
    if head.exists():
        try:
            digest = json.loads(head.read_text(encoding="utf-8")).get("digest")
        except (OSError, ValueError, AttributeError) as error:
            message = f"{head}: cannot be read ({error}); name another folder"
            raise FileError(message) from None
        if digest != facts.digest:
            message = f"{folder}: holds a matching of other facts or ranges; name another folder"
            raise FileError(message)
        return
    make_folder(folder)
    names = [item.name for item in facts.parameters] + [item.name for item in facts.facts]
    content = {"name": facts.name, "digest": facts.digest, "columns": names}
    write_atomic(head, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def _append(folder: Path, item: Tried) -> None:
    line = json.dumps(to_plain(item, nonfinite=str), ensure_ascii=False)
    try:
        with (folder / TRIED).open("a", encoding="utf-8") as file:
            file.write(f"{line}\n")
    except OSError as error:
        message = f"{folder / TRIED}: cannot be written ({error.strerror}); free space or rights"
        raise FileError(message) from None


def _read(folder: Path, facts: Facts) -> list[Tried]:
    """Read the panels that were tried; a last line that was cut off is dropped from the file."""
    path = folder / TRIED
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        write_atomic(path, whole)
    found = []
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            record = json.loads(line)
            record["point"] = tuple(map(float, record["point"]))
            record["values"] = tuple(map(float, record["values"]))
            item = Tried(**record)
        except (ValueError, TypeError, KeyError) as error:
            message = f"{path}, line {number}: is damaged ({error}); remove the line or the folder"
            raise FileError(message) from None
        if len(item.values) != len(facts.facts) or len(item.point) != len(facts.parameters):
            message = f"{path}, line {number}: belongs to other facts; name another folder"
            raise FileError(message)
        found.append(item)
    return found
