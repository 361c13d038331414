"""Batches of scenarios: members of each, their stacked variables, and their files.

Which scenarios are in which batch depends on the study alone, so that it does not matter who
throws them, when, and after which interruptions. The file of a batch
(`turnout.study.sweep.batch_bytes`) is written whole or not at all. Its name carries a digest of its
content, which every reader verifies; an attribute says which study, which sources and which batch
it comes from.
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.channels import AXES, known_channel
from turnout.core.files import write_atomic
from turnout.metric.features import FEATURES
from turnout.study.scenario import Rule
from turnout.study.study import Study
from turnout.study.sweep.labels import LABELS, UNKNOWN_LOGICAL
from turnout.study.sweep.row import (
    COMPLETE,
    ScenarioRow,
    StoredThrows,
    rule_inputs,
    skipped_row,
    throw_scenarios,
)

DIGITS = 32
"""Of the SHA-256 of a file's content that stand in its name [hexadecimal]."""

ORIGIN = b"origin"
"""Attribute of a file that states its origin."""

BATCH_NAME = re.compile(r"(\d{6,})-([0-9a-f]{32})\.nc")


@dataclass(frozen=True, slots=True, eq=False)
class StoredVariable:
    """A variable of a file.

    Attributes
    ----------
    dims : tuple of str
        Each has a variable of its name, its coordinate.
    values : ndarray
        Numbers or texts.
    attributes : mapping of str to str
        Unit, meaning and so on.
    coordinate : bool
        Whether it is one of others.
    """

    dims: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, str]
    coordinate: bool


@dataclass(frozen=True, slots=True)
class BatchOrigin:
    """Origin of a batch, as its file states it.

    Attributes
    ----------
    study : str
        Digest of the study.
    version, code : str
        Of the program that made it, and a digest of its sources.
    batch : str
        Its number in the study.
    """

    study: str
    version: str
    code: str
    batch: str

    def __str__(self) -> str:
        """Return all of it in one line, which is quicker to read than an attribute each."""
        return " ".join(astuple(self))


def write_batch(folder: Path, number: int, content: bytes, *, durable: bool = True) -> Path:
    """Write the file of a batch, named by its number and the digest of its content.

    Without `durable` it may not be on the disk yet.

    Raises
    ------
    FileError
        When it cannot be written; nothing is left of it then.
    """
    digest = hashlib.sha256(content).hexdigest()[:DIGITS]
    path = folder / f"{number:06d}-{digest}.nc"
    write_atomic(path, content, durable=durable)
    return path


def list_batches(folder: Path) -> list[tuple[int, Path]]:
    """Return number and file of the batches of a folder, by their names alone."""
    found = ((BATCH_NAME.fullmatch(path.name), path) for path in folder.glob("[0-9]*.nc"))
    return sorted((int(match[1]), path) for match, path in found if match is not None)


SIZES = (8, 32, 128, 512, 1024)
"""Scenarios in a batch; few sizes, since the head of a file is made once for each, but the last one
of a sweep, and chains, which may be longer."""

BATCHES_OF_ALL, BATCHES_OF_REST, LARGE_OF_REST = 8, 2, 4
"""A batch that is not of the smallest size leaves so many of its size in the whole sweep, and so
many among the rest, more if it is large: several workers find one, and none waits long for the last
one."""

LARGEST_BATCH = 128
"""Scenarios in a batch with histories, and in a pass without."""

LARGEST_WITHOUT_HISTORIES = 1024
"""Scenarios in a batch that holds no histories: its variables alone take 60 kB of a file."""

SPLITS = {"train": 0.7, "validation": 0.85, "test": 1.0}
"""Parts of the data, with the share of conditions up to which each reaches [-]."""


def plan_batches(study: Study) -> list[tuple[Sequence[int], ...]]:
    """Return the chains of scenarios that each batch holds.

    Parameters
    ----------
    study : Study
        With its chains.

    Returns
    -------
    list of tuple of sequences of int
        Chains are never split.
    """
    batches: list[tuple[Sequence[int], ...]] = []
    held: list[Sequence[int]] = []
    size, rest = 0, study.count
    largest = LARGEST_BATCH if study.output.channels else LARGEST_WITHOUT_HISTORIES
    for chain in study.chains:
        held.append(chain)
        size += len(chain)
        if size >= _next_size(study.count, rest, largest):
            batches.append(tuple(held))
            held, size, rest = [], 0, rest - size
    if held:
        batches.append(tuple(held))
    return batches


def _next_size(count: int, rest: int, largest: int) -> int:
    """Return the number of scenarios of the next batch, with `rest` of `count` left."""
    for size in SIZES[:0:-1]:
        of_rest = BATCHES_OF_REST if size <= LARGEST_BATCH else LARGE_OF_REST
        if size <= largest and BATCHES_OF_ALL * size <= count and of_rest * size <= rest:
            return size
    return SIZES[0]


def throw_batch(study: Study, chains: Sequence[Sequence[int]]) -> list[ScenarioRow]:
    """Throw the scenarios of a batch; return them in the order of their numbers."""
    rows: list[ScenarioRow] = []
    if study.rule is not None:
        for chain in chains:
            rows += _throw_chain(study, study.rule, chain)
    else:
        scenarios = study.scenarios_of([index for chain in chains for index in chain])
        for first in range(0, len(scenarios), LARGEST_BATCH):
            rows += throw_scenarios(study, scenarios[first : first + LARGEST_BATCH])
    return sorted(rows, key=lambda row: row.scenario.index)


def _throw_chain(study: Study, rule: Rule, chain: Sequence[int]) -> list[ScenarioRow]:
    """Throw scenarios one by one until the rule leaves out the rest."""
    rows: list[ScenarioRow] = []
    reason = ""
    for scenario in study.scenarios_of(chain):
        if reason:
            rows.append(skipped_row(scenario, reason=reason))
            continue
        rows += throw_scenarios(study, [scenario])
        if rows[-1].outcome == COMPLETE and rule.stops(rule_inputs(rows[-1])):
            reason = f"a drive slipped in scenario {scenario.index}"
    return rows


def batch_variables(study: Study, rows: Sequence[ScenarioRow]) -> dict[str, StoredVariable]:
    """Return the rows of a batch stacked; NaN, or -1, for a scenario that is not complete.

    Without histories they are compact: see `compact_variables`.
    """
    variables = _stacked_variables(study, rows)
    return variables if study.output.channels else compact_variables(variables)


def compact_variables(variables: Mapping[str, StoredVariable]) -> dict[str, StoredVariable]:
    """Return variables with numbers of scenarios in single precision, and texts of one length.

    The study gives the inputs of a scenario to the last digit by its number.
    """
    found = {}
    for name, variable in variables.items():
        values = variable.values
        if values.dtype.kind not in "fib":
            values = np.char.encode(values.astype(str), "utf-8")
        elif variable.dims[0] == "scenario" and values.dtype == np.float64:
            values = values.astype(np.float32)
        found[name] = replace(variable, values=values)
    return found


def _stacked_variables(study: Study, rows: Sequence[ScenarioRow]) -> dict[str, StoredVariable]:
    variables = _scenario_variables(study, rows)
    groups = _group_rows(rows)
    pieces: dict[str, list[_Piece]] = {}
    coordinates: set[str] = set()
    for group in groups:
        for name, (dims, values) in group.stored.coordinates.items():
            coordinates.add(name)
            if dims != (name,):
                pieces.setdefault(name, []).append(group.piece(dims, values))
            elif name not in variables:
                about = variable_attributes(name)
                variables[name] = StoredVariable(dims, values, about, coordinate=True)
    for group in groups:
        for name, (dims, values) in group.stored.variables.items():
            pieces.setdefault(name, []).append(group.piece(dims, values))
    for name, found in pieces.items():
        variables[name] = _stack(name, found, len(rows), coordinate=name in coordinates)
    over_time = [v.values.shape[-1] for v in variables.values() if v.dims[-1] == "time"]
    if over_time:
        time = np.arange(max(over_time)) * study.output.interval
        variables["time"] = StoredVariable(
            ("time",), time, variable_attributes("time"), coordinate=True
        )
    return variables


class _Piece(NamedTuple):
    """A variable of some rows: places, dimensions of one, values and number of instants of each."""

    places: list[int]
    dims: tuple[str, ...]
    values: NDArray[np.generic]
    instants: NDArray[np.int64]

    @property
    def shorter(self) -> NDArray[np.bool_] | None:
        """Values beyond the last instant of their row; None if no row is shorter."""
        if self.dims[-1:] != ("time",) or self.instants.min() >= self.values.shape[-1]:
            return None
        beyond = np.arange(self.values.shape[-1]) >= self.instants[:, np.newaxis]
        between = (np.newaxis,) * (self.values.ndim - 2)
        return np.broadcast_to(beyond[:, *between], self.values.shape)


class _Group(NamedTuple):
    """Rows of throws that are stored together: their places, and their numbers among the throws."""

    stored: StoredThrows
    places: list[int]
    numbers: list[int]

    def piece(self, dims: tuple[str, ...], values: NDArray[np.generic]) -> _Piece:
        """Return a variable of the rows; `values` are those of all throws."""
        instants = self.stored.instants
        if self.numbers != [*range(len(values))]:
            values, instants = values[self.numbers], instants[self.numbers]
        return _Piece(self.places, dims, values, instants)


def _group_rows(rows: Sequence[ScenarioRow]) -> list[_Group]:
    """Return the complete rows by the throws that they are stored with."""
    found: dict[int, _Group] = {}
    for place, row in enumerate(rows):
        if row.stored is not None:
            group = found.setdefault(id(row.stored), _Group(row.stored, [], []))
            group.places.append(place)
            group.numbers.append(row.number)
    return list(found.values())


@cache
def variable_attributes(name: str) -> dict[str, str]:
    """Return unit, meaning and sign of a stored variable.

    Examples
    --------
    >>> variable_attributes("slipped")["long_name"]
    'whether a drive slipped in the last movement'
    """
    if name in FEATURES:
        return {"units": FEATURES[name].units, "long_name": FEATURES[name].long_name}
    if name in LABELS:
        units, text = LABELS[name]
        return {"units": units, "long_name": text}
    channel = known_channel(name)
    if channel is None:
        raise KeyError(name)
    found = {"units": channel.units, "long_name": channel.long_name}
    found |= {"positive": channel.positive} if channel.positive else {}
    return found | ({"axis": AXES[name]} if name in AXES else {})


def _scenario_variables(study: Study, rows: Sequence[ScenarioRow]) -> dict[str, StoredVariable]:
    """Return number, name, inputs and outcome of each scenario."""
    scenarios = [row.scenario for row in rows]

    def of(values: Sequence[object], text: str, **attributes: str) -> StoredVariable:
        array = np.array(values)
        if array.dtype.kind == "b":
            array = array.astype(np.int8)
        about = {"units": "1", "long_name": text, **attributes}
        return StoredVariable(("scenario",), array, about, coordinate=True)

    found = {
        "scenario": of([item.index for item in scenarios], "number in the study"),
        "name": of([item.name for item in scenarios], "name of the scenario"),
        "condition": of([item.condition for item in scenarios], "group for splits"),
        "split": of([data_split(item.condition, study.seed) for item in scenarios], "part of data"),
        "seed": of([item.seed for item in scenarios], "seed of the scenario"),
        "outcome": of([row.outcome for row in rows], "how the scenario ended"),
        "reason": of([row.reason for row in rows], "why it is not complete"),
        "attempts": of([row.attempts for row in rows], "throws that were made"),
    }
    for name in scenarios[0].inputs:
        units = study.units.get(name) or "1"
        values = [item.inputs[name] for item in scenarios]
        found[name] = of(values, f"input {name}", units=units, input="varies in the study")
    return found


def data_split(condition: str, seed: int) -> str:
    """Return the part of the data that a condition belongs to, by a hash of it.

    All scenarios of a condition are in the same part, so that no test looks at a switch that was
    trained on.

    Examples
    --------
    >>> data_split("state 3", 1)
    'train'
    """
    hashed = hashlib.blake2b(f"{seed} {condition}".encode(), digest_size=8).digest()
    share = int.from_bytes(hashed, "big") / 2**64
    return next(name for name, bound in SPLITS.items() if share < bound)


def _stack(name: str, pieces: Sequence[_Piece], count: int, *, coordinate: bool) -> StoredVariable:
    """Return a variable of some rows in one array."""
    first = pieces[0]
    kind = first.values.dtype
    logical = any(piece.values.dtype.kind == "b" for piece in pieces)
    whole = kind.kind in "bi"  # states of machines are -1 without a machine too
    dtype, empty = (np.dtype(np.int8), UNKNOWN_LOGICAL) if whole else (kind, np.nan)
    alone = len(first.places) == count and kind == dtype and first.shorter is None
    values = first.values if alone else _join(pieces, count, dtype, empty)
    attributes = variable_attributes(name)
    if logical:
        attributes = attributes | {
            "values": "1 true, 0 false, -1 not known as the scenario is not complete"
        }
    return StoredVariable(("scenario", *first.dims), values, attributes, coordinate=coordinate)


def _join(
    pieces: Sequence[_Piece], count: int, dtype: np.dtype[Any], empty: float
) -> NDArray[np.generic]:
    """Return the values of some rows, the shorter ones filled up along time."""
    shape = tuple(np.max([piece.values.shape[1:] for piece in pieces], axis=0, initial=0))
    known = sum(len(piece.places) for piece in pieces)
    if known == count and all(piece.values.shape[1:] == shape for piece in pieces):
        values = np.empty((count, *shape), dtype=dtype)
    else:
        values = np.full((count, *shape), empty, dtype=dtype)
    for piece in pieces:
        places = slice(piece.places[0], piece.places[-1] + 1)
        neighbours = places.stop - places.start == len(piece.places)
        within = map(slice, piece.values.shape[1:])
        shorter = piece.shorter
        given = piece.values if shorter is None else np.where(shorter, empty, piece.values)
        values[(places if neighbours else piece.places, *within)] = given
    return values
