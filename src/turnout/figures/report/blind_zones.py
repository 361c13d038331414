"""The page about the detectability of trapped objects: blind zones along the blade."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from turnout.detection.conditions import SIMULATED
from turnout.figures.limit import plot_limit
from turnout.figures.report.page import Heat, Page, Picture, Section, Table
from turnout.figures.sheet import Line, Row, Sheet
from turnout.figures.style import MILLI, rendered
from turnout.metric.finding import Finding, Severity

BOTH = "both drives"
SHOWN_SIZES = (1, 2, 3, 5, 7, 9, 11, 13, 16, 20)
"""Sizes in the coloured table [mm]."""
BLIND_ZONE_A90 = 10e-3
"""From this a90 on a place is called a blind zone [m]; assumption: the size of a piece of ballast
that the control contacts, 13 mm at most, leave in the switch with a margin."""
CAUTION = (
    f"{SIMULATED.capitalize()}. "
    "A bound, not a detector: place and size are taken as known, so every real detector sees less. "
    "Below the touch floor nothing can be seen by anyone: the rail does not touch the object."
)


def blind_zone_page(dataset: xr.Dataset, *, suffixes: Sequence[str] = (".pdf",)) -> Page:
    """Return the page about a map of `turnout limit`.

    Parameters
    ----------
    dataset : xarray.Dataset
        With pod, a90 and touch_floor; bounds at known places and end positions if it has them.
    suffixes : sequence of str
        File formats in which the page offers the map.
    """
    said = dataset.attrs
    sections = [
        Section(
            heading="Blind zones",
            text=CAUTION,
            pictures=[_picture(dataset, suffixes)],
            heats=[_heat(dataset)],
        ),
        Section(heading="Place by place", tables=[_places(dataset)]),
    ]
    if "end_pod" in dataset:
        sections.append(
            Section(
                heading="Instead of end-position sensors",
                text="Gaps that remain after closing, and whether the drives show them.",
                tables=[_ends(dataset)],
            )
        )
    sections.append(Section(heading="What it rests on", tables=[_conditions(dataset)]))
    return Page(
        title="What the drives can show of a trapped object",
        subtitle=f"{SIMULATED.capitalize()}. "
        f"{str(said.get('quantities', 'force')).capitalize()} of the drives, "
        f"{said['states']} states, {said['sound_throws']} sound throws",
        findings=_findings(dataset),
        sections=sections,
        synthetic=True,
        footer=[CAUTION],
    )


def _findings(dataset: xr.Dataset) -> list[Finding]:
    at = dataset.sel(channel=BOTH)
    a90, places = at["a90"].to_numpy(), [str(name) for name in at["place"].to_numpy()]
    worst = int(np.nan_to_num(a90, nan=np.inf).argmax())
    blind = [places[n] for n in range(len(places)) if not a90[n] < BLIND_ZONE_A90]
    level: Severity = "bad" if blind else "good"
    low, high = (_mm(float(at[f"a90_{end}"][worst])) for end in ("low", "high"))
    found = [
        Finding(
            level,
            "Where is the drives' blind zone?",
            places[worst],
            f"nine of ten objects are seen only from {_mm(a90[worst])} mm on (95 %: {low} to "
            f"{high})",
            "Smaller objects there can stay in the closed switch without the drives noticing.",
        ),
        Finding(
            "fact",
            "What is out of reach for any method?",
            f"{_mm(float(at['touch_floor'].max()))} mm",
            "the largest touch floor: nine of ten smaller objects there are not touched at all",
        ),
    ]  # fmt: skip
    if blind:
        found.append(
            Finding("look", "Which places need a second sensor?", f"{len(blind)} of {len(places)}",
                    f"a90 of {MILLI * BLIND_ZONE_A90:g} mm or more: {', '.join(blind)}")
        )  # fmt: skip
    if "end_pod_at_limit" in dataset:
        share = dataset["end_pod_at_limit"].sel(channel=BOTH)
        least = int(share.to_numpy().argmin())
        value, name = float(share[least]), str(dataset["position"][least].item())
        found.append(
            Finding(
                "good" if value >= 0.99 else "look",  # noqa: PLR2004
                "Do the drives show an open end position?",
                f"{100 * value:.1f} %",
                f"of gaps at the limit of {name}, the position that shows worst",
            )
        )
    return found


def _mm(value: float) -> str:
    return f"{MILLI * value:.1f}" if np.isfinite(value) else "beyond what was thrown"


def _picture(dataset: xr.Dataset, suffixes: Sequence[str]) -> Picture:
    x = dataset["x"].to_numpy()
    lines = [Line(label="touch floor", x=x, y=MILLI * dataset["touch_floor"].to_numpy(), colour=4)]
    for number, name in enumerate(dataset["channel"].to_numpy().tolist()):
        alone = "" if name == BOTH else " alone"
        lines.append(
            Line(
                label=f"a90, {name}{alone}", x=x, dash=number, style="line and marks",
                y=MILLI * dataset["a90"].sel(channel=name).to_numpy(), colour=number,
                width=1.3 if name == BOTH else 0.9,
            )
        )  # fmt: skip
    if "known_a90" in dataset:
        lines.append(
            Line(label="a90 if only the place is known", x=x, style="line and marks",
                 y=MILLI * dataset["known_a90"].to_numpy(), colour=5, symbol="square")
        )  # fmt: skip
    sheet = Sheet(
        name="blind-zones",
        title="Smallest object that can be seen along the blade",
        caption="From a90 on nine of ten objects can be seen. The files show the whole map.",
        x_label="Position from the toe [m]",
        rows=(Row("Size\n[mm]", tuple(lines)),),
    )
    figure = plot_limit(dataset)
    return Picture(sheet, {suffix: rendered(figure, suffix) for suffix in suffixes})


def _heat(dataset: xr.Dataset) -> Heat:
    """Return the probability of detection over size and place; cells under the floor are framed."""
    at = dataset.sel(channel=BOTH)
    floor, largest = at["touch_floor"].to_numpy(), at["largest_size"].to_numpy()
    values, framed = [], []
    for size in SHOWN_SIZES:
        row = at["pod"].sel(size=size / MILLI, method="nearest").to_numpy()
        thrown = size / MILLI <= largest + 1e-9
        values.append([100.0 * float(v) if t else np.nan for v, t in zip(row, thrown, strict=True)])
        framed.append([bool(size / MILLI < low) for low in floor])
    return Heat(
        "Probability of detection [%] by size and place; framed: below the touch floor",
        [f"{size} mm" for size in SHOWN_SIZES],
        [str(name) for name in at["place"].to_numpy()],
        values,
        framed,
    )


def _places(dataset: xr.Dataset) -> Table:
    channels = [str(name) for name in dataset["channel"].to_numpy()]
    known = "known_a90" in dataset
    columns = ["place", "x [m]", "touch floor [mm]", "a90 [mm]", "95 %"]
    columns += ["a90, place known [mm]"] if known else []
    columns += [f"{name} alone [mm]" for name in channels[1:]]
    rows, marked = [], []
    for number, place in enumerate(dataset["place"].to_numpy().tolist()):
        at = dataset.sel(place=place)
        both = at.sel(channel=BOTH)
        cells = [_mm(float(both[name])) for name in ("a90", "a90_low", "a90_high")]
        row = [str(place), f"{float(at['x']):.2f}", _mm(float(at["touch_floor"])), cells[0]]
        row += [f"{cells[1]} to {cells[2]}"]
        row += [_mm(float(at["known_a90"]))] if known else []
        row += [_mm(float(at["a90"].sel(channel=name))) for name in channels[1:]]
        rows.append(row)
        if not float(both["a90"]) < BLIND_ZONE_A90:
            marked.append(number)
    return Table("", columns, rows, frozenset(marked))


def _ends(dataset: xr.Dataset) -> Table:
    rows = []
    for position in dataset["position"].to_numpy().tolist():
        for channel in dataset["channel"].to_numpy().tolist():
            one = dataset.sel(position=position, channel=channel)
            rows.append(
                [
                    str(position), str(channel), _mm(float(one["gap_limit"])),
                    f"{100 * float(one['end_pod_at_limit']):.1f} %",
                    _mm(float(one["revealed_gap"])),
                ]
            )  # fmt: skip
    columns = ["position", "by", "limit [mm]", "shown at the limit", "shown in 90 % from [mm]"]
    return Table("", columns, rows)


def _conditions(dataset: xr.Dataset) -> Table:
    said = dataset.attrs
    rows = [
        ["discrepancy between model and switch", f"{100 * said['discrepancy']:g} % of the peak"],
        ["its correlation", f"{said['kernel']}, {said['correlation_time']:g} s"],
        ["share of it that is fixed for a switch", f"{100 * said['fixed_share']:g} %"],
        ["noise of a force", f"{said['noise']:g} N at {said['rate']:g} Hz"],
        ["sound throws known of the switch", f"{said['history']}"],
        ["false alarms a sound throw", f"{said['false_alarm_rate']:g}"],
        ["objects", str(said.get("object_kind", "spring"))],
        ["bound", str(said["bound"])],
    ]
    return Table("", ["what", "value"], rows)
