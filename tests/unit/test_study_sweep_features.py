"""A sweep that keeps features alone: the same numbers in single precision, in few bytes."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import here, small_study, study_file

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.study.sweep.batch import (
    LARGEST_WITHOUT_HISTORIES,
    batch_variables,
    plan_batches,
    throw_batch,
)
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.export import sweep_table
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_study

FEATURES_ALONE = '\n[output]\nkeep = "features"\n'


def test_features_alone_are_those_of_a_sweep_with_histories(tmp_path: Path) -> None:
    for name, more in (("whole", ""), ("features", FEATURES_ALONE)):
        (tmp_path / f"of-{name}").mkdir()
        study = small_study(tmp_path / f"of-{name}", count=10, more=more)
        throw_study(study, tmp_path / name, pool=here)
    whole, features = read_labels(tmp_path / "whole"), read_labels(tmp_path / "features")
    assert set(features.variables) == set(whole.variables) - {"time"}
    assert "drive_force" not in open_batches(tmp_path / "features")
    assert len(sweep_table(tmp_path / "features")) == 10
    for name in features.variables:
        found, exact = features[name].to_numpy(), whole[name].to_numpy()
        if exact.dtype.kind != "f" or name in features.dims:
            np.testing.assert_array_equal(found, exact)
            continue
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, exact.astype(np.float32))


def test_a_throw_takes_at_most_300_bytes(tmp_path: Path) -> None:
    count = LARGEST_WITHOUT_HISTORIES
    more = FEATURES_ALONE + '\n[scheme]\nmode = "quick"\n'
    study = small_study(tmp_path, count=count, more=more)
    rows = throw_batch(study, [range(count)])
    assert len(file_bytes(batch_variables(study, rows))) <= 300 * count


def test_batches_without_histories_are_large(tmp_path: Path) -> None:
    study = small_study(tmp_path, count=100_000, more=FEATURES_ALONE)
    sizes = [sum(map(len, batch)) for batch in plan_batches(study)]
    assert sum(sizes) == 100_000
    assert sizes[0] == LARGEST_WITHOUT_HISTORIES
    assert sizes[-1] < 10


def test_histories_beside_features_alone_are_refused(tmp_path: Path) -> None:
    more = FEATURES_ALONE + 'channels = ["drive_force"]\n'
    with pytest.raises(StudyError, match=r'output\.channels: keep = "features" keeps none'):
        load_study(study_file(tmp_path, more=more))
