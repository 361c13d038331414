"""Foreign objects: forms, places, defaults, what a panel refuses."""

import math

import numpy as np
import pytest

from turnout.core.errors import PanelError
from turnout.detection.detector.training_sets import learned_kinds
from turnout.law.object_kind import (
    OBJECT_KINDS,
    Compression,
    ObjectKind,
    ObjectParameter,
    Trapped,
    hardening,
)
from turnout.panel.foreign_object import ForeignObject, parse_object, resolve_objects
from turnout.panel.load import load_panel
from turnout.panel.model import PANEL_KEYS
from turnout.throw.simulate import simulate
from turnout.web.controls import panel_controls

PANEL = load_panel("uic60-760-1-15")


@pytest.mark.parametrize(
    ("at", "x"),
    [
        ("sleeper 6", 3.6),
        ("sleeper6", 3.6),
        ("Sleeper 6", 3.6),
        ("sleeper-6", 3.6),
        ("sleeper_6", 3.6),
        ("drive 1", 0.3),
        ("drive2", 6.9),
        ("sensor TKK1", 3.6),
        ("sensor tkk2", 10.2),
        ("chair 5", 2.4),
        ("stud 1", 9.0),
        ("link 2", 6.9),
        ("x = 3.6 m", 3.6),
        ("x=3600mm", 3.6),
    ],
)
def test_places(at: str, x: float) -> None:
    placed = resolve_objects(PANEL, [ForeignObject(0.001, at)])
    assert placed[0].x == pytest.approx(x, abs=1e-12)


def test_defaults_come_from_the_panel() -> None:
    (placed,) = resolve_objects(PANEL, [ForeignObject("13 mm", "sleeper 6")])
    assert placed.rail == "straight"
    assert placed.height == 0.1
    assert placed.stiffness == 4e7
    assert placed.appears == 4.4
    assert math.isinf(placed.disappears)
    (placed,) = resolve_objects(load_panel("sb1"), [ForeignObject(0.013, "sensor TKK1")])
    assert (placed.appears, placed.disappears) == (1.0, 4.0)


def test_own_values_win_and_texts_carry_units() -> None:
    item = ForeignObject(
        size=np.float64(0.013),
        at="drive 1",
        rail="curved",
        height="80 mm",
        stiffness="10 kN/mm",
        appears="0.1 s",
        disappears=5,
    )
    (placed,) = resolve_objects(PANEL, [item])
    assert (placed.rail, placed.height, placed.stiffness) == ("curved", 0.08, 1e7)
    assert (placed.appears, placed.disappears) == (0.1, 5.0)


def test_an_object_on_the_other_rail_appears_when_that_rail_starts_to_close() -> None:
    (placed,) = resolve_objects(PANEL, [ForeignObject(0.013, "sleeper 6", rail="curved")])
    assert placed.appears == 0.2


def test_none_one_and_several_also_from_the_panel_file() -> None:
    assert resolve_objects(PANEL) == ()
    panel = PANEL.with_overrides({"object.stone": {"size": "10 mm", "at": "drive 1"}})
    two = [ForeignObject(0.013, "sleeper 6"), ForeignObject(0.005, "x = 1 m")]
    placed = resolve_objects(panel, two)
    assert [item.name for item in placed] == ["stone", "1", "2"]
    assert [item.size for item in placed] == [0.010, 0.013, 0.005]


@pytest.mark.parametrize(
    ("text", "size", "at"),
    [
        ("13mm@sleeper6", 0.013, "sleeper6"),
        (" 13 mm @ x = 3.6 m ", 0.013, "x = 3.6 m"),
        ("1 inch@drive 1", 0.0254, "drive 1"),
    ],
)
def test_text_of_a_command_line(text: str, size: float, at: str) -> None:
    item = parse_object(text)
    assert (item.size, item.at) == (size, at)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("13mm", "is not SIZE@PLACE"),
        ("@sleeper6", "is not SIZE@PLACE"),
        ("13mm@ ", "is not SIZE@PLACE"),
        ("13@sleeper6", r'size = "13": has no unit, 13 would be 13 m'),
        ("13kN@sleeper6", "unit of force"),
        ("0 mm@sleeper6", "must be more than 0"),
        ("-3 mm@sleeper6", "must be more than 0"),
        ("nan mm@sleeper6", "finite"),
    ],
)
def test_wrong_text_of_a_command_line(text: str, message: str) -> None:
    with pytest.raises(PanelError, match=message):
        parse_object(text)


def test_wrong_values_are_all_reported() -> None:
    with pytest.raises(PanelError) as caught:
        ForeignObject(
            -0.01, 3.6, rail=2, height="1 kN", stiffness=math.inf, appears=-1.0, face_slope=1.2
        )  # type: ignore[arg-type]
    keys = [problem.split(" ")[0] for problem in caught.value.problems]
    assert keys == ["size", "at", "rail", "height", "stiffness", "face_slope", "appears"]


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (
            ForeignObject(0.01, "sleeper 12"),
            r"no sleeper '12'; nearest is '11'; there are '1', '2'",
        ),
        (ForeignObject(0.01, "sleper 6"), r"is not a place; .*nearest is 'sleeper 6'"),
        (ForeignObject(0.01, "sensor TKK"), r"no sensor 'TKK'; nearest is 'TKK"),
        (ForeignObject(0.01, "sleeper"), "is not a place"),
        (ForeignObject(0.01, "x = 3.6"), r"has no unit, 3.6 would be 3.6 m"),
        (ForeignObject(0.01, "x = 30 m"), r"x = 30 m is not on rail 'straight', 0 \.\.\. 18.6 m"),
        (ForeignObject(0.01, "x = -1 m"), r"is not on rail"),
        (ForeignObject(0.01, "drive 1", rail="strait"), "no such rail; .*nearest is 'straight'"),
        (ForeignObject(0.2, "sleeper 6"), r"size = 200 mm: larger than the opening"),
        (ForeignObject(0.11, "drive 2"), r"at most about 87 mm open at x = 6.9 m"),
        (ForeignObject(0.03, "x = 17 m"), r"larger than the opening"),
        (ForeignObject(0.01, "drive 1", appears=9.0), "after the end of the schedule, 8.5 s"),
        (ForeignObject(0.01, "drive 1", disappears=3.0), "must be after the object appears, 4.4 s"),
    ],
)
def test_what_a_panel_refuses(item: ForeignObject, message: str) -> None:
    with pytest.raises(PanelError, match=message):
        resolve_objects(PANEL, [item])


def test_all_objects_are_checked_at_once() -> None:
    items = [ForeignObject(0.2, "sleeper 6"), ForeignObject(0.01, "sleeper 99", rail="none")]
    with pytest.raises(PanelError) as caught:
        resolve_objects(PANEL, items)
    assert len(caught.value.problems) == 3
    assert caught.value.problems[0].startswith("object 1: size")


def test_the_sizes_of_the_field_campaign_fit_everywhere_between_the_drives() -> None:
    places = ["drive 1", "drive 2", *(f"sleeper {number}" for number in range(1, 12))]
    items = [ForeignObject(0.031, place) for place in places]
    assert len(resolve_objects(PANEL, items)) == 13


@pytest.mark.parametrize("text", ["TKK1", "tkk1", "sensor TKK1"])
def test_a_sensor_is_a_place_by_its_name_alone(text: str) -> None:
    panel = load_panel("uic60-760-1-15")
    (placed,) = resolve_objects(panel, [parse_object(f"13mm@{text}")])
    assert placed.x == panel.sensor["TKK1"].x


def test_a_name_of_several_places_wants_its_family() -> None:
    panel = load_panel("uic60-760-1-15")
    with pytest.raises(PanelError, match=r"not the name of one place only; write 'sleeper 2' or"):
        resolve_objects(panel, [parse_object("13mm@2")])


class Rubber(ObjectKind):
    """A toy kind: it yields at its strength, then stiffens; half of a dent comes back."""

    parameters = {"strength": ObjectParameter(2e6, 1e5, 1e7, "assumption: a toy")}  # noqa: RUF012
    learned = True

    def curve(self, item: Trapped) -> Compression:
        """Return force over compression."""
        size = item.size - item.lost
        force = item.strength * size**2 * np.array([1.0, 50.0])
        return hardening(np.array([0.0, 0.9 * size]), force, item.stiffness)

    def left(
        self,
        item: Trapped,
        *,
        lost: float,
        deepest: float,
        dent: float,
        changes: bool,
        broke: bool,
    ) -> dict[str, float]:
        """Return what a throw changed in it."""
        return {"lost": lost, "deepest": 0.5 * deepest}


def test_a_kind_of_object_is_one_class(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading, checks, laws, memory, words and lists follow from its row alone."""
    text = "13 mm rubber @ sleeper 6, strength = 3 MPa"
    with pytest.raises(PanelError, match='kind = "rubber": must be .spring., .stone.'):
        parse_object(text)
    monkeypatch.setitem(OBJECT_KINDS, "rubber", Rubber())
    with pytest.raises(PanelError, match=r"strength = 20 MPa: must be 0.1 to 10 MPa"):
        parse_object("13 mm rubber @ sleeper 6, strength = 20 MPa")
    with pytest.raises(PanelError, match="an object of kind 'rubber' has none, it has 'strength'"):
        parse_object("13 mm rubber @ sleeper 6, density = 400 kg/m^3")
    (placed,) = resolve_objects(PANEL, [parse_object(text)])
    assert (placed.kind, placed.strength, placed.length) == ("rubber", 3e6, 0.0)
    dataset = simulate(PANEL, foreign_object=parse_object(text), mode="quick")
    assert '"kind": "rubber"' in dataset.attrs["foreign_objects"]
    assert 0.0 < float(dataset["object_left"][0]) < 0.013
    own = PANEL.with_overrides({"object.o": {"size": 0.013, "at": "sleeper 6", "kind": "rubber"}})
    assert own.object["o"].kind == "rubber"
    key = PANEL_KEYS.find("object.kind")
    assert key is not None
    assert '"rubber"' in key.allowed
    assert learned_kinds()[-1] == "rubber"
    assert panel_controls(PANEL, "a")["kinds"][-1] == "rubber"
