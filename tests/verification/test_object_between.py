"""Objects that rails have no coordinates for, against rails with nodes where they stand.

Between the nodes, and with a sloping face where no foot holds the rail up. Reference: the same
panel with both rails meshed, and reduced, with a node at the object, which is
how objects at sleepers, drives and other places of the panel are treated. Tolerance: 0.1 % for the
force of the object at the end and at most, and 0.02 % rms of the peak for the forces of the drives,
since what differs are shapes within one element (0.15 m) and what lies above the cut-off. On the
default panel itself, whose rails are bent more when they are closed, one of the three is at 0.11 %.
"""

import numpy as np
import pytest
from tests.verification.runs import DEFAULT, STUDIED

from turnout.core.scheme import Scheme
from turnout.mechanism import build
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_rows import is_off_node
from turnout.panel.foreign_object import ForeignObject, PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.solver.integration import History
from turnout.throw.simulate import solve_placed


@pytest.fixture(scope="module")
def panel() -> LoadedPanel:
    return load_panel(DEFAULT, overrides=STUDIED)


def stone(panel: LoadedPanel, at: str) -> tuple[PlacedObject, ...]:
    return resolve_objects(panel, [ForeignObject(0.013, at)])


def thrown(panel: LoadedPanel, objects: tuple[PlacedObject, ...]) -> tuple[Mechanism, History]:
    solved = solve_placed(panel, objects, scheme=Scheme.of("quick"))
    assert solved.history.outcome.complete
    return solved.mechanism, solved.history


@pytest.mark.parametrize("x", [2.93, 4.11, 5.03])
def test_forces_are_those_with_nodes_at_the_object(
    panel: LoadedPanel, x: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_as_with_nodes(panel, stone(panel, f"x = {x} m"), monkeypatch)


@pytest.mark.parametrize("slope", [0.249, -0.249])
def test_forces_along_a_face_are_those_with_nodes_at_the_drive(
    panel: LoadedPanel, slope: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = [ForeignObject(0.013, "drive 1", face_slope=slope)]
    assert_as_with_nodes(panel, resolve_objects(panel, given), monkeypatch)


def assert_as_with_nodes(
    panel: LoadedPanel, objects: tuple[PlacedObject, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    between, found = thrown(panel, objects)
    with monkeypatch.context() as patch:
        patch.setattr(build, "is_off_node", lambda *_: False)
        asked: list[object] = []
        # The rails without the object lack its node, those made with it do not.
        patch.setattr(build, "needs_node", lambda *given: asked.append(given) or len(asked) == 1)
        build.clear_mechanisms()
        at_nodes, wanted = thrown(panel, objects)
    build.clear_mechanisms()
    size, more = (sum(rail.n_interface for rail in m.rails) for m in (between, at_nodes))
    assert more > size
    law = between.index.object["1"]
    force, reference = found.law_force[:, law], wanted.law_force[:, law]
    assert reference[-1] > 1000.0
    assert force[-1] == pytest.approx(reference[-1], rel=1e-3)
    assert force.max() == pytest.approx(reference.max(), rel=1e-3)
    drives = list(between.index.drive.values())
    off = found.law_force[:, drives] - wanted.law_force[:, drives]
    peak = np.abs(wanted.law_force[:, drives]).max(axis=0)
    assert np.all(np.sqrt(np.mean(off**2, axis=0)) < 2e-4 * peak)


def test_rails_stay_the_same_for_all_places_between(panel: LoadedPanel) -> None:
    free = build.build_mechanism(panel)
    for x in (2.93, 2.94):
        mechanism = build.build_mechanism(panel, stone(panel, f"x = {x} m"))
        assert mechanism.matrices is free.matrices
        assert mechanism.rails is free.rails
        np.testing.assert_array_equal(mechanism.rows[:-1], free.rows)
        assert mechanism.law_names[-1] == "object 1"


def test_an_object_at_a_place_and_one_between_are_both_there(panel: LoadedPanel) -> None:
    given = [ForeignObject(0.01, "x = 3.37 m"), ForeignObject(0.013, "sleeper 8")]
    objects = resolve_objects(panel, given)
    assert [is_off_node(panel, item) for item in objects] == [True, False]
    mechanism, history = thrown(panel, objects)
    law = mechanism.index.object
    assert mechanism.law_names[law["1"]] == "object 1"
    assert mechanism.law_names[law["2"]] == "object 2"
    gap = mechanism.laws.offset
    alone = [build.build_mechanism(panel, (item,)) for item in objects]
    for name, one in zip(("1", "2"), alone, strict=True):
        assert gap[law[name]] == one.laws.offset[one.index.object[name]]
    assert history.law_force[:, law["2"]].max() > 0.0
