"""Modes of rails and panels against closed forms and against the unreduced finite elements.

Reference: Timoshenko's cantilever by its transfer matrix; Lanczos on the full matrices of a rail.
Tolerance: what the reduction costs: 3e-3 up to 100 Hz, 2e-5 for the lowest four; 2e-4 for the
cantilever, whose superelement goes up to 2 kHz.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from tests.verification.prismatic_panel import (
    I_LATERAL,
    I_VERTICAL,
    cantilever_frequencies,
    prismatic_panel,
)

from turnout.beam.spectrum import modes_below
from turnout.mechanism.build import rail_data
from turnout.mechanism.structure import form_rows, rail_structure
from turnout.metric.modes import modes
from turnout.panel.load import load_panel

UNDAMPED = {"damping.ratio": 0.0, "chair.damping": 0.0, "fastening.damping_y": 0.0}
LIMIT = 100.0


@pytest.mark.parametrize(
    ("motion", "second_moment"), [("lateral", I_LATERAL), ("vertical", I_VERTICAL)]
)
def test_prismatic_rail_is_timoshenkos_cantilever(
    tmp_path: Path, motion: str, second_moment: float
) -> None:
    found = modes(prismatic_panel(tmp_path), count=12)
    alone = found.isel(mode=found["system"].values == "rail A")
    mine = alone["motion_share"].sel(motion=motion).values > 0.99
    frequencies = alone["frequency"].values[mine]
    exact = cantilever_frequencies(second_moment, 4)
    np.testing.assert_allclose(frequencies[:4], exact, rtol=2e-4)
    assert frequencies[0] > exact[0] * (1 - 1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_rail_alone_agrees_with_the_unreduced_rail(closed: bool) -> None:
    panel = load_panel("sb2").with_overrides(UNDAMPED | {"fastening.damping_z": 0.0})
    data = rail_data(panel)[0]
    full = rail_structure(data)
    stiffness = full.stiffness
    if closed:
        feet = tuple(point for point in data.points if point.direction == "uz")
        rows = form_rows(full, feet, name=data.name)
        stiffness = sp.csr_array(stiffness + 1e7 * (rows.T @ rows))
    exact, _, _ = modes_below(stiffness, full.mass, cutoff_frequency=LIMIT)
    found = modes(panel, count=exact.size)
    system = "rail A, on its chairs" if closed else "rail A, feet free"
    alone = found.isel(mode=found["system"].values == system)
    assert exact.size > 10
    np.testing.assert_allclose(alone["frequency"].values, exact, rtol=3e-3)
    np.testing.assert_allclose(alone["frequency"].values[:4], exact[:4], rtol=2e-5)
    np.testing.assert_allclose(alone["damping_ratio"].values, 0.0, atol=1e-9)
