"""Channels that are rows over time are the histories that the solver left."""

import numpy as np
import pytest

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.dataset import channel_rows, response_channels
from turnout.throw.recovery import block_of, recover_motion
from turnout.throw.save import Save
from turnout.throw.signals import drive_signals, energy_scale, object_channels
from turnout.throw.simulate import Solved, simulate, solve

PANEL = load_panel("uic60-760-1-15")
OBJECTS = (ForeignObject(0.02, "sleeper 6"), ForeignObject(0.05, "sleeper 9"))


@pytest.fixture(scope="module")
def solved() -> Solved:
    """A quick throw over two objects."""
    return solve(PANEL, foreign_object=OBJECTS, scheme=Scheme.of("quick"))


def test_forces_are_those_of_the_histories(solved: Solved) -> None:
    history, index = solved.history, solved.mechanism.index
    found = response_channels(PANEL, solved.mechanism, history, save=Save())
    expected = drive_signals(PANEL, solved.mechanism, history)
    expected |= object_channels(index, history.forces([*index.object.values()]).T)
    for name, (dims, values) in expected.items():
        assert found[name][0] == dims
        np.testing.assert_array_equal(found[name][1], values, err_msg=name)
    assert np.abs(found["single_object_force"][1]).max() > 1e3
    columns = [index.link[name] for name in PANEL.link]
    np.testing.assert_array_equal(found["link_force"][1], history.law_force[:, columns].T)
    normal, friction = found["chair_normal_force"][1], found["chair_friction_force"][1]
    for (rail, chair), laws in index.chair.items():
        place = list(PANEL.rail).index(rail), list(PANEL.chair).index(chair)
        np.testing.assert_array_equal(normal[place], history.law_force[:, laws].sum(axis=1))
        feet = history.friction_force[:, index.chair_friction[rail, chair]]
        np.testing.assert_array_equal(friction[place], 0.0 - feet.sum(axis=1))


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (("drive_force",), {"drive_force"}),
        (("object_force",), {"drive_force", "object"}),
        (("link_force", "locked"), {"drive_force", "link_force", "places"}),
        (("gap",), {"drive_force", "gap", "lateral_displacement"}),
    ],
)
def test_rows_that_are_not_wanted_are_not_written(
    solved: Solved, fields: tuple[str, ...], expected: set[str]
) -> None:
    motion = recover_motion(solved.mechanism, solved.history)
    rows = channel_rows(PANEL, solved.mechanism, motion, Save(fields=fields))
    assert set(rows) == expected


@pytest.mark.parametrize("interval", [None, 0.0013])
def test_the_energy_scale_is_that_of_the_instants_of_the_dataset(interval: float | None) -> None:
    scheme = Scheme.of("quick")
    if interval is not None:
        scheme = Scheme.of("quick", output_interval=interval)
    history = solve(PANEL, scheme=scheme).history
    expected = energy_scale(history.stored, history.ledger)
    dataset = simulate(PANEL, mode="quick", save=Save(interval=interval, fields=("drive_force",)))
    assert dataset.attrs["energy_scale"] == expected


def test_blocks_of_rails_are_found_again(solved: Solved) -> None:
    motion = recover_motion(solved.mechanism, solved.history)
    blocks = motion.condensed.parts
    for body in motion.rails.values():
        number, first = block_of(blocks, body)
        assert block_of(blocks, body) == block_of(list(blocks), body) == (number, first)
        assert blocks[number].block.coordinates[first] == body.first


def test_what_is_kept_is_what_keeps_says() -> None:
    channels = dict.fromkeys(("drive_force", "gap", "fastening_force"), 1)
    for save in (Save(), Save(fields=("gap",)), Save(also=("fastening_force",))):
        assert list(save.kept(channels)) == [name for name in channels if save.keeps(name)]
