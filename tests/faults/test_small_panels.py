"""A short panel or study cannot ask for gigabytes or hours: limits, with the key and the remedy."""

import re
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from turnout.beam import spectrum
from turnout.beam.craig_bampton import MOST_INTERFACE, craig_bampton
from turnout.beam.spectrum import modes_below
from turnout.cli.main import main
from turnout.core.errors import FileError, MechanicsError, PanelError, SolverError, TurnoutError
from turnout.core.quantity import MOST_POINTS
from turnout.core.scheme import Scheme
from turnout.core.units import MOST_VALUES
from turnout.panel import matrices as matrices_file
from turnout.panel.document import MOST_MEMBERS
from turnout.panel.load import library_text, load_panel
from turnout.panel.markers import read_schedule_csv
from turnout.panel.matrices import read_rail_matrices
from turnout.solver.arrange import MOST_STEPS
from turnout.throw.simulate import simulate

SB1 = library_text("sb1")
OUTLINE = '\n[outline.z]\npoints = {{ unit = "mm", values = [{}] }}\n'
MOVEMENT = (
    "\n[movement.z]\nstart = '1 s'\nduration = '1 s'\nto = 'open'\nshape = 'table'\n"
    "table_file = '{}'\n"
)


def problems(tmp_path: Path, text: str) -> list[str]:
    """Return the problems of a panel file, none of which is long."""
    path = tmp_path / "panel.toml"
    path.write_text(text)
    with pytest.raises(PanelError) as caught:
        load_panel(path)
    assert len(str(caught.value)) < 50_000
    return list(caught.value.problems)


def generated(step: str, count: int) -> str:
    """Return a panel whose sleepers are generated."""
    sleeper = f'[sleeper]\nx = {{ start = "0 m", step = "{step}", count = {count} }}\n'
    return re.sub(r"\[sleeper\].*?(?=\n\[)", sleeper, SB1, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SB1 + "".join(f"\n[sleeper.z{number}]\nx = '1 m'\n" for number in range(2000)),
         rf"^sleeper: makes 2\d\d\d members, at most {MOST_MEMBERS}; give fewer"),
        (generated("0.6 m", 10**9), "`count` must be 1 ... 10000"),
        (generated("1e306 m", 500), "must lead to finite"),
        (SB1.replace("[chair]", "[chair]\nfoot_offsets = [" + "'1 mm', " * 90_000 + "]", 1),
         "90000 values for"),
        (SB1 + OUTLINE.format("[1, 2], " * (MOST_POINTS + 1)),
         f"at most {MOST_POINTS} are read, leave some out"),
    ],
    ids=["members", "generated", "infinite", "shared", "outline"],
)  # fmt: skip
def test_members_and_values_have_limits(tmp_path: Path, text: str, message: str) -> None:
    assert any(re.search(message, problem) for problem in problems(tmp_path, text))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("chair.foot_offsets", [f"{number} mm" for number in range(9)],
         "9 foot points, at most 8; give those of the edges"),
        ("discretisation.element_length", 1e-6,
         r"element_length = 1e-06 m: makes .* at most 5000"),
        ("discretisation.superelement_cutoff", 1e9,
         r"superelement_cutoff = 1e\+09: must be at most 100000"),
    ],
)  # fmt: skip
def test_foot_points_elements_and_modes_have_limits(key: str, value: object, message: str) -> None:
    with pytest.raises(PanelError, match=message):
        load_panel("sb1").with_overrides({key: value})


def test_a_reduction_has_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    size = MOST_INTERFACE + 10
    chain = sp.diags_array(
        [[-1.0] * (size - 1), [2.0] * size, [-1.0] * (size - 1)], offsets=[-1, 0, 1]
    )
    with pytest.raises(MechanicsError, match="interface coordinates .*element_length"):
        craig_bampton(chain, chain, range(size - 1), cutoff_frequency=1.0)
    monkeypatch.setattr(spectrum, "MOST_MODES", 3)
    few = sp.csr_array(sp.diags_array([1.0, 2.0, 3.0, 4.0]))
    with pytest.raises(MechanicsError, match="4 modes lie below 9 Hz, at most 3 are kept; lower"):
        modes_below(few, sp.csr_array(sp.eye_array(4)), cutoff_frequency=9.0)


SOONER = r"end sooner \(schedule.end\)"
INSTANTS = rf"instants every .* at most {MOST_STEPS} are made"


@pytest.mark.parametrize(
    ("end", "scheme", "message"),
    [
        (1e4, Scheme(), SOONER), (1e308, Scheme(), SOONER), (100.0, Scheme(step=1e-5), SOONER),
        (9e5, Scheme.of("quick"), SOONER), (None, Scheme(output_interval=1e-9), INSTANTS),
    ],
)  # fmt: skip
def test_steps_and_stored_instants_have_a_limit_with_a_remedy(
    end: float | None, scheme: Scheme, message: str
) -> None:
    panel = load_panel("sb1").with_overrides({} if end is None else {"schedule.end": end})
    with pytest.raises(SolverError, match=message):
        simulate(panel, scheme=scheme)


def test_many_problems_are_reported_in_part_and_counted(tmp_path: Path) -> None:
    unknown = "".join(f"stiffness_of_the_{number} = 1\n" for number in range(5000))
    found = problems(tmp_path, unknown + SB1)
    assert len(found) == 51
    assert ": and 4950 more problems" in found[-1] or ": and 4950 more problems" in found[0]
    inside = "".join(f"d{number} = '1 s', " for number in range(5000)).rstrip(", ")
    movement = MOVEMENT.format("a").replace("table_file = 'a'", f"extra_time = {{ {inside} }}")
    path = tmp_path / "panel.toml"
    path.write_text(SB1 + movement)
    with pytest.raises(PanelError, match="\n  - and [0-9]+ more$") as caught:
        load_panel(path)
    assert len(str(caught.value)) < 50_000


def test_a_path_of_an_unknown_user_is_one_message(tmp_path: Path) -> None:
    found = problems(tmp_path, SB1 + MOVEMENT.format("~no-such-user/x.csv"))
    assert any("no such file" in problem for problem in found)
    with pytest.raises(FileError, match="no such file"):
        load_panel("~no-such-user/panel.toml")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time,fraction\n" + "1" * 200_000 + ",0\n", "line 2: field larger"),
        ("time,fraction\n" + "0,0\n" * (MOST_VALUES + 1), f"at most {MOST_VALUES} rows are read"),
        ("x" * 100_000, "the first line must name"),
        ("time,fraction\n0," + "y" * 100_000, "is not a number"),
    ],
    ids=["a long cell", "many rows", "a long heading", "a long text"],
)
def test_long_schedules_are_one_short_message(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text(content)
    with pytest.raises(FileError, match=message) as caught:
        read_schedule_csv(path)
    assert len(str(caught.value)) < 500


def test_matrices_are_not_unpacked_beyond_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of 32 kB that holds 32 MB of zeros, as 1 MB could hold 1 GB."""
    monkeypatch.setattr(matrices_file, "LARGEST_UNPACKED", 10_000_000)
    packed = zlib.compress(struct.pack("<II", 14, 1 << 25) + bytes(1 << 25), 9)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path = tmp_path / "rail.mat"
    path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    assert path.stat().st_size < 50_000
    matrices, (fault,) = read_rail_matrices(path)
    assert matrices is None
    assert "once unpacked; reduce the rail" in fault


@pytest.mark.parametrize("key", ["gravity", "schedule.end", "drive.1.stiffness", "chair.x"])
def test_numbers_at_the_end_of_their_range_end_in_a_message(key: str) -> None:
    for value in (1e308, 5e-324, 10**400, -(10**400), np.inf):
        try:
            panel = load_panel("sb1").with_overrides({key: value})
        except TurnoutError:
            continue
        assert panel.hash


def test_memory_that_runs_out_is_one_message(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As under a limit of the system: 4.8 mm elements in 2 GB gave a traceback."""

    def exhausted(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("turnout.cli.options.PanelOptions.opened", exhausted)
    monkeypatch.setattr(sys, "argv", ["turnout", "panel", "check", "sb1"])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("turnout: memory ran out; give less")
    assert len(said.splitlines()) == 1
