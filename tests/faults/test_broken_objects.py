"""A verdict that depends on how an object breaks says so, wherever it is shown."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import pytest
import xarray as xr
from tests.unit.sweeps import here, study_file
from typer.testing import CliRunner

import turnout
from turnout.calibration.load_study import load_study
from turnout.cli.main import app
from turnout.core.channels import KINDS_NOTE
from turnout.core.scheme import Mode
from turnout.figures.report.page import page_html
from turnout.figures.report.run import run_page
from turnout.figures.report.sequence import sequence_page
from turnout.figures.report.sweep import sweep_findings
from turnout.figures.style import title_of
from turnout.metric.finding import HEADLINE, findings
from turnout.metric.key_figure import key_figures
from turnout.metric.summary import summary
from turnout.panel.foreign_object import parse_object
from turnout.solver.outcome import Code
from turnout.study.sweep.read import read_labels
from turnout.study.sweep.run import throw_study
from turnout.throw.breaking import ThrowEnd, break_attributes, end_of, is_of_pieces, outcomes
from turnout.throw.simulate import solve
from turnout.throw.verdict import verdict
from turnout.web.object_map import object_map
from turnout.web.question import Question
from turnout.web.request import MapRequest
from turnout.web.throw import throw_reply

ICE = "14.9mm ice@sleeper3"
NOTE = "Depends on how it breaks: "
"""Of a throw, which is compared with others; ice of this strength just fails."""
UNCOMPARED = (
    "An object broke: where its strength is nearly met, the verdict may depend on step and mode"
)
"""Of sequences and sweeps."""
QUICK = turnout.Scheme.of("quick")
STUDY = """
schema_version = 1
name = "breaks"
description = "Ice that breaks, and wood, which does not."
panel = "uic60-760-1-15"

[scheme]
mode = "quick"

[output]
channels = ["object_broken"]

[[together]]
keys = ["object.size", "object.at", "object.kind"]
rows = [["14.9 mm", "sleeper 3", "{kind}"]]
"""


@cache
def thrown(text: str = ICE) -> xr.Dataset:
    return turnout.simulate(panel(), foreign_object=parse_object(text), mode="quick")


@cache
def panel() -> turnout.LoadedPanel:
    return turnout.load_panel("uic60-760-1-15")


@cache
def sequence() -> xr.Dataset:
    """Return throws of ice that gets weaker: it breaks in the third."""
    warmer = turnout.Drift(temperature=("-12 degC", "-9 degC"))
    made = turnout.simulate_sequence(
        panel(), throws=4, foreign_object=parse_object(ICE), drift=warmer
    )
    assert [int(count) > 0 for count in made["object_broken"].values[:, 0]] == [0, 0, 1, 0]
    return made


def printed(*line: str) -> str:
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_ice_that_just_fails_has_the_same_verdict_in_both_modes() -> None:
    fine = turnout.simulate(panel(), foreign_object=parse_object(ICE))
    for made in (thrown(), fine):
        found = verdict(made)
        assert found.kind == "depends on how it breaks"
        assert re.search(
            r'TKK" with no break \(TKK1 17\.\d mm\) or "und.* 1 break \(TKK1 5\.\d', found.text
        )
        assert "; in this throw: undetected object: " in found.text
        assert "changes it" in found.meaning


@pytest.mark.parametrize("strength", [11.8, 12.1])
def test_a_stone_whose_first_failure_is_on_a_blow_depends_on_it(strength: float) -> None:
    item = parse_object(f"6.4mm stone@x = 3.826 m, strength={strength}MPa, piece=0.08")
    rough = panel().with_overrides({"chair.friction_coefficient": 0.36})
    found = verdict(turnout.simulate(rough, foreign_object=item))
    assert found.kind == "depends on how it breaks"
    assert '"undetected object" with no break' in found.text
    assert '"sound" with 1 break' in found.text


def test_ends_with_machines_are_named_as_their_verdicts_are() -> None:
    drives = panel().with_overrides({"drive.1.machine": "jea73", "drive.2.machine": "jea73"})
    stone = parse_object("22mm stone@drive1, strength=12.2MPa")
    found = verdict(turnout.simulate(drives, foreign_object=stone, mode="quick"))
    assert found.kind == "depends on how it breaks"
    assert '"detected by slip" with no break' in found.text
    assert '"not sound" with 5 breaks' in found.text


@pytest.mark.parametrize("mode", ["quick", "waveform"])
def test_an_object_on_the_other_rail_is_compared_after_opening(mode: Mode) -> None:
    item = parse_object(f"{ICE}, rail=curved, strength=9.22MPa")
    found = verdict(turnout.simulate(panel(), foreign_object=item, mode=mode))
    assert found.kind == "depends on how it breaks"
    assert re.search(r"no break \(TKK1 after opening 16\.\d.* 1 break \(TKK1 after", found.text)


def test_a_compared_throw_that_does_not_end_is_not_alike() -> None:
    item, scheme = parse_object(f"{ICE}, strength=9.5MPa"), turnout.Scheme()
    solved = solve(panel(), foreign_object=item, scheme=scheme)
    thrown = solved.mechanism, solved.history
    early = replace(solved.history.outcome, code=Code.NOT_CONVERGED)
    stopped = solved.mechanism, replace(solved.history, outcome=early)
    made = [
        break_attributes(panel(), solved.objects, thrown, scheme, lambda *_, end=end: end)
        for end in (thrown, stopped)
    ]
    assert made[0] == {"break_check": "alike with a little less and more strength"}
    assert made[1]["break_note"].endswith(
        'strength "undetected object" with 1 break or a run that does not come to its end'
    )


@pytest.mark.parametrize(
    ("kind", "broken", "counts"),
    [
        ("sound", (3, 1), True),
        ("detected by TKK", (2, 1), True),
        ("detected by slip", (3, 1), False),  # of a drive that nearly slips at the first failure
        ("detected by TKK", (3, 0), False),
    ],
)
def test_pieces_make_a_difference_by_how_many_break(
    kind: str, broken: tuple[int, ...], counts: bool
) -> None:
    first = ThrowEnd("sound", {}, (3, 1))
    assert is_of_pieces(ThrowEnd(kind, {}, broken), first) is counts


def test_outcomes_that_are_further_apart_than_a_range_are_named_one_by_one() -> None:
    ends = [
        ThrowEnd("detected by slip", {"TKK1": gap}, (count,))
        for gap, count in [(0.0313, 5), (0.0004, 5), (0.0002, 4), (0.0305, 5)]
    ]
    said = "4 to 5 breaks (TKK1 0.2 to 0.4 mm) or 5 breaks (TKK1 30.5 to 31.3 mm)"
    assert outcomes(ends) == said


WOOD = "20mm wood@sleeper6"


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        ("10mm ice@sleeper6", {}),
        (WOOD, {}),
        (f"{WOOD}, rail=curved", {}),
        (f"{WOOD}, disappears=7.9s", {}),
        (f"{WOOD}, disappears=7s", {}),
        (WOOD, {"drive.1.saturation_force": "2.5 kN"}),
        ("13mm stone@drive1", {}),
        ("13mm stone@drive1", {"drive.2.saturation_force": "3 kN"}),
        ("13mm stone@drive1", {"flangeway.limit": "70 mm"}),
        ("13mm stone@drive1", {"gauge.limit": "0.1 mm"}),
        ("15mm wood@sleeper9", {"drive.2.gap_limit": "0.1 mm"}),
        ("13mm stone@drive1", {"movement.return.start": "3.4 s"}),
    ],
)
def test_compared_throws_keep_what_the_verdict_needs(text: str, changes: dict[str, str]) -> None:
    changed, item, scheme = panel().with_overrides(changes), parse_object(text), QUICK
    solved = solve(changed, foreign_object=item, scheme=scheme)
    end = end_of(changed, solved.objects, (solved.mechanism, solved.history), scheme)
    judged = verdict(turnout.simulate(changed, foreign_object=item, scheme=scheme))
    assert end.kind == (judged.own or judged.kind)


def test_gaps_that_rest_on_a_break_are_named_beside_the_same_verdict() -> None:
    found = verdict(thrown("24.9mm ice@sleeper3, strength=6.15MPa, piece=0.7"))
    assert found.kind == "detected by TKK"
    assert re.search(r": no break \(TKK1 25\.\d.* 1 break \(TKK1 1[78]\.", found.text)


@pytest.mark.parametrize("mode", ["quick", "waveform"])
@pytest.mark.parametrize(
    ("strength", "kind"), [(9.5, "undetected object"), (10.5, "detected by TKK")]
)
def test_ice_that_surely_fails_or_holds_is_judged(mode: Mode, strength: float, kind: str) -> None:
    item = parse_object(f"{ICE}, strength={strength}MPa")
    found = verdict(turnout.simulate(panel(), foreign_object=item, mode=mode))
    assert (found.kind, NOTE in found.text) == (kind, False)


def test_a_stone_of_which_nothing_is_left_is_sound() -> None:
    made = thrown("13mm stone@drive1")
    assert verdict(made).kind == "sound"
    assert made.attrs["break_check"].startswith("alike in mode waveform")
    assert "break_note" not in made.attrs


@pytest.mark.parametrize(
    "text", ["13mm@sleeper6", "15mm wood@drive1", "20mm metal@drive1", "20mm snow@drive1"]
)
def test_what_only_dents_or_springs_back_has_no_note(text: str) -> None:
    dataset = thrown(text)
    assert bool(dataset["object_touched"])
    shown = [verdict(dataset).text, title_of(dataset), str(findings(dataset)), str(dataset.attrs)]
    assert [line for line in shown if "depend on step" in line or "broke" in line] == []


def test_page_report_and_dataset_say_so() -> None:
    dataset = thrown()
    assert dataset.attrs["break_note"].startswith(NOTE)
    headline = next(item for item in findings(dataset) if item.question == HEADLINE)
    assert (headline.level, headline.answer) == ("look", "Depends on how it breaks")
    assert "TKK1 5." in headline.detail
    assert "Depends on how it breaks" in page_html(run_page(dataset, pictures=[]))
    title = title_of(dataset).replace("\n", " ")
    assert title.count("depend") == 1 == title.count("depends on how it breaks")
    assert "good" not in {item.level for item in findings(dataset) if item.question[-1] == "?"}
    reply = throw_reply(panel(), dataset)
    assert NOTE in reply["verdict"]["text"]
    shown = [item["state"] for item in reply["checks"]]
    shown += [state for lamp in reply["lamps"] for state in lamp["states"]]
    assert set(shown) <= {"missed", "rest"}
    cell = {"run": {"panel": "", "object": {"size": "13 mm", "at": "drive 1", "kind": "ice"}}}
    asked = MapRequest.model_validate({**cell, "places": ["sleeper 3"], "sizes": ["14.9 mm"]})
    assert NOTE in object_map(panel(), asked, Question())["texts"][0][0]


def test_the_command_line_says_so() -> None:
    line = ("simulate", "--object", ICE, "--mode", "quick")
    assert NOTE in printed(*line)
    record = json.loads(printed(*line, "--json"))
    assert NOTE in record["verdict"]["text"]
    assert record["break_note"].startswith(NOTE)


@pytest.mark.parametrize("lost", ["object_broken", "drive_slipping"])
def test_what_was_not_kept_hides_nothing(lost: str) -> None:
    """Without slip there is no verdict, but what rests on a break."""
    assert (
        'strength "detected by TKK" with no break (TKK1 17.'
        in findings(thrown().drop_vars(lost))[0].detail
    )


@pytest.mark.parametrize(
    ("mode", "note"),
    [
        ("quick", "the peak of a blow is off by up to 22 %"),
        ("waveform", "the peak of a blow is off by up to 4 %"),
        ("quasi-static", "without blows, which mode quasi-static leaves out"),
    ],
)
def test_a_peak_of_a_struck_object_is_shown_with_its_error(mode: Mode, note: str) -> None:
    made = turnout.simulate(panel(), foreign_object=parse_object("13mm@sleeper6"), mode=mode)
    assert made.attrs["object_peak_note"] == note
    shown = [text for heading, text in summary(made)]
    shown += [item.detail for item in findings(made)]
    shown += [item.label for item in key_figures(made)]
    assert sum(f" ({note})" in text for text in shown) == 3


def test_peaks_of_throws_without_a_blow_have_no_note() -> None:
    unstruck = turnout.simulate(panel(), mode="quick")
    assert "object_peak_note" not in unstruck.attrs
    assert "blow" not in str(summary(unstruck)) + str(key_figures(unstruck))


def test_a_file_from_before_the_note_says_so() -> None:
    before = thrown().assign_attrs()
    del before.attrs["break_note"], before.attrs["break_check"]
    assert UNCOMPARED in verdict(before).text


def test_throws_after_a_break_say_so_and_those_before_do_not() -> None:
    made = sequence()
    said = [UNCOMPARED in verdict(made.isel(throw=number)).text for number in range(4)]
    assert said == [False, False, True, True]
    assert made.attrs["break_throw"] == 3
    assert f"{UNCOMPARED} (from throw 3 on)" in page_html(sequence_page(made))


def test_a_sequence_on_the_command_line_says_so() -> None:
    line = ("simulate", "--object", ICE, "--throws", "2")
    assert "object: the peak of a blow is off by up to 22 %\n" in printed(*line)
    assert f"{UNCOMPARED} (from throw 1 on)\n" in printed(*line)
    assert json.loads(printed(*line, "--json"))["break_note"] == f"{UNCOMPARED} (from throw 1 on)"


@pytest.mark.parametrize(("kind", "said"), [("ice", True), ("wood", False)])
@pytest.mark.parametrize(
    ("channels", "note"), [('["object_broken"]', UNCOMPARED), ("[]", KINDS_NOTE)]
)
def test_a_sweep_says_that_it_does_not_compare(
    tmp_path: Path, kind: str, said: bool, channels: str, note: str
) -> None:
    text = STUDY.replace("{kind}", kind).replace('["object_broken"]', channels)
    throw_study(load_study(study_file(tmp_path, text=text)), tmp_path / "out", pool=here)
    labels = read_labels(tmp_path / "out")
    shown = [item.detail for item in sweep_findings(labels)]
    line = ("sweep", "map", str(tmp_path / "out"))
    record = cast("dict[str, Any]", json.loads(printed(*line, "--json")))
    assert (
        note in shown,
        note in printed(*line),
        record.get("break_note") == note,
    ) == (said,) * 3
