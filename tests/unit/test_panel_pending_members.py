"""Families that are made when they are needed are those of a panel that was read as a whole."""

import copy
import pickle
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from tests.unit.sweeps import small_study

from turnout.mechanism.build import build_mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.model import Panel
from turnout.panel.pending_members import all_lack, member_numbers

KEY = "chair.friction_coefficient"
CHANGED = {KEY: 0.37, "drive.1.stiffness": 7e5}
EACH = {
    f"chair.{name}.friction_coefficient": 0.2 + 0.01 * number
    for number, name in enumerate(load_panel("uic60-760-1-15").chair)
} | {"drive.1.stiffness": 7e5}


@pytest.fixture
def restless_threads() -> Iterator[None]:
    """Let threads of Python take turns at any moment."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def pending_panel(changed: dict[str, float] = CHANGED) -> LoadedPanel:
    """Another one was made with the same keys before."""
    panel = load_panel("uic60-760-1-15")
    panel.with_overrides({key: 0.9 * value for key, value in changed.items()})
    found = panel.with_overrides(changed)
    assert list(found._pending) == ["chair"]
    return found


@pytest.mark.parametrize(
    "look",
    [
        lambda panel: panel.chair,
        lambda panel: {**panel.chair, **panel.drive},
        lambda panel: dict(panel),
        lambda panel: panel.__dict__,
        lambda panel: vars(panel),
        lambda panel: panel.model_dump(),
        lambda panel: panel.model_dump_json(),
        lambda panel: TypeAdapter(Panel).dump_python(panel),
        lambda panel: panel.hash,
        lambda panel: repr(panel),
        lambda panel: copy.copy(panel).chair,
        lambda panel: copy.deepcopy(panel).chair,
        lambda panel: panel.model_copy(update={"gravity": 9.0}).chair,
        lambda panel: pickle.loads(pickle.dumps(panel)).chair,
        lambda panel: [*panel.chair.values()],
        lambda panel: panel.with_overrides({"chair.5.friction_coefficient": 0.2}).chair,
        lambda panel: panel.with_overrides({KEY: 0.2}).chair,
        lambda panel: resolve_objects(panel, [ForeignObject(0.01, "chair 5")]),
    ],
)
@pytest.mark.parametrize("changed", [CHANGED, EACH], ids=["alike", "each"])
def test_it_looks_as_ever(look: Callable[[LoadedPanel], Any], changed: dict[str, float]) -> None:
    wanted = load_panel("uic60-760-1-15", overrides=changed)
    assert look(pending_panel(changed)) == look(wanted)


def test_it_equals_a_panel_read_as_a_whole() -> None:
    wanted = load_panel("uic60-760-1-15", overrides=CHANGED)
    assert pending_panel() == wanted
    assert wanted == pending_panel()
    assert pending_panel() == pending_panel()
    assert pending_panel(CHANGED | {KEY: 0.38}) != wanted
    found = pending_panel()
    assert found.chair is found.chair
    assert not found._pending
    with pytest.raises(AttributeError, match="no_such_family"):
        found.no_such_family  # noqa: B018


def test_threads_find_the_same_records(restless_threads: None) -> None:
    for _ in range(50):
        panel, begin = pending_panel(), Barrier(4)

        def look(panel: LoadedPanel = panel, begin: Barrier = begin) -> tuple[int, int]:
            begin.wait()
            return id(panel.chair), len(vars(panel)["chair"])

        with ThreadPoolExecutor(4) as pool:
            assert len({task.result() for task in [pool.submit(look) for _ in range(4)]}) == 1


@pytest.mark.parametrize("changed", [CHANGED, EACH], ids=["alike", "each"])
def test_numbers_are_those_of_the_records(changed: dict[str, float]) -> None:
    found, fields = pending_panel(changed), ("clearance", "friction_coefficient", "x")
    numbers = member_numbers(found, "chair", fields)
    assert all_lack(found, "chair", "friction_factor")
    assert not all_lack(found, "chair", "friction_coefficient")
    assert found._pending
    records = list(found.chair.values())
    np.testing.assert_array_equal(numbers, [[getattr(r, f) for r in records] for f in fields])
    np.testing.assert_array_equal(numbers, member_numbers(found, "chair", fields))
    assert all_lack(found, "chair", "friction_factor")


def test_throws_of_a_sweep_make_none(tmp_path: Path) -> None:
    study = small_study(tmp_path, count=3, more='[scheme]\nmode = "quick"\n')
    study.panel.with_overrides(dict(study.scenario(0).overrides))
    panels = [study.panel.with_overrides(dict(s.overrides)) for s in study.scenarios()]
    for panel in panels:
        build_mechanism(panel)
    assert all(panel._pending for panel in panels[1:])
