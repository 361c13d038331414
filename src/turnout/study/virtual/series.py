"""Throw the series of a virtual campaign, in one process or several; each throw is kept."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.kept_results import read_arrays, write_arrays
from turnout.core.running_current import running_time
from turnout.core.workers import Workers
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.recorded_throw import (
    RecordedThrow,
    piece_arrays,
    piece_of_arrays,
)
from turnout.measurement.campaign.run_sheet import LOAD_CELL_FROM
from turnout.measurement.chain.channel_map import ChannelMap
from turnout.measurement.chain.monitoring import monitored, monitoring_recording
from turnout.measurement.formats.file_format import write_recording
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.study.virtual.campaign_files import write_throw
from turnout.study.virtual.campaign_plan import CampaignPlan, Case, overrides_for, throw_generator
from turnout.study.virtual.disturbance import add_disturbance
from turnout.study.virtual.record_throw import (
    OF_MACHINES,
    extend_schedule,
    record_powers,
    record_throw,
)
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

STATE, MONITORING = ".virtual", "monitoring"
FIELDS = (
    *("drive_force", "drive_displacement", "drive_slipping", "drive_current", "object_force"),
    "contact_time",
)
KEPT = ("drive_force", "drive_current", "object_force")
# Rest and hold that the truth keeps around a throw, as a build of the campaign does [s].
KEPT_AROUND = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowJob:
    """One series of throws and all that is needed to make it in another process."""

    panel: LoadedPanel
    plan: CampaignPlan
    cases: tuple[Case, ...]
    folder: Path
    suffix: str
    channel_map: ChannelMap
    first_number: int
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class SeriesPart:
    """Kept result of a throw: its truth, or the reason for having none."""

    piece: RecordedThrow | None
    slipped: bool
    overrides: Mapping[str, float]
    failure: str


def run_jobs(
    jobs: Sequence[ThrowJob],
    *,
    folder: Path,
    workers: int,
    report: Callable[[int, int], None] | None,
) -> None:
    """Make every series that is not there yet.

    Parameters
    ----------
    jobs : sequence of Job
        One a series.
    folder : Path
        Of the campaign.
    workers : int
        Processes; with one, all is done in this one.
    report : callable or None
        Called now and then with throws done and throws at most.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C; what was thrown by then is kept.
    """
    total = sum(len(job.cases) for job in jobs)

    def report_one() -> None:
        if report is not None:
            report(len(list((folder / STATE).glob("*.npz"))), total)

    many = min(workers, len(jobs))
    with Workers(many if many > 1 else 0) as processes:
        made = [partial(make_series, job, report=None if many > 1 else report_one) for job in jobs]
        for _ in processes.run(made, wait=report_one):
            report_one()


def make_series(job: ThrowJob, *, report: Callable[[], None] | None = None) -> None:
    """Throw one series until a drive slips with an object, or the solver gives up."""
    for number, case in enumerate(job.cases):
        part = read_part(job.folder, case)
        if part is None:
            part = make_throw(job, case, number=job.first_number + number)
            _write_part(job.folder, case, part)
        if report is not None:
            report()
        if part.failure or stops_series(part, case, job.plan):
            return


def stops_series(part: SeriesPart, case: Case, plan: CampaignPlan) -> bool:
    """Return True if no larger object is tried after this throw."""
    return part.slipped and case.size >= plan.at_least - 1e-9


def make_throw(job: ThrowJob, case: Case, *, number: int) -> SeriesPart:
    """Simulate one throw, write its recording, and return its truth.

    Parameters
    ----------
    job : Job
        Panel, plan and folder.
    case : Case
        Direction, size and place.
    number : int
        Number of the throw in the campaign.

    Returns
    -------
    Part
    """
    plan, rng = job.plan, throw_generator(job.plan, case)
    overrides = overrides_for(plan, job.panel, rng)
    panel = job.panel.with_overrides(dict(overrides)) if overrides else job.panel
    foreign = ForeignObject(case.size, case.place) if case.size > 0 else None
    run = simulate(
        extend_schedule(panel),
        foreign_object=foreign,
        scheme=plan.scheme,
        save=Save(fields=FIELDS if plan.monitoring is None else (*FIELDS, *_powers(panel))),
        throw=False,
    )
    if not run.attrs["complete"]:
        if run.attrs["outcome"] == "interrupted":
            raise KeyboardInterrupt
        return SeriesPart(None, False, overrides, str(run.attrs["outcome_message"]))
    lag = plan.defects.build_up_lag
    true = record_throw(
        run,
        direction=case.direction,
        window=plan.window,
        law=plan.law,
        build_up_lag={plan.defects.drive: lag} if lag else None,
    )
    seen = add_disturbance(
        _without_idle_cell(true, case),
        rng=rng,
        disturbance=plan.disturbance,
        response=plan.recorder,
    )
    write_throw(
        seen,
        job.folder / f"{case.name}{job.suffix}",
        channel_map=job.channel_map,
        number=number,
        note=job.note,
    )
    if plan.monitoring is not None:
        powers = record_powers(run, true, direction=case.direction, window=plan.window)
        target = job.folder / MONITORING / f"{case.name}.csv"
        target.parent.mkdir(exist_ok=True)
        stored = monitored(powers, plan.monitoring)
        write_recording(monitoring_recording(stored, source=job.note), target)
    return SeriesPart(_true_piece(true, case), bool(true.attrs["slipped"]), overrides, "")


def _powers(panel: LoadedPanel) -> tuple[str, ...]:
    """Return the channels of voltage and power that a panel's drives have."""
    motors = [panel.machine[d.machine].motor for d in panel.drive.values() if d.machine]
    alternating = any(motor.of_kind.alternating for motor in motors)
    return OF_MACHINES[: 0 if not motors else 3 if alternating else 2]


def read_part(folder: Path, case: Case) -> SeriesPart | None:
    """Return the kept result of a throw, or None if it is missing or damaged."""

    def made(arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> SeriesPart:
        described, *known = (about[n] for n in ("piece", "slipped", "overrides", "failure"))
        piece = None if described is None else piece_of_arrays(arrays, described)
        return SeriesPart(piece, *known)

    return read_arrays(_part_path(folder, case), case.name, made)


def _write_part(folder: Path, case: Case, part: SeriesPart) -> None:
    """Keep the result of a throw."""
    arrays, described = ({}, None) if part.piece is None else piece_arrays(part.piece)
    known = {"slipped": part.slipped, "overrides": dict(part.overrides), "failure": part.failure}
    write_arrays(_part_path(folder, case), case.name, arrays, {"piece": described, **known})


def _without_idle_cell(true: xr.Dataset, case: Case) -> xr.Dataset:
    """Return a throw as recorded: a load cell that is thinner than the object, or nothing on it."""
    if case.size >= LOAD_CELL_FROM - 1e-9:
        return true
    return true.assign(object_force=0.0 * true["object_force"])


def _true_piece(true: xr.Dataset, case: Case) -> RecordedThrow:
    """Cut the truth as a build cuts a recording."""
    time = true["time"].values
    offs = [running_time(time, row)[1] for row in true["drive_current"].values]
    onset, end = float(true.attrs["onset"]), float(np.nanmax(offs))
    kept = true[[*KEPT]].sel(time=slice(onset - KEPT_AROUND, end + KEPT_AROUND)).drop_attrs()
    count, by = kept.sizes["time"], "simulation"
    return RecordedThrow(kept, FoundThrow(0, count, onset, end, (), by, case.direction), "", ())


def _part_path(folder: Path, case: Case) -> Path:
    return folder / STATE / f"{case.name}.npz"
