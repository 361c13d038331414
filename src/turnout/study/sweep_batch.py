"""A batch of scenarios: which ones it holds, and its file, written whole or not at all.

Which scenarios are in which batch depends on the study alone, so that it does not matter who
throws them, when, and after which interruptions. A file carries a digest of its content in its
name: what was torn by a crash is told from what is whole.
"""

import hashlib
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from turnout.files.atomic import write_atomic
from turnout.metric.features import FEATURES
from turnout.response.signals import Variable
from turnout.schema.channels import known_channel
from turnout.study.study import Study
from turnout.study.sweep_row import (
    COMPLETE,
    LABELS,
    Row,
    labels_of,
    skipped,
    throw_scenario,
)

SMALLEST_BATCH, LARGEST_BATCH, MOST_BATCHES = 8, 64, 64
"""Scenarios in a batch, and how many batches there are before they grow."""

LARGEST_CHUNK = 1_000_000
"""Of a variable in a file, before compression [bytes]."""

SMALL = 2048
"""A variable up to this size is stored as it is: chunks and compression would take more [bytes]."""

UNKNOWN = -1
"""Stands for a logical value of a scenario that is not complete."""

SPLITS = {"train": 0.7, "validation": 0.85, "test": 1.0}
"""Parts of the data, with the share of conditions up to which each reaches [-]."""

_NAME = re.compile(r"(\d{6,})-([0-9a-f]{32})\.nc")


def batches_of(study: Study) -> list[tuple[Sequence[int], ...]]:
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
    largest = min(LARGEST_BATCH, max(SMALLEST_BATCH, math.ceil(study.count / MOST_BATCHES)))
    batches: list[tuple[Sequence[int], ...]] = []
    held: list[Sequence[int]] = []
    size = 0
    for chain in study.chains:
        held.append(chain)
        size += len(chain)
        if size >= largest:
            batches.append(tuple(held))
            held, size = [], 0
    if held:
        batches.append(tuple(held))
    return batches


def throw_batch(study: Study, chains: Sequence[Sequence[int]]) -> list[Row]:
    """Throw the scenarios of a batch; return them in the order of their numbers."""
    rows: list[Row] = []
    for chain in chains:
        reason = ""
        for index in chain:
            scenario = study.scenario(index)
            if reason:
                rows.append(skipped(scenario, reason=reason))
                continue
            row = throw_scenario(study, scenario)
            rows.append(row)
            if study.rule and row.outcome == COMPLETE and study.rule.stops(labels_of(row)):
                reason = f"a drive slipped in scenario {index}"
    return sorted(rows, key=lambda row: row.scenario.index)


def batch_dataset(study: Study, rows: Sequence[Row]) -> xr.Dataset:
    """Return the rows of a batch as one dataset; NaN, or -1, where a scenario is not complete."""
    variables = _described(study, rows)
    inputs = [name for name, variable in variables.items() if "input" in variable.attrs]
    known = [row for row in rows if row.outcome == COMPLETE]
    named: dict[str, xr.Variable] = {}
    varying: dict[str, Variable] = {}
    for row in known:
        for name, (dims, values) in row.coordinates.items():
            if dims == (name,):
                named.setdefault(name, xr.Variable(dims, values, attributes_of(name)))
            else:
                varying.setdefault(name, (dims, values))
        varying |= {name: v for name, v in row.variables.items() if name not in varying}
    for name, like in varying.items():
        found = [(row.variables | row.coordinates).get(name) for row in rows]
        variables[name] = _together(name, found, like)
    sizes = {dim: n for v in variables.values() for dim, n in zip(v.dims, v.shape, strict=True)}
    if "time" in sizes:
        time = np.arange(sizes["time"]) * study.output.interval
        named["time"] = xr.Variable("time", time, attributes_of("time"))
    coordinates = {name for row in known for name in row.coordinates if name in variables}
    given = {"scenario", "name", "condition", "split", *inputs, *coordinates}
    return xr.Dataset({**variables, **named}).set_coords(sorted(given))


def attributes_of(name: str) -> dict[str, str]:
    """Return unit, meaning and sign of a stored variable.

    Examples
    --------
    >>> attributes_of("slipped")["long_name"]
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
    return found | ({"positive": channel.positive} if channel.positive else {})


def _described(study: Study, rows: Sequence[Row]) -> dict[str, xr.Variable]:
    """Return number, name, inputs and outcome of each scenario."""
    scenarios = [row.scenario for row in rows]

    def of(values: Sequence[object], text: str, **attributes: str) -> xr.Variable:
        array = np.array(values)
        if array.dtype.kind == "b":
            array = array.astype(np.int8)
        return xr.Variable("scenario", array, {"units": "1", "long_name": text, **attributes})

    found = {
        "scenario": of([item.index for item in scenarios], "number in the study"),
        "name": of([item.name for item in scenarios], "name of the scenario"),
        "condition": of([item.condition for item in scenarios], "group for splits"),
        "split": of([split_of(item.condition, study.seed) for item in scenarios], "part of data"),
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


def split_of(condition: str, seed: int) -> str:
    """Return the part of the data that a condition belongs to, by a hash of it.

    All scenarios of a condition are in the same part, so that no test looks at a switch that was
    trained on.

    Examples
    --------
    >>> split_of("state 3", 1)
    'train'
    """
    hashed = hashlib.blake2b(f"{seed} {condition}".encode(), digest_size=8).digest()
    share = int.from_bytes(hashed, "big") / 2**64
    return next(name for name, bound in SPLITS.items() if share < bound)


def _together(name: str, found: Sequence[Variable | None], like: Variable) -> xr.Variable:
    """Return the variables of scenarios stacked, the shorter ones filled up along time."""
    shape = [0] * len(like[0])
    for variable in found:
        if variable is not None:
            shape = [max(n, m) for n, m in zip(shape, variable[1].shape, strict=True)]
    kind = like[1].dtype
    logical = kind.kind == "b"
    dtype, empty = (np.dtype(np.int8), UNKNOWN) if logical else (kind, np.nan)
    values = np.full((len(found), *shape), empty, dtype=dtype)
    for number, variable in enumerate(found):
        if variable is not None:
            place: tuple[int | slice, ...] = (number, *(slice(n) for n in variable[1].shape))
            values[place] = variable[1]
    attributes = attributes_of(name)
    if logical:
        attributes |= {"values": "1 true, 0 false, -1 not known as the scenario is not complete"}
    return xr.Variable(("scenario", *like[0]), values, attributes)


def batch_bytes(dataset: xr.Dataset) -> bytes:
    """Return the netCDF-4 file of a batch; the same dataset always gives the same bytes.

    It is written by the HDF5 library itself, which takes a tenth of the time that xarray does.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `batch_dataset`; each dimension has its coordinate.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver="latest") as file:
        variables = {str(name): variable for name, variable in dataset.variables.items()}
        ordered = sorted(variables, key=lambda name: variables[name].dims != (name,))
        for name in ordered:
            _store(file, name, variables[name])
        named = [name for name in dataset.coords if str(name) not in dataset.dims]
        for variable in dataset.data_vars.values():
            mine = [str(n) for n in named if set(dataset[n].dims) <= set(variable.dims)]
            file[str(variable.name)].attrs["coordinates"] = " ".join(mine)
    return content.getvalue()


def _store(file: h5py.File, name: str, variable: xr.Variable) -> None:
    """Store a variable; its dimensions must be there, unless it is one."""
    values, options = variable.values, {}
    if values.dtype.kind not in "fib":
        values, options = values.astype(object), {"dtype": h5py.string_dtype()}
    elif variable.nbytes > SMALL:
        rows = max(1, LARGEST_CHUNK * values.shape[0] // variable.nbytes)
        chunks = (min(values.shape[0], rows), *values.shape[1:])
        options = {"chunks": chunks, "compression": "gzip", "compression_opts": 1, "shuffle": True}
    stored = file.create_dataset(name, data=values, track_times=False, **options)
    if variable.dims == (name,):
        stored.make_scale(name)
    else:
        for axis, dim in enumerate(variable.dims):
            stored.dims[axis].attach_scale(file[str(dim)])
    for key, value in variable.attrs.items():
        stored.attrs[key] = value


def write_batch(folder: Path, number: int, content: bytes) -> Path:
    """Write the file of a batch durably, named by its number and the digest of its content.

    Raises
    ------
    FileError
        When it cannot be written; nothing is left of it then.
    """
    path = folder / f"{number:06d}-{_digest(content)}.nc"
    write_atomic(path, content)
    return path


def written_batches(folder: Path, *, check: bool = False) -> tuple[dict[int, Path], list[Path]]:
    """Return the files of a folder by their number, and those whose content is not what it was.

    Parameters
    ----------
    folder : Path
        Of batches.
    check : bool
        Whether the content is held against the digest, which reads all of it.
    """
    found: dict[int, Path] = {}
    torn = []
    for path in sorted(folder.glob("[0-9]*.nc")):
        match = _NAME.fullmatch(path.name)
        if match is None:
            continue
        if check and _digest(path.read_bytes()) != match[2]:
            torn.append(path)
            continue
        found.setdefault(int(match[1]), path)
    return found, torn


def _digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()
