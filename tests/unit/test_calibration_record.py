"""A calibration as a file, and what a panel becomes with it."""

from pathlib import Path

import numpy as np
import pytest

from turnout.errors import FileError, PanelError
from turnout.panel.load import load_panel
from turnout.study.calibration.record import Calibration, Fitted, StageLog, load_calibration


def fitted(name: str, value: float, *, unit: str, state: str = "fitted") -> Fitted:
    return Fitted(
        name=name,
        keys=(name,),
        unit=unit,
        value=value,
        deviation=0.01 * value,
        lower=0.1 * value,
        upper=10 * value,
        interval=(0.98 * value, 1.02 * value),
        start=1.1 * value,
        state=state,
    )


def calibration() -> Calibration:
    return Calibration(
        parameters=(
            fitted("chair.friction_coefficient", 0.31, unit="1"),
            fitted("drive.1.stiffness", 8.123456789e5, unit="N/m"),
            fitted("drive.2.stiffness", 8.1e5, unit="N/m", state="fixed"),
        ),
        covariance=np.array([[1e-6, 2.0], [2.0, 1e8]]),
        panel="sb1",
        panel_hash="abc",
        data='a "quoted" campaign',
        data_hash="def",
        movements=("a", "b#2"),
        stages=(
            StageLog(
                name="friction",
                method="sweep and fit",
                movements=("a",),
                values={"chair.friction_coefficient": 0.3},
                misfit=1.2,
                evaluations=7,
                iterations=2,
                message="converged",
                sweep={"value": (0.1, 0.2), "misfit": (0.5, 0.3)},
            ),
        ),
        warnings=("one",),
        findings=("two",),
        noise={"drive_force of drive 1": {"white": 1.5}},
        scatter={"chair.friction_coefficient": 0.02},
        about={"version": "0.1.0"},
        posterior={"effective_samples": 812.5},
    )


def test_a_record_comes_back_from_its_file(tmp_path: Path) -> None:
    calibration().save(tmp_path / "c.toml")
    back = load_calibration(tmp_path / "c.toml")
    assert back.parameters == calibration().parameters
    np.testing.assert_array_equal(back.covariance, calibration().covariance)
    assert back.stages == calibration().stages
    for name in ("panel", "panel_hash", "data", "data_hash", "movements", "warnings", "findings"):
        assert getattr(back, name) == getattr(calibration(), name)
    for name in ("noise", "scatter", "about", "posterior"):
        assert dict(getattr(back, name)) == dict(getattr(calibration(), name))


def test_values_in_the_file_carry_their_unit(tmp_path: Path) -> None:
    calibration().save(tmp_path / "c.toml")
    text = (tmp_path / "c.toml").read_text(encoding="utf-8")
    assert 'value = "812345.6789 N/m"' in text


def test_a_calibration_applies_to_a_panel() -> None:
    panel = calibration().apply(load_panel("sb1"))
    assert panel.chair["1"].friction_coefficient == 0.31
    assert panel.drive["1"].stiffness == 8.123456789e5


def test_a_panel_without_the_keys_is_refused() -> None:
    other = Calibration(
        parameters=(fitted("link.7.stiffness", 1e6, unit="N/m"),),
        covariance=np.eye(1),
        panel="mine",
        panel_hash="",
        data="",
        data_hash="",
        movements=(),
        stages=(),
    )
    with pytest.raises(PanelError, match=r"link\.7\.stiffness.*calibration is of panel mine"):
        other.apply(load_panel("sb1"))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("schema_version = 1\n", "is no calibration"),
        ('kind = "calibration"\nschema_version = 9\n', "calibrate anew"),
        ('kind = "calibration"\nschema_version = 1\n', "damaged"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "x.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(FileError, match=words):
        load_calibration(path)


def test_a_value_in_another_unit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    calibration().save(path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("812345.6789 N/m", "812 kN/m"), encoding="utf-8")
    with pytest.raises(FileError, match="must be in 'N/m'"):
        load_calibration(path)
