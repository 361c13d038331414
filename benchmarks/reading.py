"""Time the reading of an hour of five channels at 1 kHz, for docs/evidence.

    python -m benchmarks.reading

Each reading is a process of its own, so that its peak memory is its own; the time is from the
imported program to the recording, the median and spread of several. The text has six decimals.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import savemat

from benchmarks.machine import machine
from benchmarks.page import write_section
from turnout.measurement.formats.file_format import write_recording
from turnout.measurement.recording import RecordedChannel, Recording

SECONDS, RATE, CHANNELS = 3600, 1000, 5
REPEATS = 3

READ = """
import resource, sys, time
from turnout.measurement.formats.file_format import read_recording
def peak():
    with open("/proc/self/status") as file:
        return int(next(line for line in file if line.startswith("VmHWM")).split()[1])
def used():
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, kinds))
before, processor, began = peak(), used(), time.perf_counter()
recording = read_recording(sys.argv[1])
seconds, processor = time.perf_counter() - began, used() - processor
assert len(recording.channels) == 5, recording.problems
assert all(c.values.size == 3_600_000 and c.rate == 1000 for c in recording.channels.values())
child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
# a helper has ended before its numbers are loaded here
print(seconds, processor, max(peak(), before + child) / 1024)
"""


def hour() -> Recording:
    """Return noise about slow waves, as a rod between throws gives it."""
    rng = np.random.default_rng(5)
    time = np.arange(SECONDS * RATE) / RATE
    channels = {}
    for number in range(1, CHANNELS + 1):
        values = np.sin(time / (10 * number)) + rng.normal(scale=0.01, size=time.size)
        channels[f"AI {number}"] = RecordedChannel(
            f"AI {number}", "mV/V", np.round(values, 6), RATE
        )
    return Recording(channels, "an hour")


def write_all(recording: Recording, folder: Path) -> dict[str, Path]:
    """Write the hour in every format that can be written here; return the files by name."""
    names = {
        "MATLAB 5": "hour.mat",
        "HDF5, compressed": "hour.h5",
        "MDF 4": "hour.mf4",
        "TDMS": "hour.tdms",
        "Parquet": "hour.parquet",
        "CSV": "hour.csv",
        "TXT, tabs and decimal commas, UTF-16": "hour.txt",
    }
    files = {name: folder / file for name, file in names.items()}
    time = np.arange(SECONDS * RATE) / RATE
    columns = {name: channel.values for name, channel in recording.channels.items()}
    write_recording(recording, files["HDF5, compressed"])
    savemat(
        files["MATLAB 5"], {"time": time, **{k.replace(" ", "_"): v for k, v in columns.items()}}
    )
    _write_mdf(time, columns, files["MDF 4"])
    _write_tdms(columns, files["TDMS"])
    table = pd.DataFrame({"Time (s)": time, **{f"{k} (mV/V)": v for k, v in columns.items()}})
    table.to_parquet(files["Parquet"])
    table.to_csv(files["CSV"], index=False, float_format="%.6f")
    text = files["CSV"].read_text(encoding="utf-8").replace(",", "\t").replace(".", ",")
    files["TXT, tabs and decimal commas, UTF-16"].write_text(text, encoding="utf-16")
    return files


def _write_mdf(time: np.ndarray, columns: dict[str, np.ndarray], path: Path) -> None:
    import asammdf

    with asammdf.MDF() as file:
        file.append([asammdf.Signal(v, time, name=k, unit="mV/V") for k, v in columns.items()])
        file.save(path, overwrite=True)


def _write_tdms(columns: dict[str, np.ndarray], path: Path) -> None:
    import nptdms

    reported = {"wf_increment": 1 / RATE, "unit_string": "mV/V"}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("A", k, v, reported) for k, v in columns.items()])


def measured(path: Path) -> tuple[list[float], float, float]:
    """Return seconds of repeated readings, those of the processor, and the largest memory [MB]."""
    seconds, processor, peak = [], [], 0.0
    for _ in range(REPEATS):
        run = subprocess.run(
            [sys.executable, "-c", READ, str(path)], check=True, capture_output=True, text=True
        )
        taken, busy, memory = (float(word) for word in run.stdout.split())
        seconds.append(taken)
        processor.append(busy)
        peak = max(peak, memory)
    return seconds, statistics.median(processor), peak


def main() -> None:
    """Measure and write the section."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    lines = [
        f"Written by `python -m benchmarks.reading` on {machine()}.",
        f"One hour of {CHANNELS} channels at 1 kHz, {SECONDS * RATE / 1e6:g} million samples each.",
        f"Median and spread of {REPEATS} readings, each in a process of its own. Processor time",
        "and memory count the helper of formats that have one. The machine was busy with other",
        "work, which is in the median and not in the processor time. Wanted: 5 s for binary",
        "formats, 15 s for text, less than 1000 MB.",
        "",
        "| format | file [MB] | median [s] | spread [s] | processor [s] | memory [MB] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    with tempfile.TemporaryDirectory() as folder:
        for name, path in write_all(hour(), Path(folder)).items():
            seconds, processor, peak = measured(path)
            size = path.stat().st_size / 1e6
            times = f"{statistics.median(seconds):.2f} | {min(seconds):.2f} to {max(seconds):.2f}"
            row = f"| {name} | {size:.0f} | {times} | {processor:.2f} | {peak:.0f} |"
            lines.append(row)
    lines += ["", "Dewesoft's own format is not in the table: nothing but DewesoftX writes it."]
    write_section("Recordings", "\n".join(lines))


if __name__ == "__main__":
    main()
