"""A calibration as a file, and what a panel becomes with it."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.calibrations import calibration, fitted

from turnout.calibration.result import Calibration, load_calibration
from turnout.core.errors import FileError, PanelError
from turnout.panel.load import load_panel


def test_a_record_comes_back_from_its_file(tmp_path: Path) -> None:
    saved = replace(calibration(), fitted_causes=("clutch",))
    saved.save(tmp_path / "c.toml")
    back = load_calibration(tmp_path / "c.toml")
    for mine, its in zip(back.parameters, saved.parameters, strict=True):
        np.testing.assert_equal(asdict(mine), asdict(its))
    np.testing.assert_array_equal(back.covariance, saved.covariance)
    assert back.stages == saved.stages
    assert back.fitted_causes == saved.fitted_causes == ("clutch",)
    for name in ("panel", "panel_hash", "data", "data_hash", "movements", "warnings", "findings"):
        assert getattr(back, name) == getattr(saved, name)
    for name in ("noise", "scatter", "about"):
        assert dict(getattr(back, name)) == dict(getattr(saved, name))


def test_values_in_the_file_carry_their_unit(tmp_path: Path) -> None:
    calibration().save(tmp_path / "c.toml")
    text = (tmp_path / "c.toml").read_text(encoding="utf-8")
    assert 'value = "760000.0 N/m"' in text


def test_a_calibration_applies_to_a_panel() -> None:
    panel = calibration().apply(load_panel("sb1"))
    assert panel.chair["1"].friction_coefficient == 0.31
    assert panel.drive["1"].stiffness == 7.6e5


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
        ("schema_version = 1\n", "is not a calibration"),
        ('kind = "calibration"\nschema_version = 9\n', "calibrate again"),
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
    path.write_text(text.replace("760000.0 N/m", "760 kN/m"), encoding="utf-8")
    with pytest.raises(FileError, match="must be in 'N/m'"):
        load_calibration(path)


def test_a_record_with_a_posterior_of_before_is_read_without_it(tmp_path: Path) -> None:
    calibration().save(tmp_path / "c.toml")
    with (tmp_path / "c.toml").open("a", encoding="utf-8") as file:
        file.write('\n[posterior]\njson = "{}"\n')
    assert load_calibration(tmp_path / "c.toml").values == calibration().values
