"""Studies: scenarios by their number, in any order, with what they change and trap."""

import pickle
from pathlib import Path

import pytest

from turnout.calibration.load_study import load_study, study_from_file, study_names
from turnout.core.json_files import to_plain
from turnout.core.toml import parse_toml
from turnout.panel.foreign_object import ForeignObject
from turnout.study.study import Study

HEAD = 'schema_version = 1\nname = "test"\npanel = "sb2"\nseed = 7\n'
DRAWN = """
[[variable]]
key = "chair.friction_coefficient"
distribution = "truncated normal"
mean = 0.3
standard_deviation = 0.1
minimum = 0.05
maximum = 0.6

[[variable]]
key = "drive.2.stiffness"
distribution = "uniform"
minimum = "500 kN/m"
maximum = "900 kN/m"
"""


def study(text: str) -> Study:
    return study_from_file(parse_toml(HEAD + text, source="test", folder=Path.cwd()))


def test_the_published_campaign_has_thirteen_chains_of_growing_sizes() -> None:
    campaign = load_study("paper-campaign")
    assert campaign.count == 143
    assert [len(chain) for chain in campaign.chains] == [11] * 13
    for chain in campaign.chains:
        scenarios = [campaign.scenario(index) for index in chain]
        sizes = [item.inputs["object.size"] for item in scenarios]
        assert sizes == sorted(sizes)
        assert len({item.inputs["object.at"] for item in scenarios}) == 1
        assert scenarios[0].foreign_objects == ()
        assert scenarios[3].foreign_objects == (
            ForeignObject(0.013, str(scenarios[3].inputs["object.at"])),
        )
    assert campaign.rule is not None
    assert campaign.rule.stops({"slipped": True, "object.size": 0.005})
    assert not campaign.rule.stops({"slipped": False, "object.size": 0.005})


@pytest.mark.parametrize("method", ["random", "latin hypercube", "sobol", "saltelli"])
def test_a_scenario_is_the_same_whatever_was_asked_for_before(method: str) -> None:
    text = DRAWN + f'[sampling]\nmethod = "{method}"\ncount = 16\n'
    forwards, backwards = study(text), pickle.loads(pickle.dumps(study(text)))
    ahead = [forwards.scenario(index) for index in range(forwards.count)]
    back = [backwards.scenario(index) for index in reversed(range(backwards.count))]
    assert ahead == back[::-1]
    assert len({item.inputs["drive.2.stiffness"] for item in ahead}) > 8
    assert len({item.seed for item in ahead}) == forwards.count
    assert forwards.digest == backwards.digest


@pytest.mark.parametrize("name", ["detection-reference", "plausible-panels", "paper-campaign"])
def test_scenarios_drawn_together_are_those_drawn_one_by_one(name: str) -> None:
    given = load_study(name)
    numbers = [7, *range(20), given.count - 1]
    assert given.scenarios_of(numbers) == [given.scenario(number) for number in numbers]
    with pytest.raises(IndexError, match="counted from 0"):
        given.scenarios_of([0, given.count])


def test_a_larger_random_study_begins_like_a_smaller_one() -> None:
    few, many = (study(DRAWN + f"[sampling]\ncount = {count}\n") for count in (5, 50))
    assert [few.scenario(i) for i in range(5)] == [many.scenario(i) for i in range(5)]


def test_every_library_study_loads() -> None:
    for name in study_names():
        assert load_study(name).count > 0


def test_a_design_says_what_an_analysis_must_know() -> None:
    design = study(DRAWN + "[sampling]\ncount = 3\n").design.summary()
    assert to_plain(design) == {
        "method": "random",
        "draws": 3,
        "states": 3,
        "cells": 1,
        "drawn": ["chair.friction_coefficient", "drive.2.stiffness"],
        "axes": [],
    }


def test_the_file_of_the_documentation_is_a_study(pytestconfig: pytest.Config) -> None:
    text = (pytestconfig.rootpath / "docs/use/sweep-study.md").read_text(encoding="utf-8")
    first = text.split("```toml")[1].split("```")[0]
    shown = study_from_file(parse_toml(first, source="documentation", folder=Path.cwd()))
    assert shown.count == 13 * 4 * 200
    assert [len(chain) for chain in shown.chains[:2]] == [4, 4]


def test_temperature_multiplies_what_was_drawn_for_friction() -> None:
    text = DRAWN + (
        '[[variable]]\nkey = "temperature"\nvalues = ["20 degC", "-5 degC"]\n'
        '[temperature_law]\nreference = "20 degC"\ncoefficient = "-0.01 1/K"\n'
        "[sampling]\ncount = 2\n"
    )
    warm, cold = (study(text).scenario(index) for index in (2, 3))
    assert warm.inputs["chair.friction_coefficient"] == cold.inputs["chair.friction_coefficient"]
    key = "chair.friction_coefficient"
    assert cold.overrides[key] == pytest.approx(1.25 * float(warm.overrides[key]))
    assert warm.condition == cold.condition == "state 1"


def test_a_factor_multiplies_what_a_field_has_drawn_for_each_chair() -> None:
    text = (
        '[[field]]\nkey = "chair.friction_coefficient"\ndistribution = "uniform"\n'
        'minimum = 0.1\nmaximum = 0.3\ncorrelation_length = "2 m"\n'
        '[[variable]]\nkey = "chair.friction_coefficient"\nfactor = true\nvalues = [1.0, 2.0]\n'
        "[sampling]\ncount = 3\n"
    )
    made = study(text)
    once, twice = made.scenario(4), made.scenario(5)
    assert len(once.overrides) == len(made.panel.chair)
    assert len(set(once.overrides.values())) == len(made.panel.chair)
    for key, value in once.overrides.items():
        assert twice.overrides[key] == pytest.approx(2.0 * float(value))
    assert once.inputs["chair.friction_coefficient.mean"] == pytest.approx(
        sum(float(value) for value in once.overrides.values()) / len(once.overrides)
    )


def test_an_absent_object_has_no_size_in_the_data() -> None:
    text = (
        '[[variable]]\nkey = "object.present"\nvalues = [true, false]\n'
        '[[variable]]\nkey = "object.size"\nvalues = ["13 mm"]\n'
        '[[variable]]\nkey = "object.x"\nvalues = ["3.6 m"]\n'
    )
    there, gone = study(text).scenarios()
    assert there.foreign_objects == (ForeignObject(0.013, "x = 3.6 m"),)
    assert (gone.foreign_objects, gone.inputs["object.size"]) == ((), 0.0)


def test_cases_side_by_side_are_thrown_in_their_order() -> None:
    text = (
        '[[together]]\nkeys = ["object.at", "object.size"]\n'
        'rows = [["sleeper 6", "13 mm"], ["drive 2", "5 mm"]]\n'
    )
    found = [item.foreign_objects[0] for item in study(text).scenarios()]
    assert found == [ForeignObject(0.013, "sleeper 6"), ForeignObject(0.005, "drive 2")]


def test_the_digest_changes_with_what_determines_results_and_with_nothing_else() -> None:
    base = study(DRAWN + "[sampling]\ncount = 4\n").digest
    assert study(DRAWN.replace("900 kN/m", "0.9 MN/m") + "[sampling]\ncount = 4\n").digest == base
    for changed in (
        DRAWN.replace("900", "901") + "[sampling]\ncount = 4\n",
        DRAWN + "[sampling]\ncount = 5\n",
        DRAWN + '[sampling]\ncount = 4\n[scheme]\nstep = "2 ms"\n',
        DRAWN + '[sampling]\ncount = 4\n[output]\nrate = "50 Hz"\n',
        DRAWN + '[sampling]\ncount = 4\n[set]\n"chair.damping" = "30 kN s/m"\n',
    ):
        assert study(changed).digest != base
