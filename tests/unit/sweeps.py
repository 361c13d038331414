"""Small studies, and sweeps of them without other processes."""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

from turnout.calibration.load_study import load_study
from turnout.study.study import Study
from turnout.study.sweep.row import ScenarioRow
from turnout.throw.signals import Channel

STUDY = """
schema_version = 1
name = "tiny"
description = "One rail, cut short."
panel = "sb1"
seed = 3

[set]
"schedule.end" = "1.1 s"
"movement.throw.start" = "0.05 s"
"movement.throw.duration" = "0.3 s"
"movement.return.start" = "0.45 s"
"movement.return.duration" = "0.3 s"

[[variable]]
key = "chair.friction_coefficient"
distribution = "uniform"
minimum = 0.1
maximum = 0.4

[sampling]
count = {count}
"""

# Batches made in this very process.
here: Callable[[], Executor] = partial(ThreadPoolExecutor, 1)


def study_file(folder: Path, *, count: int = 20, text: str = STUDY, more: str = "") -> Path:
    path = folder / "study.toml"
    path.write_text(text.format(count=count) + more, encoding="utf-8")
    return path


def small_study(folder: Path, *, count: int = 20, more: str = "") -> Study:
    return load_study(study_file(folder, count=count, more=more))


def batch_names(folder: Path) -> list[str]:
    """Names hold digests of contents, so equal names mean equal bytes."""
    return sorted(path.name for path in (folder / "batches").glob("[0-9]*.nc"))


def variables_of(row: ScenarioRow) -> dict[str, Channel]:
    """Return histories, labels and features of a throw alone; nothing unless it is complete."""
    if row.stored is None:
        return {}
    count, found = row.stored.instants[row.number], dict[str, Channel]()
    for name, (dims, values) in row.stored.variables.items():
        own = values[row.number, ...]
        found[name] = (dims, own[..., :count] if dims[-1:] == ("time",) else own)
    return found
