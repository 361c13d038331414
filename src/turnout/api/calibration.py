"""A panel fitted to a campaign, and the uncertainty of its values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from turnout.api.campaign import Campaign, checked_panel, dataset_of, throw_store_of
from turnout.calibration.advice import stated_shares
from turnout.calibration.calibrate import CalibrationProgress
from turnout.calibration.calibrate import calibrate as fit_stages
from turnout.calibration.result import Calibration, check_provenance
from turnout.calibration.result import load_calibration as read_record
from turnout.calibration.stages import default_plan
from turnout.core.errors import FileError
from turnout.core.html_table import html_table
from turnout.core.scheme import Mode, chosen_scheme
from turnout.core.value_text import value_text
from turnout.panel.load import LoadedPanel, library_names, load_panel

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

DEFAULT_PANEL = "uic60-760-1-15"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class CalibrationResult:
    """Result of a calibration; made by `calibrate` or `load_calibration`.

    Attributes
    ----------
    record : Calibration
        Everything that `save` writes.
    before : LoadedPanel
        The panel before calibration; its other values are unchanged.
    sweeps : tuple of xarray.Dataset
        The grid searches over the measurement, one a stage, for `turnout.figures.plot_grid_search`;
        a calibration that was read from its file has none.
    """

    record: Calibration
    before: LoadedPanel
    sweeps: tuple[xr.Dataset, ...] = ()

    @property
    def panel(self) -> LoadedPanel:
        """The panel with the calibrated values."""
        return self.record.apply(self.before)

    @property
    def table(self) -> "pd.DataFrame":
        """A row a parameter, with value, unit, standard deviation, 95 % interval, bounds, state."""
        import pandas as pd

        rows = [
            {
                "parameter": item.name,
                "value": item.value,
                "unit": item.unit,
                "deviation": item.deviation,
                "low": item.interval[0],
                "high": item.interval[1],
                "start": item.start,
                "lower_bound": item.lower,
                "upper_bound": item.upper,
                "state": item.state,
            }
            for item in self.record.parameters
        ]
        return pd.DataFrame(rows).set_index("parameter")

    @property
    def values(self) -> dict[str, float]:
        """Best value of each parameter, in SI."""
        return self.record.values

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """The 95 % interval of each parameter that was fitted, in SI."""
        return {item.name: item.interval for item in self.record.fitted}

    @property
    def trusted(self) -> bool:
        """True if the result is trustworthy; `reasons` lists the doubts if not."""
        return not self.record.distrust

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the result is not trustworthy, and checks to make."""
        return self.record.distrust

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, such as a panel that is not the calibrated one."""
        strange = check_provenance(self.record, self.before)[len(self.record.distrust) :]
        return (*self.record.warnings, *strange)

    @property
    def findings(self) -> tuple[str, ...]:
        """Parameters that the data identify, and those that they do not, as sentences."""
        return self.record.findings

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw each fitted value with its 95 % interval, relative to its start value.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; default a new figure.
        """
        from turnout.figures.calibration import plot_intervals

        fitted = self.record.fitted
        values = {
            "value": [item.value for item in fitted],
            "low": [item.interval[0] for item in fitted],
            "high": [item.interval[1] for item in fitted],
            "start": [item.start for item in fitted],
        }
        dataset = xr.Dataset(
            {name: ("parameter", row) for name, row in values.items()},
            {"parameter": [item.name for item in fitted]},
            {"title": f"Calibration of {self.record.panel} to {self.record.data}"},
        )
        return plot_intervals(dataset, ax=ax)

    def save(self, path: Path | str) -> None:
        """Write the record (TOML), which `load_calibration` and the command line read.

        Parameters
        ----------
        path : path-like
            File to write; an existing one is replaced.
        """
        self.record.save(path)

    def __repr__(self) -> str:
        """Return the calibrated values and their trustworthiness."""
        return f"<CalibrationResult {self._title()}>"

    def _repr_html_(self) -> str:
        """Return a small table for a notebook."""
        rows: list[tuple[object, ...]] = [
            (
                item.name,
                value_text(item.value, unit=item.unit),
                value_text(*item.interval, unit=item.unit) if item.state == "fitted" else "",
                item.state,
            )
            for item in self.record.parameters
        ]
        rows += [("not trusted", text, "", "") for text in self.reasons]
        rows += [("warning", text, "", "") for text in self.warnings]
        columns = ("Parameter", "Value", "95 % interval", "State")
        return html_table(self._title(), rows, columns=columns)

    def _title(self) -> str:
        verdict = "trusted" if self.trusted else "NOT TRUSTED"
        return f"{self.record.panel} calibrated to {self.record.data}: {verdict}"


def calibrate(
    campaign: Campaign | xr.Dataset,
    panel: LoadedPanel | None = None,
    *,
    free: Sequence[str] = (),
    fix: Sequence[str] = (),
    exclude: Sequence[str] = (),
    most: int = 20,
    mode: Mode | None = None,
    advise: bool = False,
    causes: bool = True,
    limit: float | None = None,
    panel_uncertainty: Sequence[str] = (),
    workers: int = 1,
    report: Callable[[CalibrationProgress], None] | None = None,
) -> CalibrationResult:
    """Fit friction, drive stiffness and slip levels of a panel to a campaign.

    First friction from movements without an object, then each drive from an object at it, then all
    of it together. Throws are cached beside the campaign, so the same call continues after a stop.

    Parameters
    ----------
    campaign : Campaign or xarray.Dataset
        From `load_campaign` or `build_campaign`; with at least one movement without an object.
    panel : LoadedPanel, optional
        Panel that was measured, with start values; default the library panel uic60-760-1-15.
    free, fix : sequence of str
        Keys of the panel to fit besides the usual ones, and keys to keep.
    exclude : sequence of str
        Movements to leave out, or to hold back for `validate`.
    most : int
        Movements of the last stage; 0 for all, then none is left to validate.
    mode : {"waveform", "quick", "quasi-static"}, optional
        How the throws of the last fit are simulated; see `simulate`.
    advise : bool
        Whether to list strongly correlated parameters and the tests that separate them.
    causes : bool
        Whether to look for causes of what the panel alone does not follow.
    limit : float, optional
        Time after which what is known is given, marked as not trusted [s]; default none.
    panel_uncertainty : sequence of str
        Standard uncertainties of the panel that intervals hold too, such as "material.density=3 %".
    workers : int
        Processes that simulate at the same time, at least 1.
    report : callable, optional
        Called after each throw with how far the calibration is.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    MeasurementError
        When the campaign cannot be calibrated to; with all problems.
    PanelError
        For unknown keys.
    SolverError
        When a throw cannot be simulated.

    Examples
    --------
    >>> found = calibrate(turnout.load_campaign("autumn"), panel)  # doctest: +SKIP
    >>> found.panel, found.intervals  # doctest: +SKIP
    """
    dataset = dataset_of(campaign)
    before = (
        load_panel(DEFAULT_PANEL) if panel is None else checked_panel(panel, caller="calibrate()")
    )
    outcome = fit_stages(
        dataset,
        before,
        plan=default_plan(before, free=free, fixed=fix, most=most),
        exclude=exclude,
        folder=throw_store_of(campaign),
        workers=workers,
        scheme=chosen_scheme(mode, None, caller="calibrate()"),
        advise=advise,
        causes=causes,
        limit=float("inf") if limit is None else limit,
        panel_shares=stated_shares(panel_uncertainty),
        report=report,
    )
    return CalibrationResult(
        record=outcome.calibration,
        before=before,
        sweeps=tuple(item.curves for item in outcome.sweeps),
    )


def load_calibration(path: Path | str, *, panel: LoadedPanel | None = None) -> CalibrationResult:
    """Read a calibration from the file that `CalibrationResult.save` wrote.

    Parameters
    ----------
    path : path-like
        TOML file, also of ``turnout calibrate``.
    panel : LoadedPanel, optional
        Panel that was calibrated; default the library panel of that name.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    FileError
        When the file is no calibration, or of a panel that is not in the library.

    Examples
    --------
    >>> load_calibration("calibration.toml").panel  # doctest: +SKIP
    """
    record = read_record(path)
    if panel is None:
        if record.panel not in library_names():
            message = (
                f"{path}: is of panel '{record.panel}', which is not in the library; give it: "
                "load_calibration(path, panel=load_panel(FILE))"
            )
            raise FileError(message)
        panel = load_panel(record.panel)
    before = checked_panel(panel, caller="load_calibration()")
    return CalibrationResult(record=record, before=before)
