"""The page about a campaign of movements, measured or virtual."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from turnout.core.value_text import count_text
from turnout.figures.campaign import campaign_channels, plot_overview, plot_stacked, stacked_sheet
from turnout.figures.report.inputs import origin_section
from turnout.figures.report.page import FEW_POINTS, Heat, Page, Picture, Section, Table
from turnout.figures.style import KILO, MILLI, rendered
from turnout.metric.campaign_statistics import (
    PlaceSizes,
    end_values,
    object_places,
    place_sizes,
    repeat_scatter,
    saturating_places,
)
from turnout.metric.finding import Finding
from turnout.throw.checks import format_force

Reasons = Sequence[tuple[str, Sequence[str]]]

DIRECTIONS = ("closing", "opening")
TOO_FEW = "too few throws without an object"
# From so many on, sizes near the smallest detectable one are not called undecided.
LEAST_REPEATS = 4


def campaign_page(
    dataset: xr.Dataset,
    *,
    excluded: Reasons = (),
    remarks: Sequence[str] = (),
    suffixes: Sequence[str] = (".pdf",),
) -> Page:
    """Return the page about a campaign.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dimensions movement and time.
    excluded : sequence of (str, sequence of str)
        Movements that are not in it, with every reason.
    remarks : sequence of str
        Remarks on movements that are usable all the same.
    suffixes : sequence of str
        File formats in which the page offers each figure.

    Returns
    -------
    Page
    """
    thrown = [way for way in DIRECTIONS if _places(dataset, way)] or [
        way for way in DIRECTIONS if (dataset["direction"].values == way).any()
    ]
    sections = [
        Section(
            heading=f"End force by place and size, {way}",
            text="Force at the end of the throw in kN, by size of the object in mm. Framed where a "
            "drive slipped; repeats are averaged; empty where nothing was thrown.",
            heats=_heats(dataset, direction=way),
            tables=[_sizes_table(dataset, way)],
        )
        for way in thrown
    ]
    sections += [
        Section(
            heading=f"Over time, {way}",
            pictures=[_stacked(dataset, place, way, suffixes) for place in _places(dataset, way)],
            folded=True,
        )
        for way in thrown
        if _places(dataset, way)
    ]
    rows = [(who, "; ".join(reasons)) for who, reasons in excluded]
    excluded_rows = Table("Excluded", ("Movement", "Reason"), rows)
    to_check = Table("Check", ("Remark",), [(text,) for text in remarks])
    quality = [table for table in (excluded_rows, to_check) if table.rows]
    sections += [Section(heading="Quality", tables=quality)] if quality else []
    sections.append(origin_section(dataset.attrs))
    count = dataset.sizes["movement"]
    return Page(
        title=str(dataset.attrs.get("title", "Campaign")),
        subtitle=f"Campaign of {count_text(count, 'usable movement')}",
        findings=campaign_findings(dataset, excluded=excluded, remarks=remarks),
        sections=sections,
        synthetic=bool(dataset.attrs.get("synthetic")),
    )


def campaign_findings(
    dataset: xr.Dataset, *, excluded: Reasons = (), remarks: Sequence[str] = ()
) -> list[Finding]:
    """Return the findings of a campaign: objects that the drives detect, by place."""
    found = [_detected(dataset, way) for way in DIRECTIONS if _places(dataset, way)]
    found += [_slips(dataset, way) for way in DIRECTIONS if _places(dataset, way)]
    for way in DIRECTIONS:
        for drive in repeat_scatter(dataset, direction=way):
            if drive.count:
                spread = "unknown" if math.isnan(drive.deviation) else f"{drive.deviation:.0f} N"
                throws = count_text(drive.count, "throw")
                detail = f"{spread} standard deviation in {throws} without an object"
                question = f"End force of drive {drive.drive}, {way}"
                found.append(Finding("fact", question, format_force(drive.mean), detail))
    count = dataset.sizes["movement"]
    if excluded or remarks:
        out = "some excluded" if excluded else "none excluded"
        detail = f"{out}; {'remarks' if remarks else 'no remarks'} under Quality"
        found.append(Finding("look", "Usable movements", str(count), detail))
    else:
        found.append(Finding("good", "Usable movements", str(count), "none excluded, no remarks"))
    return found


def campaign_figures(dataset: xr.Dataset, *, suffixes: Sequence[str]) -> dict[str, bytes]:
    """Return the tables of end force by place and size as files by name."""
    files: dict[str, bytes] = {}
    for way in DIRECTIONS:
        if (dataset["direction"].values == way).any():
            figure = plot_overview(dataset, direction=way)
            files |= {f"overview-{way}{suffix}": rendered(figure, suffix) for suffix in suffixes}
    return files


def _places(dataset: xr.Dataset, direction: str) -> list[str]:
    return object_places(dataset.isel(movement=dataset["direction"].values == direction))


def _detected(dataset: xr.Dataset, direction: str) -> Finding:
    """Return the smallest size detected at every place, and the places without detection."""
    results = place_sizes(dataset, direction=direction)
    question = f"Smallest size detected by the drives, {direction}"
    hidden = [item for item in results if math.isnan(item.detectable)]
    undetected = [item.place for item in hidden if math.isnan(item.undecided)]
    open_places = [item.place for item in hidden if not math.isnan(item.undecided)]
    rule = "detection threshold at 0.14 % false alarms"
    scatter = repeat_scatter(dataset, direction=direction)
    if all(math.isnan(item.deviation) for item in scatter):
        detail = f"{TOO_FEW} to compare with: fewer than two"
        return Finding("look", question, "Unknown", detail)
    known = [item for item in results if not math.isnan(item.detectable)]
    if not known and open_places:
        detail = f"{TOO_FEW} to decide at {', '.join(open_places)}; {rule}"
        return Finding("look", question, "Unknown", detail)
    if not known:
        slips, throws = _free_slips(dataset, direction)
        why = ", as drives slip without one" if slips and slips == throws else ""
        return Finding("bad", question, "None", f"no object is detected at any place{why}; {rule}")
    worst = max(known, key=lambda item: item.detectable)
    detail = f"at {len(known)} of {len(results)} places, largest at {worst.place}; {rule}"
    if undetected:
        detail += f"; not detected at {', '.join(undetected)}"
    if open_places:
        detail += f"; {TOO_FEW} to decide at {', '.join(open_places)}"
    smaller = [item.place for item in known if not math.isnan(item.undecided)]
    if smaller and _few(dataset, direction):
        detail += f"; {TOO_FEW} to decide on smaller ones at {', '.join(smaller)}"
    answer = f"{MILLI * worst.detectable:g} mm"
    return Finding("look" if hidden else "good", question, answer, detail)


def _free_slips(dataset: xr.Dataset, direction: str) -> tuple[int, int]:
    """Return the numbers of throws without an object: those with a slipping drive, and all."""
    free = (dataset["direction"].values == direction) & (dataset["size"].values == 0)
    slips = dataset["slipped"].values[free].sum() if "slipped" in dataset.coords else 0
    return int(slips), int(free.sum())


def _slips(dataset: xr.Dataset, direction: str) -> Finding:
    results = [
        item for item in place_sizes(dataset, direction=direction) if not math.isnan(item.slipped)
    ]
    question = f"Smallest size that makes a drive slip, {direction}"
    slips, throws = _free_slips(dataset, direction)
    if slips:
        detail = f"in {slips} of {count_text(throws, 'throw')}; a slip says nothing of an object"
        return Finding("look", question, "Slips without an object", detail)
    if not results:
        flat = saturating_places(dataset, direction=direction)
        if flat:
            detail = (
                f"none is recorded, yet a rod force no longer grows at {', '.join(flat)}; check "
                "clamps and the column slip"
            )
            return Finding("look", question, "Unknown", detail)
        return Finding("fact", question, "None", "no drive slipped with any object")
    least = min(results, key=lambda item: item.slipped)
    most = max(results, key=lambda item: item.slipped)
    detail = f"first at {least.place}"
    if most.slipped > least.slipped:
        detail += f", {MILLI * most.slipped:g} mm at {most.place}"
    return Finding("fact", question, f"{MILLI * least.slipped:g} mm", detail)


def _size(value: float) -> str:
    return "none" if math.isnan(value) else f"{MILLI * value:g} mm"


def _detectable(item: PlaceSizes, *, few: bool) -> str:
    """Return the smallest detectable size of a place, and undecided smaller ones, if any."""
    if math.isnan(item.undecided) or (not few and not math.isnan(item.detectable)):
        return _size(item.detectable)
    if math.isnan(item.detectable):
        return TOO_FEW
    return f"{_size(item.detectable)}; {TOO_FEW} to decide from {_size(item.undecided)}"


def _few(dataset: xr.Dataset, direction: str) -> bool:
    """Return True if there are too few throws without an object to compare with."""
    counts = [drive.count for drive in repeat_scatter(dataset, direction=direction) if drive.count]
    return min(counts, default=0) < LEAST_REPEATS


def _sizes_table(dataset: xr.Dataset, direction: str) -> Table:
    results, few = place_sizes(dataset, direction=direction), _few(dataset, direction)
    rows = [
        (item.place, f"{_size(item.smallest)} to {_size(item.largest)}",
         _detectable(item, few=few), _size(item.slipped))
        for item in results
    ]  # fmt: skip
    columns = ("Place", "Sizes thrown", "Smallest detectable size", "Smallest size with slip")
    return Table("Smallest sizes by place", columns, rows)


def _heats(dataset: xr.Dataset, *, direction: str) -> list[Heat]:
    """Return the end force of each drive and of the object, by place and size."""
    kept = dataset.isel(movement=np.flatnonzero(dataset["direction"].values == direction))
    none = ["none"] if (kept["size"].values == 0).any() else []
    places = [*none, *object_places(kept)]
    sizes = np.unique(kept["size"].values)
    slipped = kept["slipped"].values.astype(bool) if "slipped" in kept.coords else None
    heats = []
    for row in campaign_channels(kept):
        if row.factor != KILO:
            continue
        ends = end_values(row.channel) * KILO
        values = np.full((len(places), sizes.size), np.nan)
        framed = np.zeros(values.shape, dtype=bool)
        for line, place in enumerate(places):
            for column, size in enumerate(sizes):
                same = (kept["place"].values == place) & (kept["size"].values == size)
                same &= np.isfinite(ends)
                if same.any():
                    values[line, column] = ends[same].mean()
                    framed[line, column] = slipped is not None and bool(slipped[same].any())
        names = ["no object" if place == "none" else place for place in places]
        columns = [f"{MILLI * size:g}" for size in sizes]
        heading = f"{row.label.replace(chr(10), ' ')}"
        heats.append(Heat(heading, names, columns, values.tolist(), framed.tolist()))
    return heats


def _stacked(dataset: xr.Dataset, place: str, direction: str, suffixes: Sequence[str]) -> Picture:
    sheet = stacked_sheet(dataset, place=place, direction=direction)
    figure = plot_stacked(dataset, place=place, direction=direction)
    files = {suffix: rendered(figure, suffix) for suffix in suffixes}
    return Picture(sheet, files, FEW_POINTS)
