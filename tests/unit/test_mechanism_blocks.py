"""Rails that only laws join are solved apart; those that stand together are not."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import load_panel
from turnout.solver.condense import split_blocks


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return build_mechanism(load_panel("sb2"))


def base_of(mechanism: Mechanism, law: int) -> Mechanism:
    """Let the linear system hold a law that joins two rails."""
    base = mechanism.laws.base_segment.copy()
    base[law] = 0
    return replace(mechanism, laws=mechanism.laws._replace(base_segment=base))


def test_every_rail_is_a_block_and_what_joins_two_has_an_end_in_each(mechanism: Mechanism) -> None:
    link = mechanism.index.link[next(iter(mechanism.index.link))]
    loose = mechanism.laws.base_segment.copy()
    loose[list(mechanism.index.link.values())] = -1
    blocks = split_blocks(mechanism, mechanism.laws._replace(base_segment=loose))
    assert len(blocks) == len(mechanism.rails)
    ends = np.concatenate([block.rows for block in blocks])
    row = mechanism.laws.row[link]
    assert np.count_nonzero(ends == row) == 2
    assert set(ends.tolist()) == set(range(mechanism.rows.shape[0]))


def test_a_link_that_the_linear_system_holds_makes_one_block_of_two_rails(
    mechanism: Mechanism,
) -> None:
    held = base_of(mechanism, next(iter(mechanism.index.link.values())))
    assert len(split_blocks(held, held.laws)) == len(mechanism.rails) - 1


def test_rows_that_may_be_written_to_are_looked_at_each_time(mechanism: Mechanism) -> None:
    own = replace(mechanism, core=mechanism.core.copy())
    before = split_blocks(own, own.laws)
    as_shared = split_blocks(mechanism, mechanism.laws)
    assert [b.rows.tolist() for b in before] == [b.rows.tolist() for b in as_shared]
    link = own.laws.row[next(iter(own.index.link.values()))]
    rail = own.rails[0]
    own.rows[link, rail.first : rail.first + rail.count] = 0.0
    loose = own.laws._replace(base_segment=np.full_like(own.laws.base_segment, -1))
    ends = np.concatenate([block.rows for block in split_blocks(own, loose)])
    assert np.count_nonzero(ends == link) == 1
