"""What is kept by content: nothing is rebuilt that need not be, damage costs time only."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from turnout.core import cache_folder
from turnout.core import content_cache as cache
from turnout.core.lru_cache import LRUCache
from turnout.mechanism import build, reduce
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.mechanism.object_rows import needs_node
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel

PANEL = load_panel("uic60-760-1-15")
TABLE = ["-8 mm", "-5 mm", "0 mm", "9 mm"]


def forget() -> None:
    """Empty the memory, not the folder."""
    cache.clear_content_cache()
    reduce.clear_superelements()
    build.clear_mechanisms()


def assert_same(one: Mechanism, other: Mechanism) -> None:
    for name in ("stiffness", "mass", "damping", "load", "rows"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    for name, values in one.laws._asdict().items():
        np.testing.assert_array_equal(values, getattr(other.laws, name), err_msg=name)
    assert one.index == other.index


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty memory and an empty folder."""
    monkeypatch.setenv("TURNOUT_CACHE_DIR", str(tmp_path))
    forget()
    cache.counts.clear()
    monkeypatch.setattr(cache, "_reported", set())
    yield tmp_path
    forget()


def built(overrides: dict[str, object]) -> dict[str, int]:
    """Build a mechanism; return what was computed for it."""
    cache.counts.clear()
    build_mechanism(PANEL.with_overrides(overrides))
    return {name: n for name, n in cache.counts.items() if name.endswith("computed")}


def kept_files() -> list[Path]:
    folder = cache.cache_folder()
    assert folder is not None
    return sorted(folder.glob("*.npz"))


def test_only_what_changes_is_built_again(fresh: Path) -> None:
    assert built({}) == {"section computed": 2, "superelement computed": 2}
    nothing: dict[str, int] = {}
    for overrides in (
        {},
        {"chair.friction_coefficient": 0.2},
        {"drive.2.stiffness": 81e3, "drive.1.stroke": 0.1, "drive.saturation_force": 5e3},
        {"chair.damping": 1e3, "stop.stiffness": 1e8, "link.stiffness": 1e6, "gravity": 9.0},
        {"chair.normal_stiffness": 2e7, "damping.ratio": 0.01, "stop.clearance": 0.001},
    ):
        assert built(overrides) == nothing
    # One for both rails of a symmetric panel, each the image of the other.
    assert built({"fastening.stiffness_y": 4e7}) == {"superelement computed": 1}
    assert built({"stock_fastening.stiffness_y": 4e7}) == {"superelement computed": 1}
    assert built({"drive.2.x": 7.0}) == {"superelement computed": 1}
    shaved = built({"planed_section.clearance": 0.002})
    assert shaved == {"section computed": 1, "superelement computed": 1}


def test_rails_of_other_sections_share_all_else(
    fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What differs in the scales of sections is what would be made from the start."""
    monkeypatch.setattr(reduce, "FIRST_STORED", 0)
    build_mechanism(PANEL)
    scaled = {"rail.section_scale": 0.93, "rail.lateral_inertia_scale": 1.05}
    panel = PANEL.with_overrides(scaled)
    shared = build_mechanism(panel)
    assert built(scaled) == {}
    forget()
    made = build_mechanism(panel)
    assert_same(shared, made)
    assert not any("superelement" in path.name for path in kept_files())


def test_files_serve_the_next_process(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small superelements that a process computes after some others are made again."""
    monkeypatch.setattr(reduce, "FIRST_STORED", 1)
    first = build_mechanism(PANEL)
    forget()
    cache.counts.clear()
    second = build_mechanism(PANEL)
    assert cache.counts == {
        "section from file": 2,
        "section from memory": cache.counts["section from memory"],
        "superelement from file": 1,
        "superelement computed": 1,
        "superelement from memory": 2,
    }
    assert_same(first, second)


def test_a_damaged_file_is_made_again_and_reported_once(
    fresh: Path, caplog: pytest.LogCaptureFixture
) -> None:
    make = {"value": np.array([1.0, 2.0])}
    cache.cached_arrays("a", [1], lambda: make)
    cache.cached_arrays("a", [2], lambda: make)
    files = kept_files()
    assert len(files) == 2
    files[0].write_bytes(b"no archive")
    files[1].write_bytes(files[1].read_bytes()[:60])
    forget()
    with caplog.at_level(logging.WARNING, logger="turnout"):
        for number in (1, 2):
            again = cache.cached_arrays("a", [number], lambda: {"value": np.array([1.0, 2.0])})
            assert again["value"].tolist() == [1.0, 2.0]
    assert cache.counts["damaged"] == 2
    assert len(caplog.records) == 1
    forget()
    cache.cached_arrays("a", [1], lambda: {"value": np.zeros(0)})
    assert cache.counts["a from file"] == 1


@pytest.mark.parametrize("private", [True, False])
def test_a_folder_that_cannot_be_written_costs_nothing_but_time(
    private: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fresh: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A private folder takes its place, where there can be one."""
    blocked, other = tmp_path / "file", tmp_path / "private"
    blocked.write_text("in the way")
    other.mkdir(mode=0o700)
    monkeypatch.setenv("TURNOUT_CACHE_DIR", str(blocked))
    monkeypatch.setattr(cache_folder, "private_folder", lambda: other if private else None)
    with caplog.at_level(logging.WARNING, logger="turnout"):
        for number in (1, 2):
            made = cache.cached_arrays("b", [number], lambda: {"value": np.array([3.0])})
            assert made["value"].tolist() == [3.0]
            with pytest.raises(ValueError, match="read-only"):
                made["value"][0] = 1.0
    assert len(list(other.glob("models-*/*.npz"))) == (2 if private else 0)
    assert cache.counts["unwritable"] == (0 if private else 2)
    assert private or [r.message for r in caplog.records if "TURNOUT_CACHE_DIR" in r.message]


def test_old_files_go_and_memory_stays_small(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "MOST_FILES", 10)
    monkeypatch.setattr(cache, "_memory", LRUCache(3))
    for number in range(12):
        cache.cached_arrays("d", [number], lambda: {"value": np.array([3.0])})
    assert len(kept_files()) <= 10
    cache.counts.clear()
    cache.cached_arrays("d", [11], lambda: {"value": np.array([4.0])})
    cache.cached_arrays("d", [0], lambda: {"value": np.array([4.0])})
    assert cache.counts["d from memory"] == 1
    assert cache.counts["d computed"] == 1


def test_folders_of_other_sources_are_bounded(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each change of the sources makes folders of its own, which nothing else would remove."""
    monkeypatch.setattr(cache_folder, "MOST_FOLDERS", 2)
    monkeypatch.setattr(cache_folder, "safe_folder", cache_folder.safe_folder.__wrapped__)
    for age in range(4):
        for kind in ("models", "kernels"):
            old = fresh / f"{kind}-{age:016x}"
            old.mkdir()
            os.utime(old, (1e9 - age, 1e9 - age))
    (fresh / "kept-by the user").mkdir()
    folder = cache.cache_folder()
    left = sorted(path.name for path in fresh.iterdir())
    assert folder is not None
    assert left == sorted(
        ["kept-by the user", folder.name]
        + [f"{kind}-{age:016x}" for kind in ("models", "kernels") for age in (0, 1)]
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"chair.friction_coefficient": 0.2, "drive.2.stiffness": 81e3, "drive.1.stroke": 0.1},
        {"chair.normal_stiffness": 2e7, "chair.clearance": 1e-4, "chair.stick_stiffness": 1e7},
        {"chair.1.damping": 9e3},
        {"chair.foot_height": 0.001},
        {"drive.1.roll_stiffness": 1e3},
        {"gravity": 9.0},
        {"stop.1.clearance": 0.001},
        {"material.density": 7000.0},
        {"drive.2.extension": TABLE, "drive.2.force": ["-5 kN", "-4 kN", "0 N", "6 kN"]},
        {"link.stiffness": 2e6, "object_defaults.stiffness": 3e7, "movement.return.start": 5.0},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_kept_linear_part_is_the_one_that_would_be_made(changes: dict[str, object]) -> None:
    """Panels made from one another share records, and what is kept by them."""
    panel = PANEL.with_overrides(changes)
    build_mechanism(PANEL, resolve_objects(PANEL, [ForeignObject("5 mm", "sleeper 6")]))
    objects = resolve_objects(panel, [ForeignObject("13 mm", "sleeper 6")])
    kept = build_mechanism(panel, objects)
    build.clear_mechanisms()
    made = build_mechanism(panel, objects)
    assert_same(kept, made)


def test_nothing_of_a_rail_is_left_in_a_cleared_memory(fresh: Path) -> None:
    build_mechanism(PANEL.with_overrides({"chair.damping": 1e3}))
    caches = (reduce._rails, reduce._reductions)
    assert all(cache._values for cache in caches)
    reduce.clear_superelements()
    assert not any(cache._values for cache in caches)


def test_laws_take_the_values_of_their_own_chairs() -> None:
    own = {"chair.3.friction_coefficient": 0.5, "chair.3.normal_stiffness": 2e7}
    mechanism = build_mechanism(PANEL.with_overrides({**own, "chair.3.clearance": 1e-4}))
    laws, rail = mechanism.laws, PANEL.instrumented_rail
    for chair, values in (("3", (2e7, 1e-4, 0.5)), ("4", None)):
        contact, friction = (
            index[rail, chair][0]
            for index in (mechanism.index.chair, mechanism.index.chair_friction)
        )
        slope = laws.slope[laws.segment_start[contact] + 1]
        found = (slope, laws.offset[contact], laws.friction_coefficient[friction])
        record = PANEL.chair[chair]
        usual = (record.normal_stiffness, record.clearance, record.friction_coefficient)
        assert found == pytest.approx(values or usual)


def test_panels_of_the_same_keys_share_what_shapes_them(fresh: Path) -> None:
    """Values of laws do not count, strokes do; the mechanism is the one made from the start."""
    keys = ("chair.friction_coefficient", "drive.1.stiffness", "drive.2.over_travel_closed")
    for more in ({}, {"drive.1.stroke": 0.11}):
        panels = [
            PANEL.with_overrides(dict(zip(keys, values, strict=True)) | more)
            for values in ((0.2, 7e5, 3e-3), (0.21, 7.1e5, 3.1e-3), (0.22, 7.2e5, 3.2e-3))
        ]
        objects = [resolve_objects(panel, [ForeignObject(0.01, "sleeper 6")]) for panel in panels]
        made = [build_mechanism(*pair) for pair in zip(panels, objects, strict=True)]
        assert made[1].core is made[2].core
        assert made[1].object_rows is made[2].object_rows
        assert made[1].stiffness is made[2].stiffness
        build.clear_mechanisms()
        again = build_mechanism(panels[2], objects[2])
        assert_same(made[2], again)
        elsewhere = resolve_objects(panels[2], [ForeignObject(0.01, "sleeper 7")])
        assert build_mechanism(panels[2], elsewhere).object_rows is not again.object_rows


@pytest.mark.parametrize("scales", [{}, {"rail.section_scale": 0.93}])
def test_rails_made_with_an_object_at_their_nodes_are_those_without(
    scales: dict[str, object], fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = PANEL.with_overrides(scales)
    objects = resolve_objects(
        panel,
        [ForeignObject("13 mm", "sleeper 6"), ForeignObject("5 mm", "sleeper 4", rail="curved")],
    )
    bare, shared = build_mechanism(panel), build_mechanism(panel, objects)
    assert shared.stiffness is bare.stiffness
    assert not shared.stiffness.flags.writeable
    assert shared.core is bare.rows
    build.clear_mechanisms()
    asked: list[object] = []

    def only_of_own_rails(*given: Any) -> Any:
        asked.append(given)
        return needs_node(*given) or len(asked) == 1

    monkeypatch.setattr(build, "needs_node", only_of_own_rails)
    made = build_mechanism(panel, objects)
    assert len(asked) == 3
    assert_same(shared, made)


def test_faces_of_all_slopes_share_the_rails_of_a_drive(fresh: Path) -> None:
    """No foot holds the rail up at a rod: its flexibility along the face softens the object."""
    made = [
        build_mechanism(PANEL, resolve_objects(PANEL, [ForeignObject(0.01, "drive 1", **face)]))
        for face in ({"face_slope": 0.05}, {"face_slope": -0.02}, {})
    ]
    assert made[0].core is made[1].core is made[2].core
    at = made[0].index.object["1"]
    first, last = made[0].laws.segment_start[at : at + 2]
    stiffness = [one.laws.slope[first:last].max() for one in made]
    assert 0.0 < stiffness[0] < stiffness[1] < stiffness[2]
    assert not np.array_equal(made[0].object_rows, made[1].object_rows)
