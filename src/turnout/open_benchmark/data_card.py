"""The data card of the benchmark, written from the data."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.core.files import write_atomic
from turnout.open_benchmark.definition import TEST, TRAIN, VERSION
from turnout.open_benchmark.make_throws import THROWS
from turnout.open_benchmark.sides import read_throws_file

CARD = "data-card.md"


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
        "and a closing.",
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
