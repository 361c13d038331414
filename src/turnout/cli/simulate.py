"""The command `turnout simulate`."""

import contextlib
import gc
import importlib
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from turnout.cli.options import (
    FIGURES,
    CalibrationOption,
    DatasetOption,
    FigureOption,
    PanelArgument,
    QuietOption,
    SetOption,
    check_outputs,
    collect_errors,
    end_code,
    opened_panel,
    option,
)
from turnout.cli.output import INTERRUPTED, JsonOption, Output, coloured, note, refuse
from turnout.cli.watch import watched
from turnout.core.lean_imports import import_scipy, without_packages

if TYPE_CHECKING:
    import xarray as xr

    from turnout.core.scheme import Scheme
    from turnout.panel.load import LoadedPanel


def simulate_command(
    panel: PanelArgument = None,
    objects: list[str] = option(
        "--object SIZE[ KIND]@PLACE[, KEY=VALUE]",
        "Foreign object, such as 13mm@sleeper6, '5 mm @ x = 3.6 m' or '20mm ice@sleeper6, "
        "length=2m' (an unknown kind lists all). Repeatable.",
        default=[],
    ),
    settings: SetOption = [],  # noqa: B006 - typer copies it
    calibration: CalibrationOption = None,
    out: DatasetOption = None,
    plot: FigureOption = None,
    overlay: Path | None = option(
        "--overlay FILE.csv",
        "History of another program under the lines of --plot: columns 'time [s]', "
        "'drive_force:1 [kN]', ...",
    ),
    also: list[str] = option(
        "--also CHANNEL", "Also store this channel: fastening_force, fastening_moment.", default=[]
    ),
    mode: str | None = option(
        "--mode MODE",
        "waveform: impacts and single chairs; quick: drives, gaps and labels, several times as "
        "fast; quasi-static: without inertia. Default waveform.",
        show_default=False,
    ),
    step: str = option("--step TIME", "Time step instead of the mode's.", default=""),
    cutoff: str = option(
        "--cutoff FREQUENCY",
        "Inertia of vibration modes up to here, instead of the mode's.",
        default="",
    ),
    every: str = option(
        "--every TIME",
        "Time between stored instants; need not be a multiple of the step.",
        default="",
    ),
    throws: int | None = option(
        "--throws N",
        "Throw N times; objects keep dents and what is left. --mode is then quick unless given.",
        min=1,
    ),
    drifts: list[str] = option(
        "--drift KEY=VALUE",
        "What changes from throw to throw, such as ice_growth=0.3mm, 'temperature=-20 degC to "
        "2 degC', friction=0.001. Repeatable.",
        default=[],
    ),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate a throw, with or without trapped objects, and show how it ended."""
    check_outputs({"--out": out, "--plot": plot}, {"--out": (".nc",), "--plot": FIGURES})
    output = Output("simulate", as_json=as_json, quiet=quiet, width=16)
    if throws is not None or drifts:
        refused = {"--plot": plot, "--overlay": overlay, "--also": also or None}
        _simulate_throws(
            lambda: opened_panel(panel, settings, calibration),
            objects,
            throws=throws,
            drifts=drifts,
            scheme=lambda: _scheme(mode or "quick", step=step, cutoff=cutoff, every=every),
            out=out,
            refused=[option for option, given in refused.items() if given is not None],
            output=output,
            quiet=quiet,
        )
        return
    theirs = _overlaid(overlay, plot)
    with without_collections():
        try:
            dataset, failed = _run(
                panel,
                objects,
                settings,
                calibration=calibration,
                also=also,
                scheme=lambda: _scheme(mode or "waveform", step=step, cutoff=cutoff, every=every),
                quiet=quiet,
                plots=plot is not None,
            )
            figure = None
            if plot is not None and dataset.sizes["time"] > 1:
                from turnout.figures.throw import plot_throw

                figure = plot_throw(dataset, overlay=theirs)
        except KeyboardInterrupt:
            note("interrupted before there was anything to keep")
            raise typer.Exit(INTERRUPTED) from None
        if not output.silent:
            output.show(*summary_lines(dataset))
        output.dataset(out, dataset)
        output.figure(plot if figure else None, lambda: figure)
        if as_json:
            record, units = run_record(dataset)
            output.json(record, units=units)
    if failed:
        _end(dataset)


def _end(dataset: "xr.Dataset") -> None:
    """Say why a run is not complete; end with its exit code."""
    note(dataset.attrs["outcome_message"])
    raise typer.Exit(end_code(dataset))


def _simulate_throws(
    panel: Callable[[], "LoadedPanel"],
    objects: list[str],
    *,
    throws: int | None,
    drifts: list[str],
    scheme: Callable[[], "Scheme"],
    out: Path | None,
    refused: list[str],
    output: Output,
    quiet: bool,
) -> None:
    """Simulate throws in a row and show or write them; those until an interruption too."""
    from turnout.cli.sequence import read_drift, run_sequence, sequence_lines, sequence_record
    from turnout.panel.object_text import parse_objects

    if throws is None:
        refuse("--drift: changes from throw to throw; say how many with --throws")
    if refused:
        refuse(f"{', '.join(refused)}: shows one throw, --throws makes several; use --out")
    loaded, foreign, (chosen, drift, _) = collect_errors(
        panel,
        lambda: parse_objects(objects),
        lambda: collect_errors(scheme, lambda: read_drift(drifts), lambda: None),
    )
    dataset = run_sequence(loaded, foreign, throws=throws, drift=drift, scheme=chosen, quiet=quiet)
    if dataset.sizes["throw"] > 0:
        if not output.silent:
            output.show(*sequence_lines(dataset))
        output.dataset(out, dataset)
        if output.as_json:
            record, units = sequence_record(dataset)
            output.json(record, units=units)
    if not dataset.attrs["complete"]:
        _end(dataset)


def preload(*, plots: bool) -> None:
    """Load libraries for datasets, and for figures if they are wanted, while kernels work.

    It begins with the steps and not before: what loads at the same time only waits for each other.
    What writes files is loaded once the histories of the run are gone, which takes less memory. A
    failure here occurs again, with its message, when the dataset is made.
    """
    with contextlib.suppress(Exception):
        importlib.import_module("turnout.throw.dataset")
        importlib.import_module("xarray")
        if plots:
            importlib.import_module("turnout.figures.throw")


def _run(
    name: str | None,
    objects: list[str],
    settings: list[str],
    *,
    calibration: Path | None,
    also: list[str],
    scheme: Callable[[], "Scheme"],
    quiet: bool,
    plots: bool,
) -> tuple["xr.Dataset", bool]:
    """Return the dataset, whole or partial, and True if the run ended early."""
    import_scipy()
    from turnout.panel.foreign_object import resolve_objects
    from turnout.panel.object_text import parse_objects
    from turnout.throw.save import Save

    panel, foreign, (chosen, save, _) = collect_errors(
        lambda: opened_panel(name, settings, calibration),
        lambda: parse_objects(objects),
        lambda: collect_errors(scheme, lambda: Save(also=tuple(also)), lambda: None),
    )
    objects_placed = resolve_objects(panel, foreign)

    from turnout.throw.object_fit import check_placed
    from turnout.throw.simulate import release_memory, simulate_placed

    rehearsal = threading.Thread(target=preload, kwargs={"plots": plots}, daemon=True)

    # For both threads, whichever imports pandas. No array of a run has units by pint.
    left_out = without_packages("pyarrow", "pint")
    with left_out, watched(f"simulating {panel.name}", quiet=quiet) as watch:

        def report(done: int, steps: int) -> None:
            if rehearsal.ident is None:
                rehearsal.start()
            watch.report(done, steps)

        dataset = simulate_placed(
            panel,
            objects_placed,
            scheme=chosen,
            save=save,
            throw=False,
            report=report,
        )
        if rehearsal.ident is not None:
            rehearsal.join()  # files are written by one at a time
    release_memory()
    check_placed(dataset)
    return dataset, not dataset.attrs["complete"]


def _overlaid(overlay: Path | None, plot: Path | None) -> "xr.Dataset | None":
    """Read the history of another program, before anything long begins."""
    if overlay is None:
        return None
    if plot is None:
        refuse(f"--overlay {overlay}: is drawn in the figure; name one with --plot")
    from turnout.measurement.formats.history import read_history

    return read_history(overlay)


def _scheme(mode: str, *, step: str, cutoff: str, every: str) -> "Scheme":
    """Return the scheme of a mode, with given values instead of its own choices."""
    from turnout.core.scheme import Scheme
    from turnout.core.units import FREQUENCY, TIME, parse_quantity

    changes: dict[str, float] = {}
    problems = []
    for key, name, text, dimension in (
        ("step", "--step", step, TIME),
        ("cutoff_frequency", "--cutoff", cutoff, FREQUENCY),
        ("output_interval", "--every", every, TIME),
    ):
        if not text:
            continue
        try:
            changes[key] = parse_quantity(text, dimension)
        except ValueError as error:
            problems.append(f"{name} {text}: {error}")
    if problems:
        refuse("\n".join(problems))
    return Scheme.of(mode, **changes)


def summary_lines(dataset: "xr.Dataset") -> Iterator[str]:
    """Yield the verdict on a throw, its meaning, and what happened in it."""
    from turnout.metric.checks import checks
    from turnout.metric.finding import headline
    from turnout.metric.summary import summary
    from turnout.metric.verdict import verdict

    made = checks(dataset)
    found = verdict(dataset, made)
    judged = headline(found, dataset)
    level = "look" if judged is None else judged.level
    yield f"{'verdict':<16}{coloured(found.text, level)}"
    if found.meaning:
        yield f"{'meaning':<16}{found.meaning}"
    for heading, text in summary(dataset, made):
        fault = heading == "WARNING" or text.startswith(("NO ", "NO:", "NOT ", "INACCURATE"))
        yield f"{heading:<16}{coloured(text, 'bad') if fault else text}"


@contextmanager
def without_collections() -> Iterator[None]:
    """Collect no cycles for a while, as one that loads libraries and is soon over.

    Loading makes some hundred thousand objects that stay, and each collection looks through all of
    them: a seventh of a short command. Most memory is freed without collections.

    Examples
    --------
    >>> with without_collections():
    ...     gc.isenabled()
    False
    >>> gc.isenabled()
    True
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


RUN_UNITS = {"energy_scale": "J", "wall_time": "s", "start_difference": "N"}


def run_record(dataset: "xr.Dataset") -> tuple[dict[str, Any], dict[str, str]]:
    """Return a run: verdict, key figures, energies, and the units of its keys."""
    from turnout.metric.checks import checks
    from turnout.metric.key_figure import key_figures
    from turnout.metric.summary import numerical_share, residual_share, start_difference
    from turnout.metric.verdict import break_note, verdict

    figures, made = key_figures(dataset) if dataset.sizes.get("time", 0) else [], checks(dataset)
    judged, note = verdict(dataset, made), break_note(dataset)
    attributes = dataset.attrs
    balanced = float(attributes.get("energy_scale", 0.0)) > 0 and "energy_residual" in dataset
    record = {
        "panel": attributes.get("panel"),
        "panel_hash": attributes.get("panel_hash"),
        "overrides": json.loads(attributes.get("overrides", "{}")),
        "foreign_objects": json.loads(attributes.get("foreign_objects", "[]")),
        "complete": bool(attributes["complete"]),
        "outcome": attributes["outcome"],
        "outcome_message": attributes["outcome_message"],
        "verdict": {**asdict(judged), "meaning": judged.meaning},
        "checks": made,
        **({"break_note": note} if note else {}),
        "figures": {item.key: item.value for item in figures},
        "labels": {item.key: item.label for item in figures},
        "energy_scale": attributes.get("energy_scale"),
        "energy_residual_share": residual_share(dataset) if balanced else None,
        "numerical_dissipation_share": numerical_share(dataset) if balanced else None,
        "loaded_by": attributes.get("loaded_by"),
        "start_difference": start_difference(dataset),
        "wall_time": attributes.get("wall_time"),
    }
    return record, {**RUN_UNITS, **{item.key: item.unit for item in figures}}
