"""Items of lists as variables of a study: friction along the stroke."""

from pathlib import Path

import numpy as np
import pytest

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.study.study import Study

HEAD = """
schema_version = 1
name = "items"
panel = "sb1"

[set]
"chair.friction_opening" = ["0 mm", "15 mm", "60 mm"]
"chair.friction_factor" = [1.0, 1.0, 0.8]
"""


def made(folder: Path, more: str, *, head: str = HEAD) -> Study:
    path = folder / "items.toml"
    path.write_text(head + more, encoding="utf-8")
    return load_study(path)


def test_items_of_a_list_vary_one_by_one(tmp_path: Path) -> None:
    study = made(
        tmp_path,
        """
[[together]]
keys = ["chair.friction_factor.1", "chair.2.friction_factor.2", "chair.friction_opening.3"]
rows = [[1.5, 0.5, "50 mm"], [0.7, 2.0, "70 mm"]]
""",
    )
    assert study.units["chair.friction_opening.3"] == "m"
    for index, (first, second, last) in enumerate(((1.5, 0.5, 0.05), (0.7, 2.0, 0.07))):
        panel = study.panel.with_overrides(dict(study.scenario(index).overrides))
        for name, chair in panel.chair.items():
            factors = [first, second if name == "2" else 1.0, 0.8]
            np.testing.assert_allclose(chair.friction_factor, factors)
            np.testing.assert_allclose(chair.friction_opening, [0.0, 0.015, last])


def test_states_of_chairs_vary_as_a_whole(tmp_path: Path) -> None:
    more = '[[variable]]\nkey = "chair.friction_state"\nvalues = ["sound", "greased"]\n'
    study = made(tmp_path, more, head=HEAD.partition("[set]")[0])
    for index, state in enumerate(("sound", "greased")):
        panel = study.panel.with_overrides(dict(study.scenario(index).overrides))
        assert {chair.friction_state for chair in panel.chair.values()} == {state}
    with pytest.raises(StudyError, match="no such state; nearest is 'greased'"):
        made(tmp_path, more.replace("greased", "gresed"), head=HEAD.partition("[set]")[0])


def test_an_item_goes_with_a_factor_of_the_whole_list(tmp_path: Path) -> None:
    head = HEAD.partition("[set]")[0].replace("sb1", "uic60-760-1-15")
    more = """
[[variable]]
key = "rail.straight.fit_gap.value"
factor = true
values = [2.0]
"""
    usual = made(tmp_path, more, head=head).panel.rail["straight"].fit_gap
    both = made(
        tmp_path,
        more + '\n[[variable]]\nkey = "rail.straight.fit_gap.value.2"\nvalues = ["1 mm"]\n',
        head=head,
    )
    overrides = both.scenario(0).overrides
    given = overrides["rail.straight.fit_gap.value"]
    expected = np.array(usual.value) * 2.0
    expected[1] = 0.002
    np.testing.assert_allclose(np.array(given, dtype=float), expected)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ('key = "chair.friction_factor.4"\nvalues = [1.0]', "has 3 items, so there is no item 4"),
        ('key = "chair.friction_factor.0"\nvalues = [1.0]', "there is no item 0"),
        ('key = "chair.friction_factor.2"\nvalues = [20.0]', "every factor must be 0 to 10"),
        ('key = "chair.friction_opening.2"\nvalues = ["90 mm"]', "must begin with 0 and rise"),
        ('key = "chair.friction_opening.2"\nvalues = [0.01]', "has no unit"),
        ('key = "drive.1.extension.2"\nvalues = ["1 mm"]', "is not given, so there is no item 2"),
        ('key = "chair.friction_factor.2"\nfactor = true\nvalues = [2.0]', "no value of this name"),
        ('key = "chair.roller_lift"\nfactor = true\nvalues = [2.0]', "has no value that a factor"),
        ('key = "machine.sb4.clutch.torque"\nfactor = true\nvalues = [2.0]', "matches nothing"),
    ],
)
def test_items_that_cannot_be_are_refused(lines: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=said):
        made(tmp_path, f"[[variable]]\n{lines}\n")
