"""No screen contradicts itself: state words, colours, values and limits of many throws.

Each scenario is thrown once and shown by the studio, by the report and by the command. What stands
there is compared with itself and with the channels at the same instant, read as text, without the
checks that wrote it.
"""

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
import xarray as xr
from click import unstyle

from turnout.cli.simulate import summary_lines
from turnout.figures.report.page import Page
from turnout.figures.report.run import run_page
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate
from turnout.web.throw import throw_reply

MACHINES = {"drive.1.machine": "jea73", "drive.2.machine": "jea73"}
UNFINISHED = {"drive.1.machine": "jea73", "movement.return.start": 8.46}
UNFINISHED |= {"movement.return.duration": 0.04, "movement.return.ramp": 0.01}
WEAK = {"machine.jea73.supply.voltage": 55.0}
DEFAULT = "uic60-760-1-15"
STONE = ForeignObject("15 mm", "drive 1", kind="stone", strength="10 MPa", piece=0.0)
Scenario = tuple[str, dict[str, object], ForeignObject | None]


def piece(size: str, at: str, **more: object) -> ForeignObject:
    return ForeignObject(size, at, **more)  # type: ignore[arg-type]


SCENARIOS: dict[str, Scenario] = {
    "slip before the end": ("sb1", {}, None),
    "machine on a test piece": (
        "60e1-300-1-9", {"drive.1.machine": "jea73"}, piece("6 mm", "drive 1"),
    ),
    "curved rail": (DEFAULT, {}, piece("18 mm", "sleeper 6", rail="curved")),
    "undetected": (DEFAULT, {}, piece("13 mm", "sleeper 6")),
    "alone": (DEFAULT, {}, None),
    "one drive": ("60e1-300-1-9", {}, None),
    "machines": (DEFAULT, MACHINES, None),
    "weak machines": (DEFAULT, MACHINES | WEAK, None),
    "weak machines, object": (DEFAULT, MACHINES | WEAK, piece("13 mm", "sleeper 6")),
    "machine alone": ("60e1-300-1-9", {"drive.1.machine": "jea73"}, None),
    "unfinished": ("60e1-300-1-9", UNFINISHED, None),
    "test piece": (DEFAULT, {}, piece("5 mm", "drive 2")),
    "open rail at drive": (DEFAULT, {}, piece("13 mm", "drive 1", rail="curved")),
    "broken": (DEFAULT, {}, STONE),
    "ice": (DEFAULT, {}, piece("20 mm", "sleeper 6", kind="ice", length="1 m")),
    "unbroken metal": (DEFAULT, {}, piece("25 mm", "sleeper 8", kind="metal")),
    "never touched": (DEFAULT, {}, piece("2 mm", "sleeper 6")),
    "taken out": (DEFAULT, {}, piece("20 mm", "sleeper 6", disappears=8.2)),
    "high friction": (DEFAULT, {"chair.friction_coefficient": 0.8}, piece("3 mm", "sleeper 6")),
    "stiff rod": (DEFAULT, {"drive.2.stiffness": 7500e3}, piece("3 mm", "sleeper 6")),
    "narrow flangeway": (DEFAULT, {"drive.2.stroke": 0.02}, None),
    "raw gap": (DEFAULT, {"lock.rule": "raw gap"}, piece("8 mm", "drive 1")),
    "no slip": (DEFAULT, {"lock.rule": "no slip"}, piece("8 mm", "drive 1")),
    "two rails": ("sb2", {}, piece("13 mm", "sleeper 6")),
    "three drives": ("60e1-1200-1-18.5", {}, piece("15 mm", "TKK1")),
}  # fmt: skip
LIGHT = ("slip before the end", "machine on a test piece", "curved rail", "undetected")
NUMBERS = re.compile(r"(-?[\d.]+) of (min )?([\d.]+) (kN|mm)")
SIZE = {"kN": 1e3, "mm": 1e-3}


def thrown(name: str) -> tuple[dict[str, Any], Page, list[str], xr.Dataset]:
    """Return what the studio, the report and the command show of a scenario, and its dataset."""
    library, changes, item = SCENARIOS[name]
    panel = load_panel(library).with_overrides(changes)
    dataset = simulate(panel, foreign_object=item, mode="quick", throw=False)
    page, lines = run_page(dataset, pictures=[]), list(map(unstyle, summary_lines(dataset)))
    return throw_reply(panel, dataset), page, lines, dataset


def beyond(text: str) -> list[bool]:
    """Return for each value with a limit in a text whether it is on the wrong side."""
    found = []
    for value, least, limit, _ in NUMBERS.findall(text):
        found.append(float(value) < float(limit) if least else float(value) >= float(limit))
    return found


def lamp_faults(reply: dict[str, Any], dataset: xr.Dataset) -> Iterator[str]:
    """Yield lamps of which word, colour, value and limit do not agree at an instant."""
    for lamp in reply["lamps"]:
        rows = (lamp["states"], lamp["words"], lamp["numbers"], lamp["margins"])
        for at, state, word, numbers, margin in zip(reply["motion"]["at"], *rows, strict=True):
            said = (
                f"{lamp['name']} at {float(dataset['time'][at]):.2f} s: {state}, {word}, {numbers}"
            )
            wrong = word.startswith(("not ", "slips"))
            if state in ("good", "missed") and (wrong or any(beyond(numbers))):
                yield said
            if state == "bad" and (not wrong or margin.endswith("left")):
                yield said
            yield from (
                f"{said}; channel {v:.4g}" for v in other_instant(lamp, at, numbers, dataset)
            )


def other_instant(
    lamp: dict[str, Any], at: int, numbers: str, dataset: xr.Dataset
) -> Iterator[float]:
    """Yield the value of the channel at the instant of a lamp where another one is shown."""
    shown = NUMBERS.search(numbers)
    if shown is None:
        return
    unit, now = shown[4], dataset.isel(time=at)
    if lamp["kind"] == "control":
        value = float(now["sensor_gap"].sel(sensor=lamp["name"]))
    else:
        name = re.sub(r"^[Dd]rive ", "", lamp["name"])
        if lamp["kind"] == "lock":
            name = numbers.split()[1]
        channel = "drive_force" if unit == "kN" else "drive_gap"
        value = abs(float(now[channel].sel(drive=name)))
    if not math.isclose(value, float(shown[1]) * SIZE[unit], abs_tol=0.0051 * SIZE[unit]):
        yield value


def studio_faults(reply: dict[str, Any], dataset: xr.Dataset) -> Iterator[str]:
    """Yield what the page says twice and differently."""
    yield from lamp_faults(reply, dataset)
    verdict, states = reply["verdict"], [item["state"] for item in reply["checks"]]
    head = verdict["text"].partition(": ")[0]
    last = {lamp["kind"]: lamp["states"][-1] for lamp in reply["lamps"]}
    if verdict["kind"] == "sound" and "bad" in states:
        yield f"{head}, but a check is not met"
    if verdict["missed"] and ({"good", "bad"} & {*states, *last.values()}) - {"bad"}:
        yield f"{head}, but a lamp is green"
    if verdict["kind"] in ("not locked", "not sound") and "bad" not in states:
        yield f"{head}, but all checks are met"
    if head == "Not locked" and last["lock"] in ("good", "missed"):
        yield f"{head}, but the lamp is {last['lock']}"
    for item in reply["checks"]:
        if item["state"] in ("good", "missed") and any(beyond(item["text"])):
            yield f"{item['label']}: {item['state']}, {item['text']}"
        if (item["margin"].endswith("left")) != (item["state"] in ("good", "missed")) and item[
            "margin"
        ]:
            yield f"{item['label']}: {item['state']}, {item['margin']}"


def report_faults(page: Page) -> Iterator[str]:
    """Yield findings whose answer, level and numbers do not agree, with each other or the title."""
    said = {item.question: item for item in page.findings}
    outcome = said["Outcome"].answer
    locked = said.get("Locked?")
    for item in page.findings:
        if any(beyond(item.detail)) and item.level == "good" and item.question != "Outcome":
            yield f"{item.question} {item.answer}: good, {item.detail}"
    if locked is not None and outcome.startswith("Not locked") and locked.answer == "Yes":
        yield f"{outcome}, but {locked.question} {locked.answer}"
    if (
        locked is not None
        and outcome == "Sound"
        and {item.level for item in said.values()} & {"bad"}
    ):
        yield f"{outcome}, but a finding is bad"
    if outcome == "Undetected object" and any(item.level == "good" for item in page.findings):
        yield "undetected, but a finding is good"
    if page.subtitle.endswith(", locked") and outcome != "Sound":
        yield f"{page.subtitle}, but {outcome}"


def command_faults(lines: list[str]) -> Iterator[str]:
    """Yield lines of the command that do not agree with themselves or with the verdict."""
    verdict = lines[0].partition(" ")[2].strip()
    fields, heading = list[tuple[str, str]](), ""
    for line in lines[1:]:
        heading = line[:16].strip() or heading
        fields.append((heading, line[16:].strip()))
    for clause in (
        c for h, text in fields if h in ("locked", "in control") for c in text.split("; ")
    ):
        refused = "NO" in clause.replace(":", " ").split()[:2]
        if not refused and any(beyond(clause)):
            yield clause
        if refused and NUMBERS.search(clause) and not any(beyond(clause)):
            yield clause
        if refused and verdict.startswith("Sound"):
            yield f"{verdict} | {clause}"
    slips = [text for heading, text in fields if heading == "slip"]
    if verdict.startswith("Sound") and slips != ["no drive slipped"]:
        yield f"{verdict} | {slips}"
    if verdict.startswith(("Detected by slip", "Detected by switch-off")) and slips == [
        "no drive slipped"
    ]:
        yield f"{verdict} | {slips}"


def contradictions(name: str) -> list[str]:
    """Return the contradictions of all screens of a scenario."""
    reply, page, lines, dataset = thrown(name)
    found = [f"studio: {fault}" for fault in studio_faults(reply, dataset)]
    found += [f"report: {fault}" for fault in report_faults(page)]
    found += [f"command: {fault}" for fault in command_faults(lines)]
    texts = [*lines, *(item.detail for item in page.findings), reply["verdict"]["text"]]
    texts += [figure["text"] for figure in reply["figures"]]
    texts += [text for lamp in reply["lamps"] for text in lamp["numbers"]]
    return found + [
        f"gap below zero: {text}" for text in texts if re.search(r"(?<!e)-\d[\d.]* (of|mm)", text)
    ]


@pytest.mark.parametrize("name", LIGHT)
def test_no_screen_contradicts_itself(name: str) -> None:
    assert contradictions(name) == []


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(set(SCENARIOS) - set(LIGHT)))
def test_no_screen_of_many_throws_contradicts_itself(name: str) -> None:
    assert contradictions(name) == []


def test_a_contradiction_is_found() -> None:
    lamp = {"kind": "slip", "name": "drive 2", "states": ["good"], "words": ["holds"]}
    lamp |= {"numbers": ["6.43 of 6 kN"], "margins": ["0.43 over"]}
    run = xr.Dataset(
        {"drive_force": (("drive", "time"), [[-1440.0]])}, {"drive": ["2"], "time": [9.0]}
    )
    found = list(lamp_faults({"lamps": [lamp], "motion": {"at": [0]}}, run))
    assert len(found) == 2
    assert found[0] == "drive 2 at 9.00 s: good, holds, 6.43 of 6 kN"
    assert found[1].endswith("channel 1440")
