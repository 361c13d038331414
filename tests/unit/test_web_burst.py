"""A slider that moves without rest: 20 questions a second, of which the last is answered."""

import threading
import time

import pytest
from tests.faults.test_studio_faults import resident
from tests.unit.served import Client, Reply, served
from tests.unit.simulated import sb2_dataset, sb2_panel

from turnout.web.tasks import MOST_RUNS

RATE = 20.0
TOLERANCE = 3.0
"""Seconds in which places beside the object are prepared."""


def question(mark: str, number: int, *, preview: bool) -> dict[str, object]:
    """Return a throw that no other question asks for."""
    size = f"{8 + 0.001 * number:.3f} mm"
    return {
        "panel": mark,
        "object": {"size": size, "at": "sleeper 6"},
        "settings": {},
        "preview": preview,
    }


def burst(
    client: Client, mark: str, *, seconds: float
) -> tuple[list[bool | None], Reply, list[float]]:
    """Ask so long; return which were answered, the last reply, and how long other pages took.

    Other replies are not kept: they would be most of the memory that is measured.
    """
    count = round(RATE * seconds)
    answered: list[bool | None] = [None] * count
    final: list[Reply] = []
    waits: list[float] = []

    def ask(number: int) -> None:
        last = number == count - 1
        reply = client.post("/api/run", question(mark, number, preview=not last))
        assert reply.status == 200
        answered[number] = "superseded" not in reply.json
        if last:
            final.append(reply)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(count)]
    began = time.monotonic()
    for number, thread in enumerate(threads):
        time.sleep(max(0.0, began + number / RATE - time.monotonic()))
        thread.start()
        if number % 10 == 5:
            asked = time.monotonic()
            assert client.ask("/page/main.js").status == 200
            waits.append(time.monotonic() - asked)
    for thread in threads:
        thread.join()
    return answered, final[0], waits


@pytest.mark.parametrize("seconds", [3.0, pytest.param(30.0, marks=pytest.mark.long)])
def test_the_last_of_many_questions_is_answered(seconds: float) -> None:
    with served(sb2_panel()) as client:
        client.enter()
        mark = client.ask("/api/start").json["panel"]["mark"]
        burst(client, mark, seconds=2.0)
        time.sleep(TOLERANCE)
        before = resident()
        answered, final, waits = burst(client, mark, seconds=seconds)
        time.sleep(TOLERANCE)  # a throw at work takes memory that it gives back
        grown = resident() - before
        late = client.ask("/api/start")
    assert None not in answered, "every question gets a reply"
    assert answered[-1], "the last question must be answered"
    assert sum(map(bool, answered)) >= 2, "a moving slider must see answers on its way"
    last = final.json
    assert last["objects"][0]["size"] == pytest.approx(
        1e-3 * (8 + 0.001 * (len(answered) - 1)), rel=1e-9
    )
    assert "step 1 ms" in last["scheme"]
    assert max(waits) < 5.0, "other pages wait for no throw"
    assert late.status == 200
    kept = MOST_RUNS * sb2_dataset().nbytes / 1e6  # whole throws, whatever the number of questions
    assert grown < 60.0 + kept, f"memory grew by {grown:.0f} MB"
