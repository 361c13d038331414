"""Campaigns of many movements: loaded from files, or thrown and recorded virtually."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from turnout.core.errors import FileError, MeasurementError, PanelError
from turnout.core.html_table import html_table
from turnout.core.scheme import Mode, chosen_scheme
from turnout.core.units import LENGTH, parse_quantity
from turnout.measurement.campaign.build_campaign import build_campaign_dataset as read_folder
from turnout.measurement.campaign.campaign_folder import throw_store
from turnout.measurement.campaign.run_sheet import normal_place
from turnout.metric.campaign_statistics import object_places
from turnout.panel.load import LoadedPanel
from turnout.study.virtual.campaign_plan import SIZES, CampaignPlan, places_with_room
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.throw.store import open_response, save_response

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

DATASET = "campaign.nc"
# Movements whose reasons an error spells out.
MOST_NAMED = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Campaign:
    """Movements of one switch, measured or virtual; made by `load_campaign` or `build_campaign`.

    ``campaign["drive_force"]`` is short for ``campaign.dataset["drive_force"]``.

    Attributes
    ----------
    dataset : xarray.Dataset
        Usable movements by (movement, ..., time), in SI; time is zero at the onset.
    excluded : mapping of str to tuple of str
        Movements that are not in the dataset, each with every reason.
    remarks : tuple of str
        Remarks on movements that are usable all the same.
    source : Path
        The folder or the file that it was loaded from.
    """

    dataset: xr.Dataset
    excluded: Mapping[str, tuple[str, ...]]
    remarks: tuple[str, ...]
    source: Path

    def __getitem__(self, name: str) -> xr.DataArray:
        """Return a channel or coordinate of the dataset."""
        return self.dataset[name]

    @property
    def table(self) -> "pd.DataFrame":
        """A row a movement, with direction, size [m], place, repeat and so on."""
        names = [name for name, item in self.dataset.coords.items() if item.dims == ("movement",)]
        return self.dataset[names].to_dataframe().drop(columns="movement", errors="ignore")

    def plot(self, place: str | None = None, *, direction: str = "closing") -> "Figure":
        """Draw places against sizes, or every channel over time at one place.

        Parameters
        ----------
        place : str, optional
            Such as "sleeper 6".
        direction : str
            "closing" or "opening".
        """
        from turnout.figures.campaign import plot_overview, plot_stacked

        if place is None:
            return plot_overview(self.dataset, direction=direction)
        return plot_stacked(self.dataset, place=place, direction=direction)

    def save(self, path: Path | str) -> None:
        """Write the dataset to a netCDF file, which `load_campaign` reads.

        Parameters
        ----------
        path : path-like
            File to write (.nc); an existing one is replaced.
        """
        save_response(self.dataset, path)

    def __repr__(self) -> str:
        """Return the number of movements by kind."""
        return f"<Campaign {self._title()}>"

    def _repr_html_(self) -> str:
        """Return a small table for a notebook."""
        sizes = sorted({float(size) for size in self.dataset["size"].values if size > 0})
        counts = {
            way: int((self.dataset["direction"].values == way).sum())
            for way in dict.fromkeys(self.dataset["direction"].values.tolist())
        }
        rows = [
            ("movements", ", ".join(f"{count} {way}" for way, count in counts.items())),
            ("places", ", ".join(object_places(self.dataset)) or "none"),
            ("object sizes", ", ".join(f"{1e3 * size:g} mm" for size in sizes) or "none"),
            ("channels", ", ".join(map(str, self.dataset.data_vars))),
            *((f"left out: {name}", "; ".join(why)) for name, why in self.excluded.items()),
            *(("remark", text) for text in self.remarks),
        ]
        return html_table(self._title(), rows)

    def _title(self) -> str:
        made = ", synthetic" if self.dataset.attrs.get("synthetic") else ""
        out = f", {len(self.excluded)} left out" if self.excluded else ""
        title = self.dataset.attrs.get("title", self.source.name)
        return f"{title}: {self.dataset.sizes['movement']} movements{out}{made}"


def load_campaign(
    source: Path | str,
    *,
    channels: Path | str | None = None,
    strict: bool = False,
    report: Callable[[int, int], None] | None = None,
) -> Campaign:
    """Load a campaign from its folder of recordings, or from the dataset of one.

    The run sheet is read at every call, so corrections take effect; recordings
    that were read before are taken up from the folder.

    Parameters
    ----------
    source : path-like
        Folder with a run sheet, a channel map and recordings, or a file (.nc) that
        `Campaign.save` or ``turnout campaign build`` wrote.
    channels : path-like, optional
        Channel map of a folder; default ``channels.toml`` in it.
    strict : bool
        Whether a movement that must be left out is an error.
    report : callable, optional
        Called with movements done and movements in all.

    Returns
    -------
    Campaign

    Raises
    ------
    FileError
        When folder, sheet, channel map or file cannot be read.
    MeasurementError
        When the sheet is wrong or no movement is usable; with every reason.

    Examples
    --------
    >>> campaign = load_campaign("autumn")  # doctest: +SKIP
    >>> campaign.plot(place="sleeper 6")  # doctest: +SKIP
    """
    source = Path(source)
    if source.suffix.lower() == ".nc":
        return _from_file(source)
    found = read_folder(source, channels=channels, strict=strict, report=report)
    excluded = {item.run.name: item.reasons for item in found.excluded}
    if found.dataset is None:
        reasons = [f"{name}: {'; '.join(why)}" for name, why in excluded.items()]
        raise MeasurementError(reasons[:MOST_NAMED], source=f"{source}: no movement is usable")
    return Campaign(dataset=found.dataset, excluded=excluded, remarks=found.remarks, source=source)


def build_campaign(
    folder: Path | str,
    *,
    panel: LoadedPanel | None = None,
    places: Sequence[str] = (),
    sizes: Sequence[float | str] = (),
    object_free: int = 5,
    seed: int = 0,
    mode: Mode | None = None,
    workers: int = 1,
    channels: Path | str | None = None,
    strict: bool = False,
    report: Callable[[int, int], None] | None = None,
) -> Campaign:
    """Build the dataset of a campaign and write it to ``campaign.nc`` in its folder.

    Without a panel the folder holds the recordings of a measurement. With one the campaign is
    virtual: it is thrown and recorded as a data acquisition system would have, into a folder of
    its own, and then read as any other. A virtual campaign that was interrupted goes on.

    Parameters
    ----------
    folder : path-like
        With a run sheet and recordings; with `panel`, empty or not there yet.
    panel : LoadedPanel, optional
        Panel to throw; its friction scatters by 2 % from throw to throw.
    places : sequence of str, optional
        Of the object, such as "sleeper 6"; default every sleeper and drive.
    sizes : sequence of float or str, optional
        Of the object [m], such as 0.013 or "13 mm"; at each place they are thrown in rising order
        until a drive slips. Default those of the published campaign.
    object_free : int
        Repeats without an object in each direction.
    seed : int
        Of friction, onsets and noise.
    mode : {"waveform", "quick", "quasi-static"}, optional
        How the throws are simulated; see `simulate`.
    workers : int
        Processes that throw.
    channels, strict, report
        As for `load_campaign`.

    Returns
    -------
    Campaign

    Raises
    ------
    FileError, PanelError, MeasurementError
        When the campaign does not fit the panel, or the folder cannot be read or written.

    Examples
    --------
    >>> panel = turnout.load_panel("sb2")  # doctest: +SKIP
    >>> build_campaign("rehearsal", panel=panel, places=["sleeper 6"])  # doctest: +SKIP
    """
    folder = Path(folder)
    if panel is not None:
        panel = checked_panel(panel, caller="build_campaign()")
        plan = _plan(panel, places, sizes, object_free=object_free, seed=seed, mode=mode)
        make_virtual_campaign(panel, folder, plan=plan, workers=workers, report=report)
    elif places or sizes or mode is not None:
        message = (
            "build_campaign(): places, sizes and mode apply to virtual campaigns; "
            "give its panel too, or leave them out"
        )
        raise FileError(message)
    campaign = load_campaign(folder, channels=channels, strict=strict, report=report)
    campaign.save(folder / DATASET)
    return campaign


def dataset_of(campaign: Campaign | xr.Dataset) -> xr.Dataset:
    """Return the movements of a campaign, whichever way they were given."""
    dataset = campaign.dataset if isinstance(campaign, Campaign) else campaign
    if not isinstance(dataset, xr.Dataset) or "movement" not in dataset.dims:
        message = "campaign: takes what load_campaign() or build_campaign() returned"
        raise MeasurementError([message], source=type(campaign).__name__)
    return dataset


def checked_panel(panel: object, *, caller: str) -> LoadedPanel:
    """Return a loaded panel; raise with the remedy for anything else."""
    if isinstance(panel, LoadedPanel):
        return panel
    problem = f"panel = {panel!r}: takes a panel from load_panel(), such as load_panel('sb1')"
    raise PanelError([problem], source=caller)


def throw_store_of(campaign: Campaign | xr.Dataset) -> Path | None:
    """Return the folder in which throws for a campaign are kept; None for a bare dataset."""
    if not isinstance(campaign, Campaign):
        return None
    return throw_store(campaign.source)


def _from_file(source: Path) -> Campaign:
    dataset = open_response(source)
    if "movement" not in dataset.dims:
        message = f"{source}: holds one run, not a campaign; open_response() reads it"
        raise FileError(message)
    listed: list[dict[str, Any]] = json.loads(dataset.attrs.get("excluded", "[]"))
    excluded = {item["movement"]: tuple(item["reasons"]) for item in listed}
    return Campaign(dataset=dataset, excluded=excluded, remarks=(), source=source)


def _plan(
    panel: LoadedPanel,
    places: Sequence[str],
    sizes: Sequence[float | str],
    *,
    object_free: int,
    seed: int,
    mode: Mode | None,
) -> CampaignPlan:
    """Return the plan of a virtual campaign, or refuse all that is wrong with it at once."""
    problems: list[str] = []
    metres: list[float] = []
    named: list[str] = []
    for size in sizes:
        try:
            metres.append(parse_quantity(size, LENGTH, si=True))
        except ValueError as error:
            problems.append(f"sizes: {size!r}: {error}")
    for place in places:
        try:
            named.append(normal_place(place))
        except ValueError as error:
            problems.append(f"places: {place!r}: {error}")
    if problems:
        raise MeasurementError(problems, source="virtual campaign")
    return CampaignPlan(
        places=tuple(named) or places_with_room(panel, size=min(metres, default=min(SIZES))),
        sizes=tuple(sorted(metres)) or SIZES,
        object_free=object_free,
        seed=seed,
        scheme=chosen_scheme(mode, None, caller="build_campaign()"),
    )
