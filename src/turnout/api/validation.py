"""Test of a calibration on movements that it was not fitted to."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from turnout.api.calibration import CalibrationResult
from turnout.api.campaign import Campaign, dataset_of, throw_store_of
from turnout.calibration.evaluate import Evaluator
from turnout.calibration.validation.acceptance import Acceptance, judge
from turnout.calibration.validation.validate import validate as predict
from turnout.core.errors import MeasurementError
from turnout.core.html_table import html_table
from turnout.throw.store import save_response

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Validation:
    """Predictions beside measurements, and the verdict; made by `validate`.

    Attributes
    ----------
    dataset : xarray.Dataset
        `measured`, `predicted` and the 95 % band `low`, `high` by (channel, movement, time) [N];
        errors and features by (channel, movement).
    verdict : Acceptance
        Over the movements that the fit has not seen.
    """

    dataset: xr.Dataset
    verdict: Acceptance

    @property
    def accepted(self) -> bool:
        """True if the calibration predicts the movements that were held back."""
        return self.verdict.accepted

    @property
    def text(self) -> str:
        """The verdict in one sentence."""
        return self.verdict.text

    @property
    def table(self) -> "pd.DataFrame":
        """A row per channel, with RMS error, spread of repeats [N], their ratio and band cover."""
        import pandas as pd

        rows = [
            {
                "channel": item.channel,
                "movements": item.movements,
                "rms": item.rms,
                "nrmse": item.nrmse,
                "repeat_spread": item.spread,
                "spreads": item.spreads,
                "cover": item.cover,
            }
            for item in self.verdict.channels
        ]
        return pd.DataFrame(rows).set_index("channel")

    def plot(self, place: str | None = None) -> "Figure":
        """Draw the errors over places and sizes, or forces over time at one place.

        Parameters
        ----------
        place : str, optional
            Such as "sleeper 6".
        """
        from turnout.figures.validation import plot_comparison, plot_error_map

        if place is None:
            return plot_error_map(self.dataset)
        return plot_comparison(self.dataset, place=place)

    def save(self, path: Path | str) -> None:
        """Write the dataset to a netCDF file, which `open_response` reads.

        Parameters
        ----------
        path : path-like
            File to write (.nc); an existing one is replaced.
        """
        save_response(self.dataset, path)

    def __repr__(self) -> str:
        """Return the verdict as text."""
        return f"<Validation {self.text}>"

    def _repr_html_(self) -> str:
        """Return a small table for a notebook."""
        rows = [
            (item.channel, item.movements, item.rms, item.spread, item.spreads, item.cover)
            for item in self.verdict.channels
        ]
        columns = ("Channel", "Movements", "RMS [N]", "Repeats [N]", "Ratio", "Cover")
        return html_table(self.text, rows, columns=columns)


def validate(
    campaign: Campaign | xr.Dataset,
    calibration: CalibrationResult,
    *,
    workers: int = 1,
    report: Callable[[int, int], None] | None = None,
) -> Validation:
    """Predict every movement of a campaign and judge those that the fit has not seen.

    Parameters
    ----------
    campaign : Campaign or xarray.Dataset
        From `load_campaign` or `build_campaign`.
    calibration : CalibrationResult
        From `calibrate` or `load_calibration`.
    workers : int
        Processes that simulate at the same time, at least 1.
    report : callable, optional
        Called with throws done and throws in all: first of those that predict, then from 1 again
        of those that check what the verdict would notice.

    Returns
    -------
    Validation

    Raises
    ------
    MeasurementError
        When the campaign does not fit the panel, or no throw can be simulated.

    Examples
    --------
    >>> validate(campaign, calibration).accepted  # doctest: +SKIP
    True
    """
    dataset = dataset_of(campaign)
    if not isinstance(calibration, CalibrationResult):
        problem = (
            f"calibration = {calibration!r}: takes what calibrate() or load_calibration() returned"
        )
        raise MeasurementError([problem], source="validate()")
    record, panel = calibration.record, calibration.before
    with Evaluator(panel, folder=throw_store_of(campaign), workers=workers) as evaluator:
        shown = None if report is None else lambda _, done, total: report(done, total)
        found = predict(dataset, panel, record, evaluator=evaluator, report=shown)
    return Validation(dataset=found, verdict=judge(found))
