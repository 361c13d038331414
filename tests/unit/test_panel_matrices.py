"""Rails as matrices: what a file says, what may be left out, and every fault with its remedy."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.io import loadmat, savemat
from tests.verification.prismatic_panel import TEXT, prismatic_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import MechanicsError, PanelError
from turnout.mechanism.build import build_mechanism
from turnout.metric.export import export_matrices
from turnout.metric.modes import modes
from turnout.panel.load import load_panel
from turnout.panel.model import Panel
from turnout.panel.stored import panel_data, panel_from_data

Content = dict[str, Any]
FILE = "rail_A.mat"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A panel file, its exported rail, and a panel file that names it."""
    for name, content in export_matrices(prismatic_panel(tmp_path)).items():
        (tmp_path / name).write_bytes(content)
    named(tmp_path, FILE)
    return tmp_path


def named(folder: Path, file: str, extra: str = "") -> Path:
    path = folder / "panel.toml"
    text = TEXT.replace("[rail.A]", f'[rail.A]\nmatrices = "{file}"') + extra
    path.write_text(text, encoding="utf-8")
    return path


def changed(folder: Path, change: Callable[[Content], object]) -> Path:
    content = {k: v for k, v in loadmat(folder / FILE).items() if not k.startswith("__")}
    change(content)
    savemat(folder / "changed.mat", content)
    return named(folder, "changed.mat")


def lowest(path: Path) -> np.ndarray:
    return modes(load_panel(path), count=6)["frequency"].values


def test_files_say_what_they_hold(folder: Path) -> None:
    whole, reduced = (loadmat(folder / name) for name in (FILE, "rail_A_superelement.mat"))
    assert sp.issparse(whole["stiffness"])
    assert whole["table_x"].shape == (whole["mass"].shape[0], 1)
    assert whole["table_direction"][1, 0].item() == "uy"
    n = reduced["stiffness"].shape[0]
    assert reduced["transformation"].shape[1] == n
    names = [cell[0].item() for cell in reduced["interface_names"]]
    assert "uy at x = 0.3 m" in names
    assert reduced["frequencies_kept"].size == n - len(names)


@pytest.mark.parametrize("file", [FILE, "rail_A_superelement.mat"])
def test_a_rail_comes_back_with_its_frequencies(folder: Path, file: str) -> None:
    own = lowest(folder / "cantilever.toml")
    np.testing.assert_allclose(lowest(named(folder, file)), own, rtol=1e-7)


def test_they_are_stored_to_the_bit(folder: Path) -> None:
    panel = load_panel(folder / "panel.toml")
    data = json.loads(json.dumps(panel_data(panel)))
    given, found = panel.matrices["A"], panel_from_data(data).matrices["A"]
    for name in ("stiffness", "mass", "damping", "rows"):
        mine, others = getattr(found, name), getattr(given, name)
        assert (mine is None) == (others is None)
        assert mine is None or mine.toarray().tobytes() == others.toarray().tobytes()
    assert (found.direction, found.digest) == (given.direction, given.digest)


def test_rows_that_a_matrix_does_not_have_are_refused(folder: Path) -> None:
    def far(content: Content) -> None:
        content["stiffness"] = sp.csc_matrix(content["stiffness"])
        content["stiffness"].indices[:] = 10**6

    with pytest.raises(PanelError, match="stiffness is damaged: "):
        load_panel(changed(folder, far))


def test_what_may_be_left_out_is_made_up(folder: Path) -> None:
    def bare(content: Content) -> None:
        for name in ("damping", "unit_weight", "table_z", "with_supports", "format"):
            del content[name]
        content["stiffness"] = content["stiffness"].toarray()
        content["table_direction"] = [cell[0].item() for cell in content["table_direction"]]

    plain = load_panel(changed(folder, bare))
    own = build_mechanism(load_panel(folder / "cantilever.toml"))
    made = build_mechanism(plain)
    np.testing.assert_allclose(made.load, own.load, atol=1e-6 * np.abs(own.load).max())
    np.testing.assert_allclose(made.damping, own.damping, atol=1e-9)


def test_the_hash_follows_the_content_and_not_the_name(folder: Path) -> None:
    first = load_panel(folder / "panel.toml")
    (folder / "copy.mat").write_bytes((folder / FILE).read_bytes())
    assert load_panel(named(folder, "copy.mat")).hash == first.hash
    softer = load_panel(changed(folder, lambda c: c.update(stiffness=0.9 * c["stiffness"])))
    assert softer.hash != first.hash
    assert load_panel(folder / "cantilever.toml").hash != first.hash


def test_a_loaded_panel_no_longer_needs_the_file(folder: Path) -> None:
    panel = load_panel(folder / "panel.toml")
    (folder / FILE).unlink()
    copy = pickle.loads(pickle.dumps(panel.with_overrides({"drive.1.stiffness": 5e5})))
    assert build_mechanism(copy).stiffness.shape == build_mechanism(panel).stiffness.shape


def test_records_alone_do_not_hold_the_matrices(folder: Path) -> None:
    loaded = load_panel(folder / "panel.toml")
    records = Panel.model_construct(**{name: getattr(loaded, name) for name in Panel.model_fields})
    with pytest.raises(MechanicsError, match="load the panel with load_panel"):
        build_mechanism(records)


def lopsided(content: Content) -> None:
    matrix = content["stiffness"].tolil()
    matrix[1, 7] *= 1.1
    content["stiffness"] = matrix.tocsc()


def with_short_table(content: Content) -> None:
    for name in ("table_x", "table_z", "table_direction"):
        content[name] = content[name][:-6]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("mass"), "has no variable 'mass'"),
        (lambda c: c.update(Mass=c.pop("mass")), "no variable 'mass'; nearest is 'Mass'"),
        (lambda c: c.update(stiffness=c["stiffness"][:-1]), "stiffness is .*must be square"),
        (lambda c: c.update(mass=c["mass"][:-6, :-6]), "they must be alike"),
        (lambda c: c.update(damping=c["damping"][:-6, :-6]), "damping is .*must be"),
        (lopsided, "stiffness is not symmetric"),
        (lambda c: c.update(mass=-c["mass"]), "negative number on its diagonal"),
        (lambda c: c.update(damping=-c["mass"]), "damping has a negative number on its diagonal"),
        (lambda c: c.update(mass=c["mass"] * np.nan), "mass holds numbers that are not finite"),
        (lambda c: c.update(mass=c["mass"] * 1j), "mass must be a matrix of real numbers"),
        (lambda c: c.update(table_x=c["table_x"][:-1]), "table_direction has 366 .*table_x 365"),
        (lambda c: c.update(table_x=0 * c["table_x"]), "the table names .*more than once"),
        (lambda c: c.update(table_z=[1.0, 2.0]), "table_z is .*must be 366 x 1"),
        (lambda c: c.update(unit_weight=np.eye(3)), "unit_weight is 3 x 3"),
        (lambda c: c["table_direction"].put(0, np.array(["left"])), "table_direction has 'left'"),
        (with_short_table, "360 entries and the matrices 366 coordinates"),
        (lambda c: c.update(rows=np.eye(4)), "rows is 4 x 4, must be 366 x 366"),
    ],
)
def test_a_fault_of_the_file_is_named(
    folder: Path, change: Callable[[Content], object], words: str
) -> None:
    with pytest.raises(PanelError, match=words) as caught:
        load_panel(changed(folder, change))
    assert "rail.A.matrices" in str(caught.value)


def test_all_faults_are_reported_at_once(folder: Path) -> None:
    def both(content: Content) -> None:
        lopsided(content)
        del content["table_x"]

    with pytest.raises(PanelError) as caught:
        load_panel(changed(folder, both))
    assert len(caught.value.problems) == 2


def test_things_need_nodes_and_what_they_move_with(folder: Path) -> None:
    chairs = """
[chair]
x = ["0.3 m", "0.61 m", "0.62 m"]
normal_stiffness = "1e7 N/m"
friction_coefficient = 0.4
stick_stiffness = "5e6 N/m"
[fastening.1]
x = "3 m"
stiffness_yaw = "1e5 N m/rad"
"""

    def without(content: Content) -> None:
        keep = [
            not (x == 3.0 and cell[0].item() == "rz")
            for x, cell in zip(content["table_x"].ravel(), content["table_direction"], strict=True)
        ]
        content["rows"] = sp.eye_array(len(keep), format="csc")[np.array(keep)]
        for name in ("table_x", "table_z", "table_direction"):
            content[name] = content[name][keep]

    changed(folder, without)
    with pytest.raises(PanelError) as caught:
        load_panel(named(folder, "changed.mat", chairs))
    text = str(caught.value)
    assert "no node where there is chair 2: the nearest to x = 0.61 m is 0.6 m" in text
    assert "chair 3" in text
    assert "no rz at x = 3 m, which fastening 1 needs" in text
    assert "chair 1" not in text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"nonsense", "no MATLAB file of version 5"),
        (b"MATLAB 7.3 MAT-file" + 105 * b" " + b"\x00\x02IM" + 400 * b"\x00", "version 7.3"),
    ],
)
def test_a_file_that_is_none_is_named(folder: Path, content: bytes | None, words: str) -> None:
    if content is not None:
        (folder / "other.mat").write_bytes(content)
    with pytest.raises(PanelError, match=words):
        load_panel(named(folder, "other.mat"))


def test_an_object_needs_a_node(folder: Path) -> None:
    from turnout.panel.foreign_object import PlacedObject

    panel = load_panel(folder / "panel.toml")
    item = PlacedObject(
        name="stone",
        size=0.01,
        x=1.234,
        rail="A",
        height=0.0,
        stiffness=4e7,
        appears=0.0,
        disappears=np.inf,
    )
    gap = panel.with_overrides({"rail.A.stock_rail_gap": 0.1, "rail.A.independent_shape": True})
    with pytest.raises(MechanicsError, match=r"no node at x = 1.234 m, the nearest is at 1.2 m"):
        build_mechanism(gap, [item])


def test_command_writes_a_folder(tmp_path: Path) -> None:
    out = tmp_path / "matrices"
    result = CliRunner().invoke(app, ["panel", "export", "sb1", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == [
        "rail_switch.mat",
        "rail_switch_superelement.mat",
    ]


def test_command_refuses_a_folder_that_cannot_be(tmp_path: Path) -> None:
    for out, words in (("none/deep", "create it first"), ("file", "is a file; name a folder")):
        (tmp_path / "file").touch()
        result = CliRunner().invoke(app, ["panel", "export", "sb1", "--out", str(tmp_path / out)])
        assert words in str(result.exception)
