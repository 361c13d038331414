"""Studies: scenarios by their number, in any order, with what they change and trap."""

import pickle
from pathlib import Path

import pytest

from turnout.files.toml import parse_toml
from turnout.panel.foreign_object import ForeignObject
from turnout.study.study import Study, load_study, study_from_file
from turnout.study.study_library import study_names

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


def test_a_larger_random_study_begins_like_a_smaller_one() -> None:
    few, many = (study(DRAWN + f"[sampling]\ncount = {count}\n") for count in (5, 50))
    assert [few.scenario(i) for i in range(5)] == [many.scenario(i) for i in range(5)]


def test_every_library_study_loads() -> None:
    for name in study_names():
        assert load_study(name).count > 0
