"""The studio's answers: the numbers of `turnout simulate`, the messages of the commands."""

import io
import json
from collections.abc import Iterator

import numpy as np
import pytest
import xarray as xr
from tests.unit.served import Client, served
from tests.unit.simulated import OBJECT, sb2_dataset, sb2_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.scheme import Scheme
from turnout.metric.key_figure import key_figures
from turnout.panel.load import library_text, load_panel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate
from turnout.web.controls import controls

OBJECT_ASKED = {"size": "13 mm", "at": "sleeper 6"}


@pytest.fixture(scope="module")
def studio() -> Iterator[Client]:
    with served(sb2_panel()) as client:
        client.enter()
        yield client


def asked(client: Client, **changes: object) -> dict[str, object]:
    mark = client.ask("/api/start").json["panel"]["mark"]
    return {"panel": mark, "object": OBJECT_ASKED, "settings": {}} | changes


def test_numbers_are_those_of_a_simulation(studio: Client) -> None:
    answer = studio.post("/api/run", asked(studio)).json
    expected = {item.key: item.value for item in key_figures(sb2_dataset())}
    found = {item["key"]: item["value"] for item in answer["figures"]}
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=1e-9, abs=0), key
    assert answer["complete"]
    assert OBJECT.at in str(answer["summary"])


def test_changes_reach_the_panel(studio: Client) -> None:
    slippery = {"chair.friction_coefficient": 0.1, "drive.2.stiffness": "300 kN/m"}
    answer = studio.post("/api/run", asked(studio, settings=slippery, object=None)).json
    text = str(answer["summary"])
    assert "chair.friction_coefficient = 0.1" in text
    assert "drive.2.stiffness = 300 kN/m" in text
    assert answer["objects"] == []


def test_a_preview_is_near_the_throw_and_says_how(studio: Client) -> None:
    fine = studio.post("/api/run", asked(studio)).json
    coarse = studio.post("/api/run", asked(studio, preview=True)).json
    assert "step 4 ms" in coarse["scheme"]
    assert len(coarse["motion"]["time"]) < len(fine["motion"]["time"])
    assert "step 1 ms" in fine["scheme"]
    for one, other in zip(coarse["figures"], fine["figures"], strict=True):
        if one["key"].startswith(("end_", "sensor_")):
            assert one["value"] == pytest.approx(other["value"], rel=0.02, abs=2e-5), one["key"]


def test_numbers_of_a_preview_are_those_of_a_quick_simulation(studio: Client) -> None:
    answer = studio.post("/api/run", asked(studio, preview=True)).json
    dataset = simulate(
        sb2_panel(),
        foreign_object=OBJECT,
        scheme=Scheme.of("quick"),
        save=Save(interval=0.02),
    )
    expected = {item.key: item.value for item in key_figures(dataset)}
    found = {item["key"]: item["value"] for item in answer["figures"]}
    assert found == pytest.approx(expected, rel=1e-9, abs=0)


def test_files_hold_the_same_run(studio: Client) -> None:
    body = {"run": asked(studio)}
    dataset = xr.load_dataset(io.BytesIO(studio.post("/api/file/nc", body).body), engine="h5netcdf")
    np.testing.assert_allclose(
        dataset["drive_force"].values, sb2_dataset()["drive_force"].values, rtol=0, atol=1e-9
    )
    lines = studio.post("/api/file/csv", body).text.splitlines()
    assert lines[0].startswith("time [s],drive_force:1 [kN],drive_force:2 [kN]")
    assert len(lines) == dataset.sizes["time"] + 1
    assert studio.post("/api/file/png", body).body.startswith(b"\x89PNG")
    behind = body | {"behind": asked(studio, object=None)}
    assert len(studio.post("/api/file/svg", behind).body) > len(
        studio.post("/api/file/svg", body).body
    )


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"object": {"size": "13", "at": "sleeper 6"}}, "has no unit"),
        ({"object": {"size": "13 mm", "at": "sleeper 60"}}, "there is no sleeper '60'"),
        ({"object": {"size": "300 mm", "at": "sleeper 6"}}, "larger than the opening"),
        ({"settings": {"drive.2.stifness": "1 kN/m"}}, "nearest is 'drive.2.stiffness'"),
        ({"settings": {"drive.2.stiffness": 81}}, "has no unit"),
        ({"panel": "unknown"}, "is no longer loaded"),
        ({"colour": "red"}, "unknown key"),
    ],
)
def test_what_cannot_be_thrown_is_reported(
    studio: Client, record: dict[str, object], words: str
) -> None:
    reply = studio.post("/api/run", asked(studio) | record)
    assert reply.status == 422
    assert words in reply.json["message"]


def test_an_object_without_room_is_reported_as_by_the_command(studio: Client) -> None:
    thick = {"size": "60 mm", "at": "drive 2"}
    late = asked(studio, object=thick, settings={"object_defaults.appears": "8 s"})
    reply = studio.post("/api/run", late)
    assert reply.status == 422
    assert "does not fit" in reply.json["message"]


def test_a_sent_panel_is_opened_and_checked(studio: Client) -> None:
    text = library_text("sb1").replace('name = "sb1"', 'name = "mine"')
    panel = studio.ask("/api/panel/send?name=mine.toml", text.encode()).json
    assert panel["name"] == "mine"
    assert panel["source"] == "mine.toml"
    assert studio.post("/api/panel/again", {"panel": panel["mark"]}).json == panel
    lines = studio.post("/api/panel/concerns", {"panel": panel["mark"]}).json["lines"]
    shown = CliRunner().invoke(app, ["panel", "check", "sb1"]).stdout
    assert lines == shown.splitlines()[1:]
    pieces = [line for line in lines if line.startswith("test piece: ")]
    assert len(pieces) == len(load_panel("sb1").drive)


def test_sliders_change_what_they_say() -> None:
    panel = load_panel("uic60-760-1-15")
    for item in controls(panel):
        assert item["least"] <= item["value"] <= item["most"], item["key"]
        if item["key"].startswith("object."):
            continue
        for value in (item["least"], item["most"]):
            text = f"{value} {item['unit']}" if item["unit"] else value
            changed = panel.with_overrides({item["key"]: text}, si=False)
            assert changed.hash != panel.hash or value == item["value"], item["key"]


def test_nothing_is_remembered_without_end(studio: Client) -> None:
    base = library_text("sb1")
    for number in range(14):
        name = f"panel-{number}"
        studio.ask(f"/api/panel/send?name={name}.toml", base.replace('"sb1"', f'"{name}"').encode())
    gone = json.loads(studio.post("/api/run", {"panel": "nothing"}).body)
    assert "open it again" in gone["message"]
    first = studio.ask("/api/start")
    assert first.status == 200, "the first panel is always at hand"
