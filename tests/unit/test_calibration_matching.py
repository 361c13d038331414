"""History matching: emulators, regions, facts files, waves that resume, and what comes of them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from turnout.calibration.load_study import (
    case_panel,
    load_panel_or_case,
    load_study,
    study_from_file,
)
from turnout.calibration.matching import match
from turnout.calibration.matching.facts import (
    OF_MACHINES,
    PACKAGE,
    Facts,
    Sum,
    Term,
    load_facts,
    read_facts,
)
from turnout.calibration.matching.match import (
    Emulation,
    Matching,
    Thrower,
    TriedPanel,
    farthest_points,
    fit_emulator,
    holds,
    in_order,
    is_valid,
    match_panel,
    panel_at,
    plausible_points,
    thrower_at,
    try_panel,
    with_machines,
)
from turnout.calibration.matching.measures import MEASURES
from turnout.calibration.matching.survey import (
    Survey,
    accepted_study,
    measurement_gains,
    ranges,
)
from turnout.cli.main import app
from turnout.core.errors import FileError, StudyError
from turnout.core.library import text_in_library
from turnout.core.progress import Progress
from turnout.core.toml import parse_toml
from turnout.core.workers import Workers
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import as_written, load_panel
from turnout.study.study import Study
from turnout.study.variable import LABEL
from turnout.throw.simulate import simulate

TOY = """
schema_version = 1
name = "toy"
panel = "sb1"
seed = 4

[[parameter]]
name = "friction"
keys = ["chair.friction_coefficient"]
minimum = 0.1  # assumption: greased
maximum = 0.6

[[parameter]]
name = "stiffness"
keys = ["drive.1.stiffness"]
minimum = "300 kN/m"  # assumption: soft
maximum = "1200 kN/m"
scale = "log"

[[parameter]]
name = "chairs"
keys = ["chair.x"]
apply = "add"
minimum = "0 m"  # assumption: in place
maximum = "1 mm"

[[fact]]
name = "effort"
measure = "plateau force"
of = "1"
least = "600 N"
most = "900 N"

[[fact]]
name = "slower"
measure = "plateau force"
of = "1"
terms = [{}, { set = { "chair.friction_coefficient" = 0.0 }, factor = -1.0 }]
least = "0 N"
late = true

[[measurement]]
name = "friction itself"
parameter = "friction"
precision = 0.01  # assumption: tribometer

[[measurement]]
name = "end force"
measure = "end force"
of = "1"
precision = "5 kN"  # assumption: a guess

[[answer]]
name = "end gap"
measure = "end gap"
of = "1"
"""


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Facts:
    monkeypatch.setattr(match, "FIRST_WAVE", 30)
    monkeypatch.setattr(match, "WAVE", 6)
    return read_facts(parse_toml(TOY, source="toy"))


def test_an_emulator_recovers_a_quadratic() -> None:
    rng = np.random.default_rng(1)
    points = rng.random((60, 3))
    z = 2.0 * points - 1.0
    values = 3.0 + z[:, 0] - 2.0 * z[:, 1] * z[:, 2]
    found = fit_emulator(points, values, rng=rng)
    assert found[1] < 0.02
    fact = Sum(name="f", terms=(), unit="", least=2.0, most=4.0)
    inside = Emulation.of([found], [fact]).implausibility(points) <= 0.0
    assert (inside == ((values >= 2.0) & (values <= 4.0))).mean() > 0.95


def test_plausible_points_fill_a_small_region_and_say_how_small() -> None:
    """A corner of 0.05 by 0.05: 1/400 of the square."""
    rng = np.random.default_rng(2)
    points = rng.random((80, 2))
    emulators = [fit_emulator(points, points[:, n], rng=rng) for n in range(2)]
    facts = [Sum(name=str(n), terms=(), unit="", most=0.05) for n in range(2)]
    emulation = Emulation.of(emulators, facts)
    found, share = plausible_points(
        emulation, 200, start=np.zeros((0, 2)), limit=0.0, rng=np.random.default_rng(3)
    )
    assert found.shape == (200, 2)
    assert found.max() < 0.06
    assert 0.015 < found.mean() < 0.035
    assert share == pytest.approx(0.0025, rel=0.3)


def test_farthest_points_spread() -> None:
    line = np.linspace(0.0, 1.0, 11)[:, np.newaxis]
    assert farthest_points(line, 3) == [5, 0, 10]


def test_the_useful_measurement_comes_first(toy: Facts) -> None:
    rng = np.random.default_rng(5)
    points = rng.random((60, 3))
    ranked = measurement_gains(
        toy,
        points,
        measured=np.column_stack([points[:, 0], rng.random(60)]),
        answers=points[:, :1],
    )
    assert [item.name for item in ranked] == ["friction itself", "end force"]
    assert ranked[0].answers < 0.05
    assert ranked[1].left > 0.99
    assert ranked[1].parameters == pytest.approx(1.0, abs=1e-3)


def test_ranges_in_the_scale_of_the_parameter(toy: Facts) -> None:
    found = ranges(toy, np.array([[0.0, 0.5, 0.0], [1.0, 0.5, 1.0], [0.5, 0.5, 0.5]]))
    assert found[0].median == pytest.approx(0.35)
    assert found[1].median == pytest.approx(np.sqrt(300e3 * 1200e3))
    assert found[1].left == pytest.approx(0.0, abs=1e-12)
    assert found[0].origin == "assumption: greased"


def test_a_matching_is_what_it_says_and_resumes_to_the_same(toy: Facts, tmp_path: Path) -> None:
    whole = match_panel(toy, tmp_path / "whole", count=8, most=120)
    assert len(whole.points) >= 8
    for item in whole.tried:
        if item.accepted:
            assert 600.0 <= item.values[0] <= 900.0
    assert try_panel(toy, whole.points[0]).accepted

    def interrupt(state: Progress) -> None:
        if state.done == 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        match_panel(toy, tmp_path / "cut", count=8, most=120, report=interrupt)
    with (tmp_path / "cut" / match.TRIED).open("a") as file:
        file.write('{"wave": 0, "sha')  # a line that was cut off
    with Workers(2, pool=partial(ThreadPoolExecutor, 1)) as workers:  # they come in any order
        again = match_panel(toy, tmp_path / "cut", count=8, most=120, workers=workers)
    assert [str(replace(item, seconds=0.0)) for item in again.tried] == [
        str(replace(item, seconds=0.0)) for item in whole.tried
    ]

    other = replace(toy, seed=5)
    with pytest.raises(FileError, match="holds another matching"):
        match_panel(other, tmp_path / "whole", count=10)

    path = tmp_path / "some.toml"
    path.write_text(accepted_study(toy, whole.points[:3], name="some"), encoding="utf-8")
    study = load_study(path)
    assert study.count == 3
    for number, point in enumerate(whole.points[:3]):
        panel, made = case_panel(path, number), panel_at(toy, point)
        assert panel.drive["1"].stiffness == pytest.approx(made.drive["1"].stiffness, rel=1e-5)
        assert panel.chair["3"].x == pytest.approx(made.chair["3"].x, rel=1e-5)


WRONG = [
    ('of = "1"\nleast', 'of = "7"\nleast', 'of = "7": is no drive'),
    ('measure = "plateau force"', 'measure = "plateu"', "nearest is 'plateau force'"),
    ('minimum = "300 kN/m"', "minimum = 300", "has no unit"),
    ('keys = ["chair.x"]', 'keys = ["chair.y"]', '"chair.y"'),
    ('least = "600 N"\nmost = "900 N"\n', "", "needs `least` or `most`"),
    ('parameter = "friction"', 'parameter = "fiction"', "nearest is 'friction'"),
    ('most = "900 N"', 'most = "900 N"\nobject = "13 mm@nowhere"', "nowhere"),
]


@pytest.mark.parametrize(("old", "new", "words"), WRONG, ids=[words for _, _, words in WRONG])
def test_a_wrong_file_is_refused_with_the_place(old: str, new: str, words: str) -> None:
    assert old in TOY
    with pytest.raises(StudyError) as error:
        read_facts(parse_toml(TOY.replace(old, new, 1), source="toy"))
    assert words in str(error.value)


def test_the_library_file_has_an_origin_for_every_range_and_fact() -> None:
    facts = load_facts("paper-facts")
    assert [item.name for item in facts.parameters if not item.origin] == []
    text = text_in_library(PACKAGE, "paper-facts", kind="facts file")
    named = [line for line in text.splitlines() if line.startswith("name = ")]
    assert len(named) > len(facts.facts) > 20


def table_of_measures() -> str:
    """What the page on matching must hold, word for word."""
    lines = ["| measure | of | unit | what it is |", "|---|---|---|---|"]
    for name, item in MEASURES.items():
        of = {"drive?": "drive, or the worst", "": "-"}.get(item.of, item.of)
        lines.append(f"| `{name}` | {of} | {item.dimension.unit or '-'} | {item.meaning} |")
    return "\n".join(lines)


def test_the_page_holds_the_measures() -> None:
    page = Path(__file__).parents[2] / "docs" / "use" / "match.md"
    assert table_of_measures() in page.read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("number", range(50))
def test_each_of_the_fifty_panels_meets_the_facts(number: int) -> None:
    """As they are written, with their own machines."""
    facts = load_facts("paper-facts")
    thrower = thrower_of_case(facts, load_study("plausible-panels"), number)
    missed = [fact.name for fact in facts.facts if not holds(fact, thrower.sum(fact))]
    assert missed == []


def test_panels_are_written_with_all_digits() -> None:
    """A friction of 0.1466 met a bound and was written as 0.147, which did not."""
    facts = load_facts("paper-facts")
    points = np.random.default_rng(0).random((8, len(facts.parameters)))
    points = np.array([point for point in points if is_valid(facts, point)])
    text = accepted_study(facts, points, name="chosen")
    study = study_from_file(parse_toml(text, source="chosen"))
    assert study.count == len(points) > 2
    for number, point in enumerate(points):
        read, made = thrower_of_case(facts, study, number), thrower_at(facts, point)
        assert read.panel.hash == made.panel.hash
        assert read.by_machines is not None
        assert made.by_machines is not None
        assert read.by_machines.hash == made.by_machines.hash


def test_the_machines_of_the_paper_begin_together() -> None:
    """The gear of Drive 2 takes the paper's 0.2 s; with those of its marker it is late twice."""
    facts = load_facts("paper-facts")
    assert facts.panel.movement["return"].extra_time == {"2": 0.2}
    assert with_machines(facts, facts.panel).movement["return"].extra_time == {}


def test_the_library_study_has_fifty_panels_that_meet_the_facts() -> None:
    study = load_study("plausible-panels")
    points = {
        str(sorted(study.scenario(number).overrides.items())) for number in range(study.count)
    }
    assert len(points) == study.count == 50
    facts = load_facts("paper-facts")
    early = [fact for fact in facts.facts if not fact.late][:8]
    thrower = Thrower(load_panel_or_case("plausible-panels:49"))
    for fact in early:
        assert holds(fact, thrower.sum(fact)), fact.name


DRIVEN = """
schema_version = 1
name = "driven"
panel = "uic60-760-1-15"

[machines]
"drive.1.machine" = "jea73"
"drive.2.machine" = "jea73-drive2"
"machine.jea73-drive2.clutch.torque" = "1.5 N m"

[[parameter]]
name = "efficiency"
keys = ["machine.jea73-drive2.gear.efficiency"]
minimum = 0.7
maximum = 0.9

[[fact]]
name = "current"
measure = "closing current"
of = "2"
grows = ["5 mm@sleeper 6", "13 mm@sleeper 6", "16 mm@sleeper 6"]
least = "0 A"

[[fact]]
name = "force"
measure = "end force"
of = "2"
least = "4 kN"
"""


def test_currents_are_those_of_machines_and_forces_those_of_the_panel() -> None:
    facts = read_facts(parse_toml(DRIVEN, source="driven"))
    assert [item.name for item in facts.facts[:2]] == [
        "current, 13 mm after 5 mm",
        "current, 16 mm after 13 mm",
    ]
    worn, sound = (try_panel(facts, np.array([share])) for share in (0.0, 1.0))
    assert worn.accepted
    assert worn.throws == 4
    assert worn.values[0] > 1.1 * sound.values[0] > 0.05  # less efficient: more current per newton
    assert worn.values[2] == sound.values[2]
    study = study_from_file(
        parse_toml(accepted_study(facts, np.array([[0.5]]), name="s"), source="s")
    )
    thrower = thrower_of_case(facts, study, 0)
    assert not thrower.panel.machine
    assert thrower.by_machines is not None
    assert thrower.by_machines.machine["jea73-drive2"].gear.efficiency == 0.8
    assert thrower.by_machines.machine["jea73-drive2"].clutch.torque == 1.5
    wrong = TOY.replace('"plateau force"', '"closing current"').replace(" N", " mA")
    with pytest.raises(StudyError, match="give .machines."):
        read_facts(parse_toml(wrong, source="toy"))


def test_cases_of_a_study_have_complements_too() -> None:
    """1 less the value beside keys that it multiplies, and of machines, whose values are labels."""
    shares = """
[[parameter]]
name = "share"
keys = ["drive.2.stiffness"]
complement = ["chair.friction_coefficient"]
apply = "multiply"
minimum = 0.5
maximum = 0.7

[[parameter]]
name = "gear"
keys = ["machine.jea73-drive2.gear.efficiency"]
complement = ["machine.jea73.gear.efficiency"]
minimum = 0.2
maximum = 0.4

[[fact]]"""
    text = DRIVEN[: DRIVEN.index("[[parameter]]")] + DRIVEN[DRIVEN.index("[[fact]]") :]
    facts = read_facts(parse_toml(text.replace("[[fact]]", shares, 1), source="driven"))
    point = np.array([0.5, 0.5])
    written = accepted_study(facts, point[np.newaxis], name="s")
    thrower = thrower_of_case(facts, study_from_file(parse_toml(written, source="s")), 0)
    assert thrower.panel.hash == panel_at(facts, point).hash
    assert thrower.panel.chair["5"].friction_coefficient == pytest.approx(0.4)
    gears = [thrower.by_machines.machine[name].gear for name in ("jea73", "jea73-drive2")]
    assert [gear.efficiency for gear in gears] == pytest.approx([0.7, 0.3])


def test_the_visible_size_is_the_least_that_changes_an_end_force() -> None:
    """A held force is the same whatever lies there until it is touched: the size follows it."""
    panel = load_panel("uic60-760-1-15")
    found = Thrower(panel).sum(sum_of("visible size", "sleeper 6"))
    forces = [
        Thrower(panel).sum(sum_of("end force", "2", item=text))
        for text in ("", f"{1e3 * (found - 2e-4):g} mm@sleeper 6", f"{1e3 * found:g} mm@sleeper 6")
    ]
    assert abs(forces[1] - forces[0]) < 50.0 < abs(forces[2] - forces[0])


def test_a_machine_at_its_limit_contact_locks_in_whatever_force_it_holds() -> None:
    bars = {"machine.lock.stroke": "14 mm", "machine.lock.force": "1 kN"}
    panel = load_panel("uic60-760-1-15-jea73").with_overrides(bars)
    trapped = ForeignObject("5 mm", "drive 2")
    thrown = simulate(panel, foreign_object=trapped, mode="quick")
    end = thrown.sel(drive="2").isel(time=-1)
    assert bool(end["locked"])
    assert float(end["drive_force"]) > float(end["saturation_force"])
    missed = Thrower(panel).sum(sum_of("lock excess", "", item="5 mm@drive 2"))
    assert missed == pytest.approx(float(end["end_gap"]) - 5e-3, abs=1e-9)


def thrower_of_case(facts: Facts, study: Study, number: int) -> Thrower:
    """Return the throws of a case of a study of accepted panels, and of the machines it labels."""
    scenario = study.scenario(number)
    panel = as_written(study.panel.with_overrides(scenario.overrides))
    if not facts.machines:
        return Thrower(panel)
    labels = {name.removeprefix(LABEL): value for name, value in scenario.inputs.items()}
    given = [f"{key}={value}" for key, value in labels.items() if key.startswith(OF_MACHINES)]
    machines = as_written(with_machines(facts, panel).with_settings(given))
    return Thrower(panel, by_machines=machines)


def sum_of(measure: str, of: str, *, item: str = "") -> Sum:
    return Sum(name=measure, terms=(Term(measure, of, item, (), 1.0),), unit="")


def test_costly_facts_are_tried_last() -> None:
    facts = load_facts("paper-facts")
    late = [facts.facts[number].name for number in in_order(facts, late=True)]
    assert late[0] == "g: warnings of panel check from a throw"
    assert late[-1] == "g: warnings of panel check about flutter"


def test_a_facts_file_in_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "toy.toml").write_text(TOY, encoding="utf-8")
    assert load_facts("~/toy.toml").name == "toy"


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "the study is not written: no panel meets all facts"),
        (1, "the study has 1 panel that meets all facts"),
        (2, "the study has 2 panels that meet all facts"),
    ],
)
def test_a_study_of_too_few_panels_says_how_many_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, toy: Facts, count: int, words: str
) -> None:
    points = np.linspace(0.3, 0.7, count)[:, None] * np.ones(len(toy.parameters))
    tried = tuple(
        TriedPanel(point=tuple(row), values=(), accepted=True, fault="", throws=1)
        for row in points.tolist()
    )
    found = Matching(facts=toy, tried=tried)
    monkeypatch.setattr(match, "match_panel", lambda *_, **__: found)
    none = np.zeros((count, 0))
    seen = Survey(points=points, measured=none, answers=none, throws=0)
    monkeypatch.setattr("turnout.calibration.matching.survey.survey", lambda *_, **__: seen)
    facts, study = tmp_path / "toy.toml", tmp_path / "few.toml"
    facts.write_text(TOY, encoding="utf-8")
    command = ["panel", "match", str(facts), "--study", str(study), "--workers", "1"]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert words in done.output
    assert study.exists() == (count > 0)


def test_the_command_refuses_a_facts_file_that_is_not_there(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["panel", "match", str(tmp_path / "none.toml")])
    assert isinstance(done.exception, FileError)
