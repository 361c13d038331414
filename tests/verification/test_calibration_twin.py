"""A twin with a finer mesh, measured with noise, is calibrated back from two far starts.

Reference: the values that the twin was thrown with. Tolerance 1 %: friction and stiffness of field
drives are not known better. One movement each way and one object keep it short; friction does not
scatter, as so few movements could not average it.
"""

from pathlib import Path

import pytest
from benchmarks.studies.calibration_coverage import result_of

from turnout.calibration.calibrate import calibrate
from turnout.calibration.result import load_calibration
from turnout.cli.main import app
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.throw.store import open_response, save_response

TRUE = {
    "chair.friction_coefficient": 0.31,
    "drive.1.stiffness": 900e3,
    "drive.1.saturation_force": 5.5e3,
    "drive.2.stiffness": 620e3,
    "drive.2.saturation_force": 5.8e3,
}
STARTS = (
    {},
    {
        "chair.friction_coefficient": 0.5,
        "drive.1.stiffness": 400e3,
        "drive.1.saturation_force": 7e3,
        "drive.2.stiffness": 1200e3,
    },
)


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the dataset of a small measured twin."""
    folder = tmp_path_factory.mktemp("twin")
    truth = load_panel("sb1").with_overrides({**TRUE, "discretisation.element_length": "0.05 m"})
    plan = CampaignPlan(
        places=("drive 1",),
        sizes=(0.013,),
        object_free=1,
        friction_scatter=0.0,
        formats=(".csv",),
        seed=11,
    )
    make_virtual_campaign(truth, folder / "raw", plan=plan)
    dataset = build_campaign_dataset(folder / "raw").dataset
    assert dataset is not None
    save_response(dataset, folder / "campaign.nc")
    return folder / "campaign.nc"


@pytest.mark.parametrize("start", STARTS, ids=["library", "far"])
def test_the_truth_is_found_within_one_per_cent(twin: Path, start: dict[str, float]) -> None:
    panel = load_panel("sb1").with_overrides(start)
    outcome = calibrate(open_response(twin), panel, folder=twin.parent / ".turnout" / "throws")
    found = outcome.calibration.values
    assert {key: found[key] for key in TRUE} == pytest.approx(TRUE, rel=0.01)
    assert all(item.state == "fitted" for item in outcome.calibration.parameters)
    assert any("stage drive 2 was left out" in text for text in outcome.calibration.warnings)


def test_the_command_takes_up_the_throws_and_its_file_applies(
    twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target, figures = tmp_path / "c.toml", tmp_path / "figures"
    app(
        ["calibrate", str(twin), "--panel", "sb1", "-o", str(target), "--workers", "1"]
        + ["--figures", str(figures)],
        standalone_mode=False,
    )
    shown = capsys.readouterr().out
    assert "drive.1.stiffness" in shown
    record = load_calibration(target)
    assert all(stage.evaluations == 0 for stage in record.stages)
    panel = record.apply(load_panel("sb1"))
    assert panel.drive["1"].stiffness == pytest.approx(TRUE["drive.1.stiffness"], rel=0.01)
    assert len(list(figures.glob("sweep-*.png"))) == 2
    assert len(list(figures.glob("fit-*.png"))) == 3  # one a movement


@pytest.mark.long
def test_no_cause_is_taken_up_where_several_values_are_off_together() -> None:
    # Campaign 178 of the long job: friction 8 %, a stiffness 5 % and each movement's friction are
    # off together after the quick throws. Brief fits leave that slowly; friction by chair and soft
    # bushings were fitted then, and a stiffness came out 19 % off.
    record = result_of(178)
    assert not record["failure"]
    assert record["causes"] == [] == record["distrust"]
    for name, true in record["truth"].items():
        low, high = record["intervals"][name]
        assert low <= true <= high, name
