"""A virtual campaign behind a recorder that filters, averages and samples; objects without room."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.recorded import clean
from tests.unit.simulated import sb2_panel

from turnout.core.errors import FileError, PanelError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.measurement.chain.apply import load_channel_map
from turnout.measurement.chain.channel_map import typed_recorder
from turnout.measurement.chain.recorder import PERFECT, LowPass, Recorder
from turnout.panel.load import load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan, check_plan, virtual_plan
from turnout.study.virtual.disturbance import QUIET, add_disturbance
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.throw.store import open_response

AVERAGE = Recorder(average=0.1)


def test_a_ramp_lags_behind_a_mean_by_half_its_time_and_behind_a_filter_by_its_delay() -> None:
    """Two poles of Butterworth delay by sqrt(2) / (2 pi f)."""
    time = np.arange(2000) / 1000.0
    ramp = 1000.0 * time
    averaged = AVERAGE.recorded(time, ramp, phase=0.0)
    np.testing.assert_allclose(averaged[200:], ramp[200:] - 50.0, atol=1e-6)
    filtered = Recorder(low_pass=LowPass(corner=6.0)).recorded(time, ramp, phase=0.0)
    delay = np.sqrt(2.0) / (2.0 * np.pi * 6.0)
    np.testing.assert_allclose(filtered[1000:], ramp[1000:] - 1000.0 * delay, atol=1e-3)


def test_samples_are_joined_by_straight_lines_and_differ_with_their_phase() -> None:
    time = np.arange(1000) / 1000.0
    bend = np.maximum(0.0, time - 0.513)
    seen = [Recorder(rate=20.0).recorded(time, bend, phase=p) for p in (0.1, 0.6)]
    for phase, row in zip((0.1, 0.6), seen, strict=True):
        at = np.round(1000 * (np.arange(1, 18) + phase) / 20.0).astype(int)
        np.testing.assert_allclose(row[at], bend[at], atol=1e-9)
    assert np.abs(seen[0] - seen[1]).max() > 0.005
    # In the mean over the phase it is what a fit is compared with.
    mean = np.mean(
        [Recorder(rate=20.0).recorded(time, bend, phase=p) for p in np.arange(0, 1, 0.02)],
        axis=0,
    )
    expected = Recorder(rate=20.0).applied(time, bend)
    np.testing.assert_allclose(mean[100:900], expected[100:900], atol=2e-4)


def test_forces_are_recorded_so_and_currents_are_not() -> None:
    true = clean(0.026)
    rng = np.random.default_rng(0)
    seen = add_disturbance(true, rng=rng, disturbance=QUIET, response=AVERAGE)
    np.testing.assert_array_equal(seen["drive_current"], true["drive_current"])
    force = true["drive_force"].sel(drive="2")
    mean = force.rolling(time=100, min_periods=1).mean()
    late = slice(200, None)
    kept = seen["drive_force"].sel(drive="2").isel(time=late)
    np.testing.assert_allclose(kept, mean.isel(time=late), atol=15.0)
    assert float(np.abs(kept - force.isel(time=late)).max()) > 100.0


@pytest.mark.parametrize("stated", [True, False])
def test_the_map_states_the_recorder_unless_it_is_hidden(stated: bool, tmp_path: Path) -> None:
    plan = CampaignPlan(
        places=(), object_free=1, formats=(".csv",), recorder=AVERAGE, recorder_stated=stated
    )
    make_virtual_campaign(sb2_panel(), tmp_path / "made", plan=plan)
    known = load_channel_map(tmp_path / "made" / "channels.toml").recorder()
    assert known == (AVERAGE if stated else PERFECT)
    built = build_campaign_dataset(tmp_path / "made")
    assert built.dataset is not None
    assert built.recorder == (AVERAGE.text if stated else "")
    truth = open_response(tmp_path / "made" / "truth.nc")
    name = str(built.dataset["movement"].values[0])
    rows = [
        item["drive_force_unfiltered"].sel(movement=name, drive="2").sel(time=slice(0.0, 3.0))
        for item in (truth.assign_coords(movement=built.dataset["movement"].values), built.dataset)
    ]
    late = [float((row * row["time"]).sum() / row.sum()) for row in rows]
    assert late[1] - late[0] > 0.0


def test_a_recorder_that_cannot_be_is_refused_with_all_that_is_wrong() -> None:
    found = typed_recorder(low_pass='{ kind = "rc", corner = "6 Hz" }', rate="20 Hz")
    assert found == Recorder(low_pass=LowPass(kind="rc", order=1, corner=6.0), rate=20.0)
    with pytest.raises(FileError) as caught:
        typed_recorder(average="0.1", low_pass="{ kind = ", rate="400 Hz")
    lines = str(caught.value).splitlines()
    assert [line.split(" ")[0] for line in lines] == [
        "--recorded-filter",
        "--recorded-average",
        "--recorded-rate",
    ]


def test_a_place_without_room_is_refused_and_what_would_not_fit_elsewhere_is_left_out(
    tmp_path: Path,
) -> None:
    """On sb1 drive 2 opens by some 11 mm: an object of 13 mm is never there."""
    panel = load_panel("sb1")
    plan = virtual_plan(panel, places=["drive 2", "sleeper 6"], sizes=["13 mm", "30 mm"])
    with pytest.raises(PanelError) as caught:
        make_virtual_campaign(panel, tmp_path / "new", plan=plan)
    (problem,) = caught.value.problems
    assert problem.startswith("13 mm at drive 2: no room, the rails never stand that far apart")
    assert "about 11 mm at most; take a smaller object" in problem
    assert not (tmp_path / "new").exists()
    # Places that were not named are left out instead.
    check_plan(virtual_plan(panel, sizes=["13 mm"]), panel)
    assert "drive 2" not in virtual_plan(panel, sizes=["13 mm"]).places
