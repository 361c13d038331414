"""Make and read the throws of the benchmark, and write their data card.

A switch is thrown as a sweep; what the benchmark keeps of it goes to one file and the sweep is
deleted. The files of all switches are joined at the end. An interrupted run continues with the
switches that have no file.
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.detection.definition import (
    TEST,
    TRAIN,
    VERSION,
    Counts,
    Switch,
    definition_digest,
    panels_study,
    switches_of,
)
from benchmarks.detection.switch_throws import SwitchThrows, throws_of_switch
from turnout.core.errors import FileError
from turnout.core.files import atomic_path, write_atomic
from turnout.core.kept_results import claim_for
from turnout.core.provenance import version
from turnout.core.workers import Workers
from turnout.detection.conditions import SIMULATED
from turnout.detection.detector.throw_layout import Layout, throw_features
from turnout.detection.detector.training import layout_of_panel
from turnout.study.sweep.read import last_values, open_batches
from turnout.study.sweep.run import sweep_workers, throw_study

Floats = NDArray[np.float64]
Report = Callable[[int, int], None]
"""Called with how many switches are done, and of how many."""

STEP = 0.02
"""Samples of a history are means over so long [s]."""
QUANTUM = {"force": 0.5, "current": 2e-3, "power": 0.25}
"""Histories are stored in whole multiples of this, [N], [A] and [W]: the noise is 10 times more."""
DEFINITION, THROWS, CARD = "benchmark.json", "detection-benchmark.nc", "data-card.md"
SWITCHES = "switches"


def fine_layout(layout: Layout) -> Layout:
    """Return the same movements with windows of `STEP`, which the windows of features consist of.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> fine_layout(layout_of_panel(load_panel("uic60-760-1-15"))).windows
    408
    """
    parts = [
        replace(part, window=STEP, count=round(part.count * part.window / STEP))
        for part in layout.parts
    ]
    return Layout(parts=tuple(parts), drives=layout.drives)


def make_throws(
    folder: Path, counts: Counts, *, workers: int = 1, report: Report | None = None
) -> Path:
    """Throw the missing switches of the benchmark, and return the file of all of them.

    Parameters
    ----------
    folder : Path
        Made if it is not there; must be empty, or hold the beginning of this benchmark.
    counts : Counts
        Switches and throws.
    workers : int
        Processes.
    report : callable, optional
        Called after each switch.

    Raises
    ------
    FileError
        When the folder is that of another benchmark.
    """
    digest = definition_digest(counts)
    about = {"benchmark": VERSION, "digest": digest, "counts": asdict(counts)}
    claim_for(folder, DEFINITION, about | {"turnout": version()}, what="benchmark")
    whole = folder / THROWS
    if whole.exists():
        return whole
    switches = switches_of(counts)
    (folder / SWITCHES).mkdir(exist_ok=True)
    paths = [folder / SWITCHES / f"{item.number:03d}.nc" for item in switches]
    with sweep_workers(workers) as processes:
        for done, (switch, path) in enumerate(zip(switches, paths, strict=True)):
            if report is not None:
                report(done, len(switches))
            if not path.exists():
                _throw_switch(switch, counts, path, workers=processes)
    _join(paths, whole, digest=digest, counts=counts)
    shutil.rmtree(folder / SWITCHES)
    if report is not None:
        report(len(switches), len(switches))
    return whole


def _throw_switch(switch: Switch, counts: Counts, path: Path, *, workers: Workers) -> None:
    throws = throws_of_switch(switch, counts)
    sweep = path.with_suffix("")
    throw_study(throws.plan.study, sweep, workers=workers)
    with open_batches(sweep) as dataset:
        found = collected(switch, throws, dataset)
    with atomic_path(path) as temporary:
        found.to_netcdf(temporary, engine="h5netcdf", encoding=encoding_of(found))
    shutil.rmtree(sweep)


def collected(switch: Switch, throws: SwitchThrows, dataset: xr.Dataset) -> xr.Dataset:
    """Return the stored variables of the complete throws of a switch."""
    plan, panel = throws.plan, throws.plan.study.panel
    fine = fine_layout(layout_of_panel(panel))
    onsets = np.tile([part.start for part in fine.parts], (len(throws.role), 1))
    onsets[:, -1] = plan.start
    time = dataset["time"].to_numpy().astype(np.float64)
    channels: dict[str, Floats] = {}
    for name in QUANTUM:
        if f"drive_{name}" not in dataset:
            continue
        values = dataset[f"drive_{name}"].to_numpy().astype(np.float64)
        ended = np.where(np.isfinite(values), values, 0.0)
        found = throw_features(time, ended, layout=fine, onsets=onsets)
        found = found.reshape(len(found), len(fine.drives), -1)
        channels |= {f"{name} {drive}": found[:, at] for at, drive in enumerate(fine.drives)}
    ended = (dataset["outcome"].astype(str) == "complete").to_numpy()
    partner = plan.partner.copy()
    kept = np.flatnonzero(ended & ((partner < 0) | ended[np.maximum(partner, 0)]))
    new = np.full(len(ended), -1)
    new[kept] = np.arange(len(kept))
    history = np.full((len(kept), len(SIGNALS), fine.windows), np.nan)
    for name, item in channels.items():
        history[:, SIGNALS.index(name)] = item[kept]
    gaps = [last_values(dataset["sensor_gap"]), dataset["end_gap"].to_numpy()]
    limits = [f"sensor {name}" for name in panel.sensor] + [f"drive {name}" for name in panel.drive]
    per_throw = {
        "role": np.array(throws.role), "kind": np.array(throws.kind),
        "place": np.array(throws.place), "size": throws.size, "x": throws.x,
        "moment": throws.moment, "level": plan.level,
        "object_force": dataset["object_force_peak"].to_numpy(),
        "locked": dataset["end_locked"].to_numpy().astype(np.int8),
    }  # fmt: skip
    labels = {name: ("throw", item[kept]) for name, item in per_throw.items()}
    count = len(kept)
    fixed = {
        "switch": switch.number, "panel": switch.panel, "track": switch.track,
        "machine": switch.machines[0] if switch.machines else "", "rate": switch.rate,
        "split": switch.split,
    }  # fmt: skip
    return xr.Dataset(
        {
            "history": (("throw", "signal", "sample"), history),
            "gap": (("throw", "position"), np.hstack(gaps)[kept]),
            "partner": ("throw", np.where(partner < 0, -1, new[partner])[kept]),
            "inputs": (("throw", "input"), plan.inputs[kept]),
            **labels,
            **{name: ("throw", np.full(count, value)) for name, value in fixed.items()},
        },
        {"signal": list(SIGNALS), "position": limits},
        {"inputs": "; ".join(throws.inputs)},
    )


SIGNALS = ("force 1", "force 2", "current 1", "current 2", "power 1", "power 2")


def encoding_of(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return how each variable is stored: histories as whole numbers, all of it compressed."""
    found: dict[str, dict[str, Any]] = {}
    for name, item in dataset.data_vars.items():
        if item.dtype.kind in "fiu":
            found[str(name)] = {"zlib": True, "complevel": 4, "shuffle": True}
    return found


def _join(paths: list[Path], whole: Path, *, digest: str, counts: Counts) -> None:
    """Write the file of all switches."""
    parts: list[xr.Dataset] = []
    quantum = np.array([QUANTUM[name.split()[0]] for name in SIGNALS])
    for path in paths:
        with xr.open_dataset(path, engine="h5netcdf") as part:
            own = part.load()
        before = sum(item.sizes["throw"] for item in parts)
        own["partner"] = own["partner"].where(own["partner"] < 0, own["partner"] + before)
        for name in TEXTS:  # of different lengths
            own[name] = own[name].astype(object)
        # a quarter of the memory before all are joined
        own["history"] = (own["history"].dims, quantized(own["history"].to_numpy(), quantum))
        parts.append(own)
    joined = xr.concat(parts, "throw", join="exact")
    joined["quantum"] = ("signal", quantum)
    layout = fine_layout(layout_of_panel(panels_study().panel))
    joined = joined.assign_coords(time=("sample", layout.time[: layout.windows]))
    joined.attrs |= {
        "benchmark": VERSION,
        "definition": digest,
        "counts": json.dumps(asdict(counts)),
        "turnout": version(),
        "data": data_digest(joined),
    }
    with atomic_path(whole) as temporary:
        joined.to_netcdf(temporary, engine="h5netcdf", encoding=encoding_of(joined))


def quantized(history: Floats, quantum: Floats) -> NDArray[np.int16]:
    """Return histories in multiples of a quantum for each signal; `MISSING` for NaN.

    Parameters
    ----------
    history : ndarray, shape (n, n_signals, n_samples)
        NaN where there is no such channel.
    quantum : ndarray, shape (n_signals,)
        In the unit of each.

    Examples
    --------
    >>> quantized(np.array([[[1.2, np.nan]]]), np.array([0.5])).tolist()
    [[[2, -32768]]]
    """
    steps = np.clip(np.rint(history / quantum[:, np.newaxis]), -32767, 32767)
    return np.asarray(np.where(np.isfinite(steps), steps, MISSING).astype(np.int16))


TEXTS = ("role", "kind", "place", "track", "machine", "split")
MISSING = -32768
"""Stands in histories where there is no such channel."""


def data_digest(dataset: xr.Dataset) -> str:
    """Return a digest of histories and labels, whatever file they are in."""
    found = hashlib.sha256()
    for name in ("history", "gap", "switch", "role", "kind", "place", "size", "split"):
        values = dataset[name].to_numpy()
        found.update(name.encode())
        found.update(
            "\0".join(map(str, values)).encode() if values.dtype.kind in "OUST"
            else np.ascontiguousarray(np.round(values, 9)).tobytes()
        )  # fmt: skip
    return found.hexdigest()


def read_throws_file(folder: Path, *, recorded: bool = True) -> xr.Dataset:
    """Return the stored throws, with or without their histories."""
    path = folder / THROWS
    try:
        with xr.open_dataset(path, engine="h5netcdf") as found:
            whole = (found if recorded else found.drop_vars("history")).load()
        version = int(whole.attrs["benchmark"])
    except FileNotFoundError:
        run = f"python -m benchmarks.detection run {folder}"
        message = f"{folder}: holds no finished benchmark; run: {run}"
        raise FileError(message) from None
    except (OSError, ValueError, KeyError) as error:
        message = f"{path}: is damaged or no benchmark ({error}); delete it and make it again"
        raise FileError(message) from None
    if version != VERSION:
        message = f"{path}: is version {version} of the benchmark; this program knows {VERSION}"
        raise FileError(message)
    return whole.assign_coords(throw=np.arange(whole.sizes["throw"]))


# ---- data card


def write_card(folder: Path) -> Path:
    """Write the data card of a benchmark that was made."""
    path = folder / CARD
    write_atomic(path, data_card(read_throws_file(folder), size=(folder / THROWS).stat().st_size))
    return path


def data_card(whole: xr.Dataset, *, size: int) -> str:
    """Return the data card as Markdown.

    Parameters
    ----------
    whole : xarray.Dataset
        The stored throws.
    size : int
        Of their file [bytes].
    """
    role, split = whole["role"].to_numpy(), whole["split"].to_numpy()
    track, switch = whole["track"].to_numpy(), whole["switch"].to_numpy()
    panel, kind = whole["panel"].to_numpy(), whole["kind"].to_numpy()
    lines = [
        f"# Data card: open benchmark of foreign-object detection in switches, version {VERSION}",
        "",
        f"{whole.sizes['throw']} simulated throws of {len(np.unique(switch))} switches with "
        f"{len(np.unique(panel))} different panels; {size / 1e6:.1f} MB. Every throw is an opening "
        f"and a closing. {SIMULATED.capitalize()}.",
        "",
        "| | " + " | ".join(f"{s}, {t}" for t in ("markers", "machines") for s in (TRAIN, TEST))
        + " |",
        "|---|" + "--:|" * 4,
    ]  # fmt: skip
    groups = [(track == t) & (split == s) for t in ("markers", "machines") for s in (TRAIN, TEST)]

    def row(name: str, counts: Sequence[int]) -> str:
        return f"| {name} | " + " | ".join(str(number) for number in counts) + " |"

    lines += [
        row("switches", [len(np.unique(switch[own])) for own in groups]),
        row("panels", [len(np.unique(panel[own])) for own in groups]),
        row("throws", [int(own.sum()) for own in groups]),
    ]
    lines += [
        row(str(name), [int((role[own] == name).sum()) for own in groups])
        for name in dict.fromkeys(role.tolist())
    ]
    lines += [
        row(f"object: {name}", [int((kind[own] == name).sum()) for own in groups])
        for name in np.unique(kind[kind != ""])
    ]
    both = set(panel[split == TRAIN].tolist()) & set(panel[split == TEST].tolist())
    machine = whole["machine"].to_numpy()
    named = ", ".join(sorted({str(name) for name in machine[machine != ""]})) or "none"
    sized = whole["size"].to_numpy()[role == "object"]
    force = whole["object_force"].to_numpy()[role == "object"]
    rates = ", ".join(f"{rate:g}" for rate in np.unique(whole["rate"].to_numpy())[::-1])
    lines += [
        "",
        f"- Panels on both sides of the split: {len(both)}.",
        f"- Machines of Drive 1 on the track machines: {named}.",
        f"- Objects: {1e3 * sized.min():.1f} to {1e3 * sized.max():.1f} mm; "
        f"{100 * np.mean(force > 5.0):.0f} % are touched (more than 5 N).",
        f"- Recorders: {rates} samples a second; histories are means over 20 ms.",
        f"- Friction level: {whole['level'].to_numpy().min():.2f} to "
        f"{whole['level'].to_numpy().max():.2f}.",
        f"- Locked at the end: {100 * np.mean(whole['locked'].to_numpy() == 1):.0f} % of throws.",
        "",
        f"Definition `{whole.attrs['definition']}`",
        "",
        f"Data `{whole.attrs['data']}`",
        "",
        f"Made by turnout {whole.attrs['turnout']}.",
        "",
    ]
    return "\n".join(lines)
