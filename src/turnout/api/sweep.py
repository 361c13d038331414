"""Run and open studies of many throws."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.core.html_table import html_table
from turnout.core.progress import Report
from turnout.metric.sweep_map import STATES, end_state, sweep_map
from turnout.study.study import Study
from turnout.study.sweep.effects import sweep_effects
from turnout.study.sweep.export import sweep_table
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_study as run_batches

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sweep:
    """The results of a study; made by `run_sweep` or `open_sweep`.

    ``sweep["drive_force"]`` is short for ``sweep.dataset["drive_force"]``.

    Attributes
    ----------
    folder : Path
        Folder of the results.
    dataset : xarray.Dataset
        Inputs, histories, labels and features by scenario; values are read when they are used.
        Where a scenario is not complete numbers are NaN and logical values -1.
    """

    folder: Path
    dataset: xr.Dataset

    def __getitem__(self, name: str) -> xr.DataArray:
        """Return a variable of the dataset."""
        return self.dataset[name]

    @cached_property
    def labels(self) -> xr.Dataset:
        """Inputs, outcomes, labels and features, which is all that has no time; in memory."""
        return read_labels(self.folder)

    @property
    def table(self) -> "pd.DataFrame":
        """The same as a row a scenario; ``peak_force.2.closing`` is of Drive 2, closing."""
        return sweep_table(self.folder)

    @property
    def missing(self) -> int:
        """Scenarios that are not thrown yet."""
        return int(self.dataset.attrs["missing"])

    def plot(
        self, *, x: str = "object.size", y: str | None = None, direction: str = "closing"
    ) -> "Figure":
        """Draw forces, gaps and how the throws ended over two inputs.

        Parameters
        ----------
        x, y : str
            Inputs; `y` is "object.at" or else "object.x" where it is not given.
        direction : str
            Movement whose forces are shown.
        """
        from turnout.figures.sweep import plot_sweep_map

        return plot_sweep_map(cells_of(self.labels, x=x, y=y, direction=direction))

    def plot_effects(self) -> "Figure":
        """Draw the sensitivity of each output: Sobol indices of the inputs and main effects."""
        from turnout.figures.sweep import plot_sweep_effects

        return plot_sweep_effects(
            sweep_effects(self.labels), title=str(self.labels.attrs.get("name", ""))
        )

    def __repr__(self) -> str:
        """Return the study and its progress as text."""
        return f"<Sweep {self._title()}>"

    def _repr_html_(self) -> str:
        """Return a small table for a notebook."""
        labels = self.labels
        rows: list[tuple[object, ...]] = [("panel", labels.attrs.get("panel", ""))]
        for name, item in labels.coords.items():
            if "input" in item.attrs:
                rows.append((name, _span(item)))
        if "verdict" in labels:
            state = end_state(labels).to_numpy()
            counts = {text: int((state == number).sum()) for number, text in enumerate(STATES)}
            rows += [(text, f"{count} throws") for text, count in counts.items() if count]
        return html_table(self._title(), rows)

    def _title(self) -> str:
        name = self.dataset.attrs.get("name", self.folder.name)
        waiting = f", {self.missing} not thrown yet" if self.missing else ""
        return f"{name}: {self.dataset.sizes['scenario']} scenarios{waiting}"


def run_sweep(
    study: Study | Path | str,
    *,
    out: Path | str,
    workers: int = 1,
    report: Report | None = None,
) -> Sweep:
    """Throw every scenario of a study into a folder.

    The same call continues an interrupted run and repeats damaged batches.

    Parameters
    ----------
    study : Study or path-like
        From `load_study`, or what that takes: a library name or the path of a study file.
    out : path-like
        Folder to fill; empty, not there yet, or the beginning of this very sweep.
    workers : int
        Processes that simulate at the same time, at least 1.
    report : callable, optional
        Called twice a second with how far the run is.

    Returns
    -------
    Sweep

    Raises
    ------
    StudyError, PanelError
        When the study is not valid; with all problems.
    FileError
        When the folder is that of another study or version, is in use, or is full.

    Examples
    --------
    >>> run_sweep("study.toml", out="results", workers=2).plot()  # doctest: +SKIP
    """
    loaded = load_study(study) if isinstance(study, str | Path) else study
    if not isinstance(loaded, Study):
        problem = f"run_sweep() takes a study from load_study() or its path, not {study!r}"
        raise StudyError([problem])
    run_batches(loaded, out, workers=workers, report=report)
    return open_sweep(out)


def open_sweep(folder: Path | str) -> Sweep:
    """Open the results of a sweep, also while it runs; nothing is read yet.

    Parameters
    ----------
    folder : path-like
        Of `run_sweep` or ``turnout sweep run``.

    Returns
    -------
    Sweep

    Raises
    ------
    FileError
        When the folder holds no sweep, none of its batches, or a damaged one.

    Examples
    --------
    >>> open_sweep("results")["drive_force"].sel(scenario=3, drive="2")  # doctest: +SKIP
    """
    return Sweep(folder=Path(folder), dataset=open_batches(folder))


def cells_of(
    labels: xr.Dataset,
    *,
    x: str = "object.size",
    y: str | None = None,
    direction: str = "closing",
) -> xr.Dataset:
    """Return the throws of a sweep sorted into cells of two inputs."""
    along = y or ("object.at" if "object.at" in labels.coords else "object.x")
    return sweep_map(labels, x=x, y=along, direction=direction)


def _span(item: xr.DataArray) -> str:
    """Return the range of an input as text."""
    values = item.to_numpy()
    if values.dtype.kind not in "fiu":
        return ", ".join(dict.fromkeys(map(str, values)))
    unit = str(item.attrs.get("units", "1"))
    text = f"{float(values.min()):.5g} ... {float(values.max()):.5g}"
    return text if unit in ("", "1") else f"{text} {unit}"
