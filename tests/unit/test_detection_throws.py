"""Paired throws of the default panel: what an object that is not touched changes."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import here

from turnout.cli.limit import TEXTS
from turnout.core.progress import Pace, Progress
from turnout.core.workers import Workers
from turnout.detection.floor import touched
from turnout.detection.reference import reference_study
from turnout.detection.throws import (
    floor_study,
    gaps_at,
    objects_study,
    places_of,
    stored_throws,
    throw_all,
)
from turnout.study.sweep.read import open_batches
from turnout.study.sweep.run import throw_studies

PLACES = {"sleeper 6": (0.5e-3, 12e-3)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two states: sound, with gaps kept, and with objects too thin and thick enough."""
    place, study = tmp_path_factory.mktemp("limit"), reference_study(count=2)
    studies = {
        place / "sound": study,
        place / "floor": floor_study(study),
        place / "objects": objects_study(study, PLACES),
    }
    throw_studies(studies, pool=here)
    return place


def test_a_kind_has_a_folder_of_its_own_and_is_reported_as_objects(tmp_path: Path) -> None:
    reported: list[Progress] = []
    with Workers(1, pool=here) as workers:
        given = throw_all(
            None, tmp_path, sound=2, states=1, steps=(2e-3,), kind="ice",
            workers=workers, pace=Pace(reported.append),
        )  # fmt: skip
    assert {state.stage for state in reported} <= {"", *TEXTS, "objects-ice"}
    each = len(places_of(reference_study(count=1).panel))
    assert {state.total for state in reported} == {2 + 1 + each}  # known from the start
    assert [reported[at].done for at in (0, -1)] == [0, 3 + each]
    assert {item.name for item in tmp_path.iterdir()} >= {"sound", "floor", "objects-ice"}
    again = stored_throws(None, tmp_path, kind="ice")
    np.testing.assert_array_equal(again.change, given.change)
    np.testing.assert_allclose(again.sizes, given.sizes)
    assert again.kind == given.kind == "ice"


def test_an_object_that_is_not_touched_changes_nothing(folder: Path) -> None:
    sound = open_batches(folder / "sound")["drive_force"].to_numpy()
    objects = open_batches(folder / "objects")
    peak = objects["object_force_peak"].to_numpy().reshape(2, 2)
    change = objects["drive_force"].to_numpy().reshape(2, 2, *sound.shape[1:]) - sound[:, None]
    assert touched(peak).tolist() == [[False, True]] * 2
    np.testing.assert_array_equal(change[:, 0], 0.0)
    assert np.abs(change[:, 1]).max() > 100.0


def test_before_the_object_appears_both_throws_are_the_same(folder: Path) -> None:
    sound = open_batches(folder / "sound")
    objects = open_batches(folder / "objects")["drive_force"].to_numpy()
    before = sound["time"].to_numpy() < 4.3
    pairs = objects.reshape(2, 2, *objects.shape[1:]) - sound["drive_force"].to_numpy()[:, None]
    np.testing.assert_array_equal(pairs[..., before], 0.0)


def test_gaps_after_closing_tell_what_is_touched(folder: Path) -> None:
    gaps = gaps_at(open_batches(folder / "floor"), np.array([0.3, 3.6]), rail="straight")
    assert gaps.shape == (2, 2)
    assert np.all(np.abs(gaps[:, 0]) < 1e-3)  # Drive 1 closes
    assert np.all((gaps[:, 1] > 0.5e-3) & (gaps[:, 1] < 12e-3))
