"""A map of objects from the page: the verdicts of quick simulations, with progress and a stop."""

import threading
import time
from collections.abc import Iterator

import pytest
from tests.unit.served import Client, Reply, served
from tests.unit.simulated import sb2_panel

from turnout.core.scheme import Scheme
from turnout.metric.verdict import verdict
from turnout.panel.foreign_object import ForeignObject
from turnout.throw.simulate import simulate


@pytest.fixture(scope="module")
def studio() -> Iterator[Client]:
    with served(sb2_panel()) as client:
        client.enter()
        yield client


def asked(client: Client, places: list[str], sizes: list[str]) -> dict[str, object]:
    mark = client.ask("/api/start").json["panel"]["mark"]
    run = {"panel": mark, "object": {"size": "13 mm", "at": "sleeper 6"}}
    return {"run": run, "places": places, "sizes": sizes}


def test_a_map_holds_the_verdicts_of_quick_simulations(studio: Client) -> None:
    places, sizes = ["sleeper 6", "drive 2"], ["1 mm", "13 mm", "105 mm"]
    found = studio.post("/api/map", asked(studio, places, sizes)).json
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
        replies.append(studio.post("/api/map?job=mine", asked(studio, places, sizes)))

    at_work = threading.Thread(target=post)
    at_work.start()
    share, until = None, time.monotonic() + 60
    while not share and time.monotonic() < until:
        time.sleep(0.05)
        share = studio.ask("/api/job/mine").json["share"]
    assert share is not None
    assert 0 < share < 1
    # Sliders have a process of their own meanwhile.
    throw = asked(studio, places, sizes)["run"]
    assert isinstance(throw, dict)
    assert studio.post("/api/run", throw | {"preview": True}).status == 200
    assert studio.post("/api/job/mine/stop", {}).status == 200
    at_work.join(timeout=60)
    assert replies[0].json == {"superseded": True}
    assert studio.ask("/api/job/mine").json == {"share": None}


@pytest.mark.parametrize(
    ("places", "sizes", "words"),
    [
        (["sleeper 6"] * 40, ["13 mm"] * 20, "at most 600"),
        (["sleeper 6"], [], "sizes"),
        (["sleeper 99"], ["13 mm"], "sleeper 99"),
        (["sleeper 6"], ["13 kg"], "13 kg"),
    ],
)
def test_a_map_that_cannot_be_made(
    studio: Client, places: list[str], sizes: list[str], words: str
) -> None:
    reply = studio.post("/api/map", asked(studio, places, sizes))
    assert reply.status == 422
    assert words in reply.json["message"]
