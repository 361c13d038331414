"""Planing of one outline beside another, on bars where the answer is seen at once."""

from dataclasses import replace

import numpy as np
import pytest

from turnout.beam.outline import make_outline, ring_area
from turnout.beam.rail_outlines import load_rail_outline, outline_names, planed_rail
from turnout.beam.section_taper import Planing, planed_section, planed_sections
from turnout.core.errors import MechanicsError

BAR = make_outline([[-0.03, 0], [0.03, 0], [0.03, 0.1], [-0.03, 0.1]])
# A stock rail with a head that overhangs its web by 20 mm, at 60 mm and above.
TEE = make_outline(
    np.array([[-10, 0], [10, 0], [10, 60], [30, 60], [30, 100], [-30, 100], [-30, 60], [-10, 60]])
    * 1e-3
)
PLANING = Planing(
    running_edge_switch=0.03,
    running_edge_stock=0.03,
    seat_height=0.0,
    clearance=0.002,
    lowering_offset=np.array([0.0, 0.02]),
    lowering=np.array([0.01, 0.0]),
)


def test_all_the_far_side_of_the_stock_rail_goes() -> None:
    cut = planed_section(BAR, TEE, running_edge_offset=0.03, planing=PLANING)
    # Right of the head 28 mm remain over 42 mm, right of the web 48 mm over 58 mm.
    assert ring_area(cut.outline.points) == pytest.approx(0.028 * 0.042 + 0.048 * 0.058, rel=1e-4)
    assert cut.outline.points.max() == pytest.approx(0.1, abs=1e-9)
    assert cut.outline.points[:, 0].max() == pytest.approx(0.0, abs=1e-9)
    assert cut.dropped_areas == ()
    assert cut.stock_rail.points[:, 0].max() == pytest.approx(-0.03, abs=1e-12)


def test_lowering_is_linear_between_its_rows_and_counts_from_the_stock_rail() -> None:
    higher = replace(PLANING, seat_height=0.005)
    for planing, top in ((PLANING, 0.095), (higher, 0.090)):
        cut = planed_section(BAR, BAR, running_edge_offset=0.01, planing=planing)
        assert cut.outline.points[:, 1].max() == pytest.approx(top, abs=1e-9)


def test_far_apart_nothing_is_planed() -> None:
    cut = planed_section(BAR, TEE, running_edge_offset=0.1, planing=PLANING)
    assert ring_area(cut.outline.points) == pytest.approx(0.006, rel=1e-9)


def test_smaller_pieces_are_dropped_and_reported() -> None:
    # Two flanges on a web that the stock rail takes away.
    bracket = [[-30, 0], [30, 0], [30, 20], [-10, 20], [-10, 80], [30, 80], [30, 90], [-30, 90]]
    cut = planed_section(
        make_outline(np.array(bracket) * 1e-3), BAR, running_edge_offset=0.03, planing=PLANING
    )
    assert ring_area(cut.outline.points) == pytest.approx(0.028 * 0.020, rel=1e-4)
    assert cut.dropped_areas == pytest.approx((0.028 * 0.010,), rel=1e-4)


def test_thin_tongue_is_left_out_and_reported() -> None:
    options = {"running_edge_offset": 0.004, "planing": PLANING}
    whole = planed_section(BAR, TEE, **options)
    trimmed = planed_section(
        BAR, TEE, running_edge_offset=0.004, planing=replace(PLANING, least_thickness=0.003)
    )
    assert whole.thin_area == 0.0
    # The 2 mm beside the head go, from where the head begins less the clearance to the lowered top.
    assert trimmed.thin_area == pytest.approx(0.002 * (0.092 - 0.058), rel=1e-3)
    assert trimmed.outline.points[:, 1].max() == pytest.approx(0.058, abs=1e-6)


def test_nothing_left_is_an_error() -> None:
    with pytest.raises(MechanicsError, match="nothing of the switch rail is left"):
        planed_section(BAR, BAR, running_edge_offset=-0.07, planing=PLANING)
    thin = replace(PLANING, least_thickness=0.08)
    with pytest.raises(MechanicsError, match=r"thinner than 80 mm"):
        planed_section(BAR, TEE, running_edge_offset=0.03, planing=thin)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"clearance": -1e-3}, "clearance must not be negative"),
        ({"lowering": np.array([0.0, -1e-3])}, "lowering must not be negative"),
        ({"lowering": np.zeros(3)}, "same length"),
        ({"lowering_offset": np.array([0.02, 0.0])}, "must increase"),
    ],
)
def test_bad_planing_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(MechanicsError, match=words):
        replace(PLANING, **change)


def test_area_grows_with_the_offset() -> None:
    cuts = planed_rail("60E1A1", running_edge_offsets=np.linspace(0.0, 0.09, 31))
    areas = [ring_area(cut.outline.points) for cut in cuts]
    assert np.all(np.diff(areas) > -1e-9)
    assert all(cut.outline.points[:, 0].max() < 0.0441 for cut in cuts)


def test_library_has_both_rails() -> None:
    assert outline_names() == ["60E1", "60E1A1"]
    rail = load_rail_outline("60E1")
    assert np.ptp(rail.outline.points, axis=0).tolist() == pytest.approx([0.150, 0.172])
    assert rail.planing == {}


def test_unknown_rail_and_unplaned_rail_are_refused() -> None:
    with pytest.raises(MechanicsError, match="no outline 'UIC54'; there are 60E1, 60E1A1"):
        load_rail_outline("UIC54")
    with pytest.raises(MechanicsError, match="does not say how it is planed"):
        planed_rail("60E1", running_edge_offsets=[0.0])


def test_several_cuts_are_the_single_ones() -> None:
    both = planed_sections(BAR, TEE, running_edge_offsets=[0.01, 0.03], planing=PLANING)
    single = planed_section(BAR, TEE, running_edge_offset=0.03, planing=PLANING)
    np.testing.assert_array_equal(both[1].outline.points, single.outline.points)
