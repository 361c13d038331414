"""Panels unlike those of the library: other numbers of drives and rails, other schedules."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from turnout.core.toml import parse_toml
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, library_text, load_panel, panel_from_file
from turnout.panel.markers import marker_positions


def panel(name: str, *changes: tuple[str, str]) -> LoadedPanel:
    text = library_text(name)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return panel_from_file(parse_toml(text, source=name))


ONE_DRIVE = (
    '[drive.2]  # source: benchmark SB1\nx = "6.9 m"\nstroke = "60.2 mm"\nstiffness = "810 kN/m"\n',
    "",
)


def test_one_drive() -> None:
    one = panel("sb1", ONE_DRIVE, ('extra_time = { 2 = "0.2 s" }\n', ""))
    assert list(one.drive) == ["1"]
    assert marker_positions(one, [0.0, 4.0, 8.0]).tolist() == [[0.0, 0.12, 0.0]]
    assert len(resolve_objects(one, [ForeignObject(0.013, "x = 3.9 m")])) == 1


def test_six_drives_from_one_generator() -> None:
    six = panel(
        "sb1",
        ("[drive]", '[drive]\nx = { start = "0.3 m", step = "1.2 m", count = 6 }'),
        ONE_DRIVE,
        ('\n[drive.1]  # source: benchmark SB1\nx = "0.3 m"\nstroke = "120 mm"\nstiffness =',
         'stroke = "80 mm"\nstiffness ='),
    )  # fmt: skip
    assert list(six.drive) == ["1", "2", "3", "4", "5", "6"]
    assert marker_positions(six, np.linspace(0.0, 9.0, 10)).shape == (6, 10)
    np.testing.assert_allclose(marker_positions(six, [4.5])[:, 0], 0.08)


def test_a_panel_that_never_moves() -> None:
    text = library_text("sb1")
    start, end = text.index("[movement.throw]"), text.index("[object_defaults]")
    still = panel_from_file(parse_toml(text[:start] + text[end:], source="still"))
    assert still.movement == {}
    assert not marker_positions(still, np.linspace(0.0, 9.0, 5)).any()


TABLE = (
    'to = "closed"\nshape = "smoothstep"',
    'to = "closed"\nshape = "table"\ntable_time = ["0 s", "1.5 s", "3 s"]\n'
    "table_fraction = [0, 0.2, 1]",
)


def csv_panel(folder: Path, content: str) -> Path:
    (folder / "throw.csv").write_text(content)
    path = folder / "mine.toml"
    new = 'to = "closed"\nshape = "table"\ntable_file = "throw.csv"'
    path.write_text(library_text("sb1").replace(TABLE[0], new, 1))
    return path


def test_schedule_from_a_csv_beside_the_panel_file(tmp_path: Path) -> None:
    path = csv_panel(tmp_path, "# recorded\ntime, fraction\n0, 0\n1.5,0.2\n\n3,1\n")
    read = load_panel(path)
    found = marker_positions(read, [1.0, 2.5, 4.0])[0]
    np.testing.assert_allclose(found, [0.0, 0.024, 0.12], rtol=1e-12, atol=1e-15)
    time = np.linspace(0.0, 9.0, 91)
    np.testing.assert_array_equal(
        marker_positions(read, time), marker_positions(panel("sb1", TABLE), time)
    )
    # Columns in the other order, and the same panel content: the same hash.
    other = csv_panel(tmp_path, "fraction,time\n0,0\n0.2,1.5\n1,3\n")
    assert load_panel(other).hash == read.hash == panel("sb1", TABLE).hash
    # Elsewhere, as in a worker, the panel does not need the file any more.
    (tmp_path / "throw.csv").unlink()
    changed = pickle.loads(pickle.dumps(read)).with_overrides({"drive.1.stroke": 0.1})
    assert changed.movement["throw"].table_fraction == [0.0, 0.2, 1.0]


def test_loading_a_library_panel_needs_no_pint() -> None:
    script = (
        "import sys; from turnout.panel.load import load_panel; load_panel('uic60-760-1-15');"
        "print('pint' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": ":".join(sys.path), "PATH": ""},
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("starts", ["open", "closed"])
def test_either_start(starts: str) -> None:
    turned = {"open": ("closed", "open"), "closed": ("open", "closed")}[starts]
    both = load_panel(
        "sb2",
        overrides={
            "schedule.starts": starts,
            "movement.throw.to": turned[0],
            "movement.return.to": turned[1],
        },
    )
    sign = 1.0 if starts == "open" else -1.0
    np.testing.assert_allclose(marker_positions(both, [4.0])[:, 0], [sign * 0.115, sign * 0.075])
