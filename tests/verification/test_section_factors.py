"""Factors of a rail's section against closed forms of a cantilever.

Timoshenko's beam of `prismatic_panel`: frequencies by its transfer matrix, with the second moment
scaled; the deflection under a force at its tip is F (L^3 / 3 E I + L / kappa G A). Tolerance of
frequencies: 2e-4 as in `test_modes`, since the superelement goes up to 2 kHz; statics is exact.
"""

from pathlib import Path

import numpy as np
import pytest
from tests.verification.prismatic_panel import (
    AREA,
    I_LATERAL,
    I_VERTICAL,
    KAPPA,
    LENGTH,
    NU,
    TEXT,
    E,
    cantilever_frequencies,
    prismatic_panel,
)

from turnout.core.errors import PanelError
from turnout.mechanism.build import build_mechanism, rail_data
from turnout.metric.export import export_matrices
from turnout.metric.modes import modes
from turnout.panel.load import LoadedPanel, load_panel

DEFAULT = "uic60-760-1-15"
LATERAL, EVERY = "rail.A.lateral_inertia_scale", "rail.A.section_scale"


def frequencies(panel: LoadedPanel, motion: str) -> np.ndarray:
    found = modes(panel, count=12)
    alone = found.isel(mode=found["system"].values == "rail A")
    mine = alone["motion_share"].sel(motion=motion).values > 0.99
    return np.asarray(alone["frequency"].values[mine][:4])


def tip_flexibility(panel: LoadedPanel) -> float:
    """Deflection of the drive's place for a unit force there, without the drive's bushing [m/N]."""
    mechanism = build_mechanism(panel)
    row = mechanism.rows[mechanism.laws.row[mechanism.index.drive["1"]]]
    return float(row @ np.linalg.solve(mechanism.stiffness, row))


@pytest.mark.parametrize("scale", [0.9, 1.1, 2.0])
def test_lateral_frequencies_follow_the_scaled_second_moment(tmp_path: Path, scale: float) -> None:
    panel = prismatic_panel(tmp_path)
    stiff = panel.with_overrides({LATERAL: scale})
    lateral, vertical = (frequencies(stiff, motion) for motion in ("lateral", "vertical"))
    np.testing.assert_allclose(lateral, cantilever_frequencies(scale * I_LATERAL, 4), rtol=2e-4)
    np.testing.assert_allclose(vertical, cantilever_frequencies(I_VERTICAL, 4), rtol=2e-4)
    ratio = lateral[0] / frequencies(panel, "lateral")[0]
    assert ratio == pytest.approx(np.sqrt(scale), rel=2e-3)  # shear and rotation take the rest


def test_scaling_the_whole_section_keeps_frequencies_and_divides_deflections(
    tmp_path: Path,
) -> None:
    panel = prismatic_panel(tmp_path)
    heavy = panel.with_overrides({EVERY: 1.1})
    for motion in ("lateral", "vertical"):
        np.testing.assert_allclose(
            frequencies(heavy, motion), frequencies(panel, motion), rtol=1e-9
        )
    assert tip_flexibility(heavy) == pytest.approx(tip_flexibility(panel) / 1.1, rel=1e-9)


@pytest.mark.parametrize(("every", "lateral"), [(1.0, 1.0), (1.1, 1.0), (1.0, 0.9), (0.9, 1.1)])
def test_deflection_under_a_force_is_the_closed_form(
    tmp_path: Path, every: float, lateral: float
) -> None:
    panel = prismatic_panel(tmp_path).with_overrides({EVERY: every, LATERAL: lateral})
    length, shear_modulus = LENGTH - 0.3, E / (2 * (1 + NU))
    bending = length**3 / (3 * E * every * lateral * I_LATERAL)
    shear = length / (KAPPA * shear_modulus * every * AREA)
    assert tip_flexibility(panel) == pytest.approx(bending + shear, rel=1e-8)


def test_factors_of_one_leave_every_bit() -> None:
    panel = load_panel(DEFAULT)
    keys = {"rail.section_scale": 1.0, "rail.lateral_inertia_scale": 1.0}
    keys |= {f"stock_{key}": value for key, value in keys.items()}
    plain, same = (build_mechanism(item) for item in (panel, panel.with_overrides(keys)))
    assert np.array_equal(plain.stiffness, same.stiffness)
    assert np.array_equal(plain.mass, same.mass)


def test_skew_sections_stay_sections_and_stock_rails_scale_too() -> None:
    panel = load_panel(DEFAULT)
    keys = {"rail.lateral_inertia_scale": 0.5, "stock_rail.straight.section_scale": 1.2}
    plain = {data.name: data.sections for data in rail_data(panel)}
    scaled = {data.name: data.sections for data in rail_data(panel.with_overrides(keys))}
    for name in ("straight", "curved"):
        product = scaled[name].second_moment_vertical * scaled[name].second_moment_lateral
        share = scaled[name].product_moment ** 2 / product
        of_plain = plain[name].second_moment_vertical * plain[name].second_moment_lateral
        np.testing.assert_allclose(share, plain[name].product_moment ** 2 / of_plain, rtol=1e-12)
    stock = "stock rail straight"
    np.testing.assert_allclose(scaled[stock].area, 1.2 * plain[stock].area, rtol=1e-15)
    np.testing.assert_array_equal(scaled["stock rail curved"].area, plain["stock rail curved"].area)


@pytest.mark.parametrize("value", [0.4, 2.5, -1.0])
@pytest.mark.parametrize("key", [LATERAL, EVERY])
def test_factors_out_of_range_are_refused(tmp_path: Path, key: str, value: float) -> None:
    with pytest.raises(PanelError, match=key):
        prismatic_panel(tmp_path).with_overrides({key: value})


def test_a_rail_of_matrices_has_no_section_to_scale(tmp_path: Path) -> None:
    for name, content in export_matrices(prismatic_panel(tmp_path)).items():
        (tmp_path / name).write_bytes(content)
    text = TEXT.replace("[rail.A]", '[rail.A]\nmatrices = "rail_A.mat"\nsection_scale = 1.1')
    path = tmp_path / "panel.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PanelError, match=r"section_scale = 1\.1: the rail has matrices") as refused:
        load_panel(path)
    assert "scale those" in str(refused.value)
