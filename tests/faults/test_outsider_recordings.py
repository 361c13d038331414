"""What a program writes has no noise, and objects may be met at once: no fault of a recording."""

from pathlib import Path

import numpy as np
import pytest
from tests.verification.outsider import CASES, Case, Habits, Truth, write_campaign

from turnout.calibration.measured_movements import observe
from turnout.calibration.requirements import exclude_oversized_objects
from turnout.core.errors import MeasurementError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.measurement.quality.channel_faults import Limits, RawChannel, run_faults
from turnout.panel.load import load_panel

SQUEEZED = Case(place="drive 2", size=0.013)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without noise, a short rest, an object met at once and one that is compressed in."""
    target = tmp_path_factory.mktemp("outsider")
    cases = (Case(), Case(), *CASES[2:], SQUEEZED)
    return write_campaign(target, Truth(), cases=cases, habits=Habits(rate=100.0, lead=0.2))


def test_all_movements_are_usable(folder: Path) -> None:
    campaign = build_campaign_dataset(folder, strict=True)
    assert campaign.dataset is not None
    assert campaign.dataset.sizes["movement"] == 7
    # A force that jumps at once marks its onset by the jump.
    assert campaign.dataset["onset"].values == pytest.approx(0.2, abs=0.06)


def test_an_object_that_there_is_no_room_for_is_left_out(folder: Path) -> None:
    dataset = build_campaign_dataset(folder).dataset
    assert dataset is not None
    panel = load_panel("sb1")
    kept, texts = exclude_oversized_objects(observe(dataset, panel), panel)
    assert [item.name for item in kept] == [f"run{number:02d}-closing" for number in range(6)]
    (text,) = texts
    assert text.startswith(
        "run06-closing (closing, 13 mm at drive 2) was left out: the object does not fit"
    )
    only = [name for name in dataset["movement"].values if name != "run06-closing"]
    with pytest.raises(MeasurementError, match="no movement is left"):
        exclude_oversized_objects(observe(dataset, panel, exclude=only), panel)


def test_a_channel_that_is_held_within_its_rest_has_noise_to_tell_by() -> None:
    rng = np.random.default_rng(5)
    values = np.concatenate((np.zeros(300), 1e3 * np.linspace(0.0, 1.0, 300), 1e3 * np.ones(300)))
    assert not [*run_faults(RawChannel("rod", "drive_force", values, 1e3, 300, 600), Limits())]
    values = values + rng.standard_normal(values.size)
    values[100:160] = values[100]
    (fault,) = run_faults(RawChannel("rod", "drive_force", values, 1e3, 300, 600), Limits())
    assert fault.kind == "drop-out"


def test_kilonewtons_that_were_written_in_newtons_are_reported_as_such(tmp_path: Path) -> None:
    write_campaign(tmp_path, Truth(), cases=(Case(),), habits=Habits(rate=100.0))
    channels = (tmp_path / "channels.toml").read_text(encoding="utf-8")
    (tmp_path / "channels.toml").write_text(channels.replace('"N"', '"kN"'), encoding="utf-8")
    (item,) = build_campaign_dataset(tmp_path).excluded
    assert item.reasons[0].startswith("unit of drive_force 1: up to")
    assert item.reasons[0].endswith("check its unit")
