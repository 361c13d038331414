"""A calibration of another switch than the measured one is refused, one of the right one is not.

Reference: campaigns of sb1 whose truth is known. The other switch is free for two bays, 1.2 m,
more: two chairs more, two fastenings fewer. Both are calibrated as sb1, on half of the movements.
Limits of the verdict: band of 95 % covers at least 80 %, error at most three repeat spreads.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
import xarray as xr
from benchmarks.studies.calibration_coverage import WINDOW, Twin, campaign, short_sb1

from turnout.calibration.calibrate import calibrate
from turnout.calibration.evaluate import Evaluator
from turnout.calibration.result import Calibration
from turnout.calibration.stages import CalibrationPlan as Stages
from turnout.calibration.stages import default_plan
from turnout.calibration.validation.acceptance import Acceptance, judge
from turnout.calibration.validation.validate import validate
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_plan import CampaignPlan

LIBRARY = Path(__file__).parents[2] / "src" / "turnout" / "panel" / "library" / "sb1.toml"
CASES = (
    ("none", 0.0),
    ("none", 0.0),
    ("none", 0.0),
    ("drive 1", 0.021),
    ("drive 2", 0.010),
    ("sleeper 4", 0.021),
    ("sleeper 7", 0.013),
    ("sleeper 9", 0.018),
)
HELD_BACK = (2, 5, 6, 7)


def longer(folder: Path) -> LoadedPanel:
    """Return sb1 with a free length of two bays more."""
    text = LIBRARY.read_text(encoding="utf-8")
    head, chairs, rest = text.partition('[chair]  # source: benchmark SB1\nx = { start = "0.3 m"')
    assert chairs
    rest = rest.replace("count = 16", "count = 18", 1)
    fastenings = '[fastening]  # source: benchmark SB1\nx = { start = "9.7 m"'
    assert fastenings in rest
    before, _, after = rest.partition(fastenings)
    after = after.replace("count = 8", "count = 6", 1)
    path = folder / "longer.toml"
    path.write_text(
        head + chairs + before + fastenings.replace("9.7", "10.9") + after, encoding="utf-8"
    )
    return load_panel(path).with_overrides(dict(short_sb1().overrides))


def judged(found: Calibration, dataset: xr.Dataset) -> Acceptance:
    """Return the verdict on a calibration of sb1."""
    panel = short_sb1()
    with Evaluator(panel) as evaluator:
        return judge(validate(dataset, panel, found, evaluator=evaluator))


def calibrated_to(truth: LoadedPanel) -> tuple[Calibration, xr.Dataset]:
    """Measure a switch, and calibrate sb1 to a half of the movements."""
    panel = short_sb1()
    dataset = campaign(
        Twin(
            panel=truth,
            plan=CampaignPlan(places=("drive 1",), window=WINDOW, seed=8),
            cases=CASES,
        )
    )
    names = [str(name) for name in dataset["movement"].values]
    plan = default_plan(panel)
    joint = Stages(parameters=plan.parameters, stages=plan.stages[-1:])
    held_back = [names[number] for number in HELD_BACK]
    return calibrate(dataset, panel, plan=joint, exclude=held_back).calibration, dataset


def with_error(found: Calibration, name: str, share: float) -> Calibration:
    """Return a calibration with one value that is a share too high."""
    moved = tuple(
        replace(item, value=item.value * (1.0 + share)) if item.name == name else item
        for item in found.parameters
    )
    return replace(found, parameters=moved)


@cache
def measured() -> tuple[Calibration, xr.Dataset, Acceptance]:
    """Return the calibration of the switch that was measured, and the verdict on it."""
    found, dataset = calibrated_to(short_sb1())
    return found, dataset, judged(found, dataset)


@pytest.mark.parametrize(
    "name",
    ["chair.friction_coefficient", pytest.param("drive.1.stiffness", marks=pytest.mark.long)],
)
def test_the_measured_switch_is_accepted_and_errors_as_stated_are_noticed(name: str) -> None:
    """Friction that was 5 % off was accepted where 4.5 % were stated, by slopes alone."""
    found, dataset, verdict = measured()
    assert verdict.judged == len(HELD_BACK)
    assert verdict.accepted, verdict.text
    (text,) = (text for text in verdict.power if text.startswith(name))
    stated = float(text.removeprefix(f"{name} off by ").split(" %")[0]) / 100

    def accepted(share: float) -> bool:
        return judged(with_error(found, name, share), dataset).accepted

    assert not accepted(stated), text
    assert not accepted(-stated), text
    assert accepted(0.8 * stated) or accepted(-0.8 * stated), text


@pytest.mark.long
def test_a_switch_with_a_longer_free_length_is_refused(tmp_path: Path) -> None:
    verdict = judged(*calibrated_to(longer(tmp_path)))
    assert verdict.held_back
    assert not verdict.accepted, verdict.text
    assert max(item.spreads for item in verdict.channels) > 3.0
