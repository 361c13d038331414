"""Campaigns in memory whose truth is known: throws of a panel with noise, as a build stacks them.

Small enough that hundreds are made and calibrated in an hour: panel sb1, whose clean throw takes a
tenth of a second. A throw of its own friction, slip level, noise, drift, hum and cross-talk each,
as in a virtual campaign, but without files between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.measurement.campaign.build_campaign import stack_movements
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_files import WrittenThrow, true_sheet_row
from turnout.study.virtual.campaign_plan import CampaignPlan, Case, overrides_for, throw_generator
from turnout.study.virtual.disturbance import add_disturbance
from turnout.study.virtual.record_throw import Window, record_throw
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
    """What a campaign is made of.

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
