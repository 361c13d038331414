"""The benchmarks' own logic: rivals that agree, tables that refuse those that do not, errors."""

import json

import numpy as np
import pytest
from benchmarks import banded, race, sb1, scaling
from benchmarks.accuracy_page import draw, section
from benchmarks.errors import Error, Run, contact_late, error, errors
from benchmarks.machine import figure, processor_seconds, seconds_text
from benchmarks.page import with_section
from benchmarks.racers import RACERS
from benchmarks.schemes import MODES
from tests.verification.runs import throw


def answer(case, *, lateral_only, step=1e-3):
    system, rest = banded.prepare(case, lateral_only=lateral_only)
    return banded.run(system, rest, case=case, step=step)


@pytest.mark.parametrize("case", sb1.CASES)
def test_the_banded_program_agrees(case):
    """Its own step of 1 ms against the reference's 0.5 ms; friction locks differently in B."""
    found = answer(case, lateral_only=True)
    rms, plateau, agrees = sb1.agreement(sb1.checks(case, found))
    assert agrees
    assert rms < {"A": 0.02, "B": 0.2}[case]  # found: 0.011 and 0.17
    assert plateau < 0.1
    assert found.work["unconverged"] == 0


def test_the_banded_program_converges_to_the_reference():
    """At the reference's own step the same numbers to 1e-5 of the peak."""
    found = answer("A", lateral_only=True, step=5e-4)
    rms, _, _ = sb1.agreement(sb1.checks("A", found))
    assert rms < 2e-3  # found: 9e-4


def test_all_coordinates_or_the_lateral_plane_are_the_same_in_sb1():
    whole = answer("A", lateral_only=False, step=2e-3)
    plane = answer("A", lateral_only=True, step=2e-3)
    assert whole.drive == pytest.approx(plane.drive, abs=1e-3)
    assert whole.friction == pytest.approx(plane.friction, abs=1e-1)


def test_turnouts_superelement_holds_the_stations():
    """Gravity alone brings the full model and the superelement to rest alike."""
    weights = []
    for system in (sb1.full_system("B"), sb1.reduced_system("B")):
        rest = sb1.at_rest(system)
        weights.append(-system.stations.normal_stiffness * rest[system.stations.vertical])
    assert weights[0] == pytest.approx(weights[1], rel=1e-6)
    assert weights[0].size == 16


def test_exudyn_agrees_on_the_superelement():
    pytest.importorskip("exudyn", reason="extra `benchmark` is not installed")
    from benchmarks import with_exudyn

    system = sb1.reduced_system("B")
    rest = sb1.at_rest(system)
    found = with_exudyn.run(system, rest, case="B", step=2e-3, dense=True)
    assert sb1.agreement(sb1.checks("B", found))[2]


@pytest.mark.long
@pytest.mark.parametrize("racer", ["exudyn", "opensees"])
def test_slower_rivals_agree(racer, tmp_path):
    """Two to ten seconds each; a process of its own, as the race runs them."""
    pytest.importorskip(race.NEEDS[racer], reason="extra `benchmark` is not installed")
    found = race.measured(racer, "B", 2.0, tmp_path)
    assert found["agrees"]
    assert race.measured(racer, "B", 2.0, tmp_path) == found  # kept


def test_a_wrong_answer_is_refused():
    """Case B's answer for case A, and the right one at half its forces."""
    right = answer("A", lateral_only=True, step=2e-3)
    assert sb1.agreement(sb1.checks("A", right))[2]
    assert not sb1.agreement(sb1.checks("B", right))[2]
    half = sb1.Answer(right.time, 0.5 * right.drive, right.object, right.friction, {})
    assert not sb1.agreement(sb1.checks("A", half))[2]


def measurement(seconds, *, step=1.0, agrees=True):
    return {
        "seconds": seconds, "step": step, "agrees": agrees, "rms": 0.1, "plateau": 0.2,
        "friction": 1.0, "start": 0.001, "setup": 0.03, "note": "plain", "load": 0.5, "work": {},
    }  # fmt: skip


def test_ratios_are_of_agreeing_runs():
    lines = [
        ("turnout-least", measurement([0.001, 0.002, 0.004])),
        ("banded", measurement([0.8, 0.7, 0.9])),
        ("banded", measurement([0.4], step=2.0, agrees=False)),
        ("banded", measurement([0.6], step=3.0)),
        ("exudyn", measurement([0.2], agrees=False)),
    ]
    table = race.table("A", lines)
    assert "| 800 ms (700 to 900) |" in table
    assert "| yes | 400 | 800 |" in table
    assert "| yes | 300 | 600 |" in table  # its cheapest that agrees
    assert "coordinates | 2 |" not in table
    assert "| **no** | 100 | 200 |" in table


def test_what_is_measured_is_kept(tmp_path):
    kept = tmp_path / "banded_A_1ms.json"
    kept.write_text(json.dumps(measurement([1.0])), encoding="utf-8")
    assert race.measured("banded", "A", 1.0, tmp_path)["seconds"] == [1.0]


def test_a_program_that_is_not_installed_is_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(race.NEEDS, "exudyn", "no_such_program")
    assert race.measured("exudyn", "A", 1.0, tmp_path) is None
    assert "no_such_program is not installed" in capsys.readouterr().err
    assert set(race.NEEDS) <= set(RACERS)


def test_sections_keep_their_order():
    page = with_section(with_section("# Performance\n", "One throw", "a"), "Scaling", "b")
    again = with_section(page, "One throw", "c")
    assert again.index("## One throw\n\nc") < again.index("## Scaling\n\nb")
    assert "\na" not in again
    assert again.count("# Performance") == 1


def test_an_error_is_of_the_worst_member():
    theirs = np.array([[0.0, 100.0, 50.0], [0.0, 0.0, 2000.0]])
    ours = theirs + [[0.0, 0.0, 30.0], [0.0, 0.0, 19.0]]
    found = error(ours, theirs, unit="N")
    assert found.end == 30.0
    assert found.end_allowed == pytest.approx(2.0)  # 30 of 15 N; 19 of 20 N would do
    assert found.largest == pytest.approx(1.5)
    assert not found.within
    assert np.isnan(error(ours, theirs, unit="m").end_allowed)
    assert error(ours, theirs, unit="J", scale=300.0).largest == pytest.approx(10.0)


def test_errors_fall_with_the_step():
    truth = throw("sb1", "x = 3.9 m")
    own = errors(truth, truth)
    assert {name: e.rms for name, e in own.items() if e.rms > 0} == {}
    assert {"drive_force", "object_force", "chair_friction_force"} <= set(own)
    coarse = errors(throw("sb1", "x = 3.9 m", step=4e-3), truth)
    middle = errors(throw("sb1", "x = 3.9 m", step=2e-3), truth)
    assert 0 < middle["drive_force"].rms < coarse["drive_force"].rms < 1.0
    assert abs(contact_late(throw("sb1", "x = 3.9 m", step=4e-3), truth)) <= 4.1e-3
    assert contact_late(truth, truth) == 0.0


def test_panels_of_the_scaling():
    chairs = scaling.panel_from(scaling.with_chairs(32))
    assert len(chairs.chair) == len(chairs.stop) == 32
    drives = scaling.panel_from(scaling.with_drives(4))
    assert list(drives.drive) == ["1", "2", "3", "4"]
    assert scaling.slowed(2.0).schedule.end == pytest.approx(17.0)
    with pytest.raises(ValueError, match="is 1 times in the panel, not 2"):
        scaling.replaced("once", "once", "twice", times=2)


def test_figures_are_reported_as_measured():
    assert seconds_text([0.0123]) == "12.3 ms (once)"
    assert (figure(0.0), figure(99.96), figure(123456.0)) == ("0", "100", "123000")
    calls = []
    assert len(processor_seconds(lambda: calls.append(1), count=3)) == 3
    assert len(calls) == 4


def graded(case, mode, *, rms, end_allowed):
    step = MODES[mode].step
    found = {"drive_force": Error(rms, 1.0, 3.0, end_allowed), "gap": Error(0.1, 0.2, 1e-4, np.nan)}
    return Run(case, mode, step, 100.0, "plain", 9, 0, 0.02, 0.5, 1e-3, found)


def test_the_verdict_names_what_breaks_the_promise():
    good = [graded("sb1", mode, rms=0.4, end_allowed=0.9) for mode in MODES]
    text = section(good)
    assert "in all cases: `drive_force`, `gap`. Outside in the cases named: none." in text
    late_end = [*good, graded("sb2", "quick", rms=0.4, end_allowed=1.1)]
    assert "Outside in the cases named: `drive_force` (sb2)." in section(late_end)
    assert "**0.40 / 1.00 / 3**" in section(late_end)
    rough = [*good, graded("sb2", "quick", rms=0.6, end_allowed=0.1)]
    assert "Outside in the cases named: `drive_force` (sb2)." in section(rough)


def test_the_figure_of_accuracy_holds_the_runs():
    runs = [graded("sb2, object", mode, rms=0.4, end_allowed=0.9) for mode in MODES]
    drawing = draw(runs)
    assert drawing.axes[0].get_title() == "sb2, object"
    assert drawing.axes[2].get_xlabel() == "processor time [ms]"
    assert len(drawing.axes) == 3  # one case pictured, three groups of channels
    rings = [line for line in drawing.axes[0].lines if line.get_label() == "quick mode"]
    assert (rings[0].get_xdata(), rings[0].get_ydata()) == ([20.0], [0.4])


def test_the_figure_of_the_race_shows_agreeing_runs_only():
    lines = [
        ("turnout-least", measurement([0.002])),
        ("banded", measurement([0.8])),
        ("banded", measurement([0.4], step=2.0, agrees=False)),
        ("opensees", measurement([9.0], agrees=False)),
    ]
    drawing = race.draw({"A": lines, "B": lines})
    shown = drawing.axes[0].collections[0].get_offsets()[:, 0]
    assert shown.tolist() == [0.002, 0.8]
