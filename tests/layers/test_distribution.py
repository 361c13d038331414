"""Tests are shared out over processes by names of files, which must be there."""

import pytest
from tests.distribution import BROWSER, LONG


def test_files_that_are_named_are_there_and_named_once(pytestconfig: pytest.Config) -> None:
    names = [*BROWSER, *LONG]
    assert [name for name in names if not (pytestconfig.rootpath / name).is_file()] == []
    assert len(set(names)) == len(names)
