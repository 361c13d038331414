"""The default panel against another program that shares no step, contact, friction or start.

Reference: tests/verification/independent_switch.py (backward differences at 10 ms, all coordinates
of the superelements, laws by their own evaluation, a return before the throw). Tolerance: root mean
square over the cycle 1.5 % and largest difference 5 % of the drive's peak force, which is what
10 ms leave of impacts and of friction that turns round; the object's peak 5 %.
"""

import numpy as np
import pytest
from tests.verification.independent_switch import switch_of, throw

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

RMS, LARGEST = 0.015, 0.05
OBJECTS = (None, ForeignObject(0.013, "sleeper 6"), ForeignObject(0.008, "drive 2"))


@pytest.mark.parametrize("trapped", OBJECTS, ids=["sound", "sleeper 6", "drive 2"])
def test_forces_agree_with_another_program(trapped: ForeignObject | None) -> None:
    panel = load_panel("uic60-760-1-15")
    friction = np.full((len(panel.chair), 2), 0.4)
    own = throw(switch_of(panel), friction=friction, trapped=trapped)
    dataset = simulate(panel, foreign_object=trapped)
    time = dataset["time"].to_numpy()
    forces = dataset["drive_force"].transpose("drive", "time").to_numpy()
    for force, other in zip(forces, own.force, strict=True):
        apart = np.interp(time, own.time, other) - force
        peak = float(np.abs(force).max())
        assert np.sqrt(np.mean(apart**2)) < RMS * peak
        assert np.abs(apart).max() < LARGEST * peak
    if trapped is not None:
        touch = float(dataset["object_force"].max())
        assert own.touch == pytest.approx(touch, rel=0.05)
