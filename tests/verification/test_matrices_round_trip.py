"""A rail that leaves as matrices and comes back throws like the rail itself.

Reference: the panel with its own beams. Tolerance: 1e-9 of the largest for drive forces, gaps and
chair forces; 1e-8 for the force on an object, whose blow magnifies rounding.
"""

from pathlib import Path

import numpy as np
import pytest
from tests.verification.runs import DEFAULT, throw

from turnout.metric.export import export_matrices
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

LIMITS = {"drive_force": 1e-9, "gap": 1e-9, "chair_normal_force": 1e-9, "object_force": 1e-8}


@pytest.mark.parametrize("kind", ["", "_superelement"])
def test_default_rails_come_back_as_they_left(tmp_path: Path, kind: str) -> None:
    panel = load_panel(DEFAULT)
    for name, content in export_matrices(panel).items():
        (tmp_path / name).write_bytes(content)
    changes = {
        f"rail.{name}.matrices": str(tmp_path / f"rail_{name}{kind}.mat") for name in panel.rail
    }
    back = simulate(panel.with_overrides(changes), foreign_object=ForeignObject(0.013, "sleeper 6"))
    own = throw(DEFAULT, "sleeper 6")
    for channel, limit in LIMITS.items():
        largest = float(np.nanmax(np.abs(own[channel])))
        assert largest > 0
        np.testing.assert_allclose(
            back[channel].values, own[channel].values, rtol=0, atol=limit * largest, equal_nan=True
        )
