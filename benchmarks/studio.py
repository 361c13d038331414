"""Time the answers of the studio over HTTP and write a section of docs/evidence/performance.md.

    python -m benchmarks.studio

A server as `turnout studio` starts it, with the default panel, is asked as its page asks while a
slider moves: one question after the other, each for a throw that was not requested before.
"""

import argparse
import statistics
import time
from collections.abc import Iterator
from typing import Any

from tests.unit.served import Client, served

from benchmarks.machine import load, machine
from benchmarks.page import write_section
from turnout.panel.load import load_panel

PANEL = "uic60-760-1-15"
COUNT = 20
STEP = 0.05
READY = 4.0
"""Seconds in which the places beside the object are prepared; a hand rests that long too."""
AIM = 0.1
RESTS = "any, once it rests"


def asked(mark: str, **changes: Any) -> dict[str, Any]:
    """Return a question of a moving slider."""
    trapped = {"size": "13 mm", "at": "x = 3.6 m"} | changes.pop("object", {})
    return {"panel": mark, "object": trapped, "settings": {}, "preview": True} | changes


def sliders(mark: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the name of each moved control, and the questions."""
    numbers = range(1, COUNT + 1)
    yield "size", [asked(mark, object={"size": f"{13 + 0.5 * n} mm"}) for n in numbers]
    yield (
        "chair friction",
        [asked(mark, settings={"chair.friction_coefficient": 0.1 + 0.01 * n}) for n in numbers],
    )
    yield (
        "drive 1 stiffness",
        [asked(mark, settings={"drive.1.stiffness": f"{300 + 5 * n} kN/m"}) for n in numbers],
    )
    # From where the object rests, ten places of the slider each way.
    ways = [0.0, *(side * STEP * n for side in (1, -1) for n in range(1, COUNT // 2 + 1))]
    yield (
        "place, beside where it rested",
        [asked(mark, object={"at": f"x = {3.6 + way:.4f} m"}) for way in ways[1:]],
    )
    fresh = (time.time_ns() // 1_000_000 % 10_000) * 1e-6  # never the same places again
    yield (
        "place, far from where it rested",
        [asked(mark, object={"at": f"x = {0.8 + 0.1 * n + fresh:.6f} m"}) for n in numbers],
    )
    yield (
        RESTS,
        [asked(mark, object={"size": f"{13.2 + 0.5 * n} mm"}, preview=False) for n in numbers],
    )


def seconds(client: Client, questions: list[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Return the time of each answer by the clock, and of the processor, server and client."""
    waited, worked = [], []
    for question in questions:
        began, used = time.perf_counter(), time.process_time()
        reply = client.post("/api/run", question)
        waited.append(time.perf_counter() - began)
        worked.append(time.process_time() - used)
        assert reply.status == 200, reply.text
        assert "sheet" in reply.json
    return waited, worked


def measured() -> Iterator[tuple[str, list[float], list[float]]]:
    """Yield the name of each moved control with the seconds of its answers."""
    with served(load_panel(PANEL)) as client:
        client.enter()
        mark = client.ask("/api/start").json["panel"]["mark"]
        for what, questions in sliders(mark):
            seconds(client, [asked(mark), asked(mark, preview=False)])
            time.sleep(READY)
            yield what, *seconds(client, questions)


def section(rows: list[tuple[str, list[float], list[float]]], *, loads: tuple[float, float]) -> str:
    """Return the section."""
    lines = []
    for what, waited, worked in rows:
        ninth = sorted(waited)[len(waited) * 9 // 10 - 1]
        values = (statistics.median(waited), min(waited), ninth, statistics.median(worked))
        lines.append(f"| {what} | " + " | ".join(f"{1e3 * v:.0f}" for v in values) + " |")
    moving = [row for row in rows if row[0] != RESTS]
    waited = statistics.median(value for row in moving for value in row[1])
    worked = statistics.median(value for row in moving for value in row[2])
    return f"""Written by `python -m benchmarks.studio` on {machine()}, at a load of
{loads[0]:.1f} before and {loads[1]:.1f} at the end. The default panel, {COUNT} questions of each
kind over HTTP, from asking to the whole answer in hand: panel changed and checked, rails and
mechanism, throw, lamps, words, curves and motion, JSON. What the browser takes to draw comes on
top; `python -m benchmarks.studio_page` measures in one, from the slider to the painted number.
On a machine shared with others the time of the processor says more than that of the clock.

| what moves | median [ms] | least [ms] | nine in ten within [ms] | of the processor, median [ms] |
|---|---:|---:|---:|---:|
{chr(10).join(lines)}

Median of all that a moving slider asks: {1e3 * waited:.0f} ms by the clock, {1e3 * worked:.0f} ms
of the processor; the aim is {1e3 * AIM:.0f} ms.

While a slider moves the throw is a preview in quick mode, kept every 20 ms; once it rests it is the
throw of `turnout simulate`. Ten places of the slider each way are prepared while nothing is
asked, those farther away when they are requested: at a sleeper, a drive or another place of the
panel an object needs rails of its own, between them it does not.
"""


def main() -> None:
    """Measure and write."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    before = load()
    rows = list(measured())
    write_section("The studio", section(rows, loads=(before, load())))


if __name__ == "__main__":
    main()
