"""The accessor ``dataset.turnout``, registered with xarray when this module is imported."""

from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from turnout.figures.report.view import View
    from turnout.throw.verdict import Verdict


@xr.register_dataset_accessor("turnout")  # type: ignore[no-untyped-call]
class TurnoutAccessor:
    """Summary, findings and figures of a dataset: ``dataset.turnout.summary()`` and so on.

    Any result will do: a run, simulated or measured, the movements of a campaign, the scenarios of
    a sweep, a validation, modes.

    Parameters
    ----------
    dataset : xarray.Dataset
        Run, recording, campaign, sweep, calibration, validation or modes, by its `kind`.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def summary(self) -> "View":
        """Return the findings in words, and for one run a picture; a notebook shows both.

        Returns
        -------
        View
            Prints as lines of text.
        """
        from turnout.figures.report.view import view

        return view(self._dataset)

    def plot(self, **options: Any) -> "Figure":
        r"""Draw the usual figure of this kind of dataset.

        Parameters
        ----------
        \**options
            As the function of `turnout.figures` takes that draws it: `plot_throw` for a run,
            `plot_measured` for a recording, `plot_overview` for a campaign (`plot_stacked` with
            ``place``), `plot_sweep_map` for a sweep, `plot_error_map` for a validation
            (`plot_comparison` with ``place``), `plot_modes` for modes.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from turnout.api.draw import draw

        return draw(self._dataset, **options)

    def features(self) -> xr.Dataset:
        """Return onset, slope, peak, plateau and end of the forces; see `turnout.features`.

        Returns
        -------
        xarray.Dataset
            By drive and direction of a run, by movement and drive of a campaign.
        """
        from turnout.metric.features import features

        return features(self._dataset)

    def verdict(self) -> "Verdict":
        """Judge one run: an object undetected, or detected by lock, control contact or slip.

        Returns
        -------
        Verdict
            With ``kind`` and ``text``.
        """
        from turnout.throw.verdict import verdict

        return verdict(self._dataset)

    def __repr__(self) -> str:
        """Return the summary as text."""
        return repr(self.summary())

    def _repr_html_(self) -> str:
        """Return the summary for a notebook."""
        return self.summary()._repr_html_()

    def __dir__(self) -> list[str]:
        """List the four methods for completion."""
        return ["features", "plot", "summary", "verdict"]
