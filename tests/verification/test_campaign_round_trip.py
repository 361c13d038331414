"""Simulated throws come back from the files of a virtual campaign as they went in.

Reference: the simulation itself, filtered as a campaign is (`truth.nc`). Tolerances: with the
noise, drift, hum and cross-talk of a virtual campaign, the mean departure of each channel is below
0.5 % of its peak and the onset is found within 5 ms; without any of them, no digit that counts is
lost in the files.
"""

import atexit
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import sb2_panel

from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.measurement.formats.file_format import WRITERS
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.disturbance import QUIET
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.study.virtual.record_throw import Window
from turnout.throw.store import open_response

BIAS, ONSET = 0.005, 0.005
CHANNELS = ("drive_force", "drive_current", "object_force")
FORMATS = tuple(sorted(WRITERS))
WINDOW = Window()


@cache
def pair(*, quiet: bool) -> tuple[xr.Dataset, xr.Dataset]:
    """Return what was built of a campaign, and its truth, on the same times; quiet in all formats.

    Series of one place have one format.
    """
    plan = CampaignPlan(places=("sleeper 6",), sizes=(0.013, 0.031), object_free=3, seed=77)
    if quiet:
        plan = CampaignPlan(
            places=("sleeper 6", "sleeper 4", "sleeper 3"),
            sizes=(0.013,),
            object_free=0,
            formats=FORMATS,
            disturbance=QUIET,
        )
    folder = Path(mkdtemp()) / "campaign"
    atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
    make_virtual_campaign(sb2_panel(), folder, plan=plan)
    assert {path.suffix for path in folder.glob("*_1.*")} == set(plan.formats)
    campaign = build_campaign_dataset(folder)
    assert campaign.dataset is not None
    assert campaign.excluded == ()
    truth = open_response(folder / "truth.nc")
    truth = truth.reindex(time=campaign.dataset["time"], method="nearest", tolerance=1e-6)
    return campaign.dataset, truth


@pytest.mark.parametrize("channel", CHANNELS)
def test_bias_is_below_half_a_percent_of_the_peak(channel: str) -> None:
    built, truth = (dataset[channel] for dataset in pair(quiet=False))
    peak = np.abs(truth).max("time")
    bias = np.abs((built - truth).mean("time")) / peak
    known = np.isfinite(bias.values)
    # A load cell only with objects of 13 and 31 mm; all else in every movement of two drives.
    assert known.sum() == (2 if channel == "object_force" else 2 * built.sizes["movement"])
    assert bias.values[known].max() < BIAS


def test_the_onset_is_found_within_5_ms() -> None:
    built, _ = pair(quiet=False)
    assert built.sizes["movement"] == 8
    assert np.abs(built["onset"].values - WINDOW.lead).max() < ONSET


def test_slips_are_found() -> None:
    built, truth = pair(quiet=False)
    np.testing.assert_array_equal(built["slipped"], truth["slipped"])
    assert built["slipped"].values.sum() == 1


@pytest.mark.parametrize("channel", CHANNELS)
def test_without_disturbance_nothing_is_lost(channel: str) -> None:
    built, truth = (dataset[channel].sel(time=slice(-0.9, 4.2)) for dataset in pair(quiet=True))
    np.testing.assert_allclose(built, truth, rtol=0, atol=1e-9 * float(np.abs(truth).max()))
