"""Flangeway and gauge at one instant are those of all coordinates of the rails."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.mechanism.travel import unloaded_gap
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.panel.model import Panel
from turnout.panel.profile import contact_height, running_edge_distance
from turnout.throw.flangeway import LeastDistance, least_distances, movement_ends
from turnout.throw.gaps import gap_rows
from turnout.throw.lock_and_control import DISTANCES
from turnout.throw.recovery import Motion, recover_motion
from turnout.throw.route import DirectedMovement, closed_rail, open_rail, throws
from turnout.throw.simulate import solve

Floats = NDArray[np.float64]


@pytest.mark.parametrize("name", ["uic60-760-1-15", "60e1-300-1-9", "sb2"])
@pytest.mark.parametrize("at", ["sleeper 5", "x = 3.21 m"])
def test_flangeway_of_any_motion_and_any_forces(name: str, at: str) -> None:
    """Also of forces on ends that an object added to both rails of the gap."""
    panel = load_panel(name)
    solved = solve(panel, foreign_object=ForeignObject(0.02, at), scheme=Scheme.of("quick"))
    history, rng = solved.history, np.random.default_rng(1)
    drawn = replace(
        history,
        q=rng.normal(0.0, 0.1, size=history.q.shape),
        g=rng.normal(0.0, 1e-3, size=history.g.shape),
        law_force=rng.normal(0.0, 1e3, size=history.law_force.shape),
        friction_force=rng.normal(0.0, 1e2, size=history.friction_force.shape),
    )
    motion = recover_motion(solved.mechanism, drawn)
    assert any(part.before is not None for part in motion.condensed.parts)
    model, ends, single = motion.condensed.model, [], []
    for throw, instant in zip(throws(panel), (7, 30), strict=True):
        rail = open_rail(panel, throw.to)
        assert rail is not None
        record, x = panel.rail[rail], motion.rails[rail].x
        assert record.running_edge is not None
        assert record.head_width is not None
        start, parts = gap_rows(panel, motion, rail, x, contact_height(panel, rail, x))
        beyond = running_edge_distance(record.running_edge, x) - record.head_width
        force = drawn.g[instant] * motion.slope
        np.subtract.at(force, drawn.laws.row, drawn.law_force[instant])
        np.subtract.at(force, drawn.laws.friction_row, drawn.friction_force[instant])
        u = model.modes @ drawn.q[instant] + model.residual_shapes @ force + model.residual_load
        moved = sum(rows @ u[body.first : body.first + body.count] for body, rows in parts)
        wanted = start - moved + np.maximum(beyond, 0.0)
        found = flangeway_of(panel, motion, [(throw, instant)])
        assert found.width == pytest.approx(wanted.min(), rel=1e-9, abs=1e-12)
        assert found[1:] == (x[wanted.argmin()], rail)
        if panel.gauge is not None:
            gauge, rail = gauge_of_coordinates(panel, motion, throw.to, u)
            (least,) = least_distances(
                [movement_ends(panel, motion, [(throw, instant)], of=DISTANCES)]
            )
            assert least["gauge"].width == pytest.approx(gauge.min(), rel=1e-9, abs=1e-12)
            assert least["gauge"][1:] == (motion.rails[rail].x[gauge.argmin()], rail)
        ends.append((throw, instant))
        single.append(found)
    assert flangeway_of(panel, motion, ends) == min(single)
    assert flangeway_of(panel, motion, [*ends, ends[0]]) == min(single)


def gauge_of_coordinates(panel: Panel, motion: Motion, to: str, u: Floats) -> tuple[Floats, str]:
    """Return the gauge at the nodes of the closed rail, and its name."""
    assert panel.gauge is not None
    rail = closed_rail(panel, to)
    body, side = motion.rails[rail], 1.0 if panel.rail[rail].closes == "+y" else -1.0
    way = body.recovery @ u[body.first : body.first + body.count]
    gap = unloaded_gap(panel, motion.shapes[rail], rail, body.x)
    assert gap is not None
    edge = side * (way[1::6] - panel.gauge.height * way[3::6])
    return panel.gauge.nominal - gap + edge, rail


def flangeway_of(
    panel: Panel, motion: Motion, ends: list[tuple[DirectedMovement, int]]
) -> LeastDistance:
    (found,) = least_distances([movement_ends(panel, motion, ends, of=DISTANCES)])
    return found["flangeway"]


def test_flangeways_of_many_runs_are_those_of_each() -> None:
    """Of other rails, with other objects, some without any that the panel knows."""
    runs = []
    for name in ("uic60-760-1-15", "sb1", "60e1-300-1-9", "uic60-760-1-15"):
        for size, at in ((0.02, "sleeper 5"), (0.01, "x = 3.21 m"), (0.015, "drive 1")):
            panel = load_panel(name)
            solved = solve(panel, foreign_object=ForeignObject(size, at), scheme=Scheme.of("quick"))
            motion = recover_motion(solved.mechanism, solved.history)
            time = solved.history.time
            ends = [(throw, int(time.searchsorted(throw.end))) for throw in throws(panel)]
            runs.append(movement_ends(panel, motion, ends, of=DISTANCES))
    apart = [least_distances([run])[0] for run in runs]
    assert len({run["flangeway"].width for run in apart if run}) == 6
    assert len({run["gauge"].width for run in apart if run}) == 6
    assert apart.count({}) == 3
    np.testing.assert_equal(least_distances(runs), apart)
