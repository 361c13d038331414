"""Flexible stock rails: stops and objects act between two rails that both bend.

Reference: an independent study of this panel found that rigid stock rails change Drive 2 by 0.1 to
3 %; a stock rail of a thousandfold stiffness must give the rigid answer; action equals reaction.
"""

from pathlib import Path

import numpy as np
import pytest
from tests.verification.runs import SYMMETRIC, end_force, energy_balance, throw

from turnout.core.errors import PanelError
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_text, load_panel
from turnout.throw.simulate import simulate

EXTRA = (Path(__file__).parent / "stock_rails.toml").read_text(encoding="utf-8")


def flexible(folder: Path, extra: str = EXTRA) -> LoadedPanel:
    path = folder / "flexible.toml"
    path.write_text(library_text(SYMMETRIC) + extra, encoding="utf-8")
    return load_panel(path)


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> LoadedPanel:
    return flexible(tmp_path_factory.mktemp("stock"))


@pytest.fixture(scope="module")
def response(panel):
    return simulate(panel, foreign_object=ForeignObject(0.013, "sleeper 6"))


def test_rigid_stock_rails_change_drive_2_by_what_the_study_found(response):
    change = abs(end_force(throw(SYMMETRIC, "sleeper 6"), "2") / end_force(response, "2") - 1)
    assert 0.001 < change < 0.03


def test_the_gap_is_measured_to_the_rail_that_moves(response):
    """The object is pressed by what it overlaps the gap between the two bent rails."""
    gap = float(response["sensor_gap"].sel(sensor="TKK1")[-1])
    force = float(response["object_force"][-1])
    assert force == pytest.approx(40e6 * (0.013 - gap), rel=1e-6)
    assert force > 500.0


def test_books_close(response):
    residual, loss = energy_balance(response)
    assert residual < 1e-6
    assert loss < 0.005


def test_a_very_stiff_stock_rail_is_a_rigid_one(tmp_path):
    stiff = EXTRA
    for line in ("second_moment_vertical", "second_moment_lateral", "torsion_constant"):
        number = next(row for row in EXTRA.splitlines() if row.startswith(line))
        stiff = stiff.replace(number, number.replace('cm^4"', 'dm^4"'))
    stiff = stiff.replace('stiffness_y = "50e6 N/m"', 'stiffness_y = "5e10 N/m"')
    stiff = stiff.replace('"225 kN m/rad"', '"225000 kN m/rad"')
    run = simulate(flexible(tmp_path, stiff), foreign_object=ForeignObject(0.013, "sleeper 6"))
    rigid = throw(SYMMETRIC, "sleeper 6")
    np.testing.assert_allclose(run["drive_force"][:, -1], rigid["drive_force"][:, -1], rtol=5e-4)
    assert float(run["object_force"][-1]) == pytest.approx(
        float(rigid["object_force"][-1]), rel=2e-3
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('faces = "straight"', 'faces = "strait"', "stock_rail.curved.faces.*straight"),
        ('faces = "curved"', 'faces = "straight"', "faces it already"),
        ('section = "60E1"', 'section = "60E2"', "stock_rail.section.*60E1"),
        ('start = "-3 m"', 'start = "1 m"', "does not reach stop"),
        ("count = 35", "count = 45", "is off stock rail"),
    ],
)
def test_a_stock_rail_that_cannot_be_is_refused(tmp_path, old, new, message):
    with pytest.raises(PanelError, match=message):
        flexible(tmp_path, EXTRA.replace(old, new, 1))
