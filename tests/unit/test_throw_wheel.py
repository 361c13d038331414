"""A wheel over a closed rail: figures of a beam study, courses, routes, bad input, faces."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import turnout
from turnout.cli.main import app
from turnout.core.errors import PanelError, ResponseError
from turnout.figures.gauge import gauge_sheet
from turnout.metric.export import export_matrices
from turnout.metric.least_gauge import least_gauges
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.gauge_limits import load_gauge_limits
from turnout.panel.load import load_panel
from turnout.throw.save import Save
from turnout.throw.simulate import simulate
from turnout.throw.wheel import gauge_under_wheel

DEFAULT, TRAPPED = "uic60-760-1-15", ForeignObject("13 mm", "sleeper 6")


@cache
def found(**options: Any) -> xr.Dataset:
    given: dict[str, Any] = {"lateral": (20e3, 40e3), "foreign_object": TRAPPED} | options
    return gauge_under_wheel(load_panel(DEFAULT), **given)


def narrowed(gauge: float) -> float:
    """Return a gauge less the nominal one, in whole tenths of a millimetre."""
    return round(1e3 * (gauge - 1.435), 1)


def test_an_object_is_levered_by_the_wheel_unless_that_is_heavy() -> None:
    """As a beam study of the same panel found, whose wheel rolls as this one does."""
    light, heavy = least_gauges(found())[1], least_gauges(found(vertical=50e3))[0]
    assert narrowed(light.at_rest) == -12.9
    assert (narrowed(light.at_wheel), light.wheel_place) == (-10.1, "sleeper 6")
    assert (narrowed(light.under_wheel), light.place) == (-17.0, "x = 2.55 m")
    assert round(1e3 * light.roll) == 23
    assert narrowed(heavy.under_wheel) > -13.2
    assert light.least == light.under_wheel


def test_the_energy_balance_closes_beside_the_energy_of_the_throw() -> None:
    """Though the springs that press are stretched by some hundred kilometres."""
    for run in (found(), found(vertical=50e3), found(vertical=112e3, course="trailing")):
        assert run.attrs["energy_scale"] == pytest.approx(700, rel=0.3)
        assert run.attrs["energy_residual"] < 1e-6 * run.attrs["energy_scale"]


def test_rest_is_that_of_the_throw() -> None:
    thrown = simulate(
        load_panel(DEFAULT),
        foreign_object=TRAPPED,
        mode="quasi-static",
        save=Save(also=("gauge",), stations="all"),
    )
    np.testing.assert_allclose(
        found()["gauge_at_rest"], thrown["gauge"].isel(time=-1), rtol=0, atol=2e-6
    )


def test_places_of_the_wheel_are_at_most_a_step_apart() -> None:
    """Halving the step moves no least gauge by more than 0.1 mm."""
    coarse, fine = found(vertical=50e3), found(vertical=50e3, step=0.15)
    assert np.diff(coarse["wheel"]).max() <= 0.3 + 1e-9
    assert np.diff(fine["wheel"]).max() <= 0.15 + 1e-9
    assert float(coarse["wheel"][-1]) == pytest.approx(14.4)  # the last chair
    for one, other in zip(least_gauges(coarse), least_gauges(fine), strict=True):
        assert one.at_wheel == pytest.approx(other.at_wheel, abs=1e-4)
        assert one.under_wheel == pytest.approx(other.under_wheel, abs=2e-4)


def test_the_course_matters_behind_the_wheel_only_through_friction() -> None:
    facing, trailing = found(vertical=50e3), found(vertical=50e3, course="trailing")
    assert float(abs(facing["gauge"] - trailing["gauge"]).max()) > 0.5e-3
    smooth = load_panel(DEFAULT, overrides={"chair.friction_coefficient": 0.0})
    both = [
        gauge_under_wheel(smooth, lateral=40e3, foreign_object=TRAPPED, course=course)
        for course in ("facing", "trailing")
    ]
    np.testing.assert_allclose(both[0]["gauge"], both[1]["gauge"], rtol=0, atol=1e-9)


def test_the_other_route_and_an_object_in_it() -> None:
    """The rail rests before the return, where an object in the other gap is not there yet."""
    alone = found(rail="curved", foreign_object=None)
    other = found(rail="curved")
    np.testing.assert_array_equal(alone["gauge"], other["gauge"])
    assert json.loads(other.attrs["foreign_objects"]) == []
    own = found(foreign_object=ForeignObject("10 mm", "sleeper 6", rail="curved"))
    assert own.attrs["rail"] == "curved"
    assert 1e3 * (1.435 - float(own["gauge_at_rest"].min())) == pytest.approx(10.0, abs=0.3)


def test_machines_stand_as_markers() -> None:
    with_machines = load_panel(DEFAULT, overrides={"drive.1.machine": "jea73"})
    moved = gauge_under_wheel(with_machines, lateral=40e3, foreign_object=TRAPPED)
    gauge = found()["gauge"].isel(load=1)
    np.testing.assert_array_equal(moved["gauge"].isel(load=0), gauge)


def test_a_rail_that_came_as_matrices_answers_as_its_beams(tmp_path: Path) -> None:
    """Within micrometres: which of two feet slides first may rest on rounding."""
    panel = load_panel(DEFAULT)
    (tmp_path / "own.mat").write_bytes(export_matrices(panel)["rail_straight.mat"])
    given = panel.with_overrides({"rail.straight.matrices": str(tmp_path / "own.mat")})
    moved = gauge_under_wheel(given, lateral=(20e3, 40e3), foreign_object=TRAPPED)
    np.testing.assert_allclose(moved["gauge"], found()["gauge"], rtol=0, atol=2e-6)


def test_all_that_is_not_allowed_is_said_at_once() -> None:
    with pytest.raises(ResponseError) as error:
        gauge_under_wheel(
            load_panel("sb1"), lateral=-5e3, vertical=np.nan, rail="x", step=1.0, course="up"
        )
    text = str(error.value)
    for words in (
        *("has no [gauge]", "rail x: is no switch rail", "lateral = -5000 N", "vertical = nan N"),
        *("step = 1 m: must be 0.02 to 0.3 m", "course = 'up': allowed are facing"),
    ):
        assert words in text


def test_a_rail_that_is_never_closed_has_no_gauge() -> None:
    panel = load_panel(DEFAULT)
    still = panel.model_copy(update={"movement": {}})
    with pytest.raises(ResponseError, match="rail curved is never closed: add a movement"):
        gauge_under_wheel(still, lateral=1e3, rail="curved")


def limits_file(folder: Path, text: str) -> Path:
    path = folder / "limits.toml"
    path.write_text(text, encoding="utf-8")
    return path


CLASS = '[[class]]\nup_to = "{}"\nnarrowing = "{}"\n'
HEAD = 'schema_version = 1\nname = "own"\n'
REMEDY = 'give a table [[class]] for each, with up_to = "80 km/h", the line speed up to which'


def test_limits_of_the_library_and_of_a_file(tmp_path: Path) -> None:
    known = load_gauge_limits("immediate-action")
    assert [round(3.6 * item.up_to) for item in known.classes] == [120, 160, 230]
    text = HEAD + CLASS.format("40 km/h", "12 mm") + CLASS.format("80 km/h", "10 mm")
    own = load_gauge_limits(limits_file(tmp_path, text))
    assert 3.6 * own.highest_speed(0.011) == pytest.approx(40)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD, f"class: is missing; {REMEDY}"),
        (HEAD + "class = []\n", f"class = []: needs at least 1, has 0; {REMEDY}"),
        (CLASS.format("80 km/h", "9 mm"), "schema_version: is missing"),
        (HEAD + CLASS.format("80 mm", "9 mm"), 'class.1.up_to = "80 mm"'),
        (HEAD + CLASS.format("80 km/h", "-9 mm"), "must be more than 0"),
        (HEAD + 2 * CLASS.format("80 km/h", "9 mm"), "the speeds `up_to` must rise"),
        (HEAD + "clas = 1\n" + CLASS.format("80 km/h", "9 mm"), "clas: unknown key"),
        (HEAD + '[[class]]\nup_to = "80 km/h"\n', "class.1.narrowing: is missing"),
    ],
)
def test_faulty_limits_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(PanelError) as error:
        load_gauge_limits(limits_file(tmp_path, text))
    assert words in str(error.value)


def test_a_line_speed_takes_its_class_of_the_panels_limits(tmp_path: Path) -> None:
    """The classes become part of the panel: it does not need the file any more."""
    panel = load_panel("uic60-760-1-15")
    for speed, least in (("120 km/h", 1.426), ("121 km/h", 1.427), ("230 km/h", 1.428)):
        assert panel.with_settings([f"gauge.line_speed={speed}"]).gauge_limit == least
    assert panel.with_overrides({"gauge.line_speed": 20.0}).gauge_limit == 1.426
    text = HEAD + CLASS.format("40 km/h", "12 mm") + CLASS.format("80 km/h", "10 mm")
    file = limits_file(tmp_path, text)
    own = panel.with_settings([f"gauge.limits={file}", "gauge.line_speed=50 km/h"])
    assert panel.with_settings([f"gauge.limits={file}"]).hash != panel.hash
    file.unlink()
    assert own.with_overrides({"chair.friction_coefficient": 0.3}).gauge_limit == 1.425
    assert panel.with_overrides({"gauge.limits": "immediate-action"}).hash == panel.hash


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("gauge.line_speed=300 km/h", "no class of gauge.limits holds at it; they end at 230 km/h"),
        ("gauge.limits=none.toml", 'gauge.limits = "none.toml": .*no such file'),
        ("gauge.limits=immediat", "nearest is 'immediate-action'"),
    ],
)
def test_a_panel_refuses_limits_that_do_not_hold(text: str, words: str) -> None:
    panel = load_panel("uic60-760-1-15")
    with pytest.raises(PanelError, match=words) as error:
        panel.with_settings([text])
    assert len(error.value.problems) == 1


def test_classes_in_the_panel_must_rise() -> None:
    panel = load_panel("uic60-760-1-15")
    classes = [{"up_to": 30.0, "narrowing": 9e-3}, {"up_to": 20.0, "narrowing": 8e-3}]
    with pytest.raises(PanelError, match="must rise, but 20 m/s comes after 30 m/s"):
        panel.with_overrides({"gauge.limits": classes})


def run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["gauge", *words])
    text = f"{done.exception}" if done.exception else ""
    return done.exit_code, done.stdout, text


def test_the_command_prints_the_three_numbers_and_the_speed() -> None:
    code, text, _ = run("--object", "13mm@sleeper6", "--lateral", "40 kN", "--vertical", "0 kN")
    assert code == 0
    assert "at rest         1422.1 mm at sleeper 6" in text
    assert "1424.9 at sleeper 6         1418.0 at x = 2.55 m, wheel at 4.2 m" in text
    assert "TOO NARROW: 1418.0 mm, at least 1427 mm required" in text
    assert "allowed at no speed, by immediate action: 1426 mm up to 120 km/h" in text


def test_a_level_at_rest_is_said_not_to_count() -> None:
    """A wheel rolls slowly: friction has its level in motion whatever the panel says of rest."""
    common = ("--lateral", "5 kN", "--vertical", "0 kN")
    ratio, rise = "chair.static_ratio=1.2", "chair.friction_rise=1 s/m"
    kept, course = "that at rest, up to {} times as high, and ", "its course over speed does not"
    for setting, said in (
        (ratio, kept.format(1.2) + course),
        ("chair.friction_state='dry'", kept.format(1.3) + course),
        (rise, f"in motion: {course}"),
    ):
        code, text, _ = run(*common, "--set", setting)
        assert (code, text.count("friction  ")) == (0, 1)
        assert said in text
    assert "friction" not in run(*common)[1]
    told, silent = (json.loads(run(*common, "--json", *more)[1]) for more in (("--set", ratio), ()))
    assert kept.format(1.2) in told["friction_remark"]
    assert silent["friction_remark"] is None
    assert told["loads"] == silent["loads"]


def test_strict_json_dataset_and_figure(tmp_path: Path) -> None:
    out, plot = tmp_path / "gauge.nc", tmp_path / "gauge.svg"
    common = ("--lateral", "5 kN", "--vertical", "0 kN", "--set", "gauge.limit=5 mm")
    code, text, _ = run(*common, "--json", "--strict", "-o", str(out), "--plot", str(plot))
    record = json.loads(text)
    assert code == 1
    assert record["units"]["at_wheel"] == "m"
    assert record["loads"][0]["at_rest"] == pytest.approx(1.4286, abs=1e-4)
    assert record["up_to"] == pytest.approx(230 / 3.6)
    assert plot.stat().st_size > 1000
    read = turnout.open_response(out)
    assert read.attrs["gauge_limit"] == 1.43
    assert "Gauge too narrow" in repr(read.turnout.summary())
    sheet = gauge_sheet(read)
    assert sheet.rows[0].levels[0].at == pytest.approx(-5.0)
    assert [line.label for line in sheet.rows[1].lines] == ["Y 5 kN, Q 0 kN"]
    page = tmp_path / "gauge.html"
    done = CliRunner().invoke(app, ["report", str(out), "-o", str(page)])
    assert done.exit_code == 0, done.output
    assert "Track gauge under a wheel" in page.read_text(encoding="utf-8")


def test_no_equilibrium_is_told_by_the_exit_code() -> None:
    """Feet that can neither stick nor slip, in a throw with more friction than steel has."""
    code, text, _ = run("--lateral", "5 kN", "--set", "chair.friction_coefficient=2")
    assert (code, text) == (3, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--lateral", "-5 kN"),
            "--lateral -5 kN: a force towards the stock rail must be",
        ),
        (("--vertical", "-1 kN"), "--vertical -1 kN: a force downwards must be at least 0"),
        (("--lateral", "5"), "--lateral 5: has no unit"),
        (("--limits", "none"), "no library table of limits is called 'none'"),
    ],
)
def test_bad_input_is_one_message(words: tuple[str, ...], said: str) -> None:
    code, _, text = run(*words)
    assert code != 0
    assert said in text


def test_limits_of_a_file_decide(tmp_path: Path) -> None:
    limits = tmp_path / "own.toml"
    for narrowing, word, ends in (("2 mm", "TOO NARROW", 1), ("30 mm", "at least 1405 mm", 0)):
        limits.write_text(
            'schema_version = 1\nname = "own"\n'
            f'[[class]]\nup_to = "80 km/h"\nnarrowing = "{narrowing}"\n'
        )
        code, out, _ = run("--limits", str(limits), "--strict", "--step", "0.3 m")
        assert (code, word in out) == (ends, True), out
    faster = ("--set", "gauge.line_speed='200 km/h'", "--limits", str(limits), "--strict")
    code, _, said = run(*faster)
    assert code != 0
    assert "no class of gauge.limits holds at it" in said


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"lateral": []}, "lateral = none"),
        ({"lateral": 1e9}, "at most 500 kN"),
        ({"lateral": 5e3, "step": 1e-3}, "must be 0.02 to 0.3 m"),
        ({"lateral": 5e3, "offset": 10.0}, "within 0.1 m of the edge"),
    ],
)
def test_loads_beyond_any_wheel_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ResponseError, match=re.escape(said)):
        gauge_under_wheel(load_panel("uic60-760-1-15"), **given)
