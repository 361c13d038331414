"""Files of a virtual campaign: recordings, channel map, run sheet with its mistakes."""

import csv
import io
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.core.files import write_atomic
from turnout.core.provenance import version
from turnout.measurement.campaign.run_sheet import SheetRow
from turnout.measurement.chain.apply import raw_from_physical
from turnout.measurement.chain.channel_map import OF_DRIVES, ChannelMap
from turnout.measurement.chain.monitoring import COLUMNS
from turnout.measurement.chain.recorder import PERFECT, Recorder
from turnout.measurement.formats.file_format import WRITERS
from turnout.study.virtual.campaign_plan import Case

SHEET, CHANNELS = "runs.csv", "channels.toml"
START = datetime(2025, 1, 1, 8, 0, 0)


def synthetic_note(panel: str, *, machines: int = 0, drives: int = 1) -> str:
    """Return the sentence that every file of a virtual campaign carries.

    Parameters
    ----------
    panel : str
        Name of the simulated panel.
    machines, drives : int
        How many drives are machines, whose currents are simulated, and how many there are.

    Examples
    --------
    >>> synthetic_note("sb2").startswith("synthetic: simulated with turnout")
    True
    """
    note = f"synthetic: simulated with turnout {version()} on panel {panel}, not measured; "
    if machines == drives:
        return f"{note}motor currents are those of the simulated machines"
    which = "the currents of drives without a machine" if machines else "motor currents"
    return f"{note}{which} follow an assumed law"


def channel_map_text(drives: Sequence[str], *, note: str, recorder: Recorder = PERFECT) -> str:
    """Return a channel map for strain-gauged rods, clamps and a load cell.

    Parameters
    ----------
    drives : sequence of str
        Names of the drives.
    note : str
        Origin, as stated in the file.
    recorder : Recorder
        Response of the recorder to forces, as stated in the file.
    """
    lines = [f"# {note}", 'title = "strain-gauged drive rods, current clamps, a load cell"']
    lines += [*recorder.map_lines(), ""]
    for name in drives:
        lines += [
            f"[drive_force.{name}]",
            f'column = "Rod {name}"',
            'kind = "strain bridge"',
            'unit = "mV/V"',
            'bridge = "full T"',
            "gauge_factor = 2.1",
            "poisson_ratio = 0.3",
            'youngs_modulus = "210 GPa"',
            'section_modulus = "6.28 cm^3"',
            'eccentricity = "60 mm"',
            "",
            f"[drive_current.{name}]",
            f'column = "Clamp {name}"',
            'kind = "clamp"',
            'unit = "V"',
            'sensitivity = "100 mV/A"',
            "",
        ]
    lines += [
        "[object_force]",
        'column = "Load cell"',
        'kind = "load cell"',
        'unit = "mV/V"',
        'sensitivity = "1 mV/V"',
        'capacity = "20 kN"',
        "optional = true",
    ]
    return "\n".join(lines) + "\n"


def monitoring_map_text(
    transformers: Mapping[str, Sequence[str]], machines: Collection[str], *, note: str
) -> str:
    """Return a channel map for the files of a monitoring system.

    Parameters
    ----------
    transformers : mapping of str to sequence of str
        Names in the files, and the drives of each.
    machines : collection of str
        Drives that are machines, whose voltages and powers are stored too.
    note : str
        Origin, as stated in the file.

    Examples
    --------
    >>> print(monitoring_map_text({"switch": ["1", "2"]}, (), note="simulated"))
    # simulated
    title = "monitoring system"
    <BLANKLINE>
    [drive_current."1+2"]
    column = "Current switch"
    kind = "scaled"
    <BLANKLINE>
    """
    lines = [f"# {note}", 'title = "monitoring system"', ""]
    for name, drives in transformers.items():
        known = OF_DRIVES if not set(drives).isdisjoint(machines) else ("drive_current",)
        for channel in filter(known.__contains__, COLUMNS):
            title = f"{COLUMNS[channel][0]} {name}"
            lines += [f"[{channel}.{json.dumps('+'.join(drives))}]"]
            lines += [f"column = {json.dumps(title)}", 'kind = "scaled"', ""]
    return "\n".join(lines)


def write_throw(
    dataset: xr.Dataset, path: Path, *, channel_map: ChannelMap, number: int, note: str
) -> None:
    """Write a recording: through the measuring chain backwards to the raw signals.

    Parameters
    ----------
    dataset : xarray.Dataset
        Forces and currents as a converter gave them out.
    path : Path
        File to write; its suffix selects the format.
    channel_map : ChannelMap
        Measuring chain that turns quantities into raw units.
    number : int
        Number of the throw, which sets its time of day.
    note : str
        Origin, as stated in the file.
    """
    recording = raw_from_physical(dataset, channel_map)
    channels = {
        name: replace(channel, description=note) for name, channel in recording.channels.items()
    }
    start = (START + timedelta(minutes=2 * number)).isoformat()
    recording = replace(recording, channels=channels, source=note, start_time=start)
    content = WRITERS[path.suffix](recording)
    if path.suffix == ".csv":
        content = f"Comment: {note}\n".encode() + content
    elif path.suffix == ".mat":
        # The text on top, 116 bytes, would else be the time of writing: no two files the same.
        heading = f"MATLAB 5.0 MAT-file, {note}".encode("ascii", "replace")
        content = heading[:116].ljust(116) + content[116:]
    write_atomic(path, content)


@dataclass(frozen=True, slots=True)
class WrittenThrow:
    """Result of a case: its file, and True if a drive slipped."""

    case: Case
    file: str
    slipped: bool


def sheet_text(thrown: Sequence[WrittenThrow], *, note: str, title: str, panel: str = "") -> str:
    """Return a run sheet.

    Examples
    --------
    >>> case = Case(name="a", direction="closing", size=0.013, place="sleeper 6")
    >>> thrown = [WrittenThrow(case, "a.csv", False)]
    >>> print(sheet_text(thrown, note="synthetic: x", title="y", panel="sb2"))
    # title: y
    # panel: sb2
    # synthetic: x
    file,direction,size [mm],place,repeat,slip,remark
    a.csv,closing,13,sleeper 6,1,no,
    <BLANKLINE>
    """
    content = io.StringIO()
    content.write(f"# title: {title}\n" + (f"# panel: {panel}\n" if panel else ""))
    content.write(f"# synthetic: {note.removeprefix('synthetic: ')}\n")
    table = csv.writer(content, lineterminator="\n")
    table.writerow(["file", "direction", "size [mm]", "place", "repeat", "slip", "remark"])
    for item in thrown:
        case = item.case
        slip = "yes" if item.slipped else "no"
        size = f"{case.size * 1e3:g}"
        table.writerow([item.file, case.direction, size, case.place, case.repeat, slip, ""])
    return content.getvalue()


def mistype(
    thrown: Sequence[WrittenThrow], *, count: int, rng: np.random.Generator
) -> tuple[list[WrittenThrow], list[str]]:
    """Return a sheet's lines with mistakes as people make them, and a text for each mistake.

    Sizes of two neighbours are exchanged, a direction is turned, a slip is ticked wrongly, a file
    name is misspelt, in turn.

    Parameters
    ----------
    thrown : sequence of WrittenThrow
        Throws with the run-sheet line that is true of each.
    count : int
        How many mistakes.
    rng : numpy.random.Generator
        Source of the random numbers.

    Returns
    -------
    lines : list of WrittenThrow
    mistakes : list of str
    """
    lines = list(thrown)
    mistakes: list[str] = []
    free = list(range(len(lines)))
    kinds = ("size", "direction", "slip", "file")
    for number in range(len(kinds) * count):
        kind = kinds[number % len(kinds)]
        pairs = [
            at
            for at in free
            if at + 1 in free
            and lines[at].case.size > 0
            and lines[at + 1].case.size > 0
            and lines[at].case.place == lines[at + 1].case.place
        ]
        pool = pairs if kind == "size" else free
        if not pool or len(mistakes) == count:
            continue
        at = int(rng.choice(pool))
        free.remove(at)
        line = lines[at]
        if kind == "size":
            free.remove(at + 1)
            one, two = line.case.size, lines[at + 1].case.size
            lines[at] = replace(line, case=replace(line.case, size=two))
            other = lines[at + 1]
            lines[at + 1] = replace(other, case=replace(other.case, size=one))
            mistakes.append(f"sizes of {line.file} and {other.file} exchanged")
        elif kind == "direction":
            turned = "opening" if line.case.direction == "closing" else "closing"
            # Repeats of the other direction have this number too.
            case = replace(line.case, direction=turned, repeat=line.case.repeat + 50)
            lines[at] = replace(line, case=case)
            mistakes.append(f"direction of {line.file} turned")
        elif kind == "slip":
            lines[at] = replace(line, slipped=not line.slipped)
            mistakes.append(f"slip of {line.file} ticked wrongly")
        else:
            wrong = line.file.replace("_", "-", 1)
            lines[at] = replace(line, file=wrong)
            mistakes.append(f"{line.file} misspelt as {wrong}")
    return lines, mistakes


def true_sheet_row(item: WrittenThrow) -> SheetRow:
    """Return the line of a sheet without mistakes.

    Examples
    --------
    >>> case = Case(name="a", direction="closing", size=0.013, place="sleeper 6")
    >>> true_sheet_row(WrittenThrow(case, "a.csv", True)).load_cell
    True
    """
    case = item.case
    return SheetRow(
        where=case.name,
        file=item.file,
        movement=1,
        direction=case.direction,
        size=case.size,
        place=case.place,
        repeat=case.repeat,
        slip=item.slipped,
        load_cell=case.size > 0,
        remark="",
    )
