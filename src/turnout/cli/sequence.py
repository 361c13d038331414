"""Many throws of one switch by `turnout simulate --throws`: options, table and record."""

import json
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from turnout.cli.output import coloured, refuse
from turnout.cli.watch import watched

if TYPE_CHECKING:
    import xarray as xr

    from turnout.core.scheme import Scheme
    from turnout.panel.foreign_object import ForeignObject
    from turnout.panel.load import LoadedPanel
    from turnout.throw.drift import Drift

MOST_ROWS = 20
"""Throws that are printed; all are in the file and in --json."""


def read_drift(settings: Sequence[str]) -> "Drift":
    """Read the changes from throw to throw from KEY=VALUE of a command line.

    Raises
    ------
    FileError
        With all problems at once.

    Examples
    --------
    >>> read_drift(["ice_growth=0.3mm", "temperature=-20 degC to -5 degC"]).temperature
    (253.15, 268.15)
    """
    from dataclasses import fields

    from turnout.core.errors import ResponseError
    from turnout.core.problems import choices, nearest
    from turnout.throw.drift import Drift

    names = [item.name for item in fields(Drift)]
    found: dict[str, Any] = {}
    problems = []
    for setting in settings:
        key, sign, value = (part.strip() for part in setting.partition("="))
        if not sign or not value:
            problems.append(f'--drift "{setting}": is not KEY=VALUE')
        elif key not in names:
            known = f"there are {choices(names)}"
            problems.append(
                f'--drift "{setting}": there is no such key{nearest(key, names)}; {known}'
            )
        elif key in found:
            problems.append(f'--drift "{setting}": {key} is given twice')
        elif key == "temperature" and value.split()[-1] == "to":
            problems.append(f'--drift "{setting}": give both ends, as in "-20 degC to -5 degC"')
        elif key == "temperature":
            found[key] = tuple(part.strip() for part in value.split(" to "))
        else:
            found[key] = _number_or_text(key, value)
    if not problems:
        try:
            return Drift(**found)
        except ResponseError as error:
            problems.append(str(error))
    refuse("\n".join(problems))


def _number_or_text(key: str, value: str) -> int | float | str:
    """Return a plain number; a value that needs a unit keeps its text; a bare one is refused."""
    from turnout.throw.drift import WITH_UNIT

    if key in WITH_UNIT:
        return value
    try:
        return int(value) if key == "seed" else float(value)
    except ValueError:
        return value


def run_sequence(
    panel: "LoadedPanel",
    objects: "Sequence[ForeignObject]",
    *,
    throws: int,
    drift: "Drift",
    scheme: "Scheme",
    quiet: bool,
) -> "xr.Dataset":
    """Make the throws with progress; those until an interruption or a failure come back."""
    from turnout.throw.sequence import simulate_sequence

    with watched(f"simulating {throws} throws of {panel.name}", quiet=quiet) as watch:
        return simulate_sequence(
            panel,
            throws=throws,
            foreign_object=list(objects),
            drift=drift,
            scheme=scheme,
            throw=False,
            report=watch.report,
        )


def sequence_record(dataset: "xr.Dataset") -> tuple[dict[str, Any], dict[str, str]]:
    """Return a sequence of throws as a record, and the units of its keys."""
    from turnout.metric.verdict import break_note, throw_table

    attributes = dataset.attrs
    note = break_note(dataset)
    record = {
        "panel": attributes.get("panel"),
        "panel_hash": attributes.get("panel_hash"),
        "foreign_objects": json.loads(attributes.get("foreign_objects", "[]")),
        "drift": json.loads(attributes["drift"]),
        "complete": bool(attributes["complete"]),
        "outcome": attributes["outcome"],
        "outcome_message": attributes["outcome_message"],
        "throws": throw_table(dataset),
        **({"break_note": note} if note else {}),
        **({"object_peak_note": peak} if (peak := attributes.get("object_peak_note")) else {}),
        "wall_time": attributes["wall_time"],
    }
    units = {
        "size": "m", "left": "m", "object_force_peak": "N", "drive_force_end": "N",
        "force_margin": "N", "temperature": "K", "wall_time": "s",
    }  # fmt: skip
    return record, units


def sequence_lines(dataset: "xr.Dataset") -> Iterator[str]:
    """Yield a table of the throws, of many only some."""
    from turnout.metric.verdict import break_note, throw_table

    count = dataset.sizes["throw"]
    every = max(1, -(-count // MOST_ROWS))
    shown = [*range(0, count - 1, every), count - 1]
    yield (
        f"{'throw':>6} {'size':>10} {'left':>10} {'object':>9} {'drives':>14}  "
        f"{'verdict':<18}lock, control"
    )
    for row in throw_table(dataset.isel(throw=shown)):
        size = "+".join(f"{1e3 * value:.1f}" for value in row["size"]) or "-"
        left = "+".join(f"{1e3 * value:.1f}" for value in row["left"]) or "-"
        peak = 1e-3 * row["object_force_peak"]
        drives = "/".join(f"{1e-3 * value:.2f}" for value in row["drive_force_end"])
        yield (
            f"{row['throw']:>6} {size:>7} mm {left:>7} mm {peak:>6.2f} kN {drives:>11} kN  "
            f"{row['verdict']:<18}{row['state']}"
        )
    yield f"{count} throws, {dataset.attrs['wall_time']:.1f} s"
    if note := dataset.attrs.get("object_peak_note"):
        yield f"object: {note}"
    if note := break_note(dataset):
        yield coloured(note, "look")
