r"""States of a population in which the drives hold the rails that they press home.

A drive presses a closed rail against its stock rail with :math:`k (u - g)`: stiffness of its
bushing times over-travel less the gap that is left. Where that reaches the slip level :math:`S` the
drive slips without moving. Such a switch is not in service: its clutch is set, or its over-travel
taken back, until it holds. The reference case scatters :math:`k` by 5 %, :math:`S` by 3 % and the
closing over-travel by 1 mm, which a panel with a small margin does not bear. So its population is
that of the switches that hold: a state in which :math:`k (u - g) \ge S` is drawn again, all of it.
States that hold stay as they are.
"""

from dataclasses import replace

from turnout.mechanism.rest import RestingForce, resting_forces
from turnout.study.design import Holding, Input
from turnout.study.distribution import Distribution
from turnout.study.study import Study

SELDOM = 0.01
"""Where a drive holds with each of its values at this quantile, the worse one, nothing is drawn
again: less than one state in 1,000 slips at rest, and is left out as one that does not end [-]."""


def with_held_rails(study: Study) -> Study:
    """Return a study that draws states again in which a drive would slip at rest.

    Drives whose force is a table, and panels with margins that the population bears, leave it as it
    is. The remarks say which drives are concerned.

    Parameters
    ----------
    study : Study
        Of a panel; its states are drawn one by one.

    Examples
    --------
    >>> from turnout.calibration.load_study import load_study
    >>> study = load_study("detection-reference")
    >>> with_held_rails(study) is study
    True
    """
    found, remarks = [], []
    for force in resting_forces(study.panel):
        drive = study.panel.drive[force.drive]
        if drive.extension is not None:
            continue
        made = _holding(study, force)
        if _always(study, made):
            continue
        found.append(made)
        remarks.append(
            f"panel {study.panel.name}: drive {force.drive} presses rail {force.rail} home with "
            f"{force.force / 1e3:.2f} kN and slips at {force.limit / 1e3:.2f} kN; states in which "
            "it would slip at rest are drawn again"
        )
    if not found:
        return study
    design = replace(study.design, holdings=tuple(found))
    return replace(study, design=design, remarks=(*study.remarks, *remarks))


def _holding(study: Study, force: RestingForce) -> Holding:
    key = f"drive.{force.drive}"
    return Holding(
        stiffness=_input(study, f"{key}.stiffness", study.panel.drive[force.drive].stiffness),
        reach=_input(study, f"{key}.{force.key}", force.reach),
        fit=_input(study, "rail.fit_gap", force.fit),
        slip_level=_input(study, f"{key}.saturation_force", force.limit),
    )


def _input(study: Study, key: str, value: float) -> Input:
    """Return a number with the variables that change it; a fit may have its gaps below it."""
    replaced = multiplied = ""
    for item in study.variables.values():
        if item.key in (key, f"{key}.value"):
            replaced, multiplied = ("", item.name) if item.factor else (item.name, "")
    return Input(value=value, replaced_by=replaced, multiplied_by=multiplied)


def _always(study: Study, item: Holding) -> bool:
    """Return whether a drive holds with every value at its worse end."""
    laws = {drawn.name: drawn.law for drawn in study.design.drawn}

    def end(given: Input, share: float) -> float:
        drawn = {
            name: law.value(share)
            for name in (given.replaced_by, given.multiplied_by)
            if name and isinstance(law := laws.get(name), Distribution)
        }
        return given.in_state(drawn)

    stretch = end(item.reach, 1.0 - SELDOM) - end(item.fit, SELDOM)
    return end(item.stiffness, 1.0 - SELDOM) * stretch < end(item.slip_level, SELDOM)
