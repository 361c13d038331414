"""The page about a calibration: each parameter with its uncertainty and identifiability."""

import math

import numpy as np
import xarray as xr

from turnout.calibration.result import Calibration, StageLog
from turnout.calibration.stages import Fitted
from turnout.core.value_text import count_text, shown_unit, value_text
from turnout.figures.calibration import fit_sheet
from turnout.figures.draw import draw_sheet
from turnout.figures.report.inputs import inputs_section
from turnout.figures.report.page import FEW_POINTS, Heat, Page, Picture, Section, Table
from turnout.figures.sheet import Level, Line, Moment, Row, Sheet
from turnout.figures.style import rendered
from turnout.metric.finding import Finding
from turnout.panel.load import LoadedPanel

FITTED, FIXED = "fitted", "fixed"
# Above this correlation only a combination of two parameters is identified.
STRONG_CORRELATION = 0.9
# What findings begin with that say which movement to measure next.
NEXT = "next: "


def calibration_page(
    calibration: Calibration,
    *,
    panel: LoadedPanel | None = None,
    signals: xr.Dataset | None = None,
    suffixes: tuple[str, ...] = (".pdf",),
) -> Page:
    """Return the page about a calibration.

    Parameters
    ----------
    calibration : Calibration
        Result to show.
    panel : LoadedPanel, optional
        The panel that was calibrated, without what was found.
    signals : xarray.Dataset, optional
        Measured and fitted forces of each movement, as `load_signals` reads them.
    suffixes : tuple of str
        In which forms the page holds each figure on paper.

    Returns
    -------
    Page
    """
    sweeps = [stage for stage in calibration.stages if stage.sweep]
    pictures = [_picture(sweep_sheet(stage, calibration), suffixes) for stage in sweeps]
    others = [text for text in calibration.findings if not text.startswith(NEXT)]
    found = [Table("", ("Finding",), [(text,) for text in others])]
    warned = [Table("", ("Warning",), [(text,) for text in calibration.warnings])]
    causes = [Table("", ("Cause",), [(text,) for text in calibration.causes])]
    sections = [
        Section(
            heading="Parameters",
            pictures=_intervals(calibration, suffixes),
            tables=[_parameters(calibration)],
            heats=_together(calibration),
        ),
        Section(
            heading="Findings and warnings",
            tables=[table for table in (*causes, *found, *warned) if table.rows],
        ),
        _next(calibration),
        Section(
            heading="Measured against fitted",
            pictures=[] if signals is None else _fits(signals),
            folded=True,
        ),
        Section(heading="Stages", pictures=pictures, tables=[_stages(calibration)]),
        Section(heading="Noise and scatter", tables=_noise(calibration)),
        Section(heading="Sensors and movements", tables=_movements(calibration)),
        _inputs(calibration, panel),
        Section(heading="Versions", tables=[Table("", ("What", ""), _about(calibration))]),
    ]
    return Page(
        title=f"Calibration of {calibration.panel}",
        subtitle=f"To {calibration.data}; "
        f"{count_text(len(calibration.movements), 'movement')} in the last stage",
        findings=calibration_findings(calibration),
        synthetic=bool(calibration.about.get("synthetic")),
        sections=[s for s in sections if s.text or s.tables or s.pictures],
    )


def calibration_findings(calibration: Calibration) -> list[Finding]:
    """Return the findings of a calibration, unidentified parameters and warnings first."""
    free = [item for item in calibration.parameters if item.state != FIXED]
    identified = [item for item in free if item.state == FITTED]
    good = len(identified) == len(free) and not calibration.warnings
    count = len(calibration.warnings)
    detail = f"{count_text(count, 'warning')} below" if count else "no warning"
    answer = f"{len(identified)} of {len(free)} parameters"
    found = [
        _verdict(calibration),
        Finding("good" if good else "look", "Identified", answer, detail),
    ]
    for item in calibration.parameters:
        value = _shown(item, item.value)
        if item.state == FITTED:
            reach = value_text(*item.interval, unit=item.unit)
            found.append(Finding("fact", item.name, value, f"{reach} (95 % interval)"))
        elif item.state != FIXED:
            found.append(Finding("look", item.name, value, item.state))
    return found


def _verdict(calibration: Calibration) -> Finding:
    """Return the verdict on a calibration, trustworthy or not, with its reasons."""
    if calibration.distrust:
        return Finding("bad", "Verdict", "not trustworthy", "; ".join(calibration.distrust))
    causes = ", ".join(dict.fromkeys(text.split(":")[0] for text in calibration.causes))
    detail = f"with what is named as its cause: {causes}" if causes else "without any cause"
    return Finding("good", "Verdict", "the model follows the measurement", detail)


def sweep_sheet(stage: StageLog, calibration: Calibration) -> Sheet:
    """Return the misfit over the values that a stage has swept, as a share of the channels' range.

    Parameters
    ----------
    stage : StageLog
        One with a sweep.
    calibration : Calibration
        Calibration after its end.
    """
    known = {item.name: item for item in calibration.parameters}
    # A stage sweeps one parameter, the first that it changes.
    item = next((known[name] for name in stage.values if name in known), None)
    unit, size = ("", 1.0) if item is None else shown_unit(item.unit)
    label = "swept value" if item is None else f"{item.name} [{unit or '-'}]"
    line = Line(
        label="misfit",
        x=np.array(stage.sweep["value"]) / size,
        y=100 * np.array(stage.sweep["misfit"]),
        style="line and marks",
    )
    found = [Moment(item.value / size, "found")] if item is not None else []
    return Sheet(
        name=f"sweep-{stage.name.replace(' ', '-')}",
        title=f"Stage {stage.name}: misfit over the swept value",
        caption="The next stage starts at the lowest misfit; a flat minimum means low sensitivity.",
        x_label=label,
        rows=(Row("Misfit [% of range]", (line,)),),
        moments=tuple(found),
    )


def interval_sheet(calibration: Calibration) -> Sheet:
    """Return the 95 % interval of each fitted value about it, in per cent of the value."""
    lines = [
        Line(
            label=f"{number} {item.name}",
            x=np.array([number, number], dtype=np.float64),
            y=100 * (np.array(item.interval) - item.value) / abs(item.value),
            colour=number - 1,
            style="line and marks",
            width=2.2,
        )
        for number, item in enumerate(calibration.fitted, 1)
        if item.value
    ]
    return Sheet(
        name="intervals",
        title="95 % intervals of the fitted values",
        caption="From the lower to the upper end, about the value found.",
        x_label="Number of the value",
        rows=(Row("Off the value [%]", tuple(lines), (Level(0.0, ""),)),),
    )


def _intervals(calibration: Calibration, suffixes: tuple[str, ...]) -> list[Picture]:
    sheet = interval_sheet(calibration)
    return [_picture(sheet, suffixes)] if sheet.rows[0].lines else []


def _fits(signals: xr.Dataset) -> list[Picture]:
    """Return each movement as measured and as fitted; `calibrate --figures` has them as files."""
    sheets = (fit_sheet(signals, str(name)) for name in signals["movement"].values)
    return [Picture(sheet, {}, FEW_POINTS) for sheet in sheets]


def _next(calibration: Calibration) -> Section:
    """Return the movements to measure next, with the values that each would narrow."""
    rows = [
        tuple(text.removeprefix(NEXT).rsplit(": ", 1))
        for text in calibration.findings
        if text.startswith(NEXT)
    ]
    tables = [Table("", ("Movement", "What it would narrow"), rows)] if rows else []
    text = "" if rows else "Not looked for; `turnout calibrate --advise` ranks movements."
    return Section(heading="What to measure next", text=text, tables=tables)


def _picture(sheet: Sheet, suffixes: tuple[str, ...]) -> Picture:
    figure = draw_sheet(sheet)
    return Picture(sheet, {suffix: rendered(figure, suffix) for suffix in suffixes})


def _shown(item: Fitted, value: float, *, digits: int = 5) -> str:
    if math.isnan(value):
        return "unknown"
    return value_text(value, unit=item.unit, digits=digits)


def _parameters(calibration: Calibration) -> Table:
    rows = []
    for item in calibration.parameters:
        known = item.state == FITTED
        deviation = _shown(item, item.deviation, digits=2) if known else "-"
        reach = value_text(*item.interval, unit=item.unit) if known else "-"
        start = _shown(item, item.start, digits=4)
        bounds = value_text(item.lower, item.upper, unit=item.unit, digits=4)
        value = _shown(item, item.value)
        rows.append((item.name, value, deviation, reach, item.state, start, bounds))
    columns = (
        "Parameter",
        "Value",
        "Standard deviation",
        "95 % interval",
        "State",
        "Start",
        "Bounds",
    )
    marked = frozenset(
        n for n, item in enumerate(calibration.parameters) if item.state not in (FITTED, FIXED)
    )
    return Table("", columns, rows, marked)


def _together(calibration: Calibration) -> list[Heat]:
    """Return the correlations of the fitted parameters; strong ones are framed."""
    names = [item.name for item in calibration.fitted]
    correlation = calibration.correlation
    if len(names) < 2 or not np.isfinite(correlation).all():
        return []
    strong = (np.abs(correlation) > STRONG_CORRELATION) & ~np.eye(len(names), dtype=bool)
    heading = (
        "Correlation of the parameters; strongly correlated ones "
        f"(beyond {STRONG_CORRELATION:g}) are framed"
    )
    numbers = [str(number + 1) for number in range(len(names))]
    rows = [f"{number} {name}" for number, name in zip(numbers, names, strict=True)]
    return [Heat(heading, rows, numbers, correlation.tolist(), strong.tolist())]


def _stages(calibration: Calibration) -> Table:
    rows = [
        (stage.name, stage.method, str(len(stage.movements)), f"{stage.misfit:.3g}",
         str(stage.evaluations), str(stage.iterations), stage.message)
        for stage in calibration.stages
    ]  # fmt: skip
    columns = ("Stage", "Method", "Movements", "Misfit", "Throws", "Steps", "How it ended")
    return Table(
        "Misfit is the residual over its expected size: 1 means noise level", columns, rows
    )


def _noise(calibration: Calibration) -> list[Table]:
    parts = {
        "white": "From bin to bin [N]",
        "slow": "Slow [N]",
        "slow_length": "correlated over [s]",
        "missed": "Missed by the model [N]",
        "missed_length": "correlated over [s]",
        "left": "Missed alike, from bin to bin [N]",
    }
    noise = [
        (channel, *(f"{sizes[key]:.3g}" if key in sizes else "-" for key in parts))
        for channel, sizes in calibration.noise.items()
    ]
    scatter = [(name, f"{100 * share:.2g} %") for name, share in calibration.scatter.items()]
    columns = ("Channel", *parts.values())
    tables = [Table("Noise of each channel, as standard deviations", columns, noise)]
    tables = tables if noise else []
    if scatter:
        heading = "Scatter from movement to movement"
        tables.append(Table(heading, ("Parameter", "Share"), scatter))
    return tables


def _movements(calibration: Calibration) -> list[Table]:
    """Return sensors as found, and onset, friction, zeros, gains and residual of each movement."""
    tables = []
    if calibration.sensors:
        tables.append(Table("", ("Sensor",), [(text,) for text in calibration.sensors]))
    keys = list(dict.fromkeys(key for row in calibration.effects.values() for key in row))
    channels = list(dict.fromkeys(key.split(" ", 1)[1] for key in keys if " " in key))
    common = [key for key in keys if " " not in key]
    if keys:
        names = ["Onset [ms]" if key == "onset" else f"{key} [%]" for key in common]
        factors = [1e3 if key == "onset" else 100.0 for key in common]
        heading = "Each movement beside the common values"
        tables.append(_effects(calibration, heading, names, common, factors))
    for channel in channels:
        kind, _, drive = channel.partition(".")
        tables.append(
            _effects(
                calibration,
                f"{kind.replace('_', ' ').capitalize()}{f' of drive {drive}' if drive else ''}",
                ["Zero [N]", "Gain [%]", "Residual [N]"],
                [f"{part} {channel}" for part in ("zero", "gain", "residual")],
                [1.0, 100.0, 1.0],
            )
        )
    return tables


def _effects(
    calibration: Calibration,
    heading: str,
    names: list[str],
    keys: list[str],
    factors: list[float],
) -> Table:
    """Return a table of some effects of those movements that have any of them."""
    rows = [
        (
            movement,
            *(
                f"{factor * row[key]:.2f}" if key in row else "-"
                for key, factor in zip(keys, factors, strict=True)
            ),
        )
        for movement, row in calibration.effects.items()
        if any(key in row for key in keys)
    ]
    return Table(heading, ("Movement", *names), rows)


def _inputs(calibration: Calibration, panel: LoadedPanel | None) -> Section:
    attributes = {"panel": calibration.panel, "panel_hash": calibration.panel_hash}
    known = panel is not None and panel.hash == calibration.panel_hash
    return inputs_section(attributes, panel if known else None)


def _about(calibration: Calibration) -> list[tuple[str, str]]:
    rows = [(key.replace("_", " "), str(value)) for key, value in calibration.about.items()]
    return [
        *rows,
        ("panel", f"{calibration.panel} ({calibration.panel_hash[:12]})"),
        ("data", f"{calibration.data} ({calibration.data_hash[:12]})"),
    ]
