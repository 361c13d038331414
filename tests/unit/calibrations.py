"""A calibration made by hand, that several tests use."""

import numpy as np

from turnout.calibration.result import Calibration, StageLog
from turnout.calibration.stages import Fitted
from turnout.panel.load import load_panel


def fitted(name: str, value: float, *, unit: str, state: str = "fitted") -> Fitted:
    return Fitted(
        name=name,
        keys=(name,),
        unit=unit,
        value=value,
        deviation=0.01 * value if state == "fitted" else float("nan"),
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
            fitted("drive.1.stiffness", 7.6e5, unit="N/m"),
            fitted("drive.2.stiffness", 8.1e5, unit="N/m", state="at its bound"),
            fitted("drive.1.saturation_force", 6e3, unit="N", state="fixed"),
        ),
        covariance=np.array([[1e-6, 9.5e-1], [9.5e-1, 1e6]]),
        panel="sb1",
        panel_hash=load_panel("sb1").hash,
        data="Autumn <1>",
        data_hash="def",
        movements=("a", "b"),
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
                sweep={"value": (0.1, 0.3, 0.5), "misfit": (0.5, 0.1, 0.4)},
            ),
        ),
        warnings=("Drive 2 is at its bound",),
        findings=("forces show the friction",),
        noise={"drive_force of drive 1": {"white": 1.5}},
        scatter={"chair.friction_coefficient": 0.02},
        about={"version": "0.1.0"},
    )
