"""Library panels: their numbers against the benchmarks, and where each number comes from."""

import pickle
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from turnout.core.errors import FileError
from turnout.core.provenance import content_hash
from turnout.core.toml import ORIGIN_KINDS
from turnout.metric.panel_check import concerns, panel_concerns
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_names, library_text, load_panel
from turnout.panel.model import FAMILIES
from turnout.panel.profile import evaluate_profile, running_edge_offset
from turnout.throw.simulate import simulate

SHORT = (
    *("60e1-1200-1-18.5", "60e1-300-1-9", "60e1-300-1-9-clamp-lock", "60e1-441-1-12"),
    "60e1-500-1-12",
)
DEFAULT = "uic60-760-1-15"
NAMES = (*SHORT, "sb1", "sb2", DEFAULT, f"{DEFAULT}-jea73", f"{DEFAULT}-symmetric")
DIFFERENT = ("60e1-300-1-9-clamp-lock", "sb1", "uic60-760-1-15")


def test_library_lists_its_panels() -> None:
    assert library_names() == NAMES


TABLED = ({"unit", "values"}, {"start", "step", "count"})


def numbers(value: object, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the key path of every number of the file, with or without a unit."""
    if isinstance(value, dict) and set(value) not in TABLED:
        for key, item in value.items():
            yield from numbers(item, (*path, key))
    elif isinstance(value, list):
        for item in value:
            yield from numbers(item, path)
    elif _is_number(value):
        yield path


def _is_number(value: object) -> bool:
    if isinstance(value, str):
        return re.match(r"-?\d[\d.e-]* ?[A-Za-z]", value) is not None
    return isinstance(value, dict | int | float) and not isinstance(value, bool)


@pytest.mark.parametrize("name", NAMES)
def test_every_number_says_where_it_comes_from(name: str) -> None:
    panel = load_panel(name)
    tree = tomllib.loads(library_text(name))
    found = 0
    for path in numbers(tree):
        if path in (("schema_version",), ("name",)):
            continue
        expanded = [path]
        if path[0] in FAMILIES and path[1] in FAMILIES[path[0]].model_fields:
            expanded = [(path[0], member, *path[1:]) for member in getattr(panel, path[0])]
        for place in expanded:
            key = ".".join(place)
            assert key in panel.origins, f"{name}: {key} has no origin"
            found += 1
    assert found > 60
    assert {origin.kind for origin in panel.origins.values()} <= set(ORIGIN_KINDS)
    for family in FAMILIES:
        for member, record in getattr(panel, family).items():
            for field in record.model_fields_set:
                value = getattr(record, field)
                if isinstance(value, float | tuple):
                    assert f"{family}.{member}.{field}" in panel.origins


def test_sb1_is_the_benchmark() -> None:
    panel = load_panel("sb1")
    chairs = [chair.x for chair in panel.chair.values()]
    np.testing.assert_allclose(chairs, 0.3 + 0.6 * np.arange(16), rtol=0, atol=1e-12)
    fastenings = [item.x for item in panel.fastening.values()]
    np.testing.assert_allclose(fastenings, 9.7 + 0.6 * np.arange(8), rtol=0, atol=1e-12)
    assert [item.x for item in panel.stop.values()] == chairs
    assert panel.section["prismatic"].area == (9.3e-3,)
    assert panel.section["prismatic"].second_moment_lateral == (7.4e-6,)
    assert panel.object_defaults.stiffness == 4e7
    assert (panel.drive["1"].stroke, panel.drive["2"].stroke) == (0.120, 0.0602)
    x = np.linspace(0.0, 14.0, 141)
    gap = panel.rail["switch"].stock_rail_gap
    assert gap is not None
    parabola = 0.118 * (1.0 - x / 9.7) ** 2 + 0.001
    np.testing.assert_allclose(evaluate_profile(gap, x), parabola, rtol=0, atol=1e-15)


def test_sb2_is_the_benchmark(reference_dir: Path) -> None:
    panel = load_panel("sb2")
    data = np.load(reference_dir / "sb2" / "none.npz")
    np.testing.assert_allclose([c.x for c in panel.chair.values()], data["chairs_x"], atol=1e-12)
    stops = [item.x for item in (*panel.stop.values(), *panel.stud.values())]
    np.testing.assert_allclose(stops, data["stops_x"], rtol=0, atol=1e-12)
    gap = panel.rail["B"].stock_rail_gap
    assert gap is not None
    np.testing.assert_allclose(
        evaluate_profile(gap, data["stops_x"]), data["open_shape"], rtol=0, atol=5.1e-8
    )
    edge = panel.rail["A"].running_edge
    assert edge is not None
    offset = running_edge_offset(edge, [0.0, 6.62, 18.6])
    np.testing.assert_allclose(offset, [0.0029, (6.62 + 2.1) ** 2 / 1521.4, 0.08], rtol=1e-12)
    assert panel.section["tongue"].product_moment is None
    assert panel.sleeper["6"].x == panel.sensor["TKK1"].x == 3.6
    assert panel.chair["1"].foot_offsets == (-0.06, 0.06)


def test_the_panel_with_machines_is_the_default_panel_with_machines_of_the_library() -> None:
    panel = load_panel(f"{DEFAULT}-jea73")
    machines = {"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"}
    plain = load_panel(DEFAULT, overrides={**machines, "movement.return.extra_time": {}})
    fields = [name for name in LoadedPanel.model_fields if name not in ("name", "description")]
    assert [name for name in fields if getattr(panel, name) != getattr(plain, name)] == []
    weak = load_panel(f"{DEFAULT}-jea73", overrides={"machine.supply.voltage": 176.0})
    assert {item.supply.voltage for item in weak.machine.values()} == {176.0}


def test_default_panel_is_loaded_closed_and_its_shapes_are_computed() -> None:
    panel = load_panel("uic60-760-1-15")
    assert panel.instrumented_rail == "straight"
    assert panel.schedule.starts == "closed"
    assert panel.schedule.loaded
    assert [rail.fraction for rail in panel.rail.values()] == [0.27, 0.73]
    assert all(rail.stock_rail_gap is None for rail in panel.rail.values())
    assert [d.over_travel_open for d in panel.drive.values()] == [0.002, 0.007]
    assert [d.over_travel_closed for d in panel.drive.values()] == [0.004, 0.0038]
    chair, feet = panel.chair["1"], 2
    assert feet * chair.stick_stiffness == 1e7
    assert feet * chair.normal_stiffness == 2e7
    assert 5e3 <= feet * chair.damping <= 10e3
    assert panel.origins["drive.1.stiffness"].kind == "paper"


@pytest.mark.parametrize("name", DIFFERENT)
def test_panels_survive_pickling_with_all_they_know(name: str) -> None:
    panel = load_panel(name, overrides={"chair.friction_coefficient": 0.3})
    copy = pickle.loads(pickle.dumps(panel))
    assert isinstance(copy, LoadedPanel)
    assert copy == panel
    assert (copy.hash, dict(copy.origins), dict(copy.overrides)) == (
        panel.hash,
        dict(panel.origins),
        dict(panel.overrides),
    )
    changed = copy.with_overrides({"drive.1.stiffness": 7.5e6})
    assert changed.drive["1"].stiffness == 7.5e6
    assert changed.chair["3"].friction_coefficient == 0.3


@pytest.mark.parametrize("name", DIFFERENT)
def test_the_hash_is_that_of_the_panel_written_as_a_whole(name: str) -> None:
    """With machines, cycles before the start, an edge that meets no other and data of the gauge."""
    own: dict[str, object] = {f"drive.{key}.machine": "jea73" for key in load_panel(name).drive}
    own |= {"schedule.loaded": True, "schedule.loaded_by": "cycles"}
    own |= {"gauge.nominal": 1.435, "gauge.height": 0.12, "rail.gauge_widening": 0.001}
    own |= {"gauge.line_speed": 30.0}
    own |= {"rail.running_edge.tangent_offset": 0.001} if name != "sb1" else {}
    panel = load_panel(name).with_overrides(own)
    left_out = {"movement": {"__all__": {"table_file"}}, "rail": {"__all__": {"matrices"}}}
    values = panel.model_dump(mode="json", exclude={"description": True, **left_out})
    assert panel.hash == content_hash(values)


def test_hash_follows_the_values_only(tmp_path: Path) -> None:
    panel = load_panel("sb1")
    text = library_text("sb1")
    assert load_panel("sb1").hash == panel.hash
    same = text.replace('"120 mm"', '"0.12 m"').replace("One prismatic", "A prismatic")
    path = tmp_path / "same.toml"
    path.write_text(same)
    assert same != text
    assert load_panel(path).hash == panel.hash
    changed = panel.with_overrides({"drive.1.stroke": 0.1200001})
    assert changed.hash != panel.hash
    assert changed.with_overrides({"drive.1.stroke": "120 mm"}).hash == panel.hash


def test_paths_and_names_are_distinguished(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(library_text("sb1"))
    assert load_panel(path).name == load_panel(str(path)).name == "sb1"
    with pytest.raises(FileError, match="no library panel is called 'sb3'; nearest is 'sb2'"):
        load_panel("sb3")
    with pytest.raises(FileError, match=r"none\.toml: no such file"):
        load_panel("none.toml")
    with pytest.raises(FileError, match="no such file"):
        load_panel("./sb1")


def test_short_text_instead_of_all_records() -> None:
    panel = load_panel("sb2", overrides={"chair.friction_coefficient": 0.3})
    assert len(repr(panel)) < 120
    assert "0.3" in repr(panel)


@pytest.mark.parametrize("name", SHORT)
def test_the_shorter_panels_are_sound(name: str) -> None:
    """Margins, flangeway and chairs; flutter takes seconds and is in the long test below."""
    panel = load_panel(name)
    alone = simulate(panel, mode="quick")
    assert concerns(alone) == []
    assert bool(alone["locked"][-1])
    assert 0.058 < float(alone["least_flangeway"]) < 0.075
    for drive in panel.drive:
        rail = panel.drive[drive].rail
        thick = 1.3 * max(panel.gap_limits().values())
        piece = ForeignObject(thick, f"drive {drive}", rail=rail)
        if rail == panel.instrumented_rail:
            assert not simulate(panel, foreign_object=piece, mode="quick")["locked"][-1], drive


@pytest.mark.long
@pytest.mark.parametrize("name", SHORT)
def test_the_shorter_panels_have_no_warnings(name: str) -> None:
    panel = load_panel(name)
    assert panel_concerns(panel, simulate(panel)) == []
