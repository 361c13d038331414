"""Throws that commands make to look at a panel, with their progress."""

from typing import TYPE_CHECKING

from turnout.cli.show import Thrown

if TYPE_CHECKING:
    import xarray as xr

    from turnout.panel.load import LoadedPanel
    from turnout.study.test_piece import PieceLimit, PieceResult


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

    results = []
    for drive, size in panel.gap_limits().items():
        text = f"throwing {panel.name} on {1e3 * size:g} mm at drive {drive}"
        with watched(text) as watch:
            try:
                results.append(check_piece(panel, drive, report=watch.report))
            except PanelError as error:
                results.append(PieceResult.without(drive, size, "; ".join(error.problems)))
    return results


def least_pieces(panel: "LoadedPanel") -> "list[PieceLimit]":
    """Find the least piece at each drive that keeps a panel from locking."""
    from turnout.cli.watch import watched
    from turnout.errors import PanelError
    from turnout.study.test_piece import PieceLimit, least_piece

    found = []
    for drive in panel.drive:
        with watched(f"finding the piece that {panel.name} refuses at drive {drive}") as watch:
            try:
                found.append(least_piece(panel, drive, report=watch.report))
            except PanelError as error:
                nothing = float("nan")
                fault = "; ".join(error.problems)
                found.append(PieceLimit(drive, nothing, "", nothing, fault))
    return found


def thrown(panel: "LoadedPanel") -> Thrown:
    """Throw a panel without an object, then on test pieces."""
    return Thrown(thrown_alone(panel), thrown_on_pieces(panel), least_pieces(panel))
