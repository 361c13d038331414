"""Checks of a campaign before it is fitted.

Whether it suffices for the stages, columns of rods that are exchanged, and objects that do not fit
between the rails.
"""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.comparison import predicted
from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs
from turnout.calibration.measured_movements import (
    BIN,
    MeasuredMovement,
    observe,
)
from turnout.calibration.stages import NONE, CalibrationPlan, selected, spread
from turnout.core.errors import MeasurementError
from turnout.measurement.campaign.sheet_checks import (
    UNCHECKABLE,
    RodCheck,
    rises,
    rises_most,
    rod_check,
    swap_remarks,
)
from turnout.panel.load import LoadedPanel
from turnout.throw.object_fit import object_fits

# A drive whose marker moves, but whose rod never changes by this, is dead or not there [N].
LEAST_FORCE = 30.0


def check_campaign(
    movements: Sequence[MeasuredMovement], plan: CalibrationPlan, panel: LoadedPanel, *, source: str
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
    known = {name: _force_changes(movements, name) for name in panel.drive}
    if not any(known.values()):
        problems.append("no movement has the force of a drive; map the columns of the rods")
    for name, changes in known.items():
        if changes and max(changes) < LEAST_FORCE:
            problems.append(
                f"drive {name}: never moves, its force changes by {max(changes):.0f} N at most; "
                "check its column in the channel map"
            )
    if problems:
        raise MeasurementError(problems, source=source)


def _force_changes(movements: Sequence[MeasuredMovement], drive: str) -> list[float]:
    """Return by how much the force of a drive changes in each movement that has it [N]."""
    return [
        float(np.nanmax(signal.values) - np.nanmin(signal.values))
        for movement in movements
        for signal in movement.signals
        if signal.channel == "drive_force" and signal.drive == drive
    ]


def unmeasured_drives(movements: Sequence[MeasuredMovement], panel: LoadedPanel) -> list[str]:
    """Return a warning on each drive whose force no movement has."""
    return [
        f"drive {name}: no movement has its force, so its values come from the other channels alone"
        for name in panel.drive
        if not _force_changes(movements, name)
    ]


def exclude_oversized_objects(
    movements: Sequence[MeasuredMovement], panel: LoadedPanel
) -> tuple[tuple[MeasuredMovement, ...], list[str]]:
    """Return the movements whose object fits between the rails, and a message for each other.

    An object is placed between the rails as soon as they stand far enough apart. Where they never
    do it is not there, and a throw with it is one without: comparing it with a measurement in
    which it was squeezed would spoil every value.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; sizes of objects [m].
    panel : LoadedPanel
        What was measured.

    Raises
    ------
    MeasurementError
        When nothing is left.
    """
    fits = {
        (item.place, item.size): object_fits(panel, item.size, item.place)
        for item in movements
        if item.size > 0
    }
    kept = tuple(item for item in movements if fits.get((item.place, item.size), True))
    texts = [
        f"{item.text} was left out: the object does not fit into the gap of panel {panel.name}; "
        "check size and place in the run sheet, and the geometry of the panel there"
        for item in movements
        if not fits.get((item.place, item.size), True)
    ]
    if not kept:
        raise MeasurementError(texts, source="no movement is left")
    return kept, texts


Floats = NDArray[np.float64]


# Movements that are thrown, and how many times as much as any other the panel must load a rod: its
# stiffnesses may be far off. Beyond the second they cannot be so far off that another rod is loaded
# most, so that objects need not have loaded both rods; that takes three movements.
MOST, CLEARLY, BY_FAR, LEAST_ALONE = 12, 2.0, 5.0, 3


def refuse_exchanged_rods(
    dataset: xr.Dataset, movements: Sequence[MeasuredMovement], evaluator: Evaluator
) -> list[str]:
    """Refuse a campaign whose rods are exchanged, where its places alone do not show it.

    Parameters
    ----------
    dataset : xarray.Dataset
        As it was built, which says whether objects at drives have shown it.
    movements : sequence of MeasuredMovement
        Of that dataset.
    evaluator : Evaluator
        Open; throws the panel as it is before the fit.

    Returns
    -------
    list of str
        A warning where it cannot be checked.

    Raises
    ------
    MeasurementError
        When columns are exchanged.
    """
    if "rods_checked" in dataset.attrs or dataset.sizes["drive"] < 2:
        return []
    found = panel_rod_check(movements, evaluator)
    if found.pair:
        source = str(dataset.attrs.get("title", "campaign"))
        raise MeasurementError(swap_remarks(found.pair), source=source)
    return [] if found.checked else [UNCHECKABLE]


def rod_warnings(
    dataset: xr.Dataset, movements: Sequence[MeasuredMovement], evaluator: Evaluator
) -> list[str]:
    """Return warnings on rods that were not measured, or may be exchanged; refuse those that are.

    Takes and raises what `refuse_exchanged_rods` does.
    """
    return [
        *unmeasured_drives(movements, evaluator.panel),
        *refuse_exchanged_rods(dataset, movements, evaluator),
    ]


def rod_remarks(dataset: xr.Dataset, panel: LoadedPanel) -> list[str]:
    """Return a remark on rods that are exchanged, or where it cannot be checked with a panel.

    Parameters
    ----------
    dataset : xarray.Dataset
        A built campaign.
    panel : LoadedPanel
        Of the switch that was measured.
    """
    with Evaluator(panel) as evaluator:
        try:
            return refuse_exchanged_rods(dataset, observe(dataset, panel), evaluator)
        except MeasurementError as error:
            return list(error.problems)


def panel_rod_check(movements: Sequence[MeasuredMovement], evaluator: Evaluator) -> RodCheck:
    """Return whether rods are exchanged: forces rise at other drives than in throws of the panel.

    A rise is what a rod carries beyond its force without an object, as a mean over the movement.
    Movements count in which the panel loads one rod at least twice as much as any other. The rods
    of two drives are exchanged where the force rises at the other one in each of them, with objects
    that load either, or where one rod alone was loaded by far.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`.
    evaluator : Evaluator
        Open.
    """
    drives = tuple(evaluator.panel.drive)
    whole = [item for item in movements if _has_rods(item, drives)]
    free = {
        item.direction: [
            other for other in whole if not other.size and other.direction == item.direction
        ]
        for item in whole
    }
    loaded = [item for item in whole if item.size and free[item.direction]]
    loaded.sort(key=lambda item: (item.x, item.size))
    loaded = [loaded[number] for number in sorted(spread(len(loaded), MOST))]
    if not loaded:
        return RodCheck()
    inputs = [ThrowInputs(overrides={}, kind="quick")]
    inputs += [ThrowInputs(overrides={}, place=i.place, size=i.size, kind="quick") for i in loaded]
    plain, *responses = evaluator.responses(inputs)
    votes, strong = [], []
    for item, response in zip(loaded, responses, strict=True):
        if response.failure or plain.failure:
            continue
        rows = [_forces(other, drives, item) for other in free[item.direction]]
        measured = rises_most(rises(_forces(item, drives, item), np.stack(rows)))
        made = [
            np.stack([_simulated(one, item, drive) for drive in drives])
            for one in (response, plain)
        ]
        rise = rises(made[0], made[1][None])
        expected = rises_most(rise, times=CLEARLY)
        if measured is not None and expected is not None:
            votes.append((drives[expected], drives[measured]))
            strong.append(rises_most(rise, times=BY_FAR) is not None)
    return rod_check(votes, both=sum(strong) < LEAST_ALONE)


def _has_rods(item: MeasuredMovement, drives: Sequence[str]) -> bool:
    """Return whether a movement has the force of every drive."""
    return {s.drive for s in item.signals if s.channel == "drive_force"} >= set(drives)


def _bins(item: MeasuredMovement) -> NDArray[np.intp]:
    time = item.signals[0].time
    return np.flatnonzero((time >= 0.0) & (time + 0.5 * BIN <= item.length))


def _forces(item: MeasuredMovement, drives: Sequence[str], of: MeasuredMovement) -> Floats:
    """Return the forces of a movement over the bins of another one, shape (n_drives, n) [N]."""
    rows = {s.drive: s.values for s in item.signals if s.channel == "drive_force"}
    return np.stack([rows[drive][_bins(of)] for drive in drives])


def _simulated(response: Response, item: MeasuredMovement, drive: str) -> Floats:
    """Return what the rod of a drive shows of a simulation, in the bins of a movement [N]."""
    (signal,) = (s for s in item.signals if (s.channel, s.drive) == ("drive_force", drive))
    return predicted(response, item, signal, _bins(item))


def excluded_movements(dataset: xr.Dataset) -> list[str]:
    """List the measured movements that a campaign could not use, from its dataset.

    Examples
    --------
    >>> listed = '[{"movement": "a", "file": "a.csv", "reasons": ["dead drive_force 1"]}]'
    >>> excluded_movements(xr.Dataset(attrs={"excluded": listed}))
    ['a is not in the campaign: dead drive_force 1']
    """
    return [
        f"{item['movement']} is not in the campaign: {'; '.join(item['reasons'])}"
        for item in json.loads(dataset.attrs.get("excluded", "[]"))
    ]
