"""What the accepted panels show: measurements and answers of the facts, kept in a folder."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.facts import Facts
from turnout.calibration.matching.meet_facts import thrower_at
from turnout.core.errors import FileError
from turnout.core.json_files import to_plain
from turnout.core.provenance import content_hash

Floats = NDArray[np.float64]

SURVEYED = "surveyed.jsonl"


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
    report: Callable[[int, int], None] | None = None,
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
    report : callable, optional
        Called with panels done and panels in all.
    """
    wanted = (*facts.measurements, *facts.answers)
    key = content_hash(to_plain([[item.terms, item.parameter] for item in wanted]))
    known = _known(folder / SURVEYED, key)
    values, throws = [], 0
    for number, point in enumerate(points):
        place = content_hash([facts.digest, list(map(float, point))])
        if place not in known:
            thrower = thrower_at(facts, point)
            made = [
                _parameter(facts, point, item.parameter)
                if item.parameter
                else thrower.sum(item, among=wanted)
                for item in wanted
            ]
            known[place] = (made, thrower.made)
            record = {"key": key, "place": place, "values": made, "throws": thrower.made}
            _append(folder / SURVEYED, record)
        values.append(known[place][0])
        throws += known[place][1]
        if report is not None:
            report(number + 1, len(points))
    table = np.array(values).reshape(len(points), len(wanted))
    count = len(facts.measurements)
    return Survey(points=points, measured=table[:, :count], answers=table[:, count:], throws=throws)


def _parameter(facts: Facts, point: Floats, name: str) -> float:
    number = [item.name for item in facts.parameters].index(name)
    return float(facts.parameters[number].value(point[number]))


def _known(path: Path, key: str) -> dict[str, tuple[list[float], int]]:
    """Read what is known of the same measurements and answers; a line cut off is skipped."""
    found: dict[str, tuple[list[float], int]] = {}
    if not path.exists():
        return found
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            record = json.loads(line)
            if record["key"] == key:
                found[record["place"]] = (record["values"], int(record["throws"]))
        except (ValueError, KeyError, TypeError):
            continue
    return found


def _append(path: Path, record: dict[str, object]) -> None:
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{json.dumps(record)}\n")
    except OSError as error:
        message = f"{path}: cannot be written ({error.strerror}); free space or rights"
        raise FileError(message) from None
