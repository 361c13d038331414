"""Share of calibrated campaigns whose 95 % intervals hold the truth: 90 to 98 % is wanted.

    python -m benchmarks.studies.calibration_coverage run --count 400 --out DIR --workers 2
    python -m benchmarks.studies.calibration_coverage report DIR

Each campaign has 4 closing movements of the panel sb1, its own true friction, stiffnesses and slip
levels, its own noise, drift and hum, and friction that scatters by 2 % from throw to throw. The
truth is solved with half the mesh, twice the modes, quarter steps and other damping. Sensitivity
and cross-talk of the force channels are wrong by draws from what the intervals allow for
(`Uncertainty`): common to a campaign, and sensitivity from movement to movement. The joint stage
of the default calibration starts 5 % or so from the truth. A campaign is fixed by its index; a job
that was stopped goes on. `report` writes into docs/evidence/calibration.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.resumable import Record, command_line
from turnout.calibration.calibrate import calibrate
from turnout.calibration.candidate_causes import FRICTION
from turnout.calibration.comparison import Uncertainty
from turnout.calibration.stages import CalibrationPlan as Stages
from turnout.calibration.stages import default_plan
from turnout.core.errors import TurnoutError
from turnout.core.scheme import Scheme
from turnout.measurement.campaign.build_campaign import stack_movements
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_files import WrittenThrow, true_sheet_row
from turnout.study.virtual.campaign_plan import CampaignPlan, Case, overrides_for, throw_generator
from turnout.study.virtual.disturbance import Disturbance, add_disturbance
from turnout.study.virtual.record_throw import Window, finer_panel, finer_scheme, record_throw
from turnout.study.virtual.series import FIELDS
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

WINDOW = Window(lead=1.0, length=5.0)
# Each drive is loaded by an object beside it and by others; two throws are free.
SB1_CASES = (
    ("none", 0.0),
    ("none", 0.0),
    ("drive 1", 0.013),
    ("drive 1", 0.029),
    ("sleeper 3", 0.021),
    ("sleeper 7", 0.013),
    ("sleeper 9", 0.024),
    ("sleeper 10", 0.018),
    ("drive 2", 0.010),
)


def short_sb1() -> LoadedPanel:
    """Return the panel sb1, whose schedule ends after the closing movement and its rest."""
    changes: dict[str, object] = {"schedule.end": 4.7, "object_defaults.disappears": None}
    changes |= {"movement.return.start": 4.55, "movement.return.duration": 0.1}
    return load_panel("sb1").with_overrides({**changes, "movement.return.extra_time": {"2": 0.0}})


@dataclass(frozen=True, kw_only=True)
class Twin:
    """Ingredients of a campaign.

    Attributes
    ----------
    panel : LoadedPanel
        Before the truth.
    truth : mapping of str to float
        Overrides that a calibration has to find.
    plan : CampaignPlan
        Scatter, defects, noise and seed.
    cases : tuple of (str, float)
        Places and sizes of closing movements.
    scheme : Scheme
        With which the truth is integrated.
    mixing : sequence of ndarray, shape (n, n)
        For each movement: what each force channel, drives and then the load cell, takes up of
        each; none for perfect sensitivities.
    """

    panel: LoadedPanel = field(default_factory=lambda: short_sb1())
    truth: Mapping[str, float] = field(default_factory=dict)
    plan: CampaignPlan = field(
        default_factory=lambda: CampaignPlan(places=("drive 1",), window=WINDOW)
    )
    cases: Sequence[tuple[str, float]] = SB1_CASES
    scheme: Scheme = field(default_factory=Scheme)
    mixing: Sequence[NDArray[np.float64]] = ()


def campaign(twin: Twin) -> xr.Dataset:
    """Return a campaign as a build stacks it."""
    true_panel = twin.panel.with_overrides(dict(twin.truth)) if twin.truth else twin.panel
    members = []
    for number, (place, size) in enumerate(twin.cases):
        name = f"{number}_{place.replace(' ', '-')}_{1e3 * size:g}mm"
        case = Case(name=name, direction="closing", size=size, place=place, repeat=number + 1)
        members.append(_member(twin, true_panel, case))
    return stack_movements(members, [None] * len(members)).assign_attrs(
        title="twin", synthetic="synthetic"
    )


def _member(twin: Twin, panel: LoadedPanel, case: Case) -> tuple[object, RecordedThrow]:
    rng = throw_generator(twin.plan, case)
    changed = overrides_for(twin.plan, panel, rng)
    foreign = ForeignObject(case.size, case.place) if case.size > 0 else None
    run = simulate(
        panel.with_overrides(dict(changed)) if changed else panel,
        foreign_object=foreign,
        scheme=twin.scheme,
        save=Save(fields=FIELDS),
    )
    lag = twin.plan.defects.build_up_lag
    window = twin.plan.window
    true = record_throw(
        run,
        direction=case.direction,
        window=window,
        build_up_lag={twin.plan.defects.drive: lag} if lag else None,
    )
    if twin.mixing:
        true = _mixed(true, twin.mixing[case.repeat - 1])
    seen = add_disturbance(true, rng=rng, disturbance=twin.plan.disturbance)
    # Forces are taken from the rest before the onset, as a build takes zeros.
    throw = FoundThrow(
        0,
        seen.sizes["time"],
        window.lead,
        window.length - 1.0,
        (np.nan, np.nan),
        "current",
        "closing",
    )
    return true_sheet_row(WrittenThrow(case, f"{case.name}.csv", False)), RecordedThrow(
        seen, throw, "", ()
    )


def _mixed(true: xr.Dataset, matrix: NDArray[np.float64]) -> xr.Dataset:
    """Return a recording whose force channels are wrong in sensitivity and take up each other."""
    rods = true["drive_force"].transpose("drive", "time")
    forces = np.vstack([rods.values, np.nan_to_num(true["object_force"].values)])
    seen = matrix @ forces
    return true.assign(
        drive_force=rods.copy(data=seen[:-1]),
        object_force=true["object_force"].copy(data=seen[-1]),
    )


SEED = 20261122
CASES = (
    ("none", 0.0),
    ("drive 1", 0.029),
    ("sleeper 7", 0.013),
    ("sleeper 9", 0.024),
)
# Standard deviation of the truth from the library, and of the start from the truth, as shares.
TRUTH, START = 0.15, 0.05
LEAST, MOST, GOAL = 0.90, 0.98, 0.95
PAGE = EVIDENCE / "calibration.md"


def result_of(index: int) -> Record:
    """Make and calibrate one campaign; return truth, values and intervals."""
    rng = np.random.default_rng([SEED, index])
    panel = short_sb1()
    plan = default_plan(panel)
    truth = {p.name: p.start * float(np.exp(TRUTH * _drawn(rng))) for p in plan.parameters}
    start = {name: value * float(np.exp(START * _drawn(rng))) for name, value in truth.items()}
    twin = Twin(
        panel=finer_panel(panel),
        truth=truth,
        plan=CampaignPlan(
            places=("drive 1",),
            window=WINDOW,
            seed=int(rng.integers(2**31)),
            disturbance=Disturbance(cross_talk=0.0),
        ),
        cases=CASES,
        scheme=replace(finer_scheme(), output_interval=Scheme().output_interval),
        mixing=mixing(rng, channels=len(panel.drive) + 1),
    )
    parameters = tuple(replace(p, start=start[p.name]) for p in plan.parameters)
    joint = Stages(parameters=parameters, stages=plan.stages[-1:])
    record: Record = {"index": index, "truth": truth}
    try:
        found = calibrate(campaign(twin), panel, plan=joint).calibration
    except TurnoutError as error:
        return record | {"failure": str(error)}
    return record | {
        "failure": "",
        "values": found.values,
        "deviations": {item.name: item.deviation for item in found.parameters},
        "intervals": {item.name: list(item.interval) for item in found.parameters},
        "states": {item.name: item.state for item in found.parameters},
        "distrust": list(found.distrust),
        "causes": list(found.fitted_causes),
    }


def mixing(rng: np.random.Generator, *, channels: int) -> list[NDArray[np.float64]]:
    """Return for each movement the gains and cross-talk of all force channels, as drawn."""
    uncertainty = Uncertainty()
    common = uncertainty.cross_talk * rng.standard_normal((channels, channels))
    np.fill_diagonal(common, 1.0 + uncertainty.common_gain * rng.standard_normal(channels))
    return [np.diag(1.0 + uncertainty.gain * rng.standard_normal(channels)) @ common for _ in CASES]


def _drawn(rng: np.random.Generator) -> float:
    """Return a normal number, at most two standard deviations from zero."""
    return float(np.clip(rng.standard_normal(), -2.0, 2.0))


def coverage(records: list[Record]) -> dict[str, tuple[int, int, float, float]]:
    """Return by parameter: intervals that hold the truth, intervals, spread of z, share without.

    The spread is the standard deviation of (value - truth) / standard deviation, 1 where the
    stated uncertainty is right. The last is the share of intervals that would hold the truth
    without the uncertainty of the model's scale, which forces and stiffnesses have.
    """
    found: dict[str, tuple[int, int, float, float]] = {}
    good = [record for record in records if not record["failure"]]
    for name in good[0]["truth"] if good else ():
        own = [record for record in good if record["states"][name] == "fitted"]
        held = [r["intervals"][name][0] <= r["truth"][name] <= r["intervals"][name][1] for r in own]
        z = [(r["values"][name] - r["truth"][name]) / r["deviations"][name] for r in own]
        bare = [_held_without_scale(record, name) for record in own]
        spread = float(np.std(z)) if z else float("nan")
        found[name] = (sum(held), len(own), spread, float(np.mean(bare)) if bare else float("nan"))
    return found


def _held_without_scale(record: Record, name: str) -> bool:
    """Return whether an interval without the constant part of the scale would hold the truth."""
    value, truth, deviation = (record[key][name] for key in ("values", "truth", "deviations"))
    low, high = record["intervals"][name]
    scale = 0.0 if name == FRICTION else Uncertainty().scale * value
    left = np.sqrt(max(1.0 - (scale / deviation) ** 2, 0.0))
    reach = left * (high - value if truth > value else value - low)
    return bool(abs(truth - value) <= reach)


def section(records: list[Record]) -> list[str]:
    """Return the part of the page that this job writes."""
    failed = sum(bool(record["failure"]) for record in records)
    lines = [
        f"{len(records)} campaigns, seed {SEED}, {len(CASES)} movements each, {failed} of them "
        "not calibrated. Panel `sb1`; written by "
        "`python -m benchmarks.studies.calibration_coverage report DIR`.",
        "",
        "| parameter | 95 % intervals that hold the truth | of | share (± 1 standard error) | "
        "spread of the error in stated deviations | share without the uncertainty of the scale |",
        "|---|---|---|---|---|---|",
    ]
    for name, (held, count, spread, bare) in coverage(records).items():
        share = held / max(count, 1)
        doubt = np.sqrt(share * (1.0 - share) / max(count, 1))
        lines.append(
            f"| `{name}` | {held} | {count} | {100 * share:.1f} ± {100 * doubt:.1f} % | "
            f"{spread:.2f} | {100 * bare:.1f} % |"
        )
    return lines


def report(records: list[Record]) -> None:
    """Write the table into its page."""
    put_section(PAGE, name="coverage", heading="Do the intervals hold?", lines=section(records))


if __name__ == "__main__":
    command_line(result_of, report, count=400)
