"""The command `turnout simulate`: one throw, or many in a row by `--throws`."""

import contextlib
import gc
import importlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from turnout.cli.options import (
    DATASET,
    FIGURE,
    PanelOptions,
    collect_errors,
    end_code,
    gives,
    option,
    read_texts,
)
from turnout.cli.output import INTERRUPTED, Output, coloured, note, refuse
from turnout.cli.watch import watched
from turnout.core.lean_imports import import_scipy, without_packages

if TYPE_CHECKING:
    import xarray as xr

    from turnout.core.scheme import Scheme
    from turnout.throw.drift import Drift


@gives("simulate", quiet=True, width=16, out=DATASET, plot=FIGURE)
def simulate_command(
    output: Output,
    panel: PanelOptions,
    objects: list[str] = option(
        "--object SIZE[ KIND]@PLACE[, KEY=VALUE]",
        "Foreign object, such as 13mm@sleeper6, '5 mm @ x = 3.6 m' or '20mm ice@sleeper6, "
        "length=2m' (an unknown kind lists all). Repeatable.",
        default=[],
    ),
    overlay: Path | None = option(
        "--overlay FILE.csv",
        "History of another program under the lines of --plot: columns 'time [s]', "
        "'drive_force:1 [kN]', ...",
    ),
    also: list[str] = option(
        "--also CHANNEL",
        "Also store this channel: gauge, fastening_force, fastening_moment.",
        default=[],
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
) -> None:
    """Simulate a throw, with or without trapped objects, and show how it ended."""
    plot, quiet = output["plot"], output.quiet
    many = throws is not None or bool(drifts)
    if many:
        _check_many(throws, {"--plot": plot, "--overlay": overlay, "--also": also or None})
    theirs, figure = _overlaid(overlay, plot), None
    with contextlib.nullcontext() if many else without_collections():
        import_scipy()
        from turnout.panel.foreign_object import parse_objects

        parts = (
            panel.opened,
            lambda: parse_objects(objects),
            lambda: _scheme(
                mode or ("quick" if many else "waveform"), step=step, cutoff=cutoff, every=every
            ),
        )
        try:
            if throws is not None:
                dataset = run_sequence(parts, throws=throws, drifts=drifts, quiet=quiet)
            else:
                dataset = _run(parts, also=also, quiet=quiet, plots=plot is not None)
            if plot is not None and dataset.sizes["time"] > 1:
                from turnout.figures.throw import plot_throw

                figure = plot_throw(dataset, overlay=theirs)
        except KeyboardInterrupt:
            note("interrupted before there was anything to keep")
            raise typer.Exit(INTERRUPTED) from None
        if not many or dataset.sizes["throw"] > 0:
            output.lines((sequence_lines if many else summary_lines)(dataset))
            output.dataset(output["out"], dataset)
            output.figure(plot if figure else None, lambda: figure)
            from turnout.calibration.load_study import case_name

            record = sequence_record if many else run_record
            output.json(record, dataset, case_name(panel.panel))
    if not dataset.attrs["complete"]:
        note(dataset.attrs["outcome_message"])
        raise typer.Exit(end_code(dataset))


def _check_many(throws: int | None, options: Mapping[str, object]) -> None:
    """Refuse options of one throw beside those of many in a row."""
    if throws is None:
        refuse("--drift: changes from throw to throw; say how many with --throws")
    refused = [name for name, given in options.items() if given is not None]
    if refused:
        refuse(f"{', '.join(refused)}: shows one throw, --throws makes several; use --out")


Parts = Sequence[Callable[[], Any]]
"""Panel, objects and scheme of a command line, each read when it is called."""


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


def _run(parts: Parts, *, also: list[str], quiet: bool, plots: bool) -> "xr.Dataset":
    """Return the dataset of one throw, whole or partial."""
    from turnout.panel.foreign_object import resolve_objects
    from turnout.throw.save import Save

    panel, foreign, chosen, save = collect_errors(*parts, lambda: Save(also=tuple(also)))
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
    return dataset


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

    fields = {
        "--step": ("step", TIME),
        "--cutoff": ("cutoff_frequency", FREQUENCY),
        "--every": ("output_interval", TIME),
    }
    found = read_texts(
        {"--step": step, "--cutoff": cutoff, "--every": every},
        lambda name, text: parse_quantity(text, fields[name][1]),
    )
    return Scheme.of(mode, **{fields[name][0]: value for name, value in found.items()})


def summary_lines(dataset: "xr.Dataset") -> Iterator[str]:
    """Yield the verdict on a throw, its meaning and its summary."""
    from turnout.metric.finding import headline
    from turnout.metric.summary import summary
    from turnout.throw.checks import checks
    from turnout.throw.verdict import verdict

    made = checks(dataset)
    found = verdict(dataset, made)
    yield f"{'verdict':<16}{coloured(found.text, headline(found, dataset).level)}"
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


def _origin(dataset: "xr.Dataset", case: str | None) -> dict[str, Any]:
    """Return panel, or case of a study, objects and outcome of a run."""
    from turnout.throw.verdict import break_note

    note, attributes = break_note(dataset), dataset.attrs
    names = ("panel", "panel_hash", "outcome", "outcome_message", "wall_time")
    return {
        "case": case,
        **{name: attributes.get(name) for name in names},
        "foreign_objects": json.loads(attributes.get("foreign_objects", "[]")),
        "complete": bool(attributes["complete"]),
        **({"break_note": note} if note else {}),
    }


def run_record(
    dataset: "xr.Dataset", case: str | None = None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return a run: verdict, key figures, energies, and the units of its keys."""
    from turnout.metric.key_figure import key_figures
    from turnout.metric.summary import numerical_share, residual_share, start_difference
    from turnout.throw.checks import checks
    from turnout.throw.verdict import verdict

    made = checks(dataset)
    figures = key_figures(dataset, made) if dataset.sizes.get("time", 0) else []
    judged, attributes = verdict(dataset, made), dataset.attrs
    balanced = float(attributes.get("energy_scale", 0.0)) > 0 and "energy_residual" in dataset
    record = {
        **_origin(dataset, case),
        "overrides": json.loads(attributes.get("overrides", "{}")),
        "verdict": {**asdict(judged), "meaning": judged.meaning},
        "checks": made,
        "figures": {item.key: item.value for item in figures},
        "labels": {item.key: item.label for item in figures},
        "energy_scale": attributes.get("energy_scale"),
        "energy_residual_share": residual_share(dataset) if balanced else None,
        "numerical_dissipation_share": numerical_share(dataset) if balanced else None,
        "loaded_by": attributes.get("loaded_by"),
        "start_difference": start_difference(dataset),
    }
    return record, {**RUN_UNITS, **{item.key: item.unit for item in figures}}


MOST_ROWS = 20
"""Throws that are printed; all are in the file and in --json."""


def read_drift(settings: Sequence[str]) -> "Drift":
    """Read the changes from throw to throw from KEY=VALUE of a command line.

    Raises
    ------
    FileError
        With all problems at once.

    Examples
    --------
    >>> read_drift(["ice_growth=0.3mm", "temperature=-20 degC to -5 degC"]).temperature
    (253.15, 268.15)
    """
    from dataclasses import fields

    from turnout.core.errors import ResponseError
    from turnout.core.problems import choices, nearest
    from turnout.throw.drift import Drift

    names = [item.name for item in fields(Drift)]
    found: dict[str, Any] = {}
    problems = []
    for setting in settings:
        key, sign, value = (part.strip() for part in setting.partition("="))
        if not sign or not value:
            problems.append(f'--drift "{setting}": is not KEY=VALUE')
        elif key not in names:
            known = f"there are {choices(names)}"
            problems.append(
                f'--drift "{setting}": there is no such key{nearest(key, names)}; {known}'
            )
        elif key in found:
            problems.append(f'--drift "{setting}": {key} is given twice')
        elif key == "temperature" and value.split()[-1] == "to":
            problems.append(f'--drift "{setting}": give both ends, as in "-20 degC to -5 degC"')
        elif key == "temperature":
            found[key] = tuple(part.strip() for part in value.split(" to "))
        else:
            found[key] = _number_or_text(key, value)
    if not problems:
        try:
            return Drift(**found)
        except ResponseError as error:
            problems.append(str(error))
    refuse("\n".join(problems))


def _number_or_text(key: str, value: str) -> int | float | str:
    """Return a plain number; a value that needs a unit keeps its text; a bare one is refused."""
    from turnout.throw.drift import WITH_UNIT

    if key in WITH_UNIT:
        return value
    try:
        return int(value) if key == "seed" else float(value)
    except ValueError:
        return value


def run_sequence(parts: Parts, *, throws: int, drifts: list[str], quiet: bool) -> "xr.Dataset":
    """Make throws in a row with progress; those until an interruption or a failure come back."""
    from turnout.throw.sequence import simulate_sequence

    panel, objects, scheme, drift = collect_errors(*parts, lambda: read_drift(drifts))
    with watched(f"simulating {throws} throws of {panel.name}", quiet=quiet) as watch:
        return simulate_sequence(
            panel,
            throws=throws,
            foreign_object=objects,
            drift=drift,
            scheme=scheme,
            throw=False,
            report=watch.report,
        )


def sequence_record(
    dataset: "xr.Dataset", case: str | None = None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return a sequence of throws as a record, and the units of its keys."""
    from turnout.throw.verdict import throw_table

    record = {
        **_origin(dataset, case),
        "drift": json.loads(dataset.attrs["drift"]),
        "throws": throw_table(dataset),
    }
    units = {
        "size": "m", "left": "m", "object_force_peak": "N", "drive_force_end": "N",
        "force_margin": "N", "temperature": "K", "wall_time": "s",
    }  # fmt: skip
    return record, units


def sequence_lines(dataset: "xr.Dataset") -> Iterator[str]:
    """Yield a table of the throws, of many only some."""
    from turnout.throw.verdict import break_note, throw_table

    count = dataset.sizes["throw"]
    every = max(1, -(-count // MOST_ROWS))
    shown = [*range(0, count - 1, every), count - 1]
    yield (
        f"{'throw':>6} {'size':>10} {'left':>10} {'object':>9} {'drives':>14}  "
        f"{'verdict':<18}lock, control"
    )
    for row in throw_table(dataset.isel(throw=shown)):
        size = "+".join(f"{1e3 * value:.1f}" for value in row["size"]) or "-"
        left = "+".join(f"{1e3 * value:.1f}" for value in row["left"]) or "-"
        peak = 1e-3 * row["object_force_peak"]
        drives = "/".join(f"{1e-3 * value:.2f}" for value in row["drive_force_end"])
        yield (
            f"{row['throw']:>6} {size:>7} mm {left:>7} mm {peak:>6.2f} kN {drives:>11} kN  "
            f"{row['verdict']:<18}{row['state']}"
        )
    yield f"{count} throws, {dataset.attrs['wall_time']:.1f} s"
    if note := dataset.attrs.get("object_peak_note"):
        yield f"object: {note}"
    if note := break_note(dataset):
        yield coloured(note, "look")
