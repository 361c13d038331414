"""Throws that commands make to look at a panel, with their progress."""

from typing import TYPE_CHECKING

from turnout.cli.show import Thrown

if TYPE_CHECKING:
    import xarray as xr

    from turnout.panel.load import LoadedPanel
    from turnout.study.test_piece import PieceResult


def thrown_alone(panel: "LoadedPanel", *, quiet: bool = False) -> "xr.Dataset":
    """Throw a panel without a foreign object; a run that ends early comes back as it is."""
    from turnout.cli.watch import watched
    from turnout.response.simulate import simulate

    with watched(f"throwing {panel.name}", quiet=quiet) as watch:
        return simulate(panel, throw=False, report=watch.report)


def thrown_on_pieces(panel: "LoadedPanel") -> "list[PieceResult]":
    """Throw a panel on a test piece at each of its drives."""
    from turnout.cli.watch import watched
    from turnout.errors import PanelError
    from turnout.study.test_piece import PieceResult, check_piece

    size = panel.lock.gap_limit
    results = []
    for drive in panel.drive:
        text = f"throwing {panel.name} on {1e3 * size:g} mm at drive {drive}"
        with watched(text) as watch:
            try:
                results.append(check_piece(panel, drive, report=watch.report))
            except PanelError as error:
                results.append(PieceResult.without(drive, size, "; ".join(error.problems)))
    return results


def thrown(panel: "LoadedPanel") -> Thrown:
    """Throw a panel without an object, then on each test piece."""
    return Thrown(thrown_alone(panel), thrown_on_pieces(panel))
