"""Measures at the switch, the end position, repeated throws and plans of a day, on toys."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.detection_throws import CLOSING, toy_map, toy_throws
from tests.unit.sweeps import here
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import StudyError
from turnout.core.workers import Workers
from turnout.detection.limit import day_plan
from turnout.detection.limit.bound import repeated_alarm_rate
from turnout.detection.limit.day_plan import (
    Candidates,
    Parameter,
    candidates,
    full_grid,
    known_after,
    ordered,
    parameters_of,
    plan,
)
from turnout.detection.limit.end_positions import EndThrows, Position, end_position_map, end_rows
from turnout.detection.limit.known_place_map import known_place_map
from turnout.detection.limit.limit_map import limit_map, sound_throws
from turnout.detection.limit.what_if import (
    FORMS,
    Measure,
    gain_rows,
    gains,
    read_measure,
    repeated_throw,
)
from turnout.detection.reference import Conditions, reference_study
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.store import open_response

INPUTS = ("drive.1.over_travel_closed",)


def test_two_alarms_in_a_row_are_those_of_drawn_throws() -> None:
    rng, correlation = np.random.default_rng(3), 0.6
    common, first, second = rng.standard_normal((3, 400_000))
    threshold = norm.isf(0.02)
    pair = [
        np.sqrt(correlation) * common + np.sqrt(0.4) * own > threshold for own in (first, second)
    ]
    expected = float(repeated_alarm_rate(correlation, false_alarm_rate=0.02))
    assert float(np.mean(pair[0] & pair[1])) == pytest.approx(expected, rel=0.05)


def test_a_second_throw_does_not_square_the_rate() -> None:
    found = repeated_throw(toy_throws(), Conditions(), closing=CLOSING)
    assert 0.5 < found.correlation < 1.0
    assert 1e-6 < found.rate < 1e-3
    assert found.once_a_year == pytest.approx(7.3)
    own = repeated_throw(toy_throws(), replace(Conditions(), fixed_share=0.0), closing=CLOSING)
    assert own.rate < found.rate


def test_measures_are_ranked_by_what_they_gain() -> None:
    throws, conditions = toy_throws(), Conditions()
    measures = [read_measure(text, throws, conditions, inputs=INPUTS) for text in FORMS]
    found = gains(throws, conditions, measures, closing=CLOSING)
    rows = gain_rows(found)
    assert [row["measure"] for row in rows][0] == "history 20"
    each = [float(row["gain"]) for row in rows]
    assert each == sorted(each, reverse=True)
    usual = toy_map()["a90"].sel(channel="both drives")
    known = limit_map(throws, replace(conditions, history=20), closing=CLOSING)["a90"]
    gain = float((usual - known.sel(channel="both drives")).mean())
    assert each[0] == pytest.approx(gain)


def test_gains_have_intervals_over_states_drawn_together() -> None:
    throws, conditions = toy_throws(), Conditions()
    same = Measure(name="none", note="", throws=throws, conditions=conditions)
    better = read_measure("discrepancy 3 %", throws, conditions, inputs=INPUTS)
    few = read_measure("friction 0.25", throws, conditions, inputs=INPUTS)
    found = gains(throws, conditions, [same, better, few], closing=CLOSING)
    rows = {str(row["measure"]): row for row in gain_rows(found)}
    for name in ("gain", "gain_worst"):
        low, value, high = (float(rows["none"][name + end]) for end in ("_low", "", "_high"))
        assert low == value == high == 0.0  # drawn apart, the difference would scatter
    width = {}
    for name, row in rows.items():
        low, value, high = (float(row[f"gain{end}"]) for end in ("_low", "", "_high"))
        assert low <= value <= high
        width[name] = high - low
    assert width["friction 0.25"] > width["discrepancy 3 %"] > 0.0
    alone = toy_map().sel(channel="both drives")
    ends = np.quantile(alone["a90_resampled"], [0.025, 0.975], axis=0, method="nearest")
    np.testing.assert_allclose(ends, [alone["a90_low"], alone["a90_high"]])


def test_less_friction_keeps_the_states_that_have_it() -> None:
    throws = toy_throws()
    found = read_measure("friction 0.25", throws, Conditions(), inputs=INPUTS)
    assert np.all(found.throws.level[found.throws.states] <= 0.25)
    assert len(found.throws.change) == len(found.throws.states)
    assert len(found.throws.sound) == len(throws.sound)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("more force", "is none of"),
        ("friction 0.101", "states are like that; take a milder one"),
    ],
)
def test_a_measure_without_meaning_is_refused(text: str, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        read_measure(text, toy_throws(), Conditions(), inputs=INPUTS)


def test_a_faster_recorder_lowers_the_noise_alone() -> None:
    throws = toy_throws()
    slow, fast = (
        sound_throws(throws, Conditions(rate=rate, noise=200.0), closing=CLOSING).covariances[0]
        for rate in (125.0, 1000.0)
    )
    windows = len(slow) // 2
    fall = np.diag(slow - fast)[:windows]
    samples = np.where(np.arange(windows) < 10, 10, 5)  # 80 ms, then 40 ms
    np.testing.assert_allclose(fall, 200.0**2 * (1 - 0.125) / samples, rtol=1e-9)


# ---- end positions


def ends(slope: float) -> EndThrows:
    """A position whose gap changes the closing force by `slope` newtons a metre."""
    throws = toy_throws()
    closing = (throws.time > CLOSING).astype(float)
    gap = np.tile(np.array([2e-3, 5e-3, 8e-3]), (40, 1, 1))
    change = slope * gap[..., None, None] * closing * np.ones((2, 1))
    at = Position(name="TKK1", at="sensor TKK1", x=0.5, limit=5e-3, channel="sensor_gap")
    return EndThrows(positions=(at,), change=change, gap=gap, level=throws.level[:40])


def test_a_gap_shows_as_the_closed_form_says() -> None:
    throws, conditions = toy_throws(), Conditions()
    found = end_position_map(throws, ends(2e5), conditions, closing=CLOSING)
    known = sound_throws(throws, conditions, closing=CLOSING)
    means = known.means @ (throws.time > CLOSING).astype(float)
    signature = 2e5 * 5e-3 * np.tile(means, 2)
    index = [
        np.sqrt(signature @ np.linalg.solve(known.covariances[level], signature))
        for level in known.nearest(throws.level[:40])
    ]
    expected = norm.cdf(np.array(index) - norm.isf(1e-3)).mean()
    both = found.sel(channel="both drives", position="TKK1")
    assert float(both["end_pod_at_limit"]) == pytest.approx(expected, abs=0.005)
    assert float(found["end_pod"].sel(channel="both drives").isel(end_gap=0)[0]) == pytest.approx(
        1e-3
    )


def test_a_gap_that_changes_nothing_is_not_shown() -> None:
    found = end_position_map(toy_throws(), ends(0.0), Conditions(), closing=CLOSING)
    np.testing.assert_allclose(found["end_pod"], 1e-3)
    assert end_rows(found)[0]["revealed_gap"] is None


# ---- plans


def toy_candidates() -> Candidates:
    """Two features; the first shows the parameter, an object at the sleeper both of them."""
    size = np.array([0.0, 5e-3, 10e-3, 15e-3, 20e-3])
    return Candidates(
        place=("none", *["sleeper 1"] * 4),
        size=size,
        features=np.column_stack([np.zeros(5), 1e3 * size]),
        sensitivity=np.array([[[1.0], [0.0]], *[[[2.0], [0.0]]] * 4]),
        slips=np.array([False, False, False, False, True]),
        fixed=0.0 * np.eye(2) + 1e-12 * np.eye(2),
        own=np.eye(2),
        parameters=(Parameter(name="friction", step=0.02, deviation=0.1, share=False),),
        false_alarm_rate=1e-3,
    )


def test_repeated_throws_determine_a_parameter_by_the_closed_form() -> None:
    found = known_after(toy_candidates(), [0, 0, 0])
    assert found.deviations[0] == pytest.approx(np.sqrt(1.0 / (1.0 + 3.0)), rel=1e-6)
    both = known_after(toy_candidates(), [0, 1, 1])
    assert both.deviations[0] == pytest.approx(np.sqrt(1.0 / (1.0 + 1.0 + 8.0)), rel=1e-6)


def test_a90_of_a_plan_is_that_of_the_line() -> None:
    size, high = known_after(toy_candidates(), [1, 2, 3]).a90["sleeper 1"]
    assert size == pytest.approx((norm.isf(1e-3) + norm.ppf(0.9)) / 1e3, abs=1e-4)
    assert high > size
    assert known_after(toy_candidates(), [1, 2, 3] * 5).a90["sleeper 1"][1] < high


def test_throws_elsewhere_tell_what_is_fixed_for_the_switch() -> None:
    of = replace(toy_candidates(), fixed=4.0 * np.eye(2))
    alone = known_after(of, [1, 2]).a90["sleeper 1"][1]
    with_sound = known_after(of, [1, 2, *[0] * 12]).a90["sleeper 1"][1]
    assert with_sound < alone - 0.05e-3
    slipping = known_after(of, [1, 2, *[4] * 12]).a90["sleeper 1"][1]
    assert slipping == pytest.approx(with_sound, rel=0.1)


def test_a_plan_beats_a_grid_of_as_many_throws() -> None:
    of = toy_candidates()
    chosen = plan(of, 12)
    assert len(chosen) == 12
    assert chosen.count(0) >= 2
    assert (
        known_after(of, chosen).criterion
        < known_after(of, [0, 0, 0, *full_grid(of)] * 3).criterion + 0.5
    )
    order = ordered(of, chosen)
    assert sorted(order) == sorted(chosen)
    slipping = [bool(of.slips[row]) for row in order if of.place[row] != "none"]
    assert slipping == sorted(slipping)


@pytest.mark.parametrize(("sound", "expected"), [(4, [4, 8]), (6, [3, 6, 8]), (1, []), (2, [8])])
def test_sound_throws_follow_places_at_even_distances_and_end_the_day(
    sound: int, expected: list[int]
) -> None:
    places = [f"sleeper {number}" for number in range(1, 9)]
    of = replace(
        toy_candidates(),
        place=("none", *places),
        size=np.full(9, 5e-3),
        slips=np.array([False] * 7 + [True] * 2),
    )
    order = ordered(of, [*[0] * sound, *range(1, 9)])
    first = (sound + 1) // 2
    assert order[:first] == [0] * first
    shown = np.cumsum(np.array(order[first:]) != 0)[np.array(order[first:]) == 0]
    assert shown.tolist() == expected


def test_a_day_of_sound_throws_keeps_all_of_them() -> None:
    assert ordered(toy_candidates(), [0, 0, 0]) == [0, 0, 0]


@pytest.fixture(scope="module")
def with_a_machine() -> LoadedPanel:
    machines = {"drive.1.machine": "jea73", "drive.2.machine": "jea73"}
    return load_panel("uic60-760-1-15").with_overrides(machines)


def test_the_slip_level_of_a_machine_is_that_of_its_clutch(
    with_a_machine: LoadedPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(day_plan, "places_of", lambda _: ("drive 1", "sleeper 6", "drive 2"))
    names = [item.name for item in parameters_of(with_a_machine)]
    assert names.count("machine.jea73.clutch.torque") == 1
    assert not [name for name in names if name.endswith("saturation_force")]
    of = candidates(with_a_machine, sizes=(31e-3,))
    largest = np.abs(of.sensitivity).max(axis=(0, 1))
    assert dict(zip(names, largest, strict=True))["machine.jea73.clutch.torque"] > 20.0
    assert largest.min() > 20.0


def test_a_plan_is_of_the_same_panel_named_or_not() -> None:
    found, named = candidates(sizes=()), candidates(load_panel("uic60-760-1-15"), sizes=())
    np.testing.assert_array_equal(found.features, named.features)
    np.testing.assert_array_equal(found.sensitivity, named.sensitivity)


def test_a_day_without_throws_is_refused() -> None:
    with pytest.raises(StudyError, match="throws = 0: must be 1 or more"):
        plan(toy_candidates(), 0)


@pytest.mark.long
def test_a_day_on_the_default_panel_determines_what_it_should() -> None:
    with Workers(1, pool=here) as workers:
        of = candidates(sizes=(10e-3, 18e-3), workers=workers)
    known = known_after(of, plan(of, 24))
    assert known.deviations.max() < 0.5
    assert known.a90["sleeper 6"][0] == pytest.approx(11e-3, abs=3e-3)


# ---- the command


def test_the_command_prints_map_end_positions_and_measures(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        "turnout.detection.throws.throw_all", lambda *_, **__: toy_throws(states=30)
    )
    monkeypatch.setattr("turnout.detection.throws.closing_time", lambda _: CLOSING)
    monkeypatch.setattr(
        "turnout.detection.limit.end_positions.throw_ends", lambda *_, **__: ends(2e5)
    )
    monkeypatch.setattr(  # the tests of known places have all draws
        "turnout.detection.limit.known_place_map.known_place_map",
        partial(known_place_map, draws=1_000),
    )
    out, figure = tmp_path / "limit.nc", tmp_path / "limit.png"
    line = [
        "limit",
        "--ends",
        "--known-place",
        "--what-if",
        "second throw",
        "--what-if",
        "history 20",
    ]
    shown = CliRunner().invoke(app, [*line, "-o", str(out), "--plot", str(figure)])
    assert shown.exit_code == 0, shown.exception
    assert "TKK1" in shown.output
    assert "if the place is known" in shown.output
    assert "if a second throw must confirm" in shown.output
    found = open_response(out)
    assert {"pod", "end_pod", "revealed_gap"} <= set(found)
    assert figure.exists()
    printed = CliRunner().invoke(app, [*line, "--json"])
    record = json.loads(printed.stdout)
    assert [row["measure"] for row in record["measures"]] == ["history 20", "second throw"]
    assert record["known_place"][0]["known_a90"] > record["places"][0]["a90"]
    assert record["units"]["known_a90"] == "m"
    assert record["end_positions"][0]["position"] == "TKK1"
    assert record["second_throw"]["rate"] < 1e-3
    assert record["units"]["revealed_gap"] == "m"


def test_a_quiet_command_says_nothing_of_its_population(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    study = reference_study(count=1)
    remarked = replace(study, remarks=("panel p has no number rail.k: it does not vary",))
    monkeypatch.setattr("turnout.detection.reference.reference_study", lambda *_, **__: remarked)
    monkeypatch.setattr("turnout.detection.throws.throw_all", lambda *_, **__: toy_throws())
    monkeypatch.setattr("turnout.detection.throws.closing_time", lambda _: CLOSING)
    line = ["limit", "-o", str(tmp_path / "limit.nc")]
    shown = CliRunner().invoke(app, line)
    assert shown.exit_code == 0, shown.exception
    assert "turnout: panel p has no number rail.k" in shown.output
    quiet = CliRunner().invoke(app, [*line, "-q"])
    assert quiet.exit_code == 0, quiet.exception
    assert not quiet.output
