"""Make a virtual campaign: a folder as a measurement leaves it, and the truth beside it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.core.files import refuse_file, write_atomic
from turnout.core.kept_results import claim_for
from turnout.core.provenance import content_hash, provenance, version
from turnout.core.toml import parse_toml
from turnout.measurement.campaign.build_campaign import stack_movements
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.measurement.chain.apply import parse_channel_map
from turnout.measurement.chain.monitoring import transformers
from turnout.measurement.chain.recorder import PERFECT
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import ordered_movements
from turnout.study.virtual.campaign_files import (
    CHANNELS,
    SHEET,
    WrittenThrow,
    channel_map_text,
    mistype,
    monitoring_map_text,
    sheet_text,
    synthetic_note,
    true_sheet_row,
)
from turnout.study.virtual.campaign_plan import CampaignPlan, Case, check_plan, has_room, series_of
from turnout.study.virtual.record_throw import DIRECTIONS
from turnout.study.virtual.series import (
    MONITORING,
    STATE,
    ThrowJob,
    read_part,
    run_jobs,
    stops_series,
)
from turnout.throw.drives import machine_supplies
from turnout.throw.store import save_response

TRUTH = "truth.nc"
_PLAN_FILE = f"{STATE}/plan.json"


@dataclass(frozen=True, slots=True)
class VirtualCampaign:
    """Result of a virtual campaign.

    Attributes
    ----------
    thrown : tuple of WrittenThrow
        Every movement, as it truly was.
    mistakes : tuple of str
        Made in the run sheet on purpose.
    failures : tuple of str
        Throws that the solver did not finish; their series end there.
    oversized : tuple of str
        Places and sizes of the plan that were not thrown, as the rails leave no room for them.
    """

    thrown: tuple[WrittenThrow, ...]
    mistakes: tuple[str, ...]
    failures: tuple[str, ...]
    oversized: tuple[str, ...] = ()


def make_virtual_campaign(
    panel: LoadedPanel,
    folder: Path | str,
    *,
    plan: CampaignPlan,
    workers: int = 1,
    report: Callable[[int, int], None] | None = None,
) -> VirtualCampaign:
    """Throw a whole campaign and write the files that a data acquisition system would leave.

    Each throw is kept as soon as it is made. The same call on a folder that was left early, by
    Ctrl-C too, goes on where it stopped, and comes to the same files.

    Parameters
    ----------
    panel : LoadedPanel
        Panel to throw.
    folder : path-like
        Made if it is not there; must be empty, or hold the beginning of this campaign.
    plan : CampaignPlan
        Places, sizes, chance and defects.
    workers : int
        Processes that simulate at the same time, at least 1.
    report : callable, optional
        Called now and then with throws done and throws at most.

    Returns
    -------
    VirtualCampaign
        The folder holds recordings, `channels.toml`, `runs.csv` and `truth.nc`: the movements as
        simulated, in the form that the campaign takes when it is built. With a monitoring system
        its folder `monitoring` is a campaign too.

    Raises
    ------
    FileError
        When the plan does not fit the panel, or the folder holds something else.
    """
    folder = Path(folder)
    check_plan(plan, panel)
    directions = tuple(
        dict.fromkeys(DIRECTIONS[movement.to] for _, movement in ordered_movements(panel))
    )
    if plan.places and "closing" not in directions:
        message = f"panel {panel.name} has no closing movement, so nothing can be trapped in it"
        raise FileError(message)
    _claim(folder, panel, plan)
    machines = sum(drive.machine is not None for drive in panel.drive.values())
    note = synthetic_note(panel.name, machines=machines, drives=len(panel.drive))
    stated = plan.recorder if plan.recorder_stated else PERFECT
    map_text = channel_map_text(list(panel.drive), note=note, recorder=stated)
    write_atomic(folder / CHANNELS, map_text)
    series, oversized = _with_room(panel, series_of(plan, directions))
    jobs = _jobs(panel, plan, series, folder, map_text=map_text, note=note)
    run_jobs(jobs, folder=folder, workers=workers, report=report)
    return replace(_finish(panel, plan, series, folder, note=note), oversized=oversized)


def _with_room(
    panel: LoadedPanel, series: Sequence[Sequence[Case]]
) -> tuple[list[list[Case]], tuple[str, ...]]:
    """Return series without objects larger than the opening, and a list of those left out."""
    fits = {
        (case.place, case.size): case.size == 0.0 or has_room(panel, case.size, case.place)
        for cases in series
        for case in cases
    }
    kept = [[case for case in cases if fits[case.place, case.size]] for cases in series]
    out = tuple(f"{1e3 * size:g} mm at {place}" for (place, size), fit in fits.items() if not fit)
    return [cases for cases in kept if cases], out


def _claim(folder: Path, panel: LoadedPanel, plan: CampaignPlan) -> None:
    """Make the folder ours, or refuse one that holds something else."""
    identity = content_hash(
        {"panel": panel.hash, "plan": _plain(asdict(plan)), "version": version()}
    )
    refuse_file(folder)
    claim_for(folder, _PLAN_FILE, {"digest": identity}, what="virtual campaign")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _jobs(
    panel: LoadedPanel,
    plan: CampaignPlan,
    series: Sequence[Sequence[Case]],
    folder: Path,
    *,
    map_text: str,
    note: str,
) -> list[ThrowJob]:
    """Return one job a series; the file format changes from series to series."""
    channel_map = parse_channel_map(parse_toml(map_text, source=CHANNELS))
    jobs, number = [], 0
    for place, cases in enumerate(series):
        jobs.append(
            ThrowJob(
                panel=panel,
                plan=plan,
                cases=tuple(cases),
                folder=folder,
                suffix=plan.formats[place % len(plan.formats)],
                channel_map=channel_map,
                first_number=number,
                note=note,
            )
        )
        number += len(cases)
    return jobs


def _finish(
    panel: LoadedPanel,
    plan: CampaignPlan,
    series: Sequence[Sequence[Case]],
    folder: Path,
    *,
    note: str,
) -> VirtualCampaign:
    """Write the run sheet and the truth of all that was thrown."""
    thrown: list[WrittenThrow] = []
    pieces: list[RecordedThrow] = []
    details: list[dict[str, Any]] = []
    failures: list[str] = []
    for place, cases in enumerate(series):
        suffix = plan.formats[place % len(plan.formats)]
        for case in cases:
            part = read_part(folder, case)
            if part is None:
                break
            if part.piece is None:
                failures.append(f"{case.name}: {part.failure}")
                break
            thrown.append(WrittenThrow(case, case.name + suffix, part.slipped))
            pieces.append(part.piece)
            details.append({"movement": case.name, "overrides": part.overrides})
            if case.size > 0 and stops_series(part, case, plan):
                break
    if not thrown:
        message = f"{folder}: no throw came to an end: {'; '.join(failures)}"
        raise FileError(message)
    rng = np.random.default_rng([plan.seed, 1])
    lines, mistakes = mistype(thrown, count=plan.mistyped, rng=rng)
    truth = stack_movements(
        [(true_sheet_row(item), piece) for item, piece in zip(thrown, pieces, strict=True)],
        [item.slipped for item in thrown],
    )
    attributes: dict[str, Any] = {
        "title": f"truth of the virtual campaign of {panel.name}",
        "kind": "simulation",
        "synthetic": note.removeprefix("synthetic: "),
        **provenance(),
        "schema_version": SCHEMA_VERSION,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "overrides": json.dumps({key: str(value) for key, value in panel.overrides.items()}),
        "plan": json.dumps(_plain(asdict(plan))),
        "movements_overrides": json.dumps(details),
        "mistakes": json.dumps(mistakes),
        "failures": json.dumps(failures),
    }
    save_response(truth.assign_attrs(attributes), folder / TRUTH)
    title = f"virtual campaign of {panel.name}"
    sheet = partial(sheet_text, note=note, title=title, panel=panel.name)
    write_atomic(folder / SHEET, sheet(lines))
    if plan.monitoring is not None:
        stored = [replace(line, file=f"{Path(line.file).stem}.csv") for line in lines]
        groups = transformers(list(panel.drive), plan.monitoring)
        map_text = monitoring_map_text(groups, machine_supplies(panel), note=note)
        write_atomic(folder / MONITORING / CHANNELS, map_text)
        write_atomic(folder / MONITORING / SHEET, sheet(stored))
    return VirtualCampaign(tuple(thrown), tuple(mistakes), tuple(failures))
