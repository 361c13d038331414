"""The studio's answers: the numbers of `turnout simulate`, the messages of the commands."""

import io
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.faults.test_studio_faults import resident
from tests.unit.served import Client, Reply, served
from tests.unit.simulated import OBJECT, sb2_dataset, sb2_panel
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.scheme import Scheme
from turnout.metric.key_figure import key_figures
from turnout.metric.least_gauge import wheel_findings
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import library_text, load_panel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate
from turnout.throw.verdict import verdict
from turnout.throw.wheel import gauge_under_wheel
from turnout.web.controls import controls
from turnout.web.tasks import MOST_RUNS

OBJECT_ASKED = {"size": "13 mm", "at": "sleeper 6"}
RATE = 20.0
"""Questions per second of a slider that moves."""
REST = 0.3
"""Seconds that it is still before the throw is asked for that is shown in the end."""
TOLERANCE = 3.0
"""Seconds in which places beside the object are prepared."""


@pytest.fixture(scope="module")
def studio() -> Iterator[Client]:
    with served(sb2_panel()) as client:
        client.enter()
        yield client


def asked(client: Client, **changes: object) -> dict[str, object]:
    mark = client.ask("/api/start").json["panel"]["mark"]
    return {"panel": mark, "object": OBJECT_ASKED, "settings": {}} | changes


@pytest.mark.parametrize("preview", [False, True], ids=["throw", "preview"])
def test_numbers_are_those_of_a_simulation(studio: Client, preview: bool) -> None:
    """Those of a preview are of a quick one."""
    answer = studio.post("/api/run", asked(studio, preview=preview)).json
    dataset = (
        simulate(
            sb2_panel(),
            foreign_object=OBJECT,
            scheme=Scheme.of("quick"),
            save=Save(interval=0.02),
        )
        if preview
        else sb2_dataset()
    )
    expected = {item.key: item.value for item in key_figures(dataset)}
    found = {item["key"]: item["value"] for item in answer["figures"]}
    assert found == pytest.approx(expected, rel=1e-9, abs=0)
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


def test_files_hold_the_same_run(studio: Client) -> None:
    body = {"run": asked(studio)}
    dataset = xr.load_dataset(io.BytesIO(studio.post("/api/file/nc", body).body), engine="h5netcdf")
    np.testing.assert_allclose(
        dataset["drive_force"].values, sb2_dataset()["drive_force"].values, rtol=0, atol=1e-9
    )
    lines = studio.post("/api/file/csv", body).text.splitlines()
    assert lines[0].startswith("time [s],drive_force:1 [kN],drive_force:2 [kN]")
    assert len(lines) == dataset.sizes["time"] + 1
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
        (
            {
                "object": {"size": "60 mm", "at": "drive 2"},
                "settings": {"object_defaults.appears": "8 s"},
            },
            "does not fit",
        ),
        ({"settings": {"drive.2.stifness": "1 kN/m"}}, "nearest is 'drive.2.stiffness'"),
        ({"settings": {"drive.2.stiffness": 81}}, "has no unit"),
        ({"panel": "unknown"}, "is no longer loaded"),
        ({"colour": "red"}, "unknown key"),
        ({"places": ["sleeper 6"] * 40, "sizes": ["13 mm"] * 20}, "at most 600"),
        ({"places": ["sleeper 6"], "sizes": []}, "sizes"),
        ({"places": ["sleeper 99"], "sizes": ["13 mm"]}, "sleeper 99"),
        ({"places": ["sleeper 6"], "sizes": ["13 kg"]}, "13 kg"),
    ],
)
def test_a_throw_or_a_map_that_cannot_be_made_is_reported(
    studio: Client, record: dict[str, object], words: str
) -> None:
    if "places" in record:
        reply = studio.post("/api/map", {"run": asked(studio)} | record)
    else:
        reply = studio.post("/api/run", asked(studio) | record)
    assert reply.status == 422
    assert words in reply.json["message"]


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


def test_a_wheel_rolls_over_the_closed_rail_as_by_the_command(studio: Client) -> None:
    mark = studio.post("/api/panel/open", {"name": "60e1-300-1-9"}).json["mark"]
    run = {"panel": mark, "object": OBJECT_ASKED, "settings": {"gauge.line_speed": "120 km/h"}}
    load = {"lateral": "20 kN", "vertical": "50 kN", "course": "trailing"}
    found = studio.post("/api/wheel", {"run": run} | load).json
    dataset = gauge_under_wheel(
        load_panel("60e1-300-1-9"),
        lateral=20e3,
        vertical=50e3,
        foreign_object=OBJECT,
        course="trailing",
    )
    head, *three, speed = found["findings"]
    assert head["answer"] == "Gauge too narrow"
    assert head["detail"].endswith("(limit 1426 mm)")
    expected = wheel_findings(dataset)[1:4]
    assert [one["answer"] for one in three] == [one.answer for one in expected]
    assert speed["answer"] == "none"
    lines = [line["label"] for row in found["sheet"]["rows"] for line in row["lines"]]
    assert lines == ["at rest", "Y 20 kN, Q 50 kN", "Y 20 kN, Q 50 kN"]
    for change, words in (
        ({"lateral": "-1 kN"}, "must be at least 0"),
        ({"vertical": "5 kg"}, "vertical = '5 kg'"),
        ({"course": "sideways"}, "facing, trailing"),
        ({"run": asked(studio)}, "has no [gauge]"),
    ):
        refused = studio.post("/api/wheel", {"run": run} | load | change)
        assert refused.status == 422
        assert words in refused.json["message"]


def map_asked(client: Client, places: list[str], sizes: list[str]) -> dict[str, Any]:
    return {"run": asked(client), "places": places, "sizes": sizes}


def test_a_map_holds_the_verdicts_of_quick_simulations(studio: Client) -> None:
    places, sizes = ["sleeper 6", "drive 2"], ["1 mm", "13 mm", "105 mm"]
    found = studio.post("/api/map", map_asked(studio, places, sizes)).json
    assert found["kinds"][0] == ["not touched", "not touched"]
    assert found["kinds"][2][1] == "does not fit"
    for column, place in enumerate(places):
        trapped = ForeignObject(0.013, place)
        run = simulate(sb2_panel(), foreign_object=trapped, scheme=Scheme.of("quick"))
        assert found["kinds"][1][column] == verdict(run).kind
    assert found["kinds"][1][0] == "undetected object"
    assert "13 mm at sleeper 6" in found["texts"][1][0]


def test_a_map_says_how_much_is_done_and_can_be_stopped(studio: Client) -> None:
    # Nearly as many throws as are allowed: they must outlast the start of the second process.
    sizes = [f"{size} mm" for size in range(5, 25)]
    places = [f"x = {number / 5} m" for number in range(4, 32)]
    replies: list[Reply] = []

    def post() -> None:
        replies.append(studio.post("/api/map?job=mine", map_asked(studio, places, sizes)))

    at_work = threading.Thread(target=post)
    at_work.start()
    share, until = None, time.monotonic() + 60
    while not share and time.monotonic() < until:
        time.sleep(0.05)
        share = studio.ask("/api/job/mine").json["share"]
    assert share is not None
    assert 0 < share < 1
    # Sliders have a process of their own meanwhile.
    assert studio.post("/api/run", asked(studio, preview=True)).status == 200
    assert studio.post("/api/job/mine/stop", {}).status == 200
    at_work.join(timeout=60)
    assert replies[0].json == {"superseded": True}
    assert studio.ask("/api/job/mine").json == {"share": None}


def burst(client: Client, *, seconds: float) -> tuple[list[bool | None], Reply, list[float]]:
    """Ask 20 times a second; return which were answered, the last reply, and waits of other pages.

    Other replies are not kept: they would be most of the memory that is measured.
    """
    mark = client.ask("/api/start").json["panel"]["mark"]
    count = round(RATE * seconds)
    answered: list[bool | None] = [None] * count
    final: list[Reply] = []
    waits: list[float] = []

    def ask(number: int) -> None:
        last = number == count - 1
        # No other question asks for this throw.
        piece = {"size": f"{8 + 0.001 * number:.3f} mm", "at": "sleeper 6"}
        question = {"panel": mark, "object": piece, "settings": {}, "preview": not last}
        reply = client.post("/api/run", question)
        assert reply.status == 200
        answered[number] = "superseded" not in reply.json
        if last:
            final.append(reply)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(count)]
    began = time.monotonic()
    for number, thread in enumerate(threads):
        rest = REST if number == count - 1 else 0.0
        time.sleep(rest + max(0.0, began + number / RATE - time.monotonic()))
        thread.start()
        if number % 10 == 5:
            asked = time.monotonic()
            assert client.ask("/page/main.js").status == 200
            waits.append(time.monotonic() - asked)
    for thread in threads:
        thread.join()
    return answered, final[0], waits


def test_the_last_of_many_questions_is_answered(studio: Client) -> None:
    """As of a slider that moves without rest."""
    last = answered_last(burst(studio, seconds=2.0))
    assert "step 1 ms" in last["scheme"]


def answered_last(found: tuple[list[bool | None], Reply, list[float]]) -> dict[str, Any]:
    """Return the last answer of a burst in which all is as it should be."""
    answered, final, waits = found
    assert None not in answered, "every question gets a reply"
    assert answered[-1], "the last question must be answered"
    assert sum(map(bool, answered)) >= 2, "a moving slider must see answers on its way"
    assert max(waits) < 5.0, "other pages wait for no throw"
    last: dict[str, Any] = final.json
    size = 1e-3 * (8 + 0.001 * (len(answered) - 1))
    assert last["objects"][0]["size"] == pytest.approx(size, rel=1e-9)
    return last


@pytest.mark.long
def test_a_slider_that_moves_for_long_takes_no_memory() -> None:
    with served(sb2_panel()) as client:
        client.enter()
        burst(client, seconds=2.0)
        time.sleep(TOLERANCE)
        before = resident()
        answered_last(burst(client, seconds=30.0))
        time.sleep(TOLERANCE)  # a throw at work takes memory that it gives back
        grown = resident() - before
        assert client.ask("/api/start").status == 200
    kept = MOST_RUNS * sb2_dataset().nbytes / 1e6  # whole throws, whatever the number of questions
    assert grown < 60.0 + kept, f"memory grew by {grown:.0f} MB"


def test_nothing_is_remembered_without_end(studio: Client) -> None:
    base = library_text("sb1")
    for number in range(14):
        name = f"panel-{number}"
        studio.ask(f"/api/panel/send?name={name}.toml", base.replace('"sb1"', f'"{name}"').encode())
    assert "open it again" in studio.post("/api/run", {"panel": "nothing"}).json["message"]
    first = studio.ask("/api/start")
    assert first.status == 200, "the first panel is always at hand"
