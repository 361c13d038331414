"""What the accepted panels show: measurements and answers of the facts, kept in a folder."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.facts import Facts
from turnout.calibration.matching.match import panel_facts, panel_workers
from turnout.calibration.matching.meet_facts import thrower_at
from turnout.core.json_files import to_plain
from turnout.core.kept_lines import append_line, read_lines
from turnout.core.progress import Pace, Report
from turnout.core.provenance import content_hash
from turnout.core.workers import Workers

Floats = NDArray[np.float64]

SURVEYED = "surveyed.jsonl"
STAGE = "measurements and answers"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """What each accepted panel shows.

    Attributes
    ----------
    points : ndarray, shape (n, n_parameters)
        Accepted panels as shares of the ranges.
    measured : ndarray, shape (n, n_measurements)
        In SI.
    answers : ndarray, shape (n, n_answers)
        In SI.
    throws : int
        That were made for it, now and before.
    """

    points: Floats
    measured: Floats
    answers: Floats
    throws: int


def survey(
    facts: Facts,
    points: Floats,
    folder: Path,
    *,
    workers: int | Workers = 1,
    report: Report | None = None,
) -> Survey:
    """Throw the accepted panels for measurements and answers; what a folder holds is not repeated.

    Parameters
    ----------
    facts : Facts
        With measurements and answers.
    points : ndarray, shape (n, n_parameters)
        Accepted panels.
    folder : Path
        Of the matching.
    workers : int or Workers
        Processes, as of `match_panel`.
    report : callable, optional
        Called after every panel.
    """
    wanted = (*facts.measurements, *facts.answers)
    key = content_hash(to_plain([[item.terms, item.parameter] for item in wanted]))
    known = {
        line["place"]: (line["values"], int(line["throws"]))
        for line in read_lines(folder / SURVEYED)
        if line.get("key") == key
    }
    places = [content_hash([facts.digest, list(map(float, point))]) for point in points]
    missing = {place: at for at, place in enumerate(places) if place not in known}
    pace = Pace(report)
    pace.begin(STAGE, len(places), there=len(places) - len(missing))
    with panel_workers(facts, workers) as processes:
        jobs = [partial(_surveyed, points[at]) for at in missing.values()]
        for number, (values, throws) in processes.run(jobs):
            place = list(missing)[number]
            known[place] = values, throws
            line = {"key": key, "place": place, "values": values, "throws": throws}
            append_line(folder / SURVEYED, line)
            pace.count(STAGE)
    found = [known[place] for place in places]
    table = np.array([values for values, _ in found], dtype=np.float64)
    table, count = table.reshape(len(points), len(wanted)), len(facts.measurements)
    throws = sum(made for _, made in found)
    return Survey(points=points, measured=table[:, :count], answers=table[:, count:], throws=throws)


def _surveyed(point: Floats) -> tuple[list[float], int]:
    """Return measurements and answers of a panel, and the throws that were made for them."""
    facts = panel_facts()
    thrower, wanted = thrower_at(facts, point), (*facts.measurements, *facts.answers)
    values = [
        _parameter(facts, point, item.parameter)
        if item.parameter
        else thrower.sum(item, among=wanted)
        for item in wanted
    ]
    return values, thrower.made


def _parameter(facts: Facts, point: Floats, name: str) -> float:
    number = [item.name for item in facts.parameters].index(name)
    return float(facts.parameters[number].value(point[number]))
