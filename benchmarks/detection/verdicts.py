"""Verdicts of a method on the throws of the benchmark, and their file.

A table with a row a throw, CSV or Parquet. `throw`, `score` and `alarm` must be there; what else
is there is judged too. The format is described in docs/evidence/open-benchmark.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.files import atomic_path
from turnout.core.problems import choices, nearest

Floats = NDArray[np.float64]

THROW, SCORE, ALARM = "throw", "score", "alarm"
RARE, CAUSE, PROBABILITY, NOVELTY = "rare_alarm", "cause", "probability", "novelty"
RANGES = ("", "_low", "_high")
"""Ends of the names of a value, and of the ends of its 95 % interval."""
OBJECT_COLUMNS = tuple(f"{name}{end}" for name in ("x", "size") for end in RANGES)
GAP = "gap "
MOST_NAMED = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdicts:
    """Verdicts of a method on throws.

    Attributes
    ----------
    throw : ndarray of int, shape (n,)
        Of the benchmark.
    score : ndarray, shape (n,)
        Higher where an object is likelier; on any scale.
    alarm, rare_alarm : ndarray of bool, shape (n,), or None
        Whether an object is called, at a rate of 1 and of 0.1 false alarms in 1,000 sound throws.
    x, size : ndarray, shape (n, 3), or None
        Of the object: value and ends of its 95 % interval [m]; NaN where nothing is said.
    gap : ndarray, shape (n, n_positions, 3), or None
        After the throw: value and ends of its 95 % interval [m].
    cause : ndarray of str, shape (n,), or None
        "sound", "object", "unknown", or a cause that training throws have.
    probability : ndarray, shape (n,), or None
        Of an object, where half of the throws have one [-].
    novelty : ndarray, shape (n,), or None
        Higher where a throw is less like any that the method learned from.
    """

    throw: NDArray[np.intp]
    score: Floats
    alarm: NDArray[np.bool_]
    rare_alarm: NDArray[np.bool_] | None = None
    x: Floats | None = None
    size: Floats | None = None
    gap: Floats | None = None
    cause: NDArray[np.str_] | None = None
    probability: Floats | None = None
    novelty: Floats | None = None


def columns_of(positions: Sequence[str]) -> tuple[str, ...]:
    """Return all columns that a verdict file may have."""
    gaps = [f"{GAP}{name}{end}" for name in positions for end in RANGES]
    return (
        *(THROW, SCORE, ALARM, RARE, *OBJECT_COLUMNS),
        *(CAUSE, PROBABILITY, NOVELTY, *gaps),
    )


def write_verdicts(verdicts: Verdicts, path: Path, positions: Sequence[str]) -> None:
    """Write a verdict file, CSV or Parquet by its ending."""
    table: dict[str, object] = {
        THROW: verdicts.throw,
        SCORE: verdicts.score,
        ALARM: verdicts.alarm.astype(int),
    }
    if verdicts.rare_alarm is not None:
        table[RARE] = verdicts.rare_alarm.astype(int)
    for name in ("x", "size"):
        values = getattr(verdicts, name)
        if values is not None:
            table |= {f"{name}{end}": values[:, at] for at, end in enumerate(RANGES)}
    for name in (CAUSE, PROBABILITY, NOVELTY):
        if getattr(verdicts, name) is not None:
            table[name] = getattr(verdicts, name)
    if verdicts.gap is not None:
        for row, position in enumerate(positions):
            for at, end in enumerate(RANGES):
                table[f"{GAP}{position}{end}"] = verdicts.gap[:, row, at]
    frame = pd.DataFrame(table)
    with atomic_path(path) as temporary:
        if path.suffix == ".parquet":
            frame.to_parquet(temporary, index=False)
        else:
            frame.to_csv(temporary, index=False)


def read_verdicts(path: Path, *, throws: NDArray[np.intp], positions: Sequence[str]) -> Verdicts:
    """Read a verdict file.

    Parameters
    ----------
    path : Path
        CSV or Parquet.
    throws : ndarray of int, shape (n,)
        That must be judged, each once; verdicts are returned in their order.
    positions : sequence of str
        Of the gaps.

    Raises
    ------
    FileError
        With everything that is wrong with its columns, or else with its rows.
    """
    frame = _read(path)
    faults = _column_faults(frame, positions)
    if not faults:
        faults = _throw_faults(frame, throws) + _value_faults(frame)
    if faults:
        shown = "".join(f"\n  {text}" for text in faults)
        message = f"{path}: cannot be scored:{shown}\nFormat: docs/evidence/open-benchmark.md"
        raise FileError(message)
    return _verdicts(frame.set_index(THROW).loc[throws].reset_index(), positions)


def _read(path: Path) -> pd.DataFrame:
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        return pd.read_csv(path)
    except ImportError:
        message = f"{path}: Parquet needs the extra: pip install 'turnout[parquet]'; or give CSV"
    except FileNotFoundError:
        message = f"{path}: there is no such file"
    except (OSError, ValueError, UnicodeDecodeError) as error:
        message = f"{path}: cannot be read as a table ({str(error).splitlines()[0]})"
    raise FileError(message)


def _column_faults(frame: pd.DataFrame, positions: Sequence[str]) -> list[str]:
    allowed, given = columns_of(positions), [str(name) for name in frame.columns]
    faults = [f'column "{name}" is missing' for name in (THROW, SCORE, ALARM) if name not in given]
    for name in given:
        if name not in allowed:
            hint = nearest(name, allowed) or f"; allowed are {choices(allowed)}"
            faults.append(f'column "{name}" is unknown{hint}')
    faults += [f'column "{name}" is there twice' for name in set(given) if given.count(name) > 1]
    for name in given:
        if name in allowed and name != CAUSE and frame[name].dtype.kind not in "fiub":
            faults.append(f'column "{name}" holds what is no number')
    for base in ("x", "size", *(f"{GAP}{name}" for name in positions)):
        own = [f"{base}{end}" in given for end in RANGES]
        if any(own) and not all(own):
            faults.append(f'"{base}" needs all of {base}, {base}_low and {base}_high')
    gaps = [f"{GAP}{name}" in given for name in positions]
    if any(gaps) and not all(gaps):
        faults.append("gaps are there for some positions only; give all or none")
    return faults


def _throw_faults(frame: pd.DataFrame, throws: NDArray[np.intp]) -> list[str]:
    column = frame[THROW].to_numpy()
    if column.dtype.kind == "f" and not np.all(np.isfinite(column) & (column == np.rint(column))):
        return [f'column "{THROW}" holds what is no whole number']
    given = column.astype(np.intp)
    found = []
    single, counts = np.unique(given, return_counts=True)
    for text, which in (
        ("judged twice", single[counts > 1]),
        ("to be judged are missing", np.setdiff1d(throws, given)),
        ("are none of those to be judged", np.setdiff1d(given, throws)),
    ):
        if which.size:
            some = ", ".join(map(str, which[:MOST_NAMED])) + (", ..." if len(which) > 5 else "")
            found.append(f"{which.size} throws {text}: {some}")
    return found


def _value_faults(frame: pd.DataFrame) -> list[str]:
    found = []
    for name in (SCORE, NOVELTY):
        if name in frame and frame[name].isna().any():
            found.append(f'"{name}" is empty in {int(frame[name].isna().sum())} rows')
        if name in frame and np.isinf(frame[name]).any():
            found.append(f'"{name}" is infinite in {int(np.isinf(frame[name]).sum())} rows')
    for name in (ALARM, RARE):
        if name in frame and not frame[name].isin([0, 1]).all():
            found.append(f'"{name}" must be 0 or 1 in every row')
    if PROBABILITY in frame and not frame[PROBABILITY].between(0.0, 1.0).all():
        found.append(f'"{PROBABILITY}" must be from 0 to 1 in every row')
    for name in frame.columns:
        if str(name).endswith("_low"):
            high = frame[str(name).removesuffix("_low") + "_high"]
            wrong = int((frame[name] > high).sum())
            if wrong:
                found.append(f'"{name}" is above the other end of its interval in {wrong} rows')
    return found


def _verdicts(frame: pd.DataFrame, positions: Sequence[str]) -> Verdicts:
    def interval(base: str) -> Floats | None:
        if base not in frame:
            return None
        return frame[[f"{base}{end}" for end in RANGES]].to_numpy(dtype=np.float64)

    def column(name: str) -> Floats | None:
        return frame[name].to_numpy(dtype=np.float64) if name in frame else None

    gaps = [item for item in (interval(f"{GAP}{name}") for name in positions) if item is not None]
    rare = column(RARE)
    return Verdicts(
        throw=frame[THROW].to_numpy(dtype=np.intp),
        score=frame[SCORE].to_numpy(dtype=np.float64),
        alarm=frame[ALARM].to_numpy().astype(bool),
        rare_alarm=None if rare is None else rare.astype(bool),
        x=interval("x"),
        size=interval("size"),
        gap=np.stack(gaps, axis=1) if gaps else None,
        cause=frame[CAUSE].fillna("").to_numpy().astype(np.str_) if CAUSE in frame else None,
        probability=column(PROBABILITY),
        novelty=column(NOVELTY),
    )
