"""Whether a campaign can be calibrated to, before anything is thrown."""

from collections.abc import Sequence

import numpy as np

from turnout.errors import MeasurementError
from turnout.panel.load import LoadedPanel
from turnout.study.calibration.observed import Movement, selected
from turnout.study.calibration.stage import NONE, Plan

# A drive whose marker moves, but whose rod never changes by this, is dead or not there [N].
LEAST_FORCE = 30.0


def check_campaign(
    movements: Sequence[Movement], plan: Plan, panel: LoadedPanel, *, source: str
) -> None:
    """Refuse a campaign that the stages cannot be fitted to, with all problems."""
    problems = []
    for stage in plan.stages:
        chosen = selected(movements, stage.movements, panel)
        if not chosen and not stage.optional and plan.named(stage.parameters):
            if stage.movements.objects == NONE:
                problems.append(
                    f"stage {stage.name}: no movement without an object is left; measure one, keep "
                    "one that was excluded, or fix friction (--fix chair.friction_coefficient)"
                )
            else:
                problems.append(f"stage {stage.name}: no movement is selected")
    for name in panel.drive:
        changes = [
            float(np.nanmax(signal.values) - np.nanmin(signal.values))
            for movement in movements
            for signal in movement.signals
            if signal.channel == "drive_force" and signal.drive == name
        ]
        if not changes:
            problems.append(f"drive {name}: no movement has its force; map its column")
        elif max(changes) < LEAST_FORCE:
            problems.append(
                f"drive {name}: never moves, its force changes by {max(changes):.0f} N at most; "
                "check its column in the channel map"
            )
    if problems:
        raise MeasurementError(problems, source=source)
