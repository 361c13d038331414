"""Every figure that the page shows lies within its limits, and every rung can be drawn."""

import pytest
from benchmarks.studies.battery import RUNGS, Rung
from benchmarks.studies.verification_page import DOCS
from matplotlib.figure import Figure


@pytest.mark.parametrize("rung", RUNGS, ids=lambda rung: rung.name)
def test_found_values_lie_within_their_tolerances(rung: Rung) -> None:
    checks = rung.checks()
    assert checks
    for check in checks:
        assert check.passed, str(check)
        assert check.low < check.high


@pytest.mark.parametrize("rung", RUNGS, ids=lambda rung: rung.name)
def test_figures_show_what_was_found(rung: Rung) -> None:
    figure = rung.figure()
    assert isinstance(figure, Figure)
    for axes in figure.axes:
        assert axes.get_xlabel()
        assert axes.get_ylabel()
        assert axes.lines


def test_the_page_has_every_rung() -> None:
    page = (DOCS / "evidence" / "verification.md").read_text(encoding="utf-8")
    for rung in RUNGS:
        assert f"### {rung.title}" in page
        assert (DOCS / "figures" / f"verification_{rung.name}.png").is_file()
        for check in rung.checks():
            assert f"| {check.what} |" in page
