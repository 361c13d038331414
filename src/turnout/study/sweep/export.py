"""Export a sweep as a table for other programs, and describe it on a data card.

The table has a row for each scenario: inputs, outcome, labels and features. The data card
(README.md) states how the sweep was made, its ranges, versions and splits.
"""

import io
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from turnout.core.errors import FileError
from turnout.core.files import write_atomic
from turnout.core.provenance import provenance
from turnout.metric.features import FEATURES
from turnout.study.study import Study
from turnout.study.sweep.batch import SPLITS, StoredVariable
from turnout.study.sweep.batch_index import BatchIndex, label_arrays, read_index
from turnout.study.sweep.folder import CARD
from turnout.study.sweep.row import OUTCOMES, UNUSABLE
from turnout.study.sweep.stored_study import load_stored_study

if TYPE_CHECKING:
    import pandas as pd


Labels = Mapping[str, StoredVariable]

_STANDARD_COLUMNS = frozenset(("outcome", "reason", "attempts", "condition", "split", *FEATURES))
MOST_REASONS = 10
MOST_TEXTS = 16


def write_sweep_card(folder: Path, digest: str) -> None:
    """Write the data card of a sweep into its folder, from the files stored there.

    Parameters
    ----------
    folder : Path
        Of the sweep, with at least one batch.
    digest : str
        Of the study that was thrown and is stored there.
    """
    index, study = read_index(folder), load_stored_study(folder, digest)
    labels = label_arrays(index, names=_STANDARD_COLUMNS)
    write_atomic(folder / CARD, card_text(index, labels, study))


def card_text(index: BatchIndex, labels: Labels, study: Study) -> str:
    """Return the data card as Markdown.

    Parameters
    ----------
    index : Index
        Of the sweep.
    labels : mapping of str to Stored
        From `label_arrays`.
    study : Study
        Study that was thrown.
    """
    made = provenance()
    known = index.attributes
    kept = ", ".join(f"`{name}`" for name in study.output.channels) or "none"
    return f"""# {study.name}

{study.description or "No description was given."}

**Simulated, not measured.** {index.scenario.size} throws of panel `{study.panel.name}`
(hash {study.panel.hash[:12]}), one a scenario. Made with turnout {known["version"]} (sources
{known["code"]}), Python {made["python"]} on {made["platform"]}.

- study digest {study.digest[:16]}, seed {study.seed}
- scheme: {study.scheme.describe()}; a throw that did not get to its end was made again with half
  the step (`attempts`)
- histories kept: {kept}, single precision, every {1e3 * study.output.interval:g} ms
- labels and features are taken from every instant that the solver kept, in double precision
- SI units; forces and displacements are positive in the closing direction

Read it with `turnout.study.sweep.read.open_batches(folder)`: one dataset with the dimensions
scenario and time. Where a scenario is not complete numbers are NaN and logical values -1.

## Outcomes

{_outcomes(labels, missing=known["missing"])}

## Inputs

{_inputs(labels)}

## Features

By drive and direction of movement; times count from the onset of the movement.

{_features(labels)}

## Splits

By condition, never by row: all scenarios of a condition are in the same part (`split`), so that a
test sees no switch that was trained on. A part is chosen by a hash of the condition and the seed.

{_splits(labels)}
"""


def _outcomes(labels: Labels, *, missing: int) -> str:
    outcome, reason = labels["outcome"].values, labels["reason"].values
    lines = ["| outcome | scenarios |", "|---|---|"]
    lines += [f"| {name} | {int((outcome == name).sum())} |" for name in OUTCOMES]
    lines.append(f"| not thrown yet | {missing} |")
    again = int((labels["attempts"].values > 1).sum())
    lines += ["", f"{again} scenarios took a second attempt."]
    bad = reason[np.isin(outcome, UNUSABLE)]
    kinds, counts = np.unique(bad.astype(str), return_counts=True)
    order = np.argsort(-counts, kind="stable")[:MOST_REASONS]
    lines += [f"- {counts[at]} x {kinds[at]}" for at in order]
    return "\n".join(lines)


def _inputs(labels: Labels) -> str:
    lines = ["| input | unit | least | largest | values |", "|---|---|---|---|---|"]
    for name, variable in labels.items():
        if "input" not in variable.attributes:
            continue
        values = variable.values
        units = str(variable.attributes["units"])
        if values.dtype.kind == "O":
            texts = sorted(set(values.tolist()))
            shown = ", ".join(texts[:MOST_TEXTS]) + (" ..." if len(texts) > MOST_TEXTS else "")
            lines.append(f"| `{name}` | {units} | | | {len(texts)}: {shown} |")
        else:
            distinct = np.unique(values).size
            ends = f"{float(np.min(values)):.6g} | {float(np.max(values)):.6g}"
            lines.append(f"| `{name}` | {units} | {ends} | {distinct} |")
    return "\n".join(lines)


def _features(labels: Labels) -> str:
    lines = ["| feature | unit | meaning | least | largest |", "|---|---|---|---|---|"]
    for name, feature in FEATURES.items():
        values = labels[name].values if name in labels else np.array([np.nan])
        known = values[np.isfinite(values)]
        ends = f"{known.min():.6g} | {known.max():.6g}" if known.size else "- | -"
        lines.append(f"| `{name}` | {feature.units} | {feature.long_name} | {ends} |")
    return "\n".join(lines)


def _splits(labels: Labels) -> str:
    split, condition = labels["split"].values, labels["condition"].values
    lines = ["| split | conditions | scenarios |", "|---|---|---|"]
    for name in SPLITS:
        mine = split == name
        lines.append(f"| {name} | {len(set(condition[mine].tolist()))} | {int(mine.sum())} |")
    return "\n".join(lines)


SUFFIXES = (".parquet", ".csv", ".mat")
LONGEST_NAME = 63
"""Of a variable that MATLAB takes."""


def sweep_table(folder: Path | str) -> "pd.DataFrame":
    """Return all that has no time as columns; drive and direction are in their names.

    Parameters
    ----------
    folder : path-like
        Of a sweep.

    Returns
    -------
    pandas.DataFrame
        A row a scenario that was thrown, in SI; ``attrs["units"]`` holds the unit of each column.
        A feature of a drive in a direction is called as in ``peak_force.2.closing``.

    Raises
    ------
    FileError
        When the folder holds no sweep.
    """
    import pandas as pd

    from turnout.study.sweep.read import (
        read_labels,  # loads xarray, which a run of a sweep needs nowhere
    )

    labels = read_labels(folder)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for name, variable in labels.variables.items():
        if variable.dims[:1] != ("scenario",):
            continue
        members = [labels[dim].values.tolist() for dim in variable.dims[1:]]
        for number, parts in enumerate(product(*members)):
            column = ".".join((str(name), *map(str, parts)))
            columns[column] = variable.values.reshape(variable.shape[0], -1)[:, number]
            units[column] = str(variable.attrs.get("units", "1"))
    table = pd.DataFrame(columns)
    table.attrs["units"] = units
    return table


def export_bytes(table: "pd.DataFrame", suffix: str) -> bytes:
    """Return the content of a file with a table.

    Parameters
    ----------
    table : pandas.DataFrame
        From `sweep_table`.
    suffix : str
        ".parquet", ".csv" or ".mat"; MATLAB gets a structure `sweep` of columns, in whose names
        all but letters and digits is "_", and `units` beside it.

    Returns
    -------
    bytes

    Raises
    ------
    FileError
        When another package is needed for it, or there is no such form.
    """
    if suffix == ".csv":
        return table.to_csv(index=False, float_format="%.9g").encode()
    if suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            message = "--parquet needs pyarrow; install it with: pip install 'turnout[parquet]'"
            raise FileError(message) from None
        return bytes(table.to_parquet(index=False, engine="pyarrow"))
    if suffix == ".mat":
        return _matlab_bytes(table)
    message = f"'{suffix}': there are {', '.join(SUFFIXES)}"
    raise FileError(message)


def _matlab_bytes(table: "pd.DataFrame") -> bytes:
    from scipy.io import savemat

    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for column in table.columns:
        values = table[column].to_numpy()
        name = matlab_name(str(column))
        columns[name] = values if values.dtype.kind in "fib" else values.astype(object)
        units[name] = table.attrs["units"][column]
    content = io.BytesIO()
    savemat(
        content,  # type: ignore[arg-type]
        {"sweep": columns, "units": units},
        long_field_names=True,
        oned_as="column",
        do_compression=True,
    )
    return content.getvalue()


def matlab_name(column: str) -> str:
    """Return a name that MATLAB takes.

    Examples
    --------
    >>> matlab_name("peak_force.2.closing"), matlab_name("2nd")
    ('peak_force_2_closing', 'x2nd')
    """
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in column)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST_NAME]
